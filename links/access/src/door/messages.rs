//! The messages between a link and the broker: one message per packet, in the order they were sent.

use ob1_model::{Area, BlockId, BlockKind, Cell, CellError, Command, OperatingState as State, Piece, Put, Width};
use serde::{Deserialize, Serialize};

use super::wire::{Wire, wire};
use crate::Right;

/// Version of these messages. Both ends come from one build, and check it.
pub const VERSION: u16 = 3;
/// The longest message either way, in bytes.
pub const MESSAGE_BYTES: usize = 160 * 1024;
/// The longest part of a document.
pub const PART_BYTES: usize = 128 * 1024;
/// Bytes of blocks that a client may have put aside.
pub const STAGED_BYTES: usize = 1024 * 1024;
/// Maximum of unanswered groups and questions per client.
pub const OUTSTANDING: usize = 8;

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
        /// SZL_ID.
        id: u16,
        /// INDEX.
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
        /// The last known number; 0: all events.
        after: u64,
    },
    /// No more events.
    NoEvents,
    /// One of the station's documents.
    Document(Document),
    /// A block as in a block folder, put aside for [`Ask::Link`] (operate; the broker keeps what a client has put
    /// aside, up to [`STAGED_BYTES`]).
    Stage {
        /// Which one it is.
        id: BlockId,
        /// Its bytes.
        bytes: Box<[u8]>,
    },
    /// Adds everything this client has put aside to the program, together (operate). [`Answer::Done`] means that it has
    /// taken effect.
    Link,
    /// Removes these blocks from the program, together (operate). [`Answer::Done`] means that it has taken effect.
    Delete(Vec<BlockId>),
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
}

/// An answer of the broker.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Answer {
    /// The request has been carried out or started.
    Done,
    /// A DATE_AND_TIME.
    Clock([u8; 8]),
    /// A system status list.
    Szl {
        /// Bytes of a record.
        record: u16,
        /// The records.
        bytes: Box<[u8]>,
    },
    /// There is no such list: RET_VAL of SFC 51.
    NoSzl(u16),
    /// Newest first.
    Diagnostics(Vec<Diagnosis>),
    /// The operating state, and which modules answer.
    Modules {
        /// The state.
        state: State,
        /// For each module: whether it answers.
        present: Vec<bool>,
    },
    /// In ascending order.
    Blocks(Vec<BlockFact>),
    /// Its bytes.
    Block(Box<[u8]>),
    /// The request was refused.
    Refused(Refusal),
    /// A document. It is sent in parts, and `last` marks the last one; [`Door`](super::Door) joins them.
    Document {
        /// Nothing follows.
        last: bool,
        /// The bytes.
        bytes: Box<[u8]>,
    },
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
}

impl std::fmt::Display for Refusal {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Refusal::Cell(error) => error.fmt(f),
            Refusal::Right => f.write_str("not allowed here: see `rights`, `areas` and `blocks` of the link"),
            Refusal::Password => f.write_str("wrong password"),
            Refusal::NotThere => f.write_str("there is no such thing"),
            Refusal::Full => f.write_str("too many requests are unanswered"),
            Refusal::InRun => f.write_str("not while the CPU is in RUN: send it to STOP first"),
            Refusal::Block => f.write_str("the CPU cannot use this block, or not together with the others"),
            Refusal::Room => f.write_str("there is no room for it"),
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
    /// The event.
    pub event: u16,
    /// The block it is about.
    pub block: Option<BlockId>,
    /// The line of its source; 0: none.
    pub line: u32,
    /// Additional information.
    pub data: u32,
    /// In words.
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
    /// Kind and number.
    pub id: BlockId,
    /// Bytes of its data; 0 for code.
    pub bytes: u32,
    /// The language it was written in, as in a block's header: 1 STL, 5 a data block, 0 unknown.
    pub language: u8,
    /// Its name; empty without one.
    pub name: String,
}

/// Something has happened.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Event {
    /// Counts all events, from 1.
    pub number: u64,
    /// When, in nanoseconds of the runtime.
    pub time: u64,
    /// What.
    pub what: What,
}

