//! CP 340 and CP 341: the two channels, and the additional registers (docs/cp341-channels.md).

use crate::codes;

/// Bytes of a block.
pub const BLOCK_BYTES: usize = 64;

/// The bytes that one side shows the other in a channel.
pub type ChannelBlock = [u8; BLOCK_BYTES];

/// One of the two channels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Channel {
    /// P_SEND, P_SND_RK, P_PRINT: jobs of the CPU.
    Send,
    /// P_RCV, P_RCV_RK: telegrams and jobs of the partner.
    Receive,
}

impl Channel {
    /// Both channels of a CP.
    pub const ALL: [Self; 2] = [Self::Send, Self::Receive];

    /// Number of the data record by which the CPU reads and writes the channel (RD_REC, WR_REC).
    pub const fn record(self) -> u8 {
        match self {
            Self::Send => 0x80,
            Self::Receive => 0x81,
        }
    }

    /// The channel for a data record.
    pub fn of_record(number: u8) -> Option<Self> {
        Self::ALL.into_iter().find(|channel| channel.record() == number)
    }
}

/// User data in a block. [CP 341 manual 09/2008, p. 178]
pub const PIECE: u16 = 32;

/// Position of the user data.
const DATA: usize = BLOCK_BYTES - PIECE as usize;

/// Number of pieces for this many bytes.
pub const fn pieces(bytes: usize) -> u16 {
    bytes.div_ceil(PIECE as usize) as u16
}

/// The range of a piece in data of this length; empty after the end.
pub fn range(piece: u16, bytes: usize) -> core::ops::Range<usize> {
    let from = (usize::from(piece) * usize::from(PIECE)).min(bytes);
    from..(from + usize::from(PIECE)).min(bytes)
}

codes! {
    /// Command of the CPU in a channel (byte 0).
    Command {
        /// No command, or an unknown one.
        None = 0,
        /// Start with this start number: all earlier jobs are cancelled.
        Start = 1,
        /// Send channel: no job. Receive channel: nothing is accepted.
        Rest = 2,
        /// Receive channel: the block waits for a telegram or a job.
        Wait = 3,
        /// A job is running.
        Job = 4,
        /// Receive channel: the offered job is refused.
        Refuse = 5,
    }
}

codes! {
    /// State of the CP in a channel (byte 0).
    State {
        /// No start number has been acknowledged, or an unknown state.
        Off = 0,
        /// The CP has no job and can take one.
        Ready = 1,
        /// Data of the job are being received: the number of pieces so far.
        Collecting = 2,
        /// The job is running.
        Running = 3,
        /// Data of the job are being passed to the CPU: this piece.
        Giving = 4,
        /// The job has ended without error.
        Done = 5,
        /// The job has ended with this STATUS.
        Failed = 6,
        /// Receive channel: the CP offers a telegram or a job of the partner.
        Offered = 7,
    }
}

codes! {
    /// The reason why P_RCV or P_RCV_RK refuses an offer (byte 8).
    Refusal {
        /// The coordination flag is set.
        Locked = 1,
        /// The data block is missing.
        Db = 2,
        /// The area is too short.
        Range = 3,
        /// The area is not available.
        Area = 4,
        /// R = 1, EN_R = 0, or no memory for the data.
        Reset = 5,
    }
}

codes! {
    /// The kind of an offer in the receive channel (byte 12).
    Offered {
        /// A telegram of ASCII, 3964(R) or a loadable driver: it has no destination.
        Telegram = 0,
        /// RK 512: data of the partner.
        Receive = 1,
        /// RK 512: data for the partner.
        Provide = 2,
    }
}

/// An offer in the receive channel, from byte 12 of the block on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Header {
    /// Kind of the offer.
    pub kind: Offered,
    /// RK 512: letter of the area; 0: no header.
    pub letter: u8,
    /// Number of the data block.
    pub number: u16,
    /// First byte, timer or counter.
    pub offset: u16,
    /// Coordination flag: byte, bit; byte 255: none.
    pub flag: (u16, u16),
}

/// No coordination flag. [TIA help "PtP data link CP 341"]
pub const NO_FLAG: u16 = 255;

/// A job of P_SEND, P_SND_RK or P_PRINT, from byte 8 of the block on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Job {
    /// 'S' send, 'F' fetch, 'P' print.
    pub sf: u8,
    /// Area in the partner.
    pub r_typ: u8,
    /// LEN of the call: bytes of the job's data.
    pub len: i16,
    /// R_CPU_NO: CPU number in the partner, for RK 512.
    pub r_cpu_no: i16,
    /// DB in the partner.
    pub r_no: i16,
    /// First byte, timer or counter in the partner.
    pub r_offset: i16,
    /// Coordination flag byte; 255: none.
    pub r_cf_byt: i16,
    /// Bit of the coordination flag, 0 to 7.
    pub r_cf_bit: i16,
}

