//! A door against a test broker: a window on this side, a socket between.

use ob1_backplane::{WindowHead, WindowWriter};
use ob1_model::{Area, Cell, CellError, Frame, Head, Width};

use super::*;
use crate::Right;

struct Desk {
    socket: OwnedFd,
    window: WindowWriter,
    scan: u64,
}

fn welcome() -> Welcome {
    Welcome {
        version: VERSION,
        station: "press".into(),
        link: "panel".into(),
        family: 300,
        config: "{}".into(),
        rights: Right::Read,
        inputs: 128,
        outputs: 128,
        memory: 256,
        timers: 8,
        counters: 8,
        min_cycle: 0,
        generation: 40,
        listeners: 0,
    }
}

impl Desk {
    fn open() -> (Self, Door) {
        let (ours, theirs) = handover::pair().expect("a socket");
        let mut desk = Self { socket: ours, window: WindowWriter::create_shared().expect("shared memory"), scan: 0 };
        let mut door = Door::new(theirs).expect("a door");
        let file = desk.window.reader().descriptor().expect("shared").try_clone_to_owned().expect("a descriptor");
        handover::send(&desk.socket, &ToLink::Welcome(welcome()).encode(), &[file.as_fd()]).expect("room");
        door.pump().expect("open");
        assert_eq!(desk.hear(), None);
        (desk, door)
    }

    fn hear(&mut self) -> Option<ToBroker> {
        let mut buffer = vec![0; MESSAGE_BYTES];
        let (len, _) = handover::receive(&self.socket, &mut buffer).expect("open")?;
        ToBroker::decode(&buffer[..len])
    }

    fn say(&self, message: &ToLink) {
        handover::send(&self.socket, &message.encode(), &[]).expect("room");
    }

    /// A snapshot in which each byte of memory is its address plus the scan.
    fn scan(&mut self, generation: u64, frame: &Frame) {
        self.scan += 1;
        let scan = self.scan;
        self.window.put(WindowHead { generation, scan, time: scan * 10, state: 2 }, |words| {
            let mut at = 0;
            let mut put = |word: u64| {
                words[at].store(word, Ordering::Relaxed);
                at += 1;
            };
            for run in frame.runs() {
                match frame.pieces()[run.first] {
                    Piece::Value(..) => put(Head::of(Ok(scan as u32)).word()),
                    Piece::Bytes { at: Cell::Db(99, _), .. } => put(Head::of(Err(CellError::NoDb)).word()),
                    Piece::Bytes { .. } => put(Head::of(Ok(256)).word()),
                }
                for piece in &frame.pieces()[run.first..run.end] {
                    let Piece::Bytes { at, len } = piece else { continue };
                    for word in 0..len.div_ceil(8) {
                        let bytes = [0, 1, 2, 3, 4, 5, 6, 7].map(|n| (at.byte() + word * 8 + n + scan as u32) as u8);
                        put(u64::from_ne_bytes(bytes));
                    }
                }
            }
        });
    }
}

fn m(from: u32, len: u32) -> Piece {
    Piece::Bytes { at: Cell::Area(Area::Memory, from * 8), len }
}

