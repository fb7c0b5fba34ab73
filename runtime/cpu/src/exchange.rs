//! The exchange: what links read and write in the CPU, at the cycle control point.
//!
//! In this order: the outputs are out, then writes, then the snapshot, then the inputs come in; in STOP too. A link
//! says which pieces of memory it watches; they are copied once, together, into a buffer it has brought. Its writes
//! come in groups that land whole; a group's answer leaves after the snapshot that contains it. Everything goes through
//! two rings of a link; what it brings goes back to it: the scan allocates and frees nothing, and waits for nobody.

use ob1_model::{Cell, CellError, CellWidth, Piece};
use rtrb::{Consumer, Producer, RingBuffer};

use crate::cells;
use crate::machine::Machine;
use crate::{Nanos, OperatingState};

/// Most entries of a group of writes.
pub const GROUP_ENTRIES: usize = 64;
/// Bytes of a group, and bytes of writes that one cycle control point takes from all links together.
pub const WRITE_BYTES: usize = 4096;
/// Bytes a link may watch.
pub const WATCH_BYTES: usize = 64 * 1024;
/// Cache lines a link may watch: scattered cells cost more than their bytes.
pub const WATCH_LINES: usize = 4096;
/// Links that can be had.
pub const LINKS: usize = 8;

const LINE: u32 = 64;
/// Snapshots under way: one that is filled, one that waits, one that is read.
const BUFFERS: usize = 3;
/// Orders and groups under way, of a link.
const RING: usize = 32;
/// Groups of a link that one cycle control point takes.
const GROUPS: usize = 8;

/// One thing to write.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Put {
    /// A value into a cell; a bit changes no other bit of its byte.
    Value(Cell, CellWidth, u32),
    /// Bytes, from the byte of a cell in an area or a data block on.
    Bytes(Cell, Box<[u8]>),
}

impl Put {
    fn bytes(&self) -> usize {
        match self {
            Put::Value(_, width, _) => usize::from(width.bytes()),
            Put::Bytes(_, bytes) => bytes.len(),
        }
    }
}

/// Writes that land together, or not at all.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Group {
    id: u64,
    puts: Box<[Put]>,
    bytes: usize,
    /// Which could not be written, and why; then none was.
    refused: Option<(usize, CellError)>,
}

/// Why there is no such group or watch.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TooMuch {
    /// More than [`GROUP_ENTRIES`] or [`WRITE_BYTES`].
    Group,
    /// More than [`WATCH_BYTES`] or [`WATCH_LINES`].
    Watch,
    /// So many are under way already.
    UnderWay,
}

impl Group {
    /// Of these writes, with the link's own number.
    ///
    /// # Errors
    /// [`TooMuch::Group`].
    pub fn new(id: u64, puts: Vec<Put>) -> Result<Self, TooMuch> {
        let bytes = puts.iter().map(Put::bytes).sum();
        if puts.len() > GROUP_ENTRIES || bytes > WRITE_BYTES {
            return Err(TooMuch::Group);
        }
        Ok(Self { id, puts: puts.into(), bytes, refused: None })
    }

    /// The number it was given.
    #[must_use]
    pub const fn id(&self) -> u64 {
        self.id
    }

    /// What became of it: `Err` names the entry that could not be written; then none was.
    ///
    /// # Errors
    /// The first entry that was refused, and why.
    pub const fn outcome(&self) -> Result<(), (usize, CellError)> {
        match self.refused {
            None => Ok(()),
            Some(refused) => Err(refused),
        }
    }

