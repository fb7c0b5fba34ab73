//! The parameters of the CP 341's loadable driver "Modbus ASCII master, 32-bit registers".
//! [S4 "3.6 Assigning Parameters to the Loadable Driver"]
//!
//! The driver is selected by its name, as in the manual's dialogue, where it is listed among the protocols: `protocol =
//! "modbus-ascii-master-32"`.

use crate::error::ParamError;
use crate::keyed::{Key341, Reader, choice, error, number};
use crate::parameter_bytes::Value;

/// Its name as a value of `protocol`.
pub(crate) const NAME: &str = "modbus-ascii-master-32";

/// [S4 "Overview of Transmission Parameters"]
pub(crate) const FRAME: &[Key341] = &[
    choice(
        "baud",
        &["300", "600", "1200", "2400", "4800", "9600", "19200", "38400", "76800"],
        "9600",
        "transmission rate, bit/s",
    ),
    choice("data_bits", &["7"], "7", "data bits of a character: Modbus ASCII has 7"),
    choice("parity", &["none", "odd", "even"], "even", "parity bit"),
    choice("stop_bits", &["1", "2"], "", "stop bits: 1 with parity, 2 without"),
];

/// [S4 "Overview of Protocol Parameters"], [S4 "3.6.2 RS422/485 (X27) Interface"], [S4 "3.6.3 RS232 Secondary
/// Signals"]
pub(crate) const DRIVER: &[Key341] = &[
    number("character_delay_ms", (1, 6500, 1), "1000", "longest pause between two characters of a reply"),
    number("response_timeout_ms", (5, 65_500, 1), "2000", "longest wait for the first character of a reply"),
    number("turnaround_ms", (0, 65_500, 1), "", "wait after a broadcast; shorter than the response time-out"),
    choice(
        "operating_mode",
        &["normal", "interference-suppression"],
        "normal",
        "interference-suppression: faults before and after a reply are ignored",
    ),
    choice(
        "registers_32_bit",
        &["no", "yes"],
        "no",
        "bit 6 of the function code in the source block means registers of four bytes",
    ),
    choice("wiring", &["four-wire", "two-wire"], "four-wire", "RS 422/485: full duplex or half duplex"),
    choice(
        "preset",
        &["none", "break", "high"],
        // [S4 L549]; for two wires the text recommends "high" [S4 L556], but the default is kept.
        "break",
        "level of the open receiving line; high is recommended with two wires: BREAK cannot be recognised",
    ),
    choice("rs232_signals", &["no", "yes"], "no", "automatic use of the RS 232C secondary signals"),
    number("rts_off_ms", (0, 655_350, 10), "1000", "with rs232_signals: from the last character to RTS OFF"),
    number("output_wait_ms", (0, 655_350, 10), "1000", "with rs232_signals: from RTS ON to the first character"),
];

/// The driver's own parameters; the character frame is in the line settings. Times in milliseconds.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ModbusMaster32 {
    /// Character delay time: longest pause within a reply.
    pub character_delay_ms: u32,
    /// Response time-out: longest wait for the reply's first character.
    pub response_timeout_ms: u32,
    /// Turnaround delay: pause after a broadcast.
    pub turnaround_ms: u32,
    /// Faults and BREAK outside of a reply are ignored.
    pub suppresses_interference: bool,
    /// 32-bit mode: registers have four bytes.
    pub long_registers: bool,
    /// Two-wire operation: one side at a time sends.
    pub half_duplex: bool,
    /// Line status BREAK can be recognised.
    pub breaks: bool,
    /// Automatic use of the RS 232C secondary signals: time to RTS OFF, data output waiting time.
    pub signals: Option<(u32, u32)>,
}

impl ModbusMaster32 {
    pub(crate) fn of(keys: &Reader<'_>) -> Self {
        let ms = |key| keys.number(key) as u32;
        let yes = |key| keys.word(key) == "yes";
        Self {
            character_delay_ms: ms("character_delay_ms"),
            response_timeout_ms: ms("response_timeout_ms"),
            turnaround_ms: ms("turnaround_ms"),
            suppresses_interference: keys.word("operating_mode") == "interference-suppression",
            long_registers: yes("registers_32_bit"),
            half_duplex: keys.word("wiring") == "two-wire",
            // Without a preset the line floats, and anything may be received, including BREAK.
            breaks: keys.word("preset") != "high",
            signals: yes("rs232_signals").then(|| (ms("rts_off_ms"), ms("output_wait_ms"))),
        }
    }
}

/// Defaults that depend on an earlier key; `None`: this one does not.
pub(crate) fn default_of(key: &str, before: &Reader<'_>) -> Option<Value> {
    match key {
        "stop_bits" => Some(Value::Int(stop_bits(before))),
        // The manual names none (ours).
        "turnaround_ms" => Some(Value::Int((before.number("response_timeout_ms") - 1).min(100))),
        _ => None,
    }
}

