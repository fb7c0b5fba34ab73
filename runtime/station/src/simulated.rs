//! Simulated lines at work: where their sockets are, and the processes that are the lines.
//!
//! A line is a process of its own beside the drivers, started and watched like them (`ob1-cp --hub`), because its
//! CPs are processes and may be those of two stations. Its socket lies in the station's runtime directory; that of a
//! shared line beside the stations'.

use std::ffi::OsString;
use std::os::unix::fs::DirBuilderExt as _;
use std::path::{Path, PathBuf};

use ob1_backplane::{CpuSide, Segment};
use ob1_host::driver::{DriverCommand, Fleet};
use ob1_host::supervisor::Times;
use serde_json::{Value, json};

use crate::drivers::DriverSettings;
use ob1_station_file::{Partner, SimulatedLine};

/// Folder of the shared lines, beside the stations' directories. No station can have this name.
const SHARED: &str = ".lines";

/// Where CPs connect to a line.
#[must_use]
pub fn socket(rundir: &Path, line: &SimulatedLine) -> PathBuf {
    let folder = match rundir.parent() {
        Some(base) if line.shared => base.join(SHARED),
        _ => rundir.to_owned(),
    };
    folder.join(format!("{}.line", line.name))
}

/// Register bytes of a segment that has no registers to show.
const REGISTER_BYTES: usize = 16;

/// Adds the process that is the line.
///
/// # Errors
/// The folder of its socket or its memory cannot be made; what the system says, with the name of the line.
pub fn add(fleet: &mut Fleet, rundir: &Path, line: &SimulatedLine, drivers: &DriverSettings) -> Result<(), String> {
    let system = |error: &dyn std::fmt::Display| format!("simulated line {}: {error}", line.name);
    // The process creates its files in this folder, but not the folder.
    if let Some(folder) = socket(rundir, line).parent() {
        let made = std::fs::DirBuilder::new().mode(0o700).create(folder);
        made.or_else(|e| if e.kind() == std::io::ErrorKind::AlreadyExists { Ok(()) } else { Err(e) })
            .map_err(|e| system(&e))?;
    }
    // Only to see that the process is alive.
    let segment = Segment::create_shared().map_err(|e| system(&e))?;
    let side = CpuSide::create(&segment, REGISTER_BYTES).map_err(|e| system(&e))?;
    let name = format!("line {}", line.name);
    let command = DriverCommand {
        name: name.clone(),
        program: drivers.program.clone(),
        args: vec![
            "--name".into(),
            format!("line-{}", line.name).into(),
            "--hub".into(),
            configuration(rundir, line).to_string().into(),
        ],
        env: drivers.env.iter().cloned().chain([fence(rundir, line)]).collect(),
        descriptors: Vec::new(),
    };
    // It has no registers, and no scan rings for it; the supervisor's own log says what happens to it.
    let _port = fleet.add(command, segment, side.monitor().clone(), Times::default()).map_err(|e| system(&e))?;
    fleet.ends_last(&name);
    Ok(())
}

/// What the process may do: it makes its socket, its lock, and the link of its pty.
fn fence(rundir: &Path, line: &SimulatedLine) -> (OsString, OsString) {
    let socket = socket(rundir, line);
    let partner = match &line.partner {
        Partner::Pty(path) => path.parent(),
        Partner::None | Partner::Echo => None,
    };
    crate::confinement::variable(socket.parent(), partner, None)
}

/// The configuration of the process.
fn configuration(rundir: &Path, line: &SimulatedLine) -> Value {
    let mut text = json!({
        "path": socket(rundir, line),
        "half_duplex": line.half_duplex,
        "seed": line.seed,
        "faults": rates(&line.faults),
    });
    if let Some(bursts) = &line.bursts {
        text["bursts"] = json!({ "every_ns": bursts.every.nanos(), "length_ns": bursts.length.nanos(), "faults": rates(&bursts.faults) });
    }
    match &line.partner {
        Partner::None => {}
        Partner::Echo => text["echo"] = true.into(),
        Partner::Pty(path) => text["pty"] = json!(path),
    }
    text
}

fn rates(faults: &ob1_serial::FaultRates) -> Value {
    let ob1_serial::FaultRates { flip, lose, double, delay, parity, framing, break_, delay_max } = *faults;
    json!({
        "flip": flip, "lose": lose, "double": double, "delay": delay, "parity": parity, "framing": framing, "break": break_,
        "delay_max_ns": delay_max.nanos(),
    })
}
