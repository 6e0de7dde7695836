//! Dispatches to the machine's [`super::lanes::Lanes`].

/// Compiles a function on lanes for each instruction set, and calls the machine's version.
macro_rules! on_lanes {
    ($isa:expr, $of:ident($($arg:ident: $t:ty),* $(,)?) $(-> $out:ty)?) => {{
        #[cfg(target_arch = "x86_64")]
        #[target_feature(enable = "avx2")]
        fn avx2($($arg: $t),*) $(-> $out)? {
            $of::<crate::kernels::x86::lanes::Eight>($($arg),*)
        }
        #[cfg(target_arch = "x86_64")]
        #[target_feature(enable = "avx512f")]
        fn avx512($($arg: $t),*) $(-> $out)? {
            $of::<crate::kernels::x86::lanes::Sixteen>($($arg),*)
        }
        match $isa.floats() {
            // SAFETY: the instruction set was detected.
            #[cfg(target_arch = "x86_64")]
            crate::kernels::Floats::Avx2 => unsafe { avx2($($arg),*) },
            // SAFETY: as above.
            #[cfg(target_arch = "x86_64")]
            crate::kernels::Floats::Avx512 => unsafe { avx512($($arg),*) },
            _ => $of::<crate::kernels::lanes::Four>($($arg),*),
        }
    }};
}
pub(super) use on_lanes;