    /// All or nothing.
    fn land(&mut self, m: &mut Machine) {
        let check = |put: &Put| match put {
            Put::Value(cell, width, value) => cells::check(m, *cell, *width, *value),
            Put::Bytes(cell, bytes) => cells::place(m, *cell, bytes.len() as u32, true).map(|_| ()),
        };
        self.refused = self.puts.iter().enumerate().find_map(|(index, put)| Some((index, check(put).err()?)));
        if self.refused.is_some() {
            return;
        }
        for (index, put) in self.puts.iter().enumerate() {
            let written = match put {
                Put::Value(cell, width, value) => cells::write(m, *cell, *width, *value),
                Put::Bytes(cell, bytes) => cells::place(m, *cell, bytes.len() as u32, true).map(|place| {
                    if let Some(to) = m.memory.bytes.get_mut(place) {
                        to.copy_from_slice(bytes);
                    }
                }),
            };
            // Only a module can still say no: what is behind it is not ours to look at before.
            if let Err(error) = written
                && self.refused.is_none()
            {
                self.refused = Some((index, error));
            }
        }
    }
}

/// What a link watches, with room for it.
#[derive(Debug)]
struct Watch {
    generation: u64,
    pieces: Box<[Piece]>,
    /// Filled by nobody at the moment.
    free: [Option<Box<Snapshot>>; BUFFERS],
}

/// What a piece of a snapshot holds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Filled {
    /// So many of its bytes exist.
    pub len: u32,
    /// Why not all of them.
    pub error: Option<CellError>,
}

/// The watched pieces, one behind the other, as they were at one cycle control point.
#[derive(Debug)]
pub struct Snapshot {
    generation: u64,
    scan: u64,
    time: Nanos,
    state: OperatingState,
    bytes: Box<[u8]>,
    filled: Box<[Filled]>,
}

impl Snapshot {
    /// The number [`Link::watch`] has given for what is in it.
    #[must_use]
    pub const fn generation(&self) -> u64 {
        self.generation
    }

    /// Counts the cycle control points, those in STOP included.
    #[must_use]
    pub const fn scan(&self) -> u64 {
        self.scan
    }

    /// When.
    #[must_use]
    pub const fn time(&self) -> Nanos {
        self.time
    }

    /// The operating state then.
    #[must_use]
    pub const fn state(&self) -> OperatingState {
        self.state
    }

    /// The bytes of all pieces, one behind the other.
    #[must_use]
    pub const fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// What each piece holds.
    #[must_use]
    pub const fn filled(&self) -> &[Filled] {
        &self.filled
    }

    fn fill(&mut self, m: &mut Machine, pieces: &[Piece]) {
        let mut rest = &mut *self.bytes;
        for (piece, filled) in pieces.iter().zip(&mut self.filled) {
            let (into, behind) = rest.split_at_mut((piece.len() as usize).min(rest.len()));
            rest = behind;
            *filled = copy(m, piece, into);
            if let Some(missing) = into.get_mut(filled.len as usize..) {
                missing.fill(0);
            }
        }
    }
}

/// One piece; a data block is found by its number, because it may have been made or deleted since.
fn copy(m: &mut Machine, piece: &Piece, into: &mut [u8]) -> Filled {
    match *piece {
        Piece::Bytes { at, .. } => match cells::upto(m, at, into.len() as u32) {
            Ok(place) => {
                let there = m.memory.bytes.get(place).unwrap_or_default();
                let len = there.len().min(into.len());
                into[..len].copy_from_slice(&there[..len]);
                let error = (len < into.len()).then_some(CellError::Outside);
                Filled { len: len as u32, error }
            }
            Err(error) => Filled { len: 0, error: Some(error) },
        },
        Piece::Value(cell, width) => match cells::read(m, cell, width) {
            Ok(value) => {
                let bytes = value.to_be_bytes();
                let len = into.len().min(bytes.len());
                into[..len].copy_from_slice(&bytes[bytes.len() - len..]);
                Filled { len: len as u32, error: None }
            }
            Err(error) => Filled { len: 0, error: Some(error) },
        },
    }
}

/// To the CPU.
enum Order {
    Watch(Box<Watch>),
    /// A buffer that has been read.
    Read(Box<Snapshot>),
    Group(Box<Group>),
}

