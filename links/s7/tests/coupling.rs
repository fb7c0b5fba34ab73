//! Two Ethernet CPs on a bad network, in virtual time: PUT, GET, BSEND, USEND, ISO on TCP and TCP in both directions,
//! with connections that break at any moment. A job reported as done has been done, and no data arrives torn.

use std::collections::VecDeque;

use ob1_s7::Rights;
use ob1_s7::codes::ItemCode;
use ob1_s7::coupling::{Action, Condition, ConnectionKind, Coupling, Spec};
use ob1_s7::iso::{Event, Transport, Tsap};
use ob1_s7::server::{Ask, Reply, Settings};
use ob1_words::boxes::{Answer, BOX_BYTES, HEAD_BYTES, Order, Service, State, pieces, range, status};

/// Maximum transfer time of a chunk, in milliseconds.
const DELAY: u64 = 3;
const S7: usize = 0;
const ISO: usize = 1;
const TCP: usize = 2;
const UDP: usize = 3;
/// The connections over TCP.
const STREAMS: [usize; 3] = [ISO, TCP, S7];
const TCP_BYTES: usize = 700;

/// A box as a handling block uses it.
#[derive(Default)]
struct Job {
    number: u16,
    order: Option<Order>,
    data: Vec<u8>,
    came: Vec<u8>,
}

#[derive(Clone, Debug, PartialEq, Eq)]
enum End {
    Done(Vec<u8>),
    Failed(u16),
}

impl Job {
    fn block(&self, order: &Order) -> [u8; BOX_BYTES] {
        let mut block = [0; BOX_BYTES];
        block[..HEAD_BYTES].copy_from_slice(&order.bytes());
        let bytes = &self.data[range(order.piece, self.data.len())];
        block[HEAD_BYTES..HEAD_BYTES + bytes.len()].copy_from_slice(bytes);
        block
    }

    fn begin(&mut self, service: Service, id: u16, r_id: u32, data: Vec<u8>, room: u32) -> [u8; BOX_BYTES] {
        self.number = self.number.wrapping_add(1).max(1);
        (self.data, self.came) = (data, Vec::new());
        let len = self.data.len() as u32;
        let order = Order { service: Some(service), job: self.number, id, r_id, piece: 0, len, taken: 0, had: 0, room };
        self.order = Some(order);
        self.block(&order)
    }

    /// The block's next content, and how the job has ended.
    fn step(&mut self, answer: &Answer, data: &[u8]) -> (Option<[u8; BOX_BYTES]>, Option<End>) {
        let Some(mut order) = self.order.filter(|order| order.job == answer.job) else { return (None, None) };
        match answer.state {
            State::Collecting if answer.piece == order.piece + 1 => {
                order.piece = answer.piece;
                self.order = Some(order);
                (Some(self.block(&order)), None)
            }
            State::Giving if answer.piece == order.taken => {
                let piece = range(answer.piece, answer.len as usize);
                self.came.extend_from_slice(&data[..piece.len()]);
                order.taken += 1;
                self.order = Some(order);
                let mut block = [0; BOX_BYTES];
                block[..HEAD_BYTES].copy_from_slice(&order.bytes());
                let ended = order.taken >= pieces(answer.len as usize);
                if ended {
                    self.order = None;
                }
                (Some(block), ended.then(|| End::Done(std::mem::take(&mut self.came))))
            }
            State::Done => {
                self.order = None;
                (None, Some(End::Done(Vec::new())))
            }
            State::Failed => {
                self.order = None;
                (None, Some(End::Failed(answer.status)))
            }
            _ => (None, None),
        }
    }
}

/// A station: its CP, the boxes of its blocks, a data block.
struct Plc {
    machine: Coupling,
    jobs: Vec<Job>,
    memory: Vec<u8>,
}

/// Boxes, one for each block.
const PUT: usize = 0;
const GET: usize = 1;
const BSEND: usize = 2;
const BRCV: usize = 3;
const ISO_SEND: usize = 4;
const ISO_RECV: usize = 5;
const TCP_SEND: usize = 6;
const TCP_RECV: usize = 7;
const UDP_SEND: usize = 8;
const UDP_RECV: usize = 9;
const USEND: usize = 10;
const URCV: usize = 11;
const BLOCKS: usize = 12;

