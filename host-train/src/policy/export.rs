//! Conversion of trained parameters to the bytes that robots run, and back.

use super::ExportError;
use super::checkpoint::Checkpoint;
use super::file::WeightFile;
use super::quantise::{self, Ranges};
use crate::dataset::pairs::PairSet;
use crate::learn::env::Accumulation;
use crate::learn::nn::Parameters;
use reagent_core::dims::{LAYERS, LOGITS, padded};
use reagent_core::layer::pack_panels;
use reagent_core::sight::Sight;
use reagent_core::weights::{
    FORMAT_F32, FORMAT_INT8, HEADER, MAGIC, TABLE_ROW, VERSION, file_len, offsets,
};
use reagent_core::{Decision, Error};
use std::path::Path;

impl WeightFile {
    /// The network as a start for further training. The value head, which is not deployed, is drawn from `seed`.
    ///
    /// # Errors
    /// [`ExportError::Integers`] for a file of integers.
    pub fn parameters(&self, seed: u64) -> Result<Parameters, ExportError> {
        let policy = self.policy();
        let network = policy.f32().ok_or(ExportError::Integers)?;
        Ok(Parameters::from_network(policy.shape, network, seed))
    }

    /// The policy of a checkpoint, with the default decision rule of exported policies.
    pub fn from_checkpoint(checkpoint: Checkpoint) -> Result<Self, ExportError> {
        let sight = checkpoint.sight;
        let file = Self::from_parameters(&deployable(checkpoint)?)?;
        Ok(file.deciding(Decision::default()).seeing(sight))
    }

    /// Serialises parameters as [`reagent_core::weights`] describes, without the value head. The policy takes the
    /// most likely steps, as in the paper, until [`Self::deciding`] says otherwise.
    pub fn from_parameters(parameters: &Parameters) -> Result<Self, ExportError> {
        let shape = robot_shape(parameters)?;
        let mut bytes = with_header(&shape, FORMAT_F32);
        let arrays = shape.layers().into_iter().zip(offsets(&shape, FORMAT_F32));
        for (i, ((inputs, outputs), (weight_at, bias_at))) in arrays.enumerate() {
            let mut panels = vec![0.0; inputs * padded(outputs)];
            pack_panels(inputs, outputs, parameters.weight(i), &mut panels);
            let mut put = |at: usize, values: &[f32]| {
                bytes[at..at + 4 * values.len()].copy_from_slice(bytemuck::cast_slice(values));
            };
            put(weight_at, &panels);
            put(bias_at, parameters.bias(i));
        }
        Self::finished(bytes)
    }

    /// Serialises parameters as 8-bit integers ([`reagent_core::quant`]). Registering `pairs` gives the ranges of
    /// the activations, and the mean error of the logits, which is subtracted.
    pub fn from_parameters_int8(
        parameters: &Parameters,
        pairs: &PairSet,
    ) -> Result<Self, ExportError> {
        Self::from_parameters_int8_within(Sight::ALL, parameters, pairs)
    }

    /// The same for a policy that looks at `sight` of both clouds.
    ///
    /// # Errors
    /// As [`Self::from_parameters_int8`].
    pub fn from_parameters_int8_within(
        sight: Sight,
        parameters: &Parameters,
        pairs: &PairSet,
    ) -> Result<Self, ExportError> {
        let ranges = Ranges::calibrate(parameters, pairs, sight);
        let draft = Self::with_ranges(parameters, &ranges, &[[0.0; LOGITS]; 2])?.seeing(sight);
        let exact = Self::from_parameters(parameters)?.seeing(sight);
        let errors = quantise::logit_errors(&exact, &draft, pairs);
        Ok(Self::with_ranges(parameters, &ranges, &errors)?.seeing(sight))
    }

    fn with_ranges(
        parameters: &Parameters,
        ranges: &Ranges,
        logit_errors: &[[f64; LOGITS]; 2],
    ) -> Result<Self, ExportError> {
        let shape = robot_shape(parameters)?;
        if parameters.values.iter().any(|v| !v.is_finite()) {
            return Err(ExportError::Policy {
                path: "the exported policy".into(),
                source: Error::WeightsNotFinite { layer: 0 },
            });
        }
        let mut bytes = with_header(&shape, FORMAT_INT8);
        quantise::write_arrays(&shape, parameters, ranges, logit_errors, &mut bytes);
        Self::finished(bytes)
    }
}

/// The network's shape as robots know it.
fn robot_shape(parameters: &Parameters) -> Result<reagent_core::Shape, ExportError> {
    let shape = parameters.shape;
    shape.deployed().ok_or(ExportError::Shape(shape))
}

