//! A bus as the CPU sees it: the inputs and outputs of each coupler as modules in their places, behind one image that
//! is taken whole at the cycle control point.
//!
//! All modules of a bus live on the scan thread and share one port; nobody else takes its lock. Nothing that the
//! process of the bus says is trusted: an image without a meaning counts as a lost coupler.

mod cp;
mod stations;
#[cfg(test)]
mod tests;

use std::sync::{Arc, Mutex};

use ob1_backplane::{BusCpuSide, BusMemory, BusSize, CpuSide, CpuState, DriverState};
use ob1_coupler::Status;
use ob1_cpu::{DP_DIAGNOSIS, Module, ModuleError, ModuleEvent, ModuleStatus};
use ob1_time::Instant;

use crate::module::DriverLink;
use cp::DpCp;
pub use cp::{DpAreas, DpPiece, area_bytes};
pub use ob1_words::cp342::AREA_BYTES as DP_AREA_BYTES;
use stations::Stations;
pub use stations::{DpStation, Station, StationRules};

/// What the modules of a bus cannot read while their coupler is lost.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum OnLoss {
    /// Their bytes read 0.
    #[default]
    Zero,
    /// What was read last.
    Hold,
    /// These bytes, given by the station file.
    Substitute(Vec<u8>),
}

/// One module of a bus: a piece of the inputs of a coupler, a piece of its outputs, or both.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct BusModuleConfig {
    /// Whose it is, in the order of the bus.
    pub station: usize,
    /// Its slot there; 0 is the station itself.
    pub slot: u8,
    /// First input byte in the image of the bus, and how many.
    pub inputs: (usize, u16),
    /// Number of the range in the coupler's list: what [`Status::bad`] counts.
    pub input_range: Option<usize>,
    /// The same of the outputs.
    pub outputs: (usize, u16),
    /// What its inputs are while they cannot be read.
    pub on_loss: OnLoss,
    /// The first module of its coupler: it reports the coupler's events.
    pub speaks: bool,
}

/// A bus: what its modules share.
#[derive(Clone)]
pub struct Bus {
    shared: Arc<Mutex<Shared>>,
}

struct Shared {
    /// Heartbeat, doorbell, state of the process.
    side: CpuSide,
    link: Box<dyn DriverLink>,
    image: BusCpuSide,
    outputs: Box<[u8]>,
    /// The CPU drives the outputs.
    run: bool,
    stations: Stations,
    /// Counts images of outputs, in the registers: a change of them rings.
    published: u64,
    whole_for: u32,
    bell: bool,
    /// The first module made leads: it takes and gives the image.
    led: bool,
}

impl Bus {
    /// A bus over its memory. `side` is the CPU's end of the segment its process is supervised by, `link` reaches that.
    pub fn new(
        side: CpuSide,
        link: Box<dyn DriverLink>,
        memory: &BusMemory,
        size: BusSize,
        output_bytes: usize,
        stations: Vec<Station>,
        rules: StationRules,
    ) -> Self {
        let shared = Shared {
            side,
            link,
            image: BusCpuSide::new(memory, size),
            outputs: vec![0; output_bytes].into_boxed_slice(),
            run: false,
            stations: Stations::new(stations, rules),
            published: 0,
            whole_for: 1,
            bell: false,
            led: false,
        };
        Self { shared: Arc::new(Mutex::new(shared)) }
    }

    /// One of its modules. The first one made leads.
    pub fn module(&self, config: BusModuleConfig) -> Box<dyn Module> {
        let leads = self.shared.lock().is_ok_and(|mut shared| !std::mem::replace(&mut shared.led, true));
        Box::new(BusModule {
            shared: Arc::clone(&self.shared),
            leads,
            held: vec![0; usize::from(config.inputs.1)],
            config,
        })
    }
}

impl Bus {
    /// The CP 342-5 that the bus is behind: it leads, and no slave of it is a module of its own.
    pub fn cp(&self, areas: DpAreas) -> Box<dyn Module> {
        if let Ok(mut shared) = self.shared.lock() {
            shared.led = true;
        }
        Box::new(DpCp::new(Arc::clone(&self.shared), areas))
    }
}