impl Plc {
    fn new(active: bool, rights: Rights) -> Self {
        let spec = |id, kind, tsap: &str| {
            let tsaps = [format!("{tsap}-A"), format!("{tsap}-B")].map(|t| Tsap::new(t.as_bytes()).expect("short"));
            let [a, b] = tsaps;
            let (local, remote) = if active { (a, b) } else { (b, a) };
            Spec { id, kind, active, local, remote }
        };
        let specs = vec![
            spec(1, ConnectionKind::S7, "S7"),
            spec(2, ConnectionKind::Iso, "ISO"),
            spec(3, ConnectionKind::Tcp, "TCP"),
            spec(4, ConnectionKind::Udp, "UDP"),
        ];
        let settings = Settings { rights, pdu: 480, ..Settings::default() };
        let mut machine = Coupling::new(specs, settings);
        machine.run(true);
        Self { machine, jobs: (0..BLOCKS).map(|_| Job::default()).collect(), memory: vec![0; 400] }
    }

    fn begin(&mut self, at: usize, service: Service, id: u16, data: Vec<u8>, room: u32, now: u64) {
        let block = self.jobs[at].begin(service, id, 7, data, room);
        self.machine.show(at, &block, now);
    }

    fn is_idle(&self, at: usize) -> bool {
        self.jobs[at].order.is_none()
    }

    /// Handles everything the CP has shown; returns the ends of jobs.
    fn boxes(&mut self, now: u64) -> Vec<(usize, End)> {
        let mut ends = Vec::new();
        loop {
            let Some((at, block)) = self.machine.next_box().map(|(at, block)| (at, *block)) else { return ends };
            let (head, data) = block.split_first_chunk::<HEAD_BYTES>().expect("a head");
            let (shown, end) = self.jobs[at].step(&Answer::read(head), data);
            if let Some(block) = shown {
                self.machine.show(at, &block, now);
            }
            ends.extend(end.map(|end| (at, end)));
        }
    }

    /// The CPU answers requests of partners: DB 1 exists.
    fn serve(&mut self, index: usize) {
        while let Some(request) = self.machine.next_ask(index) {
            let at = |address: &ob1_s7::wire::Address| {
                let from = address.start as usize / 8;
                from..from + address.bytes()
            };
            let reply = match request.ask {
                Ask::Read(addresses) => Reply::Values(
                    addresses
                        .iter()
                        .map(|a| self.memory.get(at(a)).map(<[u8]>::to_vec).ok_or(ItemCode::ADDRESS))
                        .collect(),
                ),
                Ask::Write(puts) => Reply::Written(
                    puts.iter()
                        .map(|put| match self.memory.get_mut(at(&put.address)) {
                            Some(place) => {
                                place.copy_from_slice(&put.bytes);
                                ItemCode::DONE
                            }
                            None => ItemCode::ADDRESS,
                        })
                        .collect(),
                ),
                _ => Reply::Done,
            };
            self.machine.reply(index, request.id, reply);
        }
    }
}

/// A TCP connection between both, or a place for one: chunks in transit to A and to B with their arrival times.
#[derive(Default)]
struct Wire {
    is_up: bool,
    /// The call that B has not received completely yet.
    front: Option<Transport>,
    to: [VecDeque<(u64, Vec<u8>)>; 2],
}

fn pattern(number: u32, len: usize) -> Vec<u8> {
    let mut bytes: Vec<u8> = (0..len).map(|at| (at as u32).wrapping_mul(31).wrapping_add(number) as u8).collect();
    let head = len.min(4);
    bytes[..head].copy_from_slice(&number.to_be_bytes()[4 - head..]);
    bytes
}

fn item(len: usize) -> Vec<u8> {
    let mut item = vec![1];
    item.extend_from_slice(&(len as u16).to_be_bytes());
    item.extend_from_slice(&[0x10, 2]);
    item.extend_from_slice(&(len as u16).to_be_bytes());
    item.extend_from_slice(&[0, 1, 0x84, 0, 0, 0]);
    item
}

/// The result of a run.
#[derive(Debug, Default, PartialEq, Eq)]
struct Tally {
    chunks: u64,
    breaks: u64,
    done: [[u64; BLOCKS]; 2],
    failed: [[u64; BLOCKS]; 2],
    /// Jobs that failed before all connections were up for the first time.
    early: u64,
}

