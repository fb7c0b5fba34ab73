//! The door of a link: its connection to the broker of a running station.
//!
//! Reads come from shared memory that the scan fills ([`Door::read`]); writes, questions and answers go through a
//! socket. Nothing here waits, reads a clock or starts a thread: the process waits for [`Door::fd`], calls
//! [`Door::pump`], and fetches the results with [`Door::take_news`].
//!
//! ```no_run
//! use std::os::fd::AsFd as _;
//! use ob1_access::door::{Door, News, NotYet, Reading};
//! use ob1_access::{Cell, Piece};
//!
//! let mut door = Door::new(std::io::stdin().as_fd().try_clone_to_owned()?)?;
//! let (wanted, mut reading) = ([Piece::Bytes { at: Cell::Db(10, 0), len: 20 }], Reading::new());
//! loop {
//!     // poll(door.fd(), ...)
//!     door.pump()?;
//!     while let Some(news) = door.take_news() {
//!         if news == News::Watching { /* the requested pieces are there: repeat the reads that wait */ }
//!     }
//!     match door.read(&wanted, &mut reading) {
//!         Ok(()) => println!("scan {}: {:?}", reading.scan, reading.piece(0)),
//!         Err(NotYet::Coming | NotYet::Busy) => {}
//!         Err(NotYet::TooMuch) => panic!("read it in parts"),
//!     }
//! }
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod messages;
mod packets;
mod ranges;
mod reading;
mod wire;

use std::collections::{BTreeMap, VecDeque};
use std::io;
use std::os::fd::{AsFd as _, BorrowedFd, OwnedFd};
use std::sync::atomic::Ordering;

use ob1_backplane::{SegmentError, WindowReader};
use ob1_model::{AlarmNow, GROUP_ENTRIES, Piece, Put, WRITE_BYTES};
use ob1_socket::handover;
use thiserror::Error;

pub use messages::{
    ALARM_CHANGES, ALARM_PART, ARMED, Addresses, Answer, Ask, BlockFact, Connection, Diagnosis, Document, Event,
    MESSAGE_BYTES, News, OUTSTANDING, PART_BYTES, Refusal, Refused, STAGED_BYTES, Ticket, ToBroker, ToLink, VERSION,
    Welcome, What,
};
pub use ob1_model::{Command, OperatingState as State};
use ranges::Ranges;
pub use ranges::{Cover, Found};
pub use reading::Reading;

/// Messages that may wait for room in the socket; a process that queues more without pumping loses the door.
const OUTBOX: usize = 4096;

/// Why a link has lost its door.
#[derive(Debug, Error)]
pub enum DoorError {
    /// The station ends, or has dropped this link.
    #[error("the station has closed the door")]
    Closed,
    /// An error of the system.
    #[error("the socket of the broker: {0}")]
    Io(#[from] io::Error),
    /// The window cannot be mapped.
    #[error("the window: {0}")]
    Window(#[from] SegmentError),
    /// A received packet is not a message of this version.
    #[error("the broker speaks another version: link and runtime must come from one build")]
    Version,
    /// Too many messages were queued without [`Door::pump`].
    #[error("too many messages wait for the broker")]
    Full,
}

/// Why nothing was read. Nothing is lost: the same read can succeed later.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum NotYet {
    /// Not all of it was watched yet; it has now been requested and is available one cycle later, when
    /// [`News::Watching`] comes.
    #[error("not watched yet")]
    Coming,
    /// More than a link may watch: read it in parts.
    #[error("more than can be read at once")]
    TooMuch,
    /// The scan was faster in every try.
    #[error("busy")]
    Busy,
}

/// A group is too large.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[error("at most {GROUP_ENTRIES} entries and {WRITE_BYTES} bytes can be written at once")]
pub struct GroupTooLarge;

/// The door of one link; see [the module](self).
#[derive(Debug)]
pub struct Door {
    socket: OwnedFd,
    window: Option<WindowReader>,
    welcome: Option<Welcome>,
    listeners: Vec<OwnedFd>,
    ranges: Ranges,
    /// Messages, and a descriptor that goes with one.
    outbox: VecDeque<(Vec<u8>, Option<OwnedFd>)>,
    news: VecDeque<News>,
    tickets: Ticket,
    buffer: Vec<u8>,
    /// Documents whose last part has not come yet.
    documents: BTreeMap<Ticket, Vec<u8>>,
    /// Alarms whose last part has not come yet.
    alarms: BTreeMap<Ticket, Vec<AlarmNow>>,
}

/// The outcome of one attempt to read.
enum Try {
    Whole,
    Missing,
}

/// A station that ends with something of ours unread resets the connection instead of closing it.
fn ended(error: io::Error) -> DoorError {
    match error.kind() {
        io::ErrorKind::BrokenPipe | io::ErrorKind::ConnectionReset => DoorError::Closed,
        _ => error.into(),
    }
}

impl Door {
    /// A door over the socket that the supervisor has handed over, which is the standard input of a link.
    ///
    /// # Errors
    /// [`DoorError::Io`]: the socket cannot be used without waiting.
    pub fn new(socket: OwnedFd) -> Result<Self, DoorError> {
        Ok(Self {
            socket,
            window: None,
            welcome: None,
            listeners: Vec::new(),
            ranges: Ranges::default(),
            outbox: VecDeque::new(),
            news: VecDeque::new(),
            tickets: 0,
            buffer: vec![0; MESSAGE_BYTES],
            documents: BTreeMap::new(),
            alarms: BTreeMap::new(),
        })
    }

