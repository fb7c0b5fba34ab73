//! Each rule sees its breach: a broken record, or a partner that has not got what was said to be done.

mod receptions;
mod rk512_orders;

use ob1_cpu::{Cell, Cpu, CpuConfig, OperatingState, Width};
use ob1_stl::{Library, Mnemonics, Options, Source};
use ob1_time::{Instant, Span};

use super::{Bench240, modem, receive, rk512, send, serve as fc4};
use crate::compare::random::Random;
use crate::programs::cp240::blocks::{ALL_RK, MODEM, RECEIVE, SEND, SEND_RK, SYNCHRON};
use crate::programs::cp240::{Facts, Partner240, Protocol, Receiver, Role, Sender, Times};
use crate::programs::judge::{Judge as _, Scan, Verdict};
use crate::programs::partner::rk512::{Order, Request};
use crate::programs::partner::{Manners, Pace, Sent, Taken, letters, telegram};
use crate::programs::record::Call;
use crate::programs::run::Deed;
use crate::programs::text::{Block, Operand, Site, Type};
use crate::sim::{MS, SECOND};

/// Number of the first telegram that the judge gives.
const FIRST: u32 = 1;
const CYCLE: Span = Span::from_millis(2);

struct Rig {
    judge: Bench240,
    partner: Partner240,
    cpu: Cpu,
    sites: Vec<Site>,
    verdict: Verdict,
    now: Instant,
}

fn site(block: &'static Block) -> Site {
    let operands = block.parameters.iter().map(|_| Operand::Memory(100, 0)).collect();
    Site::call(block, operands)
}

fn times() -> Times {
    Times { char: MS / 10, zna: Span::ZERO, zvz: 40 * MS, qvz: 40 * MS, bwz: 100 * MS, stx: 1, dbl: 1, cycle: CYCLE }
}

impl Rig {
    fn new(protocol: Protocol) -> Self {
        let sites = vec![
            Site::mark(vec![(Operand::Memory(240, 0), Type::Dword), (Operand::Memory(2, 4), Type::Bool)]),
            site(&SEND),
            site(&RECEIVE),
            site(&MODEM),
            site(&SYNCHRON),
            site(&SEND_RK),
            site(&ALL_RK),
        ];
        let one = if protocol == Protocol::Rk512 { Role::SendRk(0) } else { Role::Send(0) };
        let other = if protocol == Protocol::Rk512 { Role::Send(1) } else { Role::SendRk(1) };
        let mut roles = vec![Role::Feed(0), one, Role::Receive, Role::Modem, Role::Synchron, other, Role::Serve];
        if protocol == Protocol::Rk512 {
            roles.swap(1, 5);
        }
        let facts = Facts {
            protocol,
            times: times(),
            roles,
            senders: vec![Sender { blocks: vec![(10, 100)], abd: 0, next: 240 }],
            receiver: Receiver { block: (40, 100), abd: 0, calls: 1 },
            wired: true,
            waits_for_anl: true,
            calm: Instant::START,
            plain: !protocol.acknowledges(),
            echo: false,
            served: vec![(60, 100)],
        };
        let pace = Pace { char: MS / 10, qvz: 40 * MS, zvz: 20 * MS };
        let partner = match protocol {
            Protocol::Rk512 => Partner240::rk512(false, Manners::GOOD, pace, 100 * MS, Random::new(1)),
            Protocol::P3964R => Partner240::procedure(true, false, Manners::GOOD, pace, Random::new(1)),
            _ => Partner240::stream(false, times(), None, false),
        };
        let block = |db: u16| {
            format!("DATA_BLOCK DB {db}\nSTRUCT\nD : ARRAY [1..100] OF BYTE;\nEND_STRUCT\nBEGIN\nEND_DATA_BLOCK\n")
        };
        let text: String = [10, 40, 60].map(block).concat();
        let options = Options { mnemonics: Mnemonics::German, ..Options::default() };
        let output = ob1_stl::compile(&[Source::new("blocks.awl", text.as_bytes())], &Library::new(), &options);
        let config = CpuConfig { memory_bytes: 1024, ..CpuConfig::default() };
        let cpu = Cpu::new(config, &output.program, Vec::new(), Vec::new(), ob1_cpu::engine::REFERENCE);
        let cpu = cpu.expect("three data blocks");
        let judge = Bench240::new(facts);
        let mut rig = Self { judge, partner, cpu, sites, verdict: Verdict::default(), now: Instant::START + SECOND };
        rig.scan(&[]);
        rig
    }

