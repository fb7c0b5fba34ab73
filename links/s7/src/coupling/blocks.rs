//! USEND, URCV, BSEND, BRCV, PUT and GET on an S7 connection: their jobs, and the telegrams for them.

use ob1_words::boxes::{BSEND_MAX, Service, pieces, status};

use super::boxes::{Held, Phase};
use super::connection::Own;
use super::vars;
use super::{Condition, ConnectionKind, Coupling, NOT_READY, PATIENCE, TAKING};
use crate::client::Came;
use crate::codes::Code;
use crate::wire::pbc::{self, Sent};
use crate::wire::{Kind, UserData};

/// The codes that refuse a part of BSEND, and the STATUS of the sender.
const REFUSALS: [(Code, u16); 3] =
    [(Code::NO_SERVICE, status::R_ID), (Code::PDU_SIZE, status::AREA), (Code::COORDINATION, status::DISABLED)];

fn refusal(wanted: u16) -> Code {
    REFUSALS.iter().find(|(_, status)| *status == wanted).map_or(Code::SERVICE, |(code, _)| *code)
}

fn status_of(code: Code) -> u16 {
    REFUSALS.iter().find(|(known, _)| *known == code).map_or(status::REFUSED, |(_, status)| *status)
}

impl Coupling {
    /// The S7 connection of an ID.
    pub(super) fn s7_link(&self, id: u16) -> Option<usize> {
        self.link_of(id).filter(|index| self.links.get(*index).is_some_and(|l| l.spec.kind == ConnectionKind::S7))
    }

    /// Sends the waiting jobs of a connection as long as there is a free place.
    pub(super) fn queued(&mut self, index: usize) {
        let Some(id) = self.links.get(index).map(|link| link.spec.id) else { return };
        for at in 0..self.slots.len() {
            let waits = |slot: &super::Slot| slot.is_queued && slot.phase == Phase::Running && slot.order.id == id;
            if !self.slots.get(at).is_some_and(waits) {
                continue;
            }
            let Some(link) = self.links.get_mut(index) else { return };
            if link.condition() != Condition::Up {
                self.fail(at, status::CONNECTION);
                continue;
            }
            if link.s7().is_none_or(|connection| connection.places() == 0) {
                return;
            }
            if let Some(slot) = self.slots.get_mut(at) {
                slot.is_queued = false;
            }
            match self.slots.get(at).and_then(|slot| slot.order.service) {
                Some(Service::Usend) => self.usend(at, index),
                Some(Service::Bsend) => self.bsend(at, index),
                Some(Service::Put) => self.variables(at, index, true),
                Some(Service::Get) => self.variables(at, index, false),
                _ => {}
            }
        }
    }

    /// Sends a job of a box.
    pub(super) fn own_job(&mut self, at: usize, index: usize, kind: Kind, parameters: &[u8], data: &[u8]) {
        let (Some(slot), Some(link)) = (self.slots.get(at), self.links.get_mut(index)) else { return };
        let is_last_part = slot.order.service == Some(Service::Bsend) && slot.confirmed >= slot.data.len();
        let taking = if is_last_part { u64::from(pieces(slot.data.len())) * TAKING } else { 0 };
        let Some(reference) = link.s7().map(|connection| connection.own_job(kind, parameters, data)) else { return };
        link.own.push(Own { reference, at, job: slot.order.job, until: self.now + PATIENCE + taking });
    }

    fn usend(&mut self, at: usize, index: usize) {
        let most = pbc::usend_bytes(self.agreed_pdu(index));
        let (Some(slot), Some(link)) = (self.slots.get_mut(at), self.links.get_mut(index)) else { return };
        let areas =
            vars::areas(&slot.data).filter(|areas| areas.iter().map(|area| area.len() + 5).sum::<usize>() <= most + 5);
        let Some(areas) = areas else {
            self.fail(at, status::AREA);
            return;
        };
        let (parameters, data) = pbc::usend(slot.order.r_id, &areas);
        if let Some(connection) = link.s7() {
            connection.own_message(&parameters, &data);
        }
        slot.out_at = Some(link.out_with_this());
    }

