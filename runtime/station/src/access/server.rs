//! The socket of a running station: a thread with a door to the broker, as every link has one. It serves one request at
//! a time.

use std::io;
use std::os::unix::fs::PermissionsExt as _;
use std::os::unix::net::UnixListener;
use std::path::Path;
use std::thread::JoinHandle;
use std::time::Duration;

use ob1_access::door::{Answer, Ask, Command, Diagnosis, Door, Refusal};
use ob1_access::{Item, Put, value};
use ob1_cpu::Family;
use serde_json::Value;

use super::clients::Clients;
use super::control::Control;
use super::protocol::{CellValue, CommandName, Diagnostic, LINE_BYTES, Op, Request, Response, Status};
use crate::view::{StationView, event_number};

/// How long the CPU may take to answer, beyond two cycles. It answers once a cycle; this is for one that hangs.
const ANSWER_TIME: Duration = Duration::from_secs(3);

/// A running server. Dropping it ends the thread and removes the socket.
#[derive(Debug)]
pub struct Server {
    stop: Option<io::PipeWriter>,
    thread: Option<JoinHandle<()>>,
}

impl Server {
    /// Opens the socket (mode 0600) and starts the thread, with a door to the broker of a CPU with this minimum cycle
    /// time in nanoseconds.
    ///
    /// # Errors
    /// What the system says.
    pub fn start(socket: &Path, door: Door, view: StationView, min_cycle: u64) -> io::Result<Self> {
        let listener = UnixListener::bind(socket)?;
        std::fs::set_permissions(socket, std::fs::Permissions::from_mode(0o600))?;
        listener.set_nonblocking(true)?;
        let (stopped, stop) = io::pipe()?;
        let socket = socket.to_owned();
        let answer_time = ANSWER_TIME + Duration::from_nanos(min_cycle.saturating_mul(2));
        let thread = ob1_rt::spawn("ob1-access", move || {
            Serving { control: Control::new(door, answer_time), view }.run(&listener, &stopped);
            let _ = std::fs::remove_file(socket);
        })?;
        Ok(Self { stop: Some(stop), thread: Some(thread) })
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        drop(self.stop.take());
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

struct Serving {
    control: Control,
    view: StationView,
}

impl Serving {
    fn run(&mut self, listener: &UnixListener, stopped: &io::PipeReader) {
        let mut clients = Clients::new();
        let too_long = || line(&Response::refused(Value::Null, format!("a line has at most {LINE_BYTES} bytes")));
        while clients.wait(listener, stopped) {
            self.control.tick();
            clients.answer_each(|request| line(&self.answer(request)), too_long);
        }
    }

    fn answer(&mut self, line: &[u8]) -> Response {
        let request: Request = match serde_json::from_slice(line) {
            Ok(request) => request,
            Err(error) => return Response::refused(Value::Null, format!("no request: {error}; see docs/access.md")),
        };
        let id = request.id.clone();
        match self.serve(request.op, id.clone()) {
            Ok(response) => response,
            Err(error) => Response::refused(id, error),
        }
    }

    fn serve(&mut self, op: Op, id: Value) -> Result<Response, String> {
        let mut response = Response::done(id);
        match op {
            Op::Get { items } => response.values = Some(self.get(&items)?),
            Op::Set { items } => {
                let (mut names, mut puts) = (Vec::with_capacity(items.len()), Vec::with_capacity(items.len()));
                for (name, value) in &items {
                    let item = self.view.names.parse(name)?;
                    puts.push(Put::Value(item.cell, item.width, value::from_json(&item, value)?));
                    names.push(name);
                }
                if let Err((entry, error)) = self.control.write(puts)? {
                    let name = names.get(entry).map_or("", |name| name.as_str());
                    return Err(format!("{name}: {error}"));
                }
            }
            Op::Command { command } => {
                let command = match command {
                    CommandName::Run => Command::Run,
                    CommandName::Stop => Command::Stop,
                    CommandName::Warm => Command::Warm,
                    CommandName::Cold => Command::Cold,
                    CommandName::Hot if self.view.family == Family::S7_300 => {
                        return Err("an S7-300 has no hot restart; it takes family = 400 in [cpu]".into());
                    }
                    CommandName::Hot => Command::Hot,
                    CommandName::Reset => Command::Reset,
                };
                self.control.ask(Ask::Command(command))?;
            }
            Op::Status => response.status = Some(self.status()?),
            Op::Diag { count } => {
                response.diagnostics = Some(self.diagnostics(count)?);
                response.cps = Some(self.view.buffers(count));
            }
            Op::ResetStatistics => self.view.timings.reset(),
            Op::Timing { histograms } => response.timing = Some(Box::new(self.view.timings.snapshot(histograms))),
            Op::Recorder => response.recorder = Some(Box::new(self.view.timings.recorder())),
        }
        Ok(response)
    }

    fn get(&mut self, names: &[String]) -> Result<Vec<CellValue>, String> {
        let items: Vec<Item> = names.iter().map(|name| self.view.names.parse(name)).collect::<Result<_, _>>()?;
        let wanted: Vec<_> = items.iter().map(|item| (item.cell, item.width)).collect();
        let values = self.control.read(&wanted)?;
        items.iter().zip(values).map(|(item, value)| cell_value(item, value)).collect()
    }

    fn status(&mut self) -> Result<Status, String> {
        match self.control.ask(Ask::Modules)? {
            Answer::Modules { state, present } => Ok(self.view.status(state, &present)),
            _ => Err("no answer".into()),
        }
    }

    fn diagnostics(&mut self, count: u32) -> Result<Vec<Diagnostic>, String> {
        match self.control.ask(Ask::Diagnostics(count.min(u32::from(u16::MAX)) as u16))? {
            Answer::Diagnostics(entries) => Ok(entries.into_iter().map(|entry| self.diagnostic(entry)).collect()),
            _ => Ok(Vec::new()),
        }
    }

    fn diagnostic(&self, entry: Diagnosis) -> Diagnostic {
        Diagnostic {
            number: entry.number,
            time_ns: entry.time,
            unix_ns: self.view.unix_at(entry.time),
            event: event_number(entry.event),
            text: entry.text,
            place: entry.place,
            because: entry.because,
            remedy: entry.remedy,
        }
    }
}

fn cell_value(item: &Item, value: Result<u32, Refusal>) -> Result<CellValue, String> {
    let bits = value.map_err(|error| format!("{}: {error}", item.name))?;
    Ok(CellValue {
        item: item.name.clone(),
        type_name: item.type_name.to_owned(),
        value: value::to_json(item, bits),
        hex: value::to_hex(item, bits),
    })
}

/// An answer as it goes out.
fn line(response: &Response) -> Vec<u8> {
    // What we answer can be serialized.
    let mut line = serde_json::to_vec(response).unwrap_or_default();
    line.push(b'\n');
    line
}
