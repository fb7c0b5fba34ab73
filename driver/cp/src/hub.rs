//! The process as a simulated line instead of a CP: `ob1-cp --hub JSON`. It also has a segment, only to show that it is
//! alive.
//!
//! A line shared by two stations is started by both: the process that holds the lock on its name is the line, the other
//! stands by and takes over if the first one ends.

use std::fs::{File, OpenOptions};
use std::io;
use std::os::unix::fs::{DirBuilderExt as _, OpenOptionsExt as _};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time;

use ob1_backplane::{Counter, CpSide, DriverState};
use ob1_cp::HEARTBEAT;
use ob1_line::hub::{Hub, Partner};
use ob1_line::sim::{Bursts, BusConfig, FaultRates};
use ob1_line::{Instant, Span};
use ob1_process::doorbell_closed;
use rustix::event::{PollFd, PollFlags};
use rustix::fs::{FlockOperation, flock};
use rustix::io::Errno;
use serde::Deserialize;
use tracing::{info, warn};

use crate::process::Ended;

/// The runtime's configuration of the line, in the words of the station file.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct HubConfig {
    /// The socket for CPs.
    path: PathBuf,
    #[serde(default)]
    half_duplex: bool,
    #[serde(default)]
    seed: u64,
    #[serde(default)]
    faults: Rates,
    bursts: Option<BurstRates>,
    /// Send every character back.
    #[serde(default)]
    echo: bool,
    /// A pty for a partner.
    pty: Option<PathBuf>,
}

/// Faults in characters per million.
#[derive(Debug, Clone, Copy, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
struct Rates {
    flip: u32,
    lose: u32,
    double: u32,
    delay: u32,
    parity: u32,
    framing: u32,
    #[serde(rename = "break")]
    break_: u32,
    delay_max_ns: u64,
}

#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields)]
struct BurstRates {
    every_ns: u64,
    length_ns: u64,
    faults: Rates,
}

impl Rates {
    const fn rates(self) -> FaultRates {
        let Self { flip, lose, double, delay, parity, framing, break_, delay_max_ns } = self;
        FaultRates { flip, lose, double, delay, parity, framing, break_, delay_max: Span::from_nanos(delay_max_ns) }
    }
}

impl HubConfig {
    /// Reads the JSON text.
    pub(crate) fn parse(text: &str) -> Result<Self, String> {
        serde_json::from_str(text).map_err(|error| error.to_string())
    }

    fn bus(&self) -> BusConfig {
        let bursts = self.bursts.map(|b| Bursts {
            every: Span::from_nanos(b.every_ns),
            length: Span::from_nanos(b.length_ns),
            faults: b.faults.rates(),
        });
        BusConfig { faults: self.faults.rates(), bursts, ..BusConfig::new(self.half_duplex) }
    }

    fn partner(&self) -> Partner {
        match &self.pty {
            Some(path) => Partner::Pty(path.clone()),
            None if self.echo => Partner::Echo,
            None => Partner::None,
        }
    }
}

/// Runs the line until standard input closes or a signal comes.
///
/// # Errors
/// When waiting or opening the line fails.
pub(crate) fn run(config: &HubConfig, mut segment: CpSide, terminate: &Arc<AtomicBool>) -> io::Result<Ended> {
    let start = time::Instant::now();
    let clock = || Instant::START + start.elapsed().into();
    let mut hub = None;
    let mut lock = None;
    let (mut told, mut log_lost) = ((0, 0), 0);
    segment.set_state(DriverState::Starting);
    loop {
        segment.beat();
        let lost = ob1_process::log::lost();
        segment.count(Counter::LogLost, lost - std::mem::replace(&mut log_lost, lost));
        if hub.is_none()
            && let Some(held) = own(&config.path)?
        {
            lock = Some(held);
            hub = Some(Hub::open(&config.path, config.bus(), config.seed, &config.partner())?);
            segment.set_state(DriverState::Ready);
            info!(path = %config.path.display(), seed = config.seed, "the simulated line is up");
        }
        let mut deadline = clock() + HEARTBEAT;
        if let Some(hub) = &mut hub {
            hub.work(clock());
            if told != (hub.lost(), hub.turned_away()) {
                told = (hub.lost(), hub.turned_away());
                warn!(lost = told.0, turned_away = told.1, "a CP does not listen, or finds no place on the line");
            }
            deadline = hub.deadline().map_or(deadline, |at| at.min(deadline));
        }
        let ready = wait(hub.as_ref(), clock(), deadline)?;
        if terminate.load(Ordering::Relaxed) || ready && doorbell_closed()? {
            drop(hub);
            drop(lock);
            return Ok(if ready { Ended::Closed } else { Ended::Terminated });
        }
    }
}

/// The lock on a line's name, if no other process holds it. It ends with its process.
fn own(path: &Path) -> io::Result<Option<File>> {
    if let Some(folder) = path.parent() {
        let made = std::fs::DirBuilder::new().mode(0o700).create(folder);
        made.or_else(|error| if error.kind() == io::ErrorKind::AlreadyExists { Ok(()) } else { Err(error) })?;
    }
    let mut name = path.as_os_str().to_owned();
    name.push(".lock");
    let file = OpenOptions::new().write(true).create(true).truncate(false).mode(0o600).open(name)?;
    match flock(&file, FlockOperation::NonBlockingLockExclusive) {
        Ok(()) => Ok(Some(file)),
        Err(Errno::WOULDBLOCK) => Ok(None),
        Err(error) => Err(error.into()),
    }
}

/// Waits; true if standard input is readable.
fn wait(hub: Option<&Hub>, now: Instant, deadline: Instant) -> io::Result<bool> {
    let stdin = rustix::stdio::stdin();
    let mut fds = vec![PollFd::new(&stdin, PollFlags::IN)];
    if let Some(hub) = hub {
        hub.poll_fds(now, &mut fds);
    }
    ob1_process::wait(&mut fds, deadline.since(now))?;
    Ok(fds.first().is_some_and(|fd| !fd.revents().is_empty()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_runtimes_text_is_understood() {
        let text = r#"{"path":"/run/x.line","half_duplex":true,"seed":7,"faults":{"flip":10,"delay":1,"delay_max_ns":5},
            "bursts":{"every_ns":100,"length_ns":10,"faults":{"break":9}},"echo":true}"#;
        let config = HubConfig::parse(text).expect("right");
        let bus = config.bus();
        assert!(bus.half_duplex);
        assert_eq!((bus.faults.flip, bus.faults.delay_max), (10, Span::from_nanos(5)));
        assert_eq!(
            bus.bursts.map(|b| (b.every, b.length, b.faults.break_)),
            Some((Span::from_nanos(100), Span::from_nanos(10), 9))
        );
        assert_eq!(config.partner(), Partner::Echo);
        for wrong in ["", "{}", r#"{"path":"/x","later":1}"#, r#"{"path":"/x","seed":-1}"#] {
            assert!(HubConfig::parse(wrong).is_err(), "{wrong}");
        }
    }
}
