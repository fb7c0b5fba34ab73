//! The tap: tells whoever listens what happens on the line. It never waits: a listener that does not fetch its records
//! loses them, and is told how many.

use std::io;
use std::os::fd::{AsFd, BorrowedFd};
use std::path::{Path, PathBuf};
use std::time::{SystemTime, UNIX_EPOCH};

use ob1_firmware::trace::record::{Kind, Record, VERSION};
use ob1_firmware::{CpEvent, Nanos, ParameterFault, cp341_events};
use ob1_line::seqpacket::{Channel, Listener, Sent};
use serde_json::json;
use tracing::warn;

use crate::config::Config;

/// Listeners at the same time.
const MOST: usize = 4;
/// Callers looked at in one pass; the others wait.
const CALLERS: usize = 4;
/// Characters in one record.
const CHUNK: usize = 4096;

/// Who listens to a CP's line.
#[derive(Debug, Default)]
pub(crate) struct Tap {
    path: Option<PathBuf>,
    socket: Option<Listener>,
    listeners: Vec<Ear>,
    hello: Vec<u8>,
}

#[derive(Debug)]
struct Ear {
    channel: Channel,
    lost: u64,
}

impl Tap {
    /// Opens the socket where listeners connect; again only when it is another one.
    pub(crate) fn open(&mut self, path: Option<&Path>) {
        if self.path.as_deref() == path {
            return;
        }
        self.path = path.map(Path::to_owned);
        self.socket = path.and_then(|path| {
            let bound = Listener::bind(path);
            bound.inspect_err(|error| warn!("no trace at {}: {error}", path.display())).ok()
        });
    }

    /// The CP has got parameters: who it is, for all listeners and those to come.
    pub(crate) fn introduce(&mut self, now: Nanos, config: &Config, parameters: &[u8; 16]) {
        let since_1970 = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        let at_zero = u64::try_from(since_1970.as_nanos()).unwrap_or(0).saturating_sub(now);
        let mut text = json!({
            "version": VERSION, "station": config.station, "name": config.name, "line": config.line.to_string(),
            "parameters": parameters, "unix_ns": at_zero, "module": config.cp_type.kind.name(),
        });
        if let Some(Ok(keyed)) = &config.cp_type.keys {
            // Its parameters are keys: there are no bytes of it.
            for (key, value) in keyed.to_keys() {
                text["params"][*key] = match value {
                    ob1_params::Value::Int(number) => json!(number),
                    ob1_params::Value::Str(word) => json!(word),
                };
            }
        }
        self.hello = Record::head(now, Kind::Hello).to_vec();
        self.hello.extend(text.to_string().into_bytes());
        for ear in &mut self.listeners {
            ear.tell(now, &self.hello);
        }
    }

    /// Lets in who has called.
    pub(crate) fn admit(&mut self, now: Nanos) {
        let Some(socket) = &self.socket else { return };
        for _ in 0..CALLERS {
            let Ok(Some(channel)) = socket.accept() else { return };
            if self.listeners.len() < MOST {
                let mut ear = Ear { channel, lost: 0 };
                ear.tell(now, &self.hello);
                self.listeners.push(ear);
            }
        }
    }

