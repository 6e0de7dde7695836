//! Detects once which instruction sets this machine runs.

use core::arch::x86_64::__cpuid_count;
use core::sync::atomic::{AtomicU8, Ordering};

cpufeatures::new!(has_avx2, "avx2", "fma");
cpufeatures::new!(has_avx512, "avx512f");
cpufeatures::new!(has_avx512_bytes, "avx512bw");

pub(in crate::kernels) const AVX2: u8 = 1;
pub(in crate::kernels) const AVX_VNNI: u8 = 2;
pub(in crate::kernels) const AVX512: u8 = 4;
pub(in crate::kernels) const AVX512_VNNI: u8 = 8;
pub(in crate::kernels) const AMX: u8 = 16;
/// Set once detection is done.
const KNOWN: u8 = 128;

static FOUND: AtomicU8 = AtomicU8::new(0);

/// Whether the machine runs all of `wanted`.
pub(in crate::kernels) fn has(wanted: u8) -> bool {
    let mut found = FOUND.load(Ordering::Relaxed);
    if found == 0 {
        found = detect() | KNOWN;
        FOUND.store(found, Ordering::Relaxed);
    }
    found & wanted == wanted
}

/// Detects the instruction sets. `cpufeatures` asks whether the system saves the registers. The extensions that it does not
/// know need no more than that, except AMX, for which Linux is asked. The AVX-512 kernels also use AVX2 and FMA, which a
/// machine (or whoever masks its features) announces separately.
fn detect() -> u8 {
    if !has_avx2::get() {
        return 0;
    }
    let mut found = AVX2;
    if __cpuid_count(7, 1).eax & (1 << 4) != 0 {
        found |= AVX_VNNI;
    }
    if has_avx512::get() {
        found |= AVX512;
        let leaf = __cpuid_count(7, 0);
        if leaf.ecx & (1 << 11) != 0 && has_avx512_bytes::get() {
            found |= AVX512_VNNI;
            let amx = (1 << 22) | (1 << 24) | (1 << 25);
            if leaf.edx & amx == amx && super::amx::permitted() {
                found |= AMX;
            }
        }
    }
    found
}
