//! A running station: its rows come over its socket, the telegrams of its lines from their taps.

use std::io::{self, Read, Write as _};
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::time::{Duration, Instant};

use ob1_record::{Entry, FormatError, Order, Reader};
use ob1_serial::tap_record::Record;
use ob1_station::access::client::Client;
use ob1_station::access::protocol::Op;
use ob1_station::run::signals::Signals;
use ob1_station::rundir;
use rustix::event::{PollFd, PollFlags, Timespec, poll};

use super::sink::Sink;
use super::{Count, RecordArgs, RecordError};
use crate::trace::{News, Taps, TraceError};

/// Time between two looks at the taps and for a signal.
const LOOK: Duration = Duration::from_millis(100);
/// What has come is in the file after this time.
const FLUSH: Duration = Duration::from_millis(200);
/// Time between two tries to hear a driver again that has ended.
const AGAIN: Duration = Duration::from_millis(500);
/// Longest refusal of a station, in bytes.
const REFUSAL: u64 = 64 * 1024;

/// Records until the station ends the recording, or a signal does.
pub(super) fn record(
    station: &str,
    order: &Order,
    path: &Path,
    args: &RecordArgs,
) -> Result<(Count, usize), RecordError> {
    let mut client = Client::to_station(station)?;
    let status = client.ask(Op::Status)?.status.ok_or(RecordError::Ended)?;
    let folder = rundir::find(&status.station).ok_or(RecordError::Ended)?;
    // Before anything is written: a second signal ends at once.
    let signals = Signals::catch()?;
    let mut taps = if args.no_lines { None } else { open_taps(station)? };
    let mut reader = begin(&folder.join(rundir::RECORD), order)?;
    let mut sink = Sink::open(path, reader.head())?;
    let (mut count, mut flushed, mut tried) = (Count::default(), Instant::now(), Instant::now());
    while count.end.is_none() && !signals.wait(Duration::ZERO) {
        if is_readable(reader.input())? {
            loop {
                let entry = match reader.next_entry() {
                    Ok(Some(entry)) => entry,
                    // A station that ended without a word; what has come is whole.
                    Ok(None) => return finish(sink, count, reader.head().signals.len()),
                    Err(error) => {
                        sink.finish()?;
                        return Err(RecordError::Stream(error));
                    }
                };
                count.take(&entry);
                sink.take(&entry)?;
                if !reader.has_more() {
                    break;
                }
            }
        }
        if let Some(heard) = &mut taps {
            listen(heard, &mut sink)?;
            // A driver that was started again has a new tap.
            if heard.has_lost_one() && tried.elapsed() >= AGAIN {
                tried = Instant::now();
                if let Ok(Some(again)) = open_taps(station) {
                    *heard = again;
                }
            }
        }
        if flushed.elapsed() >= FLUSH {
            sink.flush()?;
            flushed = Instant::now();
        }
    }
    let signals = reader.head().signals.len();
    finish(sink, count, signals)
}

fn finish(mut sink: Sink, count: Count, signals: usize) -> Result<(Count, usize), RecordError> {
    sink.finish()?;
    Ok((count, signals))
}

/// The lines of the station; none without a line.
fn open_taps(station: &str) -> Result<Option<Taps>, RecordError> {
    match Taps::open(station, None, true) {
        Ok(taps) => Ok(Some(taps)),
        Err(TraceError::NoLine(_)) => Ok(None),
        Err(error) => Err(error.into()),
    }
}

fn listen(taps: &mut Taps, sink: &mut Sink) -> Result<(), RecordError> {
    let mut failed = Ok(());
    taps.take(&mut |news| {
        if let (News::Record(number, record), Ok(())) = (&news, &failed) {
            let bytes = [&Record::head(record.time, record.kind)[..], record.data].concat();
            failed = sink.take(&Entry::Line(*number, bytes));
        }
        Ok(())
    })?;
    failed
}

/// Orders a recording: its head, or why there is none.
fn begin(socket: &Path, order: &Order) -> Result<Reader<UnixStream>, RecordError> {
    let mut stream = UnixStream::connect(socket).map_err(|_| RecordError::Ended)?;
    let mut line = serde_json::to_vec(order).map_err(io::Error::from)?;
    line.push(b'\n');
    stream.write_all(&line)?;
    let mut first = [0];
    let seen = rustix::net::recv(&stream, &mut first, rustix::net::RecvFlags::PEEK);
    if seen.map_err(io::Error::from)?.0 == 0 {
        return Err(RecordError::Ended);
    }
    if first == [b'{'] {
        let mut text = String::new();
        stream.take(REFUSAL).read_to_string(&mut text)?;
        let refusal: serde_json::Value = serde_json::from_str(&text).unwrap_or_default();
        return Err(RecordError::Refused(refusal["error"].as_str().unwrap_or("the station refuses").to_owned()));
    }
    Reader::new(stream).map_err(|error| match error {
        FormatError::Foreign => RecordError::Ended,
        error => RecordError::Stream(error),
    })
}

/// Waits a while for something to read.
fn is_readable(stream: &UnixStream) -> io::Result<bool> {
    let mut fds = [PollFd::new(stream, PollFlags::IN)];
    let time = Timespec { tv_sec: 0, tv_nsec: i64::from(LOOK.subsec_nanos()) };
    match poll(&mut fds, Some(&time)) {
        Ok(_) | Err(rustix::io::Errno::INTR) => Ok(!fds[0].revents().is_empty()),
        Err(error) => Err(error.into()),
    }
}