/// Runs until this many chunks have been transferred; one connection in `odds` milliseconds breaks.
fn run(seed: u64, chunks: u64, odds: u64, rights: Rights) -> Tally {
    let mut random = fastrand::Rng::with_seed(seed);
    let mut plcs = [Plc::new(true, rights), Plc::new(false, rights)];
    let mut wires: Vec<Wire> = (0..3).map(|_| Wire::default()).collect();
    let mut tally = Tally::default();
    let mut numbers = [[0u32; BLOCKS]; 2];
    let mut sent: [[Vec<u8>; BLOCKS]; 2] = Default::default();
    // What each has received by BRCV before the other's DONE.
    let mut received: [Vec<Vec<u8>>; 2] = Default::default();
    let mut datagrams: [VecDeque<Vec<u8>>; 2] = Default::default();
    // The certain content of the partner's memory.
    let mut written: [Option<Vec<u8>>; 2] = Default::default();
    let (mut now, mut set_up) = (0, false);
    while tally.chunks < chunks {
        now += 1;
        assert!(now < 1_000_000, "nothing moves any more: {tally:?}");
        for (me, plc) in plcs.iter_mut().enumerate() {
            plc.machine.tick(now);
            for index in STREAMS {
                plc.serve(index);
            }
            while let Some(action) = plc.machine.action() {
                match action {
                    Action::Connect(index) => {
                        wires[index] = Wire { is_up: true, front: Some(Transport::new()), ..Wire::default() };
                        wires[index].to[0].push_back((now + 1 + random.u64(..DELAY), Vec::new()));
                        wires[index].to[1].push_back((now + 1 + random.u64(..DELAY), Vec::new()));
                    }
                    Action::Close(index) => wires[index].is_up = false,
                }
            }
            for index in STREAMS {
                let output = plc.machine.output(index).to_vec();
                if output.is_empty() || !wires[index].is_up {
                    continue;
                }
                let len = 1 + random.usize(..output.len());
                let due = now + 1 + random.u64(..DELAY);
                let due = wires[index].to[1 - me].back().map_or(due, |last| last.0.max(due));
                wires[index].to[1 - me].push_back((due, output[..len].to_vec()));
                plc.machine.sent(index, len, now);
            }
            while let Some(datagram) = plc.machine.datagram(UDP) {
                // One in eight is lost.
                if random.u64(..8) > 0 {
                    datagrams[1 - me].push_back(datagram);
                }
            }
        }
        for (index, wire) in wires.iter_mut().enumerate() {
            if wire.is_up && random.u64(..odds) == 0 {
                wire.is_up = false;
                tally.breaks += 1;
            }
            if !wire.is_up {
                if wire.to.iter().any(|queue| !queue.is_empty()) || wire.front.is_some() {
                    *wire = Wire::default();
                }
                for plc in &mut plcs {
                    let is_open = matches!(plc.machine.condition(index).0, Condition::Up | Condition::Coming);
                    if is_open || !plc.machine.output(index).is_empty() {
                        plc.machine.lost(index, now);
                    }
                }
                continue;
            }
            for (me, plc) in plcs.iter_mut().enumerate() {
                while wire.to[me].front().is_some_and(|(due, _)| *due <= now) {
                    let Some((_, bytes)) = wire.to[me].pop_front() else { break };
                    tally.chunks += 1;
                    if bytes.is_empty() {
                        if me == 0 || index == TCP {
                            plc.machine.connected(index, now);
                        }
                    } else if me == 1
                        && index != TCP
                        && let Some(front) = &mut wire.front
                    {
                        front.receive(&bytes).expect("a call");
                        if let Some(Event::Call(call)) = front.event().expect("ISO") {
                            assert_eq!(plc.machine.find(&call, |_| true), Some(index));
                            plc.machine.called(index, wire.front.take().expect("it is there"), now);
                        }
                    } else if plc.machine.room(index) >= bytes.len() {
                        plc.machine.receive(index, &bytes, now);
                    } else {
                        wire.to[me].push_front((now + 1, bytes));
                        break;
                    }
                }
            }
        }
        for (me, plc) in plcs.iter_mut().enumerate() {
            while let Some(datagram) = datagrams[me].pop_front() {
                plc.machine.receive(UDP, &datagram, now);
            }
        }
        set_up |= plcs.iter().all(|plc| STREAMS.iter().all(|index| plc.machine.condition(*index).0 == Condition::Up));
        let both = [plcs[0].boxes(now), plcs[1].boxes(now)];
        // Received data first: the DONE of their sender is never earlier.
        for (me, ends) in both.iter().enumerate() {
            for (at, end) in ends {
                let End::Done(bytes) = end else {
                    *if set_up { &mut tally.failed[me][*at] } else { &mut tally.early } += 1;
                    continue;
                };
                tally.done[me][*at] += 1;
                if matches!(*at, BRCV | ISO_RECV | TCP_RECV | UDP_RECV | URCV) {
                    let number = u32::from_be_bytes(*bytes.first_chunk().expect("never shorter"));
                    assert_eq!(*bytes, pattern(number, bytes.len()), "torn: {at} of {me}, seed {seed}");
                }
                if *at == BRCV {
                    received[me].push(bytes.clone());
                }
            }
        }
        for (me, ends) in both.into_iter().enumerate() {
            for (at, end) in ends {
                match (at, end) {
                    (BSEND, End::Done(_)) => {
                        let last = received[1 - me].last();
                        assert_eq!(last, Some(&sent[me][BSEND]), "DONE, but the partner has other data; seed {seed}");
                    }
                    (PUT, End::Done(_)) => written[me] = Some(sent[me][PUT].clone()),
                    (GET, End::Done(bytes)) => assert_eq!(Some(bytes), written[me].take(), "seed {seed}"),
                    (PUT, End::Failed(status::REMOTE)) => assert!(rights < Rights::Write, "seed {seed}"),
                    (BSEND | PUT | GET | USEND, End::Failed(why)) => assert!(
                        [status::CONNECTION, status::R_ID, status::DISABLED, status::REFUSED].contains(&why),
                        "{at}: {why}"
                    ),
                    (ISO_SEND | TCP_SEND, End::Failed(why)) => assert_eq!(why, status::NOT_CONNECTED),
                    (URCV, End::Failed(why)) => assert_eq!(why, status::OVERRUN),
                    (BRCV | ISO_RECV | TCP_RECV | UDP_RECV | UDP_SEND, End::Failed(why)) => panic!("{at}: {why:04X}"),
                    _ => {}
                }
            }
            let plc = &mut plcs[me];
            // Receiving jobs wait at once; sending jobs begin after a while.
            for (at, service, id, room) in [
                (BRCV, Service::Brcv, 1, 4000),
                (ISO_RECV, Service::Receive, 2, 2000),
                (TCP_RECV, Service::Receive, 3, TCP_BYTES),
                (UDP_RECV, Service::Receive, 4, 2000),
            ] {
                if plc.is_idle(at) {
                    plc.begin(at, service, id, Vec::new(), room as u32, now);
                }
            }
            if plc.is_idle(URCV) {
                plc.begin(URCV, Service::Urcv, 1, vec![1, 0, 100], 100, now);
            }
            let at = [BSEND, ISO_SEND, TCP_SEND, UDP_SEND, USEND, PUT][random.usize(..6)];
            if !plc.is_idle(at) || at == PUT && !plc.is_idle(GET) {
                continue;
            }
            numbers[me][at] += 1;
            let number = numbers[me][at];
            let (service, id, data) = match at {
                BSEND => (Service::Bsend, 1, pattern(number, 4 + random.usize(..3000))),
                ISO_SEND => (Service::Send, 2, pattern(number, 4 + random.usize(..1500))),
                TCP_SEND => (Service::Send, 3, pattern(number, TCP_BYTES)),
                UDP_SEND => (Service::Send, 4, pattern(number, 4 + random.usize(..1500))),
                USEND => (Service::Usend, 1, [&[1, 0, 100][..], &pattern(number, 100)].concat()),
                _ if written[me].is_some() => (Service::Get, 1, item(160)),
                _ => (Service::Put, 1, pattern(number, 160)),
            };
            // Only one side writes into the other's block, so it reads back what it has written.
            if at == PUT {
                if service == Service::Get {
                    plc.begin(GET, Service::Get, id, data, 160, now);
                } else {
                    sent[me][PUT] = data.clone();
                    plc.begin(PUT, Service::Put, id, [item(160), data].concat(), 8, now);
                }
            } else {
                sent[me][at] = data.clone();
                plc.begin(at, service, id, data, 8, now);
            }
        }
    }
    let is_touched = plcs.iter().any(|plc| plc.memory.iter().any(|byte| *byte != 0));
    assert_eq!(is_touched, rights >= Rights::Write, "memory of the partner");
    tally
}

