//! Parameters that are keys: how a key is written, checked and read, and the rows that several protocols have.

use crate::error::ParamError;
use crate::parameter_bytes::{Value, nearest};
use ob1_serial::{Flow, LineSettings, Parity, StopBits};

/// How a key is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind341 {
    /// One of these words or numbers.
    Choice(&'static [&'static str]),
    /// A number, `min..=max` in steps of `step` from 0.
    Number {
        /// The smallest number allowed.
        min: i64,
        /// The largest number allowed.
        max: i64,
        /// Distance of the allowed numbers, counted from 0.
        step: i64,
    },
    /// Text of at most `max` bytes.
    Text {
        /// Most bytes of the text.
        max: usize,
    },
}

/// One row of the table.
#[derive(Clone, Copy, Debug)]
pub struct Key341 {
    /// Key in the station file.
    pub key: &'static str,
    /// How it is written.
    pub kind: Kind341,
    /// Default; empty: it depends on other keys.
    pub default: &'static str,
    /// What it means, for people.
    pub text: &'static str,
    /// It is allowed only if this earlier key has this value.
    pub needs: Option<(&'static str, &'static str)>,
}

pub(crate) const fn choice(
    key: &'static str,
    kind: &'static [&'static str],
    default: &'static str,
    text: &'static str,
) -> Key341 {
    Key341 { key, kind: Kind341::Choice(kind), default, text, needs: None }
}

pub(crate) const fn number(
    key: &'static str,
    (min, max, step): (i64, i64, i64),
    default: &'static str,
    text: &'static str,
) -> Key341 {
    Key341 { key, kind: Kind341::Number { min, max, step }, default, text, needs: None }
}

pub(crate) const fn text(key: &'static str, max: usize, text: &'static str) -> Key341 {
    Key341 { key, kind: Kind341::Text { max }, default: "", text, needs: None }
}

/// The rows of a protocol, table by table.
pub type Tables = &'static [&'static [Key341]];

/// Protocols by name, with the rows that belong to each.
pub type Protocols = &'static [(&'static str, Tables)];

/// The baud rates of a type.
pub(crate) const fn baud(rates: &'static [&'static str]) -> Key341 {
    choice("baud", rates, "9600", "baud rate, bit/s")
}

/// The bits of a character.
pub(crate) const CHARACTER: &[Key341; 3] = &[
    choice("data_bits", &["7", "8"], "8", "data bits of a character"),
    choice("parity", &["none", "odd", "even"], "even", "parity bit"),
    choice("stop_bits", &["1", "2"], "1", "stop bits"),
];

/// The key of the receive buffer at a start-up: CP 340.
pub(crate) const CLEAR: &str = "clear_buffer";

impl Key341 {
    /// The same key, allowed only if an earlier one has this value.
    pub(crate) const fn only_with(mut self, key: &'static str, value: &'static str) -> Self {
        self.needs = Some((key, value));
        self
    }

    /// `before`: the keys of the table before this one.
    pub(crate) fn is_needed(&self, before: &Reader<'_>) -> bool {
        self.needs.is_none_or(|(key, value)| before.value(key) == Some(&written(value)))
    }

    /// The error for a key given without the key that it needs.
    pub(crate) fn needless(&self, value: &Value) -> ParamError {
        let needed = self.needs.map_or_else(String::new, |(key, value)| format!("{key} = {}", written(value)));
        error(self.key, value.to_string(), format!("only with {needed}"), format!("write {needed}, or remove this key"))
    }

    /// The allowed values as text.
    pub fn allowed(&self) -> String {
        match self.kind {
            Kind341::Choice(words) => words.join(", "),
            Kind341::Number { min, max, step: 1 } => format!("{min}..{max}"),
            Kind341::Number { min, max, step } => format!("{min}..{max} in steps of {step}"),
            Kind341::Text { max } => format!("text of at most {max} bytes"),
        }
    }

    pub(crate) fn checked(&self, value: &Value) -> Result<Value, ParamError> {
        let refused =
            |remedy: String| error(self.key, value.to_string(), self.allowed(), format!("{remedy} ({})", self.text));
        match (self.kind, value) {
            (Kind341::Choice(words), _) => {
                let given = match value {
                    Value::Int(number) => number.to_string(),
                    Value::Str(text) => text.to_ascii_lowercase(),
                };
                match words.iter().find(|word| **word == given) {
                    Some(word) => Ok(written(word)),
                    None => Err(refused(match nearest(&given, words.iter().copied()) {
                        Some(near) => format!("did you mean {}?", written(near)),
                        None => "choose one of them".into(),
                    })),
                }
            }
            (Kind341::Number { min, max, step }, Value::Int(number)) => {
                if (min..=max).contains(number) && number % step == 0 {
                    Ok(value.clone())
                } else {
                    let near = (number.clamp(&min, &max) + step / 2) / step * step;
                    Err(refused(format!("the nearest is {}", near.clamp(min, max))))
                }
            }
            (Kind341::Number { .. }, Value::Str(_)) => Err(refused("write a number without quotes".into())),
            (Kind341::Text { max }, Value::Str(text)) if text.len() <= max => Ok(value.clone()),
            (Kind341::Text { .. }, Value::Str(text)) => Err(error(
                self.key,
                format!("a text of {} bytes", text.len()),
                self.allowed(),
                "make it shorter".into(),
            )),
            (Kind341::Text { .. }, Value::Int(_)) => Err(refused("write a text in quotes".into())),
        }
    }
}

/// A word of the table as in the station file.
pub(crate) fn written(word: &str) -> Value {
    word.parse().map_or_else(|_| Value::from(word), Value::Int)
}

/// Checked keys by name; a key that a protocol does not have reads 0 and "".
pub(crate) struct Reader<'a>(pub(crate) &'a [(&'static str, Value)]);

impl<'a> Reader<'a> {
    fn value(&self, key: &str) -> Option<&'a Value> {
        self.0.iter().find(|(name, _)| *name == key).map(|(_, value)| value)
    }

    pub(crate) fn has(&self, key: &str) -> bool {
        self.value(key).is_some()
    }

    pub(crate) fn number(&self, key: &str) -> i64 {
        match self.value(key) {
            Some(Value::Int(number)) => *number,
            _ => 0,
        }
    }

    pub(crate) fn word(&self, key: &str) -> &'a str {
        match self.value(key) {
            Some(Value::Str(word)) => word,
            _ => "",
        }
    }
}

pub(crate) fn error(key: &str, value: String, allowed: String, remedy: String) -> ParamError {
    ParamError { byte: None, key: key.into(), value, allowed, remedy }
}

/// The character frame and flow control that the keys ask for.
pub(crate) fn line_of(keys: &Reader<'_>) -> LineSettings {
    LineSettings {
        baud: keys.number("baud") as u32,
        data_bits: keys.number("data_bits") as u8,
        parity: match keys.word("parity") {
            "none" => Parity::None,
            "odd" => Parity::Odd,
            _ => Parity::Even,
        },
        stop_bits: match keys.value("stop_bits") {
            Some(Value::Int(2)) => StopBits::Two,
            Some(Value::Str(_)) => StopBits::OneAndHalf,
            _ => StopBits::One,
        },
        flow: match keys.word("flow") {
            "xon-xoff" => Flow::XonXoff,
            "rts-cts" | "hardware" => Flow::Hardware,
            _ => Flow::None,
        },
        half_duplex: false,
    }
}
