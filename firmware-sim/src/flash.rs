//! The robot's flash: memory that is lost with the process, or a file.
//!
//! As in [`reagent_slots::ram`], the file holds the complement of the bytes that are read. A new file is therefore sparse
//! and grows only as it is written.

use embedded_storage_async::nor_flash::{
    ErrorType, NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash,
};
use reagent_link::files::plain;
use reagent_slots::Layout;
use reagent_slots::ram::{RamError, RamFlash};
use same_file::Handle;
use std::fs::{File, OpenOptions, TryLockError};
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use tempfile::NamedTempFile;

/// Bytes of a word.
const WORD: usize = 4;
/// Bytes of an erase block.
const BLOCK: usize = 4096;
/// Bytes of a slot: an f32 policy and its header.
const SLOT: usize = 12 << 20;
/// Bytes of the whole flash.
pub(crate) const CAPACITY: usize = 2 * BLOCK + 2 * SLOT + 2 * BLOCK;
/// Name of the file in the state directory.
pub const FILE: &str = "flash.bin";

/// Why the flash failed.
#[derive(Debug)]
pub enum FlashError {
    /// The flash in memory failed.
    Ram(RamError),
    /// The file failed.
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
    /// Kept in a file.
    File(StateFile),
}

/// A file that only one robot uses.
#[derive(Debug)]
pub struct StateFile {
    file: File,
    path: PathBuf,
    /// Identity of the file when it was opened.
    opened: Handle,
}

impl StateFile {
    fn open(directory: &Path, path: &Path) -> io::Result<StateFile> {
        std::fs::create_dir_all(directory).map_err(|error| match error.kind() {
            io::ErrorKind::AlreadyExists => io::Error::new(error.kind(), "it is no directory"),
            _ => error,
        })?;
        if !path.try_exists()? {
            create_whole(directory, path)?;
        }
        let file = OpenOptions::new().read(true).write(true).open(path)?;
        file.try_lock().map_err(not_locked)?;
        checked_length(&file)?;
        Ok(StateFile {
            opened: Handle::from_file(file.try_clone()?)?,
            path: path.into(),
            file,
        })
    }

    fn is_in_place(&self) -> bool {
        Handle::from_path(&self.path).is_ok_and(|found| found == self.opened)
    }
}

/// Creates a flash of full length under its name at once: a shorter one has lost its content. A file that somebody else created
/// meanwhile stays.
fn create_whole(directory: &Path, path: &Path) -> io::Result<()> {
    let file = NamedTempFile::new_in(directory).map_err(plain)?;
    file.as_file().set_len(CAPACITY as u64)?;
    file.as_file().sync_all()?;
    match file.persist_noclobber(path) {
        Err(refused) if refused.error.kind() != io::ErrorKind::AlreadyExists => Err(refused.error),
        _ => Ok(()),
    }
}

fn may_only_be_read(error: &io::Error) -> bool {
    let kinds = [
        io::ErrorKind::PermissionDenied,
        io::ErrorKind::ReadOnlyFilesystem,
    ];
    kinds.contains(&error.kind())
}

/// The content of a file that cannot be written.
fn copy(path: &Path) -> io::Result<Vec<u8>> {
    let mut file = File::open(path)?;
    file.try_lock_shared().map_err(not_locked)?;
    checked_length(&file)?;
    let mut content = Vec::with_capacity(CAPACITY);
    file.read_to_end(&mut content)?;
    content.resize(CAPACITY, 0);
    Ok(content)
}

fn not_locked(error: TryLockError) -> io::Error {
    match error {
        TryLockError::WouldBlock => io::Error::new(
            io::ErrorKind::WouldBlock,
            "another robot uses this state directory",
        ),
        TryLockError::Error(error) => error,
    }
}

/// Accepts a shorter file, of an older layout or cut off: the missing part reads as erased flash.
fn checked_length(file: &File) -> io::Result<()> {
    let length = file.metadata()?.len();
    if length <= CAPACITY as u64 {
        return Ok(());
    }
    Err(io::Error::new(
        io::ErrorKind::InvalidData,
        format!("{FILE} has {length} bytes, more than a robot's flash of {CAPACITY}"),
    ))
}

impl RobotFlash {
    /// Erased flash in memory. Pages that are never written take no memory.
    pub fn in_memory() -> Self {
        RobotFlash::Memory(RamFlash::new(vec![0; CAPACITY]))
    }

    /// Flash in the file `flash.bin` of a directory. Both are created if they are missing. A read-only file is copied into
    /// memory: the robot starts with its content and forgets later changes.
    ///
    /// # Errors
    /// Those of the file system; `WouldBlock` if another robot holds the file; `InvalidData` if the file is longer than the
    /// flash.
    pub fn in_directory(directory: &Path) -> io::Result<Self> {
        let path = directory.join(FILE);
        match StateFile::open(directory, &path) {
            Ok(file) => Ok(RobotFlash::File(file)),
            Err(error) if may_only_be_read(&error) && path.exists() => {
                let memory = copy(&path)?;
                tracing::warn!(
                    "{} may only be read: what the robot takes from here on is lost when it ends",
                    path.display()
                );
                Ok(RobotFlash::Memory(RamFlash::new(memory)))
            }
            Err(error) => Err(error),
        }
    }

    /// Whether written data will be found again. False if the file was deleted or replaced.
    pub fn is_in_place(&self) -> bool {
        match self {
            RobotFlash::Memory(_) => true,
            RobotFlash::File(file) => file.is_in_place(),
        }
    }

    /// Gives a shorter file its full length.
    ///
    /// # Errors
    /// Those of the file system.
    pub(crate) fn make_whole(&self) -> io::Result<()> {
        let RobotFlash::File(StateFile { file, .. }) = self else {
            return Ok(());
        };
        if file.metadata()?.len() < CAPACITY as u64 {
            file.set_len(CAPACITY as u64)?;
            file.sync_all()?;
        }
        Ok(())
    }

    /// The records and two slots for chunks of this length.
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
            RobotFlash::File(file) => {
                read_at(&mut file.file, offset, bytes).map_err(FlashError::File)
            }
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
                write_at(&mut file.file, from, &zeros).map_err(FlashError::File)
            }
        }
    }

    async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), FlashError> {
        match self {
            RobotFlash::Memory(ram) => ram.write(offset, bytes).await.map_err(FlashError::Ram),
            RobotFlash::File(file) => {
                let complement: Vec<u8> = bytes.iter().map(|byte| !byte).collect();
                write_at(&mut file.file, offset, &complement).map_err(FlashError::File)
            }
        }
    }
}

fn read_at(file: &mut File, offset: u32, bytes: &mut [u8]) -> io::Result<()> {
    file.seek(SeekFrom::Start(offset.into()))?;
    let mut content = Vec::with_capacity(bytes.len());
    file.take(bytes.len() as u64).read_to_end(&mut content)?;
    content.resize(bytes.len(), 0);
    bytes.copy_from_slice(&content);
    bytes.iter_mut().for_each(|byte| *byte = !*byte);
    Ok(())
}

/// Writes, and waits until the data is on the disk: no later write can reach the disk before it.
fn write_at(file: &mut File, offset: u32, bytes: &[u8]) -> io::Result<()> {
    file.seek(SeekFrom::Start(offset.into()))?;
    file.write_all(bytes)?;
    file.sync_data()
}