#[test]
fn on_a_good_network_nothing_fails() {
    let tally = run(1, 20_000, u64::MAX, Rights::Write);
    assert_eq!(tally.breaks, 0);
    for (me, done) in tally.done.iter().enumerate() {
        for (at, done) in done.iter().enumerate() {
            assert!(*done > 20, "block {at} of {me}: {tally:?}");
        }
    }
    // A job may come before everything is set up; later none fails. Only with URCV can older data be overwritten.
    let failed: u64 = tally.failed.iter().flat_map(|failed| failed.iter().take(URCV)).sum();
    assert_eq!(failed, 0, "{tally:?}");
}

#[test]
fn a_partner_without_the_right_puts_nothing_and_has_the_rest() {
    let tally = run(3, 5_000, u64::MAX, Rights::Read);
    for (done, failed) in tally.done.iter().zip(&tally.failed) {
        assert!(done[PUT] == 0 && failed[PUT] > 20 && done[BSEND] > 20 && done[URCV] > 20, "{tally:?}");
    }
}

#[test]
fn what_is_done_has_been_done_whatever_breaks() {
    for seed in 1..=8 {
        let tally = run(seed * 7919, 10_000, 400, Rights::Write);
        assert!(tally.breaks > 10 && tally.failed[0][BSEND] > 0, "{tally:?}");
        assert!(tally.done.iter().all(|done| done.iter().all(|count| *count > 0)), "{tally:?}");
        if seed == 1 {
            assert_eq!(tally, run(seed * 7919, 10_000, 400, Rights::Write), "the same seed, the same run");
        }
    }
}

