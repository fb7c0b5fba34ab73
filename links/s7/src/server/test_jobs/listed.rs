//! The list of jobs, reading one of them, and another one in its place.

use super::force::{self, is_force};
use super::setup::parts;
use super::telegrams::{answer, message, named};
use super::{Ending, NO_CLASS, TestJob, What};
use crate::codes::Code;
use crate::server::service::Service;
use crate::server::{Ask, Connection, Reply, Step};
use crate::wire::{UserData, sub};

impl Connection {
    /// For each job its function, its number, and whether it is armed; this service too is a job.
    pub(super) fn job_list(&self, reference: u16, reply: &Reply) -> Vec<u8> {
        let own = self.tests.free();
        let state = |job: &TestJob| match &job.what {
            What::Stop(stop) => u8::from(stop.is_set()),
            _ => u8::from(job.asked.is_some() || job.stays.is_some()),
        };
        let jobs = self.tests.jobs.iter().map(|job| [job.function, job.id, 0, state(job)]);
        let forced = if let Reply::Forced(cells) = reply { self.listed(cells) } else { None };
        let all: Vec<u8> = jobs.chain(forced).chain([[sub::TEST_LIST, own, 0, 0]]).flatten().collect();
        answer(reference, sub::TEST_LIST, own, Code::DONE, &message(NO_CLASS, &all))
    }

    pub(super) fn read_job(&self, reference: u16, service: &UserData<'_>) -> Result<Step, Code> {
        let (function, number) = named(service)?;
        if is_force(function) && number == force::NUMBER {
            return Ok(Self::later(Ask::Forced, Service::Test(Ending::ForcedJob)));
        }
        let id = self.known_job((function, number), Code::TEST_NO_JOB)?;
        let request = self.tests.jobs.iter().find(|job| job.id == id).map_or(&[][..], |job| &job.request);
        Ok(Step::Answer(answer(reference, sub::TEST_READ, self.tests.free(), Code::DONE, request)))
    }

    /// `0000`, function and number, then the new request.
    pub(super) fn replace(&mut self, reference: u16, service: &UserData<'_>) -> Result<Step, Code> {
        let (_, data) = parts(service.data)?;
        let (&[_, _, function, number], request) = data.split_first_chunk::<4>().ok_or(Code::TEST_DATA)?;
        if is_force(function) && number == force::NUMBER {
            return self.force(sub::TEST_REPLACE, function, request);
        }
        let id = self.known_job((function, number), Code::TEST_NO_JOB)?;
        // The CPU would hold at the one before until the new one is known.
        if function == sub::TEST_BREAKPOINT {
            return Err(Code::TEST_NO_REPLACE);
        }
        self.set_up(reference, sub::TEST_REPLACE, function, id, request)
    }
}
