//! Handles and clients against a test broker: a window and a socket, no CPU.

use std::os::fd::{AsFd as _, OwnedFd};
use std::time::Duration;

use super::{Audit, Client, Station, Trouble, Who};
use ob1_access::door::{
    Answer, Ask, Document, Door, Event, MESSAGE_BYTES, News, Refusal, State, ToBroker, ToLink, VERSION, Welcome, What,
};
use ob1_access::{Cell, Piece, Put, Right, Width};
use ob1_backplane::{WindowHead, WindowWriter};
use ob1_model::Area;
use ob1_socket::handover;
use tokio::io::unix::AsyncFd;

const AGE: Duration = Duration::from_secs(60);

/// The broker's end.
struct Desk {
    socket: AsyncFd<OwnedFd>,
    window: WindowWriter,
    scan: u64,
}

/// A test station: its log is in the folder.
struct Plant {
    desk: Desk,
    station: Station,
    folder: tempfile::TempDir,
}

impl Plant {
    #[expect(deprecated, reason = "what replaces it is unsafe; an `OwnedFd` stays open as long as it is owned")]
    fn new(rights: Right) -> Self {
        let (ours, theirs) = handover::pair().expect("a socket");
        let window = WindowWriter::create_shared().expect("shared memory");
        let welcome = Welcome {
            version: VERSION,
            station: "press".into(),
            link: "page".into(),
            family: 300,
            config: "{}".into(),
            rights,
            inputs: 128,
            outputs: 128,
            memory: 256,
            timers: 8,
            counters: 8,
            min_cycle: 0,
            generation: 0,
            listeners: 0,
        };
        let mut door = Door::new(theirs).expect("a door");
        let file = window.reader().descriptor().expect("shared").try_clone_to_owned().expect("a descriptor");
        handover::send(&ours, &ToLink::Welcome(welcome).encode(), &[file.as_fd()]).expect("room");
        door.pump().expect("open");
        let folder = tempfile::tempdir().expect("a folder");
        let audit = Audit::open("page", &folder.path().join("x.audit")).expect("a file");
        let (station, pump) = Station::new(door, Right::Operate, audit).expect("welcomed");
        tokio::spawn(pump);
        let desk = Desk { socket: AsyncFd::new(ours).expect("a socket"), window, scan: 0 };
        Self { desk, station, folder }
    }

    fn client(&self, right: Right) -> Client {
        self.station.client(Who { user: "anna".into(), address: "::1".into(), right })
    }

    fn audit(&self) -> String {
        std::fs::read_to_string(self.folder.path().join("x.audit")).expect("a file")
    }
}

impl Desk {
    /// The next message that is not a sign of life.
    async fn hear(&self) -> ToBroker {
        let mut buffer = vec![0; MESSAGE_BYTES];
        loop {
            match handover::receive(self.socket.get_ref(), &mut buffer).expect("open") {
                Some((len, _)) => match ToBroker::decode(&buffer[..len]).expect("a message") {
                    ToBroker::Beat | ToBroker::Ask { ask: Ask::Events { .. }, .. } => {}
                    message => return message,
                },
                None => self.socket.readable().await.expect("open").clear_ready(),
            }
        }
    }

    fn say(&self, message: &ToLink) {
        handover::send(self.socket.get_ref(), &message.encode(), &[]).expect("room");
    }

    /// A snapshot with this value in every word.
    fn scan(&mut self, generation: u64, value: u64) {
        self.scan += 1;
        self.window.put(WindowHead { generation, scan: self.scan, time: self.scan, state: 2 }, |words| {
            words.iter().for_each(|word| word.store(value, std::sync::atomic::Ordering::Relaxed));
        });
    }
}

fn run(test: impl Future<Output = ()>) {
    tokio::runtime::Builder::new_current_thread().enable_all().build().expect("a runtime").block_on(test);
}

