//! A connection as the CPU sees it: telegrams in, requests to the CPU out, answers back in the order of the jobs.
//!
//! Its owner passes in bytes and replies, and takes requests and bytes. It tolerates missing, short or wrong input at
//! any moment.

mod alarms;
mod ask;
mod control;
mod cyclic;
mod dispatch;
mod job;
mod lists;
mod load;
mod long;
mod messages;
mod partner;
mod passwords;
mod service;
mod test_functions;
mod test_jobs;
mod var;

use std::collections::VecDeque;

pub use ask::{Access, Ask, CodePlaces, Control, CpuEvent, Listed, Loaded, Put, Reply, Request};
pub use lists::{OPERATING_STATE, STATE_AT};

use crate::iso::{Broken, Call, Event, Refusal, Transport};
use crate::wire::{BlockType, MAX_TELEGRAM};
use crate::{MAX_JOBS, MAX_PDU, Rights};

/// While this many bytes wait to be sent, no more input is accepted.
const OUTPUT: usize = 64 * 1024;

/// The rights of a connection, and its limits for the setup.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Settings {
    /// Largest PDU that is agreed to, in bytes.
    pub pdu: u16,
    /// Maximum of outstanding jobs.
    pub jobs: u16,
    /// Rights without a password.
    pub rights: Rights,
    /// There is a password.
    pub has_password: bool,
    /// Maximum number of connections in total.
    pub connections: u16,
    /// The CPU is an S7-400.
    pub is_400: bool,
}

impl Default for Settings {
    fn default() -> Self {
        Self { pdu: 960, jobs: MAX_JOBS, rights: Rights::Read, has_password: false, connections: 1, is_400: false }
    }
}

/// Counters of a connection.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Jobs and services of the partner.
    pub jobs: u64,
    /// Jobs refused as a whole.
    pub errors: u64,
    /// Messages dropped because the partner does not read.
    pub lost: u64,
}

/// Why a connection has ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum End {
    /// The partner has ended it, or it was refused.
    Closed,
    /// The received bytes were not ISO transport.
    Broken(Broken),
    /// The received telegram was not S7 communication.
    NotS7,
    /// Too many wrong passwords.
    Passwords,
}

/// How to turn a reply into an answer.
#[derive(Debug)]
enum Then {
    Read(Vec<var::ReadItem>),
    Write(Vec<var::Slot>),
    Service(service::Service),
    Control(u8),
    Upload,
}

/// A running job: it waits for the CPU, or for the jobs before it.
#[derive(Debug)]
struct Job {
    id: u64,
    reference: u16,
    then: Option<Then>,
    /// Telegrams of the answer.
    answer: Vec<Vec<u8>>,
}

/// The result of a job's first evaluation.
#[derive(Debug)]
enum Step {
    /// An answer at once.
    Answer(Vec<u8>),
    /// The CPU must be asked first.
    Ask(Ask, Then),
    /// Nothing: the partner expects no answer.
    Silence,
}

/// The result of the setup.
#[derive(Clone, Copy, Debug)]
struct Agreed {
    pdu: usize,
    /// Jobs of the partner that may be outstanding.
    jobs: usize,
    /// Jobs of ours, if the partner is a CPU too.
    own: usize,
}

/// A connection of a partner, from its call on.
#[derive(Debug)]
pub struct Connection {
    transport: Transport,
    settings: Settings,
    rights: Rights,
    call: Option<Call>,
    agreed: Option<Agreed>,
    /// Jobs of the partner, in order.
    queue: VecDeque<Job>,
    /// Requests without a job of the partner: cyclic data.
    aside: Vec<Job>,
    asks: VecDeque<Request>,
    /// What a job asks the CPU for next, instead of being answered.
    follows: Option<(Ask, Then)>,
    next: u64,
    wrong_passwords: u8,
    long: long::LongAnswers,
    loads: load::Loads,
    cyclic: cyclic::Cyclic,
    tests: test_jobs::TestJobs,
    subscribed: messages::Subscribed,
    partner: Option<partner::Partner>,
    counts: Counts,
    end: Option<End>,
}

