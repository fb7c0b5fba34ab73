//! CP -> host. [S3 "Receiving data"]

use super::failure::Failure;
use crate::cp040::{FIRST, HEAD_BYTES, IDLE, INFO_OFFSET, LAST, OFFSET_BYTES, RETURN_BYTES, TELEGRAM_MAX, nibble};

use super::send::SendJob;
use super::wire::is_absent;

/// The phase of a job.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
enum Phase {
    /// No telegram is being fetched.
    #[default]
    Idle,
    /// Fragment `piece` was stored, more will follow.
    Taking,
    /// The last fragment was stored; the CP must remove it from the inputs.
    Closing,
}

/// A telegram that is being fetched from the CP. It must be fetched completely: "the host system has to acknowledge
/// each fragment".
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ReceiveJob {
    phase: Phase,
    piece: u8,
    /// User bytes of the whole telegram, without return value and offset.
    length: u16,
    /// Offset word, if the telegram has one.
    offset: Option<u16>,
}

/// A fragment to store.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Take {
    /// First user byte among the inputs.
    pub from: usize,
    /// Number of user bytes of this fragment.
    pub count: usize,
    /// Position in the receive area: "Data_Offset", which includes the offset of the telegram. [S3 L11]
    pub at: usize,
    /// High nibble of output byte 0, to be written once the bytes are stored.
    pub acknowledge: u8,
    /// The received telegram, if this is the last fragment.
    pub received: Option<Received>,
}

/// A telegram that was fetched completely, or an error in its place.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Received {
    /// User bytes; 0 for an error.
    pub length: u16,
    /// 0000h, or an error reported by the CP: 0517h, 080Ah, 080Ch.
    pub return_value: u16,
}

/// What the host does next with the CP's inputs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ReceiveStep {
    /// Leave the outputs unchanged.
    Wait,
    /// Store this fragment, acknowledge it, and keep the new job; or keep the old job, then the fragment is returned
    /// again.
    Take(Take),
    /// Write only this high nibble of byte 0.
    Acknowledge(u8),
    /// The telegram is incomplete and ends. The acknowledgement returns to [`IDLE`].
    Failed(Failure),
}

impl ReceiveJob {
    /// Whether a telegram is partly received.
    pub const fn is_running(self) -> bool {
        matches!(self.phase, Phase::Taking)
    }

    /// Whether its newest fragment is the first.
    pub const fn is_at_first(self) -> bool {
        self.piece == 0
    }

    /// The number of bytes of the receive area that the telegram needs; known from its first fragment on.
    pub fn end(self) -> usize {
        usize::from(self.offset.unwrap_or(0)) + usize::from(self.length)
    }

    /// One step: the CP's inputs (as many as the CP has, 8 to 60), byte 0 of the outputs as last written, and the job
    /// of the other direction, whose answer stands in byte 0 of the inputs beside fragment 0: both can be 0, for as
    /// long as the CP transmits.
    pub fn step(self, inputs: &[u8], output0: u8, send: SendJob) -> (Self, ReceiveStep) {
        if is_absent(inputs, output0) && !send.shows_0(inputs.len()) {
            return (self, ReceiveStep::Wait);
        }
        let info = inputs.first().map_or(IDLE, |byte| byte & 0x0F);
        let shown = output0 >> 4;
        match self.phase {
            Phase::Idle if info == FIRST || info == LAST => Self::begin(info, inputs),
            Phase::Closing if info == LAST => (self, ReceiveStep::Wait),
            Phase::Closing if info == FIRST => Self::begin(info, inputs),
            Phase::Idle | Phase::Closing if shown != IDLE => (Self::default(), ReceiveStep::Acknowledge(IDLE)),
            // A fragment of a telegram whose first fragment was not seen: this needs a reset.
            Phase::Idle | Phase::Closing => (Self::default(), ReceiveStep::Wait),
            Phase::Taking => self.follow(info, inputs),
        }
    }

    fn begin(info: u8, inputs: &[u8]) -> (Self, ReceiveStep) {
        const BAD: (ReceiveJob, ReceiveStep) =
            (ReceiveJob { phase: Phase::Idle, piece: 0, length: 0, offset: None }, ReceiveStep::Wait);
        let failed = (Self::default(), ReceiveStep::Failed(Failure::NotSynchronised));
        let [_, kind, high, low, rest @ ..] = inputs else { return BAD };
        let (offset, rest) = match (*kind, rest) {
            (INFO_OFFSET, [high, low, rest @ ..]) => (Some(u16::from_be_bytes([*high, *low])), rest),
            (0, rest) => (None, rest),
            _ => return failed,
        };
        let [value_high, value_low, ..] = rest else { return BAD };
        // The length counts the return value. [S3 L321]
        let counted = u16::from_be_bytes([*high, *low]);
        let Some(length) = counted.checked_sub(RETURN_BYTES as u16).filter(|length| *length <= TELEGRAM_MAX) else {
            return failed;
        };
        let job = Self { phase: Phase::Taking, piece: 0, length, offset };
        if info != nibble(0, job.stream(), inputs.len() - 1) {
            return failed;
        }
        let return_value = u16::from_be_bytes([*value_high, *value_low]);
        job.take(info, inputs.len(), return_value)
    }

