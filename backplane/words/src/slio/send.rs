//! Host -> CP. [S3 "Sending data"]

use super::failure::Failure;
use crate::cp040::{BAD_LENGTH, FAILED, HEAD_BYTES, IDLE, RESET, RESET_DONE, TELEGRAM_MAX, nibble};

use super::wire::{fragments, is_absent};

/// The phase of a job.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
enum Phase {
    #[default]
    Idle,
    /// Nothing is written yet: the CP must be idle first.
    Starting,
    /// Fragment `piece` has been written, waits for its answer.
    Waiting,
    /// A reset will be requested when the answer to an earlier one has been cleared.
    ResetStarting,
    /// The reset has been requested.
    ResetAsked,
    /// The reset was executed; waits until the CP is idle.
    ResetClosing,
}

const PHASES: [Phase; 6] =
    [Phase::Idle, Phase::Starting, Phase::Waiting, Phase::ResetStarting, Phase::ResetAsked, Phase::ResetClosing];

/// A telegram that is being passed to the CP, or a reset.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct SendJob {
    phase: Phase,
    length: u16,
    piece: u8,
}

/// A fragment to write: user bytes `from` to `from + count` of the telegram, and the bytes before them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Piece {
    /// Low nibble of byte 0.
    pub command: u8,
    /// Index of the fragment's first user byte in the telegram.
    pub from: usize,
    /// Number of user bytes in the fragment.
    pub count: usize,
    /// Length of the telegram: in the first fragment it is before the data.
    length: Option<u16>,
}

/// What the host does next with the CP's outputs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SendStep {
    /// Leave the outputs unchanged.
    Wait,
    /// Write this fragment: the bytes first, then the command.
    Put(Piece),
    /// Write only this low nibble of byte 0.
    Command(u8),
    /// The telegram was sent, or the reset executed. The command returns to [`IDLE`].
    Done,
    /// The telegram was not sent. The command returns to [`IDLE`].
    Failed(Failure),
}

impl Piece {
    /// Writes the bytes after byte 0 of the outputs, without the user data; returns the position of the user data.
    pub fn head(&self, behind: &mut [u8]) -> usize {
        behind.fill(0);
        let Some(length) = self.length else { return 0 };
        let [high, low] = length.to_be_bytes();
        // The telegram info is 00h when sending. [S3 L313]
        for (to, from) in behind.iter_mut().zip([0, high, low]) {
            *to = from;
        }
        HEAD_BYTES
    }
}

impl SendJob {
    /// A telegram of 1 to 1024 bytes.
    pub fn telegram(length: u16) -> Option<Self> {
        (1..=TELEGRAM_MAX).contains(&length).then_some(Self { phase: Phase::Starting, length, piece: 0 })
    }

    /// "Command: execute a reset on the CP": both directions are empty afterwards. Receive nothing while it runs,
    /// because the inputs are from before the reset; afterwards start with a [`ReceiveJob::default`](super::ReceiveJob)
    /// and the acknowledgement [`IDLE`].
    pub const fn reset() -> Self {
        Self { phase: Phase::ResetStarting, length: 0, piece: 0 }
    }

    /// Whether there is anything to do.
    pub const fn is_running(self) -> bool {
        !matches!(self.phase, Phase::Idle)
    }

    /// Whether it is a reset.
    pub const fn is_reset(self) -> bool {
        matches!(self.phase, Phase::ResetStarting | Phase::ResetAsked | Phase::ResetClosing)
    }

    /// Whether 0 is the answer that stays shown until the fragment that was written last is answered.
    pub(crate) fn shows_0(self, io_bytes: usize) -> bool {
        let n = usize::from(self.piece);
        self.phase == Phase::Waiting && n > 0 && nibble(n - 1, self.stream(), io_bytes.saturating_sub(1)) == 0
    }

