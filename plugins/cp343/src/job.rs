//! A job of the CP: data are passed in pieces, one piece for each call, in both directions.

use ob1_sdk::{Abort, Cx, Refused};
use ob1_words::boxes::{
    Answer, BOX_BYTES, HEAD_BYTES, ITEM_BYTES, ITEMS_MAX, Order, Service, State, pieces, range, record,
};

use crate::area::Spans;
use crate::state::{CpState, Phase, Slot};

/// Maximum header before the data: the number of items, for each item a length and an ANY pointer.
const FRONT: usize = 1 + ITEMS_MAX * (2 + ITEM_BYTES);
/// Maximum bytes of a result that is not stored in memory of the program.
pub(crate) const SMALL: usize = 8;

/// The request of a call.
#[derive(Debug)]
pub(crate) struct Wanted {
    /// Address of the module.
    pub(crate) laddr: u32,
    /// The block: no other block has this number at the module.
    pub(crate) owner: u64,
    /// Starts a job, if none is running.
    pub(crate) begins: bool,
    pub(crate) service: Service,
    pub(crate) id: u16,
    pub(crate) r_id: u32,
    /// The header before the data.
    pub(crate) front: ([u8; FRONT], usize),
    pub(crate) source: Spans,
    /// Memory for the data of the CP.
    pub(crate) target: Spans,
    /// Or a short result.
    pub(crate) small: [u8; SMALL],
}

impl Wanted {
    pub(crate) fn new(laddr: u32, owner: u64, service: Service, id: u16) -> Self {
        Self {
            laddr,
            owner,
            begins: false,
            service,
            id,
            r_id: 0,
            front: ([0; FRONT], 0),
            source: Spans::NONE,
            target: Spans::NONE,
            small: [0; SMALL],
        }
    }

    /// Adds bytes to the header before the data.
    pub(crate) fn put_front(&mut self, bytes: &[u8]) {
        let (front, len) = &mut self.front;
        for byte in bytes {
            if let Some(place) = front.get_mut(*len) {
                *place = *byte;
                *len += 1;
            }
        }
    }

    fn len(&self) -> u32 {
        self.front.1 as u32 + self.source.len()
    }

    fn room(&self) -> u32 {
        if self.target.len() > 0 { self.target.len() } else { SMALL as u32 }
    }
}

/// The outcome of a call.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum End {
    /// No job, and none was begun.
    Idle,
    /// The job is running.
    Running,
    /// Ended without error, with this number of bytes from the CP.
    Done(u32),
    /// Ended with this STATUS from the CP.
    Failed(u16),
    /// The module does not exist, or is not a CP 343.
    NoModule,
    /// The CP does not answer, or has restarted.
    Absent,
    /// All boxes are in use.
    Full,
    /// The memory of the program cannot be read or written.
    Memory(Refused),
    /// The length of the program's memory has changed while data were being passed: what is left does not fit.
    Length,
}

/// One call: one step of the job.
pub(crate) fn turn(cx: &mut Cx<'_, CpState>, wanted: &mut Wanted) -> Result<End, Abort> {
    let (Ok(info), Ok(state)) = (cx.module_info(wanted.laddr)?, cx.module_state(wanted.laddr)?) else {
        return Ok(End::NoModule);
    };
    let Some((index, slot)) = state.slot(wanted.owner, wanted.begins) else {
        return Ok(if wanted.begins { End::Full } else { End::Idle });
    };
    let is_busy = slot.phase() != Phase::Idle;
    if !info.present || is_busy && slot.generation.get() != info.generation {
        slot.set(Phase::Idle);
        return Ok(if is_busy || wanted.begins { End::Absent } else { End::Idle });
    }
    slot.generation.set(info.generation);
    let mut head = [0; HEAD_BYTES];
    let record = record(index);
    if cx.record_read(wanted.laddr, record, &mut head)? != Ok(HEAD_BYTES) {
        slot.set(Phase::Idle);
        return Ok(End::NoModule);
    }
    let answer = Answer::read(&head);
    // The length to be received has changed. Data that are there already are taken: the CP has confirmed them.
    let is_there = answer.job == slot.job.get() && answer.state == State::Giving;
    let is_other = slot.phase() == Phase::Giving && wanted.begins && slot.room.get() != wanted.room() && !is_there;
    if is_other && wanted.service == Service::Receive {
        // The same order with another length: data that come meanwhile are still those of this order.
        slot.room.set(wanted.room());
        return give(cx, wanted, slot, record);
    }
    if !is_busy || is_other {
        if !wanted.begins {
            return Ok(End::Idle);
        }
        let mut number = answer.job.wrapping_add(1).max(1);
        if number == slot.job.get() {
            number = number.wrapping_add(1).max(1);
        }
        slot.job.set(number);
        if slot.had.get() == number {
            slot.had.set(0);
        }
        slot.set(Phase::Giving);
        slot.piece.set(0);
        slot.room.set(wanted.room());
        slot.len.set(wanted.len());
        return give(cx, wanted, slot, record);
    }
    if answer.job != slot.job.get() {
        return Ok(End::Running);
    }
    match answer.state {
        State::Collecting if slot.phase() == Phase::Giving && slot.piece.get().checked_add(1) == Some(answer.piece) => {
            if wanted.len() != slot.len.get() {
                cancel(cx, wanted.laddr, wanted.owner)?;
                return Ok(End::Length);
            }
            slot.piece.set(answer.piece);
            give(cx, wanted, slot, record)
        }
        State::Giving => {
            if slot.phase() == Phase::Giving {
                slot.set(Phase::Taking);
                slot.piece.set(0);
            }
            if answer.piece == slot.piece.get() { take(cx, wanted, slot, record) } else { Ok(End::Running) }
        }
        State::Done => {
            slot.set(Phase::Idle);
            Ok(End::Done(0))
        }
        State::Failed => {
            slot.set(Phase::Idle);
            Ok(End::Failed(answer.status))
        }
        State::None | State::Collecting | State::Running => Ok(End::Running),
    }
}

