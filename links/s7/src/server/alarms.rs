//! Alarms: telegrams of their changes, the query of those that stand, acknowledging and locking. [recorded with an
//! S7-400: messages and queries of ALARM_8 and NOTIFY; the others as the dissector of Wireshark and PLC4X have them]

use ob1_model::{
    ALARM_ORDERS, AlarmAck, AlarmChange, AlarmEvent, AlarmKind, AlarmNow, AlarmOrder, AlarmQuery, AlarmState,
    AlarmTurn, AlarmValues,
};
use ob1_words::any::AnyType;

use super::long::answer;
use super::service::Service;
use super::{Ask, Connection, Step};
use crate::Rights;
use crate::codes::{Code, ItemCode};
use crate::wire::{Group, JOB_HEAD, Telegram, UserData, sub};

/// Functions of the first byte: of what an S7-400 sends, and of an acknowledgement.
const SENT: u8 = 0x40;
/// The first byte of an object, and its syntaxes.
const OBJECT: u8 = 0x12;
const LOCK: u8 = 0x15;
const MESSAGE: u8 = 0x16;
const ACKNOWLEDGEMENT: u8 = 0x19;
const QUERY: u8 = 0x1A;
const EIGHT_SIGNALS: u8 = 0x1C;
/// Queries: all of a type (WinCC has two more numbers for it), or one message number.
const BY_TYPE: [u8; 3] = [0x01, 0x08, 0x09];
const BY_NUMBER: u8 = 0x03;
/// Types of alarms in a query and its answer.
const ALARM_8: u8 = 2;
const ALARM_S: u8 = 4;
/// The function of the answer to a query, and the number of its objects.
const ANSWER: [u8; 2] = [0x00, 0x01];
/// Transport sizes of values, whose length is in bits but for REAL and single bits.
const BIT: u8 = 3;
const BITS: u8 = 4;
const INTEGER: u8 = 5;
const REAL: u8 = 7;
/// Bytes of a message in front of its values: header, parameters, head of the data, time, function, count, object.
const BEFORE_VALUES: usize = JOB_HEAD + 8 + 4 + 8 + 2 + 16;

/// Which alarms an answer has to list.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Wanted {
    Type(u8),
    Number,
}

/// The telegram of a change; none for what has no indication. `lost`: others before it were lost on their way.
pub(super) fn telegram(event: &AlarmEvent, lost: bool, pdu: usize) -> Option<Vec<u8>> {
    let state = &event.state;
    let (sub, mut data) = match event.change {
        AlarmChange::Message { .. } => (indication(state.kind), event.time.wall.to_vec()),
        AlarmChange::Acknowledged => (sub::ALARM_ACKNOWLEDGED, event.time.wall.to_vec()),
        AlarmChange::Locked => (sub::ALARM_LOCKED, Vec::new()),
        AlarmChange::Unlocked => (sub::ALARM_UNLOCKED, Vec::new()),
        AlarmChange::Released | AlarmChange::Deleted | AlarmChange::Lost(_) => return None,
    };
    data.extend_from_slice(&[SENT, 1]);
    match event.change {
        AlarmChange::Message { changed, lost: overflow } => {
            let values = values(&event.values, pdu.saturating_sub(BEFORE_VALUES));
            let eight = state.kind == AlarmKind::Notify8p;
            let syntax = if eight { EIGHT_SIGNALS } else { MESSAGE };
            let more = [changed & !state.signals, changed & state.signals, changed, 0];
            let more = if eight { &more[..] } else { &[] };
            // Messages before this one were lost. No recording shows the byte with another value than 0; for the
            // dissector it has a bit for each signal.
            let flags = if overflow || lost { changed.max(1) } else { 0 };
            object(&mut data, syntax, values.len() as u8, state.id, &[state.signals, flags, state.going, state.coming]);
            if let Some(len) = data.get_mut(11) {
                *len += more.len() as u8;
            }
            data.extend_from_slice(more);
            for (index, value) in values.iter().enumerate() {
                data.extend_from_slice(value);
                let is_last = index + 1 == values.len();
                data.extend((!is_last && value.len() % 2 == 1).then_some(0));
            }
        }
        AlarmChange::Acknowledged => {
            object(&mut data, ACKNOWLEDGEMENT, 0, state.id, &[state.going, state.coming]);
        }
        _ => object(&mut data, LOCK, 0, state.id, &[]),
    }
    Some(UserData { telegram: Telegram::Message, ..UserData::job(Group::Cpu, sub, &data) }.write(0))
}

