//! The tap: reports to listeners what passes over a line or a connection. It never waits: a listener that does not
//! fetch its records loses them, and gets their number.

use std::io;
use std::os::fd::BorrowedFd;
use std::path::{Path, PathBuf};
use std::time::{SystemTime, UNIX_EPOCH};

use ob1_serial::tap_record::{Kind, Record, VERSION, number_of};
use ob1_serial::{Instant, LineInput};
use ob1_socket::seqpacket::{Channel, Listener, Sent};
use serde_json::Value;
use tracing::{trace, warn};

/// Maximum of listeners at a time; further callers are refused.
const MOST: usize = 4;
/// Callers handled in one pass; the others wait.
const CALLERS: usize = 4;
/// Characters in one record.
const CHUNK: usize = 4096;

/// The listeners of a line.
#[derive(Debug, Default)]
pub struct Tap {
    path: Option<PathBuf>,
    socket: Option<Listener>,
    listeners: Vec<Client>,
    hello: Vec<u8>,
}

#[derive(Debug)]
struct Client {
    channel: Channel,
    lost: u64,
}

impl Tap {
    /// Opens the socket for listeners; reopens it only if the path changes.
    pub fn open(&mut self, path: Option<&Path>) {
        if self.path.as_deref() == path {
            return;
        }
        self.path = path.map(Path::to_owned);
        self.socket = path.and_then(|path| {
            let bound = Listener::bind(path);
            bound.inspect_err(|error| warn!("the socket for traces {} cannot be opened: {error}", path.display())).ok()
        });
    }

    /// Takes the socket for listeners from the runtime, which has bound it.
    pub fn listen(&mut self, socket: impl Into<Listener>) {
        self.socket = Some(socket.into());
    }

    /// Sets the identity for all present and future listeners: JSON. The wall-clock time at 0 is added; `wall` is the
    /// present time.
    pub fn introduce(&mut self, now: Instant, wall: SystemTime, mut about: Value) {
        let since_1970 = wall.duration_since(UNIX_EPOCH).unwrap_or_default();
        let at_zero = u64::try_from(since_1970.as_nanos()).unwrap_or(0).saturating_sub(now.nanos());
        about["version"] = VERSION.into();
        about["unix_ns"] = at_zero.into();
        self.hello = Record::head(now, Kind::Hello).to_vec();
        self.hello.extend(about.to_string().into_bytes());
        for client in &mut self.listeners {
            client.tell(now, &self.hello);
        }
    }

    /// Whether there are no listeners.
    pub fn is_alone(&self) -> bool {
        self.listeners.is_empty()
    }

    /// Accepts new listeners, a few in each pass.
    pub fn admit(&mut self, now: Instant) {
        let Some(socket) = &mut self.socket else { return };
        for _ in 0..CALLERS {
            let Some(channel) = socket.accept(now) else { return };
            if self.listeners.len() < MOST {
                let mut client = Client { channel, lost: 0 };
                client.tell(now, &self.hello);
                self.listeners.push(client);
            }
        }
    }

    /// The descriptor that becomes readable when somebody calls; none while nobody can be admitted.
    pub fn fd(&self, now: Instant) -> Option<BorrowedFd<'_>> {
        self.socket.as_ref()?.fd(now)
    }

    /// Reports what comes from the line.
    pub fn hear(&mut self, now: Instant, input: LineInput<'_>) {
        match input {
            LineInput::Rx(bytes) => {
                trace!(rx = ?bytes);
                self.tell(now, Kind::In, bytes);
            }
            LineInput::TxDone => self.tell(now, Kind::Done, &[]),
            LineInput::Fault(fault) => self.tell(now, Kind::Fault, &[number_of(fault)]),
            LineInput::Modem(lines) => self.tell(now, Kind::Modem, &[lines.bits()]),
        }
    }

    /// Reports one event. Without listeners it costs a comparison.
    pub fn tell(&mut self, now: Instant, kind: Kind, data: &[u8]) {
        self.tell_of(now, kind, &[], data);
    }

    /// The same; each record begins with `origin`, where the data belong.
    pub fn tell_of(&mut self, now: Instant, kind: Kind, origin: &[u8], data: &[u8]) {
        if self.listeners.is_empty() {
            return;
        }
        let mut message = Vec::with_capacity(data.len().min(CHUNK) + 16);
        // Also once for empty data.
        let mut rest = Some(data);
        while let Some(data) = rest {
            let (part, more) = data.split_at(data.len().min(CHUNK));
            rest = (!more.is_empty()).then_some(more);
            message.clear();
            message.extend(Record::head(now, kind));
            message.extend(origin);
            message.extend(part);
            self.listeners.retain_mut(|client| client.tell(now, &message));
        }
    }
}

