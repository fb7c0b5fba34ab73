//! Cycle control: one cycle in RUN, the interrupts between two cycles, the round in STOP.

use ob1_model::{Event, Point};
use ob1_time::{Instant, Span};

use crate::accounts::Ended;
use crate::context::Context;
use crate::interrupts::{Hardware, slot_of};
use crate::machine::{Machine, Watchdog};
use crate::standstill::Standstill;
use crate::{
    Abort, Clock, Command, Cpu, CycleEnd, ImageErrors, MissedCycle, ModuleError, ModuleEvent, ObInfo, OperatingState,
    ShortText,
};

/// Time between two looks at links and modules in STOP.
const STOP_CYCLE: Span = Span::from_millis(10);
/// Events taken from one module in one scan.
const EVENTS_PER_SCAN: usize = 8;
/// Half periods of the clock memory's bits 0 to 7 in milliseconds: 10, 5, 2.5, 2, 1.25, 1, 0.625 and 0.5 Hz.
const CLOCK_HALF_MS: [u64; 8] = [50, 100, 200, 250, 400, 500, 800, 1000];
/// Events of modules that are hardware interrupts: start requests for OB 40 to 47.
const HARDWARE_EVENTS: std::ops::RangeInclusive<u16> = 0x1141..=0x1148;

impl Cpu {
    /// One whole cycle: questions of the links, exchange with them, events of the modules, process image of the inputs,
    /// OB 1, process image of the outputs, statistics. If an interrupt is due before the next cycle, only that is
    /// served ([`CycleEnd::whole`] is false then). In STOP only links and modules are served. The caller sleeps until
    /// the deadline it is given.
    pub fn cycle(&mut self, clock: &mut dyn Clock) -> CycleEnd {
        let end = self.serve_and_run(clock);
        CycleEnd { next_deadline: end.next_deadline.saturating_add(self.machine.held), ..end }
    }

    /// Makes the change of state that was requested, a start-up included, and leaves the first cycle to
    /// [`Cpu::cycle`]: whoever replays a recording sets memory in between.
    pub fn change_state(&mut self, clock: &mut dyn Clock) {
        self.machine.hot.now = self.machine.hot.now.max(self.machine.time(clock));
        if let Some(command) = self.machine.wanted.take() {
            self.obey(command, clock);
        }
    }

    fn serve_and_run(&mut self, clock: &mut dyn Clock) -> CycleEnd {
        self.machine.hot.now = self.machine.hot.now.max(self.machine.time(clock));
        self.machine.memory.reuse_deleted();
        self.exchange.questions(&mut self.machine, &self.blocks, self.state);
        if self.machine.attention.take_halt() {
            self.machine.wanted = Some(Command::Stop);
        }
        if let Some(command) = self.machine.wanted.take() {
            self.obey(command, clock);
        }
        let now = self.machine.hot.now;
        match self.state {
            OperatingState::Run if now < self.due && self.machine.interrupts.wants(now) => self.between_cycles(clock),
            // After a start-up the first cycle begins now: OB 100 is not part of it.
            OperatingState::Run => self.run_cycle(now, clock),
            _ => {
                self.serve_exchange();
                self.stop_cycle(clock)
            }
        }
    }

    fn run_cycle(&mut self, start: Instant, clock: &mut dyn Clock) -> CycleEnd {
        let planned = if self.due <= start { self.due } else { start };
        let m = &mut self.machine;
        m.trace.begin(planned, start, m.inside, m.statements + u64::from(m.hot.pending));
        if let Some(last) = self.last_start.replace(start) {
            let time = start - last;
            self.machine.trace.cycle(time);
            let ms = time.millis().min(32_767) as u16;
            let [_, least, most] = self.cycle_ms;
            let least = if self.machine.trace.accounts.scans() <= 1 { ms } else { least.min(ms) };
            self.cycle_ms = [ms, least, most.max(ms)];
        }
        self.machine.cycle_start = start;
        self.serve_links(clock);
        self.watch(start);
        self.machine.modules.begin_scan(self.machine.real());
        let mut outputs_from = None;
        let ran = self.module_events(clock).and_then(|()| {
            self.clock_memory();
            self.input_image(clock)?;
            self.point(Point::Start);
            if self.machine.interrupts.wants(self.machine.hot.now) {
                self.context(clock).attend()?;
            }
            self.ob1(start - planned, clock)?;
            // An overlong cycle is also noticed at its end, in case the last stretch had no safe point.
            self.machine.attention.take_due();
            self.context(clock).attend_now()?;
            outputs_from = Some(self.machine.hot.now);
            self.point(Point::End);
            self.output_image(clock)
        });
        self.machine.watchdog.expires = None;
        let stopped = ran.is_err() || self.machine.hot.stopping;
        if stopped {
            // The scan still counts, and so does its time since the last safe point.
            self.context(clock).look();
        }
        let m = &mut self.machine;
        if !stopped {
            m.modules.end_scan(m.real());
            m.hot.now = m.hot.now.max(m.time(clock));
        }
        let (due, overran, missed) = m.next_cycle(planned, stopped);
        self.due = due;
        let outputs_from = outputs_from.unwrap_or(m.hot.now);
        let late = self.account(outputs_from, overran, missed);
        if stopped {
            self.enter_stop();
            return CycleEnd { late, ..self.stop_cycle(clock) };
        }
        CycleEnd { next_deadline: self.next_deadline(), state: self.state, whole: true, late }
    }

