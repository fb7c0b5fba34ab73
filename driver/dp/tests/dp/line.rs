//! A master and its slaves on two wires, in virtual time: start, exchange, loss and return, refusals, the watchdog, and
//! the duration of a round.

use ob1_coupler::config::{Instant, Span};
use ob1_coupler::dp::{Diagnosis, kept_diagnosis, refusal_words};
use ob1_coupler::{Image, Input, LineInput, State};
use ob1_fakes::dp_slave::State as SlaveState;
use ob1_line::sim::FaultRates;

use crate::wires::{MS, Wires, config, slave_of};

fn quiet(baud: u32, slaves: usize, bytes: usize) -> Wires {
    let mut wires = Wires::new(&config(baud, slaves, bytes), FaultRates::NONE, 1);
    wires.start();
    wires
}

fn diagnosis(image: &Image, slaves: usize, bytes: usize, n: usize) -> String {
    let at = slaves * bytes + n * 33;
    let kept = kept_diagnosis(&image.inputs[at..at + 33]);
    Diagnosis::new(kept).map(|diagnosis| diagnosis.to_string()).unwrap_or_default()
}

#[test]
fn inputs_and_outputs_go_through() {
    let mut wires = quiet(500_000, 3, 4);
    for n in 0..3 {
        wires.slaves[n].slave.inputs = vec![n as u8 + 1; 4];
        wires.image.outputs[4 * n..4 * n + 4].fill(n as u8 + 11);
    }
    wires.run(20 * MS);
    for n in 0..3 {
        assert_eq!(wires.image.inputs[4 * n..4 * n + 4], [n as u8 + 1; 4]);
        assert_eq!(wires.slaves[n].slave.outputs, [n as u8 + 11; 4]);
    }
    assert!(wires.master.has_told_outputs(&wires.image));
    // STOP: zeros, and the watchdogs do not expire.
    wires.image.driven = false;
    wires.ask(Input::Tick);
    assert!(!wires.master.has_told_outputs(&wires.image));
    wires.run(500 * MS);
    assert!(wires.master.has_told_outputs(&wires.image));
    assert!(wires.slaves.iter().all(|on| on.slave.outputs == [0; 4] && on.slave.state() == SlaveState::Exchange));
    assert_eq!(wires.violations(), [""; 0]);
    assert_eq!(wires.losses, []);
}

/// Bits of a round with `slaves` of `bytes` each way, as short as the standard allows: for each TSYN, request, min
/// TSDR, answer; then the token, after another TSYN.
fn least_bits(slaves: u64, bytes: u64) -> u64 {
    let telegram = 11 * (bytes + if bytes == 8 { 6 } else { 9 });
    slaves * (33 + telegram + 11 + telegram) + 33 + 33
}

#[test]
fn a_round_of_16_slaves_takes_at_most_a_third_more_than_the_least() {
    for baud in [500_000, 1_500_000] {
        let mut wires = quiet(baud, 16, 8);
        let (before, rounds) = (wires.image.status[0].exchanges, Span::SECOND);
        wires.run(rounds);
        let exchanges = wires.image.status[0].exchanges - before;
        let taken = rounds / exchanges;
        let least = least_bits(16, 8) * Span::SECOND / u64::from(baud);
        let factor = taken.nanos() as f64 / least.nanos() as f64;
        println!("{baud} bit/s: {taken} a round, at least {least}: {factor:.3}");
        assert!(factor >= 1.0, "{baud}: faster than the line can be: {factor}");
        assert!(factor <= 1.3, "{baud}: {factor}");
        assert_eq!(wires.violations(), [""; 0]);
    }
}

#[test]
fn a_slave_that_loses_its_power_returns_by_itself() {
    let mut wires = quiet(500_000, 3, 4);
    wires.image.outputs.fill(7);
    wires.run(20 * MS);
    wires.slaves[1].off = true;
    wires.run(50 * MS);
    assert_eq!(wires.states(), [State::Running, State::Lost, State::Running]);
    wires.slaves[1].slave.restart();
    wires.slaves[1].off = false;
    assert_eq!(wires.slaves[1].slave.outputs, [0; 4]);
    wires.run(100 * MS);
    assert_eq!(wires.states(), [State::Running; 3]);
    assert_eq!(wires.slaves[1].slave.outputs, [7; 4]);
    assert_eq!(wires.losses.iter().map(|(_, n)| *n).collect::<Vec<_>>(), [1]);
    // Without power for so short a time that it was never silent: it still counts as lost, because its outputs were
    // off.
    wires.slaves[2].slave.restart();
    wires.run(100 * MS);
    assert_eq!(wires.losses.iter().map(|(_, n)| *n).collect::<Vec<_>>(), [1, 2]);
    assert_eq!(wires.states(), [State::Running; 3]);
    assert_eq!(wires.violations(), [""; 0]);
}

