//! The AG blocks of the CP 343, loaded as the runtime loads them, against a box written by hand.

use std::collections::BTreeMap;

use ob1_cpu::{ModuleStatus, Natives};
use ob1_host::plugin::{Plugin, PluginModule};
use ob1_model::BlockKind;
use ob1_words::boxes::{Answer, BOX_BYTES, HEAD_BYTES, Order, PIECE, Service, State, record};

use crate::support::{Cpu, Registers, find, plugin};

const LADDR: u32 = 256;
/// Places of SEND, LEN of FC 5.
const SEND: u32 = 3;
const LEN: usize = 4;
/// Place of RECV of FC 6.
const RECV: u32 = 2;
const LENGTH: u32 = 0x8185;
const RUNNING: u32 = 0x8181;
const NO_DATA: u32 = 0x8180;

/// A block, and the CP that it talks to.
struct Ag {
    cpu: Cpu,
    blocks: Natives,
    number: u16,
    params: Vec<u32>,
}

impl Ag {
    fn new(number: u16, params: Vec<u32>) -> Self {
        let mut cpu = Cpu::new();
        let status = ModuleStatus { present: true, generation: 1 };
        cpu.module = Registers { address: LADDR, status, ..Registers::default() };
        cpu.records.insert(record(0), vec![0; BOX_BYTES]);
        cpu.dbs.insert(10, (0..2000_u32).map(|n| (n / 7) as u8).collect());
        cpu.dbs.insert(11, vec![0xEE; 2000]);
        let plugin = Plugin::load(&plugin("ob1_cp343")).expect("it is ours");
        let blocks = plugin.station(&BTreeMap::new(), &[PluginModule::at(LADDR)]).expect("nothing is renumbered");
        Self { cpu, blocks, number, params }
    }

    /// AG_SEND: ACT, ID, LADDR, SEND, LEN, DONE, ERROR, STATUS.
    fn send(len: u16) -> Self {
        let mut ag = Self::new(5, vec![1, 1, LADDR, 0, len.into(), 0, 0, 0]);
        ag.point(SEND, 10, 2000);
        ag
    }

    /// AG_RECV: ID, LADDR, RECV, NDR, ERROR, STATUS, LEN.
    fn receive(len: u16) -> Self {
        let mut ag = Self::new(6, vec![1, LADDR, 0, 0, 0, 0, 0]);
        ag.point(RECV, 11, len);
        ag
    }

    /// `P#DBn.DBX 0.0 BYTE len`.
    fn point(&mut self, index: u32, db: u16, len: u16) {
        let ([len_high, len_low], [db_high, db_low]) = (len.to_be_bytes(), db.to_be_bytes());
        self.cpu.pointers.insert(index, [0x10, 2, len_high, len_low, db_high, db_low, 0x84, 0, 0, 0]);
    }

    /// One call: DONE or NDR, ERROR and STATUS.
    fn call(&mut self) -> (u32, u32, u32) {
        assert_eq!(self.cpu.call(find(&self.blocks, BlockKind::Fc, self.number), &self.params), Ok(()));
        self.params = self.cpu.params.iter().map(|value| value.expect("supplied")).collect();
        let end = if self.number == 5 { 5 } else { 3 };
        (self.params[end], self.params[end + 1], self.params[end + 2])
    }

    fn order(&self) -> Order {
        let shown = self.cpu.written[&record(0)].first_chunk::<HEAD_BYTES>();
        Order::read(shown.expect("at least a head"))
    }

    /// What the CP shows next.
    fn answers(&mut self, state: State, piece: u16, data: &[u8]) {
        let job = self.cpu.written.get(&record(0)).map_or(0, |_| self.order().job);
        let mut shown = vec![0; BOX_BYTES];
        let answer = Answer { state, job, piece, status: 0, len: data.len() as u32 };
        shown[..HEAD_BYTES].copy_from_slice(&answer.bytes());
        let bytes = &data[ob1_words::boxes::range(piece, data.len())];
        shown[HEAD_BYTES..HEAD_BYTES + bytes.len()].copy_from_slice(bytes);
        self.cpu.records.insert(record(0), shown);
    }
}

