//! Services of a programming device: dispatch.

use super::long::{SERVICE_NUMBER, answer, done, refused};
use super::service::Service;
use super::{Connection, CpuEvent, Reply, Step, Then};
use crate::codes::Code;
use crate::wire::{Group, Pdu, Telegram, UserData, sub};

/// Most jobs and messages that wait for the end of a change of the operating state.
const HELD: usize = 64;

impl Connection {
    pub(super) fn user_data(&mut self, pdu: &Pdu<'_>) -> Step {
        let Some(service) = UserData::read(pdu.parameters, pdu.data) else {
            return self.refuse_job(pdu.reference, Code::NO_SERVICE);
        };
        if self.agreed.is_none() {
            return self.refuse_job(pdu.reference, Code::NO_SERVICE);
        }
        // An answer to a message of ours, or a message: not requested.
        if service.telegram != Telegram::Job {
            return Step::Silence;
        }
        let UserData { group, sub, sequence, .. } = service;
        // Test functions come in the long form at any time; only the next part of an answer has its number.
        let is_next = matches!(group, Group::Cpu | Group::Blocks) || group == Group::Test && sequence != 0;
        if service.more && is_next {
            let pdu_bytes = self.pdu_bytes();
            return Step::Answer(self.long.next(pdu.reference, group, sub, sequence, pdu_bytes));
        }
        match (group, sub) {
            (Group::Cpu, sub::SZL) => self.szl(pdu.reference, &service),
            (Group::Cpu, sub::MESSAGES) => self.subscribe(pdu.reference, &service),
            (Group::Cpu, sub::ALARM_QUERY) => self.query_alarms(pdu.reference, &service),
            (Group::Cpu, sub::ALARM_ACKNOWLEDGE | sub::ALARM_LOCK | sub::ALARM_UNLOCK) => {
                self.order_alarms(pdu.reference, &service)
            }
            (Group::Blocks, _) => self.lists(pdu.reference, &service),
            (Group::Clock, _) => self.clock(pdu.reference, &service),
            (Group::Security, _) => self.security(pdu.reference, &service),
            (Group::Cyclic, _) => self.cyclic(pdu.reference, &service),
            (Group::Test, _) => self.test(pdu.reference, &service),
            _ => self.refuse_service(pdu.reference, &service, Code::NO_SERVICE),
        }
    }

    pub(super) fn refuse_service(&mut self, reference: u16, service: &UserData<'_>, why: Code) -> Step {
        self.counts.errors += 1;
        Step::Answer(refused(reference, service.group, service.sub, why))
    }

    pub(super) fn service_answer(&mut self, reference: u16, service: Service, reply: Reply) -> Vec<Vec<u8>> {
        let mut no = |group, sub, why| {
            self.counts.errors += 1;
            vec![refused(reference, group, sub, why)]
        };
        match service {
            Service::Szl { id, index } => match reply {
                Reply::Szl { record, bytes } => vec![self.szl_answer(reference, id, index, record, &bytes)],
                Reply::Refused(why) => no(Group::Cpu, sub::SZL, why),
                _ => no(Group::Cpu, sub::SZL, Code::NOT_NOW),
            },
            Service::Counts | Service::List(_) => {
                let sub = if matches!(service, Service::Counts) { sub::BLOCK_COUNTS } else { sub::BLOCK_LIST };
                match (reply, service) {
                    (Reply::Blocks(blocks), Service::List(ty)) => vec![self.list_answer(reference, ty, &blocks)],
                    (Reply::Blocks(blocks), _) => vec![self.counts_answer(reference, &blocks)],
                    (Reply::Refused(why), _) => no(Group::Blocks, sub, why),
                    _ => no(Group::Blocks, sub, Code::NOT_NOW),
                }
            }
            Service::Info => match reply {
                Reply::Block(block) => vec![self.info_answer(reference, &block)],
                Reply::Refused(why) => no(Group::Blocks, sub::BLOCK_INFO, why),
                _ => no(Group::Blocks, sub::BLOCK_INFO, Code::NO_BLOCK),
            },
            Service::Clock { sub } => match reply {
                Reply::Clock(time) => vec![answer(reference, Group::Clock, sub, &time.bytes())],
                Reply::Refused(why) => no(Group::Clock, sub, why),
                _ => no(Group::Clock, sub, Code::NOT_NOW),
            },
            Service::SetClock { sub } => match reply {
                Reply::Done => vec![done(reference, Group::Clock, sub, SERVICE_NUMBER)],
                Reply::Refused(why) => no(Group::Clock, sub, why),
                _ => no(Group::Clock, sub, Code::NOT_NOW),
            },
            Service::Password { sub } => vec![self.security_answer(reference, sub, &reply)],
            Service::LogOn(logon) => match reply {
                Reply::Done => vec![self.subscribed(reference, logon)],
                Reply::Refused(Code::NOT_NOW) => no(Group::Cpu, sub::MESSAGES, Code::NO_SUBSCRIBERS),
                Reply::Refused(why) => no(Group::Cpu, sub::MESSAGES, why),
                _ => no(Group::Cpu, sub::MESSAGES, Code::NOT_NOW),
            },
            Service::AlarmQuery(wanted) => match reply {
                Reply::Alarms(list) => vec![self.alarms_answer(reference, wanted, &list)],
                Reply::Refused(why) => no(Group::Cpu, sub::ALARM_QUERY, why),
                _ => no(Group::Cpu, sub::ALARM_QUERY, Code::NOT_NOW),
            },
            Service::AlarmOrder { sub, function } => match reply {
                Reply::Ordered(found) => vec![Self::ordered(reference, sub, function, &found)],
                Reply::Refused(why) => no(Group::Cpu, sub, why),
                _ => no(Group::Cpu, sub, Code::NOT_NOW),
            },
            // Answered where the request is known.
            Service::Cyclic { .. } | Service::CyclicDue | Service::Test(_) => Vec::new(),
        }
    }

    /// An event in the CPU: sends a message if the partner has subscribed to it.
    pub fn event(&mut self, event: &CpuEvent) {
        let pdu = self.pdu_bytes();
        let Some(telegram) = self.subscribed.message(event, pdu) else { return };
        // A change of the operating state is answered before it is told.
        let changes = self.queue.iter().any(|job| matches!(job.then, Some(Then::Control(_))));
        if changes && self.queue.len() < HELD {
            self.enqueue(0, Step::Answer(telegram));
        } else {
            self.message(&telegram);
        }
    }

    /// Lets this service wait for the CPU.
    pub(super) const fn later(ask: super::Ask, service: Service) -> Step {
        Step::Ask(ask, Then::Service(service))
    }
}
