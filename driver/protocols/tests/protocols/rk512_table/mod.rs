//! Message tables for RK 512: a machine is driven through a conversation in virtual time.
//!
//! One line per step, `TIME_MS INPUT => OUTPUT; OUTPUT`; text after `#` is a comment. Bytes are hexadecimal; `3*41`
//! repeats one, `01..10` counts from one to the other. `|` separates header and data.
//!
//! | input | |
//! |---|---|
//! | `start` | the first tick |
//! | `rx 10 03`, `done`, `fault Parity`, `timeout` | the line and the time, as in the tables of 3964(R) |
//! | `order 00 00 41 44 .. \| 01 02` | an own order: header as on the line, data |
//! | `answer taken`, `answer data 01 02`, `answer refused 32` | the CPU answers |
//! | `serve off`, `serve on`, `abort` | the CPU goes to STOP, to RUN, resets |
//! | `partner 00 00 45 4D ..` | the partner sends a telegram: STX, our DLE, block, our DLE; the outputs are what comes then |
//! | `takes 00 00 00 00` | our STX is out; the partner takes this telegram from us: DLE, our block, DLE; then the outputs |
//! | `refuses` | our STX is out; the partner says NAK to it |
//!
//! | output | |
//! |---|---|
//! | `tx 02`, `back` | characters for the line, taken back |
//! | `asked 00 00 45 .. \| 01` | an order of the partner is put before the CPU |
//! | `ended ok 01 02`, `ended Rejected(32)` | the own order |
//! | `answered ok`, `answered Withdrawn 060E` (why) | the partner's order |
//! | `!060E`, `!Repeated` | a report: its number, or its name where it has none |
//!
//! Between two lines the machine must stay silent: each deadline that passes is ticked, and must cause no output.

use ob1_protocols::rk512::{Answer, AnswerError, Config, Event, Input, Order, OrderError, Owner, Request, Rk512};
use ob1_protocols::s3964::codec::block;
use ob1_protocols::{Instant, LineFault, LineInput, MS, Span, Wire};

/// What a machine says, in the words of the tables.
#[derive(Default)]
pub(crate) struct Recorder {
    pub(crate) log: Vec<String>,
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|b| format!("{b:02X}")).collect::<Vec<_>>().join(" ")
}

fn with_data(header: String, data: &[u8]) -> String {
    if data.is_empty() { header } else { format!("{header} | {}", hex(data)) }
}

impl Wire for Recorder {
    fn transmit(&mut self, bytes: &[u8]) {
        match self.log.last_mut() {
            Some(last) if last.starts_with("tx ") => *last += &format!(" {}", hex(bytes)),
            _ => self.log.push(format!("tx {}", hex(bytes))),
        }
    }

    fn take_back(&mut self) -> usize {
        self.log.push("back".into());
        0
    }
}

impl Owner for Recorder {
    fn ended(&mut self, outcome: Result<&[u8], OrderError>) {
        self.log.push(match outcome {
            Ok(data) => format!("ended ok {}", hex(data)).trim_end().into(),
            Err(OrderError::Rejected(code)) => format!("ended Rejected({code:02X})"),
            Err(error) => format!("ended {error:?}"),
        });
    }

    fn asked(&mut self, request: &Request, data: &[u8]) {
        self.log.push(with_data(format!("asked {}", hex(&request.header())), data));
    }

    fn answered(&mut self, outcome: Result<(), AnswerError>) {
        self.log.push(match outcome {
            Ok(()) => "answered ok".into(),
            Err(AnswerError::Withdrawn(refusal)) => format!("answered Withdrawn {:04X}", refusal.number()),
            Err(error) => format!("answered {error:?}"),
        });
    }

    fn report(&mut self, event: Event) {
        self.log.push(match event.number() {
            Some(number) => format!("!{number:04X}"),
            None => format!("!{event:?}"),
        });
    }
}

/// Bytes of `41 3*42 01..10`.
pub(crate) fn bytes(text: &str) -> Vec<u8> {
    let byte = |word: &str| match word {
        "STX" => 0x02,
        "DLE" => 0x10,
        "NAK" => 0x15,
        other => u8::from_str_radix(other, 16).unwrap_or_else(|_| panic!("`{other}` is no byte")),
    };
    let mut bytes = Vec::new();
    for word in text.split_whitespace() {
        if let Some((count, word)) = word.split_once('*') {
            bytes.extend(std::iter::repeat_n(byte(word), count.parse().expect("a count before *")));
        } else if let Some((first, last)) = word.split_once("..") {
            bytes.extend(byte(first)..=byte(last));
        } else {
            bytes.push(byte(word));
        }
    }
    bytes
}

/// The expected outputs in the recorder's spelling.
fn expected(text: &str) -> Vec<String> {
    let spell = |output: &str| {
        let (word, rest) = output.split_once(' ').unwrap_or((output, ""));
        match (word, rest.split_once('|')) {
            ("tx", _) => format!("tx {}", hex(&bytes(rest))),
            ("asked", Some((header, data))) => format!("asked {} | {}", hex(&bytes(header)), hex(&bytes(data))),
            ("asked", None) => format!("asked {}", hex(&bytes(rest))),
            ("ended", _) if rest.starts_with("ok ") => format!("ended ok {}", hex(&bytes(&rest[3..]))),
            _ => output.to_owned(),
        }
    };
    text.split(';').map(str::trim).filter(|o| !o.is_empty()).map(spell).collect()
}

struct Bench<const N: usize> {
    machine: Rk512<N>,
    out: Recorder,
    now: Instant,
    deadline: Option<Instant>,
    bcc: bool,
}

impl<const N: usize> Bench<N> {
    fn step(&mut self, input: Input<'_>) {
        self.deadline = self.machine.step(self.now, input, &mut self.out);
    }

