//! One link as the broker sees it: its share of the exchange, its connection, its clients.

use std::collections::{BTreeMap, VecDeque};
use std::os::fd::{AsFd as _, OwnedFd};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use ob1_access::door::{
    ALARM_PART, Answer, Connection as LinkConnection, News, PART_BYTES, Refusal, Refused, Ticket, ToBroker, ToLink,
    VERSION, Welcome,
};
use ob1_backplane::{SegmentError, WindowHead, WindowReader, WindowWriter};
use ob1_cpu::{
    AlarmJob, Answer as CpuAnswer, Ask, Cpu, DebugJob, Frame, Group, Job as Work, Link, Listing, Mark, PassJob, Piece,
    PointJob, Question, SUMS_AT, TooMuch, Window,
};
use ob1_model::{DebugOrder, PASS_WAIT, Pass, Point, PointItem, PointOrder};
use ob1_process::log::Limit;
use ob1_time::{Instant, Span};

use crate::alarms::Logons;
use crate::client::{Clients, Job, Wanted};
use crate::connection::{Connection, Received};
use crate::{Facts, LinkConfig};

/// Messages of a process that is gone which are still read: more than its socket holds.
const LAST_WORDS: usize = 4096;
/// What partners do that is recorded at once, and the time after which one more is.
const RECORDS: u32 = 20;
const RECORD: Duration = Duration::from_secs(5);

/// Signs of life of a link's process: a number that changes with each.
#[derive(Clone, Debug, Default)]
pub struct Beats(Arc<AtomicU64>);

impl Beats {
    /// How many signs of life there were; only a change counts.
    #[must_use]
    pub fn count(&self) -> u64 {
        self.0.load(Ordering::Relaxed)
    }

    pub(crate) fn beat(&self) {
        self.0.fetch_add(1, Ordering::Relaxed);
    }
}

/// The scan's end of a window.
struct Glass(WindowWriter);

impl Window for Glass {
    #[inline]
    fn put(&mut self, mark: Mark, fill: &mut dyn FnMut(&[AtomicU64])) {
        let head = WindowHead {
            generation: mark.generation,
            scan: mark.scan,
            time: mark.time.nanos(),
            state: mark.state.number().into(),
        };
        self.0.put(head, fill);
    }
}

// A window has room for every frame.
const _: () = assert!(ob1_model::FRAME_WORDS <= ob1_backplane::WINDOW_WORDS);

/// Something at the scan.
#[derive(Clone, Debug)]
struct Out {
    client: u32,
    ticket: Ticket,
    kind: Kind,
    /// It stays, or waits for a STOP: nobody looks for its answer all the time.
    slow: bool,
    give_up: Instant,
}

/// What kind of job is under way, and what its answer needs.
#[derive(Clone, Debug)]
enum Kind {
    Ask(Wanted),
    /// The place of each entry in the group of the client. Inputs that a module feeds are missing.
    Group(Vec<u32>),
    List,
    Pass,
    Debug,
    Alarms,
    /// For each item of the client: whether it is allowed. The others were not handed over.
    Point(Vec<bool>),
}

impl Kind {
    /// The scan must be told when nobody waits for it any more.
    const fn is_armed(&self) -> bool {
        matches!(self, Self::Pass | Self::Point(_))
    }
}

/// The cell of an item.
const fn cell(item: &PointItem) -> ob1_access::Cell {
    match item {
        PointItem::Read(Piece::Bytes { at: cell, .. } | Piece::Value(cell, _)) => *cell,
        PointItem::Write(put) => put.cell(),
    }
}

/// A client, the number of its question, what becomes of the answers, and these.
pub(crate) type Answered = (u32, Ticket, Wanted, Vec<CpuAnswer>);

/// A link as the broker sees it; see [the module](self).
#[derive(Debug)]
pub(crate) struct Joint {
    pub(crate) config: LinkConfig,
    link: Link,
    window: WindowReader,
    pub(crate) connection: Option<Connection>,
    pub(crate) clients: Clients,
    pub(crate) beats: Beats,
    /// It has given a sign of life since it was connected.
    pub(crate) up: bool,
    /// Its connections, as it has reported them last.
    pub(crate) connections: Vec<LinkConnection>,
    /// Events up to this number have been sent; none are wanted otherwise.
    pub(crate) events_after: Option<u64>,
    /// Its displays.
    pub(crate) logons: Logons,
    /// The generation that was watched, until its first snapshot is there.
    awaited: Option<u64>,
    /// A list that found no room in the ring.
    postponed: Option<(u64, Vec<Piece>)>,
    /// Generations of this process begin above this.
    generation: u64,
    number: u64,
    out: BTreeMap<u64, Out>,
    /// The client that sets breakpoints.
    pub(crate) debugger: Option<u32>,
    /// It is gone, and the CPU does not know yet.
    debugger_gone: bool,
    /// Passes and points nobody waits for any more.
    forgotten: Vec<u64>,
    /// Entries for the diagnostic buffer that nobody waits for.
    notes: VecDeque<Ask>,
    /// What the CPU has answered to clients.
    pub(crate) answered: Vec<Answered>,
    /// The scan has not answered something in time, and nothing since.
    silent: bool,
    /// Something was handed over since the last wait.
    pub(crate) fresh: bool,
    /// How much of what its partners do is recorded.
    pub(crate) records: Limit,
}