impl Job {
    /// SF of P_SEND, and of P_SND_RK when it sends.
    pub const SEND: u8 = b'S';
    /// SF of P_SND_RK when it fetches.
    pub const FETCH: u8 = b'F';
    /// SF of P_PRINT. (ours)
    pub const PRINT: u8 = b'P';

    /// Whether the CPU passes data with the job.
    pub const fn has_data(&self) -> bool {
        matches!(self.sf, Self::SEND | Self::PRINT)
    }
}

/// The block that one side shows the other in a channel. Words are big-endian.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Block(pub ChannelBlock);

impl Block {
    fn new(code: u8, start: u16, job: u16) -> Self {
        let mut block = Self([0; BLOCK_BYTES]);
        block.0[0] = code;
        block.set(2, start);
        block.set(4, job);
        block
    }

    /// A block of the CPU: the command, its start number and its job.
    pub fn of_cpu(command: Command, start: u16, job: u16) -> Self {
        Self::new(command as u8, start, job)
    }

    /// A block of the CP: the state, the acknowledged start number and the job.
    pub fn of_cp(state: State, start: u16, job: u16) -> Self {
        Self::new(state as u8, start, job)
    }

    /// The command in a block of the CPU.
    pub const fn command(&self) -> Command {
        match Command::of(self.0[0]) {
            Some(known) => known,
            None => Command::None,
        }
    }

    /// The state in a block of the CP.
    pub const fn state(&self) -> State {
        match State::of(self.0[0]) {
            Some(known) => known,
            None => State::Off,
        }
    }

    /// The word at byte `at`.
    pub const fn word(&self, at: usize) -> u16 {
        u16::from_be_bytes([self.0[at], self.0[at + 1]])
    }

    /// Sets the word at byte `at`.
    pub fn set(&mut self, at: usize, word: u16) {
        self.0[at..at + 2].copy_from_slice(&word.to_be_bytes());
    }

    /// With [`Command::Start`] in the receive channel: the block waits for an offer at once.
    pub const fn takes(&self) -> bool {
        self.0[1] & 1 == 1
    }

    /// The block with or without this mark.
    #[must_use]
    pub const fn with_takes(mut self, takes: bool) -> Self {
        self.0[1] = takes as u8;
        self
    }

    /// With [`Command::Rest`] in the receive channel: the job under way was aborted. Without this mark REST tells, like
    /// WAIT, that the program has been told its end.
    pub const fn drops(&self) -> bool {
        self.0[1] & 2 != 0
    }

    /// The block with this mark.
    #[must_use]
    pub const fn dropping(mut self) -> Self {
        self.0[1] |= 2;
        self
    }

    /// Start number; in a block of the CP the acknowledged one, 0: none.
    pub const fn start(&self) -> u16 {
        self.word(2)
    }

    /// Number of the job.
    pub const fn job(&self) -> u16 {
        self.word(4)
    }

    /// The giving side shows the number of the piece in [`data`](Self::data), the taking side the number of pieces it
    /// has.
    pub const fn piece(&self) -> u16 {
        self.word(6)
    }

    /// The block with this value.
    #[must_use]
    pub fn with_piece(mut self, piece: u16) -> Self {
        self.set(6, piece);
        self
    }

    /// STATUS in a block of the CP with [`State::Failed`].
    pub const fn status(&self) -> u16 {
        self.word(8)
    }

    /// The block with this value.
    #[must_use]
    pub fn with_status(mut self, status: u16) -> Self {
        self.set(8, status);
        self
    }

    /// The reason in a block of the CPU with [`Command::Refuse`].
    pub const fn refusal(&self) -> Refusal {
        match Refusal::of(self.0[8]) {
            Some(known) => known,
            None => Refusal::Reset,
        }
    }

    /// The block with this value.
    #[must_use]
    pub const fn with_refusal(mut self, refusal: Refusal) -> Self {
        self.0[8] = refusal as u8;
        self
    }

    /// Length of the job in bytes.
    pub const fn len(&self) -> u16 {
        self.word(10)
    }

    /// Whether the length of the job is 0.
    pub const fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The block with this value.
    #[must_use]
    pub fn with_len(mut self, len: u16) -> Self {
        self.set(10, len);
        self
    }

    /// The job in a block of the CPU in the send channel.
    pub const fn order(&self) -> Job {
        Job {
            sf: self.0[8],
            r_typ: self.0[9],
            len: self.word(10) as i16,
            r_cpu_no: self.word(12) as i16,
            r_no: self.word(14) as i16,
            r_offset: self.word(16) as i16,
            r_cf_byt: self.word(18) as i16,
            r_cf_bit: self.word(20) as i16,
        }
    }