#[test]
fn what_is_read_first_comes_one_cycle_later_and_then_at_once() {
    let (mut desk, mut door) = Desk::open();
    assert_eq!(door.welcome().map(|welcome| welcome.station.as_str()), Some("press"));
    let mut reading = Reading::new();
    let wanted = [m(10, 3), Piece::Value(Cell::Timer(1), Width::Word), Piece::Bytes { at: Cell::Db(99, 0), len: 1 }];
    assert_eq!(door.read(&wanted, &mut reading), Err(NotYet::Coming));
    assert_eq!(door.read(&wanted, &mut reading), Err(NotYet::Coming));
    door.pump().expect("open");
    let Some(ToBroker::Watch { generation, pieces }) = desk.hear() else { panic!("no watch") };
    assert_eq!((generation, desk.hear()), (41, None), "asked once");
    let first = Frame::of(pieces);
    desk.scan(generation, &first);
    desk.say(&ToLink::Watching(generation));
    door.pump().expect("open");
    assert_eq!(door.take_news(), Some(News::Watching));
    door.read(&wanted, &mut reading).expect("there");
    assert_eq!((reading.scan, reading.time, reading.state, reading.len()), (1, 10, State::Run, 3));
    assert_eq!((reading.piece(0), reading.value(1)), (Ok(&[11, 12, 13][..]), Ok(1)));
    assert_eq!(reading.piece(2), Err(Refusal::Cell(CellError::NoDb)));
    door.read(&[m(11, 1)], &mut reading).expect("a part");
    assert_eq!(reading.piece(0), Ok(&[12][..]));

    // While more is requested, watched pieces can still be read.
    assert_eq!(door.read(&[m(100, 1)], &mut reading), Err(NotYet::Coming));
    door.pump().expect("open");
    let Some(ToBroker::Watch { generation, pieces }) = desk.hear() else { panic!("no watch") };
    desk.scan(41, &first);
    door.read(&wanted, &mut reading).expect("the old list");
    assert_eq!((reading.scan, reading.piece(0)), (2, Ok(&[12, 13, 14][..])));
    desk.scan(generation, &Frame::of(pieces));
    door.read(&wanted, &mut reading).expect("the new list, before it is told");
    door.read(&[m(100, 1)], &mut reading).expect("the new list");
    assert_eq!((reading.scan, reading.piece(0)), (3, Ok(&[103][..])));
    assert_eq!(door.read(&[m(0, 65_537)], &mut reading), Err(NotYet::TooMuch));
}

#[test]
fn what_is_not_allowed_is_told_of_its_piece() {
    let (mut desk, mut door) = Desk::open();
    let mut reading = Reading::new();
    let db = Piece::Bytes { at: Cell::Db(5, 0), len: 2 };
    assert_eq!(door.read(&[m(0, 2), db], &mut reading), Err(NotYet::Coming));
    door.pump().expect("open");
    let Some(ToBroker::Watch { generation, pieces }) = desk.hear() else { panic!("no watch") };
    let index = pieces.iter().position(|piece| *piece == db).expect("asked for") as u32;
    desk.say(&ToLink::Unwatched { generation, refused: vec![index] });
    door.pump().expect("open");
    assert_eq!(door.take_news(), Some(News::Watching));
    let Some(ToBroker::Watch { generation, pieces }) = desk.hear() else { panic!("not asked again") };
    assert_eq!(pieces, [m(0, 2)]);
    desk.scan(generation, &Frame::of(pieces));
    door.read(&[m(0, 2), db], &mut reading).expect("as far as it may");
    assert_eq!((reading.piece(0), reading.piece(1)), (Ok(&[1, 2][..]), Err(Refusal::Right)));
    door.read(&[db], &mut reading).expect("an answer");
    assert_eq!(reading.value(0), Err(Refusal::Right));
}

#[test]
fn writes_and_questions_go_out_and_their_answers_come_in() {
    let (mut desk, mut door) = Desk::open();
    let put = Put::Value(Cell::Area(Area::Memory, 3), Width::Bit, 1);
    let ticket = door.write(7, vec![put.clone()]).expect("small");
    assert!(door.write(7, vec![put.clone(); GROUP_ENTRIES + 1]).is_err());
    assert!(door.write(7, vec![Put::Bytes(put.cell(), vec![0; WRITE_BYTES + 1].into())]).is_err());
    let asked = door.ask(8, Ask::Clock);
    door.beat();
    door.client_gone(7);
    door.pump().expect("open");
    assert_eq!(desk.hear(), Some(ToBroker::Write { client: 7, ticket, puts: vec![put] }));
    assert_eq!(desk.hear(), Some(ToBroker::Ask { client: 8, ticket: asked, ask: Ask::Clock }));
    assert_eq!(desk.hear(), Some(ToBroker::Gone(7)), "no beat while others wait");
    desk.say(&ToLink::News(News::Written { client: 7, ticket, outcome: Ok(5) }));
    desk.say(&ToLink::News(News::Answer { client: 8, ticket: asked, answer: Answer::Clock([1; 8]) }));
    door.pump().expect("open");
    assert_eq!(door.take_news(), Some(News::Written { client: 7, ticket, outcome: Ok(5) }));
    assert_eq!(door.take_news(), Some(News::Answer { client: 8, ticket: asked, answer: Answer::Clock([1; 8]) }));
    assert_eq!(door.take_news(), None);
    door.beat();
    door.pump().expect("open");
    assert_eq!(desk.hear(), Some(ToBroker::Beat));
}

