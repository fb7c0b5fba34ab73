//! A DP slave as a machine (DP-V0): Set_Prm, Chk_Cfg, Slave_Diag, Data_Exchange, Global_Control and the watchdog.
//!
//! The owner passes in the events of the line with their times, sends the bytes it gets, and calls again at the time
//! that [`Slave::step`] returns. The slave also checks the times of the others: violations of the line's rules are
//! recorded ([`Slave::violations`]), and never answered.

use ob1_coupler::config::{Instant, Span};
use ob1_coupler::{Input, LineFault, LineInput, MasterInput};
use ob1_protocols::profibus::telegram::{self, Frame};
use ob1_protocols::profibus::{MIN_ANSWER_BITS, Parsed, SYNC_BITS, TELEGRAM_BYTES, Telegram, function, sap};

/// 10 ms: the unit of the watchdog.
const WATCHDOG_UNIT: Span = Span::from_millis(10);
/// Bytes of Set_Prm before the user parameters.
const PARAMETER_HEAD: usize = 7;
/// The master address of a slave without a master.
const NO_MASTER: u8 = 0xFF;

/// The configuration of a slave.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct SlaveConfig {
    /// Bits per second on the line.
    pub baud: u32,
    /// Address of the slave on the line.
    pub address: u8,
    /// Ident number: a Set_Prm with another one is refused.
    pub ident: u16,
    /// The configuration of its modules.
    pub config: Vec<u8>,
    /// The user parameters it accepts; `None`: any.
    pub parameters: Option<Vec<u8>>,
    /// Number of input bytes that it sends.
    pub inputs: usize,
    /// Number of output bytes that it takes.
    pub outputs: usize,
    /// Time from a request to its answer, in bits, in addition to the minimum set by its master.
    pub delay_bits: u32,
}

/// The state of a slave.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum State {
    /// It waits for parameters.
    #[default]
    WaitParameters,
    /// It waits for its configuration.
    WaitConfig,
    /// It exchanges inputs and outputs with its master.
    Exchange,
}

/// A DP slave as a machine; for tests and simulations.
pub struct Slave {
    config: SlaveConfig,
    state: State,
    master: Option<u8>,
    /// The watchdog's time, and when it expires.
    watchdog: Option<Span>,
    over: Instant,
    min_answer_bits: u32,
    faults: (bool, bool),
    /// The inputs that it sends with its next answer.
    pub inputs: Vec<u8>,
    /// Its outputs: 0 unless data are exchanged.
    pub outputs: Vec<u8>,
    /// Blocks of its extended diagnosis.
    extended: Vec<u8>,
    /// Its diagnosis differs from the one its master has.
    to_tell: bool,
    received: Vec<u8>,
    /// An invalid character has corrupted the telegram being received.
    noise: bool,
    /// The last bit on the line.
    active: Instant,
    /// How long the line was quiet before the telegram being received, and the longest gap in it.
    pause: Span,
    gap: Span,
    answer: Option<(Instant, Vec<u8>)>,
    /// The frame count bit of the last request and its answer: a repetition gets the same answer.
    last: Option<(u8, Vec<u8>)>,
    sending: bool,
    violations: Vec<String>,
    /// Number of outputs taken.
    exchanges: u64,
}

impl Slave {
    /// A slave after power-on.
    #[must_use]
    pub fn new(config: SlaveConfig) -> Self {
        Self {
            state: State::default(),
            master: None,
            watchdog: None,
            over: Instant::NEVER,
            min_answer_bits: MIN_ANSWER_BITS,
            faults: (false, false),
            inputs: vec![0; config.inputs],
            outputs: vec![0; config.outputs],
            extended: Vec::new(),
            to_tell: false,
            received: Vec::new(),
            noise: false,
            active: Instant::START,
            pause: Span::ZERO,
            gap: Span::ZERO,
            answer: None,
            last: None,
            sending: false,
            violations: Vec::new(),
            exchanges: 0,
            config,
        }
    }

