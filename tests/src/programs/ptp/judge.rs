//! The judge of a program around the blocks of a point-to-point CP: the automata of its blocks, and beside them the
//! partner's ledger.

use ob1_cpu::{Cpu, OperatingState};
use ob1_line::sim::FaultRates;
use ob1_time::{Instant, Span};

use super::numbers::{Number, Protocol};
use super::partner::{self, Event, Ptp};
use super::post::{CHARACTER, Inbox, Outbox};
use super::receiver::{ReceiveCall, Receiver, Report};
use super::rule::{Findings as _, Rule};
use super::sender::{End, SendCall, Sender, Turn};
use super::{modbus, receiver, sender};
use crate::programs::judge::{Judge, Scan, Verdict};
use crate::programs::record::Call;
use crate::programs::run::Deed;
use crate::programs::text::{Operand, Site};

/// A sending block at a place in the program.
#[derive(Debug)]
pub struct Sends {
    /// The place.
    pub site: usize,
    /// The manual of the block.
    pub manual: sender::Manual,
    /// Names of REQ, R, LEN, `DB_NO`, `DBB_NO`, DONE, ERROR, STATUS.
    pub names: [&'static str; 8],
    /// Longest LEN.
    pub most: i32,
    /// Byte of the mark behind `DBB_NO`: the first of what is recorded besides is its word.
    pub mark: usize,
}

/// A receiving block at a place in the program.
#[derive(Debug)]
pub struct Receives {
    /// The place.
    pub site: usize,
    /// The manual of the block.
    pub manual: receiver::Manual,
    /// Names of `EN_R`, R, `DB_NO`, `DBB_NO`, NDR, ERROR, STATUS, LEN.
    pub names: [&'static str; 8],
}

/// What the judge knows of a case.
#[derive(Debug)]
pub struct Setup {
    /// The sending blocks. More than one is against the manual: then errors need no cause.
    pub sends: Vec<Sends>,
    /// The receiving blocks.
    pub receives: Vec<Receives>,
    /// The protocol.
    pub protocol: Protocol,
    /// What the CP puts behind each telegram (ASCII).
    pub tail: Vec<u8>,
    /// The data are a FETCH, or `R_NO` of a SEND: the data block at the partner.
    pub fetch: bool,
    /// `R_NO`.
    pub r_no: u8,
    /// Faults of the line.
    pub rates: FaultRates,
    /// Errors need no cause until then.
    pub calm: Instant,
    /// A telegram of the partner is delivered within this time.
    pub patience: Span,
    /// Bytes of the receive buffer.
    pub buffer: usize,
    /// A CP 040: its own Modbus, and R empties the CP.
    pub is_040: bool,
    /// A start-up of the CPU empties the receive buffer: CP 340, CP 040; of a CP 341 it is kept. (docs/cp341.md)
    pub clears: bool,
    /// What the partner sends is not always taken.
    pub is_short: bool,
    /// Nothing happens from outside after this.
    pub last: Instant,
}

/// The judge.
#[derive(Debug)]
pub struct PtpJudge {
    setup: Setup,
    senders: Vec<Sender>,
    receivers: Vec<Receiver>,
    /// R of each sending block in its last call.
    resets: Vec<bool>,
    /// The number of the open job of each sender in the outbox.
    jobs: Vec<Option<Open>>,
    outbox: Outbox,
    inbox: Inbox,
    telegrams: u64,
    /// Since then each receiving block was called with `EN_R`.
    able: Instant,
    /// Last call of the receiving block.
    heard: Instant,
    is_running: bool,
    /// The driver was killed: until then nobody listens.
    down: Instant,
    /// Until then a telegram that was cut off may spoil others.
    torn: Instant,
}

#[derive(Clone, Copy, Debug)]
struct Open {
    number: usize,
    /// Telegrams taken when it began.
    telegrams: u64,
    reads: bool,
    data: Data,
    /// Those of the job before it, where that may be the one that runs.
    before: Option<Data>,
}

/// Where the data of a job lie.
#[derive(Clone, Copy, Debug)]
struct Data {
    db: u32,
    dbb: usize,
    len: usize,
}

/// What needs time to settle after a start of the CPU or the driver.
const SETTLES: Span = Span::from_millis(1500);
/// A CP 341 or CP 340 that has refused a block waits so long for it once more, then it reports what was wrong.
/// [TIA help "Configuration for point-to-point links"]
const REPEATS: Span = Span::from_secs(4);
/// The partner has sent more than there is room for.
const NO_BUFFER: u16 = 0x080A;
/// Longest answer of a slave.
const ANSWER: usize = 256;
/// See [`PtpJudge::torn`].
const TORN: Span = Span::from_millis(3000);
/// A receiving block that is not called for so long is a reason for errors.
const SELDOM: Span = Span::from_millis(900);

impl PtpJudge {
    /// A judge of this case.
    #[must_use]
    pub fn new(setup: Setup) -> Self {
        let mut senders: Vec<Sender> = setup.sends.iter().map(|place| Sender::new(place.manual)).collect();
        let mut receivers: Vec<Receiver> = setup.receives.iter().map(|place| Receiver::new(place.manual)).collect();
        // The start of the station, its faults and the moods of the partner.
        let calm = setup.calm.max(Instant::START + SETTLES);
        senders.iter_mut().for_each(|sender| sender.disturbed(calm));
        receivers.iter_mut().for_each(|receiver| receiver.disturbed(calm));
        let jobs = senders.iter().map(|_| None).collect();
        let resets = vec![false; senders.len()];
        let (outbox, inbox) = (Outbox::default(), Inbox::new(setup.buffer));
        let (able, heard) = (Instant::START, Instant::START);
        Self {
            setup,
            senders,
            receivers,
            resets,
            jobs,
            outbox,
            inbox,
            telegrams: 0,
            able,
            heard,
            is_running: true,
            down: Instant::START,
            torn: Instant::START,
        }
    }

