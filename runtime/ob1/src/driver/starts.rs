//! What a driver finds when it starts, and how it comes to work.

use std::os::fd::{AsFd as _, OwnedFd};

use ob1_backplane::layout::{SEGMENT_BYTES, SEGMENT_BYTES_BOXES};
use ob1_backplane::{Counter, CpuState};
use ob1_host::supervisor::Exit;
use ob1_time::Span;
use ob1_words::cp240::STARTUP;
use rustix::fs::{MemfdFlags, SealFlags, fcntl_add_seals, ftruncate, memfd_create};

use super::rig::{Breach, Checked, Rig, WHILE};
use super::rules::Rule;
use super::watch::{sequences, set, word};

/// One way to start.
pub(super) type Start = fn(&mut Rig<'_>) -> Checked;

/// All of them, with what the report calls them.
pub(super) const STARTS: [(&str, Start); 6] = [
    ("parameters are there", ready),
    ("parameters come later", later),
    ("a predecessor has died in the middle of everything", haunted),
    ("the ring is full of a predecessor's events", full_ring),
    ("the header is damaged", damaged),
    ("the file is no segment", no_segment),
];

/// Works when it returns.
fn ready(rig: &mut Rig<'_>) -> Checked {
    rig.state(CpuState::Run)?;
    rig.parameters()?;
    rig.start(|_| Ok(()))?;
    rig.synchronise(Rule::Identifier)
}

fn later(rig: &mut Rig<'_>) -> Checked {
    rig.start(|_| Ok(()))?;
    rig.until_state(Rule::NoParameters, 2)?;
    let what = "the registers are not 0, or the state is another";
    rig.hold(Rule::NoParameters, what, |rig| rig.inputs() == [0; 16] && word(&rig.segment, "cp.state", 0) as u32 == 2)?;
    rig.step("the first parameters");
    rig.state(CpuState::Run)?;
    rig.parameters()?;
    rig.synchronise(Rule::Identifier)
}

/// A word that no driver writes by itself.
const GHOST: u64 = 0xEEDD_CCBB_AA99_8877;

/// How long after its attaching a sequence may be odd, because the driver writes.
const ENDED: Span = Span::from_millis(500);

/// Open orders, open telegrams and starts of the predecessor.
const OPEN: (u64, u64, u64) = (3, 2, 7);

fn haunted(rig: &mut Rig<'_>) -> Checked {
    let segment = rig.segment.clone();
    for name in sequences() {
        let odd = rig.rng.u64(..1000) * 2 + 1;
        set(&segment, name, 0, if rig.rng.bool() { odd } else { odd + 1 });
    }
    for name in ["inputs.data", "send_to_cpu.data", "receive_to_cpu.data"] {
        (0..8).for_each(|index| set(&segment, name, index, GHOST));
    }
    set(&segment, "diagnosis.number", 0, 0xDEAD);
    set(&segment, "diagnosis.length", 0, 240);
    for name in ["cp.leds", "cp.modem_inputs", "cp.reason"] {
        set(&segment, name, 0, GHOST);
    }
    for name in ["cp.state", "cp.heartbeat", "doorbell.sleeping"] {
        set(&segment, name, 0, 1);
    }
    let generation = if rig.rng.u8(..4) == 0 { u64::MAX } else { rig.rng.u64(1..1 << 32) };
    set(&segment, "cp.generation", 0, generation);
    let counters = [
        (Counter::OrdersAccepted, 20 + OPEN.0),
        (Counter::TelegramsSent, 11),
        (Counter::SendErrors, 4),
        (Counter::OrdersAborted, 3),
        (Counter::OrdersLost, 2),
        (Counter::TelegramsReceived, 30 + OPEN.1),
        (Counter::TelegramsDelivered, 15),
        (Counter::ReceiveAborted, 8),
        (Counter::ReceiveLost, 7),
        (Counter::DriverStarts, OPEN.2),
    ];
    counters.iter().for_each(|(counter, n)| set(&segment, "counters", *counter as usize, *n));
    let entries = rig.rng.u64(1..200);
    set(&segment, "buffer.written", 0, entries);
    (0..65).for_each(|index| set(&segment, "buffer.entries", index, (index as u64) << 18 | 1 << 17 | 0x0801));
    let impossible = rig.rng.bool();
    let produced = if impossible { 65 + rig.rng.u64(..1000) } else { 3 };
    set(&segment, "events.produced", 0, produced);
    (0..3).for_each(|index| set(&segment, "events.slots", 4 * index + 1, 6 | (0x700 + index as u64) << 32));
    rig.watch.forget();
    let entered = rig.watch.words_of("buffer.entries");
    rig.start(|rig| {
        is_clear(rig)?;
        is_booked(rig)?;
        let produced = word(&rig.segment, "events.produced", 0);
        if impossible && produced > 64 {
            return Breach::of(Rule::RepairsRing, format!("produced is {produced}, consumed 0"));
        }
        if !impossible && produced < 3 {
            return Breach::of(Rule::KeepsEvents, format!("produced was 3 and is {produced}"));
        }
        Ok(())
    })?;
    for name in sequences() {
        rig.until(Rule::EndsWrites, ENDED, format!("{name} stays odd"), |rig| {
            word(&rig.segment, name, 0).is_multiple_of(2).then_some(())
        })?;
    }
    // Without parameters a driver has nothing of its own to show: what it has not cleared is still there.
    rig.until_state(Rule::NoParameters, 2)?;
    is_clear(rig)?;
    rig.step("parameters after a predecessor that has died");
    rig.state(CpuState::Run)?;
    rig.parameters()?;
    rig.synchronise(Rule::Identifier)?;
    keeps_buffer(rig, entries, &entered)?;
    let events = rig.events()?;
    let first: Vec<u32> = events.iter().take(3).map(|event| event.code).collect();
    if !impossible && first != [0x700, 0x701, 0x702] {
        return Breach::of(Rule::KeepsEvents, format!("the first events are {first:X?}"));
    }
    let starts = word(&rig.segment, "counters", Counter::DriverStarts as usize);
    if starts != OPEN.2 + 1 {
        return Breach::of(Rule::CountsStart, format!("counter 15 was {} and is {starts}", OPEN.2));
    }
    Ok(())
}

/// Nothing of the predecessor is there when the generation has changed.
fn is_clear(rig: &mut Rig<'_>) -> Checked {
    let segment = &rig.segment;
    if (0..2).any(|index| word(segment, "inputs.data", index) == GHOST) {
        return Breach::of(Rule::ClearsInputs, "the registers hold those of the predecessor");
    }
    for name in ["send_to_cpu.data", "receive_to_cpu.data"] {
        if (0..8).any(|index| word(segment, name, index) == GHOST) {
            return Breach::of(Rule::ClearsChannels, format!("{name} holds that of the predecessor"));
        }
    }
    let (number, length) = (word(segment, "diagnosis.number", 0), word(segment, "diagnosis.length", 0));
    if number == 0xDEAD || length == 240 {
        return Breach::of(Rule::ClearsRecord, format!("record {number:X}h, {length} bytes"));
    }
    for name in ["cp.leds", "cp.modem_inputs", "cp.reason"] {
        if word(segment, name, 0) == GHOST {
            return Breach::of(Rule::ClearsState, format!("{name} is that of the predecessor"));
        }
    }
    Ok(())
}

/// What the predecessor had in its buffers is counted as lost, and the start is counted.
fn is_booked(rig: &mut Rig<'_>) -> Checked {
    let of = |counter: Counter| word(&rig.segment, "counters", counter as usize);
    let (orders, telegrams) = (of(Counter::OrdersLost), of(Counter::ReceiveLost));
    if (orders, telegrams) != (2 + OPEN.0, 7 + OPEN.1) {
        let text = format!("2 and 7 with {} and {} open became {orders} and {telegrams}", OPEN.0, OPEN.1);
        return Breach::of(Rule::BooksLost, text);
    }
    let starts = of(Counter::DriverStarts);
    if starts != OPEN.2 + 1 {
        return Breach::of(Rule::CountsStart, format!("counter 15 was {} and is {starts}", OPEN.2));
    }
    Ok(())
}

/// Entries that were not overwritten by newer ones are those of the predecessor.
fn keeps_buffer(rig: &mut Rig<'_>, before: u64, entered: &[u64]) -> Checked {
    let written = word(&rig.segment, "buffer.written", 0);
    let now = rig.watch.words_of("buffer.entries");
    let new = written.wrapping_sub(before);
    let is_new = |index: usize| (0..new.min(65)).any(|n| ((before + n) % 65) as usize == index);
    let changed = (0..65).find(|index| now[*index] != entered[*index] && !is_new(*index));
    match changed {
        Some(index) => Breach::of(Rule::KeepsBuffer, format!("slot {index} has changed, {new} entries are new")),
        None if new > 65 => Breach::of(Rule::KeepsBuffer, format!("written was {before} and is {written}")),
        None => Ok(()),
    }
}

fn full_ring(rig: &mut Rig<'_>) -> Checked {
    let segment = rig.segment.clone();
    for slot in 0..64 {
        set(&segment, "events.slots", 4 * slot + 1, 6 | (0x700 + slot as u64) << 32);
    }
    set(&segment, "events.produced", 0, 64);
    rig.watch.forget();
    ready(rig)?;
    let slots = rig.watch.words_of("events.slots");
    rig.step("parameters again, with a full ring");
    for _ in 0..3 {
        rig.parameters()?;
        rig.synchronise(Rule::Restarts)?;
    }
    if rig.watch.words_of("events.slots") != slots || word(&segment, "events.produced", 0) != 64 {
        return Breach::of(Rule::Ring, "an event that nobody had consumed is overwritten");
    }
    let codes: Vec<u32> = rig.events()?.iter().take(64).map(|event| event.code).collect();
    if codes != (0x700..0x740).collect::<Vec<u32>>() {
        return Breach::of(Rule::KeepsEvents, format!("the events are {codes:X?}"));
    }
    let lost = word(&segment, "events.lost", 0);
    rig.step("parameters again, with room in the ring");
    rig.parameters()?;
    rig.synchronise(Rule::Restarts)?;
    let events = rig.events()?;
    if !events.is_empty() && lost == 0 {
        return Breach::of(Rule::Ring, "events that found no room are not counted in events.lost");
    }
    Ok(())
}

fn damaged(rig: &mut Rig<'_>) -> Checked {
    const WORDS: [(&str, u64); 9] = [
        ("header.magic", 0),
        ("header.version", 2),
        ("header.total_bytes", SEGMENT_BYTES_BOXES as u64),
        ("header.io_bytes", 65),
        ("header.json_bytes", 2048),
        ("header.record_bytes", 0),
        ("header.event_slots", 32),
        ("header.counter_words", 0),
        ("channels.version", 2),
    ];
    let (name, to) = WORDS[rig.rng.usize(..WORDS.len())];
    rig.step(format!("{name} is {to}"));
    let right = word(&rig.segment, name, 0);
    set(&rig.segment, name, 0, to);
    let before = all_words(rig);
    let file = rig.descriptor()?;
    let exit = rig.start_beside(file.as_fd(), Rule::Header)?;
    if all_words(rig) != before {
        return Breach::of(Rule::Header, "it has written into the segment");
    }
    has_refused(exit, Rule::Header)?;
    set(&rig.segment, name, 0, right);
    rig.watch.forget();
    ready(rig)
}

fn all_words(rig: &Rig<'_>) -> Vec<u64> {
    (0..SEGMENT_BYTES).step_by(8).filter_map(|at| rig.segment.peek(at)).collect()
}

fn has_refused(exit: Exit, rule: Rule) -> Checked {
    match exit {
        Exit::Code(code) if code != 0 => Ok(()),
        exit => Breach::of(rule, format!("it has ended with {exit}")),
    }
}

fn no_segment(rig: &mut Rig<'_>) -> Checked {
    let (size, seals) = match rig.rng.u8(..4) {
        0 => (SEGMENT_BYTES, SealFlags::GROW),
        1 => (SEGMENT_BYTES, SealFlags::SHRINK),
        2 => (SEGMENT_BYTES - 4096, SealFlags::SHRINK | SealFlags::GROW),
        _ => (SEGMENT_BYTES + 8, SealFlags::SHRINK | SealFlags::GROW),
    };
    rig.step(format!("a file of {size} bytes with the seals {seals:?}"));
    let file = copy_of(rig, size, seals).map_err(|error| Breach::System(error.to_string()))?;
    let exit = rig.start_beside(file.as_fd(), Rule::Sealed)?;
    has_refused(exit, Rule::Sealed)?;
    ready(rig)
}

/// A file with the content of the segment, but another size or other seals.
fn copy_of(rig: &Rig<'_>, size: usize, seals: SealFlags) -> std::io::Result<OwnedFd> {
    let file = memfd_create(c"kit", MemfdFlags::CLOEXEC | MemfdFlags::ALLOW_SEALING)?;
    let mut bytes: Vec<u8> = all_words(rig).iter().flat_map(|word| word.to_ne_bytes()).collect();
    bytes.truncate(size);
    rustix::io::pwrite(&file, &bytes, 0)?;
    ftruncate(&file, size as u64)?;
    fcntl_add_seals(&file, seals)?;
    Ok(file)
}

/// A second driver while the first one works.
pub(super) fn second(rig: &mut Rig<'_>) -> Checked {
    let shown = |rig: &mut Rig<'_>| {
        let starts = word(&rig.segment, "counters", Counter::DriverStarts as usize);
        (rig.inputs(), word(&rig.segment, "cp.generation", 0), word(&rig.segment, "cp.state", 0), starts)
    };
    let mut before = shown(rig);
    // The first one may just be showing the state of its line.
    for _ in 0..50 {
        rig.sleep(WHILE);
        let now = shown(rig);
        if now == before {
            break;
        }
        before = now;
    }
    let file = rig.descriptor()?;
    let exit = rig.start_beside(file.as_fd(), Rule::Second)?;
    let after = shown(rig);
    if before != after {
        return Breach::of(Rule::Second, format!("{before:X?} became {after:X?}"));
    }
    has_refused(exit, Rule::Second)?;
    if rig.is_unlocked() {
        return Breach::of(Rule::Lock, "another process gets the lock");
    }
    rig.look()
}

