//! Shared parts of the integration tests: golden numbers, the place of optional data, a depth image, and a network.
//!
//! Golden numbers are outputs of the authors' PyTorch implementation of ReAgent for recorded inputs. Small extracts are
//! in `tests/fixtures`; the complete file is used if it lies beside the checkout.

pub mod depth;
pub mod network;

use host_train::learn::nn::{Parameters, Shape};
use safetensors::{Dtype, SafeTensors};
use std::path::{Path, PathBuf};

/// Named arrays of golden numbers.
pub struct Golden {
    bytes: Vec<u8>,
    origin: PathBuf,
}

impl Golden {
    /// The complete reference file. If it is absent, prints why a test is skipped.
    pub fn full() -> Option<Golden> {
        let origin = shared("fixtures/reagent_reference.safetensors")?;
        Some(Golden::read(origin))
    }

    /// A committed extract, `tests/fixtures/<file>`.
    pub fn extract(file: &str) -> Golden {
        Golden::read(
            Path::new(env!("CARGO_MANIFEST_DIR"))
                .join("fixtures")
                .join(file),
        )
    }

    /// The extract, and the complete file if there is one.
    pub fn available(file: &str) -> Vec<Golden> {
        [Golden::extract(file)]
            .into_iter()
            .chain(Golden::full())
            .collect()
    }

    /// Shape and values, row-major, of an f32 array.
    pub fn f32(&self, name: &str) -> (Vec<usize>, Vec<f32>) {
        self.values(name, Dtype::F32, f32::from_le_bytes)
    }

    /// Shape and values, row-major, of an i64 array.
    pub fn i64(&self, name: &str) -> (Vec<usize>, Vec<i64>) {
        self.values(name, Dtype::I64, i64::from_le_bytes)
    }

    /// Clouds of an array `[.., N, 3]`: one vector of N points for each leading index.
    pub fn clouds(&self, name: &str) -> Vec<Vec<[f32; 3]>> {
        let (shape, values) = self.f32(name);
        let points = shape[shape.len() - 2];
        let (rows, _) = values.as_chunks::<3>();
        rows.chunks(points).map(<[_]>::to_vec).collect()
    }

    fn read(origin: PathBuf) -> Golden {
        let bytes =
            std::fs::read(&origin).unwrap_or_else(|error| panic!("{}: {error}", origin.display()));
        Golden { bytes, origin }
    }

    fn values<T, const SIZE: usize>(
        &self,
        name: &str,
        dtype: Dtype,
        decode: fn([u8; SIZE]) -> T,
    ) -> (Vec<usize>, Vec<T>) {
        let file = SafeTensors::deserialize(&self.bytes).expect("golden file is readable");
        let array = file
            .tensor(name)
            .unwrap_or_else(|error| panic!("{}: {name}: {error}", self.origin.display()));
        assert_eq!(array.dtype(), dtype, "{name}");
        let (values, _) = array.data().as_chunks::<SIZE>();
        (
            array.shape().to_vec(),
            values.iter().copied().map(decode).collect(),
        )
    }
}

/// A file or folder of the optional data beside the checkout. If it is absent, says so on stderr.
pub fn shared(path: &str) -> Option<PathBuf> {
    let full = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../../shared")
        .join(path);
    if full.exists() {
        Some(full)
    } else {
        eprintln!("skipped in part: {} is absent", full.display());
        None
    }
}

/// The reference weights of the complete golden file.
pub fn reference_parameters(golden: &Golden) -> Parameters {
    let mut parameters = Parameters::zeros(Shape::PAPER);
    for i in 0..parameters.layers.len() {
        let name = parameters.layers[i].name;
        let (weight, bias) = parameters.layer_mut(i);
        weight.copy_from_slice(&golden.f32(&format!("{name}.weight")).1);
        bias.copy_from_slice(&golden.f32(&format!("{name}.bias")).1);
    }
    parameters
}
