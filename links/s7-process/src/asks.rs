//! Requests of a connection to the CPU, on their way through the broker.
//!
//! Requests of a connection are served in order; consecutive reads are served at the same time. So a read after a write
//! sees it, even if the client has not waited for the write.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use ob1_access::door::{Answer, Ask as Question, Command, Door, News, NotYet, Reading, Refusal, Ticket};
use ob1_model::{BlockId, BlockKind, Cell, DebugOrder, GROUP_ENTRIES, Piece, Put, WRITE_BYTES};
use ob1_s7::MAX_PDU;
use ob1_s7::Rights;
use ob1_s7::codes::{Code, ItemCode};
use ob1_s7::server::{Ask, Control, Loaded, OPERATING_STATE, Reply, Request, STATE_AT};
use ob1_s7::wire::{Address, values_mut};

use crate::answers::answered;
use crate::armed::Armed;
use crate::cells;
use crate::config::Config;

/// Bytes of a data block read together: half of what a link may watch.
const VALUES: usize = 32 * 1024;
// The content of any telegram fits one group of writes.
const _: () = assert!(GROUP_ENTRIES >= MAX_PDU as usize);
const _: () = assert!(WRITE_BYTES >= MAX_PDU as usize);
/// After this long without a snapshot the CPU counts as silent: longer than any cycle a watchdog allows.
const PATIENCE: Duration = Duration::from_secs(6);
/// Time to the next attempt when the scan was faster than every try to read a snapshot.
const SOON: Duration = Duration::from_millis(1);
/// Time limit for a change of the operating state.
const TRANSITION: Duration = Duration::from_secs(3);
/// How often its end is checked.
const LOOK: Duration = Duration::from_millis(20);
const STOP: u8 = 0x03;
const STARTUP: u8 = 0x06;
const RUN: u8 = 0x08;
const HOLD: u8 = 0x0A;

/// The requests of one connection.
#[derive(Debug, Default)]
pub struct Asks {
    waiting: VecDeque<Request>,
    doing: Vec<Doing>,
    /// What waits for its trigger, beside the others.
    armed: Vec<Armed>,
}

/// A request under way, by its kind.
#[derive(Debug)]
enum Doing {
    Read {
        id: u64,
        addresses: Vec<Address>,
        pieces: Vec<Piece>,
        until: Instant,
        again: Instant,
    },
    Write(Write),
    /// One question, one answer; for a password, the rights of the connection afterwards.
    Question {
        id: u64,
        ticket: Ticket,
        rights: Option<Rights>,
    },
    Control(Transition),
    Load(Load),
    /// A data block as loaded.
    Data {
        id: u64,
        ticket: Ticket,
        number: u16,
    },
    Values(Values),
}

/// A data block whose values are read.
#[derive(Debug)]
struct Values {
    id: u64,
    number: u16,
    block: Vec<u8>,
    /// Bytes of values read so far.
    read: usize,
    until: Instant,
    again: Instant,
}

/// Blocks to be loaded into the program: staged one after the other, then linked together.
#[derive(Debug)]
struct Load {
    id: u64,
    ticket: Ticket,
    left: VecDeque<Loaded>,
}

/// Values to write, all in one group; repeated without the refused ones.
#[derive(Debug)]
struct Write {
    id: u64,
    ticket: Ticket,
    /// The remaining writes, each with its item.
    left: Vec<(usize, Put)>,
    codes: Vec<ItemCode>,
}

/// A change of the operating state.
#[derive(Debug)]
struct Transition {
    id: u64,
    control: Control,
    step: Step,
}

#[derive(Debug)]
enum Step {
    /// The present state is requested.
    Before(Ticket),
    /// The command has been given.
    Commanded(Ticket),
    /// The end of the transition is awaited.
    After { ticket: Option<Ticket>, look_at: Instant, until: Instant },
}

/// The common surroundings of all connections.
pub struct Surroundings<'s> {
    /// The way to the CPU.
    pub door: &'s mut Door,
    /// The last reading of the door, used again to save memory.
    pub reading: &'s mut Reading,
    /// The keys of the link.
    pub config: &'s Config,
    /// The time of this step.
    pub now: Instant,
}

/// What a request needs while it is served: whose it is, its surroundings, where the reply goes.
struct Turn<'t, 's> {
    client: u32,
    around: &'t mut Surroundings<'s>,
    reply: &'t mut dyn FnMut(u64, Reply),
}

impl Asks {
    /// Adds a request behind those that wait.
    pub fn push(&mut self, request: Request) {
        self.waiting.push_back(request);
    }

