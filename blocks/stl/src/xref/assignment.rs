//! The assignment list of I, Q, M, T and C; symbols nothing uses; outputs written at several places.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::ops::Deref;

use ob1_ir::{Program, Symbol};
use ob1_model::{Area, BitAddr, BlockId, BlockKind};

use super::extent::{Extent, Wanted};
use super::query::of_symbol;
use super::text::in_set;
use super::{CrossReference, Reference};
use crate::mnemonics::Mnemonics;

/// What is used of a byte.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ByteUse {
    /// The bits that are used by themselves.
    pub bits: u8,
    /// The bits that a byte, a word or more reaches.
    pub wide: u8,
    /// Bytes, words, double words and more that begin here, and whether it is reached past the process image.
    pub widths: [bool; 4],
}

/// The letters of [`ByteUse::widths`].
const WIDTHS: [char; 4] = ['B', 'W', 'D', 'P'];

/// What is used of inputs, outputs, bit memory, timers and counters.
#[derive(Clone, Debug, Default)]
pub struct Assignment {
    /// The bytes in use, of the areas of [`AREAS`].
    pub bytes: [BTreeMap<u32, ByteUse>; 3],
    /// Timers in use, by number.
    pub timers: BTreeSet<u16>,
    /// Counters in use, by number.
    pub counters: BTreeSet<u16>,
}

/// The areas of an assignment list, with their German letters.
pub const AREAS: [(Area, &str); 3] = [(Area::Input, "E"), (Area::Output, "A"), (Area::Memory, "M")];

impl Assignment {
    fn add(&mut self, area: Area, at: u32, bits: u32, peripheral: bool) {
        let Some(bytes) = AREAS.iter().position(|(of, _)| *of == area).and_then(|at| self.bytes.get_mut(at)) else {
            return;
        };
        let last = (at.saturating_add(bits.max(1)) - 1).min(BitAddr::MAX_BYTE * 8 + 7);
        for byte in at / 8..=last / 8 {
            let row = bytes.entry(byte).or_default();
            let (from, to) = (at.max(byte * 8) - byte * 8, last.min(byte * 8 + 7) - byte * 8);
            let mask = (from..=to).fold(0u8, |mask, bit| mask | 1 << bit);
            if bits == 1 {
                row.bits |= mask;
            } else {
                row.wide |= mask;
            }
            row.widths[3] |= peripheral;
        }
        let width = match bits {
            0..=7 => return,
            8..=15 => 0,
            16..=31 => 1,
            _ => 2,
        };
        if let Some(row) = bytes.get_mut(&(at / 8)) {
            row.widths[width] = true;
        }
    }

    fn has(&self, area: Area, at: u32, bits: u32) -> bool {
        let Some(bytes) = AREAS.iter().position(|(of, _)| *of == area).and_then(|at| self.bytes.get(at)) else {
            return true;
        };
        let last = at.saturating_add(bits.max(1)) - 1;
        bytes.range(at / 8..=last / 8).any(|(byte, row)| {
            let (from, to) = (at.max(byte * 8) - byte * 8, last.min(byte * 8 + 7) - byte * 8);
            (from..=to).any(|bit| (row.bits | row.wide) >> bit & 1 == 1)
        })
    }

    /// As text, with the free places below the highest one in use.
    pub fn render(&self, set: Mnemonics) -> String {
        let mut out = String::from(
            "        7 6 5 4 3 2 1 0   x a bit, o part of more, B W D begin here, P past the process image\n",
        );
        for ((_, letter), bytes) in AREAS.iter().zip(&self.bytes) {
            for (byte, row) in bytes {
                let bits: Vec<&str> = (0..8u8)
                    .rev()
                    .map(|bit| match (row.bits >> bit & 1, row.wide >> bit & 1) {
                        (1, _) => "x",
                        (_, 1) => "o",
                        _ => ".",
                    })
                    .collect();
                let widths: String = WIDTHS.iter().zip(row.widths).filter(|(_, has)| *has).map(|(w, _)| *w).collect();
                let line = format!("{:<7} {}   {widths}", in_set(&format!("{letter} {byte}"), set), bits.join(" "));
                let _ = writeln!(out, "{}", line.trim_end());
            }
            let free = free(bytes.iter().map(|(byte, row)| (*byte, row.bits | row.wide)));
            if !bytes.is_empty() {
                let _ = writeln!(out, "free    {}\n", listed(&in_set(letter, set), &free));
            }
        }
        for (letter, used) in [("T", &self.timers), ("Z", &self.counters)] {
            if !used.is_empty() {
                let letter = in_set(letter, set);
                let numbers: Vec<String> = used.iter().map(|n| format!("{letter} {n}")).collect();
                let gaps: Vec<String> = gaps(used.iter().map(|n| u32::from(*n))).map(|(a, b)| range(a, b)).collect();
                let _ = writeln!(out, "{}\nfree    {}\n", numbers.join(", "), listed(&letter, &gaps));
            }
        }
        out
    }
}

fn listed(letter: &str, ranges: &[String]) -> String {
    if ranges.is_empty() { "none below the last one".into() } else { format!("{letter} {}", ranges.join(", ")) }
}

fn range(first: u32, last: u32) -> String {
    if first == last { first.to_string() } else { format!("{first} to {last}") }
}

