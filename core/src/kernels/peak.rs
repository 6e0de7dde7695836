//! The arithmetic peak of the present core: multiply-adds on registers, without memory.

#![allow(unsafe_code)]

use super::Isa;
#[cfg(target_arch = "x86_64")]
use super::Kind;

/// The numbers that are multiplied and added.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Arithmetic {
    /// Fused multiply-add of f32.
    F32,
    /// Products of bytes summed in 32 bits.
    Bytes,
}

impl Isa {
    /// Does independent multiply-adds at the core's peak for `rounds` rounds, and returns their number. [`Isa`]'s other kernels
    /// are measured against this. Returns 0 if the core's best is not known.
    pub fn multiply_adds(self, arithmetic: Arithmetic, rounds: u64) -> u64 {
        #[cfg(target_arch = "x86_64")]
        // SAFETY (all): the instruction set was detected.
        return match (self.0, arithmetic) {
            (Kind::Avx2 | Kind::AvxVnni, Arithmetic::F32) => unsafe { x86::f32_256(rounds) },
            (Kind::AvxVnni, Arithmetic::Bytes) => unsafe { x86::bytes_256(rounds) },
            (Kind::Avx512 | Kind::Avx512Vnni | Kind::Amx, Arithmetic::F32) => unsafe {
                x86::f32_512(rounds)
            },
            (Kind::Avx512Vnni, Arithmetic::Bytes) => unsafe { x86::bytes_512(rounds) },
            (Kind::Amx, Arithmetic::Bytes) => unsafe { super::x86::amx::multiply_adds(rounds) },
            _ => 0,
        };
        #[cfg(not(target_arch = "x86_64"))]
        {
            let _ = (arithmetic, rounds);
            0
        }
    }
}

#[cfg(target_arch = "x86_64")]
mod x86 {
    use core::arch::x86_64::*;
    use core::hint::black_box;

    /// Independent sums: enough to hide four cycles of latency on two units.
    const SUMS: usize = 12;

    macro_rules! spin {
        ($name:ident, $features:literal, $zero:expr, $add:expr, $lanes:expr) => {
            #[target_feature(enable = $features)]
            pub(super) fn $name(rounds: u64) -> u64 {
                let (a, b) = black_box(($zero, $zero));
                let mut sums = [$zero; SUMS];
                for _ in 0..rounds {
                    for sum in &mut sums {
                        *sum = $add(*sum, a, b);
                    }
                }
                black_box(sums);
                rounds * SUMS as u64 * $lanes
            }
        };
    }

    spin!(
        f32_256,
        "avx2,fma",
        _mm256_setzero_ps(),
        |s, a, b| _mm256_fmadd_ps(a, b, s),
        8
    );
    spin!(
        f32_512,
        "avx512f",
        _mm512_setzero_ps(),
        |s, a, b| _mm512_fmadd_ps(a, b, s),
        16
    );
    spin!(
        bytes_256,
        "avx2,avxvnni",
        _mm256_setzero_si256(),
        |s, a, b| _mm256_dpbusd_avx_epi32(s, a, b),
        32
    );
    spin!(
        bytes_512,
        "avx512f,avx512vnni",
        _mm512_setzero_si512(),
        |s, a, b| _mm512_dpbusd_epi32(s, a, b),
        64
    );
}
