//! A CP 341 on the bench: its line is the simulated one with modem lines (null modem), a partner at the other end; the
//! test uses the two channels as P_SND_RK and P_RCV_RK do (`docs/cp341-channels.md`). Virtual time.

#![allow(dead_code)] // each test file uses its own part of it

use std::cell::RefCell;
use std::rc::Rc;

use ob1_fakes::cp_port::{CpLog, Plug};
use ob1_firmware::cp341::{Channel, ChannelBlock, Cp341};
use ob1_firmware::{Counter, Cp as _, CpInput, Instant, LineInput, LineSettings, Reason, Span, Wire};
use ob1_line::sim::{BusConfig, BusEvent, Frame, SimBus};
use ob1_params::{Cp341 as Parameters, Value};

pub(crate) const MS: Span = Span::MILLISECOND;

/// Participants of the line.
const CP: usize = 0;
const PARTNER: usize = 1;

/// States of a channel as shown by the CP.
const GIVING: u8 = 4;
const DONE: u8 = 5;
const FAILED: u8 = 6;
const OFFERED: u8 = 7;

struct Plugged {
    line: Rc<RefCell<SimBus>>,
    now: Instant,
    outputs: (bool, bool),
    frame: Frame,
}

impl Plugged {
    fn drive(&mut self) {
        let (rts, dtr) = self.outputs;
        self.line.borrow_mut().set_modem(CP, self.now, rts, dtr);
    }
}

impl Wire for Plugged {
    fn transmit(&mut self, bytes: &[u8]) {
        self.line.borrow_mut().write(CP, self.now, bytes);
    }

    fn take_back(&mut self) -> usize {
        self.line.borrow_mut().take_back(CP, self.now)
    }

    fn rts(&mut self, on: bool) {
        self.outputs.0 = on;
        self.drive();
    }

    fn dtr(&mut self, on: bool) {
        self.outputs.1 = on;
        self.drive();
    }
}

impl Plug for Plugged {
    fn settings(&mut self, settings: &LineSettings) {
        self.frame.char_time = settings.char_time();
        let mut line = self.line.borrow_mut();
        line.set_frame(CP, self.frame);
        line.set_frame(PARTNER, self.frame);
    }
}

/// A result of P_RCV_RK.
#[derive(Debug, PartialEq, Eq)]
pub(crate) enum Got {
    Telegram(Vec<u8>),
    Error(u16),
}

pub(crate) struct Bench {
    cp: Cp341,
    port: CpLog<Plugged>,
    pub(crate) now: Instant,
    due: Option<Instant>,
    /// Start number of both blocks, and the last job's number.
    started: u16,
    job: u16,
    parameters: Parameters,
    /// Characters received by the partner, each with the time of its end.
    pub(crate) heard: Vec<(Instant, u8)>,
}

impl Bench {
    /// A working CP with these parameters, both its blocks started; the partner's RTS and DTR are ON.
    pub(crate) fn new(keys: &[(&str, Value)]) -> Self {
        let parameters = Parameters::from_keys(keys.iter().cloned()).expect("parameters");
        // Unreadable characters are produced in other ways than by parity.
        let frame = Frame {
            char_time: Span::from_nanos(1),
            parity: ob1_line::Parity::None,
            data_bits: parameters.line.data_bits,
        };
        let mut line = SimBus::new(BusConfig::new(false), 1);
        assert_eq!((line.join(frame), line.join(frame)), (CP, PARTNER));
        line.set_modem(PARTNER, Instant::START, true, true);
        let line = Rc::new(RefCell::new(line));
        let port = CpLog::at(Plugged { line, now: Instant::START, outputs: (false, false), frame });
        let cp = Cp341::new();
        let mut bench = Self {
            cp,
            port,
            now: Instant::START,
            due: None,
            started: 0,
            job: 0,
            parameters: parameters.clone(),
            heard: Vec::new(),
        };
        bench.step(CpInput::Keys(Ok(&parameters)));
        bench.run(true);
        bench.start();
        // An XON takes longer than 1 ms.
        bench.pass(2 * MS);
        bench.port.entries.clear();
        bench
    }

    fn step(&mut self, input: CpInput<'_>) {
        self.port.wire.now = self.now;
        self.due = self.cp.step(self.now, input, &mut self.port);
    }

    /// Time of a character.
    pub(crate) fn char_time(&self) -> Span {
        self.port.wire.frame.char_time
    }

    /// The CPU goes to RUN or STOP.
    pub(crate) fn run(&mut self, run: bool) {
        self.step(CpInput::CpuRun(run));
    }

    /// STOP -> RUN sends the parameters again, and the blocks restart.
    pub(crate) fn restart(&mut self) {
        let parameters = self.parameters.clone();
        self.step(CpInput::Keys(Ok(&parameters)));
        self.run(true);
        self.start();
    }

