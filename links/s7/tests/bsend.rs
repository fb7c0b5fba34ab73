//! BSEND to an Ethernet CP, in virtual time: from another one whose program takes a piece in each of its cycles, and
//! from a partner of another make.

use ob1_s7::codes::Code;
use ob1_s7::coupling::{Condition, ConnectionKind, Coupling, Spec};
use ob1_s7::iso::{Event, Transport, Tsap};
use ob1_s7::server::{Connection, Settings};
use ob1_s7::wire::{Kind, UserData, pbc};
use ob1_words::boxes::{Answer, BOX_BYTES, HEAD_BYTES, Order, Service, State, pieces, range, status};

const BYTES: usize = 4000;

/// The fields that BSEND and BRCV have in common.
const ORDER: Order = Order { service: None, job: 1, id: 1, r_id: 7, piece: 0, len: 0, taken: 0, had: 0, room: 0 };
/// A BRCV with room.
const RECEIVES: Order = Order { service: Some(Service::Brcv), room: BYTES as u32, ..ORDER };

fn tsaps() -> [Tsap; 2] {
    ["A", "B"].map(|tsap| Tsap::new(tsap.as_bytes()).expect("short"))
}

fn cp(active: bool) -> Coupling {
    let [a, b] = tsaps();
    let (local, remote) = if active { (a, b) } else { (b, a) };
    let spec = Spec { id: 1, kind: ConnectionKind::S7, active, local, remote };
    let mut cp = Coupling::new(vec![spec], Settings::default());
    cp.run(true);
    cp
}

/// Moves everything that both have to send.
fn carry(cps: &mut [Coupling; 2], now: u64) {
    let mut moved = true;
    while std::mem::take(&mut moved) {
        for (from, to) in [(0, 1), (1, 0)] {
            let bytes = cps[from].output(0).to_vec();
            cps[from].sent(0, bytes.len(), now);
            cps[to].receive(0, &bytes, now);
            moved |= !bytes.is_empty();
        }
    }
}

/// A call as it has come.
fn call(bytes: &[u8]) -> Transport {
    let mut call = Transport::new();
    call.receive(bytes).expect("there is room");
    assert!(matches!(call.event(), Ok(Some(Event::Call(_)))));
    call
}

/// Two CPs with an S7 connection that is up.
fn pair() -> [Coupling; 2] {
    let mut cps = [cp(true), cp(false)];
    cps[0].connected(0, 0);
    let bytes = cps[0].output(0).to_vec();
    cps[0].sent(0, bytes.len(), 0);
    cps[1].called(0, call(&bytes), 0);
    carry(&mut cps, 0);
    assert!(cps.iter().all(|cp| cp.condition(0).0 == Condition::Up));
    cps
}

/// The CPU's content of box 0.
fn show(cp: &mut Coupling, order: Order, data: &[u8], now: u64) {
    let mut block = [0; BOX_BYTES];
    block[..HEAD_BYTES].copy_from_slice(&order.bytes());
    let piece = &data[range(order.piece, data.len())];
    block[HEAD_BYTES..HEAD_BYTES + piece.len()].copy_from_slice(piece);
    cp.show(0, &block, now);
}

/// What the CP shows there.
fn shown(cp: &mut Coupling) -> Answer {
    let (_, block) = cp.next_box().expect("something new");
    Answer::read(block.first_chunk::<HEAD_BYTES>().expect("a head"))
}

/// The answer to the last part comes when the program has all pieces. A second is allowed for each, beyond the ten
/// seconds of every job; then the connection is given up.
#[test]
fn a_slow_program_has_a_second_for_each_piece() {
    let data: Vec<u8> = (0..BYTES).map(|at| at as u8).collect();
    let sends = Order { service: Some(Service::Bsend), len: BYTES as u32, ..ORDER };
    let all = pieces(BYTES);
    for takes in [true, false] {
        let mut cps = pair();
        show(&mut cps[1], RECEIVES, &[], 1);
        for piece in 0..all {
            show(&mut cps[0], Order { piece, ..sends }, &data, 1);
        }
        carry(&mut cps, 1);
        assert_eq!([shown(&mut cps[0]).state, shown(&mut cps[1]).state], [State::Running, State::Giving]);
        let end = 1 + 10_000 + 1_000 * u64::from(all);
        cps[0].tick(end - 1);
        assert_eq!(cps[0].condition(0).0, Condition::Up);
        if takes {
            for taken in 1..=all {
                show(&mut cps[1], Order { taken, ..RECEIVES }, &[], end - 1);
            }
            carry(&mut cps, end - 1);
            assert_eq!(shown(&mut cps[0]).state, State::Done);
        } else {
            cps[0].tick(end);
            let answer = shown(&mut cps[0]);
            assert_eq!((answer.state, answer.status), (State::Failed, status::CONNECTION));
            assert_eq!(cps[0].condition(0).0, Condition::Down);
        }
    }
}

