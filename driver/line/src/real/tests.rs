//! Half duplex, echo and flow control on lines that cannot be asked for the end of sending, in virtual time.

use std::cell::RefCell;
use std::collections::VecDeque;
use std::io;
use std::rc::Rc;

use super::*;
use crate::supported_frames::Warning;

const MS: Span = Span::MILLISECOND;
/// Between what a program reads and what it writes.
const TURN: Span = Span::from_micros(300);

/// Who is at the other end.
#[derive(Clone, Copy, Debug, Default)]
struct Partner {
    /// The adapter gives back what is sent.
    echoes: bool,
    /// Answers a telegram of this many characters with itself.
    repeats: usize,
    /// Answers a telegram of this many characters with another.
    answers: usize,
    /// Characters are handed over in bursts: at multiples of this time.
    bursts: Span,
    /// Behind the network there is a wire.
    wire: bool,
}

/// The other end of a line.
struct World {
    now: Instant,
    passage: Passage,
    char_time: Span,
    partner: Partner,
    /// When the last character written has left.
    free: Instant,
    /// Since the last answer, with the time when each has arrived.
    heard: Vec<(Instant, u8)>,
    /// On the way to the line, with the time when each can be read.
    coming: VecDeque<(Instant, u8)>,
    /// All that was written, with its time.
    written: Vec<(Instant, usize)>,
}

impl World {
    fn readable(&self) -> usize {
        self.coming.iter().filter(|(at, _)| *at <= self.now).count()
    }

    fn comes(&mut self, at: Instant, byte: u8) {
        let burst = self.partner.bursts;
        let at = if burst.is_zero() { at } else { at.next_tick(burst) };
        self.coming.push_back((at, byte));
        self.coming.make_contiguous().sort_by_key(|(at, _)| *at);
    }

    fn take(&mut self, bytes: &[u8]) {
        self.written.push((self.now, bytes.len()));
        for byte in bytes {
            let on_wire = self.passage == Passage::Wire || self.partner.wire;
            self.free = if on_wire { self.free.max(self.now) + self.char_time } else { self.now };
            self.heard.push((self.free, *byte));
            if self.partner.echoes {
                self.comes(self.free + if on_wire { Span::ZERO } else { TURN }, *byte);
            }
        }
        let Partner { repeats, answers, .. } = self.partner;
        if self.heard.len() == repeats.max(answers) {
            let end = self.free;
            for (nth, (_, byte)) in std::mem::take(&mut self.heard).into_iter().enumerate() {
                let byte = if repeats > 0 || nth < 2 { byte } else { !byte };
                let wire = self.char_time * (nth as u64 + 5);
                let on_wire = self.passage == Passage::Wire || self.partner.wire;
                self.comes(end + if on_wire { wire } else { TURN }, byte);
            }
        }
    }
}

struct Fake(Rc<RefCell<World>>);

impl Link for Fake {
    fn open(&mut self, _: Instant, _: &LineSettings) -> io::Result<Opened> {
        Ok(Opened::Yes(Vec::new()))
    }
    fn apply(&mut self, _: &LineSettings) -> io::Result<Vec<Warning>> {
        Ok(Vec::new())
    }
    fn close(&mut self) {}
    fn poll_fds<'a>(&'a self, _: bool, _: &mut PollFds<'a>) {}
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let mut world = self.0.borrow_mut();
        let count = world.readable().min(buffer.len());
        if count == 0 {
            return Err(io::ErrorKind::WouldBlock.into());
        }
        for place in &mut buffer[..count] {
            *place = world.coming.pop_front().map_or(0, |(_, byte)| byte);
        }
        Ok(count)
    }
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.borrow_mut().take(bytes);
        Ok(bytes.len())
    }
    fn passage(&self) -> Passage {
        self.0.borrow().passage
    }
}

/// A line, its other end, and what the line has reported.
struct Bench {
    world: Rc<RefCell<World>>,
    line: RealLine,
    /// Received since the last telegram.
    received: Vec<u8>,
    /// Characters that came before the end of sending was reported.
    early: usize,
    sending: bool,
    told: Vec<bool>,
    ends: Vec<Instant>,
}