    /// How far its master has brought it.
    #[must_use]
    pub const fn state(&self) -> State {
        self.state
    }

    /// Number of outputs taken.
    #[must_use]
    pub const fn exchanges(&self) -> u64 {
        self.exchanges
    }

    /// Violations of the line's rules by the others, in words.
    #[must_use]
    pub fn violations(&self) -> &[String] {
        &self.violations
    }

    /// Reports faults (blocks of an extended diagnosis), or that there are no more.
    pub fn report(&mut self, blocks: &[u8]) {
        self.to_tell |= self.extended != blocks;
        self.extended = blocks.to_vec();
    }

    /// Changes its modules: configurations from now on are checked against these.
    pub fn set_config(&mut self, config: Vec<u8>) {
        self.config.config = config;
    }

    /// Its power was interrupted for a moment.
    pub fn restart(&mut self) {
        let violations = std::mem::take(&mut self.violations);
        *self = Self { violations, active: self.active, inputs: self.inputs.clone(), ..Self::new(self.config.clone()) };
    }

    /// Takes an event; `out` gets the bytes to send. Returns when to call again at the latest.
    pub fn step(&mut self, now: Instant, input: MasterInput<'_>, out: &mut Vec<u8>) -> Instant {
        match input {
            Input::Line(LineInput::Rx(bytes)) => bytes.iter().for_each(|byte| self.hear(now, Some(*byte))),
            Input::Line(LineInput::TxDone) => (self.sending, self.active) = (false, now),
            Input::Line(LineInput::Fault(LineFault::Back | LineFault::Gone)) => {
                self.received.clear();
                (self.answer, self.sending) = (None, false);
            }
            Input::Line(LineInput::Fault(_)) => self.hear(now, None),
            Input::Tick | Input::Line(LineInput::Modem(_)) => {}
            Input::Order(never) => match never {},
        }
        if now >= self.over {
            self.leave();
        }
        if let Some((_, bytes)) = self.answer.take_if(|(due, _)| now >= *due) {
            self.sending = true;
            out.extend(bytes);
        }
        let due = self.answer.as_ref().map_or(Instant::NEVER, |(due, _)| *due);
        due.min(self.over)
    }

    fn bits(&self, count: u32) -> Span {
        Span::from_nanos((u64::from(count) * Span::SECOND.nanos()).div_ceil(u64::from(self.config.baud.max(1))))
    }

    /// The end of a received character; `None`: it could not be read.
    fn hear(&mut self, now: Instant, byte: Option<u8>) {
        let began = now.saturating_sub(self.bits(ob1_protocols::profibus::CHARACTER_BITS));
        let quiet = began.since(self.active);
        if self.sending {
            self.violations.push(format!("at {now}: somebody speaks while station {} does", self.config.address));
            return;
        }
        // One nanosecond of a character is lost if its time is not a whole number.
        if quiet + Span::from_nanos(1) >= self.bits(SYNC_BITS) {
            self.received.clear();
            self.noise = false;
        }
        if self.received.is_empty() {
            (self.pause, self.gap) = (quiet, Span::ZERO);
        }
        self.gap = self.gap.max(if self.received.is_empty() { Span::ZERO } else { quiet });
        self.active = now;
        match byte {
            None => self.noise = true,
            Some(byte) if !self.noise => self.received.push(byte),
            Some(_) => {}
        }
        match telegram::parse(&self.received) {
            _ if self.noise => self.received.clear(),
            Parsed::More => {}
            Parsed::Wrong => {
                self.noise = true;
                self.received.clear();
            }
            Parsed::Telegram(telegram, _) => {
                let is_request = matches!(telegram, Telegram::Data(frame) if frame.fc & function::REQUEST != 0);
                let bytes = std::mem::take(&mut self.received);
                if is_request {
                    self.judge();
                }
                if let Parsed::Telegram(Telegram::Data(frame), _) = telegram::parse(&bytes) {
                    self.frame(now, &frame);
                }
            }
        }
    }

