//! A reader of a pickle's bytes: numbers and texts.

/// The bytes that have not been read, and their offset.
pub(super) struct Bytes<'a> {
    rest: &'a [u8],
    at: usize,
}

impl<'a> Bytes<'a> {
    pub(super) fn new(bytes: &'a [u8]) -> Self {
        Bytes { rest: bytes, at: 0 }
    }

    /// Number of bytes read so far.
    pub(super) fn at(&self) -> usize {
        self.at
    }

    pub(super) fn take(&mut self, count: usize) -> Result<&'a [u8], String> {
        let (taken, rest) = self
            .rest
            .split_at_checked(count)
            .ok_or("the pickle ends early")?;
        self.rest = rest;
        self.at += count;
        Ok(taken)
    }

    pub(super) fn array<const N: usize>(&mut self) -> Result<[u8; N], String> {
        let taken = self.take(N)?;
        taken.try_into().map_err(|_| "the pickle ends early".into())
    }

    pub(super) fn byte(&mut self) -> Result<u8, String> {
        Ok(self.array::<1>()?[0])
    }

    pub(super) fn u32(&mut self) -> Result<u32, String> {
        Ok(u32::from_le_bytes(self.array()?))
    }

    /// A little-endian two's complement number.
    pub(super) fn long(&mut self, length: usize) -> Result<i64, String> {
        let bytes = self.take(length)?;
        if length > 8 {
            return Err("an integer of more than 64 bits".into());
        }
        let fill = if bytes.last().is_some_and(|high| high & 0x80 != 0) {
            0xff
        } else {
            0
        };
        let mut wide = [fill; 8];
        wide[..length].copy_from_slice(bytes);
        Ok(i64::from_le_bytes(wide))
    }

    pub(super) fn text(&mut self, length: usize) -> Result<&'a str, String> {
        let text = std::str::from_utf8(self.take(length)?);
        text.map_err(|_| "a string that is not UTF-8".into())
    }

    /// The rest of the line; its end is read, too.
    pub(super) fn line(&mut self) -> Result<&'a str, String> {
        let end = self.rest.iter().position(|&byte| byte == b'\n');
        let end = end.ok_or("the pickle ends early")?;
        let line =
            std::str::from_utf8(&self.rest[..end]).map_err(|_| "a name that is not UTF-8")?;
        self.take(end + 1)?;
        Ok(line)
    }
}
