//! The guarantees of both ends, with heap segments. Tests that need a file or a process are in `tests/`.

// Both ends must run on two threads. The product code of this crate starts none.
#![allow(clippy::disallowed_methods)]

mod boxes;
mod buffer;
mod channel;
mod doorbell;
mod ends;
mod garbage;
mod image;
mod registers;
mod restart;
mod traffic;
mod window;

use crate::{CpSide, CpuSide, Segment};

/// Rounds of the stress tests: few if each step is interpreted.
const ROUNDS: u64 = if cfg!(miri) { 60 } else { 200_000 };

/// A fresh segment with both its ends.
fn both_ends(io_bytes: usize) -> (Segment, CpuSide, CpSide) {
    let segment = Segment::heap();
    let cpu = CpuSide::create(&segment, io_bytes).expect("a legal number of register bytes");
    let cp = CpSide::attach(&segment).expect("a segment just made");
    (segment, cpu, cp)
}

/// Offset of a field of the memory map.
fn at(name: &str) -> usize {
    let field = crate::layout::FIELDS.iter().find(|field| field.name == name);
    field.unwrap_or_else(|| panic!("no field {name}")).offset
}

/// Numbers without pattern, the same for the same seed (splitmix64).
struct Noise(u64);

impl Noise {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }
}

#[test]
fn the_memory_map_has_no_overlap_and_no_odd_corner() {
    let mut end = 0;
    for field in crate::layout::FIELDS {
        assert!(field.offset >= end, "{} lies over its neighbour", field.name);
        assert!(field.offset.is_multiple_of(8) && field.size.is_multiple_of(8), "{}", field.name);
        end = field.offset + field.size;
    }
    assert!(end <= crate::layout::SEGMENT_BYTES_BOXES);
    let before = crate::layout::FIELDS.iter().rfind(|field| !field.name.starts_with("boxes."));
    assert!(before.is_some_and(|field| field.offset + field.size <= crate::layout::SEGMENT_BYTES));
    // Data often written by one side share no pair of cache lines with data often written by the other side.
    let line = |name: &str| at(name) / 128;
    assert_ne!(line("outputs.sequence"), line("inputs.sequence"));
    assert_ne!(line("cpu.heartbeat"), line("cp.heartbeat"));
    assert_ne!(line("send_to_cp.sequence"), line("send_to_cpu.sequence"));
    assert_ne!(line("events.produced"), line("events.consumed"));
}