    fn follow(self, info: u8, inputs: &[u8]) -> (Self, ReceiveStep) {
        let n = usize::from(self.piece);
        let stream = self.stream();
        if info == nibble(n, stream, inputs.len() - 1) {
            return (self, ReceiveStep::Wait);
        }
        if info == nibble(n + 1, stream, inputs.len() - 1) {
            return Self { piece: self.piece.wrapping_add(1), ..self }.take(info, inputs.len(), 0);
        }
        match info {
            // The CP has started a new telegram.
            FIRST | LAST => Self::begin(info, inputs),
            _ => (Self::default(), ReceiveStep::Failed(Failure::NotSynchronised)),
        }
    }

    /// The number of bytes before the user data.
    fn head(self) -> usize {
        HEAD_BYTES + RETURN_BYTES + if self.offset.is_some() { OFFSET_BYTES } else { 0 }
    }

    fn stream(self) -> usize {
        self.head() + usize::from(self.length)
    }

    fn take(self, info: u8, io_bytes: usize, return_value: u16) -> (Self, ReceiveStep) {
        let n = usize::from(self.piece);
        let payload = io_bytes - 1;
        // "Data_Offset = (Fragment_counter ...) x (IO_Size - 1) - 7 + Offset", 7 is the header with an offset. [S3 L11]
        let done = (n * payload).saturating_sub(self.head());
        let front = if n == 0 { self.head() } else { 0 };
        let count = (payload - front).min(usize::from(self.length).saturating_sub(done));
        let received = (info == LAST).then_some(Received { length: self.length, return_value });
        let at = usize::from(self.offset.unwrap_or(0)) + done;
        let phase = if info == LAST { Phase::Closing } else { Phase::Taking };
        let take = Take { from: 1 + front, count, at, acknowledge: info, received };
        (Self { phase, ..self }, ReceiveStep::Take(take))
    }

    /// The job as a number, for callers that can only store numbers; 0 is not a job.
    pub fn pack(self) -> u64 {
        let phase = match self.phase {
            Phase::Idle => return 0,
            Phase::Taking => 1,
            Phase::Closing => 2,
        };
        let offset = self.offset.map_or(0, |offset| 1 << 48 | u64::from(offset) << 32);
        phase | u64::from(self.piece) << 8 | u64::from(self.length) << 16 | offset
    }

