//! The module as the blocks see it, and one call of each direction.

use ob1_sdk::{Abort, Area, Cx, Instance, Refused};
use ob1_words::slio::{ACKNOWLEDGE_SHIFT, IDLE, IO_BYTES, Piece, ReceiveJob, ReceiveStep, SendJob, SendStep, Take};

use crate::state::CpState;
use crate::status;

const IO_MAX: usize = *IO_BYTES.end();

/// A CP 040 whose driver answers, with its current inputs.
pub(crate) struct Module<'a> {
    output_address: u32,
    inputs: [u8; IO_MAX],
    io_bytes: usize,
    pub(crate) state: &'a CpState,
}

/// The program's request to the send side.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Order {
    /// A rising edge of REQ in this call, and no request waits.
    pub(crate) rises: bool,
    /// A request: it has risen in this call, or it waits.
    pub(crate) request: bool,
    /// A rising edge of R.
    pub(crate) reset: bool,
    /// The instance that gives the job.
    pub(crate) instance: u64,
    /// The instance has started a job and has not yet reported its end.
    pub(crate) busy: bool,
    pub(crate) db: i16,
    pub(crate) byte: i16,
    pub(crate) length: i16,
}

impl Order {
    /// There is no order.
    pub(crate) const fn is_idle(&self) -> bool {
        !self.request && !self.reset && !self.busy
    }
}

/// The result of a call of either direction.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Outcome {
    /// No job, no telegram: nothing to report.
    Nothing,
    /// A job runs; later calls report its end.
    Running,
    /// The request must be repeated later, because the CP is not ready.
    Later,
    /// The same, because another instance sends.
    Queued,
    /// A reset has begun, and the job or the telegram that it ends is lost.
    Lost,
    /// Sent, received (with the length), or reset executed.
    Done(u16),
    /// An error, with STATUS.
    Error(u16),
}

impl Outcome {
    /// The output ERROR of the block.
    pub(crate) const fn is_error(self) -> bool {
        matches!(self, Self::Error(_) | Self::Lost)
    }

    /// The output DONE of the send side, NDR of the receive side.
    pub(crate) const fn is_done(self) -> bool {
        matches!(self, Self::Done(_))
    }

    /// LEN of the receive side: 0 with an error; `None`: as it was.
    pub(crate) const fn length(self) -> Option<i16> {
        match self {
            Self::Done(length) => Some(length as i16),
            Self::Error(_) | Self::Lost => Some(0),
            _ => None,
        }
    }

    /// The output STATUS of the block.
    pub(crate) const fn status(self) -> u16 {
        match self {
            Self::Nothing | Self::Done(_) => status::NONE,
            Self::Running | Self::Later | Self::Queued => status::RUNNING,
            Self::Lost => status::FAILED,
            Self::Error(status) => status,
        }
    }
}

/// The called instance as a number; never 0.
pub(crate) fn instance(cx: &mut Cx<'_, CpState>) -> Result<u64, Abort> {
    Ok(cx.instance()?.map_or(u64::MAX, Instance::key))
}

/// A logical address or a byte number: declared as INT, but unsigned.
fn unsigned(number: i16) -> u32 {
    u32::from(number as u16)
}

impl<'a> Module<'a> {
    /// Reads the state of the module; returns the outcome of the call if there is nothing more to do.
    ///
    /// The inputs are read before the state of the driver: so inputs that a dead driver no longer updates are never
    /// taken for those of a living one.
    pub(crate) fn open(
        cx: &mut Cx<'a, CpState>,
        input: i16,
        output: i16,
        io_size: u16,
    ) -> Result<Result<Self, Outcome>, Abort> {
        let (input_address, output_address) = (unsigned(input), unsigned(output));
        let io_bytes = usize::from(io_size);
        if !IO_BYTES.contains(&io_bytes) {
            return Ok(Err(Outcome::Error(status::NOT_SYNCHRONISED)));
        }
        let mut inputs = [0; IO_MAX];
        let read = cx.io_read(input_address, &mut inputs[..io_bytes])?;
        let Ok(info) = cx.module_info(input_address)? else { return Ok(Err(Outcome::Error(status::READ_ACCESS))) };
        if usize::from(info.input_bytes) != io_bytes {
            return Ok(Err(Outcome::Error(status::NOT_SYNCHRONISED)));
        }
        let Ok(state) = cx.module_state(input_address)? else { return Ok(Err(Outcome::Error(status::READ_ACCESS))) };
        match read {
            Ok(()) if info.present => {}
            // The process of the CP is being restarted; the request waits.
            Ok(()) => return Ok(Err(Outcome::Later)),
            Err(_) => return Ok(Err(Outcome::Error(status::READ_ACCESS))),
        }
        let module = Self { output_address, inputs, io_bytes, state };
        if let Some(byte) = state.see(info.generation) {
            // The inputs may be from before this start.
            return Ok(Err(match cx.io_write(output_address, &[byte])? {
                Ok(()) => Outcome::Later,
                Err(_) => Outcome::Error(status::WRITE_ACCESS),
            }));
        }
        Ok(Ok(module))
    }

