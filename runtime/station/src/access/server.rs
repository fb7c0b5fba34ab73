//! The socket of a running station: a thread with a door to the broker, as every link has one. Each client has one
//! request under way at a time, and none waits for another's.

use std::io;
use std::os::fd::OwnedFd;
use std::os::unix::fs::PermissionsExt as _;
use std::os::unix::net::UnixListener;
use std::path::Path;
use std::sync::Arc;

use ob1_access::alarms::{acknowledging, standing};
use ob1_access::door::{Answer, Ask, Command, Document, Door, Refusal};
use ob1_access::{Item, Piece, Typed, value};
use ob1_cpu::Family;
use ob1_model::{ALARM_ORDERS, AlarmOrder, AlarmQuery, Area, Cell, DebugOrder, Forced, ForcedArea, PassOrder};
use ob1_rt::SideThread;
use ob1_time::{Instant, Span};
use serde_json::Value;

use super::clients::Clients;
use super::control::{Control, Outcome, Pending};
use super::protocol::{CellValue, LINE_BYTES, Op, Request, Response};
use super::{debug, pass, why};
use crate::bus_view::BusView;
use crate::program_facts::KnownProgram;
use crate::view::StationView;

/// How long the CPU may take to answer, beyond two cycles. It answers once a cycle; this is for one that hangs.
const ANSWER_TIME: Span = Span::from_secs(3);

/// A running server. Dropping it ends the thread and removes the socket.
#[derive(Debug)]
pub struct Server {
    _thread: SideThread<OwnedFd>,
}

impl Server {
    /// Opens the socket (mode 0600) and starts the thread, with a door to the broker of a CPU with this minimum cycle
    /// time.
    ///
    /// # Errors
    /// The socket cannot be made at this path, or no thread can be started.
    pub fn start(socket: &Path, door: Door, view: StationView, min_cycle: Span) -> io::Result<Self> {
        let listener = UnixListener::bind(socket)?;
        std::fs::set_permissions(socket, std::fs::Permissions::from_mode(0o600))?;
        listener.set_nonblocking(true)?;
        let socket = socket.to_owned();
        let answer_time = ANSWER_TIME.saturating_add(min_cycle.times(2));
        let thread = SideThread::polling("ob1-access", move |stopped| {
            Serving { control: Control::new(door, answer_time), view, under_way: Vec::new() }.run(&listener, &stopped);
            let _ = std::fs::remove_file(socket);
        })?;
        Ok(Self { _thread: thread })
    }
}

struct Serving {
    control: Control,
    view: StationView,
    /// What waits for the broker or the scan, in the order it came.
    under_way: Vec<UnderWay>,
}

struct UnderWay {
    pending: Pending,
    id: Value,
    then: Then,
}

/// What happens to the answer.
enum Then {
    /// `all`: nobody has named them.
    Values {
        items: Vec<Typed>,
        all: bool,
    },
    Written(Vec<String>),
    Done,
    Status,
    Links,
    Diagnostics(u32),
    Pass(Arc<KnownProgram>, PassOrder, bool),
    Why(Arc<KnownProgram>, Box<ob1_access::why::Question>),
    Debug(Arc<KnownProgram>, DebugOrder),
    Load,
    Force,
    Alarms,
    Acknowledged(Vec<u32>),
}

impl Serving {
    fn run(&mut self, listener: &UnixListener, stopped: &OwnedFd) {
        let mut clients = Clients::new();
        if !self.view.alarm_texts.is_empty() {
            self.control.log_on();
        }
        let too_long = || line(&Response::refused(Value::Null, format!("a line has at most {LINE_BYTES} bytes")));
        loop {
            let due = self.under_way.iter().map(|request| request.pending.due()).min();
            if !clients.wait(listener, stopped, self.control.is_there().then(|| self.control.fd()), due) {
                return;
            }
            self.control.pump();
            for gone in clients.take_gone() {
                self.under_way.retain(|request| request.pending.client() != gone);
                self.control.client_gone(gone);
            }
            clients
                .take_requests(|client, request| self.begin(client, request).map(|response| line(&response)), too_long);
            for (client, response) in self.go_on() {
                clients.answer(client, line(&response));
            }
        }
    }

