//! Reads and writes values of the station file in the 16 bytes, row by row of the [`table`](crate::cp240_table).

use crate::cp240_table::{ByteTables, Field, Kind, Layout, TICK_MS};
use crate::error::ParamError;
use std::fmt;

/// A parameter as in the station file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Value {
    /// A number: `baud = 9600`
    Int(i64),
    /// A word or text: `parity = "even"`
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
            let mut names = names.to_vec();
            names.sort_by_key(|(_, code)| *code);
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

impl ByteTables {
    /// Checks every code of a record; returns its protocol.
    pub(crate) fn check(&self, record: &Record) -> Result<(&'static str, Layout), ParamError> {
        let Some((name, _, layout)) = self.protocols.iter().find(|(_, code, _)| *code == record[1]) else {
            return Err(ParamError {
                byte: Some(1),
                key: "protocol".into(),
                value: format!("{:02X}h", record[1]),
                allowed: self
                    .protocols
                    .iter()
                    .map(|(n, c, _)| format!("{c:02X}h ({n})"))
                    .collect::<Vec<_>>()
                    .join(", "),
                remedy: "correct the byte or write `protocol = ...` instead".into(),
            });
        };
        for field in (self.fields)(*layout) {
            value(record, field)?;
        }
        Ok((name, *layout))
    }

    /// The bytes of a record that have something in bits of no parameter. The manual gives them no value
    /// [S0 L1896 ff.] and hardware configurations write there, so they are read over; but they can show that a value
    /// is in the wrong byte. None where the manual says that such bytes do not count.
    pub fn reserved(&self, record: &Record) -> Vec<usize> {
        let Some((.., layout)) = self.protocols.iter().find(|(_, code, _)| *code == record[1]) else {
            return Vec::new();
        };
        if layout.ignores_reserved() {
            return Vec::new();
        }
        let mut rest = *record;
        rest[1] = 0;
        for field in (self.fields)(*layout) {
            set_code(&mut rest, field, 0);
        }
        (0..rest.len()).filter(|byte| rest[*byte] != 0).collect()
    }

    /// The record of named keys, and its protocol. `protocol` must be among the keys; missing ones have their default.
    pub(crate) fn of_keys<'a>(
        &self,
        keys: impl IntoIterator<Item = (&'a str, Value)>,
    ) -> Result<(&'static str, Layout, Record), ParamError> {
        let keys: Vec<(&str, Value)> = keys.into_iter().collect();
        each_once(&keys)?;
        let (name, _, layout) = protocol_of(&keys, self.protocols, |row| row.0, Some(1))?;
        let fields = (self.fields)(layout);
        let mut record = self.defaults(name, layout);
        for (key, value) in keys.iter().filter(|(key, _)| *key != "protocol") {
            match fields.iter().find(|field| field.key == *key) {
                Some(field) => set_value(&mut record, field, value)?,
                None => return Err(self.unknown(key, name, fields)),
            }
        }
        Ok((name, layout, record))
    }

    fn unknown(&self, key: &str, protocol: &str, fields: &[Field]) -> ParamError {
        let own = || fields.iter().map(|field| field.key);
        let is_foreign = Layout::ALL.iter().any(|layout| (self.fields)(*layout).iter().any(|field| field.key == key));
        let remedy = if is_foreign {
            format!("`{key}` belongs to another protocol; remove it")
        } else {
            match nearest(key, own()) {
                Some(near) => format!("did you mean `{near}`?"),
                None => "remove it".into(),
            }
        };
        let allowed = match fields {
            [] => format!("protocol \"{protocol}\" alone, it has no parameters"),
            _ => format!("with protocol \"{protocol}\": {}", own().collect::<Vec<_>>().join(", ")),
        };
        ParamError { byte: None, key: key.into(), value: String::new(), allowed, remedy }
    }

    /// The record of values that have been checked. One out of range becomes the default, so that the result can always
    /// be decoded.
    pub(crate) fn encode(&self, protocol: &str, layout: Layout, keys: &[(&str, Value)]) -> Record {
        let mut record = self.defaults(protocol, layout);
        for field in (self.fields)(layout) {
            if let Some((_, value)) = keys.iter().find(|(key, _)| *key == field.key) {
                let _refused = set_value(&mut record, field, value);
            }
        }
        record
    }

    /// All defaults of a layout, with the code of this protocol.
    fn defaults(&self, protocol: &str, layout: Layout) -> Record {
        let mut record = [0; 16];
        record[1] = self.protocols.iter().find(|(name, ..)| *name == protocol).map_or(0, |(_, code, _)| *code);
        for field in (self.fields)(layout) {
            set_code(&mut record, field, field.default);
        }
        record
    }
}

/// Refuses a key given twice.
pub(crate) fn each_once(keys: &[(&str, Value)]) -> Result<(), ParamError> {
    let again = keys.iter().enumerate().find(|(n, (key, _))| keys[..*n].iter().any(|(other, _)| other == key));
    let Some((_, (key, value))) = again else { return Ok(()) };
    Err(ParamError {
        byte: None,
        key: (*key).into(),
        value: value.to_string(),
        allowed: "each key once".into(),
        remedy: "remove one of the two lines".into(),
    })
}

/// The row of the protocol that the keys name. `byte`: where the protocol stands in the record.
pub(crate) fn protocol_of<T: Copy>(
    keys: &[(&str, Value)],
    rows: &[T],
    name_of: fn(&T) -> &'static str,
    byte: Option<usize>,
) -> Result<T, ParamError> {
    let names = || rows.iter().map(name_of);
    let refused = |value: String, remedy: String| ParamError {
        byte,
        key: "protocol".into(),
        value,
        allowed: names().collect::<Vec<_>>().join(", "),
        remedy,
    };
    let given = match keys.iter().find(|(key, _)| *key == "protocol") {
        None => return Err(refused(String::new(), "add `protocol = \"...\"`".into())),
        Some((_, Value::Int(number))) => number.to_string(),
        Some((_, Value::Str(text))) => text.to_ascii_lowercase(),
    };
    rows.iter().find(|row| name_of(row) == given).copied().ok_or_else(|| {
        let remedy = match nearest(&given, names()) {
            Some(name) => format!("did you mean \"{name}\"?"),
            None => "choose one of them".into(),
        };
        refused(format!("\"{given}\""), remedy)
    })
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
