//! Where an operand lies: an address, after the checks it needs.

use std::mem::offset_of;

use cranelift_codegen::ir::{InstBuilder, Value, condcodes::IntCC, types};
use ob1_cpu::engine::{Db, Hot, OWN_LOCAL, Regs};
use ob1_ir::{AddressRegister, Place, Pointer};
use ob1_model::Area;

use super::Translation;
use super::state::{Data, Reg, constant};
use crate::inline::Reference;
use crate::place;

/// The part of a pointer that is an address.
const POINTER_BITS: u32 = 0x7_FFFF;

/// Address of an operand: a pointer and an offset, and the bit.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Spot {
    pub(crate) base: Value,
    pub(crate) offset: u32,
    pub(crate) bit: BitAt,
    /// What an access by a computed base can reach.
    pub(crate) reach: Reach,
    /// Other accesses by this computed base follow.
    pub(crate) again: bool,
}

/// What an access can reach.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Reach {
    /// The block's own local data.
    Local,
    /// Bytes of the arena, which are or may be those of data blocks.
    Bytes {
        from: u32,
        to: u32,
        data: bool,
    },
    /// Any data block.
    Data,
    Anything,
}

impl Reach {
    /// Two accesses may be to the same bytes.
    pub(crate) const fn meets(self, other: Self) -> bool {
        match (self, other) {
            (Self::Anything, _) | (_, Self::Anything) | (Self::Local, Self::Local) | (Self::Data, Self::Data) => true,
            (Self::Local, _) | (_, Self::Local) => false,
            (Self::Bytes { data, .. }, Self::Data) | (Self::Data, Self::Bytes { data, .. }) => data,
            (Self::Bytes { from, to, .. }, Self::Bytes { from: first, to: last, .. }) => from < last && first < to,
        }
    }
}

impl Spot {
    /// At a known place of the arena or of the local data.
    pub(crate) const fn fixed(base: Value, offset: u32, bit: BitAt) -> Self {
        Self { base, offset, bit, reach: Reach::Anything, again: false }
    }
}

/// The place of a bit in its byte.
#[derive(Clone, Copy, Debug)]
pub(crate) enum BitAt {
    Known(u8),
    /// By the low three bits of a value.
    Computed(Value),
}

/// The reference to an actual parameter, which is no pointer, and the address of its byte.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Param {
    index: u16,
    reference: Value,
    base: Option<Value>,
}

/// Which data block register.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Which {
    Db,
    Di,
}

impl Translation<'_, '_> {
    /// The place of `bits` bits for statement `pc`.
    pub(crate) fn spot(&mut self, at: &Place, bits: u32, write: bool, pc: usize) -> Spot {
        match *at {
            Place::Fixed(area, at) => self.in_area(area, at.0, bits, write, pc),
            Place::InDb(n, at) => {
                self.open(Which::Db, n);
                self.in_data(Which::Db, at.0, bits, write, pc)
            }
            Place::InDi(n, at) => {
                self.open(Which::Di, n);
                self.in_data(Which::Di, at.0, bits, write, pc)
            }
            Place::Param { index, at } => self.param(index, at.0, bits, pc),
            Place::Instance(at) => self.instance(at.0, bits, pc),
            Place::Memory(area, pointer) => {
                let at = self.pointer(pointer);
                let mask = self.word(POINTER_BITS);
                let at = self.b.ins().band(at, mask);
                self.computed(area, at, bits, write, pc)
            }
            Place::Register(area, register, offset) => self.indirect(area, register, offset.0, bits, write, pc),
        }
    }

    /// A place at a known address of an area.
    fn in_area(&mut self, area: Area, at: u32, bits: u32, write: bool, pc: usize) -> Spot {
        let bit = BitAt::Known((at % 8) as u8);
        match area {
            Area::Local => {
                let offset = at / 8 + self.body.inlined.as_ref().map_or(0, |inlined| inlined.local);
                Spot::fixed(self.local, offset, bit)
            }
            Area::Db => self.in_data(Which::Db, at, bits, write, pc),
            Area::Di => self.in_data(Which::Di, at, bits, write, pc),
            _ => {
                let fixed = Place::Fixed(area, ob1_model::BitAddr(at));
                let offset = match place::class(&fixed, bits, self.plan) {
                    place::Class::Fixed(Some(byte)) => byte,
                    _ => {
                        self.never(pc);
                        0
                    }
                };
                Spot::fixed(self.arena, offset, bit)
            }
        }
    }

    /// The reference executes statement `pc`, always.
    pub(crate) fn never(&mut self, pc: usize) {
        let always = self.b.iconst(types::I8, 1);
        self.leave_if(always, pc);
    }

