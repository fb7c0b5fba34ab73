//! The broker itself: takes requests of links, carries out what is allowed, and reports the outcome.

use std::collections::BTreeMap;
use std::io;
use std::os::fd::OwnedFd;
use std::time::{self, Duration};

use ob1_access::door::{Answer, Ask, Document, MESSAGE_BYTES, Refusal, Refused, State, Ticket, ToBroker, What};
use ob1_backplane::WindowReader;
use ob1_cpu::{Answer as CpuAnswer, Ask as CpuAsk, Command, Cpu, DIAG_ENTRIES, DIAG_STOPS, ForceStep, ShortText};
use ob1_model::{DebugAnswer, DebugEnd, DebugOrder, Event, PointItem, StateChange};
use ob1_time::{Instant, Span, WatchedTime};
use rustix::event::{PollFd, PollFlags, Timespec, poll};

use crate::alarms::Changes;
use crate::client::{Job, Wanted};
use crate::connection::Received;
use crate::events::Stream;
use crate::joint::Joint;
use crate::rights::{list, may_force, may_touch, word};
use crate::{Beats, Change, DriverState, Facts, FeedEnd, LinkConfig};

/// How long the CPU may take to answer, beyond two cycles. It answers once a cycle; this is for one that hangs.
const ANSWER_TIME: Span = Span::from_secs(3);
/// Of a longer gap between two steps only this much counts as silence of the CPU.
const GAP: Span = Span::from_millis(100);
/// Pause between two looks while the scan has something to answer, and while it has not.
const LOOK: Span = Span::from_micros(200);
const IDLE_LOOK: Span = Span::from_millis(20);
/// After this many looks without an answer of the scan, the broker looks less often.
const PATIENT_LOOKS: u32 = 500;
/// Messages of one link that are taken before the next link's turn.
const MESSAGES: usize = 64;
/// Connections of a link that are kept.
const CONNECTIONS: usize = 256;
/// Longest name of a partner, in bytes: an address and a port.
const PARTNER: usize = 64;
/// Packets that may wait for a link while documents are made for it: each can be many.
const DOCUMENTS_WAITING: usize = 256;

/// Who has asked, and so gets the answer.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Asker {
    link: usize,
    client: u32,
    ticket: Ticket,
}

/// The broker of one station: it owns every link's end, and runs on a thread of its own. See [the crate](crate).
pub struct Broker {
    feed: FeedEnd,
    pub(crate) facts: Box<dyn Facts>,
    pub(crate) joints: Vec<Joint>,
    pub(crate) events: Stream,
    pub(crate) alarms: Changes,
    drivers: Vec<DriverState>,
    /// Changes of the program under way, and who waits for them.
    changes: BTreeMap<u64, Asker>,
    change: u64,
    answer_time: Span,
    /// The CPU's time to answer is measured with it.
    watched: WatchedTime,
    looks: u32,
    buffer: Vec<u8>,
    /// The zero of this thread's time, for what counts in the time of the machine.
    zero: time::Instant,
}

impl std::fmt::Debug for Broker {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Broker").field("joints", &self.joints).finish_non_exhaustive()
    }
}

impl Broker {
    /// The broker of a CPU, with a share of its exchange for each link. `feed` is where its diagnostic entries come.
    ///
    /// # Errors
    /// No shared memory, another broker has the CPU already, or it has no share for so many links.
    pub fn new(cpu: &mut Cpu, links: Vec<LinkConfig>, feed: FeedEnd, facts: Box<dyn Facts>) -> io::Result<Self> {
        let alarms = cpu.alarm_client().ok_or_else(|| io::Error::other("the alarms are taken already"))?;
        let mut joints = Vec::with_capacity(links.len());
        for config in links {
            let joint = Joint::new(cpu, config).map_err(io::Error::other)?;
            joints.push(joint.ok_or_else(|| io::Error::other("more links than the CPU has shares for"))?);
        }
        Ok(Self {
            feed,
            answer_time: ANSWER_TIME.saturating_add(facts.min_cycle().times(2)),
            watched: WatchedTime::new(Instant::START, GAP),
            drivers: facts.drivers(),
            facts,
            joints,
            changes: BTreeMap::new(),
            change: 0,
            events: Stream::default(),
            alarms: Changes::new(alarms),
            looks: 0,
            zero: time::Instant::now(),
            buffer: vec![0; MESSAGE_BYTES],
        })
    }

