//! What memory at known places holds, while nobody else looks: values written there are used again without reading
//! them, and several writes to one place become one.
//!
//! Before anybody may look (the reference, a safe point, a call, a place where jumps meet, an access whose place is
//! computed) everything is written.

use std::cmp::Reverse;
use std::collections::BTreeMap;

use cranelift_codegen::ir::{InstBuilder, Value, types};
use cranelift_frontend::Variable;

use super::Translation;
use super::operand::Spot;

/// Places whose value waits to be written, at most: more would only move to the stack.
const WAITING: usize = 12;
/// Places whose values are known where jumps meet, at most.
const SENT: usize = 8;
/// Places whose value is known, at most.
const KNOWN: usize = 64;

/// A place: its part, first byte, bytes.
pub(crate) type Place = (Part, u32, u32);

/// The part of the arena, in which places do not overlap those of the other.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Part {
    /// From the arena's first byte.
    Arena,
    /// From the first byte of the block's local data.
    Local,
}

#[derive(Clone, Copy, Debug)]
struct Held {
    /// As wide as the place.
    value: Value,
    bytes: u32,
    /// Memory does not have it yet.
    waits: bool,
    /// When it was read or written.
    age: u64,
}

/// Values by their places.
#[derive(Clone, Debug, Default)]
pub(crate) struct Cache {
    held: BTreeMap<(Part, u32), Held>,
    turns: u64,
}

impl Cache {
    /// Nothing is known; nothing waits.
    pub(crate) fn forget(&mut self) {
        debug_assert!(self.held.values().all(|held| !held.waits), "written before");
        self.held.clear();
    }

    /// Forgets all but what waits to be written and the `most` newest places. Returns the places that are left.
    fn keep(&mut self, most: usize) -> Vec<Place> {
        let mut ages: Vec<u64> = self.held.values().filter(|held| !held.waits).map(|held| held.age).collect();
        ages.sort_unstable_by_key(|age| Reverse(*age));
        let least = ages.get(most.wrapping_sub(1)).copied().unwrap_or(0);
        self.held.retain(|_, held| held.waits || most > 0 && held.age >= least);
        self.held.iter().map(|(key, held)| (key.0, key.1, held.bytes)).collect()
    }

    /// Forgets the oldest place when there are too many.
    fn limit(&mut self) {
        if self.held.len() > KNOWN
            && let Some(key) =
                self.held.iter().filter(|(_, held)| !held.waits).min_by_key(|(_, held)| held.age).map(|(key, _)| *key)
        {
            self.held.remove(&key);
        }
    }

    /// Places that share bytes with this one.
    fn overlapping(&self, part: Part, at: u32, bytes: u32) -> Vec<(Part, u32)> {
        let from = at.saturating_sub(3);
        let range = (part, from)..(part, at + bytes);
        let shares = |((_, first), held): &(&(Part, u32), &Held)| *first + held.bytes > at;
        self.held.range(range).filter(shares).map(|(key, _)| *key).collect()
    }
}