impl Joint {
    /// A link with its window.
    pub(crate) fn new(cpu: &mut Cpu, config: LinkConfig) -> Result<Option<Self>, SegmentError> {
        let writer = WindowWriter::create_shared()?;
        let window = writer.reader();
        let Some(link) = cpu.link(Box::new(Glass(writer))) else { return Ok(None) };
        Ok(Some(Self {
            config,
            link,
            window,
            connection: None,
            clients: Clients::default(),
            beats: Beats::default(),
            up: false,
            connections: Vec::new(),
            events_after: None,
            logons: Logons::default(),
            awaited: None,
            postponed: None,
            generation: 0,
            number: 0,
            out: BTreeMap::new(),
            debugger: None,
            debugger_gone: false,
            forgotten: Vec::new(),
            notes: VecDeque::new(),
            answered: Vec::new(),
            silent: false,
            fresh: false,
            records: Limit::new(RECORDS, RECORD),
        }))
    }

    /// Its window, for reading what the scan has put there.
    pub(crate) const fn window(&self) -> &WindowReader {
        &self.window
    }

    /// Whether something is under way that the scan has to answer.
    pub(crate) fn is_idle(&self) -> bool {
        self.out.values().all(|out| out.slow)
            && self.awaited.is_none()
            && self.postponed.is_none()
            && !self.clients.wait()
    }

    /// A process has connected: it is welcomed, and everything of the one before is dropped.
    pub(crate) fn connect(&mut self, socket: OwnedFd, facts: &dyn Facts, now: Instant) {
        self.disconnect();
        let [inputs, outputs, memory] = facts.areas();
        let [timers, counters] = facts.timers_and_counters();
        let welcome = ToLink::Welcome(Welcome {
            version: VERSION,
            station: facts.name().to_owned(),
            link: self.config.name.clone(),
            family: facts.family(),
            config: self.config.config.clone(),
            rights: self.config.rights,
            inputs,
            outputs,
            memory,
            timers,
            counters,
            min_cycle: facts.min_cycle().nanos(),
            generation: self.generation,
            listeners: self.config.listeners.len() as u8,
        });
        let descriptors: Vec<_> = self
            .window
            .descriptor()
            .into_iter()
            .chain(self.config.listeners.iter().map(|listener| listener.as_fd()))
            .collect();
        let mut connection = Connection::new(socket, now);
        match connection.welcome(&welcome, &descriptors) {
            Ok(()) => self.connection = Some(connection),
            Err(error) => tracing::error!(link = %self.config.name, "cannot be welcomed: {error}"),
        }
    }

    /// The process is gone, and perhaps has said before what it has handed to its displays: they get it once then.
    pub(crate) fn hear_out(&mut self, buffer: &mut [u8]) {
        let Some(connection) = &mut self.connection else { return };
        for _ in 0..LAST_WORDS {
            match connection.receive(buffer) {
                Received::Message(ToBroker::Handed { client, number }, _) => self.logons.handed(client, number),
                Received::Message(ToBroker::Sending { client, ends }, socket) => {
                    self.logons.sending(client, &ends, socket);
                }
                Received::Message(..) => {}
                Received::Nothing | Received::Gone => return,
            }
        }
    }

    /// The process is gone: nothing is copied for it any more.
    pub(crate) fn disconnect(&mut self) {
        self.connection = None;
        self.clients.clear();
        self.logons.process_gone();
        self.connections.clear();
        self.forget(|_| true);
        (self.up, self.events_after, self.awaited, self.postponed) = (false, None, None, None);
        self.generation = self.link.generation().max(self.generation) + 1;
        self.postponed = Some((self.generation, Vec::new()));
        self.watch_postponed();
    }

    fn say(&mut self, message: &ToLink) {
        if let Some(connection) = &mut self.connection {
            connection.say(message);
        }
    }

