//! What communication processors have in common in the station file: line, parameters as keys and as bytes.

use std::path::Path;

use ob1_params::cp240_table::ByteTables;
use ob1_params::{Cp240, CpKind, ModbusKind, ParamError, Protocol, StopBits, Value, zero};

use super::findings::{CONTRADICTION, Findings, LINE, MISSING, PARAMETER, VALUE};
use super::line::{self, Line};
use super::tables::{ModuleTable, Placed};

/// Refuses 1.5 stop bits on a line that does not have them.
pub(super) fn stop_bits_of(f: &mut Findings<'_>, table: &ModuleTable, line: &Line, stop_bits: StopBits) {
    if stop_bits == StopBits::OneAndHalf && !matches!(line, Line::Sim(_)) {
        let at = match (&table.params, &table.raw) {
            (Some(keys), _) => {
                let found = keys.get_ref().iter().find(|(key, _)| key.get_ref() == "stop_bits");
                found.map_or(keys.span(), |(key, value)| key.span().start..value.span().end)
            }
            (None, raw) => raw.as_ref().map_or_else(|| table.kind.span(), Placed::span),
        };
        let remedy = "1 or 2 stop bits: Linux has no 1.5; a line `sim:NAME` has";
        f.error(PARAMETER, at, format!("{line} cannot do 1.5 stop bits"), remedy);
    }
}

/// The line of a CP.
pub(super) fn line_of(f: &mut Findings<'_>, table: &ModuleTable, folder: &Path, cp: &str) -> Option<Line> {
    let Some(text) = &table.line else {
        f.error(MISSING, table.kind.span(), format!("{cp} has no line"), format!("add `line`: {}", line::REMEDY));
        return None;
    };
    match Line::parse(text.get_ref(), folder) {
        Ok(line) => Some(line),
        Err(error) => {
            f.error(LINE, text.span(), error.to_string(), line::REMEDY);
            None
        }
    }
}

/// The table lets every Modbus mode have 5 to 8 data bits. A byte as a character takes 8, hexadecimal text takes 7.
pub(super) fn characters_of_modbus(f: &mut Findings<'_>, table: &ModuleTable, params: &Cp240) {
    let Protocol::Modbus(modbus) = &params.protocol else { return };
    use ModbusKind::{MasterRtu, SlaveRtuLong, SlaveRtuShort};
    let is_rtu = matches!(modbus.kind, MasterRtu | SlaveRtuShort | SlaveRtuLong);
    let needed = if is_rtu { 8 } else { 7 };
    if params.data_bits < needed {
        let mode = if is_rtu { "RTU" } else { "ASCII" };
        let message = format!("Modbus {mode} cannot travel in characters of {} bits", params.data_bits);
        let remedy = if is_rtu { "`data_bits = 8`" } else { "`data_bits = 7` or `data_bits = 8`" };
        f.error(PARAMETER, place_of(table, "data_bits"), message, remedy);
    }
}

/// The place of a parameter in the file: its value, or else what has all of them.
pub(super) fn place_of(table: &ModuleTable, key: &str) -> std::ops::Range<usize> {
    let named = table
        .params
        .as_ref()
        .and_then(|keys| keys.get_ref().iter().find(|(name, _)| name.get_ref() == key).map(|(_, value)| value.span()));
    named.or_else(|| table.raw.as_ref().map(Placed::span)).unwrap_or_else(|| table.kind.span())
}

pub(super) type Keys = std::collections::BTreeMap<Placed<String>, Placed<toml::Value>>;

/// The parameters of a CP that has 16 bytes of them: as keys or as these bytes, exactly one of both.
pub(super) fn keys_or_bytes<P>(
    f: &mut Findings<'_>,
    table: &ModuleTable,
    (cp, tables): (&str, ByteTables),
    of_keys: impl Fn(Vec<(&str, Value)>) -> Result<P, ParamError>,
    of_bytes: fn(&[u8; 16]) -> Result<P, ParamError>,
) -> Option<P> {
    match (&table.params, &table.raw) {
        (Some(given), None) => from_keys(f, given, of_keys),
        (None, Some(raw)) => from_raw(f, (cp, tables), raw, of_bytes),
        (Some(_), Some(raw)) => {
            let remedy = "keep one of them; `ob1 check STATION --verbose` prints the other form";
            f.error(CONTRADICTION, raw.span(), "the parameters are given twice, as `params` and as `raw`", remedy);
            None
        }
        (None, None) => {
            let remedy = "params = { protocol = \"3964r\", baud = 9600 }, or raw = \"00 04 13 ...\" with all 16 bytes; \
                sixteen 00 are a CP without parameters: ASCII, 9600 baud";
            f.error(MISSING, table.kind.span(), format!("the {cp} has no parameters"), remedy);
            None
        }
    }
}

