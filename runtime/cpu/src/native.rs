//! Native blocks: what they can ask of the CPU during a call.

use ob1_model::{Area, BitAddr, BlockId, Event, Fault, FaultKind, Section, Site, TimerKind};
use ob1_std::services::Services;
use ob1_std::{Abort, Context as _, Instance, ModuleSize, NativeArea, Refused};
use ob1_time::{Instant, Span};

use crate::arena::{ArenaBit, Range};
use crate::context::Context;
use crate::engine::{Callee, Entry, Interrupted, POINTER_BITS, RAW};
use crate::natives::{Formal, Native};
use crate::scan_position::Packed;
use crate::timers::Counter;
use crate::{IoError, ModuleStatus, NativeArg, NativeContext, ObInfo, ShortText, TimerState};

/// Calls a native block from the statement at `site`; the answer is the binary result it leaves.
#[inline]
pub(crate) fn call(index: u32, site: Packed, entry: &Entry, cx: &mut Context<'_>) -> Result<bool, Abort> {
    let Some(native) = cx.blocks.natives.get(index as usize) else { return Ok(true) };
    if native.is_plugin {
        cx.machine.position.call(site);
    }
    let br = match native.account {
        None => run(native, entry, cx)?,
        Some(account) => timed(native, account, entry, cx)?,
    };
    if cx.machine.services.touched {
        cx.machine.reschedule();
    }
    // Also when the block has ignored the refusal.
    if cx.machine.hot.stopping || cx.machine.aborted { Err(Abort) } else { Ok(br) }
}

#[inline]
fn run(native: &Native, entry: &Entry, cx: &mut Context<'_>) -> Result<bool, Abort> {
    let outer = cx.blocks.running.replace(native.word);
    let mut call = Call { cx, native, entry, br: true };
    let result = native.block.call(&mut call);
    let br = call.br;
    cx.blocks.running.replace(outer);
    result.map(|()| br)
}

/// The same with the time it takes, without organization blocks and plugin blocks that run within it. The CPU's own
/// time does not move by these readings of the clock.
fn timed(native: &Native, account: u32, entry: &Entry, cx: &mut Context<'_>) -> Result<bool, Abort> {
    let inside = cx.machine.inside;
    let outer = std::mem::take(&mut cx.machine.trace.nested);
    let began = cx.machine.time(cx.clock);
    let result = run(native, entry, cx);
    let whole = cx.machine.time(cx.clock).since(began);
    let machine = &mut *cx.machine;
    let nested = machine.inside.saturating_sub(inside).saturating_add(machine.trace.nested);
    machine.trace.nested = outer.saturating_add(whole);
    machine.trace.plugin_ran(account, whole.saturating_sub(nested));
    result
}

/// A call in progress.
struct Call<'a, 'c> {
    cx: &'a mut Context<'c>,
    native: &'a Native,
    entry: &'a Entry,
    br: bool,
}

/// Where a parameter is.
enum Found {
    /// A bit of the arena and its size.
    Place(ArenaBit, u32),
    Number(u32),
    /// A byte of the peripheral area and the size in bits.
    Peripheral(u32, u32),
}

impl Call<'_, '_> {
    #[inline]
    fn formal(&self, index: u32) -> Result<&Formal, Refused> {
        self.native.formals.get(index as usize).ok_or(Refused::NoParam)
    }

    /// In line: each use needs one or two of the answers only, and a plugin's block asks several times in each call.
    #[inline(always)]
    fn find(&self, index: u32, write: bool) -> Result<Found, Refused> {
        let formal = self.formal(index)?;
        if self.native.has_instance {
            let at = self.instance_bit(formal.at, formal.bits, write)?;
            return Ok(Found::Place(at, formal.bits));
        }
        if index < 64 && self.entry.given >> index & 1 == 0 {
            return Err(Refused::NoParam);
        }
        let reference = *self.cx.machine.refs.get((self.entry.refs + index) as usize).ok_or(Refused::NoParam)?;
        if formal.number {
            return if write { Err(Refused::NoParam) } else { Ok(Found::Number(reference)) };
        }
        if write && formal.input {
            return Err(Refused::NoParam);
        }
        if reference & RAW != 0 {
            return self.by_pointer(reference, formal.bits, write);
        }
        Ok(Found::Place(ArenaBit(reference), formal.bits))
    }

