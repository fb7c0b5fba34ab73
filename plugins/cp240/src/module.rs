//! The module a handling block is called for: its registers, its settings, the plugin's memory for it.

use std::cell::Cell;

use ob1_sdk::{Abort, Cx, ModuleInfo, Refused};

use crate::pafe::Pafe;
use crate::registers::{BlockBytes, REGISTER_BYTES, Words};
use crate::settings::{self, Service};
use crate::state::CpState;

/// Number of the entry in the diagnostic buffer: this handling block has no function for this CP (ours).
const NO_USE: u16 = 1;
/// Number of the entry: a block waits for a data block that is not present or too short (ours).
const NO_ROOM: u16 = 2;
/// Time between two entries about different data blocks, in nanoseconds.
const TOLD_EVERY: u64 = 10_000_000_000;

ob1_sdk::state! {
    /// What the diagnostic buffer has been told of a module.
    #[derive(Debug, Default)]
    pub(crate) struct Told {
        /// A call without function.
        no_use: Cell<bool>,
        /// The data block that a block waits for: number of the block, of the data block, and PAFE; and when.
        waits: Cell<u32>,
        at: Cell<u64>,
    }
}

/// The module a block is called for, with the plugin's memory for it.
pub(crate) struct Module<'a> {
    pub(crate) address: u32,
    pub(crate) info: ModuleInfo,
    pub(crate) state: &'a CpState,
}

/// A block's access to the CP. If there is no module, or a driver is down and the station file says `absent = "fault"`,
/// an access has the same effect as `L PEW` and `T PAW`: event 2942h or 2943h, OB 122 or STOP; `None` if OB 122 has
/// handled it.
impl<'a> Module<'a> {
    /// The registers are read before the state of the driver: so the 0 of a dead driver is never taken for the 0 of an
    /// acknowledged telegram.
    ///
    /// `None` also for a Modbus slave "short": its registers hold the data of the master and not count words.
    pub(crate) fn read<const N: usize>(cx: &mut Cx<'a, CpState>, adr: i16) -> Result<Option<(Self, [u8; N])>, Abort> {
        let Some((module, registers)) = Self::reach(cx, adr)? else { return Ok(None) };
        if module.service(cx)? == Service::Nothing {
            let text = "a handling block was called, but the registers of a Modbus slave \"short\" are its data";
            return module.tell_no_use(cx, text).map(|()| None);
        }
        Ok(Some((module, registers)))
    }

    /// The same, also for a Modbus slave "short".
    pub(crate) fn reach<const N: usize>(cx: &mut Cx<'a, CpState>, adr: i16) -> Result<Option<(Self, [u8; N])>, Abort> {
        let address = address(adr);
        let mut registers = [0; N];
        if !read(cx, address, &mut registers)? {
            return Ok(None);
        }
        let info = cx.module_info(address)?;
        let Some(info) = read_access(cx, info, address)? else { return Ok(None) };
        let state = cx.module_state(address)?;
        Ok(read_access(cx, state, address)?.map(|state| (Self { address, info, state }, registers)))
    }

    /// The same as [`Module::read`], but only the two count words.
    pub(crate) fn words(cx: &mut Cx<'a, CpState>, adr: i16) -> Result<Option<(Self, Words)>, Abort> {
        Ok(Self::read(cx, adr)?.map(|(module, bytes)| (module, Words::from_bytes(bytes))))
    }

    /// The count words and the block, read together so that they match.
    pub(crate) fn block(cx: &mut Cx<'a, CpState>, adr: i16) -> Result<Option<(Self, Words, BlockBytes)>, Abort> {
        let read = Self::read::<REGISTER_BYTES>(cx, adr)?;
        Ok(read.map(|(module, [a, b, c, d, block @ ..])| (module, Words::from_bytes([a, b, c, d]), block)))
    }

    /// The byte that ABD refers to.
    pub(crate) fn offset(&self, cx: &mut Cx<'_, CpState>, abd: u16) -> Result<u32, Abort> {
        settings::offset(cx, self.address, self.state, abd)
    }

    /// The blocks the CP supports.
    pub(crate) fn service(&self, cx: &mut Cx<'_, CpState>) -> Result<Service, Abort> {
        settings::service(cx, self.address, self.state)
    }

    /// Reports a call that has no function for this CP, once for each start of the station.
    pub(crate) fn tell_no_use(&self, cx: &mut Cx<'_, CpState>, text: &str) -> Result<(), Abort> {
        if self.state.told.no_use.replace(true) {
            return Ok(());
        }
        cx.diag_entry(NO_USE, format_args!("module at {}: {text}", self.address))
    }

    /// Reports the data block that the block FC `fc` waits for, once until it is right; other ones every ten seconds.
    pub(crate) fn tell_pafe(&self, cx: &mut Cx<'_, CpState>, fc: u16, db: u16, pafe: Pafe) -> Result<(), Abort> {
        let told = &self.state.told;
        let (who, before) = (u32::from(fc) << 24 | u32::from(db) << 8, told.waits.get());
        let is_same = before & !0xFF == who;
        if pafe == Pafe::Ok {
            if is_same {
                told.waits.set(0);
            }
            return Ok(());
        }
        let value = who | pafe as u32;
        if before == value {
            return Ok(());
        }
        let now = cx.now();
        if before != 0 && now.saturating_sub(told.at.get()) < TOLD_EVERY {
            return Ok(());
        }
        told.waits.set(value);
        told.at.set(now);
        let what = match pafe {
            Pafe::Missing => "is not present",
            Pafe::Number => "has no valid number",
            _ => "is too short",
        };
        let text = format_args!("module at {}: FC {fc} waits, DB {db} {what} (PAFE {})", self.address, pafe as u8);
        cx.diag_entry(NO_ROOM, text)
    }

    /// Whether no job may start and none of before goes on: the CP is not synchronised, or FC 9 is about it. "A
    /// communication with SEND and RECEIVE blocks is only possible when the parameter ANL of the SYNCHRON block has
    /// been set" [S0 L1069], and FC 9 has set it back.
    pub(crate) fn is_closed(&self, words: Words) -> bool {
        words.not_ready() || self.state.acknowledged.get() != 0
    }

    /// Writes bytes from an offset on, in one access. False if the access failed and OB 122 has handled it.
    pub(crate) fn write(&self, cx: &mut Cx<'_, CpState>, offset: u32, bytes: &[u8]) -> Result<bool, Abort> {
        match cx.io_write(self.address + offset, bytes)? {
            Ok(()) => Ok(true),
            Err(_) => cx.raise_fault(0x2943, self.address).map(|()| false),
        }
    }
}

/// The logical address: the manual declares it as INT, but addresses are unsigned.
pub(crate) fn address(adr: i16) -> u32 {
    u32::from(adr as u16)
}

/// Reads registers; false if the access failed and OB 122 has handled it.
pub(crate) fn read(cx: &mut Cx<'_, CpState>, address: u32, into: &mut [u8]) -> Result<bool, Abort> {
    let done = cx.io_read(address, into)?;
    Ok(read_access(cx, done, address)?.is_some())
}

fn read_access<T>(cx: &mut Cx<'_, CpState>, done: Result<T, Refused>, address: u32) -> Result<Option<T>, Abort> {
    match done {
        Ok(value) => Ok(Some(value)),
        Err(_) => cx.raise_fault(0x2942, address).map(|()| None),
    }
}