    fn disturbed(&mut self, until: Instant) {
        self.senders.iter_mut().for_each(|sender| sender.disturbed(until));
        self.receivers.iter_mut().for_each(|receiver| receiver.disturbed(until));
    }

    fn ledger(&mut self, now: Instant, partner: &mut Ptp, verdict: &mut Verdict) {
        // The rest of a telegram that a kill or a reset has cut off spoils the next for a partner without check, and so
        // on, as long as no silence ends it: what counts is when its first character came.
        let (rates, torn) = (self.setup.rates != FaultRates::NONE, self.torn);
        let began = |at: Instant, telegram: &[u8]| at.saturating_sub(CHARACTER * telegram.len() as u64);
        let is_torn = |at: Instant, telegram: &[u8]| now < torn || began(at, telegram) < torn;
        for event in std::mem::take(&mut partner.events) {
            match event {
                Event::Got { at, telegram, answered } => {
                    let lenient = rates || is_torn(at, &telegram);
                    self.outbox.arrived(at, &telegram, answered, lenient, verdict);
                }
                Event::Said { at, telegram, owed } => {
                    let broken = is_torn(at, &telegram);
                    // What begins right after a fault belongs to the telegram that is lost.
                    let good = !rates && now >= self.setup.calm && began(at, &telegram) > self.down;
                    self.inbox.said(at, &telegram, owed && good && !broken, broken);
                    // A CP of low priority gives way to each telegram of the partner.
                    if self.setup.protocol.is_acknowledged() {
                        self.senders.iter_mut().for_each(|sender| sender.delayed());
                    }
                }
                Event::Owed { telegram } if !rates && now >= self.setup.calm.max(torn) => {
                    self.inbox.owed(now, &telegram);
                }
                Event::Owed { .. } => {}
                Event::Disturbs(until) => self.disturbed(until),
                Event::GivesUp(at) => {
                    self.receivers.iter_mut().for_each(|receiver| receiver.given_up(at, at + REPEATS + SETTLES));
                }
                // A CP that has just started does not know of the XOFF before.
                Event::Flooded { .. } if now < self.torn => {}
                Event::Flooded { at, characters } => {
                    verdict.breaks(at, Rule::Flow, format!("{characters} characters after XOFF"));
                }
            }
        }
        let loses = self.setup.rates != FaultRates::NONE && !self.setup.protocol.is_acknowledged();
        self.outbox.settle(now, loses && now < self.setup.calm, verdict);
    }

