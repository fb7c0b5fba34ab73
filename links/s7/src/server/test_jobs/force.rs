//! Forcing: one job for the whole CPU, whoever has set it up. It stays when its connection is gone.

use ob1_model::Forced;

use super::setup::Setup;
use super::telegrams::{answer, result};
use super::{Ending, NO_CLASS, table};
use crate::Rights;
use crate::codes::{Code, ItemCode};
use crate::server::service::Service;
use crate::server::{Ask, Connection, Put, Reply, Step};
use crate::wire::sub;

/// Its number: connections number their own jobs from 1.
pub(super) const NUMBER: u8 = 0x80;

/// Whether these functions are the same: an S7-300 forces by 07, an S7-400 by 09.
pub(super) const fn is_force(function: u8) -> bool {
    matches!(function, sub::TEST_FORCE_300 | sub::TEST_FORCE)
}

/// What a job that forces is about.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(in crate::server) struct Forcing {
    function: u8,
    /// The service that is answered: the function, or replacing.
    service: u8,
    puts: Vec<Put>,
    /// The result: how each variable has ended.
    told: Vec<u8>,
}

impl Connection {
    /// Sets the job up; `service`: the function, or replacing.
    pub(super) fn force(&self, service: u8, function: u8, request: &[u8]) -> Result<Step, Code> {
        if !self.may(Rights::Operate) {
            return Err(Code::TEST_PROTECTED);
        }
        let setup = Setup::read(function, request)?;
        let (slots, puts, length) = table::modify(setup.data)?;
        if !setup.more.is_empty() {
            return Err(Code::TEST_SYNTAX);
        }
        if setup.result != length {
            return Err(Code::TEST_RESULT);
        }
        if slots.iter().any(Result::is_err) {
            return Err(Code::TEST_VARIABLE);
        }
        let told = table::modified(&slots, Reply::Written(vec![ItemCode::DONE; slots.len()]));
        let forcing = Forcing { function, service, puts, told };
        Ok(Self::later(Ask::Forced, Service::Test(Ending::MayForce(Box::new(forcing)))))
    }

    /// What is forced already: there is one job.
    pub(super) fn may_force(&mut self, reference: u16, forcing: Box<Forcing>, reply: &Reply) -> Vec<Vec<u8>> {
        match reply {
            Reply::Forced(cells) if cells.is_empty() == (forcing.service != sub::TEST_REPLACE) => {
                self.follow(Ask::Force(forcing.puts.clone()), Service::Test(Ending::Forces(forcing)));
                Vec::new()
            }
            Reply::Forced(cells) => {
                let why = if cells.is_empty() { Code::TEST_NO_JOB } else { Code::TEST_FORCED };
                vec![self.test_refused(reference, forcing.service, why)]
            }
            _ => vec![self.test_refused(reference, forcing.service, Code::TEST_NO_ACCESS)],
        }
    }

    pub(super) fn forces(&mut self, reference: u16, forcing: &Forcing, reply: &Reply) -> Vec<Vec<u8>> {
        let Forcing { function, service, told, .. } = forcing;
        match reply {
            Reply::Done => {
                let number = if *service == sub::TEST_REPLACE { self.tests.free() } else { NUMBER };
                let done = answer(reference, *service, number, Code::DONE, &[]);
                vec![done, result(*function, NUMBER, NO_CLASS, Code::DONE, told)]
            }
            Reply::Refused(Code::PROTECTED) => vec![self.test_refused(reference, *service, Code::TEST_PROTECTED)],
            _ => vec![self.test_refused(reference, *service, Code::TEST_VARIABLE)],
        }
    }

    /// The job as it was set up, for who wants to read it.
    pub(super) fn forced_job(&mut self, reference: u16, reply: &Reply) -> Vec<u8> {
        match reply {
            Reply::Forced(cells) if !cells.is_empty() => {
                let request = Setup::of_force(&table::forced(cells));
                answer(reference, sub::TEST_READ, self.tests.free(), Code::DONE, &request)
            }
            _ => self.test_refused(reference, sub::TEST_READ, Code::TEST_NO_JOB),
        }
    }

    /// Forcing ends, whoever has begun it; needs the right to operate.
    pub(super) fn end_forcing(&self) -> Result<Step, Code> {
        if self.may(Rights::Operate) {
            Ok(Self::later(Ask::Force(Vec::new()), Service::Test(Ending::ForceEnds)))
        } else {
            Err(Code::TEST_PROTECTED)
        }
    }

    /// The entry of the job in a list of jobs.
    pub(super) fn listed(&self, cells: &[Forced]) -> Option<[u8; 4]> {
        let function = if self.settings.is_400 { sub::TEST_FORCE } else { sub::TEST_FORCE_300 };
        (!cells.is_empty()).then_some([function, NUMBER, 0, 1])
    }
}
