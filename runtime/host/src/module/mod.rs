//! A CP on the back plane as the CPU sees it: the CPU's end of a segment behind the port [`ob1_cpu::Module`].
//!
//! Nothing that comes out of the segment is trusted. What has no meaning becomes an entry in the diagnostic buffer and
//! a counter, once per kind and driver; a driver that is down reads as 0. The registers a program reads are those of
//! the moment (`L PEW`), and what it writes is published at once; the doorbell is rung at the end of the scan.

mod link;
pub(crate) mod messages;
#[cfg(test)]
mod tests;

use ob1_backplane::layout::{BOX_BYTES, CHANNEL_BYTES};
use ob1_backplane::{Channel, CpuSide, CpuState, DriverState, Fault, TooLong};
use ob1_cpu::{Module, ModuleEntry, ModuleError, ModuleEvent, ModuleStatus};
use ob1_time::Instant;

pub use link::{AlwaysThere, DriverLink, Life};
use messages::Messages;
pub use messages::line_gone;

/// Number of the parameter record. [S3 L341]
const PARAMETER_RECORD: u8 = 0x80;
/// Most register bytes a segment has.
const IO_MAX: usize = ob1_backplane::layout::IO_BYTES_MAX;
/// Messages of a driver taken in one call of `poll_event`: it can make them as fast as they are read.
const LOOKS: u32 = 8;

/// What the station file says about a CP.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct CpSettings {
    /// The parameter bytes of the module.
    pub parameters: [u8; 16],
    /// The configuration of the driver, as JSON.
    pub json: Vec<u8>,
    /// `absent = "fault"`: an access while the driver is down is an access error (OB 122), instead of reading 0.
    pub absent_is_fault: bool,
    /// It has channels (the CP 341): its handling blocks read and write them as data records.
    /// (`docs/cp341-channels.md`) So it has a diagnostic buffer of its own too.
    pub channels: bool,
    /// A program may write its parameters, record 80h, in RUN (the CP 040). [S3 L341]
    pub takes_parameters: bool,
    /// It has boxes (the CP 343): its handling blocks read and write them as data records. (`docs/cp343.md`)
    pub boxes: bool,
    /// `diagnostics = true`: it may raise diagnostic interrupts (OB 82). Otherwise it may not, whatever its driver
    /// does.
    pub diagnostics: bool,
}

/// A CP in its place on the back plane.
pub struct CpModule {
    side: CpuSide,
    link: Box<dyn DriverLink>,
    settings: CpSettings,
    outputs: [u8; IO_MAX],
    messages: Messages,
    /// The CPU's part of the segment has been restored for this many attempts to start a driver.
    whole_for: u32,
}

impl CpModule {
    /// The module over the CPU's end of its segment. `link` reaches the driver.
    ///
    /// # Errors
    /// [`TooLong`] when the JSON text does not fit the parameter record.
    pub fn new(side: CpuSide, link: Box<dyn DriverLink>, settings: CpSettings) -> Result<Self, TooLong> {
        let room = ob1_backplane::layout::JSON_BYTES;
        if settings.json.len() > room {
            return Err(TooLong { found: settings.json.len(), room });
        }
        let messages = Messages::new(settings.diagnostics);
        // The first driver finds the segment as it was made.
        Ok(Self { side, link, settings, outputs: [0; IO_MAX], messages, whole_for: 1 })
    }

    /// True while a driver is attached that has shown its state. An undefined state word is not a state. A driver
    /// that was started during this scan is present from the next cycle control point on, when the CPU's part is
    /// restored for it: an earlier order would be overwritten unseen.
    #[inline]
    fn is_present(&self) -> bool {
        let state = self.side.monitor().driver_state();
        self.link.is_running_of(self.whole_for)
            && !matches!(state, Ok(DriverState::Absent | DriverState::Starting) | Err(_))
    }

    fn io_bytes(&self) -> usize {
        self.side.io_bytes().min(IO_MAX)
    }

    /// The bytes of an access, if they lie inside the registers.
    #[inline]
    fn range(&self, at: u16, len: usize) -> Result<std::ops::Range<usize>, ModuleError> {
        let at = usize::from(at);
        match at.checked_add(len) {
            Some(end) if end <= self.io_bytes() => Ok(at..end),
            _ => Err(ModuleError::Outside),
        }
    }

    /// A fault of the segment: an entry is due the first time a driver makes one of this kind.
    #[cold]
    fn garbage(&mut self, fault: Fault) {
        self.messages.garbage(fault, self.link.life().incidents);
    }

    fn send_parameters(&mut self) {
        // The length was checked when the module was made.
        let _fits = self.side.write_params(&self.settings.parameters, &self.settings.json);
    }

    /// The box with this record number.
    fn box_of(&self, record: u8) -> Option<usize> {
        self.settings.boxes.then(|| ob1_words::boxes::of_record(record)).flatten()
    }

    /// The channel with this record number.
    fn channel(&self, record: u8) -> Option<Channel> {
        self.settings.channels.then(|| Channel::of_record(record)).flatten()
    }
}

impl Module for CpModule {
    fn input_bytes(&self) -> u16 {
        self.io_bytes() as u16
    }

    fn output_bytes(&self) -> u16 {
        self.io_bytes() as u16
    }

    fn begin_scan(&mut self, now: Instant) {
        self.side.begin_scan(now.nanos());
        self.messages.time(now);
        if let Err(fault) = self.side.monitor().driver_state() {
            self.garbage(fault);
        }
    }

