//! Test functions: variable tables and block status of a programming device.
//!
//! A job is set up once and enabled for each result. What it asks the CPU for waits there for its trigger, beside the
//! requests of the connection; the result is a message.

mod breakpoints;
mod force;
mod listed;
mod results;
mod setup;
mod stacks;
mod table;
mod telegrams;
mod watch;

use ob1_model::{Point, Resume, TEST_FUNCTIONS};

use self::breakpoints::{Holds, Stop};
use self::force::{Forcing, is_force};
use self::setup::{Begin, LENGTHS, Setup, Trigger};
use self::telegrams::{MESSAGE, answer, named};
use self::watch::{Seen, Watch};
use super::service::Service;
use super::var::{Slot, addresses};
use super::{Access, Ask, Connection, Control, Put, Reply, Step, Then};
use crate::Rights;
use crate::codes::Code;
use crate::wire::{USERDATA_HEAD, UserData, sub};

/// Jobs of a connection.
const JOBS: usize = 8;
/// The class of a result without a trigger.
const NO_CLASS: u8 = 1;
/// How long the result of a job that ends may still come: a trigger of the cycle does, a STOP does not.
const PATIENCE_MS: u64 = 250;
/// Time to the next attempt when the CPU had no room for a job.
const AGAIN_MS: u64 = 50;

#[derive(Debug)]
enum What {
    Status(Vec<Slot>),
    Modify(Vec<Slot>, Vec<Put>),
    Block(Box<Watch>),
    Stop(Stop),
}

#[derive(Debug)]
struct TestJob {
    id: u8,
    function: u8,
    /// The request that has set it up.
    request: Vec<u8>,
    begin: Begin,
    once: bool,
    trigger: Trigger,
    what: What,
    /// What the CPU has been asked for: it is armed until that comes.
    asked: Option<u64>,
    /// What the CPU writes at each trigger.
    stays: Option<u64>,
    /// Its result has come since it was to be disabled.
    fired: bool,
    /// It is being deleted.
    goes: bool,
    /// There was no room: it is armed again.
    again: bool,
    /// What a pass has given, until it is known that the block is still the same.
    seen: Option<(Code, Vec<u8>)>,
}

/// The test jobs of a connection.
#[derive(Debug, Default)]
pub(super) struct TestJobs {
    jobs: Vec<TestJob>,
    holds: Holds,
    again_ms: Option<u64>,
}

/// How a service ends that has waited for the CPU.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum Ending {
    /// A block status was set up: what lies at its addresses.
    SetUp {
        job: u8,
        service: u8,
    },
    /// The addresses again, behind a pass.
    Places {
        job: u8,
    },
    /// The result of a job.
    Result {
        job: u8,
    },
    /// A job was to be disabled, or deleted.
    Disabled {
        job: u8,
    },
    Deleted {
        job: u8,
    },
    /// A stack; of the local data, which.
    Stack {
        service: u8,
        place: Option<[u8; 2]>,
    },
    /// Local data of another block than the innermost.
    Local {
        level: u8,
    },
    /// Breakpoints have been set for this job, or without it.
    Set {
        job: u8,
        service: u8,
        made: bool,
    },
    Unset {
        job: u8,
        service: u8,
    },
    /// Whether the CPU holds, for a connection without breakpoints.
    Released,
    /// The same, for a service that lets it go on.
    Leaves {
        to: Resume,
    },
    Held,
    /// What is forced is known.
    MayForce(Box<Forcing>),
    Forces(Box<Forcing>),
    ForceEnds,
    /// For a list of jobs, or who reads the job.
    Listed,
    ForcedJob,
    Resets,
    Blinks,
    /// Nothing more to do.
    Nothing,
}

impl Ending {
    /// Results of this job come before the answer.
    const fn is_after(&self, id: u8) -> bool {
        matches!(self, Self::Disabled { job } | Self::Deleted { job } if *job == id)
    }
}

impl TestJob {
    /// Forgets what it has asked for; `None`: nothing.
    fn last_ask(&self) -> Option<Ask> {
        let patience = match (self.asked, self.trigger) {
            (None, _) | (_, Trigger::Point(Point::Stop)) => 0,
            _ => PATIENCE_MS,
        };
        Some(Ask::Forget { request: self.asked.or(self.stays)?, patience })
    }
}

impl TestJobs {
    fn find(&mut self, id: u8) -> Option<&mut TestJob> {
        self.jobs.iter_mut().find(|job| job.id == id)
    }