    /// The signs of life of each link, in the order they were given.
    #[must_use]
    pub fn beats(&self) -> Vec<Beats> {
        self.joints.iter().map(|joint| joint.beats.clone()).collect()
    }

    /// The process of a link has been started, with the other end of this socket.
    pub fn connect(&mut self, link: usize, socket: OwnedFd, now: Instant) {
        self.lost(link, now);
        if let Some(joint) = self.joints.get_mut(link) {
            joint.connect(socket, &*self.facts, now);
        }
    }

    fn lost(&mut self, link: usize, now: Instant) {
        let Some(joint) = self.joints.get_mut(link).filter(|joint| joint.connection.is_some()) else { return };
        let was_up = joint.up;
        joint.hear_out(&mut self.buffer);
        joint.disconnect();
        if was_up && !joint.config.name.is_empty() {
            let name = joint.config.name.clone();
            self.events.push(now, What::Link { name, up: false });
        }
    }

    /// Waits until a link says something, `wake` can be read, or it is time to look at the scan.
    pub(crate) fn wait(&mut self, wake: &OwnedFd) {
        let busy = !self.changes.is_empty() || self.joints.iter().any(|joint| !joint.is_idle());
        // What waits for long must not delay what was asked now.
        let fresh = self.joints.iter_mut().fold(false, |any, joint| any | std::mem::take(&mut joint.fresh));
        self.looks = if busy && !fresh { self.looks.saturating_add(1) } else { 0 };
        let time = if busy && self.looks < PATIENT_LOOKS { LOOK } else { IDLE_LOOK };
        let timeout = Timespec { tv_sec: 0, tv_nsec: time.nanos() as i64 };
        let mut fds = vec![PollFd::new(wake, PollFlags::IN)];
        fds.extend(self.joints.iter().filter_map(|joint| joint.connection.as_ref()).map(|connection| {
            let flags = if connection.wants_write() { PollFlags::IN | PollFlags::OUT } else { PollFlags::IN };
            PollFd::from_borrowed_fd(connection.fd(), flags)
        }));
        // An interrupted poll is a short sleep.
        let _ = poll(&mut fds, Some(&timeout));
    }

    /// Everything that can be done now. Waits for nobody.
    pub fn step(&mut self, now: Instant) {
        let watched = self.watched.look(now);
        for link in 0..self.joints.len() {
            self.listen(link, now);
        }
        self.watch_station(now);
        self.watch_alarms(now);
        self.tell_changes();
        self.tell_logins(now);
        for link in 0..self.joints.len() {
            if let Some(joint) = self.joints.get_mut(link) {
                joint.step(&*self.facts, watched, self.answer_time);
                for (client, ticket, wanted, answers) in std::mem::take(&mut joint.answered) {
                    let answer = self.outcome(wanted, &answers);
                    self.answer(Asker { link, client, ticket }, answer);
                }
            }
            self.tell_events(link);
            self.tell_alarms(link);
            let gone = self.joints.get_mut(link).and_then(|joint| {
                let connection = joint.connection.as_mut()?;
                connection.flush(now);
                Some((connection.gone()?, joint.config.name.clone()))
            });
            if let Some((why, name)) = gone {
                // A connection without a name is part of the runtime and ends with it: that is no news.
                if !name.is_empty() {
                    tracing::info!(link = %name, "dropped: {why}");
                }
                self.lost(link, now);
            }
        }
    }