    /// What a pointer of a raw list names. Seldom: out of line, so that the usual case is short.
    #[cold]
    #[inline(never)]
    fn by_pointer(&self, pointer: u32, bits: u32, write: bool) -> Result<Found, Refused> {
        let at = BitAddr(pointer & POINTER_BITS);
        let db = match Area::from_pointer_code((pointer >> 24) as u8) {
            Some(Area::Db) => self.entry.db,
            Some(Area::Di) => self.entry.di,
            Some(Area::Peripheral) if matches!(bits, 8..=32) => return Ok(Found::Peripheral(at.byte(), bits)),
            _ => return Err(Refused::Outside),
        };
        if write && db.writable == 0 {
            return Err(Refused::ReadOnly);
        }
        let byte = db.range().locate(at.byte(), bits.div_ceil(8)).ok_or(Refused::Outside)?;
        Ok(Found::Place(byte.bit(u32::from(at.bit())), bits))
    }

    /// The arena bit of `bits` bits at `at` of the instance.
    #[inline]
    fn instance_bit(&self, at: u32, bits: u32, write: bool) -> Result<ArenaBit, Refused> {
        let di = self.entry.di;
        let at = (self.entry.ar2 & POINTER_BITS).wrapping_add(at);
        let byte = di.range().locate(at / 8, bits.div_ceil(8)).ok_or(Refused::Outside)?;
        if write && di.writable == 0 {
            return Err(Refused::ReadOnly);
        }
        Ok(byte.bit(at % 8))
    }

    #[cold]
    fn peripheral_get(&mut self, at: u32, bits: u32) -> Result<u32, Refused> {
        let mut bytes = [0; 4];
        let from = 4usize.saturating_sub((bits / 8) as usize);
        self.io_read(at, &mut bytes[from..])?;
        Ok(u32::from_be_bytes(bytes))
    }

    #[cold]
    fn peripheral_set(&mut self, at: u32, bits: u32, value: u32) -> Result<(), Refused> {
        let from = 4usize.saturating_sub((bits / 8) as usize);
        self.io_write(at, &value.to_be_bytes()[from..])
    }

    fn range(&self, area: NativeArea, write: bool) -> Result<Range, Refused> {
        let memory = &self.cx.machine.memory;
        Ok(match area {
            NativeArea::Input => memory.inputs,
            NativeArea::Output => memory.outputs,
            NativeArea::Memory => memory.memory,
            NativeArea::Db(0) => return Err(Refused::DbNumber),
            NativeArea::Db(number) => {
                let db = memory.db(number).ok_or(Refused::NoDb)?;
                if write && db.writable == 0 {
                    return Err(Refused::ReadOnly);
                }
                db.range()
            }
            NativeArea::Instance => {
                if !self.native.has_instance {
                    return Err(Refused::NoParam);
                }
                let at = self.instance_bit(0, self.native.instance_bytes * 8, write)?.byte();
                Range { at, len: self.native.instance_bytes }
            }
            NativeArea::CallerLocal => Range { at: self.entry.previous_local, len: self.entry.previous_local_len },
        })
    }

    fn site(&self) -> Site {
        let caller = self.cx.machine.native_caller.and_then(|caller| self.cx.blocks.plan.site(caller));
        caller.unwrap_or(Site { block: self.native.id, network: 0, line: 0 })
    }

    /// An entry in the diagnostic buffer, with the statement that has called the block.
    fn tell(&mut self, event: Event, data: u32, text: &str) {
        let site = self.site();
        self.cx.machine.enter(event, Some(site), data, ShortText::new(text));
    }

    fn module_error(error: IoError) -> Refused {
        match error {
            IoError::NoModule => Refused::NoModule,
            IoError::Module(error) => error.into(),
        }
    }
}

