//! Texts of alarms with places for the values that come with them, in Siemens' form: `Pressure @1R%6.2f@ bar`.
//!
//! A place is `@`, the number of a value, the letter of its type, `%` and how it is shown, `@`. ["Inserting Associated
//! Values into Messages" in "Programming with STEP 7"] An alarm with several values has them by their numbers. If it
//! has one, like those of SFC 17, the number counts elements of the type within it.

use std::fmt::Write as _;

use ob1_words::any::AnyType;
use serde::{Deserialize, Serialize};

/// The widest that a value may be shown, in characters.
const WIDEST: usize = 64;
/// What stands in place of a value that has not come.
const MISSING: &str = "?";

/// The type of a value, by its letter.
const fn type_of(letter: char) -> Option<AnyType> {
    Some(match letter {
        'B' => AnyType::Bool,
        'Y' => AnyType::Byte,
        'C' => AnyType::Char,
        'W' => AnyType::Word,
        'I' => AnyType::Int,
        'X' => AnyType::DWord,
        'D' => AnyType::DInt,
        'R' => AnyType::Real,
        _ => return None,
    })
}

/// How a value is shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Shown {
    Decimal,
    Unsigned,
    Hexadecimal,
    Binary,
    /// With so many digits behind the point.
    Point(usize),
    Text,
}

/// A place for a value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Place {
    /// From 1.
    number: usize,
    element: AnyType,
    width: usize,
    shown: Shown,
}

#[derive(Clone, Debug, PartialEq, Eq)]
enum Part {
    Text(String),
    Value(Place),
}

/// The text of an alarm.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(into = "String", try_from = "String")]
pub struct Template {
    source: String,
    parts: Vec<Part>,
}

impl From<Template> for String {
    fn from(template: Template) -> Self {
        template.source
    }
}

impl TryFrom<String> for Template {
    type Error = &'static str;

    fn try_from(source: String) -> Result<Self, &'static str> {
        Self::parse(&source).map_err(|bad| bad.why)
    }
}

/// A place in a text that cannot be understood.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BadPlace {
    /// Where it begins, in bytes.
    pub at: usize,
    /// What is wrong.
    pub why: &'static str,
}

impl Template {
    /// A text with its places. An `@` without a digit behind it stands for itself.
    ///
    /// # Errors
    /// The first place that cannot be understood.
    pub fn parse(text: &str) -> Result<Self, BadPlace> {
        let mut parts = Vec::new();
        let (mut plain, mut at) = (String::new(), 0);
        while let Some(rest) = text.get(at..).filter(|rest| !rest.is_empty()) {
            let place = rest.strip_prefix('@').filter(|place| place.starts_with(|c: char| c.is_ascii_digit()));
            let Some(place) = place else {
                let next = rest.chars().next().map_or(1, char::len_utf8);
                plain.push_str(&rest[..next]);
                at += next;
                continue;
            };
            let bad = |why| BadPlace { at, why };
            let (place, _) = place.split_once('@').ok_or(bad("the place has no second @"))?;
            if !plain.is_empty() {
                parts.push(Part::Text(std::mem::take(&mut plain)));
            }
            parts.push(Part::Value(Place::parse(place).map_err(bad)?));
            at += place.len() + 2;
        }
        if !plain.is_empty() {
            parts.push(Part::Text(plain));
        }
        Ok(Self { source: text.to_owned(), parts })
    }

    /// The text with these values, big-endian as they came.
    #[must_use]
    pub fn with(&self, values: &[&[u8]]) -> String {
        let mut out = String::new();
        for part in &self.parts {
            match part {
                Part::Text(text) => out.push_str(text),
                Part::Value(place) => place.show(values, &mut out),
            }
        }
        out
    }
}

/// The number at the begin, and what is behind it.
fn number(text: &str) -> (Option<usize>, &str) {
    let digits = text.find(|c: char| !c.is_ascii_digit()).unwrap_or(text.len());
    let (digits, rest) = text.split_at(digits);
    (digits.parse().ok(), rest)
}

