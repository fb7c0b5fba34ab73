//! The jobs of AG_SEND, AG_RECV, AG_LOCK, AG_UNLOCK, AG_CNTRL and C_CNTRL.

use ob1_words::boxes::{Service, status};

use super::boxes::Phase;
use super::{Condition, ConnectionKind, Coupling};

/// CMD of AG_CNTRL: what is asked of a connection, or of all.
mod command {
    pub(super) const NOP: u16 = 0;
    pub(super) const STATUS: u16 = 1;
    pub(super) const RESET: u16 = 2;
    pub(super) const STATUS_ALL: u16 = 3;
    pub(super) const RESET_ALL: u16 = 4;
    pub(super) const CLEAR_LOCK: u16 = 5;
    pub(super) const CLEAR_LOCK_ALL: u16 = 6;
}

/// Maximum data of a UDP telegram.
const UDP_MAX: usize = 2048;
/// Maximum data of AG_SEND and AG_LSEND.
const SEND_MAX: usize = 8192;

impl Coupling {
    /// The connection of a job of the AG blocks; a job without one ends.
    fn ag_link(&mut self, at: usize) -> Option<usize> {
        let id = self.slots.get(at)?.order.id;
        let Some(index) = self.link_of(id) else {
            self.fail(at, status::ID);
            return None;
        };
        if self.links.get(index).is_some_and(|link| link.spec.kind == ConnectionKind::S7) {
            self.fail(at, status::NOT_CONFIGURED);
            return None;
        }
        Some(index)
    }

    pub(super) fn send(&mut self, at: usize) {
        let Some(index) = self.ag_link(at) else { return };
        let (Some(slot), Some(link)) = (self.slots.get_mut(at), self.links.get_mut(index)) else { return };
        let most = if link.spec.kind == ConnectionKind::Udp { UDP_MAX } else { SEND_MAX };
        let refused = match link.condition() {
            _ if slot.data.is_empty() || slot.data.len() > most => Some(status::LENGTH),
            _ if link.is_locked => Some(status::LOCKED),
            Condition::Up => None,
            Condition::Down | Condition::Coming => Some(status::NOT_CONNECTED),
        };
        match refused {
            Some(why) => self.fail(at, why),
            None => {
                slot.out_at = Some(link.send(&slot.data));
                self.flushed(index);
            }
        }
    }

    /// Ends the jobs whose telegrams have been sent.
    pub(super) fn flushed(&mut self, index: usize) {
        let Some((id, out)) = self.links.get(index).map(|link| (link.spec.id, link.out())) else { return };
        for at in 0..self.slots.len() {
            let is_out = self.slots.get(at).is_some_and(|slot| {
                slot.phase == Phase::Running && slot.order.id == id && slot.out_at.is_some_and(|until| until <= out)
            });
            if is_out {
                self.done(at);
            }
        }
    }

    pub(super) fn wait_for_data(&mut self, at: usize) {
        if let Some(index) = self.ag_link(at) {
            self.waiting(index);
        }
    }

    /// Gives received data to the block that waits for them.
    pub(super) fn waiting(&mut self, index: usize) {
        let Some(link) = self.links.get_mut(index) else { return };
        let id = link.spec.id;
        let Some(at) = self.slots.iter().position(|slot| slot.waits_for(Service::Receive, id, 0)) else { return };
        let room = self.slots.get(at).map_or(0, |slot| slot.order.room as usize);
        if room == 0 {
            self.fail(at, status::LENGTH);
            return;
        }
        if link.is_locked {
            return;
        }
        match link.take(room) {
            None => {}
            Some((bytes, _)) if bytes.len() > room => self.fail(at, status::LENGTH),
            Some((bytes, number)) => {
                if let Some(slot) = self.slots.get_mut(at) {
                    slot.taken_of = number;
                }
                self.give(at, bytes);
            }
        }
    }

    pub(super) fn lock(&mut self, at: usize, locked: bool) {
        let Some(index) = self.ag_link(at) else { return };
        if let Some(link) = self.links.get_mut(index) {
            link.is_locked = locked;
            let id = link.spec.id;
            let sends = self.slots.iter().position(|slot| slot.waits_for(Service::Send, id, slot.order.r_id));
            if let Some(sends) = sends.filter(|_| locked) {
                self.fail(sends, status::LOCKED);
            }
        }
        self.done(at);
    }

    /// AG_CNTRL: the two results.
    pub(super) fn control(&mut self, at: usize) {
        let Some(slot) = self.slots.get(at) else { return };
        let command = match *slot.data {
            [high, low] => u16::from_be_bytes([high, low]),
            _ => u16::MAX,
        };
        let is_for_all =
            matches!(command, command::NOP | command::STATUS_ALL | command::RESET_ALL | command::CLEAR_LOCK_ALL);
        let index = if is_for_all {
            None
        } else {
            let Some(index) = self.ag_link(at) else { return };
            Some(index)
        };
        let mut results = [0u32; 2];
        match (command, index) {
            (command::NOP, _) => {}
            (command::STATUS, Some(index)) => results[0] = self.status_bits(index),
            (command::RESET, Some(index)) => {
                self.reset(index);
                results[0] = 1;
            }
            (command::CLEAR_LOCK, Some(index)) => {
                if let Some(link) = self.links.get_mut(index) {
                    link.is_locked = false;
                }
            }
            (command::STATUS_ALL, _) => {
                for link in self.links.iter().filter(|link| link.condition() == Condition::Up) {
                    let bit = usize::from(link.spec.id.saturating_sub(1));
                    if let Some(result) = results.get_mut(bit / 32) {
                        *result |= 1 << (bit % 32);
                    }
                }
            }
            (command::RESET_ALL, _) => {
                (0..self.links.len()).for_each(|index| self.reset(index));
                results[0] = 1;
            }
            (command::CLEAR_LOCK_ALL, _) => self.links.iter_mut().for_each(|link| link.is_locked = false),
            _ => {
                self.fail(at, status::COMMAND);
                return;
            }
        }
        self.give(at, results.iter().flat_map(|result| result.to_be_bytes()).collect());
    }

    /// RESULT1 of CN_STATUS: bits 0 and 1 sending, 2 and 3 receiving, 4 and 5 the connection.
    fn status_bits(&self, index: usize) -> u32 {
        let Some(link) = self.links.get(index) else { return 0 };
        let is_at =
            |service| u32::from(self.slots.iter().any(|slot| slot.waits_for(service, link.spec.id, slot.order.r_id)));
        let connection = match (link.condition(), link.spec.active) {
            (Condition::Up, _) => 3,
            (Condition::Coming, true) => 1,
            (Condition::Coming | Condition::Down, false) => 2,
            (Condition::Down, true) => 0,
        };
        is_at(Service::Send) | is_at(Service::Receive) << 2 | connection << 4
    }

    fn reset(&mut self, index: usize) {
        if self.links.get(index).is_some_and(|link| link.spec.kind != ConnectionKind::Udp) {
            self.drop_link(index);
        }
    }

    /// C_CNTRL: C_STATUS of a connection; FFh: there is no such connection.
    pub(super) fn status(&mut self, at: usize) {
        let Some(id) = self.slots.get(at).map(|slot| slot.order.id) else { return };
        let status: u16 = match self.link_of(id).map(|index| self.condition(index).0) {
            None => 0x00FF,
            Some(Condition::Down) => 0,
            Some(Condition::Coming) => 1,
            Some(Condition::Up) => 2,
        };
        self.give(at, status.to_be_bytes().to_vec());
    }
}