fn word(byte: u32) -> Piece {
    Piece::Bytes { at: Cell::Area(Area::Memory, byte * 8), len: 2 }
}

#[test]
fn a_watch_gives_the_newest_and_piles_up_nothing() {
    run(async {
        let mut plant = Plant::new(Right::Read);
        let mut watch = plant.station.watch(vec![word(10)], Duration::from_millis(10));
        let ToBroker::Watch { generation, pieces } = plant.desk.hear().await else { panic!("no watch") };
        assert!(!pieces.is_empty());
        plant.desk.scan(generation, 0);
        plant.desk.say(&ToLink::Watching(generation));
        let first = watch.next().await.expect("there");
        assert_eq!(first.scan, 1);
        // A second reader of the same piece needs no request.
        let once = plant.station.read(vec![word(10)]).await.expect("there");
        assert_eq!((once.scan, once.len()), (1, 1));
        (0..1000).for_each(|_| plant.desk.scan(generation, 0));
        let mut taken = 0;
        while watch.next().await.expect("there").scan < 1001 {
            taken += 1;
        }
        assert!(taken < 1000, "only the newest: {taken}");
        drop(plant.desk);
        loop {
            match watch.next().await {
                Ok(_) => {}
                Err(trouble) => break assert_eq!(trouble, Trouble::Gone),
            }
        }
        assert_eq!(plant.station.read(vec![word(10)]).await.expect_err("gone"), Trouble::Gone);
    });
}

#[test]
fn what_is_read_for_the_first_time_comes_a_cycle_later() {
    run(async {
        let mut plant = Plant::new(Right::Read);
        let station = plant.station.clone();
        let read = tokio::spawn(async move { station.read(vec![word(4), word(90)]).await });
        let ToBroker::Watch { generation, .. } = plant.desk.hear().await else { panic!("no watch") };
        plant.desk.scan(generation, 0);
        plant.desk.say(&ToLink::Watching(generation));
        assert_eq!(read.await.expect("no panic").expect("there").len(), 2);
        let much =
            vec![Piece::Bytes { at: Cell::Db(1, 0), len: 65_535 }, Piece::Bytes { at: Cell::Db(2, 0), len: 65_535 }];
        assert_eq!(plant.station.read(much).await.expect_err("too much"), Trouble::TooMuch);
    });
}

/// The user's right is below the link's. A request refused here never reaches the broker, and it is logged.
#[test]
fn rights_of_users_and_their_trace() {
    run(async {
        let plant = Plant::new(Right::Write);
        let put = || vec![Put::Value(Cell::Area(Area::Memory, 80), Width::Word, 5)];
        let reader = plant.client(Right::Read);
        assert_eq!(reader.write("MW10 = 5", put()).await, Err(Trouble::User));
        let operator = plant.client(Right::Operate);
        assert_eq!(operator.right(), Right::Write, "the link is the ceiling");
        let stop = Ask::Command(ob1_access::door::Command::Stop);
        assert_eq!(operator.ask(stop).await, Err(Trouble::User));
        assert_eq!(operator.ask(Ask::Login("secret".into())).await, Err(Trouble::User));
        let writes = operator.clone();
        let written = tokio::spawn(async move { writes.write("MW10 = 5", put()).await });
        let ToBroker::Write { client, ticket, puts } = plant.desk.hear().await else { panic!("no write") };
        assert_eq!(puts, put());
        plant.desk.say(&ToLink::News(News::Written { client, ticket, outcome: Ok(7) }));
        assert_eq!(written.await.expect("no panic"), Ok(7));
        let audit = plant.audit();
        for part in ["refused: not allowed", "command stop", "write MW10 = 5", "done, scan 7", "\"user\":\"anna\""] {
            assert!(audit.contains(part), "{part}: {audit}");
        }
        drop((reader, operator));
        let gone = [plant.desk.hear().await, plant.desk.hear().await];
        assert!(gone.contains(&ToBroker::Gone(client)), "{gone:?}");
    });
}