/// A call of A as it reaches B, with nothing after it.
fn call() -> Transport {
    let (mut caller, mut front) = (Transport::new(), Transport::new());
    let [a, b] = ["ISO-A", "ISO-B"].map(|tsap| Tsap::new(tsap.as_bytes()).expect("short"));
    caller.call(a, b);
    front.receive(caller.output()).expect("a call");
    assert!(matches!(front.event(), Ok(Some(Event::Call(_)))));
    front
}

/// A connection has to be closed, but before that happens another one has replaced it. A close would then close the new
/// one, which the machine takes to be up.
#[test]
fn what_comes_in_the_place_of_a_connection_is_not_closed_for_it() {
    let reset = vec![0, 2];
    for (index, id) in [(ISO, 2), (TCP, 3)] {
        for another in [true, false] {
            let mut plc = Plc::new(false, Rights::Write);
            let comes = |plc: &mut Plc| match index {
                ISO => plc.machine.called(ISO, call(), 1),
                _ => plc.machine.connected(index, 1),
            };
            comes(&mut plc);
            assert_eq!(plc.machine.condition(index).0, Condition::Up);
            match index {
                // Not a telegram of ISO on TCP.
                ISO => plc.machine.receive(ISO, &[0xFF; 8], 2),
                _ => plc.begin(ISO_SEND, Service::Control, id, reset.clone(), 8, 2),
            }
            assert_eq!(plc.machine.condition(index).0, Condition::Down, "{index}");
            if another {
                comes(&mut plc);
            }
            let condition = if another { Condition::Up } else { Condition::Down };
            let action = (!another).then_some(Action::Close(index));
            assert_eq!((plc.machine.condition(index).0, plc.machine.action()), (condition, action), "{index}");
        }
    }
}

/// A CP with an ISO and a TCP connection that are up, and what its partner has sent.
fn up(index: usize) -> (Plc, Transport) {
    let (mut plc, mut partner) = (Plc::new(index == TCP, Rights::Write), Transport::new());
    if index == TCP {
        plc.machine.connected(TCP, 1);
        return (plc, partner);
    }
    let [a, b] = ["ISO-A", "ISO-B"].map(|tsap| Tsap::new(tsap.as_bytes()).expect("short"));
    partner.call(a, b);
    plc.machine.called(ISO, call(), 1);
    partner.sent(partner.output().len());
    partner.receive(plc.machine.output(ISO)).expect("the confirmation");
    assert!(matches!(partner.event(), Ok(Some(Event::Open))));
    (plc, partner)
}

