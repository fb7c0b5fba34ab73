//! Text across the edge: taken as UTF-8, cut between characters.

use ob1_sdk::abi::{TEXT_MAX, Text};

use super::error::Refusal;
use crate::fixed_text::beginning;

const STATIC_MAX: u32 = 256;

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
