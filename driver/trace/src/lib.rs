//! Reads the records of a line from the driver of a CP, or from the process of a bus (`ob1_serial::tap_record`),
//! with the protocol of the CP: for `ob1 trace` and for the web page.
//!
//! Pure: records in, units and words out; the callers have the sockets and clocks.

use ob1_params::{Cp040, Cp240, Cp341, CpKind, Protocol, Protocol341};
use ob1_protocols::trace::{Dialect, Meaning, Reader, Unit, Way};
use ob1_protocols::{MS, stx_etx};
use ob1_serial::tap_record::{Kind, Record, fault_of};
use serde_json::Value;

/// A CP whose line is read.
#[derive(Debug)]
pub struct Cp {
    /// Its name in the station file.
    pub name: String,
    /// Reads the characters of both directions.
    pub reader: Box<Reader>,
    /// Nanoseconds since 1970 at time 0.
    pub unix: u64,
}

impl Cp {
    /// The CP of a [`Kind::Hello`], with a line about it; `None`: invalid text.
    #[must_use]
    pub fn of_hello(text: &[u8]) -> Option<(Self, String)> {
        let hello: Value = serde_json::from_slice(text).ok()?;
        let name = hello["name"].as_str()?.to_owned();
        if hello["module"] == "bus" {
            return of_bus(&hello, name);
        }
        let numbers: Vec<u8> =
            hello["parameters"].as_array()?.iter().filter_map(|n| u8::try_from(n.as_u64()?).ok()).collect();
        let bytes: [u8; 16] = numbers.try_into().ok()?;
        let (station, line) = (hello["station"].as_str().unwrap_or(""), hello["line"].as_str().unwrap_or(""));
        let unix = hello["unix_ns"].as_u64().unwrap_or(0);
        let kind = hello["module"].as_str().and_then(CpKind::of_name);
        if let Some(kind) = kind.filter(|kind| kind.row().has_channels) {
            let cp = keyed(kind, &hello["params"])?;
            let about =
                format!("{name} of station \"{station}\": {}, {}, {line}", cp.protocol_name(), cp.line_settings());
            return Some((Self { name, reader: Box::new(Reader::new(dialect_of_keyed(&cp))), unix }, about));
        }
        let parameters = match kind {
            Some(CpKind::Cp040) => Cp040::of_bytes(&bytes).ok()?.common,
            _ => Cp240::of_bytes(&bytes).ok()?,
        };
        let about = format!(
            "{name} of station \"{station}\": {}, {}, {line}",
            parameters.protocol_name(),
            parameters.line_settings()
        );
        let reader = Box::new(Reader::new(dialect(&parameters)));
        Some((Self { name, reader, unix }, about))
    }

    /// Hands a record to the reader; the units go to `out`.
    pub fn read(&mut self, record: &Record<'_>, out: &mut dyn FnMut(Unit<'_>)) {
        match (record.kind, record.data) {
            (Kind::Out, bytes) => self.reader.characters(record.time, Way::Out, bytes, out),
            (Kind::In, bytes) => self.reader.characters(record.time, Way::In, bytes, out),
            (Kind::Done, _) => self.reader.done(record.time, out),
            (Kind::Fault, &[number]) => {
                self.reader.fault(record.time, fault_of(number), out);
            }
            // An unfinished unit will not continue.
            (Kind::Gone | Kind::Lost, _) => self.reader.finish(out),
            _ => self.reader.silence(record.time, out),
        }
    }
}

/// A line of a bus.
fn of_bus(hello: &Value, name: String) -> Option<(Cp, String)> {
    let protocol = hello["protocol"].as_str()?;
    let baud = hello["baud"].as_u64();
    // Characters come late from a pty or a USB adapter; a continuing frame must not be cut.
    let pause = 50 * MS;
    let dialect = match protocol {
        "modbus-rtu" => Dialect::ModbusRtu { master: true, pause },
        "dp" => Dialect::Profibus { pause },
        _ => Dialect::ModbusTcp { pause: 1000 * MS },
    };
    let speed = baud.map_or_else(String::new, |baud| format!(", {baud} baud"));
    let about = format!("{name}: {protocol}{speed}, {}", hello["line"].as_str().unwrap_or(""));
    let unix = hello["unix_ns"].as_u64().unwrap_or(0);
    Some((Cp { name, reader: Box::new(Reader::new(dialect)), unix }, about))
}

