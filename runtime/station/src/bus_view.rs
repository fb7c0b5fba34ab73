//! Buses as seen from other threads than the scan: the state of couplers and slaves, and what they sense and drive. All
//! of it is read from shared memory; this does not disturb the scan.

use std::sync::Arc;

use ob1_backplane::{BusLook, BusMemory, BusSize, Monitor};
use ob1_coupler::dp::{Diagnosis, DpSlave, diagnosis_words, kept_diagnosis, refusal_words};
use ob1_coupler::{BusConfig, LineConfig, State, Status};
use ob1_host::driver;

use crate::access::protocol::{BusStationStatus, BusStatus, Piece};
use ob1_station_file::{Bus, ModuleConfig, ModuleKind};

/// A bus, as seen from other threads than the scan.
#[derive(Clone, Debug)]
pub struct BusView {
    name: String,
    config: BusConfig,
    memory: BusMemory,
    size: BusSize,
    monitor: Monitor,
    driver: Arc<driver::DriverStatus>,
    stations: Vec<Known>,
}

/// One of its couplers or slaves.
#[derive(Clone, Debug)]
struct Known {
    number: u8,
    diagnostic: u16,
    /// First address in the process image, first byte in the image of the bus, bytes.
    inputs: Vec<(u32, usize, usize)>,
    outputs: Vec<(u32, usize, usize)>,
}

impl BusView {
    /// Bus `index` of a station with these modules.
    pub(crate) fn new(
        (index, bus): (usize, &Bus),
        modules: &[ModuleConfig],
        memory: &BusMemory,
        size: BusSize,
        monitor: &Monitor,
        driver: &Arc<driver::DriverStatus>,
    ) -> Self {
        let known = |(n, station): (usize, &ob1_host::bus::Station)| {
            let mut known = Known {
                number: station.number,
                diagnostic: station.diagnostic,
                inputs: Vec::new(),
                outputs: Vec::new(),
            };
            for config in modules {
                if let ModuleKind::DpMaster { bus, areas } = &config.kind
                    && *bus == index
                {
                    // Where they lie for DP_RECV and DP_SEND.
                    let of = |pieces: &[ob1_host::bus::DpPiece]| {
                        let own = pieces.iter().filter(|piece| piece.station == n);
                        own.map(|piece| (piece.area as u32, piece.image, piece.len)).collect::<Vec<_>>()
                    };
                    known.inputs.extend(of(&areas.inputs));
                    known.outputs.extend(of(&areas.outputs));
                }
                if let ModuleKind::Remote { bus, module } = &config.kind
                    && (*bus, module.station) == (index, n)
                {
                    let piece = |address, (at, len): (usize, u16)| (len > 0).then_some((address, at, usize::from(len)));
                    known.inputs.extend(piece(config.input_address, module.inputs));
                    known.outputs.extend(piece(config.output_address, module.outputs));
                }
            }
            known
        };
        Self {
            name: bus.name.clone(),
            config: bus.config.clone(),
            memory: memory.clone(),
            size,
            monitor: monitor.clone(),
            driver: Arc::clone(driver),
            stations: bus.stations.iter().enumerate().map(known).collect(),
        }
    }

    /// State of the bus and its couplers and slaves at this moment.
    #[must_use]
    pub fn status(&self) -> BusStatus {
        let look = BusLook::new(&self.memory, self.size);
        let slaves = self.config.lines.iter().flat_map(|line| {
            let slaves = line.dp.iter().flat_map(|dp| dp.slaves.iter().map(|slave| Some((slave, dp.address))));
            line.couplers.iter().map(|_| None).chain(slaves).chain(line.gpio.iter().map(|_| None))
        });
        let stations = self.config.stations().zip(slaves).zip(&self.stations).enumerate();
        BusStatus {
            name: self.name.clone(),
            kind: self.config.lines.first().map_or("", LineConfig::protocol).to_owned(),
            lines: (0..self.config.lines.len()).map(|line| self.config.line_name(line)).collect(),
            pid: self.driver.pid(),
            starts: self.driver.starts(),
            losses: self.driver.losses(),
            process: crate::drivers::state_text(&self.monitor),
            driven: look.as_ref().is_some_and(BusLook::driven),
            stations: stations.map(|(n, ((name, slave), known))| known.status(n, name, slave, look.as_ref())).collect(),
        }
    }
}

impl Known {
    fn status(&self, n: usize, name: &str, slave: Option<(&DpSlave, u8)>, look: Option<&BusLook>) -> BusStationStatus {
        let words = look.map(|look| look.coupler(n)).unwrap_or_default();
        // Words without a meaning count as a lost coupler, as they do for the program.
        let status = Status::from_words(&words).unwrap_or(Status { state: State::Lost, ..Status::default() });
        let pieces = |all: &[(u32, usize, usize)], read: &dyn Fn(&BusLook, usize, &mut [u8])| {
            let piece = |(address, at, len): &(u32, usize, usize)| {
                let mut bytes = vec![0; *len];
                look.iter().for_each(|look| read(look, *at, &mut bytes));
                Piece { address: *address, hex: bytes.iter().map(|byte| format!("{byte:02X}")).collect() }
            };
            all.iter().map(piece).collect()
        };
        BusStationStatus {
            name: name.to_owned(),
            number: self.number,
            diagnostic: self.diagnostic,
            state: status.state.name().to_owned(),
            says: says(status, slave, look),
            exchanges: status.exchanges,
            failures: status.failures,
            exceptions: status.exceptions,
            losses: status.losses,
            round_ns: status.round.nanos(),
            inputs: pieces(&self.inputs, &|look, at, into| look.inputs(at, into)),
            outputs: pieces(&self.outputs, &|look, at, into| look.outputs(at, into)),
        }
    }
}

/// What a coupler refuses, or a slave with its master's address reports of itself or refuses.
fn says(status: Status, slave: Option<(&DpSlave, u8)>, look: Option<&BusLook>) -> String {
    let (Some((slave, master)), Some(look)) = (slave, look) else {
        return status.refusal.map_or_else(String::new, |refusal| refusal.to_string());
    };
    let (at, room) = slave.diagnosis;
    let mut area = vec![0; DpSlave::diagnosis_area(room)];
    look.inputs(at, &mut area);
    let bytes = kept_diagnosis(&area);
    let faulty = Diagnosis::new(bytes).is_some_and(Diagnosis::has_faults);
    match status.state {
        State::Refused => refusal_words(bytes, slave, master),
        State::Lost => String::new(),
        _ if faulty => diagnosis_words(bytes, slave),
        _ => String::new(),
    }
}