    /// Begins requests that can begin, and retries waiting ones. Replies go to `reply`.
    pub fn step(&mut self, client: u32, around: &mut Surroundings<'_>, reply: &mut dyn FnMut(u64, Reply)) {
        let turn = &mut Turn { client, around, reply };
        let mut still = Vec::with_capacity(self.doing.len());
        for doing in self.doing.drain(..) {
            still.extend(doing.again(turn));
        }
        self.doing = still;
        while let Some(next) = self.waiting.front() {
            let reads = |doing: &Doing| matches!(doing, Doing::Read { .. });
            let may_begin = self.doing.is_empty() || matches!(next.ask, Ask::Read(_)) && self.doing.iter().all(reads);
            if !may_begin {
                break;
            }
            let (client, door) = (turn.client, &mut *turn.around.door);
            match self.waiting.pop_front() {
                Some(Request { id, ask: Ask::At { point, stays, access } }) => {
                    self.armed.push(Armed::at((id, client), point, stays, access, door));
                }
                Some(Request { id, ask: Ask::Pass(order) }) => self.armed.push(Armed::pass((id, client), order, door)),
                Some(Request { id, ask: Ask::Debug(order @ DebugOrder::Hold { .. }) }) => {
                    self.armed.push(Armed::hold((id, client), order, door));
                }
                Some(Request { id, ask: Ask::Forget { request, patience } }) => {
                    match self.armed.iter_mut().find(|armed| armed.id == request) {
                        Some(armed) => armed.forget(id, turn.around.now + Duration::from_millis(patience)),
                        None => (turn.reply)(id, Reply::Done),
                    }
                }
                Some(Request { id, ask }) => self.doing.extend(begin(id, ask, turn)),
                None => {}
            }
        }
        let Surroundings { door, now, .. } = &mut *turn.around;
        self.armed.iter_mut().for_each(|armed| armed.step(client, door, *now));
    }

    /// An answer of the broker to this connection.
    pub fn news(&mut self, client: u32, news: &News, around: &mut Surroundings<'_>, reply: &mut dyn FnMut(u64, Reply)) {
        let came = match news {
            News::Written { ticket, .. } | News::Answer { ticket, .. } => *ticket,
            News::Watching | News::Event(_) | News::Alarm { .. } => return,
        };
        if let (Some(index), News::Answer { answer, .. }) =
            (self.armed.iter().position(|armed| armed.ticket == came), news)
        {
            let armed = self.armed.swap_remove(index);
            reply(armed.id, armed.reply(answer).unwrap_or_else(|| answered(answer, None)));
            armed.forgets.iter().for_each(|id| reply(*id, Reply::Done));
        }
        let Some(index) = self.doing.iter().position(|doing| doing.waits_for(came)) else { return };
        let doing = self.doing.swap_remove(index);
        self.doing.extend(doing.came(news, &mut Turn { client, around, reply }));
    }

    /// When [`Asks::step`] is due at the latest.
    pub fn due(&self) -> Option<Instant> {
        let due = |doing: &Doing| match doing {
            Doing::Read { again, .. } | Doing::Values(Values { again, .. }) => Some(*again),
            Doing::Control(Transition { step: Step::After { ticket: None, look_at, .. }, .. }) => Some(*look_at),
            _ => None,
        };
        self.doing.iter().filter_map(due).chain(self.armed.iter().filter_map(Armed::due)).min()
    }
}

