//! One station and a device on its line, in virtual time: the real CPU, plugin, driver pump and firmware; the device is
//! a separate machine.

use std::path::Path;

use ob1_cp::LinePort as _;
use ob1_fakes::sim_line::End;
use ob1_firmware::{LineFault, LineInput};
use ob1_host::module::CpSettings;
use ob1_line::sim::{FaultRates, SplitMix64};
use ob1_time::{Instant, Span};

use super::cable::{self, Cable};
use super::clock::VirtualClock;
use super::driver::Driver;
use super::station::{Plug, SimStation};
use super::{SECOND, Scenario};

/// A device on the line of a station.
pub trait Device {
    /// Takes characters, or none at a deadline; writes its output to `out`. Returns its next deadline.
    fn hear(&mut self, now: Instant, bytes: &[u8], out: &mut Vec<u8>) -> Option<Instant>;

    /// The line is short-circuited at the device: it receives nothing, and characters of the station return to it as a
    /// break.
    fn is_shorted(&self) -> bool {
        false
    }
}

/// The station with its device.
#[derive(Debug)]
pub struct Bench<D> {
    /// The station with its program.
    pub station: SimStation,
    /// The device.
    pub device: D,
    /// Virtual time.
    pub now: Instant,
    drivers: Vec<Driver>,
    cable: Cable,
    due: Option<Instant>,
    log: String,
}

impl<D: Device> Bench<D> {
    /// The station in this file with this device.
    ///
    /// # Errors
    /// The error in the files, as text.
    pub fn build(station: &Path, device: D, seed: u64) -> Result<Self, String> {
        Self::build_on(station, device, FaultRates::NONE, seed)
    }

    /// The same on a bad line.
    ///
    /// # Errors
    /// The error in the files, as text.
    pub fn build_on(station: &Path, device: D, faults: FaultRates, seed: u64) -> Result<Self, String> {
        Self::build_with(station, device, faults, seed, &|_| {})
    }

    /// The same; `spoil` may change the configuration of the drivers.
    ///
    /// # Errors
    /// The error in the files, as text.
    pub fn build_with(
        station: &Path,
        device: D,
        faults: FaultRates,
        seed: u64,
        spoil: &dyn Fn(&mut CpSettings),
    ) -> Result<Self, String> {
        Self::make(station, device, (faults, Instant::NEVER), seed, spoil)
    }

    /// The same on a line that is bad until `calm`.
    ///
    /// # Errors
    /// The error in the files, as text.
    pub fn build_until(
        station: &Path,
        device: D,
        faults: FaultRates,
        calm: Instant,
        seed: u64,
    ) -> Result<Self, String> {
        Self::make(station, device, (faults, calm), seed, &|_| {})
    }

    fn make(
        station: &Path,
        device: D,
        (faults, calm): (FaultRates, Instant),
        seed: u64,
        spoil: &dyn Fn(&mut CpSettings),
    ) -> Result<Self, String> {
        let scenario = Scenario {
            stations: Vec::new(),
            seed,
            duration: SECOND,
            faults,
            coalesce: Span::ZERO,
            kill_every: Span::ZERO,
            call: Span::ZERO,
            wire: false,
        };
        let cable = Cable::new("device", seed, &scenario, calm);
        let mut drivers = Vec::new();
        let mut rng = SplitMix64::new(seed);
        let plug: &mut Plug<'_> = &mut |_| Ok((0, End::A));
        let station = SimStation::build_with(station, plug, &mut drivers, &mut rng, spoil)?;
        Ok(Self { station, device, now: Instant::START, drivers, cable, due: None, log: String::new() })
    }

    /// Acts on the device without using the line; `act` returns its next deadline.
    pub fn meanwhile(&mut self, act: impl FnOnce(&mut D, Instant, &mut Vec<u8>) -> Option<Instant>) {
        let mut out = Vec::new();
        self.due = act(&mut self.device, self.now, &mut out);
        self.write(&out);
    }

    /// Runs for a time.
    pub fn pass(&mut self, time: Span) {
        self.until(time, |_| false);
    }

    /// Runs until `done` is true after a scan, at most for `most`; returns whether it was.
    pub fn until(&mut self, most: Span, mut done: impl FnMut(&mut SimStation) -> bool) -> bool {
        let end = self.now + most;
        while self.now < end {
            let drivers = self.drivers.iter().map(Driver::next_event);
            let next = drivers.chain([self.station.due, end]).chain(self.cable.next_event()).chain(self.due).min();
            self.now = self.now.max(next.unwrap_or(end));
            self.line();
            for driver in &mut self.drivers {
                if driver.next_event() <= self.now {
                    driver.advance(self.now, &mut self.cable);
                }
            }
            if self.station.due <= self.now {
                self.station.cycle(self.now, &mut VirtualClock(self.now));
                self.station.tell(self.now, &mut self.log);
                for driver in &mut self.drivers {
                    driver.listen(self.now);
                }
                if done(&mut self.station) {
                    return true;
                }
            }
        }
        false
    }

    /// `kill -9` of the driver; the supervisor starts another one.
    pub fn kill_driver(&mut self) {
        for driver in &mut self.drivers {
            driver.kill(self.now, &mut self.cable);
        }
    }

    /// The line has a fault, or works again.
    pub fn fault(&mut self, fault: LineFault) {
        self.tell(LineInput::Fault(fault));
    }

    /// CP 341: the numbers in its diagnostic buffer, oldest first.
    #[must_use]
    pub fn entries(&self) -> &[u16] {
        self.cable.entries(End::A)
    }

    /// The log of the CPU's diagnostic buffer.
    #[must_use]
    pub fn log(&self) -> &str {
        &self.log
    }

    fn line(&mut self) {
        let mut buffer = cable::buffer();
        while self.cable.next_event().is_some_and(|at| at <= self.now) {
            let Some((end, input)) = self.cable.pop(self.now, &mut buffer) else { break };
            match (end, input) {
                (End::A, Some(input)) => self.tell(input),
                (End::B, Some(LineInput::Rx(_))) if self.device.is_shorted() => {
                    self.tell(LineInput::Fault(LineFault::Break));
                }
                (End::B, Some(LineInput::Rx(bytes))) => {
                    let mut out = Vec::new();
                    self.due = self.device.hear(self.now, bytes, &mut out);
                    self.write(&out);
                }
                _ => {}
            }
        }
        if self.due.is_some_and(|due| due <= self.now) {
            let mut out = Vec::new();
            self.due = self.device.hear(self.now, &[], &mut out);
            self.write(&out);
        }
    }

    fn tell(&mut self, input: LineInput<'_>) {
        for driver in &mut self.drivers {
            driver.line_event(self.now, input, &mut self.cable);
        }
    }

    fn write(&mut self, bytes: &[u8]) {
        if !bytes.is_empty() {
            self.cable.end(End::B).transmit(self.now, bytes);
        }
    }
}