impl Translation<'_, '_> {
    /// The part a place lies in, when it is known.
    fn part(&self, spot: Spot) -> Option<Part> {
        if spot.base == self.arena {
            Some(Part::Arena)
        } else if spot.base == self.local {
            Some(Part::Local)
        } else {
            None
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
    pub(crate) fn held(&self, places: &[Place]) -> Vec<Value> {
        places.iter().filter_map(|(part, at, _)| Some(self.checked.cache.held.get(&(*part, *at))?.value)).collect()
    }

    /// From here on these are the values of known places.
    pub(crate) fn hold(&mut self, places: &[Place], values: &[Value]) {
        for ((part, at, _), value) in places.iter().zip(values) {
            if let Some(held) = self.checked.cache.held.get_mut(&(*part, *at)) {
                held.value = *value;
            }
        }
    }

    /// What memory has at a place.
    pub(crate) fn load_place(&mut self, (part, at, bytes): Place) -> Value {
        let base = if part == Part::Arena { self.arena } else { self.local };
        self.load_arena(Spot { base, offset: at, bit: super::operand::BitAt::Known(0) }, bytes * 8)
    }

    /// Jumps meet before statement `pc`: the variables of its places get their values. Only places known on all paths
    /// are known there.
    pub(crate) fn send_places(&mut self, pc: usize) {
        if self.fast || self.body.loops[pc] {
            return;
        }
        let mut cache = self.checked.cache.clone();
        let sent = cache.keep(SENT);
        let all = match self.body.meeting[pc].take() {
            None => sent,
            Some(before) => before.into_iter().filter(|place| sent.contains(place)).collect(),
        };
        for place in &all {
            let value = cache.held[&(place.0, place.1)].value;
            let var = self.variable(*place);
            self.b.def_var(var, value);
        }
        self.body.meeting[pc] = Some(all);
    }

    /// What is known where jumps have met.
    pub(crate) fn take_places(&mut self, pc: usize) {
        for place in self.body.meeting[pc].clone().unwrap_or_default() {
            let var = self.variable(place);
            let value = self.b.use_var(var);
            self.know(place, value);
        }
    }

    /// Memory is known to have this value.
    fn know(&mut self, (part, at, bytes): Place, value: Value) {
        let cache = &mut self.checked.cache;
        cache.turns += 1;
        cache.held.insert((part, at), Held { value, bytes, waits: false, age: cache.turns });
    }

    /// The variable of a place, for where jumps meet.
    pub(crate) fn variable(&mut self, place: Place) -> Variable {
        if let Some(var) = self.places.get(&place) {
            return *var;
        }
        let ty = match place.2 {
            1 => types::I8,
            2 => types::I16,
            _ => types::I32,
        };
        let var = self.b.declare_var(ty);
        self.places.insert(place, var);
        var
    }

    /// 8, 16 or 32 bits of memory.
    pub(crate) fn content(&mut self, spot: Spot, bits: u32) -> Value {
        let bytes = bits / 8;
        let Some(part) = self.part(spot) else {
            self.write_back();
            return self.load_arena(spot, bits);
        };
        let key = (part, spot.offset);
        if let Some(held) = self.checked.cache.held.get(&key).filter(|held| held.bytes == bytes) {
            return held.value;
        }
        for other in self.checked.cache.overlapping(part, spot.offset, bytes) {
            self.write_held(other);
            self.checked.cache.held.remove(&other);
        }
        let value = self.load_arena(spot, bits);
        self.checked.cache.turns += 1;
        let age = self.checked.cache.turns;
        self.checked.cache.held.insert(key, Held { value, bytes, waits: false, age });
        self.checked.cache.limit();
        value
    }

    /// Memory holds `value` from here on.
    pub(crate) fn put_content(&mut self, spot: Spot, value: Value) {
        let bytes = self.b.func.dfg.value_type(value).bytes();
        let Some(part) = self.part(spot) else {
            self.write_back();
            self.store_arena(spot.base, spot.offset, value);
            // It may lie anywhere.
            self.checked.cache.forget();
            return;
        };
        for other in self.checked.cache.overlapping(part, spot.offset, bytes) {
            let held = self.checked.cache.held[&other];
            let covered = other.1 >= spot.offset && other.1 + held.bytes <= spot.offset + bytes;
            if !covered {
                self.write_held(other);
            }
            self.checked.cache.held.remove(&other);
        }
        let cache = &mut self.checked.cache;
        cache.turns += 1;
        let age = cache.turns;
        cache.held.insert((part, spot.offset), Held { value, bytes, waits: true, age });
        let waiting = cache.held.iter().filter(|(_, held)| held.waits);
        if waiting.clone().count() > WAITING
            && let Some(key) = waiting.min_by_key(|(_, held)| held.age).map(|(key, _)| *key)
        {
            self.write_held(key);
        }
        self.checked.cache.limit();
    }

    /// Writes what waits to be written.
    pub(crate) fn write_back(&mut self) {
        let waiting: Vec<_> =
            self.checked.cache.held.iter().filter(|(_, held)| held.waits).map(|(key, _)| *key).collect();
        for key in waiting {
            self.write_held(key);
        }
    }

    fn write_held(&mut self, key: (Part, u32)) {
        let Some(held) = self.checked.cache.held.get_mut(&key).filter(|held| held.waits) else { return };
        held.waits = false;
        let value = held.value;
        let base = if key.0 == Part::Arena { self.arena } else { self.local };
        self.store_arena(base, key.1, value);
    }

    fn load_arena(&mut self, spot: Spot, bits: u32) -> Value {
        let flags = self.arena_flags();
        let ty = match bits {
            8 => types::I8,
            16 => types::I16,
            _ => types::I32,
        };
        let value = self.b.ins().load(ty, flags, spot.base, spot.offset as i32);
        if bits == 8 { value } else { self.b.ins().bswap(value) }
    }

    fn store_arena(&mut self, base: Value, offset: u32, value: Value) {
        let flags = self.arena_flags();
        let wide = self.b.func.dfg.value_type(value) != types::I8;
        let value = if wide { self.b.ins().bswap(value) } else { value };
        self.b.ins().store(flags, value, base, offset as i32);
    }
}