/// The parameters of a CP 341 or CP 340 from its keys.
fn keyed(kind: CpKind, keys: &Value) -> Option<Cp341> {
    let value = |(key, value): (&String, &Value)| {
        let value = match value {
            Value::String(word) => ob1_params::Value::Str(word.clone()),
            number => ob1_params::Value::Int(number.as_i64()?),
        };
        Some((key.clone(), value))
    };
    let keys: Vec<(String, ob1_params::Value)> = keys.as_object()?.iter().map(value).collect::<Option<_>>()?;
    Cp341::of_kind(kind, keys.iter().map(|(key, value)| (key.as_str(), value.clone()))).ok()
}

/// The protocol of the CP with these parameters.
fn dialect_of_keyed(cp: &Cp341) -> Dialect {
    match &cp.protocol {
        Protocol341::Ascii(p) => Dialect::Ascii { pause: u64::from(p.zvz_ms) * MS },
        Protocol341::S3964(p) => {
            let pause = (u64::from(p.zvz_ms) * MS).max(20 * MS);
            Dialect::S3964 { bcc: p.bcc, rk512: p.rk512, pause }
        }
        // Lines of text: a pause ends a shown unit.
        Protocol341::Printer(_) => Dialect::Ascii { pause: 20 * MS },
        Protocol341::ModbusMaster32(p) => {
            // Characters come late from a pty; a continuing telegram must not be cut.
            let pause = u64::from(p.character_delay_ms).max(20) * MS;
            Dialect::ModbusAscii { master: true, loadable: true, pause }
        }
    }
}

/// The protocol of the CP with these parameters.
fn dialect(parameters: &Cp240) -> Dialect {
    let characters = |count: u64| count * parameters.char_time();
    // A ZVZ of 0 stands for about two characters. [S0 "Character delay time (ZVZ)"]
    let pause = |ms: u16| if ms == 0 { characters(2) } else { u64::from(ms) * MS };
    match &parameters.protocol {
        Protocol::Ascii(p) => Dialect::Ascii { pause: pause(p.zvz_ms) },
        Protocol::StxEtx(p) => Dialect::StxEtx {
            start: stx_etx::Flags::new(p.start, p.start_flags),
            end: stx_etx::Flags::new(p.end, p.end_flags),
            pause: pause(p.tmo_ms),
        },
        Protocol::S3964(p) => Dialect::S3964 { bcc: p.bcc, rk512: p.rk512, pause: pause(p.zvz_ms).max(20 * MS) },
        Protocol::Modbus(_) => {
            let name = parameters.protocol_name();
            let master = name.contains("master");
            if name.contains("rtu") {
                Dialect::ModbusRtu { master, pause: characters(35).max(50 * MS) }
            } else {
                Dialect::ModbusAscii { master, loadable: false, pause: 1000 * MS }
            }
        }
        // 33 bits at 300 baud, enough for any rate of a telegram.
        Protocol::EnOcean => Dialect::EnOcean { pause: 250 * MS },
        Protocol::MBus => Dialect::MBus { pause: 110 * MS },
    }
}

/// The content of a record besides characters, in words; `None`: nothing of interest.
pub fn remark(record: &Record<'_>) -> Option<String> {
    let words = || String::from_utf8_lossy(record.data);
    match record.kind {
        Kind::Gone => Some(format!("the line is gone: {}", words())),
        Kind::Up => Some("the line is up".to_owned()),
        Kind::Note => Some(words().into_owned()),
        Kind::Lost => {
            let count = record.data.first_chunk().map_or(0, |bytes| u64::from_le_bytes(*bytes));
            Some(format!("{count} records were lost here: this trace did not keep up"))
        }
        Kind::TakenBack => {
            let count = record.data.first_chunk().map_or(0, |bytes| u32::from_le_bytes(*bytes));
            (count > 0).then(|| format!("{count} characters were withdrawn before they were sent"))
        }
        Kind::Modem => {
            let bits = record.data.first().copied().unwrap_or(0);
            let level = |bit: u8| if bits >> bit & 1 == 1 { "ON" } else { "OFF" };
            let lines = ["CTS", "DSR", "RI", "CD"].iter().zip(0..).map(|(name, bit)| format!("{name} {}", level(bit)));
            Some(format!("modem lines: {}", lines.collect::<Vec<_>>().join(", ")))
        }
        Kind::Hello | Kind::Out | Kind::In | Kind::Done | Kind::Fault => None,
    }
}