impl ob1_std::Context for Call<'_, '_> {
    fn given(&mut self, index: u32) -> bool {
        self.formal(index).is_ok() && (index >= 64 || self.entry.given >> index & 1 == 1)
    }

    #[inline]
    fn get(&mut self, index: u32) -> Result<u32, Refused> {
        match self.find(index, false)? {
            Found::Number(number) => Ok(number),
            Found::Place(at, bits @ 0..=32) => Ok(self.cx.machine.memory.read_bits(at, bits as u8)),
            Found::Place(..) => Err(Refused::NoParam),
            Found::Peripheral(at, bits) => self.peripheral_get(at, bits),
        }
    }

    #[inline]
    fn set(&mut self, index: u32, value: u32) -> Result<(), Refused> {
        match self.find(index, true)? {
            Found::Place(at, bits @ 0..=32) => {
                self.cx.machine.memory.write_bits(at, bits as u8, value);
                Ok(())
            }
            Found::Peripheral(at, bits) => self.peripheral_set(at, bits, value),
            _ => Err(Refused::NoParam),
        }
    }

    fn read(&mut self, index: u32, at: u32, into: &mut [u8]) -> Result<(), Refused> {
        let Found::Place(bit, bits) = self.find(index, false)? else { return Err(Refused::NoParam) };
        let range = Range { at: bit.byte(), len: bits.div_ceil(8) };
        let at = range.locate(at, into.len() as u32).ok_or(Refused::Outside)?.index();
        // A STRING's operand may be shorter than declared.
        let bytes = self.cx.machine.memory.bytes.get(at..at + into.len()).ok_or(Refused::Outside)?;
        into.copy_from_slice(bytes);
        Ok(())
    }

    fn write(&mut self, index: u32, at: u32, from: &[u8]) -> Result<(), Refused> {
        let Found::Place(bit, bits) = self.find(index, true)? else { return Err(Refused::NoParam) };
        if bits < 8 {
            return Err(Refused::NoParam);
        }
        let range = Range { at: bit.byte(), len: bits / 8 };
        let at = range.locate(at, from.len() as u32).ok_or(Refused::Outside)?.index();
        let bytes = self.cx.machine.memory.bytes.get_mut(at..at + from.len()).ok_or(Refused::Outside)?;
        bytes.copy_from_slice(from);
        Ok(())
    }

    fn area_read(&mut self, area: NativeArea, at: u32, into: &mut [u8]) -> Result<(), Refused> {
        let at = self.range(area, false)?.locate(at, into.len() as u32).ok_or(Refused::Outside)?.index();
        into.copy_from_slice(&self.cx.machine.memory.bytes[at..at + into.len()]);
        Ok(())
    }

    fn area_write(&mut self, area: NativeArea, at: u32, from: &[u8]) -> Result<(), Refused> {
        let at = self.range(area, true)?.locate(at, from.len() as u32).ok_or(Refused::Outside)?.index();
        self.cx.machine.memory.bytes[at..at + from.len()].copy_from_slice(from);
        Ok(())
    }

    fn instance(&mut self) -> Option<Instance> {
        let (db, offset) = (self.entry.di.number, (self.entry.ar2 & POINTER_BITS) / 8);
        self.native.has_instance.then_some(Instance { db, offset, len: self.native.instance_bytes })
    }

    fn registers(&mut self) -> (u16, u16) {
        (self.entry.db.number, self.entry.di.number)
    }

    fn set_br(&mut self, br: bool) {
        self.br = br;
    }

    fn now(&mut self) -> Instant {
        self.cx.machine.hot.now
    }

    fn module(&mut self, address: u32) -> Result<ModuleSize, Refused> {
        let plugged = self.cx.machine.modules.at(address).ok_or(Refused::NoModule)?;
        Ok(ModuleSize { inputs: plugged.input_bytes as u16, outputs: plugged.output_bytes as u16 })
    }

    fn io_read(&mut self, address: u32, into: &mut [u8]) -> Result<(), Refused> {
        self.cx.machine.io_read(address, into).map_err(Self::module_error)
    }

