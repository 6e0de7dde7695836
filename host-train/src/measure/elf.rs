//! What a microcontroller's linked image holds: its bytes in flash, and whether it can panic.

use object::elf::SHF_ALLOC;
use object::{Object, ObjectSection, ObjectSymbol, SectionFlags, SectionKind};
use std::path::Path;

/// Why an image cannot be inspected.
#[derive(Debug, thiserror::Error)]
pub enum ImageError {
    /// The file cannot be read.
    #[error("cannot read the image {path}: {reason}")]
    Read {
        /// The file.
        path: String,
        /// What the system said.
        reason: std::io::Error,
    },
    /// The file is not an ELF image.
    #[error("{path} is no ELF image: {reason}")]
    Format {
        /// The file.
        path: String,
        /// What is wrong.
        reason: object::Error,
    },
}

/// What an image holds.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Image {
    /// Bytes that go into flash: program, constants, initial values of variables.
    pub flash_bytes: usize,
    /// Symbols of the panicking machinery that are linked; empty for an image that cannot panic.
    pub panics: Vec<String>,
}

/// Inspects an ELF image.
///
/// # Errors
/// See [`ImageError`].
pub fn read(path: &Path) -> Result<Image, ImageError> {
    let name = || path.display().to_string();
    let bytes = std::fs::read(path).map_err(|reason| ImageError::Read {
        path: name(),
        reason,
    })?;
    let format = |reason| ImageError::Format {
        path: name(),
        reason,
    };
    let file = object::File::parse(&*bytes).map_err(format)?;
    let sections = file.sections().filter(|section| {
        let allocated = match section.flags() {
            SectionFlags::Elf { sh_flags } => sh_flags & u64::from(SHF_ALLOC) != 0,
            _ => false,
        };
        allocated && section.kind() != SectionKind::UninitializedData
    });
    let symbols = file.symbols().filter_map(|symbol| symbol.name().ok());
    Ok(Image {
        flash_bytes: sections.map(|section| section.size() as usize).sum(),
        // Mangled paths hold each name after its length: `core::panicking::…`.
        panics: symbols
            .filter(|name| name.contains("9panicking"))
            .map(str::to_owned)
            .collect(),
    })
}
