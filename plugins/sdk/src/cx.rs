//! The call in progress: parameters, and what every block needs.

use core::fmt::Display;
use core::marker::PhantomData;

use crate::abi::{self as abi, CallContext, HostTable};

use crate::formal::{Formal, Readable, Writable};
use crate::reply::{Abort, Reply, reply};
use crate::text::Line;
use crate::types::{Elementary, S7Type};

/// The call in progress. Everything a block does goes through it; `M` is the plugin's memory per module.
///
/// Functions that fail only when the block itself is wrong return `Result<_, Abort>`; the others return a [`Reply`].
#[derive(Debug)]
pub struct Cx<'a, M = ()> {
    host: &'a HostTable,
    call: *mut CallContext,
    _module: PhantomData<&'a M>,
}

/// Severity of a log line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Level {
    /// Something does not work.
    Error = abi::LOG_ERROR,
    /// Something is odd, and work goes on.
    Warn = abi::LOG_WARN,
    /// Something happened, as it should.
    Info = abi::LOG_INFO,
}

/// The data blocks the caller has opened; 0 for none.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Registers {
    /// The data block of `AUF DB`.
    pub db: u16,
    /// The data block of `AUF DI`.
    pub di: u16,
}

impl<'a, M> Cx<'a, M> {
    /// # Safety
    /// `host` and `call` are those the host passed to the running entry; the result does not outlive that entry.
    #[inline]
    pub(crate) unsafe fn new(host: &'a HostTable, call: *mut CallContext) -> Self {
        Self { host, call, _module: PhantomData }
    }

    /// The two things every host function needs.
    #[inline]
    pub(crate) fn edge(&self) -> (&'a HostTable, *mut CallContext) {
        (self.host, self.call)
    }

    /// The value of an actual parameter.
    ///
    /// # Errors
    /// [`Abort`] when an unreadable actual has taken the CPU to STOP; with OB 121 loaded the value is 0 then.
    #[inline]
    pub fn get<T: Elementary, S: Readable>(&mut self, formal: Formal<T, S>) -> Result<T::Value, Abort> {
        let mut raw = 0;
        // SAFETY: `host` and `call` belong to the running entry (Cx::new); the pointer lives through the call.
        let status = unsafe { (self.host.param_get)(self.call, formal.index(), &raw mut raw) };
        if status != abi::OK {
            self.parameter_fault(status, 0x2522, formal.index())?;
        }
        Ok(T::from_raw(raw))
    }

    /// Writes an actual parameter: at once for M, E, A, L operands and instances, after the return for data operands.
    ///
    /// # Errors
    /// [`Abort`] when an unwritable actual has taken the CPU to STOP.
    #[inline]
    pub fn set<T: Elementary, S: Writable>(&mut self, formal: Formal<T, S>, value: T::Value) -> Result<(), Abort> {
        // SAFETY: as in `get`.
        let status = unsafe { (self.host.param_set)(self.call, formal.index(), T::to_raw(value)) };
        if status == abi::OK { Ok(()) } else { self.parameter_fault(status, 0x2523, formal.index()) }
    }

    /// Raises an area length error, as a statement with such an operand does.
    #[cold]
    fn parameter_fault(&mut self, status: abi::Status, event: u16, index: u32) -> Result<(), Abort> {
        match reply(status)? {
            Ok(()) => Ok(()),
            Err(_) => self.raise_fault(event, index),
        }
    }

    /// Copies bytes of an actual wider than 32 bits (STRING, DATE_AND_TIME, ANY), from its byte `at`.
    ///
    /// # Errors
    /// [`Abort`]; refused with `NoParam` or `Outside`.
    pub fn get_bytes<T: S7Type, S: Readable>(&mut self, formal: Formal<T, S>, at: u32, into: &mut [u8]) -> Reply<()> {
        // SAFETY: as in `get`; pointer and length are those of a slice.
        reply(unsafe { (self.host.param_read)(self.call, formal.index(), at, into.as_mut_ptr(), into.len() as u32) })
    }

