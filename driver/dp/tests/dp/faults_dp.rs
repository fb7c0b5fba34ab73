//! Data exchange with damaged telegrams: none is accepted wrong, in either direction.
//!
//! One telegram in a hundred is damaged in a way that is always detected according to the standard: up to three wrong
//! bits, of which parity does not detect two in one character; a missing character; a missing end; unreadable
//! characters. `cargo xtask faults dp --telegrams 1000000` runs that many exchanges, a test run some thousands.

use ob1_line::sim::{FaultRates, SplitMix64};

use crate::wires::{MS, Wires, config};

const SLAVES: usize = 4;
const BYTES: usize = 8;
/// Default without `OB1_TELEGRAMS`.
const EXCHANGES: u64 = 6000;

/// Bytes that only this sender makes of this number: the number and its seal.
fn sealed(sender: u64, number: u32) -> [u8; BYTES] {
    let seal = SplitMix64::new(sender << 32 | u64::from(number)).next_u64();
    let mut bytes = [0; BYTES];
    bytes[..4].copy_from_slice(&number.to_be_bytes());
    bytes[4..].copy_from_slice(&seal.to_be_bytes()[..4]);
    bytes
}

/// The number in such bytes.
///
/// # Panics
/// If this sender has not made them.
fn opened(sender: u64, bytes: &[u8]) -> u32 {
    let number = u32::from_be_bytes(bytes[..4].try_into().expect("eight bytes"));
    assert_eq!(bytes, sealed(sender, number), "accepted, and nobody has sent it (sender {sender})");
    number
}

#[expect(clippy::disallowed_methods, reason = "how long a run is, is asked for from outside")]
fn wanted() -> u64 {
    std::env::var("OB1_TELEGRAMS").map_or(EXCHANGES, |text| text.parse().expect("a number"))
}

/// Another seed in each part of a campaign (`--part`).
#[expect(clippy::disallowed_methods, reason = "which part of a campaign this is, is told from outside")]
fn seed(number: u64) -> u64 {
    let part = std::env::var("OB1_PART").ok();
    let part = part.as_ref().and_then(|part| part.split_once('/')?.0.parse::<u64>().ok()).unwrap_or(1);
    number + ((part - 1) << 32)
}

#[test]
fn none_is_accepted_wrong() {
    let wanted = wanted();
    // Unreadable characters, in addition to the damage below: 14 characters are a telegram.
    let faults = FaultRates { parity: 100, framing: 50, ..FaultRates::NONE };
    let mut wires = Wires::new(&config(500_000, SLAVES, BYTES), faults, seed(4711));
    wires.damage = Some((SplitMix64::new(seed(815)), 8000));
    for n in 0..SLAVES {
        wires.slaves[n].slave.inputs = sealed(n as u64, 0).to_vec();
    }
    let mut last = [[0_u32; SLAVES]; 2];
    let mut sent = [[0_u32; SLAVES]; 2];
    let mut exchanged = [0_u64; SLAVES];
    while wires.accepted < wanted {
        wires.run_with(100 * MS, |wires| {
            for n in 0..SLAVES {
                // New outputs for each exchange; a slave has outputs that were sent, and never older ones than before.
                let outputs = wires.slaves[n].slave.outputs.clone();
                if outputs.iter().any(|byte| *byte != 0) {
                    let number = opened(100 + n as u64, &outputs);
                    assert!(number <= sent[0][n] && number >= last[0][n], "outputs {number} behind {}", last[0][n]);
                    last[0][n] = number;
                }
                if wires.image.status[n].exchanges == exchanged[n] {
                    continue;
                }
                exchanged[n] = wires.image.status[n].exchanges;
                let inputs = &wires.image.inputs[n * BYTES..(n + 1) * BYTES];
                let number = opened(n as u64, inputs);
                assert!(number <= sent[1][n] && number >= last[1][n], "inputs {number} behind {}", last[1][n]);
                last[1][n] = number;
                sent[0][n] += 1;
                sent[1][n] += 1;
                wires.image.outputs[n * BYTES..(n + 1) * BYTES].copy_from_slice(&sealed(100 + n as u64, sent[0][n]));
                wires.slaves[n].slave.inputs = sealed(n as u64, sent[1][n]).to_vec();
            }
        });
    }
    let losses: u64 = wires.image.status.iter().map(|status| status.losses).sum();
    println!(
        "{} exchanges, {} telegrams damaged, {} answers rejected, {losses} losses, {} ms",
        wires.accepted,
        wires.damaged,
        wires.master.wires().rejected(),
        wires.now.millis()
    );
    assert!(wires.damaged * 100 > wires.accepted, "one in a hundred is to be damaged: {}", wires.damaged);
    assert!(last.iter().flatten().all(|number| *number > 0), "{last:?}");
}
