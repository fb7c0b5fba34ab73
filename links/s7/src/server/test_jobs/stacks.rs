//! The stacks of a CPU in STOP or HOLD: interrupt stack, block stack, local data stack.

use ob1_model::{BlockKind, DebugAnswer, DebugEnd, DebugOrder, Held, HeldBlock};

use super::setup::parts;
use super::telegrams::message;
use super::watch::{DB_OPEN, block_type};
use super::{Ending, NO_CLASS};
use crate::codes::Code;
use crate::server::service::Service;
use crate::server::{Ask, Connection, Reply, Step};
use crate::wire::{Group, UserData, sub};

/// What a local data stack is asked for: priority class, and depth of nesting from 1, the organization block.
type Place = [u8; 2];

impl Connection {
    /// One of the three.
    pub(super) fn stack(&self, service: &UserData<'_>) -> Result<Step, Code> {
        let (_, data) = parts(service.data)?;
        let place = *data.first_chunk::<2>().ok_or(Code::TEST_DATA)?;
        Ok(Self::later(Ask::Debug(DebugOrder::Stack { level: 0 }), of(service.sub, place)))
    }

    pub(super) fn stack_came(
        &mut self,
        reference: u16,
        service: u8,
        place: Option<Place>,
        reply: Reply,
    ) -> Vec<Vec<u8>> {
        let held = match reply {
            Reply::Debug(DebugAnswer { end: DebugEnd::Held | DebugEnd::Stopped, held }) => held,
            Reply::Debug(_) => return vec![self.test_refused(reference, service, Code::TEST_NOT_IN_RUN)],
            Reply::Refused(Code::PROTECTED) => {
                return vec![self.test_refused(reference, service, Code::TEST_PROTECTED)];
            }
            _ => return vec![self.test_refused(reference, service, Code::TEST_NO_ACCESS)],
        };
        let data = match (service, place) {
            (sub::TEST_ISTACK, _) => interrupt(&held),
            (sub::TEST_BSTACK, _) => held.stack.iter().flat_map(block).collect(),
            (_, Some(place)) => match level(&held, place) {
                // The innermost is there already.
                Some(0) => local(&held, 0),
                Some(level) => {
                    let order = DebugOrder::Stack { level };
                    self.follow(Ask::Debug(order), Service::Test(Ending::Local { level }));
                    return Vec::new();
                }
                None => return vec![self.test_refused(reference, service, Code::TEST_DATA)],
            },
            _ => Vec::new(),
        };
        vec![self.stack_answer(reference, service, &data)]
    }

    /// Local data of another block than the innermost.
    pub(super) fn local_came(&mut self, reference: u16, level: u8, reply: Reply) -> Vec<Vec<u8>> {
        let data = match reply {
            Reply::Debug(DebugAnswer { end: DebugEnd::Held | DebugEnd::Stopped, held }) => local(&held, level),
            _ => Vec::new(),
        };
        if data.is_empty() {
            return vec![self.test_refused(reference, sub::TEST_LSTACK, Code::TEST_NOT_IN_RUN)];
        }
        vec![self.stack_answer(reference, sub::TEST_LSTACK, &data)]
    }

    fn stack_answer(&mut self, reference: u16, service: u8, data: &[u8]) -> Vec<u8> {
        let pdu = self.pdu_bytes();
        self.long.first(reference, Group::Test, service, message(NO_CLASS, data), pdu)
    }
}

fn of(service: u8, place: Place) -> Service {
    Service::Test(Ending::Stack { service, place: (service == sub::TEST_LSTACK).then_some(place) })
}

/// The place in the block stack.
fn level(held: &Held, [priority, depth]: Place) -> Option<u8> {
    let of_class = (0..).zip(&held.stack).filter(|(_, block)| block.priority == priority);
    let levels: Vec<u8> = of_class.map(|(level, _)| level).collect();
    // Depth 0: the innermost of the class.
    let from_inside = if depth == 0 { 0 } else { levels.len().checked_sub(depth.into())? };
    levels.get(from_inside).copied()
}

/// Type, number and address of a block.
pub(super) fn place(block: &HeldBlock) -> [u8; 6] {
    let [a, b] = block_type(block.block.kind).to_be_bytes();
    let [c, d] = block.block.number.to_be_bytes();
    let [e, f] = block.address.unwrap_or(0).to_be_bytes();
    [a, b, c, d, e, f]
}

/// Whether DB and DI are open, and their numbers.
pub(super) fn data_blocks([db, di]: [u16; 2]) -> [u8; 6] {
    let open = |number| if number == 0 { 0 } else { DB_OPEN };
    let ([a, b], [c, d]) = (db.to_be_bytes(), di.to_be_bytes());
    [open(db), open(di), a, b, c, d]
}

fn longs(bytes: &mut Vec<u8>, values: &[u32]) {
    bytes.extend(values.iter().flat_map(|value| value.to_be_bytes()));
}

/// Status word, accumulators and address registers as a breakpoint tells them.
pub(super) fn registers(held: &Held) -> Vec<u8> {
    let mut bytes = held.status.to_be_bytes().to_vec();
    longs(&mut bytes, &held.accus[..2]);
    longs(&mut bytes, &held.addresses);
    bytes
}

/// The interrupt stack: nothing if the program was not interrupted.
fn interrupt(held: &Held) -> Vec<u8> {
    let Some(innermost) = held.stack.first() else { return Vec::new() };
    let mut bytes = place(innermost).to_vec();
    bytes.extend(data_blocks(innermost.blocks));
    bytes.extend([0; 4]);
    longs(&mut bytes, &held.accus);
    longs(&mut bytes, &held.addresses);
    bytes.extend([0; 2]);
    bytes.extend(held.status.to_be_bytes());
    bytes.extend(place(innermost));
    bytes.extend([0; 6]);
    bytes.extend(held.start);
    bytes
}

/// An entry of the block stack.
fn block(block: &HeldBlock) -> Vec<u8> {
    let mut bytes = place(block).to_vec();
    bytes.extend(data_blocks(block.blocks));
    bytes.extend([0; 4]);
    if block.block.kind == BlockKind::Ob {
        bytes.extend([block.priority, 0, 0, 0]);
        bytes.extend(block.began);
    }
    bytes
}

fn local(held: &Held, level: u8) -> Vec<u8> {
    let Some(block) = held.stack.get(usize::from(level)) else { return Vec::new() };
    let mut bytes = place(block).to_vec();
    bytes.extend((held.local.len() as u16).to_be_bytes());
    bytes.extend_from_slice(&held.local);
    bytes.extend([block.priority, 0, 0, 0]);
    bytes.extend(block.began);
    bytes
}
