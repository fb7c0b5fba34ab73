//! The bus keeps the times of the cable, and has the collisions of two wires.

use ob1_fakes::sim_line::{End, SimConfig, SimEvent, SimLine};

use super::*;

const T: Span = Span::from_micros(1);
const FRAME: Frame = Frame { char_time: T, parity: Parity::None, data_bits: 8 };

fn bus(config: BusConfig, participants: usize) -> SimBus {
    let mut bus = SimBus::new(config, 5);
    for _ in 0..participants {
        bus.join(FRAME);
    }
    bus
}

/// Runs the bus until it is idle; one line per event: time, participant, event.
fn drain(bus: &mut SimBus) -> Vec<String> {
    let mut log = Vec::new();
    let mut buffer = [0; 64];
    while let Some(at) = bus.next_event() {
        while let Some((who, event)) = bus.pop(at, &mut buffer) {
            log.push(match event {
                BusEvent::Rx(n) => format!("{} {who} {:02X?}", at.nanos(), &buffer[..n]),
                other => format!("{} {who} {other:?}", at.nanos()),
            });
        }
    }
    log
}

#[test]
fn two_participants_are_a_cable() {
    let faults = FaultRates { delay_max: 5 * T, ..FaultRates::all(30_000) };
    let mut cable = SimLine::new(SimConfig { char_time: T, faults, ..SimConfig::new(9600, 20) }, 5);
    let mut bus = bus(BusConfig { faults, ..BusConfig::new(false) }, 2);
    let mut rng = SplitMix64::new(9);
    let (mut of_cable, mut of_bus) = ([Vec::new(), Vec::new()], [Vec::new(), Vec::new()]);
    let mut buffer = [0; 64];
    let mut now = Instant::START;
    let mut run = |cable: &mut SimLine, bus: &mut SimBus, until: Instant| {
        while let Some(at) = cable.next_event().filter(|at| *at <= until) {
            while let Some((end, event)) = cable.pop(at, &mut buffer) {
                of_cable[end as usize].push(match event {
                    SimEvent::Rx(n) => format!("{} {:02X?}", at.nanos(), &buffer[..n]),
                    other => format!("{} {other:?}", at.nanos()),
                });
            }
        }
        while let Some(at) = bus.next_event().filter(|at| *at <= until) {
            while let Some((who, event)) = bus.pop(at, &mut buffer) {
                of_bus[who].push(match event {
                    BusEvent::Rx(n) => format!("{} {:02X?}", at.nanos(), &buffer[..n]),
                    other => format!("{} {other:?}", at.nanos()),
                });
            }
        }
    };
    for round in 0..300 {
        now += rng.span_below(20 * T);
        run(&mut cable, &mut bus, now);
        let bytes: Vec<u8> = (0..rng.below(12)).map(|i| i as u8).collect();
        let end = End::BOTH[round % 2];
        cable.write(end, now, &bytes);
        bus.write(end as usize, now, &bytes);
        if rng.below(10) == 0 {
            assert_eq!(cable.take_back(end, now), bus.take_back(end as usize, now));
        }
    }
    run(&mut cable, &mut bus, Instant::NEVER - Span::from_nanos(1));
    assert!(of_cable[0].len() > 500, "{}", of_cable[0].len());
    assert_eq!(of_cable, of_bus);
}

#[test]
fn everybody_on_two_wires_hears_the_speaker_but_the_speaker() {
    let mut bus = bus(BusConfig { strict: true, ..BusConfig::new(true) }, 3);
    bus.write(1, Instant::START, &[7, 8]);
    assert_eq!(drain(&mut bus), ["1000 0 [07]", "1000 2 [07]", "2000 0 [08]", "2000 1 TxDone", "2000 2 [08]"]);
    // One after the other, without a pause: legal.
    bus.write(0, Instant::from_nanos(2000), &[1]);
    bus.write(2, Instant::from_nanos(3000), &[2]);
    assert_eq!(drain(&mut bus).len(), 6);
    assert_eq!(bus.collisions(), 0);
}

