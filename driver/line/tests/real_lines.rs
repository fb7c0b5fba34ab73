//! Real ptys and loopback TCP: opening, bytes both ways, the end of transmission, going and coming back.
//!
//! Nothing sleeps here: the tests wait in `poll` for the event itself. The deadline only ends a test that has failed.

#![allow(clippy::disallowed_methods, clippy::disallowed_types)] // a test owns its line, so it owns the clock

use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::path::PathBuf;
use std::time::{self, Duration};

use ob1_line::{Flow, Instant, LineEvent, LineInput, LineSettings, Parity, PollFds, RealLine, Span};
use ob1_time::WatchedTime;
use rustix::event::{Timespec, poll};
use serialport::SerialPort;

/// A wait has failed after this time.
const GUARD: Span = Span::from_secs(20);
/// The same for a partner's read.
const PATIENCE: Duration = Duration::from_secs(120);

/// Everything written has been sent.
const SENT: LineEvent<'static> = LineEvent::Input(LineInput::TxDone);

/// A line and the clock of its owner.
struct Bench {
    line: RealLine,
    start: time::Instant,
    /// A machine that stands still does not end a test.
    watched: WatchedTime,
    received: Vec<u8>,
}

impl Bench {
    fn new(spec: &str) -> Self {
        let line = RealLine::new(&spec.parse().unwrap());
        let start = time::Instant::now();
        Self { line, start, watched: WatchedTime::new(Instant::START, 2 * Span::SECOND), received: Vec::new() }
    }

    fn now(&self) -> Instant {
        Instant::START + self.start.elapsed().into()
    }

    /// The next event other than received bytes, which are collected.
    fn event(&mut self) -> LineEvent<'static> {
        self.run(|_| false).expect("an event")
    }

    /// Runs until this many bytes have come.
    fn receive(&mut self, n: usize) -> Vec<u8> {
        let event = self.run(|received| received.len() >= n);
        assert_eq!(event, None, "while waiting for {n} bytes, having {:?}", self.received);
        std::mem::take(&mut self.received)
    }

    fn run(&mut self, enough: impl Fn(&[u8]) -> bool) -> Option<LineEvent<'static>> {
        loop {
            let mut buffer = [0; 64];
            while let Some(event) = self.line.next_event(self.now(), &mut buffer) {
                match event {
                    LineEvent::Input(LineInput::Rx(bytes)) => self.received.extend_from_slice(bytes),
                    LineEvent::Input(input) => {
                        assert_eq!(LineEvent::Input(input), SENT);
                        return Some(SENT);
                    }
                    LineEvent::Up(warnings) => return Some(LineEvent::Up(warnings)),
                    LineEvent::Gone(why) => return Some(LineEvent::Gone(why)),
                    LineEvent::Echo(on) => return Some(LineEvent::Echo(on)),
                }
            }
            if enough(&self.received) {
                return None;
            }
            let time = self.watched.look(self.now());
            assert!(time.since_start() < GUARD, "nothing happened; received so far {:?}", self.received);
            let due = self.line.deadline().map_or(Span::SECOND, |at| at.since(self.now()));
            let mut fds = PollFds::default();
            self.line.poll_fds(&mut fds);
            let mut entries: Vec<_> = fds.into_entries().collect();
            let timeout = Timespec::try_from(Duration::from(due.min(Span::SECOND))).unwrap();
            if poll(&mut entries, Some(&timeout)).unwrap() > 0 {
                drop(entries);
                self.line.ready();
            }
        }
    }
}

fn up() -> LineEvent<'static> {
    LineEvent::Up(Vec::new())
}

fn partner(path: &std::path::Path) -> serialport::TTYPort {
    serialport::new(path.to_string_lossy(), 9600).exclusive(false).timeout(PATIENCE).open_native().unwrap()
}

fn pty_in(dir: &tempfile::TempDir) -> (PathBuf, String) {
    let path = dir.path().join("line");
    let spec = format!("pty:{}", path.display());
    (path, spec)
}

