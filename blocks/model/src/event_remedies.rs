//! What an event means for the operating state, and what helps against it.

use crate::{Event, FaultKind};

/// How an entry of the diagnostic buffer changes the operating state.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StateChange {
    /// The CPU goes to STARTUP.
    Startup,
    /// The CPU goes to RUN.
    Run,
    /// The CPU goes to HOLD.
    Hold,
    /// To STOP, by command.
    Stop,
    /// To STOP, because of a fault.
    Fault,
}

impl Event {
    /// How the operating state changes with this event, if it does: the one table of what counts as a fault.
    pub const fn state_change(self) -> Option<StateChange> {
        Some(match self {
            Event::STARTUP => StateChange::Startup,
            Event::RUN | Event::HOLD_LEFT => StateChange::Run,
            Event::HOLD => StateChange::Hold,
            Event::STOP_OPERATOR | Event::HOLD_STOPPED | Event::MEMORY_RESET => StateChange::Stop,
            Event::STOP_PROGRAM
            | Event::STOP_PROGRAMMING_ERROR
            | Event::STOP_ACCESS_ERROR
            | Event::STOP_TIME_ERROR
            | Event::STOP_DIAGNOSIS
            | Event::STOP_SEQUENCE_ERROR
            | Event::STOP_RACK_FAILURE
            | Event::STOP_ABORTED
            | Event::PLUGIN_PANIC
            | Event::PLUGIN_STOP
            | Event::ENGINES_DIFFER => StateChange::Fault,
            _ => return None,
        })
    }
}

impl FaultKind {
    /// What the number of such a fault counts: `DB 77`, `byte 260`; empty: nothing.
    pub const fn counts(self) -> &'static str {
        match self {
            FaultKind::BcdConversion | FaultKind::NestingDepth => "",
            FaultKind::AreaLengthRead
            | FaultKind::AreaLengthWrite
            | FaultKind::AlignmentRead
            | FaultKind::AlignmentWrite => "byte",
            FaultKind::AreaRead | FaultKind::AreaWrite => "area code",
            FaultKind::PeripheralRead | FaultKind::PeripheralWrite => "peripheral byte",
            FaultKind::TimerNumber => "T",
            FaultKind::CounterNumber => "C",
            FaultKind::WriteProtectedDb
            | FaultKind::WriteProtectedDi
            | FaultKind::DbNumber
            | FaultKind::DiNumber
            | FaultKind::DbNotLoaded => "DB",
            FaultKind::FcNumber | FaultKind::FcNotLoaded => "FC",
            FaultKind::FbNumber | FaultKind::FbNotLoaded => "FB",
            FaultKind::SfcNotLoaded => "SFC",
            FaultKind::SfbNotLoaded => "SFB",
        }
    }

    /// What helps against it, as a sentence for the user.
    pub const fn remedy(self) -> &'static str {
        match self {
            FaultKind::BcdConversion => "Check the value before BTI, BTD or ITB: each digit must be 0 to 9.",
            FaultKind::AreaLengthRead | FaultKind::AreaLengthWrite => {
                "The address is beyond the end of its area: check the pointer, the length of the DB, or [cpu] in the station file."
            }
            FaultKind::AreaRead | FaultKind::AreaWrite => {
                "The pointer has an area code that does not exist, or one that is not allowed here: check how it is built."
            }
            FaultKind::TimerNumber => "Use a timer that the CPU has, or raise `timers` in [cpu].",
            FaultKind::CounterNumber => "Use a counter that the CPU has, or raise `counters` in [cpu].",
            FaultKind::AlignmentRead | FaultKind::AlignmentWrite => {
                "Bits 0 to 2 of the pointer must be 0 for bytes, words and double words."
            }
            FaultKind::WriteProtectedDb | FaultKind::WriteProtectedDi => {
                "The data block is READ_ONLY: write to another one, or remove the attribute."
            }
            FaultKind::DbNumber | FaultKind::DiNumber => {
                "The number of a data block is 1 to 65535: check the value from which the program takes it."
            }
            FaultKind::FcNumber | FaultKind::FbNumber => {
                "Check the value from which the program takes the number of the block."
            }
            FaultKind::DbNotLoaded => "Load the data block, or create it with SFC 22 before it is used.",
            FaultKind::FcNotLoaded | FaultKind::FbNotLoaded => {
                "Load the block: name its source, its library or its plugin in the station file."
            }
            FaultKind::SfcNotLoaded | FaultKind::SfbNotLoaded => {
                "This system block does not exist here: docs/standard-blocks.md lists those that exist."
            }
            FaultKind::PeripheralRead | FaultKind::PeripheralWrite => {
                "No module has this address, or it does not answer: check [[module]] in the station file, and the module's driver."
            }
            FaultKind::NestingDepth => {
                "Blocks call one another too deeply, or need too much local data: raise `nesting_depth` or `local_bytes` in [cpu], or look for a block that calls itself."
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Events that report something good, or a command.
    const NOTHING_TO_DO: [Event; 18] = [
        Event::STARTUP,
        Event::RUN,
        Event::HOLD,
        Event::HOLD_LEFT,
        Event::HOLD_STOPPED,
        Event::STOP_OPERATOR,
        Event::MEMORY_RESET,
        Event::PLUGIN_ENTRY,
        Event::DRIVER_UP,
        Event::CP_ERROR_GONE,
        Event::RETENTIVE_KEPT,
        Event::PARTNER,
        Event::INPUT_IMAGE_BACK,
        Event::OUTPUT_IMAGE_BACK,
        Event::STATION_BACK,
        Event::STATION_ACCEPTS,
        Event::STATION_FAULT_GONE,
        Event::SLAVE_BACK,
    ];

    #[test]
    fn every_event_has_a_text_and_a_remedy() {
        let faults = FaultKind::ALL.map(Event::from);
        for event in faults.into_iter().chain(Event::ALL) {
            assert_ne!(event.text(), "event", "{event:?}");
            assert_eq!(event.remedy().is_empty(), NOTHING_TO_DO.contains(&event), "{:04X}h {}", event.0, event.text());
        }
    }

    #[test]
    fn what_says_stop_is_a_stop() {
        for event in Event::ALL {
            let change = event.state_change();
            let stops = matches!(change, Some(StateChange::Stop | StateChange::Fault));
            let says = event.text().starts_with("STOP") || matches!(event, Event::MEMORY_RESET | Event::HOLD_STOPPED);
            assert_eq!(stops, says, "{:04X}h {}", event.0, event.text());
        }
        assert_eq!(Event::STOP_DIAGNOSIS.state_change(), Some(StateChange::Fault));
        assert_eq!(Event::STOP_SEQUENCE_ERROR.state_change(), Some(StateChange::Fault));
        assert_eq!(Event::STOP_ABORTED.state_change(), Some(StateChange::Fault));
    }
}
