//! Events that call an organization block at once: programming, access and time errors, diagnosis of modules, lost
//! stations, image errors. ["Organization Blocks" of the system software reference]

use ob1_model::{Access, BlockId, BlockKind, Event, Fault, FaultKind, Site};

use crate::engine::{Callee, Interrupted};
use crate::interrupts::{ob_of, priority_of};
use crate::szl::block_code;
use crate::{Abort, Context, DiagEntry, Family, ImageErrors, ModuleError, ObInfo, ShortText};

/// Priority class of the OBs for asynchronous errors in RUN.
const ASYNCHRONOUS: u8 = 26;
/// That of OB 88.
const ABORTED: u8 = 28;
/// The OBs of these two classes that this CPU calls.
const ERROR_OBS: [u16; 5] = [80, 82, 85, 86, 88];

/// Why a hardware interrupt was not taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum InterruptError {
    /// Not one of OB 40 to 47, or not loaded.
    NoOb,
    /// The CPU is not in RUN.
    NotRunning,
    /// Sixteen hardware interrupts wait already; this one is lost.
    Full,
}

/// Why a request for an organization block is a time error.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Late {
    /// 02: its OB is still being executed.
    Running,
    /// 07: one waits already.
    Waiting,
}

impl Context<'_> {
    /// The watchdog has expired: OB 80 the first time, STOP without it or the second time in one cycle.
    pub(crate) fn cycle_exceeded(&mut self) -> Result<(), Abort> {
        let machine = &mut *self.machine;
        machine.trace.accounts.watchdogs.add(1);
        let limit_ms = machine.config.watchdog.millis() as u32;
        let ran_ms = (machine.hot.now - machine.cycle_start).millis().min(0xFFFF) as u16;
        // SFC 43 restarts the cycle monitoring, but an excess while OB 80 runs counts as the second.
        let second = std::mem::replace(&mut machine.watchdog.excess, true) || machine.is_active(&[80]);
        machine.watchdog.expires = Some(machine.hot.now.saturating_add(machine.config.watchdog));
        self.machine.enter(Event::CYCLE_TIME_EXCEEDED, None, limit_ms, ShortText::default());
        if second {
            self.stop(Event::STOP_TIME_ERROR, limit_ms, "twice in one cycle");
            return Err(Abort);
        }
        let running = [self.machine.ob.priority, self.machine.ob.number as u8];
        self.time_error(0x01, ran_ms, [0x35, 0x01], running, "no OB 80")
    }

    /// A request for the OB of a slot came too soon: OB 80, or STOP without it.
    pub(crate) fn request_error(&mut self, slot: usize, late: Late) -> Result<(), Abort> {
        let ob = ob_of(slot);
        let (id, event) = match late {
            Late::Running => (0x02, Event::OB_STILL_RUNS),
            Late::Waiting => (0x07, Event::OB_QUEUE_OVERFLOW),
        };
        self.about_ob(event, ob);
        if self.machine.is_active(&[80]) {
            // OB 80 handles one already.
            return Ok(());
        }
        let start = self.interrupt_start(slot, &crate::interrupts::Hardware::default());
        let info = u16::from_be_bytes([start[6], start[7]]);
        self.time_error(
            id,
            info,
            [start[0], start[1]],
            [priority_of(ob), ob as u8],
            "a request came too soon, no OB 80",
        )
    }

    /// The clock was set forward past the start of these time-of-day interrupts, one bit for each from OB 10: OB 80, or
    /// STOP without it.
    pub(crate) fn times_of_day_skipped(&mut self, skipped: u8) -> Result<(), Abort> {
        let mut told = 0_u16;
        for ob in 10..18_u16 {
            let bit = 1_u16 << (ob - 10);
            if u16::from(skipped) & bit != 0 && !self.disabled(ob) {
                self.about_ob(Event::TIME_OF_DAY_SKIPPED, ob);
                told |= bit;
            }
        }
        if told == 0 || self.machine.is_active(&[80]) {
            // They are locked, or OB 80 sets the clock itself.
            return Ok(());
        }
        self.time_error(0x05, told, [0; 2], [0; 2], "the clock was set forward, no OB 80")
    }

    /// An entry about an organization block.
    fn about_ob(&mut self, event: Event, ob: u16) {
        let mut digits = [0; 3];
        let text = ob_name(ob, &mut digits);
        self.machine.enter(event, None, u32::from(ob), ShortText::join(&["OB ", text]));
    }

    fn time_error(&mut self, id: u8, info: u16, event: [u8; 2], ob: [u8; 2], stop: &str) -> Result<(), Abort> {
        if self.disabled(80) {
            return Ok(());
        }
        let Some(callee) = self.blocks.ob(80) else {
            self.stop(Event::STOP_TIME_ERROR, u32::from(info), stop);
            return Err(Abort);
        };
        let mut start = self.start_info(0x35, id, ASYNCHRONOUS, 80);
        start[6..8].copy_from_slice(&info.to_be_bytes());
        start[8..10].copy_from_slice(&event);
        start[10..12].copy_from_slice(&ob);
        self.asynchronous(callee, 80, start)
    }

    /// Runs the OB of an asynchronous error; after the outermost of them the diagnostic interrupts that wait.
    fn asynchronous(&mut self, callee: Callee, number: u16, start: [u8; 20]) -> Result<(), Abort> {
        self.run_ob(callee, ObInfo { number, priority: ASYNCHRONOUS, start })?;
        if self.machine.is_active(&ERROR_OBS) || std::mem::replace(&mut self.machine.diagnoses.serving, true) {
            return Ok(());
        }
        while let Some((address, data)) = self.machine.diagnoses.take() {
            self.diagnostic_interrupt(address, data)?;
        }
        self.machine.diagnoses.serving = false;
        Ok(())
    }

    /// A programming or access error: its OB, or STOP. `Ok`: the program continues with the next statement, with the
    /// value that SFC 44 has put in ACCU1, if it was called.
    #[cold]
    pub(crate) fn fault(
        &mut self,
        fault: Fault,
        site: Option<Site>,
        interrupted: &Interrupted,
    ) -> Result<Option<u32>, Abort> {
        if self.machine.services.filter.absorbs(fault.kind) {
            return Ok(None);
        }
        let [a1, a2, ..] = interrupted.accus;
        let number = fault.kind.ob();
        let callee = self.blocks.ob(number);
        // OB 121 and OB 122 do not handle their own errors. A higher class that interrupts them has its own.
        let nested = matches!(self.machine.ob.number, 121 | 122);
        let aborts = self.machine.config.family == Family::S7_400;
        let full = (fault.kind == FaultKind::NestingDepth && aborts).then(|| self.machine.full());
        let event = full.unwrap_or(fault.kind.into());
        let entry = DiagEntry::new(self.machine.hot.now, event, fault.number, ShortText::default());
        self.machine.diag.push(DiagEntry { site, accus: [a1, a2], ..entry }, self.machine.wall);
        if let Some(event) = full {
            // The block that finds no room is the one that is aborted: its caller continues behind the call.
            return self.processing_aborted(event, site).map(|()| None);
        }
        if nested && aborts {
            let event = Event::SYNCHRONOUS_NESTING;
            self.machine.enter(event, site, u32::from(self.machine.ob.number), ShortText::default());
            self.processing_aborted(event, site)?;
            self.machine.aborted = true;
            return Err(Abort);
        }
        let (Some(callee), false) = (callee, nested) else {
            let event = if number == 121 { Event::STOP_PROGRAMMING_ERROR } else { Event::STOP_ACCESS_ERROR };
            self.stop(event, u32::from(fault.kind.number()), if nested { "an error in the OB for errors" } else { "" });
            return Err(Abort);
        };
        let [class, id] = fault.kind.number().to_be_bytes();
        let mut start = self.start_info(class, id, self.machine.ob.priority, number as u8);
        let block = site.map_or(BlockId::new(BlockKind::Ob, 0), |s| s.block);
        start[4] = block_code(block.kind);
        start[5] = fault.access.map_or(0, Access::code);
        start[6..8].copy_from_slice(&fault.source().to_be_bytes());
        start[8..10].copy_from_slice(&block.number.to_be_bytes());
        // The address of the statement is its line here.
        start[10..12].copy_from_slice(&(site.map_or(0, |s| s.line) as u16).to_be_bytes());
        let outer = self.machine.substitute.take();
        self.machine.interrupted = Some(*interrupted);
        let ran = self.run_ob(callee, ObInfo { number, priority: self.machine.ob.priority, start });
        self.machine.interrupted = None;
        let substitute = std::mem::replace(&mut self.machine.substitute, outer);
        match ran {
            Err(Abort) if std::mem::take(&mut self.machine.aborted) => Ok(None),
            ran => ran.map(|()| substitute),
        }
    }

    /// An S7-400 has aborted a block, for an error in an OB for synchronous errors or because there is no room for one
    /// block more: OB 88, and the program continues. STOP without OB 88, or while that runs. ["Processing Interrupt OB
    /// (OB 88)" of the system software reference]
    fn processing_aborted(&mut self, event: Event, site: Option<Site>) -> Result<(), Abort> {
        if self.disabled(88) {
            return Ok(());
        }
        let running = self.machine.is_active(&[88]);
        let (Some(callee), false) = (self.blocks.ob(88), running) else {
            let text = if running { "an error while OB 88 runs" } else { "no OB 88" };
            self.stop(Event::STOP_ABORTED, u32::from(event.0), text);
            return Err(Abort);
        };
        let [class, id] = event.0.to_be_bytes();
        let mut start = self.start_info(class, id, ABORTED, 88);
        (start[4], start[6], start[7]) = (0, self.machine.ob.priority, self.machine.ob.number as u8);
        if let Some(site) = site {
            start[4] = block_code(site.block.kind);
            start[8..10].copy_from_slice(&site.block.number.to_be_bytes());
            start[10..12].copy_from_slice(&(site.line as u16).to_be_bytes());
        }
        self.run_ob(callee, ObInfo { number: 88, priority: ABORTED, start })
    }

    /// OB 82 for the module at `address` with the first four bytes of its diagnostic data; without OB 82 STOP: "if no
    /// OB 82 is programmed, the CPU automatically enters STOP mode" [CP 340 manual 04/2011, p. 142].
    pub(crate) fn diagnostic_interrupt(&mut self, address: u32, data: [u8; 4]) -> Result<(), Abort> {
        if self.disabled(82) {
            return Ok(());
        }
        let Some(callee) = self.blocks.ob(82) else {
            self.stop(Event::STOP_DIAGNOSIS, address, "no OB 82");
            return Err(Abort);
        };
        if self.machine.is_active(&ERROR_OBS) {
            if !self.machine.diagnoses.put(address, data) {
                self.about_ob(Event::OB_QUEUE_OVERFLOW, 82);
            }
            return Ok(());
        }
        // Bit 0 of the first byte says that something is wrong with the module: the event comes; else it goes.
        let class = if data[0] & 1 == 1 { 0x39 } else { 0x38 };
        let mut start = self.start_info(class, 0x42, ASYNCHRONOUS, 82);
        start[5] = 0x54;
        start[6..8].copy_from_slice(&(address as u16).to_be_bytes());
        start[8..12].copy_from_slice(&data);
        self.asynchronous(callee, 82, start)
    }

    /// OB 86, when it is loaded: the station behind the module at `address` is lost or back. `index` counts the modules
    /// from 0.
    ///
    /// A lost driver is no reason for STOP here, unlike on the hardware: it is started again, and the scan continues
    /// meanwhile.
    pub(crate) fn station(&mut self, address: u32, index: usize, lost: bool) -> Result<(), Abort> {
        let Some(callee) = self.blocks.ob(86).filter(|_| !self.disabled(86)) else { return Ok(()) };
        let mut start = self.start_info(if lost { 0x39 } else { 0x38 }, 0xC4, ASYNCHRONOUS, 86);
        start[6..8].copy_from_slice(&(address as u16).to_be_bytes());
        // OB86_Z23 of error C4h: the logical base address, then master system and station number.
        start[8..10].copy_from_slice(&(address as u16).to_be_bytes());
        start[11] = (index + 1).min(0xFF) as u8;
        self.asynchronous(callee, 86, start)
    }

    /// A bus or one of its stations is lost, or a station is back: OB 86, STOP without it. `data` are those of the
    /// module's event.
    pub(crate) fn bus_station(&mut self, event: Event, data: [u8; 16]) -> Result<(), Abort> {
        if self.disabled(86) {
            return Ok(());
        }
        let Some(callee) = self.blocks.ob(86) else {
            // A return needs no OB, and a start-up continues without a station that was never there.
            if event == Event::STATION_BACK || data[6] != 0 {
                return Ok(());
            }
            self.stop(Event::STOP_RACK_FAILURE, u32::from(event.0), "no OB 86");
            return Err(Abort);
        };
        let [class, id] = event.0.to_be_bytes();
        let [station_high, station_low, bus_high, bus_low, bus, station, ..] = data;
        let mut start = self.start_info(class, id, ASYNCHRONOUS, 86);
        // OB86_MDL_ADDR: the master; OB86_Z23: station's diagnostic address, master system, station.
        start[6..8].copy_from_slice(&[bus_high, bus_low]);
        start[8..12].copy_from_slice(&if event == Event::BUS_FAILED {
            [0, 0, bus, 0]
        } else {
            [station_high, station_low, bus, station]
        });
        self.asynchronous(callee, 86, start)
    }

    /// A module's part of the process image is transferred again: OB 85, where it is loaded.
    pub(crate) fn image_back(&mut self, index: usize, output: bool) -> Result<(), Abort> {
        let event = if output { Event::OUTPUT_IMAGE_BACK } else { Event::INPUT_IMAGE_BACK };
        let slot = &self.machine.modules.list[index].slot;
        let byte = if output { slot.output_address } else { slot.input_address };
        let base = slot.input_address.min(slot.output_address) as u16;
        let text = ShortText::new(&slot.name);
        self.machine.enter(event, None, byte, text);
        let Some(callee) = self.blocks.ob(85).filter(|_| !self.disabled(85)) else { return Ok(()) };
        let [class, id] = event.0.to_be_bytes();
        let mut start = self.start_info(class, id, ASYNCHRONOUS, 85);
        start[4] = 0x10;
        start[6..8].copy_from_slice(&base.to_be_bytes());
        start[10..12].copy_from_slice(&(byte as u16).to_be_bytes());
        self.asynchronous(callee, 85, start)
    }

    /// A module does not answer while the system transfers the process image: OB 85, STOP without it.
    pub(crate) fn image_error(&mut self, index: usize, output: bool, error: ModuleError) -> Result<(), Abort> {
        let plugged = &self.machine.modules.list[index];
        let slot = &plugged.slot;
        let base = slot.input_address.min(slot.output_address) as u16;
        let byte = if output { slot.output_address } else { slot.input_address };
        // B1h and B2h come each time, B3h and B4h when it begins and ends. ["Priority Class Error Organization Block
        // (OB85)" of the system software reference]
        let event = match (self.machine.config.image_errors, output) {
            (ImageErrors::Changes, false) => Event::INPUT_IMAGE_FAILS,
            (ImageErrors::Changes, true) => Event::OUTPUT_IMAGE_FAILS,
            (_, false) => Event::INPUT_IMAGE_ERROR,
            (_, true) => Event::OUTPUT_IMAGE_ERROR,
        };
        // The OB is called at each transfer; the diagnostic buffer gets only the first error.
        if !plugged.image_error[usize::from(output)] {
            let what = if error == ModuleError::Absent { ", the module does not answer" } else { "" };
            let text = ShortText::join(&[&slot.name, what]);
            self.machine.enter(event, None, byte, text);
            self.machine.modules.list[index].image_error[usize::from(output)] = true;
        }
        let [class, id] = event.0.to_be_bytes();
        let mut start = self.start_info(class, id, ASYNCHRONOUS, 85);
        start[4] = 0x10;
        start[6..8].copy_from_slice(&base.to_be_bytes());
        start[10..12].copy_from_slice(&(byte as u16).to_be_bytes());
        self.sequence_error(start, "image error, no OB 85")
    }

    /// A start event for an OB that is not loaded: OB 85, or STOP without it.
    pub(crate) fn missing_ob(&mut self, ob: u16, wanted: [u8; 20]) -> Result<(), Abort> {
        self.about_ob(Event::OB_NOT_LOADED, ob);
        let mut start = self.start_info(0x35, 0xA1, ASYNCHRONOUS, 85);
        start[6..8].copy_from_slice(&wanted[6..8]);
        start[8..10].copy_from_slice(&wanted[..2]);
        start[10..12].copy_from_slice(&[self.machine.ob.priority, self.machine.ob.number as u8]);
        self.sequence_error(start, "no OB 85")
    }

    /// The program has locked the events of this OB (SFC 39).
    fn disabled(&self, ob: u16) -> bool {
        self.machine.services.locks.is_disabled(ob)
    }

    fn sequence_error(&mut self, start: [u8; 20], stop: &str) -> Result<(), Abort> {
        if self.disabled(85) {
            return Ok(());
        }
        let Some(callee) = self.blocks.ob(85) else {
            self.stop(Event::STOP_SEQUENCE_ERROR, u32::from(start[1]), stop);
            return Err(Abort);
        };
        self.asynchronous(callee, 85, start)
    }
}

/// The number of an organization block in decimal, without allocating.
fn ob_name(ob: u16, digits: &mut [u8; 3]) -> &str {
    let ob = ob.min(999);
    *digits = [ob / 100, ob / 10 % 10, ob % 10].map(|digit| b'0' + digit as u8);
    let first = digits.iter().take(2).take_while(|digit| **digit == b'0').count();
    std::str::from_utf8(&digits[first..]).unwrap_or("")
}

#[cfg(test)]
mod tests {
    use super::ob_name;

    #[test]
    fn numbers_of_organization_blocks() {
        for (ob, text) in [(0, "0"), (1, "1"), (35, "35"), (100, "100"), (121, "121")] {
            assert_eq!(ob_name(ob, &mut [0; 3]), text);
        }
    }
}
