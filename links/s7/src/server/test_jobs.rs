//! Test functions: status and modification of variables, as requested by the variable table of a programming device.
//! Block status, breakpoints and forcing are not served.

use super::long::done;
use super::service::Service;
use super::var::{Slot, addresses, codes, values};
use super::{Ask, Connection, Put, Reply, Step, Then};
use crate::Rights;
use crate::codes::{Code, ItemCode};
use crate::wire::{Address, Area, DataItems, DataType, Group, Telegram, USERDATA_HEAD, UserData, sub};

/// Jobs of a connection.
const JOBS: usize = 8;
/// Bytes in front of parameters and data: their lengths.
const LENGTHS: usize = 4;
/// Bytes of an address.
const ADDRESS: usize = 6;
/// Lengths and parameters of a message: 4 bytes of parameters, whatever they mean.
const MESSAGE: [u8; 4] = [0x01, 0x00, 0x00, 0x01];
const OCTET: u8 = 0x09;

#[derive(Debug)]
struct TestJob {
    id: u8,
    slots: Vec<Slot>,
}

/// The test jobs of a connection.
#[derive(Debug, Default)]
pub(super) struct TestJobs {
    jobs: Vec<TestJob>,
    next: u8,
}

/// An address of a variable table: area and width, repetition or bit, data block, byte or number.
fn address(bytes: [u8; ADDRESS]) -> Slot {
    let [kind, count, db_high, db_low, high, low] = bytes;
    let area = match kind >> 4 {
        0 => Area::Memory,
        1 => Area::Inputs,
        2 => Area::Outputs,
        3 => Area::Peripheral,
        5 => Area::Timers,
        6 => Area::Counters,
        7 => Area::Db,
        _ => return Err(ItemCode::NO_OBJECT),
    };
    let first = u32::from(u16::from_be_bytes([high, low]));
    let db = if area == Area::Db { u16::from_be_bytes([db_high, db_low]) } else { 0 };
    let (ty, start, count) = match (area, kind & 0x0F) {
        (Area::Timers, 4) => (DataType::Timer, first, count),
        (Area::Counters, 4) => (DataType::Counter, first, count),
        (Area::Timers | Area::Counters, _) => return Err(ItemCode::TYPE),
        (_, 0) if count < 8 => (DataType::Bit, first * 8 + u32::from(count), 1),
        (_, 1) => (DataType::Byte, first * 8, count),
        (_, 2) => (DataType::Word, first * 8, count),
        (_, 3) => (DataType::DWord, first * 8, count),
        _ => return Err(ItemCode::TYPE),
    };
    if count == 0 {
        return Err(ItemCode::ADDRESS);
    }
    Ok(Address { area, db, start, ty, count: u16::from(count) })
}

/// The data of a job: the addresses of the items, and the bytes after them.
fn items(data: &[u8]) -> Option<(Vec<Slot>, &[u8])> {
    let (&[high, low, _, _], rest) = data.split_first_chunk::<LENGTHS>()?;
    let data = rest.get(usize::from(u16::from_be_bytes([high, low]))..)?;
    let (&[high, low], rest) = data.split_first_chunk::<2>()?;
    let count = usize::from(u16::from_be_bytes([high, low]));
    let (addresses, rest) = rest.split_at_checked(count.checked_mul(ADDRESS)?)?;
    let slots: Vec<Slot> = addresses.as_chunks::<ADDRESS>().0.iter().map(|bytes| address(*bytes)).collect();
    (!slots.is_empty()).then_some((slots, rest))
}

/// A message of a job: lengths, parameters, data.
fn message(sub: u8, job: u8, data: &[u8]) -> Vec<u8> {
    let mut bytes = vec![0, MESSAGE.len() as u8];
    bytes.extend_from_slice(&(data.len() as u16).to_be_bytes());
    bytes.extend_from_slice(&MESSAGE);
    bytes.extend_from_slice(data);
    UserData { telegram: Telegram::Message, sequence: job, ..UserData::job(Group::Test, sub, &bytes) }.write(0)
}

/// The answer, if this is the first time, and the values.
pub(super) fn status_telegrams(reference: u16, first: bool, job: u8, slots: &[Slot], reply: Reply) -> Vec<Vec<u8>> {
    let mut data = (slots.len() as u16).to_be_bytes().to_vec();
    for value in values(slots, reply) {
        match value {
            Ok((_, bytes)) => {
                data.extend_from_slice(&[ItemCode::DONE.0, OCTET]);
                data.extend_from_slice(&(bytes.len() as u16).to_be_bytes());
                data.extend_from_slice(&bytes);
                if bytes.len() % 2 == 1 {
                    data.push(0);
                }
            }
            Err(code) => data.extend_from_slice(&[code.0, 0, 0, 0]),
        }
    }
    let sub = if first { sub::TEST_STATUS } else { sub::TEST_ENABLE };
    vec![done(reference, Group::Test, sub, job), message(sub::TEST_STATUS, job, &data)]
}

