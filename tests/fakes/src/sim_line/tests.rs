//! The simulated line keeps its times, its order and its faults.

use super::*;

const T: Span = Span::from_micros(1);

fn config() -> SimConfig {
    SimConfig { char_time: T, ..SimConfig::new(9600, 20) }
}

/// Runs the line until it is idle; one line per event: time, end, event.
fn drain(line: &mut SimLine) -> Vec<String> {
    let mut log = Vec::new();
    let mut buffer = [0; 64];
    while let Some(at) = line.next_event() {
        let now = at.max(line.now);
        while let Some((end, event)) = line.pop(now, &mut buffer) {
            log.push(match event {
                SimEvent::Rx(n) => format!("{} {end:?} {:02X?}", now.nanos(), &buffer[..n]),
                other => format!("{} {end:?} {other:?}", now.nanos()),
            });
        }
    }
    log
}

#[test]
fn character_times_of_the_frames() {
    assert_eq!(SimConfig::new(9600, 22).char_time, Span::from_nanos(1_145_834)); // 8E1
    assert_eq!(SimConfig::new(150, 15).char_time, Span::from_nanos(50_000_000)); // 5N1.5
    assert_eq!(SimConfig::new(115_200, 20).char_time, Span::from_nanos(86_806)); // 8N1, rounded up
}

#[test]
fn characters_arrive_one_by_one_and_tx_done_comes_with_the_last_bit() {
    let mut line = SimLine::new(config(), 0);
    line.write(End::A, Instant::from_nanos(500), &[1, 2]);
    line.write(End::B, Instant::from_nanos(700), &[9]);
    line.write(End::A, Instant::from_nanos(900), &[3]);
    assert_eq!(
        drain(&mut line),
        ["1500 B [01]", "1700 B TxDone", "1700 A [09]", "2500 B [02]", "3500 A TxDone", "3500 B [03]"]
    );
}

#[test]
fn tx_done_waits_for_what_is_written_at_the_very_end() {
    let mut line = SimLine::new(config(), 0);
    line.write(End::A, Instant::START, &[1]);
    line.write(End::A, Instant::from_nanos(1000), &[2]);
    assert_eq!(drain(&mut line), ["1000 B [01]", "2000 A TxDone", "2000 B [02]"]);
}

#[test]
fn what_has_not_begun_is_taken_back() {
    let mut line = SimLine::new(config(), 0);
    line.write(End::A, Instant::START, &[1, 2, 3, 4]);
    assert_eq!(line.take_back(End::A, Instant::from_nanos(1500)), 2); // 1 is out, 2 is leaving
    line.write(End::A, Instant::from_nanos(1600), &[5]);
    assert_eq!(drain(&mut line), ["1600 B [01]", "2000 B [02]", "3000 A TxDone", "3000 B [05]"]);
}

#[test]
fn a_late_owner_gets_several_characters_but_none_across_an_event() {
    let mut line = SimLine::new(config(), 0);
    line.write(End::A, Instant::START, &[1, 2, 3]);
    line.write(End::B, Instant::from_nanos(1500), &[9]);
    let mut buffer = [0; 8];
    assert_eq!(line.pop(Instant::from_nanos(10_000), &mut buffer), Some((End::B, SimEvent::Rx(2))));
    assert_eq!(line.pop(Instant::from_nanos(10_000), &mut buffer), Some((End::B, SimEvent::TxDone)));
    assert_eq!(line.pop(Instant::from_nanos(10_000), &mut buffer), Some((End::A, SimEvent::Rx(1))));
    assert_eq!(line.pop(Instant::from_nanos(10_000), &mut buffer), Some((End::A, SimEvent::TxDone)));
    assert_eq!(line.pop(Instant::from_nanos(10_000), &mut buffer), Some((End::B, SimEvent::Rx(1))));
    assert_eq!(line.pop(Instant::from_nanos(10_000), &mut buffer), None);
    assert_eq!(line.next_event(), None);
}

#[test]
fn coalescing_holds_characters_back_by_at_most_its_time() {
    let mut line = SimLine::new(SimConfig { coalesce: Span::from_nanos(2500), ..config() }, 0);
    line.write(End::A, Instant::START, &[1, 2, 3, 4]);
    assert_eq!(drain(&mut line), ["3500 B [01, 02, 03]", "4000 A TxDone", "4000 B [04]"]);
}

#[test]
fn a_level_does_not_wait_for_characters() {
    let mut line = SimLine::new(config(), 0);
    line.write(End::A, Instant::START, &[1, 2]);
    line.set_rts(End::A, Instant::from_nanos(500), false);
    assert_eq!(drain(&mut line), ["500 B Cts(false)", "1000 B [01]", "2000 A TxDone", "2000 B [02]"]);
}

