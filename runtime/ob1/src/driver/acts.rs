//! What happens to a driver that works: orders, telegrams, kills, stops, nonsense. Each act leaves it working.

use ob1_backplane::{Counter, CpuState};
use ob1_time::Span;
use ob1_words::cp240::{BLOCK_BYTES as BLOCK, FAILED, RESET, STARTUP};
use rustix::process::Signal;

use super::rig::{Breach, Checked, Rig, SOON};
use super::rules::Rule;
use super::starts::{again, second, unacknowledged};
use super::watch::word;

/// One act.
pub(super) struct Act {
    pub(super) name: &'static str,
    /// It needs the registers of a CP 240.
    pub(super) registers: bool,
    pub(super) play: fn(&mut Rig<'_>) -> Checked,
}

const fn act(name: &'static str, play: fn(&mut Rig<'_>) -> Checked) -> Act {
    Act { name, registers: true, play }
}

const fn of_any(name: &'static str, play: fn(&mut Rig<'_>) -> Checked) -> Act {
    Act { name, registers: false, play }
}

/// All acts.
pub(super) const ACTS: &[Act] = &[
    act("an order", |rig| {
        let length = rig.length();
        rig.send(length)
    }),
    act("a telegram of the partner", |rig| {
        let length = rig.length();
        rig.receive(length)
    }),
    act("a burst of orders", burst),
    act("a burst of telegrams", telegrams),
    act("both ways at once", both_ways),
    act("an order that is too long", too_long),
    act("an order that is given up", given_up),
    act("words that are no counts", no_counts),
    act("a telegram that is not fetched at once", not_fetched),
    act("more telegrams than there is room for", overflow),
    act("changes to a driver that goes to sleep", drowsy),
    act("changes to a driver that sleeps", prompt),
    act("parameters again", |rig| {
        rig.parameters()?;
        rig.synchronise(Rule::Restarts)
    }),
    act("a start-up that is not acknowledged", unacknowledged),
    act("a reset request", reset),
    act("a CPU that dies in the middle of a write", torn_outputs),
    act("a CPU that dies while it transfers parameters", torn_parameters),
    of_any("words without meaning", nonsense),
    of_any("parameters that cannot be read", unreadable),
    of_any("twenty transfers of parameters", many_transfers),
    of_any("a full doorbell", full_bell),
    of_any("a second driver", second),
    of_any("the driver is stopped for a while", stopped),
    of_any("the driver is killed", killed),
    of_any("signals of a terminal", signals),
    of_any("the clock of the CPU jumps", clock_jumps),
    of_any("STOP and RUN", stop_and_run),
];

fn burst(rig: &mut Rig<'_>) -> Checked {
    for _ in 0..rig.rng.usize(2..6) {
        let length = rig.rng.usize(1..40);
        rig.send(length)?;
    }
    rig.line_is_silent(Rule::Sends)
}

/// Telegrams that are fetched together, the oldest first.
fn telegrams(rig: &mut Rig<'_>) -> Checked {
    let mut all = Vec::new();
    for _ in 0..rig.rng.usize(2..4) {
        let length = rig.rng.usize(1..40);
        let before = word(&rig.segment, "counters", Counter::TelegramsReceived as usize);
        all.extend(rig.partner_sends(length)?);
        rig.until(Rule::Account, SOON, "counter 5 does not count a telegram", |rig| {
            (word(&rig.segment, "counters", Counter::TelegramsReceived as usize) != before).then_some(())
        })?;
    }
    rig.fetch(&all)
}

fn both_ways(rig: &mut Rig<'_>) -> Checked {
    let (out, coming) = (rig.length(), rig.rng.usize(1..60));
    let (out, coming) = (rig.telegram(out), rig.partner_sends(coming)?);
    rig.hand_over(&out)?;
    rig.fetch(&coming)?;
    rig.complete(&out)
}

/// The order is refused, and the refusal is acknowledged.
fn too_long(rig: &mut Rig<'_>) -> Checked {
    let count = rig.rng.u16(1025..0x800);
    rig.put_tx(count, &[1; BLOCK])?;
    rig.answer(Rule::TooLong, "2017h does not come", |rig| (rig.words().1 == 0x2017).then_some(()))?;
    rig.put_tx(0, &[])?;
    rig.hold(Rule::TooLong, "2017h goes without being acknowledged", |rig| rig.words().1 == 0x2017)?;
    rig.put_tx(FAILED, &[])?;
    rig.answer(Rule::TooLong, "0 does not follow", |rig| (rig.words().1 == 0).then_some(()))?;
    rig.put_tx(0, &[])?;
    rig.line_is_silent(Rule::TooLong)
}

