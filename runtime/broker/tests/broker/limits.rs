//! Links and clients that want too much: each gets its share, and nobody else waits for it.

use std::os::fd::OwnedFd;
use std::sync::atomic::Ordering;

use ob1_access::door::{
    Answer, Ask, Connection, Document, Door, Event, MESSAGE_BYTES, News, OUTSTANDING, Refusal, Refused, Ticket,
    ToBroker, ToLink, What,
};
use ob1_access::{Cell, Piece, Put, Right, Width};
use ob1_broker::LinkConfig;
use ob1_model::{BlockId, BlockKind, Command};
use ob1_socket::handover;

use crate::station::{MS, Station, bytes, link, memory, word};

/// A link's process that says what it likes.
struct Raw {
    socket: OwnedFd,
    buffer: Vec<u8>,
}

impl Raw {
    fn open(station: &mut Station, link: usize) -> Self {
        let (ours, theirs) = handover::pair().expect("a socket");
        station.broker.connect(link, ours, station.time);
        Self { socket: theirs, buffer: vec![0; MESSAGE_BYTES] }
    }

    /// False: the door is closed, or the way there is full.
    fn say(&self, message: &ToBroker) -> bool {
        handover::send(&self.socket, &message.encode(), &[]).is_ok()
    }

    fn ask(&self, client: u32, ticket: Ticket, ask: Ask) -> bool {
        self.say(&ToBroker::Ask { client, ticket, ask })
    }

    /// All news that have come.
    fn news(&mut self) -> Vec<News> {
        let mut news = Vec::new();
        while let Ok(Some((len, _))) = handover::receive(&self.socket, &mut self.buffer) {
            match ToLink::decode(&self.buffer[..len]) {
                Some(ToLink::News(one)) => news.push(one),
                Some(_) => {}
                None => break,
            }
        }
        news
    }
}

impl Station {
    /// So many changes of the driver's state, each an event. No time passes.
    fn happen(&mut self, count: usize) {
        for _ in 0..count {
            self.driver_up.fetch_not(Ordering::Relaxed);
            self.broker.step(self.time);
        }
    }
}

/// The figures here are those of docs/access.md: a larger one is a promise about memory that nobody has weighed.
#[test]
fn a_link_has_4096_clients() {
    let mut station = Station::new(vec![link("panel", Right::Read)]);
    let mut raw = Raw::open(&mut station, 0);
    let (mut served, mut refused) = (0, 0);
    for client in 1..=5_000 {
        assert!(raw.ask(client, 0, Ask::NoEvents));
        station.broker.step(station.time);
        for news in raw.news() {
            match news {
                News::Answer { answer: Answer::Done, .. } => served += 1,
                News::Answer { answer: Answer::Refused(Refusal::Full), .. } => refused += 1,
                other => panic!("{other:?}"),
            }
        }
    }
    assert_eq!((served, refused), (4_096, 904));
    // One that goes makes room for another, and those that are there are served.
    assert!(raw.say(&ToBroker::Gone(7)) && raw.ask(9_999, 1, Ask::NoEvents) && raw.ask(8, 2, Ask::NoEvents));
    station.broker.step(station.time);
    let done = |client, ticket| News::Answer { client, ticket, answer: Answer::Done };
    assert_eq!(raw.news(), [done(9_999, 1), done(8, 2)]);
}

