//! Unsolicited messages: changes of the operating state, entries of the diagnostic buffer.

use super::long::answer;
use super::{Connection, CpuEvent, Step};
use crate::codes::Code;
use crate::wire::{Group, Telegram, UserData, sub};

/// Kinds of messages a partner can subscribe to.
const MODE: u8 = 0x01;
const SYSTEM: u8 = 0x02;
const USER: u8 = 0x04;
const ALARMS: u8 = 0x80;
/// Bytes of the answer: result, reserved; for alarms also their kind.
const SUBSCRIBED: [u8; 2] = [0x02, 0x00];
const ALARMS_SUBSCRIBED: [u8; 2] = [0x01, 0x00];
/// Offset of the kind of alarms in a subscription.
const KIND_AT: usize = 10;
/// The answer to a query of alarms: of those that are asked for, there is none.
const NO_ALARMS: [u8; 6] = [0x00, 0x01, 0x0A, 0x00, 0x00, 0x00];
/// The operating state during a warm restart. A 315-2 does not tell it, only that RUN is reached.
const WARM: u8 = 1;
/// The class of entries that only this software makes (who has changed what): no panel has words for them.
const OURS: u8 = 0xF;
/// Event classes A and B of the diagnostic buffer are the user's own.
const USER_CLASSES: [u8; 2] = [0xA, 0xB];

/// The messages a partner has subscribed to.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Subscribed(u8);

impl Subscribed {
    /// The telegram for an event, if it is wanted.
    pub(super) fn message(self, event: &CpuEvent) -> Option<Vec<u8>> {
        let message =
            |data| UserData { telegram: Telegram::Message, ..UserData::job(Group::Cpu, sub::DIAGNOSIS, data) };
        match event {
            CpuEvent::Mode(mode) if self.0 & MODE != 0 && *mode != WARM => Some(UserData::mode(*mode)),
            CpuEvent::Diagnosis(entry) => {
                let kind = if USER_CLASSES.contains(&(entry[0] >> 4)) { USER } else { SYSTEM };
                (self.0 & kind != 0 && entry[0] >> 4 != OURS).then(|| message(entry.as_slice()).write(0))
            }
            CpuEvent::Mode(_) => None,
        }
    }
}

impl Connection {
    /// Data: the messages, a reserved byte, the name of the partner; for alarms their kind. It replaces what was
    /// subscribed before. Alarms are accepted, though no block of ours sends any.
    pub(super) fn subscribe(&mut self, reference: u16, service: &UserData<'_>) -> Step {
        let &[events, _, ..] = service.data else {
            return self.refuse_service(reference, service, Code::NO_INFORMATION);
        };
        self.subscribed = Subscribed(events & (MODE | SYSTEM | USER));
        let mut data = SUBSCRIBED.to_vec();
        if events & ALARMS != 0 {
            data.push(service.data.get(KIND_AT).copied().unwrap_or(0));
            data.extend_from_slice(&ALARMS_SUBSCRIBED);
        }
        Step::Answer(answer(reference, service.group, service.sub, &data))
    }

    /// A query of the alarms that are active or not acknowledged.
    pub(super) fn query_alarms(reference: u16, service: &UserData<'_>) -> Step {
        Step::Answer(answer(reference, service.group, service.sub, &NO_ALARMS))
    }

    /// Whether the partner has subscribed to events.
    #[must_use]
    pub const fn wants_events(&self) -> bool {
        self.subscribed.0 != 0
    }
}