/// Cancels a job; true if there was one.
pub(crate) fn cancel(cx: &mut Cx<'_, CpState>, laddr: u32, owner: u64) -> Result<bool, Abort> {
    let Ok(state) = cx.module_state(laddr)? else { return Ok(false) };
    let Some((index, slot)) = state.slot(owner, false).filter(|(_, slot)| slot.phase() != Phase::Idle) else {
        return Ok(false);
    };
    slot.set(Phase::Idle);
    // If the CP is gone, its job is gone too.
    let _told = cx.record_write(laddr, record(index), &Order { had: slot.had.get(), ..Order::NONE }.bytes())?;
    Ok(true)
}

fn order(wanted: &Wanted, slot: &Slot) -> Order {
    Order {
        service: Some(wanted.service),
        job: slot.job.get(),
        id: wanted.id,
        r_id: wanted.r_id,
        piece: slot.piece.get(),
        len: slot.len.get(),
        taken: 0,
        had: slot.had.get(),
        room: slot.room.get(),
    }
}

/// Shows the CP the next piece.
fn give(cx: &mut Cx<'_, CpState>, wanted: &Wanted, slot: &Slot, record: u8) -> Result<End, Abort> {
    let mut block = [0; BOX_BYTES];
    let (head, data) = block.split_at_mut(HEAD_BYTES);
    head.copy_from_slice(&order(wanted, slot).bytes());
    let piece = range(slot.piece.get(), wanted.len() as usize);
    let front = wanted.front.0.get(..wanted.front.1).unwrap_or_default();
    let data = data.get_mut(..piece.len()).unwrap_or_default();
    let ahead = front.get(piece.start.min(front.len())..).unwrap_or_default();
    let ahead = ahead.get(..ahead.len().min(data.len())).unwrap_or_default();
    let (begin, rest) = data.split_at_mut(ahead.len());
    begin.copy_from_slice(ahead);
    let from = (piece.start + ahead.len()).saturating_sub(front.len());
    if let Err(refused) = wanted.source.read(cx, from as u32, rest)? {
        cancel(cx, wanted.laddr, wanted.owner)?;
        return Ok(End::Memory(refused));
    }
    let shown = block.get(..HEAD_BYTES + piece.len()).unwrap_or_default();
    Ok(match cx.record_write(wanted.laddr, record, shown)? {
        Ok(()) => End::Running,
        Err(_) => {
            slot.set(Phase::Idle);
            End::Absent
        }
    })
}

/// Takes the piece the CP shows.
fn take(cx: &mut Cx<'_, CpState>, wanted: &mut Wanted, slot: &Slot, record: u8) -> Result<End, Abort> {
    let mut block = [0; BOX_BYTES];
    if cx.record_read(wanted.laddr, record, &mut block)? != Ok(BOX_BYTES) {
        return Ok(End::Running);
    }
    let Some((head, data)) = block.split_first_chunk::<HEAD_BYTES>() else { return Ok(End::Running) };
    let answer = Answer::read(head);
    if answer.state != State::Giving || answer.job != slot.job.get() || answer.piece != slot.piece.get() {
        return Ok(End::Running);
    }
    // If a partner gives more than it was asked for, the rest is ignored. Received data stay whole.
    let is_received = wanted.service == Service::Receive;
    let len = if is_received { answer.len } else { answer.len.min(slot.room.get()) };
    if len > wanted.room() {
        cancel(cx, wanted.laddr, wanted.owner)?;
        return Ok(End::Length);
    }
    let piece = range(answer.piece, len as usize);
    let bytes = data.get(..piece.len()).unwrap_or_default();
    if wanted.target.len() > 0 {
        if let Err(refused) = wanted.target.write(cx, piece.start as u32, bytes)? {
            cancel(cx, wanted.laddr, wanted.owner)?;
            return Ok(End::Memory(refused));
        }
    } else {
        wanted.small.iter_mut().zip(bytes).for_each(|(place, byte)| *place = *byte);
    }
    let taken = answer.piece.saturating_add(1);
    slot.piece.set(taken);
    if taken >= pieces(len as usize) {
        // The next job may be in the box before the CP has seen this: what the program has is not given a second time,
        // and not refused to its sender.
        slot.had.set(slot.job.get());
    }
    let order = Order { taken, ..order(wanted, slot) };
    let told = cx.record_write(wanted.laddr, record, &order.bytes())?;
    let end = stored(taken, len, told.is_ok());
    if end != End::Running {
        slot.set(Phase::Idle);
    }
    Ok(end)
}

/// The outcome of a call that has stored one more piece, `taken` in all, of `len` bytes; `told`: the CP has been told.
fn stored(taken: u16, len: u32, told: bool) -> End {
    if taken >= pieces(len as usize) {
        End::Done(len)
    } else if told {
        End::Running
    } else {
        // The CP is gone, and the pieces stored so far are not the data.
        End::Absent
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pieces_without_the_rest_are_not_done() {
        for (taken, len, told, end) in [
            (1, 0, true, End::Done(0)),
            (1, 480, true, End::Done(480)),
            (1, 480, false, End::Done(480)),
            (1, 481, true, End::Running),
            (1, 481, false, End::Absent),
            (2, 481, false, End::Done(481)),
            (u16::MAX, 481, true, End::Done(481)),
        ] {
            assert_eq!(stored(taken, len, told), end, "{taken} of {len} bytes, told {told}");
        }
    }
}
