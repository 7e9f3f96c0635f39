//! A bounds-checked cursor over bytes, for the small binary formats.

use std::path::Path;

use crate::error::{IoError, Place};

/// Deflate expands a byte to at most 1032: what claims more is damaged.
pub(crate) const MAX_INFLATION: u64 = 1032;

/// Reads consecutive little-endian values; running out of bytes is an error that names the offset.
pub(crate) struct Cursor<'a> {
    bytes: &'a [u8],
    position: usize,
    path: &'a Path,
}

impl<'a> Cursor<'a> {
    pub(crate) fn new(bytes: &'a [u8], path: &'a Path) -> Self {
        Self { bytes, position: 0, path }
    }

    pub(crate) fn position(&self) -> usize {
        self.position
    }

    pub(crate) fn remaining(&self) -> usize {
        self.bytes.len() - self.position
    }

    /// The next `count` bytes; `what` names them in the error.
    pub(crate) fn take(&mut self, count: usize, what: &str) -> Result<&'a [u8], IoError> {
        if count > self.remaining() {
            let have = self.remaining();
            return Err(self.error(format!("ends early: {what} needs {count} bytes, {have} are left")));
        }
        let slice = &self.bytes[self.position..self.position + count];
        self.position += count;
        Ok(slice)
    }

    fn array<const N: usize>(&mut self, what: &str) -> Result<[u8; N], IoError> {
        let mut out = [0; N];
        out.copy_from_slice(self.take(N, what)?);
        Ok(out)
    }

    pub(crate) fn u8(&mut self, what: &str) -> Result<u8, IoError> {
        Ok(u8::from_le_bytes(self.array(what)?))
    }

    pub(crate) fn u16(&mut self, what: &str) -> Result<u16, IoError> {
        Ok(u16::from_le_bytes(self.array(what)?))
    }

    pub(crate) fn u32(&mut self, what: &str) -> Result<u32, IoError> {
        Ok(u32::from_le_bytes(self.array(what)?))
    }

    pub(crate) fn u64(&mut self, what: &str) -> Result<u64, IoError> {
        Ok(u64::from_le_bytes(self.array(what)?))
    }

    pub(crate) fn f64(&mut self, what: &str) -> Result<f64, IoError> {
        Ok(f64::from_le_bytes(self.array(what)?))
    }

    /// Reads text up to a zero byte, which is consumed; `what` names it in the error.
    pub(crate) fn c_string(&mut self, what: &str) -> Result<String, IoError> {
        let rest = &self.bytes[self.position..];
        let Some(length) = rest.iter().position(|&b| b == 0) else {
            return Err(self.error(format!("ends early: {what} has no end")));
        };
        let text = std::str::from_utf8(&rest[..length]).map_err(|_| self.error(format!("{what} is not UTF-8")))?;
        self.position += length + 1;
        Ok(text.to_owned())
    }

    /// An error at the current offset.
    pub(crate) fn error(&self, what: impl Into<String>) -> IoError {
        IoError::new(self.path, what).at(Place::Byte(self.position as u64))
    }
}