    pub(crate) fn answer(&mut self, client: u32, ticket: Ticket, answer: Answer) {
        if let Answer::Alarms { after, list, .. } = &answer
            && list.len() > ALARM_PART
        {
            let parts = list.chunks(ALARM_PART);
            let count = parts.len();
            for (index, part) in parts.enumerate() {
                let answer = Answer::Alarms { last: index + 1 == count, after: *after, list: part.to_vec() };
                self.say(&ToLink::News(News::Answer { client, ticket, answer }));
            }
            return;
        }
        let Answer::Document { bytes, .. } = answer else {
            return self.say(&ToLink::News(News::Answer { client, ticket, answer }));
        };
        let parts = bytes.chunks(PART_BYTES).count().max(1);
        for index in 0..parts {
            let part = bytes.chunks(PART_BYTES).nth(index).unwrap_or_default();
            let answer = Answer::Document { last: index + 1 == parts, bytes: part.into() };
            self.say(&ToLink::News(News::Answer { client, ticket, answer }));
        }
    }

    /// An entry for the diagnostic buffer, unless the CPU has not taken as many before.
    pub(crate) fn note(&mut self, note: Ask) {
        if self.notes.len() < RECORDS as usize {
            self.notes.push_back(note);
        }
    }

    /// Packets that wait for the link to take them.
    pub(crate) fn waits(&self) -> usize {
        self.connection.as_ref().map_or(0, Connection::waiting)
    }

    pub(crate) fn written(&mut self, client: u32, ticket: Ticket, outcome: Result<u64, Refused>) {
        self.say(&ToLink::News(News::Written { client, ticket, outcome }));
    }

    /// Another list of pieces, if all of them are allowed.
    pub(crate) fn watch(&mut self, generation: u64, pieces: Vec<Piece>) {
        let allowed = |piece: &Piece| match piece {
            Piece::Bytes { at, .. } => self.config.allowed.has(*at),
            Piece::Value(cell, _) => self.config.allowed.has(*cell),
        };
        let refused: Vec<u32> =
            (0..).zip(&pieces).filter(|(_, piece)| !allowed(piece)).map(|(index, _)| index).collect();
        let fits = ob1_model::fits_a_share(pieces.iter().copied());
        if !refused.is_empty() || !fits || generation <= self.link.generation().max(self.generation) {
            return self.say(&ToLink::Unwatched { generation, refused });
        }
        self.postponed = Some((generation, pieces));
        self.watch_postponed();
    }

    fn watch_postponed(&mut self) {
        let Some((generation, pieces)) = self.postponed.take() else { return };
        let empty = pieces.is_empty();
        match self.link.watch(generation, &Frame::of(pieces.clone())) {
            // An empty list gets no snapshot.
            Ok(()) if empty => self.say(&ToLink::Watching(generation)),
            Ok(()) => self.awaited = Some(generation),
            Err(TooMuch::UnderWay) => self.postponed = Some((generation, pieces)),
            Err(TooMuch::Watch | TooMuch::Group) => {
                self.say(&ToLink::Unwatched { generation, refused: Vec::new() });
            }
        }
    }