    fn send(&mut self, place: usize, call: &Call, site: &Site, cpu: &Cpu, verdict: &mut Verdict) {
        let at = &self.setup.sends[place];
        let values = Values { site, call };
        let [req, r, len, db, dbb, done, error, status] = at.names;
        let mut send = SendCall {
            legal: true,
            at: call.at,
            req: values.before(req) != 0,
            reset: values.before(r) != 0,
            len: i32::from(values.before(len) as u16 as i16),
            done: values.after(done) != 0,
            error: values.after(error) != 0,
            status: values.after(status) as u16,
        };
        let (db_no, dbb_no) = (values.before(db), values.before(dbb) as usize);
        let mut telegram = None;
        if self.senders[place].may_begin(send.req) {
            telegram = self.telegram(place, send.len, db_no, dbb_no, values.mark(), cpu);
            // A second sending block at one CP is against the manual. [S4 L1584]
            send.legal = telegram.is_some() && self.setup.sends.len() == 1 && !self.setup.is_short;
        }
        if self.setup.is_040 && send.reset && !self.resets[place] {
            // It empties both directions. [S3 L311]
            self.inbox.broken_off();
            self.torn = call.at + TORN;
            self.disturbed(call.at + SETTLES);
        }
        self.resets[place] = send.reset;
        if self.setup.is_040 && self.setup.protocol == Protocol::Modbus && self.inbox.room() < ANSWER {
            // The receiving block is too slow for the answers: there may be no buffer for the next. [S3 L319]
            self.senders[place].excuse();
        }
        let Turn { ended, began, at_once, ghost } = self.senders[place].call(&send, verdict);
        if self.setup.sends.len() > 1 {
            self.senders[place].excuse();
        }
        if let Some(end) = ended {
            self.ended(place, call.at, end, cpu, verdict);
        }
        if !began {
            self.waiting(place, values.mark(), cpu);
            return;
        }
        verdict.given();
        let (db, dbb) = (db_no, dbb_no);
        // Nobody answers a broadcast: DONE is the turnaround delay. [S4 L636]
        let is_broadcast = self.setup.protocol == Protocol::Modbus
            && telegram.as_ref().is_some_and(|telegram| telegram.bytes.first() == Some(&0));
        let reads = telegram.as_ref().is_some_and(|telegram| telegram.reads);
        let block = self.setup.sends[place].manual.block;
        let number = self.outbox.began(call.at, block, telegram.map(|telegram| telegram.bytes));
        if ghost || is_broadcast {
            self.outbox.spoilt(number);
        }
        // The job before may be the one that runs, with the data that stand there now.
        if ghost
            && let Some(old) = self.jobs[place]
            && let Some(telegram) =
                self.telegram(place, old.data.len as i32, old.data.db, old.data.dbb, values.mark(), cpu)
        {
            self.outbox.also(number, telegram.bytes);
        }
        let reads = reads && !ghost;
        let data = Data { db, dbb, len: usize::try_from(send.len).unwrap_or(0) };
        let before = self.jobs[place].filter(|_| ghost).map(|old| old.data);
        self.jobs[place] = Some(Open { number, telegrams: self.telegrams, reads, data, before });
        if let Some(end) = at_once {
            self.ended(place, call.at, end, cpu, verdict);
        }
    }

    /// A job at a CP 040 has the parameters of the edge of REQ, and the data of the calls that pass them: a program
    /// that starts jobs in a reset changes those of the one that waits.
    fn waiting(&mut self, place: usize, mark: u32, cpu: &Cpu) {
        let Some(open) = self.jobs[place].filter(|_| self.setup.is_040) else { return };
        if let Some(telegram) = self.telegram(place, open.data.len as i32, open.data.db, open.data.dbb, mark, cpu) {
            self.outbox.also(open.number, telegram.bytes);
        }
    }

    /// What has to arrive at the partner; `None`: the parameters are wrong.
    fn telegram(&self, place: usize, len: i32, db: u32, dbb: usize, mark: u32, cpu: &Cpu) -> Option<Expected> {
        let Sends { most, mark: at, .. } = self.setup.sends[place];
        let len = usize::try_from(len).ok().filter(|_| len > 0 && len <= most)?;
        let mut data = cpu.data_block(u16::try_from(db).ok()?)?.get(dbb..dbb + len)?.to_vec();
        for (byte, value) in data.iter_mut().skip(at).zip((mark as u16).to_be_bytes()) {
            *byte = value;
        }
        match self.setup.protocol {
            // The telegram stands in the data block as it goes over the line. [S3 L383-L389]
            Protocol::Modbus if self.setup.is_040 => Some(Expected { bytes: data, reads: false }),
            Protocol::Modbus => modbus::request(&data),
            Protocol::Rk512 if self.setup.fetch => Some(Expected { bytes: Vec::new(), reads: false }),
            Protocol::Rk512 => {
                let mut bytes = vec![b'A', b'D', self.setup.r_no, 0];
                bytes.extend(&data);
                // An odd LEN is filled up. [TIA help "PtP data link CP 341"]
                if data.len() % 2 == 1 {
                    bytes.push(0);
                }
                Some(Expected { bytes, reads: false })
            }
            _ => Some(Expected { bytes: [&data[..], &self.setup.tail].concat(), reads: false }),
        }
    }

