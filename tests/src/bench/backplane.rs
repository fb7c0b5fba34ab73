//! The back plane alone: a round trip of sixteen bytes between two spinning processes, compared with a round trip of
//! one word; a round trip to a driver that sleeps, compared with a bare eventfd.

use std::io::Write as _;
use std::path::Path;
use std::time::{Duration, Instant};

use ob1_backplane::{CpSide, CpuSide, OrderTimes, Segment, Stage};
use rustix::event::{PollFd, PollFlags, poll};
use rustix::time::{ClockId, clock_gettime};

use super::peer::{Failure, Peer, Words};
use super::{Figure, in_turns, median};

pub(super) const ROUND_TRIPS: u64 = 20_000;
pub(super) const ROUNDS: usize = 31;

/// The peer's side of the registers: writes back what it reads.
///
/// # Errors
/// If the segment cannot be attached.
pub fn answer_registers(path: &Path) -> Result<(), Failure> {
    let mut side = CpSide::attach(&Segment::open(path)?)?;
    let mut registers = [0u8; 16];
    loop {
        if side.outputs_changed() {
            let _ = side.read_outputs(&mut registers);
            side.write_inputs(&registers);
        } else {
            std::hint::spin_loop();
        }
    }
}

/// The same with the times of an order at every exchange, more often than any CP has orders.
///
/// # Errors
/// If the segment cannot be attached.
pub fn answer_timed(path: &Path) -> Result<(), Failure> {
    let mut side = CpSide::attach(&Segment::open(path)?)?;
    let mut registers = [0u8; 16];
    loop {
        if side.outputs_changed() {
            let _ = side.read_outputs(&mut registers);
            side.write_inputs(&registers);
            let mut times = OrderTimes::new(true, registers.len());
            times.say(Stage::Posted, side.posted());
            let now = clock_gettime(ClockId::Monotonic);
            let now = now.tv_sec.unsigned_abs() * 1_000_000_000 + now.tv_nsec.unsigned_abs();
            [Stage::Taken, Stage::Given].into_iter().for_each(|stage| times.say(stage, now));
            side.enter_times(times);
        } else {
            std::hint::spin_loop();
        }
    }
}

/// What the times of orders cost: an exchange while they are kept, against one without, in turns; and, without an aim,
/// one in which every exchange is an order, with an entry each time.
///
/// # Errors
/// If a segment or a process cannot be created.
pub fn measure_times() -> Result<[Figure; 2], Failure> {
    let (plain, told) = (Segment::create_shared()?, Segment::create_shared()?);
    let (mut plain_side, mut told_side) = (CpuSide::create(&plain, 16)?, CpuSide::create(&told, 16)?);
    told_side.set_origin(0);
    let (mut plain_serial, mut told_serial) = (0u64, 0u64);
    let mut with_times = || {
        // The scan's own times: it has them already.
        told_side.begin_scan(told_serial + 1);
        round_trip(&mut told_side, &mut told_serial);
        told_side.end_scan(told_serial + 1, |_| ());
    };
    let mut without_times = || round_trip(&mut plain_side, &mut plain_serial);
    let mut compare = |role: &str| {
        let with = || timed(&told, role, &mut with_times);
        in_turns(ROUNDS, with, || timed(&plain, "registers", &mut without_times))
    };
    let (kept, without) = compare("registers")?;
    let (entered, bare) = compare("timed")?;
    let figure = |what: &'static str, value, floor, aim| Figure {
        what: what.into(),
        value,
        unit: "ns",
        floor: Some(("without times of orders", floor)),
        aim,
    };
    Ok([
        figure("the same with times of orders", kept, without, ("<= 1.03 x floor", kept <= 1.03 * without)),
        figure("the same, an order with each", entered, bare, ("", true)),
    ])
}

/// The peer's side of the word.
///
/// # Errors
/// If the segment cannot be opened.
pub fn answer_word(path: &Path) -> Result<(), Failure> {
    let segment = Segment::open(path)?;
    let words = Words::of(&segment)?;
    loop {
        words.answer();
        std::hint::spin_loop();
    }
}

/// The peer's side of a driver that sleeps as docs/backplane.md says.
///
/// # Errors
/// If the segment cannot be attached or the doorbell fails.
pub fn answer_asleep(path: &Path) -> Result<(), Failure> {
    let mut side = CpSide::attach(&Segment::open(path)?)?;
    let (stdin, mut registers, mut bytes) = (rustix::stdio::stdin(), [0u8; 16], [0u8; 64]);
    loop {
        let mark = side.changes();
        if side.outputs_changed() {
            let _ = side.read_outputs(&mut registers);
            side.write_inputs(&registers);
        }
        if side.prepare_sleep(mark) {
            poll(&mut [PollFd::new(&stdin, PollFlags::IN)], None)?;
            if rustix::io::read(stdin, &mut bytes)? == 0 {
                return Ok(());
            }
        }
        side.awake();
    }
}