    fn inputs(&self) -> &[u8] {
        &self.inputs[..self.io_bytes]
    }

    /// Writes one nibble of byte 0.
    fn put(&self, cx: &mut Cx<'_, CpState>, byte: u8) -> Result<Result<(), u16>, Abort> {
        if cx.io_write(self.output_address, &[byte])?.is_err() {
            return Ok(Err(status::WRITE_ACCESS));
        }
        self.state.set_byte0(byte);
        Ok(Ok(()))
    }

    fn command(&self, cx: &mut Cx<'_, CpState>, nibble: u8) -> Result<Result<(), u16>, Abort> {
        self.put(cx, self.state.byte0() & 0xF0 | nibble)
    }

    fn acknowledge(&self, cx: &mut Cx<'_, CpState>, nibble: u8) -> Result<Result<(), u16>, Abort> {
        self.put(cx, self.state.byte0() & 0x0F | nibble << ACKNOWLEDGE_SHIFT)
    }

    // ---- send ----

    /// One call of the send side.
    pub(crate) fn send(&self, cx: &mut Cx<'_, CpState>, order: Order) -> Result<Outcome, Abort> {
        let (state, now_ms) = (self.state, cx.now() / 1_000_000);
        let owns = state.is_owner(order.instance);
        let is_owner = owns && order.busy;
        // DONE of the reset must not be taken for that of the job.
        let is_lost = order.reset && (order.request || is_owner && !state.send().is_reset());
        let is_taken = !owns && state.send().is_running() && !(order.request && state.is_abandoned(now_ms));
        if order.reset {
            state.leave(order.instance);
            // A reset ends every running job.
            state.claim(order.instance, SendJob::reset(), status::FAILED);
            state.drop_receive();
            if let Err(status) = self.acknowledge(cx, IDLE)? {
                return Ok(Outcome::Error(status));
            }
        } else if is_owner {
            // A request while a job runs is ignored.
        } else if order.busy {
            return Ok(Outcome::Error(state.lost()));
        } else if owns && !order.request {
            // Its end has been told: a call with wrong parameters, or the instance was written anew.
            state.claim(0, SendJob::default(), status::NOT_SYNCHRONISED);
        } else if order.request && (is_taken || state.is_behind(order.instance, now_ms)) {
            state.queue(order.instance, now_ms);
            return Ok(Outcome::Queued);
        } else if is_taken {
            return Ok(Outcome::Nothing);
        } else if order.request {
            state.leave(order.instance);
            let Some(job) = u16::try_from(order.length).ok().and_then(SendJob::telegram) else {
                return Ok(Outcome::Error(status::LENGTH));
            };
            let end = unsigned(order.byte) + unsigned(order.length);
            if !cx.len(Area::Db(order.db as u16))?.is_ok_and(|bytes| end <= bytes) {
                return Ok(Outcome::Error(status::DATA_BLOCK));
            }
            state.claim(order.instance, job, status::NOT_SYNCHRONISED);
            state.set_source(order.db as u16, order.byte as u16);
        }
        state.touch(now_ms);
        let running = state.send().is_running();
        let (job, step) = state.send().step(self.inputs(), state.byte0(), self.io_bytes);
        let done = match step {
            SendStep::Wait => Ok(()),
            SendStep::Command(nibble) => self.command(cx, nibble)?,
            SendStep::Put(piece) => self.piece(cx, &piece)?,
            SendStep::Done | SendStep::Failed(_) => self.command(cx, IDLE)?,
        };
        if let Err(status) = done {
            state.claim(0, SendJob::default(), status);
            return Ok(Outcome::Error(status));
        }
        state.set_send(job);
        Ok(match step {
            SendStep::Done => Outcome::Done(0),
            SendStep::Failed(failure) => Outcome::Error(status::of(failure)),
            _ if is_lost => Outcome::Lost,
            _ if running => Outcome::Running,
            _ => Outcome::Nothing,
        })
    }

