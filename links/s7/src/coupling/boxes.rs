//! A box: a job comes from the CPU piece by piece, and its end goes back.

use ob1_words::boxes::{Answer, BOX_BYTES, DATA_MAX, HEAD_BYTES, Order, PIECE, Service, State, pieces, range, status};

use super::Coupling;
use crate::wire::pbc;

/// The progress of a job.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum Phase {
    /// The box has no job.
    #[default]
    Idle,
    /// Its data are coming from the CPU.
    Collecting,
    /// It is running, or waits.
    Running,
    /// Its data are going to the CPU.
    Giving,
    /// It has ended; the CPU has not seen that yet.
    Ended,
}

/// A part of BSEND that waits for its BRCV, or whose answer waits until the CPU has taken everything.
#[derive(Clone, Copy, Debug)]
pub(super) struct Held {
    pub(super) reference: u16,
    pub(super) unit: u8,
    pub(super) until: u64,
}

/// A box and its job.
#[derive(Debug)]
pub(super) struct Slot {
    pub(super) order: Order,
    pub(super) phase: Phase,
    /// Data of the CPU.
    pub(super) data: Vec<u8>,
    /// Data for the CPU; while BRCV collects, the data so far.
    pub(super) give: Vec<u8>,
    /// Number of pieces received, or the piece shown.
    piece: u16,
    /// A job of an S7 connection waits for a free place.
    pub(super) is_queued: bool,
    /// The count of the connection's bytes at which the telegram has been sent.
    pub(super) out_at: Option<u64>,
    /// BSEND: bytes confirmed, and the number of the current part.
    pub(super) confirmed: usize,
    pub(super) unit: u8,
    /// BRCV: total number of bytes, and the answer the partner waits for.
    pub(super) total: Option<usize>,
    pub(super) held: Option<Held>,
    /// AG_RECV: the number of the TCP connection that has brought the data.
    pub(super) taken_of: u64,
    shown: [u8; BOX_BYTES],
    is_new: bool,
}

impl Default for Slot {
    fn default() -> Self {
        Self {
            order: Order::NONE,
            phase: Phase::Idle,
            data: Vec::new(),
            give: Vec::new(),
            piece: 0,
            is_queued: false,
            out_at: None,
            confirmed: 0,
            unit: 0,
            total: None,
            held: None,
            taken_of: 0,
            shown: [0; BOX_BYTES],
            is_new: false,
        }
    }
}

impl Slot {
    fn show(&mut self, state: State, status: u16) {
        let len = self.give.len();
        let answer = Answer { state, job: self.order.job, piece: self.piece, status, len: len as u32 };
        let (head, data) = self.shown.split_at_mut(HEAD_BYTES);
        head.copy_from_slice(&answer.bytes());
        if state == State::Giving {
            let bytes = self.give.get(range(self.piece, len)).unwrap_or_default();
            data.iter_mut().zip(bytes).for_each(|(place, byte)| *place = *byte);
        }
        self.is_new = true;
    }

    /// Whether it waits for data of the partner.
    pub(super) fn waits_for(&self, service: Service, id: u16, r_id: u32) -> bool {
        self.phase == Phase::Running
            && self.order.service == Some(service)
            && self.order.id == id
            && (service == Service::Receive || self.order.r_id == r_id)
    }
}

impl Coupling {
    /// Learns from the CPU's content of a box that the program has all data of the job in it, which may have ended
    /// since: they are neither given again nor refused to their sender.
    pub fn settle(&mut self, at: usize, block: &[u8; BOX_BYTES], now: u64) {
        self.now = now;
        let Some(head) = block.first_chunk::<HEAD_BYTES>() else { return };
        let order = Order::read(head);
        let Some(slot) = self.slots.get_mut(at).filter(|slot| slot.phase == Phase::Giving) else { return };
        let has_all = order.job == slot.order.job && order.taken >= pieces(slot.give.len());
        if has_all || order.had == slot.order.job {
            slot.phase = Phase::Ended;
            slot.show(State::Done, 0);
            self.taken(at);
        }
    }

    /// Takes the CPU's content of a box.
    pub fn show(&mut self, at: usize, block: &[u8; BOX_BYTES], now: u64) {
        self.settle(at, block, now);
        let Some((head, data)) = block.split_first_chunk::<HEAD_BYTES>() else { return };
        let order = Order::read(head);
        let Some(slot) = self.slots.get(at) else { return };
        if order.service.is_none() || order.job == 0 {
            if slot.phase != Phase::Idle {
                self.cancel(at);
            }
            return;
        }
        if slot.phase == Phase::Idle || slot.order.job != order.job {
            self.cancel(at);
            let Some(slot) = self.slots.get_mut(at) else { return };
            *slot = Slot { order, phase: Phase::Collecting, shown: slot.shown, is_new: slot.is_new, ..Slot::default() };
            if order.len as usize > DATA_MAX {
                self.fail(at, status::LENGTH);
                return;
            }
        }
        let Some(slot) = self.slots.get_mut(at) else { return };
        slot.order.taken = order.taken;
        let is_receive = order.service == Some(Service::Receive);
        if is_receive && slot.phase == Phase::Running && slot.order.room != order.room {
            // RECV has another length now. Data that have come may fit it.
            slot.order.room = order.room;
            return self.wait_for_data(at);
        }
        match slot.phase {
            Phase::Collecting if order.piece == slot.piece => {
                let len = slot.order.len as usize;
                let bytes = range(order.piece, len).len().min(PIECE);
                slot.data.extend_from_slice(data.get(..bytes).unwrap_or_default());
                slot.piece += 1;
                if slot.piece < pieces(len) {
                    slot.show(State::Collecting, 0);
                } else {
                    slot.phase = Phase::Running;
                    slot.show(State::Running, 0);
                    self.begin(at);
                }
            }
            Phase::Giving if order.taken == slot.piece + 1 => {
                slot.piece = order.taken;
                slot.show(State::Giving, 0);
            }
            _ => {}
        }
    }

