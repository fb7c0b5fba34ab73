//! System status lists (SZL) as SFC 51 reads them: module identification, characteristics, memory and system areas,
//! LEDs, operating state, interrupts, modules and their diagnosis, the diagnostic buffers of the CPU and of CPs.
//!
//! Layouts are those of the reference. An ID is list (low byte), extract (bits 8 to 11) and module class (bits 12 to
//! 15, 0: CPU). ["System Status Lists (SSL)" of the system software reference]

use ob1_model::{BlockKind, StateChange};
use ob1_std::services::{RunTimes, StatusError, SystemStatus};

use crate::interrupts::{priority_of, slot_of};
use crate::machine::Machine;
use crate::modules::{Plugged, SLOT};
use crate::szl_outside;
use crate::szl_record::{Each, Length, Record};
use crate::wall_clock::Wall;
use crate::{DiagEntry, Family, ModuleEntry, OperatingState};

/// The lists there are, for list 0000h: those of an S7-300 with a PROFINET interface, because programming devices offer
/// what they find here. [`szl_outside::empty`] has those that are always empty.
const LISTS: [u16; 112] = [
    0x0000, 0x0F00, 0x0002, 0x0011, 0x0111, 0x0F11, 0x0012, 0x0112, 0x0F12, 0x0013, 0x0113, 0x0014, 0x0F14, 0x0015,
    0x0115, 0x0017, 0x0117, 0x0F17, 0x0018, 0x0118, 0x0F18, 0x0019, 0x0F19, 0x001A, 0x0F1A, 0x001B, 0x0F1B, 0x001C,
    0x011C, 0x0F1C, 0x0021, 0x0A21, 0x0F21, 0x0222, 0x0023, 0x0F23, 0x0024, 0x0124, 0x0424, 0x0524, 0x0025, 0x0125,
    0x0225, 0x0F25, 0x0131, 0x0132, 0x0232, 0x0036, 0x0136, 0x0F36, 0x0037, 0x0137, 0x0F37, 0x0038, 0x0138, 0x0238,
    0x0F38, 0x0139, 0x003A, 0x0F3A, 0x0074, 0x0174, 0x0F74, 0x0591, 0x0A91, 0x0C91, 0x0D91, 0x0092, 0x0292, 0x0692,
    0x0F92, 0x0094, 0x0194, 0x0294, 0x0694, 0x0794, 0x0F94, 0x0095, 0x0195, 0x0F95, 0x0696, 0x0C96, 0x0C97, 0x0D97,
    0x019A, 0x029A, 0x0F9A, 0x0C9B, 0x009C, 0x019C, 0x029C, 0x039C, 0x0F9C, 0x00A0, 0x01A0, 0x0FA0, 0x00B1, 0x00B2,
    0x00B3, 0x00B4, 0x01B5, 0x02B5, 0x03B5, 0x04B5, 0x05B5, 0x06B5, 0x07B5, 0x08B5, 0x01B6, 0x02B6, 0x03B6, 0x04B6,
];
/// LEDs of list xy74: SF, RUN, STOP, FRCE, BUS1F, BUS2F, MAINT.
const LEDS: [u16; 7] = [0x0001, 0x0004, 0x0005, 0x0006, 0x000B, 0x000C, 0x0015];
/// Entries of the diagnostic buffer that an S7-300 shows in RUN. ["Programming with STEP 7": 10 unless set otherwise]
const SHOWN_IN_RUN: usize = 10;
/// The logical address of the CPU itself, and its type, in the lists of modules.
const OWN_ADDRESS: u16 = 0x7FFF;
const OWN_TYPE: u16 = 0x00C0;
const SLOT_OF_CPU: u16 = 2;
/// Organization blocks of list 0222, and those SFC 78 knows, besides the interrupts.
const OTHER_OBS: [u16; 14] = [1, 80, 81, 82, 83, 84, 85, 86, 87, 88, 100, 101, 102, 121];
/// Bytes of a diagnostic data record 1, at most.
const RECORD: usize = 16;