    /// Enters what has run until now into the accounts; whether it was late.
    fn account(&mut self, outputs_from: Instant, overran: bool, missed: u64) -> bool {
        let m = &mut self.machine;
        let ended = Ended {
            end: m.hot.now,
            outputs_from,
            inside: m.inside,
            statements: m.statements + u64::from(m.hot.pending),
            overran,
            missed,
            site: m.trace.long_in.take().and_then(|at| self.blocks.plan.site(at)),
        };
        let late = m.trace.end(&ended);
        m.account_interrupts();
        late
    }

    /// The exchange with the links, timed in its own account.
    fn serve_links(&mut self, clock: &mut dyn Clock) {
        if self.exchange.is_idle() {
            self.serve_exchange();
            return;
        }
        let began = clock.now();
        self.serve_exchange();
        let took = clock.now().since(began);
        self.machine.trace.exchanged(took);
    }

    fn serve_exchange(&mut self) {
        self.exchange.serve(&mut self.machine, self.state);
        if self.machine.debugging.is_busy() {
            self.breakpoints();
        }
        if self.machine.watching.is_busy() || self.machine.runs_every() != self.machine.watching.every() {
            self.passes();
        }
        self.point(Point::Now);
    }

    /// Interrupts that come while the minimum cycle time is waited for.
    fn between_cycles(&mut self, clock: &mut dyn Clock) -> CycleEnd {
        let start = self.machine.hot.now;
        self.watch(start);
        let m = &mut self.machine;
        m.trace.begin_between(start, m.inside, m.statements + u64::from(m.hot.pending));
        let ran = self.context(clock).attend();
        self.machine.watchdog.expires = None;
        if ran.is_err() || self.machine.hot.stopping {
            // It counts as a scan: what has led to STOP is in the accounts.
            self.context(clock).look();
            let end = self.machine.hot.now;
            let late = self.account(end, end > self.due, 0);
            self.enter_stop();
            return CycleEnd { late, ..self.stop_cycle(clock) };
        }
        // Rings the doorbells for what an interrupt has written to modules.
        let m = &mut self.machine;
        m.modules.end_scan(m.real());
        m.trace.between(m.hot.now);
        m.account_interrupts();
        CycleEnd { next_deadline: self.next_deadline(), state: self.state, whole: false, late: false }
    }

    fn next_deadline(&self) -> Instant {
        self.due.min(self.machine.interrupts.next_due())
    }

    /// Starts the cycle monitoring.
    fn watch(&mut self, start: Instant) {
        let limit = self.machine.config.watchdog;
        self.machine.watchdog =
            Watchdog { expires: (!limit.is_zero()).then(|| start.saturating_add(limit)), excess: false };
        self.machine.standstill = Standstill::watched(start, self.state);
    }

    pub(crate) fn context<'a>(&'a mut self, clock: &'a mut dyn Clock) -> Context<'a> {
        Context { machine: &mut self.machine, blocks: &self.blocks, clock, exchange: &mut self.exchange }
    }

    fn input_image(&mut self, clock: &mut dyn Clock) -> Result<(), Abort> {
        for index in 0..self.machine.modules.list.len() {
            let m = &mut self.machine;
            let error = m.modules.read_image(index, &mut m.memory).err();
            self.image_transferred(index, false, error, clock)?;
        }
        self.machine.put_forced();
        Ok(())
    }

