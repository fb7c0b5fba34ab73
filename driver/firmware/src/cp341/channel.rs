//! The blocks of the two channels as the CP reads and writes them; `docs/cp341-channels.md`.

/// What one side shows the other in a channel.
pub type ChannelBlock = [u8; 64];

/// Which channel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Channel {
    /// P_SND_RK.
    Send,
    /// P_RCV_RK.
    Receive,
}

/// User data in a block. [reference 1.0]
pub(crate) const PIECE: usize = 32;

/// Where user data begin.
const DATA: usize = 32;

/// Pieces of so many bytes.
pub(crate) const fn pieces(bytes: usize) -> u16 {
    bytes.div_ceil(PIECE) as u16
}

/// The bytes of a piece in data of this length; empty behind them.
pub(crate) fn range(piece: u16, bytes: usize) -> std::ops::Range<usize> {
    let from = (usize::from(piece) * PIECE).min(bytes);
    from..(from + PIECE).min(bytes)
}

/// What the CPU says in a channel (byte 0).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Command {
    /// Nothing, or nothing this CP knows.
    None,
    /// Begin with this start number: everything before is forgotten.
    Start,
    /// Send channel: no job. Receive channel: nothing is taken.
    Rest,
    /// Receive channel: the block waits for something.
    Wait,
    /// A job is under way.
    Job,
    /// Receive channel: the job offered is refused.
    Refuse,
}

/// Why P_RCV_RK refuses a job.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Reason {
    /// The coordination flag is set.
    Locked,
    /// The DB is missing.
    Db,
    /// The area is too short.
    Range,
    /// This area cannot be had.
    Area,
    /// R = 1, EN_R = 0, or nowhere to put the data.
    Reset,
}

/// A block of the CPU.
#[derive(Debug, Clone, Copy)]
pub(crate) struct FromCpu<'a>(pub(crate) &'a ChannelBlock);

impl<'a> FromCpu<'a> {
    pub(crate) fn command(self) -> Command {
        match self.0[0] {
            1 => Command::Start,
            2 => Command::Rest,
            3 => Command::Wait,
            4 => Command::Job,
            5 => Command::Refuse,
            _ => Command::None,
        }
    }

    fn word(self, at: usize) -> u16 {
        u16::from_be_bytes([self.0[at], self.0[at + 1]])
    }

    /// With [`Command::Start`] in the receive channel: the block waits for something at once.
    pub(crate) fn takes(self) -> bool {
        self.0[1] & 1 == 1
    }

    pub(crate) fn start(self) -> u16 {
        self.word(2)
    }

    pub(crate) fn job(self) -> u16 {
        self.word(4)
    }

    /// Data towards the CP: the piece in `data`. Towards the CPU: the pieces it has.
    pub(crate) fn piece(self) -> u16 {
        self.word(6)
    }

    /// Why a job is refused.
    pub(crate) fn reason(self) -> Reason {
        match self.0[8] {
            1 => Reason::Locked,
            2 => Reason::Db,
            3 => Reason::Range,
            4 => Reason::Area,
            _ => Reason::Reset,
        }
    }

    /// The piece.
    pub(crate) fn data(self) -> &'a [u8] {
        &self.0[DATA..]
    }
}

/// A job of P_SND_RK.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Job {
    /// 'S' send, 'F' fetch, 'P' print.
    pub sf: u8,
    /// Area in the partner.
    pub r_typ: u8,
    /// Bytes.
    pub len: i16,
    /// Partner's CPU number.
    pub r_cpu_no: i16,
    /// DB in the partner.
    pub r_no: i16,
    /// First byte, timer or counter in the partner.
    pub r_offset: i16,
    /// Coordination flag byte; 255: none.
    pub r_cf_byt: i16,
    /// Coordination flag bit.
    pub r_cf_bit: i16,
}

impl Job {
    /// SF of P_PRINT. (ours)
    pub(crate) const PRINT: u8 = b'P';

    /// Whether the CPU gives data with it.
    pub(crate) const fn has_data(&self) -> bool {
        matches!(self.sf, b'S' | Self::PRINT)
    }

    pub(crate) fn of(block: &ChannelBlock) -> Self {
        let int = |at: usize| i16::from_be_bytes([block[at], block[at + 1]]);
        Self {
            sf: block[8],
            r_typ: block[9],
            len: int(10),
            r_cpu_no: int(12),
            r_no: int(14),
            r_offset: int(16),
            r_cf_byt: int(18),
            r_cf_bit: int(20),
        }
    }
}

/// What the CP says in a channel (byte 0).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub(crate) enum State {
    /// No start number has been acknowledged.
    Off = 0,
    /// No job.
    Ready = 1,
    /// Data of the job come: so many pieces are there.
    Collecting = 2,
    /// The job is under way.
    Running = 3,
    /// Data of the job go to the CPU: this piece.
    Giving = 4,
    /// It has ended without error.
    Done = 5,
    /// It has ended with this STATUS.
    Failed = 6,
    /// Receive channel: a telegram, or a job of the partner.
    Offered = 7,
}

/// A block of the CP, in the making.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ToCpu(pub(crate) ChannelBlock);

impl ToCpu {
    pub(crate) fn new(state: State, start: u16, job: u16) -> Self {
        let mut block = Self([0; 64]);
        block.0[0] = state as u8;
        block.set(2, start);
        block.set(4, job);
        block
    }

    pub(crate) fn set(&mut self, at: usize, word: u16) {
        self.0[at..at + 2].copy_from_slice(&word.to_be_bytes());
    }

    pub(crate) fn piece(mut self, piece: u16) -> Self {
        self.set(6, piece);
        self
    }

    pub(crate) fn status(mut self, status: u16) -> Self {
        self.set(8, status);
        self
    }

    pub(crate) fn len(mut self, len: usize) -> Self {
        self.set(10, len as u16);
        self
    }

    pub(crate) fn data(mut self, data: &[u8]) -> Self {
        let len = data.len().min(PIECE);
        self.0[DATA..DATA + len].copy_from_slice(&data[..len]);
        self
    }
}