#[test]
fn a_door_that_is_gone_says_so() {
    let (desk, mut door) = Desk::open();
    drop(desk);
    assert!(matches!(door.pump(), Err(DoorError::Closed)));
    let (desk, mut door) = Desk::open();
    handover::send(&desk.socket, b"what is this", &[]).expect("room");
    assert!(matches!(door.pump(), Err(DoorError::Version)));
    // Nobody reads: the queue is bounded.
    let (_desk, mut door) = Desk::open();
    for _ in 0..200_000 {
        door.ask(1, Ask::Clock);
    }
    assert!(matches!(door.pump(), Err(DoorError::Full)) && door.wants_write());
}

/// A process with several links gets its doors in their order, and all of them.
#[test]
fn several_doors_come_over_one_socket() {
    let (over, input) = handover::pair().expect("a socket");
    assert!(Door::several(&input).expect("open").is_none(), "nothing yet");
    let pairs: Vec<_> = (0..7).map(|_| handover::pair().expect("a socket")).collect();
    let (ours, theirs): (Vec<OwnedFd>, Vec<OwnedFd>) = pairs.into_iter().unzip();
    Door::hand_over(&over, &theirs).expect("room");
    let mut doors = Door::several(&input).expect("open").expect("all of them");
    assert_eq!(doors.len(), 7);
    for (number, (door, ours)) in doors.iter_mut().zip(&ours).enumerate() {
        let event = Event { number: number as u64, time: 0, what: What::State(State::Run) };
        handover::send(ours, &ToLink::News(News::Event(event.clone())).encode(), &[]).expect("room");
        door.pump().expect("open");
        assert_eq!(door.take_news(), Some(News::Event(event)));
    }
    drop(over);
    assert!(matches!(Door::several(&input), Err(DoorError::Closed)));
}

/// Parts of several documents that come interleaved are joined separately.
#[test]
fn documents_are_put_together() {
    let (desk, mut door) = Desk::open();
    let part = |ticket, last, byte: u8| {
        let answer = Answer::Document { last, bytes: Box::from([byte; 3]) };
        desk.say(&ToLink::News(News::Answer { client: 1, ticket, answer }));
    };
    part(1, false, 1);
    part(2, false, 2);
    part(1, true, 3);
    part(2, false, 4);
    part(2, true, 5);
    door.pump().expect("open");
    for (ticket, bytes) in [(1, &[1, 1, 1, 3, 3, 3][..]), (2, &[2, 2, 2, 4, 4, 4, 5, 5, 5])] {
        let answer = Answer::Document { last: true, bytes: bytes.into() };
        assert_eq!(door.take_news(), Some(News::Answer { client: 1, ticket, answer }));
    }
    assert_eq!(door.take_news(), None);
}

/// The station ends at any moment of the link: with a sign of life unread, or with nothing. Both are a normal end.
#[test]
fn a_station_that_ends_with_something_unread_has_closed_the_door() {
    for unread in [false, true] {
        let (desk, mut door) = Desk::open();
        door.pump().expect("open");
        if unread {
            door.beat();
            door.pump().expect("open");
        }
        drop(desk);
        if !unread {
            door.beat();
        }
        assert!(matches!(door.pump(), Err(DoorError::Closed)), "{unread}");
    }
}

/// A long list of alarms is one answer, behind what came before its last part.
#[test]
fn alarms_come_whole() {
    let (desk, mut door) = Desk::open();
    let alarm = |id| AlarmNow { state: ob1_model::AlarmState { id, ..Default::default() }, ..AlarmNow::default() };
    let parts = [(false, vec![alarm(1), alarm(2)]), (false, Vec::new()), (true, vec![alarm(3)])];
    for (last, list) in parts {
        desk.say(&ToLink::News(News::Answer { client: 1, ticket: 7, answer: Answer::Alarms { last, after: 9, list } }));
        desk.say(&ToLink::News(News::Watching));
    }
    door.pump().expect("open");
    let whole = Answer::Alarms { last: true, after: 9, list: vec![alarm(1), alarm(2), alarm(3)] };
    let answer = News::Answer { client: 1, ticket: 7, answer: whole };
    let news: Vec<News> = std::iter::from_fn(|| door.take_news()).collect();
    assert_eq!(news, [News::Watching, News::Watching, answer, News::Watching]);
}
