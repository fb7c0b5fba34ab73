//! Message tables: a machine is driven through a conversation in virtual time.
//!
//! One line per step, `TIME_MS INPUT => OUTPUT, OUTPUT`; text after `#` is a comment. A step without an output may omit
//! the arrow. Times are absolute and may have decimals.
//!
//! | input | |
//! |---|---|
//! | `start` | the first tick |
//! | `rx 10 03` | characters (hexadecimal, or `STX` `ETX` `DLE` `NAK` `XON` `XOFF`) |
//! | `done` | the last bit of our output has been sent |
//! | `order 41 42` | send this telegram; `order N*41` repeats a byte |
//! | `abort` | the CPU resets |
//! | `fault Parity` | a character that cannot be read |
//! | `cts on`, `cts off` | the modem line |
//! | `lines cts dsr` | the modem lines that are ON |
//! | `room 12` | from now on the receive buffer has room for this many bytes; a tick |
//! | `timeout` | the machine must have asked to be called exactly now; a tick |
//!
//! | output | |
//! |---|---|
//! | `tx 02` | characters for the line; consecutive ones in one piece |
//! | `back` | our output is taken back |
//! | `got 41` | a telegram is delivered |
//! | `more 41`, `end`, `broken` | a part of one, and what follows parts |
//! | `sent ok`, `sent AckDelay` | the end of the order |
//! | `!Phase: What` | a report |
//! | `rts on`, `rts off`, `dtr on` | the modem line |
//! | `baud 2400` | the line continues at this baud rate |
//!
//! Between two lines the machine must stay silent: each deadline that passes is ticked, and must cause no output.

use ob1_protocols::{
    Event, Input, Instant, LineFault, LineInput, MS, Machine, ModemLines, Order, Part, SendError, Sink, Wire,
};

/// A sink that records its calls in the words of the tables.
#[derive(Default)]
pub(crate) struct Recorder {
    pub(crate) log: Vec<String>,
    pub(crate) room: usize,
    /// The result of `take_back`.
    pub(crate) back: usize,
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|b| format!("{b:02X}")).collect::<Vec<_>>().join(" ")
}

impl Wire for Recorder {
    fn transmit(&mut self, bytes: &[u8]) {
        assert!(!bytes.is_empty());
        match self.log.last_mut() {
            Some(last) if last.starts_with("tx ") => *last += &format!(" {}", hex(bytes)),
            _ => self.log.push(format!("tx {}", hex(bytes))),
        }
    }

    fn take_back(&mut self) -> usize {
        self.log.push("back".into());
        std::mem::take(&mut self.back)
    }

    fn rts(&mut self, on: bool) {
        self.log.push(format!("rts {}", if on { "on" } else { "off" }));
    }

    fn dtr(&mut self, on: bool) {
        self.log.push(format!("dtr {}", if on { "on" } else { "off" }));
    }
}

impl Sink for Recorder {
    fn room(&self) -> usize {
        self.room
    }

    fn deliver(&mut self, telegram: &[u8]) {
        assert!(!telegram.is_empty() && telegram.len() <= self.room);
        self.log.push(format!("got {}", hex(telegram)));
    }

    fn part(&mut self, bytes: &[u8], part: Part) {
        assert!(bytes.len() <= self.room);
        self.log.push(match (bytes, part) {
            ([], Part::Last) => "end".into(),
            ([], Part::Broken) => "broken".into(),
            (bytes, Part::More) => format!("more {}", hex(bytes)),
            (bytes, _) => format!("got {}", hex(bytes)),
        });
    }

    fn sent(&mut self, outcome: Result<(), SendError>) {
        self.log.push(match outcome {
            Ok(()) => "sent ok".into(),
            Err(error) => format!("sent {error:?}"),
        });
    }

    fn report(&mut self, Event { phase, what }: Event) {
        self.log.push(format!("!{phase:?}: {what:?}"));
    }

    fn baud(&mut self, baud: u32) {
        self.log.push(format!("baud {baud}"));
    }
}

