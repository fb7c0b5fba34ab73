//! The messages between a link and the broker: one message per packet, in the order they were sent.

use ob1_model::{
    AlarmEvent, AlarmNow, AlarmOrder, BlockId, CellError, CodeAddress, Command, DebugAnswer, DebugOrder, Displays,
    Forced, OperatingState as State, Pass, PassOrder, Piece, PointOrder, Put,
};
use serde::{Deserialize, Serialize};

use crate::Right;

/// Version of these messages. Both ends come from one build, and check it.
pub const VERSION: u16 = 10;
/// The longest message either way, in bytes.
pub const MESSAGE_BYTES: usize = 160 * 1024;
/// The longest part of a document.
pub const PART_BYTES: usize = 128 * 1024;
/// Bytes of blocks that a client may have put aside.
pub const STAGED_BYTES: usize = 1024 * 1024;
/// Maximum of unanswered groups and questions per client.
pub const OUTSTANDING: usize = 8;
/// Maximum of unanswered passes and points per client: they may wait for long, and do not count as the others do.
pub const ARMED: usize = 32;

/// Alarms of one part of [`Answer::Alarms`].
pub const ALARM_PART: usize = 128;
/// Changes of alarms that a client gets before it has said of the first that it is handed out.
pub const ALARM_CHANGES: usize = 64;

/// Returned with the answer.
pub type Ticket = u64;

/// What a client asks the broker. In brackets: the right it needs beyond reading.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Ask {
    /// Password: it gives the client the rights of the key `password_rights`.
    Login(String),
    /// Back to the rights of the link.
    Logout,
    /// A change of the operating state (operate). [`Answer::Done`] means that it has been started.
    Command(Command),
    /// Date and time of day of the CPU.
    Clock,
    /// Sets them (operate): a DATE_AND_TIME.
    SetClock([u8; 8]),
    /// A system status list, as SFC 51 reads it.
    Szl {
        /// SZL_ID: which list, and which part of it.
        id: u16,
        /// INDEX: which object the list is about.
        index: u16,
    },
    /// The diagnostic buffer, with at most this many entries.
    Diagnostics(u16),
    /// The operating state, and which modules answer, in the order of the station file.
    Modules,
    /// The blocks of the program.
    Blocks,
    /// One of them, as in a block folder.
    Block(BlockId),
    /// Events with a higher number than this, and every new one as it comes.
    Events {
        /// The last known number; 0: all events; [`u64::MAX`]: only new ones.
        after: u64,
    },
    /// Ends [`Ask::Events`]: no more events.
    NoEvents,
    /// One of the station's documents.
    Document(Document),
    /// A block as in a block folder, put aside for [`Ask::Link`] (operate; the broker keeps what a client has put
    /// aside, up to [`STAGED_BYTES`]). If it is refused, nothing stays aside.
    Stage {
        /// Which one it is.
        id: BlockId,
        /// Header, code, interface and foot, as MC7 has them.
        bytes: Box<[u8]>,
    },
    /// Adds everything this client has put aside to the program, together (operate). [`Answer::Done`] means that it has
    /// taken effect.
    Link,
    /// Removes these blocks from the program, together (operate). [`Answer::Done`] means that it has taken effect.
    Delete(Vec<BlockId>),
    /// One pass through a block, watched statement by statement. The answer comes when it was made.
    Pass(PassOrder),
    /// Forces these cells in place of those before (operate); none: it ends forcing. All of them, or none is.
    Force(Vec<Forced>),
    /// The cells that are forced, with their values.
    Forced,
    /// Breakpoints and single step (operate). One client at a time; if it goes, a CPU in HOLD goes to STOP.
    Debug(DebugOrder),
    /// Cells read and written at one point of a cycle (operate, if any is written). The answer comes when it was done,
    /// of an order that stays when it is forgotten.
    Point(PointOrder),
    /// The pass or point with this ticket is wanted no more; it is answered all the same, with what there is of it.
    Forget(Ticket),
    /// What lies at these addresses of a block's machine code.
    Addresses {
        /// The block with the machine code.
        block: BlockId,
        /// Bytes from the begin of its code.
        wanted: Vec<u16>,
    },
    /// The client is a display from now on: it gets the changes of alarms as [`News::Alarm`] until it logs off.
    /// [`Answer::LoggedOn`]. What it has logged on for before is replaced; nothing logs it off ([`Answer::Done`]).
    LogOn {
        /// What it wants to get.
        displays: Displays,
        /// Its name. If the process of the link is killed, a display of this name and address continues after the last
        /// change that was handed to it; without a name it begins anew. The first characters count.
        name: String,
    },
    /// About the alarms: which there are, or (write) acknowledge, lock, unlock. [`Answer::Alarms`] or
    /// [`Answer::Ordered`].
    Alarms(AlarmOrder),
}

