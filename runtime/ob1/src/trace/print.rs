//! Records as text: a line for each telegram and control character, and the user data below it.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use ob1_params::{Cp040, Cp240, Cp341, CpKind, Protocol, Protocol341};
use ob1_protocols::trace::record::{Kind, Record, fault_of};
use ob1_protocols::trace::{Dialect, Meaning, Reader, Unit, Way};
use ob1_protocols::{MS, Nanos, stx_etx};
use serde_json::Value;

use super::source::News;

/// Bytes in a line of a dump.
const WIDTH: usize = 16;

/// A CP whose line is read.
#[derive(Debug)]
pub(super) struct Cp {
    pub(super) name: String,
    pub(super) reader: Box<Reader>,
    /// Nanoseconds since 1970 at time 0.
    pub(super) unix: u64,
}

impl Cp {
    /// The CP of a [`Kind::Hello`], with a line about it; `None`: no such text.
    pub(super) fn of_hello(text: &[u8]) -> Option<(Self, String)> {
        let hello: Value = serde_json::from_slice(text).ok()?;
        let name = hello["name"].as_str()?.to_owned();
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
            Some(CpKind::Cp040) if bytes == [0; 16] => Cp040::defaults("ascii").ok()?.common,
            Some(CpKind::Cp040) => Cp040::decode(&bytes).ok()?.common,
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
    pub(super) fn read(&mut self, record: &Record<'_>, out: &mut dyn FnMut(Unit<'_>)) {
        match (record.kind, record.data) {
            (Kind::Out, bytes) => self.reader.characters(record.time, Way::Out, bytes, out),
            (Kind::In, bytes) => self.reader.characters(record.time, Way::In, bytes, out),
            (Kind::Done, _) => self.reader.done(record.time, out),
            (Kind::Fault, &[number]) => {
                self.reader.fault(record.time, fault_of(number), out);
            }
            // What is open will not go on.
            (Kind::Gone | Kind::Lost, _) => self.reader.finish(out),
            _ => self.reader.silence(record.time, out),
        }
    }
}

/// The parameters of a CP 341 or CP 340 out of its keys.
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

/// What the CP with these parameters speaks.
fn dialect_of_keyed(cp: &Cp341) -> Dialect {
    match &cp.protocol {
        Protocol341::Ascii(p) => Dialect::Ascii { pause: Nanos::from(p.zvz_ms) * MS },
        Protocol341::S3964(p) => {
            let pause = (Nanos::from(p.zvz_ms) * MS).max(20 * MS);
            Dialect::S3964 { bcc: p.bcc, rk512: p.rk512, pause }
        }
        // Lines of text: a pause ends what is shown as one.
        Protocol341::Printer(_) => Dialect::Ascii { pause: 20 * MS },
        Protocol341::ModbusMaster32(p) => {
            // Characters come late from a pty; a telegram that goes on is not cut.
            Dialect::ModbusAscii { master: true, pause: Nanos::from(p.character_delay_ms).max(20) * MS }
        }
    }
}

/// What the CP with these parameters speaks.
fn dialect(parameters: &Cp240) -> Dialect {
    let characters = |count: u64| count * parameters.char_time_ns();
    // A ZVZ of 0 stands for about two characters. [S0 "Character delay time (ZVZ)"]
    let pause = |ms: u16| if ms == 0 { characters(2) } else { Nanos::from(ms) * MS };
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
                Dialect::ModbusAscii { master, pause: 1000 * MS }
            }
        }
        // 33 bits at 300 baud: whatever rate a telegram names.
        Protocol::EnOcean => Dialect::EnOcean { pause: 250 * MS },
        Protocol::MBus => Dialect::MBus { pause: 110 * MS },
    }
}

/// Lines with their times that wait for a telegram that has begun before them.
type Held = Vec<(Nanos, String)>;

/// Turns records into text. A telegram is known when it has ended, and stands at the time it has begun: what has
/// happened meanwhile waits, so that the times of a CP are in order.
#[derive(Debug)]
pub struct Printer {
    raw: bool,
    cps: BTreeMap<u8, Cp>,
    held: BTreeMap<u8, Held>,
    text: String,
}

impl Printer {
    /// Nothing printed yet. `raw`: characters as on the line, instead of user data.
    #[must_use]
    pub fn new(raw: bool) -> Self {
        Self { raw, cps: BTreeMap::new(), held: BTreeMap::new(), text: String::new() }
    }

    /// Takes a record.
    pub fn take(&mut self, number: u8, record: &Record<'_>) {
        self.tell(number, record);
        self.release(number);
    }

