//! Memory where jumps meet: values that are known on all paths stay known, and what waits to be written still waits.

use cranelift_codegen::ir::Value;
use cranelift_frontend::Variable;

use super::Translation;
use super::cache::{Held, Key, Part, Place, integer};
use super::operand::{BitAt, Spot};
use super::state::Bit;

/// Places whose values are known where jumps meet, at most, besides those that wait to be written.
const SENT: usize = 8;

/// A place that is known where jumps meet.
#[derive(Clone, Debug)]
pub(crate) struct Met {
    pub(crate) place: Place,
    held: Held,
    bits: Vec<(u8, Bit)>,
    /// All paths so far have this value since the same point of the code. Otherwise it is in the place's variable.
    same: bool,
}

impl Translation<'_, '_> {
    /// Jumps meet before statement `pc`: the variables of its places get their values. Only places known on all paths
    /// are known there, besides those that wait to be written: the first path decides which these are.
    pub(crate) fn send_places(&mut self, pc: usize) {
        if self.fast || self.body.loops[pc] {
            self.write_back();
            return;
        }
        let before = self.body.meeting[pc].take().unwrap_or_else(|| self.first_met(pc));
        let mut all = Vec::with_capacity(before.len());
        for met in before {
            let Some((met, value)) = self.met_again(met) else { continue };
            let var = self.variable(met.place);
            self.b.def_var(var, value);
            all.push(met);
        }
        for place in self.checked.cache.waiting() {
            if !all.iter().any(|met| met.place == place) {
                self.write_held((place.0, place.1), false);
            }
        }
        self.body.meeting[pc] = Some(all);
    }

    fn first_met(&self, pc: usize) -> Vec<Met> {
        let mut cache = self.checked.cache.clone();
        cache.held.retain(|(key, _)| !matches!(key.0, Part::At(_)));
        let sent = cache.keep(SENT);
        // The reference comes back with what memory has.
        let same = self.body.inlined.is_some() || !self.body.entries[pc];
        let met =
            |(place, (key, held)): (Place, &(Key, Held))| Met { place, held: *held, bits: cache.bits_of(*key), same };
        sent.into_iter().zip(&cache.held).map(met).collect()
    }

    /// The place and its value on one more path.
    fn met_again(&mut self, mut met: Met) -> Option<(Met, Value)> {
        let (part, at, bytes) = met.place;
        let held = self.checked.cache.get((part, at)).filter(|held| held.bytes == bytes).copied();
        if let Some(held) = held {
            met.same &= (held.value, held.since) == (met.held.value, met.held.since)
                && self.checked.cache.bits_of((part, at)) == met.bits;
            met.held.waits |= held.waits;
        } else if met.held.waits {
            // It waits on another path: here it gets the value that memory has.
            met.same = false;
        } else {
            return None;
        }
        let value = self.content(Spot::fixed(self.base(part), at, BitAt::Known(0)), bytes * 8);
        Some((met, value))
    }

    /// What is known where jumps have met.
    pub(crate) fn take_places(&mut self, pc: usize) {
        for Met { place, held, bits, same } in self.body.meeting[pc].clone().unwrap_or_default() {
            if same {
                let (cache, key) = (&mut self.checked.cache, (place.0, place.1));
                cache.turns = cache.turns.max(held.age);
                cache.insert(key, held);
                cache.set_bits(key, &bits);
            } else {
                let var = self.variable(place);
                let value = self.b.use_var(var);
                self.know(place, value, held.waits, held.reach);
            }
        }
    }

    /// The variable of a place, for where jumps meet.
    pub(crate) fn variable(&mut self, place: Place) -> Variable {
        if let Some(var) = self.places.get(&place) {
            return *var;
        }
        let var = self.b.declare_var(integer(place.2));
        self.places.insert(place, var);
        var
    }
}
