//! Faults of a program and the events of the diagnostic buffer, numbered as an S7-300 numbers them.
//!
//! Event numbers are those of the "System Software for S7-300/400" reference (event classes 2, 3 and 4); class F is
//! free for "events of modules other than CPUs" and holds our own.

use std::fmt;

use crate::{Area, BlockId};

/// Where in the program something happened.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Site {
    /// The block in which it happened.
    pub block: BlockId,
    /// Network number, from 1; 0 when the source has none.
    pub network: u16,
    /// Source line, from 1; 0 for blocks that are not compiled from source.
    pub line: u32,
}

impl fmt::Display for Site {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.block)?;
        if self.network > 0 {
            write!(f, ", network {}", self.network)?;
        }
        if self.line > 0 {
            write!(f, ", line {}", self.line)?;
        }
        Ok(())
    }
}

/// Declares [`FaultKind`] from a row for each fault: name, number, text.
macro_rules! faults {
    ($(#[$meta:meta])* pub enum FaultKind { $($(#[$doc:meta])* $name:ident = $number:literal, $text:literal;)* }) => {
        $(#[$meta])*
        pub enum FaultKind { $($(#[$doc])* $name = $number,)* }

        impl FaultKind {
            /// Every fault, each once.
            pub const ALL: [Self; [$($number),*].len()] = [$(Self::$name),*];

            /// The fault of an event number, as a plugin raises it.
            pub const fn from_number(number: u16) -> Option<Self> {
                match number { $($number => Some(Self::$name),)* _ => None }
            }

            const fn text(self) -> &'static str {
                match self { $(Self::$name => $text,)* }
            }
        }
    };
}

faults! {
    /// What a statement did wrong. Programming errors call OB 121, access errors OB 122; without that OB the CPU goes
    /// to STOP.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    #[repr(u16)]
    pub enum FaultKind {
        /// 2521h: a digit above 9 where a BCD number is expected.
        BcdConversion = 0x2521, "BCD conversion error";
        /// 2522h: read outside the area.
        AreaLengthRead = 0x2522, "area length error when reading";
        /// 2523h: write outside the area.
        AreaLengthWrite = 0x2523, "area length error when writing";
        /// 2524h: a pointer with an area code that names no readable area.
        AreaRead = 0x2524, "area error when reading";
        /// 2525h: a pointer with an area code that names no writable area.
        AreaWrite = 0x2525, "area error when writing";
        /// 2526h: a timer the CPU does not have.
        TimerNumber = 0x2526, "timer number error";
        /// 2527h: a counter the CPU does not have.
        CounterNumber = 0x2527, "counter number error";
        /// 2528h: a word or double word read through a pointer whose bit part is not 0.
        AlignmentRead = 0x2528, "alignment error when reading";
        /// 2529h: a word or double word written through a pointer whose bit part is not 0.
        AlignmentWrite = 0x2529, "alignment error when writing";
        /// 2530h: write to a write-protected global data block.
        WriteProtectedDb = 0x2530, "write error, data block is write-protected";
        /// 2531h: write to a write-protected instance data block.
        WriteProtectedDi = 0x2531, "write error, instance data block is write-protected";
        /// 2532h: `AUF DB` with an impossible number.
        DbNumber = 0x2532, "block number error when opening a data block";
        /// 2533h: `AUF DI` with an impossible number.
        DiNumber = 0x2533, "block number error when opening an instance data block";
        /// 2534h: call of an FC with an impossible number.
        FcNumber = 0x2534, "block number error when calling an FC";
        /// 2535h: call of an FB with an impossible number.
        FbNumber = 0x2535, "block number error when calling an FB";
        /// 253Ah: the data block is not loaded.
        DbNotLoaded = 0x253A, "data block not loaded";
        /// 253Ch: the function is not loaded.
        FcNotLoaded = 0x253C, "FC not loaded";
        /// 253Dh: the system function does not exist.
        SfcNotLoaded = 0x253D, "SFC not available";
        /// 253Eh: the function block is not loaded.
        FbNotLoaded = 0x253E, "FB not loaded";
        /// 253Fh: the system function block does not exist.
        SfbNotLoaded = 0x253F, "SFB not available";
        /// 2942h: peripheral read without a module, or the module does not answer.
        PeripheralRead = 0x2942, "peripheral access error when reading";
        /// 2943h: peripheral write without a module, or the module does not answer.
        PeripheralWrite = 0x2943, "peripheral access error when writing";
        /// 2575h (ours): blocks nested deeper than the CPU allows, or no local data left. An S7-400 has 3575h and
        /// 3576h.
        NestingDepth = 0x2575, "blocks nested too deep";
    }
}

impl FaultKind {
    /// The event number, such as 2522h.
    pub const fn number(self) -> u16 {
        self as u16
    }

    /// The organization block that handles it: 121 or 122.
    pub const fn ob(self) -> u16 {
        match self {
            FaultKind::PeripheralRead | FaultKind::PeripheralWrite => 122,
            _ => 121,
        }
    }
}

/// A fault with what is needed to explain it: the number that was wrong and the size it was compared with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Fault {
    /// What the program did wrong.
    pub kind: FaultKind,
    /// How memory was accessed, where that was the fault; `None` otherwise.
    pub access: Option<Access>,
    /// The block, timer, counter or area byte concerned.
    pub number: u32,
}

/// An access to memory as OB 121 and OB 122 describe it (OB121_RESERVED_1, OB122_MEM_AREA): in bits 7 to 4 its width (0
/// bit, 1 byte, 2 word, 3 double word), in bits 3 to 0 the area (0 peripheral, 1 inputs, 2 outputs, 3 bit memory, 4
/// global data block, 5 instance data block, 6 own local data, 7 the caller's). ["Programming Error Organization
/// Block", "I/O Access Error Organization Block"]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Access(u8);

impl Access {
    /// An access of so many bits; above 16 it counts as a double word.
    pub const fn new(area: Area, bits: u32) -> Self {
        let width = match bits {
            ..=1 => 0,
            2..=8 => 1,
            9..=16 => 2,
            _ => 3,
        };
        Self(width << 4 | area.pointer_code() & 0x0F)
    }

    /// The byte of the start information.
    pub const fn code(self) -> u8 {
        self.0
    }
}

impl Fault {
    /// A fault about `number`.
    pub const fn new(kind: FaultKind, number: u32) -> Self {
        Self { kind, access: None, number }
    }

    /// A fault of an access to `bits` bits at a byte of an area.
    pub const fn at(kind: FaultKind, area: Area, bits: u32, byte: u32) -> Self {
        Self { kind, access: Some(Access::new(area, bits)), number: byte }
    }

    /// The word of OB 121's and OB 122's start information that tells what was wrong (OB121_FLT_REG, OB122_MEM_ADDR): a
    /// byte address, the illegal area, the number of a timer, counter or block; of a BCD conversion the register, which
    /// is accumulator 1: 0.
    pub const fn source(&self) -> u16 {
        match self.kind {
            FaultKind::BcdConversion => 0,
            _ => self.number as u16,
        }
    }
}

/// An entry's meaning in the diagnostic buffer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Event(pub u16);

/// Declares the events that are no faults from a row for each: name, number, text, and what helps, where something has
/// to be done.
macro_rules! events {
    ($($(#[$doc:meta])* $name:ident = $number:literal, $text:literal $(, $remedy:expr)?;)*) => {
        impl Event {
            $($(#[$doc])* pub const $name: Self = Self($number);)*

            /// Every event with a name that is not a fault.
            pub const ALL: [Self; [$($number),*].len()] = [$(Self::$name),*];

            /// The text of the event, without its place.
            pub const fn text(self) -> &'static str {
                match (self.0, FaultKind::from_number(self.0)) {
                    $(($number, _) => $text,)*
                    (_, Some(fault)) => fault.text(),
                    // Entries of the program itself (SFC 52): classes 8 and 9 are for its messages, A and B for the
                    // user's own.
                    (0x8000..=0xBFFF, None) => "entry of the program",
                    _ => "event",
                }
            }

            /// What helps; empty where nothing has to be done: for a change that was commanded, the end of a fault, an
            /// entry of the program.
            #[must_use]
            pub const fn remedy(self) -> &'static str {
                match (self.0, FaultKind::from_number(self.0)) {
                    $($(($number, _) => $remedy,)?)*
                    (_, Some(fault)) => fault.remedy(),
                    _ => "",
                }
            }
        }
    };
}

// What helps against several events.
const STATION_LOST: &str =
    "Check power, address and cable of the station; the log of the bus says how its requests failed.";
const IMAGE_ERROR: &str = "Check the module that feeds this byte; for a CP, its driver and its line (`ob1 diag`).";

events! {
    /// Change from STOP to STARTUP.
    STARTUP = 0x4301, "mode transition from STOP to STARTUP";
    /// Change from STARTUP to RUN.
    RUN = 0x4302, "mode transition from STARTUP to RUN";
    /// STOP requested by an operator (`ob1 ctl stop`, end of a run).
    STOP_OPERATOR = 0x4304, "STOP by operator";
    /// Change from RUN to HOLD, at a breakpoint.
    HOLD = 0x4305, "breakpoint reached, HOLD";
    /// Change from HOLD to RUN.
    HOLD_LEFT = 0x4306, "breakpoint left";
    /// Change from HOLD to STOP.
    HOLD_STOPPED = 0x430A, "HOLD left to STOP";
    /// Memory reset by an operator.
    MEMORY_RESET = 0x4307, "memory reset by operator";
    /// STOP by SFC 46.
    STOP_PROGRAM = 0x4543, "STOP by the program (SFC 46)",
        "The program calls SFC 46 (STP): look at the condition before the call.";
    /// STOP by a programming error without OB 121.
    STOP_PROGRAMMING_ERROR = 0x4562, "STOP by programming error, OB 121 not loaded or not possible",
        "Correct the statement named in the entry before, or load OB 121 to continue in spite of such errors.";
    /// STOP by an access error without OB 122.
    STOP_ACCESS_ERROR = 0x4563, "STOP by access error, OB 122 not loaded or not possible",
        "Check the module at the address named in the entry before, or load OB 122 to continue without it.";
    /// STOP by a time error: watchdog without OB 80, or twice in one cycle.
    STOP_TIME_ERROR = 0x4568, "STOP by time error",
        "Shorten the cycle or raise `watchdog` in [cpu]; with OB 80 the CPU stays in RUN after the first excess of \
         a cycle.";
    /// STOP because of a diagnostic interrupt without OB 82.
    STOP_DIAGNOSIS = 0x456A, "STOP by diagnostic interrupt, OB 82 not loaded",
        "Clear the fault that the module reports (`ob1 diag`), load OB 82, or set `diagnostics = false` for the \
         module.";
    /// STOP because OB 85 is wanted and not loaded (program sequence error).
    STOP_SEQUENCE_ERROR = 0x456D, "STOP by program sequence error, OB 85 not loaded",
        "Load the OB named in the entry before, or OB 85 to continue without it.";
    /// STOP because a station of a bus is lost and OB 86 is not loaded.
    STOP_RACK_FAILURE = 0x456F, "STOP by rack failure, OB 86 not loaded",
        "Check the station named in the entry before, its power and its line; load OB 86 to continue without it.";
    /// STOP because a block was aborted and OB 88 is not loaded, or was the one that was aborted.
    STOP_ABORTED = 0x4570, "STOP, a block was aborted, OB 88 not loaded or not possible",
        "Correct what the entry before names; with OB 88 the program continues without it.";
    /// A block was aborted: an error in an OB that handles a synchronous error.
    SYNCHRONOUS_NESTING = 0x3573, "a block was aborted, synchronous errors nested too deep",
        "Correct the faulty statement in OB 121 or OB 122; with OB 88 the program continues without it.";
    /// A block was aborted: blocks are nested too deep (S7-400).
    BLOCKS_TOO_DEEP = 0x3575, "a block was aborted, blocks nested too deep", FaultKind::NestingDepth.remedy();
    /// A block was aborted: no local data is left (S7-400).
    NO_LOCAL_DATA = 0x3576, "a block was aborted, no local data left", FaultKind::NestingDepth.remedy();
    /// Cycle time exceeded: the cycle monitoring expired.
    CYCLE_TIME_EXCEEDED = 0x3501, "cycle time exceeded",
        "Look where the time goes (`ob1 ctl recorder`), shorten the program, or raise `watchdog` in [cpu].";
    /// An OB is requested that is still being executed.
    OB_STILL_RUNS = 0x3502, "OB requested while it is still being executed",
        "Give the OB a longer period, or shorten it.";
    /// The clock was set forward past the start of a time-of-day interrupt.
    TIME_OF_DAY_SKIPPED = 0x3505, "time-of-day interrupt skipped, the clock was set forward",
        "Its OB runs once, late. Load OB 80 so that setting the clock does not stop the CPU; SFC 29 in OB 80 \
        leaves the late run out.";
    /// An OB is requested for which a request waits already.
    OB_QUEUE_OVERFLOW = 0x3507, "OB requested while a request for it waits already",
        "The OB is requested more often than it can run: shorten it, or request it less often.";
    /// An event wants an OB that is not loaded.
    OB_NOT_LOADED = 0x35A1, "event for an OB that is not loaded",
        "Load the OB, or remove the interrupt or call that requests it.";
    /// Access error while the system reads the process image of the inputs.
    INPUT_IMAGE_ERROR = 0x39B1, "access error in the transfer of the process image of the inputs", IMAGE_ERROR;
    /// Access error while the system writes the process image of the outputs.
    OUTPUT_IMAGE_ERROR = 0x39B2, "access error in the transfer of the process image of the outputs", IMAGE_ERROR;
    /// The same for inputs, where only the beginning and the end are reported.
    INPUT_IMAGE_FAILS = 0x39B3, "access to the process image of the inputs fails from now on", IMAGE_ERROR;
    /// The same for outputs, where only the beginning and the end are reported.
    OUTPUT_IMAGE_FAILS = 0x39B4, "access to the process image of the outputs fails from now on", IMAGE_ERROR;
    /// Access to the inputs of a module works again.
    INPUT_IMAGE_BACK = 0x38B3, "access to the process image of the inputs works again";
    /// Access to the outputs of a module works again.
    OUTPUT_IMAGE_BACK = 0x38B4, "access to the process image of the outputs works again";
    /// A whole bus is lost: its process has ended.
    BUS_FAILED = 0x39C3, "distributed I/O, failure of a bus",
        "The process of the bus is restarted automatically. If this repeats, check its log and its line.";
    /// A station of a bus is lost.
    STATION_FAILED = 0x39C4, "distributed I/O, failure of a station", STATION_LOST;
    /// A station of a bus is back.
    STATION_BACK = 0x38C4, "distributed I/O, a station is back";
    /// A plugin block panicked (ours).
    PLUGIN_PANIC = 0xF101, "STOP, a plugin block panicked",
        "This is an error in the plugin: report the text of this entry to its author; a warm restart continues the \
         program.";
    /// A plugin block requested STOP or broke the rules of the interface (ours).
    PLUGIN_STOP = 0xF102, "STOP by a plugin block",
        "The text of this entry says why the block of the plugin has stopped the CPU.";
    /// An entry written by a plugin block (ours).
    PLUGIN_ENTRY = 0xF103, "entry of a plugin block";
    /// A driver process ended (ours).
    DRIVER_LOST = 0xF201, "driver process ended",
        "It is restarted automatically. If this repeats, check the log of the driver and its device.";
    /// A driver process is up (ours).
    DRIVER_UP = 0xF202, "driver process is up";
    /// A CP's shared memory holds an impossible value (ours).
    SEGMENT_GARBAGE = 0xF203, "a CP's shared memory is not valid",
        "The driver does not fit this runtime, or is damaged: install `ob1` and `ob1-cp` together.";
    /// A CP reports an error of its line or its parameters (ours).
    CP_ERROR = 0xF204, "a CP reports an error",
        "Check the parameters of the CP, its cable and its partner (`ob1 trace`).";
    /// A CP's error is gone (ours).
    CP_ERROR_GONE = 0xF205, "a CP's error is gone";
    /// A driver process got no core, or the kernel held it, for longer than a hang is tolerated (ours).
    DRIVER_HELD_UP = 0xF206, "driver process was held up by the system",
        "The machine is too busy: give the drivers cores of their own (`affinity`), or reduce the load.";
    /// A station of a bus refuses a request (ours).
    STATION_REFUSES = 0xF207, "distributed I/O, a station refuses a request",
        "Compare its entry in the station file with the manual of the device: the function (exception 01h), the \
        address (02h), the length or value (03h); 04h is a fault of the device, 06h means that it is busy. For \
        a DP slave, compare the GSD file, the modules in its slots and their parameters; `ob1 bus watch` says \
        which is wrong.";
    /// A station of a bus refuses nothing any more (ours).
    STATION_ACCEPTS = 0xF208, "distributed I/O, a station accepts all requests again";
    /// A DP slave reports a fault of its own, of a module or of a channel (ours).
    STATION_FAULT = 0xF209, "distributed I/O, a slave reports a fault",
        "Repair the module and the channel that it names (s slot, c channel, e error type); the log of the bus \
        describes the fault in words, SFC 13 reads the whole diagnosis.";
    /// A DP slave reports no fault any more (ours).
    STATION_FAULT_GONE = 0xF20A, "distributed I/O, a slave reports no fault any more";
    /// A slave behind a CP 342-5 is lost (ours).
    SLAVE_LOST = 0xF20B, "a slave of a communication processor is lost", STATION_LOST;
    /// A slave behind a CP 342-5 is back (ours).
    SLAVE_BACK = 0xF20C, "a slave of a communication processor is back";
    /// Events of a CP are lost: they came faster than the CPU takes them (ours).
    CP_EVENTS_LOST = 0xF20D, "a CP has lost events",
        "The CPU takes a few events of a CP in each cycle: shorten the cycle, or mend what the CP reports so often \
         (`ob1 diag`, the log of its driver).";
    /// No cycle has ended for some seconds, though the program is alive (ours).
    CYCLE_STANDS = 0xF104, "no cycle ends",
        "A loop triggers the cycle monitoring again and again (SFC 43), or the monitoring is off (`watchdog`): the \
         outputs keep what the cycle before wrote. Give the loop an end; STOP is obeyed meanwhile.";
    /// Retentive memory cannot be written to its file (ours).
    RETENTIVE_LOST = 0xF301, "retentive memory cannot be written",
        "Make room on the disk, or make the folder writable ([station] state); until then a power cycle loses the \
         newest values.";
    /// Retentive memory is written again (ours).
    RETENTIVE_KEPT = 0xF302, "retentive memory is written again";
    /// No file of retentive memory could be used: the station starts without its values (ours).
    RETENTIVE_REFUSED = 0xF303, "retentive memory is refused, the station starts without it",
        "The log says why each file was refused and where it is kept. After a start with the wrong program, end the \
        station, put its file back and start the right one (docs/station-file.md).";
    /// A file of retentive memory was used, but the program has no place for all of it (ours).
    RETENTIVE_PARTLY = 0xF304, "retentive memory is restored in part",
        "These are declared anew or not there any more; the others have their values. The log says where the file \
        is kept. After a start with the wrong program, put it back (docs/station-file.md).";
    /// STOP because two engines do not do the same (ours, `engine = "both"`).
    ENGINES_DIFFER = 0xF401, "STOP, the two engines disagree",
        "This is an error in ob1: report it with the program and the lines of the log; set engine = \"reference\" \
         until it is corrected.";
    /// A partner of a link has given a wrong password, or has changed something (ours).
    PARTNER = 0xF501, "a partner of a link";
}

impl From<FaultKind> for Event {
    fn from(kind: FaultKind) -> Self {
        Event(kind.number())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_access_in_the_words_of_ob_121() {
        for (area, bits, code) in [
            (Area::Peripheral, 8, 0x10),
            (Area::Input, 1, 0x01),
            (Area::Output, 16, 0x22),
            (Area::Memory, 32, 0x33),
            (Area::Db, 64, 0x34),
            (Area::Di, 1, 0x05),
            (Area::Local, 16, 0x26),
            (Area::PreviousLocal, 8, 0x17),
        ] {
            assert_eq!(Access::new(area, bits).code(), code);
        }
        assert_eq!(Fault::new(FaultKind::BcdConversion, 0xABC).source(), 0);
        assert_eq!(Fault::at(FaultKind::AreaLengthRead, Area::Db, 8, 300).source(), 300);
    }

    #[test]
    fn every_event_has_a_text_of_its_own() {
        for (i, event) in Event::ALL.into_iter().enumerate() {
            for other in &Event::ALL[..i] {
                assert!(*other != event && other.text() != event.text(), "{event:?} and {other:?}");
            }
        }
    }

    #[test]
    fn every_fault_has_a_number_and_a_text_of_its_own() {
        for (i, kind) in FaultKind::ALL.into_iter().enumerate() {
            assert_eq!(FaultKind::from_number(kind.number()), Some(kind));
            assert_ne!(Event::from(kind).text(), "event", "{kind:?}");
            assert!(!FaultKind::ALL[..i].iter().any(|k| k.number() == kind.number()), "{kind:?} twice");
        }
    }
}