    fn ended(&mut self, place: usize, at: Instant, end: End, cpu: &Cpu, verdict: &mut Verdict) {
        let Some(open) = self.jobs[place].take() else { return };
        let manual = self.setup.sends[place].manual;
        let block = manual.block;
        let number = match end {
            End::Error(status) => (manual.number)(status),
            _ => None,
        };
        match end {
            End::Done => verdict.done(),
            _ => verdict.failed(),
        }
        if end == End::Done && open.reads {
            verdict.must(self.telegrams > open.telegrams, at, Rule::NdrBeforeDone, || {
                format!("{block}: a reading job is DONE, and its NDR has not come")
            });
        }
        if self.setup.fetch {
            let places = [Some(open.data), open.before];
            let right = end != End::Done || places.iter().flatten().any(|data| self.fetched(data, cpu));
            verdict.must(right, at, Rule::DoneArrived, || format!("{block}: a FETCH is DONE with other data"));
            return;
        }
        // What the job sends itself is nothing without a partner that hears it.
        let number = number.filter(|number| *number != Number::Open);
        self.outbox.ended(at, open.number, end, number, verdict);
    }

    fn fetched(&self, to: &Data, cpu: &Cpu) -> bool {
        let data = u16::try_from(to.db).ok().and_then(|db| cpu.data_block(db));
        let data = data.and_then(|data| data.get(to.dbb..to.dbb + to.len)).unwrap_or(&[]);
        (0..).zip(data).all(|(at, byte)| *byte == partner::rk512::memory(self.setup.r_no, at))
    }

    fn receive(&mut self, place: usize, call: &Call, site: &Site, alone: bool, cpu: &Cpu, verdict: &mut Verdict) {
        let at = &self.setup.receives[place];
        let values = Values { site, call };
        let [en_r, r, db, dbb, ndr, error, status, len] = at.names;
        let receive = ReceiveCall {
            at: call.at,
            enable: values.before(en_r) != 0,
            reset: values.before(r) != 0,
            ndr: values.after(ndr) != 0,
            error: values.after(error) != 0,
            status: values.after(status) as u16,
            len: i32::from(values.after(len) as u16 as i16),
        };
        if self.setup.is_040 && receive.reset {
            self.inbox.broken_off();
            self.torn = call.at + TORN;
            self.disturbed(call.at + SETTLES);
        }
        if !receive.enable || receive.reset || call.at.since(self.heard) > SELDOM {
            self.able = call.at;
            self.starves(call.at);
        }
        self.heard = call.at;
        let report = self.receivers[place].call(&receive, verdict);
        match report {
            Some(Report::Telegram(len)) => {
                verdict.received();
                self.telegrams += 1;
                let (db, dbb) = (values.before(db), values.before(dbb) as usize);
                let (db, dbb) =
                    if self.setup.protocol == Protocol::Rk512 { (values.after("L_NO"), 0) } else { (db, dbb) };
                let len = usize::try_from(len).unwrap_or(0);
                let data = u16::try_from(db).ok().and_then(|db| cpu.data_block(db));
                // The CP 040's own text about a telegram of the slave that is wrong. [S3 L391]
                let own = self.setup.is_040 && self.setup.protocol == Protocol::Modbus;
                let told = |data: &[u8]| !(own && data.starts_with(b"ERROR"));
                if let Some(data) = data.and_then(|data| data.get(dbb..dbb + len)).filter(|data| alone && told(data)) {
                    let lenient = self.setup.rates != FaultRates::NONE || call.at < self.torn;
                    let block = self.setup.receives[place].manual.block;
                    self.inbox.taken(call.at, block, data, lenient, verdict);
                }
            }
            Some(Report::Error(status)) => {
                // Something was lost, and the block said so.
                self.inbox.broken_off();
                if self.setup.is_short || status == NO_BUFFER {
                    self.starves(call.at);
                }
            }
            Some(Report::Reset) => self.inbox.broken_off(),
            None => {}
        }
    }

