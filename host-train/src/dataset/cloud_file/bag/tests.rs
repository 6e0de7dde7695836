use super::*;
use crate::pose64::Position;
use std::collections::BTreeMap;
use tempfile::TempDir;

/// Written by rosbags and by MCAP's Python library: see `tests/bags.py`.
fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../tests/fixtures/bags")
        .join(name)
}

fn folder() -> TempDir {
    tempfile::tempdir().expect("a temporary folder")
}

/// The clouds of a bag up to the first error.
fn clouds(path: &Path) -> (Vec<Vec<Position>>, Option<String>) {
    let bag = match Bag::open(path, Some("/camera/points")) {
        Ok(bag) => bag,
        Err(error) => return (Vec::new(), Some(error.to_string())),
    };
    let mut clouds = Vec::new();
    for message in bag.messages() {
        let cloud = message.map_err(|e| e.to_string());
        match cloud.and_then(|message| message.cloud().map_err(|e| e.to_string())) {
            Ok((cloud, _)) => clouds.push(cloud.points),
            Err(error) => return (clouds, Some(error)),
        }
    }
    (clouds, None)
}

#[test]
fn messages_are_named_by_number_or_time() {
    assert_eq!("12".parse(), Ok(MessageSelector::Number(12)));
    let after = Duration::from_millis(2500);
    assert_eq!("2.5s".parse(), Ok(MessageSelector::After(after)));
    for wrong in ["", "s", "-1", "-1s", "1e99s", "nans", "2.5", "first"] {
        assert!(wrong.parse::<MessageSelector>().is_err(), "{wrong}");
    }
    let bag = Bag::open(&fixture("lz4.mcap"), None).expect("one topic");
    // Ten a second, each a microsecond after a message of another topic.
    for (which, number) in [
        (MessageSelector::FIRST, 0),
        (MessageSelector::Number(5), 5),
        (MessageSelector::After(Duration::ZERO), 0),
        (MessageSelector::After(Duration::from_micros(1)), 0),
        (MessageSelector::After(Duration::from_micros(2)), 1),
        (MessageSelector::After(Duration::from_millis(500)), 5),
    ] {
        let message = bag.message(which).expect("there is one");
        assert_eq!(message.number, number, "{which:?}");
        let (cloud, stamp) = message.cloud().expect("a cloud");
        assert_eq!((stamp.sec, stamp.nanosec), (number as i32, 5));
        // One point is not finite; the division into two or four rows drops the remainder.
        let points = cloud.points.len();
        assert!((197..=200).contains(&points), "{points}");
    }
    for which in [
        MessageSelector::Number(6),
        MessageSelector::After(Duration::from_millis(501)),
    ] {
        let said = bag.message(which).expect_err("there is none").to_string();
        assert!(
            said.contains("/camera/points of the bag has 6 messages, the last 0.500 s after"),
            "{said}"
        );
    }
}

#[test]
fn every_compression_and_layout_gives_the_same_part() {
    for (name, count) in [("lz4.mcap", 6), ("zstd.mcap", 2), ("two_topics.mcap", 5)] {
        let (clouds, error) = clouds(&fixture(name));
        assert_eq!((clouds.len(), error), (count, None), "{name}");
        for (number, cloud) in clouds.iter().enumerate() {
            // A box of 0.3 by 0.2 by 0.1 whose corner stands by the shift of its message.
            let shift = [0.02, -0.01, 0.0].map(|step| step * number as f64);
            let near = |p: &Position| {
                let [x, y, z] = [p[0] - shift[0], p[1] - shift[1], p[2] - 0.5];
                (x * x + y * y + z * z).sqrt() < 0.24
            };
            assert!(cloud.iter().all(near), "{name} {number}");
        }
    }
}

#[test]
fn what_a_cloud_is_of_is_noted() {
    let cloud = read(&fixture("lz4.mcap"), None, MessageSelector::Number(1)).expect("a cloud");
    let notes: Vec<String> = cloud.notes.iter().map(ToString::to_string).collect();
    assert_eq!(
        notes,
        [
            "message 1 of /camera/points, stamped 1.000000005",
            "left out 1 invalid point (NaN, infinite or beyond 1e12)"
        ]
    );
}

#[test]
fn topics_that_have_no_clouds_are_refused_with_those_that_have() {
    let path = fixture("two_topics.mcap");
    let said = |topic| {
        let refused = Bag::open(&path, topic).expect_err("refused");
        refused.to_string()
    };
    let both = "/camera/points, /lidar/points";
    let several = format!("several topics of the bag have clouds; name one with --topic: {both}");
    assert!(said(None).ends_with(&several), "{}", said(None));
    let none = format!("the bag has no topic /points; topics with clouds: {both}");
    assert!(said(Some("/points")).ends_with(&none));
    let other = said(Some("/camera/label"));
    assert!(other.contains("is std_msgs/msg/Header, and") && other.ends_with(both));
    assert!(Bag::open(&path, Some("/lidar/points")).is_ok());
}

