//! Message tables of the loadable driver: it is driven through a conversation in virtual time.
//!
//! One line per step, `TIME_MS INPUT => OUTPUT, OUTPUT`; text after `#` is a comment. Times are absolute.
//!
//! | input | |
//! |---|---|
//! | `start` | the first tick |
//! | `job 05 03 0040 0002` | P_SND_RK with this source area, `R_TYP` 'X'; `job N*41` repeats a byte |
//! | `typ D 05 07` | the same with another `R_TYP` |
//! | `done` | the last bit of our output has been sent |
//! | `say 05 03 04 21232527` | the slave sends this telegram: colon, digits, LRC, CR LF are added |
//! | `rx :0501\r\n` | characters as they are; `_` is a blank |
//! | `taken`, `refused` | P_RCV_RK has taken the data, cannot take them |
//! | `fault Parity` | a character that cannot be read, BREAK, the line gone or back |
//! | `lines cts dsr` | the signals that are ON |
//! | `abort` | the CP gets new parameters |
//! | `timeout` | the driver must have asked to be called exactly now; a tick |
//!
//! | output | |
//! |---|---|
//! | `ask 05 03 0040 0002` | the request on the line, as a telegram |
//! | `got 2123 2527` | the destination area for P_RCV_RK |
//! | `ok` | the job has ended successfully |
//! | `fail 0830` | an entry in the diagnostic buffer, and the job has ended with this STATUS |
//! | `!0834` | an entry in the diagnostic buffer |
//! | `back` | our output is taken back |
//! | `rts on`, `dtr on` | the signal |
//!
//! Between two lines the driver must stay silent: each deadline that passes is ticked, and must cause no output.

use ob1_protocols::modbus_master_32::{Driver, Input, Order, Owner, Parameters};
use ob1_protocols::{Instant, LineFault, LineInput, MS, ModemLines, Wire};

/// The frame of a telegram, written from the manual. [S4 "4.1 Message Structure"]
pub(crate) fn frame(telegram: &[u8]) -> String {
    let sum: u32 = telegram.iter().map(|byte| u32::from(*byte)).sum();
    let lrc = (256 - sum % 256) % 256;
    let digits: String = telegram.iter().map(|byte| format!("{byte:02X}")).collect();
    format!(":{digits}{lrc:02X}\r\n")
}

/// The telegram of a frame; `None` if the frame is invalid.
fn telegram(frame: &[u8]) -> Option<Vec<u8>> {
    let text = std::str::from_utf8(frame).ok()?.strip_prefix(':')?.strip_suffix("\r\n")?;
    let mut bytes = bytes(text);
    bytes.pop()?;
    (self::frame(&bytes).as_bytes() == frame).then_some(bytes)
}

/// Bytes of `0501 F7 3*41`.
pub(crate) fn bytes(text: &str) -> Vec<u8> {
    let mut bytes = Vec::new();
    for word in text.split_whitespace() {
        let (count, digits) = word.split_once('*').unwrap_or(("1", word));
        let one: Vec<u8> = (0..digits.len() / 2)
            .map(|at| u8::from_str_radix(&digits[2 * at..2 * at + 2], 16).unwrap_or_else(|_| panic!("`{word}`")))
            .collect();
        assert_eq!(digits.len() % 2, 0, "`{word}`");
        bytes.extend(std::iter::repeat_n(one, count.parse().expect("a count before *")).flatten());
    }
    bytes
}

pub(crate) fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02X}")).collect()
}

/// Records the driver's outputs in the words of the tables.
#[derive(Default)]
struct Recorder {
    log: Vec<String>,
}

impl Wire for Recorder {
    fn transmit(&mut self, bytes: &[u8]) {
        let telegram = telegram(bytes).unwrap_or_else(|| panic!("no frame: {}", String::from_utf8_lossy(bytes)));
        self.log.push(format!("ask {}", hex(&telegram)));
    }

    fn take_back(&mut self) -> usize {
        self.log.push("back".into());
        0
    }

    fn rts(&mut self, on: bool) {
        self.log.push(format!("rts {}", if on { "on" } else { "off" }));
    }

    fn dtr(&mut self, on: bool) {
        self.log.push(format!("dtr {}", if on { "on" } else { "off" }));
    }
}

