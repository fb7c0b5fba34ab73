//! In which pieces characters come does not matter: a machine does the same with a whole chunk as with its characters
//! one by one at the same time.

use ob1_protocols::rk512::{self, Answer, Area, Command, Coordination, Request, Rk512};
use ob1_protocols::s3964::codec::block;
use ob1_protocols::s3964::{self, Priority, S3964};
use ob1_protocols::{Ascii, Input, Instant, LineInput, MS, Machine, Order, Span, StxEtx};
use proptest::prelude::*;

use crate::common::Recorder;
use crate::{defaults, rk512_table};

/// What happens on the line.
#[derive(Clone, Debug)]
enum Step {
    Rx(Vec<u8>),
    TxDone,
    Send(Vec<u8>),
    Wait(Span),
}

/// Characters as they come: whole blocks, blocks with something in them that does not belong there, noise.
fn characters() -> impl Strategy<Value = Vec<u8>> {
    let data = proptest::collection::vec(prop_oneof![4 => 0x20..0x7f_u8, 1 => Just(0x10), 1 => any::<u8>()], 0..40);
    let order = (0..40_u8).prop_map(|words| {
        let mut order = vec![0, 0, b'A', b'D', 10, 0, 0, words, 0xff, 0xff];
        order.extend(std::iter::repeat_n(0x41, 2 * usize::from(words)));
        order
    });
    let telegram = prop_oneof![data, order, Just(vec![0; 4])];
    let whole = (telegram, any::<bool>()).prop_map(|(data, bcc)| block(&data, bcc).collect::<Vec<u8>>());
    let special = prop::sample::select(vec![0x02_u8, 0x03, 0x10, 0x15, 0x11, 0x13]);
    let noise = proptest::collection::vec(prop_oneof![2 => special, 1 => any::<u8>()], 0..4);
    let part = prop_oneof![4 => whole, 2 => Just(vec![0x02]), 2 => Just(vec![0x10]), 1 => noise];
    proptest::collection::vec(part, 0..4).prop_map(|parts| parts.concat())
}

fn steps() -> impl Strategy<Value = Vec<Step>> {
    let step = prop_oneof![
        6 => characters().prop_map(Step::Rx),
        4 => Just(Step::TxDone),
        1 => proptest::collection::vec(any::<u8>(), 1..40).prop_map(Step::Send),
        3 => (0..700 * MS.nanos()).prop_map(|time| Step::Wait(Span::from_nanos(time))),
    ];
    proptest::collection::vec(step, 0..60)
}

/// A machine and what it has said.
trait Side {
    fn step(&mut self, now: Instant, input: Input<'_>) -> Option<Instant>;
    fn log(&self) -> &[String];
}

struct OfMachine(Box<dyn Machine>, Recorder);

impl Side for OfMachine {
    fn step(&mut self, now: Instant, input: Input<'_>) -> Option<Instant> {
        self.0.step(now, input, &mut self.1)
    }

    fn log(&self) -> &[String] {
        &self.1.log
    }
}

/// RK 512; a telegram to send is the data of an order, or the CPU's answer to the partner's.
struct OfRk512(Rk512, rk512_table::Recorder);

impl Side for OfRk512 {
    fn step(&mut self, now: Instant, input: Input<'_>) -> Option<Instant> {
        let input = match input {
            Input::Order(Order::Send(_)) if self.0.is_asking() => Input::Order(rk512::Order::Answer(Answer::Taken)),
            Input::Order(Order::Send(data)) => {
                let request = Request {
                    command: Command::Send,
                    area: Area::Memory,
                    db: 0,
                    start: 0,
                    length: data.len() as u16,
                    coordination: Coordination::NONE,
                };
                Input::Order(rk512::Order::Start(request, data))
            }
            other => other.with_orders(rk512::Order::Abort),
        };
        self.0.step(now, input, &mut self.1)
    }

