//! What memory holds, while nobody else looks: values written there are used again without reading them, and several
//! writes to one place become one. Bytes of a word are taken from it, and a word is put together from its bytes: a
//! processor that reads from memory what it has just written in other pieces waits until all of them have arrived.
//!
//! Before anybody may look (the reference, a safe point, a call, a jump back) everything is written; before an access
//! whose place is computed, whatever it can reach. A store of what nobody replaces lies here or, when many values wait,
//! where the oldest was known.

use std::cmp::Reverse;

use cranelift_codegen::cursor::{Cursor, FuncCursor};
use cranelift_codegen::ir::{Block, Function, Inst, InstBuilder, Opcode, Type, Value, ValueDef, types};

use super::Translation;
use super::operand::{Reach, Spot};
use super::state::Bit;

/// Places whose value waits to be written, at most: more would only move to the stack.
const WAITING: usize = 12;
/// How far before a value a slow instruction is looked for.
const NEAR: u32 = 8;
/// Places whose value is known, at most.
const KNOWN: usize = 64;

/// A place: its part, first byte, bytes.
pub(crate) type Place = (Part, u32, u32);

/// What the places of a part are counted from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Part {
    /// From the arena's first byte.
    Arena,
    /// From the first byte of the block's local data.
    Local,
    /// From an address that was computed, and is used again.
    At(Value),
}

/// A place of the code: behind this instruction of a block, or at its beginning.
pub(super) type Point = (Block, Option<Inst>);

#[derive(Clone, Copy, Debug)]
pub(super) struct Held {
    /// As wide as the place.
    pub(super) value: Value,
    pub(super) bytes: u32,
    pub(super) reach: Reach,
    /// Memory does not have it yet.
    pub(super) waits: bool,
    /// When it was read or written.
    pub(super) age: u64,
    /// Where it was known.
    pub(super) since: Point,
}

/// The part and the first byte of a place.
pub(super) type Key = (Part, u32);

/// Values by their places, in order: there are few, and each statement looks at most of them.
#[derive(Clone, Debug, Default)]
pub(crate) struct Cache {
    pub(super) held: Vec<(Key, Held)>,
    /// Bits of bytes that wait to be written: they replace those of the byte's value when somebody wants all of it.
    pub(super) bits: Vec<(Key, u8, Bit)>,
    pub(super) turns: u64,
}

impl Cache {
    /// Where the first place is that does not lie before this one.
    fn from(&self, key: Key) -> usize {
        self.held.partition_point(|(before, _)| *before < key)
    }

    fn find(&self, key: Key) -> Option<usize> {
        let index = self.from(key);
        self.held.get(index).is_some_and(|(found, _)| *found == key).then_some(index)
    }

    pub(super) fn get(&self, key: Key) -> Option<&Held> {
        self.find(key).map(|index| &self.held[index].1)
    }

    fn get_mut(&mut self, key: Key) -> Option<&mut Held> {
        self.find(key).map(|index| &mut self.held[index].1)
    }

    fn remove(&mut self, key: Key) -> Option<Held> {
        self.find(key).map(|index| self.held.remove(index).1)
    }

    pub(super) fn insert(&mut self, key: Key, held: Held) {
        let index = self.from(key);
        match self.held.get_mut(index) {
            Some((found, before)) if *found == key => *before = held,
            _ => self.held.insert(index, (key, held)),
        }
    }

    /// Forgets all but what waits to be written and the `most` newest places. Returns the places that are left.
    pub(super) fn keep(&mut self, most: usize) -> Vec<Place> {
        let mut ages: Vec<u64> = self.held.iter().filter(|(_, held)| !held.waits).map(|(_, held)| held.age).collect();
        ages.sort_unstable_by_key(|age| Reverse(*age));
        let least = ages.get(most.wrapping_sub(1)).copied().unwrap_or(0);
        self.held.retain(|(_, held)| held.waits || most > 0 && held.age >= least);
        self.held.iter().map(|(key, held)| (key.0, key.1, held.bytes)).collect()
    }

    /// The oldest of the places that wait to be written, if there are too many.
    fn waits_for_room(&self) -> Option<Key> {
        let waiting = || self.held.iter().filter(|(_, held)| held.waits);
        if waiting().count() <= WAITING {
            return None;
        }
        waiting().min_by_key(|(_, held)| held.age).map(|(key, _)| *key)
    }

