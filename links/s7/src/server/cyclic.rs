//! Cyclic data: a partner names variables and a period, and gets their values in each period, or only what has changed.
//!
//! What is told of changes is how an S7-400 did it in recordings with WinCC: the answer to the job has all values.
//! Then, at the end of a period, nothing if nothing has changed since the last message; otherwise one message with all
//! areas of data blocks in order, those that are as they were told last by their mark alone. After a write of the same
//! partner the next message of each such job is complete, and comes even if nothing has changed: by it the partner sees
//! what has become of the written values.

use std::collections::VecDeque;

use ob1_model::{CYCLIC_300, CYCLIC_400, CyclicLimits};

use super::service::Service;
use super::var::{Outcome, ReadItem, data_bytes, items, outcomes, wanted_addresses, write_outcomes};
use super::{Ask, Connection, Job, Reply, Step, Then};
use crate::codes::Code;
use crate::wire::{Group, Telegram, USERDATA_HEAD, UserData, sub};

/// The step of periods, in milliseconds.
const STEP_MS: u64 = 100;
/// Time bases, in such steps.
const BASES: [u64; 3] = [1, 10, 100];
/// Bytes in front of the items: their number, time base, factor.
const HEAD: usize = 4;
/// Bytes in front of the values: their number.
const COUNT: usize = 2;

#[derive(Debug)]
struct CyclicJob {
    id: u8,
    /// The service that its messages carry: that which made the job, or changed it last.
    sub: u8,
    wanted: Vec<ReadItem>,
    every_ms: u64,
    due_ms: Option<u64>,
    /// The request whose answer has the first values. No message comes in front of that answer.
    made_by: u64,
    /// The request for the values of a message.
    under_way: Option<u64>,
    /// What was sent last.
    sent: Vec<Outcome>,
    /// The next message has all values, and is sent in any case.
    complete: bool,
}

impl CyclicJob {
    const fn tells_changes(&self) -> bool {
        self.sub != sub::CYCLIC
    }

    /// It waits for the end of its period, and for nothing else.
    fn is_waiting(&self, queue: &VecDeque<Job>) -> bool {
        self.under_way.is_none() && queue.iter().all(|job| job.id != self.made_by)
    }
}

/// The cyclic jobs of a connection.
#[derive(Debug, Default)]
pub(super) struct Cyclic {
    jobs: Vec<CyclicJob>,
    next: u8,
}

impl Cyclic {
    /// A write of the partner is done.
    pub(super) fn written(&mut self) {
        self.jobs.iter_mut().for_each(|job| job.complete = true);
    }

    /// A free number: there are fewer jobs than numbers. [an S7-400 counts up]
    fn free(&mut self) -> u8 {
        loop {
            self.next = self.next % 0xFF + 1;
            if self.jobs.iter().all(|job| job.id != self.next) {
                return self.next;
            }
        }
    }
}

/// The answer to a job, or one of its messages, with what has changed since `before`.
fn telegram(
    (telegram, reference): (Telegram, u16),
    (job, sub): (u8, u8),
    now: &[Outcome],
    before: &[Outcome],
) -> Vec<u8> {
    let mut data = (now.len() as u16).to_be_bytes().to_vec();
    write_outcomes(&mut data, now, before);
    UserData { telegram, sequence: job, ..UserData::job(Group::Cyclic, sub, &data) }.write(reference)
}

/// Number of items, time base, factor, items: the items, and the period in milliseconds.
fn asked(data: &[u8], limits: CyclicLimits) -> Result<(Vec<ReadItem>, u64), Code> {
    let (&[high, low, base, factor], bytes) = data.split_first_chunk::<HEAD>().ok_or(Code::NO_INFORMATION)?;
    let steps = BASES.get(usize::from(base)).ok_or(Code::CYCLIC_TIME)? * u64::from(factor);
    if steps == 0 || steps > u64::from(limits.longest) {
        return Err(Code::CYCLIC_TIME);
    }
    let wanted = items(bytes, usize::from(u16::from_be_bytes([high, low]))).ok_or(Code::NO_INFORMATION)?;
    Ok((wanted, steps * STEP_MS))
}

impl Connection {
    pub(super) fn cyclic(&mut self, reference: u16, service: &UserData<'_>) -> Step {
        let made = match service.sub {
            sub::CYCLIC | sub::CYCLIC_CHANGE | sub::CYCLIC_REPLACE => self.cyclic_job(service),
            sub::CYCLIC_DELETE => match service.data {
                [_, 0] => {
                    self.cyclic.jobs.clear();
                    return Step::Answer(super::long::done(reference, service.group, service.sub, 0));
                }
                [_, id] if self.cyclic.jobs.iter().any(|job| job.id == *id) => {
                    self.cyclic.jobs.retain(|job| job.id != *id);
                    return Step::Answer(super::long::done(reference, service.group, service.sub, *id));
                }
                _ => Err(Code::CYCLIC_JOB),
            },
            _ => Err(Code::NO_SERVICE),
        };
        made.unwrap_or_else(|why| self.refuse_service(reference, service, why))
    }