    fn io_write(&mut self, address: u32, from: &[u8]) -> Result<(), Refused> {
        self.cx.machine.io_write(address, from).map_err(Self::module_error)
    }

    fn record_read(&mut self, address: u32, record: u8, into: &mut [u8]) -> Result<usize, Refused> {
        let plugged = self.cx.machine.modules.at(address).ok_or(Refused::NoModule)?;
        plugged.module.record_read(record, into).map_err(Refused::from)
    }

    fn record_write(&mut self, address: u32, record: u8, from: &[u8]) -> Result<(), Refused> {
        let plugged = self.cx.machine.modules.at(address).ok_or(Refused::NoModule)?;
        if plugged.module.is_of_blocks(record) {
            return Err(Refused::NoRecord);
        }
        plugged.module.record_write(record, from).map_err(Refused::from)
    }

    fn retrigger_watchdog(&mut self) {
        self.cx.look();
        self.cx.retrigger_watchdog();
        // The count of statements begins anew: in a loop that comes back sooner than it ends, nobody else would see
        // that something is due.
        let machine = &mut *self.cx.machine;
        if machine.hot.now >= machine.standstill.look_at.min(machine.interrupts.next_due()) {
            machine.hot.look_after = 0;
        }
    }

    fn wait(&mut self, time: Span) -> Result<(), Abort> {
        self.cx.wait(time)
    }

    fn stop_by_program(&mut self) -> Abort {
        self.stop(Event::STOP_PROGRAM, "")
    }

    fn services(&mut self) -> &mut dyn Services {
        &mut *self.cx.machine
    }
}

impl NativeContext for Call<'_, '_> {
    fn bit_get(&mut self, area: NativeArea, bit: u32) -> Result<bool, Refused> {
        let byte = self.range(area, false)?.locate(bit / 8, 1).ok_or(Refused::Outside)?;
        Ok(self.cx.machine.memory.read_bits(byte.bit(bit % 8), 1) == 1)
    }

    fn bit_set(&mut self, area: NativeArea, bit: u32, value: bool) -> Result<(), Refused> {
        let byte = self.range(area, true)?.locate(bit / 8, 1).ok_or(Refused::Outside)?;
        self.cx.machine.memory.write_bits(byte.bit(bit % 8), 1, u32::from(value));
        Ok(())
    }

    fn area_len(&mut self, area: NativeArea) -> Result<u32, Refused> {
        self.range(area, false).map(|range| range.len)
    }

    fn timer_run(&mut self, number: u16, kind: TimerKind, rlo: bool, s5time: u16) -> Result<(), Refused> {
        let now = self.cx.machine.hot.now;
        let timer = self.cx.machine.timers.get_mut(usize::from(number)).ok_or(Refused::NoTimer)?;
        timer.run(kind, rlo, s5time, now).map_err(|_| Refused::Outside)
    }

    fn timer_reset(&mut self, number: u16) -> Result<(), Refused> {
        self.cx.machine.timers.get_mut(usize::from(number)).ok_or(Refused::NoTimer)?.reset();
        Ok(())
    }

    fn timer_get(&mut self, number: u16) -> Result<TimerState, Refused> {
        let now = self.cx.machine.hot.now;
        self.cx.machine.timers.get(usize::from(number)).map(|t| t.state(now)).ok_or(Refused::NoTimer)
    }

    fn counter_get(&mut self, number: u16) -> Result<u16, Refused> {
        self.cx.machine.counters.get(usize::from(number)).map(|c| c.value).ok_or(Refused::NoTimer)
    }

    fn counter_set(&mut self, number: u16, value: u16) -> Result<(), Refused> {
        let counter = self.cx.machine.counters.get_mut(usize::from(number)).ok_or(Refused::NoTimer)?;
        if value > Counter::MAX {
            return Err(Refused::Outside);
        }
        counter.value = value;
        Ok(())
    }

    fn module_status(&mut self, address: u32) -> Result<ModuleStatus, Refused> {
        self.cx.machine.modules.at(address).map(|plugged| plugged.module.status()).ok_or(Refused::NoModule)
    }