/// A file of zeros with its header and layer table filled in.
fn with_header(shape: &reagent_core::Shape, format: u16) -> Vec<u8> {
    let len = file_len(shape, format);
    let mut bytes = vec![0u8; len];
    let mut put = |at: usize, field: &[u8]| bytes[at..at + field.len()].copy_from_slice(field);
    put(0, &MAGIC);
    put(4, &VERSION.to_le_bytes());
    put(6, &format.to_le_bytes());
    put(8, &(len as u32).to_le_bytes());
    put(12, &(LAYERS as u32).to_le_bytes());
    for (i, width) in shape.header().iter().enumerate() {
        put(16 + 2 * i, &width.to_le_bytes());
    }
    let arrays = shape.layers().into_iter().zip(offsets(shape, format));
    for (i, ((inputs, outputs), (weight, bias))) in arrays.enumerate() {
        for (k, field) in [inputs, outputs, weight, bias].into_iter().enumerate() {
            let at = HEADER + i * TABLE_ROW + 4 * k;
            put(at, &(field as u32).to_le_bytes());
        }
    }
    bytes
}

/// Parameters of a checkpoint, of a run directory's checkpoint ([`Checkpoint::find`]), or of an f32 weight file.
pub fn parameters_of(path: &Path) -> Result<Parameters, ExportError> {
    if path.extension().is_some_and(|e| e == "rgw") {
        return WeightFile::load(path)?.parameters(0);
    }
    deployable(Checkpoint::load(&Checkpoint::find(path)?)?)
}

/// The parameters of a checkpoint, if robots can run it.
fn deployable(checkpoint: Checkpoint) -> Result<Parameters, ExportError> {
    match checkpoint.accumulation {
        Accumulation::Global => Ok(checkpoint.result()),
        other => Err(ExportError::Accumulation(other)),
    }
}

#[cfg(test)]
mod tests {
    use super::super::file::seal;
    use super::*;
    use crate::learn::nn::Shape;
    use proptest::prelude::*;
    use reagent_core::weights::DECISION_AT;

    #[test]
    fn parameters_survive_export() {
        let mut parameters = Parameters::random(Shape::PAPER, 1);
        let file = WeightFile::from_parameters(&parameters).expect("deployable");
        let back = file.parameters(1).expect("f32");
        // The value head is not deployed: it is drawn afresh from the same seed.
        assert_eq!(back, parameters);
        parameters.values[0] = f32::NAN;
        let refused = WeightFile::from_parameters(&parameters);
        assert!(matches!(
            refused,
            Err(ExportError::Policy {
                source: Error::WeightsNotFinite { layer: 0 },
                ..
            })
        ));
    }

    #[test]
    fn a_file_says_how_it_decides() {
        let parameters = Parameters::random(Shape::PAPER, 1);
        let file = WeightFile::from_parameters(&parameters).expect("deployable");
        assert_eq!(file.policy().decision, Decision::MostLikely);
        let other = file.clone().deciding(Decision::NearestToMean);
        assert_ne!(other.sha256(), file.sha256());
        let read = WeightFile::from_bytes(other.bytes()).expect("its check sum is right");
        assert_eq!(read.policy().decision, Decision::NearestToMean);
        let often = read.clone().rescanning(3);
        assert_eq!(often.policy().rescan, 3);
        assert_eq!(read.policy().rescan, 1);
        assert_eq!(read.clone().rescanning(1).policy().rescan, 1);
        let same = often.run_like(&file.policy()).rescanning(0);
        assert_eq!(same, file);
        assert_eq!(read.deciding(Decision::MostLikely), file);
        let mut unknown = other.bytes().to_vec();
        unknown[DECISION_AT] = 3;
        seal(&mut unknown);
        let found = WeightFile::from_bytes(&unknown).expect_err("there is no such decision");
        assert_eq!(found, Error::WeightsDecision { found: 3 });
    }

    #[test]
    fn another_shape_is_refused() {
        let small = Shape {
            extra: 0,
            embed: [16, 16, 32],
            head: [16, 16],
        };
        let refused = WeightFile::from_parameters(&Parameters::random(small, 1));
        assert!(matches!(refused, Err(ExportError::Shape(_))));
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        #[test]
        fn any_flipped_bit_or_cut_is_an_error(at in any::<prop::sample::Index>(), bit in 0u8..8) {
            let file = WeightFile::from_parameters(&Parameters::random(Shape::PAPER, 2)).expect("deployable");
            let mut bytes = file.bytes().to_vec();
            let at = at.index(bytes.len());
            bytes[at] ^= 1 << bit;
            prop_assert!(WeightFile::from_bytes(&bytes).is_err());
            bytes[at] ^= 1 << bit;
            bytes.truncate(at);
            prop_assert!(WeightFile::from_bytes(&bytes).is_err());
        }
    }
}
