//! Two policy slots over NOR flash, and which of them counts: a cut of the power at any moment leaves
//! the old policy or the new one, never neither. no_std, no alloc.
//!
//! A new policy goes into the idle slot ([`Slots::begin`], [`Slots::write_chunk`]), is checked chunk by
//! chunk ([`Slots::missing`]), tried ([`Slots::try_out`]) and then counts ([`Slots::confirm`]) or not
//! ([`Slots::revert`]). The one moment at which it starts to count is the replacement of a small record
//! kept by [`sequential_storage::map`]. No older version than one that was confirmed ever counts again.
//!
//! There are two copies of the record, at both ends of the flash. One that is erased or damaged is written anew
//! from the other; where both are, and the slots are not blank, nothing is taken for granted ([`SlotError::Lost`]).
//! Who can write all of the flash can make it a new robot's, whose floor is none: only memory that counts and
//! cannot be erased, which a simulated robot does not have, tells these apart.
//!
//! In flash, a slot is
//!
//! | bytes | content |
//! |---|---|
//! | 0..32 | head, written last: magic `RSLT`, lengths of frame, file and chunk, CRC-32 of these, the frame and the table |
//! | 32.. | the signed manifest, as it came, padded to 1024 bytes |
//! | 1056.. | SHA-256 of each chunk |
//! | next erase block.. | the policy file |
//!
//! No mark says which chunks have come: a chunk is there if its bytes have its hash, so a partial
//! download goes on after a cut without trusting anything that the cut may have torn.
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

/// Why the slots could not do what they were asked.
#[derive(Debug, thiserror::Error)]
pub enum SlotError<E: core::fmt::Debug> {
    /// The flash cannot be divided so.
    #[error(transparent)]
    Layout(#[from] LayoutError),
    /// The flash failed.
    #[error("flash: {0:?}")]
    Flash(E),
    /// A copy of the record cannot be written.
    #[error("the record in flash is damaged: {0}")]
    Record(&'static str),
    /// Both copies of the record are erased or damaged, though policies were there.
    #[error(
        "both copies of the record in flash are erased or damaged, so that nobody knows which policy was in use \
         and below which version it must not go"
    )]
    Lost,
    /// The policy does not fit, or its manifest, or it has another chunk length than the layout.
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
    /// The bytes of a chunk are not those that its hash stands for.
    #[error("chunk {index} has another SHA-256 than the table says")]
    Hash {
        /// Its number.
        index: u32,
    },
    /// The idle slot holds no whole policy.
    #[error("the idle slot holds no whole policy")]
    Incomplete,
    /// The version is below the floor.
    #[error("version {version} is older than {floor}, which was in use")]
    Version {
        /// As given.
        version: Floor,
        /// The newest that was ever confirmed.
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
    /// A trial was cut short; what counts is the slot before it, if there was one.
    Reverted(Option<Slot>),
}

/// Two slots and the record of which one counts.
pub struct Slots<F: NorFlash> {
    flash: F,
    layout: Layout,
    record: Record,
    /// Which copies of the record do not hold it.
    stale: [bool; 2],
}

/// The map that holds a copy of the record.
type Map<'f, F> = MapStorage<u8, &'f mut F, Cache<Uncached, Uncached, Uncached, u8>>;

impl<F: NorFlash> Slots<F> {
    /// Reads the record. Erased flash is a robot that never had a policy.
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

    /// Whether no copy of the record is there: the flash is new, or was wiped.
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

    /// What to run after a start; ends a trial that a restart cut short.
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

    /// The slot into which the next policy goes, or that is on trial.
    pub fn idle(&self) -> Slot {
        self.record.idle()
    }

    /// Release of the newest policy that was ever confirmed: no older one is taken.
    pub fn floor(&self) -> Floor {
        self.record.floor
    }

    /// Prepares the idle slot for a policy of `length` bytes with these hashes of its chunks. Where a
    /// download of the same manifest was cut short, the chunks that came stay.
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
        // There is a record before there is anything in a slot.
        if self.stale.contains(&true) {
            self.store(self.record).await?;
        }
        let idle = self.idle();
        if self.holds(idle, &header, frame, table).await? {
            return Ok(());
        }
        self.write_header(idle, &header, frame, table).await
    }

    /// The lowest number from `from` of a chunk that has not come.
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

    /// Keeps a chunk.
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

    /// Takes a chunk from the slot that counts, if that has the same: what did not change between two
    /// policies is not fetched again. `buffer` holds at least a chunk.
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

    /// Puts the whole policy in the idle slot on trial: a start before [`Slots::confirm`] finds the old policy.
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

    /// The policy on trial counts from here on, and no older one is taken any more.
    ///
    /// # Errors
    /// `Incomplete` without a trial, `Version` for an older one than ever counted, `Flash`, `Record`.
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

    /// Ends a trial, if there is one: the policy before it counts.
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

    /// Gives the flash back.
    pub fn destroy(self) -> F {
        self.flash
    }

    /// Replaces the record, in its first copy and then in the second.
    async fn store(&mut self, record: Record) -> Result<(), SlotError<F::Error>> {
        let (mut bytes, mut buffer) = ([0; BUFFER], [0; BUFFER]);
        let bytes =
            postcard::to_slice(&record, &mut bytes).map_err(|_| SlotError::Record("too long"))?;
        let value = &&*bytes;
        for copy in 0..self.layout.records.len() {
            let range = self.layout.records.get(copy).cloned().unwrap_or_default();
            if self.stale.get(copy) == Some(&true) {
                // What is there may be damaged. The other copy is whole, or there never was a record.
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