    /// The next part of a BSEND.
    fn bsend(&mut self, at: usize, index: usize) {
        let most = pbc::part_bytes(self.agreed_pdu(index));
        let Some(slot) = self.slots.get_mut(at) else { return };
        let (from, all) = (slot.confirmed, slot.data.len());
        let total = (from == 0).then_some(all as u16);
        let room = most.saturating_sub(if total.is_some() { 2 } else { 0 }).max(1);
        let part = slot.data.get(from..(from + room).min(all)).unwrap_or_default().to_vec();
        if all > BSEND_MAX || all == 0 {
            self.fail(at, status::AREA);
            return;
        }
        let more = from + part.len() < all;
        slot.unit = if from == 0 && !more { 0 } else { slot.unit.wrapping_add(1).max(1) };
        let (parameters, data) = pbc::part(slot.order.r_id, slot.unit, more, total, &part);
        slot.confirmed = from + part.len();
        self.own_job(at, index, Kind::UserData, &parameters, &data);
    }

    /// Handles everything the partner has sent for our blocks.
    pub(super) fn came(&mut self, index: usize) {
        while let Some(came) = self.links.get_mut(index).and_then(super::Link::s7).and_then(|s7| s7.take_came()) {
            match pbc::read(&came.parameters, &came.data) {
                Some(Sent::Usend { r_id, items }) if came.kind == Kind::UserData => {
                    if let Some(link) = self.links.get_mut(index) {
                        link.keep(r_id, items.to_vec());
                    }
                    self.unread(index);
                }
                Some(Sent::Part { .. }) if came.kind == Kind::UserData => self.part(index, came),
                _ => self.answer(index, &came),
            }
        }
    }

    /// An answer to a job of ours.
    fn answer(&mut self, index: usize, came: &Came) {
        let Some(link) = self.links.get_mut(index) else { return };
        let Some(own) = link.own.iter().position(|own| own.reference == came.reference) else { return };
        let own = link.own.swap_remove(own);
        let Some(slot) = self.slots.get_mut(own.at) else { return };
        // The CPU has begun another job in this box.
        if slot.order.job != own.job || slot.phase != Phase::Running {
            return;
        }
        match slot.order.service {
            Some(Service::Bsend) => {
                let error = UserData::read(&came.parameters, &[]).map_or(Code::NO_SERVICE, |service| service.error);
                if came.error != Code::DONE || error != Code::DONE {
                    self.fail(own.at, status_of(if came.error == Code::DONE { error } else { came.error }));
                } else if slot.confirmed >= slot.data.len() {
                    self.done(own.at);
                } else {
                    slot.is_queued = true;
                }
            }
            Some(Service::Put) => match vars::put_end(came) {
                Ok(()) => self.done(own.at),
                Err(status) => self.fail(own.at, status),
            },
            Some(Service::Get) => match vars::get_end(came, &slot.data, slot.order.room as usize) {
                Ok(bytes) => self.give(own.at, bytes),
                Err(status) => self.fail(own.at, status),
            },
            _ => {}
        }
    }

    /// URCV or BRCV starts to wait.
    pub(super) fn wait_for_blocks(&mut self, at: usize) {
        let Some(order) = self.slots.get(at).map(|slot| slot.order) else { return };
        let Some(index) = self.s7_link(order.id) else {
            self.fail(at, status::CONNECTION);
            return;
        };
        let is_other = |(other, slot): (usize, &super::Slot)| {
            let service = order.service.unwrap_or(Service::Urcv);
            other != at && slot.waits_for(service, order.id, order.r_id)
        };
        if self.slots.iter().enumerate().any(is_other) {
            self.fail(at, status::TWICE);
            return;
        }
        if let Some(link) = self.links.get_mut(index) {
            link.know(order.r_id);
        }
        self.unread(index);
        let waiting = self.links.get_mut(index).and_then(|link| link.parts.remove(&order.r_id));
        if let Some((_, came)) = waiting {
            self.part(index, came);
        }
    }

    /// Gives data of USEND to the waiting URCV.
    fn unread(&mut self, index: usize) {
        let Some(link) = self.links.get_mut(index) else { return };
        let id = link.spec.id;
        let waits = |r_id: &u32| self.slots.iter().position(|slot| slot.waits_for(Service::Urcv, id, *r_id));
        let found = link.inbox.keys().find_map(|r_id| Some((*r_id, waits(r_id)?)));
        let Some((r_id, at)) = found else { return };
        let Some((items, is_newer)) = link.inbox.remove(&r_id) else { return };
        let values = self.slots.get(at).and_then(|slot| vars::received(&items, &slot.data));
        match values {
            _ if is_newer => {
                // The newest data stay for the next call; this call reports that older ones were lost.
                link.inbox.insert(r_id, (items, false));
                self.fail(at, status::OVERRUN);
            }
            Some(bytes) => self.give(at, bytes),
            None => self.fail(at, status::AREA),
        }
    }