    fn log(&self) -> &[String] {
        &self.1.log
    }
}

/// Runs the steps; `longest`: maximum length of a piece. Returns what the machine has said and its deadline after each
/// step.
fn run(mut side: Box<dyn Side>, steps: &[Step], longest: usize) -> (Vec<String>, Vec<Option<Instant>>) {
    let mut now = Instant::START;
    let mut deadline = side.step(now, Input::Tick);
    let mut deadlines = Vec::new();
    for step in steps {
        match step {
            Step::Rx(bytes) => {
                for piece in bytes.chunks(longest) {
                    deadline = side.step(now, Input::Line(LineInput::Rx(piece)));
                }
            }
            Step::TxDone => deadline = side.step(now, Input::Line(LineInput::TxDone)),
            Step::Send(telegram) => deadline = side.step(now, Input::Order(Order::Send(telegram))),
            Step::Wait(time) => {
                let until = now + *time;
                while let Some(at) = deadline.filter(|at| *at <= until) {
                    now = now.max(at);
                    deadline = side.step(now, Input::Tick);
                }
                now = until;
            }
        }
        deadlines.push(deadline);
    }
    (side.log().to_vec(), deadlines)
}

fn of_machine(machine: impl Machine + 'static) -> Box<dyn Side> {
    Box::new(OfMachine(Box::new(machine), Recorder { room: 1024, ..Recorder::default() }))
}

/// 3964(R) with a short buffer: blocks that are too long come, too.
fn s3964_config(bcc: bool, cp341: bool) -> s3964::Config {
    let base = if cp341 { defaults::cp341(bcc, MS) } else { defaults::cp240(bcc, MS) };
    s3964::Config { priority: Priority::Low, telegram_max: 32, ..base }
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    /// Without orders: one that waits begins after a piece, and the rest of it would come before or after that.
    #[test]
    fn s3964(mut steps in steps(), longest in 2..50_usize, bcc: bool, cp341: bool) {
        steps.retain(|step| !matches!(step, Step::Send(_)));
        let machine = || of_machine(<S3964>::new(s3964_config(bcc, cp341)));
        prop_assert_eq!(run(machine(), &steps, longest), run(machine(), &steps, 1));
    }

    #[test]
    fn rk512(steps in steps(), longest in 2..50_usize, bcc: bool) {
        let line = s3964::Config { priority: Priority::Low, ..defaults::cp240(bcc, MS) };
        let machine = || Box::new(OfRk512(Rk512::new(rk512::Config::cp240(line.clone())), Default::default()));
        prop_assert_eq!(run(machine(), &steps, longest), run(machine(), &steps, 1));
    }

    #[test]
    fn ascii(steps in steps(), longest in 2..50_usize) {
        let machine = || of_machine(<Ascii>::new(&defaults::ascii(MS)));
        prop_assert_eq!(run(machine(), &steps, longest), run(machine(), &steps, 1));
    }

    #[test]
    fn stx_etx(steps in steps(), longest in 2..50_usize) {
        let machine = || of_machine(<StxEtx>::new(&defaults::stx_etx(MS)));
        prop_assert_eq!(run(machine(), &steps, longest), run(machine(), &steps, 1));
    }
}

#[test]
fn the_steps_reach_what_they_are_for() {
    let block = |data: &[u8]| block(data, true).collect::<Vec<u8>>();
    let steps =
        [Step::Rx(vec![0x02]), Step::TxDone, Step::Rx(block(&[0, 0, b'A', b'D', 10, 0, 0, 2, 0xff, 0xff, 1, 2, 3, 4]))];
    let line = s3964::Config { priority: Priority::Low, ..defaults::cp240(true, MS) };
    let rk512 = Box::new(OfRk512(Rk512::new(rk512::Config::cp240(line)), Default::default()));
    assert!(run(rk512, &steps, 50).0.iter().any(|said| said.starts_with("asked")));
    let steps = [Step::Rx(vec![0x02]), Step::TxDone, Step::Rx(block(&[0x41; 32]))];
    let said = run(of_machine(<S3964>::new(s3964_config(true, false))), &steps, 50).0;
    assert!(said.iter().any(|said| said.starts_with("got")), "{said:?}");
    let steps = [Step::Rx(vec![0x02]), Step::TxDone, Step::Rx(block(&[0x41; 33]))];
    let said = run(of_machine(<S3964>::new(s3964_config(true, false))), &steps, 50).0;
    assert!(said.iter().any(|said| said.contains("TooLong")), "{said:?}");
}