const fn indication(kind: AlarmKind) -> u8 {
    match kind {
        AlarmKind::Alarm | AlarmKind::Alarm8 | AlarmKind::Alarm8p => sub::ALARM_8,
        AlarmKind::Notify => sub::NOTIFY,
        AlarmKind::Notify8p => sub::NOTIFY_8,
        AlarmKind::AlarmSq | AlarmKind::AlarmDq => sub::ALARM_SQ,
        AlarmKind::AlarmS | AlarmKind::AlarmD => sub::ALARM_S,
    }
}

/// An object: its length counts what follows.
fn object(data: &mut Vec<u8>, syntax: u8, values: u8, id: u32, rest: &[u8]) {
    data.extend_from_slice(&[OBJECT, 6 + rest.len() as u8, syntax, values]);
    data.extend_from_slice(&id.to_be_bytes());
    data.extend_from_slice(rest);
}

/// The values as items of a read, as many as fit.
fn values(values: &AlarmValues, room: usize) -> Vec<Vec<u8>> {
    let items = values.iter().map(|(ty, bytes)| item(ty, bytes));
    let fits = items.scan(0, |used, item| {
        *used += item.len().next_multiple_of(2);
        (*used <= room).then_some(item)
    });
    fits.collect()
}

fn item(ty: u8, bytes: &[u8]) -> Vec<u8> {
    let (size, len) = match AnyType::of(ty) {
        Some(AnyType::Bool) => (BIT, 1),
        Some(AnyType::Int | AnyType::DInt) => (INTEGER, 8 * bytes.len()),
        Some(AnyType::Real) => (REAL, bytes.len()),
        _ => (BITS, 8 * bytes.len()),
    };
    let mut item = vec![ItemCode::DONE.0, size];
    item.extend_from_slice(&(len as u16).to_be_bytes());
    item.extend_from_slice(bytes);
    item
}

impl Connection {
    /// A query of the alarms that are active or not acknowledged.
    pub(super) fn query_alarms(&mut self, reference: u16, service: &UserData<'_>) -> Step {
        let &[_, _, _, _, QUERY, _, by, _, a, b, c, d, ..] = service.data else {
            return self.refuse_service(reference, service, Code::NO_INFORMATION);
        };
        let value = u32::from_be_bytes([a, b, c, d]);
        let (query, wanted) = match by {
            BY_NUMBER => (AlarmQuery::Number(value), Wanted::Number),
            by if BY_TYPE.contains(&by) => (AlarmQuery::Standing, Wanted::Type(d)),
            _ => return self.refuse_service(reference, service, Code::NO_INFORMATION),
        };
        Self::later(Ask::Alarms(AlarmOrder::Query(query)), Service::AlarmQuery(wanted))
    }

    pub(super) fn alarms_answer(&mut self, reference: u16, wanted: Wanted, list: &[AlarmNow]) -> Vec<u8> {
        let is_function = match wanted {
            Wanted::Type(ty) => ty == ALARM_S,
            Wanted::Number => list.iter().any(|now| now.state.kind.is_function()),
        };
        let known = !matches!(wanted, Wanted::Type(ty) if ty != ALARM_8 && ty != ALARM_S);
        let list: Vec<_> = list.iter().filter(|now| known && now.state.kind.is_function() == is_function).collect();
        let mut data = ANSWER.to_vec();
        if list.is_empty() {
            data.extend_from_slice(&[ItemCode::NO_OBJECT.0, 0, 0, 0]);
        } else if is_function {
            data.extend_from_slice(&[ItemCode::DONE.0, 9, 0xFF, 0xFF]);
            list.iter().for_each(|now| data.extend(entry_of_function(now)));
            data.push(0);
        } else {
            let entries: Vec<u8> = list.iter().flat_map(|now| entry(&now.state, ALARM_8, &[])).collect();
            data.extend_from_slice(&[ItemCode::DONE.0, 9]);
            data.extend_from_slice(&(entries.len() as u16).to_be_bytes());
            data.extend(entries);
        }
        let pdu = self.pdu_bytes();
        self.long.first(reference, Group::Cpu, sub::ALARM_QUERY, data, pdu)
    }