impl Bench {
    fn new(passage: Passage, settings: LineSettings, partner: Partner) -> Self {
        let world = World {
            now: Instant::START,
            passage,
            char_time: settings.char_time(),
            partner,
            free: Instant::START,
            heard: Vec::new(),
            coming: VecDeque::new(),
            written: Vec::new(),
        };
        let world = Rc::new(RefCell::new(world));
        let mut line = RealLine::new(&"serial:/dev/null".parse().unwrap());
        line.link = Box::new(Fake(Rc::clone(&world)));
        line.apply(&settings).unwrap();
        let (told, ends) = (Vec::new(), Vec::new());
        let mut bench = Self { world, line, received: Vec::new(), early: 0, sending: false, told, ends };
        bench.run(MS);
        bench
    }

    fn now(&self) -> Instant {
        self.world.borrow().now
    }

    fn send(&mut self, telegram: &[u8]) {
        self.received.clear();
        self.world.borrow_mut().heard.clear();
        self.sending = true;
        assert_eq!(self.line.write(self.now(), telegram), telegram.len());
    }

    /// Sends and waits for a second longer than both directions take.
    fn ask(&mut self, telegram: &[u8]) -> &[u8] {
        self.send(telegram);
        let time = self.world.borrow().char_time * 4 * telegram.len() as u64 + 1000 * MS;
        self.run(time);
        assert!(!self.sending, "the end is reported");
        &self.received
    }

    fn run(&mut self, time: Span) {
        let until = self.now() + time;
        self.step(|_, _| {}, until);
    }

