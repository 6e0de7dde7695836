//! The records of an MCAP file, in their order.

use super::BagError;
use mcap::records::{Record, op};
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};
use mcap::{MAGIC, McapError};
use std::fs::File;
use std::io::{BufReader, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

/// Longest record or uncompressed chunk accepted in a file of so many bytes. No message compresses to less than a
/// 4096th; a larger length is damaged.
fn longest(bytes: u64) -> usize {
    bytes.saturating_mul(4096).min(1 << 30) as usize
}

/// A reader that reads the file as records are asked for.
pub(super) struct Records {
    path: PathBuf,
    file: BufReader<File>,
    /// Length of the file in bytes, and how many have been read.
    length: u64,
    read: u64,
    reader: LinearReader,
}

impl Records {
    /// Reads from the start of the file.
    pub(super) fn open(path: &Path) -> Result<Records, BagError> {
        let io = |source| BagError::Io {
            path: path.into(),
            source,
        };
        let file = File::open(path).map_err(io)?;
        let length = file.metadata().map_err(io)?.len();
        Ok(Records::new(path, file, length, 0))
    }

    /// Reads the summary, which a bag has at its end unless its recording was interrupted.
    pub(super) fn of_summary(path: &Path) -> Option<Records> {
        let mut file = File::open(path).ok()?;
        // The file ends with the summary's offset, the offset of its index, a checksum, and the magic.
        let mut end = [0; 8 + 8 + 4 + MAGIC.len()];
        file.seek(SeekFrom::End(-(end.len() as i64))).ok()?;
        file.read_exact(&mut end).ok()?;
        let length = file.stream_position().ok()?;
        let start = u64::from_le_bytes(*end.first_chunk()?);
        if !end.ends_with(MAGIC) || !(1..length).contains(&start) {
            return None;
        }
        file.seek(SeekFrom::Start(start)).ok()?;
        Some(Records::new(path, file, length, start))
    }

    fn new(path: &Path, file: File, length: u64, read: u64) -> Records {
        let options = LinearReaderOptions::default()
            .with_skip_start_magic(read > 0)
            .with_prevalidate_chunk_crcs(true)
            .with_record_length_limit(longest(length));
        Records {
            path: path.into(),
            file: BufReader::with_capacity(1 << 16, file),
            length,
            read,
            reader: LinearReader::new_with_options(options),
        }
    }

    /// Offers the next schemas, channels and messages to `take`, and returns the first taken. Nothing follows an error.
    pub(super) fn find<T>(
        &mut self,
        mut take: impl FnMut(Record<'_>) -> Option<T>,
    ) -> Option<Result<T, BagError>> {
        loop {
            let wanted = match self.reader.next_event()? {
                Ok(LinearReadEvent::ReadRequest(wanted)) => wanted,
                Ok(LinearReadEvent::Record { opcode, data }) => {
                    let record = match is_used(opcode, data) {
                        Some(true) => mcap::parse_record(opcode, data),
                        Some(false) => continue,
                        None => Err(McapError::UnexpectedEoc),
                    };
                    match record.map(&mut take) {
                        Ok(None) => continue,
                        Ok(Some(taken)) => return Some(Ok(taken)),
                        Err(error) => return Some(Err(self.damaged(&error))),
                    }
                }
                Err(error) => return Some(Err(self.damaged(&error))),
            };
            // Reserves no memory for more than the file can hold.
            if wanted as u64 > self.length - self.read {
                let path = self.path.clone();
                return Some(Err(match self.length {
                    0 => BagError::Empty { path },
                    bytes => BagError::CutOff { path, bytes },
                }));
            }
            match self.file.read_exact(self.reader.insert(wanted)) {
                Ok(()) => self.reader.notify_read(wanted),
                Err(source) => {
                    let path = self.path.clone();
                    return Some(Err(BagError::Io { path, source }));
                }
            }
            self.read += wanted as u64;
        }
    }

    fn damaged(&self, error: &McapError) -> BagError {
        let path = self.path.clone();
        match error {
            McapError::BadMagic if self.read as usize <= MAGIC.len() => BagError::NotMcap { path },
            _ => BagError::Damaged {
                path,
                byte: self.read,
                reason: error.to_string(),
            },
        }
    }
}

/// Whether a record is a schema, channel or message. `None` if a string in it would reach beyond the record: the
/// library reserves a string's memory before it reads it.
fn is_used(opcode: u8, data: &[u8]) -> Option<bool> {
    let texts = match opcode {
        op::SCHEMA => data.get(2..)?,
        op::CHANNEL => data.get(4..)?,
        op::MESSAGE => return Some(true),
        _ => return Some(false),
    };
    let rest = after_text(after_text(texts)?)?;
    if opcode == op::CHANNEL {
        let mut metadata = rest.get(4..)?;
        while !metadata.is_empty() {
            metadata = after_text(metadata)?;
        }
    }
    Some(true)
}

/// The bytes after a string, which follows its length.
fn after_text(data: &[u8]) -> Option<&[u8]> {
    let (length, rest) = data.split_first_chunk()?;
    rest.get(u32::from_le_bytes(*length) as usize..)
}