/// The CP has the length of the first call. A telegram with bytes of the piece before it instead of those of the
/// program would be "done".
#[test]
fn a_telegram_whose_length_changes_while_it_is_passed_on_is_broken_off() {
    for (len, area, end) in [
        (1000, 2000, (0, 0, RUNNING)),
        (500, 2000, (0, 1, LENGTH)),
        (1001, 2000, (0, 1, LENGTH)),
        (0, 2000, (0, 1, LENGTH)),
        (1000, 999, (0, 1, LENGTH)),
    ] {
        let mut ag = Ag::send(1000);
        assert_eq!(ag.call(), (0, 0, RUNNING));
        assert_eq!((ag.order().service, ag.order().len, ag.order().piece), (Some(Service::Send), 1000, 0));
        ag.answers(State::Collecting, 1, &[]);
        ag.params[LEN] = len;
        ag.point(SEND, 10, area);
        assert_eq!(ag.call(), end, "LEN {len} of {area}");
        if end.1 == 1 {
            assert_eq!(ag.order(), Order::NONE, "the CP drops it");
        } else {
            assert_eq!((ag.order().len, ag.order().piece), (1000, 1));
            assert_eq!(ag.cpu.written[&record(0)][HEAD_BYTES..], ag.cpu.dbs[&10][PIECE..2 * PIECE]);
        }
    }
    // Once the CP has everything, the parameters may be those of the next telegram.
    let mut ag = Ag::send(100);
    assert_eq!(ag.call(), (0, 0, RUNNING));
    ag.answers(State::Running, 1, &[]);
    ag.params[LEN] = 200;
    assert_eq!(ag.call(), (0, 0, RUNNING));
    ag.answers(State::Done, 1, &[]);
    assert_eq!(ag.call(), (1, 0, 0));
}

/// What the CP has for the program is stored, or the program is told that it is not.
#[test]
fn a_telegram_whose_room_changes_is_not_lost() {
    let data: Vec<u8> = (0..600_u32).map(|n| n as u8).collect();
    // How many pieces are stored before the room changes; the room then (0: none); the outcome of that call.
    for (before, room, end) in [
        (0, 1000, (0, 0, NO_DATA)),
        (0, 600, (0, 0, NO_DATA)),
        (0, 1200, (0, 0, NO_DATA)),
        (0, 599, (0, 1, LENGTH)),
        (0, 0, (0, 1, 0x8184)),
        (1, 1000, (1, 0, 0)),
        (1, 599, (0, 1, LENGTH)),
        (1, 0, (0, 1, 0x8184)),
    ] {
        let mut ag = Ag::receive(1000);
        assert_eq!(ag.call(), (0, 0, NO_DATA));
        let job = ag.order().job;
        for piece in 0..before {
            ag.answers(State::Giving, piece, &data);
            assert_eq!(ag.call(), (0, 0, NO_DATA));
        }
        ag.answers(State::Giving, before, &data);
        ag.point(RECV, 11, room);
        assert_eq!(ag.call(), end, "{before} pieces, then room for {room}");
        if end.2 == LENGTH {
            // The CP keeps the data for the next order, whether it sees that this one is dropped or not.
            assert_eq!(ag.order(), Order::NONE);
            assert_eq!(ag.call(), (0, 0, NO_DATA));
            let order = ag.order();
            assert_eq!((order.service, order.room, order.had), (Some(Service::Receive), room.into(), 0));
            continue;
        }
        assert_eq!(ag.order().job, job, "the CP keeps it");
        if room == 0 {
            ag.point(RECV, 11, 1000);
            ag.call();
        }
        if before == 0 {
            ag.answers(State::Giving, 1, &data);
            assert_eq!(ag.call(), (1, 0, 0));
        }
        assert_eq!(ag.cpu.dbs[&11][..601], [&data[..], &[0xEE]].concat());
    }
}

/// Memory that changes its length before there are data is told to the CP in the same order: another order could cross
/// the data. The next order says that those of the one before were taken: the CP may not have seen it.
#[test]
fn an_order_for_data_stays_the_same_until_they_have_come() {
    let mut ag = Ag::receive(100);
    assert_eq!(ag.call(), (0, 0, NO_DATA));
    let job = ag.order().job;
    for room in [200, 50, 60] {
        ag.answers(State::Running, 0, &[]);
        ag.point(RECV, 11, room);
        assert_eq!(ag.call(), (0, 0, NO_DATA));
        assert_eq!((ag.order().job, ag.order().room), (job, room.into()));
    }
    ag.answers(State::Giving, 0, &[7; 60]);
    assert_eq!(ag.call(), (1, 0, 0));
    assert_eq!((ag.order().job, ag.order().taken), (job, 1));
    assert_eq!(ag.call(), (0, 0, NO_DATA));
    assert_eq!((ag.order().job, ag.order().taken, ag.order().had), (job + 1, 0, job), "at once");
    assert_eq!(ag.cpu.dbs[&11][..61], [&[7; 60][..], &[0xEE]].concat());
}
