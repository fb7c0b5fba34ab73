//! Breakpoints: each is a job, and its result tells that the CPU holds there. Service 0B lets the CPU go on; it has a
//! result of its own where the CPU holds at no breakpoint. A connection that is lost takes its breakpoints along, and
//! its CPU goes from HOLD to STOP.

use ob1_model::{BREAKPOINTS, BlockId, Breakpoint, DebugAnswer, DebugEnd, DebugOrder, Held, Resume};

use super::setup::{Setup, parts};
use super::stacks::{data_blocks, place, registers};
use super::telegrams::{answer, result};
use super::watch::{block, words};
use super::{Ending, NO_CLASS, What};
use crate::Rights;
use crate::codes::Code;
use crate::server::service::Service;
use crate::server::{Ask, CodePlaces, Connection, Reply, Step, Then};
use crate::wire::{UserData, sub};

/// Bytes of a result.
pub(super) const RESULT: usize = 38;
/// How long it is waited for a hold at a time.
const WAIT: u64 = 500_000_000;

/// A breakpoint that a connection has set.
#[derive(Debug)]
pub(super) struct Stop {
    block: BlockId,
    address: u16,
    /// Its statement, once that is known.
    statement: Option<u32>,
    /// The CPU holds there.
    is_set: bool,
}

impl Stop {
    /// From the request: block type, number, address, and perhaps a word more.
    pub(super) fn read(setup: &Setup<'_>) -> Result<Self, Code> {
        let (place, rest) = setup.more.split_at_checked(6).ok_or(Code::TEST_SYNTAX)?;
        let [ty, number, address] = words(place).ok_or(Code::TEST_SYNTAX)?;
        if !matches!(rest.len(), 0 | 2) {
            return Err(Code::TEST_SYNTAX);
        }
        Ok(Self { block: block(ty, number)?, address, statement: None, is_set: false })
    }

    pub(super) const fn is_set(&self) -> bool {
        self.is_set
    }

    /// What must be known before it can be set.
    pub(super) fn ask(&self) -> Ask {
        Ask::Code { block: self.block, wanted: vec![self.address] }
    }

    pub(super) fn found(&mut self, places: &CodePlaces) -> Result<(), Code> {
        let at = places.found.first().copied().flatten().ok_or(Code::TEST_ADDRESS)?;
        self.statement = Some(at.statement);
        Ok(())
    }

    fn breakpoint(&self) -> Option<Breakpoint> {
        Some(Breakpoint { block: self.block, statement: self.statement? })
    }
}

/// What a connection waits for.
#[derive(Debug, Default)]
pub(super) struct Holds {
    /// The request that comes back at a hold.
    asked: Option<u64>,
    /// The service that has let the CPU go on.
    resumed: Option<u8>,
    /// It is asked again after a while: the CPU is in STOP.
    pub(super) again: bool,
}

impl Holds {
    pub(super) const fn wait(&self) -> bool {
        self.asked.is_some() || self.again
    }
}

impl Connection {
    fn stops(&self) -> impl Iterator<Item = (u8, &Stop)> {
        self.tests
            .jobs
            .iter()
            .filter_map(|job| if let What::Stop(stop) = &job.what { Some((job.id, stop)) } else { None })
    }

    fn stop(&mut self, id: u8) -> Option<&mut Stop> {
        self.tests.find(id).and_then(|job| if let What::Stop(stop) = &mut job.what { Some(stop) } else { None })
    }

    fn any_set(&self) -> bool {
        self.stops().any(|(_, stop)| stop.is_set)
    }

    /// Whether the breakpoint is set; `None`: the job is none.
    pub(super) fn is_set(&self, id: u8) -> Option<bool> {
        self.stops().find(|(other, _)| *other == id).map(|(_, stop)| stop.is_set)
    }

    /// The order for all that are set.
    fn order(&self) -> Ask {
        let set = self.stops().filter(|(_, stop)| stop.is_set).filter_map(|(_, stop)| stop.breakpoint());
        Ask::Debug(DebugOrder::Breakpoints(set.collect()))
    }

    /// Sets a breakpoint, or takes it back: what the CPU must be asked for.
    pub(super) fn set(&mut self, id: u8, is_set: bool) -> Result<Ask, Code> {
        if !self.may(Rights::Operate) {
            return Err(Code::TEST_PROTECTED);
        }
        if is_set && self.stops().filter(|(other, stop)| stop.is_set && *other != id).count() >= BREAKPOINTS {
            return Err(Code::TEST_TAKEN);
        }
        self.stop(id).ok_or(Code::TEST_JOB)?.is_set = is_set;
        Ok(self.order())
    }

    /// The CPU has taken the breakpoints, or not. `service`: what is answered; `made`: the job is new.
    pub(super) fn set_came(&mut self, reference: u16, id: u8, service: u8, made: bool, reply: &Reply) -> Vec<u8> {
        let why = match reply {
            Reply::Debug(DebugAnswer { end: DebugEnd::Done, .. }) => {
                self.wait_for_hold();
                return match made {
                    true => self.set_up_answer(reference, service, id),
                    false => self.test_done(reference, service),
                };
            }
            Reply::Debug(_) => Code::TEST_CHANGED,
            Reply::Refused(Code::PROTECTED) => Code::TEST_PROTECTED,
            // Somebody else has breakpoints.
            _ => Code::TEST_TAKEN,
        };
        self.stop(id).into_iter().for_each(|stop| stop.is_set = false);
        if made {
            self.tests.jobs.retain(|job| job.id != id);
        }
        self.test_refused(reference, service, why)
    }