    /// A new job, or a new list for the one whose number the request has. A list that is refused changes nothing.
    fn cyclic_job(&mut self, service: &UserData<'_>) -> Result<Step, Code> {
        let limits = if self.settings.is_400 { CYCLIC_400 } else { CYCLIC_300 };
        let (wanted, every_ms) = asked(service.data, limits)?;
        let addresses = wanted_addresses(&wanted);
        if addresses.is_empty() {
            return Err(Code::CYCLIC_ADDRESS);
        }
        if USERDATA_HEAD + COUNT + data_bytes(&wanted) > self.pdu_bytes() {
            return Err(Code::PDU_SIZE);
        }
        let id = if service.sub == sub::CYCLIC_REPLACE {
            let job = self.cyclic.jobs.iter().find(|job| job.id == service.sequence).ok_or(Code::CYCLIC_JOB)?;
            if !job.tells_changes() {
                return Err(Code::CYCLIC_KIND);
            }
            job.id
        } else if self.cyclic.jobs.len() >= usize::from(limits.jobs) {
            return Err(Code::CYCLIC_FULL);
        } else {
            self.cyclic.free()
        };
        self.cyclic.jobs.retain(|job| job.id != id);
        self.cyclic.jobs.push(CyclicJob {
            id,
            sub: service.sub,
            wanted: wanted.clone(),
            every_ms,
            due_ms: None,
            // The request that the step below becomes.
            made_by: self.next,
            under_way: None,
            sent: Vec::new(),
            complete: false,
        });
        Ok(Self::later(Ask::Read(addresses), Service::Cyclic { job: id, sub: service.sub, wanted }))
    }

    /// Time passes: requests the values of the cyclic jobs that are due, and what the CPU had no room for. `now_ms` is
    /// any clock in milliseconds that never goes back.
    pub fn tick(&mut self, now_ms: u64) {
        self.tests_tick(now_ms);
        let mut due = Vec::new();
        let queue = &self.queue;
        for job in self.cyclic.jobs.iter_mut().filter(|job| job.is_waiting(queue)) {
            let at = *job.due_ms.get_or_insert(now_ms + job.every_ms);
            if let Some(late) = now_ms.checked_sub(at) {
                // Missed times are not made up.
                job.due_ms = Some(at + (late / job.every_ms + 1) * job.every_ms);
                due.push((job.id, wanted_addresses(&job.wanted)));
            }
        }
        for (id, addresses) in due {
            let request = self.ask_aside(Ask::Read(addresses), Then::Service(Service::CyclicDue));
            if let Some(job) = self.cyclic.jobs.iter_mut().find(|job| job.id == id) {
                job.under_way = Some(request);
            }
        }
    }

    /// When [`Connection::tick`] has something to do; `None`: never.
    #[must_use]
    pub fn next_tick(&self) -> Option<u64> {
        let cyclic = self.cyclic.jobs.iter().filter(|job| job.is_waiting(&self.queue));
        cyclic.map(|job| job.due_ms.unwrap_or(0)).chain(self.tests.next_tick()).min()
    }

    /// Whether the partner waits for something: an answer, messages, or cyclic data. Then its silence means nothing.
    #[must_use]
    pub fn waits(&self) -> bool {
        !self.queue.is_empty() || self.wants_events() || !self.cyclic.jobs.is_empty() || self.tests.wait()
    }

    /// The answer to a job: all values.
    pub(super) fn cyclic_answer(
        &mut self,
        (reference, request): (u16, u64),
        (id, sub): (u8, u8),
        wanted: &[ReadItem],
        reply: Reply,
    ) -> Vec<u8> {
        let now = outcomes(wanted, reply);
        let answer = telegram((Telegram::Answer, reference), (id, sub), &now, &[]);
        // The job may have been changed or deleted since.
        if let Some(job) = self.cyclic.jobs.iter_mut().find(|job| job.made_by == request) {
            (job.sent, job.complete) = (now, false);
        }
        answer
    }

    /// Values have come for a message. `None`: it need not be sent, because nothing has changed or the job is gone, or
    /// it cannot, because the partner does not read: then the next one tells what has changed.
    pub(super) fn cyclic_came(&mut self, request: u64, reply: Reply) -> Option<Vec<u8>> {
        let takes = self.takes_messages();
        let job = self.cyclic.jobs.iter_mut().find(|job| job.under_way == Some(request))?;
        job.under_way = None;
        let now = outcomes(&job.wanted, reply);
        let complete = job.complete || !job.tells_changes();
        if !complete && now == job.sent {
            return None;
        }
        if !takes {
            self.counts.lost += 1;
            return None;
        }
        let before = if complete { &[][..] } else { &job.sent };
        let message = telegram((Telegram::Message, 0), (job.id, job.sub), &now, before);
        (job.sent, job.complete) = (now, false);
        Some(message)
    }
}