    /// All doors of a process that serves several links: they come over its standard input, one per message.
    ///
    /// # Errors
    /// The system's error, or a packet that is not a message of this version.
    pub fn several(socket: &OwnedFd) -> Result<Option<Vec<Self>>, DoorError> {
        let mut doors = Vec::new();
        loop {
            let mut more = [0];
            let Some((len, descriptors)) = handover::receive(socket, &mut more)? else {
                return if doors.is_empty() { Ok(None) } else { Err(DoorError::Version) };
            };
            if len == 0 {
                return Err(DoorError::Closed);
            }
            let door = descriptors.into_iter().next().ok_or(DoorError::Version)?;
            doors.push(Self::new(door)?);
            if more == [0] {
                return Ok(Some(doors));
            }
        }
    }

    /// The other end of [`Door::several`]: hands over all doors at once.
    ///
    /// # Errors
    /// The system cannot send over the socket: its other end is gone or does not read.
    pub fn hand_over(socket: &OwnedFd, doors: &[OwnedFd]) -> io::Result<()> {
        let more = (0..doors.len()).rev();
        doors
            .iter()
            .zip(more)
            .try_for_each(|(door, more)| handover::send(socket, &[u8::from(more > 0)], &[door.as_fd()]))
    }

    /// The descriptor to wait for: readable, and with [`Door::wants_write`] also writable.
    #[must_use]
    pub fn fd(&self) -> BorrowedFd<'_> {
        self.socket.as_fd()
    }

    /// Whether something waits to be sent.
    #[must_use]
    pub fn wants_write(&self) -> bool {
        !self.outbox.is_empty()
    }

    /// Sends waiting messages and receives all that have come.
    ///
    /// # Errors
    /// [`DoorError`]: the door is closed, the system fails, or the broker is of another version. The door is of no use
    /// then.
    pub fn pump(&mut self) -> Result<(), DoorError> {
        self.send()?;
        while let Some((len, descriptors)) = handover::receive(&self.socket, &mut self.buffer).map_err(ended)? {
            if len == 0 {
                return Err(DoorError::Closed);
            }
            let message = self.buffer.get(..len).and_then(ToLink::decode).ok_or(DoorError::Version)?;
            self.take(message, descriptors)?;
        }
        self.send()
    }