    /// A data block of the program, or none, as a register holds it.
    pub(crate) fn known_data(&self, number: u16) -> Data {
        match place::data(self.plan, number) {
            Some(db) => Data::Known(db),
            None => Data::Known(Db::default()),
        }
    }

    /// Opens a data block of the program. It is written to memory where somebody looks.
    pub(crate) fn open(&mut self, which: Which, number: u16) {
        let data = self.known_data(number);
        let (place, checked) = match which {
            Which::Db => (&mut self.now.db, &mut self.checked.db),
            Which::Di => (&mut self.now.di, &mut self.checked.di),
        };
        if *place == data {
            return;
        }
        *place = data;
        *checked = [0; 2];
        self.now.saved[which as usize] = false;
        self.checked.data[which as usize] = [None; 3];
        self.checked.bases[which as usize] = None;
        if which == Which::Di {
            self.checked.instance = None;
        }
    }

    /// A place at a known address of an opened data block.
    fn in_data(&mut self, which: Which, at: u32, bits: u32, write: bool, pc: usize) -> Spot {
        let bit = BitAt::Known((at % 8) as u8);
        let end = at / 8 + bits.div_ceil(8);
        let data = if which == Which::Db { self.now.db } else { self.now.di };
        if let Data::Known(db) = data {
            if end > if write { db.writable } else { db.len } {
                self.never(pc);
                return Spot::fixed(self.arena, 0, bit);
            }
            return Spot::fixed(self.arena, db.at.0 + at / 8, bit);
        }
        let how = usize::from(write);
        let known = match which {
            Which::Db => self.checked.db[how],
            Which::Di => self.checked.di[how],
        };
        if known < end {
            let room = self.data_part(which, 1 + how);
            let end_value = self.word(end);
            let short = self.b.ins().icmp(IntCC::UnsignedLessThan, room, end_value);
            self.leave_if(short, pc);
            let checked = match which {
                Which::Db => &mut self.checked.db,
                Which::Di => &mut self.checked.di,
            };
            // What can be written can be read.
            checked[how] = checked[how].max(end);
            checked[0] = checked[0].max(end);
        }
        let base = match self.checked.bases[which as usize] {
            Some(base) => base,
            None => {
                let first = self.data_part(which, 0);
                self.arena_at(first)
            }
        };
        self.checked.bases[which as usize] = Some(base);
        Spot { base, offset: at / 8, bit, reach: Reach::Data, again: true }
    }

    /// First byte (0), length (1) or writable length (2) of a data block register, as memory has it.
    fn data_part(&mut self, which: Which, part: usize) -> Value {
        if let Some(known) = self.checked.data[which as usize][part] {
            return known;
        }
        let register = if which == Which::Db { offset_of!(Regs, db) } else { offset_of!(Regs, di) };
        let at = [offset_of!(Db, at), offset_of!(Db, len), offset_of!(Db, writable)][part];
        let v = self.load_state(types::I32, self.run, Self::reg(register) + at);
        self.checked.data[which as usize][part] = Some(v);
        v
    }

    /// Address of a byte of the arena.
    fn arena_at(&mut self, byte: Value) -> Value {
        let byte = self.b.ins().uextend(types::I64, byte);
        self.b.ins().iadd(self.arena, byte)
    }

    /// Where an actual parameter lies: found at run time, or known in an inlined block.
    fn param(&mut self, index: u16, at: u32, bits: u32, pc: usize) -> Spot {
        if let Some(inlined) = &self.body.inlined {
            let (base, bit) = match inlined.refs.get(usize::from(index)).copied() {
                Some(Reference::Local(bit)) => (self.local, bit + at),
                Some(Reference::Arena(bit)) => (self.arena, bit + at),
                None => (self.arena, 0),
            };
            return Spot::fixed(base, bit / 8, BitAt::Known((bit % 8) as u8));
        }
        let mut param = self.reference(index, pc);
        if at > 0 {
            // The actual of a STRING may be shorter than its formal, and the arena end after it.
            let length = self.load_state(types::I32, self.hot, offset_of!(Hot, arena_len));
            let three = self.word(3);
            let behind = self.word(at);
            let first = self.b.ins().iadd(param.reference, behind);
            let byte = self.b.ins().ushr(first, three);
            let bytes = self.word(bits.div_ceil(8));
            let end = self.b.ins().iadd(byte, bytes);
            let outside = self.b.ins().icmp(IntCC::UnsignedGreaterThan, end, length);
            self.leave_if(outside, pc);
            if bits == 1 {
                let base = self.arena_at(byte);
                return Spot { base, offset: 0, bit: BitAt::Computed(first), reach: Reach::Anything, again: false };
            }
        }
        let base = match param.base {
            Some(base) => base,
            None => {
                let base = self.byte_at(param.reference);
                param.base = Some(base);
                self.checked.params.retain(|known| known.index != index);
                self.checked.params.push(param);
                base
            }
        };
        let bit = if bits == 1 { BitAt::Computed(param.reference) } else { BitAt::Known(0) };
        Spot { base, offset: at / 8, bit, reach: Reach::Anything, again: true }
    }

