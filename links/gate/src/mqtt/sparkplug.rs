//! Sparkplug B 3.0: payloads in the wire format of protocol buffers, and the topics of an edge node.
//!
//! There are three messages of a few fields each; a code generator would be longer. [Sparkplug 3.0, "6.4 Payload
//! Definition"]

use ob1_access::Datum;

/// Data types [Sparkplug 3.0, "6.4.16"].
pub(crate) mod kind {
    pub(crate) const INT8: u32 = 1;
    pub(crate) const INT16: u32 = 2;
    pub(crate) const INT32: u32 = 3;
    pub(crate) const INT64: u32 = 4;
    pub(crate) const UINT8: u32 = 5;
    pub(crate) const UINT16: u32 = 6;
    pub(crate) const UINT32: u32 = 7;
    pub(crate) const UINT64: u32 = 8;
    pub(crate) const FLOAT: u32 = 9;
    pub(crate) const BOOLEAN: u32 = 11;
    pub(crate) const STRING: u32 = 12;
    pub(crate) const DATE_TIME: u32 = 13;
    pub(crate) const BYTES: u32 = 17;
}

/// The metric that requests a new birth.
pub(crate) const REBIRTH: &str = "Node Control/Rebirth";
/// The metric that links a death to its birth.
pub(crate) const BD_SEQ: &str = "bdSeq";

/// A value of a metric.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Value {
    /// Up to 32 bits; signed ones as two's complement of their width. Some hosts extend theirs to 32 bits.
    Int(u32),
    Long(u64),
    Float(f32),
    Double(f64),
    Boolean(bool),
    Text(String),
    Bytes(Vec<u8>),
}

/// A metric.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Metric {
    pub(crate) name: Option<String>,
    pub(crate) alias: Option<u64>,
    pub(crate) timestamp: u64,
    pub(crate) datatype: u32,
    pub(crate) historical: bool,
    /// `None`: null.
    pub(crate) value: Option<Value>,
}

/// A payload.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Payload {
    pub(crate) timestamp: u64,
    pub(crate) metrics: Vec<Metric>,
    /// A death has none.
    pub(crate) seq: Option<u8>,
}

/// The data type of values of an S7 type, single ones; times are milliseconds.
pub(crate) fn kind_of(ty: &ob1_model::DataType) -> u32 {
    use ob1_model::DataType as Ty;
    match ty {
        Ty::Bool => kind::BOOLEAN,
        Ty::Byte | Ty::Char => kind::UINT8,
        Ty::Word | Ty::Counter => kind::UINT16,
        Ty::DWord => kind::UINT32,
        Ty::Int => kind::INT16,
        Ty::DInt => kind::INT32,
        Ty::Real => kind::FLOAT,
        Ty::Time | Ty::S5Time | Ty::TimeOfDay => kind::INT64,
        Ty::Date | Ty::DateAndTime => kind::DATE_TIME,
        Ty::Pointer | Ty::Any => kind::BYTES,
        _ => kind::STRING,
    }
}

impl Value {
    /// A single value; an array is sent as its JSON.
    pub(crate) fn of(datum: &Datum) -> Self {
        match datum {
            Datum::Bool(v) => Self::Boolean(*v),
            Datum::Byte(v) => Self::Int((*v).into()),
            Datum::Word(v) => Self::Int((*v).into()),
            Datum::DWord(v) => Self::Int(*v),
            // In 16 bits: hosts refuse what does not fit the data type.
            Datum::Int(v) => Self::Int((*v as u16).into()),
            Datum::DInt(v) => Self::Int(*v as u32),
            Datum::Real(v) => Self::Float(*v),
            Datum::Duration(ms) | Datum::Moment(ms) => Self::Long(*ms as u64),
            Datum::Text(v) => Self::Text(v.clone()),
            Datum::Bytes(v) => Self::Bytes(v.clone()),
            Datum::List(_) => Self::Text(datum.to_string()),
        }
    }

    /// The value of a command, as JSON for a place of the type with this data type.
    pub(crate) fn json(&self, datatype: u32) -> serde_json::Value {
        match self {
            Self::Int(v) => match datatype {
                kind::INT8 => serde_json::json!(*v as i8),
                kind::INT16 => serde_json::json!(*v as i16),
                kind::INT32 => serde_json::json!(*v as i32),
                _ => serde_json::json!(v),
            },
            Self::Long(v) => match datatype {
                kind::INT64 => serde_json::json!(*v as i64),
                kind::DATE_TIME => Datum::Moment(*v as i64).json(),
                _ => serde_json::json!(v),
            },
            Self::Float(v) => Datum::Real(*v).json(),
            Self::Double(v) => serde_json::json!(v),
            Self::Boolean(v) => serde_json::json!(v),
            Self::Text(v) => serde_json::json!(v),
            Self::Bytes(_) => serde_json::Value::Null,
        }
    }
}

