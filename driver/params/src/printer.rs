//! The parameters of the printer driver of a CP 340 and a CP 341: page layout, control characters, message texts.
//! `docs/cp340-printer.md`
//!
//! Siemens keeps them in system data blocks whose layout is not published; here they are keys like the others. The
//! parameters are those of the manual [CP 341 manual 09/2008, p. 76, 94], their notation is ours.

use std::collections::BTreeMap;

use crate::error::ParamError;
use crate::keyed::{Key341, Reader, choice, error, number, text};

/// Its name as a value of `protocol`.
pub(crate) const NAME: &str = "printer";

/// Longest message text, and longest format string, in bytes. [TIA help "PtP data link CP 341"]
pub const TEXT_MAX: usize = 150;

/// Highest number of a message text. [CP 341 manual 09/2008, p. 101]
pub const TEXT_NUMBER_MAX: u16 = 1999;

/// Maximum bytes of all message texts in the file: as many as can be passed to the driver. (ours)
const TEXTS_BYTES: usize = 3000;

/// Maximum bytes of all control characters in the file. (ours)
const CONTROLS_BYTES: usize = 400;

/// The keys after the character frame and the flow control.
pub(crate) const DRIVER: &[Key341] = &[
    number("left_margin", (0, 255, 1), "3", "blanks before each line"),
    number("lines_per_page", (0, 255, 1), "50", "lines of a page with headers and footers; 0: one endless page"),
    choice("line_end", &["cr-lf", "cr", "lf", "lf-cr"], "cr-lf", "what ends a line"),
    text("header_1", TEXT_MAX, "first line of each page; %P is the page number"),
    text("header_2", TEXT_MAX, "second line of each page"),
    text("footer_1", TEXT_MAX, "last line of each page but one; %P is the page number"),
    text("footer_2", TEXT_MAX, "last line of each page"),
    choice("character_set", &["ansi", "ibm-437", "ibm-850"], "ansi", "character set of the printer"),
    choice("emulation", &["none", "hp", "ibm"], "none", "what the printer understands as bold, italic and so on"),
    text("controls", CONTROLS_BYTES, "control statements of one's own: \"B=1B45 b=1B46\""),
    text("texts", TEXTS_BYTES, "message texts, a line for each: \"17 The pressure in the chamber %S\""),
];

/// Control sequences of the printer, in hexadecimal: statement, HP (PCL), IBM (Proprinter). Upper case switches on.
/// (ours; the manual's tables are not public text)
const EMULATIONS: [(u8, &str, &str); 10] = [
    (b'B', "1B28733342", "1B45"),
    (b'b', "1B28733042", "1B46"),
    (b'C', "1B287331362E363648", "0F"),
    (b'c', "1B2873313048", "12"),
    (b'E', "1B28733548", "1B5701"),
    (b'e', "1B2873313048", "1B5700"),
    (b'I', "1B28733153", "1B2547"),
    (b'i', "1B28733053", "1B2548"),
    (b'U', "1B26643044", "1B2D01"),
    (b'u', "1B266440", "1B2D00"),
];

/// Statements with a meaning of their own. [CP 341 manual 09/2008, p. 76]
const RESERVED: [u8; 2] = *b"Fx";

/// What ends a line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LineEnd {
    /// CR LF (0Dh 0Ah).
    CrLf,
    /// CR (0Dh) without LF.
    Cr,
    /// LF (0Ah) without CR.
    Lf,
    /// LF CR (0Ah 0Dh).
    LfCr,
}

impl LineEnd {
    /// The characters that end a line on the paper.
    pub const fn bytes(self) -> &'static [u8] {
        match self {
            Self::CrLf => b"\r\n",
            Self::Cr => b"\r",
            Self::Lf => b"\n",
            Self::LfCr => b"\n\r",
        }
    }

    /// The character by which lines are counted.
    pub const fn counted(self) -> u8 {
        match self {
            Self::Cr => b'\r',
            _ => b'\n',
        }
    }
}

/// The character set of the printer. Texts of the program and of the station file are ANSI (ISO 8859-1).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CharacterSet {
    /// ANSI: texts go out unchanged.
    Ansi,
    /// IBM code page 437.
    Ibm437,
    /// IBM code page 850.
    Ibm850,
}

