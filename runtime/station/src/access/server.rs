//! The socket of a running station: a thread that is the access port's one client. It serves one request at a time; the
//! scan sees only the bounded rings of the port.

use std::io;
use std::os::unix::fs::PermissionsExt as _;
use std::os::unix::net::UnixListener;
use std::path::Path;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use ob1_access::{Item, value};
use ob1_cpu::{
    AccessClient, Answer, Ask, CellError, Command, Family, Link, OperatingState, Put, Request as PortRequest,
};
use serde_json::Value;

use super::cells::Cells;
use super::clients::Clients;
use super::protocol::{CellValue, CommandName, Diagnostic, LINE_BYTES, Op, Request, Response, Status};
use crate::view::StationView;

/// How long the CPU may take to answer, beyond two cycles. It answers once a cycle; this is for one that hangs.
const ANSWER_TIME: Duration = Duration::from_secs(3);
/// Pause between two looks at the answers.
const LOOK: Duration = Duration::from_micros(200);
/// Requests posted to the port at a time: less than its rings hold.
const BATCH: usize = 128;

/// A running server. Dropping it ends the thread and removes the socket.
#[derive(Debug)]
pub struct Server {
    stop: Option<io::PipeWriter>,
    thread: Option<JoinHandle<()>>,
}

impl Server {
    /// Opens the socket (mode 0600) and starts the thread, for a CPU with this minimum cycle time in nanoseconds.
    ///
    /// # Errors
    /// What the system says.
    pub fn start(socket: &Path, port: AccessClient, link: Link, view: StationView, min_cycle: u64) -> io::Result<Self> {
        let listener = UnixListener::bind(socket)?;
        std::fs::set_permissions(socket, std::fs::Permissions::from_mode(0o600))?;
        listener.set_nonblocking(true)?;
        let (stopped, stop) = io::pipe()?;
        let socket = socket.to_owned();
        let answer_time = ANSWER_TIME + Duration::from_nanos(min_cycle.saturating_mul(2));
        let thread = ob1_rt::spawn("ob1-access", move || {
            let port = Port { client: port, next_id: 0, answer_time };
            Serving { port, cells: Cells::new(link, answer_time), view }.run(&listener, &stopped);
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

/// The access port with questions in, answers out.
struct Port {
    client: AccessClient,
    next_id: u32,
    answer_time: Duration,
}

impl Port {
    /// Asks and waits for all answers.
    fn ask(&mut self, asks: &[Ask]) -> Result<Vec<Answer>, String> {
        let mut answers = Vec::with_capacity(asks.len());
        for batch in asks.chunks(BATCH) {
            let first = self.next_id;
            self.next_id = self.next_id.wrapping_add(batch.len() as u32);
            let give_up = Instant::now() + self.answer_time;
            for (id, &ask) in (0..).zip(batch) {
                let mut request = PortRequest { id: first.wrapping_add(id), ask };
                while let Err(full) = self.client.post(request) {
                    request = full;
                    self.wait(give_up)?;
                    // Answers nobody waits for any more would keep the rings full.
                    while self.client.take().is_some() {}
                }
            }
            for id in 0..batch.len() as u32 {
                answers.push(self.answer_to(first.wrapping_add(id), give_up)?);
            }
        }
        Ok(answers)
    }

    fn answer_to(&mut self, id: u32, give_up: Instant) -> Result<Answer, String> {
        loop {
            match self.client.take() {
                Some(response) if response.id == id => return Ok(response.answer),
                // Of a request that was given up.
                Some(_) => {}
                None => self.wait(give_up)?,
            }
        }
    }

    fn wait(&self, give_up: Instant) -> Result<(), String> {
        if self.client.is_closed() {
            return Err("the CPU is gone".into());
        }
        if Instant::now() >= give_up {
            return Err("the CPU does not answer: its scan hangs, or its cycle is very long".into());
        }
        std::thread::sleep(LOOK);
        Ok(())
    }

    fn ask_one(&mut self, ask: Ask) -> Result<Answer, String> {
        self.ask(&[ask])?.pop().ok_or_else(|| "no answer".to_owned())
    }
}

struct Serving {
    port: Port,
    cells: Cells,
    view: StationView,
}

impl Serving {
    fn run(&mut self, listener: &UnixListener, stopped: &io::PipeReader) {
        let mut clients = Clients::new();
        let too_long = || line(&Response::refused(Value::Null, format!("a line has at most {LINE_BYTES} bytes")));
        while clients.wait(listener, stopped) {
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
                let mut cells = Vec::with_capacity(items.len());
                for (name, value) in &items {
                    let item = self.view.names.parse(name)?;
                    cells.push((name, item.cell, item.width, value::from_json(&item, value)?));
                }
                // What a module feeds is written there; the process image would not keep it.
                let panel = self.view.panel.as_ref();
                cells.retain(|(_, cell, width, bits)| !panel.is_some_and(|panel| panel.write(*cell, *width, *bits)));
                let (names, puts): (Vec<_>, Vec<_>) =
                    cells.into_iter().map(|(name, cell, width, bits)| (name, Put::Value(cell, width, bits))).unzip();
                if let Err((entry, error)) = self.cells.write(puts)? {
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
                self.port.ask_one(Ask::Command(command))?;
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
        let values = self.cells.read(&wanted)?;
        items.iter().zip(values).map(|(item, value)| cell_value(item, value)).collect()
    }

    fn status(&mut self) -> Result<Status, String> {
        let count = self.view.modules.len() as u32;
        let mut asks = vec![Ask::State];
        asks.extend((0..count).map(Ask::Module));
        let mut answers = self.port.ask(&asks)?.into_iter();
        let state = match answers.next() {
            Some(Answer::State(state)) => state,
            _ => OperatingState::Stop,
        };
        let present =
            answers.map(|answer| matches!(answer, Answer::Module(module) if module.present)).collect::<Vec<_>>();
        Ok(self.view.status(state, &present))
    }

    fn diagnostics(&mut self, count: u32) -> Result<Vec<Diagnostic>, String> {
        let asks: Vec<Ask> =
            (0..count.min((ob1_cpu::DIAG_ENTRIES + ob1_cpu::DIAG_STOPS) as u32)).map(Ask::Diag).collect();
        let entries = self.port.ask(&asks)?.into_iter().map_while(|answer| match answer {
            Answer::Diag(entry) => Some(self.view.diagnostic(&entry)),
            _ => None,
        });
        Ok(entries.collect())
    }
}

fn cell_value(item: &Item, value: Result<u32, CellError>) -> Result<CellValue, String> {
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