    /// The answer, if it is there at once.
    fn begin(&mut self, client: u32, line: &[u8]) -> Option<Response> {
        let request: Request = match serde_json::from_slice(line) {
            Ok(request) => request,
            Err(error) => {
                let why = format!("no request: {error}; see docs/access.md");
                return Some(Response::refused(Value::Null, why));
            }
        };
        match self.serve(client, request.op) {
            Ok(Begun::Answered(response)) => Some(Response { id: request.id, ..*response }),
            Ok(Begun::UnderWay(pending, then)) => {
                self.under_way.push(UnderWay { pending, id: request.id, then });
                None
            }
            Err(error) => Some(Response::refused(request.id, error)),
        }
    }

    /// Goes on with what is under way; returns the answers of what has ended.
    fn go_on(&mut self) -> Vec<(u32, Response)> {
        let mut answers = Vec::new();
        let mut may_read = true;
        for mut request in std::mem::take(&mut self.under_way) {
            match self.control.advance(&mut request.pending, &mut may_read) {
                None => self.under_way.push(request),
                Some(ended) => {
                    let response = ended.and_then(|outcome| self.response(outcome, request.then));
                    let response = match response {
                        Ok(response) => Response { id: request.id, ..response },
                        Err(error) => Response::refused(request.id, error),
                    };
                    answers.push((request.pending.client(), response));
                }
            }
        }
        answers
    }