/// What has happened.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum What {
    /// An entry of the diagnostic buffer.
    Diagnosis(Diagnosis),
    /// Another operating state.
    State(State),
    /// A driver has come up or is gone.
    Driver {
        /// Of this module.
        name: String,
        /// It is up.
        up: bool,
    },
    /// A link has come up or is gone.
    Link {
        /// Its name.
        name: String,
        /// It is up.
        up: bool,
    },
    /// The number of events lost before this one.
    Lost(u64),
}

/// The first message to a link.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Welcome {
    /// [`VERSION`].
    pub version: u16,
    /// The station's name.
    pub station: String,
    /// The link's name.
    pub link: String,
    /// 300 or 400.
    pub family: u16,
    /// The keys of the `[[link]]` table as JSON, without passwords.
    pub config: String,
    /// What its clients may do.
    pub rights: Right,
    /// Bytes of the process image of the inputs.
    pub inputs: u32,
    /// Bytes of the process image of the outputs.
    pub outputs: u32,
    /// Bytes of bit memory.
    pub memory: u32,
    /// Timers.
    pub timers: u16,
    /// Counters.
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
    /// Its state.
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
        /// The pieces.
        pieces: Vec<Piece>,
    },
    /// A group of writes.
    Write {
        /// Whose.
        client: u32,
        /// Comes back.
        ticket: Ticket,
        /// What.
        puts: Vec<Put>,
    },
    /// A question.
    Ask {
        /// Whose.
        client: u32,
        /// Comes back.
        ticket: Ticket,
        /// What.
        ask: Ask,
    },
    /// This client is gone.
    Gone(u32),
    /// Its present connections.
    Connections(Vec<Connection>),
}

/// A message to a link.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ToLink {
    /// The first message.
    Welcome(Welcome),
    /// A snapshot of this generation is there.
    Watching(u64),
    /// Nothing of this generation is watched, because these of its pieces are not allowed. None is named if the pieces
    /// exceed the link's share.
    Unwatched {
        /// The generation.
        generation: u64,
        /// Indexes of pieces.
        refused: Vec<u32>,
    },
    /// The outcome of a group.
    Written {
        /// Whose.
        client: u32,
        /// Of the group.
        ticket: Ticket,
        /// The scan whose snapshot contains it; or the first entry that was refused.
        outcome: Result<u64, Refused>,
    },
    /// An answer.
    Answer {
        /// Whose.
        client: u32,
        /// Of the question.
        ticket: Ticket,
        /// What.
        answer: Answer,
    },
    /// An event.
    Event(Event),
}

/// An entry of a group that was refused; then nothing was written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Refused {
    /// Its index.
    pub entry: u32,
    /// Why.
    pub why: Refusal,
}

impl Wire for Cell {
    fn put(&self, out: &mut Vec<u8>) {
        let (kind, number) = match self {
            Cell::Area(..) | Cell::Db(..) => self.block().unwrap_or((u8::MAX, 0)),
            Cell::Peripheral(_) => (4, 0),
            Cell::Timer(number) => (5, *number),
            Cell::Counter(number) => (6, *number),
        };
        kind.put(out);
        number.put(out);
        self.bit().put(out);
    }
    fn get(bytes: &mut &[u8]) -> Option<Self> {
        let (kind, number, bit) = (u8::get(bytes)?, u16::get(bytes)?, u32::get(bytes)?);
        Some(match kind {
            0 => Cell::Area(Area::Input, bit),
            1 => Cell::Area(Area::Output, bit),
            2 => Cell::Area(Area::Memory, bit),
            3 => Cell::Db(number, bit),
            4 => Cell::Peripheral(bit),
            5 => Cell::Timer(number),
            6 => Cell::Counter(number),
            _ => return None,
        })
    }
}

impl Wire for CellError {
    fn put(&self, out: &mut Vec<u8>) {
        out.push(self.code());
    }
    fn get(bytes: &mut &[u8]) -> Option<Self> {
        CellError::from_code(u8::get(bytes)?)
    }
}

impl Wire for BlockId {
    fn put(&self, out: &mut Vec<u8>) {
        out.push(self.kind as u8);
        self.number.put(out);
    }
    fn get(bytes: &mut &[u8]) -> Option<Self> {
        Some(BlockId::new(BlockKind::from_repr(u8::get(bytes)?)?, u16::get(bytes)?))
    }
}

