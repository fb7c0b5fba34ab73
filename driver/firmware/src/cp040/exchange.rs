//! Both directions of the host protocol in one pair of register areas, and the reset over both. [S3 "In/Output area"]

use super::receive::{self, ReceiveSide};
use super::send::{self, SendSide};
use ob1_words::cp040::{Area, IO_BYTES, RESET, nibbles};

/// The effect of the host's output bytes; at most one in each direction.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Step {
    /// The host has requested a reset: empty both directions with [`Exchange::clear`].
    Reset,
    /// The steps of the two directions.
    Both(send::Step, receive::Step),
}

/// The CP's side of the host protocol.
#[derive(Debug)]
pub(crate) struct Exchange {
    io_bytes: usize,
    outputs: Area,
    /// The outputs contain a reset command.
    reset: bool,
    pub(crate) send: SendSide,
    pub(crate) receive: ReceiveSide,
}

impl Exchange {
    /// Areas of `io_bytes` bytes, clamped to 8 to 60.
    pub(crate) fn new(io_bytes: usize) -> Self {
        Self {
            io_bytes: io_bytes.clamp(*IO_BYTES.start(), *IO_BYTES.end()),
            outputs: [0; *IO_BYTES.end()],
            reset: false,
            send: SendSide::new(),
            receive: ReceiveSide::new(),
        }
    }

    pub(crate) const fn io_bytes(&self) -> usize {
        self.io_bytes
    }

    /// Sets the current output bytes.
    pub(crate) fn set_outputs(&mut self, outputs: &[u8]) {
        for (to, from) in self.outputs.iter_mut().zip(outputs) {
            *to = *from;
        }
    }

    pub(crate) fn outputs(&self) -> &[u8] {
        &self.outputs[..self.io_bytes]
    }

    /// Empties both directions. The present content of the outputs is old and is not taken for a telegram.
    ///
    /// Returns whether an order was aborted, and how many telegrams were dropped.
    pub(crate) fn clear(&mut self, telegrams_max: u8) -> (bool, usize) {
        let (_, command) = nibbles(self.outputs());
        (self.send.clear(command), self.receive.clear(telegrams_max))
    }

    /// Evaluates the outputs: what the host's two nibbles ask for.
    pub(crate) fn look(&mut self) -> Step {
        let (acknowledgement, command) = nibbles(self.outputs());
        if command == RESET || acknowledgement == RESET {
            let step = if self.reset { Step::Both(send::Step::Wait, receive::Step::Wait) } else { Step::Reset };
            self.reset = true;
            return step;
        }
        self.reset = false;
        Step::Both(self.look_send(), self.look_receive())
    }

    /// Evaluates only the command: an order has ended.
    pub(crate) fn look_send(&mut self) -> send::Step {
        let (_, command) = nibbles(&self.outputs);
        if self.reset { send::Step::Wait } else { self.send.look(command, &self.outputs[..self.io_bytes]) }
    }

    /// Evaluates only the acknowledgement: a telegram has come.
    pub(crate) fn look_receive(&mut self) -> receive::Step {
        let (acknowledgement, _) = nibbles(&self.outputs);
        if self.reset { receive::Step::Wait } else { self.receive.look(acknowledgement, self.io_bytes) }
    }