    fn serve(&mut self, client: u32, op: Op) -> Result<Begun, String> {
        let mut response = Response::done(Value::Null);
        let known = self.view.known.get();
        match op {
            Op::Get { items } => {
                let all = items.is_empty();
                // Without names all symbols that have a value.
                let items: Vec<(Typed, Piece)> = match all {
                    true => known.names.symbols().iter().filter_map(|s| typed(&known, &s.name).ok()).collect(),
                    false => items.iter().map(|name| typed(&known, name)).collect::<Result<_, _>>()?,
                };
                let wanted = items.iter().map(|(_, piece)| *piece).collect();
                let items = items.into_iter().map(|(typed, _)| typed).collect();
                return Ok(Begun::UnderWay(self.control.read(client, wanted), Then::Values { items, all }));
            }
            Op::Set { items } => {
                let (mut names, mut puts) = (Vec::with_capacity(items.len()), Vec::with_capacity(items.len()));
                for (name, value) in items {
                    for put in known.names.typed(&name)?.puts_of(&value)? {
                        puts.push(put);
                        names.push(name.clone());
                    }
                }
                return Ok(Begun::UnderWay(self.control.write(client, puts), Then::Written(names)));
            }
            Op::Command { command } => {
                if command == Command::Hot && self.view.family == Family::S7_300 {
                    return Err("an S7-300 has no hot restart; it takes family = 400 in [cpu]".into());
                }
                return Ok(Begun::UnderWay(self.control.ask(client, Ask::Command(command)), Then::Done));
            }
            Op::Status => return Ok(Begun::UnderWay(self.control.ask(client, Ask::Modules), Then::Status)),
            Op::Links => {
                return Ok(Begun::UnderWay(self.control.ask(client, Ask::Document(Document::Links)), Then::Links));
            }
            Op::Diag { count } => {
                let ask = Ask::Diagnostics(count.min(u32::from(u16::MAX)) as u16);
                return Ok(Begun::UnderWay(self.control.ask(client, ask), Then::Diagnostics(count)));
            }
            Op::Pass(wanted) => {
                let order = pass::order(&known, &wanted)?;
                let pending = self.control.ask_for(client, Ask::Pass(order), Span::from_nanos(order.wait));
                return Ok(Begun::UnderWay(pending, Then::Pass(known, order, wanted.statements)));
            }
            Op::Why(wanted) => {
                let (question, order) = why::order(&known, &wanted)?;
                let Some(order) = order else {
                    response.why = Some(Box::new(why::status(&known, &question, None, 0)?));
                    return Ok(Begun::Answered(Box::new(response)));
                };
                let pending = self.control.ask_for(client, Ask::Pass(order), Span::from_nanos(order.wait));
                return Ok(Begun::UnderWay(pending, Then::Why(known, Box::new(question))));
            }
            Op::Debug(wanted) => {
                let order = debug::order(&known, &wanted)?;
                let wait = if let DebugOrder::Hold { wait, .. } = order { wait } else { 0 };
                let pending = self.control.ask_for(client, Ask::Debug(order.clone()), Span::from_nanos(wait));
                return Ok(Begun::UnderWay(pending, Then::Debug(known, order)));
            }
            Op::Force { items, off } => {
                let mut cells = if off { Vec::new() } else { self.view.forces.now() };
                if items.is_empty() && !off {
                    response.forced = Some(cells.iter().map(ToString::to_string).collect());
                    return Ok(Begun::Answered(Box::new(response)));
                }
                for (name, value) in items {
                    let cell = forced(&known, &name, &value)?;
                    cells.retain(|other| (other.area, other.bit, other.width) != (cell.area, cell.bit, cell.width));
                    cells.push(cell);
                }
                return Ok(Begun::UnderWay(self.control.ask(client, Ask::Force(cells)), Then::Force));
            }
            Op::Alarms { acknowledge } if acknowledge.len() > ALARM_ORDERS => {
                return Err(format!("at most {ALARM_ORDERS} alarms can be acknowledged at once"));
            }
            Op::Alarms { acknowledge } if acknowledge.is_empty() => {
                let ask = Ask::Alarms(AlarmOrder::Query(AlarmQuery::Standing));
                return Ok(Begun::UnderWay(self.control.ask(client, ask), Then::Alarms));
            }
            Op::Alarms { acknowledge } => {
                let ask = Ask::Alarms(AlarmOrder::Acknowledge(acknowledging(&acknowledge)));
                return Ok(Begun::UnderWay(self.control.ask(client, ask), Then::Acknowledged(acknowledge)));
            }
            Op::Load(order) => {
                let told = self.view.loads.get().and_then(|loads| loads.load(order));
                let told = told.ok_or("the station ends, or has not started yet")?;
                return Ok(Begun::UnderWay(self.control.load(client, told), Then::Load));
            }
            Op::ResetStatistics => self.view.timings.reset(),
            Op::Timing { histograms } => response.timing = Some(Box::new(self.view.timings.snapshot(histograms))),
            Op::Buses => response.buses = Some(self.view.buses.iter().map(BusView::status).collect()),
            Op::Recorder => response.recorder = Some(Box::new(self.view.timings.recorder())),
        }
        Ok(Begun::Answered(Box::new(response)))
    }

