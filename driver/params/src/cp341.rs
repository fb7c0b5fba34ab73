//! The parameters of a CP 341 and of a CP 340: named keys, checked against a table. (docs/cp341.md)
//!
//! In a rack they are in a system data block whose layout Siemens does not publish; here they are keys, both in the
//! station file and in the configuration of the driver.

use crate::error::ParamError;
use crate::parameter_bytes::{Value, each_once, nearest, protocol_of};
use ob1_serial::{LineSettings, Span};

use crate::cp240::Priority;
use crate::cp341_ascii::{self, AsciiOf341};
use crate::cp341_modbus::{self, ModbusMaster32};
use crate::keyed::{CHARACTER, CLEAR, Key341, Kind341, Protocols, Reader, baud, choice, error, line_of, written};
use crate::keys_3964::{ATTEMPTS, qvz, zvz_of_3964};
use crate::module_types::CpKind;
use crate::printer::Printer;
use crate::{cp340, printer};

/// The character frame, first in every protocol. [CP 341 manual 09/2008, p. 38]
const FRAME: &[Key341] = &[
    baud(&["300", "600", "1200", "2400", "4800", "9600", "19200", "38400", "57600", "76800", "115200"]),
    CHARACTER[0],
    CHARACTER[1],
    CHARACTER[2],
];

/// Keys of 3964 and 3964R: ZVZ, QVZ, attempts, priority.
const S3964: &[Key341] = &[zvz_of_3964(20), qvz(20), ATTEMPTS[0], ATTEMPTS[1], ATTEMPTS[2]];

/// Key that RK 512 adds to those of 3964(R).
const RK512: &[Key341] =
    &[choice("reaction", &["20s", "baud"], "20s", "longest wait for the response: 20 s, or as the baud rate has it")];

/// The protocols, by name, with the rows that belong to each besides the character frame.
pub const PROTOCOLS_341: Protocols = &[
    (cp341_ascii::NAME, &[FRAME, cp341_ascii::CRITERION, cp341_ascii::LIMITS, cp341_ascii::FLOW, cp341_ascii::DRIVER]),
    ("3964", &[FRAME, S3964]),
    ("3964r", &[FRAME, S3964]),
    ("3964-rk512", &[FRAME, S3964, RK512]),
    ("3964r-rk512", &[FRAME, S3964, RK512]),
    (cp341_modbus::NAME, &[cp341_modbus::FRAME, cp341_modbus::DRIVER]),
    (printer::NAME, &[FRAME, cp341_ascii::FLOW, printer::DRIVER]),
];

/// The protocols of a type; none for a type whose parameters are bytes.
pub fn protocols_of(kind: CpKind) -> Protocols {
    match kind {
        CpKind::Cp341 => PROTOCOLS_341,
        CpKind::Cp340 => cp340::PROTOCOLS_340,
        CpKind::Cp240 | CpKind::Cp040 | CpKind::Cp343 => &[],
    }
}

/// The parameters of a CP 341 or a CP 340.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Cp341 {
    /// Which of the two it is.
    pub kind: CpKind,
    /// The character frame, and the flow control of the driver.
    pub line: LineSettings,
    /// The protocol and its parameters.
    pub protocol: Protocol341,
    /// The keys in the order of the table: the result of [`Cp341::to_keys`].
    keys: Vec<(&'static str, Value)>,
}

/// Protocol and its own parameters.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Protocol341 {
    /// Bare characters: the ASCII driver.
    Ascii(AsciiOf341),
    /// 3964 and 3964R, with or without RK 512 on top.
    S3964(S3964Of341),
    /// Loadable driver: Modbus ASCII master, 32-bit registers.
    ModbusMaster32(ModbusMaster32),
    /// Printer driver: output only.
    Printer(Box<Printer>),
}

/// Parameters of 3964(R). Times in milliseconds.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct S3964Of341 {
    /// 3964R: with block check character.
    pub bcc: bool,
    /// With RK 512 on top.
    pub rk512: bool,
    /// ZVZ, longest pause between two characters of a telegram.
    pub zvz_ms: u32,
    /// QVZ, longest wait for the partner's acknowledgement.
    pub qvz_ms: u32,
    /// Attempts to get a connection, the first included.
    pub connect_attempts: u16,
    /// Attempts to get a telegram through, the first included.
    pub block_attempts: u16,
    /// Who goes first when both begin at the same time.
    pub priority: Priority,
    /// RK 512: the wait for the response depends on the baud rate, instead of 20 s.
    pub reaction_by_baud: bool,
    /// CP 340: the receive buffer is emptied at each start-up of the CPU.
    pub clear_buffer: bool,
}