    /// The reference to an actual parameter; pointers are left to the reference engine.
    fn reference(&mut self, index: u16, pc: usize) -> Param {
        if let Some(known) = self.checked.params.iter().find(|known| known.index == index) {
            return *known;
        }
        let reference = self.load_state(types::I32, self.refs, usize::from(index) * 4);
        if !self.no_pointers {
            let zero = self.word(0);
            let pointer = self.b.ins().icmp(IntCC::SignedLessThan, reference, zero);
            self.leave_if(pointer, pc);
        }
        let param = Param { index, reference, base: None };
        self.checked.params.push(param);
        param
    }

    /// Address of the byte of a bit of the arena.
    fn byte_at(&mut self, bit: Value) -> Value {
        let three = self.word(3);
        let byte = self.b.ins().ushr(bit, three);
        self.arena_at(byte)
    }

    /// A variable of the instance. The whole instance is checked once.
    fn instance(&mut self, at: u32, bits: u32, pc: usize) -> Spot {
        let bit = BitAt::Known((at % 8) as u8);
        if let Some(first) = self.body.inlined.as_ref().and_then(|inlined| inlined.instance) {
            return Spot::fixed(self.arena, first + at / 8, bit);
        }
        debug_assert!(at / 8 + bits.div_ceil(8) <= self.body.instance_bytes, "verified");
        let spot = |base| Spot { base, offset: at / 8, bit, reach: Reach::Data, again: true };
        if let Some(base) = self.checked.instance {
            return spot(base);
        }
        let ar2 = self.address(1);
        let mask = self.word(POINTER_BITS);
        let place = self.b.ins().band(ar2, mask);
        let seven = self.word(7);
        let within = self.b.ins().band(place, seven);
        let three = self.word(3);
        let byte = self.b.ins().ushr(place, three);
        let bytes = self.word(self.body.instance_bytes);
        let end = self.b.ins().iadd(byte, bytes);
        let (first, room) = self.data_values(Which::Di, true);
        let short = self.b.ins().icmp(IntCC::UnsignedGreaterThan, end, room);
        let zero = self.word(0);
        let odd = self.b.ins().icmp(IntCC::NotEqual, within, zero);
        let bad = self.b.ins().bor(short, odd);
        self.leave_if(bad, pc);
        let byte = self.b.ins().iadd(first, byte);
        let base = self.arena_at(byte);
        self.checked.instance = Some(base);
        spot(base)
    }

    /// First byte and length of an opened data block.
    fn data_values(&mut self, which: Which, write: bool) -> (Value, Value) {
        match if which == Which::Db { self.now.db } else { self.now.di } {
            Data::Known(db) => (self.word(db.at.0), self.word(if write { db.writable } else { db.len })),
            Data::Var => (self.data_part(which, 0), self.data_part(which, 1 + usize::from(write))),
        }
    }

    /// The double word of a pointer.
    fn pointer(&mut self, pointer: Pointer) -> Value {
        let spot = self.in_area(pointer.area, pointer.at.0, 32, false, 0);
        self.read(spot, 32)
    }

    fn indirect(
        &mut self,
        area: Option<Area>,
        register: AddressRegister,
        offset: u32,
        bits: u32,
        write: bool,
        pc: usize,
    ) -> Spot {
        let index = usize::from(register == AddressRegister::Ar2);
        if let Reg::Known(pointer) = self.now.ar[index] {
            let at = pointer.wrapping_add(offset) & POINTER_BITS;
            let area = area.or_else(|| Area::from_pointer_code((pointer >> 24) as u8));
            let reachable = area.filter(|area| {
                !matches!(area, Area::Peripheral | Area::PreviousLocal) && (bits == 1 || at.is_multiple_of(8))
            });
            return match reachable {
                // Unlike a fixed operand, this one was not verified.
                Some(Area::Local) if at / 8 + bits.div_ceil(8) > self.local_len() => {
                    self.never(pc);
                    self.in_area(Area::Local, 0, bits, write, pc)
                }
                Some(area) => self.in_area(area, at, bits, write, pc),
                None => {
                    self.never(pc);
                    self.in_area(Area::Local, 0, bits, write, pc)
                }
            };
        }
        let pointer = self.address(index);
        let offset = self.word(offset);
        let at = self.b.ins().iadd(pointer, offset);
        let mask = self.word(POINTER_BITS);
        let at = self.b.ins().band(at, mask);
        match area {
            Some(area) => self.computed(area, at, bits, write, pc),
            None => self.crossing(pointer, at, bits, write, pc),
        }
    }