/// The peer's side of a bare eventfd, its standard input: it sleeps in a read, and answers in the word.
///
/// # Errors
/// If the segment cannot be opened.
pub fn answer_eventfd(path: &Path) -> Result<(), Failure> {
    let segment = Segment::open(path)?;
    let words = Words::of(&segment)?;
    let mut count = [0u8; 8];
    loop {
        rustix::io::read(rustix::stdio::stdin(), &mut count)?;
        words.answer();
    }
}

/// Time for the other side to fall asleep before it is woken.
const NAP: Duration = Duration::from_micros(150);
/// Round trips to a side that sleeps, in a round.
const WAKES: u32 = 300;

/// The mean time of `trip`, to a side that has fallen asleep.
pub(super) fn asleep(mut trip: impl FnMut() -> Result<(), Failure>) -> Result<f64, Failure> {
    let mut total = Duration::ZERO;
    for _ in 0..WAKES {
        let start = Instant::now();
        while start.elapsed() < NAP {
            std::hint::spin_loop();
        }
        let start = Instant::now();
        trip()?;
        total += start.elapsed();
    }
    Ok(total.as_nanos() as f64 / f64::from(WAKES))
}

/// A driver that sleeps beside a bare eventfd: the answer is a word, on which this side spins.
///
/// # Errors
/// If a segment or a process cannot be created.
pub fn measure_asleep() -> Result<Figure, Failure> {
    let registers = Segment::create_shared()?;
    let mut cpu = CpuSide::create(&registers, 16)?;
    let word = Segment::create_shared()?;
    let words = Words::of(&word)?;
    let mut driver = Peer::start("asleep", &registers)?;
    let bell = driver.stdin().ok_or("no pipe")?;
    let eventfd = rustix::event::eventfd(0, rustix::event::EventfdFlags::CLOEXEC)?;
    let _bare = Peer::start_with("eventfd", &word, eventfd.try_clone()?)?;
    let (mut serial, mut of_registers, mut of_eventfd) = (0u64, Vec::new(), Vec::new());
    for _ in 0..ROUNDS {
        of_registers.push(asleep(|| {
            serial += 1;
            let mut registers = [0u8; 16];
            registers.as_chunks_mut().0.fill(serial.to_ne_bytes());
            cpu.write_outputs(&registers);
            if cpu.take_doorbell() {
                bell.write_all(&[1])?;
            }
            wait_for(&mut cpu, serial);
            Ok(())
        })?);
        of_eventfd.push(asleep(|| {
            words.call();
            rustix::io::write(&eventfd, &1u64.to_ne_bytes())?;
            words.wait();
            Ok(())
        })?);
    }
    let [value, bare] = [&mut of_registers, &mut of_eventfd].map(|of| median(of));
    Ok(Figure {
        what: "back plane round trip, 16 bytes, driver asleep".into(),
        value,
        unit: "ns",
        floor: Some(("bare eventfd wake-up, word back", bare)),
        aim: ("<= 1.05 x floor", value <= 1.05 * bare),
    })
}

/// One round trip of sixteen bytes.
pub(super) fn round_trip(cpu: &mut CpuSide, serial: &mut u64) {
    *serial += 1;
    // Word by word: sixteen bytes compared at once would wait for the two words just stored.
    let mut registers = [0u8; 16];
    registers.as_chunks_mut().0.fill(serial.to_ne_bytes());
    cpu.write_outputs(&registers);
    wait_for(cpu, *serial);
}

/// Spins until both words are this one.
fn wait_for(cpu: &mut CpuSide, serial: u64) {
    let mut registers = [0u8; 16];
    loop {
        if cpu.inputs_changed() {
            let _ = cpu.read_inputs(&mut registers);
            if registers.as_chunks().0.iter().all(|word| u64::from_ne_bytes(*word) == serial) {
                break;
            }
        }
        std::hint::spin_loop();
    }
}

/// Runs the measurement.
///
/// # Errors
/// If a segment or a process cannot be created.
pub fn measure() -> Result<Figure, Failure> {
    let registers = Segment::create_shared()?;
    let mut cpu = CpuSide::create(&registers, 16)?;
    let word = Segment::create_shared()?;
    let words = Words::of(&word)?;

    let mut serial = 0u64;
    let mut through_registers = || round_trip(&mut cpu, &mut serial);
    let (registers, word) = in_turns(
        ROUNDS,
        || timed(&registers, "registers", &mut through_registers),
        || timed(&word, "word", || words.round_trip()),
    )?;
    Ok(Figure {
        what: "back plane round trip, 16 bytes, both spin".into(),
        value: registers,
        unit: "ns",
        floor: Some(("one word between two processes", word)),
        aim: ("<= 1.5 x floor", registers <= 1.5 * word),
    })
}

/// One round: a new peer, one round trip until it is running, then many.
pub(super) fn timed(segment: &Segment, role: &str, mut round_trip: impl FnMut()) -> Result<f64, Failure> {
    let _peer = Peer::start(role, segment)?;
    round_trip();
    let start = Instant::now();
    for _ in 0..ROUND_TRIPS {
        round_trip();
    }
    Ok(start.elapsed().as_nanos() as f64 / ROUND_TRIPS as f64)
}