    /// A box whose content has changed, for the CPU.
    pub fn next_box(&mut self) -> Option<(usize, &[u8; BOX_BYTES])> {
        let (at, slot) = self.slots.iter_mut().enumerate().find(|(_, slot)| slot.is_new)?;
        slot.is_new = false;
        Some((at, &slot.shown))
    }

    /// The job has all its data.
    fn begin(&mut self, at: usize) {
        let Some(order) = self.slots.get(at).map(|slot| slot.order) else { return };
        match order.service {
            Some(Service::Send) => self.send(at),
            Some(Service::Receive) => self.wait_for_data(at),
            Some(Service::Lock) => self.lock(at, true),
            Some(Service::Unlock) => self.lock(at, false),
            Some(Service::Control) => self.control(at),
            Some(Service::Status) => self.status(at),
            Some(Service::Urcv | Service::Brcv) => self.wait_for_blocks(at),
            Some(Service::Usend | Service::Bsend | Service::Put | Service::Get) => {
                let Some(index) = self.s7_link(order.id) else {
                    self.fail(at, status::CONNECTION);
                    return;
                };
                if let Some(slot) = self.slots.get_mut(at) {
                    slot.is_queued = true;
                }
                self.queued(index);
            }
            None => {}
        }
    }

    /// The CPU has taken all data.
    fn taken(&mut self, at: usize) {
        let Some(slot) = self.slots.get_mut(at) else { return };
        let (id, held) = (slot.order.id, slot.held.take());
        let Some(link) = self.link_of(id).and_then(|index| self.links.get_mut(index)) else { return };
        link.traffic.jobs += 1;
        if let (Some(held), Some(connection)) = (held, link.s7()) {
            connection.answer(&pbc::part_answer(held.reference, held.unit, crate::codes::Code::DONE));
        }
    }

    /// The job has ended without error.
    pub(super) fn done(&mut self, at: usize) {
        self.end(at, State::Done, 0);
    }

    /// The job has ended with this STATUS.
    pub(super) fn fail(&mut self, at: usize, status: u16) {
        self.end(at, State::Failed, status);
    }

    fn end(&mut self, at: usize, state: State, status: u16) {
        let Some(slot) = self.slots.get_mut(at) else { return };
        (slot.phase, slot.is_queued, slot.out_at, slot.total) = (Phase::Ended, false, None, None);
        slot.data.clear();
        slot.give.clear();
        slot.show(state, status);
        let id = slot.order.id;
        if let Some(link) = self.link_of(id).and_then(|index| self.links.get_mut(index)) {
            let count = if state == State::Done { &mut link.traffic.jobs } else { &mut link.traffic.errors };
            *count += 1;
        }
    }

    /// Data for the CPU.
    pub(super) fn give(&mut self, at: usize, bytes: Vec<u8>) {
        let Some(slot) = self.slots.get_mut(at) else { return };
        (slot.phase, slot.piece, slot.give) = (Phase::Giving, 0, bytes);
        slot.data.clear();
        slot.show(State::Giving, 0);
    }

    /// The CPU drops a job. If it is an AG_RECV that has not taken all its data, the next AG_RECV gets them.
    fn put_back(&mut self, at: usize) {
        let Some(slot) = self.slots.get_mut(at) else { return };
        if slot.phase != Phase::Giving || slot.order.service != Some(Service::Receive) {
            return;
        }
        let (id, data, number) = (slot.order.id, std::mem::take(&mut slot.give), slot.taken_of);
        if let Some(link) = self.link_of(id).and_then(|index| self.links.get_mut(index)) {
            link.put_back(data, number);
        }
    }

    /// The CPU drops the job.
    pub(super) fn cancel(&mut self, at: usize) {
        self.put_back(at);
        self.abandon(at);
        let Some(slot) = self.slots.get_mut(at) else { return };
        let was_idle = slot.phase == Phase::Idle;
        *slot = Slot { shown: slot.shown, is_new: slot.is_new, ..Slot::default() };
        if !was_idle {
            slot.show(State::None, 0);
        }
    }
}
