//! The CP's side of the handshake, written from the register document, without a line.

use crate::registers::{FAILED, RESET, STARTUP, SYSTEM, Words};

/// State of the CP in the send direction.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Send {
    Collecting,
    Transmitting,
    Failed,
}

/// A CP 240 between two sets of registers.
pub(super) struct FakeCp {
    /// What the CPU has written.
    pub(super) output: [u8; 16],
    /// What the CPU reads.
    pub(super) input: [u8; 16],
    /// The telegrams it was asked to transmit.
    pub(super) transmitted: Vec<Vec<u8>>,
    /// The error code of its next transmission.
    pub(super) fails_with: Option<u8>,
    /// Every `TX` and every `RX echo` it has acted on.
    pub(super) log: Vec<u16>,
    /// The answer to a line command.
    pub(super) lines: u16,
    send: Send,
    collected: Vec<u8>,
    offered: Vec<u8>,
    number: u8,
    starting: bool,
}

impl FakeCp {
    /// A CP that works.
    pub(super) fn working() -> Self {
        Self {
            output: [0; 16],
            input: [0; 16],
            transmitted: Vec::new(),
            fails_with: None,
            log: Vec::new(),
            lines: 0x1C00,
            send: Send::Collecting,
            collected: Vec::new(),
            offered: Vec::new(),
            number: 0,
            starting: false,
        }
    }

    fn word(bytes: &[u8; 16], at: usize) -> u16 {
        u16::from_be_bytes([bytes[at], bytes[at + 1]])
    }

    fn set(&mut self, at: usize, word: u16) {
        self.input[at..at + 2].copy_from_slice(&word.to_be_bytes());
    }

    pub(super) fn words(&self) -> Words {
        Words { rx: Self::word(&self.input, 0), tx_echo: Self::word(&self.input, 2) }
    }

    pub(super) fn write(&mut self, at: usize, bytes: &[u8]) {
        self.output[at..at + bytes.len()].copy_from_slice(bytes);
    }

    /// A telegram has arrived on the line.
    pub(super) fn receive(&mut self, telegram: &[u8]) {
        self.offered = telegram.to_vec();
        self.offer();
    }

    /// A start-up: the identifier with the next number.
    pub(super) fn start_up(&mut self) {
        self.number = self.number % 255 + 1;
        self.starting = true;
        (self.collected, self.offered, self.send) = (Vec::new(), Vec::new(), Send::Collecting);
        self.input = [0; 16];
        self.set(0, STARTUP);
        self.set(2, SYSTEM | u16::from(self.number));
    }

    /// Reads the registers of the CPU once.
    pub(super) fn look(&mut self) {
        let (rx_echo, tx) = (Self::word(&self.output, 0), Self::word(&self.output, 2));
        if rx_echo == RESET {
            if !self.starting {
                self.start_up();
            }
        } else if self.starting {
            let shown = Self::word(&self.input, 0) != 0;
            if shown && (rx_echo, tx) == (STARTUP, SYSTEM | u16::from(self.number)) {
                self.input = [0; 16];
            } else if !shown && (rx_echo, tx) == (0, 0) {
                self.starting = false;
            }
        } else {
            self.look_send(tx);
            self.look_receive(rx_echo);
        }
    }

    /// The protocol has finished the telegram.
    pub(super) fn finish(&mut self) {
        assert_eq!(self.send, Send::Transmitting, "nothing is on the line");
        match self.fails_with.take() {
            Some(code) => {
                self.send = Send::Failed;
                self.set(2, FAILED | u16::from(code));
            }
            None => {
                self.send = Send::Collecting;
                self.set(2, 0);
            }
        }
    }

    fn look_send(&mut self, tx: u16) {
        let echo = Self::word(&self.input, 2);
        if tx & 0xF800 == 0x1800 {
            if echo == 0 {
                self.log.push(tx);
                self.set(2, self.lines);
            }
            return;
        }
        let echo = if echo & 0xF800 == 0x1800 { 0 } else { echo };
        self.set(2, echo);
        match self.send {
            Send::Collecting if tx != echo => {
                self.log.push(tx);
                if tx == 0 {
                    if echo <= 12 {
                        self.transmitted.push(std::mem::take(&mut self.collected));
                        self.send = Send::Transmitting;
                    } else {
                        self.collected.clear();
                        self.set(2, 0);
                    }
                } else {
                    assert!(echo == 0 || tx == echo - 12, "{tx} after {echo}");
                    self.collected.extend_from_slice(&self.output[4..4 + usize::from(tx.min(12))]);
                    self.set(2, tx);
                }
            }
            Send::Failed if tx == FAILED => {
                self.log.push(tx);
                self.send = Send::Collecting;
                self.set(2, 0);
            }
            _ => {}
        }
    }

    fn look_receive(&mut self, echo: u16) {
        let rx = Self::word(&self.input, 0);
        if rx != 0 && echo == rx {
            self.log.push(echo);
            self.offered.drain(..usize::from(rx.min(12)));
            self.offer();
        }
    }

    fn offer(&mut self) {
        self.set(0, self.offered.len() as u16);
        self.input[4..].fill(0);
        let block = self.offered.len().min(12);
        self.input[4..4 + block].copy_from_slice(&self.offered[..block]);
    }
}