    /// Writes bytes of such an actual.
    ///
    /// # Errors
    /// [`Abort`]; refused with `NoParam` or `Outside`.
    pub fn set_bytes<T: S7Type, S: Writable>(&mut self, formal: Formal<T, S>, at: u32, from: &[u8]) -> Reply<()> {
        // SAFETY: as in `get_bytes`.
        reply(unsafe { (self.host.param_write)(self.call, formal.index(), at, from.as_ptr(), from.len() as u32) })
    }

    /// True when the caller supplied this actual (an FB's parameters may be left open).
    #[inline]
    pub fn is_given<T, S>(&mut self, formal: Formal<T, S>) -> bool {
        // SAFETY: as in `get`.
        unsafe { (self.host.param_given)(self.call, formal.index()) == abi::OK }
    }

    /// The data blocks the caller has opened.
    ///
    /// # Errors
    /// [`Abort`], if the CPU goes to STOP.
    pub fn registers(&mut self) -> Result<Registers, Abort> {
        let mut registers = abi::Registers { size: size_of::<abi::Registers>() as u32, ..Default::default() };
        // SAFETY: as in `get`; the size is set.
        let _always_there = reply(unsafe { (self.host.registers)(self.call, &raw mut registers) })?;
        Ok(Registers { db: registers.db, di: registers.di })
    }

    /// Sets the binary result the caller sees after the call; 1 unless set.
    ///
    /// # Errors
    /// [`Abort`], if the CPU goes to STOP.
    pub fn set_br(&mut self, br: bool) -> Result<(), Abort> {
        // SAFETY: as in `get`.
        reply(unsafe { (self.host.set_br)(self.call, u8::from(br)) }).map(drop)
    }

    /// Nanoseconds since the runtime started; virtual in a simulation.
    #[must_use]
    pub fn now(&mut self) -> u64 {
        let mut nanos = 0;
        // SAFETY: as in `get`.
        unsafe { (self.host.now)(self.call, &raw mut nanos) };
        nanos
    }

    /// Raises a programming or access error (event 25xxh, 29xxh) about `number`, as a statement would. Returns when OB
    /// 121/122 has dealt with it.
    ///
    /// # Errors
    /// [`Abort`]: the CPU goes to STOP.
    #[cold]
    pub fn raise_fault(&mut self, event: u16, number: u32) -> Result<(), Abort> {
        // SAFETY: as in `get`.
        reply(unsafe { (self.host.raise_fault)(self.call, event, number) }).map(drop)
    }

    /// Asks for STOP with a text for the diagnostic buffer; return the result at once.
    #[cold]
    pub fn stop(&mut self, text: impl Display) -> Abort {
        // SAFETY: as in `get`; the text lives through the call.
        unsafe { (self.host.stop)(self.call, Line::of(text).as_text()) };
        Abort(())
    }

    /// Writes an entry into the diagnostic buffer: a number of the plugin's own, and a text (at most 200 bytes).
    ///
    /// # Errors
    /// [`Abort`], if the CPU goes to STOP.
    pub fn diag_entry(&mut self, number: u16, text: impl Display) -> Result<(), Abort> {
        let line = Line::of(text);
        // SAFETY: as in `stop`.
        reply(unsafe { (self.host.diag_entry)(self.call, number, line.as_text()) }).map(drop)
    }

    /// Writes a line (at most 200 bytes) into the log; dropped when the log is full.
    pub fn log(&mut self, level: Level, text: impl Display) {
        let line = Line::of(text);
        // SAFETY: as in `stop`.
        unsafe { (self.host.log)(self.call, level as u8, line.as_text()) };
    }

    /// A safe point: higher priorities may run now. A block that loops calls it in every iteration.
    ///
    /// # Errors
    /// [`Abort`]: leave the loop; the CPU goes to STOP or its watchdog has fired.
    pub fn attend(&mut self) -> Result<(), Abort> {
        // SAFETY: as in `get`.
        reply(unsafe { (self.host.attend)(self.call) }).map(drop)
    }
}