    /// Acknowledges, locks, unlocks: function, count, and so many objects.
    pub(super) fn order_alarms(&mut self, reference: u16, service: &UserData<'_>) -> Step {
        if self.rights < Rights::Write {
            return self.refuse_service(reference, service, Code::PROTECTED);
        }
        let order = objects(service).and_then(|(function, objects)| {
            let order = match service.sub {
                sub::ALARM_ACKNOWLEDGE => {
                    let ack = |object: &&[u8]| match **object {
                        [ACKNOWLEDGEMENT, _, a, b, c, d, going, coming] => {
                            Some(AlarmAck { id: u32::from_be_bytes([a, b, c, d]), coming, going })
                        }
                        _ => None,
                    };
                    AlarmOrder::Acknowledge(objects.iter().map(ack).collect::<Option<_>>()?)
                }
                sub => {
                    let id = |object: &&[u8]| match **object {
                        [LOCK, _, a, b, c, d, ..] => Some(u32::from_be_bytes([a, b, c, d])),
                        _ => None,
                    };
                    let ids = objects.iter().map(id).collect::<Option<_>>()?;
                    AlarmOrder::Lock { ids, locked: sub == sub::ALARM_LOCK }
                }
            };
            Some((function, order))
        });
        match order {
            Some((function, order)) => {
                Self::later(Ask::Alarms(order), Service::AlarmOrder { sub: service.sub, function })
            }
            None => self.refuse_service(reference, service, Code::NO_INFORMATION),
        }
    }

    pub(super) fn ordered(reference: u16, sub: u8, function: u8, found: &[bool]) -> Vec<u8> {
        let mut data = vec![function, found.len() as u8];
        data.extend(found.iter().map(|found| if *found { ItemCode::DONE.0 } else { ItemCode::NO_OBJECT.0 }));
        answer(reference, Group::Cpu, sub, &data)
    }
}

/// The function and the objects of an order, from their syntax on.
fn objects<'d>(service: &UserData<'d>) -> Option<(u8, Vec<&'d [u8]>)> {
    let (&[function, count], mut rest) = service.data.split_first_chunk::<2>()?;
    if usize::from(count) > ALARM_ORDERS {
        return None;
    }
    let mut list = Vec::with_capacity(usize::from(count));
    for _ in 0..count {
        let (&[OBJECT, len], after) = rest.split_first_chunk::<2>()? else { return None };
        let (object, after) = after.split_at_checked(usize::from(len))?;
        list.push(object);
        rest = after;
    }
    Some((function, list))
}

/// An entry of a list: its first byte counts what follows less one.
fn entry(state: &AlarmState, ty: u8, more: &[u8]) -> Vec<u8> {
    let mut entry = vec![0, 0, 0, ty];
    entry.extend_from_slice(&state.id.to_be_bytes());
    entry.extend_from_slice(&[0, state.signals, state.going, state.coming]);
    entry.extend_from_slice(more);
    let len = u8::try_from(entry.len() - 2).unwrap_or(u8::MAX);
    if let Some(first) = entry.first_mut() {
        *first = len;
    }
    entry
}

/// The same with the times and values of coming and going.
fn entry_of_function(now: &AlarmNow) -> Vec<u8> {
    let turn = |turn: &Option<AlarmTurn>| {
        let (wall, value) = match turn {
            Some(turn) => (turn.time.wall, turn.values.iter().next().map(|(ty, bytes)| item(ty, bytes))),
            None => ([0; 8], None),
        };
        let value = value.unwrap_or_else(|| vec![ItemCode::NO_OBJECT.0, 0, 0, 0]);
        [&wall[..], &value].concat()
    };
    entry(&now.state, ALARM_S, &[turn(&now.came), turn(&now.went)].concat())
}
