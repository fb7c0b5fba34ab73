//! A running station's taps: a socket each, on which its drivers report what happens on their lines (docs/trace.md).

use std::io;
use std::os::fd::OwnedFd;
use std::path::Path;
use std::time::{self, Duration};

use ob1_params::CpKind;
use ob1_protocols::Instant;
use ob1_serial::tap_record::Record;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::io::Errno;
use rustix::net::{AddressFamily, RecvFlags, SocketAddrUnix, SocketFlags, SocketType, connect, recv, socket_with};

use super::{Sinks, TraceArgs, TraceError};
use ob1_station::access::client::Client;
use ob1_station::access::protocol::Op;
use ob1_station::rundir;

/// Longest record a driver sends.
const RECORD: usize = 8192;
/// After this long without news, pauses that end telegrams are looked for.
const QUIET: Duration = Duration::from_millis(200);

/// A CP that is listened to.
struct Tap {
    fd: OwnedFd,
    number: u8,
    /// The driver's time at its last record, and when it came.
    last: (Instant, time::Instant),
    ended: bool,
}

/// What is heard of a CP, by its number.
pub(crate) enum News<'a> {
    /// It has reported something.
    Record(u8, Record<'a>),
    /// It has reported nothing until this time of its driver.
    Silence(u8, Instant),
}

/// The CPs of a station that are listened to.
pub(crate) struct Taps {
    taps: Vec<Tap>,
    buffer: Vec<u8>,
}

impl Taps {
    /// Connects to the wanted CP, or to all of them.
    /// `buses`: the lines of the buses too.
    pub(crate) fn open(station: &str, wanted: Option<&str>, buses: bool) -> Result<Self, TraceError> {
        Ok(Self { taps: open(station, wanted, buses)?, buffer: vec![0; RECORD] })
    }

    /// Every driver has ended.
    fn is_over(&self) -> bool {
        self.taps.iter().all(|tap| tap.ended)
    }

    /// A driver has ended since they were opened.
    pub(crate) fn has_lost_one(&self) -> bool {
        self.taps.iter().any(|tap| tap.ended)
    }

    /// Hands over what there is, without waiting.
    pub(crate) fn take(&mut self, on: &mut dyn FnMut(News<'_>) -> io::Result<()>) -> io::Result<()> {
        for tap in self.taps.iter_mut().filter(|tap| !tap.ended) {
            while !tap.ended {
                match recv(&tap.fd, self.buffer.as_mut_slice(), RecvFlags::DONTWAIT) {
                    Ok((0, _)) | Err(Errno::CONNRESET) => tap.ended = true,
                    Ok((length, _)) => {
                        // A newer driver may have kinds we do not know.
                        if let Some(record) = Record::read(&self.buffer[..length]) {
                            tap.last = (record.time, time::Instant::now());
                            on(News::Record(tap.number, record))?;
                        }
                    }
                    Err(Errno::AGAIN | Errno::INTR) => break,
                    Err(error) => return Err(error.into()),
                }
            }
            let (time, came) = tap.last;
            let since = came.elapsed();
            if since > QUIET {
                on(News::Silence(tap.number, time.saturating_add(since.into())))?;
            }
        }
        Ok(())
    }
}

pub(super) fn live(station: &str, args: &TraceArgs, sinks: &mut Sinks) -> Result<(), TraceError> {
    let end = args.time.map(|time| time::Instant::now() + Duration::from(time));
    let mut taps = Taps::open(station, args.cp.as_deref(), true)?;
    while !taps.is_over() && !sinks.is_over() {
        let left = end.map_or(QUIET, |end| end.saturating_duration_since(time::Instant::now()));
        if left.is_zero() {
            return Ok(());
        }
        wait(&taps.taps, left.min(QUIET))?;
        taps.take(&mut |news| match news {
            News::Record(cp, record) => sinks.take(cp, &record),
            News::Silence(..) => {
                sinks.printer.hear(&news);
                sinks.show();
                Ok(())
            }
        })?;
    }
    Ok(())
}

/// Connects to the taps of the wanted CPs.
fn open(station: &str, wanted: Option<&str>, buses: bool) -> Result<Vec<Tap>, TraceError> {
    let nobody = |error: &dyn std::fmt::Display| TraceError::Nobody(error.to_string());
    let mut client = Client::to_station(station)?;
    let status = client.ask(Op::Status)?.status;
    let status = status.ok_or_else(|| nobody(&"the station does not answer"))?;
    let folder = rundir::find(&status.station).ok_or_else(|| nobody(&"the station has just ended"))?;
    let links = client.ask(Op::Links)?.links.unwrap_or_default();
    // A module without a tap has nothing to report here: a CP 343 is heard at its link.
    let has_tap = |name: &String| folder.join(format!("{name}.trace")).exists();
    let cps = status.modules.iter().filter(|module| CpKind::of_name(&module.type_name).is_some());
    let links = links.into_iter().map(|link| link.name);
    let mut cps: Vec<String> = cps.map(|module| module.name.clone()).chain(links).collect();
    if buses {
        let buses = client.ask(Op::Buses)?.buses.unwrap_or_default();
        cps.extend(buses.into_iter().flat_map(|bus| bus.lines));
    }
    cps.retain(has_tap);
    if cps.is_empty() {
        return Err(TraceError::NoLine(format!("{} has no CP, no S7 link and no bus", status.station)));
    }
    if let Some(wanted) = wanted
        && !cps.iter().any(|name| name == wanted)
    {
        return Err(TraceError::NoLine(format!(
            "{} has no CP, S7 link or bus \"{wanted}\"; there are: {}",
            status.station,
            cps.join(", ")
        )));
    }
    let mut taps = Vec::new();
    for (name, number) in cps.iter().zip(0..).filter(|(name, _)| wanted.is_none_or(|wanted| wanted == *name)) {
        let path = folder.join(format!("{name}.trace"));
        let fd = connect_to(&path).map_err(|error| nobody(&format!("{}: {error}", path.display())))?;
        taps.push(Tap { fd, number, last: (Instant::START, time::Instant::now()), ended: false });
    }
    Ok(taps)
}

fn connect_to(path: &Path) -> io::Result<OwnedFd> {
    let flags = SocketFlags::CLOEXEC | SocketFlags::NONBLOCK;
    let fd = socket_with(AddressFamily::UNIX, SocketType::SEQPACKET, flags, None)?;
    connect(&fd, &SocketAddrUnix::new(path)?)?;
    Ok(fd)
}

fn wait(taps: &[Tap], time: Duration) -> io::Result<()> {
    let mut fds: Vec<PollFd<'_>> =
        taps.iter().filter(|tap| !tap.ended).map(|tap| PollFd::new(&tap.fd, PollFlags::IN)).collect();
    let time = Timespec { tv_sec: time.as_secs() as i64, tv_nsec: i64::from(time.subsec_nanos()) };
    match poll(&mut fds, Some(&time)) {
        Ok(_) | Err(Errno::INTR) => Ok(()),
        Err(error) => Err(error.into()),
    }
}