/// "With even or odd parity 1 stop bit is pre-defined. None parity effects two stop bits." [S4 L500]
fn stop_bits(keys: &Reader<'_>) -> i64 {
    if keys.word("parity") == "none" { 2 } else { 1 }
}

/// Checks combinations of keys.
///
/// # Errors
/// Stop bits that the parity does not allow; a turnaround delay that is not shorter than the response time-out;
/// signals with two wires.
pub(crate) fn check(keys: &Reader<'_>) -> Result<(), ParamError> {
    let (wanted, given) = (stop_bits(keys), keys.number("stop_bits"));
    if given != wanted {
        let parity = format!("with parity \"{}\": {wanted}", keys.word("parity"));
        return Err(error("stop_bits", given.to_string(), parity, "leave the key out: the parity decides".into()));
    }
    let (turnaround, response) = (keys.number("turnaround_ms"), keys.number("response_timeout_ms"));
    // "The turnaround delay should be shorter than the response timeout." [S4 L528]
    if turnaround > 0 && turnaround >= response {
        let remedy = "make it shorter, or `response_timeout_ms` longer".into();
        return Err(error("turnaround_ms", turnaround.to_string(), format!("less than {response}"), remedy));
    }
    // The signals are the RS 232C submodule's. [S4 "Available Signals"]
    if keys.word("rs232_signals") == "yes" && keys.word("wiring") == "two-wire" {
        let remedy = "RS 232C has no two-wire operation: remove one of the two".into();
        return Err(error("rs232_signals", "yes".into(), "no, with wiring \"two-wire\"".into(), remedy));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cp341::{Cp341, Protocol341};

    fn cp(keys: &[(&str, Value)]) -> Result<Cp341, ParamError> {
        let all = [("protocol", Value::from(NAME))].into_iter().chain(keys.iter().cloned());
        Cp341::from_keys(all)
    }

    fn driver(keys: &[(&str, Value)]) -> ModbusMaster32 {
        let Protocol341::ModbusMaster32(driver) = cp(keys).expect("parameters").protocol else { panic!("another") };
        driver
    }

    #[test]
    fn defaults_are_the_manuals() {
        assert_eq!(cp(&[]).expect("parameters").line.to_string(), "9600 7E1");
        let expected = ModbusMaster32 {
            character_delay_ms: 1000,
            response_timeout_ms: 2000,
            turnaround_ms: 100,
            suppresses_interference: false,
            long_registers: false,
            half_duplex: false,
            breaks: true,
            signals: None,
        };
        assert_eq!(driver(&[]), expected);
        let keys = [("rs232_signals", "yes".into()), ("registers_32_bit", "yes".into()), ("parity", "none".into())];
        assert_eq!(driver(&keys), ModbusMaster32 { long_registers: true, signals: Some((1000, 1000)), ..expected });
        assert_eq!(cp(&keys).expect("parameters").line.to_string(), "9600 7N2");
        assert_eq!(driver(&[("response_timeout_ms", Value::Int(5))]).turnaround_ms, 4);
        let two_wire = driver(&[("wiring", "two-wire".into())]);
        assert!(two_wire.half_duplex && two_wire.breaks, "the default is BREAK with two wires, too");
        assert!(!driver(&[("wiring", "two-wire".into()), ("preset", "high".into())]).breaks);
    }

    #[test]
    fn what_cannot_be_is_said_with_the_remedy() {
        let table: [(&[(&str, Value)], &str); 10] = [
            (&[("data_bits", Value::Int(8))], "`data_bits`: 8 is not allowed; allowed: 7"),
            (&[("baud", Value::Int(57_600))], "`baud`: 57600"),
            (&[("stop_bits", Value::Int(2))], "with parity \"even\": 1"),
            (&[("stop_bits", Value::Int(1)), ("parity", "none".into())], "with parity \"none\": 2"),
            (&[("character_delay_ms", Value::Int(0))], "1..6500; the nearest is 1"),
            (&[("response_timeout_ms", Value::Int(65_501))], "5..65500; the nearest is 65500"),
            (&[("turnaround_ms", Value::Int(2000))], "less than 2000"),
            (&[("operating_mode", "noise".into())], "normal, interference-suppression"),
            (&[("rs232_signals", "yes".into()), ("wiring", "two-wire".into())], "RS 232C has no two-wire operation"),
            (&[("zvz_ms", Value::Int(220))], "character_delay_ms"),
        ];
        for (keys, says) in table {
            let error = cp(keys).expect_err("refused").to_string();
            assert!(error.contains(says), "{keys:?}: {error}");
        }
    }
}