#[test]
fn two_speakers_are_deaf_and_spoil_what_the_third_hears() {
    let mut bus = bus(BusConfig::new(true), 3);
    bus.write(0, Instant::START, &[0x55, 0x55, 0x55]);
    bus.write(1, Instant::from_nanos(1500), &[0x2A]);
    let log = drain(&mut bus);
    assert_eq!(bus.collisions(), 3, "the second and third of the one, the only of the other: {log:?}");
    // Delivered at 1500, when it was read.
    assert!(log.contains(&"1500 1 [55]".to_owned()) && log.contains(&"1500 2 [55]".to_owned()), "{log:?}");
    let of = |who: &str| log.iter().filter(|line| line.split(' ').nth(1) == Some(who)).count();
    assert_eq!((of("0"), of("1"), of("2")), (1, 2, 4), "{log:?}");
    let whole = |line: &&String| line.contains("[55]") || line.contains("[2A]");
    assert_eq!(log.iter().filter(whole).count(), 2, "only the first came through, to both: {log:?}");
}

#[test]
#[should_panic(expected = "two speak at the same time")]
fn a_strict_bus_panics_on_a_collision() {
    let mut bus = bus(BusConfig { strict: true, ..BusConfig::new(true) }, 2);
    bus.write(0, Instant::START, &[1]);
    bus.write(1, Instant::from_nanos(999), &[2]);
    drain(&mut bus);
}

#[test]
fn what_was_taken_back_does_not_collide() {
    let mut bus = bus(BusConfig { strict: true, ..BusConfig::new(true) }, 2);
    bus.write(0, Instant::START, &[1, 2, 3, 4]);
    assert_eq!(bus.take_back(0, Instant::from_nanos(1500)), 2);
    bus.write(1, Instant::from_nanos(2000), &[9]);
    assert_eq!(drain(&mut bus), ["2000 0 TxDone", "2000 1 [01, 02]", "3000 0 [09]", "3000 1 TxDone"]);
}

#[test]
fn another_frame_is_heard_as_faults() {
    let even = Frame { parity: Parity::Even, ..FRAME };
    for (listens, hears) in [
        (FRAME, "1000 1 [FF]"),
        (Frame { char_time: T + T / 50, ..FRAME }, "1000 1 [FF]"),
        (Frame { char_time: 2 * T, ..FRAME }, "1000 1 Fault(Framing)"),
        (even, "1000 1 Fault(Parity)"),
        (Frame { data_bits: 7, ..FRAME }, "1000 1 [7F]"),
    ] {
        let mut bus = bus(BusConfig::new(false), 2);
        bus.set_frame(1, listens);
        bus.write(0, Instant::START, &[0xFF]);
        assert_eq!(drain(&mut bus)[1], hears, "{listens:?}");
    }
    let mut both = bus(BusConfig::new(false), 0);
    both.join(even);
    both.join(even);
    both.write(0, Instant::START, &[0xFF]);
    assert_eq!(drain(&mut both)[1], "1000 1 [FF]");
}

#[test]
fn a_break_takes_its_time_and_is_heard_as_one() {
    let mut bus = bus(BusConfig::new(false), 2);
    bus.write(0, Instant::START, &[1]);
    bus.send_break(0, Instant::from_nanos(100), 5 * T);
    bus.write(0, Instant::from_nanos(200), &[2]);
    assert_eq!(drain(&mut bus), ["1000 1 [01]", "6000 1 Fault(Break)", "7000 0 TxDone", "7000 1 [02]"]);
}

#[test]
fn modem_lines_cross_on_a_cable_and_do_not_exist_on_two_wires() {
    let mut cable = bus(BusConfig::new(false), 2);
    cable.set_modem(0, Instant::from_nanos(5), true, true);
    cable.set_modem(0, Instant::from_nanos(6), true, true);
    cable.set_modem(0, Instant::from_nanos(7), false, true);
    let log = drain(&mut cable);
    assert_eq!(log.len(), 2, "{log:?}");
    assert!(log[0].contains("cts: true, dsr: true") && log[1].contains("cts: false, dsr: true"), "{log:?}");
    let mut wires = bus(BusConfig::new(true), 2);
    wires.set_modem(0, Instant::from_nanos(5), true, true);
    assert_eq!(wires.next_event(), None);
}

