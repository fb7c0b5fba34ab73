//! Unsolicited messages: changes of the operating state, entries of the diagnostic buffer, alarms.

use ob1_model::{AlarmChange, Displays};

use super::alarms;
use super::long::answer;
use super::service::Service;
use super::{Ask, Connection, CpuEvent, Step};
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
/// Where the name of the partner is in a subscription, and behind it the kind of alarms.
const NAME: std::ops::Range<usize> = 2..10;
const KIND_AT: usize = 10;
/// Kinds of alarms: an odd one logs on, the one before it logs off. SCAN (symbol-related messages) is not served.
const SCAN_OFF: u8 = 0x00;
const BLOCKS_OFF: u8 = 0x04;
const BLOCKS_ON: u8 = 0x05;
const FUNCTIONS_OFF: u8 = 0x08;
const FUNCTIONS_ON: u8 = 0x09;
/// The operating state during a warm restart. A 315-2 does not tell it, only that RUN is reached.
const WARM: u8 = 1;
/// The class of entries that only this software makes (who has changed what): no panel has words for them.
const OURS: u8 = 0xF;
/// Event classes A and B of the diagnostic buffer are the user's own.
const USER_CLASSES: [u8; 2] = [0xA, 0xB];

/// The messages a partner has subscribed to.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Subscribed {
    events: u8,
    displays: Displays,
    /// Alarms were lost on their way, and no message has told it yet.
    lost: bool,
}

impl Subscribed {
    /// The telegram for an event, if it is wanted.
    pub(super) fn message(&mut self, event: &CpuEvent, pdu: usize) -> Option<Vec<u8>> {
        let message =
            |data| UserData { telegram: Telegram::Message, ..UserData::job(Group::Cpu, sub::DIAGNOSIS, data) };
        match event {
            CpuEvent::Mode(mode) if self.events & MODE != 0 && *mode != WARM => Some(UserData::mode(*mode)),
            CpuEvent::Diagnosis(entry) => {
                let kind = if USER_CLASSES.contains(&(entry[0] >> 4)) { USER } else { SYSTEM };
                (self.events & kind != 0 && entry[0] >> 4 != OURS).then(|| message(entry.as_slice()).write(0))
            }
            CpuEvent::Mode(_) => None,
            CpuEvent::Alarm(event) => {
                self.lost |= matches!(event.change, AlarmChange::Lost(_));
                if !self.displays.want(event.state.kind.display()) {
                    return None;
                }
                let is_message = matches!(event.change, AlarmChange::Message { .. });
                let lost = is_message && std::mem::take(&mut self.lost);
                alarms::telegram(event, lost, pdu)
            }
        }
    }
}

/// What a log-on changes, while the CPU is asked.
#[derive(Clone, Copy, Debug)]
pub(super) struct LogOn {
    events: u8,
    displays: Displays,
    /// The kind of alarms, as it was asked for.
    kind: Option<u8>,
}

impl Connection {
    /// Data: the messages, a reserved byte, the name of the partner; for alarms their kind. It replaces what was
    /// subscribed before; only the kinds of alarms come and go one by one.
    pub(super) fn subscribe(&mut self, reference: u16, service: &UserData<'_>) -> Step {
        let &[events, _, ..] = service.data else {
            return self.refuse_service(reference, service, Code::NO_INFORMATION);
        };
        let Subscribed { events: before, displays, .. } = self.subscribed;
        let alarms = displays.0 & Displays::ALARMS;
        let kind = (events & ALARMS != 0).then(|| service.data.get(KIND_AT).copied().unwrap_or(SCAN_OFF));
        let alarms = match kind {
            None => 0,
            Some(SCAN_OFF) => alarms,
            Some(BLOCKS_ON) => alarms | Displays::BLOCKS,
            Some(BLOCKS_OFF) => alarms & !Displays::BLOCKS,
            Some(FUNCTIONS_ON) => alarms | Displays::FUNCTIONS,
            Some(FUNCTIONS_OFF) => alarms & !Displays::FUNCTIONS,
            Some(_) => return self.refuse_service(reference, service, Code::NO_INFORMATION),
        };
        let events = events & (MODE | SYSTEM | USER);
        let user = if events & USER != 0 { Displays::DIAGNOSIS } else { 0 };
        let logon = LogOn { events, displays: Displays(alarms | user), kind };
        let logs_on = matches!(kind, Some(BLOCKS_ON | FUNCTIONS_ON));
        if logs_on && logon.displays == displays && events == before {
            return self.refuse_service(reference, service, Code::LOGGED_ON);
        }
        if logon.displays == displays {
            return Step::Answer(self.subscribed(reference, logon));
        }
        let name = service.data.get(NAME).unwrap_or_default();
        let name = String::from_utf8_lossy(name).trim_end_matches([' ', '\0']).to_owned();
        Self::later(Ask::LogOn { displays: logon.displays, name }, Service::LogOn(logon))
    }

    /// The CPU has taken it.
    pub(super) fn subscribed(&mut self, reference: u16, logon: LogOn) -> Vec<u8> {
        self.subscribed = Subscribed { events: logon.events, displays: logon.displays, ..self.subscribed };
        let mut data = SUBSCRIBED.to_vec();
        if let Some(kind) = logon.kind {
            data.push(kind);
            data.extend_from_slice(&ALARMS_SUBSCRIBED);
        }
        answer(reference, Group::Cpu, sub::MESSAGES, &data)
    }

    /// Whether the partner has subscribed to events.
    #[must_use]
    pub const fn wants_events(&self) -> bool {
        self.subscribed.events != 0
    }
}