#[test]
fn a_link_is_shown_with_256_connections() {
    let mut station = Station::new(vec![link("panel", Right::Read)]);
    let mut door = station.open(0);
    for (there, shown) in [(256, 256), (257, 256), (600, 256)] {
        door.connections(vec![Connection::default(); there]);
        let links = station.ask(&mut door, 1, Ask::Document(Document::Links));
        let Answer::Document { bytes: links, .. } = links else { panic!("{links:?}") };
        assert_eq!(String::from_utf8_lossy(&links), format!(r#"Links Stop [("panel", true, {shown})]"#));
    }
}

#[test]
fn the_last_1024_events_are_kept() {
    let mut station = Station::new(vec![link("panel", Right::Read)]);
    station.happen(1_500);
    let mut door = station.open(0);
    assert_eq!(station.ask(&mut door, 0, Ask::Events { after: 0 }), Answer::Done);
    let mut seen = std::mem::take(&mut station.seen);
    for _ in 0..100 {
        station.broker.step(station.time);
        door.pump().expect("open");
        seen.extend(std::iter::from_fn(|| door.take_news()).filter_map(|news| match news {
            News::Event(event) => Some(event),
            _ => None,
        }));
    }
    let [Event { number: before, what: What::Lost(lost), .. }, kept @ ..] = seen.as_slice() else {
        panic!("no gap is told: {:?}", seen.first());
    };
    assert_eq!((lost, kept.len()), (before, 1_024));
    assert!(kept.iter().zip(before + 1..).all(|(event, number)| event.number == number), "{before}: {kept:?}");
}

/// Events wait in the stream, not for each link: one that takes none of them loses the oldest, and learns of it.
#[test]
fn a_link_that_takes_no_events_keeps_its_door() {
    let mut station = Station::new(vec![link("page", Right::Read)]);
    let mut raw = Raw::open(&mut station, 0);
    assert!(raw.ask(0, 1, Ask::Events { after: 0 }));
    station.happen(8_000);
    let mut seen: Vec<Event> = Vec::new();
    for _ in 0..200 {
        station.broker.step(station.time);
        seen.extend(raw.news().into_iter().filter_map(|news| match news {
            News::Event(event) => Some(event),
            _ => None,
        }));
    }
    assert!(raw.ask(0, 2, Ask::NoEvents), "its door is open");
    let gap = seen.iter().position(|event| matches!(event.what, What::Lost(_))).expect("the gap is told");
    assert!(seen.len() - gap > 1_024 && seen.last().is_some_and(|event| event.number > 8_000), "{:?}", seen.last());
}

#[test]
fn sixty_four_messages_of_a_link_are_taken_before_the_next_links_turn() {
    let mut station = Station::new(vec![link("greedy", Right::Read)]);
    let mut raw = Raw::open(&mut station, 0);
    assert!((0..100).all(|ticket| raw.ask(1, ticket, Ask::Blocks)));
    let mut answered = || {
        station.broker.step(station.time);
        raw.news().len()
    };
    assert_eq!((answered(), answered(), answered()), (64, 36, 0));
}

/// While no time passes, only the number of answers that wait can close its door.
#[test]
fn at_most_4096_answers_wait_for_a_link() {
    let mut station = Station::new(vec![link("deaf", Right::Read), link("panel", Right::Write)]);
    let mut panel = station.open(1);
    let raw = Raw::open(&mut station, 0);
    let closed = (0..20_000).find(|ticket| {
        let sent = raw.ask(1, *ticket, Ask::Blocks);
        station.broker.step(station.time);
        !sent
    });
    // Those that wait, and those that are on their way.
    assert!(closed.is_some_and(|asked| asked >= 4_096), "{closed:?}");
    assert!(station.write(&mut panel, 1, &[word(memory(20), 1)]).is_ok());
}

/// Asks for a login and waits for its end, in milliseconds.
fn login(station: &mut Station, door: &mut Door, client: u32, password: &str) -> (bool, u64) {
    let begin = station.time;
    let ticket = door.ask(client, Ask::Login(password.into()));
    loop {
        door.pump().expect("open");
        while let Some(news) = door.take_news() {
            if let News::Answer { ticket: of, answer, .. } = news
                && of == ticket
            {
                assert!(matches!(answer, Answer::Done | Answer::Refused(Refusal::Password)), "{answer:?}");
                return (answer == Answer::Done, (station.time - begin) / MS);
            }
        }
        station.cycle();
    }
}

/// Another connection is no way to more tries; another address does not wait for this one. Each wrong password is
/// recorded with its partner, up to a bound.
#[test]
fn who_guesses_waits_longer_and_longer_and_is_recorded() {
    let config =
        LinkConfig { password: Some("secret".into()), password_rights: Right::Operate, ..link("panel", Right::Read) };
    let mut station = Station::new(vec![config]);
    let mut door = station.open(0);
    let begin = station.time;
    for client in 1..=200 {
        door.partner(client, format!("10.0.0.5:{client}"));
        let (is_right, wait) = login(&mut station, &mut door, client, "guess");
        assert!(!is_right);
        let least = [0, 250, 500, 1000, 2000, 2250][(client as usize - 1).min(5)];
        assert!((least..least + 10).contains(&wait), "{client}: {wait}");
    }
    assert!(station.time - begin > 440_000 * MS, "200 tries take more than seven minutes");
    door.partner(300, "10.0.0.6:1".to_owned());
    assert!(matches!(login(&mut station, &mut door, 300, "secret"), (true, 0..10)));
    door.partner(301, "10.0.0.5:999".to_owned());
    assert!(matches!(login(&mut station, &mut door, 301, "secret"), (true, 2250..2260)), "at the same address");
    let records = std::mem::take(&mut *station.records.lock().expect("not poisoned"));
    assert_eq!(records[0], "panel, 10.0.0.5:1: password: wrong");
    assert!((100..140).contains(&records.len()), "{}", records.len());
    let left_out =
        |line: &String| line.split_once(" (").and_then(|(_, rest)| rest.split(' ').next()?.parse::<usize>().ok());
    let left_out: usize = records.iter().filter_map(left_out).sum();
    assert!((190..=200).contains(&(records.len() + left_out)), "{left_out} of {records:?}");
    let entries = station.entries(0xF501);
    assert!(
        entries.iter().any(|text| text.starts_with("panel, 10.0.0.5:") && text.contains(": password: wrong")),
        "{entries:?}"
    );
}

/// STOP, clock, loading and deleting name their partner. A link that has users of its own records them itself.
#[test]
fn what_a_partner_changes_is_recorded() {
    let mut station = Station::new(vec![link("panel", Right::Operate), link("page", Right::Operate)]);
    let (mut door, mut other) = (station.open(0), station.open(1));
    door.partner(7, "[2001:db8::5]:1102".to_owned());
    let db = BlockId::new(BlockKind::Db, 8);
    for ask in [
        Ask::SetClock([0x26, 0x11, 0x28, 0x10, 0, 0, 0, 0]),
        Ask::Stage { id: db, bytes: Box::from([1]) },
        Ask::Link,
        Ask::Delete(vec![db]),
        Ask::Command(Command::Stop),
        Ask::Szl { id: 0x0011, index: 0 },
    ] {
        let _ = station.ask(&mut door, 7, ask.clone());
        let _ = station.ask(&mut other, 7, ask);
    }
    let partner = "panel, [2001:db8::5]:1102: ";
    let wanted = ["set the clock", "load DB 8", "delete DB 8", "stop"].map(|what| format!("{partner}{what}: taken"));
    assert_eq!(*station.records.lock().expect("not poisoned"), wanted);
    let entries = station.entries(0xF501);
    assert_eq!(entries.iter().rev().collect::<Vec<_>>(), wanted.iter().collect::<Vec<_>>());
    // A link that never gives the right to operate has nothing to record.
    let mut station = Station::new(vec![link("panel", Right::Write)]);
    let mut door = station.open(0);
    door.partner(7, "10.0.0.5:1".to_owned());
    assert_eq!(station.ask(&mut door, 7, Ask::Command(Command::Stop)), Answer::Refused(Refusal::Right));
    assert!(station.records.lock().expect("not poisoned").is_empty());
}

/// What a door refuses to send, the broker refuses to take.
#[test]
fn a_group_has_1024_entries_and_4096_bytes() {
    let mut station = Station::new(vec![link("panel", Right::Write)]);
    let mut raw = Raw::open(&mut station, 0);
    let bits = |count| vec![Put::Value(memory(20), Width::Bit, 1); count];
    let bytes = |count, len| Put::Bytes(Cell::Db(7, 0), vec![count; len].into());
    let blocks: Vec<Put> = (0..8).map(|count| bytes(count, 512)).collect();
    let too_long = [blocks.clone(), vec![bytes(9, 1)]].concat();
    let full = Err(Refused { entry: 0, why: Refusal::Full });
    for (puts, good) in [(bits(1_024), true), (bits(1_025), false), (blocks, true), (too_long, false)] {
        let len: usize = puts.iter().map(Put::bytes).sum();
        assert!(raw.say(&ToBroker::Write { client: 1, ticket: 1, puts: puts.clone() }));
        station.cycles(2);
        let outcome = match raw.news().as_slice() {
            [News::Written { outcome, .. }] => *outcome,
            other => panic!("{other:?}"),
        };
        assert_eq!((outcome.is_ok(), outcome == full), (good, !good), "{} entries, {len} bytes", puts.len());
    }
}

/// One that asks for everything at once gets what is its share; the others do not wait for it.
#[test]
fn clients_take_turns_and_none_takes_the_turn_of_another() {
    let mut station = Station::new(vec![link("panel", Right::Write), link("gate", Right::Write)]);
    let (mut greedy, mut modest) = (station.open(0), station.open(1));
    let big: Vec<Put> = vec![Put::Bytes(Cell::Db(7, 0), vec![1; 590].into()); 6];
    let mut refused = 0;
    for client in 0..40 {
        for _ in 0..OUTSTANDING + 2 {
            let _ = greedy.write(client, big.clone()).expect("a group");
        }
    }
    greedy.pump().expect("open");
    (0..20).for_each(|_| station.broker.step(station.time));
    let before = station.time;
    assert!(station.write(&mut modest, 1, &[word(memory(20), 3)]).is_ok());
    assert!(station.time - before <= 5 * MS, "it waited {} cycles", (station.time - before) / MS);
    let mut landed: Vec<(u32, Ticket)> = Vec::new();
    for _ in 0..600 {
        station.cycle();
        greedy.pump().expect("open");
        while let Some(news) = greedy.take_news() {
            match news {
                News::Written { outcome: Err(Refused { why: Refusal::Full, .. }), .. } => refused += 1,
                News::Written { client, ticket, outcome: Ok(_) } => landed.push((client, ticket)),
                _ => {}
            }
        }
    }
    assert_eq!((landed.len(), refused), (40 * OUTSTANDING, 40 * 2));
    for client in 0..40 {
        let tickets: Vec<Ticket> = landed.iter().filter(|(c, _)| *c == client).map(|(_, ticket)| *ticket).collect();
        assert!(tickets.len() == OUTSTANDING && tickets.is_sorted(), "{client}: {tickets:?}");
    }
}

/// What comes through the socket of a link gone mad closes that door, and nothing else.
#[test]
fn noise_closes_one_door() {
    let mut station = Station::new(vec![link("mad", Right::Operate), link("panel", Right::Write)]);
    let mut panel = station.open(1);
    let mut random = fastrand::Rng::with_seed(0x1234_5678_9ABC_DEF0);
    for round in 0..300 {
        let (ours, theirs): (OwnedFd, OwnedFd) = handover::pair().expect("a socket");
        station.broker.connect(0, ours, station.time);
        let mut packet = ob1_access::door::ToBroker::Watch {
            generation: u64::from(round % 3 == 0) << 40 | round,
            pieces: vec![bytes(memory(0), 2), Piece::Value(Cell::Timer(9), Width::Bit)],
        }
        .encode();
        for _ in 0..round % 5 {
            let at = random.usize(..packet.len());
            packet[at] = random.u8(..);
        }
        handover::send(&theirs, &packet, &[]).expect("room");
        station.cycle();
    }
    assert!(station.write(&mut panel, 1, &[word(memory(20), 77)]).is_ok());
    assert_eq!(station.read(&mut panel, &[bytes(memory(20), 2)]).value(0), Ok(77));
}

/// A link that asks and takes none of its answers is dropped, and nobody else waits for it.
#[test]
fn a_link_that_takes_nothing_is_let_go() {
    let mut station = Station::new(vec![link("stuck", Right::Read), link("panel", Right::Write)]);
    let mut panel = station.open(1);
    let (ours, theirs) = handover::pair().expect("a socket");
    station.broker.connect(0, ours, station.time);
    let ask = |ticket| ob1_access::door::ToBroker::Ask { client: 1, ticket, ask: Ask::Blocks }.encode();
    let mut sent = 0;
    // Until the way back is full and the broker holds some.
    for _ in 0..600 {
        sent += u64::from(handover::send(&theirs, &ask(sent), &[]).is_ok());
        station.broker.step(station.time);
    }
    assert!(station.write(&mut panel, 1, &[word(memory(20), 1)]).is_ok());
    station.time += 5_000 * MS;
    station.cycles(2);
    assert!(handover::send(&theirs, &ask(0), &[]).is_err(), "its door is closed after {sent} questions");
    assert!(station.write(&mut panel, 1, &[word(memory(20), 2)]).is_ok());
    let mut again = station.open(0);
    assert!(station.read(&mut again, &[bytes(memory(20), 2)]).value(0).is_ok(), "and it may come back");
}
