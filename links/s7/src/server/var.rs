//! Reading and writing variables: any number of items, each with its own code.

use std::vec::IntoIter;

use super::{Ask, Connection, Put, Reply, Step, Then};
use crate::Rights;
use crate::codes::{Code, ItemCode};
use crate::wire::{
    ANSWER_HEAD, Address, DataItems, DataType, Item, Items, Kind, Pdu, function, write, write_areas, write_item,
    write_refused,
};

/// A variable: its address, or why it cannot be served.
pub(super) type Slot = Result<Address, ItemCode>;
/// An item of a read, or why it cannot be served.
pub(super) type ReadItem = Result<Item, ItemCode>;

/// Bytes in front of the items of an answer: head, function, count.
const HEAD: usize = ANSWER_HEAD + 2;
/// Bytes in front of an item's data.
const ITEM: usize = 4;

/// What has come of an item.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Outcome {
    Variable(Result<(DataType, Vec<u8>), ItemCode>),
    Areas(Vec<Result<Vec<u8>, ItemCode>>),
}

/// The items of a job; `None`: the list is cut off, or empty.
pub(super) fn items(bytes: &[u8], count: usize) -> Option<Vec<ReadItem>> {
    let items: Option<Vec<ReadItem>> = Items::new(bytes, count).collect();
    items.filter(|items| !items.is_empty())
}

fn of_job(pdu: &Pdu<'_>) -> Option<Vec<ReadItem>> {
    let (&[_, count], bytes) = pdu.parameters.split_first_chunk::<2>()?;
    items(bytes, usize::from(count))
}

/// Length of the items in an answer that has all of them. The last one is not padded.
pub(super) fn data_bytes(wanted: &[ReadItem]) -> usize {
    let bytes = |item: &ReadItem| match item {
        Ok(Item::Variable(address)) => ITEM + address.bytes(),
        Ok(Item::Areas(areas)) => ITEM + areas.iter().map(|area| 1 + area.map_or(0, |a| a.bytes())).sum::<usize>(),
        Err(_) => ITEM,
    };
    wanted.iter().fold(0, |all: usize, item| all.next_multiple_of(2) + bytes(item))
}

/// The addresses of all items.
pub(super) fn wanted_addresses(wanted: &[ReadItem]) -> Vec<Address> {
    let mut all = Vec::new();
    for item in wanted.iter().flatten() {
        match item {
            Item::Variable(address) => all.push(*address),
            Item::Areas(areas) => all.extend(areas.iter().flatten()),
        }
    }
    all
}

/// The addresses among the variables.
pub(super) fn addresses(slots: &[Slot]) -> Vec<Address> {
    slots.iter().filter_map(|slot| slot.ok()).collect()
}

/// Why nothing has come, by the reply.
fn missing(reply: &Reply) -> ItemCode {
    match reply {
        Reply::Refused(Code::PROTECTED) => ItemCode::NOT_ALLOWED,
        _ => ItemCode::HARDWARE,
    }
}

/// The values of a reply, in the order of their addresses.
struct Came {
    values: IntoIter<Result<Vec<u8>, ItemCode>>,
    missing: ItemCode,
}

impl Came {
    fn of(reply: Reply) -> Self {
        let missing = missing(&reply);
        let values = if let Reply::Values(values) = reply { values } else { Vec::new() };
        Self { values: values.into_iter(), missing }
    }

    fn next(&mut self, address: &Address) -> Result<Vec<u8>, ItemCode> {
        let bytes = self.values.next().unwrap_or(Err(self.missing))?;
        // A value of the wrong length would shift all that follow.
        if bytes.len() == address.bytes() { Ok(bytes) } else { Err(ItemCode::HARDWARE) }
    }

    fn variable(&mut self, slot: Slot) -> Result<(DataType, Vec<u8>), ItemCode> {
        let address = slot?;
        Ok((address.ty, self.next(&address)?))
    }
}

/// Values or codes of all variables: those with an address take theirs from the reply.
pub(super) fn values(slots: &[Slot], reply: Reply) -> Vec<Result<(DataType, Vec<u8>), ItemCode>> {
    let mut came = Came::of(reply);
    slots.iter().map(|slot| came.variable(*slot)).collect()
}

/// What has come of all items.
pub(super) fn outcomes(wanted: &[ReadItem], reply: Reply) -> Vec<Outcome> {
    let mut came = Came::of(reply);
    let mut of = |item: &ReadItem| match item {
        Ok(Item::Variable(address)) => Outcome::Variable(came.variable(Ok(*address))),
        Ok(Item::Areas(areas)) => {
            Outcome::Areas(areas.iter().map(|area| area.and_then(|address| came.next(&address))).collect())
        }
        Err(code) => Outcome::Variable(Err(*code)),
    };
    wanted.iter().map(&mut of).collect()
}

