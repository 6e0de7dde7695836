//! Two policy slots in NOR flash, and a record of which one counts. If the power is cut at any moment, the old policy or the new
//! one remains, never neither. no_std, no alloc.
//!
//! A new policy goes into the idle slot ([`Slots::begin`], [`Slots::write_chunk`]). It is checked chunk by chunk
//! ([`Slots::missing`]) and tried ([`Slots::try_out`]). Then it counts ([`Slots::confirm`]) or not ([`Slots::revert`]). It starts to
//! count at one moment: when a small record is replaced, which [`sequential_storage::map`] keeps. A version older than a confirmed
//! one never counts again.
//!
//! There are two copies of the record, at both ends of the flash. A copy that is erased or damaged is restored from the other. If
//! both are lost and the slots are not blank, nothing can be known ([`SlotError::Lost`]).
//!
//! Whoever can write all of the flash can turn it into a new robot's flash, which has no floor. Only a counter in memory that
//! cannot be erased could tell the two apart, and a simulated robot has none.
//!
//! A slot in flash:
//!
//! | bytes | content |
//! |---|---|
//! | 0..32 | head, written last: magic `RSLT`, lengths of frame, file and chunk, CRC-32 of these, the frame and the table |
//! | 32.. | the signed manifest, as it came, padded to 1024 bytes |
//! | 1056.. | SHA-256 of each chunk |
//! | next erase block.. | the policy file |
//!
//! No mark says which chunks have come. A chunk is there if its bytes have its hash. So a partial download goes on after a cut
//! without trusting anything that the cut may have torn.
#![cfg_attr(not(test), no_std)]

mod layout;
pub mod ram;
mod record;
mod slot;

pub use layout::{FRAME_BYTES, HASH_BYTES, Layout, LayoutError, Slot};
pub use slot::Header;

use embedded_storage_async::nor_flash::NorFlash;
pub use record::Floor;
use record::{BUFFER, Copy, KEY, Record, reconcile};
use sequential_storage::cache::{Cache, Uncached};
use sequential_storage::map::{MapConfig, MapStorage};

/// Why an operation on the slots failed.
#[derive(Debug, thiserror::Error)]
pub enum SlotError<E: core::fmt::Debug> {
    /// The layout does not fit the flash.
    #[error(transparent)]
    Layout(#[from] LayoutError),
    /// The flash failed.
    #[error("flash: {0:?}")]
    Flash(E),
    /// A copy of the record cannot be written.
    #[error("the record in flash is damaged: {0}")]
    Record(&'static str),
    /// Both copies of the record are erased or damaged, although there were policies.
    #[error(
        "both copies of the record in flash are erased or damaged, so that nobody knows which policy was in use \
         and below which version it must not go"
    )]
    Lost,
    /// The policy or its manifest does not fit, or its chunks have another length than the layout's.
    #[error("a policy of {length} bytes with a manifest of {frame} does not fit the slots")]
    TooLarge {
        /// Bytes of the policy file.
        length: u32,
        /// Bytes of the signed manifest.
        frame: u32,
    },
    /// There is no chunk of this number and length.
    #[error("chunk {index} has {length} bytes, which is not its length")]
    Length {
        /// Its number.
        index: u32,
        /// Its bytes.
        length: u32,
    },
    /// The bytes of a chunk do not have its hash.
    #[error("chunk {index} has another SHA-256 than the table says")]
    Hash {
        /// Its number.
        index: u32,
    },
    /// The idle slot holds no complete policy.
    #[error("the idle slot holds no whole policy")]
    Incomplete,
    /// The version is below the floor.
    #[error("version {version} is older than {floor}, which was in use")]
    Version {
        /// As given.
        version: Floor,
        /// The newest version that was ever confirmed.
        floor: Floor,
    },
}

/// What a robot runs after a start.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Boot {
    /// Nothing: no policy was ever confirmed.
    Empty,
    /// The policy that counts.
    Confirmed(Slot),
    /// A trial was cut short. The slot before it counts, if there was one.
    Reverted(Option<Slot>),
}

/// Two slots and the record of which one counts.
pub struct Slots<F: NorFlash> {
    flash: F,
    layout: Layout,
    record: Record,
    /// Which copies in flash do not hold this record.
    stale: [bool; 2],
}

/// The map that holds a copy of the record.
type Map<'f, F> = MapStorage<u8, &'f mut F, Cache<Uncached, Uncached, Uncached, u8>>;