impl CharacterSet {
    /// The printer's character for an ANSI one; `?` if it has none.
    pub fn byte(self, ansi: u8) -> u8 {
        let upper = ansi.checked_sub(0xA0).map(usize::from);
        match (self, upper) {
            (Self::Ibm437, Some(at)) => IBM_437[at],
            (Self::Ibm850, Some(at)) => IBM_850[at],
            (Self::Ibm437 | Self::Ibm850, None) if ansi >= 0x80 => b'?',
            _ => ansi,
        }
    }
}

/// Parameters of the printer driver. Texts are ANSI.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Printer {
    /// Longest wait for XON or CTS in milliseconds.
    pub flow_wait_ms: u32,
    /// Blanks before each line.
    pub left_margin: u8,
    /// Lines of a page with headers and footers; 0: one endless page.
    pub lines_per_page: u8,
    /// What ends a line.
    pub line_end: LineEnd,
    /// First lines of each page.
    pub headers: Vec<Vec<u8>>,
    /// Last lines of each page.
    pub footers: Vec<Vec<u8>>,
    /// The printer's character set.
    pub character_set: CharacterSet,
    /// What a control statement sends.
    pub controls: BTreeMap<u8, Vec<u8>>,
    /// Message texts by number.
    pub texts: BTreeMap<u16, Vec<u8>>,
}

impl Printer {
    pub(crate) fn of(keys: &Reader<'_>) -> Result<Self, ParamError> {
        let lines = |names: [&'static str; 2]| {
            let given = names.into_iter().filter(|name| !keys.word(name).is_empty());
            given.map(|name| ansi(name, keys.word(name))).collect::<Result<Vec<_>, _>>()
        };
        let printer = Self {
            flow_wait_ms: keys.number("flow_wait_ms") as u32,
            left_margin: keys.number("left_margin") as u8,
            lines_per_page: keys.number("lines_per_page") as u8,
            line_end: match keys.word("line_end") {
                "cr" => LineEnd::Cr,
                "lf" => LineEnd::Lf,
                "lf-cr" => LineEnd::LfCr,
                _ => LineEnd::CrLf,
            },
            headers: lines(["header_1", "header_2"])?,
            footers: lines(["footer_1", "footer_2"])?,
            character_set: match keys.word("character_set") {
                "ibm-437" => CharacterSet::Ibm437,
                "ibm-850" => CharacterSet::Ibm850,
                _ => CharacterSet::Ansi,
            },
            controls: controls(keys.word("emulation"), keys.word("controls"))?,
            texts: texts(keys.word("texts"))?,
        };
        let layout = printer.headers.len() + printer.footers.len();
        if printer.lines_per_page > 0 && usize::from(printer.lines_per_page) <= layout {
            let given = printer.lines_per_page.to_string();
            let allowed = format!("{} or more with {layout} lines of headers and footers", layout + 1);
            return Err(error("lines_per_page", given, allowed, "leave room for a line of text".into()));
        }
        Ok(printer)
    }

    /// Lines of a page for texts; 0: endless.
    pub fn body_lines(&self) -> usize {
        usize::from(self.lines_per_page).saturating_sub(self.headers.len() + self.footers.len())
    }
}

/// A text of the station file in ANSI.
fn ansi(key: &str, text: &str) -> Result<Vec<u8>, ParamError> {
    let byte = |character: char| {
        u8::try_from(u32::from(character)).map_err(|_| {
            let allowed = "characters of ANSI (ISO 8859-1)".into();
            error(key, format!("the character {character}"), allowed, "write another character".into())
        })
    };
    text.chars().map(byte).collect()
}

fn texts(given: &str) -> Result<BTreeMap<u16, Vec<u8>>, ParamError> {
    let mut texts = BTreeMap::new();
    for line in given.lines().map(|line| line.trim_end_matches('\r')).filter(|line| !line.trim().is_empty()) {
        let refused =
            |allowed: &str, remedy: &str| error("texts", format!("the line \"{line}\""), allowed.into(), remedy.into());
        // As in a file of message texts: `17:text`, or with a blank.
        let line_of = line.trim_start();
        let (number, text) = line_of.split_once([' ', ':']).unwrap_or((line_of, ""));
        let number = number.parse::<u16>().ok().filter(|number| *number <= TEXT_NUMBER_MAX);
        let number = number.ok_or_else(|| {
            refused("a number 0..1999, a colon or a blank, the text", "begin each line with a number")
        })?;
        let text = ansi("texts", text)?;
        if text.len() > TEXT_MAX {
            return Err(refused("at most 150 characters", "make the text shorter"));
        }
        if texts.insert(number, text).is_some() {
            return Err(refused("each number once", "give it another number"));
        }
    }
    Ok(texts)
}