fn given_up(rig: &mut Rig<'_>) -> Checked {
    let count = rig.rng.u16(13..200);
    rig.put_tx(count, &[2; BLOCK])?;
    rig.echo(count)?;
    if count > 24 {
        rig.put_tx(count - 12, &[3; BLOCK])?;
        rig.echo(count - 12)?;
    }
    rig.put_tx(0, &[])?;
    rig.answer(Rule::GivenUp, "0 does not come", |rig| (rig.words().1 == 0).then_some(()))?;
    rig.line_is_silent(Rule::GivenUp)?;
    rig.send(5)
}

fn no_counts(rig: &mut Rig<'_>) -> Checked {
    for tx in [0x8000, 0x8001, 0x2007, 0x6010] {
        rig.put_tx(tx, &[4; BLOCK])?;
        rig.hold(Rule::NoCount, format!("TX = {tx:04X}h is answered"), |rig| rig.words().1 == 0)?;
    }
    rig.put_tx(0, &[])?;
    let telegram = rig.telegram(30);
    rig.put_tx(30, &telegram[..BLOCK])?;
    rig.echo(30)?;
    for tx in [29, 12, 31, 0x8000] {
        rig.put_tx(tx, &[5; BLOCK])?;
        rig.hold(Rule::NoCount, format!("TX = {tx:04X}h after 30 is answered"), |rig| rig.words().1 == 30)?;
    }
    for (rest, block) in [(18, &telegram[12..24]), (6, &telegram[24..])] {
        rig.put_tx(rest, block)?;
        rig.echo(rest)?;
    }
    rig.complete(&telegram)
}

/// `RX` stays until it is echoed, also when another word is written; the next telegram comes after `RX echo` = 0.
fn not_fetched(rig: &mut Rig<'_>) -> Checked {
    let telegram = rig.partner_sends(30)?;
    let rx = rig.until(Rule::Delivers, SOON, "nothing is offered", |rig| Some(rig.words().0).filter(|rx| *rx != 0))?;
    let offered = rig.inputs();
    let stays = |rig: &mut Rig<'_>| rig.inputs() == offered;
    rig.hold(Rule::Waits, "the offer changes without an echo", stays)?;
    rig.put(rx + 1, 0, &[])?;
    rig.hold(Rule::Waits, "an echo of another count is taken", stays)?;
    rig.put(0, 0, &[])?;
    rig.fetch(&telegram)?;
    rig.put(0x0007, 0, &[])?;
    let next = rig.partner_sends(3)?;
    rig.hold(Rule::Waits, "a telegram is offered while RX echo is not 0", |rig| rig.words().0 == 0)?;
    rig.put(0, 0, &[])?;
    rig.fetch(&next)
}

/// Telegrams until one finds no room: those before it are delivered.
fn overflow(rig: &mut Rig<'_>) -> Checked {
    let count = |rig: &Rig<'_>, counter: Counter| word(&rig.segment, "counters", counter as usize);
    let begun = (count(rig, Counter::TelegramsReceived), count(rig, Counter::RejectedFull));
    let mut kept = Vec::new();
    for _ in 0..300 {
        let before = (count(rig, Counter::TelegramsReceived), count(rig, Counter::RejectedFull));
        let telegram = rig.partner_sends(4)?;
        let full = rig.until(Rule::Overflow, SOON, "neither counter 5 nor counter 10 counts a telegram", |rig| {
            let now = (count(rig, Counter::TelegramsReceived), count(rig, Counter::RejectedFull));
            (now != before).then_some(now.1 != before.1)
        })?;
        if full {
            // The next telegram begins after a silence.
            rig.hold(Rule::Overflow, "", |_| true)?;
            break;
        }
        kept.extend(telegram);
    }
    if kept.is_empty() {
        return Breach::of(Rule::Overflow, format!("there is no room for one telegram; the counters were {begun:?}"));
    }
    rig.fetch(&kept)
}

/// First counts, and their withdrawal, as the driver goes back to sleep: so long after its awakening as it took to
/// announce its sleep the last times, a little sooner after one that came too late, a little later after one that did
/// not. So many come between its last look and its announcement.
fn drowsy(rig: &mut Rig<'_>) -> Checked {
    rig.apart(while_drowsy)
}

fn while_drowsy(rig: &mut Rig<'_>) -> Checked {
    let (mut aim, begin) = (100_u32, rig.now());
    for round in 0..2000 {
        let tx = if round % 2 == 0 { 13 + round % 7 } else { 0 };
        let delay = aim - rig.rng.u32(..=aim / 4);
        aim = if rig.put_drowsy(delay, tx)? { aim - aim.div_ceil(16) } else { (aim + aim / 16 + 1).min(1 << 20) };
        rig.echo(tx)?;
        if tx == 0 && rig.now().since(begin) > Span::SECOND {
            break;
        }
    }
    Ok(())
}