impl Owner for Recorder {
    fn deliver(&mut self, destination: &[u8]) {
        assert!(!destination.is_empty());
        self.log.push(format!("got {}", hex(destination)));
    }

    fn ended(&mut self, outcome: Result<(), u16>) {
        match outcome {
            Ok(()) => self.log.push("ok".into()),
            Err(number) => {
                // The entry comes first, then the other outputs of the end.
                let entry = format!("!{number:04X}");
                let at = self.log.iter().rposition(|line| *line == entry);
                self.log.remove(at.expect("no entry for what ended the job"));
                self.log.push(format!("fail {number:04X}"));
            }
        }
    }

    fn event(&mut self, number: u16) {
        self.log.push(format!("!{number:04X}"));
    }
}

/// The expected outputs in the recorder's spelling.
fn expected(text: &str) -> Vec<String> {
    let spell = |output: &str| match output.split_once(' ') {
        Some((word @ ("ask" | "got"), data)) => format!("{word} {}", hex(&bytes(data))),
        _ => output.to_owned(),
    };
    text.split(',').map(str::trim).filter(|output| !output.is_empty()).map(spell).collect()
}

/// Drives a driver with these parameters through the table.
pub(crate) fn check(parameters: Parameters, table: &str) {
    let (mut driver, mut out) = (Driver::new(parameters), Recorder::default());
    let (mut deadline, mut last): (Option<Instant>, Instant) = (None, Instant::START);
    for line in table.lines() {
        let line = line.split('#').next().unwrap_or("").trim();
        if line.is_empty() {
            continue;
        }
        let (step, outputs) = line.split_once("=>").unwrap_or((line, ""));
        let mut words = step.trim().splitn(3, ' ');
        let time: f64 = words.next().and_then(|time| time.parse().ok()).unwrap_or_else(|| panic!("no time: {line}"));
        let (word, rest) = (words.next().unwrap_or(""), words.next().unwrap_or("").trim());
        let now = Instant::from_nanos((time * MS.nanos() as f64).round() as u64);
        assert!(now >= last, "time goes back: {line}");
        last = now;
        while let Some(at) = deadline.filter(|at| *at < now) {
            deadline = driver.step(at, Input::Tick, &mut out);
            assert!(out.log.is_empty(), "at {} ms, before `{line}`: {:?}", at.since_start().as_millis_f64(), out.log);
            assert_ne!(deadline, Some(at), "the driver does not get past {at}: {line}");
        }
        let data = match word {
            "job" => bytes(rest),
            "typ" => bytes(rest.split_once(' ').expect("R_TYP and source").1),
            "say" => frame(&bytes(rest)).into_bytes(),
            "rx" => rest.replace("\\r", "\r").replace("\\n", "\n").replace('_', " ").into_bytes(),
            _ => Vec::new(),
        };
        let input = match word {
            "start" => Input::Tick,
            "timeout" => {
                assert_eq!(deadline, Some(now), "the deadline: {line}");
                Input::Tick
            }
            "job" => Input::Order(Order::Job { r_typ: b'X', source: &data }),
            "typ" => Input::Order(Order::Job { r_typ: rest.as_bytes()[0], source: &data }),
            "say" | "rx" => Input::Line(LineInput::Rx(&data)),
            "done" => Input::Line(LineInput::TxDone),
            "taken" => Input::Order(Order::Taken(true)),
            "refused" => Input::Order(Order::Taken(false)),
            "abort" => Input::Order(Order::Abort),
            "lines" => Input::Line(LineInput::Modem(ModemLines {
                cts: rest.contains("cts"),
                dsr: rest.contains("dsr"),
                ..ModemLines::default()
            })),
            "fault" => Input::Line(LineInput::Fault(match rest {
                "Parity" => LineFault::Parity,
                "Framing" => LineFault::Framing,
                "Overrun" => LineFault::Overrun,
                "Break" => LineFault::Break,
                "Gone" => LineFault::Gone,
                "Back" => LineFault::Back,
                other => panic!("`{other}` is no fault"),
            })),
            other => panic!("`{other}` is no input: {line}"),
        };
        deadline = driver.step(now, input, &mut out);
        assert_eq!(out.log, expected(outputs), "{line}");
        out.log.clear();
    }
}
