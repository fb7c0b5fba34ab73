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

/// What a statement did wrong. Programming errors call OB 121, access errors OB 122; without that OB the CPU goes to
/// STOP.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FaultKind {
    /// 2521h: a digit above 9 where a BCD number is expected.
    BcdConversion,
    /// 2522h: read outside the area.
    AreaLengthRead,
    /// 2523h: write outside the area.
    AreaLengthWrite,
    /// 2524h: a pointer with an area code that names no readable area.
    AreaRead,
    /// 2525h: a pointer with an area code that names no writable area.
    AreaWrite,
    /// 2526h: a timer the CPU does not have.
    TimerNumber,
    /// 2527h: a counter the CPU does not have.
    CounterNumber,
    /// 2528h: a word or double word read through a pointer whose bit part is not 0.
    AlignmentRead,
    /// 2529h: a word or double word written through a pointer whose bit part is not 0.
    AlignmentWrite,
    /// 2530h: write to a write-protected global data block.
    WriteProtectedDb,
    /// 2531h: write to a write-protected instance data block.
    WriteProtectedDi,
    /// 2532h: `AUF DB` with an impossible number.
    DbNumber,
    /// 2533h: `AUF DI` with an impossible number.
    DiNumber,
    /// 2534h: call of an FC with an impossible number.
    FcNumber,
    /// 2535h: call of an FB with an impossible number.
    FbNumber,
    /// 253Ah: the data block is not loaded.
    DbNotLoaded,
    /// 253Ch: the function is not loaded.
    FcNotLoaded,
    /// 253Dh: the system function does not exist.
    SfcNotLoaded,
    /// 253Eh: the function block is not loaded.
    FbNotLoaded,
    /// 253Fh: the system function block does not exist.
    SfbNotLoaded,
    /// 2942h: peripheral read without a module, or the module does not answer.
    PeripheralRead,
    /// 2943h: peripheral write without a module, or the module does not answer.
    PeripheralWrite,
    /// 2575h (ours): blocks nested deeper than the CPU allows, or no local data left. An S7-400 has 3575h and 3576h.
    NestingDepth,
}

impl FaultKind {
    /// The event number, such as 2522h.
    #[must_use]
    pub const fn number(self) -> u16 {
        match self {
            FaultKind::BcdConversion => 0x2521,
            FaultKind::AreaLengthRead => 0x2522,
            FaultKind::AreaLengthWrite => 0x2523,
            FaultKind::AreaRead => 0x2524,
            FaultKind::AreaWrite => 0x2525,
            FaultKind::TimerNumber => 0x2526,
            FaultKind::CounterNumber => 0x2527,
            FaultKind::AlignmentRead => 0x2528,
            FaultKind::AlignmentWrite => 0x2529,
            FaultKind::WriteProtectedDb => 0x2530,
            FaultKind::WriteProtectedDi => 0x2531,
            FaultKind::DbNumber => 0x2532,
            FaultKind::DiNumber => 0x2533,
            FaultKind::FcNumber => 0x2534,
            FaultKind::FbNumber => 0x2535,
            FaultKind::DbNotLoaded => 0x253A,
            FaultKind::FcNotLoaded => 0x253C,
            FaultKind::SfcNotLoaded => 0x253D,
            FaultKind::FbNotLoaded => 0x253E,
            FaultKind::SfbNotLoaded => 0x253F,
            FaultKind::NestingDepth => 0x2575,
            FaultKind::PeripheralRead => 0x2942,
            FaultKind::PeripheralWrite => 0x2943,
        }
    }

    /// The organization block that handles it: 121 or 122.
    #[must_use]
    pub const fn ob(self) -> u16 {
        match self {
            FaultKind::PeripheralRead | FaultKind::PeripheralWrite => 122,
            _ => 121,
        }
    }

    /// The fault of an event number, as a plugin raises it.
    #[must_use]
    pub fn from_number(number: u16) -> Option<Self> {
        Self::ALL.into_iter().find(|k| k.number() == number)
    }