#[test]
fn a_pulled_cable_swallows_in_its_time() {
    let mut line = SimLine::new(config(), 0);
    line.set_cut(true);
    line.write(End::A, Instant::START, &[1, 2]);
    assert_eq!(drain(&mut line), ["2000 A TxDone"]);
}

#[test]
#[should_panic(expected = "both ends of a half-duplex line")]
fn a_strict_half_duplex_line_panics_on_a_collision() {
    let mut line = SimLine::new(SimConfig { half_duplex: true, ..config() }, 0);
    line.write(End::A, Instant::START, &[1]);
    line.write(End::B, Instant::from_nanos(999), &[2]);
}

#[test]
#[should_panic(expected = "time goes back")]
fn a_strict_line_panics_when_time_goes_back() {
    let mut line = SimLine::new(config(), 0);
    line.write(End::A, Instant::from_nanos(10), &[1]);
    line.write(End::A, Instant::from_nanos(9), &[2]);
}

#[test]
fn a_lenient_half_duplex_line_counts_collisions_and_garbles() {
    let mut line = SimLine::new(SimConfig { half_duplex: true, strict: false, ..config() }, 0);
    line.write(End::A, Instant::START, &[1]);
    line.write(End::B, Instant::from_nanos(1000), &[2]); // the last bit of A is out: allowed
    line.write(End::A, Instant::from_nanos(1500), &[3]);
    assert_eq!(line.violations(), 1);
    let log = drain(&mut line);
    assert!(log.contains(&"2500 B Fault(Framing)".to_owned()), "{log:?}");
}

#[test]
fn the_same_seed_gives_the_same_faults_and_another_seed_others() {
    let run = |seed| {
        let mut line = SimLine::new(SimConfig { faults: FaultRates::all(20_000), ..config() }, seed);
        line.write(End::A, Instant::START, &[0x55; 500]);
        drain(&mut line)
    };
    assert_eq!(run(1), run(1));
    assert_ne!(run(1), run(2));
}

#[test]
fn rates_are_kept_and_faults_stop_in_time() {
    let until = 100_000 * T;
    let faults = FaultRates { flip: 10_000, lose: 20_000, parity: 5_000, ..FaultRates::NONE };
    let mut line = SimLine::new(SimConfig { faults, faults_until: Instant::START + until, ..config() }, 42);
    let (mut whole, mut flipped, mut parity) = (0, 0, 0);
    let mut buffer = [0; 64];
    let mut now = Instant::START;
    for _ in 0..100 {
        line.write(End::A, now, &[0; 2000]);
        while let Some(at) = line.next_event() {
            now = at;
            while let Some((_, event)) = line.pop(now, &mut buffer) {
                match event {
                    SimEvent::Rx(n) => {
                        flipped += buffer[..n].iter().filter(|b| b.count_ones() == 1).count();
                        whole += buffer[..n].iter().filter(|b| **b == 0).count();
                        assert!(now <= Instant::START + until + T || buffer[..n].iter().all(|b| *b == 0));
                    }
                    SimEvent::Fault(fault) => {
                        assert_eq!(fault, LineFault::Parity);
                        assert!(now <= Instant::START + until + T);
                        parity += 1;
                    }
                    _ => {}
                }
            }
        }
    }
    // 100,000 characters under faults: expected 1000 flips, 2000 losses, 500 parity errors.
    let lost = 200_000 - whole - flipped - parity;
    assert!((900..1100).contains(&flipped), "{flipped}");
    assert!((1850..2150).contains(&lost), "{lost}");
    assert!((430..570).contains(&parity), "{parity}");
}

#[test]
fn arrivals_keep_the_distance_of_a_character_whatever_goes_wrong() {
    let faults = FaultRates { double: 50_000, delay: 50_000, delay_max: 20 * T, ..FaultRates::NONE };
    let mut line = SimLine::new(SimConfig { faults, ..config() }, 7);
    line.write(End::A, Instant::START, &[0; 5000]);
    let mut buffer = [0; 64];
    let mut last = Instant::START;
    while let Some(now) = line.next_event() {
        while let Some((end, event)) = line.pop(now, &mut buffer) {
            if end == End::B {
                assert_eq!(event, SimEvent::Rx(1));
                assert!(now >= last + T);
                last = now;
            }
        }
    }
    assert!(last > Instant::START + 5000 * T);
}

#[test]
fn splitmix_matches_its_published_vector() {
    let mut rng = SplitMix64::new(1_234_567);
    let expected = [6_457_827_717_110_365_317, 3_203_168_211_198_807_973, 9_817_491_932_198_370_423_u64];
    for value in expected {
        assert_eq!(rng.next_u64(), value);
    }
}