impl SystemStatus for Machine {
    fn list(&mut self, id: u16, index: u16, each: &mut dyn FnMut(&[u8])) -> Result<u16, StatusError> {
        match id {
            0x0000 => words(&LISTS, each),
            0x0011 | 0x0111 => self.identification((id == 0x0111).then_some(index), each),
            0x0012 | 0x0112 => self.characteristics((id == 0x0112).then_some(index), each),
            0x0013 | 0x0113 => self.memory_areas((id == 0x0113).then_some(index), each),
            0x0014 => self.system_areas(each),
            0x0015 | 0x0115 => self.block_types((id == 0x0115).then_some(index), each),
            0x0019 | 0x0074 => self.leds(None, each),
            0x0119 | 0x0174 => self.leds(Some(index), each),
            0x001A => self.memories(each),
            0x001B => self.memory_parts(each),
            0x001C | 0x011C => self.components((id == 0x011C).then_some(index), each),
            0x0222 => self.interrupt_status(index, each),
            0x0025 => szl_outside::partitions(),
            0x0131 => szl_outside::capabilities(self.config.family, index, each),
            0x0132 | 0x0232 => szl_outside::communication(id, index, self.wall.bytes(self.hot.now), each),
            0x0092 | 0x0292 | 0x0692 => szl_outside::racks(&self.modules, id, index, each),
            0x0024 | 0x0124 => self.operating_state(false, each),
            0x0424 | 0x0524 => self.operating_state(true, each),
            0x0091 | 0x0A91 => self.module_status(None, each),
            0x0D91 if index == 0 => self.rack_status(each),
            0x0D91 => self.module_status(None, each),
            0x0C91 => self.module_status(Some(index), each),
            0x00A0 if self.config.family == Family::S7_300 && self.state_shown() != OperatingState::Stop => {
                self.diagnostic_buffer(SHOWN_IN_RUN, each)
            }
            0x00A0 => self.diagnostic_buffer(usize::MAX, each),
            0x01A0 => self.diagnostic_buffer(usize::from(index), each),
            0x00B1 => diagnostic_record(self.addressed(index)?, 0, each),
            0x00B2 => diagnostic_record(self.slotted(index)?, 1, each),
            0x00B3 => diagnostic_record(self.addressed(index)?, 1, each),
            0xC0A0 => self.buffer_of_cp(index, each),
            _ => szl_outside::empty(id),
        }
    }

    fn run_times(&mut self, ob: u16) -> Option<RunTimes> {
        let own = ob == 0;
        let ob = if own { self.class_ob } else { ob };
        if !OTHER_OBS.contains(&ob) && slot_of(ob).is_none() {
            return None;
        }
        let mut times =
            RunTimes { ob, priority: u16::from(priority_of(ob)), last_run: u32::MAX, ..RunTimes::default() };
        let (now, running, inside) = (self.hot.now, self.class_ob, self.inside);
        if let Some(record) = self.obs.of(ob) {
            record.times(now, (running == ob).then_some(inside), own, &mut times);
        }
        Some(times)
    }
}

/// A record of words.
fn words(list: &[u16], each: Each<'_>) -> Length {
    list.iter().for_each(|word| each(&word.to_be_bytes()));
    Ok(2)
}

/// Calls `give` for each index of a list, or for the one that is asked for.
fn chosen(all: &[u16], index: Option<u16>, give: &mut dyn FnMut(u16)) -> Result<(), StatusError> {
    match index {
        None => all.iter().for_each(|index| give(*index)),
        Some(index) if all.contains(&index) => give(index),
        Some(_) => return Err(StatusError::Index),
    }
    Ok(())
}

/// The number in front of each dot of this version.
fn version() -> [u8; 3] {
    let mut numbers = env!("CARGO_PKG_VERSION").split('.').map(|n| n.parse().unwrap_or(0));
    std::array::from_fn(|_| numbers.next().unwrap_or(0))
}

