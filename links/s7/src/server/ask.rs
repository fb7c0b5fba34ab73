//! Requests of a connection to the CPU, and the replies.

use ob1_model::{
    AlarmEvent, AlarmNow, AlarmOrder, BlockId, CodeAddress, DebugAnswer, DebugOrder, Displays, Forced, Pass, PassOrder,
    Point,
};

use crate::Rights;
use crate::codes::{Code, ItemCode};
use crate::wire::{Address, BlockType, DateTime};

/// A request with its number.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Request {
    /// Returned with the reply.
    pub id: u64,
    /// What the CPU is asked for.
    pub ask: Ask,
}

/// A request to the CPU.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Ask {
    /// Values, all of one cycle control point. [`Reply::Values`].
    Read(Vec<Address>),
    /// New values, in order, at one cycle control point. [`Reply::Written`].
    Write(Vec<Put>),
    /// A system status list. [`Reply::Szl`].
    Szl {
        /// SZL-ID: which list, and which part of it.
        id: u16,
        /// INDEX: which object the list is about.
        index: u16,
    },
    /// The list of blocks. [`Reply::Blocks`].
    Blocks,
    /// A whole block: header, code or actual values, interface, segments, foot. [`Reply::Block`].
    Block {
        /// Its type: OB, DB, FC and so on.
        ty: BlockType,
        /// Number of the block.
        number: u16,
    },
    /// Date and time of the CPU. [`Reply::Clock`].
    Clock,
    /// Sets the clock. [`Reply::Done`].
    SetClock(DateTime),
    /// A change of the operating state, or of the memory. [`Reply::Done`].
    Control(Control),
    /// Links blocks into the program, together. [`Reply::Done`].
    Load(Vec<Loaded>),
    /// Deletes blocks of the program. [`Reply::Done`].
    Delete(Vec<(BlockType, u16)>),
    /// A password was given. [`Reply::Rights`].
    Login(String),
    /// The password is no longer valid. [`Reply::Rights`].
    Logout,
    /// Values read or written at a point of the cycle, beside the other requests. [`Reply::Values`],
    /// [`Reply::Written`], or [`Reply::Forgotten`].
    At {
        /// The point at which it is done.
        point: Point,
        /// At each such point, without a reply until it is forgotten.
        stays: bool,
        /// What is read or written there.
        access: Access,
    },
    /// One pass through a block, likewise beside the others. [`Reply::Pass`].
    Pass(PassOrder),
    /// A request is not wanted any more: it has its reply before this one. [`Reply::Done`].
    Forget {
        /// Number of that request.
        request: u64,
        /// So long, in milliseconds, its result may still come.
        patience: u64,
    },
    /// What lies at these addresses of the machine code of a block. [`Reply::Code`].
    Code {
        /// The block with the machine code.
        block: BlockId,
        /// Bytes from the begin of its code.
        wanted: Vec<u16>,
    },
    /// Breakpoints, HOLD, stacks. To wait for a hold, it waits beside the others. [`Reply::Debug`].
    Debug(DebugOrder),
    /// What is forced. [`Reply::Forced`].
    Forced,
    /// Forces these values in place of those before; none: it ends forcing. [`Reply::Done`].
    Force(Vec<Put>),
    /// The partner is a display of alarms from now on, for these of them; nothing: no longer. [`Reply::Done`].
    LogOn {
        /// What it wants to get.
        displays: Displays,
        /// Its name.
        name: String,
    },
    /// About alarms. [`Reply::Alarms`] or [`Reply::Ordered`].
    Alarms(AlarmOrder),
    /// The partner wants to see which CPU it is. [`Reply::Done`].
    Blink,
}

/// An access at a point of the cycle.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Access {
    /// These addresses are read.
    Read(Vec<Address>),
    /// These values are written.
    Write(Vec<Put>),
}

impl Access {
    /// Whether nothing is accessed.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        match self {
            Self::Read(addresses) => addresses.is_empty(),
            Self::Write(puts) => puts.is_empty(),
        }
    }
}

/// Places in the machine code of a block.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct CodePlaces {
    /// A number of the code: another one, if the block has been changed.
    pub code: u64,
    /// The statements of the block, its end included.
    pub statements: u32,
    /// For each address the statement that begins there.
    pub found: Vec<Option<CodeAddress>>,
}

/// One value to write.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Put {
    /// The address that gets the bytes.
    pub address: Address,
    /// As many bytes as the address has.
    pub bytes: Vec<u8>,
}

/// A block that was received whole.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Loaded {
    /// Its type: OB, DB, FC and so on.
    pub ty: BlockType,
    /// Number of the block.
    pub number: u16,
    /// Header, code or values, interface, segments, foot.
    pub bytes: Vec<u8>,
}

/// Program invocation services that a partner can ask for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Control {
    /// The CPU goes to STOP.
    Stop,
    /// Warm restart (OB 100).
    Warm,
    /// Cold restart (OB 102).
    Cold,
    /// Compresses the memory: `_GARB`.
    Compress,
    /// Copy RAM to ROM.
    CopyRamToRom,
    /// Memory reset, in STOP.
    Reset,
}

/// A block of a list.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Listed {
    /// Its type: OB, DB, FC and so on.
    pub ty: BlockType,
    /// Number of the block.
    pub number: u16,
    /// The language in its header.
    pub language: u8,
}

/// A reply of the CPU.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Reply {
    /// Done, with nothing to tell.
    Done,
    /// The bytes of each address, or why there are none.
    Values(Vec<Result<Vec<u8>, ItemCode>>),
    /// The outcome for each value.
    Written(Vec<ItemCode>),
    /// Records of a status list.
    Szl {
        /// Bytes of a record.
        record: u16,
        /// The records, one after the other.
        bytes: Vec<u8>,
    },
    /// All blocks of the CPU.
    Blocks(Vec<Listed>),
    /// A whole block, as in a block folder.
    Block(Vec<u8>),
    /// Date and time of the CPU.
    Clock(DateTime),
    /// The rights of the connection from now on.
    Rights(Rights),
    /// A pass through a block.
    Pass(Pass),
    /// Places in machine code.
    Code(CodePlaces),
    /// How an order about breakpoints has ended.
    Debug(DebugAnswer),
    /// The forced cells, with their values.
    Forced(Vec<Forced>),
    /// The alarms that were asked for.
    Alarms(Vec<AlarmNow>),
    /// For each alarm of an order whether it exists.
    Ordered(Vec<bool>),
    /// Its point has not come.
    Forgotten,
    /// Not done, for this reason.
    Refused(Code),
    /// Not done, because the CPU is in this state already.
    Already,
}

/// Something happened in the CPU.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum CpuEvent {
    /// An entry of the diagnostic buffer, as in list 00A0.
    Diagnosis([u8; 20]),
    /// The operating state, as in the message: 0 STOP, 1 warm restart, 2 RUN.
    Mode(u8),
    /// A change of an alarm.
    Alarm(Box<AlarmEvent>),
}
