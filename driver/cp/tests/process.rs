//! The process itself: its doorbell, its line, its end. A lock makes the tests serial, because a process is expensive.

#![allow(clippy::disallowed_methods, clippy::disallowed_types)] // real processes have real time

use std::io::{Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::Mutex;
use std::time::{Duration, Instant};

use ob1_backplane::{Counter, CpuSide, CpuState, DriverState, Segment, Stage};
use ob1_time::{Span, WatchedTime};
use rustix::process::{Pid, Resource, Rlimit, Signal, getrlimit, kill_process, prlimit};

static ONE_AT_A_TIME: Mutex<()> = Mutex::new(());

/// ASCII, 115200 8N1, ZVZ 20 ms.
const ASCII: [u8; 16] = [0x0E, 0x01, 0x13, 0, 0, 1, 5, 0, 0, 0, 0, 0, 0, 0, 0, 0];

struct Station {
    cpu: CpuSide,
    segment: Segment,
    line: PathBuf,
    driver: Child,
    bell: Option<ChildStdin>,
    begun: Instant,
    /// A machine that stands still does not end a test.
    watched: WatchedTime,
    _dir: tempfile::TempDir,
}

impl Station {
    fn start() -> Self {
        let dir = tempfile::tempdir().unwrap();
        let line = dir.path().join("line");
        Self::with(&ASCII, "pty", line, dir)
    }

    fn with(parameters: &[u8; 16], kind: &str, line: PathBuf, dir: tempfile::TempDir) -> Self {
        let segment = Segment::create_shared().unwrap();
        let mut cpu = CpuSide::create(&segment, 16).unwrap();
        cpu.set_cpu_state(CpuState::Run);
        let json = format!(r#"{{"module":"cp240","station":"s","name":"cp1","line":"{kind}:{}"}}"#, line.display());
        cpu.write_params(parameters, json.as_bytes()).unwrap();
        let (driver, bell) = spawn(&segment.path().unwrap());
        let watched = WatchedTime::new(ob1_time::Instant::START, Span::SECOND);
        Self { cpu, segment, line, driver, bell: Some(bell), begun: Instant::now(), watched, _dir: dir }
    }

    fn words(&mut self) -> (u16, u16) {
        let mut inputs = [0; 16];
        let _ = self.cpu.read_inputs(&mut inputs);
        (u16::from_be_bytes([inputs[0], inputs[1]]), u16::from_be_bytes([inputs[2], inputs[3]]))
    }

    /// Checks until the condition holds; the time only ends a failed test.
    fn until<T>(&mut self, what: &str, mut look: impl FnMut(&mut Self) -> Option<T>) -> T {
        loop {
            if let Some(found) = look(self) {
                return found;
            }
            let time = self.watched.look(ob1_time::Instant::START + self.begun.elapsed().into());
            assert!(time.since_start() < Span::from_secs(30), "{what}: registers {:04X?}", self.words());
            std::thread::yield_now();
        }
    }

    fn put(&mut self, rx_echo: u16, tx: u16, block: &[u8]) {
        let mut outputs = [0; 16];
        outputs[..2].copy_from_slice(&rx_echo.to_be_bytes());
        outputs[2..4].copy_from_slice(&tx.to_be_bytes());
        outputs[4..4 + block.len()].copy_from_slice(block);
        self.cpu.write_outputs(&outputs);
        if self.cpu.take_doorbell() {
            self.bell.as_mut().unwrap().write_all(&[1]).unwrap();
        }
    }

    fn synchronise(&mut self) -> u16 {
        let number = self.synchronise_without_line();
        self.until("ready", |s| (s.cpu.monitor().driver_state() == Ok(DriverState::Ready)).then_some(()));
        number
    }

    /// Before the line is up.
    fn synchronise_without_line(&mut self) -> u16 {
        let number = self.until("start-up", |s| Some(s.words()).filter(|w| w.0 == 0x8001)).1;
        self.put(0x8001, number, &[]);
        self.until("acknowledged", |s| (s.words() == (0, 0)).then_some(()));
        self.put(0, 0, &[]);
        number
    }

    fn partner(&mut self) -> serialport::TTYPort {
        self.until("pty", |s| s.line.exists().then_some(()));
        serialport::new(self.line.to_string_lossy(), 115_200)
            .exclusive(false)
            .timeout(Duration::from_secs(120))
            .open_native()
            .unwrap()
    }

    fn pid(&self) -> Pid {
        Pid::from_child(&self.driver)
    }

    /// Does what FC 0 does.
    fn send(&mut self, telegram: &[u8]) {
        for (n, block) in telegram.chunks(12).enumerate() {
            let rest = (telegram.len() - 12 * n) as u16;
            self.put(0, rest, block);
            self.until("echo", |s| (s.words().1 == rest).then_some(()));
        }
        self.put(0, 0, &[]);
    }

    /// Does what FC 1 does.
    fn receive(&mut self) -> Vec<u8> {
        let mut telegram = Vec::new();
        let mut rest = self.until("telegram", |s| Some(s.words().0).filter(|rx| *rx != 0));
        while rest != 0 {
            let mut inputs = [0; 16];
            let _ = self.cpu.read_inputs(&mut inputs);
            telegram.extend_from_slice(&inputs[4..4 + usize::from(rest).min(12)]);
            self.put(rest, 0, &[]);
            rest = self.until("next block", |s| Some(s.words().0).filter(|rx| *rx != rest));
        }
        self.put(0, 0, &[]);
        telegram
    }

    /// A short telegram to the partner and one back.
    fn exchange(&mut self, partner: &mut serialport::TTYPort) {
        self.send(b"ping");
        let mut ping = [0; 4];
        partner.read_exact(&mut ping).unwrap();
        assert_eq!(&ping, b"ping");
        self.until("done", |s| (s.words().1 == 0).then_some(()));
        partner.write_all(b"pong\xFF").unwrap();
        assert_eq!(self.receive(), b"pong\xFF");
    }
}

impl Drop for Station {
    fn drop(&mut self) {
        let _ = self.driver.kill();
        let _ = self.driver.wait();
    }
}

fn spawn(segment: &Path) -> (Child, ChildStdin) {
    let mut driver = Command::new(env!("CARGO_BIN_EXE_ob1-cp"))
        .arg("--segment")
        .arg(segment)
        .stdin(Stdio::piped())
        .stdout(Stdio::null())
        .env("OB1_LOG", "off")
        .spawn()
        .unwrap();
    let bell = driver.stdin.take().unwrap();
    (driver, bell)
}

fn lock() -> std::sync::MutexGuard<'static, ()> {
    ONE_AT_A_TIME.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
}

#[test]
fn telegrams_pass_and_the_end_of_the_doorbell_ends_it() {
    let _one = lock();
    let mut station = Station::start();
    station.synchronise();
    let mut partner = station.partner();
    for _ in 0..20 {
        station.exchange(&mut partner);
    }
    // Ctrl-C of the terminal goes to all processes; the runtime decides.
    kill_process(station.pid(), Signal::INT).unwrap();
    station.exchange(&mut partner);
    station.bell = None;
    assert_eq!(station.driver.wait().unwrap().code(), Some(0));
    assert!(station.line.symlink_metadata().is_err(), "the pty's path is removed");
}

#[test]
fn an_order_and_a_telegram_say_where_their_time_went() {
    let _one = lock();
    let mut station = Station::start();
    let monotonic = || {
        let now = rustix::time::clock_gettime(rustix::time::ClockId::Monotonic);
        now.tv_sec.unsigned_abs() * 1_000_000_000 + now.tv_nsec.unsigned_abs()
    };
    let origin = monotonic();
    station.cpu.set_origin(origin);
    station.synchronise();
    let mut partner = station.partner();
    station.cpu.begin_scan(monotonic() - origin);
    station.exchange(&mut partner);
    let mut said = Vec::new();
    // The scan that could see both begins after they were given.
    station.until("both are seen", |s| {
        s.cpu.begin_scan(monotonic() - origin);
        s.cpu.end_scan(monotonic() - origin, |times| said.push(*times));
        (said.len() == 2).then_some(())
    });
    let order: Vec<u64> = Stage::ALL.into_iter().filter_map(|stage| said[0].at(stage)).collect();
    assert!(said[0].is_order && said[0].bytes == 4 && order.len() >= 6, "{said:?}");
    assert!(order.is_sorted() && order[0] > origin, "{said:?}");
    let telegram = [Stage::FirstIn, Stage::LastIn, Stage::Given, Stage::Seen].map(|stage| said[1].at(stage));
    assert!(!said[1].is_order && telegram.iter().all(Option::is_some) && telegram.is_sorted(), "{said:?}");
    let known: Vec<Stage> = station.cpu.monitor().spreads().map(|spread| spread.stage).collect();
    assert!(known.contains(&Stage::Taken) && known.contains(&Stage::Seen), "{known:?}");
}

#[test]
fn two_drivers_speak_3964r_over_a_null_modem() {
    let _one = lock();
    let mut parameters = [0x0E, 0x04, 0x13, 0, 0, 10, 25, 100, 5, 6, 0, 0, 0, 0, 0, 0];
    let dir = tempfile::tempdir().unwrap();
    let line = dir.path().join("line");
    let mut a = Station::with(&parameters, "pty", line.clone(), dir);
    a.synchronise();
    parameters[10] = 1;
    let mut b = Station::with(&parameters, "serial", line, tempfile::tempdir().unwrap());
    b.synchronise();
    for length in [1, 12, 13, 250] {
        // It contains every control character.
        let telegram: Vec<u8> = (0..length).map(|i| (i * 3) as u8).collect();
        a.send(&telegram);
        assert_eq!(b.receive(), telegram);
        a.until("done", |s| (s.words().1 == 0).then_some(()));
        b.send(&telegram);
        assert_eq!(a.receive(), telegram);
        b.until("done", |s| (s.words().1 == 0).then_some(()));
    }
    let (a, b) = (a.cpu.monitor().counters(), b.cpu.monitor().counters());
    for counters in [a, b] {
        assert_eq!(counters.get(Counter::TelegramsSent), 4);
        assert_eq!(counters.get(Counter::TelegramsDelivered), 4);
        assert_eq!(counters.get(Counter::SendErrors), 0);
    }
}

/// The system holds the driver up for longer than QVZ, while the answer comes in.
/// Modbus RTU, function 06, whose answer repeats its request.
#[test]
fn an_adapter_that_echoes_is_no_slave() {
    let _one = lock();
    let keys = [("protocol", "modbus-master-rtu".into()), ("baud", 2400.into()), ("wait_ms", 200.into())];
    let parameters = ob1_params::Cp240::from_keys(keys).unwrap().encode();
    for echoes in [true, false] {
        let dir = tempfile::tempdir().unwrap();
        let line = dir.path().join("line");
        let mut station = Station::with(&parameters, "pty", line, dir);
        // Modbus has no start-up to acknowledge.
        station.until("ready", |s| (s.cpu.monitor().driver_state() == Ok(DriverState::Ready)).then_some(()));
        let mut partner = station.partner();
        std::thread::spawn(move || {
            let mut heard = [0; 8];
            loop {
                // An adapter gives back what it has, a slave what is whole.
                let count = if echoes { partner.read(&mut heard) } else { partner.read_exact(&mut heard).map(|()| 8) };
                let Ok(count) = count else { return };
                if partner.write_all(&heard[..count]).is_err() {
                    return;
                }
            }
        });
        // A machine that stands still for 25 ms may hold the first echo back until it looks like an answer.
        let mut ends = Vec::new();
        for _ in 0..4 {
            station.send(&[5, 6, 0, 1, 0x12, 0x34]);
            let end = station.until("an end", |s| Some(s.words().1).filter(|tx| *tx == 0 || tx & 0xFF == 0x07));
            ends.push(end);
            // The answer, or why there is none; then the error is acknowledged.
            station.receive();
            station.put(0, end & 0x2000, &[]);
            station.until("acknowledged", |s| (s.words().1 == 0).then_some(()));
            station.put(0, 0, &[]);
        }
        let failed = ends.iter().filter(|end| **end != 0).count();
        if echoes {
            assert!(failed > 1, "{ends:04X?}");
            let text = station.cpu.read_diagnosis().unwrap();
            assert_eq!(std::str::from_utf8(text.data()), Ok(ob1_line::ECHOES));
        } else {
            assert_eq!(failed, 0, "{ends:04X?}");
        }
    }
}

#[test]
fn an_answer_in_time_counts_for_a_driver_that_comes_late() {
    let _one = lock();
    let qvz = Duration::from_secs(2);
    let parameters = [0x0E, 0x04, 0x13, 0, 0, 10, 100, 100, 5, 6, 0, 0, 0, 0, 0, 0];
    let dir = tempfile::tempdir().unwrap();
    let line = dir.path().join("line");
    let mut station = Station::with(&parameters, "pty", line, dir);
    station.synchronise();
    let mut partner = station.partner();
    station.put(0, 1, b"1");
    station.until("echo", |s| (s.words().1 == 1).then_some(()));
    station.put(0, 0, &[]);
    // Answered while it is held up: STX, then the block.
    for out in [[0x02].as_slice(), &[b'1', 0x10, 0x03, 0x22]] {
        let mut read = vec![0; out.len()];
        partner.read_exact(&mut read).unwrap();
        assert_eq!(read, out);
        kill_process(station.pid(), Signal::STOP).unwrap();
        let stopped = Instant::now();
        partner.write_all(&[0x10]).unwrap();
        station.until("QVZ is over", |_| (stopped.elapsed() > qvz + qvz / 10).then_some(()));
        kill_process(station.pid(), Signal::CONT).unwrap();
    }
    station.until("done", |s| (s.words().1 == 0).then_some(()));
    let counters = station.cpu.monitor().counters();
    assert_eq!((counters.get(Counter::TelegramsSent), counters.get(Counter::SendErrors)), (1, 0));
    // Nothing was repeated.
    assert_eq!(serialport::SerialPort::bytes_to_read(&partner).unwrap(), 0);
}

#[test]
fn a_killed_driver_is_followed_by_another_on_the_same_path() {
    let _one = lock();
    let mut station = Station::start();
    let mut numbers = Vec::new();
    for _ in 0..3 {
        numbers.push(station.synchronise());
        let mut partner = station.partner();
        station.exchange(&mut partner);
        station.driver.kill().unwrap();
        station.driver.wait().unwrap();
        assert!(station.line.symlink_metadata().is_ok(), "nobody could remove it");
        station.cpu.monitor().driver_gone();
        let (driver, bell) = spawn(&station.segment.path().unwrap());
        (station.driver, station.bell) = (driver, Some(bell));
    }
    numbers.dedup();
    assert_eq!(numbers.len(), 3, "each start-up has a number of its own: {numbers:04X?}");
    station.bell = None;
    assert_eq!(station.driver.wait().unwrap().code(), Some(0));
    assert!(station.line.symlink_metadata().is_err());
}

#[test]
fn sigterm_ends_it_in_order() {
    let _one = lock();
    let mut station = Station::start();
    station.synchronise();
    kill_process(station.pid(), Signal::TERM).unwrap();
    assert_eq!(station.driver.wait().unwrap().code(), Some(0));
    assert!(station.line.symlink_metadata().is_err());
}

#[test]
fn a_line_that_cannot_be_opened_is_a_state_and_heals() {
    let _one = lock();
    let mut station = Station::start();
    station.synchronise();
    let device = station.line.with_file_name("device");
    let json = format!(r#"{{"module":"cp240","line":"serial:{}"}}"#, device.display());
    station.cpu.write_params(&ASCII, json.as_bytes()).unwrap();
    station.until("line error", |s| {
        if s.cpu.take_doorbell() {
            s.bell.as_mut().unwrap().write_all(&[1]).unwrap();
        }
        (s.cpu.monitor().driver_state() == Ok(DriverState::LineError(2))).then_some(())
    });
    let text = station.cpu.read_diagnosis().unwrap();
    assert!(String::from_utf8_lossy(text.data()).contains("No such file"), "{text:?}");
    // A pty replaces the missing device.
    let (_master, slave) = serialport::TTYPort::pair().unwrap();
    std::os::unix::fs::symlink(serialport::SerialPort::name(&slave).unwrap(), &device).unwrap();
    station.until("back", |s| (s.cpu.monitor().driver_state() == Ok(DriverState::Ready)).then_some(()));
}

/// A device that exists under `path` until its master is dropped.
fn plug_in(path: &Path) -> (serialport::TTYPort, serialport::TTYPort) {
    let _ = std::fs::remove_file(path);
    let (mut master, slave) = serialport::TTYPort::pair().unwrap();
    serialport::SerialPort::set_timeout(&mut master, Duration::from_secs(120)).unwrap();
    std::os::unix::fs::symlink(serialport::SerialPort::name(&slave).unwrap(), path).unwrap();
    (master, slave)
}

#[test]
fn a_device_that_disappears_is_an_error_that_heals_when_it_returns() {
    let _one = lock();
    let dir = tempfile::tempdir().unwrap();
    let device = dir.path().join("ttyUSB0");
    let mut station = Station::with(&ASCII, "serial", device.clone(), dir);
    // After the driver has started: it must not inherit the other end.
    let mut plugged = plug_in(&device);
    station.synchronise();
    station.until("ready", |s| (s.cpu.monitor().driver_state() == Ok(DriverState::Ready)).then_some(()));
    for round in 1..=3 {
        plugged.0.write_all(b"pong").unwrap();
        assert_eq!(station.receive(), b"pong", "round {round}");
        station.until("no ER", |s| (!s.cpu.monitor().leds().error).then_some(()));
        // The adapter is pulled out: the kernel removes the device, and open descriptors read an error.
        std::fs::remove_file(&device).unwrap();
        drop(plugged);
        station.until("line error", |s| {
            matches!(s.cpu.monitor().driver_state(), Ok(DriverState::LineError(_))).then_some(())
        });
        station.until("ER", |s| s.cpu.monitor().leds().error.then_some(()));
        let text = station.cpu.read_diagnosis().unwrap();
        assert!(!text.data().is_empty(), "why, for whoever asks");
        // A telegram for a missing line ends with an error, it is not discarded.
        if round == 3 {
            station.put(0, 4, b"lost");
            station.until("echo", |s| (s.words().1 == 4).then_some(()));
            station.put(0, 0, &[]);
            station.until("0Ch", |s| (s.words().1 & 0xFF == 0x0C).then_some(()));
            assert_eq!(station.cpu.monitor().counters().get(Counter::SendErrors), 1);
        }
        plugged = plug_in(&device);
        station.until("back", |s| (s.cpu.monitor().driver_state() == Ok(DriverState::Ready)).then_some(()));
        // The counters follow the state. The line may have been missing at the start, too.
        station.until("one fault and one restart each", |s| {
            let counters = s.cpu.monitor().counters();
            let (faults, restarts) = (counters.get(Counter::LineFaults), counters.get(Counter::LineRestarts));
            (faults == restarts && (round..=round + 1).contains(&faults)).then_some(())
        });
    }
    plugged.0.write_all(b"pong").unwrap();
    assert_eq!(station.receive(), b"pong");
    let mut codes = Vec::new();
    while let Some(event) = station.cpu.poll_event().unwrap() {
        codes.push(event.code);
    }
    // Entries of the diagnostic buffer: gone (4) and up (5), in turns.
    codes.retain(|code| [4, 5].contains(code));
    codes.drain(..codes.len().saturating_sub(6));
    assert_eq!(codes, [4, 5, 4, 5, 4, 5]);
}

/// The line is taken, and the driver has no descriptor left to refuse a caller with.
#[test]
fn a_caller_who_cannot_be_refused_does_not_keep_the_driver_awake() {
    use std::net::{TcpListener, TcpStream};
    let _one = lock();
    let port = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
    let dir = tempfile::tempdir().unwrap();
    let mut station = Station::with(&ASCII, "tcp-listen", PathBuf::from(port.to_string()), dir);
    station.synchronise_without_line();
    let _partner = station.until("listening", |_| TcpStream::connect(("127.0.0.1", port)).ok());
    station.until("ready", |s| (s.cpu.monitor().driver_state() == Ok(DriverState::Ready)).then_some(()));
    let process = PathBuf::from(format!("/proc/{}", station.driver.id()));
    let free = (0..).find(|number: &u64| process.join(format!("fd/{number}")).symlink_metadata().is_err());
    let limit = Rlimit { current: free, ..getrlimit(Resource::Nofile) };
    prlimit(Some(station.pid()), Resource::Nofile, limit).unwrap();
    let _caller = TcpStream::connect(("127.0.0.1", port)).unwrap();
    let ran = || {
        let text = std::fs::read_to_string(process.join("schedstat")).unwrap();
        Duration::from_nanos(text.split_whitespace().next().unwrap().parse().unwrap())
    };
    let (begun, before) = (Instant::now(), ran());
    let beats = station.cpu.monitor().cp_heartbeat();
    station.until("20 signs of life", |s| (s.cpu.monitor().cp_heartbeat() >= beats + 20).then_some(()));
    let (ran, whole) = (ran() - before, begun.elapsed());
    // One that runs in circles gets more, however many others want the core.
    assert!(ran < whole / 20, "{ran:?} of {whole:?}");
}

#[test]
fn what_is_no_segment_is_refused() {
    let _one = lock();
    let file = tempfile::NamedTempFile::new().unwrap();
    for path in [file.path(), Path::new("/nowhere")] {
        let (mut driver, _bell) = spawn(path);
        assert_eq!(driver.wait().unwrap().code(), Some(1));
    }
    let status = Command::new(env!("CARGO_BIN_EXE_ob1-cp")).stderr(Stdio::null()).status().unwrap();
    assert_eq!(status.code(), Some(2), "no arguments");
}

#[test]
fn a_partner_that_floods_the_line_does_not_keep_the_driver_from_its_heartbeat_or_its_end() {
    use std::net::{TcpListener, TcpStream};
    let _lock = lock();
    let port = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
    let dir = tempfile::tempdir().unwrap();
    let mut station = Station::with(&ASCII, "tcp-listen", PathBuf::from(port.to_string()), dir);
    station.synchronise_without_line();
    let mut partner = station.until("listening", |_| TcpStream::connect(("127.0.0.1", port)).ok());
    let flood = std::thread::spawn(move || {
        let noise = [0x55; 1 << 16];
        // Until the line is closed.
        while partner.write_all(&noise).is_ok() {}
    });
    let received = |s: &Station| s.cpu.monitor().counters().get(Counter::BytesRx);
    station.until("the flood", |s| (received(s) > 1 << 16).then_some(()));
    let beats = station.cpu.monitor().cp_heartbeat();
    let from = received(&station);
    station.until("ten signs of life", |s| (s.cpu.monitor().cp_heartbeat() >= beats + 10).then_some(()));
    assert!(received(&station) > from, "it was at work all the time");
    station.bell = None;
    station.until("its end", |s| s.driver.try_wait().unwrap());
    flood.join().unwrap();
}