/// Bytes of `41 STX 3*42`.
fn bytes(words: &[&str]) -> Vec<u8> {
    let mut bytes = Vec::new();
    for word in words {
        let (count, word) = match word.split_once('*') {
            Some((count, word)) => (count.parse().expect("a count before *"), word),
            None => (1, *word),
        };
        let byte = match word {
            "STX" => 0x02,
            "ETX" => 0x03,
            "DLE" => 0x10,
            "XON" => 0x11,
            "XOFF" => 0x13,
            "NAK" => 0x15,
            other => u8::from_str_radix(other, 16).unwrap_or_else(|_| panic!("`{other}` is no byte")),
        };
        bytes.extend(std::iter::repeat_n(byte, count));
    }
    bytes
}

/// The expected outputs in the recorder's spelling.
fn expected(text: &str) -> Vec<String> {
    let mut list = Vec::new();
    for output in text.split(',').map(str::trim).filter(|o| !o.is_empty()) {
        let words: Vec<&str> = output.split_whitespace().collect();
        list.push(match words[0] {
            "tx" | "got" | "more" => format!("{} {}", words[0], hex(&bytes(&words[1..]))),
            _ => output.to_owned(),
        });
    }
    list
}

/// Drives the machine through the table.
pub(crate) fn check(machine: &mut dyn Machine, table: &str) {
    let mut out = Recorder { room: 1024, ..Recorder::default() };
    let mut deadline = None;
    let mut last: Instant = Instant::START;
    for (number, line) in table.lines().enumerate() {
        let line = line.split('#').next().unwrap_or("").trim();
        if line.is_empty() {
            continue;
        }
        let place = || format!("line {} of the table: {line}", number + 1);
        let (step, outputs) = line.split_once("=>").unwrap_or((line, ""));
        let words: Vec<&str> = step.split_whitespace().collect();
        let millis = words[0].parse::<f64>().unwrap_or_else(|_| panic!("no time: {}", place()));
        let now = Instant::from_nanos((millis * MS.nanos() as f64).round() as u64);
        assert!(now >= last, "time goes back: {}", place());
        last = now;
        let input = words[1];
        // Silence until then.
        while let Some(at) = deadline.filter(|at| *at < now) {
            deadline = machine.step(at, Input::Tick, &mut out);
            assert!(
                out.log.is_empty(),
                "at {} ms, before {}: {:?}",
                at.since_start().as_millis_f64(),
                place(),
                out.log
            );
            assert!(deadline != Some(at), "the machine does not get past {at}: {}", place());
        }
        let data = if matches!(input, "rx" | "order") { bytes(&words[2..]) } else { Vec::new() };
        let input = match input {
            "start" => Input::Tick,
            "rx" => Input::Line(LineInput::Rx(&data)),
            "done" => Input::Line(LineInput::TxDone),
            "order" => Input::Order(Order::Send(&data)),
            "abort" => Input::Order(Order::Abort),
            "fault" => Input::Line(LineInput::Fault(match words[2] {
                "Parity" => LineFault::Parity,
                "Framing" => LineFault::Framing,
                "Overrun" => LineFault::Overrun,
                "Break" => LineFault::Break,
                "Gone" => LineFault::Gone,
                other => panic!("`{other}` is no fault: {}", place()),
            })),
            "cts" => Input::Line(LineInput::Modem(ModemLines { cts: words[2] == "on", ..ModemLines::default() })),
            "lines" => Input::Line(LineInput::Modem(ModemLines {
                cts: words[2..].contains(&"cts"),
                dsr: words[2..].contains(&"dsr"),
                ..ModemLines::default()
            })),
            "room" => {
                out.room = words[2].parse().expect("a number of bytes");
                Input::Tick
            }
            "timeout" => {
                assert_eq!(deadline, Some(now), "the deadline: {}", place());
                Input::Tick
            }
            other => panic!("`{other}` is no input: {}", place()),
        };
        out.back = outputs
            .split(',')
            .map(str::trim)
            .find_map(|o| o.strip_prefix("back "))
            .map_or(0, |n| n.parse().expect("a number of characters taken back"));
        deadline = machine.step(now, input, &mut out);
        let wanted: Vec<String> =
            expected(outputs).into_iter().map(|o| if o.starts_with("back") { "back".into() } else { o }).collect();
        // A comma inside of `{ .. }` of a report splits it; put both sides in one string.
        assert_eq!(out.log.join(", "), wanted.join(", "), "{}", place());
        out.log.clear();
    }
}