    /// Hands jobs over, each client in turn, as long as there is room.
    fn hand_over(&mut self, facts: &dyn Facts, give_up: Instant) {
        while let Some((client, job)) = self.clients.next() {
            self.number += 1;
            let number = self.number;
            let mut give_up = give_up;
            let mut slow = false;
            let (kind, work, job): (_, Work, _) = match job {
                Job::Ask(ticket, asks, wanted) => {
                    let question = Question::new(number, asks.clone());
                    (Kind::Ask(wanted.clone()), question.into(), Job::Ask(ticket, asks, wanted))
                }
                Job::Group(ticket, puts) => {
                    let (mut places, mut left) = (Vec::with_capacity(puts.len()), Vec::with_capacity(puts.len()));
                    for (place, put) in (0..).zip(&puts).filter(|(_, put)| !facts.take_input(put)) {
                        places.push(place);
                        left.push(put.clone());
                    }
                    // The sender has been held to the bounds of a group.
                    let Ok(group) = Group::new(number, left) else { continue };
                    (Kind::Group(places), group.into(), Job::Group(ticket, puts))
                }
                Job::List(ticket, list, index) => {
                    (Kind::List, Listing::new(number, list, index).into(), Job::List(ticket, list, index))
                }
                Job::Alarms(ticket, order) => {
                    // The order has been held to its bounds.
                    let Ok(work) = AlarmJob::new(number, order.clone()) else { continue };
                    (Kind::Alarms, work.into(), Job::Alarms(ticket, order))
                }
                Job::Pass(ticket, order) => {
                    give_up = give_up.saturating_add(Span::from_nanos(order.wait.min(PASS_WAIT)));
                    (Kind::Pass, PassJob::new(number, order).into(), Job::Pass(ticket, order))
                }
                Job::Point(ticket, order) => {
                    let allowed: Vec<bool> =
                        order.items.iter().map(|item| self.config.allowed.has(cell(item))).collect();
                    let items = order.items.iter().zip(&allowed).filter(|(_, allowed)| **allowed);
                    let items = items.map(|(item, _)| item.clone()).collect();
                    (give_up, slow) = (Instant::NEVER, order.stays || order.point == Point::Stop);
                    let work = PointJob::new(number, PointOrder { items, ..order }).into();
                    (Kind::Point(allowed), work, Job::Point(ticket, order))
                }
                Job::Debug(ticket, order) => {
                    if let DebugOrder::Hold { wait, .. } = order {
                        give_up = give_up.saturating_add(Span::from_nanos(wait.min(PASS_WAIT)));
                    }
                    (Kind::Debug, DebugJob::new(number, order.clone()).into(), Job::Debug(ticket, order))
                }
            };
            let ticket = job.ticket();
            let is_full = self.link.hand(work).is_err();
            match job {
                _ if !is_full => {}
                // Whoever asks a CPU that does not answer is told so, although there is no room to ask it.
                Job::Group(..) if self.silent => {
                    self.written(client, ticket, Err(Refused { entry: 0, why: Refusal::Silent }));
                    continue;
                }
                _ if self.silent => {
                    self.answer(client, ticket, Answer::Refused(Refusal::Silent));
                    continue;
                }
                job => return self.clients.put_back(client, job),
            }
            self.fresh = true;
            let armed = kind.is_armed();
            self.out.insert(number, Out { client, ticket, kind, slow, give_up });
            if let Some(client) = self.clients.known(client) {
                *(if armed { &mut client.armed } else { &mut client.out }) += 1;
            }
        }
    }

    /// What the scan has given back.
    fn take_back(&mut self, facts: &dyn Facts) {
        while let Some(returned) = self.link.take() {
            self.silent = false;
            match returned {
                Work::Question(question) => {
                    let Some(out) = self.done(question.id()) else { continue };
                    let Kind::Ask(wanted) = out.kind else { continue };
                    self.answered.push((out.client, out.ticket, wanted, question.answers().to_vec()));
                }
                Work::Group(group) => {
                    let Some(out) = self.done(group.id()) else { continue };
                    let outcome = group.outcome().map(|()| group.scan()).map_err(|(entry, error)| {
                        let place = if let Kind::Group(places) = &out.kind { places.get(entry) } else { None };
                        Refused { entry: place.copied().unwrap_or(0), why: Refusal::Cell(error) }
                    });
                    self.written(out.client, out.ticket, outcome);
                }
                Work::List(listing) => {
                    let Some(out) = self.done(listing.id()) else { continue };
                    let answer = match listing.found() {
                        Ok((record, bytes)) => {
                            let mut bytes: Box<[u8]> = bytes.into();
                            if listing.tells_protection() {
                                put_checksums(&mut bytes, facts.checksums());
                            }
                            Answer::Szl { record, bytes }
                        }
                        Err(error) => Answer::NoSzl(error.code()),
                    };
                    self.answer(out.client, out.ticket, answer);
                }
                Work::Alarms(job) => {
                    let Some(out) = self.done(job.id()) else { continue };
                    let (list, after) = job.list();
                    let answer = match job.found() {
                        Some(found) => Answer::Ordered(found.to_vec()),
                        None => Answer::Alarms { last: true, after, list: list.to_vec() },
                    };
                    self.answer(out.client, out.ticket, answer);
                }
                Work::Pass(job) => {
                    let Some(out) = self.done(job.id()) else { continue };
                    self.answer(out.client, out.ticket, Answer::Pass(job.into_pass()));
                }
                Work::Debug(job) => {
                    let Some(out) = self.done(job.id()) else { continue };
                    let mut answer = job.into_answer();
                    // Only links speak of machine code; whoever steps through blocks here does not pay for it.
                    let is_link = !self.config.name.is_empty();
                    for block in answer.held.stack.iter_mut().filter(|_| is_link) {
                        block.address = facts.address(block.block, block.statement);
                    }
                    self.answer(out.client, out.ticket, Answer::Debug(answer));
                }
                Work::Point(job) => {
                    let Some(out) = self.done(job.id()) else { continue };
                    let Kind::Point(allowed) = &out.kind else { continue };
                    let mut outcomes = job.outcomes();
                    let mut of = |allowed: &bool| match allowed {
                        true => Some(outcomes.next()?.map(Into::into).map_err(Refusal::Cell)),
                        false => Some(Err(Refusal::Right)),
                    };
                    // Forgotten before its point came: it has no outcomes.
                    let all: Option<Vec<_>> = allowed.iter().map(&mut of).collect();
                    let answer = match job.is_full() {
                        true => Answer::Refused(Refusal::Full),
                        false => Answer::Point(all.unwrap_or_default()),
                    };
                    self.answer(out.client, out.ticket, answer);
                }
            }
        }
    }

