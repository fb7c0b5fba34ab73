//! Reading and writing variables: any number of items, each with its own code.

use super::{Ask, Connection, Put, Reply, Step, Then};
use crate::Rights;
use crate::codes::{Code, ItemCode};
use crate::wire::{
    ANSWER_HEAD, Address, DataItems, DataType, Items, Kind, Pdu, function, write, write_item, write_refused,
};

/// An item: its address, or why it cannot be served.
pub(super) type Slot = Result<Address, ItemCode>;

/// Bytes in front of the items of an answer: head, function, count.
const HEAD: usize = ANSWER_HEAD + 2;
/// Bytes in front of an item's data.
const ITEM: usize = 4;

/// The items of a job; `None`: the list is cut off, or empty.
fn slots(pdu: &Pdu<'_>) -> Option<Vec<Slot>> {
    let (&[_, count], items) = pdu.parameters.split_first_chunk::<2>()?;
    let slots: Option<Vec<Slot>> = Items::new(items, usize::from(count)).collect();
    slots.filter(|slots| !slots.is_empty())
}

/// Length of the answer to a read.
fn answer_bytes(slots: &[Slot]) -> usize {
    let item = |slot: &Slot| ITEM + slot.map_or(0, |address| address.bytes().next_multiple_of(2));
    let last = slots.last().map_or(0, |slot| slot.map_or(0, |address| address.bytes() % 2));
    HEAD + slots.iter().map(item).sum::<usize>() - last
}

/// The addresses among the items.
pub(super) fn addresses(slots: &[Slot]) -> Vec<Address> {
    slots.iter().filter_map(|slot| slot.ok()).collect()
}

/// Values or codes of all items: items with an address take theirs from the reply.
pub(super) fn values(slots: &[Slot], reply: Reply) -> Vec<Result<(DataType, Vec<u8>), ItemCode>> {
    let refused = match &reply {
        Reply::Refused(Code::PROTECTED) => ItemCode::NOT_ALLOWED,
        _ => ItemCode::HARDWARE,
    };
    let mut values = match reply {
        Reply::Values(values) => values,
        _ => Vec::new(),
    }
    .into_iter();
    let of = |slot: &Slot| {
        let address = (*slot)?;
        let bytes = values.next().unwrap_or(Err(refused))?;
        // A value of the wrong length would shift all that follow.
        if bytes.len() == address.bytes() { Ok((address.ty, bytes)) } else { Err(ItemCode::HARDWARE) }
    };
    slots.iter().map(of).collect()
}

pub(super) fn read_answer(reference: u16, slots: &[Slot], reply: Reply) -> Vec<u8> {
    let mut data = Vec::new();
    for value in values(slots, reply) {
        match value {
            Ok((ty, bytes)) => write_item(&mut data, ItemCode::DONE, ty, &bytes),
            Err(code) => write_refused(&mut data, code),
        }
    }
    write(Kind::Answer, reference, Code::DONE, &[function::READ, slots.len() as u8], &data)
}

/// Codes of all items of a write.
pub(super) fn codes(slots: &[Slot], reply: Reply) -> Vec<ItemCode> {
    let refused = match &reply {
        Reply::Refused(Code::PROTECTED) => ItemCode::NOT_ALLOWED,
        _ => ItemCode::HARDWARE,
    };
    let mut codes = match reply {
        Reply::Written(codes) => codes,
        _ => Vec::new(),
    }
    .into_iter();
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
        let Some(slots) = slots(pdu) else { return self.refuse_job(pdu.reference, Code::PDU_SIZE) };
        if answer_bytes(&slots) > self.pdu_bytes() {
            return self.refuse_job(pdu.reference, Code::PDU_SIZE);
        }
        let wanted = addresses(&slots);
        if wanted.is_empty() {
            return Step::Answer(read_answer(pdu.reference, &slots, Reply::Done));
        }
        Step::Ask(Ask::Read(wanted), Then::Read(slots))
    }

    pub(super) fn write(&mut self, pdu: &Pdu<'_>) -> Step {
        let Some(mut slots) = slots(pdu) else { return self.refuse_job(pdu.reference, Code::PDU_SIZE) };
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
            return Step::Answer(write_answer(pdu.reference, &slots, Reply::Done));
        }
        Step::Ask(Ask::Write(puts), Then::Write(slots))
    }
}