    fn output_image(&mut self, clock: &mut dyn Clock) -> Result<(), Abort> {
        self.machine.put_forced();
        for index in 0..self.machine.modules.list.len() {
            let m = &mut self.machine;
            let error = m.modules.write_image(index, &m.memory).err();
            self.image_transferred(index, true, error, clock)?;
        }
        self.machine.drive_forced();
        self.machine.put_forced();
        Ok(())
    }

    /// OB 85 for a module whose part of the process image was not transferred, and for one where it works again, as the
    /// configuration wants it.
    #[inline]
    fn image_transferred(
        &mut self,
        index: usize,
        output: bool,
        error: Option<ModuleError>,
        clock: &mut dyn Clock,
    ) -> Result<(), Abort> {
        let m = &mut self.machine;
        let failed = &mut m.modules.list[index].image_error[usize::from(output)];
        let (wanted, before) = (m.config.image_errors, *failed);
        match error {
            None if !before => Ok(()),
            None => {
                *failed = false;
                if wanted == ImageErrors::Changes { self.context(clock).image_back(index, output) } else { Ok(()) }
            }
            Some(_) if wanted == ImageErrors::None || wanted == ImageErrors::Changes && before => Ok(()),
            Some(error) => self.context(clock).image_error(index, output, error),
        }
    }

    fn ob1(&mut self, late: Span, clock: &mut dyn Clock) -> Result<(), Abort> {
        let Some(callee) = self.blocks.plan.ob1 else {
            self.context(clock).look();
            return Ok(());
        };
        let scan = std::mem::replace(&mut self.first_scan, 3);
        let cycle_ms = self.cycle_ms;
        if let Some(record) = self.machine.obs.of(1) {
            record.late(late);
        }
        let inside = self.machine.inside;
        let mut cx = self.context(clock);
        let mut start = cx.start_info(0x11, scan, 1, 1);
        for (i, ms) in cycle_ms.into_iter().enumerate() {
            start[6 + 2 * i..8 + 2 * i].copy_from_slice(&ms.to_be_bytes());
        }
        let ran = cx.run_ob(callee, ObInfo { number: 1, priority: 1, start });
        let m = &mut self.machine;
        let whole = m.obs.of(1).map_or(Span::ZERO, |record| record.last_whole());
        m.trace.ob1_began(m.hot.now.saturating_sub(whole), inside);
        ran
    }

    /// Serves links and modules while the program stands still.
    pub(crate) fn stop_cycle(&mut self, clock: &mut dyn Clock) -> CycleEnd {
        let now = self.machine.hot.now;
        self.machine.modules.begin_scan(self.machine.real());
        // No organization block runs in STOP: this cannot abort.
        let _ = self.module_events(clock);
        let m = &mut self.machine;
        for index in 0..m.modules.list.len() {
            // A module that does not answer reads as 0; in STOP that is not an error.
            let _ = m.modules.read_image(index, &mut m.memory);
        }
        self.point(Point::Start);
        self.point(Point::End);
        let m = &mut self.machine;
        m.put_forced();
        m.drive_in_stop();
        m.modules.end_scan(m.real());
        self.due = now.saturating_add(STOP_CYCLE);
        CycleEnd { next_deadline: self.due, state: self.state, whole: true, late: false }
    }

    /// Diagnostic entries and interrupts of the modules.
    fn module_events(&mut self, clock: &mut dyn Clock) -> Result<(), Abort> {
        for index in 0..self.machine.modules.list.len() {
            for _ in 0..EVENTS_PER_SCAN {
                let Some(event) = self.machine.modules.list[index].module.poll_event() else { break };
                self.module_event(index, &event, clock)?;
            }
        }
        Ok(())
    }

    fn module_event(&mut self, index: usize, event: &ModuleEvent, clock: &mut dyn Clock) -> Result<(), Abort> {
        let run = self.state == OperatingState::Run;
        let plugged = &mut self.machine.modules.list[index];
        let address = plugged.slot.input_address;
        let data = [event.data[0], event.data[1], event.data[2], event.data[3]];
        if HARDWARE_EVENTS.contains(&event.event.0) {
            let ob = event.event.0 - HARDWARE_EVENTS.start() + 40;
            return if run { self.module_interrupt(ob, address, data, clock) } else { Ok(()) };
        }
        // A driver's first start does not count as a return.
        let station = match event.event {
            Event::DRIVER_LOST => !std::mem::replace(&mut plugged.lost, true),
            Event::DRIVER_UP => std::mem::replace(&mut plugged.lost, false),
            _ => false,
        };
        let lost = plugged.lost;
        let text = event_text(&plugged.slot.name, event);
        self.machine.enter(event.event, None, address, text);
        if !run {
            return Ok(());
        }
        if event.diagnostic_interrupt {
            self.context(clock).diagnostic_interrupt(address, data)?;
        }
        if matches!(event.event, Event::BUS_FAILED | Event::STATION_FAILED | Event::STATION_BACK) {
            return self.context(clock).bus_station(event.event, event.data);
        }
        if station { self.context(clock).station(address, index, lost) } else { Ok(()) }
    }