    #[inline]
    fn read(&mut self, at: u16, into: &mut [u8]) -> Result<(), ModuleError> {
        let range = self.range(at, into.len())?;
        if !self.is_present() {
            into.fill(0);
            return if self.settings.absent_is_fault { Err(ModuleError::Absent) } else { Ok(()) };
        }
        // A stale copy is whole, only not the newest: the next look sees more. CpuSide counts them.
        let _freshness = self.side.read_inputs_from(range.start, into);
        Ok(())
    }

    #[inline]
    fn write(&mut self, at: u16, from: &[u8]) -> Result<(), ModuleError> {
        let range = self.range(at, from.len())?;
        // Kept even while the driver is down: what is written is what the registers hold when it comes back.
        self.outputs[range].copy_from_slice(from);
        let len = self.io_bytes();
        self.side.write_outputs(&self.outputs[..len]);
        if self.settings.absent_is_fault && !self.is_present() { Err(ModuleError::Absent) } else { Ok(()) }
    }

    fn end_scan(&mut self, now: Instant) {
        self.side.end_scan(now.nanos(), |_| ());
        self.side.set_time(now.nanos());
        self.side.beat();
        if self.side.take_doorbell() {
            self.link.ring();
        }
    }

    fn cpu_state(&mut self, run: bool) {
        if run {
            self.send_parameters();
        }
        self.side.set_cpu_state(if run { CpuState::Run } else { CpuState::Stop });
    }

    fn poll_event(&mut self) -> Option<ModuleEvent> {
        let life = self.link.life();
        if life.attempts > self.whole_for {
            // The last driver, or anybody else while there was none, may have written where it must not, the parameters
            // included.
            self.whole_for = life.attempts;
            self.side.restore();
            self.send_parameters();
        }
        if let Some(report) = self.link.next_report() {
            return Some(messages::of_report(report));
        }
        self.messages.lost(self.side.monitor().events_lost());
        for _ in 0..LOOKS {
            if let Some(event) = self.messages.due() {
                return Some(event);
            }
            if self.messages.is_holding() {
                return None;
            }
            match self.side.poll_event() {
                Ok(None) => return None,
                Ok(Some(event)) => self.messages.take(&event, life.incidents),
                Err(fault) => self.garbage(fault),
            }
        }
        self.messages.due()
    }

    fn status(&self) -> ModuleStatus {
        // Before the generation: a driver seen with its state is seen with its number.
        let present = self.is_present();
        ModuleStatus { present, generation: self.side.monitor().generation() as u32 }
    }

    fn record_read(&mut self, record: u8, into: &mut [u8]) -> Result<usize, ModuleError> {
        if !self.is_present() {
            return Err(ModuleError::Absent);
        }
        if let Some(channel) = self.channel(record) {
            let mut block = [0; CHANNEL_BYTES];
            // A stale copy is whole; the next call sees more.
            let _freshness = self.side.read_channel(channel, &mut block);
            let len = block.len().min(into.len());
            into[..len].copy_from_slice(&block[..len]);
            return Ok(len);
        }
        if let Some(index) = self.box_of(record) {
            let len = into.len().min(BOX_BYTES);
            let into = into.get_mut(..len).unwrap_or_default();
            let _freshness = self.side.read_box(index, into);
            return Ok(len);
        }
        match self.side.read_diagnosis() {
            Ok(found) if !found.data().is_empty() => {
                let data = found.data();
                let data = match (record, found.number) {
                    // Record 0 is the first four bytes of record 1.
                    (0, 1) => data.get(..4).unwrap_or(data),
                    _ if found.number == u32::from(record) => data,
                    _ => return Err(ModuleError::NoRecord),
                };
                let len = data.len().min(into.len());
                into[..len].copy_from_slice(&data[..len]);
                Ok(len)
            }
            Ok(_) => Err(ModuleError::NoRecord),
            Err(fault) => {
                self.garbage(fault);
                Err(ModuleError::NoRecord)
            }
        }
    }

    fn record_write(&mut self, record: u8, from: &[u8]) -> Result<(), ModuleError> {
        if !self.is_present() {
            return Err(ModuleError::Absent);
        }
        if let Some(channel) = self.channel(record) {
            self.side.write_channel(channel, from.try_into().map_err(|_| ModuleError::Outside)?);
            return Ok(());
        }
        if let Some(index) = self.box_of(record) {
            if from.len() > BOX_BYTES {
                return Err(ModuleError::Outside);
            }
            self.side.write_box(index, from);
            return Ok(());
        }
        if self.settings.takes_parameters && record == PARAMETER_RECORD {
            let parameters = from.try_into().map_err(|_| ModuleError::Outside)?;
            // They last until the next start-up, which brings those of the station file again.
            let _fits = self.side.write_params(parameters, &self.settings.json);
            return Ok(());
        }
        // No CP here takes any other record: 00h and 02h of a CP 040 "may only be transferred at STOP state". [S3 L375]
        Err(ModuleError::NoRecord)
    }

    fn is_of_blocks(&self, record: u8) -> bool {
        self.channel(record).is_some() || self.box_of(record).is_some()
    }

    fn diagnostic_buffer(&mut self, each: &mut dyn FnMut(ModuleEntry)) -> bool {
        if !self.settings.channels {
            return false;
        }
        for entry in self.side.monitor().buffer() {
            let time = Instant::from_millis(entry.time_ms);
            each(ModuleEntry { number: entry.number, incoming: entry.incoming, time });
        }
        true
    }
}