/// The answer, and the outcome for each variable.
pub(super) fn modify_telegrams(reference: u16, job: u8, slots: &[Slot], reply: Reply) -> Vec<Vec<u8>> {
    let mut data = (slots.len() as u16).to_be_bytes().to_vec();
    data.extend(codes(slots, reply).into_iter().map(|code| code.0));
    if data.len() % 2 == 1 {
        data.push(0);
    }
    vec![done(reference, Group::Test, sub::TEST_MODIFY, job), message(sub::TEST_MODIFY, job, &data)]
}

impl Connection {
    pub(super) fn test(&mut self, reference: u16, service: &UserData<'_>) -> Step {
        let made = match service.sub {
            sub::TEST_STATUS => self.variable_status(service),
            sub::TEST_MODIFY => self.modify(service),
            sub::TEST_ENABLE => self.job_of(service).and_then(|index| self.again(index)),
            sub::TEST_DELETE => self.job_of(service).map(|index| {
                let job = self.tests.jobs.remove(index);
                Step::Answer(done(reference, Group::Test, sub::TEST_DELETE, job.id))
            }),
            sub::TEST_LIST => Ok(Step::Answer(self.job_list(reference))),
            // There is no LED; the partner gets the answer that it blinks.
            sub::TEST_BLINK => Ok(Step::Answer(done(reference, Group::Test, sub::TEST_BLINK, 0))),
            _ => Err(Code::NO_SERVICE),
        };
        made.unwrap_or_else(|why| self.refuse_service(reference, service, why))
    }

    fn job_number(&mut self) -> u8 {
        loop {
            self.tests.next = self.tests.next % 0xFF + 1;
            if self.tests.jobs.iter().all(|job| job.id != self.tests.next) {
                return self.tests.next;
            }
        }
    }

    fn variable_status(&mut self, service: &UserData<'_>) -> Result<Step, Code> {
        let (slots, _) = items(service.data).ok_or(Code::TEST_DATA)?;
        let bytes: usize = slots.iter().map(|slot| 4 + slot.map_or(0, |a| a.bytes().next_multiple_of(2))).sum();
        if USERDATA_HEAD + LENGTHS + MESSAGE.len() + 2 + bytes > self.pdu_bytes() {
            return Err(Code::PDU_SIZE);
        }
        if self.tests.jobs.len() >= JOBS {
            // A partner that never deletes its jobs still gets values: the oldest job is dropped.
            self.tests.jobs.remove(0);
        }
        let job = self.job_number();
        self.tests.jobs.push(TestJob { id: job, slots: slots.clone() });
        let service = Service::Status { first: true, job, slots: slots.clone() };
        Ok(Self::later(Ask::Read(addresses(&slots)), service))
    }

    /// Requests the values of a job again.
    fn again(&self, index: usize) -> Result<Step, Code> {
        let job = self.tests.jobs.get(index).ok_or(Code::TEST_JOB)?;
        let slots = job.slots.clone();
        let service = Service::Status { first: false, job: job.id, slots: slots.clone() };
        Ok(Step::Ask(Ask::Read(addresses(&slots)), Then::Service(service)))
    }

    fn modify(&mut self, service: &UserData<'_>) -> Result<Step, Code> {
        if !self.may(Rights::Write) {
            return Err(Code::TEST_PROTECTED);
        }
        let (mut slots, rest) = items(service.data).ok_or(Code::TEST_DATA)?;
        let mut data = DataItems::new(rest);
        let mut puts = Vec::new();
        for slot in &mut slots {
            let Some(Some(item)) = data.next() else { return Err(Code::TEST_DATA) };
            if let Ok(address) = *slot {
                if item.bytes.len() == address.bytes() {
                    puts.push(Put { address, bytes: item.bytes.to_vec() });
                } else {
                    *slot = Err(ItemCode::INCONSISTENT);
                }
            }
        }
        let job = self.job_number();
        Ok(Self::later(Ask::Write(puts), Service::Modify { job, slots }))
    }

    /// The job of a service: its function and number are in the data after the parameters.
    fn job_of(&self, service: &UserData<'_>) -> Result<usize, Code> {
        let data = service
            .data
            .split_first_chunk::<LENGTHS>()
            .and_then(|(&[high, low, ..], rest)| rest.get(usize::from(u16::from_be_bytes([high, low]))..));
        let id = data.and_then(|data| data.get(1)).ok_or(Code::TEST_SYNTAX)?;
        self.tests.jobs.iter().position(|job| job.id == *id).ok_or(Code::TEST_JOB)
    }

    /// Lengths, parameters, and for each job its function, its number and the state idle.
    fn job_list(&self, reference: u16) -> Vec<u8> {
        let jobs: Vec<u8> = self.tests.jobs.iter().flat_map(|job| [sub::TEST_STATUS, job.id, 0, 0]).collect();
        let mut bytes = vec![0, MESSAGE.len() as u8];
        bytes.extend_from_slice(&(jobs.len() as u16).to_be_bytes());
        bytes.extend_from_slice(&MESSAGE);
        bytes.extend_from_slice(&jobs);
        let job = UserData::job(Group::Test, sub::TEST_LIST, &bytes);
        UserData { telegram: Telegram::Answer, ..job }.write(reference)
    }
}