    fn start(&mut self) {
        (self.started, self.job) = (self.started + 1, 0);
        let mut block = [0; 64];
        (block[0], block[1]) = (1, 1);
        block[2..4].copy_from_slice(&self.started.to_be_bytes());
        for channel in [Channel::Send, Channel::Receive] {
            self.step(CpInput::Channel(channel, &block));
        }
        block[0] = 2;
        self.step(CpInput::Channel(Channel::Send, &block));
    }

    /// Lets time pass.
    pub(crate) fn pass(&mut self, time: Span) {
        let end = self.now + time;
        loop {
            let mut buffer = [0; 16];
            let line = Rc::clone(&self.port.wire.line);
            let popped = line.borrow_mut().pop(self.now, &mut buffer);
            match popped {
                Some((CP, event)) => {
                    let input = match event {
                        BusEvent::Rx(n) => LineInput::Rx(&buffer[..n]),
                        BusEvent::TxDone => LineInput::TxDone,
                        BusEvent::Fault(fault) => LineInput::Fault(fault),
                        BusEvent::Modem(lines) => LineInput::Modem(lines),
                    };
                    self.step(CpInput::Line(input));
                }
                Some((_, BusEvent::Rx(n))) => self.heard.extend(buffer[..n].iter().map(|byte| (self.now, *byte))),
                Some(_) => {}
                None => {
                    let next = self.due.into_iter().chain(self.port.wire.line.borrow().next_event()).min();
                    let Some(next) = next.filter(|next| *next <= end) else { break };
                    self.now = self.now.max(next);
                    if self.due.is_some_and(|due| due <= self.now) {
                        self.step(CpInput::Tick);
                    }
                }
            }
        }
        self.now = end;
        self.step(CpInput::Tick);
    }

    // ---- the partner ----

    /// The partner sends, without waiting for it.
    pub(crate) fn says(&mut self, bytes: &[u8]) {
        self.port.wire.line.borrow_mut().write(PARTNER, self.now, bytes);
    }

    /// The partner sends; returns when its last bit has been sent.
    pub(crate) fn has_said(&mut self, bytes: &[u8]) {
        self.says(bytes);
        self.pass(bytes.len() as u64 * self.char_time());
    }

    /// The partner sends at half the speed: nothing of it can be read.
    pub(crate) fn has_mumbled(&mut self, bytes: &[u8]) {
        let slow = Frame { char_time: 2 * self.char_time(), ..self.port.wire.frame };
        self.port.wire.line.borrow_mut().set_frame(PARTNER, slow);
        self.says(bytes);
        self.pass(2 * bytes.len() as u64 * self.char_time());
        self.port.wire.line.borrow_mut().set_frame(PARTNER, self.port.wire.frame);
    }

    /// The partner's line is at 0 for 5 ms.
    pub(crate) fn breaks(&mut self) {
        self.port.wire.line.borrow_mut().send_break(PARTNER, self.now, 5 * MS);
    }

    /// The partner switches its RTS and DTR: CTS, DSR and DCD of the CP.
    pub(crate) fn switches(&mut self, rts: bool, dtr: bool) {
        self.port.wire.line.borrow_mut().set_modem(PARTNER, self.now, rts, dtr);
        self.pass(Span::ZERO);
    }

    /// Characters received by the partner since the last call.
    pub(crate) fn heard(&mut self) -> Vec<u8> {
        std::mem::take(&mut self.heard).into_iter().map(|(_, byte)| byte).collect()
    }

    // ---- the blocks ----

    /// P_SND_RK hands a job over.
    pub(crate) fn send(&mut self, data: &[u8]) {
        self.job += 1;
        let mut block: ChannelBlock = [0; 64];
        block[0] = 4;
        block[2..4].copy_from_slice(&self.started.to_be_bytes());
        block[4..6].copy_from_slice(&self.job.to_be_bytes());
        (block[8], block[9]) = (b'S', b'X');
        block[10..12].copy_from_slice(&(data.len() as u16).to_be_bytes());
        for (piece, part) in data.chunks(32).enumerate() {
            block[6..8].copy_from_slice(&(piece as u16).to_be_bytes());
            block[32..32 + part.len()].copy_from_slice(part);
            self.step(CpInput::Channel(Channel::Send, &block));
        }
    }

    /// The outcome of the job, if it has ended; P_SND_RK is then ready for the next.
    pub(crate) fn sent(&mut self) -> Option<Result<(), u16>> {
        let shown = self.port.channel_block(Channel::Send);
        let outcome = match shown[0] {
            DONE => Ok(()),
            FAILED => Err(u16::from_be_bytes([shown[8], shown[9]])),
            _ => return None,
        };
        let mut block: ChannelBlock = [0; 64];
        block[0] = 2;
        block[2..4].copy_from_slice(&self.started.to_be_bytes());
        self.step(CpInput::Channel(Channel::Send, &block));
        Some(outcome)
    }