impl Connection {
    /// A connection whose partner has not called yet.
    #[must_use]
    pub fn new(settings: Settings) -> Self {
        Self {
            transport: Transport::new(),
            settings: Settings { pdu: settings.pdu.min(MAX_PDU), jobs: settings.jobs.clamp(1, MAX_JOBS), ..settings },
            rights: settings.rights,
            call: None,
            agreed: None,
            queue: VecDeque::new(),
            aside: Vec::new(),
            asks: VecDeque::new(),
            follows: None,
            next: 0,
            wrong_passwords: 0,
            long: long::LongAnswers::default(),
            loads: load::Loads::default(),
            cyclic: cyclic::Cyclic::default(),
            tests: test_jobs::TestJobs::default(),
            subscribed: messages::Subscribed::default(),
            partner: None,
            counts: Counts::default(),
            end: None,
        }
    }

    /// Number of bytes that [`Connection::receive`] accepts now; 0 while the CPU or the partner has to catch up.
    #[must_use]
    pub fn room(&self) -> usize {
        if self.end.is_some() || self.is_busy() { 0 } else { self.transport.room() }
    }

    /// Bytes from the wire.
    pub fn receive(&mut self, bytes: &[u8]) {
        if let Err(why) = self.transport.receive(bytes) {
            self.end = Some(End::Broken(why));
        }
        self.advance();
    }

    /// The call that waits for [`Connection::accept`] or [`Connection::refuse`].
    #[must_use]
    pub const fn call(&self) -> Option<&Call> {
        self.call.as_ref()
    }

    /// Accepts the call: the partner may set up S7 communication.
    pub fn accept(&mut self) {
        self.call = None;
        self.transport.accept();
        self.advance();
    }

    /// Refuses the call; the connection ends.
    pub fn refuse(&mut self, why: Refusal) {
        self.call = None;
        self.transport.refuse(why);
        self.end = Some(End::Closed);
    }

    /// The next request to the CPU.
    pub fn next_ask(&mut self) -> Option<Request> {
        self.asks.pop_front()
    }

    /// The CPU's reply to a request. A reply without a request is ignored.
    pub fn reply(&mut self, id: u64, reply: Reply) {
        if let Some(then) = self.queue.iter_mut().find(|job| job.id == id).and_then(|job| job.then.take()) {
            let reference = self.queue.iter().find(|job| job.id == id).map_or(0, |job| job.reference);
            let answer = self.finish(reference, id, then, reply);
            let follows = self.follows.take().map(|(ask, then)| (self.ask(ask), then));
            if let Some(job) = self.queue.iter_mut().find(|job| job.id == id) {
                job.answer.extend(answer);
                if let Some((next, then)) = follows {
                    (job.id, job.then) = (next, Some(then));
                }
            }
            self.flush();
            self.advance();
        } else if let Some(index) = self.aside.iter().position(|job| job.id == id) {
            let job = self.aside.swap_remove(index);
            if let Some(then) = job.then {
                for telegram in self.finish(job.reference, id, then, reply) {
                    self.message(&telegram);
                }
            }
        }
    }

    /// The bytes to send.
    #[must_use]
    pub fn output(&self) -> &[u8] {
        self.transport.output()
    }

    /// Reports that `count` bytes of the output have been sent.
    pub fn sent(&mut self, count: usize) {
        self.transport.sent(count);
        self.advance();
    }

    /// Why the connection has ended: close it when the output has been sent.
    #[must_use]
    pub const fn end(&self) -> Option<End> {
        self.end
    }

    /// The PDU of the setup, once that is done.
    #[must_use]
    pub fn pdu(&self) -> Option<u16> {
        self.agreed.map(|agreed| agreed.pdu as u16)
    }

    /// Number of running jobs.
    #[must_use]
    pub fn under_way(&self) -> usize {
        self.queue.len()
    }

    /// The present rights of the connection.
    #[must_use]
    pub const fn rights(&self) -> Rights {
        self.rights
    }

    /// How many jobs there were, refused ones and lost messages.
    #[must_use]
    pub const fn counts(&self) -> Counts {
        self.counts
    }