impl Machine {
    const fn name(&self) -> &'static str {
        match self.config.family {
            Family::S7_300 => "ob1 S7-300",
            Family::S7_400 => "ob1 S7-400",
        }
    }

    /// The order number: that of the station file, or the name.
    fn order(&self) -> &str {
        if self.config.order.is_empty() { self.name() } else { &self.config.order }
    }

    /// Order number (20 characters), type, version: of the module, the basic hardware, the firmware, the boot loader.
    fn identification(&self, index: Option<u16>, each: Each<'_>) -> Length {
        let [major, minor, patch] = version();
        chosen(&[0x01, 0x06, 0x07, 0x81], index, &mut |index| {
            let (text, ty, version) = match index {
                0x07 => ("", OWN_TYPE, [b'V', major, minor, patch]),
                0x81 => ("Boot Loader", 0, [b'A', major, minor, patch]),
                _ => (self.order(), OWN_TYPE, [0, 1, 0, 1]),
            };
            each(&Record::<28>::new().word(index).text(text, 20, b' ').word(ty).put(&version).bytes);
        })?;
        Ok(28)
    }

    /// By groups: MC7 unit, time system, system response, instructions.
    fn characteristics(&self, group: Option<u16>, each: Each<'_>) -> Length {
        let large = self.config.family == Family::S7_400;
        // Interpreter; 1 ms, all clock functions; which restarts; 32 bits, floats with functions, 4 accumulators, MCR,
        // AR1 and AR2, area-crossing, area-internal, memory-indirect for M, DB, DI, L, parameters of FCs, edges of I,
        // Q, M, DB, DI, L, /FC.
        let groups: [(u16, &[u16]); 4] = [
            (0x0000, &[0x0002]),
            (0x0100, &[0x0101, 0x0105]),
            // An S7-300 has the warm restart only, and says nothing here.
            (0x0200, if large { &[0x0202] } else { &[] }),
            (
                0x0300,
                &[
                    0x0302, 0x0303, 0x0304, 0x0305, 0x0306, 0x0307, 0x0308, 0x0309, 0x030A, 0x030B, 0x030C, 0x030D,
                    0x030E, 0x030F, 0x0310, 0x0311, 0x0312, 0x0313, 0x0314, 0x0315, 0x0316,
                ],
            ),
        ];
        if group.is_some_and(|group| groups.iter().all(|(id, _)| *id != group)) {
            return Err(StatusError::Index);
        }
        if !large && group == Some(0x0200) {
            return Ok(0);
        }
        for (_, list) in groups.into_iter().filter(|(id, _)| group.is_none_or(|group| group == *id)) {
            for word in list.iter().filter(|word| **word != 0x0305 || self.config.accumulators == 4) {
                each(&word.to_be_bytes());
            }
        }
        Ok(2)
    }

    /// Bytes of all data blocks and of the room for those the program makes, and those in use.
    fn work_memory(&self) -> (u32, u32) {
        let all = self.memory.bytes.len() as u32;
        (all, all - self.memory.pool.len + self.memory.taken_of_pool())
    }

    /// The work memory; load memory (integrated, plugged in, the most of it) and backup: there is none.
    fn memory_areas(&self, index: Option<u16>, each: Each<'_>) -> Length {
        let (all, used) = self.work_memory();
        chosen(&[1, 2, 3, 4, 5], index, &mut |index| {
            let record = Record::<36>::new().word(index);
            let record = match index {
                1 => record.word(1).long(all).word(0b1_0001).word(0).long(all).long(used).long(all - used),
                2 => record.word(1),
                _ => record.word(2).long(0).word(0b10),
            };
            each(&record.bytes);
        })?;
        Ok(36)
    }

    /// The memories of list 001A: load, work and retentive memory with size and most. The layout is that of the
    /// recordings named in docs/s7-link.md.
    fn memories(&self, each: Each<'_>) -> Length {
        let (all, _) = self.work_memory();
        let kept = self.config.memory_bytes;
        for (kind, form, size) in [(0x0901, 0x0105, all), (0x1201, 0x0002, all), (0x1801, 0x0002, kept)] {
            each(&Record::<12>::new().word(kind).word(form).long(size).long(size).bytes);
        }
        Ok(12)
    }

    /// What of these memories is used, and what is free.
    fn memory_parts(&self, each: Each<'_>) -> Length {
        let (all, used) = self.work_memory();
        let memory = &self.config.retentive.memory;
        let kept: u32 = memory.iter().map(|range| range.end.saturating_sub(range.start)).sum();
        let rest = self.config.memory_bytes.saturating_sub(kept);
        for (kind, load, parts) in
            [(0x0900, 2, [used, all - used]), (0x1200, 0, [used, all - used]), (0x1800, 0, [kept, rest])]
        {
            for (free, bytes) in [0x0000, 0x0070].into_iter().zip(parts) {
                let record = Record::<20>::new().word(kind).word(free).word(load).long(0).word(0);
                each(&record.long(bytes).bytes);
            }
        }
        Ok(20)
    }

    /// Process images, bit memory, timers, counters, peripheral area, local data: how many, and how many are retentive.
    fn system_areas(&self, each: Each<'_>) -> Length {
        let c = &self.config;
        let short = |n: u32| n.min(0xFFFF) as u16;
        let retentive = |ranges: &[std::ops::Range<u32>]| ranges.iter().map(|r| r.end.saturating_sub(r.start)).sum();
        let few = |ranges: &[std::ops::Range<u16>]| ranges.iter().map(|r| r.end.saturating_sub(r.start)).sum();
        let memory: u32 = retentive(&c.retentive.memory);
        for (index, count, kept) in [
            (1, short(c.input_bytes), 0),
            (2, short(c.output_bytes), 0),
            (3, short(c.memory_bytes * 8), short(memory * 8)),
            (4, c.timers, few(&c.retentive.timers)),
            (5, c.counters, few(&c.retentive.counters)),
            (6, 0xFFFF, 0),
            (7, short(c.local_bytes), 0),
            (8, short(c.memory_bytes), short(memory)),
            (9, short(c.local_bytes / 1024), 0),
        ] {
            each(&Record::<8>::new().word(index).word(1).word(count).word(kept).bytes);
        }
        Ok(8)
    }

    /// OB, DB, SDB, FC, FB: how many there can be, and how large.
    fn block_types(&self, index: Option<u16>, each: Each<'_>) -> Length {
        chosen(&[0x0800, 0x0A00, 0x0B00, 0x0C00, 0x0E00], index, &mut |index| {
            let (count, kbytes) = match index {
                0x0800 => ((OTHER_OBS.len() + 1 + crate::interrupts::SLOTS) as u16, 64),
                0x0A00 => (0xFFFF, 64),
                0x0B00 => (0, 0),
                _ => (0xFFFF, 64),
            };
            each(&Record::<10>::new().word(index).word(count).word(kbytes).long(u32::from(kbytes) * 1024).bytes);
        })?;
        Ok(10)
    }

    fn leds(&self, index: Option<u16>, each: Each<'_>) -> Length {
        let fault = self.modules.list.iter().any(|plugged| plugged.lost || !plugged.module.status().present);
        let bus_fault = self.modules.list.iter().any(|plugged| plugged.slot.bus.is_some() && plugged.lost);
        let state = self.state_shown();
        chosen(&LEDS, index, &mut |led| {
            // RUN flashes at 2 Hz in the start-up.
            let (on, blink) = match led {
                0x0001 => (fault, 0),
                0x0004 => {
                    let flashes = matches!(state, OperatingState::Startup | OperatingState::Hold);
                    (state != OperatingState::Stop, u8::from(flashes))
                }
                0x0005 => (matches!(state, OperatingState::Stop | OperatingState::Hold), 0),
                // A bus is at fault when one of its stations is.
                0x000B => (bus_fault, 0),
                0x0006 => (self.force.is_on(), 0),
                // A second bus, maintenance.
                _ => (false, 0),
            };
            each(&Record::<4>::new().word(led).put(&[u8::from(on), blink]).bytes);
        })?;
        Ok(4)
    }

    /// The event of the last transition to STOP that is still in the buffer.
    fn last_stop(&self) -> u16 {
        let is_stop =
            |entry: &&DiagEntry| matches!(entry.event.state_change(), Some(StateChange::Stop | StateChange::Fault));
        self.diag.iter().find(is_stop).map_or(0x4304, |entry| entry.event.0)
    }

    /// The state a program sees when it asks: RUN, or STARTUP while a start-up runs.
    fn state_shown(&self) -> OperatingState {
        let inside = if matches!(self.class_ob, 100..=102) { OperatingState::Startup } else { OperatingState::Run };
        self.seen_from_outside.unwrap_or(inside)
    }

    /// Names: of the station and of the module, the plant's (none), copyright, serial number, module type; memory card,
    /// maker, a seller's copyright, location: none.
    fn components(&self, index: Option<u16>, each: Each<'_>) -> Length {
        chosen(&[1, 2, 3, 4, 5, 7, 8, 9, 10, 11], index, &mut |index| {
            let (text, len) = match index {
                1 | 2 => (self.name(), 24),
                3 => ("", 32),
                4 => ("ob1", 26),
                5 => (self.config.serial.as_str(), 24),
                7 => (self.name(), 32),
                _ => ("", 32),
            };
            each(&Record::<34>::new().word(index).text(text, len, 0).bytes);
        })?;
        Ok(34)
    }

    /// Start information of an OB as it would be now, what can be done with it, and when it is called.
    fn interrupt_status(&mut self, ob: u16, each: Each<'_>) -> Length {
        let Some(loaded) =
            (OTHER_OBS.contains(&ob) || ob == 122 || slot_of(ob).is_some()).then(|| self.obs.of(ob).is_some())
        else {
            return Err(StatusError::Index);
        };
        let (event, active) = match ob {
            1 => (0x1101, true),
            10..=17 => (0x1111 + ob - 10, self.services.time_of_day[usize::from(ob - 10)].active),
            20..=23 => (0x1121 + ob - 20, self.services.delays[usize::from(ob - 20)].due.is_some()),
            30..=38 => (0x1131 + ob - 30, loaded),
            40..=47 => (0x1141 + ob - 40, loaded),
            100..=102 => (0x1381, false),
            121 => (0x2521, false),
            122 => (0x2942, false),
            _ => (0x3501, false),
        };
        let locked = self.services.locks.is_disabled(ob);
        let silent = locked && self.services.locks.is_silent(ob);
        let flags = u16::from(locked) << 1 | u16::from(active) << 2 | u16::from(loaded) << 4 | u16::from(silent) << 6;
        let start = Record::<28>::new().word(event).put(&[priority_of(ob), ob as u8]);
        let mut record = start.bytes;
        record[20..22].copy_from_slice(&flags.to_be_bytes());
        each(&record);
        Ok(28)
    }

    /// The last transition: its event, this state (3: STOP, 6: STARTUP, 8: RUN) and the one before. If only the current
    /// state is asked for (0424), the one before is left out, because clients compare the whole byte with 08 and 03.
    fn operating_state(&self, only_now: bool, each: Each<'_>) -> Length {
        let (event, now, before) = match self.state_shown() {
            // What led to STOP, if it is still in the buffer.
            OperatingState::Stop => (self.last_stop(), 0x03, 0x08),
            OperatingState::Startup => (0x4301, 0x06, 0x04),
            OperatingState::Run => (0x4302, 0x08, 0x06),
            OperatingState::Hold => (ob1_model::Event::HOLD.0, 0x0A, 0x08),
        };
        let before = if only_now { 0 } else { before };
        // Request of the start-up, and its OB10x_STRT_INFO except the first byte.
        let start = &self.services.start_up;
        let record = Record::<20>::new().word(event).put(&[0xFF, before << 4 | now]).long(0);
        let record = record.put(&[start[1], start[9], start[10], start[11]]);
        each(&record.put(&self.started).bytes);
        Ok(20)
    }

    /// The module at an address, or all.
    fn module_status(&self, address: Option<u16>, each: Each<'_>) -> Length {
        let wanted = |plugged: &Plugged| address.is_none_or(|a| plugged.has(u32::from(a & 0x7FFF), a & 0x8000 != 0));
        let found = self.modules_where(&wanted, each);
        if found || address.is_none() { Ok(16) } else { Err(StatusError::Index) }
    }

    /// Rack and slot, address, expected and actual type, state, area and width. True: there is one.
    fn modules_where(&self, wanted: &dyn Fn(&Plugged) -> bool, each: Each<'_>) -> bool {
        let base = |plugged: &Plugged| plugged.slot.input_address.min(plugged.slot.output_address);
        let mut found = false;
        for (place, plugged) in self.modules.list.iter().enumerate().filter(|(_, plugged)| wanted(plugged)) {
            found = true;
            let present = plugged.module.status().present && !plugged.lost;
            // Module available or not, fault, in the local bus segment.
            let state = if present { 0x0002 } else { 0x0005 } | 0x0080;
            let central = (0, place as u16 + SLOT, u16::from(self.config.family == Family::S7_300));
            // Area 2: distributed I/O.
            let (adr1, slot, area) = plugged.slot.bus.map_or(central, |place| {
                (u16::from(place.master & 0x7F) << 8 | u16::from(place.station), u16::from(place.slot), 2)
            });
            let record = Record::<16>::new().word(adr1).word(slot << 8).word(base(plugged) as u16);
            each(&record.word(0).word(0).word(0).word(state).word(area << 4 | 1).bytes);
        }
        found
    }

    /// Rack 0: the CPU itself, then its modules.
    fn rack_status(&self, each: Each<'_>) -> Length {
        let record = Record::<16>::new().word(0).word(SLOT_OF_CPU << 8).word(OWN_ADDRESS);
        each(&record.word(OWN_TYPE).word(OWN_TYPE).word(0).word(0xB402).word(0x0011).bytes);
        self.modules_where(&|plugged| plugged.slot.bus.is_none(), each);
        Ok(16)
    }

    /// The newest entries first: event, block type, number, block and line as OB 121 has them, date and time.
    fn diagnostic_buffer(&self, most: usize, each: Each<'_>) -> Length {
        for (entry, date) in self.diag.with_dates().take(most) {
            each(&diagnostic_entry(entry, date));
        }
        Ok(20)
    }

    /// The module at a logical address; bit 15 stands for an output.
    fn addressed(&mut self, address: u16) -> Result<&mut Plugged, StatusError> {
        let (at, output) = (u32::from(address & 0x7FFF), address & 0x8000 != 0);
        self.modules.list.iter_mut().find(|plugged| plugged.has(at, output)).ok_or(StatusError::Index)
    }

    /// The module in a rack (high byte: 0) and slot (low byte).
    fn slotted(&mut self, place: u16) -> Result<&mut Plugged, StatusError> {
        let index = place.checked_sub(SLOT).ok_or(StatusError::Index)?;
        let central = |plugged: &&mut Plugged| place < 0x100 && plugged.slot.bus.is_none();
        self.modules.list.get_mut(usize::from(index)).filter(central).ok_or(StatusError::Index)
    }

    /// Diagnostic buffer of the CP at a logical address, newest entry first. (docs/standard-blocks.md)
    fn buffer_of_cp(&mut self, address: u16, each: Each<'_>) -> Length {
        let wall = self.wall;
        let plugged = self.addressed(address)?;
        let base = plugged.slot.input_address as u16;
        let has_buffer = plugged.module.diagnostic_buffer(&mut |entry| {
            each(&cp_entry(entry, base, wall));
        });
        if has_buffer { Ok(20) } else { Err(StatusError::Index) }
    }
}