#[test]
fn a_pty_is_published_and_removed() {
    let dir = tempfile::tempdir().unwrap();
    let (path, spec) = pty_in(&dir);
    let mut a = Bench::new(&spec);
    assert_eq!(a.event(), up());
    assert!(std::fs::read_link(&path).unwrap().starts_with("/dev/pts"));
    drop(a);
    assert!(path.symlink_metadata().is_err(), "removed with the line");

    std::os::unix::fs::symlink("/dev/pts/99999", &path).unwrap();
    let mut a = Bench::new(&spec);
    assert_eq!(a.event(), up(), "the link an earlier process left is replaced");
    assert_ne!(std::fs::read_link(&path).unwrap(), PathBuf::from("/dev/pts/99999"));
    assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 1, "no file is left beside it");
}

#[test]
fn a_published_pty_that_others_remove_is_published_again() {
    let dir = tempfile::tempdir().unwrap();
    let (path, spec) = pty_in(&dir);
    let mut a = Bench::new(&spec);
    assert_eq!(a.event(), up());
    let device = std::fs::read_link(&path).unwrap();
    std::fs::remove_file(&path).unwrap();
    let due = a.now() + 3 * Span::SECOND;
    assert!(a.line.next_event(due, &mut [0; 16]).is_none());
    assert_eq!(std::fs::read_link(&path).unwrap(), device, "the same pty, so nobody who has it open is disturbed");
    std::fs::remove_file(&path).unwrap();
    std::fs::write(&path, "mine").unwrap();
    assert!(a.line.next_event(due + 3 * Span::SECOND, &mut [0; 16]).is_none());
    assert_eq!(std::fs::read(&path).unwrap(), b"mine");
}

#[test]
fn a_file_in_the_place_of_the_pty_is_not_touched() {
    let dir = tempfile::tempdir().unwrap();
    let (path, spec) = pty_in(&dir);
    std::fs::write(&path, "mine").unwrap();
    let mut a = Bench::new(&spec);
    let LineEvent::Gone(why) = a.event() else { panic!("it must not open") };
    assert!(why.contains("is not replaced"), "{why}");
    assert_eq!(std::fs::read(&path).unwrap(), b"mine");
    std::fs::remove_file(&path).unwrap();
    assert_eq!(a.event(), up(), "and it opens once the way is free");
}

#[test]
fn every_byte_goes_both_ways_between_a_pty_and_a_serial_line() {
    let dir = tempfile::tempdir().unwrap();
    let (path, spec) = pty_in(&dir);
    let mut a = Bench::new(&spec);
    assert_eq!(a.event(), up());
    let mut b = Bench::new(&format!("serial:{}", path.display()));
    assert_eq!(b.event(), up());

    // FFh is the escape of PARMRK; a tty that is not raw would swallow the control characters.
    let all: Vec<u8> = (0..=255).collect();
    assert_eq!(a.line.write(a.now(), &all), 256);
    assert_eq!(b.receive(256), all);
    assert_eq!(b.line.write(b.now(), &all), 256);
    assert_eq!(a.event(), SENT, "before what may be the answer");
    assert_eq!(a.receive(256), all);
    assert_eq!(b.event(), SENT, "by the time it takes");
}

#[test]
fn transmission_lasts_as_long_as_its_characters() {
    let dir = tempfile::tempdir().unwrap();
    let (_, spec) = pty_in(&dir);
    let mut line = RealLine::new(&spec.parse().unwrap());
    let settings = LineSettings { baud: 1200, parity: Parity::Even, ..LineSettings::default() };
    line.apply(&settings).unwrap();
    let mut buffer = [0; 64];
    // Virtual time from here on: 12 characters of 11 bits at 1200 baud last 110 ms, although a pty takes them at once.
    assert!(
        matches!(line.next_event(Instant::START, &mut buffer), Some(LineEvent::Up(w)) if w.len() == 1),
        "8E1 is not for a pty"
    );
    assert_eq!(line.write(Instant::from_nanos(1_000), b"twelve chars"), 12);
    assert_eq!(line.next_event(Instant::from_nanos(2_000), &mut buffer), None);
    assert_eq!(line.deadline(), Some(Instant::from_nanos(110_001_000)));
    assert_eq!(line.next_event(Instant::from_nanos(110_000_999), &mut buffer), None);
    assert_eq!(line.next_event(Instant::from_nanos(110_001_000), &mut buffer), Some(SENT));
    let look_at_its_name = Instant::from_nanos(2_000) + Span::from_secs(2);
    assert_eq!(line.deadline(), Some(look_at_its_name), "nothing else is left to do");
}

