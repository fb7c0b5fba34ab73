//! Text on its way to the host: cut at a character's boundary, formatted without an allocation.

use core::fmt::{self, Write};

use crate::abi::{TEXT_MAX, Text};

/// A text of the interface. Sound for `'static` text in tables, and for the time of one host call.
pub(crate) const fn text(text: &str) -> Text {
    Text { ptr: text.as_ptr(), len: text.len() as u32 }
}

/// A line of at most [`TEXT_MAX`] bytes; what is longer is cut.
pub(crate) struct Line {
    bytes: [u8; TEXT_MAX as usize],
    len: usize,
}

impl Line {
    pub(crate) fn of(content: impl fmt::Display) -> Self {
        let mut line = Self { bytes: [0; TEXT_MAX as usize], len: 0 };
        // The only error is a full line; what fits is kept.
        let _full = write!(line, "{content}");
        line
    }

    pub(crate) fn as_text(&self) -> Text {
        Text { ptr: self.bytes.as_ptr(), len: self.len as u32 }
    }
}

impl Write for Line {
    fn write_str(&mut self, s: &str) -> fmt::Result {
        let room = self.bytes.len() - self.len;
        let part = &s[..s.floor_char_boundary(room)];
        self.bytes[self.len..self.len + part.len()].copy_from_slice(part.as_bytes());
        self.len += part.len();
        if part.len() == s.len() { Ok(()) } else { Err(fmt::Error) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_long_line_is_cut_between_characters() {
        let line = Line::of(format_args!("{}äää", "x".repeat(199)));
        assert_eq!(line.len, 199);
        let line = Line::of(format_args!("DB{} zu kurz für {}", 10, "ä".repeat(300)));
        let text = std::str::from_utf8(&line.bytes[..line.len]).unwrap();
        assert!(text.starts_with("DB10 zu kurz für ää") && line.len >= 199);
    }
}
