//! CPs on the process of a simulated line: real sockets, virtual time.

use std::path::PathBuf;

use ob1_line::hub::{Hub, Partner};
use ob1_line::sim::{BusConfig, FaultRates};
use ob1_line::{Instant, LineEvent, LineFault, LineInput, LineSettings, ModemLines, Parity, RealLine, Span, StopBits};

const MS: Span = Span::MILLISECOND;

/// A line and CPs on it, all driven by one clock.
struct World {
    _dir: tempfile::TempDir,
    path: PathBuf,
    hub: Option<Hub>,
    lines: Vec<RealLine>,
    now: Instant,
    log: Vec<String>,
}

impl World {
    fn new(config: BusConfig, partner: &Partner, settings: &[LineSettings]) -> Self {
        let dir = tempfile::tempdir().expect("a folder");
        let path = dir.path().join("bus.line");
        let hub = Hub::open(&path, config, 3, partner).expect("a free name");
        let lines = settings
            .iter()
            .map(|settings| {
                let mut line = RealLine::new(&format!("sim:{}", path.display()).parse().expect("a line"));
                line.apply(settings).expect("a simulated line can do all of them");
                line
            })
            .collect();
        let mut world = Self { _dir: dir, path, hub: Some(hub), lines, now: Instant::START, log: Vec::new() };
        world.run(Span::from_nanos(1));
        world
    }

    /// Runs everything until this much time has passed.
    fn run(&mut self, time: Span) {
        let end = self.now + time;
        loop {
            // A message sent at an instant is received at that instant.
            for _ in 0..3 {
                if let Some(hub) = &mut self.hub {
                    hub.work(self.now);
                }
                for (number, line) in self.lines.iter_mut().enumerate() {
                    line.ready();
                    let mut buffer = [0; 64];
                    while let Some(event) = line.next_event(self.now, &mut buffer) {
                        let us = self.now.since_start().micros();
                        self.log.push(match event {
                            LineEvent::Input(LineInput::Rx(bytes)) => format!("{us} {number} {bytes:02X?}"),
                            LineEvent::Input(input) => format!("{us} {number} {input:?}"),
                            LineEvent::Gone(_) => format!("{us} {number} gone"),
                            other => format!("{us} {number} {other:?}"),
                        });
                    }
                }
            }
            let hub = self.hub.as_ref().and_then(Hub::deadline);
            let next = self.lines.iter().filter_map(RealLine::deadline).chain(hub).min().unwrap_or(end);
            if self.now >= end {
                return;
            }
            self.now = next.clamp(self.now + Span::from_nanos(1), end);
        }
    }

    fn take(&mut self) -> Vec<String> {
        std::mem::take(&mut self.log)
    }
}

fn at_9600() -> LineSettings {
    LineSettings::default()
}

#[test]
fn two_cps_hear_each_other_in_the_time_of_the_line() {
    let mut world = World::new(BusConfig::new(false), &Partner::None, &[at_9600(), at_9600()]);
    assert_eq!(world.take(), ["0 0 Up([])", "0 1 Up([])"]);
    let begin = world.now;
    assert_eq!(world.lines[0].write(begin, &[0x10, 0xFF]), 2);
    world.run(10 * MS);
    assert_eq!(world.take(), ["1041 1 [10]", "2083 0 TxDone", "2083 1 [FF]"]);
    // Both ways at once, and twice before the first has been sent: one end for both.
    world.lines[0].write(world.now, &[1]);
    world.lines[1].write(world.now, &[2]);
    world.run(MS / 2);
    world.lines[0].write(world.now, &[3]);
    world.run(10 * MS);
    let log = world.take();
    assert_eq!(log.iter().filter(|line| line.contains("0 TxDone")).count(), 1, "{log:?}");
    assert_eq!(log.len(), 5, "{log:?}");
}