impl Payload {
    /// The bytes to send.
    pub(crate) fn encode(&self) -> Vec<u8> {
        let mut out = Vec::new();
        number(&mut out, 1, self.timestamp);
        for metric in &self.metrics {
            bytes(&mut out, 2, &metric.encode());
        }
        if let Some(seq) = self.seq {
            number(&mut out, 3, seq.into());
        }
        out
    }

    /// From received bytes; `None` if they are not a payload. Unknown fields are skipped.
    pub(crate) fn decode(bytes: &[u8]) -> Option<Self> {
        let mut payload = Self::default();
        for field in fields(bytes) {
            match field? {
                (1, Wire::Number(v)) => payload.timestamp = v,
                (2, Wire::Bytes(v)) => payload.metrics.push(Metric::decode(v)?),
                (3, Wire::Number(v)) => payload.seq = Some(v as u8),
                _ => {}
            }
        }
        Some(payload)
    }
}

impl Metric {
    /// Whether it is a control that is switched on.
    pub(crate) fn is_true(&self) -> bool {
        self.value == Some(Value::Boolean(true))
    }

    pub(crate) fn encode(&self) -> Vec<u8> {
        let mut out = Vec::new();
        if let Some(name) = &self.name {
            bytes(&mut out, 1, name.as_bytes());
        }
        if let Some(alias) = self.alias {
            number(&mut out, 2, alias);
        }
        number(&mut out, 3, self.timestamp);
        number(&mut out, 4, self.datatype.into());
        if self.historical {
            number(&mut out, 5, 1);
        }
        match &self.value {
            None => number(&mut out, 7, 1),
            Some(Value::Int(v)) => number(&mut out, 10, (*v).into()),
            Some(Value::Long(v)) => number(&mut out, 11, *v),
            Some(Value::Float(v)) => {
                out.push(12 << 3 | 5);
                out.extend(v.to_le_bytes());
            }
            Some(Value::Double(v)) => {
                out.push(13 << 3 | 1);
                out.extend(v.to_le_bytes());
            }
            Some(Value::Boolean(v)) => number(&mut out, 14, (*v).into()),
            Some(Value::Text(v)) => bytes(&mut out, 15, v.as_bytes()),
            Some(Value::Bytes(v)) => bytes(&mut out, 16, v),
        }
        out
    }

    pub(crate) fn decode(bytes: &[u8]) -> Option<Self> {
        let mut metric = Self::default();
        let text = |v: &[u8]| std::str::from_utf8(v).ok().map(str::to_owned);
        for field in fields(bytes) {
            match field? {
                (1, Wire::Bytes(v)) => metric.name = Some(text(v)?),
                (2, Wire::Number(v)) => metric.alias = Some(v),
                (3, Wire::Number(v)) => metric.timestamp = v,
                (4, Wire::Number(v)) => metric.datatype = v as u32,
                (5, Wire::Number(v)) => metric.historical = v != 0,
                (7, Wire::Number(v)) if v != 0 => metric.value = None,
                (10, Wire::Number(v)) => metric.value = Some(Value::Int(v as u32)),
                (11, Wire::Number(v)) => metric.value = Some(Value::Long(v)),
                (12, Wire::Four(v)) => metric.value = Some(Value::Float(f32::from_le_bytes(v))),
                (13, Wire::Eight(v)) => metric.value = Some(Value::Double(f64::from_le_bytes(v))),
                (14, Wire::Number(v)) => metric.value = Some(Value::Boolean(v != 0)),
                (15, Wire::Bytes(v)) => metric.value = Some(Value::Text(text(v)?)),
                (16, Wire::Bytes(v)) => metric.value = Some(Value::Bytes(v.to_vec())),
                _ => {}
            }
        }
        Some(metric)
    }
}

fn varint(out: &mut Vec<u8>, mut value: u64) {
    while value >= 0x80 {
        out.push(value as u8 | 0x80);
        value >>= 7;
    }
    out.push(value as u8);
}

fn number(out: &mut Vec<u8>, field: u32, value: u64) {
    varint(out, u64::from(field << 3));
    varint(out, value);
}

fn bytes(out: &mut Vec<u8>, field: u32, value: &[u8]) {
    varint(out, u64::from(field << 3 | 2));
    varint(out, value.len() as u64);
    out.extend(value);
}

/// A field on the wire.
enum Wire<'a> {
    Number(u64),
    Four([u8; 4]),
    Eight([u8; 8]),
    Bytes(&'a [u8]),
}