    /// Checks the rules: a request begins after TSYN; the characters of a telegram follow each other without gaps.
    fn judge(&mut self) {
        let (pause, gap) = (self.pause, self.gap);
        if pause + Span::from_nanos(1) < self.bits(SYNC_BITS) {
            self.violations.push(format!("a request {pause} behind the bit before it"));
        }
        if gap > self.bits(1) {
            self.violations.push(format!("a gap of {gap} in a telegram"));
        }
    }

    fn frame(&mut self, now: Instant, frame: &Frame<'_>) {
        let ours = frame.da == self.config.address;
        if frame.fc & function::REQUEST == 0 || !(ours || frame.da == ob1_protocols::profibus::BROADCAST) {
            return;
        }
        if !ours {
            if frame.dsap == Some(sap::GLOBAL_CONTROL) && Some(frame.sa) == self.master {
                self.global_control(now, frame.data);
            }
            return;
        }
        if self.answer.is_some() {
            self.violations.push(format!("station {} is asked again before it could answer", self.config.address));
        }
        let count = frame.fc & (function::COUNT | function::COUNT_VALID);
        let repeated = frame.fc & function::COUNT_VALID != 0
            && self.last.as_ref().is_some_and(|(last, _)| last & function::COUNT == count & function::COUNT);
        if let Some((_, bytes)) = self.last.as_ref().filter(|_| repeated) {
            let bytes = bytes.clone();
            self.trigger(now, frame);
            return self.answers(now, bytes);
        }
        let mut bytes = [0; TELEGRAM_BYTES];
        let Some(answer) = self.request(now, frame) else { return };
        let len = telegram::encode(&answer.telegram(frame, self.config.address), &mut bytes).unwrap_or(0);
        let bytes = bytes.get(..len).unwrap_or_default().to_vec();
        // A request without a valid frame count bit leaves the last one unchanged.
        if count != 0 {
            self.last = Some((count, bytes.clone()));
        }
        self.answers(now, bytes);
    }

    fn answers(&mut self, now: Instant, bytes: Vec<u8>) {
        let due = now + self.bits(self.min_answer_bits + self.config.delay_bits);
        self.answer = Some((due, bytes));
    }

    /// The master's telegram triggers the watchdog.
    fn trigger(&mut self, now: Instant, frame: &Frame<'_>) {
        if Some(frame.sa) == self.master
            && let Some(time) = self.watchdog
        {
            self.over = now.saturating_add(time);
        }
    }

    fn request(&mut self, now: Instant, frame: &Frame<'_>) -> Option<Answer> {
        if frame.fc & 0x0F == function::STATUS {
            return Some(Answer::Status(function::OK));
        }
        if !matches!(frame.fc & 0x0F, function::SRD | function::SRD_HIGH) {
            return None;
        }
        if frame.dsap.is_some() && frame.ssap != Some(sap::MASTER) {
            return Some(Answer::Status(function::NOT_OPEN));
        }
        match frame.dsap {
            Some(sap::DIAGNOSIS) => {
                self.trigger(now, frame);
                self.to_tell = false;
                Some(Answer::Data(function::DATA, self.diagnosis()))
            }
            Some(sap::GET_CONFIG) => Some(Answer::Data(function::DATA, self.config.config.clone())),
            Some(sap::PARAMETERS) => Some(self.parameters(now, frame)),
            Some(sap::CHECK_CONFIG) if self.master == Some(frame.sa) => {
                self.trigger(now, frame);
                self.check_config(frame.data);
                Some(Answer::Confirmation)
            }
            None if self.state == State::Exchange && self.master == Some(frame.sa) => {
                Some(self.data_exchange(now, frame))
            }
            _ => Some(Answer::Status(function::NOT_OPEN)),
        }
    }

