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

    /// What helps; empty where nothing has to be done.
    pub fn remedy(self) -> &'static str {
        if let Some(kind) = FaultKind::from_number(self.0) {
            return kind.remedy();
        }
        match self {
            Event::STOP_PROGRAM => "The program calls SFC 46 (STP): look at the condition before the call.",
            Event::STOP_PROGRAMMING_ERROR => {
                "Correct the statement named in the entry before, or load OB 121 to continue in spite of such errors."
            }
            Event::STOP_ACCESS_ERROR => {
                "Check the module at the address named in the entry before, or load OB 122 to continue without it."
            }
            Event::STOP_TIME_ERROR => {
                "Shorten the cycle or raise `watchdog` in [cpu]; with OB 80 the CPU stays in RUN after the first excess of a cycle."
            }
            Event::STOP_DIAGNOSIS => {
                "Clear the fault that the module reports (`ob1 diag`), load OB 82, or set `diagnostics = false` for the module."
            }
            Event::STOP_SEQUENCE_ERROR => "Load the OB named in the entry before, or OB 85 to continue without it.",
            Event::STOP_RACK_FAILURE => {
                "Check the station named in the entry before, its power and its line; load OB 86 to continue without it."
            }
            Event::BUS_FAILED => {
                "The process of the bus is restarted automatically. If this repeats, check its log and its line."
            }
            Event::STATION_FAILED | Event::SLAVE_LOST => {
                "Check power, address and cable of the station; the log of the bus says how its requests failed."
            }
            Event::STATION_REFUSES => {
                "Compare its entry in the station file with the manual of the device: the function (exception 01h), the \
                 address (02h), the length or value (03h); 04h is a fault of the device, 06h means that it is busy. For \
                 a DP slave, compare the GSD file, the modules in its slots and their parameters; `ob1 bus watch` says \
                 which is wrong."
            }
            Event::STATION_FAULT => {
                "Repair the module and the channel that it names (s slot, c channel, e error type); the log of the bus \
                 describes the fault in words, SFC 13 reads the whole diagnosis."
            }
            Event::BLOCKS_TOO_DEEP | Event::NO_LOCAL_DATA => FaultKind::NestingDepth.remedy(),
            Event::STOP_ABORTED => "Correct what the entry before names; with OB 88 the program continues without it.",
            Event::SYNCHRONOUS_NESTING => {
                "Correct the faulty statement in OB 121 or OB 122; with OB 88 the program continues without it."
            }
            Event::CYCLE_TIME_EXCEEDED => {
                "Look where the time goes (`ob1 ctl recorder`), shorten the program, or raise `watchdog` in [cpu]."
            }
            Event::OB_STILL_RUNS => "Give the OB a longer period, or shorten it.",
            Event::TIME_OF_DAY_SKIPPED => {
                "Its OB runs once, late. Load OB 80 so that setting the clock does not stop the CPU; SFC 29 in OB 80 \
                 leaves the late run out."
            }
            Event::OB_QUEUE_OVERFLOW => {
                "The OB is requested more often than it can run: shorten it, or request it less often."
            }
            Event::OB_NOT_LOADED => "Load the OB, or remove the interrupt or call that requests it.",
            Event::INPUT_IMAGE_ERROR
            | Event::OUTPUT_IMAGE_ERROR
            | Event::INPUT_IMAGE_FAILS
            | Event::OUTPUT_IMAGE_FAILS => {
                "Check the module that feeds this byte; for a CP, its driver and its line (`ob1 diag`)."
            }
            Event::PLUGIN_PANIC => {
                "This is an error in the plugin: report the text of this entry to its author; a warm restart continues the program."
            }
            Event::PLUGIN_STOP => "The text of this entry says why the block of the plugin has stopped the CPU.",
            Event::DRIVER_LOST => {
                "It is restarted automatically. If this repeats, check the log of the driver and its device."
            }
            Event::SEGMENT_GARBAGE => {
                "The driver does not fit this runtime, or is damaged: install `ob1` and `ob1-cp` together."
            }
            Event::CP_ERROR => "Check the parameters of the CP, its cable and its partner (`ob1 trace`).",
            Event::CP_EVENTS_LOST => {
                "The CPU takes a few events of a CP in each cycle: shorten the cycle, or mend what the CP reports so often (`ob1 diag`, the log of its driver)."
            }
            Event::DRIVER_HELD_UP => {
                "The machine is too busy: give the drivers cores of their own (`affinity`), or reduce the load."
            }
            Event::CYCLE_STANDS => {
                "A loop triggers the cycle monitoring again and again (SFC 43), or the monitoring is off (`watchdog`): the outputs keep what the cycle before wrote. Give the loop an end; STOP is obeyed meanwhile."
            }
            Event::RETENTIVE_LOST => {
                "Make room on the disk, or make the folder writable ([station] state); until then a power cycle loses the newest values."
            }
            Event::RETENTIVE_REFUSED => {
                "The log says why each file was refused and where it is kept. After a start with the wrong program, end the \
                 station, put its file back and start the right one (docs/station-file.md)."
            }
            Event::RETENTIVE_PARTLY => {
                "These are declared anew or not there any more; the others have their values. The log says where the file \
                 is kept. After a start with the wrong program, put it back (docs/station-file.md)."
            }
            Event::ENGINES_DIFFER => {
                "This is an error in ob1: report it with the program and the lines of the log; set engine = \"reference\" until it is corrected."
            }
            // A change that was commanded, the end of a fault, an entry of the program.
            _ => "",
        }
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