/// Appends the items. An area that has come as it was `before` is only marked so.
pub(super) fn write_outcomes(out: &mut Vec<u8>, outcomes: &[Outcome], before: &[Outcome]) {
    for (index, outcome) in outcomes.iter().enumerate() {
        match outcome {
            Outcome::Variable(Ok((ty, bytes))) => write_item(out, ItemCode::DONE, *ty, bytes),
            Outcome::Variable(Err(code)) => write_refused(out, *code),
            Outcome::Areas(areas) => {
                let before = match before.get(index) {
                    Some(Outcome::Areas(before)) => before.as_slice(),
                    _ => &[],
                };
                let each = areas.iter().enumerate().map(|(index, area)| match area {
                    _ if before.get(index) == Some(area) => Err(ItemCode::UNCHANGED),
                    Ok(bytes) => Ok(bytes.as_slice()),
                    Err(code) => Err(*code),
                });
                write_areas(out, each);
            }
        }
    }
}

pub(super) fn read_answer(reference: u16, wanted: &[ReadItem], reply: Reply) -> Vec<u8> {
    let mut data = Vec::new();
    write_outcomes(&mut data, &outcomes(wanted, reply), &[]);
    write(Kind::Answer, reference, Code::DONE, &[function::READ, wanted.len() as u8], &data)
}

/// Codes of all items of a write.
pub(super) fn codes(slots: &[Slot], reply: Reply) -> Vec<ItemCode> {
    let refused = missing(&reply);
    let mut codes = if let Reply::Written(codes) = reply { codes } else { Vec::new() }.into_iter();
    slots.iter().map(|slot| slot.map_or_else(|code| code, |_| codes.next().unwrap_or(refused))).collect()
}

pub(super) fn write_answer(reference: u16, slots: &[Slot], reply: Reply) -> Vec<u8> {
    let codes: Vec<u8> = codes(slots, reply).into_iter().map(|code| code.0).collect();
    write(Kind::Answer, reference, Code::DONE, &[function::WRITE, slots.len() as u8], &codes)
}

impl Connection {
    pub(super) fn read(&mut self, pdu: &Pdu<'_>) -> Step {
        // A read without items, which one client uses to test the connection, gets an empty answer.
        if let [_] | [_, 0] = pdu.parameters {
            return Step::Answer(write(Kind::Answer, pdu.reference, Code::DONE, &[function::READ, 0], &[]));
        }
        let Some(wanted) = of_job(pdu) else { return self.refuse_job(pdu.reference, Code::PDU_SIZE) };
        if HEAD + data_bytes(&wanted) > self.pdu_bytes() {
            return self.refuse_job(pdu.reference, Code::PDU_SIZE);
        }
        let addresses = wanted_addresses(&wanted);
        if addresses.is_empty() {
            return Step::Answer(read_answer(pdu.reference, &wanted, Reply::Done));
        }
        Step::Ask(Ask::Read(addresses), Then::Read(wanted))
    }

    pub(super) fn write(&mut self, pdu: &Pdu<'_>) -> Step {
        let Some(items) = of_job(pdu) else { return self.refuse_job(pdu.reference, Code::PDU_SIZE) };
        // Nobody writes several areas as one item: what its data would be is not known.
        let variable = |item: ReadItem| match item {
            Ok(Item::Variable(address)) => Ok(address),
            Ok(Item::Areas(_)) => Err(ItemCode::TYPE),
            Err(code) => Err(code),
        };
        let mut slots: Vec<Slot> = items.into_iter().map(variable).collect();
        let mut data = DataItems::new(pdu.data);
        let mut puts = Vec::new();
        for slot in &mut slots {
            let Some(Some(item)) = data.next() else { return self.refuse_job(pdu.reference, Code::PDU_SIZE) };
            if !self.may(Rights::Write) {
                *slot = Err(ItemCode::NOT_ALLOWED);
            } else if let Ok(address) = *slot {
                if item.fits(address.ty, address.bytes()) {
                    puts.push(Put { address, bytes: item.bytes.to_vec() });
                } else {
                    *slot = Err(ItemCode::INCONSISTENT);
                }
            }
        }
        if puts.is_empty() {
            self.cyclic.written();
            return Step::Answer(write_answer(pdu.reference, &slots, Reply::Done));
        }
        Step::Ask(Ask::Write(puts), Then::Write(slots))
    }
}