    fn step(&mut self, mut on: impl FnMut(&mut RealLine, (Instant, LineInput<'_>)), until: Instant) {
        loop {
            let now = self.now();
            if self.world.borrow().readable() > 0 {
                self.line.ready();
            }
            let mut buffer = [0; 64];
            let mut turns = 0;
            while let Some(event) = self.line.next_event(now, &mut buffer) {
                turns += 1;
                assert!(turns < 1000, "it never ends");
                match event {
                    LineEvent::Input(input) => {
                        match input {
                            LineInput::Rx(bytes) => {
                                self.received.extend_from_slice(bytes);
                                self.early += if self.sending { bytes.len() } else { 0 };
                            }
                            LineInput::TxDone => {
                                self.sending = false;
                                self.ends.push(now);
                            }
                            _ => {}
                        }
                        on(&mut self.line, (now, input));
                    }
                    LineEvent::Echo(on) => self.told.push(on),
                    LineEvent::Up(_) | LineEvent::Gone(_) => {}
                }
            }
            if now >= until {
                return;
            }
            let due = self.line.deadline().unwrap_or(Instant::NEVER);
            let world = &mut *self.world.borrow_mut();
            let coming = world.coming.front().map_or(Instant::NEVER, |(at, _)| *at);
            assert!(due > now, "it does not spin");
            world.now = due.min(coming.max(now + Span::from_nanos(1))).min(until);
        }
    }
}

fn half(baud: u32) -> LineSettings {
    LineSettings { baud, half_duplex: true, ..LineSettings::default() }
}

const RTU: [u8; 8] = [5, 6, 0, 1, 0x12, 0x34, 0xAB, 0xCD];
const ASCII: &[u8; 17] = b":01050000FF00FB\r\n";
const BAUDS: [u32; 7] = [300, 1200, 2400, 9600, 19_200, 38_400, 115_200];
const PASSAGES: [Passage; 3] = [Passage::Wire, Passage::Program, Passage::Network];

/// Whether the echo of such a telegram in such bursts can be told from an answer that repeats it.
fn is_decidable(passage: Passage, settings: &LineSettings, length: usize, bursts: Span) -> bool {
    let on_wire = settings.time_of(length);
    match passage {
        // It is complete one burst after the end; an answer as long as itself is not.
        Passage::Wire => bursts < on_wire * 7 / 8,
        // Its first characters come back before the last one goes.
        Passage::Program => bursts + TURN < 20 * MS,
        _ => bursts + TURN < settings.time_of(6),
    }
}

#[test]
fn an_echo_is_not_an_answer() {
    let mut decided = 0;
    for passage in PASSAGES {
        for baud in BAUDS {
            for telegram in [&RTU[..], ASCII] {
                for bursts in [Span::ZERO, MS, 4 * MS, 16 * MS] {
                    let partner = Partner { echoes: true, bursts, ..Partner::default() };
                    let mut bench = Bench::new(passage, half(baud), partner);
                    if !is_decidable(passage, &half(baud), telegram.len(), bursts) {
                        continue;
                    }
                    decided += 1;
                    let case = format!("{passage:?}, {baud} baud, bursts of {bursts:?}");
                    for _ in 0..3 {
                        assert_eq!(bench.ask(telegram), b"", "{case}");
                    }
                    assert_eq!(bench.told, [true], "{case}: once");
                }
            }
        }
    }
    assert!(decided > 100, "{decided}");
}

#[test]
fn an_answer_that_repeats_its_request_is_heard() {
    for passage in PASSAGES {
        for baud in BAUDS {
            for telegram in [&RTU[..], ASCII] {
                for bursts in [Span::ZERO, MS, 4 * MS, 16 * MS] {
                    let partner = Partner { repeats: telegram.len(), bursts, ..Partner::default() };
                    let mut bench = Bench::new(passage, half(baud), partner);
                    for _ in 0..3 {
                        assert_eq!(bench.ask(telegram), telegram, "{passage:?}, {baud} baud, bursts of {bursts:?}");
                    }
                    assert_eq!((bench.early, bench.told.len()), (0, 0));
                }
            }
        }
    }
}

#[test]
fn an_answer_behind_the_echo_is_heard() {
    for passage in PASSAGES {
        for baud in BAUDS {
            for bursts in [Span::ZERO, MS, 16 * MS] {
                for repeats in [true, false] {
                    if !is_decidable(passage, &half(baud), RTU.len(), bursts) {
                        continue;
                    }
                    let (repeats, answers) = if repeats { (8, 0) } else { (0, 8) };
                    let partner = Partner { echoes: true, repeats, answers, bursts, wire: passage == Passage::Network };
                    let mut bench = Bench::new(passage, half(baud), partner);
                    let answer: Vec<u8> =
                        RTU.iter().enumerate().map(|(n, b)| if repeats > 0 || n < 2 { *b } else { !b }).collect();
                    for _ in 0..3 {
                        assert_eq!(bench.ask(&RTU), answer, "{passage:?}, {baud} baud, {bursts:?}");
                    }
                    assert_eq!(bench.told, [true]);
                }
            }
        }
    }
}

#[test]
fn a_burst_with_an_echo_and_its_answer_is_taken_apart() {
    // At 115200 baud both come in one burst of a USB adapter.
    let partner = Partner { echoes: true, repeats: 8, bursts: 16 * MS, ..Partner::default() };
    let mut bench = Bench::new(Passage::Wire, half(115_200), partner);
    for _ in 0..3 {
        assert_eq!(bench.ask(&RTU), RTU);
    }
    assert_eq!(bench.told, [true]);
    bench.world.borrow_mut().partner.repeats = 0;
    assert_eq!(bench.ask(&RTU), b"", "it is known to echo, so this is no answer");
}

#[test]
fn an_echo_that_stays_away_is_told_and_the_answer_is_heard() {
    for passage in PASSAGES {
        let mut bench = Bench::new(passage, half(9600), Partner { echoes: true, ..Partner::default() });
        let wire = passage == Passage::Network;
        assert_eq!(bench.ask(&RTU), b"");
        bench.world.borrow_mut().partner = Partner { answers: 8, wire, ..Partner::default() };
        assert_eq!(bench.ask(&RTU)[..3], [5, 6, !0], "also the beginning that it shares with its request");
        assert_eq!(bench.told, [true, false]);
        bench.world.borrow_mut().partner = Partner { repeats: 8, wire, ..Partner::default() };
        assert_eq!(bench.ask(&RTU), RTU, "{passage:?}");
    }
}

#[test]
fn an_echo_that_comes_late_once_is_still_one() {
    // As a machine that stands still makes it.
    let mut bench = Bench::new(Passage::Program, half(9600), Partner { echoes: true, ..Partner::default() });
    for bursts in [0, 30, 0, 30, 0] {
        bench.world.borrow_mut().partner.bursts = MS * bursts;
        assert_eq!(bench.ask(&RTU), b"");
    }
    assert_eq!(bench.told, [true]);
    bench.world.borrow_mut().partner = Partner { repeats: 8, ..Partner::default() };
    assert_eq!(bench.ask(&RTU), b"", "it cannot be told apart");
    assert_eq!(bench.ask(&RTU), RTU);
    assert_eq!(bench.told, [true, false]);
}

#[test]
fn a_telegram_to_a_program_keeps_its_time_and_tears_nothing() {
    for (passage, pause) in [(Passage::Program, 10_000), (Passage::Network, 0)] {
        for baud in BAUDS {
            let mut bench = Bench::new(passage, half(baud), Partner::default());
            let begin = bench.now();
            bench.ask(&[7; 100]);
            let written = bench.world.borrow().written.clone();
            assert!(written.len() <= 5, "{written:?}");
            let char_time = half(baud).char_time();
            for pair in written.windows(2) {
                let silence = pair[1].0.since(pair[0].0);
                let most = (char_time * 2).max(Span::from_micros(pause)) + Span::from_nanos(2);
                assert!(silence <= most, "{baud} baud: {silence:?}");
            }
            let late = bench.ends[0].since(begin + half(baud).time_of(100));
            assert!(late <= 40 * MS && bench.ends[0] >= begin + half(baud).time_of(100), "{late:?}");
            assert_eq!(written.last().map(|(at, _)| *at), Some(bench.ends[0]), "its last character is the end");
        }
    }
}

#[test]
fn what_comes_while_a_wire_is_sending_is_not_heard() {
    let mut bench = Bench::new(Passage::Wire, half(300), Partner::default());
    bench.send(&RTU);
    let at = bench.now() + MS;
    bench.world.borrow_mut().comes(at, 0x41);
    bench.run(1000 * MS);
    assert_eq!((bench.received.len(), bench.sending), (0, false));
}

#[test]
fn a_full_duplex_partner_may_answer_before_the_computed_end() {
    for passage in [Passage::Program, Passage::Network] {
        let settings = LineSettings { baud: 300, ..LineSettings::default() };
        let mut bench = Bench::new(passage, settings, Partner { repeats: 8, ..Partner::default() });
        bench.send(&RTU);
        bench.run(2 * MS);
        assert_eq!((&bench.received[..], bench.early, bench.sending), (&RTU[..], 0, false), "behind the end");
    }
}

#[test]
fn after_xoff_only_what_was_handed_over_still_comes() {
    // As the protocols do it: 16 characters at a time, none after XOFF.
    for passage in PASSAGES {
        let settings = LineSettings { baud: 2400, flow: Flow::XonXoff, ..LineSettings::default() };
        let mut bench = Bench::new(passage, settings, Partner::default());
        bench.send(&[0x55; 16]);
        let until = bench.now() + 2000 * MS;
        let (mut given, mut stopped) = (16, false);
        let world = Rc::clone(&bench.world);
        bench.step(
            |line, (now, input)| match input {
                LineInput::Rx(bytes) => stopped |= bytes.contains(&0x13),
                LineInput::TxDone if !stopped && given < 200 => {
                    given += 16;
                    line.write(now, &[0x55; 16]);
                    if given == 48 {
                        // In the same moment as the end of these.
                        let end = line.end;
                        world.borrow_mut().comes(end, 0x13);
                    }
                }
                _ => {}
            },
            until,
        );
        assert!(stopped);
        assert_eq!(given, 48, "{passage:?}");
    }
}

#[test]
fn a_partner_that_never_falls_silent_does_not_hold_the_end_back() {
    let settings = LineSettings { baud: 2400, flow: Flow::XonXoff, ..LineSettings::default() };
    let mut bench = Bench::new(Passage::Program, settings, Partner::default());
    bench.send(&[0x55; 16]);
    for n in 0..200 {
        let at = bench.now() + MS * n;
        bench.world.borrow_mut().comes(at, 0x41);
    }
    bench.run(100 * MS);
    assert!(!bench.sending);
}

#[test]
fn characters_taken_back_are_not_waited_for() {
    let mut bench = Bench::new(Passage::Program, half(9600), Partner { echoes: true, ..Partner::default() });
    bench.send(&[7; 100]);
    bench.run(10 * MS);
    assert_eq!(bench.line.take_back(bench.now()), 100, "none has left");
    bench.run(10 * MS);
    assert!(!bench.sending);
    assert_eq!(bench.ask(&RTU), b"");
}