    /// The descriptor that says that somebody calls.
    pub(crate) fn fd(&self) -> Option<BorrowedFd<'_>> {
        self.socket.as_ref().map(Listener::as_fd)
    }

    /// Tells one thing. With nobody listening it costs a comparison.
    pub(crate) fn tell(&mut self, now: Nanos, kind: Kind, data: &[u8]) {
        if self.listeners.is_empty() {
            return;
        }
        let mut message = Vec::with_capacity(data.len().min(CHUNK) + 16);
        // Also once for nothing at all.
        let mut rest = Some(data);
        while let Some(data) = rest {
            let (part, more) = data.split_at(data.len().min(CHUNK));
            rest = (!more.is_empty()).then_some(more);
            message.clear();
            message.extend(Record::head(now, kind));
            message.extend(part);
            self.listeners.retain_mut(|ear| ear.tell(now, &message));
        }
    }

    /// Tells what the CP has to say.
    pub(crate) fn note(&mut self, now: Nanos, event: &CpEvent<'_>) {
        if self.listeners.is_empty() {
            return;
        }
        let text = match event {
            // The characters are told by themselves.
            CpEvent::Order(telegram) => format!("order of {} bytes", telegram.len()),
            CpEvent::Received(telegram) => format!("telegram of {} bytes received", telegram.len()),
            CpEvent::SendFailed(code) => format!("order failed, {code:02X}h"),
            CpEvent::Sent => "order done".to_owned(),
            CpEvent::Delivered(length) => format!("telegram of {length} bytes handed to the CPU"),
            CpEvent::Startup { number, .. } => format!("start-up {number}"),
            CpEvent::Working => "start-up acknowledged".to_owned(),
            CpEvent::NoParameters(ParameterFault::Value(why)) => format!("parameters refused: {why}"),
            CpEvent::NoParameters(ParameterFault::Protocol(name)) => {
                format!("parameters refused: the protocol {name} is not there")
            }
            CpEvent::OrderDiscarded { code: Some(code) } => format!("order refused, {code:02X}h"),
            CpEvent::OrderDiscarded { code: None } => "order given up by the CPU before it was complete".to_owned(),
            CpEvent::JobFailed(status) => format!("job ended with STATUS {status:04X}h: {}", meaning(*status)),
            CpEvent::Entry(number) => format!("diagnostic entry {number:04X}h: {}", meaning(*number)),
            CpEvent::EntryGone(number) => format!("diagnostic entry {number:04X}h is gone: {}", meaning(*number)),
            CpEvent::Changed(count) => format!("the master has changed {count} bytes"),
            CpEvent::Protocol(event) => event.to_string(),
            CpEvent::Rk512(event) => event.to_string(),
            CpEvent::Asked(request, data) => {
                format!(
                    "order of the partner for {} bytes, {} of them here, handed to the CPU",
                    request.bytes(),
                    data.len()
                )
            }
            CpEvent::Answered(Ok(())) => "order of the partner done".to_owned(),
            CpEvent::Answered(Err(_)) => "order of the partner came to nothing".to_owned(),
            CpEvent::Diagnosis { incoming: true, .. } | CpEvent::Record { incoming: true, .. } => {
                "diagnostic interrupt: an error has come".to_owned()
            }
            CpEvent::Diagnosis { incoming: false, .. } | CpEvent::Record { incoming: false, .. } => {
                "diagnostic interrupt: all errors are gone".to_owned()
            }
        };
        self.tell(now, Kind::Note, text.as_bytes());
    }
}

/// What a number of the CP 341 means.
fn meaning(number: u16) -> &'static str {
    cp341_events::row(number).map_or("no event of the CP 341", |row| row.text)
}

impl Ear {
    /// False when it is gone.
    fn tell(&mut self, now: Nanos, message: &[u8]) -> bool {
        match self.try_tell(now, message) {
            Ok(Sent::Yes) => true,
            Ok(Sent::Full) => {
                self.lost += 1;
                true
            }
            Err(_) => false,
        }
    }

    fn try_tell(&mut self, now: Nanos, message: &[u8]) -> io::Result<Sent> {
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
    use ob1_line::seqpacket::MESSAGE_MAX;

    #[test]
    fn a_listener_that_sleeps_loses_records_and_is_told_how_many() {
        let dir = tempfile::tempdir().expect("a folder");
        let path = dir.path().join("cp.trace");
        let mut tap = Tap::default();
        tap.tell(0, Kind::Up, &[]);
        tap.open(Some(&path));
        let config = Config::parse(br#"{"module":"cp240","name":"cp","line":"pty:/x"}"#).expect("right");
        tap.introduce(5, &config, &[7; 16]);
        let ear = Channel::connect(&path).expect("the tap listens");
        tap.admit(9);
        // Nobody fetches these: the tap neither waits nor grows.
        for time in 0..100_000 {
            tap.tell(time, Kind::In, &[0x55; 100]);
        }
        let mut buffer = [0; MESSAGE_MAX];
        let mut seen = 0;
        let hello = ear.receive(&mut buffer).expect("alive").expect("a record");
        let hello = Record::read(hello).expect("a record");
        assert_eq!(hello.kind, Kind::Hello);
        let hello: serde_json::Value = serde_json::from_slice(hello.data).expect("JSON");
        assert_eq!((&hello["name"], &hello["version"], &hello["parameters"][3]), (&json!("cp"), &json!(1), &json!(7)));
        while ear.receive(&mut buffer).expect("alive").is_some() {
            seen += 1;
        }
        tap.tell(100_000, Kind::Done, &[]);
        let gap = Record::read(ear.receive(&mut buffer).expect("alive").expect("a record")).expect("a record");
        assert_eq!(gap.kind, Kind::Lost);
        let lost = u64::from_le_bytes(gap.data.try_into().expect("8 bytes"));
        assert_eq!(seen + lost, 100_000);
        let last = ear.receive(&mut buffer).expect("alive").expect("a record");
        assert_eq!(Record::read(last).map(|record| record.kind), Some(Kind::Done));
        drop(ear);
        tap.tell(100_001, Kind::Up, &[]);
        assert!(tap.listeners.is_empty(), "who is gone is forgotten");
        // Long data come in pieces.
        let ear = Channel::connect(&path).expect("the tap listens");
        tap.admit(0);
        tap.tell(0, Kind::Out, &[1; CHUNK + 1]);
        let lengths: Vec<usize> =
            std::iter::from_fn(|| ear.receive(&mut buffer).ok().flatten().map(<[u8]>::len)).skip(1).collect();
        assert_eq!(lengths, [9 + CHUNK, 9 + 1]);
    }
}
