//! Alarms from the program through the broker to displays, and back.

use std::io::{Read as _, Write as _};
use std::net::{TcpListener, TcpStream};

use ob1_access::door::{ALARM_CHANGES, Answer, Ask, Door, News, Refusal};
use ob1_access::{Right, Width};
use ob1_model::{AlarmAck, AlarmChange, AlarmEvent, AlarmKind, AlarmNow, AlarmOrder, AlarmQuery, Displays};

use crate::station::{Station, link, memory};

const SQ: u32 = 0x11;
const ALARM_8P: u32 = 0x23;

fn log_on(name: &str) -> Ask {
    Ask::LogOn { displays: Displays(Displays::ALARMS), name: name.into() }
}

fn query() -> Ask {
    Ask::Alarms(AlarmOrder::Query(AlarmQuery::Standing))
}

fn acknowledge(id: u32) -> Ask {
    Ask::Alarms(AlarmOrder::Acknowledge(vec![AlarmAck { id, coming: 0xFF, going: 0xFF }]))
}

/// What came for a client.
fn came(station: &mut Station, door: &mut Door, wanted: u32) -> Vec<AlarmEvent> {
    station.cycles(3);
    door.pump().expect("open");
    let mut all = std::mem::take(&mut station.changed);
    all.extend(std::iter::from_fn(|| door.take_news()).filter_map(|news| match news {
        News::Alarm { client, event } => Some((client, *event)),
        _ => None,
    }));
    let (its, others) = all.into_iter().partition(|(client, _)| *client == wanted);
    station.changed = others;
    let its: Vec<(u32, AlarmEvent)> = its;
    its.into_iter().map(|(_, event)| event).collect()
}

fn told(events: &[AlarmEvent]) -> Vec<(u32, u8, bool)> {
    events.iter().map(|e| (e.state.id, e.state.signals, matches!(e.change, AlarmChange::Message { .. }))).collect()
}

impl Station {
    /// The signals: bit 0 of SFC 17, bits 1 and 2 of SFB 35. They are there for the next cycle.
    fn signals(&mut self, bits: u32) {
        self.cpu.write(memory(50), Width::Byte, bits).expect("memory");
        self.cycle();
    }

    fn word(&mut self, at: u32) -> u32 {
        self.cpu.read(memory(at), Width::Word).expect("memory")
    }

    fn standing(&mut self, door: &mut Door) -> Vec<AlarmNow> {
        match self.ask(door, 9, query()) {
            Answer::Alarms { list, last: true, .. } => list,
            other => panic!("{other:?}"),
        }
    }
}

#[test]
fn a_display_is_told_acknowledges_and_locks() {
    let mut station = Station::new(vec![link("panel", Right::Write), link("other", Right::Read)]);
    let (mut panel, mut other) = (station.open(0), station.open(1));
    station.signals(1);
    assert_eq!((station.word(54), station.word(56)), (0x8085, 1), "nobody is logged on");
    station.signals(0);
    assert_eq!(station.word(54), 0x8087);
    panel.partner(1, "10.0.0.5:1000".into());
    assert!(matches!(station.ask(&mut panel, 1, log_on("A")), Answer::LoggedOn { .. }));
    assert!(matches!(station.ask(&mut other, 2, log_on("B")), Answer::LoggedOn { .. }));
    station.cycles(2);
    station.signals(0b011);
    assert_eq!((station.word(54), station.word(56)), (0, 25));
    let first = came(&mut station, &mut panel, 1);
    assert_eq!(told(&first), [(SQ, 1, true), (ALARM_8P, 1, true)]);
    assert_eq!(first[1].number, first[0].number + 1);
    assert_eq!(first[0].time, first[1].time, "the time of the scan");
    assert_eq!(first[0].values.iter().collect::<Vec<_>>(), [(4, &[0, 0][..])]);
    assert_eq!(told(&came(&mut station, &mut other, 2)), told(&first));
    let standing = station.standing(&mut other);
    let kinds: Vec<_> =
        standing.iter().map(|now| (now.state.kind, now.state.is_active(), now.state.is_open())).collect();
    assert_eq!(kinds, [(AlarmKind::AlarmSq, true, true), (AlarmKind::Alarm8p, true, true)]);
    // Who may only read does not acknowledge.
    assert_eq!(station.ask(&mut other, 2, acknowledge(SQ)), Answer::Refused(Refusal::Right));
    assert_eq!(station.ask(&mut panel, 1, acknowledge(SQ)), Answer::Ordered(vec![true]));
    assert_eq!(station.ask(&mut panel, 1, acknowledge(99)), Answer::Ordered(vec![false]));
    assert_eq!(station.ask(&mut panel, 1, acknowledge(ALARM_8P)), Answer::Ordered(vec![true]));
    let lock = |locked| Ask::Alarms(AlarmOrder::Lock { ids: vec![ALARM_8P, SQ], locked });
    assert_eq!(station.ask(&mut panel, 1, lock(true)), Answer::Ordered(vec![true, false]));
    let changes: Vec<_> = came(&mut station, &mut other, 2).iter().map(|e| (e.change, e.state.id)).collect();
    let acknowledged = AlarmChange::Acknowledged;
    assert_eq!(changes, [(acknowledged, SQ), (acknowledged, ALARM_8P), (AlarmChange::Locked, ALARM_8P)]);
    assert_eq!(station.word(58), 0xFFFF, "ACK_STATE");
    station.signals(0b101);
    assert_eq!(station.word(56), 21);
    assert!(came(&mut station, &mut other, 2).is_empty(), "it is locked");
    let records = std::mem::take(&mut *station.records.lock().expect("not poisoned"));
    let who = "panel, 10.0.0.5:1000";
    let expected = [
        "acknowledge alarm DW#16#00000011",
        "acknowledge alarm DW#16#00000063",
        "acknowledge alarm DW#16#00000023",
        "lock alarm DW#16#00000023, DW#16#00000011",
    ];
    assert_eq!(records, expected.map(|what| format!("{who}: {what}: taken")));
    // Both log off.
    assert_eq!(station.ask(&mut panel, 1, Ask::LogOn { displays: Displays(0), name: String::new() }), Answer::Done);
    other.client_gone(2);
    other.pump().expect("open");
    station.cycles(3);
    station.signals(0b100);
    assert_eq!(station.word(54), 0x8085);
}

