//! A station and a bus of meters in virtual time: the real CPU, plugin, driver pump and firmware; the meters are [`crate::meters`].

use std::path::Path;

use ob1_cp::LinePort as _;
use ob1_cpu::Nanos;
use ob1_firmware::{LineFault, LineInput};
use ob1_line::sim::{End, FaultRates, SplitMix64};

use super::cable::{self, Cable};
use super::driver::Driver;
use super::station::SimStation;
use super::{MS, SECOND, Scenario};
use crate::meters::Bus;

/// A meter thinks so long before it answers: 11 to 330 bit times and 50 ms are permitted; this is enough for 11 bits at 300 baud.
const THINKS: Nanos = 40 * MS;

/// The simulation.
#[derive(Debug)]
pub struct Reading {
    /// The station with its program.
    pub station: SimStation,
    /// The meters.
    pub bus: Bus,
    /// While it is true the bus is short-circuited: nothing gets through, and the converter reports a break at each frame.
    pub shorted: bool,
    /// Virtual time.
    pub now: Nanos,
    drivers: Vec<Driver>,
    cable: Cable,
    answer: Option<(Nanos, Vec<u8>)>,
    log: String,
}

impl Reading {
    /// The station of this file, with these meters on its line.
    ///
    /// # Errors
    /// What is wrong with the files, as text.
    pub fn build(station: &Path, bus: Bus, seed: u64) -> Result<Self, String> {
        let scenario = Scenario {
            stations: Vec::new(),
            seed,
            duration: SECOND,
            faults: FaultRates::NONE,
            coalesce: 0,
            kill_every: 0,
            wire: false,
        };
        let cable = Cable::new("mbus", seed, &scenario, 0);
        let mut drivers = Vec::new();
        let mut rng = SplitMix64::new(seed);
        let station = SimStation::build(station, &mut |_| Ok((0, End::A)), &mut drivers, &mut rng)?;
        Ok(Self { station, bus, shorted: false, now: 0, drivers, cable, answer: None, log: String::new() })
    }

    /// Runs until `done` after a scan, at most so long; whether it was done. Nothing that waits for the CPU is lost in between.
    pub fn until(&mut self, most: Nanos, mut done: impl FnMut(&SimStation) -> bool) -> bool {
        let end = self.now + most;
        while self.now < end {
            let drivers = self.drivers.iter().map(Driver::next_event);
            let answer = self.answer.as_ref().map(|(at, _)| *at);
            let next = drivers.chain([self.station.due]).chain(self.cable.next_event()).chain(answer).min();
            self.now = self.now.max(next.unwrap_or(end));
            self.line();
            for driver in &mut self.drivers {
                if driver.next_event() <= self.now {
                    driver.advance(self.now, &mut self.cable);
                }
            }
            if self.station.due <= self.now {
                self.station.cycle(self.now, &mut self.log);
                for driver in &mut self.drivers {
                    driver.listen(self.now);
                }
                if done(&self.station) {
                    return true;
                }
            }
        }
        false
    }

    /// `kill -9` of the driver; the supervisor starts another.
    pub fn kill_driver(&mut self) {
        for driver in &mut self.drivers {
            driver.kill(self.now, &mut self.cable);
        }
    }

    /// What the CPU's diagnostic buffer said.
    #[must_use]
    pub fn log(&self) -> &str {
        &self.log
    }

    fn line(&mut self) {
        let mut buffer = cable::buffer();
        while self.cable.next_event().is_some_and(|at| at <= self.now) {
            let Some((end, input)) = self.cable.pop(self.now, &mut buffer) else { break };
            let Some(input) = input else { continue };
            match (end, input) {
                (End::A, input) => {
                    for driver in &mut self.drivers {
                        driver.line_event(self.now, input, &mut self.cable);
                    }
                }
                (End::B, LineInput::Rx(_)) if self.shorted => {
                    for driver in &mut self.drivers {
                        driver.line_event(self.now, LineInput::Fault(LineFault::Break), &mut self.cable);
                    }
                }
                (End::B, LineInput::Rx(bytes)) => {
                    let answer = self.bus.hear(bytes);
                    if !answer.is_empty() {
                        self.answer = Some((self.now + THINKS, answer));
                    }
                }
                (End::B, _) => {}
            }
        }
        if let Some((_, bytes)) = self.answer.take_if(|(at, _)| *at <= self.now) {
            self.cable.end(End::B).transmit(self.now, &bytes);
        }
    }
}