    fn scan(&mut self, calls: &[(usize, Vec<u32>, Vec<u32>)]) {
        self.now += CYCLE;
        let calls: Vec<Call> = calls
            .iter()
            .map(|(site, before, after)| Call {
                site: *site,
                before: before.clone(),
                after: after.clone(),
                at: self.now,
            })
            .collect();
        let scan = Scan { now: self.now, calls: &calls, sites: &self.sites, state: OperatingState::Run };
        self.judge.scan(&scan, &mut self.cpu, &mut self.partner, &mut self.verdict);
    }

    /// One call with the given parameters before and after it.
    fn call(&mut self, site: usize, before: &[(usize, u32)], after: &[(usize, u32)]) {
        let len = self.sites[site].block.map_or(0, |block| block.parameters.len()) + 1;
        let values = |set: &[(usize, u32)]| {
            let mut values = vec![0; len];
            set.iter().for_each(|(at, value)| values[*at] = *value);
            values
        };
        self.scan(&[(site, values(before), values(after))]);
    }

    fn feed(&mut self) {
        let number = u32::from_be_bytes(letters(FIRST));
        self.scan(&[(0, Vec::new(), vec![number, 0])]);
    }

    /// The program gives an order to FC 0, which takes it.
    fn send(&mut self) {
        self.feed();
        self.fc0(1, 0);
    }

    fn fc0(&mut self, frg: u32, error: u32) {
        let anz = (send::LENGTH, 12);
        self.call(1, &[(send::FRG, 1), anz], &[(send::FRG, frg), (send::FEHLER_KOM, error), anz]);
    }

    fn takes(&mut self, data: Vec<u8>) {
        let taken = Taken { at: self.now, data, told: true };
        if let Partner240::Procedure(line, _) = &mut self.partner {
            line.took.push(taken);
        }
    }

    fn sends(&mut self, data: &[u8]) {
        let sent = Sent { data: data.to_vec(), begun: self.now, acknowledged: Some(self.now), attempts: 1 };
        match &mut self.partner {
            Partner240::Procedure(line, _) => line.sent.push(sent),
            Partner240::Rk512(rk, _) => rk.line.sent.push(sent),
            Partner240::Stream(stream, _) => stream.sent.push(sent),
        }
    }

    /// FC 1 gives this telegram to the program.
    fn gives(&mut self, data: &[u8]) {
        for (at, byte) in (0..).zip(data) {
            self.cpu.write(Cell::Db(40, 8 * at), Width::Byte, u32::from(*byte)).expect("DB 40");
        }
        self.call(2, &[], &[(receive::EMFR, 1), (receive::ANZ, data.len() as u32)]);
    }

    /// FC 3 with ANZW before and after.
    fn fc3(&mut self, before: u32, after: u32, pafe: u32) {
        let lang = (rk512::LANG, 6);
        let site = self.judge.facts.roles.iter().position(|role| *role == Role::SendRk(0)).expect("FC 3");
        self.sites[site] = site_of_fc3();
        let values = |anzw: u32| [lang, (rk512::ANZW, anzw), (rk512::PAFE, pafe), (13, anzw >> 1 & 1)];
        self.call(site, &values(before), &values(after));
    }

    fn order_comes(&mut self, done: bool) {
        let Partner240::Rk512(rk, _) = &mut self.partner else { return };
        rk.orders.push(Order {
            at: self.now,
            command: b'A',
            target: (21, 0),
            words: 6,
            data: telegram(FIRST, 12, false),
            done: done.then_some(self.now),
            refused: None,
            unclear: false,
            reaction: rk.line.sent.len(),
        });
        self.sends(&[0, 0, 0, 0]);
    }