    /// Whether it has given a wrong password, and not the right one since.
    #[must_use]
    pub const fn guesses(&self) -> bool {
        self.wrong_passwords > 0
    }

    fn is_busy(&self) -> bool {
        let most = self.agreed.map_or(1, |agreed| agreed.jobs);
        self.queue.len() >= most || self.transport.output().len() >= OUTPUT || self.is_full()
    }

    /// Maximum length of a telegram.
    fn pdu_bytes(&self) -> usize {
        self.agreed.map_or(MAX_TELEGRAM, |agreed| agreed.pdu)
    }

    /// Takes telegrams as long as there is room for their answers.
    fn advance(&mut self) {
        while self.end.is_none() && !self.is_busy() {
            match self.transport.event() {
                Ok(None) => return,
                Ok(Some(Event::Call(call))) => self.call = Some(call),
                Ok(Some(Event::Message(message))) => self.telegram(&message),
                Ok(Some(Event::Open)) => self.opened(),
                Ok(Some(Event::Ended(_))) => self.end = Some(End::Closed),
                Err(why) => self.end = Some(End::Broken(why)),
            }
        }
    }

    /// Puts a job into the queue, and passes its request, if any, to the CPU.
    fn enqueue(&mut self, reference: u16, step: Step) {
        match step {
            Step::Silence => {}
            Step::Answer(answer) if self.queue.is_empty() => self.transport.send(&answer),
            Step::Answer(answer) => {
                self.queue.push_back(Job { id: self.next, reference, then: None, answer: vec![answer] });
                self.next += 1;
            }
            Step::Ask(ask, then) => {
                let id = self.ask(ask);
                self.queue.push_back(Job { id, reference, then: Some(then), answer: Vec::new() });
            }
        }
    }

    fn ask(&mut self, ask: Ask) -> u64 {
        let id = self.next;
        self.next += 1;
        self.asks.push_back(Request { id, ask });
        id
    }

    /// The job that is just being finished asks for this next.
    fn follow(&mut self, ask: Ask, service: service::Service) {
        self.follows = Some((ask, Then::Service(service)));
    }

    /// A request besides the jobs of the partner.
    fn ask_aside(&mut self, ask: Ask, then: Then) -> u64 {
        let id = self.ask(ask);
        self.aside.push(Job { id, reference: 0, then: Some(then), answer: Vec::new() });
        id
    }

    /// Sends the answers that are ready, in the order of the jobs.
    fn flush(&mut self) {
        while self.queue.front().is_some_and(|job| job.then.is_none()) {
            if let Some(job) = self.queue.pop_front() {
                job.answer.iter().for_each(|telegram| self.transport.send(telegram));
            }
        }
    }

    fn takes_messages(&self) -> bool {
        self.transport.output().len() < OUTPUT
    }

    /// Sends an unsolicited telegram; it is dropped if the partner does not read.
    fn message(&mut self, telegram: &[u8]) {
        if self.takes_messages() {
            self.transport.send(telegram);
        } else {
            self.counts.lost += 1;
        }
    }

    /// Builds the answer from a reply.
    fn finish(&mut self, reference: u16, request: u64, then: Then, reply: Reply) -> Vec<Vec<u8>> {
        match then {
            Then::Read(wanted) => vec![var::read_answer(reference, &wanted, reply)],
            Then::Write(slots) => {
                self.cyclic.written();
                vec![var::write_answer(reference, &slots, reply)]
            }
            Then::Control(function) => vec![self.control_answer(reference, function, &reply)],
            Then::Upload => vec![self.upload_answer(reference, reply)],
            Then::Service(service::Service::Test(ending)) => self.test_came(reference, request, ending, reply),
            Then::Service(service::Service::Cyclic { job, sub, wanted }) => {
                vec![self.cyclic_answer((reference, request), (job, sub), &wanted, reply)]
            }
            Then::Service(service::Service::CyclicDue) => self.cyclic_came(request, reply).into_iter().collect(),
            Then::Service(service) => self.service_answer(reference, service, reply),
        }
    }
}

/// The blocks that can be loaded and deleted.
const fn is_loadable(ty: BlockType) -> bool {
    !ty.is_system()
}