fn controls(emulation: &str, own: &str) -> Result<BTreeMap<u8, Vec<u8>>, ParamError> {
    let bytes = |text: &str| {
        let pair = |at: usize| text.get(at..at + 2).and_then(|pair| u8::from_str_radix(pair, 16).ok());
        if text.len().is_multiple_of(2) {
            (0..text.len()).step_by(2).map(pair).collect::<Option<Vec<u8>>>()
        } else {
            None
        }
    };
    let of_printer = EMULATIONS.iter().filter_map(|(statement, hp, ibm)| match emulation {
        "hp" => Some((*statement, bytes(hp)?)),
        "ibm" => Some((*statement, bytes(ibm)?)),
        _ => Some((*statement, Vec::new())),
    });
    let mut controls: BTreeMap<u8, Vec<u8>> = of_printer.collect();
    for word in own.split_whitespace() {
        let refused = |remedy: &str| {
            let allowed = "LETTER=HEX, such as B=1B45".into();
            error("controls", format!("\"{word}\""), allowed, remedy.into())
        };
        let (letter, hex) = word.split_once('=').ok_or_else(|| refused("write the letter, = and the characters"))?;
        let &[letter] = letter.as_bytes() else { return Err(refused("a control statement is one letter")) };
        if !letter.is_ascii_alphabetic() {
            return Err(refused("a control statement is one letter"));
        }
        if RESERVED.contains(&letter) {
            return Err(refused("F (new page) and x (no line end) have their meaning; take another letter"));
        }
        let sends = bytes(hex).ok_or_else(|| refused("write two hexadecimal digits for each character"))?;
        controls.insert(letter, sends);
    }
    Ok(controls)
}

/// A0h to FFh of ISO 8859-1 in code page 437.
const IBM_437: [u8; 96] = [
    0xFF, 0xAD, 0x9B, 0x9C, 0x3F, 0x9D, 0x3F, 0x3F, 0x3F, 0x3F, 0xA6, 0xAE, 0xAA, 0x3F, 0x3F, 0x3F, 0xF8, 0xF1, 0xFD,
    0x3F, 0x3F, 0xE6, 0x3F, 0xFA, 0x3F, 0x3F, 0xA7, 0xAF, 0xAC, 0xAB, 0x3F, 0xA8, 0x3F, 0x3F, 0x3F, 0x3F, 0x8E, 0x8F,
    0x92, 0x80, 0x3F, 0x90, 0x3F, 0x3F, 0x3F, 0x3F, 0x3F, 0x3F, 0x3F, 0xA5, 0x3F, 0x3F, 0x3F, 0x3F, 0x99, 0x3F, 0x3F,
    0x3F, 0x3F, 0x3F, 0x9A, 0x3F, 0x3F, 0xE1, 0x85, 0xA0, 0x83, 0x3F, 0x84, 0x86, 0x91, 0x87, 0x8A, 0x82, 0x88, 0x89,
    0x8D, 0xA1, 0x8C, 0x8B, 0x3F, 0xA4, 0x95, 0xA2, 0x93, 0x3F, 0x94, 0xF6, 0x3F, 0x97, 0xA3, 0x96, 0x81, 0x3F, 0x3F,
    0x98,
];

