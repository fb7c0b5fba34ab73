//! The control socket's own door to the broker. Requests of many clients are under way at a time; none of them waits
//! for another.
//!
//! All requested cells are watched together, as long as somebody asks for them; however many ask, the scan makes only
//! that one copy.

use std::collections::VecDeque;
use std::sync::mpsc::{Receiver, TryRecvError};
use std::time::{self, Duration};

use ob1_access::door::{Answer, Ask, Door, News, NotYet, Reading, Refusal, Refused, Ticket};
use ob1_access::{Piece, Put};
use ob1_cpu::GROUP_ENTRIES;
use ob1_model::Displays;
use ob1_time::{Instant, Span, WatchedTime};
use rustix::event::{PollFd, PollFlags};

use crate::download::LoadStatus;

/// Pause between two readings of the window, while a snapshot is waited for.
const LOOK: Duration = Duration::from_micros(200);
/// Longest pause between two looks while a request is under way; of a longer gap only twice as much counts as silence
/// of the broker.
const PULSE: Duration = Duration::from_millis(100);
/// How often cells are released that are no longer asked for.
const TICK: Duration = Duration::from_secs(1);
/// Longest wait for a program to be compiled and taken over.
const LOAD_TIME: Span = Span::from_secs(55);

/// The client that the socket itself is.
const OWN: u32 = 0;

/// A request under way.
pub(super) struct Pending {
    client: u32,
    /// When it is given up, in watched time.
    give_up: Instant,
    work: Work,
}

enum Work {
    /// The bytes of pieces, all of one cycle control point after `seen`.
    Read {
        wanted: Vec<Piece>,
        values: Vec<Result<Box<[u8]>, Refusal>>,
        part: usize,
        seen: u64,
    },
    /// Groups of puts, one after the other: each lands at one cycle control point, or none of it does.
    Write {
        rest: VecDeque<Put>,
        before: usize,
        group: Option<(Ticket, usize)>,
    },
    Ask(Ticket),
    Load(Receiver<Result<LoadStatus, String>>),
}

/// How a request ended.
pub(super) enum Outcome {
    /// The bytes, or why there are none, piece by piece.
    Read(Vec<Result<Box<[u8]>, Refusal>>),
    /// The error names the entry. A read after this sees what was written.
    Written(Result<(), (usize, Refusal)>),
    Answer(Answer),
    Loaded(LoadStatus),
}

impl Pending {
    /// How long until it must be looked at again, at the latest.
    pub(super) const fn due(&self) -> Duration {
        if matches!(self.work, Work::Read { .. }) { LOOK } else { PULSE }
    }

    pub(super) const fn client(&self) -> u32 {
        self.client
    }
}

pub(super) struct Control {
    door: Door,
    answer_time: Span,
    /// The broker's time to answer is measured with it.
    watched: WatchedTime,
    reading: Reading,
    began: time::Instant,
    ticked: time::Instant,
    /// What has come in this round.
    news: Vec<News>,
    /// Why there is no door any more.
    gone: Option<String>,
}

impl Control {
    pub(super) fn new(door: Door, answer_time: Span) -> Self {
        let (reading, now) = (Reading::new(), time::Instant::now());
        let watched = WatchedTime::new(Instant::START, (2 * PULSE).into());
        Self { door, answer_time, watched, reading, began: now, ticked: now, news: Vec::new(), gone: None }
    }