impl Shared {
    /// The process is there, and says so itself.
    fn is_ready(&self) -> bool {
        self.link.is_running() && matches!(self.side.monitor().driver_state(), Ok(DriverState::Ready))
    }

    /// The cycle control point; whether there is a new image.
    fn begin(&mut self, now: Instant) -> bool {
        let life = self.link.life();
        if life.attempts > self.whole_for {
            // Another process: the last one may have written where it must not.
            self.whole_for = life.attempts;
            self.side.restore();
            self.image.rewrite();
        }
        while let Some(report) = self.link.next_report() {
            self.stations.process(&report);
        }
        let fresh = self.image.take();
        let ready = matches!(self.side.monitor().driver_state(), Ok(DriverState::Ready));
        let (image, life) = (&self.image, (self.link.is_running(), ready));
        self.stations.look(now, life, fresh, |station| Status::from_words(&image.coupler(station)));
        fresh
    }

    fn publish(&mut self) {
        let Self { image, outputs, run, side, published, .. } = self;
        if image.publish(*run, outputs) {
            *published = published.wrapping_add(1);
            side.write_outputs(&published.to_ne_bytes());
        }
    }

    /// HOLD: the couplers are told that nobody drives the outputs; those stay as they are for later.
    fn output_disable(&mut self, on: bool) {
        self.run = !on;
        self.publish();
        self.bell = true;
    }

    /// The CPU went to RUN, or to STOP.
    fn cpu_state(&mut self, run: bool) {
        self.run = run;
        if run {
            self.stations.restart();
        } else {
            self.outputs.fill(0);
        }
        self.publish();
        self.side.set_cpu_state(if run { CpuState::Run } else { CpuState::Stop });
        self.bell = true;
    }

    fn end(&mut self, now: Instant) {
        self.publish();
        self.side.set_time(now.nanos());
        self.side.beat();
        if self.side.take_doorbell() || std::mem::take(&mut self.bell) {
            self.link.ring();
        }
    }
}

/// One module in its place.
struct BusModule {
    shared: Arc<Mutex<Shared>>,
    config: BusModuleConfig,
    leads: bool,
    /// What was read last while that was possible.
    held: Vec<u8>,
}

impl BusModule {
    fn inside(at: u16, count: usize, len: u16) -> Result<(), ModuleError> {
        if usize::from(at) + count <= usize::from(len) { Ok(()) } else { Err(ModuleError::Outside) }
    }

    /// Whether its coupler is exchanged with, and its own piece of it is not refused.
    fn answers(&self, shared: &Shared) -> bool {
        shared.stations.is_present(self.config.station)
            && self.config.input_range.is_none_or(|range| !shared.stations.refuses(self.config.station, range))
    }

    /// The result of an access that found no inputs: no error while the station is still starting.
    fn missed(&self, shared: &Shared) -> Result<(), ModuleError> {
        let stations = &shared.stations;
        let starting = !stations.is_present(self.config.station) && !stations.is_missed(self.config.station);
        if starting { Ok(()) } else { Err(ModuleError::Absent) }
    }
}

impl Module for BusModule {
    fn input_bytes(&self) -> u16 {
        self.config.inputs.1
    }

    fn output_bytes(&self) -> u16 {
        self.config.outputs.1
    }

    fn begin_scan(&mut self, now: Instant) {
        if self.leads
            && let Ok(mut shared) = self.shared.try_lock()
        {
            shared.begin(now);
        }
    }

    /// Direct access: an error while the coupler does not answer. The image is that of the cycle control point.
    fn read(&mut self, at: u16, into: &mut [u8]) -> Result<(), ModuleError> {
        Self::inside(at, into.len(), self.config.inputs.1)?;
        let Ok(shared) = self.shared.try_lock() else { return Err(ModuleError::Busy) };
        if !self.answers(&shared) {
            into.fill(0);
            return self.missed(&shared);
        }
        shared.image.inputs(self.config.inputs.0 + usize::from(at), into);
        Ok(())
    }