/// A partner of another make, its connection to the CP, and its BSENDs of three parts.
struct Partner {
    connection: Connection,
    cp: Coupling,
}

/// Bytes of a part.
const PART: usize = 300;

impl Partner {
    fn new() -> Self {
        let ([a, b], mut cp) = (tsaps(), cp(false));
        let mut connection = Connection::calling(Settings::default(), a, b);
        let bytes = connection.output().to_vec();
        connection.sent(bytes.len());
        cp.called(0, call(&bytes), 0);
        let mut partner = Self { connection, cp };
        partner.carry();
        partner
    }

    fn carry(&mut self) {
        loop {
            let (to, from) = (self.connection.output().to_vec(), self.cp.output(0).to_vec());
            if to.is_empty() && from.is_empty() {
                return;
            }
            self.connection.sent(to.len());
            self.cp.receive(0, &to, 1);
            self.cp.sent(0, from.len(), 1);
            self.connection.receive(&from);
        }
    }

    /// Sends a part under this count; its answer, if it has come.
    fn send(&mut self, index: usize, unit: u8) -> Option<Code> {
        let total = (index == 0).then_some(3 * PART as u16);
        let (parameters, data) = pbc::part(7, unit, index < 2, total, &[index as u8; PART]);
        self.connection.own_job(Kind::UserData, &parameters, &data);
        self.answer()
    }

    fn answer(&mut self) -> Option<Code> {
        self.carry();
        let came = self.connection.take_came()?;
        UserData::read(&came.parameters, &came.data).map(|answer| answer.error)
    }

    /// BRCV takes everything; the answer to the last part.
    fn takes(&mut self, order: Order) -> Option<Code> {
        assert_eq!(shown(&mut self.cp).state, State::Giving);
        for taken in 1..=pieces(3 * PART) {
            show(&mut self.cp, Order { taken, ..order }, &[], 1);
        }
        self.answer()
    }
}

/// snap7's partner counts its parts on and on: over all BSENDs, those of one part too, and over its own answers.
#[test]
fn parts_are_counted_as_the_sender_likes() {
    let mut partner = Partner::new();
    let counts = [[1, 2, 3], [4, 5, 6], [9, 11, 14], [253, 254, 1], [2, 3, 4], [1, 2, 3]];
    for (job, units) in (1..).zip(counts) {
        let order = Order { job, ..RECEIVES };
        show(&mut partner.cp, order, &[], 1);
        let answers = [0, 1, 2].map(|index| partner.send(index, units[index]));
        assert_eq!(answers, [Some(Code::DONE), Some(Code::DONE), None], "{units:?}");
        assert_eq!(partner.takes(order), Some(Code::DONE), "{units:?}");
    }
}

/// The program has everything and shows its next job, drops its block or stops, before the CP has seen that: the sender
/// hears that it has arrived. (`D240h` is for a program that has not taken everything.)
#[test]
fn what_the_program_has_is_confirmed_whatever_it_shows_next() {
    let all = pieces(3 * PART);
    let next = Order { job: 2, ..RECEIVES };
    let had = |order: Order| Order { had: 1, ..order };
    let (has, refused) = (Some(Code::DONE), Some(Code::COORDINATION));
    for (shows, answer) in [
        (Order { taken: all, ..RECEIVES }, has),
        (had(next), has),
        (had(Order { service: Some(Service::Lock), ..next }), has),
        (had(Order::NONE), has),
        (next, refused),
        (Order { had: 7, ..next }, refused),
        (Order::NONE, refused),
        (Order { taken: all - 1, ..RECEIVES }, None),
    ] {
        let mut partner = Partner::new();
        show(&mut partner.cp, RECEIVES, &[], 1);
        let answers = [0, 1, 2].map(|index| partner.send(index, index as u8 + 1));
        assert_eq!(answers, [has, has, None]);
        show(&mut partner.cp, shows, &[], 1);
        assert_eq!(partner.answer(), answer, "{shows:?}");
        // In STOP there is nobody who could take the rest.
        partner.cp.run(false);
        assert_eq!(partner.answer(), if answer.is_none() { refused } else { None }, "{shows:?}");
    }
}

/// The middle of a BSEND is not the beginning of another one, whatever becomes of its BRCV.
#[test]
fn a_brcv_that_comes_in_the_middle_takes_nothing() {
    let mut partner = Partner::new();
    show(&mut partner.cp, RECEIVES, &[], 1);
    assert_eq!(partner.send(0, 5), Some(Code::DONE));
    show(&mut partner.cp, Order::NONE, &[], 1);
    let order = Order { job: 2, ..RECEIVES };
    show(&mut partner.cp, order, &[], 1);
    assert_eq!(partner.send(1, 6), Some(Code::SERVICE));
    // The sender begins again.
    let answers = [0, 1, 2].map(|index| partner.send(index, 7 + index as u8));
    assert_eq!(answers, [Some(Code::DONE), Some(Code::DONE), None]);
    assert_eq!(partner.takes(order), Some(Code::DONE));
}
