//! Points of the cycle and passes: by right, forgotten, gone with their client.

use ob1_access::door::{ARMED, Answer, Ask, Door, News, Refusal, Ticket};
use ob1_access::{Allowed, Cell, Right, Width};
use ob1_broker::LinkConfig;
use ob1_model::{Area, BlockId, BlockKind, PassEnd, PassOrder, Point, PointItem, PointOrder, Put};

use crate::station::{Station, bytes, link, memory};

fn at(point: Point, items: &[PointItem]) -> Ask {
    Ask::Point(PointOrder { point, stays: false, items: items.to_vec() })
}

fn read(at: Cell, len: u32) -> PointItem {
    PointItem::Read(bytes(at, len))
}

fn write(byte: u32, value: u32) -> PointItem {
    PointItem::Write(Put::Value(memory(byte), Width::Word, value))
}

/// What has come for this ticket within some cycles.
fn came(station: &mut Station, door: &mut Door, wanted: Ticket) -> Option<Answer> {
    let mut found = None;
    for _ in 0..20 {
        door.pump().expect("open");
        while let Some(news) = door.take_news() {
            if let News::Answer { ticket, answer, .. } = news
                && ticket == wanted
            {
                found = Some(answer);
            }
        }
        station.cycle();
    }
    found
}

#[test]
fn a_point_is_one_of_the_cycle_and_by_right() {
    let mut station = Station::new(vec![
        link("operator", Right::Operate),
        link("panel", Right::Write),
        LinkConfig {
            allowed: Allowed::of(Some(&["M".to_owned()]), None).expect("an area"),
            ..link("memory", Right::Operate)
        },
    ]);
    let mut operator = station.open(0);
    // Written at the begin, the program has copied it at the end.
    let both = [write(20, 0x1234), read(memory(22), 2)];
    let Answer::Point(begin) = station.ask(&mut operator, 1, at(Point::Start, &both)) else { panic!("no answer") };
    assert!(begin[0].as_deref() == Ok(&[]) && begin[1].is_ok());
    let copied = station.ask(&mut operator, 1, at(Point::End, &[read(memory(22), 2), read(Cell::Db(99, 0), 2)]));
    let Answer::Point(copied) = copied else { panic!("{copied:?}") };
    assert_eq!(copied[0], Ok([0x12, 0x34].into()));
    assert!(matches!(copied[1], Err(Refusal::Cell(_))), "each for itself: {copied:?}");
    // To write takes the right to operate; cells that are not allowed are refused one by one.
    let mut panel = station.open(1);
    assert_eq!(station.ask(&mut panel, 1, at(Point::Now, &both)), Answer::Refused(Refusal::Right));
    assert!(matches!(station.ask(&mut panel, 1, at(Point::Now, &both[1..])), Answer::Point(_)));
    let mut narrow = station.open(2);
    let items = [read(Cell::Db(7, 0), 2), write(20, 7), read(Cell::Area(Area::Output, 0), 1), read(memory(20), 2)];
    let right = Err(Refusal::Right);
    let expected = vec![right.clone(), Ok([].into()), right, Ok([0, 7].into())];
    assert_eq!(station.ask(&mut narrow, 1, at(Point::Now, &items)), Answer::Point(expected));
    let block = BlockId::new(BlockKind::Ob, 1);
    let addresses = Ask::Addresses { block, wanted: vec![0] };
    assert_eq!(station.ask(&mut narrow, 1, addresses), Answer::Refused(Refusal::Right), "the program is not allowed");
}

#[test]
fn what_is_forgotten_is_answered_with_what_there_is() {
    let mut station = Station::new(vec![link("operator", Right::Operate)]);
    let mut door = station.open(0);
    let stays = door.ask(1, Ask::Point(PointOrder { point: Point::Start, stays: true, items: vec![write(20, 9)] }));
    assert_eq!(came(&mut station, &mut door, stays), None);
    let read = station.read(&mut door, &[bytes(memory(22), 2)]);
    assert_eq!(read.value(0), Ok(9), "in each cycle");
    let stop = door.ask(1, at(Point::Stop, &[write(30, 1)]));
    let wait = u64::MAX;
    let block = BlockId::new(BlockKind::Ob, 1);
    let order = PassOrder { block, from: None, db: 5, first: 0, count: 3, wait, before: true };
    let pass = door.ask(1, Ask::Pass(order));
    assert_eq!(came(&mut station, &mut door, stop), None);
    for (ticket, expected) in [(stays, Answer::Point(vec![])), (stop, Answer::Point(vec![]))] {
        door.ask(1, Ask::Forget(ticket));
        assert_eq!(came(&mut station, &mut door, ticket), Some(expected));
    }
    door.ask(1, Ask::Forget(pass));
    let Some(Answer::Pass(pass)) = came(&mut station, &mut door, pass) else { panic!("no pass") };
    assert_eq!(pass.end, PassEnd::NotCalled);
    // Those that wait do not count as the others do, but there is a bound.
    for _ in 0..=ARMED {
        door.ask(2, at(Point::Stop, &[]));
    }
    assert!(matches!(station.ask(&mut door, 2, Ask::Szl { id: 0x0424, index: 0 }), Answer::Szl { .. }));
    let one_more = door.ask(2, at(Point::Stop, &[]));
    assert_eq!(came(&mut station, &mut door, one_more), Some(Answer::Refused(Refusal::Full)));
}

/// The places of a client that is gone are free at once.
#[test]
fn jobs_go_with_their_client() {
    let mut station = Station::new(vec![link("operator", Right::Operate)]);
    let mut door = station.open(0);
    for client in 1..40 {
        for _ in 0..ob1_model::POINT_JOBS {
            door.ask(
                client,
                Ask::Point(PointOrder { point: Point::Start, stays: true, items: vec![write(20, client)] }),
            );
        }
        door.pump().expect("open");
        station.cycles(3);
        assert_eq!(station.read(&mut door, &[bytes(memory(22), 2)]).value(0), Ok(client));
        door.client_gone(client);
        door.pump().expect("open");
        station.cycles(2);
    }
}