/// Places in the machine code of a block.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Addresses {
    /// A number of the code: another one, if the block has been changed.
    pub code: u64,
    /// The statements of the block, its end included.
    pub statements: u32,
    /// For each address: the statement that begins there.
    pub found: Vec<Option<CodeAddress>>,
}

/// A document about the whole station. All but the program are JSON objects as on the control socket (docs/access.md).
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Document {
    /// The program in the file form of `ob1_ir::file`. It does not change while the station runs.
    Program,
    /// `status`: operating state, modules, figures.
    Status,
    /// `timing`, with the buckets of all distributions.
    Timing,
    /// `cps`: the diagnostic buffers of the CPs.
    Buffers,
    /// `links`: each link and whether its process is up.
    Links,
    /// The blocks as a person reads them, with the set of mnemonics.
    Sources,
    /// The texts of alarms ([`AlarmTexts`](crate::alarms::AlarmTexts)). They do not change while the station runs.
    AlarmTexts,
}

/// An answer of the broker.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Answer {
    /// The request has been carried out or started.
    Done,
    /// Date and time of the CPU, as a DATE_AND_TIME.
    Clock([u8; 8]),
    /// A system status list.
    Szl {
        /// Bytes of a record.
        record: u16,
        /// The records, one after the other.
        bytes: Box<[u8]>,
    },
    /// There is no such list: RET_VAL of SFC 51.
    NoSzl(u16),
    /// The entries, newest first.
    Diagnostics(Vec<Diagnosis>),
    /// The operating state, and which modules answer.
    Modules {
        /// Operating state of the CPU.
        state: State,
        /// For each module: whether it answers.
        present: Vec<bool>,
    },
    /// The blocks, in ascending order.
    Blocks(Vec<BlockFact>),
    /// The block as a block folder has it.
    Block(Box<[u8]>),
    /// The request was refused.
    Refused(Refusal),
    /// A document. It is sent in parts, and `last` marks the last one; [`Door`](super::Door) joins them.
    Document {
        /// Whether this is the last part.
        last: bool,
        /// Bytes of this part.
        bytes: Box<[u8]>,
    },
    /// What was seen of the pass.
    Pass(Pass),
    /// The forced cells, with their values.
    Forced(Vec<Forced>),
    /// How an order about breakpoints has ended.
    Debug(DebugAnswer),
    /// For each item the bytes read; empty if the order was forgotten before its point came.
    Point(Vec<Result<Box<[u8]>, Refusal>>),
    /// Places in machine code.
    Addresses(Addresses),
    /// The client is a display: it gets the changes after this one.
    LoggedOn {
        /// Number of that change.
        after: u64,
    },
    /// The alarms. They are sent in parts, and `last` marks the last one; [`Door`](super::Door) joins them.
    Alarms {
        /// Whether this is the last part.
        last: bool,
        /// Number of the last change that they contain.
        after: u64,
        /// The alarms of this part.
        list: Vec<AlarmNow>,
    },
    /// For each alarm of an order: whether there is such an alarm.
    Ordered(Vec<bool>),
}