    /// Every fault, each once.
    pub const ALL: [FaultKind; 23] = [
        FaultKind::BcdConversion,
        FaultKind::AreaLengthRead,
        FaultKind::AreaLengthWrite,
        FaultKind::AreaRead,
        FaultKind::AreaWrite,
        FaultKind::TimerNumber,
        FaultKind::CounterNumber,
        FaultKind::AlignmentRead,
        FaultKind::AlignmentWrite,
        FaultKind::WriteProtectedDb,
        FaultKind::WriteProtectedDi,
        FaultKind::DbNumber,
        FaultKind::DiNumber,
        FaultKind::FcNumber,
        FaultKind::FbNumber,
        FaultKind::DbNotLoaded,
        FaultKind::FcNotLoaded,
        FaultKind::SfcNotLoaded,
        FaultKind::FbNotLoaded,
        FaultKind::SfbNotLoaded,
        FaultKind::PeripheralRead,
        FaultKind::PeripheralWrite,
        FaultKind::NestingDepth,
    ];
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
    #[must_use]
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
    #[must_use]
    pub const fn code(self) -> u8 {
        self.0
    }
}

impl Fault {
    /// A fault about `number`.
    #[must_use]
    pub const fn new(kind: FaultKind, number: u32) -> Self {
        Self { kind, access: None, number }
    }

    /// A fault of an access to `bits` bits at a byte of an area.
    #[must_use]
    pub const fn at(kind: FaultKind, area: Area, bits: u32, byte: u32) -> Self {
        Self { kind, access: Some(Access::new(area, bits)), number: byte }
    }