#[test]
fn an_answer_ends_the_transmission_it_answers() {
    let dir = tempfile::tempdir().unwrap();
    let (path, spec) = pty_in(&dir);
    let mut a = Bench::new(&spec);
    // A character lasts 66 ms, the telegram more than a minute: the test would not wait for it.
    a.line.apply(&LineSettings { baud: 150, ..LineSettings::default() }).unwrap();
    assert_eq!(a.event(), up());
    let mut partner = partner(&path);
    assert_eq!(a.line.write(a.now(), &[0x55; 1000]), 1000);
    partner.read_exact(&mut [0; 1000]).unwrap();
    partner.write_all(&[0x10]).unwrap();
    assert_eq!(a.event(), SENT);
    assert_eq!(a.receive(1), [0x10], "behind it");
}

#[test]
fn an_xoff_is_handed_over_before_the_end_of_what_it_stops() {
    let dir = tempfile::tempdir().unwrap();
    let (path, spec) = pty_in(&dir);
    let mut a = Bench::new(&spec);
    a.line.apply(&LineSettings { baud: 150, flow: Flow::XonXoff, ..LineSettings::default() }).unwrap();
    assert!(matches!(a.event(), LineEvent::Up(_)));
    let mut partner = partner(&path);
    assert_eq!(a.line.write(a.now(), &[0x55; 16]), 16);
    partner.read_exact(&mut [0; 16]).unwrap();
    partner.write_all(&[0x13]).unwrap();
    assert_eq!(a.event(), SENT);
    assert_eq!(std::mem::take(&mut a.received), [0x13], "before it");
}

#[test]
fn an_echo_is_found_and_an_answer_that_repeats_the_request_is_heard() {
    // A pty of our own, and that of another program, opened as a device: neither knows TIOCSERGETLSR.
    let dir = tempfile::tempdir().unwrap();
    let (path, spec) = pty_in(&dir);
    let mut a = Bench::new(&spec);
    assert_eq!(a.event(), up());
    echoes_and_answers(a, partner(&path));
    let (mut master, slave) = serialport::TTYPort::pair().unwrap();
    master.set_timeout(PATIENCE).unwrap();
    let spec = format!("serial:{}", slave.name().unwrap());
    let mut a = Bench::new(&spec);
    assert_eq!(a.event(), up());
    echoes_and_answers(a, master);
}

fn echoes_and_answers(mut a: Bench, mut slave: serialport::TTYPort) {
    // The echo has 0.4 s for its way.
    a.line.apply(&LineSettings { baud: 150, half_duplex: true, ..LineSettings::default() }).unwrap();
    assert!(matches!(a.event(), LineEvent::Up(_)));
    let request = [5, 6, 0, 1, 0x12, 0x34, 0xAB, 0xCD];
    for _ in 0..2 {
        let mut heard = [0; 8];
        a.line.write(a.now(), &request);
        assert_eq!(a.event(), SENT, "a slave answers what it has received");
        slave.read_exact(&mut heard).unwrap();
        slave.write_all(&heard).unwrap();
        assert_eq!(a.receive(8), request);
    }
    std::thread::spawn(move || {
        let mut heard = [0; 64];
        while let Ok(count) = slave.read(&mut heard) {
            if slave.write_all(&heard[..count]).is_err() {
                return;
            }
        }
    });
    a.line.write(a.now(), &request);
    let mut events = vec![a.event(), a.event()];
    events.sort_by_key(|event| *event == SENT);
    assert_eq!((events, a.received.len()), (vec![LineEvent::Echo(true), SENT], 0));
}