    /// The lowest free number: each service is a job too while it is served.
    fn free(&self) -> u8 {
        (1..=u8::MAX).find(|id| self.jobs.iter().all(|job| job.id != *id)).unwrap_or(u8::MAX)
    }

    pub(super) const fn next_tick(&self) -> Option<u64> {
        self.again_ms
    }

    /// Whether the partner waits for a result.
    pub(super) fn wait(&self) -> bool {
        self.holds.wait() || self.jobs.iter().any(|job| job.asked.is_some() || job.again)
    }
}

impl Connection {
    pub(super) fn test(&mut self, reference: u16, service: &UserData<'_>) -> Step {
        let made = match service.sub {
            _ if !TEST_FUNCTIONS.contains(&service.sub) => Err(Code::TEST_FUNCTION),
            sub::TEST_ISTACK | sub::TEST_BSTACK | sub::TEST_LSTACK => self.stack(service),
            function if is_force(function) => self.force(function, function, service.data),
            sub::TEST_LEAVE_HOLD => self.leave_hold(service),
            sub::TEST_RESET if !self.may(Rights::Operate) => Err(Code::TEST_PROTECTED),
            sub::TEST_RESET => Ok(Self::later(Ask::Control(Control::Reset), Service::Test(Ending::Resets))),
            sub::TEST_STATUS | sub::TEST_MODIFY | sub::TEST_BLOCK | sub::TEST_OLD_BLOCK | sub::TEST_BREAKPOINT => {
                let id = self.tests.free();
                self.set_up(reference, service.sub, service.sub, id, service.data)
            }
            sub::TEST_ENABLE | sub::TEST_DISABLE | sub::TEST_DELETE => self.change(reference, service),
            sub::TEST_LIST => Ok(Self::later(Ask::Forced, Service::Test(Ending::Listed))),
            sub::TEST_READ => self.read_job(reference, service),
            sub::TEST_REPLACE => self.replace(reference, service),
            _ => Ok(Self::later(Ask::Blink, Service::Test(Ending::Blinks))),
        };
        made.unwrap_or_else(|why| Step::Answer(self.test_refused(reference, service.sub, why)))
    }

    fn test_refused(&mut self, reference: u16, function: u8, why: Code) -> Vec<u8> {
        self.counts.errors += 1;
        answer(reference, function, self.tests.free(), why, &[])
    }

    fn test_done(&self, reference: u16, function: u8) -> Vec<u8> {
        answer(reference, function, self.tests.free(), Code::DONE, &[])
    }

    /// Enables, disables or deletes the job that the service names.
    fn change(&mut self, reference: u16, service: &UserData<'_>) -> Result<Step, Code> {
        let name = named(service)?;
        if is_force(name.0) && name.1 == force::NUMBER {
            return if service.sub == sub::TEST_DELETE { self.end_forcing() } else { Err(Code::TEST_ALWAYS) };
        }
        let id = self.known_job(name, Code::TEST_JOB)?;
        if let Some(is_set) = self.is_set(id) {
            let (job, sub) = (id, service.sub);
            let ending = match sub {
                sub::TEST_ENABLE => Ending::Set { job, service: sub, made: false },
                _ if is_set => Ending::Unset { job, service: sub },
                sub::TEST_DISABLE => return Err(Code::TEST_JOB),
                _ => {
                    self.tests.jobs.retain(|other| other.id != job);
                    return Ok(Step::Answer(self.test_done(reference, sub)));
                }
            };
            return Ok(Self::later(self.set(job, sub == sub::TEST_ENABLE)?, Service::Test(ending)));
        }
        match service.sub {
            sub::TEST_DISABLE => self.disable(reference, id),
            sub::TEST_DELETE => Ok(self.delete(reference, id)),
            _ => {
                self.arm(id);
                Ok(Step::Answer(self.test_done(reference, service.sub)))
            }
        }
    }

    /// The job of this function and number, or `why` there is none.
    fn known_job(&self, (function, number): (u8, u8), why: Code) -> Result<u8, Code> {
        let known = self.tests.jobs.iter().any(|job| (job.function, job.id) == (function, number) && !job.goes);
        if known { Ok(number) } else { Err(why) }
    }