    fn sees(&self, rule: &str) {
        assert!(self.verdict.has(rule), "{rule}: {:?}", self.verdict.findings);
    }

    fn sees_only(&self, rule: &str) {
        self.sees(rule);
        assert!(self.verdict.findings.iter().all(|finding| finding.rule == rule), "{:?}", self.verdict.findings);
    }

    fn sees_nothing(&self) {
        assert_eq!(self.verdict.findings, []);
    }

    fn end(&mut self) {
        self.judge.end(self.now, &mut self.partner, &mut self.verdict);
    }
}

fn site_of_fc3() -> Site {
    site(&SEND_RK)
}

fn expected() -> Vec<u8> {
    telegram(FIRST, 12, false)
}

#[test]
fn an_order_that_arrives_and_ends_is_good() {
    let mut rig = Rig::new(Protocol::P3964R);
    rig.send();
    rig.takes(expected());
    rig.fc0(0, 0);
    rig.end();
    rig.sees_nothing();
    assert_eq!(rig.verdict.counts, [1, 1, 0, 0]);
}

#[test]
fn fc0_changes_something_without_frg() {
    let mut rig = Rig::new(Protocol::P3964R);
    rig.call(1, &[], &[(send::PAFE, 1)]);
    rig.sees_only("fc0-idle");
}

#[test]
fn fc0_does_not_see_a_short_block() {
    let mut rig = Rig::new(Protocol::P3964R);
    rig.feed();
    let long = (send::LENGTH, 101);
    rig.call(1, &[(send::FRG, 1), long], &[(send::FRG, 1), long]);
    rig.sees_only("fc0-pafe");
}

#[test]
fn fc0_never_ends() {
    let mut rig = Rig::new(Protocol::P3964R);
    rig.send();
    (0..600).for_each(|_| rig.fc0(1, 0));
    rig.sees_only("fc0-live");
}

/// The job that runs is the long one, whatever the program writes to ANZ meanwhile.
#[test]
fn anz_is_changed_while_a_long_telegram_runs() {
    let run = |scans: u32| {
        let mut rig = Rig::new(Protocol::P3964R);
        rig.feed();
        let call = |rig: &mut Rig, anz: u32| {
            let anz = (send::LENGTH, anz);
            rig.call(1, &[(send::FRG, 1), anz], &[(send::FRG, 1), anz]);
        };
        call(&mut rig, 100);
        (1..scans).for_each(|_| call(&mut rig, 5));
        rig
    };
    // 5 bytes would have to be out after 170 scans.
    run(200).sees_nothing();
    run(300).sees_only("fc0-live");
}

/// The other FC 0 is called every 46 ms: 40 calls for its 477 bytes come first, but not more than that.
#[test]
fn fc0_waits_for_one_that_is_called_seldom() {
    let run = |turns: u32| {
        let mut rig = Rig::new(Protocol::P3964R);
        rig.judge.facts.senders.push(Sender { blocks: vec![(10, 477)], abd: 0, next: 244 });
        rig.judge.facts.roles[5] = Role::Send(1);
        rig.sites[5] = site(&SEND);
        rig.judge.senders.push(send::Job::default());
        rig.send();
        for _ in 0..turns {
            let values = [(send::FRG, 1), (send::LENGTH, 477)];
            rig.call(5, &values, &values);
            (1..23).for_each(|_| rig.fc0(1, 0));
        }
        rig
    };
    run(45).sees_nothing();
    let seen = run(400).verdict;
    assert!(seen.findings.iter().any(|finding| finding.text.contains("12 bytes")), "{:?}", seen.findings);
}

/// Each pause in which it is not called does not count, but the calls do.
#[test]
fn fc0_that_is_not_called_may_wait() {
    let mut rig = Rig::new(Protocol::P3964R);
    rig.send();
    for _ in 0..10 {
        rig.now += SECOND;
        rig.fc0(1, 0);
    }
    rig.sees_nothing();
}

#[test]
fn fc0_says_done_and_nothing_came() {
    let mut rig = Rig::new(Protocol::P3964R);
    rig.send();
    rig.fc0(0, 0);
    rig.sees_only("fc0-false-done");
    let mut rig = Rig::new(Protocol::Ascii);
    rig.send();
    rig.fc0(0, 0);
    rig.sees_only("fc0-false-done");
}