    /// A hardware interrupt of a module: it waits for its class, or, when its OB is not loaded, is an error at once.
    fn module_interrupt(&mut self, ob: u16, address: u32, data: [u8; 4], clock: &mut dyn Clock) -> Result<(), Abort> {
        let at = self.machine.hot.now;
        let Some(slot) = slot_of(ob) else { return Ok(()) };
        let request =
            Hardware { slot: slot as u8, output: false, address: address as u16, point: u32::from_be_bytes(data), at };
        if self.blocks.ob(ob).is_none() {
            let mut cx = self.context(clock);
            let start = cx.interrupt_start(slot, &request);
            return cx.missing_ob(ob, start);
        }
        if self.machine.interrupts.fire(request) {
            return Ok(());
        }
        self.context(clock).request_error(slot, crate::error_obs::Late::Waiting)
    }

    fn clock_memory(&mut self) {
        let Some(byte) = self.machine.config.clock_memory else { return };
        let ms = self.machine.hot.now.millis();
        let bits = (0u8..).zip(CLOCK_HALF_MS).fold(0, |bits, (i, half)| bits | (((ms / half) & 1) as u32) << i);
        let at = self.machine.memory.memory.at.plus(u32::from(byte)).bit(0);
        self.machine.memory.write_bits(at, 8, bits);
    }
}

impl Machine {
    /// Returns when the cycle after the one planned at `planned` is due, whether the planned one overran, and how many
    /// deadlines get no cycle (none if the CPU has `stopped`).
    fn next_cycle(&mut self, planned: Instant, stopped: bool) -> (Instant, bool, u64) {
        let (min, now) = (self.config.min_cycle, self.hot.now);
        let next = planned.saturating_add(min);
        if next >= now || min.is_zero() {
            return (next.max(now), false, 0);
        }
        if stopped {
            return (next, true, 0);
        }
        let passed = (now - next) / min + 1;
        match self.config.missed {
            // The cycle that begins now stands for the first of them.
            MissedCycle::Now => {
                self.trace.missed(next + min, min, passed - 1, now);
                (now, true, passed - 1)
            }
            MissedCycle::Skip => {
                let due = next + min * passed;
                self.trace.missed(next, min, passed, due);
                (due, true, passed)
            }
            MissedCycle::CatchUp => {
                let left_out = passed.saturating_sub(MissedCycle::MOST);
                let due = next + min * left_out;
                self.trace.missed(next, min, left_out, now);
                (due, true, left_out)
            }
        }
    }

    /// Interrupts lost so far.
    fn account_interrupts(&self) {
        for account in &self.trace.accounts.obs {
            if let Some(slot) = slot_of(account.ob) {
                account.overruns.set(self.interrupts.overruns[slot]);
            }
        }
    }
}

/// The module's name, and the event's data if they are text. Of a diagnostic interrupt: the text after the first four
/// bytes, or without text these four bytes in hexadecimal.
fn event_text(name: &str, event: &ModuleEvent) -> ShortText {
    let data = event.data.get(..usize::from(event.len)).unwrap_or(&event.data);
    let data = if event.diagnostic_interrupt { data.get(4..).unwrap_or_default() } else { data };
    let has_text = matches!(event.event, Event::STATION_FAULT | Event::STATION_REFUSES) && !data.is_empty();
    if event.diagnostic_interrupt && !has_text {
        let mut digits = [b' '; 11];
        for (place, byte) in digits.chunks_mut(3).zip(event.data) {
            let hex = |nibble: u8| b"0123456789ABCDEF"[usize::from(nibble & 15)];
            (place[0], place[1]) = (hex(byte >> 4), hex(byte));
        }
        // Hexadecimal digits and spaces.
        return ShortText::join(&[name, ": ", std::str::from_utf8(&digits).unwrap_or("")]);
    }
    match std::str::from_utf8(data) {
        Ok(text) if !text.is_empty() && !text.contains(|c: char| c.is_control()) => {
            ShortText::join(&[name, ": ", text])
        }
        _ => ShortText::new(name),
    }
}