/// Warns of what is allowed, and lets orders fail.
pub(super) fn zeros_of(f: &mut Findings<'_>, table: &ModuleTable, kind: CpKind, params: &Cp240) {
    let Protocol::S3964(s3964) = &params.protocol else { return };
    if s3964.qvz_ms == 0 {
        let characters = zero::characters(kind, "qvz_ms");
        let time = (characters * params.char_time()).micros();
        let message = format!("QVZ = 0 means {characters} character times, here {time} us");
        let remedy = "a partner that acknowledges later is not waited for, and each order fails with 07h: \
            write `qvz_ms = 500`";
        f.warning(PARAMETER, place_of(table, "qvz_ms"), message, remedy);
    }
}

/// The parameters of these keys. Every key that is wrong is reported, except those that are wrong only because another
/// one is.
pub(super) fn from_keys<P>(
    f: &mut Findings<'_>,
    given: &Placed<Keys>,
    of_keys: impl Fn(Vec<(&str, Value)>) -> Result<P, ParamError>,
) -> Option<P> {
    let mut keys = keys_of(f, given)?;
    let mut wrong: Vec<String> = Vec::new();
    loop {
        let error = match of_keys(keys.clone()) {
            Ok(params) => return wrong.is_empty().then_some(params),
            Err(error) => error,
        };
        if !wrong.iter().any(|key| error.follows_from(key)) {
            parameter(f, place_in(given, &error), &error);
        }
        // What else is wrong shows without it; the protocol decides on all others.
        let before = keys.len();
        keys.retain(|(key, _)| *key != error.key);
        if error.key == "protocol" || keys.len() == before {
            return None;
        }
        wrong.push(error.key);
    }
}

/// The keys as the parameter tables take them; `None` if one has a value of a type that no parameter has.
fn keys_of<'a>(f: &mut Findings<'_>, params: &'a Placed<Keys>) -> Option<Vec<(&'a str, Value)>> {
    let mut keys = Vec::new();
    for (key, value) in params.get_ref() {
        let converted = match value.get_ref() {
            toml::Value::Integer(number) => Value::Int(*number),
            toml::Value::String(text) => Value::Str(text.clone()),
            // Stop bits are 1, 1.5 and 2.
            toml::Value::Float(number) => Value::Str(number.to_string()),
            other => {
                let message =
                    format!("the parameter `{}` cannot be a value of type {}", key.get_ref(), other.type_str());
                f.error(PARAMETER, value.span(), message, "a number or a word in quotes");
                continue;
            }
        };
        keys.push((key.get_ref().as_str(), converted));
    }
    (keys.len() == params.get_ref().len()).then_some(keys)
}

/// The place of the key that is wrong.
fn place_in(params: &Placed<Keys>, error: &ParamError) -> std::ops::Range<usize> {
    let found = params.get_ref().iter().find(|(key, _)| *key.get_ref() == error.key);
    found.map_or(params.span(), |(key, value)| key.span().start..value.span().end)
}

fn from_raw<P>(
    f: &mut Findings<'_>,
    (cp, tables): (&str, ByteTables),
    raw: &Placed<String>,
    decode: fn(&[u8; 16]) -> Result<P, ParamError>,
) -> Option<P> {
    // After the opening quote; in a string with escapes only the caret would be off.
    let start = raw.span().start + 1;
    let mut bytes = [0; 16];
    let mut places = Vec::new();
    for word in raw.get_ref().split_whitespace() {
        let at = word.as_ptr().addr() - raw.get_ref().as_ptr().addr() + start;
        let at = at..at + word.len();
        let Ok(byte) = u8::from_str_radix(word.trim_end_matches(['h', 'H']), 16) else {
            f.error(VALUE, at, format!("\"{word}\" is not a byte"), "16 bytes in hexadecimal: \"0E 04 13 ...\"");
            return None;
        };
        if let Some(cell) = bytes.get_mut(places.len()) {
            *cell = byte;
        }
        places.push(at);
    }
    if places.len() != bytes.len() {
        let message = format!("a {cp} has 16 parameter bytes, not {}", places.len());
        f.error(PARAMETER, raw.span(), message, "unused bytes are written too, as 00");
        return None;
    }
    let place = |error: &ParamError| error.byte.and_then(|b| places.get(b).cloned()).unwrap_or_else(|| raw.span());
    let params = decode(&bytes).map_err(|error| parameter(f, place(&error), &error)).ok()?;
    let reserved = tables.reserved(&bytes);
    if let Some(at) = reserved.first().and_then(|byte| places.get(*byte)) {
        let list: Vec<String> = reserved.iter().map(|byte| format!("{byte} ({:02X}h)", bytes[*byte])).collect();
        let message = format!("no parameter of this protocol lies in byte {}: it is read over", list.join(", "));
        let remedy = "a hardware configuration may write there; otherwise a value is in the wrong byte";
        f.warning(PARAMETER, at.clone(), message, remedy);
    }
    Some(params)
}

fn parameter(f: &mut Findings<'_>, at: std::ops::Range<usize>, error: &ParamError) {
    f.error(PARAMETER, at, error.what(), format!("allowed: {}; {}", error.allowed, error.remedy));
}