/// If a caller goes away during a write, its line is still logged.
#[test]
fn a_write_that_nobody_waits_for_is_written_down() {
    run(async {
        let plant = Plant::new(Right::Write);
        let client = plant.client(Right::Write);
        let write = tokio::spawn(async move {
            let _ = client.write("MB1 = 1", vec![Put::Value(Cell::Area(Area::Memory, 8), Width::Byte, 1)]).await;
        });
        let ToBroker::Write { client, ticket, .. } = plant.desk.hear().await else { panic!("no write") };
        write.abort();
        assert!(write.await.is_err());
        plant.desk.say(&ToLink::News(News::Written { client, ticket, outcome: Ok(9) }));
        assert_eq!(plant.desk.hear().await, ToBroker::Gone(client), "only now");
        assert!(plant.audit().contains("done, scan 9"));
    });
}

#[test]
fn many_who_want_a_document_get_the_same() {
    run(async {
        let plant = Plant::new(Right::Read);
        let readers: Vec<_> = (0..5)
            .map(|_| {
                let station = plant.station.clone();
                tokio::spawn(async move { station.document(Document::Status, AGE).await })
            })
            .collect();
        let ToBroker::Ask { client, ticket, ask: Ask::Document(Document::Status) } = plant.desk.hear().await else {
            panic!("no question")
        };
        let part = |last, bytes: &[u8]| {
            let answer = Answer::Document { last, bytes: bytes.into() };
            plant.desk.say(&ToLink::News(News::Answer { client, ticket, answer }));
        };
        part(false, b"one, ");
        part(true, b"two");
        for reader in readers {
            assert_eq!(&*reader.await.expect("no panic").expect("there"), b"one, two");
        }
        // An error is not cached.
        let station = plant.station.clone();
        let other = tokio::spawn(async move { station.document(Document::Timing, AGE).await });
        let ToBroker::Ask { client, ticket, .. } = plant.desk.hear().await else { panic!("no question") };
        plant.desk.say(&ToLink::News(News::Answer { client, ticket, answer: Answer::Refused(Refusal::Silent) }));
        assert_eq!(other.await.expect("no panic"), Err(Refusal::Silent.into()));
    });
}

#[test]
fn the_program_is_asked_for_once() {
    run(async {
        let plant = Plant::new(Right::Read);
        let station = plant.station.clone();
        let first = tokio::spawn(async move { station.catalog().await });
        let ToBroker::Ask { client, ticket, ask: Ask::Document(Document::Program) } = plant.desk.hear().await else {
            panic!("no question")
        };
        let bytes = b"symbol \"lamp\" \"A 4.0\"\n".as_slice().into();
        plant.desk.say(&ToLink::News(News::Answer { client, ticket, answer: Answer::Document { last: true, bytes } }));
        let catalog = first.await.expect("no panic").expect("a program");
        assert!(catalog.names.parse("lamp").is_ok());
        assert!(plant.station.catalog().await.is_ok(), "without another question");
    });
}

#[test]
fn events_are_kept_and_resumed() {
    run(async {
        let plant = Plant::new(Right::Read);
        let event = |number, state| ToLink::News(News::Event(Event { number, time: 0, what: What::State(state) }));
        let (none, mut events) = plant.station.events(0);
        assert!(none.is_empty());
        plant.desk.say(&event(1, State::Run));
        plant.desk.say(&event(2, State::Stop));
        assert_eq!(events.recv().await.expect("open").number, 1);
        assert_eq!(events.recv().await.expect("open").what, What::State(State::Stop));
        let numbers = |after| plant.station.events(after).0.iter().map(|event| event.number).collect::<Vec<_>>();
        assert_eq!((numbers(0), numbers(1), numbers(2)), (vec![1, 2], vec![2], vec![]));
        assert_eq!(numbers(9), [1, 2], "of another run");
    });
}