impl Place {
    /// What is between the two `@`.
    fn parse(place: &str) -> Result<Self, &'static str> {
        let (count, rest) = number(place);
        let count = count.filter(|count| (1..=255).contains(count)).ok_or("values have numbers from 1 on")?;
        let mut letters = rest.chars();
        let element = letters.next().and_then(type_of);
        let element = element.ok_or("the type is one of B Y C W I X D R")?;
        let form = letters.as_str().strip_prefix('%').ok_or("behind the type stands % and how it is shown")?;
        let (width, rest) = number(form);
        let (digits, kind) = match rest.strip_prefix('.') {
            Some(rest) => number(rest),
            None => (None, rest),
        };
        let width = width.unwrap_or(0);
        if width > WIDEST || digits.is_some_and(|digits| digits > WIDEST) {
            return Err("it is wider than 64 characters");
        }
        let shown = match kind {
            "d" => Shown::Decimal,
            "u" => Shown::Unsigned,
            "X" | "x" => Shown::Hexadecimal,
            "b" => Shown::Binary,
            "f" => Shown::Point(digits.unwrap_or(6)),
            "s" => Shown::Text,
            _ if kind.starts_with("t#") => return Err("text libraries are not read: write the texts themselves"),
            _ => return Err("it is shown as d, u, X, b, f or s"),
        };
        if digits.is_some() && kind != "f" {
            return Err("only f has digits behind a point");
        }
        Ok(Self { number: count, element, width, shown })
    }

    /// The bytes of the value: of the only one, if there is one, the element with this number.
    fn bytes<'v>(self, values: &[&'v [u8]]) -> Option<&'v [u8]> {
        let (index, size) = (self.number - 1, self.element.bits().div_ceil(8) as usize);
        match (values, self.shown) {
            ([one], Shown::Text) if index == 0 => Some(one),
            ([one], _) => one.get(index * size..(index + 1) * size),
            (several, Shown::Text) => several.get(index).copied(),
            (several, _) => several.get(index)?.get(..size),
        }
    }

    fn show(self, values: &[&[u8]], out: &mut String) {
        let width = self.width;
        let Some(bytes) = self.bytes(values) else {
            let _ = write!(out, "{MISSING:>width$}");
            return;
        };
        let raw = bytes.iter().take(4).fold(0_u32, |raw, byte| raw << 8 | u32::from(*byte));
        let signed = match self.element {
            AnyType::Int => i64::from(raw as u16 as i16),
            AnyType::DInt => i64::from(raw as i32),
            _ => i64::from(raw),
        };
        let real = f32::from_bits(raw);
        let _ = match (self.shown, self.element) {
            (Shown::Text, _) => {
                let text =
                    bytes.iter().take_while(|byte| **byte != 0).map(|byte| char::from(*byte)).collect::<String>();
                write!(out, "{text:>width$}")
            }
            (Shown::Point(digits), AnyType::Real) => write!(out, "{real:>width$.digits$}"),
            (Shown::Point(digits), _) => write!(out, "{:>width$.digits$}", signed as f64),
            (Shown::Decimal, AnyType::Real) => write!(out, "{:>width$}", real.round()),
            (Shown::Decimal, _) => write!(out, "{signed:>width$}"),
            (Shown::Unsigned, _) => write!(out, "{raw:>width$}"),
            (Shown::Hexadecimal, _) => write!(out, "{raw:>width$X}"),
            (Shown::Binary, _) => write!(out, "{raw:>width$b}"),
        };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shown(text: &str, values: &[&[u8]]) -> String {
        Template::parse(text).expect("it can be understood").with(values)
    }

    #[test]
    fn values_stand_where_the_text_wants_them() {
        let values: [&[u8]; 4] = [&[0xFF, 0xFE], &[0, 0, 1, 0], &1.5_f32.to_be_bytes(), b"Pump 1\0\0"];
        for (text, expected) in [
            ("@1I%d@ bar", "-2 bar"),
            ("@1W%d@", "65534"),
            ("@1I%u@/@1W%6X@", "65534/  FFFE"),
            ("@1Y%b@", "11111111"),
            ("at @2D%6d@!", "at    256!"),
            ("@3R%8.2f@|@3R%f@|@3R%d@", "    1.50|1.500000|2"),
            ("@2D%8.1f@", "   256.0"),
            ("Motor: @4C%s@", "Motor: Pump 1"),
            ("@4C%10s@", "    Pump 1"),
            // A value that has not come, one that is shorter than its type.
            ("@9W%d@ @5W%4d@ @1X%d@", "?    ? ?"),
            // No places.
            ("name@plant.example, 5 @ 3", "name@plant.example, 5 @ 3"),
            ("", ""),
            ("Größe @1I%d@ µm", "Größe -2 µm"),
        ] {
            assert_eq!(shown(text, &values), expected, "{text}");
        }
        assert_eq!(shown("@1B%d@@1B%d@", &[&[1]]), "11");
    }

    /// The only value of an alarm is cut into elements.
    #[test]
    fn elements_of_the_only_value() {
        let value: &[u8] = &[0, 1, 0, 2, 0xFF, 0xFF, 0x41, 0x42];
        assert_eq!(shown("@1W%d@ @2W%d@ @3I%d@ @4W%X@ @5W%d@ @2X%X@", &[value]), "1 2 -1 4142 ? FFFF4142");
        assert_eq!(shown("@7C%s@ @9C%s@", &[value]), "A ?");
        assert_eq!(shown("@1C%s@", &[b"abc"]), "abc");
    }

    #[test]
    fn a_place_that_cannot_be_understood_is_told() {
        for (text, at, why) in [
            ("a @1W%d", 2, "second @"),
            ("@0W%d@", 0, "from 1 on"),
            ("@256W%d@", 0, "from 1 on"),
            ("@99999999999999999999W%d@", 0, "from 1 on"),
            ("@1W%d@ @1Z%d@", 7, "one of B Y C W I X D R"),
            ("@1@", 0, "one of B"),
            ("@1W@", 0, "stands %"),
            ("@1W%@", 0, "shown as"),
            ("@1W%q@", 0, "shown as"),
            ("@1W%99d@", 0, "wider"),
            ("@1R%9.99f@", 0, "wider"),
            ("@1W%6.2d@", 0, "only f"),
            ("@1W%t#Motors@", 0, "text libraries"),
        ] {
            let bad = Template::parse(text).expect_err(text);
            assert!(bad.at == at && bad.why.contains(why), "{text}: {bad:?}");
        }
    }
}
