//! RK 512: the decoder is total and decoding is reversible; the machine accepts any characters, orders and answers at
//! any time, ends each order once, and answers each request of the partner once.

use crate::defaults;
use ob1_protocols::rk512::codec::{HEADER, Telegram, parse};
use ob1_protocols::rk512::{Answer, AnswerError, Config, Event, Input, Order, OrderError, Owner, Request, Rk512};
use ob1_protocols::{Instant, LineFault, LineInput, MS, Wire, s3964};

/// Reads the bytes as a telegram, and as a script.
pub fn run(data: &[u8]) {
    decode(data);
    play(data);
}

fn decode(telegram: &[u8]) {
    if let Ok(Telegram::Order(request, data)) = parse(telegram) {
        let header = request.header();
        assert_eq!(Request::of_header(&header), Ok(request), "a header is what it says");
        assert_eq!(data.len() + HEADER, telegram.len());
    }
}

#[derive(Default)]
struct Books {
    running: bool,
    asked: bool,
}

impl Wire for Books {
    fn transmit(&mut self, bytes: &[u8]) {
        assert!(!bytes.is_empty());
    }
}

impl Owner for Books {
    fn ended(&mut self, outcome: Result<&[u8], OrderError>) {
        let busy = outcome == Err(OrderError::Busy);
        assert!(self.running, "an order ended that was not running");
        self.running = busy;
    }

    fn asked(&mut self, request: &Request, data: &[u8]) {
        assert!(!self.asked, "a second question before the first is over");
        assert!(data.is_empty() || data.len() == request.bytes());
        self.asked = true;
    }

    fn answered(&mut self, _outcome: Result<(), AnswerError>) {
        assert!(self.asked, "the end of an order nobody was asked about");
        self.asked = false;
    }

    fn report(&mut self, event: Event) {
        assert!(event.number().is_none_or(|number| matches!(number >> 8, 3 | 5..=10)));
    }
}

/// The first byte selects the procedure; then each byte is a step, some with further bytes.
fn play(script: &[u8]) {
    let Some((&mode, mut rest)) = script.split_first() else { return };
    let line = match mode % 4 {
        0 => defaults::cp240(true, MS),
        1 => defaults::cp240(false, MS),
        2 => defaults::cp341(true, MS),
        _ => s3964::Config { priority: s3964::Priority::High, ..defaults::cp240(true, MS) },
    };
    let config = if mode % 4 == 2 { Config::cp341(line) } else { Config::cp240(line) };
    let (mut machine, mut books, mut now) = (Rk512::<512>::new(config), Books::default(), Instant::START);
    let mut due = machine.step(now, Input::Tick, &mut books);
    while let Some((&op, tail)) = rest.split_first() {
        let (bytes, after) = tail.split_at(tail.len().min(usize::from(op >> 3)));
        rest = tail;
        let input = match op & 7 {
            // A telegram as sent by the partner.
            0 => {
                rest = after;
                machine.step(now, Input::Line(LineInput::Rx(&[0x02])), &mut books);
                machine.step(now, Input::Line(LineInput::TxDone), &mut books);
                let block: Vec<u8> = s3964::codec::block(bytes, mode % 4 != 1).collect();
                due = machine.step(now, Input::Line(LineInput::Rx(&block)), &mut books);
                continue;
            }
            1 => {
                rest = after;
                Input::Line(LineInput::Rx(bytes))
            }
            2 => Input::Line(LineInput::TxDone),
            3 => Input::Line(LineInput::Rx(&[0x10])),
            4 => {
                now = due.map_or(now + MS, |due| due.max(now));
                Input::Tick
            }
            5 => {
                rest = after;
                let Some(Ok(request)) = bytes.first_chunk().map(Request::of_header) else { continue };
                books.running = true;
                let data = vec![op; if bytes[2] == b'E' { 0 } else { request.bytes() }];
                due = machine.step(now, Input::Order(Order::Start(request, &data)), &mut books);
                assert_eq!(machine.busy(), books.running);
                continue;
            }
            6 => {
                rest = after;
                let answers = [Answer::Taken, Answer::Data(bytes), Answer::Refused(op)];
                Input::Order(Order::Answer(answers[usize::from(op >> 3) % 3]))
            }
            _ => match op >> 3 & 3 {
                0 => Input::Order(Order::Abort),
                1 => Input::Order(Order::Serve(op & 0x20 != 0)),
                2 => Input::Line(LineInput::Fault(LineFault::Parity)),
                _ => Input::Line(LineInput::Fault(LineFault::Break)),
            },
        };
        due = machine.step(now, input, &mut books);
        assert_eq!(machine.busy(), books.running, "an order ended without a word");
    }
}