/// Why a request was refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Refusal {
    /// The CPU does not have such a cell.
    Cell(CellError),
    /// The rights of this client do not allow it: kind of access, area or data block.
    Right,
    /// A wrong password, or the link has none.
    Password,
    /// There is no such thing here.
    NotThere,
    /// Too many requests of this client are unanswered.
    Full,
    /// The CPU does not answer.
    Silent,
    /// Not while the CPU is in RUN.
    InRun,
    /// The CPU cannot use this block, or not together with the others.
    Block,
    /// There is no room for it.
    Room,
    /// A job of program status watches a block that would change.
    Watched,
}

impl std::fmt::Display for Refusal {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Refusal::Cell(error) => error.fmt(f),
            Refusal::Right => {
                f.write_str("not allowed here: see `rights`, `areas`, `blocks` and `program` of the link")
            }
            Refusal::Password => f.write_str("wrong password"),
            Refusal::NotThere => f.write_str("there is no such thing"),
            Refusal::Full => f.write_str("too many requests are unanswered"),
            Refusal::InRun => f.write_str("not while the CPU is in RUN: send it to STOP first"),
            Refusal::Block => f.write_str("the CPU cannot use this block, or not together with the others"),
            Refusal::Room => f.write_str("there is no room for it"),
            Refusal::Watched => f.write_str("program status watches a block that would change: end it first"),
            Refusal::Silent => f.write_str("the CPU does not answer: its scan hangs, or its cycle is very long"),
        }
    }
}

/// An entry of the diagnostic buffer.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Diagnosis {
    /// Counts all entries, from 1.
    pub number: u64,
    /// When, in nanoseconds of the runtime.
    pub time: u64,
    /// When, as a DATE_AND_TIME, by the CPU's clock as it is set now.
    pub wall: [u8; 8],
    /// Number of the event, 16#4302 for instance.
    pub event: u16,
    /// The block it is about.
    pub block: Option<BlockId>,
    /// The line of its source; 0: none.
    pub line: u32,
    /// Additional information, by the event: a block, an address, a time.
    pub data: u32,
    /// The event in words.
    pub text: String,
    /// File and line; empty for an entry about no statement.
    pub place: String,
    /// What delayed the scan, if the cycle monitoring expired and the cause is known.
    pub because: String,
    /// The remedy; empty for mere information.
    pub remedy: String,
}

/// A block of the program.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BlockFact {
    /// Kind and number of the block.
    pub id: BlockId,
    /// Bytes of its data; 0 for code.
    pub bytes: u32,
    /// The language it was written in, as in a block's header: 1 STL, 5 a data block, 0 unknown.
    pub language: u8,
    /// Its name; empty without one.
    pub name: String,
}

/// Something has happened: an entry for those who asked for [`Ask::Events`].
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Event {
    /// Counts all events, from 1.
    pub number: u64,
    /// When, in nanoseconds of the runtime.
    pub time: u64,
    /// What has happened then.
    pub what: What,
}

/// What can happen in a station.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum What {
    /// An entry of the diagnostic buffer.
    Diagnosis(Diagnosis),
    /// The operating state has become this.
    State(State),
    /// A driver has come up or is gone.
    Driver {
        /// Name of the driver's module.
        name: String,
        /// Whether it is up now.
        up: bool,
    },
    /// A link has come up or is gone.
    Link {
        /// Name of the link.
        name: String,
        /// Whether it is up now.
        up: bool,
    },
    /// The number of events lost before this one.
    Lost(u64),
}

/// The first message to a link.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Welcome {
    /// Version of the messages, [`VERSION`]; another one ends the link.
    pub version: u16,
    /// Name of the station, from its station file.
    pub station: String,
    /// Name of the link, from the station file.
    pub link: String,
    /// Family of the CPU: 300 or 400.
    pub family: u16,
    /// What its process is told ([`settings`](crate::settings)), as JSON, without passwords.
    pub config: String,
    /// What its clients may do.
    pub rights: Right,
    /// Bytes of the process image of the inputs.
    pub inputs: u32,
    /// Bytes of the process image of the outputs.
    pub outputs: u32,
    /// Bytes of bit memory.
    pub memory: u32,
    /// Number of timers of the CPU.
    pub timers: u16,
    /// Number of counters of the CPU.
    pub counters: u16,
    /// Minimum cycle time in nanoseconds.
    pub min_cycle: u64,
    /// Generations of watches begin above this.
    pub generation: u64,
    /// Number of listening sockets that come with this message, after the window.
    pub listeners: u8,
}

