//! Detects which instruction sets beyond NEON this machine runs.

#![allow(unsafe_code)]

/// Whether the machine has `sdot` for bytes: asks Linux; elsewhere, what the code was compiled for decides.
pub(in crate::kernels) fn has_dot_product() -> bool {
    #[cfg(any(target_os = "linux", target_os = "android"))]
    {
        // SAFETY: getauxval(3) reads what the kernel gave the process, and nothing else.
        let capabilities = unsafe { libc::getauxval(libc::AT_HWCAP) };
        capabilities & libc::HWCAP_ASIMDDP != 0
    }
    #[cfg(not(any(target_os = "linux", target_os = "android")))]
    {
        cfg!(target_feature = "dotprod")
    }
}