/// Begins a request; returns the rest of the work if it cannot be answered at once.
fn begin(id: u64, ask: Ask, turn: &mut Turn<'_, '_>) -> Option<Doing> {
    let question = match ask {
        Ask::Read(addresses) => {
            let pieces = cells::pieces(&addresses);
            let until = turn.around.now + PATIENCE;
            let read = Doing::Read { id, addresses, pieces, until, again: until };
            return read.again(turn);
        }
        Ask::Write(puts) => {
            let mut write = Write { id, ticket: 0, left: Vec::new(), codes: vec![ItemCode::DONE; puts.len()] };
            for (index, put) in puts.iter().enumerate() {
                match cells::puts(put) {
                    Ok(entries) => write.left.extend(entries.into_iter().map(|entry| (index, entry))),
                    Err(why) => write.codes[index] = why,
                }
            }
            return write.send(turn);
        }
        Ask::Control(Control::Compress | Control::CopyRamToRom) => {
            // The memory has no gaps, and loaded blocks are already retained.
            (turn.reply)(id, Reply::Done);
            return None;
        }
        Ask::Control(control) => {
            let ticket = turn.around.door.ask(turn.client, Question::Szl { id: OPERATING_STATE, index: 0 });
            return Some(Doing::Control(Transition { id, control, step: Step::Before(ticket) }));
        }
        Ask::Load(blocks) => return Load { id, ticket: 0, left: blocks.into() }.send(turn),
        Ask::Delete(blocks) => {
            Question::Delete(blocks.iter().map(|(ty, number)| BlockId::new(cells::kind(*ty), *number)).collect())
        }
        Ask::Szl { id, index } => Question::Szl { id, index },
        Ask::Debug(order) => Question::Debug(order),
        Ask::Forced => Question::Forced,
        Ask::Force(puts) => {
            let cells: Option<Vec<_>> = puts.iter().map(cells::forced).collect();
            match cells {
                Some(cells) => Question::Force(cells.concat()),
                None => {
                    (turn.reply)(id, Reply::Refused(Code::TEST_VARIABLE));
                    return None;
                }
            }
        }
        Ask::Code { block, wanted } => Question::Addresses { block, wanted },
        Ask::Blink => {
            tracing::info!("a programming device wants to see this CPU: its LED would flash");
            (turn.reply)(id, Reply::Done);
            return None;
        }
        // They never come here.
        Ask::At { .. } | Ask::Pass(_) | Ask::Forget { .. } => return None,
        Ask::Blocks => Question::Blocks,
        Ask::Block { ty, number } => match cells::kind(ty) {
            BlockKind::Db => {
                let ticket = turn.around.door.ask(turn.client, Question::Block(BlockId::new(BlockKind::Db, number)));
                return Some(Doing::Data { id, ticket, number });
            }
            kind => Question::Block(BlockId::new(kind, number)),
        },
        Ask::Clock => Question::Clock,
        Ask::SetClock(time) => Question::SetClock(time.date_and_time()),
        Ask::Login(password) => Question::Login(password),
        Ask::Logout => Question::Logout,
        Ask::LogOn { displays, name } => Question::LogOn { displays, name },
        Ask::Alarms(order) => Question::Alarms(order),
    };
    let rights = match question {
        Question::Login(_) => Some(turn.around.config.unlocked),
        Question::Logout => Some(turn.around.config.settings.rights),
        _ => None,
    };
    let ticket = turn.around.door.ask(turn.client, question);
    Some(Doing::Question { id, ticket, rights })
}

impl Doing {
    fn waits_for(&self, came: Ticket) -> bool {
        match self {
            Doing::Read { .. } | Doing::Values(_) => false,
            Doing::Data { ticket, .. } => *ticket == came,
            Doing::Write(write) => write.ticket == came,
            Doing::Load(load) => load.ticket == came,
            Doing::Question { ticket, .. } => *ticket == came,
            Doing::Control(transition) => match transition.step {
                Step::Before(ticket) | Step::Commanded(ticket) => ticket == came,
                Step::After { ticket, .. } => ticket == Some(came),
            },
        }
    }

    /// Retries, without an answer having come.
    fn again(self, turn: &mut Turn<'_, '_>) -> Option<Self> {
        match self {
            Doing::Read { id, addresses, pieces, until, .. } => {
                let refused = match turn.around.door.read(&pieces, turn.around.reading) {
                    Ok(()) => {
                        let reading = &*turn.around.reading;
                        let mut next = 0..reading.len();
                        let mut pieces = || next.next().map_or(Err(Refusal::NotThere), |index| reading.piece(index));
                        (turn.reply)(id, Reply::Values(cells::values(&addresses, &mut pieces)));
                        return None;
                    }
                    Err(why @ (NotYet::Coming | NotYet::Busy)) if turn.around.now < until => {
                        // Coming pieces are announced by news; a snapshot that was too fast is retried soon.
                        let again = if why == NotYet::Busy { turn.around.now + SOON } else { until };
                        return Some(Doing::Read { id, addresses, pieces, until, again });
                    }
                    Err(_) => ItemCode::HARDWARE,
                };
                (turn.reply)(id, Reply::Values(vec![Err(refused); addresses.len()]));
                None
            }
            Doing::Values(values) => values.again(turn),
            Doing::Control(Transition { id, control, step: Step::After { ticket: None, look_at, until } })
                if look_at <= turn.around.now =>
            {
                let ticket = Some(turn.around.door.ask(turn.client, Question::Szl { id: OPERATING_STATE, index: 0 }));
                Some(Doing::Control(Transition { id, control, step: Step::After { ticket, look_at, until } }))
            }
            other => Some(other),
        }
    }