#[test]
fn files_of_a_folder_follow_each_other_by_number() {
    let folder = folder();
    let at = |name: &str| folder.path().join(name);
    for name in [
        "metadata.yaml",
        "b_10.mcap",
        "b_2.mcap",
        "b_0.mcap",
        "b.txt",
    ] {
        std::fs::write(at(name), "").expect("written");
    }
    assert!(is_bag(folder.path()) && is_bag(&at("x.MCAP")) && !is_bag(&at("b.txt")));
    let found = files(folder.path()).expect("three");
    assert_eq!(found, ["b_0.mcap", "b_2.mcap", "b_10.mcap"].map(at));
}

#[test]
fn other_kinds_are_refused_with_what_to_do() {
    let folder = folder();
    let said = |name: &str, content: &[u8]| {
        let path = folder.path().join(name);
        std::fs::write(&path, content).expect("written");
        let refused = Bag::open(&path, None).expect_err("refused").to_string();
        assert!(
            refused.contains(name) && !refused.contains('\n'),
            "{refused}"
        );
        refused
    };
    let magic = mcap::MAGIC;
    for (name, content, reason) in [
        ("a.db3", &b"SQLite format 3\0"[..], "ros2 bag convert -i"),
        ("a.mcap.zstd", &super::ZSTD, "zstd -d"),
        ("empty.mcap", b"", "no points: the file is empty"),
        ("text.mcap", b"0 0 0\n1 0 0\n", "it is no MCAP file"),
        ("begun.mcap", magic, "cut off at 8 bytes"),
        ("zeros.mcap", &[magic, &[0; 64][..]].concat(), "cut off"),
    ] {
        let refused = said(name, content);
        assert!(refused.contains(reason), "{refused}");
    }
    std::fs::write(folder.path().join("metadata.yaml"), "").expect("written");
    let sqlite = Bag::open(folder.path(), None);
    // One file that is read, and the others do not matter.
    assert!(matches!(
        sqlite,
        Err(BagError::CutOff { .. } | BagError::NotMcap { .. } | BagError::Damaged { .. })
    ));
}

/// Whatever is still read from a damaged bag is what was written.
#[test]
fn damaged_bags_end_early_or_are_refused() {
    let folder = folder();
    let path = folder.path().join("damaged.mcap");
    for name in ["lz4.mcap", "zstd.mcap", "two_topics.mcap"] {
        let bytes = std::fs::read(fixture(name)).expect("a fixture");
        let (whole, _) = clouds(&fixture(name));
        let mut read = 0;
        for end in (97..bytes.len()).step_by(97) {
            std::fs::write(&path, &bytes[..end]).expect("written");
            let (clouds, error) = clouds(&path);
            assert!(
                error.is_some_and(|said| said.contains("cut off") || said.contains("no topic")),
                "{name} {end}"
            );
            assert_eq!(clouds, whole[..clouds.len()], "{name} {end}");
            read = read.max(clouds.len());
        }
        assert_eq!(read, whole.len(), "{name}");
        for at in (0..bytes.len()).step_by(31) {
            let mut bytes = bytes.clone();
            bytes[at] ^= 1 << (at % 8);
            std::fs::write(&path, &bytes).expect("written");
            let (clouds, _) = clouds(&path);
            // With checksums of chunks, nothing else is read.
            if name == "lz4.mcap" {
                assert!(clouds.iter().all(|cloud| whole.contains(cloud)), "{at}");
            }
        }
    }
}

/// Chunks that are neither compressed nor checksummed: a record may claim to be longer than its chunk.
#[test]
fn damaged_lengths_are_no_panic() {
    let folder = folder();
    let path = folder.path().join("plain.mcap");
    let mut bytes = std::io::Cursor::new(Vec::new());
    let options = mcap::WriteOptions::new()
        .compression(None)
        .chunk_size(Some(600))
        .calculate_chunk_crcs(false);
    let mut writer = options.create(&mut bytes).expect("begun");
    let schema = writer.add_schema("sensor_msgs/msg/PointCloud2", "ros2msg", b"");
    let topic = "/camera/points";
    let channel = writer.add_channel(schema.expect("a schema"), topic, "cdr", &BTreeMap::new());
    for sequence in 0..6 {
        let header = mcap::records::MessageHeader {
            channel_id: *channel.as_ref().expect("a channel"),
            sequence,
            log_time: 100,
            publish_time: 100,
        };
        let written = writer.write_to_known_channel(&header, &[7; 200]);
        written.expect("written");
    }
    writer.finish().expect("ended");
    drop(writer);
    let bytes = bytes.into_inner();
    let count = || Bag::open(&path, None).map(|bag| bag.messages().filter(Result::is_ok).count());
    std::fs::write(&path, &bytes).expect("written");
    assert_eq!(count().ok(), Some(6));
    for at in 0..bytes.len() {
        let mut damaged = bytes.clone();
        damaged[at] ^= 0x80;
        std::fs::write(&path, &damaged).expect("written");
        let messages = count().unwrap_or(0);
        assert!(messages <= 6, "{at}: {messages}");
    }
}