wire!(enum Width { 0 => Bit, 1 => Byte, 2 => Word, 3 => DWord });
wire!(enum Piece { 0 => Bytes { at, len }, 1 => Value(cell, width) });
wire!(enum Put { 0 => Value(cell, width, value), 1 => Bytes(cell, bytes) });
wire!(enum State { 0 => Stop, 1 => Startup, 2 => Run });
wire!(enum Right { 0 => Read, 1 => Write, 2 => Operate });
wire!(enum Command { 0 => Run, 1 => Stop, 2 => Warm, 3 => Cold, 4 => Hot, 5 => Reset });
wire!(enum Ask {
    0 => Login(password), 1 => Logout, 2 => Command(command), 3 => Clock, 4 => SetClock(clock), 5 => Szl { id, index },
    6 => Diagnostics(count), 7 => Modules, 8 => Blocks, 9 => Block(id), 10 => Events { after }, 11 => NoEvents,
    12 => Document(which), 13 => Stage { id, bytes }, 14 => Link, 15 => Delete(ids),
});
wire!(enum Document { 0 => Program, 1 => Status, 2 => Timing, 3 => Buffers, 4 => Links });
wire!(enum Answer {
    0 => Done, 1 => Clock(clock), 2 => Szl { record, bytes }, 3 => NoSzl(code), 4 => Diagnostics(entries),
    5 => Modules { state, present }, 6 => Blocks(blocks), 7 => Block(block), 8 => Refused(why),
    9 => Document { last, bytes },
});
wire!(enum Refusal {
    0 => Cell(error), 1 => Right, 2 => Password, 3 => NotThere, 4 => Full, 5 => Silent,
    6 => InRun, 7 => Block, 8 => Room,
});
wire!(struct Refused { entry, why });
wire!(struct Diagnosis { number, time, wall, event, block, line, data, text, place, because, remedy });
wire!(struct BlockFact { id, bytes, language, name });
wire!(struct Event { number, time, what });
wire!(enum What {
    0 => Diagnosis(entry), 1 => State(state), 2 => Driver { name, up }, 3 => Link { name, up }, 4 => Lost(count),
});
wire!(struct Welcome {
    version, station, link, family, config, rights, inputs, outputs, memory, timers, counters, min_cycle, generation,
    listeners,
});
wire!(enum ToBroker {
    0 => Beat, 1 => Watch { generation, pieces }, 2 => Write { client, ticket, puts }, 3 => Ask { client, ticket, ask },
    4 => Gone(client), 5 => Connections(list),
});
wire!(struct Connection { partner, name, state, pdu, jobs, errors });
wire!(enum ToLink {
    0 => Welcome(welcome), 1 => Watching(generation), 2 => Unwatched { generation, refused },
    3 => Written { client, ticket, outcome }, 4 => Answer { client, ticket, answer }, 5 => Event(event),
});

impl ToBroker {
    /// As a packet.
    #[must_use]
    pub fn encode(&self) -> Vec<u8> {
        super::wire::encode(self)
    }

    /// From a packet; `None`: it is not a message.
    #[must_use]
    pub fn decode(bytes: &[u8]) -> Option<Self> {
        super::wire::decode(bytes)
    }
}

impl ToLink {
    /// As a packet.
    #[must_use]
    pub fn encode(&self) -> Vec<u8> {
        super::wire::encode(self)
    }