    /// The receiving block does not take what comes: that is a reason for errors. [TIA help "PtP data link CP 341"]
    fn starves(&mut self, at: Instant) {
        self.receivers.iter_mut().for_each(|receiver| receiver.disturbed(at + SETTLES));
        if self.setup.protocol == Protocol::Modbus {
            self.senders.iter_mut().for_each(|sender| sender.disturbed(at + SETTLES));
        }
    }
}

/// What has to arrive.
#[derive(Debug)]
pub struct Expected {
    /// The telegram.
    pub bytes: Vec<u8>,
    /// Its answer goes to the receiving block.
    pub reads: bool,
}

impl Judge<Ptp> for PtpJudge {
    fn scan(&mut self, scan: &Scan<'_>, cpu: &mut Cpu, partner: &mut Ptp, verdict: &mut Verdict) {
        if scan.state == OperatingState::Run && !self.is_running {
            let until = scan.now + SETTLES;
            self.senders.iter_mut().for_each(|sender| sender.restarted(until));
            self.receivers.iter_mut().for_each(|receiver| receiver.restarted(until));
            self.heard = scan.now;
        }
        self.is_running = scan.state == OperatingState::Run;
        self.ledger(scan.now, partner, verdict);
        for call in scan.calls {
            let site = &scan.sites[call.site];
            if let Some(place) = self.setup.sends.iter().position(|place| place.site == call.site) {
                self.send(place, call, site, cpu, verdict);
            }
            if let Some(place) = self.setup.receives.iter().position(|place| place.site == call.site) {
                let alone = scan.calls.iter().filter(|other| other.site == call.site).count() == 1;
                self.receive(place, call, site, alone, cpu, verdict);
            }
        }
    }

    fn deed(&mut self, now: Instant, deed: &Deed) {
        match deed {
            Deed::Kill => {
                self.disturbed(now + SETTLES);
                self.down = now + Span::from_millis(300);
                self.inbox.forget();
                self.torn = now + TORN;
                self.able = now;
            }
            Deed::Stop | Deed::Run => {
                if self.setup.clears {
                    self.down = now + Span::from_millis(300);
                    self.inbox.forget();
                    // The rest of a telegram that comes in just then is one for a protocol without frames.
                    self.torn = now + TORN;
                }
                self.disturbed(now + SETTLES);
                self.able = now;
            }
            Deed::Line(_) => {
                self.disturbed(now + SETTLES);
                self.receivers.iter_mut().for_each(Receiver::fault);
                self.outbox.line_fault(now);
                // Without an answer nobody knows whether it hit a telegram that is under way.
                if !self.setup.protocol.is_acknowledged() {
                    self.inbox.broken_off();
                }
                // Characters right after it belong to the telegram that is lost.
                self.down = now + Span::from_millis(300);
            }
            // A parameter is changed: it counts for the next job, but errors of the running one have a cause.
            Deed::Write(..) => self.senders.iter_mut().for_each(Sender::excuse),
            Deed::Partner(_) => {}
        }
    }

    fn is_over(&self, now: Instant) -> bool {
        // A job that began after all that happened has had its chance when it is a second old.
        let over = self.setup.last.max(self.setup.calm) + Span::from_millis(1000);
        let is_late = |sender: &Sender| sender.began().is_none_or(|began| began > self.setup.last);
        now > over && self.senders.iter().all(is_late) && !self.inbox.has_owed()
    }

    fn end(&mut self, now: Instant, partner: &mut Ptp, verdict: &mut Verdict) {
        self.ledger(now, partner, verdict);
        let patience = self.setup.patience;
        if !self.setup.receives.is_empty() && now.since(self.able) > patience && !self.setup.is_short {
            self.inbox.finish(self.setup.receives[0].manual.block, now, patience, verdict);
        }
    }
}

/// The parameters of a call by name.
struct Values<'a> {
    site: &'a Site,
    call: &'a Call,
}

impl Values<'_> {
    fn index(&self, name: &str) -> Option<usize> {
        self.site.block?.parameters.iter().position(|(own, _)| *own == name)
    }

    fn of(&self, name: &str, values: &[u32]) -> u32 {
        let Some(index) = self.index(name) else { return 0 };
        match self.site.operands.get(index).and_then(Option::as_ref) {
            Some(Operand::Fixed(text)) => constant(text),
            Some(_) => values.get(index).copied().unwrap_or(0),
            None => 0,
        }
    }

    fn before(&self, name: &str) -> u32 {
        self.of(name, &self.call.before)
    }

    fn after(&self, name: &str) -> u32 {
        self.of(name, &self.call.after)
    }

    /// The first of what is recorded besides.
    fn mark(&self) -> u32 {
        self.call.before.get(self.site.operands.len()).copied().unwrap_or(0)
    }
}

fn constant(text: &str) -> u32 {
    match text {
        "TRUE" => 1,
        "FALSE" => 0,
        _ => text.parse::<i32>().unwrap_or(0).cast_unsigned(),
    }
}