    /// The word of OB 121's and OB 122's start information that tells what was wrong (OB121_FLT_REG, OB122_MEM_ADDR): a
    /// byte address, the illegal area, the number of a timer, counter or block; of a BCD conversion the register, which
    /// is accumulator 1: 0.
    #[must_use]
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

impl Event {
    /// Change from STOP to STARTUP.
    pub const STARTUP: Event = Event(0x4301);
    /// Change from STARTUP to RUN.
    pub const RUN: Event = Event(0x4302);
    /// STOP requested by an operator (`ob1 ctl stop`, end of a run).
    pub const STOP_OPERATOR: Event = Event(0x4304);
    /// Change from RUN to HOLD, at a breakpoint.
    pub const HOLD: Event = Event(0x4305);
    /// Change from HOLD to RUN.
    pub const HOLD_LEFT: Event = Event(0x4306);
    /// Change from HOLD to STOP.
    pub const HOLD_STOPPED: Event = Event(0x430A);
    /// Memory reset by an operator.
    pub const MEMORY_RESET: Event = Event(0x4307);
    /// STOP by SFC 46.
    pub const STOP_PROGRAM: Event = Event(0x4543);
    /// STOP by a programming error without OB 121.
    pub const STOP_PROGRAMMING_ERROR: Event = Event(0x4562);
    /// STOP by an access error without OB 122.
    pub const STOP_ACCESS_ERROR: Event = Event(0x4563);
    /// STOP by a time error: watchdog without OB 80, or twice in one cycle.
    pub const STOP_TIME_ERROR: Event = Event(0x4568);
    /// STOP because of a diagnostic interrupt without OB 82.
    pub const STOP_DIAGNOSIS: Event = Event(0x456A);
    /// STOP because OB 85 is wanted and not loaded (program sequence error).
    pub const STOP_SEQUENCE_ERROR: Event = Event(0x456D);
    /// STOP because a station of a bus is lost and OB 86 is not loaded.
    pub const STOP_RACK_FAILURE: Event = Event(0x456F);
    /// STOP because a block was aborted and OB 88 is not loaded, or was the one that was aborted.
    pub const STOP_ABORTED: Event = Event(0x4570);
    /// A block was aborted: an error in an OB that handles a synchronous error.
    pub const SYNCHRONOUS_NESTING: Event = Event(0x3573);
    /// A block was aborted: blocks are nested too deep (S7-400).
    pub const BLOCKS_TOO_DEEP: Event = Event(0x3575);
    /// A block was aborted: no local data is left (S7-400).
    pub const NO_LOCAL_DATA: Event = Event(0x3576);
    /// Cycle time exceeded: the cycle monitoring expired.
    pub const CYCLE_TIME_EXCEEDED: Event = Event(0x3501);
    /// An OB is requested that is still being executed.
    pub const OB_STILL_RUNS: Event = Event(0x3502);
    /// The clock was set forward past the start of a time-of-day interrupt.
    pub const TIME_OF_DAY_SKIPPED: Event = Event(0x3505);
    /// An OB is requested for which a request waits already.
    pub const OB_QUEUE_OVERFLOW: Event = Event(0x3507);
    /// An event wants an OB that is not loaded.
    pub const OB_NOT_LOADED: Event = Event(0x35A1);
    /// Access error while the system reads the process image of the inputs.
    pub const INPUT_IMAGE_ERROR: Event = Event(0x39B1);
    /// Access error while the system writes the process image of the outputs.
    pub const OUTPUT_IMAGE_ERROR: Event = Event(0x39B2);
    /// The same for inputs, where only the beginning and the end are reported.
    pub const INPUT_IMAGE_FAILS: Event = Event(0x39B3);
    /// The same for outputs, where only the beginning and the end are reported.
    pub const OUTPUT_IMAGE_FAILS: Event = Event(0x39B4);
    /// Access to the inputs of a module works again.
    pub const INPUT_IMAGE_BACK: Event = Event(0x38B3);
    /// Access to the outputs of a module works again.
    pub const OUTPUT_IMAGE_BACK: Event = Event(0x38B4);
    /// A whole bus is lost: its process has ended.
    pub const BUS_FAILED: Event = Event(0x39C3);
    /// A station of a bus is lost.
    pub const STATION_FAILED: Event = Event(0x39C4);
    /// A station of a bus is back.
    pub const STATION_BACK: Event = Event(0x38C4);
    /// A plugin block panicked (ours).
    pub const PLUGIN_PANIC: Event = Event(0xF101);
    /// A plugin block requested STOP or broke the rules of the interface (ours).
    pub const PLUGIN_STOP: Event = Event(0xF102);
    /// An entry written by a plugin block (ours).
    pub const PLUGIN_ENTRY: Event = Event(0xF103);
    /// A driver process ended (ours).
    pub const DRIVER_LOST: Event = Event(0xF201);
    /// A driver process is up (ours).
    pub const DRIVER_UP: Event = Event(0xF202);
    /// A CP's shared memory holds an impossible value (ours).
    pub const SEGMENT_GARBAGE: Event = Event(0xF203);
    /// A CP reports an error of its line or its parameters (ours).
    pub const CP_ERROR: Event = Event(0xF204);
    /// A CP's error is gone (ours).
    pub const CP_ERROR_GONE: Event = Event(0xF205);
    /// A driver process got no core, or the kernel held it, for longer than a hang is tolerated (ours).
    pub const DRIVER_HELD_UP: Event = Event(0xF206);
    /// A station of a bus refuses a request (ours).
    pub const STATION_REFUSES: Event = Event(0xF207);
    /// A station of a bus refuses nothing any more (ours).
    pub const STATION_ACCEPTS: Event = Event(0xF208);
    /// A DP slave reports a fault of its own, of a module or of a channel (ours).
    pub const STATION_FAULT: Event = Event(0xF209);
    /// A DP slave reports no fault any more (ours).
    pub const STATION_FAULT_GONE: Event = Event(0xF20A);
    /// A slave behind a CP 342-5 is lost (ours).
    pub const SLAVE_LOST: Event = Event(0xF20B);
    /// A slave behind a CP 342-5 is back (ours).
    pub const SLAVE_BACK: Event = Event(0xF20C);
    /// Events of a CP are lost: they came faster than the CPU takes them (ours).
    pub const CP_EVENTS_LOST: Event = Event(0xF20D);
    /// No cycle has ended for some seconds, though the program is alive (ours).
    pub const CYCLE_STANDS: Event = Event(0xF104);
    /// Retentive memory cannot be written to its file (ours).
    pub const RETENTIVE_LOST: Event = Event(0xF301);
    /// Retentive memory is written again (ours).
    pub const RETENTIVE_KEPT: Event = Event(0xF302);
    /// No file of retentive memory could be used: the station starts without its values (ours).
    pub const RETENTIVE_REFUSED: Event = Event(0xF303);
    /// A file of retentive memory was used, but the program has no place for all of it (ours).
    pub const RETENTIVE_PARTLY: Event = Event(0xF304);
    /// STOP because two engines do not do the same (ours, `engine = "both"`).
    pub const ENGINES_DIFFER: Event = Event(0xF401);
    /// A partner of a link has given a wrong password, or has changed something (ours).
    pub const PARTNER: Event = Event(0xF501);

