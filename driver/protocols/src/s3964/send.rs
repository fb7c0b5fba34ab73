//! The sending role: connect, send the block, wait for the acknowledgement; repeat what failed.

use super::codec::{self, DLE, NAK, STX};
use super::{Priority, S3964, State};
use crate::machine::{Instant, Phase, SendError, Sink, What};

/// An order and its progress. The states in which it runs contain it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Job {
    /// Bytes of the telegram.
    len: usize,
    /// Connection attempts begun for the present attempt to send the block.
    connects: u16,
    /// Attempts to send the block that have failed.
    blocks: u16,
    /// The whole block has been sent in an attempt that was not refused: the partner may have it.
    out: bool,
}

impl Job {
    pub(super) fn new(len: usize) -> Self {
        Self { len, connects: 0, blocks: 0, out: false }
    }

    /// The partner may have the block from an attempt that has failed.
    pub(super) fn is_out(&self) -> bool {
        self.out
    }

    /// An attempt has failed.
    pub(super) fn is_repeated(&self) -> bool {
        self.connects > 0 || self.blocks > 0
    }
}

impl<const N: usize> S3964<N> {
    /// Asks for a connection: STX, then QVZ.
    pub(super) fn connect(&mut self, now: Instant, mut job: Job, out: &mut dyn Sink) {
        job.connects += 1;
        self.transmit(now, &[STX], out);
        self.state = State::Connect { job, expiry: self.expiry_unreported(self.config.qvz) };
    }

    /// An answer to STX?
    pub(super) fn connect_character(&mut self, now: Instant, mut job: Job, byte: u8, out: &mut dyn Sink) {
        match byte {
            STX if self.config.priority == Priority::Low => {
                // [S0 "Initialization conflict"]: the station with the lower priority sends DLE and changes to receive
                // mode. Its order stays and begins again afterwards; the attempt lost here does not count.
                // [TIA help "Configuration for point-to-point links"]
                self.report(Phase::Connect, What::Conflict { yielded: true }, out);
                job.connects -= 1;
                (self.state, self.waiting) = (State::Idle, Some(job));
                self.connection_asked(now, 0, out);
            }
            // [TIA help "Configuration for point-to-point links"]: the higher priority ignores it; QVZ keeps running.
            STX => self.report(Phase::Connect, What::Conflict { yielded: false }, out),
            // It ended before our STX had been sent, so it does not answer it.
            _ if !self.output.is_out(now) => {}
            DLE => self.send_block(now, job, out),
            NAK => self.connect_failed(now, job, What::Nak, out),
            other => self.connect_failed(now, job, What::Unexpected(other), out),
        }
    }

    /// [S0 "Timeout times"]: QVZ expires after STX, or NAK or any other character follows it: STX is repeated; after
    /// the last repetition NAK, and the attempt is given up.
    pub(super) fn connect_failed(&mut self, now: Instant, job: Job, what: What, out: &mut dyn Sink) {
        self.report(Phase::Connect, what, out);
        if job.connects < self.config.connect_attempts {
            self.report(Phase::Connect, What::Repetition(job.connects), out);
            self.again(now, job, what, out);
        } else {
            self.give_up(now, Phase::Connect, what, out);
        }
    }

    fn send_block(&mut self, now: Instant, job: Job, out: &mut dyn Sink) {
        let mut stage = [0; 128];
        let mut used = 0;
        let mut total = 0;
        for byte in codec::block(&self.tx[..job.len], self.config.bcc) {
            stage[used] = byte;
            used += 1;
            if used == stage.len() {
                out.transmit(&stage);
                total += used;
                used = 0;
            }
        }
        if used > 0 {
            out.transmit(&stage[..used]);
            total += used;
        }
        self.output.end = self.output.end.max(now) + self.config.char_time * total as u64;
        self.output.in_flight = true;
        self.output.nak = false;
        self.state = State::Output { job };
    }