impl Cp341 {
    /// Reads named keys of a CP 341. `protocol` must be among them; missing keys have the table's default.
    ///
    /// # Errors
    /// An unknown key (with the nearest known one), a key given twice, an impossible value.
    pub fn from_keys<'a>(given: impl IntoIterator<Item = (&'a str, Value)>) -> Result<Self, ParamError> {
        Self::of_kind(CpKind::Cp341, given)
    }

    /// The same for a type of this family.
    ///
    /// # Errors
    /// A key or a value that this type does not have, as [`Cp341::from_keys`] names it.
    pub fn of_kind<'a>(kind: CpKind, given: impl IntoIterator<Item = (&'a str, Value)>) -> Result<Self, ParamError> {
        let given: Vec<(&str, Value)> = given.into_iter().collect();
        let (protocol, tables) = protocol_of(&given, protocols_of(kind), |row| row.0, None)?;
        let rows = || tables.iter().flat_map(|table| table.iter());
        each_once(&given)?;
        for (key, _) in &given {
            if *key != "protocol" && !rows().any(|row| row.key == *key) {
                let remedy = match nearest(key, rows().map(|row| row.key)) {
                    Some(near) => format!("did you mean `{near}`?"),
                    None => "remove it".into(),
                };
                let known = rows().map(|row| row.key).collect::<Vec<_>>().join(", ");
                return Err(error(key, String::new(), format!("with protocol \"{protocol}\": {known}"), remedy));
            }
        }
        let mut keys = vec![("protocol", Value::from(protocol))];
        for row in rows() {
            let value = given.iter().find(|(key, _)| *key == row.key).map(|(_, value)| value);
            if !row.is_needed(&Reader(&keys)) {
                value.map_or(Ok(()), |value| Err(row.needless(value)))?;
                continue;
            }
            let value = match value {
                Some(value) => row.checked(value)?,
                None => default_of(row, kind, protocol, &Reader(&keys)),
            };
            keys.push((row.key, value));
        }
        Self::of_checked(kind, protocol, keys)
    }

    /// The typed form of keys that have been checked one by one.
    fn of_checked(kind: CpKind, protocol: &str, keys: Vec<(&'static str, Value)>) -> Result<Self, ParamError> {
        let reader = Reader(&keys);
        // "Reception during transmission is ignored." [S4 L727]
        let line = LineSettings { half_duplex: protocol == cp341_modbus::NAME, ..line_of(&reader) };
        let protocol = match protocol {
            cp341_modbus::NAME => {
                cp341_modbus::check(&reader)?;
                Protocol341::ModbusMaster32(ModbusMaster32::of(&reader))
            }
            cp341_ascii::NAME => {
                cp341_ascii::check(&reader, least_zvz_ms(kind, &line))?;
                Protocol341::Ascii(AsciiOf341::of(&reader))
            }
            printer::NAME => Protocol341::Printer(Box::new(Printer::of(&reader)?)),
            name => Protocol341::S3964(S3964Of341::of(name, &reader)),
        };
        Ok(Self { kind, line, protocol, keys })
    }

    /// All parameters as named keys, `protocol` first.
    pub fn to_keys(&self) -> &[(&'static str, Value)] {
        &self.keys
    }

    /// Name of the protocol, as in `protocol = `.
    pub fn protocol_name(&self) -> &str {
        Reader(&self.keys).word("protocol")
    }

    /// The settings of the line.
    pub fn line_settings(&self) -> LineSettings {
        self.line
    }
}

/// Shortest ZVZ of ASCII in milliseconds: one character at a CP 341, four at a CP 340.
fn least_zvz_ms(kind: CpKind, line: &LineSettings) -> i64 {
    match kind {
        CpKind::Cp340 => cp340::least_zvz_ms(line.char_time()),
        _ => line.char_time().div_ceil(Span::MILLISECOND) as i64,
    }
}

impl S3964Of341 {
    fn of(protocol: &str, reader: &Reader<'_>) -> Self {
        Self {
            bcc: protocol.starts_with("3964r"),
            rk512: protocol.ends_with("rk512"),
            zvz_ms: reader.number("zvz_ms") as u32,
            qvz_ms: reader.number("qvz_ms") as u32,
            connect_attempts: reader.number("connect_attempts") as u16,
            block_attempts: reader.number("block_attempts") as u16,
            priority: if reader.word("priority") == "low" { Priority::Low } else { Priority::High },
            reaction_by_baud: reader.word("reaction") == "baud",
            clear_buffer: reader.word(CLEAR) == "yes",
        }
    }
}

/// The default of a row. `before`: the keys of the table before it.
fn default_of(row: &Key341, kind: CpKind, protocol: &str, before: &Reader<'_>) -> Value {
    match (row.key, row.default) {
        (_, "") if matches!(row.kind, Kind341::Text { .. }) => Value::from(""),
        ("zvz_ms", "") if kind == CpKind::Cp340 => Value::Int(cp340::default_zvz_ms(line_of(before).char_time())),
        // 2 s with block check character, 550 ms without. [CP 341 manual 09/2008, p. 38]
        ("qvz_ms", "") => Value::Int(if protocol.starts_with("3964r") { 2000 } else { 550 }),
        (key, "") => cp341_modbus::default_of(key, before)
            .or_else(|| cp341_ascii::default_of(key, before))
            .unwrap_or_else(|| written("")),
        (_, word) => written(word),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn defaults_are_those_of_the_reference() {
        let cp = Cp341::from_keys([("protocol", Value::from("3964R"))]).unwrap();
        assert_eq!(cp.line.to_string(), "9600 8E1");
        let Protocol341::S3964(s3964) = &cp.protocol else { panic!("{:?}", cp.protocol) };
        assert_eq!((s3964.bcc, s3964.rk512, s3964.zvz_ms, s3964.qvz_ms), (true, false, 220, 2000));
        assert_eq!((s3964.connect_attempts, s3964.block_attempts, s3964.priority), (6, 6, Priority::High));
        let cp = Cp341::from_keys([("protocol", Value::from("3964")), ("priority", "low".into())]).unwrap();
        let Protocol341::S3964(s3964) = &cp.protocol else { panic!("{:?}", cp.protocol) };
        assert_eq!((s3964.bcc, s3964.qvz_ms, s3964.priority), (false, 550, Priority::Low));
    }

    #[test]
    fn keys_survive_the_way_to_the_driver() {
        for (kind, baud) in [(CpKind::Cp341, 38_400), (CpKind::Cp340, 4800)] {
            for (protocol, _) in protocols_of(kind) {
                let given = [("protocol", Value::from(*protocol)), ("baud", Value::Int(baud))];
                let cp = Cp341::of_kind(kind, given).unwrap();
                let again = Cp341::of_kind(kind, cp.to_keys().iter().cloned()).unwrap();
                assert_eq!((again.protocol_name(), &again), (*protocol, &cp));
            }
        }
        for end in ["end-characters", "length"] {
            let given =
                [("protocol", Value::from("ascii")), ("end_criterion", end.into()), ("rs232_signals", "yes".into())];
            let cp = Cp341::from_keys(given).unwrap();
            assert_eq!(Cp341::from_keys(cp.to_keys().iter().cloned()), Ok(cp));
        }
    }

    #[test]
    fn what_is_wrong_is_said_with_the_remedy() {
        let with = |key, value| Cp341::from_keys([("protocol", Value::from("3964r")), (key, value)]).unwrap_err();
        for (key, value, says) in [
            ("bawd", Value::Int(9600), "did you mean `baud`?"),
            ("baud", Value::Int(9601), "did you mean 9600?"),
            ("zvz_ms", Value::Int(225), "the nearest is 230"),
            ("zvz_ms", Value::Int(0), "the nearest is 20"),
            ("zvz_ms", Value::from("220"), "without quotes"),
            ("reaction", Value::from("20s"), "remove it"),
            ("protocol", Value::from("3964r"), "remove one"),
        ] {
            let error = with(key, value).to_string();
            assert!(error.contains(says), "{key}: {error}");
        }
        let needless = with("length", Value::Int(5));
        assert!(!needless.follows_from("end_criterion"), "3964R has neither: {needless}");
        // It would be right if the end were the length.
        let ascii = [("protocol", Value::from("ascii")), ("length", Value::Int(5))];
        assert!(Cp341::from_keys(ascii).unwrap_err().follows_from("end_criterion"));
        assert!(Cp341::from_keys([]).unwrap_err().to_string().contains("add `protocol"));
        assert!(Cp341::from_keys([("protocol", "3946r".into())]).unwrap_err().to_string().contains("\"3964r\"?"));
    }
}
