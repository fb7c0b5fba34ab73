//! Every question there is, from clients with every right, in any order: who may not operate changes nothing.

use ob1_access::door::{Answer, Ask, Command, Document, Refusal};
use ob1_access::{Right, Width};
use ob1_model::{
    AlarmAck, AlarmOrder, AlarmQuery, BlockId, BlockKind, Breakpoint, DebugOrder, Displays, Forced, ForcedArea,
    PassOrder, Piece, Point, PointItem, PointOrder, Put, Resume,
};

use crate::station::{Station, link, memory, word};

/// What a question needs. No question can be added without a line here.
fn needs(ask: &Ask) -> Right {
    match ask {
        Ask::Login(_)
        | Ask::Logout
        | Ask::Clock
        | Ask::Szl { .. }
        | Ask::Diagnostics(_)
        | Ask::Modules
        | Ask::Blocks
        | Ask::Block(_)
        | Ask::Events { .. }
        | Ask::NoEvents
        | Ask::Document(_)
        | Ask::Pass(_)
        | Ask::Forced
        | Ask::Forget(_)
        | Ask::Addresses { .. }
        | Ask::LogOn { .. }
        | Ask::Alarms(AlarmOrder::Query(_))
        | Ask::Debug(DebugOrder::Stack { .. }) => Right::Read,
        Ask::Point(order) => {
            let writes = order.items.iter().any(|item| matches!(item, PointItem::Write(_)));
            if order.stays || writes { Right::Operate } else { Right::Read }
        }
        Ask::Alarms(_) => Right::Write,
        Ask::Command(_)
        | Ask::SetClock(_)
        | Ask::Stage { .. }
        | Ask::Link
        | Ask::Delete(_)
        | Ask::Force(_)
        | Ask::Debug(_) => Right::Operate,
    }
}

/// One of each.
fn every_ask() -> Vec<Ask> {
    let ob1 = BlockId::new(BlockKind::Ob, 1);
    let point = |stays, items| Ask::Point(PointOrder { point: Point::Now, stays, items });
    let write = || PointItem::Write(Put::Value(memory(30), Width::Word, 7));
    let read = || PointItem::Read(Piece::Value(memory(30), Width::Word));
    let forced = Forced { area: ForcedArea::Input, bit: 8, width: Width::Byte, value: 3 };
    let pass = PassOrder { block: ob1, from: None, db: 0, first: 0, count: 4, wait: 1000, before: false };
    let mut all = vec![
        Ask::Login("wrong".into()),
        Ask::Logout,
        Ask::Clock,
        Ask::SetClock([0x26, 0x11, 0x22, 0x15, 0, 0, 0, 1]),
        Ask::Szl { id: 0x0424, index: 0 },
        Ask::Diagnostics(3),
        Ask::Modules,
        Ask::Blocks,
        Ask::Block(ob1),
        Ask::Events { after: u64::MAX },
        Ask::NoEvents,
        Ask::Document(Document::Links),
        Ask::Stage { id: ob1, bytes: Box::from([1, 2, 3]) },
        Ask::Link,
        Ask::Delete(vec![ob1]),
        Ask::Pass(pass),
        Ask::Force(vec![forced]),
        Ask::Force(Vec::new()),
        Ask::Forced,
        Ask::Debug(DebugOrder::Breakpoints(vec![Breakpoint { block: ob1, statement: 1 }])),
        Ask::Debug(DebugOrder::Hold { resume: Some(Resume::Run), wait: 1000 }),
        Ask::Debug(DebugOrder::End),
        Ask::Debug(DebugOrder::Stack { level: 0 }),
        Ask::Debug(DebugOrder::Outputs(true)),
        point(false, vec![read()]),
        point(false, vec![read(), write()]),
        point(true, vec![write()]),
        Ask::Forget(1),
        Ask::Addresses { block: ob1, wanted: vec![0] },
        Ask::LogOn { displays: Displays(Displays::ALARMS), name: "panel".into() },
        Ask::Alarms(AlarmOrder::Query(AlarmQuery::Standing)),
        Ask::Alarms(AlarmOrder::Acknowledge(vec![AlarmAck { id: 17, coming: 1, going: 1 }])),
        Ask::Alarms(AlarmOrder::Lock { ids: vec![35], locked: true }),
    ];
    all.extend(Command::ALL.map(Ask::Command));
    all
}

#[test]
fn who_may_not_operate_changes_nothing() {
    let mut random = fastrand::Rng::with_seed(34);
    for right in [Right::Read, Right::Write] {
        let mut station = Station::new(vec![link("panel", right)]);
        let mut door = station.open(0);
        for _ in 0..20 {
            let mut all = every_ask();
            random.shuffle(&mut all);
            for ask in all {
                let refused = station.ask(&mut door, random.u32(1..4), ask.clone()) == Answer::Refused(Refusal::Right);
                assert_eq!(refused, needs(&ask) > right, "{right:?}: {ask:?}");
            }
            let cpu = &mut station.cpu;
            let seen = [30, 20].map(|at| cpu.read(memory(at), Width::Word));
            assert_eq!((seen, cpu.state()), ([Ok(0); 2], ob1_cpu::OperatingState::Run));
            assert_eq!(cpu.forced().load(std::sync::atomic::Ordering::Relaxed), 0);
            assert!(station.changes.lock().expect("not poisoned").is_empty());
        }
        let written = station.write(&mut door, 1, &[word(memory(20), 1)]);
        assert_eq!(written.is_ok(), right >= Right::Write);
    }
    // With the right none of them is refused for want of one.
    let mut station = Station::new(vec![link("panel", Right::Operate)]);
    let mut door = station.open(0);
    let waits = |ask: &Ask| matches!(ask, Ask::Point(order) if order.stays);
    for ask in every_ask().into_iter().filter(|ask| !waits(ask) && !matches!(ask, Ask::Command(_) | Ask::Debug(_))) {
        assert_ne!(station.ask(&mut door, 1, ask.clone()), Answer::Refused(Refusal::Right), "{ask:?}");
    }
}