    /// Outputs since the last call.
    fn seen(&mut self) -> Vec<String> {
        std::mem::take(&mut self.out.log)
    }

    /// Takes `tx` of these characters from the front of the outputs.
    fn expect_first(&mut self, characters: &[u8]) {
        assert!(!self.out.log.is_empty(), "nothing was put out instead of {}", hex(characters));
        let first = self.out.log.remove(0);
        let rest = first.strip_prefix(&format!("tx {}", hex(characters)));
        let rest = rest.unwrap_or_else(|| panic!("{first} instead of tx {}", hex(characters)));
        if !rest.is_empty() {
            self.out.log.insert(0, format!("tx{rest}"));
        }
    }

    /// The partner sends a telegram.
    fn partner(&mut self, telegram: &[u8]) {
        self.step(Input::Line(LineInput::Rx(&[0x02])));
        // A low-priority station whose own STX has been sent gives way, and reports it.
        self.out.log.retain(|line| !line.starts_with("!Line") && line != "tx 02");
        assert_eq!(self.seen(), ["tx 10"], "our answer to STX");
        self.step(Input::Line(LineInput::TxDone));
        let block: Vec<u8> = block(telegram, self.bcc).collect();
        self.step(Input::Line(LineInput::Rx(&block)));
        self.expect_first(&[0x10]);
        self.step(Input::Line(LineInput::TxDone));
    }

    /// The partner takes a telegram from us; our STX has been sent.
    fn takes(&mut self, telegram: &[u8]) {
        self.step(Input::Line(LineInput::TxDone));
        self.step(Input::Line(LineInput::Rx(&[0x10])));
        let block: Vec<u8> = block(telegram, self.bcc).collect();
        assert_eq!(self.seen(), [format!("tx {}", hex(&block))], "our telegram");
        self.step(Input::Line(LineInput::TxDone));
        self.step(Input::Line(LineInput::Rx(&[0x10])));
    }

    fn input(&mut self, words: &str) {
        let (word, rest) = words.split_once(' ').unwrap_or((words, ""));
        match word {
            "start" => self.step(Input::Tick),
            "rx" => self.step(Input::Line(LineInput::Rx(&bytes(rest)))),
            "done" => self.step(Input::Line(LineInput::TxDone)),
            "fault" => self.step(Input::Line(LineInput::Fault(match rest {
                "Parity" => LineFault::Parity,
                other => panic!("`{other}` is no fault"),
            }))),
            "timeout" => {
                assert_eq!(self.deadline, Some(self.now), "the deadline");
                self.step(Input::Tick);
            }
            "order" => {
                let (header, data) = rest.split_once('|').unwrap_or((rest, ""));
                let header: [u8; 10] = bytes(header).try_into().expect("a header of 10 bytes");
                let request = Request::of_header(&header).expect("a header");
                self.step(Input::Order(Order::Start(request, &bytes(data))));
            }
            "answer" => {
                let (how, rest) = rest.split_once(' ').unwrap_or((rest, ""));
                let data = bytes(rest);
                self.step(Input::Order(Order::Answer(match how {
                    "taken" => Answer::Taken,
                    "data" => Answer::Data(&data),
                    _ => Answer::Refused(data[0]),
                })));
            }
            "serve" => self.step(Input::Order(Order::Serve(rest == "on"))),
            "abort" => self.step(Input::Order(Order::Abort)),
            "partner" => self.partner(&bytes(rest)),
            "takes" => self.takes(&bytes(rest)),
            "refuses" => {
                self.step(Input::Line(LineInput::TxDone));
                self.step(Input::Line(LineInput::Rx(&[0x15])));
            }
            other => panic!("`{other}` is no input"),
        }
    }
}

/// Drives a machine through the table.
pub(crate) fn check<const N: usize>(config: Config, table: &str) {
    let bcc = config.line.bcc;
    let machine = Rk512::<N>::new(config);
    let mut bench = Bench { machine, out: Recorder::default(), now: Instant::START, deadline: None, bcc };
    for (number, line) in table.lines().enumerate() {
        let line = line.split('#').next().unwrap_or("").trim();
        if line.is_empty() {
            continue;
        }
        println!("line {}: {line}", number + 1);
        let (step, outputs) = line.split_once("=>").unwrap_or((line, ""));
        let (time, input) = step.trim().split_once(' ').expect("a time and an input");
        let now = Instant::from_nanos((time.parse::<f64>().expect("a time") * MS.nanos() as f64) as u64);
        assert!(now >= bench.now, "time goes back");
        // Silence until then.
        while let Some(at) = bench.deadline.filter(|at| *at < now) {
            bench.now = at;
            bench.step(Input::Tick);
            assert_eq!(bench.seen(), [""; 0], "at {} ms", at.since_start().as_millis_f64());
            assert!(bench.deadline != Some(at), "the machine does not get past {at}");
        }
        bench.now = now;
        bench.input(input.trim());
        assert_eq!(bench.seen(), expected(outputs));
    }
}

/// 9600 baud, 10 bits.
pub(crate) const CHAR: Span = Span::from_nanos(1_041_667);

/// A CP 240 on 3964 or 3964R.
pub(crate) fn cp240(bcc: bool) -> Config {
    Config::cp240(crate::defaults::cp240(bcc, CHAR))
}

/// A CP 240 on both; the first line of each table is the first tick.
pub(crate) fn check_cp240(table: &str) {
    for bcc in [true, false] {
        check::<1024>(cp240(bcc), &format!("0 start\n{table}"));
    }
}

/// SEND of 8 words to DB 5, DW 1.
pub(crate) const SEND_8: &str = "00 00 41 44 05 01 00 08 FF FF";
