//! Host -> CP: a telegram collected fragment by fragment, and how its order ends [S3 "Sending data"].

use ob1_protocols::SendError;
use ob1_words::cp040::{BAD_LENGTH, FAILED, FIRST, HEAD_BYTES, IDLE, INFO_PLAIN, LAST, RESET, RESET_DONE, nibble};
use ob1_words::cp240::BUFFER_BYTES;

/// The progress of an order.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum State {
    /// The next telegram may begin.
    Idle,
    /// Piece `piece` was stored, and its nibble is shown as the answer.
    Collecting { piece: usize, shown: u8 },
    /// The order is with the protocol; the answer to the previous piece stays shown.
    Transmitting { shown: u8, withdrawn: bool },
    /// The order is over: `A` or `E`; or it was refused: `D` or `E`.
    Answered { shown: u8 },
    /// "Reset was executed": shown until the outputs contain nothing that could be taken for the beginning of a
    /// telegram.
    Reset,
}

/// The effect of the host's command.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Step {
    /// Nothing to do: no new command.
    Wait,
    /// A fragment was stored.
    Stored,
    /// The telegram is complete: start to transmit.
    Complete,
    /// The host gave up before the telegram was complete.
    Discarded,
    /// The length is not valid, or the fragments do not fit it (`D`).
    BadLength,
    /// A fragment came out of order (`E`).
    BadOrder,
}

/// The send buffer and its handshake.
#[derive(Debug)]
pub(crate) struct SendSide {
    state: State,
    buffer: [u8; BUFFER_BYTES],
    /// User bytes announced, and stored so far.
    length: usize,
    stored: usize,
}

impl SendSide {
    pub(crate) const fn new() -> Self {
        Self { state: State::Idle, buffer: [0; BUFFER_BYTES], length: 0, stored: 0 }
    }

    /// Drops everything; true if the protocol had an order that will never be answered.
    ///
    /// An old `command` of a host that has received no answer must not send its telegram a second time.
    pub(crate) fn clear(&mut self, command: u8) -> bool {
        let aborted = self.is_transmitting();
        self.state = if matches!(command, FIRST | LAST | RESET) { State::Reset } else { State::Idle };
        aborted
    }

    /// Whether an order is with the protocol.
    pub(crate) const fn is_transmitting(&self) -> bool {
        matches!(self.state, State::Transmitting { .. })
    }

    /// The complete telegram, until its order has ended.
    pub(crate) fn telegram(&self) -> &[u8] {
        &self.buffer[..self.length]
    }

    /// The acknowledgement: high nibble of input byte 0.
    pub(crate) const fn nibble(&self) -> u8 {
        match self.state {
            State::Idle => IDLE,
            State::Reset => RESET_DONE,
            State::Collecting { shown, .. } | State::Transmitting { shown, .. } | State::Answered { shown } => shown,
        }
    }

    /// Evaluates the command and the output area that contains it.
    pub(crate) fn look(&mut self, command: u8, area: &[u8]) -> Step {
        match self.state {
            State::Idle => match command {
                FIRST | LAST => self.begin(command, area),
                // Idle, or a fragment without a telegram: output bytes that were never written are 0.
                _ => Step::Wait,
            },
            State::Collecting { shown, .. } if command == shown => Step::Wait,
            State::Collecting { .. } if command == IDLE => {
                self.state = State::Idle;
                Step::Discarded
            }
            State::Collecting { piece, .. } => self.follow(piece + 1, command, area),
            State::Transmitting { shown, .. } => {
                // A host that withdraws the command wants no answer, and another telegram must not get it.
                if command == IDLE {
                    self.state = State::Transmitting { shown, withdrawn: true };
                }
                Step::Wait
            }
            // A refused telegram: its remaining fragments do not belong to another one. The host has to go to idle.
            State::Answered { shown } if command == IDLE || shown == LAST && command == FIRST => {
                self.state = State::Idle;
                self.look(command, area)
            }
            State::Reset if !matches!(command, FIRST | LAST | RESET) => {
                self.state = State::Idle;
                Step::Wait
            }
            State::Answered { .. } | State::Reset => Step::Wait,
        }
    }

    fn begin(&mut self, command: u8, area: &[u8]) -> Step {
        // The telegram info is fixed when sending. [S3 L313]
        let [_, info, high, low, data @ ..] = area else { return Step::Wait };
        let length = usize::from(u16::from_be_bytes([*high, *low]));
        let total = HEAD_BYTES + length;
        let expected = nibble(0, total, area.len() - 1);
        if !(1..=BUFFER_BYTES).contains(&length) || *info != INFO_PLAIN || command != expected {
            self.state = State::Answered { shown: BAD_LENGTH };
            return Step::BadLength;
        }
        (self.length, self.stored) = (length, 0);
        self.store(0, command, data)
    }