/// The fields of a message; the last is `None` if the message is broken there.
fn fields(mut bytes: &[u8]) -> impl Iterator<Item = Option<(u32, Wire<'_>)>> {
    let mut broken = false;
    std::iter::from_fn(move || {
        if bytes.is_empty() || broken {
            return None;
        }
        let field = next(&mut bytes);
        broken = field.is_none();
        Some(field)
    })
}

fn next<'a>(bytes: &mut &'a [u8]) -> Option<(u32, Wire<'a>)> {
    let tag = read_varint(bytes)?;
    let mut take = |len: usize| {
        let (head, rest) = bytes.split_at_checked(len)?;
        *bytes = rest;
        Some(head)
    };
    let field = u32::try_from(tag >> 3).ok()?;
    Some((
        field,
        match tag & 7 {
            0 => Wire::Number(read_varint(bytes)?),
            1 => Wire::Eight(take(8)?.try_into().ok()?),
            5 => Wire::Four(take(4)?.try_into().ok()?),
            2 => {
                let len = usize::try_from(read_varint(bytes)?).ok()?;
                let (head, rest) = bytes.split_at_checked(len)?;
                *bytes = rest;
                Wire::Bytes(head)
            }
            _ => return None,
        },
    ))
}

fn read_varint(bytes: &mut &[u8]) -> Option<u64> {
    let mut value = 0u64;
    for shift in (0..64).step_by(7) {
        let (byte, rest) = bytes.split_first()?;
        *bytes = rest;
        value |= u64::from(byte & 0x7F) << shift;
        if byte & 0x80 == 0 {
            return Some(value);
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    fn payload() -> Payload {
        let metric = |name: &str, datatype, value| Metric {
            name: Some(name.into()),
            alias: Some(300),
            timestamp: 1_795_370_399_007,
            datatype,
            historical: false,
            value,
        };
        Payload {
            timestamp: 1_795_370_399_007,
            metrics: vec![
                metric("a", kind::INT16, Some(Value::of(&Datum::Int(-2)))),
                metric("b", kind::FLOAT, Some(Value::Float(-1.5))),
                metric("c", kind::BOOLEAN, Some(Value::Boolean(true))),
                metric("d", kind::STRING, Some(Value::Text("täxt".into()))),
                metric("e", kind::UINT64, Some(Value::Long(u64::MAX))),
                metric("f", kind::BYTES, Some(Value::Bytes(vec![0, 255]))),
                Metric { historical: true, alias: None, ..metric("g", kind::UINT8, None) },
            ],
            seq: Some(255),
        }
    }

    #[test]
    fn what_is_sent_is_read_again() {
        assert_eq!(Payload::decode(&payload().encode()), Some(payload()));
        // A number has the width of its data type; what hosts send may be extended to 32 bits.
        assert_eq!(Value::of(&Datum::Int(-2)), Value::Int(0xFFFE));
        for (value, kind) in [(0xFFFF_FFFE, kind::INT16), (0xFFFE, kind::INT16), (0xFE, kind::INT8)] {
            assert_eq!(Value::Int(value).json(kind), serde_json::json!(-2), "{value:X}");
        }
        assert_eq!(Value::Long(u64::MAX).json(kind::INT64), serde_json::json!(-1));
        assert_eq!(Value::Long(1_767_225_600_007).json(kind::DATE_TIME), serde_json::json!("2026-01-01T00:00:00.007"));
        // A payload of Eclipse Tahu's: timestamp 1, one metric "bdSeq" (UInt64) 7, by hand.
        let metric = [&[0x0A, 5][..], b"bdSeq", &[0x18, 1, 0x20, 8, 0x58, 7]].concat();
        let whole = [&[0x08, 1, 0x12, metric.len() as u8][..], &metric].concat();
        let bd = Metric {
            name: Some(BD_SEQ.into()),
            timestamp: 1,
            datatype: kind::UINT64,
            value: Some(Value::Long(7)),
            ..Metric::default()
        };
        let expected = Payload { timestamp: 1, metrics: vec![bd], seq: None };
        assert_eq!((Payload::decode(&whole), expected.encode()), (Some(expected.clone()), whole));
    }

    #[test]
    fn what_is_broken_is_none_and_nothing_panics() {
        let whole = payload().encode();
        for len in 0..whole.len() {
            let _ = Payload::decode(&whole[..len]);
        }
        for wrong in
            [&[0x0F][..], &[0x12, 0x7F], &[0x12, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 1], &[8]]
        {
            assert_eq!(Payload::decode(wrong), None, "{wrong:?}");
        }
        let mut noise = whole;
        for at in 0..noise.len() {
            for flip in 0..8 {
                noise[at] ^= 1 << flip;
                let _ = Payload::decode(&noise);
                noise[at] ^= 1 << flip;
            }
        }
    }
}