    /// From a packet; `None`: it is not a message.
    #[must_use]
    pub fn decode(bytes: &[u8]) -> Option<Self> {
        super::wire::decode(bytes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn samples() -> (Vec<ToBroker>, Vec<ToLink>) {
        let at = Cell::Db(7, 160);
        let cells = [at, Cell::Area(Area::Output, 3), Cell::Peripheral(8), Cell::Timer(2), Cell::Counter(9)];
        let pieces = cells.into_iter().map(|cell| Piece::Value(cell, Width::DWord)).collect();
        let entry = Diagnosis {
            number: 1,
            time: 2,
            wall: [3; 8],
            event: 0x4302,
            block: Some(BlockId::new(BlockKind::Fb, 7)),
            line: 5,
            data: 6,
            text: "ü".into(),
            place: "a.awl:5".into(),
            because: "kernel".into(),
            remedy: String::new(),
        };
        let welcome = Welcome {
            version: VERSION,
            station: "press".into(),
            link: "panel".into(),
            family: 300,
            config: "{}".into(),
            rights: Right::Operate,
            inputs: 1,
            outputs: 2,
            memory: 3,
            timers: 4,
            counters: 5,
            min_cycle: 6,
            generation: 7,
            listeners: 1,
        };
        let asks = [
            Ask::Login("secret".into()),
            Ask::Command(Command::Hot),
            Ask::SetClock([1; 8]),
            Ask::Szl { id: 0x11, index: 2 },
            Ask::Block(BlockId::new(BlockKind::Db, 65_535)),
            Ask::Events { after: u64::MAX },
            Ask::Document(Document::Timing),
            Ask::Stage { id: BlockId::new(BlockKind::Fc, 5), bytes: [1, 2, 3].into() },
            Ask::Link,
            Ask::Delete(vec![BlockId::new(BlockKind::Ob, 35)]),
        ];
        let mut to = vec![
            ToBroker::Beat,
            ToBroker::Watch { generation: 1, pieces },
            ToBroker::Write {
                client: 1,
                ticket: 2,
                puts: vec![Put::Value(at, Width::Bit, 1), Put::Bytes(at, Box::from([1, 2]))],
            },
            ToBroker::Gone(5),
        ];
        to.extend(asks.into_iter().map(|ask| ToBroker::Ask { client: 1, ticket: 2, ask }));
        let answers = [
            Answer::Done,
            Answer::Szl { record: 4, bytes: Box::from([0; 12]) },
            Answer::Diagnostics(vec![entry.clone(), Diagnosis::default()]),
            Answer::Modules { state: State::Run, present: vec![true, false] },
            Answer::Blocks(vec![BlockFact {
                id: BlockId::new(BlockKind::Ob, 1),
                bytes: 0,
                language: 1,
                name: "main".into(),
            }]),
            Answer::Refused(Refusal::Cell(CellError::NoDb)),
        ];
        let mut from = vec![
            ToLink::Welcome(welcome),
            ToLink::Watching(3),
            ToLink::Unwatched { generation: 3, refused: vec![1, 2] },
            ToLink::Written { client: 1, ticket: 2, outcome: Ok(9) },
            ToLink::Written { client: 1, ticket: 2, outcome: Err(Refused { entry: 3, why: Refusal::Right }) },
            ToLink::Event(Event { number: 1, time: 2, what: What::Diagnosis(entry) }),
            ToLink::Event(Event { number: 1, time: 2, what: What::Driver { name: "cp".into(), up: true } }),
        ];
        from.extend(answers.into_iter().map(|answer| ToLink::Answer { client: 1, ticket: 2, answer }));
        (to, from)
    }

    #[test]
    fn messages_come_back_from_their_bytes() {
        let (to, from) = samples();
        for message in to {
            assert_eq!(ToBroker::decode(&message.encode()), Some(message));
        }
        for message in from {
            assert_eq!(ToLink::decode(&message.encode()), Some(message));
        }
    }

    /// Cut, longer, and with each byte changed: a message or none, never a panic, never much memory.
    #[test]
    fn other_bytes_are_survived() {
        let (to, from) = samples();
        let all = to.iter().map(ToBroker::encode).chain(from.iter().map(ToLink::encode));
        for packet in all {
            for cut in 0..packet.len() {
                let _ = (ToBroker::decode(&packet[..cut]), ToLink::decode(&packet[..cut]));
                for value in [0, 1, 7, 0x7F, 0xFF] {
                    let mut changed = packet.clone();
                    changed[cut] = value;
                    let _ = (ToBroker::decode(&changed), ToLink::decode(&changed));
                }
            }
            let mut longer = packet.clone();
            longer.push(0);
            assert!(ToBroker::decode(&longer).is_none() || ToLink::decode(&longer).is_none());
        }
        assert_eq!(ToBroker::decode(&[1, 0, 0, 0, 0, 0, 0, 0, 0, 0xFF, 0xFF, 0xFF, 0xFF]), None);
    }
}