/// A connection of a link, for tools that show the station.
#[derive(Clone, Debug, Default, PartialEq, Eq, Deserialize, Serialize)]
pub struct Connection {
    /// Its partner: address and port.
    pub partner: String,
    /// Its name: a TSAP, or the number and type of a configured connection.
    pub name: String,
    /// Its state, in a word.
    pub state: String,
    /// The agreed PDU; 0: none.
    pub pdu: u16,
    /// Jobs of both sides.
    pub jobs: u64,
    /// Jobs refused or failed.
    pub errors: u64,
}

/// A message from a link.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ToBroker {
    /// A sign of life.
    Beat,
    /// Watches these pieces instead of the previous ones.
    Watch {
        /// Higher than the previous one.
        generation: u64,
        /// The pieces to watch.
        pieces: Vec<Piece>,
    },
    /// A group of writes.
    Write {
        /// Number of the client whose writes they are.
        client: u32,
        /// Number that comes back with the outcome.
        ticket: Ticket,
        /// The values; all of them are written, or none.
        puts: Vec<Put>,
    },
    /// A question of a client.
    Ask {
        /// Number of the client that asks.
        client: u32,
        /// Number that comes back with the answer.
        ticket: Ticket,
        /// What is asked of the broker.
        ask: Ask,
    },
    /// This client is gone.
    Gone(u32),
    /// Connections of the link at present, for tools that show them.
    Connections(Vec<Connection>),
    /// Who this client is, address and port: passwords wait by the address, and what it changes is recorded under it. A
    /// link that has users of its own records them itself.
    Partner {
        /// Number of the client.
        client: u32,
        /// Address and port of its partner.
        partner: String,
    },
    /// Changes of alarms are about to be written to the socket of this client. The first time the socket itself comes
    /// along: if the process is killed, the kernel knows which of them its partner has.
    Sending {
        /// Number of the client.
        client: u32,
        /// Number of each change, and how many bytes of the connection are written when it is.
        ends: Vec<(u64, u64)>,
    },
    /// Changes of alarms up to this one have left the link for this client. More of them come after that.
    Handed {
        /// Number of the client.
        client: u32,
        /// Number of the change.
        number: u64,
    },
}

/// A message to a link.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ToLink {
    /// The first message; nothing is valid before it.
    Welcome(Welcome),
    /// A snapshot of this generation is there.
    Watching(u64),
    /// Nothing of this generation is watched, because these of its pieces are not allowed. None is named if the pieces
    /// exceed the link's share.
    Unwatched {
        /// Generation that is not watched.
        generation: u64,
        /// Indexes of the pieces that are not allowed.
        refused: Vec<u32>,
    },
    /// News for the process.
    News(News),
}

/// News from the broker.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum News {
    /// The pieces requested by a read are available.
    Watching,
    /// The outcome of a group of writes: the scan whose snapshot contains it. A later read sees it.
    Written {
        /// Number of the client that has written.
        client: u32,
        /// Number of the group of writes.
        ticket: Ticket,
        /// The scan, or the first entry that was refused; then nothing was written.
        outcome: Result<u64, Refused>,
    },
    /// An answer to a question of a client.
    Answer {
        /// Number of the client that has asked.
        client: u32,
        /// Number of the question.
        ticket: Ticket,
        /// What the broker says to it.
        answer: Answer,
    },
    /// An event, for a client that asked for them.
    Event(Event),
    /// A change of an alarm, for a display.
    Alarm {
        /// Number of the client that has logged on.
        client: u32,
        /// The change.
        event: Box<AlarmEvent>,
    },
}

/// An entry of a group that was refused; then nothing was written. [`Refusal::Silent`] is about the whole group, and
/// nobody knows whether it was written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Refused {
    /// Index of the entry in its group.
    pub entry: u32,
    /// Why it was refused.
    pub why: Refusal,
}