    fn piece(&self, cx: &mut Cx<'_, CpState>, piece: &Piece) -> Result<Result<(), u16>, Abort> {
        let mut area = [0; IO_MAX];
        let Some(area) = area.get_mut(..self.io_bytes) else { return Ok(Err(status::NOT_SYNCHRONISED)) };
        let byte0 = self.state.byte0() & 0xF0 | piece.command;
        area[0] = byte0;
        let at = 1 + piece.head(&mut area[1..]);
        let Some(data) = area.get_mut(at..at + piece.count) else { return Ok(Err(status::NOT_SYNCHRONISED)) };
        let (db, byte) = self.state.source();
        if cx.read(Area::Db(db), u32::from(byte) + piece.from as u32, data)?.is_err() {
            self.command(cx, IDLE)?.ok();
            return Ok(Err(status::DATA_BLOCK));
        }
        if cx.io_write(self.output_address, area)?.is_err() {
            return Ok(Err(status::WRITE_ACCESS));
        }
        self.state.set_byte0(byte0);
        Ok(Ok(()))
    }

    // ---- receive ----

    /// One call of the receive side.
    pub(crate) fn receive(
        &self,
        cx: &mut Cx<'_, CpState>,
        enabled: bool,
        db: i16,
        byte: i16,
    ) -> Result<Outcome, Abort> {
        let state = self.state;
        if state.take_cut_off() {
            return Ok(Outcome::Error(status::NOT_SYNCHRONISED));
        }
        if state.send().is_reset() {
            if !state.is_abandoned(cx.now() / 1_000_000) {
                return Ok(Outcome::Running);
            }
            state.claim(0, SendJob::default(), status::NOT_SYNCHRONISED);
            if let Err(status) = self.command(cx, IDLE)? {
                return Ok(Outcome::Error(status));
            }
        }
        let job = state.receive();
        if !enabled && (job.is_running() || job == ReceiveJob::default()) {
            return Ok(Outcome::Nothing);
        }
        let (next, step) = job.step(self.inputs(), state.byte0(), state.send());
        let outcome = match step {
            ReceiveStep::Wait if next.is_running() => Outcome::Running,
            ReceiveStep::Wait => Outcome::Nothing,
            // The acknowledgement must return to idle before the next telegram.
            ReceiveStep::Take(_) if !enabled => return Ok(Outcome::Nothing),
            ReceiveStep::Take(take) => {
                if let Err(status) = self.take(cx, next, &take, db, byte)? {
                    return Ok(Outcome::Error(status));
                }
                match take.received {
                    None => Outcome::Running,
                    Some(received) if received.return_value == 0 => Outcome::Done(received.length),
                    Some(received) => Outcome::Error(received.return_value),
                }
            }
            ReceiveStep::Acknowledge(nibble) => match self.acknowledge(cx, nibble)? {
                Ok(()) => Outcome::Nothing,
                Err(status) => Outcome::Error(status),
            },
            ReceiveStep::Failed(failure) => match self.acknowledge(cx, IDLE)? {
                Ok(()) => Outcome::Error(status::of(failure)),
                Err(status) => Outcome::Error(status),
            },
        };
        state.set_receive(next);
        Ok(outcome)
    }

    /// Stores a fragment and acknowledges it. A fragment that does not fit waits in the CP until it fits, or until a
    /// reset (ours).
    fn take(
        &self,
        cx: &mut Cx<'_, CpState>,
        job: ReceiveJob,
        take: &Take,
        db: i16,
        byte: i16,
    ) -> Result<Result<(), u16>, Abort> {
        let Some(data) = self.inputs().get(take.from..take.from + take.count) else {
            return Ok(Err(status::NOT_SYNCHRONISED));
        };
        // A telegram is in one place: that of its first fragment.
        let place = if job.is_at_first() { (db as u16, byte as u16) } else { self.state.target() };
        let (db, begin) = (Area::Db(place.0), u32::from(place.1));
        // An error reported by the CP has no data and needs no data block.
        if job.end() > 0 {
            match cx.len(db)? {
                Ok(len) if begin as usize + job.end() <= len as usize => {}
                Ok(_) => return Ok(Err(status::TOO_SHORT)),
                Err(Refused::DbNumber) => return Ok(Err(status::DATA_BLOCK)),
                Err(_) => return Ok(Err(status::NOT_READABLE)),
            }
            if cx.write(db, begin + take.at as u32, data)?.is_err() {
                return Ok(Err(status::NOT_READABLE));
            }
            self.state.set_target(place.0, place.1);
        }
        self.acknowledge(cx, take.acknowledge)
    }
}