/// From the CPU.
enum Back {
    Snapshot(Box<Snapshot>),
    Group(Box<Group>),
    /// A watch that is no more, and a buffer of such a one: to be freed.
    OldWatch(#[expect(dead_code, reason = "it comes back to be freed")] Box<Watch>),
    OldSnapshot(#[expect(dead_code, reason = "it comes back to be freed")] Box<Snapshot>),
}

/// A link's end. It belongs to one thread.
#[derive(Debug)]
pub struct Link {
    orders: Producer<Order>,
    back: Consumer<Back>,
    newest: Option<Box<Snapshot>>,
    answers: std::collections::VecDeque<Box<Group>>,
    generation: u64,
}

impl std::fmt::Debug for Order {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Order")
    }
}

impl std::fmt::Debug for Back {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Back")
    }
}

impl Link {
    /// Watches these pieces from the next cycle control point on, instead of those before. The number its snapshots
    /// have.
    ///
    /// # Errors
    /// [`TooMuch`].
    pub fn watch(&mut self, pieces: &[Piece]) -> Result<u64, TooMuch> {
        let bytes: usize = pieces.iter().map(|piece| piece.len() as usize).sum();
        let lines: usize = pieces.iter().map(|piece| (piece.len().div_ceil(LINE) + 1) as usize).sum();
        if bytes > WATCH_BYTES || lines > WATCH_LINES {
            return Err(TooMuch::Watch);
        }
        let generation = self.generation + 1;
        let buffer = || {
            Some(Box::new(Snapshot {
                generation,
                scan: 0,
                time: 0,
                state: OperatingState::Stop,
                bytes: vec![0; bytes].into(),
                filled: vec![Filled::default(); pieces.len()].into(),
            }))
        };
        let watch = Watch { generation, pieces: pieces.into(), free: [buffer(), buffer(), buffer()] };
        self.orders.push(Order::Watch(Box::new(watch))).map_err(|_| TooMuch::UnderWay)?;
        self.generation = generation;
        Ok(generation)
    }

    /// Hands a group over; its answer comes with [`Link::answer`].
    ///
    /// # Errors
    /// Too much is under way: the group.
    pub fn write(&mut self, group: Group) -> Result<(), Group> {
        match self.orders.push(Order::Group(Box::new(group))) {
            Err(rtrb::PushError::Full(Order::Group(group))) => Err(*group),
            // Nothing else was pushed.
            _ => Ok(()),
        }
    }

    /// Takes what the CPU has sent. A snapshot that is not the newest goes back at once.
    pub fn take(&mut self) {
        while let Ok(back) = self.back.pop() {
            match back {
                Back::Snapshot(snapshot) => {
                    if let Some(read) = self.newest.replace(snapshot) {
                        self.give_back(read);
                    }
                }
                Back::Group(group) => self.answers.push_back(group),
                Back::OldWatch(_) | Back::OldSnapshot(_) => {}
            }
        }
    }

    fn give_back(&mut self, read: Box<Snapshot>) {
        if read.generation == self.generation {
            // A ring without room: this link has one buffer less until it watches anew.
            let _ = self.orders.push(Order::Read(read));
        }
    }

    /// The newest snapshot that [`Link::take`] has found.
    #[must_use]
    pub fn newest(&self) -> Option<&Snapshot> {
        self.newest.as_deref()
    }

    /// The next answer to a group. The newest snapshot contains it.
    pub fn answer(&mut self) -> Option<Group> {
        self.answers.pop_front().map(|group| *group)
    }

    /// True when the CPU is gone.
    #[must_use]
    pub fn is_closed(&self) -> bool {
        self.orders.is_abandoned()
    }
}

/// The CPU's end of a link.
#[derive(Debug)]
struct End {
    orders: Consumer<Order>,
    back: Producer<Back>,
    watch: Option<Box<Watch>>,
    /// Groups that have landed and whose answers wait for the snapshot.
    landed: [Option<Box<Group>>; GROUPS],
}

/// The CPU's end of all links.
#[derive(Debug)]
pub(crate) struct Exchange {
    ends: Vec<End>,
    links: Vec<Link>,
    /// Cycle control points so far.
    scan: u64,
    /// Whose group comes first this time.
    first: usize,
}