    /// The answer has come.
    fn came(self, news: &News, turn: &mut Turn<'_, '_>) -> Option<Self> {
        match (self, news) {
            (Doing::Write(write), News::Written { outcome, .. }) => {
                let refused = outcome.as_ref().err().map(|refused| (refused.entry as usize, refused.why));
                write.written(refused, turn)
            }
            (Doing::Question { id, rights, .. }, News::Answer { answer, .. }) => {
                (turn.reply)(id, answered(answer, rights));
                None
            }
            (Doing::Data { id, number, .. }, News::Answer { answer: Answer::Block(bytes), .. }) => {
                let until = turn.around.now + PATIENCE;
                let values = Values { id, number, block: bytes.to_vec(), read: 0, until, again: until };
                values.again(turn)
            }
            (Doing::Data { id, .. }, News::Answer { answer, .. }) => {
                (turn.reply)(id, answered(answer, None));
                None
            }
            (Doing::Load(load), News::Answer { answer, .. }) => load.came(answer, turn),
            (Doing::Control(transition), News::Answer { answer, .. }) => transition.came(answer, turn),
            _ => None,
        }
    }
}

impl Values {
    /// Continues reading: a block of usual length is read at one cycle control point.
    fn again(mut self, turn: &mut Turn<'_, '_>) -> Option<Doing> {
        loop {
            let Some(rest) = values_mut(&mut self.block).and_then(|values| values.get_mut(self.read..)) else {
                (turn.reply)(self.id, Reply::Refused(Code::SERVICE));
                return None;
            };
            if rest.is_empty() {
                (turn.reply)(self.id, Reply::Block(self.block));
                return None;
            }
            let len = rest.len().min(VALUES);
            let piece = Piece::Bytes { at: Cell::Db(self.number, self.read as u32 * 8), len: len as u32 };
            match turn.around.door.read(&[piece], turn.around.reading) {
                Ok(()) => {}
                Err(why @ (NotYet::Coming | NotYet::Busy)) if turn.around.now < self.until => {
                    self.again = if why == NotYet::Busy { turn.around.now + SOON } else { self.until };
                    return Some(Doing::Values(self));
                }
                Err(_) => {
                    (turn.reply)(self.id, Reply::Refused(Code::NOT_NOW));
                    return None;
                }
            }
            match (turn.around.reading.piece(0), rest.get_mut(..len)) {
                (Ok(bytes), Some(place)) if bytes.len() == len => place.copy_from_slice(bytes),
                // Not allowed, or the block has been replaced since.
                (refused, _) => {
                    let right = refused == Err(Refusal::Right);
                    (turn.reply)(self.id, Reply::Refused(if right { Code::PROTECTED } else { Code::NO_BLOCK }));
                    return None;
                }
            }
            self.read += len;
        }
    }
}

impl Load {
    /// Sends the next block.
    fn send(mut self, turn: &mut Turn<'_, '_>) -> Option<Doing> {
        let Some(block) = self.left.pop_front() else {
            let ticket = turn.around.door.ask(turn.client, Question::Link);
            return Some(Doing::Question { id: self.id, ticket, rights: None });
        };
        let id = BlockId::new(cells::kind(block.ty), block.number);
        self.ticket = turn.around.door.ask(turn.client, Question::Stage { id, bytes: block.bytes.into() });
        Some(Doing::Load(self))
    }

    fn came(self, answer: &Answer, turn: &mut Turn<'_, '_>) -> Option<Doing> {
        if *answer == Answer::Done {
            return self.send(turn);
        }
        (turn.reply)(self.id, answered(answer, None));
        None
    }
}

impl Write {
    /// Sends the remaining writes, or the reply if nothing is left.
    fn send(mut self, turn: &mut Turn<'_, '_>) -> Option<Doing> {
        let group: Vec<Put> = self.left.iter().map(|(_, put)| put.clone()).collect();
        let sent = if group.is_empty() { None } else { turn.around.door.write(turn.client, group).ok() };
        let Some(ticket) = sent else {
            self.left.iter().for_each(|(item, _)| self.codes[*item] = ItemCode::INCONSISTENT);
            (turn.reply)(self.id, Reply::Written(self.codes));
            return None;
        };
        self.ticket = ticket;
        Some(Doing::Write(self))
    }

    fn written(mut self, refused: Option<(usize, Refusal)>, turn: &mut Turn<'_, '_>) -> Option<Doing> {
        match refused {
            None => self.left.clear(),
            // These concern the whole group. A silent CPU may have written it, so nothing is sent again.
            Some((_, why @ (Refusal::Silent | Refusal::Full))) => {
                for (item, _) in self.left.drain(..) {
                    self.codes[item] = cells::code(why);
                }
            }
            // Nothing of the group was written: the rest is sent without the refused item.
            Some((entry, why)) => {
                let Some(item) = self.left.get(entry).or(self.left.first()).map(|(item, _)| *item) else {
                    (turn.reply)(self.id, Reply::Written(self.codes));
                    return None;
                };
                self.codes[item] = cells::code(why);
                self.left.retain(|(other, _)| *other != item);
            }
        }
        self.send(turn)
    }
}

