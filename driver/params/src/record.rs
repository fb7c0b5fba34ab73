//! Reads and writes values of the station file in the 16 bytes, row by row of the [`table`](crate::table).

use crate::error::ParamError;
use crate::table::{Field, Kind, Layout, PROTOCOLS, TICK_MS};
use std::fmt;

/// A parameter as in the station file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Value {
    /// `baud = 9600`
    Int(i64),
    /// `parity = "even"`
    Str(String),
}

impl From<&str> for Value {
    fn from(text: &str) -> Self {
        Self::Str(text.to_owned())
    }
}

impl From<i64> for Value {
    fn from(number: i64) -> Self {
        Self::Int(number)
    }
}

impl fmt::Display for Value {
    /// As in the station file.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Int(number) => write!(f, "{number}"),
            Self::Str(text) => write!(f, "\"{text}\""),
        }
    }
}

pub(crate) type Record = [u8; 16];

/// The bits of a field.
pub(crate) fn code(record: &Record, field: &Field) -> u16 {
    if field.bits == 16 {
        return u16::from_be_bytes([record[field.byte], record[field.byte + 1]]);
    }
    u16::from(record[field.byte] >> field.shift) & mask(field)
}

/// Writes the bits of a field.
pub(crate) fn set_code(record: &mut Record, field: &Field, code: u16) {
    if field.bits == 16 {
        [record[field.byte], record[field.byte + 1]] = code.to_be_bytes();
        return;
    }
    let mask = mask(field) as u8;
    let byte = &mut record[field.byte];
    *byte = *byte & !(mask << field.shift) | ((code as u8 & mask) << field.shift);
}

fn mask(field: &Field) -> u16 {
    (1 << field.bits) - 1
}

/// The value of a field in the record, checked.
pub(crate) fn value(record: &Record, field: &Field) -> Result<Value, ParamError> {
    let code = code(record, field);
    let found = match field.kind {
        Kind::Choice(names) => {
            names.iter().find(|(_, c)| u16::from(*c) == code).map(|(name, _)| match name.parse::<i64>() {
                Ok(number) => Value::Int(number),
                Err(_) => Value::from(*name),
            })
        }
        Kind::Number { min, max } => (min..=max).contains(&code).then_some(Value::Int(code.into())),
        Kind::Ticks { min } => (code >= min).then_some(Value::Int((code * TICK_MS).into())),
    };
    found.ok_or_else(|| ParamError {
        byte: Some(field.byte),
        key: field.key.into(),
        value: if field.bits < 8 { format!("{code:0w$b}b", w = field.bits.into()) } else { format!("{code:02X}h") },
        allowed: codes(field),
        remedy: format!("correct the byte or write `{} = ...` instead ({})", field.key, field.text),
    })
}

/// The allowed codes of a field, for a mistake in the raw bytes.
fn codes(field: &Field) -> String {
    match field.kind {
        Kind::Choice(names) => {
            let one = |(name, code): &(&str, u8)| match field.bits {
                8.. => format!("{code:02X}h ({name})"),
                bits => format!("{code:0w$b}b ({name})", w = bits.into()),
            };
            names.iter().map(one).collect::<Vec<_>>().join(", ")
        }
        Kind::Number { min, max } => format!("{min:02X}h..{max:02X}h ({min}..{max})"),
        Kind::Ticks { min } => format!("{min:02X}h..FFh (units of {TICK_MS} ms)"),
    }
}

/// Writes a value of the station file into the record, checked.
pub(crate) fn set_value(record: &mut Record, field: &Field, value: &Value) -> Result<(), ParamError> {
    let code = match (field.kind, value) {
        (Kind::Choice(names), _) => {
            let name = match value {
                Value::Int(number) => number.to_string(),
                Value::Str(text) => text.to_ascii_lowercase(),
            };
            names.iter().find(|(n, _)| *n == name).map(|(_, code)| u16::from(*code))
        }
        (Kind::Number { min, max }, Value::Int(number)) => {
            u16::try_from(*number).ok().filter(|n| (min..=max).contains(n))
        }
        (Kind::Ticks { min }, Value::Int(ms)) => u16::try_from(*ms)
            .ok()
            .filter(|ms| ms % TICK_MS == 0)
            .map(|ms| ms / TICK_MS)
            .filter(|t| *t >= min && *t <= 255),
        _ => None,
    };
    let code = code.ok_or_else(|| ParamError {
        byte: Some(field.byte),
        key: field.key.into(),
        value: value.to_string(),
        allowed: field.allowed(),
        remedy: format!("{} ({})", remedy(field, value), field.text),
    })?;
    set_code(record, field, code);
    Ok(())
}

/// What to do about a refused value.
fn remedy(field: &Field, value: &Value) -> String {
    match (field.kind, value) {
        (Kind::Choice(names), Value::Str(text)) => match nearest(text, names.iter().map(|(name, _)| *name)) {
            Some(name) => format!("did you mean \"{name}\"?"),
            None => "choose one of them".into(),
        },
        (Kind::Ticks { min }, Value::Int(ms)) if *ms >= 0 => {
            let tick = i64::from(TICK_MS);
            let near = ((ms + tick / 2) / tick).clamp(min.into(), 255) * tick;
            format!("the nearest is {near}")
        }
        (Kind::Number { .. } | Kind::Ticks { .. }, Value::Str(_)) => "write a number without quotes".into(),
        _ => "choose one of them".into(),
    }
}

/// All defaults of a layout, with this protocol code in byte 1.
pub(crate) fn defaults(layout: Layout, protocol: u8) -> Record {
    let mut record = [0; 16];
    record[1] = protocol;
    for field in layout.fields() {
        set_code(&mut record, field, field.default);
    }
    record
}

/// Name and layout of the protocol in byte 1.
pub(crate) fn protocol(record: &Record) -> Result<(&'static str, Layout), ParamError> {
    PROTOCOLS.iter().find(|(_, code, _)| *code == record[1]).map(|(name, _, layout)| (*name, *layout)).ok_or_else(
        || ParamError {
            byte: Some(1),
            key: "protocol".into(),
            value: format!("{:02X}h", record[1]),
            allowed: PROTOCOLS.iter().map(|(n, c, _)| format!("{c:02X}h ({n})")).collect::<Vec<_>>().join(", "),
            remedy: "correct the byte or write `protocol = ...` instead".into(),
        },
    )
}

/// Refuses bits that belong to no field: they show that a value is in the wrong byte.
pub(crate) fn check_reserved(record: &Record, layout: Layout) -> Result<(), ParamError> {
    if layout.ignores_reserved() {
        return Ok(());
    }
    let mut rest = *record;
    rest[1] = 0;
    for field in layout.fields() {
        set_code(&mut rest, field, 0);
    }
    match rest.iter().position(|b| *b != 0) {
        None => Ok(()),
        Some(byte) => Err(ParamError {
            byte: Some(byte),
            key: String::new(),
            value: format!("{:02X}h", record[byte]),
            allowed: "0 in reserved bits".into(),
            remedy: "set them to 0, or move the value to the byte it belongs to".into(),
        }),
    }
}

/// The candidate nearest to a misspelt word, if one is near enough.
pub(crate) fn nearest<'a>(word: &str, candidates: impl Iterator<Item = &'a str>) -> Option<&'a str> {
    let word = word.to_ascii_lowercase().replace('-', "_");
    candidates
        .map(|c| (strsim::damerau_levenshtein(&word, &c.replace('-', "_")), c))
        .min_by_key(|(distance, _)| *distance)
        .filter(|(distance, c)| *distance <= 1 + c.len() / 3)
        .map(|(_, c)| c)
}
