//! CPU -> CP: a telegram collected block by block, and how its order ends [S0 "Example SEND data"].

use crate::cp240::rk512_side::HEADER_BYTES;
use ob1_words::cp240::{
    AREA, BLOCK_BYTES, BUFFER_BYTES, FAILED, count, framed_count, is_telegram_of_any_kind, line_command,
};

/// Error code of a telegram that is longer than the buffer. [S0 L1298]
const TOO_LONG: u8 = 0x17;

/// Error code of a telegram whose kind the protocol does not have (ours): FC 0 with RK 512, FC 2 or FC 3 without,
/// `OR 4000h` elsewhere than at the Modbus slave "long". Without this error the program's block would wait for ever.
const WRONG_KIND: u8 = 0x0C;

/// The progress of an order.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum State {
    /// `TX echo` is 0; the next telegram may begin.
    Idle,
    /// Blocks arrive; `rest` is the count echoed last.
    Collecting { rest: usize },
    /// The order is with the protocol; `rest` stays shown.
    Transmitting { rest: usize },
    /// The error is shown until the CPU has seen it.
    Failed(u8),
    /// The CPU has seen it and must now clear the acknowledgement in `TX`.
    Closing,
    /// The content of `TX` is from before the start: the CPU must clear it first.
    Stale,
    /// The answer to a line command is shown; the CPU must now clear the command in `TX`.
    Answered(u16),
}

/// The effect of the CPU's count.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Step {
    /// Nothing to do: the count has not changed.
    Wait,
    /// A block was stored: the echo has changed.
    Stored,
    /// The telegram is complete, [`SendSide::telegram`] has it: start to transmit.
    Complete,
    /// The CPU gave up before the telegram was complete.
    Discarded,
    /// The telegram is too long, or of a kind that the protocol does not have: this error code is shown.
    Refused(u8),
    /// A line command: [`SendSide::answer`] it.
    Line(u16),
}

/// The send buffer and its handshake.
#[derive(Debug)]
pub(crate) struct SendSide {
    state: State,
    /// RK 512 has a header beside the data.
    buffer: [u8; BUFFER_BYTES + HEADER_BYTES],
    length: usize,
    /// The bit 4000h is permitted: the telegram may be for the Modbus output area.
    area: bool,
    /// It was set in the first count.
    for_output_area: bool,
    /// RK 512: telegrams carry a framing.
    framed: bool,
    /// Framing of the telegram; 0 without.
    framing: u16,
}

impl SendSide {
    pub(crate) const fn new() -> Self {
        Self {
            state: State::Idle,
            buffer: [0; BUFFER_BYTES + HEADER_BYTES],
            length: 0,
            area: false,
            for_output_area: false,
            framed: false,
            framing: 0,
        }
    }

    /// Back to "nothing to send"; true if the protocol had an order that will never be answered.
    pub(crate) fn clear(&mut self) -> bool {
        let aborted = self.is_transmitting();
        self.state = State::Idle;
        self.length = 0;
        aborted
    }

    /// Whether `ANZ OR 4000h` is permitted.
    pub(crate) const fn set_area(&mut self, area: bool) {
        self.area = area;
    }

    /// Whether telegrams are framed, as those of RK 512 are.
    pub(crate) const fn set_framed(&mut self, framed: bool) {
        self.framed = framed;
    }

    /// Framing of the complete telegram.
    pub(crate) const fn framing(&self) -> u16 {
        self.framing
    }

    /// Splits a word into framing and count, according to the protocol's framing.
    const fn count(&self, word: u16) -> Option<(u16, usize)> {
        if self.framed {
            return framed_count(word);
        }
        match count(word) {
            Some(count) => Some((0, count)),
            None => None,
        }
    }

    /// Longest telegram in bytes; with RK 512 its header is added.
    const fn limit(&self) -> usize {
        if self.framed { BUFFER_BYTES + HEADER_BYTES } else { BUFFER_BYTES }
    }

    /// Whether the complete telegram is for the output area.
    pub(crate) const fn for_output_area(&self) -> bool {
        self.for_output_area
    }

    /// A start without start-up identifier: a count in `TX` belongs to a lost telegram. `TX echo` shows 1 until the
    /// count is gone: no job of the CPU continues with 1, and it makes the next job write 0 first.
    pub(crate) const fn begin(&mut self, tx: u16) {
        self.state = if tx == 0 { State::Idle } else { State::Stale };
    }

    /// Whether an order is with the protocol.
    pub(crate) const fn is_transmitting(&self) -> bool {
        matches!(self.state, State::Transmitting { .. })
    }