    fn follow(&mut self, piece: usize, command: u8, area: &[u8]) -> Step {
        if !matches!(command, 0..=7 | LAST) {
            // 9h inside a telegram; the others are not commands of the host.
            if command == FIRST {
                self.state = State::Answered { shown: FAILED };
                return Step::BadOrder;
            }
            return Step::Wait;
        }
        let expected = nibble(piece, HEAD_BYTES + self.length, area.len() - 1);
        if command == expected {
            return self.store(piece, command, &area[1..]);
        }
        let (shown, step) =
            if command == LAST || expected == LAST { (BAD_LENGTH, Step::BadLength) } else { (FAILED, Step::BadOrder) };
        self.state = State::Answered { shown };
        step
    }

    fn store(&mut self, piece: usize, command: u8, data: &[u8]) -> Step {
        let count = data.len().min(self.length - self.stored);
        self.buffer[self.stored..self.stored + count].copy_from_slice(&data[..count]);
        self.stored += count;
        if command == LAST {
            self.state = State::Transmitting { shown: self.nibble(), withdrawn: false };
            return Step::Complete;
        }
        self.state = State::Collecting { piece, shown: command };
        Step::Stored
    }

    /// The order is over. A telegram that the protocol does not take has no valid length or content. [S3 L315]
    pub(crate) fn ended(&mut self, outcome: Result<(), SendError>) {
        if let State::Transmitting { withdrawn, .. } = self.state {
            let shown = match outcome {
                Ok(()) => LAST,
                Err(SendError::TooLong | SendError::NoRequest) => BAD_LENGTH,
                Err(_) => FAILED,
            };
            self.state = if withdrawn { State::Idle } else { State::Answered { shown } };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn area(command: u8, rest: &[u8]) -> [u8; 16] {
        let mut area = [0xEE; 16];
        area[0] = command;
        area[1..=rest.len()].copy_from_slice(rest);
        area
    }

    fn look(side: &mut SendSide, command: u8, rest: &[u8]) -> (Step, u8) {
        let step = side.look(command, &area(command, rest));
        (step, side.nibble())
    }

    #[test]
    fn lengths_that_are_none_are_answered_with_d() {
        let mut side = SendSide::new();
        for (command, high, low) in [(LAST, 0, 0), (FIRST, 4, 1), (LAST, 0, 13), (FIRST, 0, 12), (FIRST, 0xFF, 0xFF)] {
            assert_eq!(
                look(&mut side, command, &[0, high, low]),
                (Step::BadLength, BAD_LENGTH),
                "{high:02X}{low:02X}h"
            );
            assert_eq!(look(&mut side, 0, &[]), (Step::Wait, BAD_LENGTH), "only idle ends it");
            assert_eq!(look(&mut side, IDLE, &[]), (Step::Wait, IDLE));
        }
        assert_eq!(look(&mut side, LAST, &[4, 0, 1]), (Step::BadLength, BAD_LENGTH), "an offset cannot be sent");
    }

    #[test]
    fn fragments_out_of_order_are_answered_with_e_and_send_nothing() {
        let mut side = SendSide::new();
        for (second, expected) in [(1, Step::BadOrder), (7, Step::BadOrder), (LAST, Step::BadLength)] {
            assert_eq!(look(&mut side, FIRST, &[0, 0, 50]), (Step::Stored, FIRST));
            assert_eq!(look(&mut side, FIRST, &[]), (Step::Wait, FIRST));
            assert_eq!(look(&mut side, second, &[]).0, expected);
            assert_eq!(look(&mut side, LAST, &[]).0, Step::Wait);
            assert_eq!(look(&mut side, IDLE, &[]), (Step::Wait, IDLE));
        }
    }

    #[test]
    fn giving_up_discards() {
        let mut side = SendSide::new();
        look(&mut side, FIRST, &[0, 0, 50]);
        look(&mut side, 0, &[]);
        assert_eq!(look(&mut side, IDLE, &[]), (Step::Discarded, IDLE));
        assert_eq!(look(&mut side, 1, &[]), (Step::Wait, IDLE));
    }

    #[test]
    fn a_withdrawn_order_answers_nobody_else() {
        let mut side = SendSide::new();
        assert_eq!(look(&mut side, LAST, &[0, 0, 1, b'a']), (Step::Complete, IDLE));
        assert_eq!(look(&mut side, IDLE, &[]), (Step::Wait, IDLE));
        assert_eq!(look(&mut side, LAST, &[0, 0, 1, b'b']), (Step::Wait, IDLE));
        side.ended(Ok(()));
        assert_eq!(look(&mut side, LAST, &[0, 0, 1, b'b']), (Step::Complete, IDLE), "now it is its turn");
        assert_eq!(side.telegram(), b"b");
        side.ended(Err(SendError::AckDelay));
        assert_eq!(side.nibble(), FAILED);
    }
}
