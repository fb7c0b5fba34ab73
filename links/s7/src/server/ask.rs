//! What a connection asks of the CPU, and what it gets for it.

use crate::Rights;
use crate::codes::{Code, ItemCode};
use crate::wire::{Address, BlockType, DateTime};

/// A request with its number.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Request {
    /// Comes back with the reply.
    pub id: u64,
    /// What is asked.
    pub ask: Ask,
}

/// What is asked of the CPU.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Ask {
    /// Values, all of one cycle control point. [`Reply::Values`].
    Read(Vec<Address>),
    /// New values, in order, at one cycle control point. [`Reply::Written`].
    Write(Vec<Put>),
    /// A system status list. [`Reply::Szl`].
    Szl {
        /// Its ID.
        id: u16,
        /// The index.
        index: u16,
    },
    /// Which blocks there are. [`Reply::Blocks`].
    Blocks,
    /// A whole block: head, code or actual values, interface, segments, foot. [`Reply::Block`].
    Block {
        /// Its type.
        ty: BlockType,
        /// Its number.
        number: u16,
    },
    /// The clock. [`Reply::Clock`].
    Clock,
    /// Sets the clock. [`Reply::Done`].
    SetClock(DateTime),
    /// A change of the operating state, or of the memory. [`Reply::Done`].
    Control(Control),
    /// Blocks to be linked into the program, together. [`Reply::Done`].
    Load(Vec<Loaded>),
    /// Blocks to be deleted. [`Reply::Done`].
    Delete(Vec<(BlockType, u16)>),
    /// A password was given. [`Reply::Rights`].
    Login(String),
    /// The password counts no more. [`Reply::Rights`].
    Logout,
}

/// One value to write.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Put {
    /// Where.
    pub address: Address,
    /// As many bytes as the address has.
    pub bytes: Vec<u8>,
}

/// A block that has come over the wire.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Loaded {
    /// Its type.
    pub ty: BlockType,
    /// Its number.
    pub number: u16,
    /// Head, code or values, interface, segments, foot.
    pub bytes: Vec<u8>,
}

/// Program invocation services.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Control {
    /// To STOP.
    Stop,
    /// Warm restart.
    Warm,
    /// Cold restart.
    Cold,
    /// Compress the memory.
    Compress,
    /// Copy RAM to ROM.
    CopyRamToRom,
}

/// A block of a list.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Listed {
    /// Its type.
    pub ty: BlockType,
    /// Its number.
    pub number: u16,
    /// The language of its head.
    pub language: u8,
}

/// What the CPU says.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Reply {
    /// Done.
    Done,
    /// Of each address its bytes, or why there are none.
    Values(Vec<Result<Vec<u8>, ItemCode>>),
    /// What became of each value.
    Written(Vec<ItemCode>),
    /// Records of a status list.
    Szl {
        /// Bytes of a record.
        record: u16,
        /// The records.
        bytes: Vec<u8>,
    },
    /// All blocks.
    Blocks(Vec<Listed>),
    /// A whole block.
    Block(Vec<u8>),
    /// Date and time.
    Clock(DateTime),
    /// What the connection may do from now on.
    Rights(Rights),
    /// Not done, for this reason.
    Refused(Code),
    /// Not done, because the CPU is in this state already.
    Already,
}

/// Something happened in the CPU.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CpuEvent {
    /// An entry of the diagnostic buffer, as list 00A0 has it.
    Diagnosis([u8; 20]),
    /// The operating state, as the message has it: 0 STOP, 1 warm restart, 2 RUN.
    Mode(u8),
}