    /// The complete telegram, until its order has ended.
    pub(crate) fn telegram(&self) -> &[u8] {
        &self.buffer[..self.length]
    }

    /// The word `TX echo` as it is shown.
    pub(crate) const fn echo(&self) -> u16 {
        match self.state {
            State::Idle | State::Closing => 0,
            State::Stale => 1,
            State::Collecting { rest } | State::Transmitting { rest } => self.framing | rest as u16,
            State::Failed(code) => FAILED | code as u16,
            State::Answered(word) => word,
        }
    }

    /// Evaluates `TX` and the block that came with it.
    pub(crate) fn look(&mut self, tx: u16, block: &[u8]) -> Step {
        let has_bit = self.area && tx & AREA != 0;
        let tx = if has_bit { tx & !AREA } else { tx };
        match self.state {
            State::Stale if tx == 0 => {
                self.state = State::Idle;
                Step::Stored
            }
            State::Stale => Step::Wait,
            State::Idle => match self.count(tx) {
                None if is_telegram_of_any_kind(tx) => self.refuse(WRONG_KIND),
                None => line_command(tx).map_or(Step::Wait, Step::Line),
                Some((_, 0)) => Step::Wait,
                Some((_, total)) if total > self.limit() => self.refuse(TOO_LONG),
                Some((framing, total)) => {
                    (self.length, self.for_output_area, self.framing) = (0, has_bit, framing);
                    self.store(total, block)
                }
            },
            State::Collecting { rest } => match self.count(tx) {
                // The counts have run down: the last block is here.
                Some((_, 0)) if rest <= BLOCK_BYTES => {
                    self.state = State::Transmitting { rest };
                    Step::Complete
                }
                Some((_, 0)) => {
                    self.discard();
                    Step::Discarded
                }
                Some((framing, next))
                    if framing == self.framing && rest > BLOCK_BYTES && next == rest - BLOCK_BYTES =>
                {
                    self.store(next, block)
                }
                // The count that was already echoed, or one out of sequence: ignored.
                _ => Step::Wait,
            },
            // A first count must wait.
            State::Transmitting { .. } => Step::Wait,
            State::Failed(_) => {
                if tx != FAILED {
                    return Step::Wait;
                }
                self.state = State::Closing;
                Step::Stored
            }
            State::Closing if tx == FAILED => Step::Wait,
            State::Answered(_) if line_command(tx).is_some() => Step::Wait,
            // 0, or already the first count of the next telegram: the CPU may have overwritten its 0 before the CP has
            // seen it.
            State::Closing | State::Answered(_) => {
                self.state = State::Idle;
                self.look(tx, block)
            }
        }
    }

    /// Drops a telegram that is not complete; true if there was one.
    pub(crate) fn discard(&mut self) -> bool {
        let collecting = matches!(self.state, State::Collecting { .. });
        if collecting {
            self.state = State::Idle;
            self.length = 0;
        }
        collecting
    }

    /// Shows the answer to a line command.
    pub(crate) fn answer(&mut self, word: u16) {
        if self.state == State::Idle {
            self.state = State::Answered(word);
        }
    }

    /// The protocol has finished the order.
    pub(crate) fn ended(&mut self, outcome: Result<(), u8>) {
        if self.is_transmitting() {
            self.state = match outcome {
                Ok(()) => State::Idle,
                Err(code) => State::Failed(code),
            };
            self.length = 0;
        }
    }

    fn refuse(&mut self, code: u8) -> Step {
        self.state = State::Failed(code);
        Step::Refused(code)
    }