impl Exchange {
    /// With [`LINKS`] links that can be handed out.
    pub(crate) fn new() -> Self {
        let (mut ends, mut links) = (Vec::with_capacity(LINKS), Vec::with_capacity(LINKS));
        for _ in 0..LINKS {
            let (to_cpu, orders) = RingBuffer::new(RING);
            // For all groups, all snapshots and a watch that goes.
            let (back, from_cpu) = RingBuffer::new(2 * RING);
            ends.push(End { orders, back, watch: None, landed: [const { None }; GROUPS] });
            let answers = std::collections::VecDeque::new();
            links.push(Link { orders: to_cpu, back: from_cpu, newest: None, answers, generation: 0 });
        }
        Self { ends, links, scan: 0, first: 0 }
    }

    /// A link that nobody has yet.
    pub(crate) fn link(&mut self) -> Option<Link> {
        self.links.pop()
    }

    /// The cycle control point: writes, then the snapshots, then the answers.
    pub(crate) fn serve(&mut self, m: &mut Machine, state: OperatingState) {
        self.scan += 1;
        self.writes(m);
        for end in &mut self.ends {
            if end.snapshot(m, self.scan, state) {
                end.answers();
            }
        }
    }

    /// One group of each link in turn, until there is none or the bytes of this scan are used up.
    fn writes(&mut self, m: &mut Machine) {
        let mut left = WRITE_BYTES;
        self.first = (self.first + 1) % LINKS;
        for _ in 0..GROUPS {
            let mut any = false;
            for turn in 0..LINKS {
                let end = &mut self.ends[(self.first + turn) % LINKS];
                any |= end.one_group(m, &mut left);
            }
            if !any {
                return;
            }
        }
    }
}

impl End {
    /// Takes orders up to the next group, and lands that; false when there is none for this scan.
    fn one_group(&mut self, m: &mut Machine, left: &mut usize) -> bool {
        let Some(place) = self.landed.iter().position(Option::is_none) else { return false };
        loop {
            // What is taken must find room on its way back.
            if self.back.slots() < GROUPS + BUFFERS + 1 {
                return false;
            }
            if let Ok(Order::Group(group)) = self.orders.peek()
                && group.bytes > *left
            {
                return false;
            }
            match self.orders.pop() {
                Ok(Order::Group(mut group)) => {
                    *left -= group.bytes;
                    group.land(m);
                    self.landed[place] = Some(group);
                    return true;
                }
                Ok(Order::Watch(watch)) => {
                    if let Some(old) = self.watch.replace(watch) {
                        let _ = self.back.push(Back::OldWatch(old));
                    }
                }
                Ok(Order::Read(snapshot)) => self.keep(snapshot),
                Err(_) => return false,
            }
        }
    }

    /// A buffer is free again, or belongs to a watch that is no more and goes back to be freed.
    fn keep(&mut self, snapshot: Box<Snapshot>) {
        let watch = self.watch.as_mut().filter(|watch| watch.generation == snapshot.generation);
        match watch.and_then(|watch| watch.free.iter_mut().find(|place| place.is_none())) {
            Some(place) => *place = Some(snapshot),
            None => {
                let _ = self.back.push(Back::OldSnapshot(snapshot));
            }
        }
    }

    /// Fills a snapshot; false when the link has no buffer free and its answers have to wait.
    fn snapshot(&mut self, m: &mut Machine, scan: u64, state: OperatingState) -> bool {
        let Some(watch) = &mut self.watch else { return true };
        if watch.pieces.is_empty() {
            return true;
        }
        if self.back.slots() < GROUPS + 1 {
            return false;
        }
        let Some(mut snapshot) = watch.free.iter_mut().find_map(Option::take) else { return false };
        (snapshot.scan, snapshot.time, snapshot.state) = (scan, m.hot.now, state);
        snapshot.fill(m, &watch.pieces);
        let _ = self.back.push(Back::Snapshot(snapshot));
        true
    }

    fn answers(&mut self) {
        for place in &mut self.landed {
            if let Some(group) = place.take() {
                let _ = self.back.push(Back::Group(group));
            }
        }
    }
}
