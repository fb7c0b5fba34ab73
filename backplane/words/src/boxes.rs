//! CP 343: the boxes. Each handling block that has a job at the CP has a box of its own: 512 bytes to the CP and 512
//! bytes from it, read and written as data records. (docs/cp343.md)
//!
//! The CPU shows a job with its first piece of data; the CP reports how many pieces it has, then that the job is
//! running, then its end, or piece by piece the received data. A box of the CP is valid only if it has the number of
//! the job that the CPU shows.

use crate::codes;

/// Boxes of a module.
pub const BOXES: usize = 64;
/// Bytes of a box in each direction.
pub const BOX_BYTES: usize = 512;
/// Bytes of the header, which contains the state of a job.
pub const HEAD_BYTES: usize = 32;
/// Bytes of data in a box.
pub const PIECE: usize = BOX_BYTES - HEAD_BYTES;
/// Maximum data of a job: BSEND over a CP, with the headers of its areas.
pub const DATA_MAX: usize = 65_536;

/// The box for a data record: records 80h to BFh.
pub fn of_record(number: u8) -> Option<usize> {
    number.checked_sub(RECORD).map(usize::from).filter(|index| *index < BOXES)
}

/// The data record of a box.
pub const fn record(index: usize) -> u8 {
    RECORD + (index % BOXES) as u8
}

const RECORD: u8 = 0x80;

/// Number of pieces for this many bytes; a job without data has one empty piece.
pub const fn pieces(bytes: usize) -> u16 {
    let pieces = bytes.div_ceil(PIECE);
    if pieces == 0 { 1 } else { pieces as u16 }
}

/// The range of a piece in data of this length; empty after the end.
pub fn range(piece: u16, bytes: usize) -> core::ops::Range<usize> {
    let from = (usize::from(piece) * PIECE).min(bytes);
    from..(from + PIECE).min(bytes)
}

codes! {
    /// The service of a job.
    Service {
        /// AG_SEND, AG_LSEND: the data go to the partner.
        Send = 1,
        /// AG_RECV, AG_LRECV: waits for data of the partner.
        Receive = 2,
        /// AG_LOCK: locks a connection for other blocks.
        Lock = 3,
        /// AG_UNLOCK: releases a locked connection.
        Unlock = 4,
        /// AG_CNTRL: the data are CMD; eight bytes come back.
        Control = 5,
        /// C_CNTRL: two bytes come back.
        Status = 6,
        /// USEND: sends without acknowledgement of the partner's program.
        Usend = 7,
        /// URCV: receives what USEND has sent.
        Urcv = 8,
        /// BSEND: sends a large block, acknowledged by the partner's BRCV.
        Bsend = 9,
        /// BRCV: receives what BSEND has sent.
        Brcv = 10,
        /// PUT: the data are items with their values.
        Put = 11,
        /// GET: the data are items; their values come back.
        Get = 12,
    }
}

codes! {
    /// State of a job, reported by the CP.
    State {
        /// The box has no job of the CPU.
        None = 0,
        /// The CP has a number of pieces and requests the next one.
        Collecting = 1,
        /// Running, or waiting for the partner.
        Running = 2,
        /// A piece of data for the CPU.
        Giving = 3,
        /// Ended without error; STATUS is 0.
        Done = 4,
        /// Ended with a STATUS.
        Failed = 5,
    }
}

/// The header of a box of the CPU. Words are big-endian.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Order {
    /// The service; `None`: no job, a running job is cancelled.
    pub service: Option<Service>,
    /// Number of the job, never 0.
    pub job: u16,
    /// Number of the connection: ID of the block's call.
    pub id: u16,
    /// R_ID of the blocks that have one.
    pub r_id: u32,
    /// The piece of data after the header.
    pub piece: u16,
    /// Bytes of all pieces.
    pub len: u32,
    /// Number of pieces of the CP's data that have been taken.
    pub taken: u16,
    /// The last job of this box whose data were all taken; 0: none. The CP may not have seen that before the next job
    /// is in the box.
    pub had: u16,
    /// Room for data of the CP, in bytes.
    pub room: u32,
}

impl Order {
    /// The header of a box without a job.
    pub const NONE: Self = Self { service: None, job: 0, id: 0, r_id: 0, piece: 0, len: 0, taken: 0, had: 0, room: 0 };

    /// The bytes in the box.
    pub fn bytes(&self) -> [u8; HEAD_BYTES] {
        let mut head = [0; HEAD_BYTES];
        head[0] = self.service.map_or(0, |service| service as u8);
        head[2..4].copy_from_slice(&self.job.to_be_bytes());
        head[4..6].copy_from_slice(&self.id.to_be_bytes());
        head[6..8].copy_from_slice(&self.piece.to_be_bytes());
        head[8..12].copy_from_slice(&self.r_id.to_be_bytes());
        head[12..16].copy_from_slice(&self.len.to_be_bytes());
        head[16..18].copy_from_slice(&self.taken.to_be_bytes());
        head[18..20].copy_from_slice(&self.had.to_be_bytes());
        head[20..24].copy_from_slice(&self.room.to_be_bytes());
        head
    }

    /// Reads the header from a box.
    pub const fn read(head: &[u8; HEAD_BYTES]) -> Self {
        Self {
            service: Service::of(head[0]),
            job: word(head, 2),
            id: word(head, 4),
            piece: word(head, 6),
            r_id: dword(head, 8),
            len: dword(head, 12),
            taken: word(head, 16),
            had: word(head, 18),
            room: dword(head, 20),
        }
    }
}