    /// Every event with a name that is not a fault.
    pub const ALL: [Event; 55] = [
        Event::STARTUP,
        Event::RUN,
        Event::STOP_OPERATOR,
        Event::HOLD,
        Event::HOLD_LEFT,
        Event::HOLD_STOPPED,
        Event::MEMORY_RESET,
        Event::STOP_PROGRAM,
        Event::STOP_PROGRAMMING_ERROR,
        Event::STOP_ACCESS_ERROR,
        Event::STOP_TIME_ERROR,
        Event::STOP_DIAGNOSIS,
        Event::STOP_SEQUENCE_ERROR,
        Event::STOP_RACK_FAILURE,
        Event::STOP_ABORTED,
        Event::SYNCHRONOUS_NESTING,
        Event::BLOCKS_TOO_DEEP,
        Event::NO_LOCAL_DATA,
        Event::CYCLE_TIME_EXCEEDED,
        Event::OB_STILL_RUNS,
        Event::TIME_OF_DAY_SKIPPED,
        Event::OB_QUEUE_OVERFLOW,
        Event::OB_NOT_LOADED,
        Event::INPUT_IMAGE_ERROR,
        Event::OUTPUT_IMAGE_ERROR,
        Event::INPUT_IMAGE_FAILS,
        Event::OUTPUT_IMAGE_FAILS,
        Event::INPUT_IMAGE_BACK,
        Event::OUTPUT_IMAGE_BACK,
        Event::BUS_FAILED,
        Event::STATION_FAILED,
        Event::STATION_BACK,
        Event::PLUGIN_PANIC,
        Event::PLUGIN_STOP,
        Event::PLUGIN_ENTRY,
        Event::DRIVER_LOST,
        Event::DRIVER_UP,
        Event::SEGMENT_GARBAGE,
        Event::CP_ERROR,
        Event::CP_ERROR_GONE,
        Event::DRIVER_HELD_UP,
        Event::STATION_REFUSES,
        Event::STATION_ACCEPTS,
        Event::STATION_FAULT,
        Event::STATION_FAULT_GONE,
        Event::SLAVE_LOST,
        Event::SLAVE_BACK,
        Event::CP_EVENTS_LOST,
        Event::CYCLE_STANDS,
        Event::RETENTIVE_LOST,
        Event::RETENTIVE_KEPT,
        Event::RETENTIVE_REFUSED,
        Event::RETENTIVE_PARTLY,
        Event::ENGINES_DIFFER,
        Event::PARTNER,
    ];

