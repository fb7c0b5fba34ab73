//! Two ASCII machines on a two-wire line that panics when both send at once: question and answer, each after the
//! silence that ends the other.

use ob1_fakes::sim_line::{End, SimConfig, SimEvent, SimLine};
use ob1_protocols::ascii::{Ascii, Config};
use ob1_protocols::{Event, Input, Instant, LineInput, MS, Machine, Order, SendError, Sink, Wire};

use crate::defaults;

struct Port<'a> {
    line: &'a mut SimLine,
    end: End,
    now: Instant,
    delivered: Option<Vec<u8>>,
}

impl Wire for Port<'_> {
    fn transmit(&mut self, bytes: &[u8]) {
        self.line.write(self.end, self.now, bytes);
    }
}

impl Sink for Port<'_> {
    fn room(&self) -> usize {
        1024
    }

    fn deliver(&mut self, telegram: &[u8]) {
        assert!(self.delivered.replace(telegram.to_vec()).is_none());
    }

    fn sent(&mut self, outcome: Result<(), SendError>) {
        assert_eq!(outcome, Ok(()));
    }

    fn report(&mut self, event: Event) {
        panic!("{event:?} on a clean line");
    }
}

#[test]
fn question_and_answer_on_two_wires() {
    let sim = SimConfig { half_duplex: true, ..SimConfig::new(19_200, 22) };
    let config = Config { zvz: 20 * MS, ..defaults::ascii(sim.char_time) };
    let char_time = sim.char_time;
    let mut line = SimLine::new(sim, 0);
    let mut machines = [Ascii::<1024>::new(&config), Ascii::<1024>::new(&config)];
    let mut deadlines: [Option<Instant>; 2] = [Some(Instant::START), Some(Instant::START)];
    let mut buffer = [0; 64];
    let mut now = Instant::START;
    let mut sent: Vec<u8> = b"1".to_vec();
    let mut rounds = 0;
    let mut begun = None;
    while rounds < 200 {
        let mut todo: Vec<(End, Option<Vec<u8>>, bool)> = Vec::new(); // end, characters, TxDone
        while let Some((end, event)) = line.pop(now, &mut buffer) {
            match event {
                SimEvent::Rx(n) => todo.push((end, Some(buffer[..n].to_vec()), false)),
                SimEvent::TxDone => todo.push((end, None, true)),
                other => panic!("{other:?} on a clean line"),
            }
        }
        for end in End::BOTH {
            if deadlines[end as usize].is_some_and(|at| at <= now) {
                todo.push((end, None, false));
            }
        }
        if begun.is_none() {
            begun = Some(now);
            let mut port = Port { line: &mut line, end: End::A, now, delivered: None };
            deadlines[0] = machines[0].step(now, Input::Order(Order::Send(&sent)), &mut port);
        }
        for (end, characters, done) in todo {
            let input = match &characters {
                Some(characters) => Input::Line(LineInput::Rx(characters)),
                None if done => Input::Line(LineInput::TxDone),
                None => Input::Tick,
            };
            let mut port = Port { line: &mut line, end, now, delivered: None };
            deadlines[end as usize] = machines[end as usize].step(now, input, &mut port);
            if let Some(telegram) = port.delivered.take() {
                assert_eq!(telegram, sent);
                // Exactly ZVZ after the last character.
                assert_eq!(begun, Some(now - 20 * MS - char_time * sent.len() as u64));
                rounds += 1;
                sent.push(rounds as u8);
                begun = Some(now);
                deadlines[end as usize] = machines[end as usize].step(now, Input::Order(Order::Send(&sent)), &mut port);
            }
        }
        let next = deadlines.iter().flatten().copied().chain(line.next_event()).min();
        now = next.expect("somebody always has something to do").max(now);
    }
    assert_eq!(sent.len(), 201);
}
