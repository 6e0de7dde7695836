//! The robot's flash: memory that is lost with the process, or a file.
//!
//! As in [`reagent_slots::ram`], the file holds the complement of what is read: a new one is sparse, and
//! grows with what is written.

use embedded_storage_async::nor_flash::{
    ErrorType, NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash,
};
use reagent_slots::Layout;
use reagent_slots::ram::{RamError, RamFlash};
use std::fs::{File, OpenOptions, TryLockError};
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::Path;

/// Bytes of a word.
const WORD: usize = 4;
/// Bytes of an erase block.
const BLOCK: usize = 4096;
/// Bytes of a slot: an f32 policy and its header.
const SLOT: usize = 12 << 20;
/// Bytes of the whole flash.
const CAPACITY: usize = 2 * BLOCK + 2 * SLOT;

/// Why the flash failed.
#[derive(Debug)]
pub enum FlashError {
    /// In memory.
    Ram(RamError),
    /// In a file.
    File(io::Error),
}

impl NorFlashError for FlashError {
    fn kind(&self) -> NorFlashErrorKind {
        NorFlashErrorKind::Other
    }
}

/// NOR flash of a simulated robot: words of 4 bytes, blocks of 4 KiB, 24 MiB.
#[derive(Debug)]
pub enum RobotFlash {
    /// Lost with the process.
    Memory(RamFlash<Vec<u8>, WORD, BLOCK>),
    /// Kept.
    File(File),
}

impl RobotFlash {
    /// Erased flash in memory; pages that nothing is written to cost none.
    pub fn in_memory() -> Self {
        RobotFlash::Memory(RamFlash::new(vec![0; CAPACITY]))
    }

    /// Flash in the file `flash.bin` of a directory, both made where they are missing.
    ///
    /// # Errors
    /// Those of the file system; `WouldBlock` where another robot holds the file.
    pub fn in_directory(directory: &Path) -> io::Result<Self> {
        std::fs::create_dir_all(directory)?;
        let file = OpenOptions::new()
            .read(true)
            .write(true)
            .create(true)
            .truncate(false)
            .open(directory.join("flash.bin"))?;
        file.try_lock().map_err(|error| match error {
            TryLockError::WouldBlock => io::Error::new(
                io::ErrorKind::WouldBlock,
                "another robot uses this state directory",
            ),
            TryLockError::Error(error) => error,
        })?;
        if file.metadata()?.len() != CAPACITY as u64 {
            file.set_len(CAPACITY as u64)?;
        }
        Ok(RobotFlash::File(file))
    }

    /// The record and two slots for chunks of this length.
    pub fn layout(chunk: u32) -> Layout {
        Layout::over::<RobotFlash>(CAPACITY as u32, chunk)
    }
}

impl ErrorType for RobotFlash {
    type Error = FlashError;
}

impl ReadNorFlash for RobotFlash {
    const READ_SIZE: usize = WORD;

    async fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), FlashError> {
        match self {
            RobotFlash::Memory(ram) => ram.read(offset, bytes).await.map_err(FlashError::Ram),
            RobotFlash::File(file) => read_at(file, offset, bytes).map_err(FlashError::File),
        }
    }

    fn capacity(&self) -> usize {
        CAPACITY
    }
}

impl NorFlash for RobotFlash {
    const WRITE_SIZE: usize = WORD;
    const ERASE_SIZE: usize = BLOCK;

    async fn erase(&mut self, from: u32, to: u32) -> Result<(), FlashError> {
        match self {
            RobotFlash::Memory(ram) => ram.erase(from, to).await.map_err(FlashError::Ram),
            RobotFlash::File(file) => {
                let zeros = vec![0; to.saturating_sub(from) as usize];
                write_at(file, from, &zeros).map_err(FlashError::File)
            }
        }
    }

    async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), FlashError> {
        match self {
            RobotFlash::Memory(ram) => ram.write(offset, bytes).await.map_err(FlashError::Ram),
            RobotFlash::File(file) => {
                let complement: Vec<u8> = bytes.iter().map(|byte| !byte).collect();
                write_at(file, offset, &complement).map_err(FlashError::File)
            }
        }
    }
}

fn read_at(file: &mut File, offset: u32, bytes: &mut [u8]) -> io::Result<()> {
    file.seek(SeekFrom::Start(offset.into()))?;
    file.read_exact(bytes)?;
    bytes.iter_mut().for_each(|byte| *byte = !*byte);
    Ok(())
}

/// Writes and waits until it is kept: what is written later is never kept without it.
fn write_at(file: &mut File, offset: u32, bytes: &[u8]) -> io::Result<()> {
    file.seek(SeekFrom::Start(offset.into()))?;
    file.write_all(bytes)?;
    file.sync_data()
}
