//! What the broker tells: answers of the CPU in the words of the door, events, alarms.

use ob1_access::door::{Answer, Document, News, Refusal, State, ToLink};
use ob1_cpu::Answer as CpuAnswer;
use ob1_model::Displays;
use ob1_time::Instant;

use crate::joint::Joint;
use crate::{Broker, LinkState};

/// Packets that may wait for a link while it still gets events.
const EVENTS_WAITING: usize = 64;

impl Broker {
    pub(crate) fn document(&self, which: Document, state: State, present: &[bool]) -> Answer {
        let named = self.joints.iter().filter(|joint| !joint.config.name.is_empty());
        let told = |joint: &Joint| LinkState {
            name: joint.config.name.clone(),
            up: joint.up,
            connections: joint.connections.clone(),
        };
        let links: Vec<LinkState> = named.map(told).collect();
        Answer::Document { last: true, bytes: self.facts.document(which, state, present, &links) }
    }

    /// What the CPU has answered to one question.
    pub(crate) fn told(&self, answers: &[CpuAnswer]) -> Answer {
        match answers {
            [CpuAnswer::Done] => Answer::Done,
            // Cells that are forced: all are taken, or the first that is not says why.
            [CpuAnswer::Done, CpuAnswer::Done | CpuAnswer::Refused(_), ..] => {
                let refused = answers.iter().find_map(|answer| match answer {
                    CpuAnswer::Refused(error) => Some(Answer::Refused(Refusal::Cell(*error))),
                    _ => None,
                });
                refused.unwrap_or(Answer::Done)
            }
            [CpuAnswer::Clock(clock)] => Answer::Clock(*clock),
            [CpuAnswer::State(state), modules @ ..] => {
                let present = |answer: &CpuAnswer| matches!(answer, CpuAnswer::Module(module) if module.present);
                Answer::Modules { state: *state, present: modules.iter().map(present).collect() }
            }
            [CpuAnswer::Refused(error)] if *error != ob1_cpu::CellError::NoEntry => {
                Answer::Refused(Refusal::Cell(*error))
            }
            entries => {
                let entries = entries.iter().map_while(|answer| match answer {
                    CpuAnswer::Diag(entry) => Some(self.facts.diagnosis(entry)),
                    _ => None,
                });
                Answer::Diagnostics(entries.collect())
            }
        }
    }

    /// Events that a link has not got, as long as it takes them.
    pub(crate) fn tell_events(&mut self, link: usize) {
        let Some(joint) = self.joints.get_mut(link) else { return };
        let Some(connection) = &mut joint.connection else { return };
        while let Some(after) = joint.events_after
            && connection.waiting() < EVENTS_WAITING
            && after != self.events.newest()
        {
            let Some(event) = self.events.after(after) else { return };
            joint.events_after = Some(event.number);
            connection.say(&ToLink::News(News::Event(event)));
        }
    }

    /// Changes of alarms, and who is logged on.
    pub(crate) fn watch_alarms(&mut self, now: Instant) {
        self.alarms.take();
        let all = self.joints.iter_mut().fold(0, |bits, joint| bits | joint.logons.displays(now).0);
        self.alarms.set_displays(Displays(all));
    }

    /// Changes of alarms that the displays of a link have not got, as long as they take them.
    pub(crate) fn tell_alarms(&mut self, link: usize) {
        let Some(joint) = self.joints.get_mut(link) else { return };
        let Some(connection) = &mut joint.connection else { return };
        while connection.waiting() < EVENTS_WAITING {
            let Some((client, event)) = joint.logons.next(&self.alarms) else { return };
            connection.say(&ToLink::News(News::Alarm { client, event: Box::new(event) }));
        }
    }
}