impl Client {
    /// False when it is gone.
    fn tell(&mut self, now: Instant, message: &[u8]) -> bool {
        match self.try_tell(now, message) {
            Ok(Sent::Yes) => true,
            Ok(Sent::Full) => {
                self.lost += 1;
                true
            }
            Err(_) => false,
        }
    }

    fn try_tell(&mut self, now: Instant, message: &[u8]) -> io::Result<Sent> {
        if self.lost > 0 {
            let mut gap = Record::head(now, Kind::Lost).to_vec();
            gap.extend(self.lost.to_le_bytes());
            if self.channel.send(&gap)? == Sent::Full {
                return Ok(Sent::Full);
            }
            self.lost = 0;
        }
        self.channel.send(message)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ob1_socket::seqpacket::MESSAGE_MAX;
    use serde_json::json;

    #[test]
    fn a_listener_that_sleeps_loses_records_and_is_told_how_many() {
        let dir = tempfile::tempdir().expect("a folder");
        let path = dir.path().join("cp.trace");
        let mut tap = Tap::default();
        tap.tell(Instant::START, Kind::Up, &[]);
        tap.open(Some(&path));
        tap.introduce(Instant::from_nanos(5), UNIX_EPOCH, json!({ "name": "cp" }));
        let ear = Channel::connect(&path).expect("the tap listens");
        tap.admit(Instant::from_nanos(9));
        // Nobody reads these: the tap neither waits nor grows.
        for time in 0..100_000 {
            tap.tell(Instant::from_nanos(time), Kind::In, &[0x55; 100]);
        }
        let mut buffer = [0; MESSAGE_MAX];
        let mut seen = 0;
        let hello = ear.receive(&mut buffer).expect("alive").expect("a record");
        let hello = Record::read(hello).expect("a record");
        assert_eq!(hello.kind, Kind::Hello);
        let hello: serde_json::Value = serde_json::from_slice(hello.data).expect("JSON");
        assert_eq!((&hello["name"], &hello["version"]), (&json!("cp"), &json!(1)));
        while ear.receive(&mut buffer).expect("alive").is_some() {
            seen += 1;
        }
        tap.tell(Instant::from_nanos(100_000), Kind::Done, &[]);
        let gap = Record::read(ear.receive(&mut buffer).expect("alive").expect("a record")).expect("a record");
        assert_eq!(gap.kind, Kind::Lost);
        let lost = u64::from_le_bytes(gap.data.try_into().expect("8 bytes"));
        assert_eq!(seen + lost, 100_000);
        let last = ear.receive(&mut buffer).expect("alive").expect("a record");
        assert_eq!(Record::read(last).map(|record| record.kind), Some(Kind::Done));
        drop(ear);
        tap.tell(Instant::from_nanos(100_001), Kind::Up, &[]);
        assert!(tap.listeners.is_empty(), "who is gone is forgotten");
        // Long data come in pieces.
        let ear = Channel::connect(&path).expect("the tap listens");
        tap.admit(Instant::START);
        tap.tell(Instant::START, Kind::Out, &[1; CHUNK + 1]);
        let lengths: Vec<usize> =
            std::iter::from_fn(|| ear.receive(&mut buffer).ok().flatten().map(<[u8]>::len)).skip(1).collect();
        assert_eq!(lengths, [9 + CHUNK, 9 + 1]);
    }
}