    pub(super) fn waiting(&self) -> Vec<Place> {
        self.held.iter().filter(|(_, held)| held.waits).map(|(key, held)| (key.0, key.1, held.bytes)).collect()
    }

    /// Forgets the oldest places when there are too many.
    fn limit(&mut self) {
        while self.held.len() > KNOWN
            && let Some(key) =
                self.held.iter().filter(|(_, held)| !held.waits).min_by_key(|(_, held)| held.age).map(|(key, _)| *key)
        {
            self.remove(key);
        }
    }

    /// Places of one part that share bytes with this one, in order.
    fn overlapping(&self, part: Part, at: u32, bytes: u32) -> Vec<Key> {
        let near = self.held.iter().skip(self.from((part, at.saturating_sub(3))));
        let near = near.take_while(|(key, _)| *key < (part, at + bytes));
        near.filter(|((_, first), held)| first + held.bytes > at).map(|(key, _)| *key).collect()
    }

    /// Places of other parts that may be those that an access reaches.
    fn reached(&self, part: Option<Part>, reach: Reach) -> Vec<Key> {
        let other = |(key, held): &&(Key, Held)| Some(key.0) != part && held.reach.meets(reach);
        self.held.iter().filter(other).map(|(key, _)| *key).collect()
    }
}

impl Translation<'_, '_> {
    /// The part a place lies in. An address that is used once only is none.
    pub(super) fn part(&self, spot: Spot) -> Option<Part> {
        if spot.base == self.arena {
            Some(Part::Arena)
        } else if spot.base == self.local {
            Some(Part::Local)
        } else {
            spot.again.then_some(Part::At(spot.base))
        }
    }

    pub(super) fn base(&self, part: Part) -> Value {
        match part {
            Part::Arena => self.arena,
            Part::Local => self.local,
            Part::At(base) => base,
        }
    }

    /// Forgets all but what waits to be written and the `most` newest places. Returns the places in order.
    pub(crate) fn keep(&mut self, most: usize) -> Vec<Place> {
        if self.fast {
            self.write_back();
        }
        self.checked.cache.keep(if self.fast { 0 } else { most })
    }

    /// The values of places that are known.
    pub(crate) fn held(&mut self, places: &[Place]) -> Vec<Value> {
        places.iter().filter_map(|(part, at, _)| self.settled((*part, *at))).collect()
    }

    /// From here on these are the values of known places.
    pub(crate) fn hold(&mut self, places: &[Place], values: &[Value]) {
        let since = self.here();
        for ((part, at, _), value) in places.iter().zip(values) {
            if let Some(held) = self.checked.cache.get_mut((*part, *at)) {
                (held.value, held.since) = (*value, since);
            }
        }
    }

    /// What memory has at a place.
    pub(crate) fn load_place(&mut self, (part, at, bytes): Place) -> Value {
        self.load_arena(self.base(part), at, bytes)
    }

    /// Memory is known to have this value, or is to get it.
    pub(super) fn know(&mut self, (part, at, bytes): Place, value: Value, waits: bool, reach: Reach) {
        let since = self.here();
        let cache = &mut self.checked.cache;
        cache.turns += 1;
        cache.insert((part, at), Held { value, bytes, reach, waits, age: cache.turns, since });
    }

    /// The end of the code so far.
    pub(super) fn here(&mut self) -> Point {
        self.b.ensure_inserted_block();
        let block = self.b.current_block().expect("code is being made");
        (block, self.b.func.layout.last_inst(block))
    }