    /// Sets the job except its length, which is set with the data.
    pub fn set_order(&mut self, job: &Job) {
        (self.0[8], self.0[9]) = (job.sf, job.r_typ);
        let words = [job.r_cpu_no, job.r_no, job.r_offset, job.r_cf_byt, job.r_cf_bit];
        for (at, word) in (12..).step_by(2).zip(words) {
            self.set(at, word as u16);
        }
    }

    /// The offer in a block of the CP in the receive channel.
    pub const fn header(&self) -> Header {
        let kind = match Offered::of(self.0[12]) {
            Some(known) => known,
            None => Offered::Telegram,
        };
        let flag = (self.word(18), self.word(20));
        Header { kind, letter: self.0[13], number: self.word(14), offset: self.word(16), flag }
    }

    /// Writes the offer's kind, letter, number, offset and flag (bytes 12 to 21).
    pub fn set_header(&mut self, header: &Header) {
        (self.0[12], self.0[13]) = (header.kind as u8, header.letter);
        let words = [header.number, header.offset, header.flag.0, header.flag.1];
        for (at, word) in (14..).step_by(2).zip(words) {
            self.set(at, word);
        }
    }

    /// The piece, including the bytes after its end.
    pub fn data(&self) -> &[u8] {
        &self.0[DATA..]
    }

    /// The block with this piece, truncated to the size of the block.
    #[must_use]
    pub fn with_data(mut self, data: &[u8]) -> Self {
        let room = self.data_mut(data.len());
        room.copy_from_slice(&data[..room.len()]);
        self
    }

    /// The bytes of a piece of this length, limited to the size of the block.
    pub fn data_mut(&mut self, len: usize) -> &mut [u8] {
        &mut self.0[DATA..DATA + len.min(usize::from(PIECE))]
    }
}

/// The accompanying signals: input byte 0 (V24_STAT), and bits of output byte 0 (V24_SET).
pub mod v24 {
    /// DTR, data terminal ready.
    pub const DTR: u8 = 1 << 0;
    /// DSR, data set ready; inputs only.
    pub const DSR: u8 = 1 << 1;
    /// RTS, request to send.
    pub const RTS: u8 = 1 << 2;
    /// CTS, clear to send; inputs only.
    pub const CTS: u8 = 1 << 3;
    /// DCD, data carrier detect; inputs only.
    pub const DCD: u8 = 1 << 4;
    /// RI, ring indicator; inputs only.
    pub const RI: u8 = 1 << 5;
    /// Outputs: the program drives RTS and DTR.
    pub const DRIVES: u8 = 1 << 7;
}

/// Byte of the inputs and outputs with the number of P_RESET.
pub const RESET_AT: usize = 1;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_code_is_read_as_it_is_written() {
        use Command::{None, Refuse, Rest, Start, Wait};
        for command in [None, Start, Rest, Wait, Command::Job, Refuse] {
            assert_eq!(Block::of_cpu(command, 1, 2).command(), command);
        }
        use State::{Collecting, Done, Failed, Giving, Off, Offered, Ready, Running};
        for state in [Off, Ready, Collecting, Running, Giving, Done, Failed, Offered] {
            assert_eq!(Block::of_cp(state, 1, 2).state(), state);
        }
        for refusal in [Refusal::Locked, Refusal::Db, Refusal::Range, Refusal::Area, Refusal::Reset] {
            let block = Block::of_cpu(Refuse, 1, 2).with_refusal(refusal);
            assert_eq!((block.refusal(), block.start(), block.job()), (refusal, 1, 2));
        }
    }

    #[test]
    fn a_job_lies_where_the_table_says() {
        let job = Job { sf: b'S', r_typ: b'D', len: 7, r_cpu_no: 1, r_no: 2, r_offset: 3, r_cf_byt: 4, r_cf_bit: 5 };
        let mut block = Block::of_cpu(Command::Job, 0x0102, 0x0304).with_len(7);
        block.set_order(&job);
        assert_eq!(block.0[..22], [4, 0, 1, 2, 3, 4, 0, 0, b'S', b'D', 0, 7, 0, 1, 0, 2, 0, 3, 0, 4, 0, 5]);
        assert_eq!(block.order(), job);
    }

    #[test]
    fn a_header_lies_where_the_table_says() {
        for kind in [Offered::Telegram, Offered::Receive, Offered::Provide] {
            let header = Header { kind, letter: b'X', number: 0x0102, offset: 0x0304, flag: (5, 6) };
            let mut block = Block::of_cp(State::Offered, 1, 2);
            block.set_header(&header);
            assert_eq!(block.0[12..22], [kind as u8, b'X', 1, 2, 3, 4, 0, 5, 0, 6]);
            assert_eq!(block.header(), header);
        }
    }

    #[test]
    fn pieces_are_32_bytes() {
        assert_eq!([0, 1, 32, 33, 4096].map(pieces), [0, 1, 1, 2, 128]);
        assert_eq!((range(0, 40), range(1, 40), range(2, 40)), (0..32, 32..40, 40..40));
    }
}
