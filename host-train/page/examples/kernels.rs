//! Checks that WebAssembly's byte kernels give the portable kernels' logits, bit for bit; the tests run it in a browser.

use reagent_core::kernels::Isa;
use reagent_core::net::Scratch;
use reagent_core::{Error, Frame, Policy, Pose, Registrar};

type Cloud = Vec<[f32; 3]>;

/// Pairs of clouds.
const PAIRS: usize = 60;
/// Steps of each pair.
const STEPS: usize = 5;

/// Number of pairs compared; 0 if two results differ, or this machine has no kernels of its own.
#[allow(unsafe_code)] // the name alone
#[unsafe(no_mangle)]
pub extern "C" fn compared() -> usize {
    compare().unwrap_or(0)
}

fn compare() -> Result<usize, Error> {
    let mut seed = 5u32;
    let mut number = || {
        seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (seed >> 8) as f32 / (1 << 23) as f32 - 1.0
    };
    let mut compared = 0;
    for pair in 0..PAIRS {
        // Every fifth is stretched, so that codes reach the ends of their range.
        let stretch = if pair % 5 == 0 { 50.0 } else { 1.0 };
        let mut cloud = || -> Cloud {
            let points = 3 + pair * 37 % 300;
            (0..points)
                .map(|_| [stretch * number(), number(), number()])
                .collect()
        };
        let clouds = [cloud(), cloud()];
        let [portable, own] = [Isa::PORTABLE, Isa::best()].map(|isa| logits(isa, &clouds));
        if Isa::best() == Isa::PORTABLE || portable? != own? {
            return Ok(0);
        }
        compared += 1;
    }
    Ok(compared)
}

/// Bits of the logits of all steps of a registration.
fn logits(isa: Isa, [source, target]: &[Cloud; 2]) -> Result<Vec<u32>, Error> {
    let mut scratch = Box::new(Scratch::new());
    let mut registrar = Registrar::with_isa(isa, Policy::pretrained_compact()?, &mut scratch);
    let mut registration = registrar.start(source, target, Frame::IDENTITY, Pose::IDENTITY)?;
    let mut bits = Vec::new();
    for _ in 0..STEPS {
        let step = registrar.step(&mut registration)?;
        let logits = step.logits_t.iter().chain(&step.logits_r);
        bits.extend(logits.map(|x| x.to_bits()));
    }
    Ok(bits)
}