    /// A character came in while the block is being sent.
    pub(super) fn output_character(&mut self, now: Instant, job: Job, byte: u8, out: &mut dyn Sink) {
        if self.output.is_out(now) {
            // The output must have ended, although the line has not reported it yet: this is the answer.
            self.output_done(now, job);
            return self.acknowledge_character(now, job, byte, out);
        }
        match byte {
            NAK => {
                self.take_back(now, out);
                self.report(Phase::Output, What::Nak, out);
                self.repeat_block(now, job, What::Nak, out);
            }
            // DLE too: it comes too early. (0706h)
            other => self.output_disturbed(now, job, What::Unexpected(other), out),
        }
    }

    /// Something other than NAK came in while the block is being sent.
    pub(super) fn output_disturbed(&mut self, now: Instant, job: Job, what: What, out: &mut dyn Sink) {
        self.report(Phase::Output, what, out);
        self.take_back(now, out);
        if self.config.nak_after_silence {
            // [TIA help "Configuration for point-to-point links"]: wait until ZVZ has expired on the line, send NAK,
            // begin again. (CP 341)
            self.silence(now, Some((job, what)));
        } else {
            // [S0 "Timeout times"]: "a character other than DLE": connection and message are repeated.
            self.repeat_block(now, job, what, out);
        }
    }

    /// The last bit of the block has been sent: QVZ begins.
    pub(super) fn output_done(&mut self, now: Instant, job: Job) {
        self.state = State::Acknowledge { job, expiry: now + self.config.qvz };
    }

    /// An answer to the block?
    pub(super) fn acknowledge_character(&mut self, now: Instant, job: Job, byte: u8, out: &mut dyn Sink) {
        match byte {
            DLE => self.end(now, Ok(()), out),
            NAK => self.block_failed(now, job, What::Nak, out),
            other => self.block_failed(now, job, What::Unexpected(other), out),
        }
    }

    /// [S0 "Timeout times"]: QVZ expires after the block, or a character other than DLE is received.
    pub(super) fn block_failed(&mut self, now: Instant, job: Job, what: What, out: &mut dyn Sink) {
        self.report(Phase::Acknowledge, what, out);
        // A block that was refused has not arrived.
        let job = Job { out: job.out || what != What::Nak, ..job };
        self.repeat_block(now, job, what, out);
    }

    /// [S0 "Timeout times"]: connection and message are repeated; after the last repetition NAK, and the end.
    fn repeat_block(&mut self, now: Instant, job: Job, what: What, out: &mut dyn Sink) {
        // The next attempt has connection attempts of its own. (ours)
        let job = Job { connects: 0, blocks: job.blocks + 1, ..job };
        if job.blocks < self.config.block_attempts {
            self.report(Phase::Output, What::Repetition(job.blocks), out);
            self.again(now, job, what, out);
        } else {
            self.give_up(now, Phase::Output, what, out);
        }
    }

    /// Sends STX again: at once if nothing has come, otherwise when the line is quiet.
    fn again(&mut self, now: Instant, job: Job, what: What, out: &mut dyn Sink) {
        if what == What::AckDelay || self.config.quiet.is_zero() {
            return self.connect(now, job, out);
        }
        (self.state, self.waiting) = (State::Idle, Some(job));
        self.wait_for_quiet(now);
    }

    /// The line has been silent for ZVZ after a character without meaning. (CP 341)
    pub(super) fn silent(&mut self, now: Instant, disturbed: Option<(Job, What)>, out: &mut dyn Sink) {
        self.transmit(now, &[NAK], out);
        match disturbed {
            Some((job, what)) => self.repeat_block(now, job, what, out),
            None => self.state = State::Idle,
        }
    }

    fn give_up(&mut self, now: Instant, phase: Phase, what: What, out: &mut dyn Sink) {
        self.report(phase, What::Exhausted, out);
        self.transmit(now, &[NAK], out);
        let error = match what {
            What::AckDelay => SendError::AckDelay,
            What::Nak => SendError::Repetitions,
            _ => SendError::Frame,
        };
        self.end(now, Err(error), out);
    }

    /// The order has ended.
    pub(super) fn end(&mut self, now: Instant, outcome: Result<(), SendError>, out: &mut dyn Sink) {
        self.state = State::Idle;
        self.pause_until = now + self.config.zna;
        out.sent(outcome);
    }
}
