//! Buses at work: the process of each, the image between it and the scan, and its modules.

use std::ffi::OsString;
use std::path::Path;
use std::sync::Arc;

use ob1_backplane::{BusMemory, BusSize, CpuSide, Monitor, Segment};
use ob1_host::bus::Bus as HostBus;
use ob1_host::driver::{DriverCommand, DriverStatus, Fleet};
use ob1_host::supervisor::Times;

use crate::bus_view::BusView;
use crate::confinement;
use crate::drivers::DriverSettings;
use crate::simulated;
use ob1_station_file::{Bus, Line, Station};

/// Register bytes of the segment: a number that changes with the outputs.
const REGISTER_BYTES: usize = 8;
/// Longest text the system takes as one argument, less its end.
const ARGUMENT: usize = 128 * 1024 - 1;

/// A bus in a station that is being built.
pub(crate) struct AddedBus {
    pub(crate) bus: HostBus,
    pub(crate) monitor: Monitor,
    pub(crate) driver: Arc<DriverStatus>,
    pub(crate) view: BusView,
}

/// Adds the process of a bus.
///
/// # Errors
/// The bus has more bytes than an image carries, or the system refuses memory or descriptors; with the name of the bus.
pub(crate) fn add(
    fleet: &mut Fleet,
    rundir: &Path,
    (index, bus): (usize, &Bus),
    station: &Station,
    drivers: &DriverSettings,
) -> Result<AddedBus, String> {
    let system = |error: &dyn std::fmt::Display| format!("bus {}: {error}", bus.name);
    let text = told(rundir, bus, station).map_err(|e| system(&e))?;
    let (inputs, outputs) = (bus.config.input_bytes, bus.config.output_bytes);
    let size =
        BusSize::new(bus.stations.len(), inputs, outputs).ok_or_else(|| system(&"more than an image carries"))?;
    let memory = BusMemory::create_shared().map_err(|e| system(&e))?;
    let descriptor = memory.descriptor().ok_or_else(|| system(&"its image is not shared memory"))?;
    let descriptor = descriptor.try_clone_to_owned().map_err(|e| system(&e))?;
    let segment = Segment::create_shared().map_err(|e| system(&e))?;
    let side = CpuSide::create(&segment, REGISTER_BYTES).map_err(|e| system(&e))?;
    let command = DriverCommand {
        name: bus.name.clone(),
        program: drivers.io.clone(),
        args: vec!["--name".into(), bus.name.clone().into(), "--trace".into(), rundir.into(), "--bus".into(), text],
        env: drivers.env.iter().cloned().chain([confinement::variable([rundir], None, &bus.lines)]).collect(),
        descriptors: vec![Arc::new(descriptor)],
    };
    let monitor = side.monitor().clone();
    let port = fleet.add(command, segment, monitor.clone(), Times::default()).map_err(|e| system(&e))?;
    let driver = Arc::clone(&port.status);
    let view = BusView::new((index, bus), &station.modules, &memory, size, &monitor, &driver);
    let bus = HostBus::new(side, Box::new(port), &memory, size, outputs, bus.stations.clone(), bus.rules);
    Ok(AddedBus { bus, monitor, driver, view })
}

/// The configuration of the process: the bus, with the sockets of simulated lines in the place of their names.
fn told(rundir: &Path, bus: &Bus, station: &Station) -> Result<OsString, String> {
    let mut config = bus.config.clone();
    for (line, told) in bus.lines.iter().zip(&mut config.lines) {
        if let Line::Sim(name) = line
            && let Some(simulated) = station.simulated_lines.iter().find(|simulated| simulated.name == *name)
        {
            told.line = format!("sim:{}", simulated::socket(rundir, simulated).display());
        }
    }
    let text = serde_json::to_string(&config).map_err(|error| error.to_string())?;
    if text.len() > ARGUMENT {
        return Err("it has more couplers and ranges than one process can have; divide it in two".into());
    }
    Ok(text.into())
}