    fn record_of_block_write(&mut self, address: u32, record: u8, from: &[u8]) -> Result<(), Refused> {
        let plugged = self.cx.machine.modules.at(address).ok_or(Refused::NoModule)?;
        plugged.module.record_write(record, from).map_err(Refused::from)
    }

    fn call_block(&mut self, id: BlockId, instance_db: u16, args: &[NativeArg]) -> Result<(), Refused> {
        let callee = self.cx.blocks.find(id).ok_or(Refused::NoBlock)?;
        self.attend().map_err(|Abort| Refused::Abort)?;
        let called = Called { id, callee, instance_db, args };
        nested_call(self, &called)
    }

    fn ob_info(&mut self) -> ObInfo {
        self.cx.machine.ob
    }

    fn attend(&mut self) -> Result<(), Abort> {
        let machine = &mut *self.cx.machine;
        machine.hot.pending = machine.hot.pending.saturating_add(1);
        if machine.hot.pending >= machine.hot.look_after || machine.attention.is_due() {
            return self.cx.attend();
        }
        if machine.hot.stopping { Err(Abort) } else { Ok(()) }
    }

    fn raise_fault(&mut self, kind: FaultKind, number: u32) -> Result<(), Abort> {
        let site = self.site();
        self.cx.fault(Fault::new(kind, number), Some(site), &Interrupted::default()).map(|_| ())
    }

    fn diagnostic_interrupt(&mut self, address: u32, data: &[u8]) -> Result<(), Refused> {
        if self.cx.machine.modules.at(address).is_none() {
            return Err(Refused::NoModule);
        }
        let mut first = [0; 4];
        let len = data.len().min(4);
        first[..len].copy_from_slice(&data[..len]);
        self.cx.diagnostic_interrupt(address, first).map_err(|Abort| Refused::Abort)
    }

    fn diag_entry(&mut self, number: u16, text: &str) {
        self.tell(Event::PLUGIN_ENTRY, u32::from(number), text);
    }

    fn stop(&mut self, event: Event, text: &str) -> Abort {
        self.tell(event, 0, text);
        self.cx.machine.hot.stopping = true;
        Abort
    }

    fn log(&mut self, level: u8, text: &str) {
        self.cx.machine.log(level, text);
    }
}

/// A call a native block makes.
struct Called<'a> {
    id: BlockId,
    callee: Callee,
    instance_db: u16,
    args: &'a [NativeArg],
}

