//! NOR flash in memory whose power can be cut: a model for tests and simulated robots.

use core::ops::Range;
use embedded_storage_async::nor_flash::{
    ErrorType, NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash,
};

/// Why the model refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RamError {
    /// A range that is out of bounds, or not whole words or blocks.
    Address,
    /// A word that has been written and not erased since.
    NotErased,
    /// The power is off.
    PowerCut,
}

impl NorFlashError for RamError {
    fn kind(&self) -> NorFlashErrorKind {
        match self {
            RamError::Address => NorFlashErrorKind::OutOfBounds,
            RamError::NotErased | RamError::PowerCut => NorFlashErrorKind::Other,
        }
    }
}

/// Flash that writes words of `WRITE` bytes and erases blocks of `ERASE` bytes. The memory holds the complement of what is read. So
/// erased flash is zeros in memory, which cost nothing until something is written.
#[derive(Debug)]
pub struct RamFlash<M, const WRITE: usize, const ERASE: usize> {
    memory: M,
    /// Words to write and blocks to erase before the power fails; `None` for never.
    left: Option<u32>,
    /// State of the noise that a torn word or block holds.
    tear: u64,
    /// Words written and blocks erased so far.
    done: u32,
}

impl<M: AsRef<[u8]> + AsMut<[u8]>, const WRITE: usize, const ERASE: usize>
    RamFlash<M, WRITE, ERASE>
{
    /// Flash in this memory, which holds the complement of what is read.
    pub fn new(memory: M) -> Self {
        RamFlash {
            memory,
            left: None,
            tear: 0,
            done: 0,
        }
    }

    /// Cuts the power within the word or block after so many operations. `tear` seeds the noise that is left there.
    pub fn cut_after(mut self, operations: u32, tear: u64) -> Self {
        self.left = Some(operations);
        self.tear = tear.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1;
        self
    }

    /// Words written and blocks erased so far.
    pub fn operations(&self) -> u32 {
        self.done
    }

    /// Whether the next word or block is done (`Ok(true)`) or torn (`Ok(false)`).
    fn spend(&mut self) -> Result<bool, RamError> {
        match &mut self.left {
            None => {}
            Some(0) => {
                // From the next operation on the power is off.
                self.left = Some(u32::MAX);
                return Ok(false);
            }
            Some(u32::MAX) => return Err(RamError::PowerCut),
            Some(left) => *left -= 1,
        }
        self.done += 1;
        Ok(true)
    }

    fn noise(&mut self) -> u8 {
        self.tear = self
            .tear
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (self.tear >> 56) as u8
    }

    fn checked(&self, start: usize, end: usize, unit: usize) -> Result<Range<usize>, RamError> {
        let good = start <= end
            && end <= self.memory.as_ref().len()
            && start.is_multiple_of(unit)
            && end.is_multiple_of(unit);
        good.then_some(start..end).ok_or(RamError::Address)
    }
}

impl<M, const WRITE: usize, const ERASE: usize> ErrorType for RamFlash<M, WRITE, ERASE> {
    type Error = RamError;
}

impl<M: AsRef<[u8]> + AsMut<[u8]>, const WRITE: usize, const ERASE: usize> ReadNorFlash
    for RamFlash<M, WRITE, ERASE>
{
    const READ_SIZE: usize = WRITE;

    async fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), RamError> {
        if self.left == Some(u32::MAX) {
            return Err(RamError::PowerCut);
        }
        let start = offset as usize;
        let range = self.checked(start, start + bytes.len(), WRITE)?;
        for (to, from) in bytes.iter_mut().zip(&self.memory.as_ref()[range]) {
            *to = !from;
        }
        Ok(())
    }

    fn capacity(&self) -> usize {
        self.memory.as_ref().len()
    }
}

impl<M: AsRef<[u8]> + AsMut<[u8]>, const WRITE: usize, const ERASE: usize> NorFlash
    for RamFlash<M, WRITE, ERASE>
{
    const WRITE_SIZE: usize = WRITE;
    const ERASE_SIZE: usize = ERASE;

    async fn erase(&mut self, from: u32, to: u32) -> Result<(), RamError> {
        let range = self.checked(from as usize, to as usize, ERASE)?;
        for block in range.step_by(ERASE) {
            let whole = self.spend()?;
            for at in block..block + ERASE {
                let kept = if whole { 0 } else { self.noise() };
                self.memory.as_mut()[at] &= kept;
            }
            if !whole {
                return Err(RamError::PowerCut);
            }
        }
        Ok(())
    }

    async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), RamError> {
        let start = offset as usize;
        let range = self.checked(start, start + bytes.len(), WRITE)?;
        for (word, at) in bytes.chunks(WRITE).zip(range.step_by(WRITE)) {
            let place = at..at + WRITE;
            if self.memory.as_ref()[place.clone()]
                .iter()
                .any(|&byte| byte != 0)
            {
                return Err(RamError::NotErased);
            }
            let whole = self.spend()?;
            for (at, &byte) in place.zip(word) {
                let kept = if whole { 0 } else { self.noise() };
                self.memory.as_mut()[at] |= !(byte | kept);
            }
            if !whole {
                return Err(RamError::PowerCut);
            }
        }
        Ok(())
    }
}