    /// The input bytes; those beyond the IO size are 0.
    pub(crate) fn inputs(&self) -> Area {
        let mut inputs = *self.receive.shown();
        let answer = if self.reset { ob1_words::cp040::RESET_DONE } else { self.send.nibble() };
        inputs[0] = answer << 4 | self.receive.nibble();
        inputs
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ob1_words::cp040::{IDLE, LAST};

    fn cp(io_bytes: usize) -> Exchange {
        let mut cp = Exchange::new(io_bytes);
        cp.clear(250);
        cp.set_outputs(&[0x88]);
        cp.look();
        cp
    }

    /// The host writes byte 0 and what follows; the answer is byte 0 of the inputs.
    fn write(cp: &mut Exchange, front: &[u8], data: core::ops::Range<u8>) -> (Step, u8) {
        let mut outputs: Vec<u8> = front.iter().copied().chain(data).collect();
        outputs.resize(cp.io_bytes(), 0xEE);
        cp.set_outputs(&outputs);
        (cp.look(), cp.inputs()[0])
    }

    const STORED: Step = Step::Both(send::Step::Stored, receive::Step::Wait);
    const COMPLETE: Step = Step::Both(send::Step::Complete, receive::Step::Wait);

    #[test]
    fn send_without_fragmentation() {
        // [S3 L323] IO size 60, length 40: 0A, 00, 00, 28, data -> A0.
        let mut cp = cp(60);
        assert_eq!(write(&mut cp, &[0x8A, 0, 0, 0x28], 0..40), (COMPLETE, 0x88));
        assert_eq!(cp.send.telegram(), Vec::from_iter(0..40));
        cp.send.ended(Ok(()));
        assert_eq!(cp.inputs()[0], 0xA8);
        assert_eq!(write(&mut cp, &[0x88], 0..0).1, 0x88);
    }

    #[test]
    fn send_with_fragmentation() {
        // [S3 L323], [S3 L325] IO size 16, length 50 (32h; 28h is a misprint): 09 -> 90, 00 -> 00, 01 -> 10, 0A -> A0.
        let mut cp = cp(16);
        assert_eq!(write(&mut cp, &[0x89, 0, 0, 0x32], 0..12), (STORED, 0x98));
        assert_eq!(write(&mut cp, &[0x80], 12..27), (STORED, 0x08));
        assert_eq!(write(&mut cp, &[0x81], 27..42), (STORED, 0x18));
        assert_eq!(write(&mut cp, &[0x8A], 42..50), (COMPLETE, 0x18));
        assert_eq!(cp.send.telegram(), Vec::from_iter(0..50));
        cp.send.ended(Ok(()));
        assert_eq!(cp.inputs()[0], 0xA8);
    }

    #[test]
    fn receive_without_fragmentation() {
        // [S3 L325] IO size 60, length 40: 0A, 00, 00, 2A, 00, 00, data; acknowledged with A0.
        let mut cp = cp(60);
        cp.receive.push(None, &Vec::from_iter(0..40));
        assert_eq!(cp.look_receive(), receive::Step::Offered);
        assert_eq!(cp.inputs()[..6], [0x8A, 0, 0, 0x2A, 0, 0]);
        assert_eq!(cp.inputs()[6..46], Vec::from_iter(0..40));
        let delivered = Step::Both(send::Step::Wait, receive::Step::Delivered(Some(40)));
        assert_eq!(write(&mut cp, &[0xA8], 0..0), (delivered, 0x88));
    }

    #[test]
    fn receive_with_fragmentation() {
        // [S3 L325], [S3 L327] IO size 16, length 40: 09 acknowledged with 90, 00 with 00, 0A with A0.
        let mut cp = cp(16);
        cp.receive.push(None, &Vec::from_iter(0..40));
        cp.look_receive();
        assert_eq!(cp.inputs()[..16], [0x89, 0, 0, 0x2A, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9]);
        write(&mut cp, &[0x98], 0..0);
        assert_eq!(cp.inputs()[0], 0x80);
        assert_eq!(cp.inputs()[1..16], Vec::from_iter(10..25));
        write(&mut cp, &[0x08], 0..0);
        assert_eq!(cp.inputs()[0], 0x8A);
        assert_eq!(cp.inputs()[1..16], Vec::from_iter(25..40));
        let delivered = Step::Both(send::Step::Wait, receive::Step::Delivered(Some(40)));
        assert_eq!(write(&mut cp, &[0xA8], 0..0), (delivered, 0x88));
    }

    #[test]
    fn a_reset_is_answered_with_c_in_either_nibble() {
        for reset in [0x8B, 0xB8, 0xBB] {
            let mut cp = cp(16);
            cp.receive.push(None, &[1, 2, 3]);
            write(&mut cp, &[0x89, 0, 0, 0x32], 0..12);
            assert_eq!(write(&mut cp, &[reset], 0..0).0, Step::Reset);
            assert_eq!(cp.clear(250), (false, 1));
            assert_eq!(cp.inputs()[0], 0xC8);
            let nothing = Step::Both(send::Step::Wait, receive::Step::Wait);
            assert_eq!(write(&mut cp, &[reset], 0..0), (nothing, 0xC8), "once");
            assert_eq!(write(&mut cp, &[0x88], 0..0), (nothing, 0x88));
        }
    }

    #[test]
    fn what_stands_there_at_the_start_is_sent_by_nobody() {
        for old in [0x8A, 0x89] {
            let mut cp = Exchange::new(16);
            cp.set_outputs(&[old, 0, 0, 3, 1, 2, 3]);
            cp.clear(250);
            assert_eq!(cp.inputs()[0], 0xC8, "the host sees that it is not synchronised");
            assert_eq!(cp.look(), Step::Both(send::Step::Wait, receive::Step::Wait));
            assert_eq!(write(&mut cp, &[0x88], 0..0).1, IDLE << 4 | IDLE);
            assert_eq!(write(&mut cp, &[0x80 | LAST, 0, 0, 3], 1..4).0, COMPLETE);
        }
    }
}