    fn read_image(&mut self, into: &mut [u8]) -> Result<(), ModuleError> {
        let Ok(shared) = self.shared.try_lock() else { return Err(ModuleError::Busy) };
        if self.answers(&shared) {
            shared.image.inputs(self.config.inputs.0, &mut self.held);
            for (to, from) in into.iter_mut().zip(&self.held) {
                *to = *from;
            }
            return Ok(());
        }
        match &self.config.on_loss {
            OnLoss::Zero => into.fill(0),
            OnLoss::Hold => into.iter_mut().zip(&self.held).for_each(|(to, from)| *to = *from),
            OnLoss::Substitute(bytes) => into.iter_mut().zip(bytes).for_each(|(to, from)| *to = *from),
        }
        self.missed(&shared)
    }

    fn write(&mut self, at: u16, from: &[u8]) -> Result<(), ModuleError> {
        Self::inside(at, from.len(), self.config.outputs.1)?;
        let Ok(mut shared) = self.shared.try_lock() else { return Err(ModuleError::Busy) };
        let first = self.config.outputs.0 + usize::from(at);
        // Kept while the coupler is lost too: it is what the coupler gets when it returns.
        if let Some(place) = shared.outputs.get_mut(first..first + from.len()) {
            place.copy_from_slice(from);
        }
        if shared.stations.is_missed(self.config.station) { Err(ModuleError::Absent) } else { Ok(()) }
    }

    fn end_scan(&mut self, now: Instant) {
        if self.leads
            && let Ok(mut shared) = self.shared.try_lock()
        {
            shared.end(now);
        }
    }

    fn output_disable(&mut self, on: bool) {
        if self.leads
            && let Ok(mut shared) = self.shared.try_lock()
        {
            shared.output_disable(on);
        }
    }

    fn cpu_state(&mut self, run: bool) {
        if !self.leads {
            return;
        }
        if let Ok(mut shared) = self.shared.try_lock() {
            shared.cpu_state(run);
        }
    }

    fn poll_event(&mut self) -> Option<ModuleEvent> {
        let mut shared = self.shared.try_lock().ok()?;
        if self.leads
            && let Some(event) = shared.stations.bus_event()
        {
            return Some(event);
        }
        if !self.config.speaks {
            return None;
        }
        let Shared { stations, image, .. } = &mut *shared;
        stations.event(self.config.station, |at, into| image.inputs(at, into))
    }

    fn status(&self) -> ModuleStatus {
        let Ok(shared) = self.shared.try_lock() else { return ModuleStatus::default() };
        let generation = shared.side.monitor().generation() as u32;
        ModuleStatus { present: self.answers(&shared), generation }
    }

    /// The diagnosis of a DP slave, at its diagnostic address; also of one that refuses.
    fn record_read(&mut self, record: u8, into: &mut [u8]) -> Result<usize, ModuleError> {
        let Ok(shared) = self.shared.try_lock() else { return Err(ModuleError::Busy) };
        let dp = shared.stations.dp(self.config.station).filter(|_| record == DP_DIAGNOSIS && self.config.speaks);
        let Some(dp) = dp else { return Err(ModuleError::NoRecord) };
        let mut area = [0; _];
        let diagnosis = dp.diagnosis(&mut area, |at, into| shared.image.inputs(at, into));
        if diagnosis.is_empty()
            || shared.stations.is_missed(self.config.station) && !shared.stations.refuses_all(self.config.station)
        {
            return Err(ModuleError::Absent);
        }
        into.get_mut(..diagnosis.len()).ok_or(ModuleError::Outside)?.copy_from_slice(diagnosis);
        Ok(diagnosis.len())
    }

    fn record_write(&mut self, _record: u8, _from: &[u8]) -> Result<(), ModuleError> {
        Err(ModuleError::NoRecord)
    }
}
