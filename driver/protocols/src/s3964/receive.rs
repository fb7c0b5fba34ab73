//! The receiving role: accept a connection, receive the block, check it, acknowledge or refuse it.

use super::codec::{DLE, Decoder, NAK, STX, Step};
use super::send::Job;
use super::{BUFFER_POLL, S3964, State};
use crate::machine::{Instant, Phase, Sink, What};

/// A block being received; its user data are in the machine's `rx`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Block {
    decoder: Decoder,
    /// Bytes of user data so far.
    len: usize,
    /// Characters so far, unreadable ones included.
    characters: usize,
    /// The request for the connection was repeated before our DLE had been sent.
    asked_again: bool,
    /// The last character was STX, and came then; the request is one.
    asked: Option<Instant>,
    /// An error has been noted (and reported): the block will be refused at its end.
    bad: bool,
    /// How often this block has been refused before.
    refused: u16,
}

impl Block {
    /// Its first character has come.
    pub(super) fn begun(&self) -> bool {
        self.characters > 0
    }
}

impl<const N: usize> S3964<N> {
    /// A character while the line is free. `refused`: a block was refused that often and its repetition is awaited.
    pub(super) fn idle_character(&mut self, now: Instant, byte: u8, refused: u16, out: &mut dyn Sink) {
        match byte {
            STX => {
                if self.given_up_until.take().is_some_and(|until| now < until) {
                    self.report(Phase::Idle, What::OneMoreRepetition, out);
                }
                self.connection_asked(now, refused, out);
            }
            // [S0 "Passive operation"]: NAK is not answered. A partner that gives up its block sends NAK.
            // [TIA help "Configuration for point-to-point links"]
            NAK => {
                self.given_up_until = None;
                if self.waiting.as_ref().is_some_and(Job::is_repeated) {
                    self.wait_for_quiet(now);
                }
            }
            other => self.unexpected(now, What::Unexpected(other), out),
        }
    }

    /// [S0 "Passive operation"]: a character that is not STX while a connection request is expected: NAK.
    pub(super) fn unexpected(&mut self, now: Instant, what: What, out: &mut dyn Sink) {
        self.report(Phase::Idle, what, out);
        if self.config.nak_after_silence {
            self.silence(now, None);
        } else if !self.output.nak || self.output.is_out(now) {
            // One NAK at a time: it also answers what comes in while it is being sent.
            self.transmit(now, &[NAK], out);
            self.output.nak = true;
        }
    }

    /// The partner has sent STX.
    pub(super) fn connection_asked(&mut self, now: Instant, refused: u16, out: &mut dyn Sink) {
        if out.room() > 0 {
            self.accept(now, refused, out);
        } else if !self.config.buffer_wait.is_zero() {
            // [TIA help "Configuration for point-to-point links"]: up to 400 ms for a buffer. (CP 341)
            let until = now + self.config.buffer_wait;
            self.state = State::Buffer { until, poll: now + BUFFER_POLL, refused };
        } else {
            // [S0 "Data Link Escape (DLE-character)"]: STX while it is not ready: NAK.
            self.refuse_connection(now, out);
        }
    }

    fn accept(&mut self, now: Instant, refused: u16, out: &mut dyn Sink) {
        self.transmit(now, &[DLE], out);
        let block = Block {
            decoder: Decoder::new(self.config.bcc),
            len: 0,
            characters: 0,
            asked_again: false,
            asked: Some(now),
            bad: false,
            refused,
        };
        self.state = State::Receive { block, expiry: self.expiry_unreported(self.config.zvz()) };
    }

    fn refuse_connection(&mut self, now: Instant, out: &mut dyn Sink) {
        self.report(Phase::Idle, What::NoBuffer, out);
        self.transmit(now, &[NAK], out);
        self.state = State::Idle;
    }

    /// A partner waits for a buffer. (CP 341)
    pub(super) fn buffer_tick(
        &mut self,
        now: Instant,
        until: Instant,
        poll: Instant,
        refused: u16,
        out: &mut dyn Sink,
    ) {
        if out.room() > 0 {
            self.accept(now, refused, out);
        } else if now >= until {
            self.refuse_connection(now, out);
        } else if now >= poll {
            self.state = State::Buffer { until, poll: now + BUFFER_POLL, refused };
        }
    }

