//! Source files: bytes in CP1252 or UTF-8, and their text.

use std::borrow::Cow;

/// A source file as it lies on disk.
#[derive(Clone, Debug)]
pub struct Source {
    /// Its name, as diagnostics print it.
    pub name: String,
    /// Its bytes: UTF-16 after its byte order mark or recognised without one, UTF-8 where they are valid UTF-8, else
    /// CP1252; lines end with LF, CR LF, or all of them with CR alone.
    pub bytes: Vec<u8>,
}

impl Source {
    /// A source by name and bytes.
    pub fn new(name: impl Into<String>, bytes: impl Into<Vec<u8>>) -> Self {
        Self { name: name.into(), bytes: bytes.into() }
    }

    /// The text. Bytes that are no UTF-8 are read as CP1252, which STEP 7 writes; a byte order mark is dropped. With
    /// that of UTF-16, which Windows editors call "Unicode", they are UTF-16. Lines that end with CR alone end with LF.
    pub fn text(&self) -> Cow<'_, str> {
        let text = self.decoded();
        if text.contains('\r') && !text.contains('\n') { Cow::Owned(text.replace('\r', "\n")) } else { text }
    }

    fn decoded(&self) -> Cow<'_, str> {
        match self.bytes.as_slice() {
            [0xFF, 0xFE, rest @ ..] => return Cow::Owned(utf16(rest, u16::from_le_bytes)),
            [0xFE, 0xFF, rest @ ..] => return Cow::Owned(utf16(rest, u16::from_be_bytes)),
            bytes => {
                if let Some(unit) = without_mark(bytes) {
                    return Cow::Owned(utf16(bytes, unit));
                }
            }
        }
        let bytes = without_end(&self.bytes);
        match std::str::from_utf8(bytes) {
            Ok(text) => Cow::Borrowed(text.strip_prefix('\u{feff}').unwrap_or(text)),
            Err(_) => Cow::Owned(bytes.iter().map(|b| cp1252(*b)).collect()),
        }
    }
}

/// Editors of DOS and CP/M mark the end of a text with 1Ah, and fill up its last sector with more of it or with zeros.
/// Zeros alone are none of that: so ends a file that was lost with the power.
fn without_end(bytes: &[u8]) -> &[u8] {
    let text = bytes.iter().rposition(|byte| !matches!(byte, 0 | 0x1A)).map_or(0, |last| last + 1);
    match bytes.split_at(text) {
        (text, [0x1A, ..]) => text,
        _ => bytes,
    }
}

/// The order of bytes of a text that is UTF-16 without saying so: every second byte of its begin is 0, nearly.
fn without_mark(bytes: &[u8]) -> Option<fn([u8; 2]) -> u16> {
    let (pairs, _) = bytes.get(..bytes.len().min(1024))?.as_chunks::<2>();
    if pairs.len() < 4 {
        return None;
    }
    let first = pairs.iter().filter(|[a, b]| *a == 0 && *b != 0).count();
    let second = pairs.iter().filter(|[a, b]| *a != 0 && *b == 0).count();
    let most = pairs.len() * 3 / 4;
    if second >= most {
        return Some(u16::from_le_bytes);
    }
    (first >= most).then_some(u16::from_be_bytes)
}

/// A unit that is half a pair, or an odd byte at the end, reads as the replacement character.
fn utf16(bytes: &[u8], unit: fn([u8; 2]) -> u16) -> String {
    let (pairs, odd) = bytes.as_chunks();
    let mut text = String::from_utf16_lossy(&pairs.iter().copied().map(unit).collect::<Vec<_>>());
    text.extend(odd.iter().map(|_| char::REPLACEMENT_CHARACTER));
    text
}

/// The characters of 80h to 9Fh in CP1252; its five holes read as the control characters of that number.
const CP1252_HIGH: [char; 32] = [
    '€', '\u{81}', '‚', 'ƒ', '„', '…', '†', '‡', 'ˆ', '‰', 'Š', '‹', 'Œ', '\u{8d}', 'Ž', '\u{8f}', '\u{90}', '‘', '’',
    '“', '”', '•', '–', '—', '˜', '™', 'š', '›', 'œ', '\u{9d}', 'ž', 'Ÿ',
];

fn cp1252(byte: u8) -> char {
    match byte {
        0x80..=0x9F => CP1252_HIGH[usize::from(byte - 0x80)],
        _ => char::from(byte),
    }
}

/// The CP1252 byte of a character, as a CHAR or STRING stores it; `None` when it has none.
fn to_cp1252(c: char) -> Option<u8> {
    match u8::try_from(u32::from(c)) {
        Ok(byte) if !(0x80..=0x9F).contains(&byte) => Some(byte),
        _ => (0x80u8..).zip(CP1252_HIGH).find(|(_, high)| *high == c).map(|(byte, _)| byte),
    }
}