    fn store(&mut self, rest: usize, block: &[u8]) -> Step {
        let n = rest.min(BLOCK_BYTES).min(block.len());
        self.buffer[self.length..self.length + n].copy_from_slice(&block[..n]);
        self.length += n;
        self.state = State::Collecting { rest };
        Step::Stored
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const BLOCK: [u8; 12] = *b"abcdefghijkl";

    #[test]
    fn thirty_bytes_are_30_18_6_0() {
        let mut send = SendSide::new();
        for (tx, echo) in [(30, 30), (30, 30), (18, 18), (6, 6)] {
            send.look(tx, &BLOCK);
            assert_eq!(send.echo(), echo);
        }
        assert_eq!(send.look(0, &BLOCK), Step::Complete);
        assert_eq!(send.telegram(), b"abcdefghijklabcdefghijklabcdef");
        assert_eq!(send.echo(), 6, "stays until the protocol is through");
        assert_eq!(send.look(5, &BLOCK), Step::Wait, "left waiting");
        send.ended(Ok(()));
        assert_eq!(send.echo(), 0);
        assert_eq!(send.look(5, &BLOCK), Step::Stored, "the one that waited");
    }

    #[test]
    fn a_telegram_of_exactly_one_block() {
        let mut send = SendSide::new();
        assert_eq!(send.look(12, &BLOCK), Step::Stored);
        assert_eq!(send.look(0, &BLOCK), Step::Complete);
        assert_eq!(send.telegram(), BLOCK);
    }

    #[test]
    fn zero_before_the_counts_have_run_down_discards() {
        let mut send = SendSide::new();
        send.look(13, &BLOCK);
        assert_eq!(send.look(0, &BLOCK), Step::Discarded);
        assert_eq!(send.echo(), 0);
        assert_eq!(send.look(1, b"x"), Step::Stored, "the next one may follow");
        assert_eq!(send.telegram(), b"x");
    }

    #[test]
    fn words_that_are_no_count_are_absent() {
        let mut send = SendSide::new();
        for word in [0x8000, 0x8001, 0x2000, 0x2007, 0x4000, 0x0800, 0x1000, 0x6010, 0x5010, 0xFFFF] {
            assert_eq!(send.look(word, &BLOCK), Step::Wait, "{word:04X}h");
            assert_eq!(send.echo(), 0);
        }
        send.look(30, &BLOCK);
        for word in [29, 12, 6, 31, 17, 1024, 0x8000, 0x4012] {
            assert_eq!(send.look(word, &BLOCK), Step::Wait, "{word:04X}h does not follow 30");
            assert_eq!(send.echo(), 30);
        }
    }

    #[test]
    fn a_line_command_is_answered_until_it_is_taken_back() {
        let mut send = SendSide::new();
        assert_eq!(send.look(0x1805, &BLOCK), Step::Line(5));
        send.answer(0x1C3F);
        assert_eq!((send.look(0x1805, &BLOCK), send.echo()), (Step::Wait, 0x1C3F));
        send.look(0, &BLOCK);
        assert_eq!(send.echo(), 0);
        send.look(0x1800, &BLOCK);
        send.answer(0x1C00);
        assert_eq!(send.look(5, &BLOCK), Step::Stored, "a 0 that was overwritten is not waited for");
        assert_eq!(send.look(0x1805, &BLOCK), Step::Wait, "not while a telegram is collected");
    }

    #[test]
    fn too_long_is_refused_with_17h() {
        for word in [1025, 0x07FF] {
            let mut send = SendSide::new();
            assert_eq!(send.look(word, &BLOCK), Step::Refused(0x17));
            assert_eq!(send.echo(), 0x2017);
        }
        let mut send = SendSide::new();
        assert_eq!(send.look(1024, &BLOCK), Step::Stored);
    }

    #[test]
    fn a_kind_the_protocol_does_not_have_is_refused_with_0ch() {
        for (framed, area, word) in [
            (false, false, 0x4010), // OR 4000h elsewhere than at the Modbus slave "long"
            (false, false, 0x0810), // FC 2 or FC 3 without RK 512
            (false, false, 0x1001), // FC 4 without RK 512
            (true, false, 30),      // FC 0 with RK 512
            (true, false, 0x4010),
            (false, true, 0x0810),
        ] {
            let mut send = SendSide::new();
            send.set_framed(framed);
            send.set_area(area);
            assert_eq!(send.look(word, &BLOCK), Step::Refused(0x0C), "{word:04X}h");
            assert_eq!(send.echo(), 0x200C);
            send.look(FAILED, &BLOCK);
            send.look(0, &BLOCK);
            assert_eq!(send.echo(), 0, "{word:04X}h");
        }
    }

    #[test]
    fn a_failure_is_shown_until_it_is_acknowledged() {
        let mut send = SendSide::new();
        send.look(1, &BLOCK);
        send.look(0, &BLOCK);
        send.ended(Err(0x0A));
        assert_eq!(send.echo(), 0x200A);
        send.look(0, &BLOCK);
        send.look(5, &BLOCK);
        assert_eq!(send.echo(), 0x200A, "neither 0 nor a count acknowledges it");
        send.look(FAILED, &BLOCK);
        assert_eq!(send.echo(), 0);
        send.look(0, &BLOCK);
        assert_eq!(send.look(5, &BLOCK), Step::Stored);
    }

    #[test]
    fn a_zero_that_was_overwritten_is_not_waited_for() {
        let mut send = SendSide::new();
        send.look(1025, &BLOCK);
        send.look(FAILED, &BLOCK);
        assert_eq!(send.look(FAILED, &BLOCK), Step::Wait);
        assert_eq!(send.look(5, &BLOCK), Step::Stored);
    }
}
