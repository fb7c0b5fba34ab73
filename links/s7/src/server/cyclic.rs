//! Cyclic data: a partner names variables and a time, and gets their values repeatedly, or only when they change.

use super::service::Service;
use super::var::{Slot, addresses, values};
use super::{Ask, Connection, Reply, Step, Then};
use crate::codes::{Code, ItemCode};
use crate::wire::{Group, Items, Telegram, USERDATA_HEAD, UserData, sub, write_item, write_refused};

/// Cyclic jobs of a connection.
const JOBS: usize = 8;
/// Time bases, in milliseconds.
const BASES: [u64; 3] = [100, 1000, 10_000];
/// Bytes in front of the items: their number, time base, factor.
const HEAD: usize = 4;
/// Bytes in front of the values: their number.
const COUNT: usize = 2;
/// Offset of the data in a telegram.
const DATA_AT: usize = USERDATA_HEAD - 4;

#[derive(Debug)]
struct CyclicJob {
    id: u8,
    sub: u8,
    slots: Vec<Slot>,
    every_ms: u64,
    due_ms: Option<u64>,
    /// Asked, and not answered yet.
    under_way: bool,
    /// The last values sent, if only changes are wanted.
    last: Option<Vec<u8>>,
}

/// The cyclic jobs of a connection.
#[derive(Debug, Default)]
pub(super) struct Cyclic {
    jobs: Vec<CyclicJob>,
    next: u8,
}

/// The answer to a new job, or one of its messages.
pub(super) fn telegram(reference: u16, first: bool, job: u8, sub: u8, slots: &[Slot], reply: Reply) -> Vec<u8> {
    let data = data(slots, reply);
    let telegram = if first { Telegram::Answer } else { Telegram::Message };
    UserData { telegram, sequence: job, ..UserData::job(Group::Cyclic, sub, &data) }.write(reference)
}

fn data(slots: &[Slot], reply: Reply) -> Vec<u8> {
    let mut data = (slots.len() as u16).to_be_bytes().to_vec();
    for value in values(slots, reply) {
        match value {
            Ok((ty, bytes)) => write_item(&mut data, ItemCode::DONE, ty, &bytes),
            Err(code) => write_refused(&mut data, code),
        }
    }
    data
}

impl Connection {
    pub(super) fn cyclic(&mut self, reference: u16, service: &UserData<'_>) -> Step {
        let made = match service.sub {
            sub::CYCLIC | sub::CYCLIC_CHANGE => self.new_cyclic(service),
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

    fn new_cyclic(&mut self, service: &UserData<'_>) -> Result<Step, Code> {
        let Some((&[high, low, base, factor], items)) = service.data.split_first_chunk::<HEAD>() else {
            return Err(Code::NO_INFORMATION);
        };
        let base = BASES.get(usize::from(base)).ok_or(Code::CYCLIC_TIME)?;
        if factor == 0 {
            return Err(Code::CYCLIC_TIME);
        }
        let slots: Option<Vec<Slot>> = Items::new(items, usize::from(u16::from_be_bytes([high, low]))).collect();
        let slots = slots.filter(|slots| !slots.is_empty()).ok_or(Code::NO_INFORMATION)?;
        let wanted = addresses(&slots);
        let bytes: usize = slots.iter().map(|slot| 4 + slot.map_or(0, |a| a.bytes().next_multiple_of(2))).sum();
        if wanted.is_empty() {
            return Err(Code::CYCLIC_ADDRESS);
        }
        if USERDATA_HEAD + COUNT + bytes > self.pdu_bytes() {
            return Err(Code::PDU_SIZE);
        }
        if self.cyclic.jobs.len() >= JOBS {
            return Err(Code::CYCLIC_FULL);
        }
        // A free number always exists: there are fewer jobs than numbers.
        loop {
            self.cyclic.next = self.cyclic.next % 0xFF + 1;
            if self.cyclic.jobs.iter().all(|job| job.id != self.cyclic.next) {
                break;
            }
        }
        let (id, sub, every_ms) = (self.cyclic.next, service.sub, base * u64::from(factor));
        let job = CyclicJob { id, sub, slots: slots.clone(), every_ms, due_ms: None, under_way: false, last: None };
        self.cyclic.jobs.push(job);
        Ok(Self::later(Ask::Read(wanted), Service::Cyclic { first: true, job: id, sub, slots }))
    }

    /// Time passes: requests the values of the cyclic jobs that are due, and what the CPU had no room for. `now_ms` is
    /// any clock in milliseconds that never goes back.
    pub fn tick(&mut self, now_ms: u64) {
        self.tests_tick(now_ms);
        let mut due = Vec::new();
        for job in &mut self.cyclic.jobs {
            let at = *job.due_ms.get_or_insert(now_ms + job.every_ms);
            if at <= now_ms && !job.under_way {
                // Missed times are not made up.
                job.due_ms = Some((at + job.every_ms).max(now_ms + 1));
                job.under_way = true;
                due.push((job.id, job.sub, job.slots.clone()));
            }
        }
        for (job, sub, slots) in due {
            let then = Then::Service(Service::Cyclic { first: false, job, sub, slots: slots.clone() });
            self.ask_aside(Ask::Read(addresses(&slots)), then);
        }
    }

    /// When [`Connection::tick`] has something to do; `None`: never.
    #[must_use]
    pub fn next_tick(&self) -> Option<u64> {
        let cyclic = self.cyclic.jobs.iter().filter(|job| !job.under_way).map(|job| job.due_ms.unwrap_or(0));
        cyclic.chain(self.tests.next_tick()).min()
    }

    /// Whether the partner waits for something: an answer, messages, or cyclic data. Then its silence means nothing.
    #[must_use]
    pub fn waits(&self) -> bool {
        !self.queue.is_empty() || self.wants_events() || !self.cyclic.jobs.is_empty() || self.tests.wait()
    }

    /// Values of a cyclic job have come. False: they need not be sent, because they have not changed or the job is
    /// gone.
    pub(super) fn cyclic_came(&mut self, id: u8, telegram: &[u8]) -> bool {
        let Some(job) = self.cyclic.jobs.iter_mut().find(|job| job.id == id) else { return false };
        job.under_way = false;
        let data = telegram.get(DATA_AT..).unwrap_or_default();
        if job.sub == sub::CYCLIC_CHANGE {
            if job.last.as_deref() == Some(data) {
                return false;
            }
            job.last = Some(data.to_vec());
        }
        true
    }
}