    pub(super) fn at(&mut self, (block, behind): Point) -> FuncCursor<'_> {
        let mut cursor = FuncCursor::new(self.b.func);
        match behind {
            Some(inst) => {
                cursor.use_srcloc(inst);
                cursor.after_inst(inst)
            }
            None => cursor.at_first_insertion_point(block),
        }
    }

    /// What an access to a place of a part can reach.
    fn fixed_reach(&self, part: Part, at: u32, bytes: u32) -> Reach {
        match part {
            Part::Local => Reach::Local,
            _ => Reach::Bytes { from: at, to: at + bytes, data: !self.plan.areas.is_image(at) },
        }
    }

    fn reach_of(&self, part: Option<Part>, spot: Spot, bytes: u32) -> Reach {
        match part {
            Some(part @ (Part::Arena | Part::Local)) => self.fixed_reach(part, spot.offset, bytes),
            _ => spot.reach,
        }
    }

    /// 8, 16 or 32 bits of memory.
    pub(crate) fn content(&mut self, spot: Spot, bits: u32) -> Value {
        let bytes = bits / 8;
        let part = self.part(spot);
        let reach = self.reach_of(part, spot, bytes);
        let Some(part) = part else {
            self.write_reached(None, reach);
            return self.load_arena(spot.base, spot.offset, bytes);
        };
        if self.checked.cache.get((part, spot.offset)).is_some_and(|held| held.bytes == bytes)
            && let Some(value) = self.settled((part, spot.offset))
        {
            return value;
        }
        if let Some(value) = self.within(part, spot.offset, bytes) {
            return value;
        }
        if let Some((value, waits)) = self.put_together(part, spot.offset, bytes) {
            self.know((part, spot.offset, bytes), value, waits, reach);
            return value;
        }
        for other in self.checked.cache.overlapping(part, spot.offset, bytes) {
            self.write_held(other, false);
            self.checked.cache.remove(other);
        }
        self.write_reached(Some(part), reach);
        let value = self.load_arena(spot.base, spot.offset, bytes);
        self.know((part, spot.offset, bytes), value, false, reach);
        self.checked.cache.limit();
        value
    }

    /// A part of a value that is held.
    fn within(&mut self, part: Part, at: u32, bytes: u32) -> Option<Value> {
        let cache = &mut self.checked.cache;
        let from = cache.from((part, at.saturating_sub(3)));
        let mut near = cache.held.iter_mut().skip(from).take_while(|(key, _)| *key <= (part, at));
        let ((_, first), held) = near.find(|((_, first), held)| *first + held.bytes >= at + bytes)?;
        cache.turns += 1;
        held.age = cache.turns;
        let (value, behind) = (held.value, *first + held.bytes - at - bytes);
        Some(self.cut_out(value, behind, bytes))
    }

    /// Bytes of a value, with so many behind them.
    fn cut_out(&mut self, value: Value, behind: u32, bytes: u32) -> Value {
        let ty = self.b.func.dfg.value_type(value);
        let by = self.b.iconst(ty, i64::from(behind * 8));
        let moved = if behind > 0 { self.b.ins().ushr(value, by) } else { value };
        self.b.ins().ireduce(integer(bytes), moved)
    }

    /// A value from those of all its bytes, which are forgotten; and whether memory lacks any of them.
    fn put_together(&mut self, part: Part, at: u32, bytes: u32) -> Option<(Value, bool)> {
        let pieces = self.checked.cache.overlapping(part, at, bytes);
        let mut end = at;
        for key in &pieces {
            if key.1 != end {
                return None;
            }
            end += self.checked.cache.get(*key)?.bytes;
        }
        if pieces.is_empty() || end != at + bytes {
            return None;
        }
        let ty = integer(bytes);
        let (mut whole, mut waits) = (None, false);
        for key in pieces {
            let value = self.settled(key)?;
            let held = self.checked.cache.remove(key)?;
            waits |= held.waits;
            let wide = self.b.ins().uextend(ty, value);
            let by = self.b.iconst(ty, i64::from((end - key.1 - held.bytes) * 8));
            let moved = if end == key.1 + held.bytes { wide } else { self.b.ins().ishl(wide, by) };
            whole = Some(whole.map_or(moved, |before| self.b.ins().bor(before, moved)));
        }
        Some((whole?, waits))
    }

    /// Memory holds `value` from here on.
    pub(crate) fn put_content(&mut self, spot: Spot, value: Value) {
        let bytes = self.b.func.dfg.value_type(value).bytes();
        let part = self.part(spot);
        let reach = self.reach_of(part, spot, bytes);
        for other in self.checked.cache.reached(part, reach) {
            self.write_held(other, false);
            self.checked.cache.remove(other);
        }
        let Some(part) = part else {
            let here = self.here();
            self.store_arena(spot.base, spot.offset, value, here);
            return;
        };
        for other in self.checked.cache.overlapping(part, spot.offset, bytes) {
            self.cut_off(other, spot.offset, spot.offset + bytes);
        }
        self.know((part, spot.offset, bytes), value, true, reach);
        while let Some(oldest) = self.checked.cache.waits_for_room() {
            // Nothing since it was known looks at it, and the value need not be kept until here.
            self.write_held(oldest, true);
        }
        self.checked.cache.limit();
    }

    /// Of a value that is held only the bytes outside of a range are left, each part of them as a value of its own.
    fn cut_off(&mut self, key: Key, from: u32, to: u32) {
        self.checked.cache.set_bits(key, &[]);
        let Some(held) = self.checked.cache.remove(key) else { return };
        let end = key.1 + held.bytes;
        for (mut at, to) in [(key.1, from.min(end)), (to.max(key.1), end)] {
            while at < to {
                let bytes = if to - at >= 2 { 2 } else { 1 };
                let value = self.cut_out(held.value, end - at - bytes, bytes);
                let reach = match key.0 {
                    Part::At(_) => held.reach,
                    part => self.fixed_reach(part, at, bytes),
                };
                self.know((key.0, at, bytes), value, held.waits, reach);
                at += bytes;
            }
        }
    }

    /// Writes what waits in other parts and may lie where an access reaches.
    fn write_reached(&mut self, part: Option<Part>, reach: Reach) {
        for key in self.checked.cache.reached(part, reach) {
            self.write_held(key, false);
        }
    }

    /// Writes what waits to be written.
    pub(crate) fn write_back(&mut self) {
        for (part, at, _) in self.checked.cache.waiting() {
            self.write_held((part, at), false);
        }
    }

    /// Before a branch: writes what waits and takes long to calculate. A store keeps its calculation before the branch,
    /// where it goes on while the processor finds out that it has guessed the wrong way.
    pub(crate) fn write_slow(&mut self) {
        let (block, _) = self.here();
        for (part, at, _) in self.checked.cache.waiting() {
            let held = self.checked.cache.get((part, at));
            if held.is_some_and(|held| is_slow(self.b.func, held.value, block, NEAR)) {
                self.write_held((part, at), false);
            }
        }
    }

    /// Writes a value if it waits: here, or `early` where it was known.
    pub(super) fn write_held(&mut self, key: Key, early: bool) {
        if self.checked.cache.get(key).is_none_or(|held| !held.waits) {
            return;
        }
        let Some(value) = self.settled(key) else { return };
        let Some(held) = self.checked.cache.get_mut(key) else { return };
        held.waits = false;
        let at = if early { held.since } else { self.here() };
        self.store_arena(self.base(key.0), key.1, value, at);
    }

    fn load_arena(&mut self, base: Value, offset: u32, bytes: u32) -> Value {
        let flags = self.arena_flags();
        let value = self.b.ins().load(integer(bytes), flags, base, offset as i32);
        if bytes == 1 { value } else { self.b.ins().bswap(value) }
    }

    fn store_arena(&mut self, base: Value, offset: u32, value: Value, at: Point) {
        let flags = self.arena_flags();
        let wide = self.b.func.dfg.value_type(value) != types::I8;
        let mut at = self.at(at);
        let value = if wide { at.ins().bswap(value) } else { value };
        at.ins().store(flags, value, base, offset as i32);
    }
}

/// The block calculates a product, a quotient or a root for this value, at most so many steps before it.
fn is_slow(func: &Function, value: Value, block: Block, steps: u32) -> bool {
    let ValueDef::Result(inst, _) = func.dfg.value_def(value) else { return false };
    let slow = matches!(func.dfg.insts[inst].opcode(), Opcode::Imul | Opcode::Sdiv | Opcode::Fdiv | Opcode::Sqrt);
    let further = |arg: &Value| is_slow(func, *arg, block, steps - 1);
    func.layout.inst_block(inst) == Some(block) && (slow || steps > 0 && func.dfg.inst_args(inst).iter().any(further))
}

/// The type of an integer of 1, 2 or 4 bytes.
pub(super) const fn integer(bytes: u32) -> Type {
    match bytes {
        1 => types::I8,
        2 => types::I16,
        _ => types::I32,
    }
}