/// The numbers that are missing below the highest one.
fn gaps(used: impl Iterator<Item = u32>) -> impl Iterator<Item = (u32, u32)> {
    let mut next = 0;
    used.filter_map(move |number| {
        let gap = (next < number).then(|| (next, number - 1));
        next = number + 1;
        gap
    })
}

/// The free bytes below the highest one in use, and the free bits of those in use.
fn free(bytes: impl Iterator<Item = (u32, u8)> + Clone) -> Vec<String> {
    let mut free: Vec<(u32, String)> =
        gaps(bytes.clone().map(|(byte, _)| byte)).map(|(first, last)| (first * 8, range(first, last))).collect();
    for (byte, used) in bytes {
        let mut bit = 0;
        while bit < 8 {
            let run = (bit..8).take_while(|bit| used >> bit & 1 == 0).count() as u32;
            if run > 0 {
                let last = bit + run - 1;
                let text = if run == 1 { format!("{byte}.{bit}") } else { format!("{byte}.{bit} to {byte}.{last}") };
                free.push((byte * 8 + bit, text));
            }
            bit += run + 1;
        }
    }
    free.sort();
    free.into_iter().map(|(_, text)| text).collect()
}

/// An output that several statements give a value.
#[derive(Clone, Debug)]
pub struct WrittenTwice<'x> {
    /// Its bits in German mnemonics: `A 4.0`.
    pub outputs: Vec<String>,
    /// The statements that write them.
    pub writers: Vec<&'x Reference>,
}

impl<P: Deref<Target = Program>> CrossReference<P> {
    /// What is used of inputs, outputs, bit memory, timers and counters.
    pub fn assignment(&self) -> Assignment {
        let mut all = Assignment::default();
        for reference in &self.all {
            match reference.extent {
                Extent::Bits { area: Area::Peripheral, at, bits } => {
                    let [reads, writes] = reference.access.does();
                    for (area, is) in [(Area::Input, reads), (Area::Output, writes)] {
                        if is {
                            all.add(area, at, bits, true);
                        }
                    }
                }
                Extent::Bits { area, at, bits } => all.add(area, at, bits, false),
                Extent::Timer(n) => {
                    all.timers.insert(n);
                }
                Extent::Counter(n) => {
                    all.counters.insert(n);
                }
                _ => {}
            }
        }
        all
    }

    /// The symbols that no statement uses. Organization blocks are called by the CPU.
    pub fn unused(&self) -> Vec<&Symbol> {
        let assignment = self.assignment();
        let mut blocks: BTreeSet<BlockId> = BTreeSet::new();
        for reference in &self.all {
            match reference.extent {
                Extent::Block(id) => {
                    blocks.insert(id);
                }
                Extent::Data { db: Some(db), .. } => {
                    blocks.insert(BlockId::new(BlockKind::Db, db));
                }
                _ => {}
            }
        }
        let is_used = |symbol: &Symbol| match of_symbol(symbol, &self.words).map(|(wanted, _)| wanted) {
            Some(Wanted::Bits { area: Area::Peripheral, at, bits, written }) => {
                written != Some(true) && assignment.has(Area::Input, at, bits)
                    || written != Some(false) && assignment.has(Area::Output, at, bits)
            }
            Some(Wanted::Bits { area, at, bits, .. }) => assignment.has(area, at, bits),
            Some(Wanted::Timers(n, _)) => assignment.timers.contains(&n),
            Some(Wanted::Counters(n, _)) => assignment.counters.contains(&n),
            Some(Wanted::Blocks(BlockKind::Ob, ..)) => true,
            Some(Wanted::Blocks(kind, n, _)) => blocks.contains(&BlockId::new(kind, n)),
            Some(Wanted::Data { db, .. }) => blocks.contains(&BlockId::new(BlockKind::Db, db)),
            // Names of data types and variable tables: no statement can use them.
            _ => true,
        };
        self.program.symbols.iter().filter(|symbol| !is_used(symbol)).collect()
    }

    /// The outputs that several statements write, at least one of them each time it runs. What a startup block writes
    /// is overwritten on purpose.
    pub fn written_twice(&self) -> Vec<WrittenTwice<'_>> {
        let mut writers: BTreeMap<u32, Vec<&Reference>> = BTreeMap::new();
        let is_startup = |id: BlockId| id.kind == BlockKind::Ob && (100..=102).contains(&id.number);
        for reference in &self.all {
            let (Extent::Bits { area, at, bits }, [_, true]) = (reference.extent, reference.access.does()) else {
                continue;
            };
            let is_output = matches!(area, Area::Output | Area::Peripheral) && reference.access != super::Access::Point;
            if is_output && !is_startup(reference.block) {
                let last = at.saturating_add(bits.max(1)).min((BitAddr::MAX_BYTE + 1) * 8);
                (at..last).for_each(|bit| writers.entry(bit).or_default().push(reference));
            }
        }
        let mut all: Vec<WrittenTwice<'_>> = Vec::new();
        for (bit, of) in writers {
            let places: BTreeSet<_> = of.iter().map(|r| (r.block, r.network, r.line)).collect();
            if places.len() < 2 || !of.iter().any(|r| r.assigns) {
                continue;
            }
            let name = format!("A {}", BitAddr(bit));
            match all.last_mut() {
                Some(last) if last.writers == of => last.outputs.push(name),
                _ => all.push(WrittenTwice { outputs: vec![name], writers: of }),
            }
        }
        all
    }
}