    /// What a client is told of the answers of the CPU.
    fn outcome(&mut self, wanted: Wanted, answers: &[CpuAnswer]) -> Answer {
        let told = self.told(answers);
        match (wanted, told) {
            (Wanted::Status, Answer::Modules { state, present }) => self.document(Document::Status, state, &present),
            (Wanted::Forced(cells), Answer::Done) => {
                self.facts.force(cells);
                Answer::Done
            }
            (_, told) => told,
        }
    }

    /// Reports changes of the program that have ended.
    fn tell_changes(&mut self) {
        while let Some((number, outcome)) = self.facts.changed() {
            let Some(asker) = self.changes.remove(&number) else { continue };
            self.uncount(asker);
            self.answer(asker, outcome.map_or_else(Answer::Refused, |()| Answer::Done));
        }
    }

    /// Looks at passwords that have waited.
    fn tell_logins(&mut self, now: Instant) {
        for link in 0..self.joints.len() {
            while let Some((client, ticket, is_right)) =
                self.joints.get_mut(link).and_then(|joint| joint.clients.logged_in(&joint.config, now))
            {
                if !is_right {
                    self.record(link, client, "password", "wrong", now);
                }
                let answer = if is_right { Answer::Done } else { Answer::Refused(Refusal::Password) };
                self.answer(Asker { link, client, ticket }, answer);
            }
        }
    }

    /// Records what a partner does, in the log, the diagnostic buffer and the audit log.
    fn record(&mut self, link: usize, client: u32, what: &str, outcome: &str, now: Instant) {
        let Some(joint) = self.joints.get_mut(link) else { return };
        let Some(partner) = joint.clients.known(client).map(|client| client.partner.clone()) else { return };
        if partner.is_empty() || !joint.records.take(self.zero + Duration::from(now.since_start())) {
            return;
        }
        let link = joint.config.name.clone();
        let left_out = match joint.records.left_out() {
            0 => String::new(),
            count => format!(" ({count} more before it)"),
        };
        let outcome = format!("{outcome}{left_out}");
        tracing::warn!(link, "{partner}: {what}: {outcome}");
        let text = ShortText::new(&format!("{link}, {partner}: {what}: {outcome}"));
        joint.note(CpuAsk::Note(Event::PARTNER, text));
        self.facts.record(&link, &partner, what, &outcome);
    }

    /// Has the program changed; the answer comes when it has taken effect.
    fn begin_change(&mut self, asker: Asker, change: Change) -> Result<Option<Answer>, Refusal> {
        self.change += 1;
        if !self.facts.change(self.change, change) {
            return Err(Refusal::NotThere);
        }
        self.changes.insert(self.change, asker);
        Ok(None)
    }

    /// Takes messages of a link, up to a bound.
    fn listen(&mut self, link: usize, now: Instant) {
        let mut buffer = std::mem::take(&mut self.buffer);
        for _ in 0..MESSAGES {
            let Some(joint) = self.joints.get_mut(link) else { break };
            let Some(connection) = joint.connection.as_mut() else { break };
            match connection.receive(&mut buffer) {
                Received::Message(message, descriptor) => {
                    joint.beats.beat();
                    if !std::mem::replace(&mut joint.up, true) && !joint.config.name.is_empty() {
                        let name = joint.config.name.clone();
                        self.events.push(now, What::Link { name, up: true });
                    }
                    self.obey(link, message, descriptor, now);
                }
                Received::Nothing | Received::Gone => break,
            }
        }
        self.buffer = buffer;
    }

