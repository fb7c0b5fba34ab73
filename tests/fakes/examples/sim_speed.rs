//! How many characters a second the simulated line carries: `cargo run --release -p ob1-fakes --example sim_speed`.
#![allow(clippy::disallowed_methods, clippy::disallowed_types)] // Measures with the real clock.

use ob1_fakes::sim_line::{End, SimConfig, SimEvent, SimLine};
use ob1_line::Instant;
use ob1_line::sim::FaultRates;

fn main() {
    for (name, faults) in [("clean", FaultRates::NONE), ("100 faults of each kind per million", FaultRates::all(100))] {
        let mut line = SimLine::new(SimConfig { faults, ..SimConfig::new(115_200, 20) }, 1);
        let mut buffer = [0; 64];
        let mut characters = 0_u64;
        let mut now = Instant::START;
        let begin = std::time::Instant::now();
        while characters < 20_000_000 {
            line.write(End::A, now, &[0x55; 250]);
            line.write(End::B, now, &[0xAA; 250]);
            while let Some(at) = line.next_event() {
                now = at;
                while let Some((_, event)) = line.pop(now, &mut buffer) {
                    if let SimEvent::Rx(n) = event {
                        characters += n as u64;
                    }
                }
            }
        }
        let rate = characters as f64 / begin.elapsed().as_secs_f64();
        println!("{name}: {:.1} million characters a second, one event each", rate / 1e6);
    }
}