    /// Sets a job up, or another one in its place.
    fn set_up(&mut self, reference: u16, service: u8, function: u8, id: u8, request: &[u8]) -> Result<Step, Code> {
        let setup = Setup::read(function, request)?;
        let (what, length) = match (function, setup.trigger) {
            (sub::TEST_STATUS, _) => {
                let (slots, length) = table::status(setup.data)?;
                (What::Status(slots), length)
            }
            (sub::TEST_MODIFY, _) if !self.may(Rights::Operate) => return Err(Code::TEST_PROTECTED),
            (sub::TEST_MODIFY, _) => {
                let (slots, puts, length) = table::modify(setup.data)?;
                (What::Modify(slots, puts), length)
            }
            (sub::TEST_BREAKPOINT, _) if !self.may(Rights::Operate) => return Err(Code::TEST_PROTECTED),
            (sub::TEST_BREAKPOINT, _) => (What::Stop(Stop::read(&setup)?), breakpoints::RESULT),
            (_, trigger) => {
                let called = trigger == Trigger::Code { called: true };
                let (watch, length) = Watch::read(function, &setup, called)?;
                (What::Block(Box::new(watch)), length)
            }
        };
        let is_table = matches!(what, What::Status(_) | What::Modify(..));
        if is_table && !setup.more.is_empty() {
            return Err(Code::TEST_SYNTAX);
        }
        // A client reserves as much as the result has, or more for lines that may not come.
        if setup.result != length && (is_table || setup.result < length) {
            return Err(Code::TEST_RESULT);
        }
        if USERDATA_HEAD + LENGTHS + MESSAGE + length > self.pdu_bytes() {
            return Err(Code::PDU_SIZE);
        }
        let mut job = TestJob {
            id,
            function,
            request: request.to_vec(),
            begin: setup.begin,
            once: setup.once,
            trigger: setup.trigger,
            what,
            asked: None,
            stays: None,
            fired: false,
            goes: false,
            again: false,
            seen: None,
        };
        let code = match &job.what {
            What::Block(watch) => Some(Ask::Code { block: watch.block(), wanted: watch.wanted() }),
            What::Stop(stop) => Some(stop.ask()),
            What::Status(_) | What::Modify(..) => None,
        };
        // It cannot be enabled before its addresses are known.
        job.goes = code.is_some();
        let later = code.map(|ask| Self::later(ask, Service::Test(Ending::SetUp { job: id, service })));
        let is_full = self.tests.jobs.len() >= JOBS;
        match self.tests.find(id) {
            Some(old) => {
                let old = std::mem::replace(old, job);
                self.forget(&old);
            }
            None if is_full => return Err(Code::TEST_FULL),
            None => self.tests.jobs.push(job),
        }
        Ok(later.unwrap_or_else(|| {
            self.begin(id);
            Step::Answer(self.set_up_answer(reference, service, id))
        }))
    }

    /// The answer to a set-up has the number of the job.
    fn set_up_answer(&self, reference: u16, service: u8, id: u8) -> Vec<u8> {
        let number = if service == sub::TEST_REPLACE { self.tests.free() } else { id };
        answer(reference, service, number, Code::DONE, &[])
    }

    fn begin(&mut self, id: u8) {
        if self.tests.find(id).is_some_and(|job| job.begin != Begin::WhenEnabled) {
            self.arm(id);
        }
    }

    /// What a permanent job writes at each trigger.
    fn stay(&mut self, id: u8) {
        let Some(TestJob { what: What::Modify(_, puts), trigger: Trigger::Point(point), .. }) = self.tests.find(id)
        else {
            return;
        };
        let ask = Ask::At { point: *point, stays: true, access: Access::Write(puts.clone()) };
        let asked = self.ask_aside(ask, Then::Service(Service::Test(Ending::Result { job: id })));
        if let Some(job) = self.tests.find(id) {
            job.stays = Some(asked);
        }
    }

    /// Asks the CPU for the next result, unless it is asked already.
    fn arm(&mut self, id: u8) {
        if self.tests.find(id).is_some_and(|job| job.begin == Begin::Permanent && job.stays.is_none()) {
            self.stay(id);
        }
        let Some(job) = self.tests.find(id).filter(|job| job.asked.is_none()) else { return };
        (job.again, job.fired) = (false, false);
        let point = if let Trigger::Point(point) = job.trigger { point } else { Point::Now };
        let at = |access| Ask::At { point, stays: false, access };
        let ask = match &job.what {
            What::Status(slots) => at(Access::Read(addresses(slots))),
            What::Modify(_, puts) => at(Access::Write(puts.clone())),
            What::Block(watch) => Ask::Pass(watch.order()),
            What::Stop(_) => return,
        };
        self.armed(id, ask, Ending::Result { job: id });
    }

