//! Text of a fixed size, which is composed without an allocation, and the beginning of foreign bytes.

use std::fmt::{self, Write};

/// At most so many bytes; what does not fit is cut between characters.
pub(crate) struct FixedText<const BYTES: usize> {
    pub(crate) bytes: [u8; BYTES],
    pub(crate) len: usize,
}

impl<const BYTES: usize> FixedText<BYTES> {
    pub(crate) fn new(content: fmt::Arguments<'_>) -> Self {
        let mut text = Self { bytes: [0; BYTES], len: 0 };
        // The only error is that it is full.
        let _full = text.write_fmt(content);
        text
    }

    pub(crate) fn as_str(&self) -> &str {
        beginning(self.bytes.get(..self.len).unwrap_or(&self.bytes))
    }
}

impl<const BYTES: usize> Write for FixedText<BYTES> {
    fn write_str(&mut self, s: &str) -> fmt::Result {
        let part = &s[..s.floor_char_boundary(BYTES - self.len)];
        self.bytes[self.len..self.len + part.len()].copy_from_slice(part.as_bytes());
        self.len += part.len();
        if part.len() == s.len() { Ok(()) } else { Err(fmt::Error) }
    }
}

/// The longest beginning of `bytes` that is UTF-8.
pub(crate) fn beginning(bytes: &[u8]) -> &str {
    bytes.utf8_chunks().next().map_or("", |chunk| chunk.valid())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_long_or_broken_text_keeps_its_beginning() {
        let len = |text: &str| FixedText::<200>::new(format_args!("FC {}{text}", 0)).len;
        assert_eq!([len(&"x".repeat(300)), len(&"ä".repeat(98)), len(&"ä".repeat(150))], [200, 200, 200]);
        assert_eq!(len(&format!("x{}", "ä".repeat(150))), 199);
        assert_eq!(beginning(b"abc\xFFdef"), "abc");
        assert_eq!(beginning(&"ä".as_bytes()[..1]), "");
        let copied = FixedText { bytes: *b"ab\xC3", len: 7 };
        assert_eq!(copied.as_str(), "ab");
    }
}
