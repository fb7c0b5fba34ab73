//! Calls of other blocks, and information about the running organization block.

use crate::abi;

use crate::reply::{Abort, Reply, reply};
use crate::{Area, Cx};

/// An actual parameter of a call.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Arg {
    /// Not supplied; FB only.
    Open,
    /// A value, right-aligned; numbers of timers, counters and blocks too.
    Value(u32),
    /// The operand at this bit address (byte * 8 + bit).
    Operand(Area, u32),
}

/// The running organization block.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ObInfo {
    /// Number of the organization block.
    pub number: u16,
    /// Priority class of the organization block.
    pub priority: u8,
    /// Its start information, as in its local data.
    pub start: [u8; 20],
}

/// Maximum number of arguments of a call.
const ARGS_MAX: usize = 64;

impl<M> Cx<'_, M> {
    /// Calls an FC, with one argument per formal parameter.
    ///
    /// # Errors
    /// [`Abort`]; refused with `NoBlock`, `BadArgument` beyond 64 arguments.
    pub fn call_fc(&mut self, number: u16, args: &[Arg]) -> Reply<()> {
        self.call_block(abi::KIND_FC, number, 0, args)
    }

    /// Calls an FB on an instance data block, with one argument per formal parameter.
    ///
    /// # Errors
    /// [`Abort`]; refused with `NoBlock`, `NoDb`, `BadArgument` beyond 64 arguments.
    pub fn call_fb(&mut self, number: u16, instance_db: u16, args: &[Arg]) -> Reply<()> {
        self.call_block(abi::KIND_FB, number, instance_db, args)
    }

    /// Calls a system function.
    ///
    /// # Errors
    /// [`Abort`]; refused with `NoBlock`, `BadArgument` beyond 64 arguments.
    pub fn call_sfc(&mut self, number: u16, args: &[Arg]) -> Reply<()> {
        self.call_block(abi::KIND_SFC, number, 0, args)
    }

    /// Calls a system function block on an instance data block.
    ///
    /// # Errors
    /// [`Abort`]; refused with `NoBlock`, `NoDb`, `BadArgument` beyond 64 arguments.
    pub fn call_sfb(&mut self, number: u16, instance_db: u16, args: &[Arg]) -> Reply<()> {
        self.call_block(abi::KIND_SFB, number, instance_db, args)
    }

    fn call_block(&mut self, kind: u8, number: u16, instance_db: u16, args: &[Arg]) -> Reply<()> {
        let mut raw = [abi::CallArg::default(); ARGS_MAX];
        let Some(raw) = raw.get_mut(..args.len()) else { return Ok(Err(crate::Refused::BadArgument)) };
        for (raw, arg) in raw.iter_mut().zip(args) {
            match *arg {
                Arg::Open => {}
                Arg::Value(value) => (raw.kind, raw.value) = (1, value),
                Arg::Operand(area, bit) => {
                    (raw.area, raw.db) = area.code();
                    (raw.kind, raw.bit_address) = (2, bit);
                }
            }
        }
        let (host, call) = self.edge();
        // SAFETY: `host` and `call` belong to the running entry (Cx::new); pointer and length are those of a slice.
        reply(unsafe { (host.call_block)(call, kind, number, instance_db, raw.as_ptr(), raw.len() as u32) })
    }

    /// The running organization block.
    ///
    /// # Errors
    /// [`Abort`], if the CPU goes to STOP.
    pub fn ob_info(&mut self) -> Result<ObInfo, Abort> {
        let ((host, call), size) = (self.edge(), size_of::<abi::ObInfo>() as u32);
        let mut info = abi::ObInfo { size, ..Default::default() };
        // SAFETY: as in `call_block`; the size is set.
        let _always_there = reply(unsafe { (host.ob_info)(call, &raw mut info) })?;
        Ok(ObInfo { number: info.number, priority: info.priority, start: info.start })
    }
}
