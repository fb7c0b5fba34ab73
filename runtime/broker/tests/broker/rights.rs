//! Who may do what: checked here and nowhere else.

use ob1_access::door::{Answer, Ask, Command, Refusal, Refused};
use ob1_access::{Allowed, Cell, Piece, Put, Right, Width};
use ob1_broker::LinkConfig;
use ob1_model::{Area, BlockId, BlockKind, Forced};

use crate::station::{Station, bytes, link, memory, word};

/// Each right, and each limit of it: what is not allowed is refused and changes nothing.
#[test]
fn rights() {
    let force = |text| Ask::Force(vec![Forced::parse(text).expect("a cell")]);
    let operates = [
        force("I0.0=1"),
        Ask::Force(Vec::new()),
        Ask::Command(Command::Stop),
        Ask::Command(Command::Cold),
        Ask::Command(Command::Reset),
        Ask::SetClock([0; 8]),
    ];
    for right in [Right::Read, Right::Write, Right::Operate] {
        let mut station = Station::new(vec![link("panel", right)]);
        let mut door = station.open(0);
        assert!(station.read(&mut door, &[bytes(memory(0), 2)]).value(0).is_ok(), "{right:?}");
        let written = station.write(&mut door, 1, &[word(memory(20), 7)]);
        let refused = Err(Refused { entry: 0, why: Refusal::Right });
        if right == Right::Read {
            assert_eq!((written, station.write(&mut door, 1, &[])), (refused, refused));
            assert_eq!(station.cpu.read(memory(20), Width::Word), Ok(0));
        } else {
            assert!(written.is_ok());
            assert_eq!(station.cpu.read(memory(20), Width::Word), Ok(7));
        }
        for ask in operates.clone() {
            let answer = station.ask(&mut door, 1, ask.clone());
            if right < Right::Operate {
                assert_eq!(answer, Answer::Refused(Refusal::Right), "{right:?} {ask:?}");
                assert_eq!(station.cpu.state(), ob1_cpu::OperatingState::Run, "{right:?} {ask:?}");
            } else {
                assert_ne!(answer, Answer::Refused(Refusal::Right), "{ask:?}");
            }
        }
    }
}

#[test]
fn areas_and_blocks() {
    let texts = |list: &[&str]| list.iter().map(|text| (*text).to_owned()).collect::<Vec<_>>();
    let allowed = Allowed::of(Some(&texts(&["M", "DB"])), Some(&texts(&["DB8"]))).expect("right");
    let mut station = Station::new(vec![LinkConfig { allowed, ..link("panel", Right::Operate) }]);
    let mut door = station.open(0);
    let output = Ask::Force(Forced::parse("QB0=1").into_iter().collect());
    assert_eq!(station.ask(&mut door, 1, output), Answer::Refused(Refusal::Right));
    let pieces = [
        bytes(memory(0), 2),
        bytes(Cell::Db(7, 0), 2),
        bytes(Cell::Db(8, 0), 2),
        bytes(Cell::Area(Area::Output, 0), 1),
        Piece::Value(Cell::Timer(1), Width::Word),
    ];
    let reading = station.read(&mut door, &pieces);
    let seen: Vec<bool> = (0..pieces.len()).map(|at| reading.piece(at).is_ok()).collect();
    assert_eq!(seen, [true, false, true, false, false]);
    assert_eq!((reading.piece(1), reading.piece(4)), (Err(Refusal::Right), Err(Refusal::Right)));
    for (put, good) in [
        (word(memory(20), 1), true),
        (word(Cell::Db(8, 0), 1), true),
        (word(Cell::Db(7, 16), 1), false),
        (Put::Bytes(Cell::Db(7, 16), Box::from([1])), false),
        (word(Cell::Area(Area::Output, 0), 1), false),
        (word(Cell::Peripheral(0), 1), false),
        (word(Cell::Counter(0), 1), false),
    ] {
        let outcome = station.write(&mut door, 1, &[word(memory(30), 5), put.clone()]);
        let refused = outcome == Err(Refused { entry: 1, why: Refusal::Right });
        assert_eq!((outcome.is_ok(), refused), (good, !good), "{put:?}");
    }
}

/// A link that is limited to some cells shows and changes no statements, unless its file says so: they tell and reach
/// every cell.
#[test]
fn areas_and_blocks_cover_the_program() {
    let dbs = ["DB8".to_owned()];
    let limited = || Allowed::of(None, Some(&dbs)).expect("right");
    for (allowed, db7, ob1) in [
        (Allowed::default(), true, true),
        (Allowed::default().with_program(Some(false)), true, false),
        (limited(), false, false),
        (limited().with_program(Some(true)), false, true),
    ] {
        let mut station = Station::new(vec![LinkConfig { allowed: allowed.clone(), ..link("panel", Right::Operate) }]);
        let mut door = station.open(0);
        let mut may = |ask: Ask| station.ask(&mut door, 1, ask) != Answer::Refused(Refusal::Right);
        for (kind, number, is_allowed) in
            [(BlockKind::Db, 7, db7), (BlockKind::Db, 8, true), (BlockKind::Ob, 1, ob1), (BlockKind::Fc, 5, ob1)]
        {
            let id = BlockId::new(kind, number);
            assert_eq!(may(Ask::Block(id)), is_allowed, "{allowed:?} {id}");
            assert_eq!(may(Ask::Stage { id, bytes: Box::from([1]) }), is_allowed, "{allowed:?} {id}");
            assert_eq!(may(Ask::Delete(vec![id])), is_allowed, "{allowed:?} {id}");
        }
        assert!(may(Ask::Blocks));
    }
}

#[test]
fn a_password_gives_one_client_more() {
    let config =
        LinkConfig { password: Some("secret".into()), password_rights: Right::Write, ..link("panel", Right::Read) };
    let mut station = Station::new(vec![config]);
    let mut door = station.open(0);
    assert_eq!(station.ask(&mut door, 1, Ask::Login("guess".into())), Answer::Refused(Refusal::Password));
    assert_eq!(station.ask(&mut door, 1, Ask::Login("secret".into())), Answer::Done);
    assert!(station.write(&mut door, 1, &[word(memory(20), 1)]).is_ok());
    assert!(station.write(&mut door, 2, &[word(memory(20), 2)]).is_err(), "another client");
    assert_eq!(station.ask(&mut door, 1, Ask::Command(Command::Stop)), Answer::Refused(Refusal::Right));
    assert_eq!(station.ask(&mut door, 1, Ask::Logout), Answer::Done);
    assert!(station.write(&mut door, 1, &[word(memory(20), 3)]).is_err());
    assert_eq!(station.ask(&mut door, 1, Ask::Login("secret".into())), Answer::Done);
    door.client_gone(1);
    assert!(station.write(&mut door, 1, &[word(memory(20), 4)]).is_err(), "its rights went with it");
    assert_eq!(station.cpu.read(memory(20), Width::Word), Ok(1));
}