    /// One step: the CP's inputs, byte 0 of the outputs as last written, and the number of bytes in each direction (8
    /// to 60).
    pub fn step(self, inputs: &[u8], output0: u8, io_bytes: usize) -> (Self, SendStep) {
        if is_absent(inputs, output0) {
            return (self, SendStep::Wait);
        }
        let answer = inputs.first().map_or(0, |byte| byte >> 4);
        match self.phase {
            Phase::Idle => (self, if output0 & 0x0F == IDLE { SendStep::Wait } else { SendStep::Command(IDLE) }),
            // An answer to an earlier telegram must not be taken for the answer to this one.
            Phase::Starting if answer != IDLE || output0 & 0x0F != IDLE => (self, SendStep::Command(IDLE)),
            Phase::Starting => self.put(0, io_bytes),
            Phase::Waiting => self.answered(answer, io_bytes),
            Phase::ResetStarting if answer == RESET_DONE => (self, SendStep::Command(IDLE)),
            Phase::ResetStarting => (Self { phase: Phase::ResetAsked, ..self }, SendStep::Command(RESET)),
            Phase::ResetAsked if answer == RESET_DONE => {
                (Self { phase: Phase::ResetClosing, ..self }, SendStep::Command(IDLE))
            }
            Phase::ResetClosing if answer == IDLE => (Self::default(), SendStep::Done),
            Phase::ResetAsked | Phase::ResetClosing => (self, SendStep::Wait),
        }
    }

    fn stream(self) -> usize {
        HEAD_BYTES + usize::from(self.length)
    }

    fn answered(self, answer: u8, io_bytes: usize) -> (Self, SendStep) {
        let n = usize::from(self.piece);
        let before = if n == 0 { IDLE } else { nibble(n - 1, self.stream(), io_bytes - 1) };
        if answer == nibble(n, self.stream(), io_bytes - 1) {
            if n + 1 == fragments(self.stream(), io_bytes) {
                return (Self::default(), SendStep::Done);
            }
            return self.put(n + 1, io_bytes);
        }
        let failure = match answer {
            _ if answer == before => return (self, SendStep::Wait),
            BAD_LENGTH => Failure::Length,
            FAILED => Failure::Communication,
            _ => Failure::NotSynchronised,
        };
        (Self::default(), SendStep::Failed(failure))
    }

    fn put(self, n: usize, io_bytes: usize) -> (Self, SendStep) {
        let payload = io_bytes - 1;
        // The user data of fragment n begin after those of the previous fragments; the header belongs to fragment 0.
        let from = (n * payload).saturating_sub(HEAD_BYTES);
        let room = if n == 0 { payload - HEAD_BYTES } else { payload };
        let count = room.min(usize::from(self.length).saturating_sub(from));
        let length = (n == 0).then_some(self.length);
        let piece = Piece { command: nibble(n, self.stream(), io_bytes - 1), from, count, length };
        (Self { phase: Phase::Waiting, piece: n as u8, ..self }, SendStep::Put(piece))
    }

    /// The job as a number, for callers that can only store numbers; 0 is not a job.
    pub fn pack(self) -> u64 {
        let phase = PHASES.iter().position(|phase| *phase == self.phase).unwrap_or(0);
        phase as u64 | u64::from(self.piece) << 8 | u64::from(self.length) << 16
    }

