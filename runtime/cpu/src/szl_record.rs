//! A record of a system status list.

use ob1_std::services::StatusError;

/// Who gets the records.
pub(crate) type Each<'a> = &'a mut dyn FnMut(&[u8]);
/// Length of a record, or why there is none.
pub(crate) type Length = Result<u16, StatusError>;

/// A record that is filled piece by piece.
pub(crate) struct Record<const N: usize> {
    pub(crate) bytes: [u8; N],
    at: usize,
}

impl<const N: usize> Record<N> {
    pub(crate) fn new() -> Self {
        Self { bytes: [0; N], at: 0 }
    }

    pub(crate) fn put(mut self, bytes: &[u8]) -> Self {
        let end = (self.at + bytes.len()).min(N);
        self.bytes[self.at..end].copy_from_slice(&bytes[..end - self.at]);
        self.at = end;
        self
    }

    pub(crate) fn word(self, word: u16) -> Self {
        self.put(&word.to_be_bytes())
    }

    pub(crate) fn long(self, long: u32) -> Self {
        self.put(&long.to_be_bytes())
    }

    /// Text, filled up with `fill` to `len` bytes.
    pub(crate) fn text(self, text: &str, len: usize, fill: u8) -> Self {
        let mut bytes = [fill; 32];
        let used = text.len().min(len).min(bytes.len());
        bytes[..used].copy_from_slice(&text.as_bytes()[..used]);
        self.put(&bytes[..len.min(32)])
    }
}