    fn take(&mut self, message: ToLink, descriptors: Vec<OwnedFd>) -> Result<(), DoorError> {
        match message {
            ToLink::Welcome(welcome) => {
                let mut descriptors = descriptors.into_iter();
                let window = descriptors.next().filter(|_| welcome.version == VERSION).ok_or(DoorError::Version)?;
                self.window = Some(WindowReader::received(window)?);
                self.listeners = descriptors.collect();
                self.ranges = Ranges::new(welcome.generation);
                self.welcome = Some(welcome);
            }
            ToLink::Watching(generation) => {
                self.ranges.watching(generation);
                self.news.push_back(News::Watching);
            }
            ToLink::Unwatched { generation, refused } => {
                self.ranges.unwatched(generation, &refused);
                // A reader that waits for one of them finds out by reading again.
                self.news.push_back(News::Watching);
            }
            ToLink::News(News::Answer { client, ticket, answer: Answer::Document { last, bytes } }) => {
                self.part(client, ticket, last, &bytes);
            }
            ToLink::News(News::Answer { client, ticket, answer: Answer::Alarms { last, after, list } }) => {
                let mut whole = self.alarms.remove(&ticket).unwrap_or_default();
                whole.extend(list);
                if last {
                    let answer = Answer::Alarms { last, after, list: whole };
                    self.news.push_back(News::Answer { client, ticket, answer });
                } else {
                    self.alarms.insert(ticket, whole);
                }
            }
            ToLink::News(news) => self.news.push_back(news),
        }
        self.watch();
        Ok(())
    }

    fn part(&mut self, client: u32, ticket: Ticket, last: bool, bytes: &[u8]) {
        let mut whole = self.documents.remove(&ticket).unwrap_or_default();
        whole.extend_from_slice(bytes);
        if last {
            let answer = Answer::Document { last, bytes: whole.into() };
            self.news.push_back(News::Answer { client, ticket, answer });
        } else {
            self.documents.insert(ticket, whole);
        }
    }

    fn watch(&mut self) {
        if let Some((generation, pieces)) = self.ranges.next() {
            self.say(&ToBroker::Watch { generation, pieces });
        }
    }

    fn say(&mut self, message: &ToBroker) {
        self.outbox.push_back((message.encode(), None));
    }

    fn send(&mut self) -> Result<(), DoorError> {
        while let Some((message, descriptor)) = self.outbox.front() {
            let descriptors: Vec<_> = descriptor.iter().map(OwnedFd::as_fd).collect();
            match handover::send(&self.socket, message, &descriptors) {
                Ok(()) => drop(self.outbox.pop_front()),
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => break,
                Err(error) => return Err(ended(error)),
            }
        }
        if self.outbox.len() > OUTBOX { Err(DoorError::Full) } else { Ok(()) }
    }

    /// The broker's first message; `None` until it has come.
    #[must_use]
    pub fn welcome(&self) -> Option<&Welcome> {
        self.welcome.as_ref()
    }

    /// The listening sockets of this link, in the order of its key `listen`: bound, listening, non-blocking. Once.
    #[must_use]
    pub fn take_listeners(&mut self) -> Vec<OwnedFd> {
        std::mem::take(&mut self.listeners)
    }

    /// A sign of life. Call it at least four times a second: a link without one for a second is killed and restarted.
    pub fn beat(&mut self) {
        // While the broker reads nothing, more of them are useless.
        if self.outbox.is_empty() {
            self.say(&ToBroker::Beat);
        }
    }

    /// Call it about once a second: pieces not read for half a minute are no longer watched.
    pub fn tick(&mut self) {
        self.ranges.tick();
        self.watch();
    }

    /// The number of the newest snapshot; 0 if there is none yet.
    #[must_use]
    pub fn newest_scan(&self) -> u64 {
        self.window.as_ref().and_then(WindowReader::newest).map_or(0, |head| head.scan)
    }