#[test]
fn what_has_not_left_is_taken_back() {
    let mut world = World::new(BusConfig::new(false), &Partner::None, &[at_9600(), at_9600()]);
    world.take();
    world.lines[0].write(world.now, &[7; 100]);
    world.run(5 * MS);
    let taken = world.lines[0].take_back(world.now);
    assert!((94..=96).contains(&taken), "{taken}");
    world.run(200 * MS);
    let log = world.take();
    assert_eq!(log.iter().filter(|line| line.contains("[07]")).count() + taken, 100, "{log:?}");
    assert_eq!(log.iter().filter(|line| line.contains("TxDone")).count(), 1, "{log:?}");
}

#[test]
fn cps_that_are_set_differently_hear_faults() {
    let even = LineSettings { parity: Parity::Even, ..at_9600() };
    let fast = LineSettings { baud: 19_200, ..at_9600() };
    for (other, fault) in [(even, LineFault::Parity), (fast, LineFault::Framing)] {
        let mut world = World::new(BusConfig::new(false), &Partner::None, &[at_9600(), other]);
        world.take();
        world.lines[0].write(world.now, &[1]);
        world.run(10 * MS);
        let log = world.take();
        assert!(log.iter().any(|line| line.contains(&format!("1 Fault({fault:?})"))), "{log:?}");
        // With equal settings they understand each other, without reconnecting.
        world.lines[1].apply(&at_9600()).expect("possible");
        world.run(MS);
        world.take();
        world.lines[0].write(world.now, &[1]);
        world.run(10 * MS);
        let log = world.take();
        assert!(log.iter().any(|line| line.ends_with("1 [01]")), "{log:?}");
    }
    let odd = LineSettings { stop_bits: StopBits::OneAndHalf, ..at_9600() };
    assert_eq!(World::new(BusConfig::new(false), &Partner::None, &[odd]).take(), ["0 0 Up([])"]);
}

#[test]
fn a_cable_has_two_ends_and_two_wires_have_room() {
    let mut cable = World::new(BusConfig::new(false), &Partner::None, &[at_9600(); 3]);
    let hub = cable.hub.as_ref().expect("there");
    assert_eq!((hub.guests(), hub.turned_away()), (2, 1));
    assert!(cable.take().iter().any(|line| line.ends_with("2 gone")), "the third is told");

    let mut wires = World::new(BusConfig::new(true), &Partner::None, &[at_9600(); 3]);
    wires.take();
    wires.lines[1].write(wires.now, &[5]);
    wires.run(2 * MS);
    assert_eq!(wires.take(), ["1041 0 [05]", "1041 1 TxDone", "1041 2 [05]"]);
    wires.lines[0].write(wires.now, &[1]);
    wires.lines[1].write(wires.now, &[2]);
    wires.run(2 * MS);
    assert_eq!(wires.hub.as_ref().map(Hub::collisions), Some(2));
}

#[test]
fn the_line_goes_and_comes_back() {
    let mut world = World::new(BusConfig::new(false), &Partner::None, &[at_9600(), at_9600()]);
    world.take();
    world.hub = None;
    world.run(100 * MS);
    let log = world.take();
    assert_eq!(log.iter().filter(|line| line.ends_with("gone")).count(), 2, "{log:?}");
    // Discarded, but its end is reported: a protocol does not hang on a lost line.
    world.lines[0].write(world.now, &[1]);
    world.run(5 * MS);
    assert!(world.take().iter().any(|line| line.ends_with("0 TxDone")));
    world.hub = Some(Hub::open(&world.path, BusConfig::new(false), 4, &Partner::None).expect("free again"));
    world.run(2000 * MS);
    let log = world.take();
    assert_eq!(log.iter().filter(|line| line.contains("Up")).count(), 2, "{log:?}");
    world.lines[1].write(world.now, &[9]);
    world.run(5 * MS);
    assert!(world.take().iter().any(|line| line.ends_with("0 [09]")));
}

#[test]
fn modem_lines_cross() {
    let mut world = World::new(BusConfig::new(false), &Partner::None, &[at_9600(), at_9600()]);
    world.run(MS);
    assert!(world.lines[0].modem_lines().is_some_and(|lines| lines.cts && lines.dsr && lines.cd));
    world.lines[1].set_modem_lines(false, true);
    world.run(MS);
    assert!(world.lines[0].modem_lines().is_some_and(|lines| !lines.cts && lines.dsr));
    world.lines.pop();
    world.run(MS);
    assert!(world.lines[0].modem_lines().is_some_and(|lines| !lines.cts && !lines.dsr && !lines.cd), "unplugged");
}

