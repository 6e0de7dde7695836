//! Checkpoints written here, well formed and broken.

use super::*;
use proptest::prelude::*;
use std::io::Write;
use zip::ZipWriter;
use zip::write::SimpleFileOptions;

/// Contents of a checkpoint to be written.
#[derive(Clone)]
struct Checkpoint {
    nested: bool,
    kind: &'static str,
    layers: Vec<&'static str>,
    /// Numbers cut off the end of each storage.
    cut: usize,
}

impl Checkpoint {
    fn new() -> Checkpoint {
        Checkpoint {
            nested: true,
            kind: "FloatStorage",
            layers: NAMES.map(|(theirs, _)| theirs).into(),
            cut: 0,
        }
    }

    /// A pickle and storages as torch writes them: weights `[2, 3]`, biases `[2]`.
    fn bytes(&self) -> Vec<u8> {
        let text = |pickle: &mut Vec<u8>, text: &str| {
            pickle.push(b'X');
            pickle.extend((text.len() as u32).to_le_bytes());
            pickle.extend(text.as_bytes());
        };
        let mut pickle = b"\x80\x02".to_vec();
        if self.nested {
            pickle.extend(b"}(");
            text(&mut pickle, "epoch");
            pickle.extend(b"K\x00");
            text(&mut pickle, "model_state_dict");
        }
        pickle.extend(b"ccollections\nOrderedDict\n)R(");
        let mut storages = Vec::new();
        for layer in &self.layers {
            for (part, shape) in [("weight", &[2u8, 3][..]), ("bias", &[2])] {
                text(&mut pickle, &format!("{layer}.{part}"));
                pickle.extend(b"ctorch._utils\n_rebuild_tensor_v2\n((");
                text(&mut pickle, "storage");
                pickle.extend(format!("ctorch\n{}\n", self.kind).as_bytes());
                text(&mut pickle, &storages.len().to_string());
                text(&mut pickle, "cpu");
                let numbers = shape.iter().product::<u8>();
                pickle.extend([b'K', numbers, b't', b'Q', b'K', 0]);
                pickle.push(b'(');
                shape.iter().for_each(|&n| pickle.extend([b'K', n]));
                pickle.extend(b"t(");
                let strides = if shape.len() == 2 { &[3, 1][..] } else { &[1] };
                strides.iter().for_each(|&n| pickle.extend([b'K', n]));
                pickle.extend(b"t\x89ccollections\nOrderedDict\n)RtR");
                let first = storages.len() as f32;
                storages.push(
                    (0..numbers)
                        .map(|i| first + f32::from(i) / 8.0)
                        .collect::<Vec<_>>(),
                );
            }
        }
        pickle.push(b'u');
        if self.nested {
            pickle.push(b'u');
        }
        pickle.push(b'.');
        self.zip(&pickle, &storages)
    }

    fn zip(&self, pickle: &[u8], storages: &[Vec<f32>]) -> Vec<u8> {
        let mut zip = ZipWriter::new(std::io::Cursor::new(Vec::new()));
        let options =
            SimpleFileOptions::default().compression_method(zip::CompressionMethod::Stored);
        zip.start_file("run/data.pkl", options).expect("start");
        zip.write_all(pickle).expect("write");
        for (i, storage) in storages.iter().enumerate() {
            zip.start_file(format!("run/data/{i}"), options)
                .expect("start");
            let bytes: Vec<u8> = storage.iter().flat_map(|x| x.to_le_bytes()).collect();
            zip.write_all(&bytes[..bytes.len().saturating_sub(4 * self.cut)])
                .expect("write");
        }
        zip.finish().expect("finish").into_inner()
    }
}

fn import(bytes: &[u8]) -> Result<BTreeMap<String, Tensor>, ImportError> {
    let mut file = tempfile::NamedTempFile::new().expect("temporary file");
    file.write_all(bytes).expect("write");
    read_pytorch(file.path())
}

fn refused(checkpoint: &Checkpoint) -> String {
    import(&checkpoint.bytes())
        .expect_err("must be refused")
        .to_string()
}

#[test]
fn reads_bare_and_nested_state_dicts() {
    let nested = import(&Checkpoint::new().bytes()).expect("well formed");
    assert_eq!(nested.len(), 22);
    assert_eq!(
        nested["embed.conv1.bias"],
        Tensor {
            shape: vec![2],
            data: vec![1.0, 1.125]
        }
    );
    assert_eq!(nested["value.fc2.weight"].shape, [2, 3]);
    let bare = Checkpoint {
        nested: false,
        ..Checkpoint::new()
    };
    assert_eq!(import(&bare.bytes()).expect("well formed"), nested);
}

#[test]
fn refusals_say_what_and_where() {
    let mut checkpoint = Checkpoint::new();
    checkpoint.layers.remove(3);
    assert!(refused(&checkpoint).contains("missing parameter \"actor_critic.emb_t.0.weight\""));
    checkpoint.layers.push("actor_critic.emb_x.0");
    assert!(refused(&checkpoint).contains("unknown parameter \"actor_critic.emb_x.0.weight\""));
    let half = Checkpoint {
        kind: "HalfStorage",
        ..Checkpoint::new()
    };
    assert!(refused(&half).contains("torch.HalfStorage; only f32"));
    let cut = Checkpoint {
        cut: 1,
        ..Checkpoint::new()
    };
    assert!(refused(&cut).contains("5 of 6 numbers"));
    let legacy = import(b"\x80\x02\x8a\nl\xfc\x9cF\xf9 j\xa8P\x19.").expect_err("must be refused");
    assert!(legacy.to_string().contains("before 1.6"));
    assert!(import(b"").is_err());
    assert!(read_pytorch(Path::new("no/such/file.pt")).is_err());
    let number = Checkpoint::new().zip(b"\x80\x02K\x01.", &[]);
    assert!(
        import(&number)
            .expect_err("must be refused")
            .to_string()
            .contains("neither a state dict")
    );
}

proptest! {
    #[test]
    fn flips_and_cuts_never_panic(at: prop::sample::Index, value: u8, cut: prop::sample::Index) {
        let whole = Checkpoint::new().bytes();
        let mut flipped = whole.clone();
        flipped[at.index(whole.len())] = value;
        let _ = import(&flipped);
        prop_assert!(import(&whole[..cut.index(whole.len())]).is_err());
    }
}