    /// Reads these pieces, all of the newest snapshot, without a system call. A piece read for the first time is
    /// requested: then call [`Door::pump`], wait for [`News::Watching`], and read again. A piece that the CPU does not
    /// have, or that this link may not read, is refused without affecting the others.
    ///
    /// # Errors
    /// [`NotYet`]: it was requested now and comes a cycle later, is more than a link may watch, or the scan was too
    /// fast.
    pub fn read(&mut self, pieces: &[Piece], into: &mut Reading) -> Result<(), NotYet> {
        if pieces.iter().all(|piece| self.ranges.is_refused(piece)) {
            into.clear(self.newest_scan(), 0, State::Stop);
            pieces.iter().for_each(|piece| into.push(piece, |_| Err(Refusal::Right)));
            return Ok(());
        }
        let Some(window) = &self.window else { return Err(NotYet::Coming) };
        let ranges = &self.ranges;
        let tried = window.read(|head, words| {
            let Some(layout) = ranges.layout(head.generation) else { return Try::Missing };
            into.clear(head.scan, head.time, State::of(head.state));
            let word = |at: usize| words.get(at).map_or(0, |word| word.load(Ordering::Relaxed));
            for piece in pieces {
                if ranges.is_refused(piece) {
                    into.push(piece, |_| Err(Refusal::Right));
                    continue;
                }
                let Some((index, skip)) = layout.find(piece) else { return Try::Missing };
                into.push(piece, |bytes| {
                    layout.frame().read(index, skip, piece.len(), word, bytes).map_err(Refusal::Cell)
                });
            }
            Try::Whole
        });
        match tried {
            Some(Try::Whole) => {
                self.ranges.used(pieces);
                return Ok(());
            }
            None if window.newest().is_some() => return Err(NotYet::Busy),
            Some(Try::Missing) | None => {}
        }
        if !self.ranges.want(pieces) {
            return Err(NotYet::TooMuch);
        }
        self.watch();
        Err(NotYet::Coming)
    }

    fn ticket(&mut self) -> Ticket {
        self.tickets += 1;
        self.tickets
    }

    /// Writes a group for a client (a number of the link's own; 0: for itself): all of it is written at one cycle
    /// control point, or nothing. [`News::Written`] reports the outcome.
    ///
    /// # Errors
    /// More than [`GROUP_ENTRIES`] entries or [`WRITE_BYTES`] bytes.
    pub fn write(&mut self, client: u32, puts: Vec<Put>) -> Result<Ticket, GroupTooLarge> {
        if puts.len() > GROUP_ENTRIES || puts.iter().map(Put::bytes).sum::<usize>() > WRITE_BYTES {
            return Err(GroupTooLarge);
        }
        let ticket = self.ticket();
        self.say(&ToBroker::Write { client, ticket, puts });
        Ok(ticket)
    }

    /// Asks a question for a client. [`News::Answer`] brings the answer.
    pub fn ask(&mut self, client: u32, ask: Ask) -> Ticket {
        let ticket = self.ticket();
        self.say(&ToBroker::Ask { client, ticket, ask });
        ticket
    }

    /// Who a client is: address and port.
    pub fn partner(&mut self, client: u32, partner: String) {
        self.say(&ToBroker::Partner { client, partner });
    }

    /// Sends what waits, without receiving; [`Door::pump`] does both.
    ///
    /// # Errors
    /// As [`Door::pump`].
    pub fn flush(&mut self) -> Result<(), DoorError> {
        self.send()
    }

    /// Changes of alarms that are about to be written for a client, each by its number and the bytes of the connection
    /// that are written when it is; [`Door::flush`] before they are. The first time with the client's socket: if the
    /// process is killed, the broker repeats what the kernel of the partner has not confirmed, and nothing else.
    pub fn sending(&mut self, client: u32, ends: Vec<(u64, u64)>, socket: Option<OwnedFd>) {
        self.outbox.push_back((ToBroker::Sending { client, ends }.encode(), socket));
    }

    /// Changes of alarms up to this one have left the link for a client: the broker sends it further ones.
    pub fn handed(&mut self, client: u32, number: u64) {
        self.say(&ToBroker::Handed { client, number });
    }

    /// A client is gone: its rights and its open requests are dropped.
    pub fn client_gone(&mut self, client: u32) {
        self.say(&ToBroker::Gone(client));
    }

    /// Reports the present connections, for tools that show the station.
    pub fn connections(&mut self, list: Vec<Connection>) {
        self.say(&ToBroker::Connections(list));
    }

    /// The next news, in the order they came.
    pub fn take_news(&mut self) -> Option<News> {
        self.news.pop_front()
    }
}

#[cfg(test)]
mod tests;
