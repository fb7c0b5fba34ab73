//! What link access costs a scan: a thousand items of four bytes, copied into the window of a link at each cycle
//! control point, compared with a plain copy of the same ranges in the same run.

use std::sync::atomic::{AtomicBool, Ordering};

use ob1_access::door::{Door, Reading};
use ob1_access::{Cell, Piece, Right};
use ob1_broker::{Broker, LinkConfig, feed};
use ob1_cpu::{Clock, Command, Cpu, CpuConfig};
use ob1_socket::handover;
use ob1_stl::{Library, Options, Source};
use ob1_time::Instant;

use super::peer::Failure;
use super::{Figure, median};
use crate::sim::facts::Bare;

/// Items, and bytes of each.
const ITEMS: usize = 1000;
const BYTES: usize = 4;
/// Bytes of their data block.
const BLOCK: usize = 64_000;
/// Scans of one measurement.
const SCANS: usize = 20_000;
/// Concurrent readers.
const READERS: usize = 32;

/// The figures: contiguous items, items in a cache line each, and the latter with 32 concurrent readers.
///
/// # Errors
/// If the CPU cannot be built, or nothing can be read.
pub fn figures() -> Result<Vec<Figure>, Failure> {
    Ok(vec![
        measure("1,000 items of 4 bytes, together", BYTES, 0)?,
        measure("1,000 items of 4 bytes, each in its line", BLOCK / ITEMS, 0)?,
        measure("the same, 32 readers beside it", BLOCK / ITEMS, READERS)?,
    ])
}

/// A CPU whose link has asked for [`ITEMS`] items of [`BYTES`] bytes.
pub(super) struct Rig<C> {
    cpu: Cpu,
    broker: Broker,
    door: Door,
    pieces: Vec<Piece>,
    reading: Reading,
    clock: C,
}

impl<C: Clock> Rig<C> {
    /// The items lie `stride` bytes apart.
    pub(super) fn new(stride: usize, clock: C) -> Result<Self, Failure> {
        let text = format!(
            "DATA_BLOCK DB 7\nSTRUCT\n a : ARRAY[0..{}] OF DWORD;\nEND_STRUCT\nBEGIN\nEND_DATA_BLOCK\n\
             ORGANIZATION_BLOCK OB 1\nBEGIN\nNETWORK\nL MW 0; + 1; T MW 0;\nEND_ORGANIZATION_BLOCK\n",
            BLOCK / 4 - 1
        );
        let source = Source { name: "bench.awl".into(), bytes: text.into_bytes() };
        let output = ob1_stl::compile(&[source], &Library::new(), &Options::default());
        let cpu = Cpu::new(CpuConfig::default(), &output.program, vec![], vec![], ob1_cpu::engine::REFERENCE);
        let mut cpu = cpu.map_err(|errors| format!("the program does not load: {errors:?}"))?;
        let link = LinkConfig { name: "bench".into(), rights: Right::Read, ..LinkConfig::default() };
        let mut broker = Broker::new(&mut cpu, vec![link], feed().1, Box::new(Bare))?;
        let (ours, theirs) = handover::pair()?;
        broker.connect(0, ours, Instant::START);
        let door = Door::new(theirs)?;
        let at = |item: usize| Cell::Db(7, (item * stride * 8) as u32);
        let pieces = (0..ITEMS).map(|item| Piece::Bytes { at: at(item), len: BYTES as u32 }).collect();
        let mut rig = Self { cpu, broker, door, pieces, reading: Reading::new(), clock };
        rig.cpu.request(Command::Warm);
        for _ in 0..100 {
            rig.cycle();
            rig.broker.step(rig.clock.now());
            rig.door.pump()?;
            rig.read();
        }
        rig.door.read(&rig.pieces, &mut rig.reading)?;
        Ok(rig)
    }

    pub(super) fn cycle(&mut self) {
        self.cpu.cycle(&mut self.clock);
    }

    pub(super) fn read(&mut self) {
        let _ = self.door.read(&self.pieces, &mut self.reading);
    }
}

fn measure(what: &'static str, stride: usize, readers: usize) -> Result<Figure, Failure> {
    let Rig { mut cpu, broker, mut clock, door: _door, .. } = Rig::new(stride, ob1_rt::MonotonicClock::start())?;
    let before = cpu.accounts().figures();
    let (memory, mut copy) = (vec![7u8; BLOCK], vec![0u8; ITEMS * BYTES]);
    let mut bare = Vec::with_capacity(SCANS);
    let done = AtomicBool::new(false);
    std::thread::scope(|scope| {
        for _ in 0..readers {
            let through = broker.window(0);
            let done = &done;
            scope.spawn(move || {
                while !done.load(Ordering::Relaxed) {
                    let sum = through.as_ref().and_then(|window| {
                        window.read(|_, words| words.iter().map(|word| word.load(Ordering::Relaxed)).max())
                    });
                    std::hint::black_box(sum);
                    std::thread::yield_now();
                }
            });
        }
        for _ in 0..SCANS {
            cpu.cycle(&mut clock);
            let from = clock.time();
            for (item, to) in copy.chunks_exact_mut(BYTES).enumerate() {
                if let Some(bytes) = memory.get(item * stride..item * stride + BYTES) {
                    to.copy_from_slice(bytes);
                }
            }
            std::hint::black_box(&mut copy);
            bare.push((clock.time() - from).nanos() as f64);
        }
        done.store(true, Ordering::Relaxed);
    });
    let links = cpu.accounts().figures().since(&before).links.distribution();
    let floor = median(&mut bare);
    let value = links.p50.nanos() as f64;
    Ok(Figure {
        what: what.into(),
        value,
        unit: "ns",
        floor: Some(("a bare copy of the same ranges", floor)),
        aim: ("<= 1.5 x + 500 ns", value <= 1.5 * floor + 500.0),
    })
}