#[test]
fn a_line_that_cannot_have_parity_says_so() {
    let dir = tempfile::tempdir().unwrap();
    let (path, spec) = pty_in(&dir);
    let mut a = Bench::new(&spec);
    assert_eq!(a.event(), up());
    let mut b = Bench::new(&format!("serial:{}", path.display()));
    let settings = LineSettings { parity: Parity::Even, data_bits: 7, ..LineSettings::default() };
    b.line.apply(&settings).unwrap();
    let LineEvent::Up(warnings) = b.event() else { panic!("it opens all the same") };
    let text = format!("{warnings:?}");
    assert!(text.contains("parity even") && text.contains("data bits 7"), "{text}");

    let one_and_a_half = LineSettings { stop_bits: ob1_line::StopBits::OneAndHalf, ..LineSettings::default() };
    assert!(b.line.apply(&one_and_a_half).is_err());
    assert!(matches!(b.event(), LineEvent::Gone(why) if why.contains("1.5 stop bits")));
    b.line.apply(&LineSettings::default()).unwrap();
    assert_eq!(b.event(), up(), "other settings heal it");
}

#[test]
fn a_partner_that_leaves_and_comes_back_is_no_event_on_a_pty() {
    let dir = tempfile::tempdir().unwrap();
    let (path, spec) = pty_in(&dir);
    let mut a = Bench::new(&spec);
    assert_eq!(a.event(), up());
    for round in 0..3u8 {
        // A foreign program opens the path as a device.
        let mut partner = partner(&path);
        partner.write_all(&[round, 0xFF]).unwrap();
        assert_eq!(a.receive(2), [round, 0xFF]);
        a.line.write(a.now(), &[round]);
        let mut one = [0xAA];
        partner.read_exact(&mut one).unwrap();
        assert_eq!(one, [round]);
        assert_eq!(a.event(), SENT);
        drop(partner);
    }
}

#[test]
fn a_serial_line_survives_the_loss_of_its_device() {
    let dir = tempfile::tempdir().unwrap();
    let (path, spec) = pty_in(&dir);
    let mut b = Bench::new(&format!("serial:{}", path.display()));
    assert!(matches!(b.event(), LineEvent::Gone(why) if why.contains("No such file")), "not there yet");
    for round in 0..2u8 {
        let mut a = Bench::new(&spec);
        assert_eq!(a.event(), up());
        assert_eq!(b.event(), up());
        a.line.write(a.now(), &[round]);
        assert_eq!(b.receive(1), [round]);
        drop(a);
        assert!(matches!(b.event(), LineEvent::Gone(_)));
    }
    // Discarded, and the end comes at the computed time: a protocol does not hang on a lost line.
    b.line.write(b.now(), b"into the void");
    let mut events = vec![b.event()];
    if events[0] != SENT {
        events.push(b.event());
    }
    assert_eq!(events.last(), Some(&SENT));
}

#[test]
fn a_serial_device_belongs_to_one_program() {
    let dir = tempfile::tempdir().unwrap();
    let (path, spec) = pty_in(&dir);
    let mut a = Bench::new(&spec);
    assert_eq!(a.event(), up());
    let mut b = Bench::new(&format!("serial:{}", path.display()));
    assert_eq!(b.event(), up());
    let mut c = Bench::new(&format!("serial:{}", path.display()));
    let LineEvent::Gone(why) = c.event() else { panic!("two programs on one line") };
    assert!(why.contains("lock"), "{why}");
    drop(b);
    assert_eq!(c.event(), up(), "free again");
}

#[test]
fn a_tcp_client_comes_back() {
    let server = TcpListener::bind("127.0.0.1:0").unwrap();
    let mut line = Bench::new(&format!("tcp:127.0.0.1:{}", server.local_addr().unwrap().port()));
    for round in 0..2u8 {
        assert_eq!(line.event(), up());
        let (mut partner, _) = server.accept().unwrap();
        partner.write_all(&[round, 0xFF, 0]).unwrap();
        assert_eq!(line.receive(3), [round, 0xFF, 0]);
        line.line.write(line.now(), b"abc");
        let mut three = [0; 3];
        partner.read_exact(&mut three).unwrap();
        assert_eq!(&three, b"abc");
        assert_eq!(line.event(), SENT);
        drop(partner);
        assert!(matches!(line.event(), LineEvent::Gone(why) if why.contains("closed")));
    }
}

