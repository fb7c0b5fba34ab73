//! Unsolicited messages: changes of the operating state, entries of the diagnostic buffer.

use super::{Connection, CpuEvent, Step};
use crate::codes::Code;
use crate::wire::{Group, Telegram, UserData, sub};

/// Kinds of messages a partner can subscribe to.
const MODE: u8 = 0x01;
const SYSTEM: u8 = 0x02;
const USER: u8 = 0x04;
const ALARMS: u8 = 0x80;
/// Bytes of the answer: result, reserved.
const SUBSCRIBED: [u8; 2] = [0x02, 0x00];
/// Event classes A and B of the diagnostic buffer are the user's own.
const USER_CLASSES: [u8; 2] = [0xA, 0xB];

/// The messages a partner has subscribed to.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Subscribed(u8);

impl Subscribed {
    /// The telegram for an event, if it is wanted.
    pub(super) fn message(self, event: &CpuEvent) -> Option<Vec<u8>> {
        let message = |group, sub, data| UserData { telegram: Telegram::Message, ..UserData::job(group, sub, data) };
        match event {
            CpuEvent::Mode(mode) if self.0 & MODE != 0 => Some(message(Group::Mode, *mode, &[]).write(0)),
            CpuEvent::Diagnosis(entry) => {
                let kind = if USER_CLASSES.contains(&(entry[0] >> 4)) { USER } else { SYSTEM };
                (self.0 & kind != 0).then(|| message(Group::Cpu, sub::DIAGNOSIS, entry.as_slice()).write(0))
            }
            CpuEvent::Mode(_) => None,
        }
    }
}

impl Connection {
    /// Data: the messages, a reserved byte, the name of the partner; for alarms their kind.
    pub(super) fn subscribe(&mut self, reference: u16, service: &UserData<'_>) -> Step {
        let &[events, _, ..] = service.data else {
            return self.refuse_service(reference, service, Code::NO_INFORMATION);
        };
        // No block of ours sends alarms, so a subscription is refused.
        if events & ALARMS != 0 && events & (MODE | SYSTEM | USER) == 0 {
            return self.refuse_service(reference, service, Code::NO_INFORMATION);
        }
        self.subscribed = Subscribed(events & (MODE | SYSTEM | USER));
        let job = UserData::job(service.group, service.sub, &SUBSCRIBED);
        Step::Answer(UserData { telegram: Telegram::Answer, ..job }.write(reference))
    }

    /// Whether the partner has subscribed to events.
    #[must_use]
    pub const fn wants_events(&self) -> bool {
        self.subscribed.0 != 0
    }
}
