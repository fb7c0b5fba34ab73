//! Organization blocks in their turn: a due interrupt runs when its priority class is above the running one, at safe
//! points and between cycles.

use ob1_model::{Event, FaultKind};
use ob1_std::services::ErrorFilter;
use ob1_time::Span;

use crate::context::Context;
use crate::engine::{Callee, Entry};
use crate::error_obs::Late;
use crate::interrupts::{Hardware, Passed, Request, SLOTS, ob_of, priority_of};
use crate::native;
use crate::recording::ObRun;
use crate::scan_position::Packed;
use crate::services::period_word;
use crate::{Abort, Family, ObInfo};

impl Context<'_> {
    /// Runs the interrupt of the highest class that is due, when it is above the running class. False when there was
    /// none.
    #[cold]
    pub(crate) fn interrupt(&mut self) -> Result<bool, Abort> {
        self.collect()?;
        let machine = &mut *self.machine;
        if machine.services.locks.is_delayed() {
            return Ok(false);
        }
        let locks = machine.services.locks;
        machine.interrupts.cancel(|ob| locks.is_disabled(ob));
        let Some(request) = self.machine.interrupts.take(self.machine.ob.priority) else { return Ok(false) };
        self.run_interrupt(&request)?;
        Ok(true)
    }

    /// Due times that have passed become requests; those that came too soon are errors.
    fn collect(&mut self) -> Result<(), Abort> {
        if self.machine.services.skipped != 0 {
            let skipped = std::mem::take(&mut self.machine.services.skipped);
            self.times_of_day_skipped(skipped)?;
        }
        let passed = self.machine.interrupts.collect(self.machine.hot.now);
        if passed == Passed::default() {
            return Ok(());
        }
        if passed.elapsed != 0 {
            self.machine.elapsed(passed.elapsed);
        }
        for slot in 0..SLOTS {
            let bit = 1 << slot;
            if self.machine.services.locks.is_disabled(ob_of(slot)) {
                continue;
            }
            if passed.waiting & bit != 0 {
                self.request_error(slot, Late::Waiting)?;
            }
            if passed.running & bit != 0 {
                self.request_error(slot, Late::Running)?;
            }
        }
        Ok(())
    }

    fn run_interrupt(&mut self, request: &Request) -> Result<(), Abort> {
        let number = ob_of(request.slot);
        let mut start = self.interrupt_start(request.slot, &request.hardware);
        // One that was skipped shows when it should have come first.
        let course = self.machine.services.courses.get_mut(request.slot);
        if let Some((at, moment)) = course.and_then(|course| course.skipped.take())
            && at == request.due
        {
            start[12..].copy_from_slice(&moment.to_bytes());
        }
        let Some(callee) = self.blocks.ob(number) else {
            self.machine.interrupts.done(request.slot);
            return self.missing_ob(number, start);
        };
        let late = self.machine.hot.now.since(request.due);
        if let Some(record) = self.machine.obs.of(number) {
            record.late(late);
        }
        self.run_ob(callee, ObInfo { number, priority: priority_of(number), start })?;
        // An interrupt that became due again while it ran is an error; `collect` must see that before the run counts as
        // ended.
        let again = self.collect();
        self.machine.interrupts.done(request.slot);
        again
    }

    /// Runs an organization block, nested in whatever runs.
    pub(crate) fn run_ob(&mut self, callee: Callee, info: ObInfo) -> Result<(), Abort> {
        let machine = &mut *self.machine;
        let Some(at) = machine.memory.local.locate(machine.hot.local_top, 20) else {
            let event = match machine.config.family {
                Family::S7_300 => Event(FaultKind::NestingDepth.number()),
                Family::S7_400 => Event::STOP_ABORTED,
            };
            self.stop(event, u32::from(info.number), "no local data left");
            return Err(Abort);
        };
        if machine.config.ob_start_info {
            machine.memory.bytes[at.index()..at.index() + 20].copy_from_slice(&info.start);
        }
        self.look();
        let machine = &mut *self.machine;
        let began = machine.hot.now;
        let outer_inside = std::mem::take(&mut machine.inside);
        // The OBs for synchronous errors belong to the class they interrupt, and so do its masks and its run time.
        let synchronous = matches!(info.number, 121 | 122);
        let (filter, outer_class) = (machine.services.filter, machine.class_ob);
        if !synchronous {
            machine.services.filter = ErrorFilter::default();
            machine.class_ob = info.number;
            if let Some(record) = machine.obs.of(outer_class) {
                record.pause(began, outer_inside);
            }
            if let Some(record) = machine.obs.of(info.number) {
                record.begin(began);
            }
        }
        let outer = std::mem::replace(&mut machine.ob, info);
        let active = machine.active;
        machine.active |= 1 << (info.number & 127);
        machine.position.enter(info.number);
        let caller = machine.native_caller.take();
        let depth = std::mem::take(&mut machine.hot.depth);
        let tops = (machine.hot.local_top, machine.hot.refs_top, machine.hot.scratch_top);
        let result = match callee {
            Callee::Code(block) => self.blocks.engine.call(block, &Entry::default(), self),
            Callee::Native(index) => native::call(index, Packed::NONE, &Entry::default(), self).map(|_| ()),
        };
        self.look();
        let machine = &mut *self.machine;
        let whole = machine.hot.now - began;
        let inside = machine.inside;
        machine.inside = outer_inside + if synchronous { inside } else { whole };
        let own = whole.saturating_sub(inside);
        machine.trace.ob_ran(info.number, own);
        self.exchange.recordings.ob_ran(ObRun { ob: info.number, began, whole, own });
        if let Some(record) = machine.obs.of(info.number) {
            record.ran(own, whole);
        }
        if !synchronous {
            machine.services.filter = filter;
            machine.class_ob = outer_class;
            if info.number < 80 {
                machine.services.locks.end_delays();
            }
        }
        (machine.ob, machine.active) = (outer, active);
        machine.position.enter(outer.number);
        machine.native_caller = caller;
        machine.hot.depth = depth;
        (machine.hot.local_top, machine.hot.refs_top, machine.hot.scratch_top) = tops;
        result
    }

    /// The start information of an interrupt.
    pub(crate) fn interrupt_start(&self, slot: usize, hardware: &Hardware) -> [u8; 20] {
        let ob = ob_of(slot);
        let start = |id| self.start_info(0x11, id, priority_of(ob), ob as u8);
        let interrupts = &self.machine.interrupts;
        match ob {
            10..=17 => {
                let mut start = start(0x11 + (ob - 10) as u8);
                let set = self.machine.services.time_of_day[slot].set;
                let period = set.map_or(0, |(_, period)| period_word(period));
                start[6..8].copy_from_slice(&period.to_be_bytes());
                start
            }
            20..=23 => {
                let mut start = start(0x21 + (ob - 20) as u8);
                let delay = interrupts.delays[usize::from(ob - 20)];
                start[6..8].copy_from_slice(&delay.sign.to_be_bytes());
                start[8..12].copy_from_slice(&delay.ms.to_be_bytes());
                start
            }
            30..=38 => {
                let mut start = start(0x31 + (ob - 30) as u8);
                let cyclic = interrupts.cyclic(slot);
                let ms = |time: Span, most: u64| time.millis().min(most) as u16;
                start[6..8].copy_from_slice(&ms(cyclic.phase, 0xFFFF).to_be_bytes());
                start[10..12].copy_from_slice(&ms(cyclic.period, 0x7FFF).to_be_bytes());
                start
            }
            _ => {
                let mut start = start(0x41 + (ob - 40) as u8);
                start[5] = if hardware.output { 0x55 } else { 0x54 };
                start[6..8].copy_from_slice(&hardware.address.to_be_bytes());
                start[8..12].copy_from_slice(&hardware.point.to_be_bytes());
                start
            }
        }
    }
}
