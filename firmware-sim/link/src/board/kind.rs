//! The boards, and their names for the compiler and the emulator.

/// A board.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Kind {
    /// Cortex-M7, MPS2 with AN500
    CortexM7,
    /// Cortex-M55 with Helium, MPS3 with AN547
    CortexM55,
}

impl Kind {
    /// Every board.
    pub const ALL: [Kind; 2] = [Kind::CortexM7, Kind::CortexM55];

    /// Its target for the compiler.
    pub fn target(self) -> &'static str {
        match self {
            Kind::CortexM7 => "thumbv7em-none-eabihf",
            Kind::CortexM55 => "thumbv8m.main-none-eabihf",
        }
    }

    /// Its processor's name.
    pub fn name(self) -> &'static str {
        match self {
            Kind::CortexM7 => "Cortex-M7",
            Kind::CortexM55 => "Cortex-M55",
        }
    }

    /// The name of its machine in QEMU.
    pub fn machine(self) -> &'static str {
        match self {
            Kind::CortexM7 => "mps2-an500",
            Kind::CortexM55 => "mps3-an547",
        }
    }

    /// Where the policy's flash begins.
    pub(super) fn policy_address(self) -> &'static str {
        match self {
            Kind::CortexM7 => "0x00100000",
            Kind::CortexM55 => "0x60000000",
        }
    }
}