#[test]
fn bursts_come_at_their_rate_and_spare_the_rest() {
    let bursts = Bursts { every: 900 * T, length: 100 * T, faults: FaultRates { parity: 500_000, ..FaultRates::NONE } };
    let mut bus = bus(BusConfig { bursts: Some(bursts), ..BusConfig::new(false) }, 2);
    bus.write(0, Instant::START, &[0; 100_000]);
    let log = drain(&mut bus);
    let bad: Vec<Instant> = log
        .iter()
        .filter(|line| line.contains("Parity"))
        .map(|line| line.split(' ').next().and_then(|at| at.parse().ok()).map(Instant::from_nanos).expect("a time"))
        .collect();
    // About 100 bursts of 100 characters, half of which have faults.
    assert!((4000..6000).contains(&bad.len()), "{}", bad.len());
    let gaps = bad.windows(2).filter(|pair| pair[1] - pair[0] > 300 * T).count();
    assert!((80..120).contains(&gaps), "{gaps}");
}

#[test]
fn the_same_seed_gives_the_same_events() {
    let run = |seed| {
        let bursts = Bursts { every: 50 * T, length: 20 * T, faults: FaultRates::all(50_000) };
        let config = BusConfig { faults: FaultRates::all(5_000), bursts: Some(bursts), ..BusConfig::new(true) };
        let mut bus = SimBus::new(config, seed);
        for _ in 0..4 {
            bus.join(FRAME);
        }
        for round in 0..100 {
            bus.write(round % 4, Instant::START + round as u64 * 7 * T, &[round as u8; 9]);
        }
        (drain(&mut bus), bus.collisions())
    };
    assert_eq!(run(1), run(1));
    assert_ne!(run(1), run(2));
}

#[test]
fn a_participant_that_does_not_exist_is_no_panic() {
    let mut bus = bus(BusConfig::new(true), 1);
    bus.write(7, Instant::START, &[1]);
    bus.send_break(7, Instant::START, T);
    bus.set_frame(7, FRAME);
    bus.set_modem(7, Instant::START, true, true);
    assert_eq!(
        (bus.take_back(7, Instant::START), bus.is_sending(7, Instant::START), bus.next_event()),
        (0, false, None)
    );
}

#[test]
fn who_leaves_is_told_nothing_and_its_number_is_free_once_its_characters_are_out() {
    let mut bus = bus(BusConfig::new(true), 2);
    bus.write(0, Instant::START, &[1, 2]);
    bus.leave(0, Instant::from_nanos(500));
    assert_eq!(bus.participants(), 1);
    assert_eq!(bus.join(FRAME), 2, "it is still sending");
    bus.leave(2, Instant::from_nanos(500));
    assert_eq!(drain(&mut bus), ["1000 1 [01]", "2000 1 [02]"]);
    assert_eq!(bus.join(FRAME), 0);
    assert_eq!(bus.participants(), 2);
}

#[test]
fn a_successor_on_a_cable_sends_behind_its_predecessor_and_does_not_hear_it() {
    let mut bus = bus(BusConfig::new(false), 2);
    bus.write(0, Instant::START, &[1, 2, 3]);
    bus.write(1, Instant::START, &[9]);
    bus.leave(0, Instant::from_nanos(1500));
    assert_eq!(bus.join(FRAME), 0, "the same end");
    assert!(bus.is_sending(0, Instant::from_nanos(1500)));
    bus.write(0, Instant::from_nanos(1500), &[4]);
    assert_eq!(
        drain(&mut bus),
        ["1500 1 TxDone", "1500 1 [01]", "2000 1 [02]", "3000 1 [03]", "4000 0 TxDone", "4000 1 [04]"]
    );
}

#[test]
fn what_nobody_is_left_to_hear_is_gone() {
    let mut bus = bus(BusConfig::new(false), 2);
    bus.write(0, Instant::START, &[1, 2, 3]);
    bus.write(1, Instant::START, &[4, 5, 6]);
    bus.leave(0, Instant::from_nanos(500));
    bus.leave(1, Instant::from_nanos(600));
    assert_eq!((bus.join(FRAME), bus.join(FRAME)), (0, 1));
    assert_eq!(drain(&mut bus), [""; 0]);
}