/// What a note of a CP says about the order it has under way.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OrderStep {
    /// It has got a whole order.
    Begun,
    /// It has ended without an error.
    Done,
    /// It has failed, or was refused.
    Failed,
}

/// What a note says about an order of the CPU, if it does; those of a partner are another matter.
pub fn order_step(record: &Record<'_>) -> Option<OrderStep> {
    let text = std::str::from_utf8(record.data).ok().filter(|_| record.kind == Kind::Note)?;
    match text {
        "order done" => Some(OrderStep::Done),
        text if text.starts_with("order of the partner") => None,
        text if text.starts_with("order of ") => Some(OrderStep::Begun),
        text if ["order failed", "order refused", "job ended with STATUS"].iter().any(|end| text.starts_with(end)) => {
            Some(OrderStep::Failed)
        }
        _ => None,
    }
}

/// The bytes of a unit to show: user data, or the raw characters if `raw` is set or there are no user data. For a
/// control character its name is enough.
pub fn shown<'a>(unit: &Unit<'a>, raw: bool) -> Option<&'a [u8]> {
    match (&unit.meaning, unit.meaning.payload()) {
        (Meaning::Control(..) | Meaning::Fault(_), _) => None,
        (_, Some(payload)) if !raw => Some(payload),
        _ => Some(unit.raw),
    }
}

#[cfg(test)]
mod tests {
    use ob1_protocols::Instant;

    use super::*;

    const HELLO: &[u8] = br#"{"version":1,"station":"s","name":"cp","line":"sim:x","module":"cp240",
        "parameters":[0,0,0,0,0,0,0,0,0,0,0,0,0,0,0,0],"unix_ns":1000}"#;

    #[test]
    fn a_greeting_says_what_is_spoken() {
        let (mut cp, about) = Cp::of_hello(HELLO).expect("a greeting");
        assert_eq!((cp.name.as_str(), cp.unix), ("cp", 1000));
        assert!(about.starts_with("cp of station \"s\": "), "{about}");
        let mut told = Vec::new();
        cp.read(&Record { time: Instant::from_nanos(5), kind: Kind::Out, data: b"AB" }, &mut |_| {});
        cp.reader.finish(&mut |unit| told.push((unit.way, shown(&unit, false).map(<[u8]>::to_vec))));
        assert_eq!(told, [(Way::Out, Some(b"AB".to_vec()))]);
        for wrong in [&b"{"[..], b"{}", br#"{"name":"cp","parameters":[1,2]}"#, br#"{"name":7}"#] {
            assert!(Cp::of_hello(wrong).is_none());
        }
    }

    /// The notes are those of `driver/cp/src/tap.rs`.
    #[test]
    fn steps_of_an_order() {
        let step = |text: &str| order_step(&Record { time: Instant::START, kind: Kind::Note, data: text.as_bytes() });
        assert_eq!(step("order of 12 bytes"), Some(OrderStep::Begun));
        assert_eq!(step("order done"), Some(OrderStep::Done));
        assert_eq!(step("order failed, 07h"), Some(OrderStep::Failed));
        assert_eq!(step("job ended with STATUS 0703h: no answer"), Some(OrderStep::Failed));
        assert_eq!((step("order of the partner done"), step("start-up 1")), (None, None));
    }

    #[test]
    fn remarks() {
        let say = |kind, data: &[u8]| remark(&Record { time: Instant::START, kind, data });
        assert_eq!(say(Kind::Lost, &7u64.to_le_bytes()).map(|text| text.starts_with("7 records")), Some(true));
        assert_eq!(say(Kind::TakenBack, &[0; 4]), None);
        assert_eq!(say(Kind::Modem, &[5]).as_deref(), Some("modem lines: CTS ON, DSR OFF, RI ON, CD OFF"));
        assert_eq!(say(Kind::Out, b"x"), None);
        assert!(say(Kind::Lost, &[]).is_some() && say(Kind::Modem, &[]).is_some(), "cut off");
    }
}