/// The process is killed: its displays count as logged on, and each continues behind what was handed to it. One that
/// has broken off itself begins anew.
#[test]
fn a_display_continues_after_its_link_was_killed() {
    let mut station = Station::new(vec![link("panel", Right::Write)]);
    let mut door = station.open(0);
    for (client, name) in [(1, "A"), (2, "B"), (3, "")] {
        door.partner(client, format!("10.0.0.5:{client}"));
        assert!(matches!(station.ask(&mut door, client, log_on(name)), Answer::LoggedOn { .. }));
    }
    station.signals(1);
    station.signals(0);
    station.signals(1);
    let numbers: Vec<u64> = came(&mut station, &mut door, 1).iter().map(|event| event.number).collect();
    assert_eq!(numbers.len(), 3);
    // A has given the first to its partner, B all.
    door.handed(1, numbers[0]);
    door.handed(2, numbers[2]);
    door.pump().expect("open");
    station.cycles(2);
    drop(door);
    station.cycles(2);
    station.signals(0);
    assert_eq!(station.word(54), 0, "it was sent, for them");
    let mut door = station.open(0);
    for (client, name, after) in
        [(7, "B", numbers[2]), (8, "A", numbers[0]), (9, "", numbers[2] + 1), (10, "C", numbers[2] + 1)]
    {
        door.partner(client, format!("10.0.0.5:5{client}"));
        assert_eq!(station.ask(&mut door, client, log_on(name)), Answer::LoggedOn { after }, "{name}");
    }
    let mut got = |client| came(&mut station, &mut door, client).iter().map(|event| event.number).collect::<Vec<u64>>();
    let fourth = numbers[2] + 1;
    assert_eq!((got(7), got(8)), (vec![fourth], vec![numbers[1], numbers[2], fourth]));
    assert!(got(9).is_empty() && got(10).is_empty());
    // It is killed right after it has handed the last one out.
    door.handed(8, fourth);
    door.pump().expect("open");
    drop(door);
    let mut door = station.open(0);
    door.partner(1, "10.0.0.5:9".into());
    assert_eq!(station.ask(&mut door, 1, log_on("A")), Answer::LoggedOn { after: fourth });
    station.signals(1);
    assert_eq!(came(&mut station, &mut door, 1).len(), 1);
    // Another address is another display.
    drop(door);
    let mut door = station.open(0);
    door.partner(1, "10.0.0.6:1".into());
    assert_eq!(station.ask(&mut door, 1, log_on("A")), Answer::LoggedOn { after: fourth + 1 });
}