    /// The text of the event, without its place.
    #[must_use]
    pub const fn text(self) -> &'static str {
        match self.0 {
            0x4301 => "mode transition from STOP to STARTUP",
            0x4302 => "mode transition from STARTUP to RUN",
            0x4304 => "STOP by operator",
            0x4305 => "breakpoint reached, HOLD",
            0x4306 => "breakpoint left",
            0x430A => "HOLD left to STOP",
            0x4307 => "memory reset by operator",
            0x4543 => "STOP by the program (SFC 46)",
            0x4562 => "STOP by programming error, OB 121 not loaded or not possible",
            0x4563 => "STOP by access error, OB 122 not loaded or not possible",
            0x4568 => "STOP by time error",
            0x456A => "STOP by diagnostic interrupt, OB 82 not loaded",
            0x456D => "STOP by program sequence error, OB 85 not loaded",
            0x456F => "STOP by rack failure, OB 86 not loaded",
            0x4570 => "STOP, a block was aborted, OB 88 not loaded or not possible",
            0x3573 => "a block was aborted, synchronous errors nested too deep",
            0x3575 => "a block was aborted, blocks nested too deep",
            0x3576 => "a block was aborted, no local data left",
            0x3501 => "cycle time exceeded",
            0x3502 => "OB requested while it is still being executed",
            0x3505 => "time-of-day interrupt skipped, the clock was set forward",
            0x3507 => "OB requested while a request for it waits already",
            0x35A1 => "event for an OB that is not loaded",
            0x39B1 => "access error in the transfer of the process image of the inputs",
            0x39B2 => "access error in the transfer of the process image of the outputs",
            0x39B3 => "access to the process image of the inputs fails from now on",
            0x39B4 => "access to the process image of the outputs fails from now on",
            0x38B3 => "access to the process image of the inputs works again",
            0x38B4 => "access to the process image of the outputs works again",
            0x39C3 => "distributed I/O, failure of a bus",
            0x39C4 => "distributed I/O, failure of a station",
            0x38C4 => "distributed I/O, a station is back",
            0x2521 => "BCD conversion error",
            0x2522 => "area length error when reading",
            0x2523 => "area length error when writing",
            0x2524 => "area error when reading",
            0x2525 => "area error when writing",
            0x2526 => "timer number error",
            0x2527 => "counter number error",
            0x2528 => "alignment error when reading",
            0x2529 => "alignment error when writing",
            0x2530 => "write error, data block is write-protected",
            0x2531 => "write error, instance data block is write-protected",
            0x2532 => "block number error when opening a data block",
            0x2533 => "block number error when opening an instance data block",
            0x2534 => "block number error when calling an FC",
            0x2535 => "block number error when calling an FB",
            0x253A => "data block not loaded",
            0x253C => "FC not loaded",
            0x253D => "SFC not available",
            0x253E => "FB not loaded",
            0x253F => "SFB not available",
            0x2575 => "blocks nested too deep",
            0x2942 => "peripheral access error when reading",
            0x2943 => "peripheral access error when writing",
            0xF101 => "STOP, a plugin block panicked",
            0xF102 => "STOP by a plugin block",
            0xF103 => "entry of a plugin block",
            0xF104 => "no cycle ends",
            0xF201 => "driver process ended",
            0xF202 => "driver process is up",
            0xF203 => "a CP's shared memory is not valid",
            0xF204 => "a CP reports an error",
            0xF205 => "a CP's error is gone",
            0xF206 => "driver process was held up by the system",
            0xF207 => "distributed I/O, a station refuses a request",
            0xF208 => "distributed I/O, a station accepts all requests again",
            0xF209 => "distributed I/O, a slave reports a fault",
            0xF20A => "distributed I/O, a slave reports no fault any more",
            0xF20B => "a slave of a communication processor is lost",
            0xF20C => "a slave of a communication processor is back",
            0xF20D => "a CP has lost events",
            0xF301 => "retentive memory cannot be written",
            0xF302 => "retentive memory is written again",
            0xF501 => "a partner of a link",
            0xF303 => "retentive memory is refused, the station starts without it",
            0xF304 => "retentive memory is restored in part",
            0xF401 => "STOP, the two engines disagree",
            // Entries of the program itself (SFC 52): classes 8 and 9 are for its messages, A and B for the user's own.
            _ if matches!(self.0 >> 12, 8..=0xB) => "entry of the program",
            _ => "event",
        }
    }
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