/// Supplies the parameters as a `CALL` does: references for an FC, copies through the instance for an FB.
fn nested_call(call: &mut Call<'_, '_>, called: &Called<'_>) -> Result<(), Refused> {
    let Some(signature) = call.cx.blocks.plan.signatures.find(called.id) else { return Err(Refused::NoBlock) };
    if called.args.len() != signature.formals.len() {
        return Err(Refused::NoBlock);
    }
    if call.cx.machine.hot.depth >= u32::from(call.cx.machine.config.nesting_depth) {
        let site = call.site();
        let fault = Fault::new(FaultKind::NestingDepth, call.cx.machine.hot.depth);
        return call.cx.fault(fault, Some(site), &Interrupted::default()).map(|_| ()).map_err(|Abort| Refused::Abort);
    }
    let tops = (call.cx.machine.hot.refs_top, call.cx.machine.hot.scratch_top);
    let mut entry = Entry {
        refs: tops.0,
        given: 0,
        db: call.entry.db,
        di: call.entry.di,
        ar2: call.entry.ar2,
        previous_local: call.entry.previous_local,
        previous_local_len: call.entry.previous_local_len,
    };
    for (i, arg) in called.args.iter().enumerate().take(64) {
        entry.given |= u64::from(*arg != NativeArg::Open) << i;
    }
    let has_instance = called.id.kind.has_instance();
    if has_instance {
        let db = match called.instance_db {
            0 => return Err(Refused::DbNumber),
            number => call.cx.machine.memory.db(number).ok_or(Refused::NoDb)?,
        };
        if db.writable < signature.instance_bytes {
            return Err(if db.writable == 0 && db.len > 0 { Refused::ReadOnly } else { Refused::NoBlock });
        }
        entry.db = entry.di;
        entry.di = db;
        entry.ar2 = u32::from(ob1_model::Area::Db.pointer_code()) << 24;
    }
    for (i, (arg, formal)) in called.args.iter().zip(&signature.formals).enumerate() {
        let operand = match *arg {
            NativeArg::Operand(area, bit) => Some(operand(call, area, bit, formal.bits, formal.written)?),
            _ => None,
        };
        let machine = &mut *call.cx.machine;
        if has_instance {
            let to = entry.di.at.bit(formal.at);
            if !matches!(formal.section, Section::Input | Section::InOut) {
                continue;
            }
            match (*arg, operand) {
                (NativeArg::Value(value), _) if formal.bits <= 32 => {
                    machine.memory.write_bits(to, formal.bits as u8, value);
                }
                (_, Some(from)) if formal.bits <= 32 => {
                    let value = machine.memory.read_bits(from, formal.bits as u8);
                    machine.memory.write_bits(to, formal.bits as u8, value);
                }
                (_, Some(from)) => machine.memory.copy(from.byte(), to.byte(), formal.bits / 8),
                (NativeArg::Open, None) => {}
                _ => return Err(Refused::NoBlock),
            }
            continue;
        }
        let reference = match (*arg, operand) {
            (NativeArg::Value(value), _) if formal.number => value,
            (NativeArg::Value(value), _) if formal.elementary => {
                let at = machine.memory.scratch.locate(machine.hot.scratch_top, 4).ok_or(Refused::NoBlock)?;
                machine.hot.scratch_top += 4;
                machine.memory.write_bits(at.bit(0), formal.bits as u8, value);
                at.bit(0).0
            }
            (_, Some(at)) if formal.number => machine.memory.read_bits(at, 16),
            (_, Some(at)) => at.0,
            _ => return Err(Refused::NoBlock),
        };
        let slot = machine.refs.get_mut(tops.0 as usize + i).ok_or(Refused::NoBlock)?;
        *slot = reference;
        machine.hot.refs_top = tops.0 + i as u32 + 1;
    }
    let caller = call.cx.machine.native_caller;
    let result = match called.callee {
        Callee::Code(block) => call.cx.blocks.engine.call(block, &entry, call.cx),
        Callee::Native(index) => {
            call.cx.machine.hot.depth += 1;
            // From the statement that has called the block which calls now.
            let site = caller.and_then(|caller| call.cx.blocks.plan.site(caller)).map_or(Packed::NONE, Packed::of);
            let result = self::call(index, site, &entry, call.cx).map(|_| ());
            call.cx.machine.hot.depth -= 1;
            result
        }
    };
    call.cx.machine.native_caller = caller;
    (call.cx.machine.hot.refs_top, call.cx.machine.hot.scratch_top) = tops;
    result.map_err(|Abort| Refused::Abort)?;
    if has_instance {
        for (arg, formal) in called.args.iter().zip(&signature.formals) {
            let NativeArg::Operand(area, bit) = *arg else { continue };
            if formal.section == Section::Input {
                continue;
            }
            let to = operand(call, area, bit, formal.bits, true)?;
            let from = entry.di.at.bit(formal.at);
            let memory = &mut call.cx.machine.memory;
            if formal.bits <= 32 {
                let value = memory.read_bits(from, formal.bits as u8);
                memory.write_bits(to, formal.bits as u8, value);
            } else {
                memory.copy(from.byte(), to.byte(), formal.bits / 8);
            }
        }
    }
    Ok(())
}

/// The arena bit of an actual a native block supplies.
fn operand(call: &Call<'_, '_>, area: NativeArea, bit: u32, bits: u32, write: bool) -> Result<ArenaBit, Refused> {
    let at = BitAddr(bit);
    let byte = call.range(area, write)?.locate(at.byte(), bits.div_ceil(8)).ok_or(Refused::Outside)?;
    Ok(byte.bit(u32::from(at.bit())))
}