    /// A client wants this pass or point no more; it is answered with what there is of it.
    pub(crate) fn forget_armed(&mut self, client: u32, ticket: Ticket) {
        let out = self.out.iter().find(|(_, out)| (out.client, out.ticket) == (client, ticket) && out.kind.is_armed());
        self.forgotten.extend(out.map(|(number, _)| *number));
        if self.clients.known(client).is_some_and(|client| client.forget(ticket)) {
            self.answer(client, ticket, Answer::Pass(Pass::default()));
        }
    }

    /// Drops what is under way for these clients. The scan is told of passes and points, so that their places are free
    /// again.
    fn forget(&mut self, gone: impl Fn(u32) -> bool) {
        // Without its owner a CPU in HOLD goes to STOP.
        if self.debugger.take_if(|client| gone(*client)).is_some() {
            self.debugger_gone = true;
        }
        let forgotten = &mut self.forgotten;
        self.out.retain(|number, out| {
            let stays = !gone(out.client);
            if !stays && out.kind.is_armed() {
                forgotten.push(*number);
            }
            stays
        });
    }

    fn done(&mut self, number: u64) -> Option<Out> {
        let out = self.out.remove(&number)?;
        if let Some(client) = self.clients.known(out.client) {
            let count = if out.kind.is_armed() { &mut client.armed } else { &mut client.out };
            *count = count.saturating_sub(1);
        }
        Some(out)
    }

    /// Nobody sets breakpoints any more. The CPU is told before anything of the next one who does.
    pub(crate) fn end_debugging(&mut self) {
        self.debugger_gone |= self.debugger.take().is_some();
    }

    /// Whether somebody else than this client sets breakpoints.
    pub(crate) fn is_debugged(&self, but: Option<u32>) -> bool {
        self.debugger_gone || self.debugger.is_some() && self.debugger != but
    }

    /// A client is gone: its answers are dropped.
    pub(crate) fn client_gone(&mut self, number: u32) {
        self.clients.gone(number);
        self.logons.gone(number);
        self.forget(|client| client == number);
    }

    /// Everything that can be done now, in the broker's watched time.
    pub(crate) fn step(&mut self, facts: &dyn Facts, now: Instant, answer_time: Span) {
        self.watch_postponed();
        // First what has come back: a write's answer never overtakes its snapshot.
        self.take_back(facts);
        if let Some(generation) = self.awaited
            && self.window.newest().is_some_and(|head| head.generation >= generation)
        {
            self.awaited = None;
            self.say(&ToLink::Watching(generation));
        }
        while let Some(note) = self.notes.front()
            && self.link.hand(Question::new(0, vec![*note])).is_ok()
        {
            self.notes.pop_front();
        }
        while let Some(number) = self.forgotten.pop() {
            if self.link.forget(number).is_err() {
                self.forgotten.push(number);
                break;
            }
        }
        if self.debugger_gone {
            self.number += 1;
            self.debugger_gone = self.link.hand(DebugJob::new(self.number, DebugOrder::End)).is_err();
        }
        self.hand_over(facts, now.saturating_add(answer_time));
        let silent: Vec<u64> = self.out.iter().filter(|(_, out)| now >= out.give_up).map(|(n, _)| *n).collect();
        for number in silent {
            self.silent = true;
            match self.done(number) {
                Some(out) if matches!(out.kind, Kind::Group(_)) => {
                    self.written(out.client, out.ticket, Err(Refused { entry: 0, why: Refusal::Silent }));
                }
                Some(out) => self.answer(out.client, out.ticket, Answer::Refused(Refusal::Silent)),
                None => {}
            }
        }
    }
}

/// The CPU does not know these: programming devices see by them that the program has changed.
fn put_checksums(record: &mut [u8], sums: [u32; 2]) {
    let places = record.get_mut(SUMS_AT..).unwrap_or_default().as_chunks_mut::<4>().0;
    places.iter_mut().zip(sums).for_each(|(place, sum)| *place = sum.to_be_bytes());
}