    /// A character of the block. ZVZ begins again with each. [S0 "Timeout times"]
    pub(super) fn receive_character(&mut self, now: Instant, mut block: Block, byte: u8, out: &mut dyn Sink) {
        if byte == STX && self.is_repetition(now, &block) {
            self.report(Phase::Idle, What::Unexpected(byte), out);
            return self.connection_asked(now, block.refused, out);
        }
        block.asked = (byte == STX).then_some(now);
        if byte == STX && !block.begun() {
            if !self.output.is_out(now) {
                // Our DLE comes so late that the partner has repeated its request. (0802h)
                block.asked_again = true;
                self.state = State::Receive { block, expiry: self.expiry_unreported(self.config.zvz()) };
                return self.report(Phase::Idle, What::Unexpected(byte), out);
            }
            if block.asked_again {
                // One more of these, or the first of the data? As data, two of them would not change the BCC: so the
                // partner must repeat the block.
                self.note(&mut block, What::Unexpected(byte), out);
            }
        }
        block.characters += 1;
        match block.decoder.push(byte) {
            Step::More => {}
            Step::Data(byte) => match self.rx.get_mut(block.len) {
                Some(place) if block.len < self.config.telegram_max => {
                    *place = byte;
                    block.len += 1;
                }
                _ => self.note(&mut block, What::TooLong, out),
            },
            Step::BadDle(other) => self.note(&mut block, What::BadDle(other), out),
            Step::End { check } => {
                if let Some((computed, received)) = check
                    && computed != received
                {
                    self.note(&mut block, What::BadCheck { computed, received }, out);
                }
                return self.block_complete(now, block, out);
            }
        }
        self.state = State::Receive { block, expiry: now + self.config.zvz() };
    }

    /// Whether an STX is the request for the connection once more: "When the QVZ expires after an STX, the STX is
    /// repeated" [S0 L1631], by a partner that has not had our DLE. Where ZVZ is longer than QVZ it would keep the
    /// block open as long as the partner asks, and neither side could ever send. A quarter of QVZ is for the partner's
    /// clock. (ours)
    fn is_repetition(&self, now: Instant, block: &Block) -> bool {
        let qvz = self.config.qvz;
        !qvz.is_zero() && block.asked.is_some_and(|asked| now >= asked + qvz * 3 / 4)
    }

    /// Takes the user data at the beginning of `characters`, as [`Self::receive_character`] would one by one. It leaves
    /// the first character of a block and what follows STX, which may be a repeated STX.
    pub(crate) fn receive_plain(&mut self, now: Instant, characters: &mut &[u8]) {
        let zvz = self.config.zvz();
        let State::Receive { block, expiry } = &mut self.state else { return };
        let end = self.config.telegram_max.min(N);
        let places = match self.rx.get_mut(block.len..end) {
            Some(places) if block.begun() && block.asked.is_none() => places,
            _ => return,
        };
        let taken = block.decoder.plain(characters, places);
        if taken > 0 {
            block.len += taken;
            block.characters += taken;
            block.asked = (characters[taken - 1] == STX).then_some(now);
            *expiry = now + zvz;
            *characters = &characters[taken..];
        }
    }

    /// A character of the block could not be read: the block is received to its end, then refused.
    /// [TIA help "Configuration for point-to-point links"]
    pub(super) fn receive_unreadable(&mut self, now: Instant, mut block: Block, what: What, out: &mut dyn Sink) {
        block.characters += 1;
        block.asked = None;
        self.note(&mut block, what, out);
        if block.decoder.unreadable() {
            return self.block_complete(now, block, out);
        }
        self.state = State::Receive { block, expiry: now + self.config.zvz() };
    }

    /// Notes the first error of a block.
    fn note(&self, block: &mut Block, what: What, out: &mut dyn Sink) {
        if !block.bad {
            block.bad = true;
            self.report(Phase::Receive, what, out);
        }
    }

    fn block_complete(&mut self, now: Instant, mut block: Block, out: &mut dyn Sink) {
        match out.room() {
            // It is not longer than the longest telegram, so the buffer is in use. (080Ah)
            room if room == 0 || block.len > room => self.note(&mut block, What::NoBuffer, out),
            // Nobody sends an empty telegram: without a check character this is a telegram that has lost its
            // characters, and an acknowledgement would tell the partner that it has arrived. (ours)
            _ if block.len == 0 && !self.config.bcc => self.note(&mut block, What::Empty, out),
            _ => {}
        }
        if block.bad {
            return self.refuse_block(now, block, out);
        }
        self.transmit(now, &[DLE], out);
        self.state = State::Idle;
        if block.len == 0 {
            self.report(Phase::Receive, What::Empty, out);
        } else {
            out.deliver(&self.rx[..block.len]);
        }
    }

    /// [S0 "Block check character (BCC-Byte)"]: NAK instead of DLE.
    fn refuse_block(&mut self, now: Instant, block: Block, out: &mut dyn Sink) {
        self.transmit(now, &[NAK], out);
        let refused = block.refused + 1;
        self.state = if self.config.repetition_wait.is_zero() {
            // [S0 "Data Link Escape (DLE-character)"]: NAK, and wait for another connection request.
            State::Idle
        } else if refused < self.config.block_attempts {
            self.report(Phase::Receive, What::Refused(refused), out);
            State::Repetition { until: self.output.end + self.config.repetition_wait, refused }
        } else {
            self.report(Phase::Receive, What::Exhausted, out);
            self.given_up_until = Some(self.output.end + self.config.repetition_wait);
            State::Idle
        };
    }

    /// [S0 "Passive operation"]: ZVZ is exceeded at reception: NAK, and wait for a new connection.
    pub(super) fn character_delay(&mut self, now: Instant, mut block: Block, out: &mut dyn Sink) {
        self.note(&mut block, What::CharacterDelay, out);
        self.transmit(now, &[NAK], out);
        self.state = State::Idle;
    }
}