    /// Hands over a job and waits for its end.
    pub(crate) fn job(&mut self, data: &[u8]) -> Result<(), u16> {
        self.send(data);
        for _ in 0..100_000 {
            if let Some(outcome) = self.sent() {
                return outcome;
            }
            self.pass(MS);
        }
        panic!("the job does not end");
    }

    fn receive_block(&self, command: u8, piece: u16) -> ChannelBlock {
        let mut block: ChannelBlock = [0; 64];
        block[0] = command;
        block[2..4].copy_from_slice(&self.started.to_be_bytes());
        block[4..6].copy_from_slice(&self.port.channel_block(Channel::Receive)[4..6]);
        block[6..8].copy_from_slice(&piece.to_be_bytes());
        block
    }

    /// P_RCV_RK begins to take the telegram on offer, if any; returns its length.
    pub(crate) fn begin(&mut self) -> Option<usize> {
        let shown = self.port.channel_block(Channel::Receive);
        (shown[0] == OFFERED).then(|| {
            let block = self.receive_block(4, 0);
            self.step(CpInput::Channel(Channel::Receive, &block));
            usize::from(u16::from_be_bytes([shown[10], shown[11]]))
        })
    }

    /// P_RCV_RK takes the rest of it.
    pub(crate) fn finish(&mut self, length: usize) -> Vec<u8> {
        let data = self.take(length);
        assert!(self.ends());
        data
    }

    /// P_RCV_RK takes the rest of it, and has not been told that this was all.
    pub(crate) fn take(&mut self, length: usize) -> Vec<u8> {
        let mut data = Vec::new();
        while data.len() < length {
            let shown = self.port.channel_block(Channel::Receive);
            assert_eq!(shown[0], GIVING);
            data.extend_from_slice(&shown[32..32 + (length - data.len()).min(32)]);
            let piece = u16::from_be_bytes([shown[6], shown[7]]);
            let block = self.receive_block(4, piece + 1);
            self.step(CpInput::Channel(Channel::Receive, &block));
        }
        data
    }

    /// P_RCV_RK shows NDR, if the CP has told it that this was all.
    pub(crate) fn ends(&mut self) -> bool {
        let done = self.port.channel_block(Channel::Receive)[0] == DONE;
        if done {
            let block = self.receive_block(3, 0);
            self.step(CpInput::Channel(Channel::Receive, &block));
        }
        done
    }

    /// P_RCV_RK refuses the telegram on offer: R = 1.
    pub(crate) fn refuse(&mut self) {
        let block = self.receive_block(5, 0);
        self.step(CpInput::Channel(Channel::Receive, &block));
        assert_eq!(self.port.channel_block(Channel::Receive)[0], FAILED);
        let block = self.receive_block(3, 0);
        self.step(CpInput::Channel(Channel::Receive, &block));
    }

    /// EN_R = 0 and 1 again.
    pub(crate) fn pauses(&mut self) {
        for command in [2, 3] {
            let block = self.receive_block(command, 0);
            self.step(CpInput::Channel(Channel::Receive, &block));
        }
    }

    /// The next result of P_RCV_RK.
    pub(crate) fn got(&mut self) -> Option<Got> {
        let shown = self.port.channel_block(Channel::Receive);
        if shown[0] == FAILED {
            let block = self.receive_block(3, 0);
            self.step(CpInput::Channel(Channel::Receive, &block));
            return Some(Got::Error(u16::from_be_bytes([shown[8], shown[9]])));
        }
        let length = self.begin()?;
        Some(Got::Telegram(self.finish(length)))
    }

    /// All results of P_RCV_RK.
    pub(crate) fn all(&mut self) -> Vec<Got> {
        std::iter::from_fn(|| self.got()).collect()
    }

    /// V24_SET.
    pub(crate) fn v24_set(&mut self, rts: bool, dtr: bool) {
        let mut outputs = [0; 16];
        outputs[0] = 0x80 | u8::from(rts) << 2 | u8::from(dtr);
        self.step(CpInput::Outputs(&outputs));
    }

    /// V24_STAT: DTR, DSR, RTS, CTS, DCD, RI from bit 0 on.
    pub(crate) fn v24_stat(&mut self) -> u8 {
        self.pass(20 * MS);
        self.port.inputs.first().copied().unwrap_or(0)
    }

    /// RTS and DTR of the CP.
    pub(crate) fn outputs(&self) -> (bool, bool) {
        self.port.wire.outputs
    }

    /// New entries of the diagnostic buffer.
    pub(crate) fn entries(&mut self) -> Vec<u16> {
        std::mem::take(&mut self.port.entries)
    }

    /// Whether SF is lit.
    pub(crate) fn sf(&self) -> bool {
        self.port.leds.error
    }

    /// What its owner would show as its reason.
    pub(crate) fn reason(&mut self) -> Option<Reason> {
        self.port.troubles.reason(self.now, &self.cp)
    }

    pub(crate) fn count(&self, counter: Counter) -> u64 {
        self.port.counter(counter)
    }
}