/// The check character is the same without them, so the partner has acknowledged what is left.
#[test]
fn a_bad_line_has_taken_two_equal_characters() {
    let run = |data: Vec<u8>, calm: bool| {
        let mut rig = Rig::new(Protocol::P3964R);
        rig.judge.seen.strict = if calm { Instant::START } else { Instant::NEVER };
        rig.send();
        rig.takes(data);
        rig.fc0(0, 0);
        rig
    };
    let whole = expected();
    assert_eq!(whole[0], whole[1]);
    run(whole[2..].to_vec(), false).sees_nothing();
    run(whole[1..].to_vec(), false).sees_only("fc0-false-done");
    run(whole[2..].to_vec(), true).sees_only("fc0-false-done");
}

/// Its DLE comes so late that the order after it has it.
#[test]
fn a_late_line_has_acknowledged_the_order_before() {
    let run = |late: bool, calm: bool| {
        let mut rig = Rig::new(Protocol::P3964R);
        rig.judge.seen.strict = if calm { Instant::START } else { Instant::NEVER };
        rig.send();
        rig.fc0(0, 1);
        rig.verdict.findings.clear();
        rig.scan(&[(0, Vec::new(), vec![u32::from_be_bytes(letters(FIRST + 1)), 0])]);
        rig.fc0(1, 0);
        if late {
            rig.takes(expected());
        }
        rig.fc0(0, 0);
        rig
    };
    run(true, false).sees_nothing();
    run(false, false).sees_only("fc0-false-done");
    run(true, true).sees("fc0-false-done");
}

/// One DLE is for its STX. That for another STX comes when the block is out.
#[test]
fn a_late_line_has_agreed_twice() {
    let run = |agreed: usize, calm: bool| {
        let mut rig = Rig::new(Protocol::P3964R);
        rig.judge.seen.strict = if calm { Instant::START } else { Instant::NEVER };
        rig.send();
        if let Partner240::Procedure(line, _) = &mut rig.partner {
            line.agreed = vec![rig.now; agreed];
        }
        rig.fc0(0, 0);
        rig
    };
    run(2, false).sees_nothing();
    run(1, false).sees_only("fc0-false-done");
    run(2, true).sees_only("fc0-false-done");
}

/// FC 9 has cleared FRG together with the control bits: for the program the order is done.
#[test]
fn frg_vanishes() {
    let mut rig = Rig::new(Protocol::P3964R);
    rig.send();
    rig.call(1, &[], &[]);
    rig.sees_only("fc0-false-done");
}

#[test]
fn fc0_says_error_and_it_was_acknowledged() {
    let mut rig = Rig::new(Protocol::P3964R);
    rig.send();
    rig.takes(expected());
    rig.fc0(0, 1);
    rig.sees_only("fc0-false-error");
}

#[test]
fn fc0_fails_for_no_reason() {
    let mut rig = Rig::new(Protocol::P3964R);
    rig.send();
    rig.fc0(0, 1);
    rig.sees_only("fc0-no-reason");
    // With a reason: a RESET in the middle.
    let mut rig = Rig::new(Protocol::P3964R);
    rig.send();
    rig.call(4, &[(modem::RESET, 1)], &[(modem::RESET, 1)]);
    rig.fc0(0, 1);
    rig.sees_nothing();
}

/// FC 8 has asked while FC 0 was not called, and has its turn after two seconds.
#[test]
fn fc0_fails_after_a_rest() {
    for (rest, modem, finds) in [(SECOND * 2, true, false), (SECOND * 2, false, true), (SECOND, true, true)] {
        let mut rig = Rig::new(Protocol::P3964R);
        if !modem {
            rig.judge.facts.roles[3] = Role::Consume;
        }
        rig.send();
        rig.now += rest;
        rig.fc0(0, 1);
        if finds { rig.sees_only("fc0-no-reason") } else { rig.sees_nothing() }
    }
}

