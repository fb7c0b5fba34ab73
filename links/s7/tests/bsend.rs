//! A BSEND between two Ethernet CPs, in virtual time: the partner's program takes a piece in each of its cycles.

use ob1_s7::coupling::{Condition, ConnectionKind, Coupling, Spec};
use ob1_s7::iso::{Event, Transport, Tsap};
use ob1_s7::server::Settings;
use ob1_words::boxes::{Answer, BOX_BYTES, HEAD_BYTES, Order, Service, State, pieces, range, status};

const BYTES: usize = 4000;

fn cp(active: bool) -> Coupling {
    let [a, b] = ["A", "B"].map(|tsap| Tsap::new(tsap.as_bytes()).expect("short"));
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

/// Two CPs with an S7 connection that is up.
fn pair() -> [Coupling; 2] {
    let mut cps = [cp(true), cp(false)];
    cps[0].connected(0, 0);
    let bytes = cps[0].output(0).to_vec();
    cps[0].sent(0, bytes.len(), 0);
    let mut call = Transport::new();
    call.receive(&bytes).expect("a call");
    assert!(matches!(call.event(), Ok(Some(Event::Call(_)))));
    cps[1].called(0, call, 0);
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
    let order = Order { service: None, job: 1, id: 1, r_id: 7, piece: 0, len: 0, taken: 0, room: 0 };
    let receives = Order { service: Some(Service::Brcv), room: BYTES as u32, ..order };
    let sends = Order { service: Some(Service::Bsend), len: BYTES as u32, ..order };
    let all = pieces(BYTES);
    for takes in [true, false] {
        let mut cps = pair();
        show(&mut cps[1], receives, &[], 1);
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
                show(&mut cps[1], Order { taken, ..receives }, &[], end - 1);
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