    /// The job from a number. An invalid number gives no job.
    pub fn unpack(number: u64) -> Self {
        let phase = PHASES.get((number & 0xFF) as usize).copied().unwrap_or_default();
        let length = (number >> 16) as u16;
        let piece = (number >> 8) as u8;
        match phase {
            Phase::Idle => Self::default(),
            Phase::Starting | Phase::Waiting if !(1..=TELEGRAM_MAX).contains(&length) => Self::default(),
            _ => Self { phase, length, piece },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::vec::Vec;

    /// Passes a telegram to a CP that accepts everything; returns the written outputs.
    fn written(length: usize, io_bytes: usize) -> Vec<Vec<u8>> {
        let telegram: Vec<u8> = (0..length).map(|n| n as u8).collect();
        let mut job = SendJob::telegram(length as u16).expect("a length that can be");
        let (mut inputs, mut output0) = (0x88, 0x88);
        let mut all = Vec::new();
        loop {
            let (next, step) = job.step(&[inputs], output0, io_bytes);
            job = next;
            match step {
                SendStep::Put(piece) => {
                    output0 = 0x80 | piece.command;
                    let mut area = std::vec![output0; io_bytes];
                    let at = 1 + piece.head(&mut area[1..]);
                    area[at..at + piece.count].copy_from_slice(&telegram[piece.from..piece.from + piece.count]);
                    all.push(area);
                    inputs = piece.command << 4 | 8;
                }
                SendStep::Done => return all,
                other => panic!("{other:?}"),
            }
        }
    }

    #[test]
    fn forty_bytes_go_in_one_area_of_sixty() {
        // [S3 L323] IO size 60, length 40: 0A 00 00 28, data, not used.
        let mut expected = std::vec![0x8A, 0x00, 0x00, 0x28];
        expected.extend(0..40);
        expected.resize(60, 0);
        assert_eq!(written(40, 60), [expected]);
    }

    #[test]
    fn fifty_bytes_go_in_four_areas_of_sixteen() {
        // [S3 L323] IO size 16, length 50. The manual prints 28h as length, a misprint for 32h.
        let all = written(50, 16);
        let commands: Vec<u8> = all.iter().map(|area| area[0]).collect();
        assert_eq!(commands, [0x89, 0x80, 0x81, 0x8A]);
        assert_eq!(all[0][1..], [0, 0, 0x32, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11]);
        assert_eq!(all[1][1..], std::vec::Vec::from_iter(12..27));
        assert_eq!(all[2][1..], std::vec::Vec::from_iter(27..42));
        assert_eq!(all[3][1..], [42, 43, 44, 45, 46, 47, 48, 49, 0, 0, 0, 0, 0, 0, 0]);
    }

    #[test]
    fn a_job_survives_as_a_number() {
        let mut job = SendJob::telegram(1024).expect("a length that can be");
        let (mut answer, mut output0) = (IDLE, 0x88);
        while job.is_running() {
            assert_eq!(SendJob::unpack(job.pack()), job);
            let (next, step) = job.step(&[answer << 4], output0, 8);
            if let SendStep::Put(piece) = step {
                (answer, output0) = (piece.command, 0x80 | piece.command);
            }
            job = next;
        }
        assert_eq!(job.pack(), 0);
        assert_eq!(SendJob::unpack(SendJob::reset().pack()), SendJob::reset());
        assert_eq!(SendJob::unpack(u64::MAX), SendJob::default(), "noise is no job");
        assert_eq!((SendJob::telegram(0), SendJob::telegram(1025)), (None, None));
    }

    #[test]
    fn answers_that_end_a_job() {
        let started = |length| {
            let job = SendJob::telegram(length).expect("a length that can be");
            job.step(&[0x88], 0x88, 16).0
        };
        for (answer, ends) in [
            (0x88, SendStep::Wait),
            (0x00, SendStep::Wait),
            (0xA8, SendStep::Done),
            (0xD8, SendStep::Failed(Failure::Length)),
            (0xE8, SendStep::Failed(Failure::Communication)),
            (0xC8, SendStep::Failed(Failure::NotSynchronised)),
            (0x98, SendStep::Failed(Failure::NotSynchronised)),
        ] {
            assert_eq!(started(5).step(&[answer], 0x8A, 16).1, ends, "{answer:02X}h");
        }
    }

    #[test]
    fn a_reset_is_asked_for_and_waited_for() {
        let job = SendJob::reset();
        let (job, step) = job.step(&[0xC8], 0x88, 16);
        assert_eq!(step, SendStep::Command(IDLE), "the answer to another reset");
        let (job, step) = job.step(&[0x88], 0x88, 16);
        assert_eq!(step, SendStep::Command(RESET));
        let (job, step) = job.step(&[0x88], 0x8B, 16);
        assert_eq!(step, SendStep::Wait);
        let (job, step) = job.step(&[0xC8], 0x8B, 16);
        assert_eq!(step, SendStep::Command(IDLE));
        let (job, step) = job.step(&[0x88], 0x88, 16);
        assert_eq!((job, step), (SendJob::default(), SendStep::Done));
    }
}