/// The same in code page 850.
const IBM_850: [u8; 96] = [
    0xFF, 0xAD, 0xBD, 0x9C, 0xCF, 0xBE, 0xDD, 0xF5, 0xF9, 0xB8, 0xA6, 0xAE, 0xAA, 0xF0, 0xA9, 0xEE, 0xF8, 0xF1, 0xFD,
    0xFC, 0xEF, 0xE6, 0xF4, 0xFA, 0xF7, 0xFB, 0xA7, 0xAF, 0xAC, 0xAB, 0xF3, 0xA8, 0xB7, 0xB5, 0xB6, 0xC7, 0x8E, 0x8F,
    0x92, 0x80, 0xD4, 0x90, 0xD2, 0xD3, 0xDE, 0xD6, 0xD7, 0xD8, 0xD1, 0xA5, 0xE3, 0xE0, 0xE2, 0xE5, 0x99, 0x9E, 0x9D,
    0xEB, 0xE9, 0xEA, 0x9A, 0xED, 0xE8, 0xE1, 0x85, 0xA0, 0x83, 0xC6, 0x84, 0x86, 0x91, 0x87, 0x8A, 0x82, 0x88, 0x89,
    0x8D, 0xA1, 0x8C, 0x8B, 0xD0, 0xA4, 0x95, 0xA2, 0x93, 0xE4, 0x94, 0xF6, 0x9B, 0x97, 0xA3, 0x96, 0x81, 0xEC, 0xE7,
    0x98,
];

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cp341::{Cp341, Protocol341};
    use crate::module_types::CpKind;
    use crate::parameter_bytes::Value;

    fn printer(keys: &[(&str, Value)]) -> Result<Printer, String> {
        let keys: Vec<(&str, Value)> =
            [("protocol", Value::from(NAME))].into_iter().chain(keys.iter().cloned()).collect();
        let [small, large] = [CpKind::Cp340, CpKind::Cp341].map(|kind| Cp341::of_kind(kind, keys.iter().cloned()));
        match (small, large) {
            (Ok(small), Ok(large)) => {
                assert_eq!(small.protocol, large.protocol);
                let Protocol341::Printer(printer) = small.protocol else { panic!("{:?}", small.protocol) };
                Ok(*printer)
            }
            (Err(small), Err(large)) if small == large => Err(small.to_string()),
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn defaults() {
        let printer = printer(&[]).expect("parameters");
        assert_eq!((printer.left_margin, printer.lines_per_page, printer.body_lines()), (3, 50, 50));
        assert_eq!((printer.line_end.bytes(), printer.flow_wait_ms), (&b"\r\n"[..], 20_000));
        assert_eq!((printer.controls.len(), printer.controls[&b'B'].len()), (10, 0), "no emulation prints nothing");
    }

    #[test]
    fn texts_and_controls_are_read() {
        let texts = "\n17:The pressure in the chamber %S\n\n  1999 \u{fc}ber\n0\n";
        let keys = [("texts", texts.into()), ("emulation", "ibm".into()), ("controls", "B=1B47 Q=07".into())];
        let printer = printer(&keys).expect("parameters");
        let numbers: Vec<u16> = printer.texts.keys().copied().collect();
        assert_eq!(numbers, [0, 17, 1999]);
        assert_eq!(printer.texts[&17], b"The pressure in the chamber %S");
        assert_eq!((printer.texts[&1999].as_slice(), printer.texts[&0].len()), (&b"\xFCber"[..], 0));
        let sends = [b'B', b'b', b'Q'].map(|letter| printer.controls[&letter].clone());
        assert_eq!(sends, [vec![0x1B, 0x47], vec![0x1B, 0x46], vec![7]]);
    }

    #[test]
    fn characters_are_the_printers() {
        let sets = [CharacterSet::Ansi, CharacterSet::Ibm437, CharacterSet::Ibm850];
        for (ansi, expected) in
            [(b'A', [b'A'; 3]), (0xFC, [0xFC, 0x81, 0x81]), (0xD8, [0xD8, b'?', 0x9D]), (0x80, [0x80, b'?', b'?'])]
        {
            assert_eq!(sets.map(|set| set.byte(ansi)), expected, "{ansi:02X}");
        }
    }

    #[test]
    fn what_cannot_be_is_said_with_the_remedy() {
        let long = format!("1 {}", "x".repeat(151));
        let table: [(&str, Value, &str); 10] = [
            ("texts", "pressure".into(), "begin each line with a number"),
            ("texts", "2000 x".into(), "0..1999"),
            ("texts", "1 a\n1 b".into(), "each number once"),
            ("texts", long.as_str().into(), "at most 150"),
            ("texts", "1 \u{20ac}".into(), "ISO 8859-1"),
            ("controls", "B:1B45".into(), "LETTER=HEX"),
            ("controls", "B=1B4".into(), "two hexadecimal digits"),
            ("controls", "F=0C".into(), "F (new page)"),
            ("header_1", "x".repeat(151).as_str().into(), "a text of 151 bytes"),
            ("left_margin", Value::Int(256), "the nearest is 255"),
        ];
        for (key, value, says) in table {
            let error = printer(&[(key, value)]).expect_err("refused");
            assert!(error.contains(says), "{key}: {error}");
        }
        let keys = [("lines_per_page", Value::Int(2)), ("header_1", "a".into()), ("footer_2", "b".into())];
        assert!(printer(&keys).expect_err("refused").contains("3 or more"));
    }
}