/// The time to an answer, in the middle of many tries; the machine may be busy, so the best of five rounds counts.
fn prompt(rig: &mut Rig<'_>) -> Checked {
    const ENOUGH: Span = Span::from_millis(10);
    for _ in 0..5 {
        let (mut tries, mut slow) = (0, 0);
        while tries < 31 && slow < 16 {
            let pause = Span::from_micros(rig.rng.u64(500..4000));
            rig.sleep(pause);
            let begin = rig.now();
            rig.put_tx(13, &[7; BLOCK])?;
            rig.echo(13)?;
            slow += u32::from(rig.now().since(begin) > ENOUGH);
            tries += 1;
            rig.put_tx(0, &[])?;
            rig.answer(Rule::GivenUp, "0 does not come", |rig| (rig.words().1 == 0).then_some(()))?;
        }
        if slow < 16 {
            return Ok(());
        }
    }
    Breach::of(Rule::Prompt, "16 of 31 answers take longer, five times")
}

fn reset(rig: &mut Rig<'_>) -> Checked {
    match rig.rng.u8(..4) {
        0 => rig.hand_over(&[8; 30])?,
        1 => {
            rig.partner_sends(20)?;
            rig.until(Rule::Delivers, SOON, "nothing is offered", |rig| (rig.words().0 != 0).then_some(()))?;
        }
        2 => {
            rig.parameters()?;
            rig.identifier(Rule::Restarts)?;
        }
        _ => {}
    }
    rig.put(RESET, 0, &[])?;
    rig.identifier(Rule::Reset)?;
    rig.acknowledge()?;
    rig.line_is_silent(Rule::Reset)
}

/// Half a block under an odd sequence, then a whole one.
fn torn_outputs(rig: &mut Rig<'_>) -> Checked {
    let odd = word(&rig.segment, "outputs.sequence", 0) + 1;
    let torn = u64::from_ne_bytes([0, 0, 0, 20, 0xBA, 0xD0, 0xBA, 0xD0]);
    rig.spoil(&[("outputs.sequence", 0, odd), ("outputs.data", 0, torn)])?;
    rig.hold(Rule::Torn, "a block is taken that is half written", |rig| rig.words().1 == 0)?;
    let beat = word(&rig.segment, "cp.heartbeat", 0);
    // One that has never shown a heartbeat may well go on.
    let rule = if beat == 0 { Rule::Heartbeat } else { Rule::Torn };
    rig.until(rule, Span::SECOND, "it waits for the writer", |rig| {
        (word(&rig.segment, "cp.heartbeat", 0) != beat).then_some(())
    })?;
    rig.send(17)
}

fn torn_parameters(rig: &mut Rig<'_>) -> Checked {
    let odd = word(&rig.segment, "params.sequence", 0) + 1;
    rig.spoil(&[("params.sequence", 0, odd), ("params.bytes", 0, u64::MAX), ("params.json_length", 0, 3)])?;
    let state = word(&rig.segment, "cp.state", 0);
    rig.hold(Rule::Torn, "parameters are taken that are half written", |rig| {
        rig.words() == (0, 0) && word(&rig.segment, "cp.state", 0) == state
    })?;
    rig.parameters()?;
    rig.synchronise(Rule::Restarts)
}

fn nonsense(rig: &mut Rig<'_>) -> Checked {
    let state = rig.rng.u64(3..);
    rig.spoil(&[("cpu.state", 0, state), ("cpu.modem_outputs", 0, unknown_bits(state))])?;
    rig.hold(Rule::Nonsense, "", |_| true)?;
    rig.state(CpuState::Run)?;
    let sequence = word(&rig.segment, "params.sequence", 0);
    rig.spoil(&[("params.json_length", 0, 4097 + state % 1_000_000), ("params.sequence", 0, sequence + 2)])?;
    rig.hold(Rule::Nonsense, "", |_| true)?;
    rig.parameters()?;
    rig.until_state(Rule::Nonsense, 4)?;
    if rig.kind == ob1_params::CpKind::Cp240 {
        rig.number_may_repeat();
        return rig.synchronise(Rule::Nonsense);
    }
    Ok(())
}

/// Unknown bits, without those that drive RTS and DTR.
const fn unknown_bits(noise: u64) -> u64 {
    noise << 8
}

fn unreadable(rig: &mut Rig<'_>) -> Checked {
    const TEXTS: [&[u8]; 4] = [b"no JSON", b"", b"{\"module\": \"cp240\", \"line\": ", b"\xFF\xFE\x00"];
    let text = TEXTS[rig.rng.usize(..TEXTS.len())];
    rig.transfer(&[0; 16], text)?;
    rig.until_state(Rule::Refuses, 3)?;
    rig.parameters()?;
    rig.until_state(Rule::Refuses, 4)?;
    rig.number_may_repeat();
    rig.synchronise(Rule::Refuses)
}