    /// What becomes ready when the broker says something.
    pub(super) fn fd(&self) -> PollFd<'_> {
        let mut flags = PollFlags::IN;
        flags.set(PollFlags::OUT, self.door.wants_write());
        // A lost door is reported once, by the requests under way.
        PollFd::from_borrowed_fd(self.door.fd(), if self.gone.is_some() { PollFlags::empty() } else { flags })
    }

    /// Whether the broker is there.
    pub(super) const fn is_there(&self) -> bool {
        self.gone.is_none()
    }

    /// Begins a round: takes what has come, and releases cells that were requested long ago.
    pub(super) fn pump(&mut self) {
        self.watched.look(Instant::START + self.began.elapsed().into());
        while self.ticked.elapsed() >= TICK {
            self.ticked += TICK;
            self.door.tick();
        }
        if let Err(error) = self.door.pump() {
            self.gone = Some(error.to_string());
        }
        self.news.clear();
        while let Some(news) = self.door.take_news() {
            match news {
                // Which alarms there are is asked for when somebody wants to see them.
                News::Alarm { client, event } => self.door.handed(client, event.number),
                // News that nobody waits for belong to a request that was given up.
                news => self.news.push(news),
            }
        }
    }

    /// The station itself is a display, for its tools: so the program sends its alarms although nobody else has logged
    /// on.
    pub(super) fn log_on(&mut self) {
        self.door.ask(OWN, Ask::LogOn { displays: Displays(Displays::ALARMS), name: String::new() });
    }

    /// The bytes of these pieces.
    pub(super) fn read(&self, client: u32, wanted: Vec<Piece>) -> Pending {
        // The snapshot that is there already may be old.
        let (part, seen) = (wanted.len(), self.door.newest_scan());
        let values = Vec::with_capacity(part);
        let work = Work::Read { wanted, values, part, seen };
        Pending { client, give_up: self.watched.time().saturating_add(self.answer_time), work }
    }

    /// Writes these values in their order, in as many groups as they need.
    pub(super) fn write(&self, client: u32, puts: Vec<Put>) -> Pending {
        let work = Work::Write { rest: puts.into(), before: 0, group: None };
        Pending { client, give_up: self.broker_gives_up(), work }
    }

    /// Asks the broker on behalf of this client.
    pub(super) fn ask(&mut self, client: u32, ask: Ask) -> Pending {
        let work = Work::Ask(self.door.ask(client, ask));
        Pending { client, give_up: self.broker_gives_up(), work }
    }

    /// The same for an answer that may take so much longer.
    pub(super) fn ask_for(&mut self, client: u32, ask: Ask, longer: Span) -> Pending {
        let pending = self.ask(client, ask);
        Pending { give_up: pending.give_up.saturating_add(longer), ..pending }
    }

    /// Waits for a load.
    pub(super) fn load(&self, client: u32, told: Receiver<Result<LoadStatus, String>>) -> Pending {
        Pending { client, give_up: self.watched.time().saturating_add(LOAD_TIME), work: Work::Load(told) }
    }

    /// The broker gives up first, and says so.
    fn broker_gives_up(&self) -> Instant {
        self.watched.time().saturating_add(self.answer_time.times(2))
    }

    /// Nobody waits for this client's requests any more.
    pub(super) fn client_gone(&mut self, client: u32) {
        self.door.client_gone(client);
    }

    /// Continues a request; `None`: it has not ended. Reads are asked for in the order they came: while one still
    /// waits for its cells to be watched, `may_read` becomes false for those after it, which could take its place at
    /// the broker.
    pub(super) fn advance(&mut self, pending: &mut Pending, may_read: &mut bool) -> Option<Result<Outcome, String>> {
        if let Some(why) = &self.gone {
            return Some(Err(why.clone()));
        }
        let (client, is_late) = (pending.client, self.watched.time() >= pending.give_up);
        let ended = match &mut pending.work {
            Work::Read { wanted, values, part, seen } => self.go_on_reading(wanted, values, part, seen, may_read),
            Work::Write { rest, before, group } => self.go_on_writing(client, rest, before, group),
            Work::Ask(asked) => self.answer(*asked),
            Work::Load(told) => match told.try_recv() {
                Ok(told) => Some(told.map(Outcome::Loaded)),
                Err(TryRecvError::Empty) => None,
                Err(TryRecvError::Disconnected) => Some(Err("the station ends".into())),
            },
        };
        ended.or_else(|| is_late.then(|| Err(Refusal::Silent.to_string())))
    }

    fn go_on_reading(
        &mut self,
        wanted: &[Piece],
        values: &mut Vec<Result<Box<[u8]>, Refusal>>,
        part: &mut usize,
        seen: &mut u64,
        may_read: &mut bool,
    ) -> Option<Result<Outcome, String>> {
        while *may_read {
            let rest = wanted.get(values.len()..).unwrap_or_default();
            if rest.is_empty() {
                return Some(Ok(Outcome::Read(std::mem::take(values))));
            }
            *part = (*part).clamp(1, rest.len());
            match self.door.read(rest.get(..*part).unwrap_or_default(), &mut self.reading) {
                Ok(()) if self.reading.scan > *seen => {
                    values.extend((0..*part).map(|index| self.reading.piece(index).map(Into::into)));
                    *seen = self.reading.scan;
                }
                Ok(()) | Err(NotYet::Busy) => return None,
                Err(NotYet::Coming) => *may_read = false,
                // More than can be watched at a time: one part after the other.
                Err(NotYet::TooMuch) if *part > 1 => *part /= 2,
                Err(NotYet::TooMuch) => return Some(Err("the cell cannot be watched".into())),
            }
        }
        None
    }

    fn go_on_writing(
        &mut self,
        client: u32,
        rest: &mut VecDeque<Put>,
        before: &mut usize,
        group: &mut Option<(Ticket, usize)>,
    ) -> Option<Result<Outcome, String>> {
        if let Some((written, count)) = *group {
            match self.news.iter().find_map(|news| match news {
                News::Written { ticket, outcome, .. } if *ticket == written => Some(*outcome),
                _ => None,
            })? {
                Err(Refused { why: Refusal::Silent, .. }) => return Some(Err(Refusal::Silent.to_string())),
                Err(Refused { entry, why }) => {
                    return Some(Ok(Outcome::Written(Err((*before + entry as usize, why)))));
                }
                Ok(_) => *before += count,
            }
        }
        if rest.is_empty() {
            return Some(Ok(Outcome::Written(Ok(()))));
        }
        let part: Vec<Put> = rest.drain(..rest.len().min(GROUP_ENTRIES)).collect();
        let count = part.len();
        match self.door.write(client, part) {
            Ok(ticket) => *group = Some((ticket, count)),
            Err(error) => return Some(Err(error.to_string())),
        }
        None
    }

    fn answer(&self, asked: Ticket) -> Option<Result<Outcome, String>> {
        let answer = self.news.iter().find_map(|news| match news {
            News::Answer { ticket, answer, .. } if *ticket == asked => Some(answer),
            _ => None,
        })?;
        Some(match answer {
            Answer::Refused(why) => Err(why.to_string()),
            answer => Ok(Outcome::Answer(answer.clone())),
        })
    }
}