impl<F: NorFlash> Slots<F> {
    /// Reads the record. Erased flash belongs to a robot that never had a policy.
    ///
    /// # Errors
    /// `Layout`, `Flash`, `Lost`.
    pub async fn open(flash: F, layout: Layout) -> Result<Self, SlotError<F::Error>> {
        layout.check::<F>(flash.capacity() as u32)?;
        let mut slots = Slots {
            flash,
            layout,
            record: Record::default(),
            stale: [true; 2],
        };
        let copies = [slots.copy(0).await?, slots.copy(1).await?];
        if let Some((record, stale)) = reconcile(copies) {
            (slots.record, slots.stale) = (record, stale);
        } else if !slots.is_blank(Slot::A).await? || !slots.is_blank(Slot::B).await? {
            return Err(SlotError::Lost);
        }
        Ok(slots)
    }

    /// Whether a copy of the record was erased or damaged, or differed from the other.
    pub fn needs_repair(&self) -> bool {
        self.stale.contains(&true) && self.record != Record::default()
    }

    /// Whether there is no copy of the record: the flash is new, or was wiped.
    pub fn is_new(&self) -> bool {
        self.stale == [true; 2] && self.record == Record::default()
    }

    fn map(&mut self, copy: usize) -> Result<Map<'_, F>, SlotError<F::Error>> {
        let range = self.layout.records.get(copy).cloned().unwrap_or_default();
        let config = MapConfig::try_new(range).map_err(|_| LayoutError::Record)?;
        Ok(MapStorage::new(
            &mut self.flash,
            config,
            Cache::new_uncached(),
        ))
    }

    async fn copy(&mut self, copy: usize) -> Result<Copy, SlotError<F::Error>> {
        let mut buffer = [0; BUFFER];
        let mut map = self.map(copy)?;
        let stored = map.fetch_item::<&[u8]>(&mut buffer, &KEY).await;
        match stored.map_err(of_map) {
            Ok(None) => Ok(Copy::Erased),
            Ok(Some(bytes)) => Ok(postcard::from_bytes(bytes).map_or(Copy::Damaged, Copy::Whole)),
            Err(SlotError::Record(_)) => Ok(Copy::Damaged),
            Err(error) => Err(error),
        }
    }

    /// What to run after a start. Ends a trial that a restart has cut short.
    ///
    /// # Errors
    /// `Flash`, `Record`.
    pub async fn boot(&mut self) -> Result<Boot, SlotError<F::Error>> {
        if self.needs_repair() {
            self.store(self.record).await?;
        }
        let confirmed = self.record.confirmed;
        if self.record.on_trial {
            self.revert().await?;
            return Ok(Boot::Reverted(confirmed));
        }
        Ok(confirmed.map_or(Boot::Empty, Boot::Confirmed))
    }

    /// The slot that counts.
    pub fn confirmed(&self) -> Option<Slot> {
        self.record.confirmed
    }

    /// The slot that is on trial, or that the next policy goes into.
    pub fn idle(&self) -> Slot {
        self.record.idle()
    }

    /// The release of the newest policy that was ever confirmed. No older policy is taken.
    pub fn floor(&self) -> Floor {
        self.record.floor
    }

    /// Prepares the idle slot for a policy of `length` bytes with these hashes of its chunks. If a download of the same manifest was
    /// cut short, its chunks are kept.
    ///
    /// # Errors
    /// `TooLarge`, `Flash`, `Record`.
    pub async fn begin(
        &mut self,
        frame: &[u8],
        length: u32,
        table: &[[u8; 32]],
    ) -> Result<(), SlotError<F::Error>> {
        let header = Header {
            frame: frame.len() as u32,
            length,
        };
        let fits = header.frame <= FRAME_BYTES
            && length <= self.layout.capacity::<F>()
            && table.len() as u32 == length.div_ceil(self.layout.chunk);
        if !fits {
            let frame = header.frame;
            return Err(SlotError::TooLarge { length, frame });
        }
        self.revert().await?;
        // Write a record before anything is in a slot.
        if self.stale.contains(&true) {
            self.store(self.record).await?;
        }
        let idle = self.idle();
        if self.holds(idle, &header, frame, table).await? {
            return Ok(());
        }
        self.write_header(idle, &header, frame, table).await
    }

    /// The lowest number, from `from` on, of a chunk that has not come.
    ///
    /// # Errors
    /// `Incomplete` before [`Slots::begin`]; `Flash`.
    pub async fn missing(&mut self, from: u32) -> Result<Option<u32>, SlotError<F::Error>> {
        let idle = self.idle();
        let header = self.header(idle).await?.ok_or(SlotError::Incomplete)?;
        for index in from..header.length.div_ceil(self.layout.chunk) {
            if !self.has_chunk(idle, &header, index).await? {
                return Ok(Some(index));
            }
        }
        Ok(None)
    }

    /// Writes a chunk.
    ///
    /// # Errors
    /// `Length`, `Hash` (nothing is written then); `Incomplete` before [`Slots::begin`]; `Flash`.
    pub async fn write_chunk(
        &mut self,
        index: u32,
        bytes: &[u8],
    ) -> Result<(), SlotError<F::Error>> {
        let idle = self.idle();
        let header = self.header(idle).await?.ok_or(SlotError::Incomplete)?;
        self.put_chunk(idle, &header, index, bytes).await
    }

    /// Copies a chunk from the slot that counts, if that has the same one. So chunks that two policies share are not fetched again.
    /// `buffer` has room for a chunk. Returns whether the chunk was copied.
    ///
    /// # Errors
    /// `Incomplete` before [`Slots::begin`], `Length` for a short buffer, `Flash`.
    pub async fn reuse_chunk(
        &mut self,
        index: u32,
        buffer: &mut [u8],
    ) -> Result<bool, SlotError<F::Error>> {
        let idle = self.idle();
        let header = self.header(idle).await?.ok_or(SlotError::Incomplete)?;
        let length = self.chunk_length(&header, index);
        let short = SlotError::Length { index, length };
        let buffer = buffer.get_mut(..length as usize).ok_or(short)?;
        let Some(confirmed) = self.record.confirmed else {
            return Ok(false);
        };
        let Some(old) = self.header(confirmed).await? else {
            return Ok(false);
        };
        let same = self.chunk_length(&old, index) == length
            && self.hash_of(confirmed, index).await? == self.hash_of(idle, index).await?;
        if !same || !self.has_chunk(confirmed, &old, index).await? {
            return Ok(false);
        }
        self.read(confirmed, index * self.layout.chunk, buffer)
            .await?;
        self.put_chunk(idle, &header, index, buffer).await?;
        Ok(true)
    }

    /// Puts the complete policy in the idle slot on trial. A start before [`Slots::confirm`] finds the old policy.
    ///
    /// # Errors
    /// `Incomplete`, `Flash`, `Record`.
    pub async fn try_out(&mut self) -> Result<Slot, SlotError<F::Error>> {
        if self.missing(0).await?.is_some() {
            return Err(SlotError::Incomplete);
        }
        self.store(Record {
            on_trial: true,
            ..self.record
        })
        .await?;
        Ok(self.idle())
    }

    /// Makes the policy on trial count. No older one is taken from here on.
    ///
    /// # Errors
    /// `Incomplete` without a trial, `Version` if a newer one has ever counted, `Flash`, `Record`.
    pub async fn confirm(&mut self, version: Floor) -> Result<(), SlotError<F::Error>> {
        let Record {
            floor, on_trial, ..
        } = self.record;
        if !on_trial {
            return Err(SlotError::Incomplete);
        }
        if version < floor {
            return Err(SlotError::Version { version, floor });
        }
        let idle = self.idle();
        self.store(Record {
            confirmed: Some(idle),
            floor: version,
            on_trial: false,
        })
        .await
    }

    /// Ends a trial, if there is one. The policy before it counts.
    ///
    /// # Errors
    /// `Flash`, `Record`.
    pub async fn revert(&mut self) -> Result<(), SlotError<F::Error>> {
        if !self.record.on_trial {
            return Ok(());
        }
        self.store(Record {
            on_trial: false,
            ..self.record
        })
        .await
    }

    /// The flash.
    pub fn flash(&self) -> &F {
        &self.flash
    }

    /// Returns the flash.
    pub fn destroy(self) -> F {
        self.flash
    }

    /// Replaces the record, first in the first copy, then in the second.
    async fn store(&mut self, record: Record) -> Result<(), SlotError<F::Error>> {
        let (mut bytes, mut buffer) = ([0; BUFFER], [0; BUFFER]);
        let bytes =
            postcard::to_slice(&record, &mut bytes).map_err(|_| SlotError::Record("too long"))?;
        let value = &&*bytes;
        for copy in 0..self.layout.records.len() {
            let range = self.layout.records.get(copy).cloned().unwrap_or_default();
            if self.stale.get(copy) == Some(&true) {
                // This copy may be damaged. The other one is intact, or there never was a record.
                let erased = self.flash.erase(range.start, range.end).await;
                erased.map_err(SlotError::Flash)?;
            }
            let mut map = self.map(copy)?;
            let stored = map.store_item_generic(&mut buffer, &KEY, value).await;
            stored.map_err(of_map)?;
            if let Some(stale) = self.stale.get_mut(copy) {
                *stale = false;
            }
        }
        self.record = record;
        Ok(())
    }
}

fn of_map<E: core::fmt::Debug>(error: sequential_storage::Error<E>) -> SlotError<E> {
    match error {
        sequential_storage::Error::Storage { value, .. } => SlotError::Flash(value),
        sequential_storage::Error::FullStorage => SlotError::Record("full"),
        sequential_storage::Error::Corrupted { .. } => SlotError::Record("corrupted"),
        _ => SlotError::Record("unreadable"),
    }
}
