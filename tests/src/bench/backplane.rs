//! The back plane alone: a round trip of sixteen bytes between two spinning processes, compared with a round trip of
//! one word.

use std::path::Path;
use std::time::Instant;

use ob1_backplane::{CpSide, CpuSide, Segment};

use super::peer::{Failure, Peer, Words};
use super::{Figure, in_turns};

const ROUND_TRIPS: u64 = 20_000;
const ROUNDS: usize = 31;

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
    let mut through_registers = || {
        serial += 1;
        // Word by word: sixteen bytes compared at once would wait for the two words just stored.
        let mut registers = [0u8; 16];
        registers.as_chunks_mut().0.fill(serial.to_ne_bytes());
        cpu.write_outputs(&registers);
        loop {
            if cpu.inputs_changed() {
                let _ = cpu.read_inputs(&mut registers);
                if registers.as_chunks().0.iter().all(|word| u64::from_ne_bytes(*word) == serial) {
                    break;
                }
            }
            std::hint::spin_loop();
        }
    };
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
fn timed(segment: &Segment, role: &str, mut round_trip: impl FnMut()) -> Result<f64, Failure> {
    let _peer = Peer::start(role, segment)?;
    round_trip();
    let start = Instant::now();
    for _ in 0..ROUND_TRIPS {
        round_trip();
    }
    Ok(start.elapsed().as_nanos() as f64 / ROUND_TRIPS as f64)
}
