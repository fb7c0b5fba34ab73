//! A CP on the bench: virtual time, registers set by the test, everything it does is recorded.

#![allow(dead_code)] // each test file uses its own part of it

use ob1_fakes::cp_port::CpLog;
use ob1_firmware::{Counter, Cp as _, Cp240, CpInput, Instant, LineInput, Reason, Registers, Span};

pub(crate) const MS: Span = Span::MILLISECOND;

pub(crate) fn word(registers: &[u8], at: usize) -> u16 {
    u16::from_be_bytes([registers[at], registers[at + 1]])
}

pub(crate) struct Bench {
    pub(crate) cp: Cp240,
    pub(crate) log: CpLog,
    pub(crate) now: Instant,
    pub(crate) due: Option<Instant>,
    pub(crate) outputs: Registers,
}

impl Bench {
    /// A CP just switched on.
    pub(crate) fn off() -> Self {
        Self {
            cp: Cp240::new(0),
            log: CpLog { inputs: vec![0; 16], ..CpLog::default() },
            now: Instant::START,
            due: None,
            outputs: [0; 16],
        }
    }

    /// A CP with these parameters, showing its start-up identifier.
    pub(crate) fn starting(parameters: &[u8; 16]) -> Self {
        let mut bench = Self::off();
        bench.step(CpInput::Parameters(parameters));
        bench
    }

    /// A CP at work.
    pub(crate) fn working(parameters: &[u8; 16]) -> Self {
        let mut bench = Self::starting(parameters);
        bench.synchronise();
        bench.log.shown.clear();
        bench
    }

    /// Does what FC 9 does.
    pub(crate) fn synchronise(&mut self) {
        assert_eq!(self.rx(), 0x8001, "a start-up identifier");
        let number = self.tx_echo();
        self.put(0x8001, number, &[]);
        self.put(0, 0, &[]);
        assert!(self.cp.is_working());
    }

    pub(crate) fn step(&mut self, input: CpInput<'_>) {
        self.due = self.cp.step(self.now, input, &mut self.log);
    }

    pub(crate) fn line(&mut self, input: LineInput<'_>) {
        self.step(CpInput::Line(input));
    }

    /// Time passes; ticks at every deadline.
    pub(crate) fn pass(&mut self, time: Span) {
        let end = self.now + time;
        while let Some(due) = self.due.filter(|due| *due <= end) {
            self.now = self.now.max(due);
            self.step(CpInput::Tick);
        }
        self.now = end;
        self.step(CpInput::Tick);
    }

    /// Writes the output registers.
    pub(crate) fn put(&mut self, rx_echo: u16, tx: u16, block: &[u8]) {
        self.outputs = [0; 16];
        self.outputs[..2].copy_from_slice(&rx_echo.to_be_bytes());
        self.outputs[2..4].copy_from_slice(&tx.to_be_bytes());
        self.outputs[4..4 + block.len()].copy_from_slice(block);
        let outputs = self.outputs;
        self.step(CpInput::Outputs(&outputs));
    }

    pub(crate) fn put_tx(&mut self, tx: u16, block: &[u8]) {
        self.put(word(&self.outputs, 0), tx, block);
    }

    pub(crate) fn put_rx(&mut self, echo: u16) {
        let mut outputs = self.outputs;
        outputs[..2].copy_from_slice(&echo.to_be_bytes());
        self.outputs = outputs;
        self.step(CpInput::Outputs(&outputs));
    }

    /// Hands a telegram over as FC 0 does, up to and including TX = 0.
    pub(crate) fn hand_over(&mut self, telegram: &[u8]) {
        for (n, block) in telegram.chunks(12).enumerate() {
            let rest = (telegram.len() - 12 * n) as u16;
            self.put_tx(rest, block);
            assert_eq!(self.tx_echo(), rest);
        }
        self.put_tx(0, &[]);
    }

    /// Fetches a telegram as FC 1 does.
    pub(crate) fn fetch(&mut self) -> Vec<u8> {
        let mut telegram = Vec::new();
        assert_ne!(self.rx(), 0, "nothing to fetch");
        while self.rx() != 0 {
            let rest = self.rx();
            telegram.extend_from_slice(&self.log.inputs[4..4 + usize::from(rest).min(12)]);
            self.put_rx(rest);
        }
        self.put_rx(0);
        telegram
    }

    pub(crate) fn rx(&self) -> u16 {
        word(&self.log.inputs, 0)
    }

    pub(crate) fn tx_echo(&self) -> u16 {
        word(&self.log.inputs, 2)
    }

    pub(crate) fn count(&self, counter: Counter) -> u64 {
        self.log.counter(counter)
    }

    /// What its owner would show as its reason.
    pub(crate) fn reason(&mut self) -> Option<Reason> {
        self.log.troubles.reason(self.now, &self.cp)
    }

    pub(crate) fn has_event(&self, text: &str) -> bool {
        self.log.events.iter().any(|event| event.contains(text))
    }
}

/// ASCII at 9600 8N1, ZNA 0, ZVZ 40 ms.
pub(crate) fn ascii(receive_buffers: u8) -> [u8; 16] {
    [0, 0x01, 0x13, 0, 0, 2, receive_buffers, 0, 0, 0, 0, 0, 0, 0, 0, 0]
}

/// 3964R at 9600 8N1 with the default times.
pub(crate) fn s3964r(high: bool) -> [u8; 16] {
    [0, 0x04, 0x13, 0, 0, 10, 25, 100, 5, 6, u8::from(high), 0, 0, 0, 0, 0]
}
