//! RK 512 between CPU and protocol: parses the CPU's orders and answers, and hands over results and orders of the
//! partner block by block (docs/cp240-registers.md, "RK 512").

use ob1_protocols::rk512::{Answer, Command, OrderError, Request};

pub(crate) use ob1_words::cp240::RK512_HEADER_BYTES as HEADER_BYTES;
use ob1_words::cp240::{
    BLOCK_BYTES, BUFFER_BYTES, OWN_ORDER, PARTNER_ORDER, RK512_RESULT_BYTES as RESULT_BYTES, framed_count,
};

/// Third byte of a result: the error number is the partner's.
const BY_PARTNER: u8 = 0;
/// Third byte of a result: the error number is the CP's.
const BY_CP: u8 = 1;

/// What waits for the CPU.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Offer {
    /// The end of the CPU's own order.
    Result,
    /// An order of the partner.
    Partner,
    /// An order of the partner that the CP has refused by itself, reported to the program.
    Notice,
}

impl Offer {
    const fn framing(self) -> u16 {
        match self {
            Self::Result => OWN_ORDER,
            Self::Partner | Self::Notice => PARTNER_ORDER,
        }
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum State {
    /// Nothing is shown: `RX` is 0.
    Idle,
    /// `RX` is the framing and `rest`, with its block.
    Offered { what: Offer, rest: usize },
    /// `RX` is 0 again; the count in `RX echo` must become 0.
    Closing,
}

/// Bytes waiting for the CPU.
#[derive(Debug)]
struct Record<const N: usize> {
    bytes: [u8; N],
    len: usize,
}

impl<const N: usize> Record<N> {
    const fn new() -> Self {
        Self { bytes: [0; N], len: 0 }
    }

    fn set(&mut self, head: &[u8], data: &[u8]) {
        let len = (head.len() + data.len()).min(N);
        let data_len = len - head.len();
        self.bytes[..head.len()].copy_from_slice(head);
        self.bytes[head.len()..len].copy_from_slice(&data[..data_len]);
        self.len = len;
    }

    fn get(&self) -> &[u8] {
        &self.bytes[..self.len]
    }
}

/// A telegram of the CPU, parsed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Handed<'a> {
    /// An order of the CPU, with its data.
    Order(Request, &'a [u8]),
    /// An invalid order: its header or its length is wrong.
    BadOrder,
    /// The answer to the partner's order that the CPU has.
    Answer(Answer<'a>),
    /// An answer to an order that has already ended.
    Stale,
}

/// The receive side of RK 512: one result and one order of the partner.
#[derive(Debug)]
pub(crate) struct Rk512Side {
    state: State,
    block: [u8; BLOCK_BYTES],
    result: Record<{ RESULT_BYTES + BUFFER_BYTES }>,
    partner: Record<{ HEADER_BYTES + BUFFER_BYTES }>,
    notice: Record<HEADER_BYTES>,
    /// The CPU's mark on the running order, or on the last one; it is returned in its result.
    token: u8,
    /// Number of the last order of the partner, 1 to 255.
    job: u8,
    /// Its command, while the CPU's answer is awaited.
    asked: Option<Command>,
}

impl Rk512Side {
    pub(crate) const fn new() -> Self {
        Self {
            state: State::Idle,
            block: [0; BLOCK_BYTES],
            result: Record::new(),
            partner: Record::new(),
            notice: Record::new(),
            token: 0,
            job: 0,
            asked: None,
        }
    }

    /// Back to "nothing received"; true if an order of the partner was waiting.
    pub(crate) fn clear(&mut self) -> bool {
        let dropped = self.partner.len > 0;
        (self.state, self.result.len, self.partner.len, self.asked) = (State::Idle, 0, 0, None);
        self.notice.len = 0;
        dropped
    }

    // ---- from the CPU ----

    /// Parses a complete telegram of the CPU. The mark of an order is kept, and the result of the previous order is
    /// dropped.
    pub(crate) fn handed<'a>(&mut self, framing: u16, telegram: &'a [u8]) -> Handed<'a> {
        if framing == OWN_ORDER {
            self.drop_result();
            self.token = telegram.get(1).copied().unwrap_or(0);
            let parts = telegram.split_first_chunk::<HEADER_BYTES>();
            let order = parts.and_then(|(&[first, _token, ref rest @ ..], data)| {
                let mut header = [0; HEADER_BYTES];
                header[0] = first;
                header[2..].copy_from_slice(rest);
                Request::of_header(&header).ok().map(|request| Handed::Order(request, data))
            });
            return order.unwrap_or(Handed::BadOrder);
        }
        match (telegram.split_first_chunk::<RESULT_BYTES>(), self.asked) {
            (Some((&[_, job, _, code], data)), Some(command)) if job == self.job => {
                self.asked = None;
                Handed::Answer(match command {
                    _ if code != 0 => Answer::Refused(code),
                    Command::Send => Answer::Taken,
                    Command::Fetch => Answer::Data(data),
                })
            }
            _ => Handed::Stale,
        }
    }

    fn drop_result(&mut self) {
        self.result.len = 0;
        if matches!(self.state, State::Offered { what: Offer::Result, .. }) {
            self.state = State::Closing;
        }
    }

    // ---- from the protocol ----

    /// The CPU's order has ended.
    pub(crate) fn ended(&mut self, outcome: Result<&[u8], OrderError>) {
        let (by, code, data) = match outcome {
            Ok(data) => (BY_PARTNER, 0, data),
            Err(error @ (OrderError::Rejected(_) | OrderError::NoArea)) => (BY_PARTNER, error.code(), &[][..]),
            Err(error) => (BY_CP, error.code(), &[][..]),
        };
        self.result.set(&[0, self.token, by, code], data);
    }

    /// The partner has sent an order.
    pub(crate) fn asked(&mut self, request: &Request, data: &[u8]) {
        self.job = if self.job == u8::MAX { 1 } else { self.job + 1 };
        self.asked = Some(request.command);
        let mut header = request.header();
        header[1] = self.job;
        self.partner.set(&header, data);
    }

    /// The CP has refused an order of the partner that the CPU has not seen; `code` is for its indicator word. Number
    /// 0: no answer is awaited. Of several, only the last is reported.
    pub(crate) fn refused(&mut self, code: u8) {
        if !matches!(self.state, State::Offered { what: Offer::Notice, .. }) {
            self.notice.set(&[code, 0, 0, 0, 0, 0, 0, 0, 0, 0], &[]);
        }
    }

    /// The order of the partner has ended. True if the CPU had not fetched it completely: it is removed from the
    /// registers.
    pub(crate) fn answered(&mut self) -> bool {
        self.asked = None;
        let waiting = self.partner.len > 0;
        self.partner.len = 0;
        if matches!(self.state, State::Offered { what: Offer::Partner, .. }) {
            self.state = State::Closing;
        }
        waiting
    }

    // ---- the registers ----

    /// The count word `RX` as it is shown.
    pub(crate) const fn rx(&self) -> u16 {
        match self.state {
            State::Idle | State::Closing => 0,
            State::Offered { what, rest } => what.framing() | rest as u16,
        }
    }

    /// The order of the partner that waits for the CPU or its answer: how many, and a number that changes when the CPU
    /// takes a part of it.
    pub(crate) fn waiting(&self) -> (usize, u32) {
        (self.asked.is_some().into(), u32::from(self.job) << 16 | u32::from(self.rx()))
    }

    /// The block of `RX`.
    pub(crate) fn block(&self) -> &[u8] {
        match self.state {
            State::Offered { rest, .. } => &self.block[..rest.min(BLOCK_BYTES)],
            State::Idle | State::Closing => &[],
        }
    }

    /// Evaluates `RX echo`. Returns what was handed over completely, with its length.
    pub(crate) fn look(&mut self, echo: u16) -> Option<(Offer, usize)> {
        let (framing, count) = framed_count(echo)?;
        match self.state {
            State::Closing if count == 0 => {
                self.state = State::Idle;
                self.look(echo)
            }
            State::Idle if count == 0 => {
                // Results come first: the program may have no call that takes the partner's order.
                if self.result.len > 0 {
                    self.offer(Offer::Result, self.result.len);
                } else if self.partner.len > 0 && framing == PARTNER_ORDER {
                    self.offer(Offer::Partner, self.partner.len);
                } else if self.notice.len > 0 && framing == PARTNER_ORDER {
                    self.offer(Offer::Notice, self.notice.len);
                }
                None
            }
            State::Offered { what, rest } if framing == what.framing() && count == rest => {
                if rest > BLOCK_BYTES {
                    self.offer(what, rest - BLOCK_BYTES);
                    return None;
                }
                self.state = State::Closing;
                let len = match what {
                    Offer::Result => &mut self.result.len,
                    Offer::Partner => &mut self.partner.len,
                    Offer::Notice => &mut self.notice.len,
                };
                Some((what, core::mem::take(len)))
            }
            _ => None,
        }
    }

    fn offer(&mut self, what: Offer, rest: usize) {
        let record = match what {
            Offer::Result => self.result.get(),
            Offer::Partner => self.partner.get(),
            Offer::Notice => self.notice.get(),
        };
        let from = record.len() - rest;
        let block = &record[from..record.len().min(from + BLOCK_BYTES)];
        self.block[..block.len()].copy_from_slice(block);
        self.state = State::Offered { what, rest };
    }
}