    fn response(&self, outcome: Outcome, then: Then) -> Result<Response, String> {
        let mut response = Response::done(Value::Null);
        match (then, outcome) {
            (Then::Values { items, all }, Outcome::Read(values)) => {
                let values = items.iter().zip(values).map(|(item, value)| cell_value(item, value));
                // Of all symbols, those are left out whose module is not there.
                let values = values.filter(|value| !all || value.is_ok());
                response.values = Some(values.collect::<Result<_, _>>()?);
            }
            (Then::Written(names), Outcome::Written(Err((entry, error)))) => {
                let name = names.get(entry).map_or("", |name| name.as_str());
                return Err(format!("{name}: {error}"));
            }
            (Then::Written(_), Outcome::Written(Ok(()))) | (Then::Done, Outcome::Answer(_)) => {}
            (Then::Status, Outcome::Answer(Answer::Modules { state, present })) => {
                response.status = Some(self.view.status(state, &present));
            }
            (Then::Links, Outcome::Answer(Answer::Document { bytes, .. })) => {
                response.links = serde_json::from_slice(&bytes).ok();
            }
            (Then::Force, Outcome::Answer(_)) => {
                response.forced = Some(self.view.forces.now().iter().map(ToString::to_string).collect());
            }
            (Then::Alarms, Outcome::Answer(Answer::Alarms { list, .. })) => {
                response.alarms = Some(standing(&list, &self.view.alarm_texts));
            }
            (Then::Acknowledged(numbers), Outcome::Answer(Answer::Ordered(found))) => {
                let missing = numbers.into_iter().zip(found).filter(|(_, found)| !found);
                response.missing = Some(missing.map(|(number, _)| number).collect());
            }
            (Then::Load, Outcome::Loaded(told)) => response.load = Some(Box::new(told)),
            (Then::Pass(known, order, each), Outcome::Answer(Answer::Pass(pass))) => {
                let started = self.view.unix_at(Instant::START);
                let mut told = pass::status(&known, &order, &pass, started)?;
                if each {
                    told.statements = pass::statements(&order, &pass);
                }
                response.pass = Some(Box::new(told));
            }
            (Then::Why(known, question), Outcome::Answer(Answer::Pass(pass))) => {
                let started = self.view.unix_at(Instant::START);
                response.why = Some(Box::new(why::status(&known, &question, Some(&pass), started)?));
            }
            (Then::Debug(known, order), Outcome::Answer(Answer::Debug(answer))) => {
                response.debug = Some(Box::new(debug::status(&known, &order, answer)?));
            }
            (Then::Diagnostics(count), Outcome::Answer(answer)) => {
                let entries = if let Answer::Diagnostics(entries) = answer { entries } else { Vec::new() };
                response.diagnostics = Some(entries.into_iter().map(|entry| self.view.diagnostic(entry)).collect());
                response.cps = Some(self.view.buffers(count));
            }
            _ => return Err("no answer".into()),
        }
        Ok(response)
    }
}

/// A request, once it has been parsed.
enum Begun {
    Answered(Box<Response>),
    UnderWay(Pending, Then),
}

/// A cell to be forced, and its value.
fn forced(known: &KnownProgram, name: &str, value: &Value) -> Result<Forced, String> {
    let item = known.names.parse(name)?;
    // Peripheral cells by their names only: nothing else says whether inputs or outputs are meant.
    let area = match item.cell {
        Cell::Area(Area::Input, _) => ForcedArea::Input,
        Cell::Area(Area::Output, _) => ForcedArea::Output,
        Cell::Area(Area::Memory, _) => ForcedArea::Memory,
        Cell::Peripheral(_) => Forced::named(name)
            .map(|cell| cell.area)
            .ok_or_else(|| format!("{name}: write PIW 256 for peripheral inputs, PQW 256 for outputs"))?,
        _ => {
            return Err(format!(
                "{name} cannot be forced\n  = inputs and outputs can; with family = 400 bit memory and peripheral cells, too"
            ));
        }
    };
    Ok(Forced { area, bit: item.cell.bit(), width: item.width, value: value::from_json(&item, value)? })
}

/// A place by its name, with what is read for it.
fn typed(known: &KnownProgram, name: &str) -> Result<(Typed, Piece), String> {
    let typed = known.names.typed(name)?;
    let piece = typed.piece();
    piece.map(|piece| (typed, piece)).ok_or_else(|| format!("{name} is a structure, which is not a single value"))
}

fn cell_value(typed: &Typed, value: Result<Box<[u8]>, Refusal>) -> Result<CellValue, String> {
    let bytes = value.map_err(|error| format!("{}: {error}", typed.name))?;
    let single = Item::of(typed).zip(typed.bits(&bytes)).map(|(item, bits)| value::to_json(&item, bits));
    let value = single.or_else(|| typed.value(&bytes).map(|datum| datum.json())).unwrap_or_default();
    Ok(CellValue {
        item: typed.name.clone(),
        type_name: typed.ty.name().to_owned(),
        value,
        hex: typed.hex(&bytes),
        text: typed.text(&bytes),
    })
}

/// An answer as it goes out.
fn line(response: &Response) -> Vec<u8> {
    // What we answer can be serialized.
    let mut line = serde_json::to_vec(response).unwrap_or_default();
    line.push(b'\n');
    line
}