/// The header of a box of the CP.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Answer {
    /// State of the job.
    pub state: State,
    /// Number of the job.
    pub job: u16,
    /// [`State::Collecting`]: number of pieces the CP has. [`State::Giving`]: the piece after the header.
    pub piece: u16,
    /// [`State::Failed`]: the STATUS of the block.
    pub status: u16,
    /// [`State::Giving`]: bytes of all pieces.
    pub len: u32,
}

impl Answer {
    /// The header of a box that answers nothing.
    pub const NONE: Self = Self { state: State::None, job: 0, piece: 0, status: 0, len: 0 };

    /// The bytes in the box.
    pub fn bytes(&self) -> [u8; HEAD_BYTES] {
        let mut head = [0; HEAD_BYTES];
        head[0] = self.state as u8;
        head[2..4].copy_from_slice(&self.job.to_be_bytes());
        head[6..8].copy_from_slice(&self.piece.to_be_bytes());
        head[8..10].copy_from_slice(&self.status.to_be_bytes());
        head[12..16].copy_from_slice(&self.len.to_be_bytes());
        head
    }

    /// Reads the header from a box; an invalid state means no job.
    pub const fn read(head: &[u8; HEAD_BYTES]) -> Self {
        let state = match State::of(head[0]) {
            Some(state) => state,
            None => State::None,
        };
        Self { state, job: word(head, 2), piece: word(head, 6), status: word(head, 8), len: dword(head, 12) }
    }
}

const fn word(head: &[u8; HEAD_BYTES], at: usize) -> u16 {
    u16::from_be_bytes([head[at], head[at + 1]])
}

const fn dword(head: &[u8; HEAD_BYTES], at: usize) -> u32 {
    u32::from_be_bytes([head[at], head[at + 1], head[at + 2], head[at + 3]])
}

/// Bytes of an item of PUT or GET before the data: an ANY pointer to an area in the partner, as in ADDR_i.
pub const ITEM_BYTES: usize = 10;
/// Maximum number of items of one PUT or GET: SFB 14 and 15.
pub const ITEMS_MAX: usize = 4;

/// Maximum bytes of a BSEND: SFB 12 of an S7-400.
pub const BSEND_MAX: usize = 65_534;
/// Maximum bytes of a BSEND over a CP: FB 12 of an S7-300.
pub const BSEND_MAX_300: usize = 32_768;

/// STATUS values that the CP itself reports.
pub mod status {
    /// AG blocks: the job is not possible on this connection, or the connection is not configured.
    pub const NOT_CONFIGURED: u16 = 0x8183;
    /// AG blocks: LEN, or the received data, exceed the area.
    pub const LENGTH: u16 = 0x8185;
    /// AG blocks: no connection has this ID.
    pub const ID: u16 = 0x8186;
    /// AG blocks: the connection is not established.
    pub const NOT_CONNECTED: u16 = 0x8304;
    /// AG blocks: locked by AG_LOCK. (ours)
    pub const LOCKED: u16 = 0x80C4;
    /// AG_CNTRL: CMD is unknown.
    pub const COMMAND: u16 = 0x8184;
    /// FB/SFB: the connection is not configured, not established, or lost.
    pub const CONNECTION: u16 = 1;
    /// FB/SFB: the partner refuses.
    pub const REFUSED: u16 = 2;
    /// FB/SFB: the partner does not know R_ID.
    pub const R_ID: u16 = 3;
    /// FB/SFB: the areas of both sides do not match.
    pub const AREA: u16 = 4;
    /// BSEND, BRCV: the transfer was reset by R or by the partner.
    pub const RESET: u16 = 5;
    /// FB/SFB: the receiving block of the partner is not ready.
    pub const DISABLED: u16 = 6;
    /// FB/SFB: access to the partner's memory was refused.
    pub const REMOTE: u16 = 8;
    /// CONTROL: there is no instance of an SFB.
    pub const INSTANCE: u16 = 12;
    /// URCV: older data were overwritten.
    pub const OVERRUN: u16 = 9;
    /// FB/SFB: no access to the memory of this CPU.
    pub const LOCAL: u16 = 10;
    /// FB/SFB: REQ came while a job was running.
    pub const BUSY: u16 = 11;
    /// FB/SFB: two receiving blocks have the same R_ID on this connection.
    pub const TWICE: u16 = 18;
    /// FB/SFB: too many jobs at the same time.
    pub const FULL: u16 = 20;
    /// FB/SFB: a job is running.
    pub const RUNNING: u16 = 25;
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn heads_go_both_ways() {
        for service in (0..=u8::MAX).map(Service::of) {
            let order = Order {
                service,
                job: 0x102,
                id: 0x304,
                r_id: 0x506_0708,
                piece: 9,
                len: 70_000,
                taken: 3,
                had: 4,
                room: 65_536,
            };
            assert_eq!(Order::read(&order.bytes()), order);
        }
        assert_eq!((1..=u8::MAX).filter(|byte| Service::of(*byte).is_some()).count(), 12);
        for state in (0..=u8::MAX).filter_map(State::of) {
            let answer = Answer { state, job: 1, piece: 2, status: 0x8304, len: 32_768 };
            assert_eq!(Answer::read(&answer.bytes()), answer);
        }
        assert_eq!(Answer::read(&[0xFF; HEAD_BYTES]).state, State::None);
    }

    #[test]
    fn pieces_are_480_bytes() {
        assert_eq!([0, 1, 480, 481, 32_768].map(pieces), [1, 1, 1, 2, 69]);
        assert_eq!((range(0, 500), range(1, 500), range(2, 500)), (0..480, 480..500, 500..500));
        for index in 0..BOXES {
            assert_eq!(of_record(record(index)), Some(index));
        }
        assert_eq!((of_record(0x7F), of_record(0xC0)), (None, None));
    }
}