/// An entry of the CPU's buffer, with its date and time.
fn diagnostic_entry(entry: &DiagEntry, date: [u8; 8]) -> [u8; 20] {
    let (kind, block, line) = match entry.site {
        Some(site) => (block_code(site.block.kind), site.block.number, site.line as u16),
        None => (0, 0, 0),
    };
    let record = Record::<20>::new().word(entry.event.0).word(0).put(&[kind, 0]).word(entry.data as u16);
    record.word(block).word(line).put(&date).bytes
}

/// An entry of a CP's buffer as one of the CPU's: event of class F (modules other than CPUs), incoming or outgoing,
/// with the CP's event class; event class and number, address, date and time.
fn cp_entry(entry: ModuleEntry, base: u16, wall: Wall) -> [u8; 20] {
    let event = if entry.incoming { 0xF900 } else { 0xF800 } | entry.number >> 8;
    let record = Record::<20>::new().word(event).long(0).word(entry.number).word(base).word(0);
    record.put(&wall.bytes(entry.time)).bytes
}

/// Diagnostic data record 0 or 1.
fn diagnostic_record(plugged: &mut Plugged, number: u8, each: Each<'_>) -> Length {
    let mut bytes = [0; RECORD];
    let room = if number == 0 { 4 } else { RECORD };
    match plugged.module.record_read(number, &mut bytes[..room]) {
        Ok(len) => {
            let len = if number == 0 { 4 } else { len };
            each(&bytes[..len]);
            Ok(len as u16)
        }
        // No diagnostic data of its own: what the CPU knows. Module fault, wrong or missing module, communication.
        Err(_) if number == 0 => {
            let present = plugged.module.status().present && !plugged.lost;
            each(if present { &[0, 0x0C, 0, 0] } else { &[0x01, 0x0C, 0x03, 0] });
            Ok(4)
        }
        Err(_) => Err(StatusError::NotNow),
    }
}

/// The type of a block as start information and lists tell it.
pub(crate) const fn block_code(kind: BlockKind) -> u8 {
    match kind {
        BlockKind::Ob => 0x88,
        BlockKind::Db => 0x8A,
        BlockKind::Sdb => 0x8B,
        BlockKind::Fc | BlockKind::Sfc => 0x8C,
        BlockKind::Fb | BlockKind::Sfb => 0x8E,
    }
}