#[test]
fn an_echo_comes_back_in_twice_the_time_and_suffers_the_faults_of_the_line() {
    let faults = FaultRates { parity: 500_000, ..FaultRates::NONE };
    let mut world = World::new(BusConfig { faults, ..BusConfig::new(false) }, &Partner::Echo, &[at_9600()]);
    world.take();
    world.lines[0].write(world.now, &[0xFF; 200]);
    world.run(1000 * MS);
    let log = world.take();
    let of = |what: &str| log.iter().filter(|line| line.ends_with(what)).count();
    // The echo does not send back unreadable characters: half get there, half of these come back.
    assert_eq!((of("TxDone"), log[0].as_str()), (1, log[0].as_str()));
    assert!((30..70).contains(&of("[FF]")) && (30..70).contains(&of("Fault(Framing)")), "{log:?}");
}

#[test]
fn a_program_on_the_pty_is_the_partner() {
    let dir = tempfile::tempdir().expect("a folder");
    let pty = dir.path().join("partner");
    let mut world = World::new(BusConfig::new(false), &Partner::Pty(pty.clone()), &[at_9600()]);
    world.run(MS);
    let mut program = RealLine::new(&format!("serial:{}", pty.display()).parse().expect("a line"));
    let mut buffer = [0; 64];
    assert!(matches!(program.next_event(Instant::START, &mut buffer), Some(LineEvent::Up(_))));
    world.lines[0].write(world.now, b"ping");
    world.run(10 * MS);
    // The kernel delivers a pty's characters when it has time, not all at once.
    let mut heard = Vec::new();
    while heard.len() < 4 {
        program.ready();
        match program.next_event(Instant::START, &mut buffer) {
            Some(LineEvent::Input(LineInput::Rx(bytes))) => heard.extend_from_slice(bytes),
            event => assert_eq!(event, None),
        }
    }
    assert_eq!(heard, b"ping");
    world.take();
    program.write(Instant::START, b"pong");
    world.run(10 * MS);
    let heard = world.take().iter().filter(|line| line.contains(" 0 [")).count();
    assert_eq!(heard, 4, "one by one, however fast the pty is");
}

#[test]
fn a_cable_reports_its_modem_lines_before_anybody_has_switched_them() {
    let lines = |half_duplex, partner| {
        World::new(BusConfig::new(half_duplex), &partner, &[at_9600()]).lines[0].modem_lines().map(ModemLines::bits)
    };
    assert_eq!(lines(false, Partner::None), Some(0), "nobody is there: all OFF");
    assert_eq!(lines(false, Partner::Echo), Some(0b1011), "CTS, DSR, CD: a partner without modem lines holds nothing");
    assert_eq!(lines(true, Partner::None), None, "two wires have none");
}

#[test]
fn who_writes_without_end_waits_and_the_line_holds_no_more_than_it_must() {
    use ob1_socket::seqpacket::{Channel, MESSAGE_MAX, Sent};
    let world = World::new(BusConfig::new(false), &Partner::None, &[]);
    let mut hub = world.hub.expect("made");
    let flooder = Channel::connect(&world.path).expect("the line listens");
    let mut message = vec![0x55; MESSAGE_MAX];
    message[0] = b'W';
    let (mut taken, mut refused) = (0_usize, 0);
    while refused < 10 {
        match flooder.send(&message).expect("nobody hangs up") {
            Sent::Yes => (taken, refused) = (taken + MESSAGE_MAX, 0),
            Sent::Full => {
                refused += 1;
                hub.work(Instant::START);
            }
        }
        assert!(taken < 2 << 20, "{taken} characters wait for a line of 9600 baud");
    }
    // It must not keep the line from accepting others.
    let other = Channel::connect(&world.path).expect("the line listens");
    hub.work(Instant::from_nanos(1));
    assert_eq!((hub.guests(), hub.turned_away()), (2, 0));
    drop(other);
}
