//! Results of test jobs, and where they go among the answers.

use super::telegrams::result;
use crate::codes::Code;
use crate::server::service::Service;
use crate::server::{Connection, Job, Then};

impl Connection {
    /// The job is over: its last message says why.
    pub(super) fn ends(&mut self, id: u8, why: Code) {
        let Some(index) = self.tests.jobs.iter().position(|job| job.id == id) else { return };
        let job = self.tests.jobs.remove(index);
        self.push_result(&result(job.function, id, job.trigger.class(), why, &[]), id);
    }

    /// The result of a job.
    pub(super) fn fires(&mut self, id: u8, code: Code, data: &[u8]) {
        let Some(job) = self.tests.find(id) else { return };
        job.fired = true;
        let push = result(job.function, id, job.trigger.class(), code, data);
        if job.once && !job.goes {
            self.tests.jobs.retain(|job| job.id != id);
        }
        self.push_result(&push, id);
    }

    /// The partner has disabled or deleted the job, and waits for the answer.
    pub(super) fn is_ending(&self, id: u8) -> bool {
        self.queue.iter().any(|job| is_ending(job, id))
    }

    /// Sends a result: behind the answers that are not out yet, but before that of the service which ends the job.
    pub(super) fn push_result(&mut self, telegram: &[u8], id: u8) {
        if let Some(job) = self.queue.iter_mut().find(|job| is_ending(job, id)) {
            job.answer.push(telegram.to_vec());
        } else if self.queue.is_empty() {
            self.message(telegram);
        } else {
            self.queue.push_back(Job { id: self.next, reference: 0, then: None, answer: vec![telegram.to_vec()] });
            self.next += 1;
        }
    }
}

fn is_ending(job: &Job, id: u8) -> bool {
    matches!(&job.then, Some(Then::Service(Service::Test(ending))) if ending.is_after(id))
}