    /// One breakpoint less; after the last one it is asked where the CPU holds.
    pub(super) fn unset_came(&mut self, reference: u16, id: u8, service: u8) -> Vec<u8> {
        if service == sub::TEST_DELETE {
            self.tests.jobs.retain(|job| job.id != id);
        }
        if !self.any_set() {
            let ask = Ask::Debug(DebugOrder::Stack { level: 0 });
            self.ask_aside(ask, Then::Service(Service::Test(Ending::Released)));
        }
        self.test_done(reference, service)
    }

    /// Without breakpoints others may set theirs; not while the CPU holds for this connection.
    pub(super) fn released(&mut self, reply: &Reply) {
        let holds = matches!(reply, Reply::Debug(DebugAnswer { end: DebugEnd::Held, .. }));
        if !holds && !self.any_set() {
            self.ask_aside(Ask::Debug(DebugOrder::End), Then::Service(Service::Test(Ending::Nothing)));
        }
    }

    /// Waits for the next hold, if there is anything to hold at.
    pub(super) fn wait_for_hold(&mut self) {
        self.tests.holds.again = false;
        if self.tests.holds.asked.is_none() && (self.any_set() || self.tests.holds.resumed.is_some()) {
            self.ask_hold(None);
        }
    }

    fn ask_hold(&mut self, resume: Option<Resume>) {
        let ask = Ask::Debug(DebugOrder::Hold { resume, wait: WAIT });
        let asked = self.ask_aside(ask, Then::Service(Service::Test(Ending::Held)));
        self.tests.holds.asked = Some(asked);
    }

    /// Service 0B: the CPU is to leave HOLD. 00: to the next breakpoint; 01: one statement, a called block included.
    pub(super) fn leave_hold(&self, service: &UserData<'_>) -> Result<Step, Code> {
        if !self.may(Rights::Operate) {
            return Err(Code::TEST_PROTECTED);
        }
        let (_, data) = parts(service.data)?;
        let to = match data.first() {
            Some(0) => Resume::Run,
            Some(1) => Resume::Over,
            _ => return Err(Code::TEST_DATA),
        };
        let ask = Ask::Debug(DebugOrder::Stack { level: 0 });
        Ok(Self::later(ask, Service::Test(Ending::Leaves { to })))
    }

    /// Whether it holds is known.
    pub(super) fn leaves(&mut self, reference: u16, to: Resume, reply: &Reply) -> Vec<u8> {
        if !matches!(reply, Reply::Debug(DebugAnswer { end: DebugEnd::Held, .. })) {
            return self.test_refused(reference, sub::TEST_LEAVE_HOLD, Code::TEST_NOT_IN_RUN);
        }
        let number = self.tests.free();
        self.tests.holds.resumed = Some(number);
        self.ask_hold(Some(to));
        answer(reference, sub::TEST_LEAVE_HOLD, number, Code::DONE, &[])
    }

    /// The CPU holds, or has not come to that in time.
    pub(super) fn hold_came(&mut self, request: u64, reply: Reply) {
        if self.tests.holds.asked != Some(request) {
            return;
        }
        self.tests.holds.asked = None;
        match reply {
            Reply::Debug(DebugAnswer { end: DebugEnd::Held, held }) => self.holds(&held),
            Reply::Debug(DebugAnswer { end: DebugEnd::Runs | DebugEnd::Done, .. }) => {
                // It runs on without end, where there is no breakpoint.
                if !self.any_set() {
                    self.tests.holds.resumed = None;
                    self.released(&Reply::Done);
                }
                self.wait_for_hold();
            }
            other => {
                let stopped = matches!(other, Reply::Debug(_));
                let why = if stopped { Code::TEST_STOPPED } else { Code::TEST_TAKEN };
                if let Some(number) = self.tests.holds.resumed.take() {
                    self.message(&result(sub::TEST_LEAVE_HOLD, number, NO_CLASS, why, &[]));
                }
                self.tests.holds.again = self.any_set();
            }
        }
    }

    fn holds(&mut self, held: &Held) {
        let Some(innermost) = held.stack.first() else { return };
        let here = Some(Breakpoint { block: innermost.block, statement: innermost.statement });
        let stop = self.stops().find(|(_, stop)| stop.is_set && stop.breakpoint() == here).map(|(id, _)| id);
        let resumed = self.tests.holds.resumed.take();
        let (function, number) = match (stop, resumed) {
            (Some(id), _) => (sub::TEST_BREAKPOINT, id),
            (None, Some(number)) => (sub::TEST_LEAVE_HOLD, number),
            (None, None) => return,
        };
        // The place is the same twice: it holds before the statement.
        let mut data = [place(innermost), place(innermost)].concat();
        data.extend([0; 2]);
        data.extend(registers(held));
        data.extend(data_blocks(innermost.blocks));
        self.message(&result(function, number, NO_CLASS, Code::DONE, &data));
    }
}