    fn tell(&mut self, number: u8, record: &Record<'_>) {
        if record.kind == Kind::Hello {
            match Cp::of_hello(record.data) {
                Some((cp, about)) => {
                    // What is open ends with the parameters it was sent with.
                    self.finish_one(number);
                    line(self.held.entry(number).or_default(), record.time, &cp.name, ' ', &about);
                    self.cps.insert(number, cp);
                }
                None => {
                    let held = self.held.entry(number).or_default();
                    line(held, record.time, "?", ' ', "a CP with parameters that cannot be");
                }
            }
            return;
        }
        let Self { raw, cps, held, .. } = self;
        let (Some(cp), text) = (cps.get_mut(&number), held.entry(number).or_default()) else { return };
        let name = cp.name.clone();
        cp.read(record, &mut |unit| put(text, &name, *raw, &unit));
        let say = |text: &mut Held, what: &str| line(text, record.time, &name, '-', what);
        let words = String::from_utf8_lossy(record.data);
        match record.kind {
            Kind::Gone => say(text, &format!("the line is gone: {words}")),
            Kind::Up => say(text, "the line is up"),
            Kind::Note => say(text, &words),
            Kind::Lost => {
                let count = record.data.first_chunk().map_or(0, |bytes| u64::from_le_bytes(*bytes));
                say(text, &format!("{count} records were lost here: this trace did not keep up"));
            }
            Kind::TakenBack => {
                let count = record.data.first_chunk().map_or(0, |bytes| u32::from_le_bytes(*bytes));
                if count > 0 {
                    say(text, &format!("{count} characters were taken back before they left"));
                }
            }
            Kind::Modem => {
                let bits = record.data.first().copied().unwrap_or(0);
                let level = |bit: u8| if bits >> bit & 1 == 1 { "ON" } else { "OFF" };
                let lines =
                    ["CTS", "DSR", "RI", "CD"].iter().zip(0..).map(|(name, bit)| format!("{name} {}", level(bit)));
                say(text, &format!("modem lines: {}", lines.collect::<Vec<_>>().join(", ")));
            }
            Kind::Hello | Kind::Out | Kind::In | Kind::Done | Kind::Fault => {}
        }
    }

    /// Takes what was heard of a CP.
    pub(crate) fn hear(&mut self, news: &News<'_>) {
        match news {
            News::Record(cp, record) => self.take(*cp, record),
            News::Silence(cp, now) => self.silence(*cp, *now),
        }
    }

    /// So much time has passed at all CPs without a record.
    pub fn silence(&mut self, number: u8, now: Nanos) {
        let Self { raw, cps, held, .. } = self;
        if let Some(cp) = cps.get_mut(&number) {
            let (name, text) = (cp.name.clone(), held.entry(number).or_default());
            cp.reader.silence(now, &mut |unit| put(text, &name, *raw, &unit));
        }
        self.release(number);
    }

    /// Prints what is still open.
    pub fn finish(&mut self) {
        for number in self.cps.keys().copied().collect::<Vec<_>>() {
            self.finish_one(number);
        }
    }

    fn finish_one(&mut self, number: u8) {
        let Self { raw, cps, held, .. } = self;
        if let Some(cp) = cps.get_mut(&number) {
            let (name, text) = (cp.name.clone(), held.entry(number).or_default());
            cp.reader.finish(&mut |unit| put(text, &name, *raw, &unit));
        }
        self.release(number);
    }

    /// Lets go, in the order of their times, of the lines no open telegram has begun before.
    fn release(&mut self, number: u8) {
        let Some(held) = self.held.get_mut(&number) else { return };
        let open = self.cps.get(&number).and_then(|cp| cp.reader.open_since()).unwrap_or(Nanos::MAX);
        held.sort_by_key(|(time, _)| *time);
        let ready = held.iter().take_while(|(time, _)| *time <= open).count();
        self.text.extend(held.drain(..ready).map(|(_, text)| text));
    }

    /// What there is to print; then there is nothing.
    pub fn text(&mut self) -> String {
        std::mem::take(&mut self.text)
    }
}

fn line(held: &mut Held, time: Nanos, name: &str, arrow: char, what: &str) {
    let text = format!("{:>6}.{:06}  {name} {arrow} {what}\n", time / 1_000_000_000, time / 1000 % 1_000_000);
    held.push((time, text));
}

fn put(held: &mut Held, name: &str, raw: bool, unit: &Unit<'_>) {
    let arrow = if unit.way == Way::Out { '>' } else { '<' };
    line(held, unit.begin, name, arrow, &unit.meaning.to_string());
    let Some((_, text)) = held.last_mut() else { return };
    match (&unit.meaning, unit.meaning.payload()) {
        (Meaning::Control(..) | Meaning::Fault(_), _) => {}
        (_, Some(payload)) if !raw => dump(text, payload),
        _ => dump(text, unit.raw),
    }
}

/// Hexadecimal and text, sixteen bytes a line.
fn dump(text: &mut String, bytes: &[u8]) {
    for (number, part) in bytes.chunks(WIDTH).enumerate() {
        let hex: Vec<String> = part.iter().map(|byte| format!("{byte:02X}")).collect();
        let plain: String =
            part.iter().map(|&byte| if (0x20..0x7F).contains(&byte) { char::from(byte) } else { '.' }).collect();
        // Writing into a String cannot fail.
        let _ = writeln!(text, "                 {:04X}  {:<47}  {plain}", number * WIDTH, hex.join(" "));
    }
}