impl Transition {
    fn came(self, answer: &Answer, turn: &mut Turn<'_, '_>) -> Option<Doing> {
        let Self { id, control, step } = self;
        let state = match answer {
            Answer::Szl { bytes, .. } => bytes.get(STATE_AT).map(|state| state & 0x0F),
            _ => None,
        };
        let runs = state.map(|state| matches!(state, RUN | STARTUP | HOLD));
        let step = match step {
            // Memory reset is for a CPU in STOP.
            Step::Before(_) if control == Control::Reset && state != Some(STOP) => {
                (turn.reply)(id, Reply::Refused(Code::COORDINATION));
                return None;
            }
            Step::Before(_) if control != Control::Reset && runs == Some(control != Control::Stop) => {
                (turn.reply)(id, Reply::Already);
                return None;
            }
            Step::Before(_) => {
                let command = match control {
                    Control::Stop => Command::Stop,
                    Control::Cold => Command::Cold,
                    Control::Reset => Command::Reset,
                    _ => Command::Warm,
                };
                Step::Commanded(turn.around.door.ask(turn.client, Question::Command(command)))
            }
            Step::Commanded(_) if *answer != Answer::Done => {
                (turn.reply)(id, answered(answer, None));
                return None;
            }
            Step::Commanded(_) => {
                Step::After { ticket: None, look_at: turn.around.now, until: turn.around.now + TRANSITION }
            }
            Step::After { until, .. } => {
                let reached = match control {
                    Control::Stop | Control::Reset => runs == Some(false),
                    _ => state == Some(RUN),
                };
                if reached || turn.around.now >= until {
                    (turn.reply)(id, if reached { Reply::Done } else { Reply::Refused(Code::COORDINATION) });
                    return None;
                }
                Step::After { ticket: None, look_at: turn.around.now + LOOK, until }
            }
        };
        Doing::Control(Transition { id, control, step }).again(turn)
    }
}

#[cfg(test)]
mod tests {
    use ob1_access::door::Refused;
    use ob1_s7::iso::Place;
    use ob1_s7::server::{Put, Settings};
    use ob1_s7::wire::{Area, DataType};
    use ob1_socket::handover;

    use super::*;

    /// Writes three items. The reply, if there is one after this outcome; otherwise the number of writes sent again.
    fn after(entry: u32, why: Refusal) -> Result<Reply, usize> {
        let (_broker, socket) = handover::pair().expect("a socket");
        let mut door = Door::new(socket).expect("a door");
        let mut reading = Reading::new();
        let settings = Settings::default();
        let place = Place { rack: 0, slot: 2 };
        let config = Config { place, settings, unlocked: settings.rights, clients: 1, idle: None, tap: false };
        let now = Instant::now();
        let mut around = Surroundings { door: &mut door, reading: &mut reading, config: &config, now };
        let put = |byte: u32| Put {
            address: Address { area: Area::Memory, db: 0, start: 8 * byte, ty: DataType::Byte, count: 1 },
            bytes: vec![7],
        };
        let mut replies = Vec::new();
        let mut asks = Asks::default();
        asks.push(Request { id: 5, ask: Ask::Write(vec![put(1), put(2), put(3)]) });
        asks.step(1, &mut around, &mut |_, reply| replies.push(reply));
        let Some(Doing::Write(Write { ticket, .. })) = asks.doing.first() else { panic!("nothing was sent") };
        let news = News::Written { client: 1, ticket: *ticket, outcome: Err(Refused { entry, why }) };
        asks.news(1, &news, &mut around, &mut |_, reply| replies.push(reply));
        match asks.doing.first() {
            Some(Doing::Write(write)) => Err(write.left.len()),
            _ => Ok(replies.remove(0)),
        }
    }

    #[test]
    fn nothing_is_written_twice_to_a_cpu_that_is_silent() {
        assert_eq!(after(1, Refusal::Right), Err(2), "nothing was written: the rest is sent again");
        let all = |code| -> Result<Reply, usize> { Ok(Reply::Written(vec![code; 3])) };
        assert_eq!(after(0, Refusal::Silent), all(ItemCode::HARDWARE));
        assert_eq!(after(0, Refusal::Full), all(ItemCode::HARDWARE));
    }
}