    fn armed(&mut self, id: u8, ask: Ask, ending: Ending) {
        let asked = self.ask_aside(ask, Then::Service(Service::Test(ending)));
        if let Some(job) = self.tests.find(id) {
            job.asked = Some(asked);
        }
    }

    /// What a job has asked for is not wanted any more.
    fn forget(&mut self, job: &TestJob) {
        for request in [job.asked, job.stays].into_iter().flatten() {
            self.forget_aside(request);
        }
    }

    fn forget_aside(&mut self, request: u64) {
        let ask = Ask::Forget { request, patience: 0 };
        self.ask_aside(ask, Then::Service(Service::Test(Ending::Nothing)));
    }

    /// A job that has given its result is not armed. What is under way still comes, before the answer.
    fn disable(&mut self, reference: u16, id: u8) -> Result<Step, Code> {
        let job = self.tests.find(id).ok_or(Code::TEST_JOB)?;
        if std::mem::take(&mut job.again) {
            return Ok(Step::Answer(self.test_done(reference, sub::TEST_DISABLE)));
        }
        let (asked, stays) = (job.asked, job.stays);
        let ask = job.last_ask().ok_or(Code::TEST_JOB)?;
        job.fired = false;
        if let (Some(_), Some(stays)) = (asked, stays) {
            self.forget_aside(stays);
        }
        Ok(Self::later(ask, Service::Test(Ending::Disabled { job: id })))
    }

    fn delete(&mut self, reference: u16, id: u8) -> Step {
        let Some(job) = self.tests.find(id) else { return Step::Silence };
        job.goes = true;
        let (asked, stays) = (job.asked, job.stays);
        let Some(ask) = job.last_ask() else {
            self.tests.jobs.retain(|job| job.id != id);
            return Step::Answer(self.test_done(reference, sub::TEST_DELETE));
        };
        if let (Some(_), Some(stays)) = (asked, stays) {
            self.forget_aside(stays);
        }
        Self::later(ask, Service::Test(Ending::Deleted { job: id }))
    }

    /// A service of the test functions has waited for the CPU. `request`: what it has asked.
    pub(super) fn test_came(&mut self, reference: u16, request: u64, ending: Ending, reply: Reply) -> Vec<Vec<u8>> {
        match ending {
            Ending::Nothing => Vec::new(),
            Ending::Blinks => vec![self.test_done(reference, sub::TEST_BLINK)],
            Ending::Resets => vec![match reply {
                Reply::Done => self.test_done(reference, sub::TEST_RESET),
                Reply::Refused(Code::PROTECTED) => self.test_refused(reference, sub::TEST_RESET, Code::TEST_PROTECTED),
                _ => self.test_refused(reference, sub::TEST_RESET, Code::TEST_NOT_IN_RUN),
            }],
            Ending::Stack { service, place } => self.stack_came(reference, service, place, reply),
            Ending::Local { level } => self.local_came(reference, level, reply),
            Ending::Set { job, service, made } => vec![self.set_came(reference, job, service, made, &reply)],
            Ending::Unset { job, service } => vec![self.unset_came(reference, job, service)],
            Ending::Released => {
                self.released(&reply);
                Vec::new()
            }
            Ending::Leaves { to } => vec![self.leaves(reference, to, &reply)],
            Ending::Held => {
                self.hold_came(request, reply);
                Vec::new()
            }
            Ending::MayForce(forcing) => self.may_force(reference, forcing, &reply),
            Ending::Forces(forcing) => self.forces(reference, &forcing, &reply),
            Ending::ForceEnds => vec![match reply {
                Reply::Done => self.test_done(reference, sub::TEST_DELETE),
                _ => self.test_refused(reference, sub::TEST_DELETE, Code::TEST_NO_ACCESS),
            }],
            Ending::Listed => vec![self.job_list(reference, &reply)],
            Ending::ForcedJob => vec![self.forced_job(reference, &reply)],
            Ending::SetUp { job, service } => vec![match self.places_came(job, reply, true) {
                Ok(())
                    if self.is_set(job).is_some()
                        && self.tests.find(job).is_some_and(|job| job.begin == Begin::AtOnce) =>
                {
                    match self.set(job, true) {
                        Ok(ask) => {
                            self.follow(ask, Service::Test(Ending::Set { job, service, made: true }));
                            return Vec::new();
                        }
                        Err(why) => {
                            self.tests.jobs.retain(|other| other.id != job);
                            self.test_refused(reference, service, why)
                        }
                    }
                }
                Ok(()) => {
                    let answer = self.set_up_answer(reference, service, job);
                    self.begin(job);
                    answer
                }
                Err(why) => {
                    self.tests.jobs.retain(|other| other.id != job);
                    self.test_refused(reference, service, why)
                }
            }],
            Ending::Places { job } => {
                self.places_again(job, request, reply);
                Vec::new()
            }
            Ending::Result { job } => {
                self.result_came(job, request, reply);
                Vec::new()
            }
            Ending::Disabled { job } => {
                let fired = self.tests.find(job).is_none_or(|job| job.fired);
                vec![match fired {
                    true => self.test_refused(reference, sub::TEST_DISABLE, Code::TEST_JOB),
                    false => self.test_done(reference, sub::TEST_DISABLE),
                }]
            }
            Ending::Deleted { job } => {
                self.tests.jobs.retain(|other| other.id != job);
                vec![self.test_done(reference, sub::TEST_DELETE)]
            }
        }
    }