#[test]
fn what_tcp_cannot_carry_is_told_once_until_the_settings_change() {
    let server = TcpListener::bind("127.0.0.1:0").unwrap();
    let mut line = Bench::new(&format!("tcp:127.0.0.1:{}", server.local_addr().unwrap().port()));
    let settings = LineSettings { parity: Parity::Even, ..LineSettings::default() };
    line.line.apply(&settings).unwrap();
    for round in 0..2 {
        let LineEvent::Up(warnings) = line.event() else { panic!("it opens all the same") };
        assert_eq!(warnings.len(), 1 - round);
        line.line.reopen(line.now());
    }
    assert_eq!(line.event(), up());
    for (settings, count) in [(LineSettings::default(), 0), (settings, 1)] {
        line.line.apply(&settings).unwrap();
        let LineEvent::Up(warnings) = line.event() else { panic!("it stays open") };
        assert_eq!(warnings.len(), count);
    }
}

#[test]
fn a_connection_that_is_given_up_is_opened_again_at_its_time() {
    let server = TcpListener::bind("127.0.0.1:0").unwrap();
    let mut line = Bench::new(&format!("tcp:127.0.0.1:{}", server.local_addr().unwrap().port()));
    assert_eq!(line.event(), up());
    let (mut partner, _) = server.accept().unwrap();
    let later = line.now() + 3600 * Span::SECOND;
    line.line.reopen(later);
    assert_eq!(partner.read(&mut [0; 1]).unwrap(), 0, "it is closed");
    assert_eq!((line.line.is_up(), line.line.deadline()), (false, Some(later)));
    assert!(line.line.next_event(line.now(), &mut [0; 16]).is_none());
    line.line.reopen(line.now());
    assert_eq!(line.event(), up());
}

#[test]
fn a_refused_connection_is_told_and_tried_again() {
    let server = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = server.local_addr().unwrap();
    drop(server);
    let mut line = Bench::new(&format!("tcp:localhost:{}", address.port()));
    assert!(matches!(line.event(), LineEvent::Gone(why) if why.contains("refused")));
    // `localhost` may resolve to either address first.
    let server = TcpListener::bind(address).or_else(|_| TcpListener::bind(("::1", address.port()))).unwrap();
    let six = TcpListener::bind(("::1", address.port()));
    assert_eq!(line.event(), up());
    drop((server, six));
}

#[test]
fn a_listener_serves_one_client_at_a_time() {
    let mut line = Bench::new("tcp-listen:0");
    assert!(matches!(line.event(), LineEvent::Gone(why) if why.contains("waiting")));
    let port = {
        // The port the system chose: the only listening socket of this line.
        let mut fds = PollFds::default();
        line.line.poll_fds(&mut fds);
        let entries: Vec<_> = fds.into_entries().collect();
        assert_eq!(entries.len(), 1);
        std::net::SocketAddr::try_from(rustix::net::getsockname(&entries[0]).unwrap()).unwrap().port()
    };
    for round in 0..2u8 {
        let mut partner = TcpStream::connect(("127.0.0.1", port)).unwrap();
        assert_eq!(line.event(), up());
        // A second caller is refused, the first is not disturbed.
        let mut second = TcpStream::connect(("127.0.0.1", port)).unwrap();
        partner.write_all(&[round]).unwrap();
        assert_eq!(line.receive(1), [round]);
        line.line.ready();
        line.line.write(line.now(), b"x");
        let mut one = [0];
        partner.read_exact(&mut one).unwrap();
        assert_eq!(line.event(), SENT);
        assert_eq!(second.read(&mut one).unwrap_or(0), 0, "closed");
        drop(partner);
        assert!(matches!(line.event(), LineEvent::Gone(_)));
    }
}

#[test]
fn modem_lines_are_absent_where_there_are_none() {
    let dir = tempfile::tempdir().unwrap();
    let (_, spec) = pty_in(&dir);
    let mut a = Bench::new(&spec);
    assert_eq!(a.event(), up());
    a.line.set_modem_lines(true, true);
    assert_eq!(a.line.modem_lines(), None);
    // The other end of a pty has none either, as serialport reports.
    let (_master, mut slave) = serialport::TTYPort::pair().unwrap();
    assert!(slave.read_clear_to_send().is_err());
}