    /// A part of BSEND.
    fn part(&mut self, index: usize, came: Came) {
        let Some(Sent::Part { r_id, unit, more, bytes }) = pbc::read(&came.parameters, &came.data) else { return };
        let until = self.now + NOT_READY;
        let Some(link) = self.links.get_mut(index) else { return };
        let id = link.spec.id;
        let Some(at) = self.slots.iter().position(|slot| slot.waits_for(Service::Brcv, id, r_id)) else {
            if link.known.contains(&r_id) && link.parts.len() < 64 {
                link.parts.insert(r_id, (until, came));
            } else {
                link.take_begun(r_id);
                self.refuse(index, came.reference, unit, status::R_ID);
            }
            return;
        };
        let Some(slot) = self.slots.get_mut(at) else { return };
        let is_begun = link.take_begun(r_id);
        // Some senders count the parts of each BSEND from 1. Others count on and on, their answers too: 1 follows 255.
        let restarts = unit == 0 || unit == 1 && slot.unit < 0x80;
        let is_first = restarts || slot.total.is_none() && !is_begun;
        let bytes = match (is_first, bytes) {
            (true, [high, low, rest @ ..]) => {
                slot.total = Some(usize::from(u16::from_be_bytes([*high, *low])));
                slot.give.clear();
                slot.unit = unit;
                rest
            }
            (false, bytes) if slot.total.is_some() => {
                slot.unit = unit;
                bytes
            }
            _ => {
                self.refuse(index, came.reference, unit, status::REFUSED);
                return;
            }
        };
        slot.give.extend_from_slice(bytes);
        let total = slot.total.unwrap_or(0);
        let fits = total <= slot.order.room as usize && slot.give.len() <= total && (more || slot.give.len() == total);
        if !fits {
            self.refuse(index, came.reference, unit, status::AREA);
            self.fail(at, status::AREA);
        } else if more {
            link.begun.push(r_id);
            if let Some(connection) = link.s7() {
                connection.answer(&pbc::part_answer(came.reference, unit, Code::DONE));
            }
        } else {
            // The sender's DONE means that the data have arrived, so the answer is sent when the CPU has taken them.
            slot.total = None;
            slot.held = Some(Held { reference: came.reference, unit, until: u64::MAX });
            let bytes = std::mem::take(&mut slot.give);
            self.give(at, bytes);
        }
    }

    fn refuse(&mut self, index: usize, reference: u16, unit: u8, why: u16) {
        if let Some(connection) = self.links.get_mut(index).and_then(super::Link::s7) {
            connection.answer(&pbc::part_answer(reference, unit, refusal(why)));
        }
    }

    /// The CPU gives up a box, whatever its job was: a sender that waits for its BRCV is informed.
    pub(super) fn abandon(&mut self, at: usize) {
        let Some(slot) = self.slots.get_mut(at) else { return };
        let Some(held) = slot.held.take() else { return };
        let id = slot.order.id;
        if let Some(index) = self.link_of(id) {
            self.refuse(index, held.reference, held.unit, status::DISABLED);
        }
    }

    /// Refuses parts that have waited too long for their BRCV.
    pub(super) fn expire(&mut self, index: usize) {
        let now = self.now;
        let Some(link) = self.links.get_mut(index) else { return };
        let late: Vec<u32> = link.parts.iter().filter(|(_, (until, _))| now >= *until).map(|(r_id, _)| *r_id).collect();
        for r_id in late {
            let part = self.links.get_mut(index).and_then(|link| link.parts.remove(&r_id));
            if let Some((_, came)) = part
                && let Some(Sent::Part { unit, .. }) = pbc::read(&came.parameters, &came.data)
            {
                if let Some(link) = self.links.get_mut(index) {
                    link.take_begun(r_id);
                }
                self.refuse(index, came.reference, unit, status::DISABLED);
            }
        }
    }
}
