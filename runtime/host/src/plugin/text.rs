//! Text across the edge: taken as UTF-8, cut between characters; and a line that is composed without an allocation.

use std::fmt::{self, Write};

use ob1_sdk::abi::{TEXT_MAX, Text};

use super::error::Refusal;

const STATIC_MAX: u32 = 256;

/// The longest beginning of `bytes` that is UTF-8 and at most [`TEXT_MAX`] bytes long.
fn beginning(bytes: &[u8]) -> &str {
    let bytes = bytes.get(..TEXT_MAX as usize).unwrap_or(bytes);
    match std::str::from_utf8(bytes) {
        Ok(text) => text,
        Err(e) => std::str::from_utf8(&bytes[..e.valid_up_to()]).unwrap_or_default(),
    }
}

/// A text the plugin passes to a host function.
///
/// # Safety
/// `text` is null, or as long as it says for `'a`.
pub(super) unsafe fn given<'a>(text: Text) -> Option<&'a str> {
    if text.len == 0 {
        return Some("");
    }
    if text.ptr.is_null() {
        return None;
    }
    let len = text.len.min(TEXT_MAX) as usize;
    // SAFETY: not null; that long by the caller's word.
    Some(beginning(unsafe { std::slice::from_raw_parts(text.ptr, len) }))
}

/// A line of at most [`TEXT_MAX`] bytes.
pub(super) struct Line {
    bytes: [u8; TEXT_MAX as usize],
    len: usize,
}

impl Line {
    pub(super) fn new(content: fmt::Arguments<'_>) -> Self {
        let mut line = Self { bytes: [0; TEXT_MAX as usize], len: 0 };
        // The only error is a full line.
        let _full = line.write_fmt(content);
        line
    }

    pub(super) fn as_str(&self) -> &str {
        beginning(self.bytes.get(..self.len).unwrap_or_default())
    }
}

impl Write for Line {
    fn write_str(&mut self, s: &str) -> fmt::Result {
        let part = &s[..s.floor_char_boundary(self.bytes.len() - self.len)];
        self.bytes[self.len..self.len + part.len()].copy_from_slice(part.as_bytes());
        self.len += part.len();
        if part.len() == s.len() { Ok(()) } else { Err(fmt::Error) }
    }
}

/// What a plugin's panic function copies.
pub(super) struct PanicText {
    pub(super) bytes: [u8; TEXT_MAX as usize],
    pub(super) len: usize,
}

impl PanicText {
    pub(super) fn as_str(&self) -> &str {
        beginning(self.bytes.get(..self.len).unwrap_or(&self.bytes))
    }
}

/// Text of the plugin: UTF-8 without control characters.
pub(super) fn text(text: Text, what: &str) -> Result<String, Refusal> {
    if text.len == 0 {
        return Ok(String::new());
    }
    if text.ptr.is_null() || text.len > STATIC_MAX {
        return Err(malformed(format!("{what}: a text of {} bytes at {:p}", text.len, text.ptr)));
    }
    // SAFETY: not null; by the plugin's word that many bytes of static data.
    let bytes = unsafe { std::slice::from_raw_parts(text.ptr, text.len as usize) };
    match std::str::from_utf8(bytes) {
        Ok(text) if !text.chars().any(char::is_control) => Ok(text.to_owned()),
        _ => Err(malformed(format!("{what} is no UTF-8 text"))),
    }
}

/// A text that must not be empty.
pub(super) fn word(word: Text, what: &str) -> Result<String, Refusal> {
    match text(word, what)? {
        empty if empty.trim().is_empty() => Err(malformed(format!("{what} is empty"))),
        word => Ok(word),
    }
}

pub(super) fn malformed(what: impl Into<String>) -> Refusal {
    Refusal::Malformed(what.into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_long_or_broken_text_keeps_its_beginning() {
        assert_eq!(beginning("ä".repeat(150).as_bytes()).len(), 200);
        assert_eq!(beginning(format!("x{}", "ä".repeat(150)).as_bytes()).len(), 199);
        assert_eq!(beginning(b"abc\xFFdef"), "abc");
        assert_eq!(Line::new(format_args!("FC {}: {}", 0, "x".repeat(300))).as_str().len(), 200);
    }
}