/// Its STX was crossed by the NAK with which the partner gives up a telegram that the CP has no room for.
#[test]
fn fc0_fails_by_the_nak_of_a_partner_that_gives_up() {
    let run = |before: Span| {
        let mut rig = Rig::new(Protocol::P3964R);
        let Partner240::Procedure(line, _) = &mut rig.partner else { unreachable!("3964R") };
        line.gave_up = Some(rig.now.saturating_sub(before));
        rig.send();
        rig.fc0(0, 1);
        rig
    };
    run(MS).sees_nothing();
    run(SECOND).sees_only("fc0-no-reason");
}

#[test]
fn a_telegram_that_was_sent_twice() {
    let mut rig = Rig::new(Protocol::P3964R);
    rig.send();
    rig.takes(expected());
    rig.takes(expected());
    rig.fc0(0, 0);
    rig.sees_only("fc0-twice");
    // The second one comes long after the end.
    let mut rig = Rig::new(Protocol::P3964R);
    rig.send();
    rig.takes(expected());
    rig.fc0(0, 0);
    rig.takes(expected());
    rig.end();
    rig.sees_only("fc0-twice");
}

#[test]
fn fc8_does_not_end() {
    let mut rig = Rig::new(Protocol::P3964R);
    let start = [(7, 1)];
    (0..2000).for_each(|_| rig.call(3, &start, &start));
    rig.sees_only("fc8-live");
}

#[test]
fn fc8_has_no_return_value_and_sets_no_start() {
    let mut rig = Rig::new(Protocol::P3964R);
    rig.call(3, &[], &[(9, 1)]);
    rig.sees_only("fc8-ret");
    let mut rig = Rig::new(Protocol::P3964R);
    rig.call(3, &[], &[(7, 1)]);
    rig.sees_only("fc8-start");
}

#[test]
fn fc9_does_not_end() {
    let mut rig = Rig::new(Protocol::P3964R);
    let anl = [(modem::ANL, 1)];
    (0..1000).for_each(|_| rig.call(4, &anl, &anl));
    rig.sees_only("fc9-live");
    let mut rig = Rig::new(Protocol::P3964R);
    rig.call(4, &[], &[(modem::RESET, 1)]);
    rig.sees_only("fc9-reset");
}

fn request(rig: &mut Rig, db: u8, error: u8) {
    let head = [0, 0, b'A', b'D', db, 0, 0, 2, 0xFF, 0xFF];
    let (now, telegram) = (rig.now, [&head[..], b"data"].concat());
    let Partner240::Rk512(rk, _) = &mut rig.partner else { return };
    let place = rk.line.sent.len();
    rk.requests.push(Request { telegram, given: now, place, reaction: Some((error, Vec::new(), now)) });
}

#[test]
fn fc4_says_done_or_refuses() {
    let mut rig = Rig::new(Protocol::Rk512);
    request(&mut rig, 60, 0);
    rig.call(6, &[], &[]);
    rig.sees_only("fc4-false-done");
    let mut rig = Rig::new(Protocol::Rk512);
    rig.call(6, &[], &[]);
    request(&mut rig, 60, 0x14);
    rig.call(6, &[], &[]);
    rig.sees_only("fc4-refused");
    // What is not there may be refused.
    let mut rig = Rig::new(Protocol::Rk512);
    rig.call(6, &[], &[]);
    request(&mut rig, 99, 0x14);
    rig.call(6, &[], &[]);
    rig.sees_nothing();
}

#[test]
fn the_cp_goes_on_after_xoff() {
    let mut rig = Rig::new(Protocol::Ascii);
    if let Partner240::Stream(stream, _) = &mut rig.partner {
        stream.after_stop = 30;
    }
    rig.scan(&[]);
    rig.sees_only("xoff");
}

#[test]
fn a_stop_is_a_break() {
    let mut rig = Rig::new(Protocol::P3964R);
    rig.send();
    rig.judge.deed(rig.now, &Deed::Stop);
    rig.judge.deed(rig.now + 100 * MS, &Deed::Run);
    // Bit memory is empty: the program knows of no order.
    rig.call(1, &[], &[]);
    rig.sees_nothing();
}