    /// Bytes of the local data of the block.
    fn local_len(&self) -> u32 {
        self.plan.blocks[self.block as usize].local_len
    }

    /// First byte in the arena and length of an area.
    fn area_values(&mut self, area: Area, write: bool) -> (Value, Value) {
        let range = match area {
            Area::Db => return self.data_values(Which::Db, write),
            Area::Di => return self.data_values(Which::Di, write),
            Area::Local => {
                let first = self.load_state(types::I32, self.run, Self::reg(offset_of!(Regs, local)));
                let length = self.word(self.local_len());
                return (first, length);
            }
            Area::Input => self.plan.areas.inputs,
            Area::Output => self.plan.areas.outputs,
            _ => self.plan.areas.memory,
        };
        (self.word(range.at.0), self.word(range.len))
    }

    /// A place at a computed bit address of an area.
    fn computed(&mut self, area: Area, at: Value, bits: u32, write: bool, pc: usize) -> Spot {
        let (first, length) = self.area_values(area, write);
        let reach = match (area, constant(&self.b, first), constant(&self.b, length)) {
            (Area::Local, ..) => Reach::Anything,
            (_, Some(first), Some(length)) => {
                let (from, to) = (first as u32, first as u32 + length as u32);
                Reach::Bytes { from, to, data: matches!(area, Area::Db | Area::Di) }
            }
            _ => Reach::Data,
        };
        Spot { reach, ..self.bounded(first, length, at, bits, pc) }
    }

    /// A place at bit `at` of an area; `at` has no bits but [`POINTER_BITS`].
    fn bounded(&mut self, first: Value, length: Value, at: Value, bits: u32, pc: usize) -> Spot {
        let three = self.word(3);
        // A pointer that does not point to a byte becomes so large that it is outside.
        let byte = if bits > 1 { self.b.ins().rotr(at, three) } else { self.b.ins().ushr(at, three) };
        let width = bits.div_ceil(8);
        let bad = match constant(&self.b, length) {
            Some(length) if length as u32 >= width => {
                let last = self.word(length as u32 - width);
                self.b.ins().icmp(IntCC::UnsignedGreaterThan, byte, last)
            }
            _ => {
                let width = self.word(width);
                let end = self.b.ins().iadd(byte, width);
                self.b.ins().icmp(IntCC::UnsignedGreaterThan, end, length)
            }
        };
        self.leave_if(bad, pc);
        let (base, offset) = match constant(&self.b, first) {
            Some(first) => (self.arena_at(byte), first as u32),
            None => {
                let byte = self.b.ins().iadd(first, byte);
                (self.arena_at(byte), 0)
            }
        };
        let bit = if bits > 1 { BitAt::Known(0) } else { BitAt::Computed(at) };
        Spot { base, offset, bit, reach: Reach::Anything, again: false }
    }

    /// An area-crossing pointer: the areas programs use; the others are left to the reference.
    fn crossing(&mut self, pointer: Value, at: Value, bits: u32, write: bool, pc: usize) -> Spot {
        let shift = self.word(24);
        let code = self.b.ins().ushr(pointer, shift);
        // What `L P##name` points to: the block's own local data, named as area V. The caller's is left to the
        // reference: its address is beyond the own.
        let (previous, own) = (self.word(u32::from(Area::PreviousLocal.pointer_code())), self.word(OWN_LOCAL * 8));
        let is_own = self.b.ins().icmp(IntCC::Equal, code, previous);
        let inside = self.b.ins().isub(at, own);
        let at = self.b.ins().select(is_own, inside, at);
        let local = self.word(u32::from(Area::Local.pointer_code()));
        let code = self.b.ins().select(is_own, local, code);
        let (mut first, mut length) = (self.word(0), self.word(0));
        for area in [Area::Output, Area::Input, Area::Local, Area::Di, Area::Memory, Area::Db] {
            let (area_first, area_length) = self.area_values(area, write);
            let wanted = self.word(u32::from(area.pointer_code()));
            let same = self.b.ins().icmp(IntCC::Equal, code, wanted);
            first = self.b.ins().select(same, area_first, first);
            length = self.b.ins().select(same, area_length, length);
        }
        self.bounded(first, length, at, bits, pc)
    }

    /// An address register: 0 is AR1, 1 is AR2.
    pub(crate) fn address(&mut self, index: usize) -> Value {
        match self.now.ar[index] {
            Reg::Var => self.b.use_var(self.vars.ar[index]),
            Reg::Known(value) => self.word(value),
            Reg::Val(v) => v,
        }
    }

    /// AR2 has changed: what was checked of the instance no longer holds.
    pub(crate) fn set_address(&mut self, index: usize, value: Reg) {
        self.now.ar[index] = value;
        if index == 1 {
            self.checked.instance = None;
        }
    }
}