    fn obey(&mut self, link: usize, message: ToBroker, descriptor: Option<OwnedFd>, now: Instant) {
        let Some(joint) = self.joints.get_mut(link) else { return };
        match message {
            ToBroker::Beat => {}
            ToBroker::Watch { generation, pieces } => joint.watch(generation, pieces),
            ToBroker::Handed { client, number } => joint.logons.handed(client, number),
            ToBroker::Sending { client, ends } => joint.logons.sending(client, &ends, descriptor),
            ToBroker::Gone(client) => joint.client_gone(client),
            ToBroker::Partner { client, mut partner } => {
                partner.truncate(partner.floor_char_boundary(PARTNER));
                if let Some(client) = joint.clients.of(client, &joint.config) {
                    client.partner = partner;
                }
            }
            ToBroker::Connections(mut list) => {
                list.truncate(CONNECTIONS);
                joint.connections = list;
            }
            ToBroker::Write { client, ticket, puts } => {
                let bytes: usize = puts.iter().map(ob1_access::Put::bytes).sum();
                let too_much = puts.len() > ob1_cpu::GROUP_ENTRIES || bytes > ob1_cpu::WRITE_BYTES;
                let refuse = |why| Refused { entry: 0, why };
                let taken = match joint.clients.of(client, &joint.config) {
                    _ if too_much => Err(refuse(Refusal::Full)),
                    None => Err(refuse(Refusal::Full)),
                    Some(known) => known
                        .may_write(&puts, &joint.config)
                        .and_then(|()| known.take(Job::Group(ticket, puts)).map_err(refuse)),
                };
                if let Err(refused) = taken {
                    joint.written(client, ticket, Err(refused));
                }
            }
            ToBroker::Ask { client, ticket, ask } => {
                let asker = Asker { link, client, ticket };
                match self.ask(asker, ask, now) {
                    Ok(None) => {}
                    Ok(Some(answer)) => self.answer(asker, answer),
                    Err(refusal) => self.answer(asker, Answer::Refused(refusal)),
                }
            }
        }
    }

    fn answer(&mut self, asker: Asker, answer: Answer) {
        if let Some(joint) = self.joints.get_mut(asker.link) {
            joint.answer(asker.client, asker.ticket, answer);
        }
    }