fn many_transfers(rig: &mut Rig<'_>) -> Checked {
    let transfer = |rig: &mut Rig<'_>, times: usize| -> Checked<usize> {
        for _ in 0..times {
            rig.parameters()?;
            rig.synchronise(Rule::Restarts)?;
        }
        // What is closed a moment later counts as closed.
        let mut least = usize::MAX;
        for _ in 0..5 {
            rig.sleep(Span::from_millis(2));
            least = least.min(rig.descriptors());
        }
        Ok(least)
    };
    let before = transfer(rig, 2)?;
    let after = transfer(rig, 20)?;
    if after > before {
        return Breach::of(Rule::Descriptors, format!("{before} were open and {after} are"));
    }
    Ok(())
}

fn full_bell(rig: &mut Rig<'_>) -> Checked {
    (0..70_000).for_each(|_| rig.ring());
    rig.until(Rule::Drains, SOON, "there are bytes in the doorbell", |rig| (rig.rung() == 0).then_some(()))
}

/// A driver that is stopped in the middle of an order goes on with it.
fn stopped(rig: &mut Rig<'_>) -> Checked {
    let span = Span::from_millis(rig.rng.u64(20..1500));
    if rig.kind != ob1_params::CpKind::Cp240 {
        rig.stop(span);
        return rig.look();
    }
    let telegram = rig.telegram(40);
    let step = rig.rng.usize(..4);
    rig.step(format!("the driver is stopped for {} ms in step {step} of an order", span.millis()));
    for (index, block) in telegram.chunks(BLOCK).enumerate() {
        let rest = (telegram.len() - BLOCK * index) as u16;
        rig.put_tx(rest, block)?;
        if index == step {
            rig.stop(span);
        }
        rig.echo(rest)?;
    }
    rig.complete(&telegram)
}

/// A kill at a step of the handshake; the next driver starts from there.
fn killed(rig: &mut Rig<'_>) -> Checked {
    let step = if rig.kind == ob1_params::CpKind::Cp240 { rig.rng.u8(..8) } else { 0 };
    rig.step(format!("the driver is killed in step {step}"));
    match step {
        1 => rig.put_tx(30, &[9; BLOCK])?,
        2 => {
            rig.put_tx(30, &[9; BLOCK])?;
            rig.echo(30)?;
        }
        3 => {
            rig.hand_over(&[9; 30])?;
            rig.put_tx(0, &[])?;
        }
        4 => {
            rig.hand_over(&[9; 600])?;
            rig.put_tx(0, &[])?;
            rig.until(Rule::Sends, SOON, "nothing is on the line", |rig| (!rig.line.heard.is_empty()).then_some(()))?;
        }
        5 => drop(rig.partner_sends(25)?),
        6 => {
            rig.partner_sends(25)?;
            rig.until(Rule::Delivers, SOON, "nothing is offered", |rig| (rig.words().0 != 0).then_some(()))?;
            let rx = rig.words().0;
            rig.put(rx, 0, &[])?;
        }
        7 => {
            rig.parameters()?;
            let number = rig.identifier(Rule::Restarts)?;
            rig.put(STARTUP, number, &[])?;
        }
        _ => {}
    }
    rig.kill()?;
    rig.step(format!("a driver after one that was killed in step {step}"));
    again(rig)
}

fn signals(rig: &mut Rig<'_>) -> Checked {
    rig.signal(Signal::INT);
    rig.signal(Signal::HUP);
    rig.hold(Rule::Signals, "", |_| true).map_err(|breach| match breach {
        Breach::Rule(Rule::Lives, text) => Breach::Rule(Rule::Signals, text),
        other => other,
    })
}

/// Forth and back; cpu.time is the clock of entries, not of the driver.
fn clock_jumps(rig: &mut Rig<'_>) -> Checked {
    for time in [u64::MAX, 0, 1 << 62, 1] {
        rig.cpu(|cpu| cpu.set_time(time))?;
        rig.ring();
        rig.hold(Rule::Lives, "", |_| true)?;
    }
    if rig.kind == ob1_params::CpKind::Cp240 {
        rig.send(20)?;
        rig.receive(20)?;
    }
    Ok(())
}

/// The transition to RUN transfers the parameters.
fn stop_and_run(rig: &mut Rig<'_>) -> Checked {
    if rig.kind == ob1_params::CpKind::Cp240 {
        rig.put(0, 0, &[])?;
    }
    rig.state(CpuState::Stop)?;
    rig.hold(Rule::Lives, "", |_| true)?;
    rig.parameters()?;
    rig.state(CpuState::Run)?;
    rig.synchronise(Rule::Restarts)
}