/// A driver that was killed is followed by another.
pub(super) fn again(rig: &mut Rig<'_>) -> Checked {
    rig.start(|_| Ok(()))?;
    rig.restore()?;
    rig.synchronise(Rule::Identifier)
}

/// The identifier is shown: neither orders nor telegrams count, nor another number's acknowledgement.
pub(super) fn unacknowledged(rig: &mut Rig<'_>) -> Checked {
    rig.parameters()?;
    let number = rig.identifier(Rule::Restarts)?;
    rig.until_state(Rule::Ready, 4)?;
    rig.line.send(b"nobody is there")?;
    rig.put(0, 5, b"early")?;
    let what = "the identifier is gone, or something is on the line";
    rig.hold(Rule::Silent, what, |rig| rig.words() == (STARTUP, number) && rig.line.heard.is_empty())?;
    rig.step("an acknowledgement of another start-up");
    let other = 0x8000 | (if number == 0x80FF { 1 } else { number + 1 });
    rig.put(STARTUP, other, &[])?;
    rig.hold(Rule::Acknowledged, "it is answered", |rig| rig.words() == (STARTUP, number))?;
    for _ in 0..50 {
        if rig.line.is_read() {
            break;
        }
        rig.hold(Rule::Acknowledged, "it is answered", |rig| rig.words() == (STARTUP, number))?;
    }
    rig.step("the acknowledgement");
    rig.acknowledge()?;
    rig.hold(Rule::Silent, "a telegram is offered that came before", |rig| rig.words().0 == 0)
}