/// It is killed between writing and telling so: what the partner's system has confirmed is not repeated, the rest is.
#[test]
fn the_kernel_knows_what_a_killed_link_has_written() {
    let mut station = Station::new(vec![link("panel", Right::Write)]);
    let mut door = station.open(0);
    door.partner(1, "10.0.0.5:1".into());
    assert!(matches!(station.ask(&mut door, 1, log_on("A")), Answer::LoggedOn { .. }));
    (0..4).for_each(|turn| station.signals(turn & 1 ^ 1));
    let numbers: Vec<u64> = came(&mut station, &mut door, 1).iter().map(|event| event.number).collect();
    let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
    let mut panel = TcpStream::connect(listener.local_addr().expect("its address")).expect("connected");
    let (mut ours, _) = listener.accept().expect("the panel");
    // Telegrams of 100 bytes; the last is not announced.
    let socket = ours.try_clone().expect("a descriptor");
    door.sending(1, vec![(numbers[0], 100)], Some(socket.into()));
    door.sending(1, vec![(numbers[1], 200), (numbers[2], 300)], None);
    door.pump().expect("open");
    station.cycles(2);
    ours.write_all(&[7; 299]).expect("room");
    drop((ours, door));
    station.cycles(2);
    let mut got = Vec::new();
    panel.read_to_end(&mut got).expect("the end of the connection");
    assert_eq!(got.len(), 299, "whoever else has the socket");
    let mut door = station.open(0);
    door.partner(2, "10.0.0.5:2".into());
    assert_eq!(station.ask(&mut door, 2, log_on("A")), Answer::LoggedOn { after: numbers[1] });
    let again: Vec<u64> = came(&mut station, &mut door, 2).iter().map(|event| event.number).collect();
    assert_eq!(again, numbers[2..]);
}

/// After some time a display that does not come back is given up.
#[test]
fn a_display_that_stays_away_is_logged_off() {
    let mut station = Station::new(vec![link("panel", Right::Write)]);
    let mut door = station.open(0);
    assert!(matches!(station.ask(&mut door, 1, log_on("A")), Answer::LoggedOn { .. }));
    drop(door);
    station.cycles(10_000);
    station.signals(1);
    assert_eq!(station.word(54), 0);
    station.cycles(25_000);
    station.signals(0);
    assert_eq!(station.word(54), 0x8085);
}

/// A display that hands nothing out gets a bounded number; what is no longer kept is told as lost.
#[test]
fn a_slow_display_is_told_what_it_has_lost() {
    let mut station = Station::new(vec![link("panel", Right::Write)]);
    let mut door = station.open(0);
    let Answer::LoggedOn { after } = station.ask(&mut door, 1, log_on("A")) else { panic!("logged on") };
    let mut total = 0;
    for turn in 0..20_000u32 {
        station.signals(turn & 1 ^ 1);
        total += 1;
    }
    let first = came(&mut station, &mut door, 1);
    let numbers: Vec<u64> = first.iter().map(|event| event.number).collect();
    assert_eq!(numbers, (after + 1..=after + ALARM_CHANGES as u64).collect::<Vec<_>>());
    let mut seen = first.len() as u64;
    let mut lost = 0;
    let mut last = *numbers.last().expect("some");
    loop {
        door.handed(1, last);
        door.pump().expect("open");
        let more = came(&mut station, &mut door, 1);
        let Some(newest) = more.last() else { break };
        last = newest.number;
        for event in more {
            match event.change {
                AlarmChange::Lost(count) => lost += count,
                _ => seen += 1,
            }
        }
    }
    assert!(lost > 0, "more than is kept");
    assert_eq!((seen + lost, last), (total, after + total), "all of them are told or told as lost");
}

/// One alarm, and more acknowledgements than one order may have.
#[test]
fn a_query_by_number_and_too_long_an_order() {
    let mut station = Station::new(vec![link("panel", Right::Write)]);
    let mut door = station.open(0);
    assert!(matches!(station.ask(&mut door, 1, log_on("A")), Answer::LoggedOn { .. }));
    station.signals(0b011);
    assert_eq!(station.standing(&mut door).len(), 2);
    let one = Ask::Alarms(AlarmOrder::Query(AlarmQuery::Number(ALARM_8P)));
    let Answer::Alarms { list, after, .. } = station.ask(&mut door, 1, one) else { panic!("a list") };
    assert_eq!((list.len(), list[0].state.id), (1, ALARM_8P));
    assert!(after >= 3);
    let many = vec![AlarmAck { id: 1, coming: 1, going: 1 }; 257];
    let refused = station.ask(&mut door, 1, Ask::Alarms(AlarmOrder::Acknowledge(many)));
    assert_eq!(refused, Answer::Refused(Refusal::Full));
}