    /// The answer, if it can be given at once.
    fn ask(&mut self, asker: Asker, ask: Ask, now: Instant) -> Result<Option<Answer>, Refusal> {
        let joint = self.joints.get_mut(asker.link).ok_or(Refusal::NotThere)?;
        let waits = joint.waits();
        let client = joint.clients.of(asker.client, &joint.config).ok_or(Refusal::Full)?;
        let mut wanted = Wanted::Told;
        let asks: Vec<CpuAsk> = match ask {
            Ask::Login(password) => {
                joint.clients.login((asker.client, asker.ticket), password, &joint.config, now)?;
                return Ok(None);
            }
            Ask::Logout => {
                client.right = joint.config.rights;
                return Ok(Some(Answer::Done));
            }
            Ask::Szl { id, index } => {
                client.take(Job::List(asker.ticket, id, index))?;
                return Ok(None);
            }
            Ask::Pass(order) => {
                may_touch(order.block, &joint.config)?;
                client.take(Job::Pass(asker.ticket, order))?;
                return Ok(None);
            }
            Ask::Debug(order @ DebugOrder::Stack { .. }) => {
                if !joint.config.allowed.has_program() {
                    return Err(Refusal::Right);
                }
                client.take(Job::Debug(asker.ticket, order))?;
                return Ok(None);
            }
            Ask::Debug(order) => {
                client.may_operate()?;
                if let DebugOrder::Breakpoints(list) = &order {
                    list.iter().try_for_each(|breakpoint| may_touch(breakpoint.block, &joint.config))?;
                }
                let mine = |index: usize| (index == asker.link).then_some(asker.client);
                if self.joints.iter().enumerate().any(|(index, joint)| joint.is_debugged(mine(index))) {
                    return Err(Refusal::Full);
                }
                let joint = self.joints.get_mut(asker.link).ok_or(Refusal::NotThere)?;
                let told = word(&order);
                let ended = order == DebugOrder::End;
                if ended {
                    joint.end_debugging();
                } else {
                    let client = joint.clients.of(asker.client, &joint.config).ok_or(Refusal::Full)?;
                    client.take(Job::Debug(asker.ticket, order))?;
                    joint.debugger = Some(asker.client);
                }
                if let Some(told) = told {
                    self.record(asker.link, asker.client, told, "taken", now);
                }
                let done = Answer::Debug(DebugAnswer { end: DebugEnd::Done, ..DebugAnswer::default() });
                return Ok(ended.then_some(done));
            }
            Ask::Point(order) => {
                if order.stays || order.items.iter().any(|item| matches!(item, PointItem::Write(_))) {
                    client.may_operate()?;
                }
                let bytes: usize = order
                    .items
                    .iter()
                    .map(|item| match item {
                        PointItem::Read(piece) => piece.len() as usize,
                        PointItem::Write(put) => put.bytes(),
                    })
                    .sum();
                if order.items.len() > ob1_cpu::GROUP_ENTRIES || bytes > ob1_cpu::WRITE_BYTES {
                    return Err(Refusal::Full);
                }
                client.take(Job::Point(asker.ticket, order))?;
                return Ok(None);
            }
            Ask::Forget(ticket) => {
                joint.forget_armed(asker.client, ticket);
                return Ok(Some(Answer::Done));
            }
            Ask::Addresses { block, wanted } => {
                may_touch(block, &joint.config)?;
                let found = self.facts.addresses(block, &wanted).ok_or(Refusal::NotThere)?;
                return Ok(Some(Answer::Addresses(found)));
            }
            Ask::LogOn { displays, name } => {
                let logon = (name, client.partner.as_str());
                let after = joint.logons.log_on(asker.client, displays, logon, self.alarms.newest());
                let after = after.ok_or(Refusal::Full)?;
                return Ok(Some(if displays.0 == 0 { Answer::Done } else { Answer::LoggedOn { after } }));
            }
            Ask::Alarms(order) => {
                let told = order.words();
                client.may_order(&order)?;
                client.take(Job::Alarms(asker.ticket, order))?;
                if let Some(told) = told {
                    self.record(asker.link, asker.client, &told, "taken", now);
                }
                return Ok(None);
            }
            Ask::Forced => return Ok(Some(Answer::Forced(self.facts.forced()))),
            Ask::Force(cells) => {
                client.may_operate()?;
                cells.iter().try_for_each(|cell| may_force(cell, &joint.config))?;
                let told: Vec<String> = cells.iter().map(ToString::to_string).collect();
                let what =
                    if told.is_empty() { "end forcing".to_owned() } else { format!("force {}", told.join(", ")) };
                self.record(asker.link, asker.client, &what, "taken", now);
                let adds = cells.iter().map(|cell| CpuAsk::Force(ForceStep::Add(*cell)));
                let first = [CpuAsk::Force(ForceStep::New)].into_iter();
                let asks = first.chain(adds).chain([CpuAsk::Force(ForceStep::Take)]).collect();
                wanted = Wanted::Forced(cells);
                asks
            }
            Ask::Blocks => return Ok(Some(Answer::Blocks(self.facts.blocks()))),
            Ask::Block(id) => {
                may_touch(id, &joint.config)?;
                let block = self.facts.block(id).filter(|bytes| bytes.len() + 64 < MESSAGE_BYTES);
                return block.map(|bytes| Some(Answer::Block(bytes))).ok_or(Refusal::NotThere);
            }
            Ask::Events { after } => {
                joint.events_after = Some(if after == u64::MAX { self.events.newest() } else { after });
                return Ok(Some(Answer::Done));
            }
            Ask::NoEvents => {
                joint.events_after = None;
                return Ok(Some(Answer::Done));
            }
            Ask::Document(_) if waits >= DOCUMENTS_WAITING => return Err(Refusal::Full),
            Ask::Document(which) if which != Document::Status => {
                return Ok(Some(self.document(which, State::Stop, &[])));
            }
            Ask::Command(command) => {
                client.may_operate()?;
                self.check(command)?;
                self.record(asker.link, asker.client, command.name(), "taken", now);
                vec![CpuAsk::Command(command)]
            }
            Ask::Stage { id, bytes } => {
                client.may_operate()?;
                let allowed = may_touch(id, &joint.config);
                let client = joint.clients.of(asker.client, &joint.config).ok_or(Refusal::Full)?;
                let staged = allowed.and_then(|()| client.stage(id, bytes));
                // What belongs together comes in together: the blocks before this one go with it.
                if staged.is_err() {
                    drop(client.take_staged());
                }
                return staged.map(|()| Some(Answer::Done));
            }
            Ask::Link => {
                client.may_operate()?;
                client.count()?;
                let blocks = client.take_staged();
                let what = format!("load {}", list(blocks.iter().map(|(id, _)| *id)));
                self.record(asker.link, asker.client, &what, "taken", now);
                return self.begin_change(asker, Change::Link(blocks)).inspect_err(|_| self.uncount(asker));
            }
            Ask::Delete(ids) => {
                client.may_operate()?;
                ids.iter().try_for_each(|id| may_touch(*id, &joint.config))?;
                joint.clients.of(asker.client, &joint.config).ok_or(Refusal::Full)?.count()?;
                self.record(asker.link, asker.client, &format!("delete {}", list(ids.iter().copied())), "taken", now);
                return self.begin_change(asker, Change::Delete(ids)).inspect_err(|_| self.uncount(asker));
            }
            Ask::SetClock(clock) => {
                client.may_operate()?;
                self.record(asker.link, asker.client, "set the clock", "taken", now);
                vec![CpuAsk::SetClock(clock)]
            }
            Ask::Clock => vec![CpuAsk::Clock],
            Ask::Diagnostics(count) => {
                let count = u32::from(count).min((DIAG_ENTRIES + DIAG_STOPS) as u32);
                (0..count).map(CpuAsk::Diag).collect()
            }
            Ask::Modules | Ask::Document(_) => {
                if matches!(ask, Ask::Document(_)) {
                    wanted = Wanted::Status;
                }
                std::iter::once(CpuAsk::State).chain((0..self.facts.modules()).map(CpuAsk::Module)).collect()
            }
        };
        let joint = self.joints.get_mut(asker.link).ok_or(Refusal::NotThere)?;
        let client = joint.clients.of(asker.client, &joint.config).ok_or(Refusal::Full)?;
        client.take(Job::Ask(asker.ticket, asks, wanted))?;
        Ok(None)
    }