#[test]
fn outputs_go_off_with_the_watchdog_when_the_master_is_gone() {
    let config = config(500_000, 2, 4);
    let mut wires = Wires::new(&config, FaultRates::NONE, 1);
    wires.start();
    wires.image.outputs.fill(7);
    wires.run(20 * MS);
    wires.killed = true;
    let killed = wires.now;
    let mut off = [None; 2];
    wires.run_with(300 * MS, |wires| {
        for (n, on) in wires.slaves.iter().enumerate() {
            if on.slave.outputs == [0; 4] && off[n].is_none() {
                off[n] = Some(wires.now - killed);
            }
        }
    });
    // 200 ms are configured; the last telegram to each was at most a round ago, or being sent.
    assert!(off.iter().all(|off| off.is_some_and(|off| (190 * MS..=201 * MS).contains(&off))), "{off:?}");
    // The next process finds everything unchanged.
    wires.restart_master(&config);
    let again = wires.now;
    wires.start();
    assert!(wires.now - again < 1000 * MS, "{} ms", (wires.now - again) / MS);
}

#[test]
fn who_refuses_says_why() {
    let config = config(500_000, 4, 4);
    let mut wires = Wires::new(&config, FaultRates::NONE, 1);
    let dp = config.lines[0].dp.as_ref().expect("DP");
    let other = |n: usize, change: fn(&mut ob1_fakes::dp_slave::SlaveConfig)| {
        let mut slave = slave_of(dp, n);
        change(&mut slave);
        ob1_fakes::dp_slave::Slave::new(slave)
    };
    wires.slaves[0].slave = other(0, |slave| slave.ident = 0x806A);
    wires.slaves[1].slave = other(1, |slave| slave.config = vec![0x11]);
    wires.slaves[2].slave = other(2, |slave| slave.parameters = Some(vec![0xFF]));
    wires.run(500 * MS);
    assert_eq!(wires.states(), [State::Refused, State::Refused, State::Refused, State::Running]);
    assert!(diagnosis(&wires.image, 4, 4, 0).contains("ident 806Ah"));
    assert!(diagnosis(&wires.image, 4, 4, 1).contains("configuration fault"), "{}", diagnosis(&wires.image, 4, 4, 1));
    assert!(diagnosis(&wires.image, 4, 4, 2).contains("parameter fault"));
    // As in the log of the bus.
    for (n, why) in ["another device than its GSD file", "its modules are not those", "refuses its parameters"]
        .into_iter()
        .enumerate()
    {
        let at = 4 * 4 + n * 33;
        let kept = kept_diagnosis(&wires.image.inputs[at..at + 33]);
        let told = refusal_words(kept, &dp.slaves[n], dp.address);
        assert!(told.contains(why) && told.contains("; "), "{told}");
    }
    // Somebody puts the right module in.
    wires.slaves[1].slave.set_config(dp.slaves[1].config.clone());
    wires.run(500 * MS);
    assert_eq!(wires.states()[1], State::Running);
}

#[test]
fn a_slave_that_was_never_there_is_lost_and_found() {
    let mut wires = Wires::new(&config(500_000, 2, 4), FaultRates::NONE, 1);
    wires.slaves[1].off = true;
    wires.run(1900 * MS);
    assert_eq!(wires.states(), [State::Running, State::Starting]);
    wires.run(200 * MS);
    assert_eq!(wires.states(), [State::Running, State::Lost]);
    wires.slaves[1].off = false;
    wires.run(200 * MS);
    assert_eq!(wires.states(), [State::Running; 2]);
}

#[test]
fn a_diagnosis_is_fetched_when_it_comes_and_when_it_goes() {
    let mut wires = quiet(500_000, 2, 4);
    let before = wires.image.status[1].diagnosis;
    // Slot 4, channel 2: wire break.
    wires.slaves[1].slave.report(&[0x42, 0b1000, 0x83, 0x42, 0x26]);
    wires.run(20 * MS);
    assert_eq!(wires.image.status[1].diagnosis, before + 1);
    assert!(diagnosis(&wires.image, 2, 4, 1).ends_with("slot 4, slot 4 channel 2 input: wire break"));
    assert_eq!(wires.image.status[1].state, State::Running);
    wires.slaves[1].slave.report(&[]);
    wires.run(20 * MS);
    assert_eq!(wires.image.status[1].diagnosis, before + 2);
    assert!(!diagnosis(&wires.image, 2, 4, 1).contains("slot"));
    assert_eq!(wires.violations(), [""; 0]);
}

#[test]
fn a_master_that_speaks_too_soon_is_found() {
    // 11 bits at 500 kbit/s.
    const CHARACTER: Span = Span::from_micros(22);
    // A test of the check itself: a request without TSYN before it.
    let mut wires = quiet(500_000, 1, 4);
    let mut slave =
        ob1_fakes::dp_slave::Slave::new(slave_of(config(500_000, 1, 4).lines[0].dp.as_ref().expect("DP"), 0));
    let mut out = Vec::new();
    let telegram = [0x10, 3, 2, 0x49, 0x4E, 0x16];
    let first = Instant::from_micros(100);
    for (n, byte) in telegram.iter().enumerate() {
        slave.step(first + CHARACTER * (n as u64 + 1), Input::Line(LineInput::Rx(&[*byte])), &mut out);
    }
    assert_eq!(slave.violations(), [""; 0]);
    let begin = first + 6 * CHARACTER + Span::from_micros(60);
    slave.step(begin - Span::from_micros(30), Input::Tick, &mut out);
    for (n, byte) in telegram.iter().enumerate() {
        slave.step(begin + CHARACTER * (n as u64 + 1), Input::Line(LineInput::Rx(&[*byte])), &mut out);
    }
    assert!(!slave.violations().is_empty());
    wires.run(MS);
}