    /// The job from a number. An invalid number gives no job.
    pub fn unpack(number: u64) -> Self {
        let phase = match number & 0xFF {
            1 => Phase::Taking,
            2 => Phase::Closing,
            _ => return Self::default(),
        };
        let length = (number >> 16) as u16;
        if length > TELEGRAM_MAX {
            return Self::default();
        }
        let offset = (number >> 48 & 1 == 1).then_some((number >> 32) as u16);
        Self { phase, piece: (number >> 8) as u8, length, offset }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn area<const N: usize>(front: &[u8], data: core::ops::Range<u8>) -> [u8; N] {
        let mut area = [0; N];
        for (to, from) in area.iter_mut().zip(front.iter().copied().chain(data)) {
            *to = from;
        }
        area
    }

    fn take(job: &mut ReceiveJob, inputs: &[u8]) -> Take {
        match job.step(inputs, 0x88, SendJob::default()) {
            (next, ReceiveStep::Take(take)) => {
                *job = next;
                assert_eq!(ReceiveJob::unpack(job.pack()), *job);
                take
            }
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn forty_bytes_come_in_one_area_of_sixty() {
        // [S3 L325] IO size 60, length 40: 0A 00 00 2A 00 00, data in bytes 6 to 45; acknowledged with A0.
        let mut job = ReceiveJob::default();
        let got = take(&mut job, &area::<60>(&[0x8A, 0, 0, 0x2A, 0, 0], 0..40));
        let received = Some(Received { length: 40, return_value: 0 });
        assert_eq!(got, Take { from: 6, count: 40, at: 0, acknowledge: 0xA, received });
        assert_eq!(job.step(&[0x8A], 0xA8, SendJob::default()).1, ReceiveStep::Wait);
        assert_eq!(
            job.step(&[0x88], 0xA8, SendJob::default()),
            (ReceiveJob::default(), ReceiveStep::Acknowledge(IDLE))
        );
    }

    #[test]
    fn forty_bytes_come_in_three_areas_of_sixteen() {
        // [S3 L327] 09 00 00 2A 00 00 d0..d9, 00 d10..d24, 0A d25..d39; acknowledged with 90, 00, A0.
        let mut job = ReceiveJob::default();
        let first = take(&mut job, &area::<16>(&[0x89, 0, 0, 0x2A, 0, 0], 0..10));
        assert_eq!((first.from, first.count, first.at, first.acknowledge), (6, 10, 0, 0x9));
        assert_eq!(job.step(&area::<16>(&[0x89], 0..0), 0x98, SendJob::default()).1, ReceiveStep::Wait);
        let second = take(&mut job, &area::<16>(&[0x80], 10..25));
        assert_eq!((second.from, second.count, second.at, second.acknowledge), (1, 15, 10, 0x0));
        let third = take(&mut job, &area::<16>(&[0x8A], 25..40));
        let received = Some(Received { length: 40, return_value: 0 });
        assert_eq!(third, Take { from: 1, count: 15, at: 25, acknowledge: 0xA, received });
    }

    #[test]
    fn an_offset_says_where_the_data_go() {
        let mut job = ReceiveJob::default();
        let first = take(&mut job, &area::<8>(&[0x89, 4, 0, 10, 0x01, 0x18, 0, 0], 0..0));
        assert_eq!((first.count, first.at, job.end()), (0, 0x118, 0x120));
        // Fragment 1 of areas of 8: 1 x 7 - 7 + offset.
        assert_eq!(take(&mut job, &area::<8>(&[0x80], 0..7)).at, 0x118);
        // Fragment 2: 2 x 7 - 7 + offset.
        let last = take(&mut job, &area::<8>(&[0x8A], 7..8));
        assert_eq!((last.at, last.count), (0x118 + 7, 1));
    }

    #[test]
    fn an_error_is_a_length_of_two() {
        let mut job = ReceiveJob::default();
        let got = take(&mut job, &area::<16>(&[0x8A, 0, 0, 2, 0x08, 0x0A], 0..0));
        assert_eq!((got.count, got.acknowledge), (0, 0xA));
        assert_eq!(got.received, Some(Received { length: 0, return_value: 0x080A }));
    }

    #[test]
    fn what_cannot_be_is_not_taken() {
        for inputs in [
            [0x8A, 1, 0, 10, 0, 0, 0, 0],
            [0x8A, 0, 0, 1, 0, 0, 0, 0],
            [0x89, 0, 0, 2, 0, 0, 0, 0],
            [0x8A, 0, 0, 20, 0, 0, 0, 0],
            [0x89, 0, 4, 3, 0, 0, 0, 0],
        ] {
            let failed = ReceiveStep::Failed(Failure::NotSynchronised);
            assert_eq!(ReceiveJob::default().step(&inputs, 0x88, SendJob::default()).1, failed, "{inputs:02X?}");
        }
    }

    #[test]
    fn a_cp_that_is_gone_is_no_fragment_0() {
        let mut job = ReceiveJob::default();
        take(&mut job, &area::<16>(&[0x89, 0, 0, 0x2A, 0, 0], 0..10));
        assert_eq!(job.step(&[0; 16], 0x98, SendJob::default()), (job, ReceiveStep::Wait));
        let (none, step) = job.step(&area::<16>(&[0x88], 0..0), 0x98, SendJob::default());
        assert_eq!((none, step), (ReceiveJob::default(), ReceiveStep::Failed(Failure::NotSynchronised)));
    }

    /// A CP that transmits shows its answer to the fragment before: with 34 bytes and areas of 16 that is 0.
    #[test]
    fn fragment_0_comes_beside_the_answer_0() {
        let mut send = SendJob::telegram(34).expect("1 to 1024");
        for (inputs, output0) in [(0x88, 0x88), (0x98, 0x89), (0x08, 0x80)] {
            send = send.step(&[inputs], output0, 16).0;
        }
        let mut job = ReceiveJob::default();
        take(&mut job, &area::<16>(&[0x09, 0, 0, 0x2A, 0, 0], 0..10));
        let inputs = area::<16>(&[0x00], 10..25);
        let (_, step) = job.step(&inputs, 0x9A, send);
        assert!(matches!(step, ReceiveStep::Take(Take { at: 10, count: 15, acknowledge: 0, .. })), "{step:?}");
    }
}