    fn uncount(&mut self, asker: Asker) {
        if let Some(client) = self.joints.get_mut(asker.link).and_then(|joint| joint.clients.known(asker.client)) {
            client.out = client.out.saturating_sub(1);
        }
    }

    /// Whether this CPU has the command: an S7-300 has no hot restart.
    fn check(&self, command: Command) -> Result<(), Refusal> {
        if command == Command::Hot && self.facts.family() != 400 { Err(Refusal::NotThere) } else { Ok(()) }
    }

    /// Diagnostic entries, changes of state, drivers.
    fn watch_station(&mut self, now: Instant) {
        while let Some(entry) = self.feed.take() {
            self.events.push(entry.time, What::Diagnosis(self.facts.diagnosis(&entry)));
            let state = match entry.event.state_change() {
                Some(StateChange::Startup) => State::Startup,
                Some(StateChange::Run) => State::Run,
                Some(StateChange::Stop | StateChange::Fault) => State::Stop,
                Some(StateChange::Hold) => State::Hold,
                None => continue,
            };
            self.events.push(entry.time, What::State(state));
        }
        let drivers = self.facts.drivers();
        if drivers != self.drivers {
            for driver in drivers.iter().filter(|driver| !self.drivers.contains(driver)) {
                self.events.push(now, What::Driver { name: driver.name.clone(), up: driver.up });
            }
            self.drivers = drivers;
        }
    }

    /// The window of a link, for measurements.
    #[must_use]
    pub fn window(&self, link: usize) -> Option<WindowReader> {
        self.joints.get(link).map(|joint| joint.window().clone())
    }
}