/// Data of the partner for the connection.
fn comes(plc: &mut Plc, partner: &mut Transport, index: usize, data: &[u8]) {
    if index == TCP {
        return plc.machine.receive(TCP, data, 2);
    }
    partner.send(data);
    let bytes = partner.output().to_vec();
    partner.sent(bytes.len());
    plc.machine.receive(ISO, &bytes, 2);
}

/// AG_RECV takes some of the pieces, then the CPU drops it: its memory has become too short. The next one gets
/// everything, and what follows.
#[test]
fn data_that_were_not_taken_completely_are_given_again() {
    for (index, at, id) in [(ISO, ISO_RECV, 2), (TCP, TCP_RECV, 3)] {
        for again in 0..2 {
            let (mut plc, mut partner) = up(index);
            let (first, second) = (pattern(1, TCP_BYTES), pattern(2, TCP_BYTES));
            comes(&mut plc, &mut partner, index, &first);
            comes(&mut plc, &mut partner, index, &second);
            plc.begin(at, Service::Receive, id, Vec::new(), TCP_BYTES as u32, 3);
            // Two pieces: the first is taken once, or not at all.
            for _ in 0..again {
                let (box_, block) = plc.machine.next_box().map(|(at, block)| (at, *block)).expect("it gives");
                let (head, data) = block.split_first_chunk::<HEAD_BYTES>().expect("a head");
                let (shown, end) = plc.jobs[box_].step(&Answer::read(head), data);
                assert_eq!(end, None, "one of two pieces");
                plc.machine.show(box_, &shown.expect("taken"), 3);
            }
            plc.machine.show(at, &[0; BOX_BYTES], 4);
            for whole in [first, second] {
                plc.begin(at, Service::Receive, id, Vec::new(), TCP_BYTES as u32, 5);
                assert_eq!(plc.boxes(5), [(at, End::Done(whole))], "{index}, after {again} pieces");
            }
        }
    }
}

/// Bytes of a stream belong to their connection: those of a connection that is gone do not get in front of others.
#[test]
fn dropped_data_of_a_connection_that_is_gone_do_not_come_on_the_next_one() {
    for late in [false, true] {
        let (mut plc, mut partner) = up(TCP);
        comes(&mut plc, &mut partner, TCP, &pattern(1, TCP_BYTES));
        plc.begin(TCP_RECV, Service::Receive, 3, Vec::new(), TCP_BYTES as u32, 3);
        plc.machine.lost(TCP, 3);
        if late {
            plc.machine.connected(TCP, 4);
        }
        plc.machine.show(TCP_RECV, &[0; BOX_BYTES], 4);
        if !late {
            plc.machine.connected(TCP, 4);
        }
        comes(&mut plc, &mut partner, TCP, &pattern(2, TCP_BYTES));
        plc.begin(TCP_RECV, Service::Receive, 3, Vec::new(), TCP_BYTES as u32, 5);
        assert_eq!(plc.boxes(5), [(TCP_RECV, End::Done(pattern(2, TCP_BYTES)))]);
    }
}

/// The memory of an AG_RECV that waits changes its length: the order stays, and the new length decides how many bytes
/// are given.
#[test]
fn an_order_for_data_follows_the_length_of_the_memory() {
    let (mut plc, mut partner) = up(TCP);
    plc.begin(TCP_RECV, Service::Receive, 3, Vec::new(), 100, 3);
    comes(&mut plc, &mut partner, TCP, &pattern(1, 60));
    assert_eq!(plc.boxes(3), [], "not all of them");
    let order = plc.jobs[TCP_RECV].order.as_mut().expect("it waits");
    order.room = 60;
    let block = plc.jobs[TCP_RECV].block(&plc.jobs[TCP_RECV].order.expect("it waits"));
    plc.machine.show(TCP_RECV, &block, 4);
    assert_eq!(plc.boxes(4), [(TCP_RECV, End::Done(pattern(1, 60)))]);
}
