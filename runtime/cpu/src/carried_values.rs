//! What data blocks keep when another program takes over: the components with the same name and type, wherever they
//! lie. Found out outside the scan; the scan copies what was found.

use ob1_ir::{DataBlock, Program};
use ob1_model::{Component, DataType, Field, Layout};

use crate::memory::Memory;

/// Data blocks whose layout changes, and what of them stays.
#[derive(Debug, Default)]
pub(crate) struct Carry {
    /// Their numbers, in ascending order.
    laid_out: Vec<u16>,
    moves: Vec<Move>,
    /// Data blocks with other start values, in ascending order.
    started: Vec<u16>,
}

/// Bits of a data block that lie elsewhere in the next one.
#[derive(Clone, Copy, Debug)]
struct Move {
    db: u16,
    from: u32,
    to: u32,
    bits: u32,
}

/// Of `next` what it takes over from `before`, and what is lost.
fn block(before: &DataBlock, next: &DataBlock, moves: &mut Vec<Move>, lost: &mut Vec<String>) {
    let mut walk = Walk { db: next.number, moves, lost };
    for old in &before.components {
        let path = format!("DB {}.{}", next.number, old.path);
        match next.components.iter().find(|new| new.path.eq_ignore_ascii_case(&old.path)) {
            None => walk.lost.push(format!("{path}: gone")),
            Some(new) => walk.pair(&path, (&old.ty, old.at.0), (&new.ty, new.at.0)),
        }
    }
}

struct Walk<'a> {
    db: u16,
    moves: &'a mut Vec<Move>,
    lost: &'a mut Vec<String>,
}

impl Walk<'_> {
    fn pair(&mut self, path: &str, (old, from): (&DataType, u32), (new, to): (&DataType, u32)) {
        if old == new {
            self.moves.push(Move { db: self.db, from, to, bits: Layout::bits(old) });
            return;
        }
        let (DataType::Struct(old_fields), DataType::Struct(new_fields)) = (old, new) else {
            self.lost.push(format!("{path}: of another type"));
            return;
        };
        let new_places = places(new_fields);
        // The nameless ones separate the sections of an instance.
        for (field, at) in places(old_fields).into_iter().filter(|(field, _)| !field.name.is_empty()) {
            let path = format!("{path}.{}", field.name);
            match new_places.iter().find(|(new, _)| new.name.eq_ignore_ascii_case(&field.name)) {
                None => self.lost.push(format!("{path}: gone")),
                Some((new, place)) => self.pair(&path, (&field.ty, from + at), (&new.ty, to + place)),
            }
        }
    }
}

fn places(fields: &[Field]) -> Vec<(&Field, u32)> {
    let mut layout = Layout::new();
    fields.iter().map(|field| (field, layout.place(&field.ty).0)).collect()
}

/// Each byte means what it meant before.
fn is_laid_out_so(before: &DataBlock, next: &DataBlock) -> bool {
    let same = |(old, new): (&Component, &Component)| {
        old.at == new.at && old.ty == new.ty && old.path.eq_ignore_ascii_case(&new.path)
    };
    let (old, new) = (&before.components, &next.components);
    let unknown = old.is_empty() || new.is_empty();
    before.bytes.len() == next.bytes.len() && (unknown || old.len() == new.len() && old.iter().zip(new).all(same))
}

/// The values that are lost where `next` follows `before`: `DB 5.level: gone`.
#[must_use]
pub fn lost_values(before: &Program, next: &Program) -> Vec<String> {
    Carry::new(before, next, &[]).1
}

impl Carry {
    pub(crate) fn new(before: &Program, next: &Program, fresh: &[u16]) -> (Self, Vec<String>) {
        let (mut carry, mut lost) = (Self::default(), Vec::new());
        let mut blocks: Vec<&DataBlock> = before.data.iter().collect();
        blocks.sort_unstable_by_key(|db| db.number);
        for old in blocks {
            let Some(new) = next.data.iter().find(|db| db.number == old.number) else {
                lost.push(format!("DB {}: gone", old.number));
                continue;
            };
            if fresh.contains(&old.number) {
                continue;
            }
            if !is_laid_out_so(old, new) {
                carry.laid_out.push(old.number);
                block(old, new, &mut carry.moves, &mut lost);
            } else if old.bytes != new.bytes {
                carry.started.push(old.number);
            }
        }
        (carry, lost)
    }
}

impl Memory {
    /// The values of the areas and of those data blocks that are not `fresh` (ascending).
    pub(crate) fn take_values(&mut self, before: &Self, fresh: &[u16], carry: &Carry) {
        let areas = [(self.inputs, before.inputs), (self.outputs, before.outputs), (self.memory, before.memory)];
        for (to, from) in areas {
            self.bytes[to.bytes()].copy_from_slice(&before.bytes[from.bytes()]);
        }
        let among = |list: &[u16], number| list.binary_search(&number).is_ok();
        for index in 0..self.program_dbs {
            let db = self.dbs[index];
            let other = among(fresh, db.number) || among(&carry.laid_out, db.number);
            let was = before.program_db(db.number).filter(|was| !other && was.len == db.len);
            let Some(was) = was else { continue };
            self.bytes[db.range().bytes()].copy_from_slice(&before.bytes[was.range().bytes()]);
            if !among(&carry.started, db.number) {
                self.take_load_values(before, db.number);
            }
        }
        for part in &carry.moves {
            let (Some(was), Some(db)) = (before.program_db(part.db), self.program_db(part.db)) else { continue };
            // Declarations longer than their block are none of ours.
            if part.from + part.bits > was.len * 8 || part.to + part.bits > db.len * 8 {
                continue;
            }
            if (part.from | part.to | part.bits) % 8 == 0 {
                let len = (part.bits / 8) as usize;
                let (from, to) = (was.at.plus(part.from / 8).index(), db.at.plus(part.to / 8).index());
                self.bytes[to..to + len].copy_from_slice(&before.bytes[from..from + len]);
                continue;
            }
            for bit in 0..part.bits {
                let value = before.read_bits(was.at.bit(part.from + bit), 1);
                self.write_bits(db.at.bit(part.to + bit), 1, value);
            }
        }
        self.adopt_made(before);
    }

    /// Has the system give it all its pages now: the scan that takes it over waits for none.
    pub(crate) fn touch(&mut self) {
        self.bytes.chunks_mut(4096).filter_map(|page| page.first_mut()).for_each(|byte| {
            *byte = std::hint::black_box(*byte);
        });
    }
}