    /// What lies at the addresses of a block status.
    fn places_came(&mut self, id: u8, reply: Reply, is_first: bool) -> Result<(), Code> {
        let job = self.tests.find(id).ok_or(Code::TEST_JOB)?;
        match reply {
            Reply::Code(places) => {
                match &mut job.what {
                    What::Block(watch) => watch.found(places)?,
                    What::Stop(stop) => stop.found(&places)?,
                    What::Status(_) | What::Modify(..) => return Err(Code::TEST_JOB),
                }
                if is_first {
                    job.goes = false;
                }
                Ok(())
            }
            Reply::Refused(Code::PROTECTED) => Err(Code::TEST_PROTECTED),
            _ if is_first => Err(Code::TEST_NO_BLOCK),
            _ => Err(Code::TEST_CHANGED),
        }
    }

    /// The block is the same as before the pass, or not.
    fn places_again(&mut self, id: u8, request: u64, reply: Reply) {
        let Some(job) = self.tests.find(id).filter(|job| job.asked == Some(request)) else { return };
        job.asked = None;
        let seen = job.seen.take();
        match (self.places_came(id, reply, false), seen) {
            (Err(why), _) => self.ends(id, why),
            (Ok(()), Some((code, data))) => self.fires(id, code, &data),
            (Ok(()), None) => {}
        }
    }

    fn result_came(&mut self, id: u8, request: u64, reply: Reply) {
        let Some(job) = self.tests.find(id) else { return };
        let no_room = reply == Reply::Refused(Code::NOT_NOW);
        if job.stays == Some(request) {
            job.stays = None;
            job.again |= no_room;
            return;
        }
        if job.asked != Some(request) {
            return;
        }
        job.asked = None;
        let wanted = !job.goes && !self.is_ending(id);
        let Some(job) = self.tests.find(id) else { return };
        let seen = match (&job.what, reply) {
            (_, Reply::Forgotten) => Seen::Waits,
            (What::Block(watch), Reply::Pass(pass)) => watch.seen(&pass),
            _ if no_room => Seen::Later,
            (What::Status(slots), reply) => Seen::Result(Code::DONE, table::seen(slots, reply)),
            (What::Modify(slots, _), reply) => Seen::Result(Code::DONE, table::modified(slots, reply)),
            (What::Block(_) | What::Stop(_), _) => Seen::Later,
        };
        match seen {
            Seen::Result(code, data) => match &job.what {
                What::Block(watch) if wanted => {
                    let ask = Ask::Code { block: watch.block(), wanted: watch.wanted() };
                    job.seen = Some((code, data));
                    self.armed(id, ask, Ending::Places { job: id });
                }
                _ => self.fires(id, code, &data),
            },
            Seen::Ends(why) => self.ends(id, why),
            Seen::Waits if wanted => self.arm(id),
            Seen::Later if wanted => job.again = true,
            Seen::Waits | Seen::Later => {}
        }
    }

    /// Jobs for which there was no room are armed again.
    pub(super) fn tests_tick(&mut self, now_ms: u64) {
        if !self.tests.holds.again && !self.tests.jobs.iter().any(|job| job.again) {
            self.tests.again_ms = None;
        } else if now_ms >= *self.tests.again_ms.get_or_insert(now_ms + AGAIN_MS) {
            self.tests.again_ms = None;
            let ids: Vec<u8> = self.tests.jobs.iter().filter(|job| job.again).map(|job| job.id).collect();
            for id in ids {
                self.arm(id);
            }
            if self.tests.holds.again {
                self.wait_for_hold();
            }
        }
    }
}