    fn parameters(&mut self, now: Instant, frame: &Frame<'_>) -> Answer {
        if self.master.is_some_and(|master| master != frame.sa) {
            return Answer::Confirmation;
        }
        self.leave();
        let &[status, f1, f2, answer_bits, high, low, _, ref user @ ..] = frame.data else {
            self.faults.0 = true;
            return Answer::Confirmation;
        };
        debug_assert_eq!(frame.data.len(), user.len() + PARAMETER_HEAD);
        let wanted = self.config.parameters.as_ref().is_none_or(|wanted| wanted == user);
        let watched = status & 0x08 != 0;
        if u16::from_be_bytes([high, low]) != self.config.ident || !wanted || watched && (f1 == 0 || f2 == 0) {
            self.faults = (true, false);
            return Answer::Confirmation;
        }
        self.faults = (false, false);
        (self.master, self.state) = (Some(frame.sa), State::WaitConfig);
        if u32::from(answer_bits) >= MIN_ANSWER_BITS {
            self.min_answer_bits = u32::from(answer_bits);
        }
        self.watchdog = watched.then(|| u64::from(f1) * u64::from(f2) * WATCHDOG_UNIT);
        self.trigger(now, frame);
        Answer::Confirmation
    }

    fn check_config(&mut self, config: &[u8]) {
        if config == self.config.config {
            self.state = State::Exchange;
        } else {
            self.leave();
            self.faults.1 = true;
        }
    }

    fn data_exchange(&mut self, now: Instant, frame: &Frame<'_>) -> Answer {
        if frame.data.len() != self.outputs.len() {
            self.leave();
            self.faults.1 = true;
            return Answer::Status(function::NOT_OPEN);
        }
        self.trigger(now, frame);
        self.outputs.copy_from_slice(frame.data);
        self.exchanges += 1;
        match (self.inputs.is_empty(), self.to_tell) {
            (true, false) => Answer::Confirmation,
            (_, false) => Answer::Data(function::DATA, self.inputs.clone()),
            (_, true) => Answer::Data(function::DATA_HIGH, self.inputs.clone()),
        }
    }

    /// Only Clear_Data is mandatory in it.
    fn global_control(&mut self, now: Instant, data: &[u8]) {
        if let (Some(time), State::Exchange) = (self.watchdog, self.state) {
            self.over = now.saturating_add(time);
        }
        if data.first().is_some_and(|command| command & 0x02 != 0) {
            self.outputs.fill(0);
        }
    }

    /// The watchdog has expired, or everything restarts: outputs off.
    fn leave(&mut self) {
        self.outputs.fill(0);
        (self.state, self.master, self.watchdog, self.over) = (State::WaitParameters, None, None, Instant::NEVER);
        self.min_answer_bits = MIN_ANSWER_BITS;
    }

    fn diagnosis(&self) -> Vec<u8> {
        let flag = |on: bool, mask: u8| if on { mask } else { 0 };
        let first = flag(self.state != State::Exchange, 0x02)
            | flag(self.faults.1, 0x04)
            | flag(!self.extended.is_empty(), 0x08)
            | flag(self.faults.0, 0x40);
        let second = flag(self.state == State::WaitParameters, 0x01) | 0x04 | flag(self.watchdog.is_some(), 0x08);
        let [high, low] = self.config.ident.to_be_bytes();
        let mut bytes = vec![first, second, 0, self.master.unwrap_or(NO_MASTER), high, low];
        bytes.extend(&self.extended);
        bytes
    }
}

enum Answer {
    Confirmation,
    /// No data, only a status.
    Status(u8),
    Data(u8, Vec<u8>),
}

impl Answer {
    fn telegram(&self, asked: &Frame<'_>, address: u8) -> Telegram<'_> {
        let frame = |fc, data, saps: bool| {
            let (dsap, ssap) = if saps { (asked.ssap, asked.dsap) } else { (None, None) };
            Telegram::Data(Frame { da: asked.sa, sa: address, dsap, ssap, fc, data })
        };
        match self {
            Self::Confirmation => Telegram::Confirmation,
            Self::Status(status) => frame(*status, &[], false),
            Self::Data(status, data) => frame(*status, data, true),
        }
    }
}