/// Letters of Central Europe with their byte in CP1250.
#[rustfmt::skip]
const CP1250: [(char, u8); 44] = [
    ('Ą', 0xA5), ('ą', 0xB9), ('Ć', 0xC6), ('ć', 0xE6), ('Ę', 0xCA), ('ę', 0xEA), ('Ł', 0xA3), ('ł', 0xB3), ('Ń', 0xD1),
    ('ń', 0xF1), ('Ś', 0x8C), ('ś', 0x9C), ('Ź', 0x8F), ('ź', 0x9F), ('Ż', 0xAF), ('ż', 0xBF), ('Č', 0xC8), ('č', 0xE8),
    ('Ď', 0xCF), ('ď', 0xEF), ('Ě', 0xCC), ('ě', 0xEC), ('Ň', 0xD2), ('ň', 0xF2), ('Ř', 0xD8), ('ř', 0xF8), ('Ť', 0x8D),
    ('ť', 0x9D), ('Ů', 0xD9), ('ů', 0xF9), ('Ő', 0xD5), ('ő', 0xF5), ('Ű', 0xDB), ('ű', 0xFB), ('Ľ', 0xBC), ('ľ', 0xBE),
    ('Ĺ', 0xC5), ('ĺ', 0xE5), ('Ŕ', 0xC0), ('ŕ', 0xE0), ('Ă', 0xC3), ('ă', 0xE3), ('Đ', 0xD0), ('đ', 0xF0),
];

/// The byte of a character as a CPU stores it: that of CP1252, else of the code page of the countries that write it,
/// CP1250 or CP1251.
pub fn to_byte(c: char) -> Option<u8> {
    let cyrillic = || match c {
        'А'..='я' => u8::try_from(u32::from(c) - u32::from('А') + 0xC0).ok(),
        'Ё' => Some(0xA8),
        'ё' => Some(0xB8),
        '№' => Some(0xB9),
        'Є' => Some(0xAA),
        'є' => Some(0xBA),
        'І' => Some(0xB2),
        'і' => Some(0xB3),
        'Ї' => Some(0xAF),
        'ї' => Some(0xBF),
        _ => None,
    };
    let central = || CP1250.iter().find(|(letter, _)| *letter == c).map(|(_, byte)| *byte);
    to_cp1252(c).or_else(cyrillic).or_else(central)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_encodings_give_the_same_text() {
        assert_eq!(Source::new("a", "Zähler €".as_bytes()).text(), "Zähler €");
        assert_eq!(Source::new("a", *b"Z\xE4hler \x80").text(), "Zähler €");
        assert_eq!(Source::new("a", *b"\xEF\xBB\xBFOK").text(), "OK");
        assert_eq!(Source::new("a", *b"\xFF\xFEZ\0\xE4\0\xAC\x20").text(), "Zä€");
        assert_eq!(Source::new("a", *b"\xFE\xFF\0Z\0\xE4\x20\xAC").text(), "Zä€");
        // Without a mark.
        assert_eq!(Source::new("a", *b"L\0 \x001\0;\0\r\0\n\0").text(), "L 1;\r\n");
        assert_eq!(Source::new("a", *b"\0L\0 \x001\0;").text(), "L 1;");
        // With the mark of DOS at the end.
        assert_eq!(Source::new("a", *b"L 1;\r\n\x1A").text(), "L 1;\r\n");
        assert_eq!(Source::new("a", *b"Z\xE4hler\x1A").text(), "Zähler");
        assert_eq!(Source::new("a", *b"L 1;\r\n\x1A\x1A\x1A").text(), "L 1;\r\n");
        assert_eq!(Source::new("a", *b"L 1;\r\n\x1A\0\0\x1A\0").text(), "L 1;\r\n");
        assert_eq!(Source::new("a", *b"\x1A\x1A").text(), "");
        // Neither within a text, nor zeros alone.
        for kept in ["L 1;\x1AT MB 2;", "L 1;\0\0", "\0\x1A", ""] {
            assert_eq!(Source::new("a", kept).text(), kept);
        }
        // Lines of an old Mac.
        assert_eq!(Source::new("a", *b"L 1;\rT MB 2;\r").text(), "L 1;\nT MB 2;\n");
        assert_eq!(Source::new("a", *b"L 1;\r\nT MB 2;\r").text(), "L 1;\r\nT MB 2;\r");
        // Cut off in a character, and in a pair of units.
        assert_eq!(Source::new("a", *b"\xFF\xFEZ\0\xE4").text(), "Z\u{fffd}");
        assert_eq!(Source::new("a", *b"\xFE\xFF\xD8\0").text(), "\u{fffd}");
    }

    #[test]
    fn cp1252_goes_both_ways() {
        for byte in 0..=255u8 {
            assert_eq!(to_cp1252(cp1252(byte)), Some(byte));
        }
        assert_eq!(to_cp1252('Ж'), None);
        assert_eq!(
            ['Ж', 'я', 'ё', 'ł', 'ä', '中'].map(to_byte),
            [Some(0xC6), Some(0xFF), Some(0xB8), Some(0xB3), Some(0xE4), None]
        );
    }
}
