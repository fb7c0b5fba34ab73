//! Memory areas, data blocks and the instance.

use crate::abi;

use crate::Cx;
use crate::formal::Static;
use crate::reply::{Abort, Refused, Reply, reply};
use crate::types::{Bool, Elementary, S7Type};

/// Memory a block may name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Area {
    /// Process image of the inputs.
    Input,
    /// Process image of the outputs.
    Output,
    /// Bit memory, from M 0.0 on.
    Memory,
    /// The data block of this number.
    Db(u16),
    /// The instance of the running FB, from its first byte; multi-instances included.
    Instance,
    /// Local data of the calling block, for pointers with area code 87h.
    CallerLocal,
}

impl Area {
    /// Area code and data block number.
    #[inline]
    pub(crate) const fn code(self) -> (u8, u16) {
        match self {
            Area::Input => (abi::AREA_E, 0),
            Area::Output => (abi::AREA_A, 0),
            Area::Memory => (abi::AREA_M, 0),
            Area::Db(number) => (abi::AREA_DB, number),
            Area::Instance => (abi::AREA_INSTANCE, 0),
            Area::CallerLocal => (abi::AREA_L, 0),
        }
    }
}

/// The location of the instance of the running FB.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Instance {
    /// The instance data block's number.
    pub db: u16,
    /// First byte of this instance in the data block; 0 except for multi-instances.
    pub offset: u32,
    /// Length of the instance in bytes.
    pub len: u32,
}

impl Instance {
    /// Data block and first byte as one number, never 0: for a block that stores which instance uses something.
    #[must_use]
    pub const fn key(self) -> u64 {
        1 << 48 | (self.db as u64) << 32 | self.offset as u64
    }
}

impl<M> Cx<'_, M> {
    /// Copies bytes out of an area, all or none.
    ///
    /// # Errors
    /// [`Abort`]; refused with `Outside`, `NoDb`, `DbNumber`, and `NoParam` for the instance of an FC.
    #[inline]
    pub fn read(&mut self, area: Area, at: u32, into: &mut [u8]) -> Reply<()> {
        let ((host, call), (code, db)) = (self.edge(), area.code());
        // SAFETY: `host` and `call` belong to the running entry (Cx::new); pointer and length are those of a slice.
        reply(unsafe { (host.area_read)(call, code, db, at, into.as_mut_ptr(), into.len() as u32) })
    }

    /// Copies bytes into an area, all or none.
    ///
    /// # Errors
    /// As [`Cx::read`], and `ReadOnly`.
    #[inline]
    pub fn write(&mut self, area: Area, at: u32, from: &[u8]) -> Reply<()> {
        let ((host, call), (code, db)) = (self.edge(), area.code());
        // SAFETY: as in `read`.
        reply(unsafe { (host.area_write)(call, code, db, at, from.as_ptr(), from.len() as u32) })
    }

    /// Reads the bit `byte.bit`.
    ///
    /// # Errors
    /// [`Abort`]; refused with `Outside`, `NoDb`, `DbNumber`, `NoParam` (see [`Cx::read`]).
    #[inline]
    pub fn bit(&mut self, area: Area, byte: u32, bit: u8) -> Reply<bool> {
        self.bit_at(area, byte.saturating_mul(8).saturating_add(u32::from(bit & 7)))
    }

    /// Writes the bit `byte.bit`.
    ///
    /// # Errors
    /// [`Abort`]; refused as by [`Cx::read`], and with `ReadOnly`.
    #[inline]
    pub fn set_bit(&mut self, area: Area, byte: u32, bit: u8, value: bool) -> Reply<()> {
        self.set_bit_at(area, byte.saturating_mul(8).saturating_add(u32::from(bit & 7)), value)
    }

    fn bit_at(&mut self, area: Area, bit: u32) -> Reply<bool> {
        let ((host, call), (code, db), mut value) = (self.edge(), area.code(), 0);
        // SAFETY: as in `read`.
        let status = unsafe { (host.bit_get)(call, code, db, bit, &raw mut value) };
        Ok(reply(status)?.map(|()| value != 0))
    }

    fn set_bit_at(&mut self, area: Area, bit: u32, value: bool) -> Reply<()> {
        let ((host, call), (code, db)) = (self.edge(), area.code());
        // SAFETY: as in `read`.
        reply(unsafe { (host.bit_set)(call, code, db, bit, u8::from(value)) })
    }

    /// Reads a word, high byte first.
    ///
    /// # Errors
    /// [`Abort`]; refused with `Outside`, `NoDb`, `DbNumber`, `NoParam` (see [`Cx::read`]).
    #[inline]
    pub fn word(&mut self, area: Area, at: u32) -> Reply<u16> {
        let mut bytes = [0; 2];
        Ok(self.read(area, at, &mut bytes)?.map(|()| u16::from_be_bytes(bytes)))
    }

    /// Writes a word, high byte first.
    ///
    /// # Errors
    /// [`Abort`]; refused as by [`Cx::read`], and with `ReadOnly`.
    #[inline]
    pub fn set_word(&mut self, area: Area, at: u32, value: u16) -> Reply<()> {
        self.write(area, at, &value.to_be_bytes())
    }

    /// Length of an area in bytes. Also tells whether a data block exists.
    ///
    /// # Errors
    /// [`Abort`]; refused with `NoDb`, `DbNumber`, and `NoParam` for the instance of an FC.
    #[inline]
    pub fn len(&mut self, area: Area) -> Reply<u32> {
        let ((host, call), (code, db), mut len) = (self.edge(), area.code(), 0);
        // SAFETY: as in `read`.
        let status = unsafe { (host.area_len)(call, code, db, &raw mut len) };
        Ok(reply(status)?.map(|()| len))
    }

    /// The location of the instance of the running FB.
    ///
    /// # Errors
    /// [`Abort`]; refused with `NoParam` in an FC.
    pub fn instance(&mut self) -> Reply<Instance> {
        let ((host, call), size) = (self.edge(), size_of::<abi::InstanceInfo>() as u32);
        let mut info = abi::InstanceInfo { size, ..Default::default() };
        // SAFETY: as in `read`; the size is set.
        let status = unsafe { (host.instance)(call, &raw mut info) };
        Ok(reply(status)?.map(|()| Instance { db: info.db, offset: info.offset, len: info.len }))
    }

    /// Reads a variable of the instance.
    ///
    /// # Errors
    /// [`Abort`] when a data block that is too short has taken the CPU to STOP; with OB 121 loaded the value is 0 then.
    #[inline]
    pub fn load<T: Elementary>(&mut self, variable: Static<T>) -> Result<T::Value, Abort> {
        let (bit, width) = (variable.bit_address(), width::<T>());
        let found = if width == 0 {
            self.bit_at(Area::Instance, bit)?.map(u32::from)
        } else {
            let mut bytes = [0; 4];
            let from = bytes.len() - width;
            self.read(Area::Instance, bit / 8, &mut bytes[from..])?.map(|()| u32::from_be_bytes(bytes))
        };
        if found.is_err() {
            self.raise_fault(0x2522, bit / 8)?;
        }
        Ok(T::from_raw(found.unwrap_or(0)))
    }

    /// Writes a variable of the instance.
    ///
    /// # Errors
    /// [`Abort`] when a data block that is too short has taken the CPU to STOP.
    #[inline]
    pub fn store<T: Elementary>(&mut self, variable: Static<T>, value: T::Value) -> Result<(), Abort> {
        let (bit, width, raw) = (variable.bit_address(), width::<T>(), T::to_raw(value));
        let done = if width == 0 {
            self.set_bit_at(Area::Instance, bit, raw != 0)?
        } else {
            let bytes = raw.to_be_bytes();
            self.write(Area::Instance, bit / 8, &bytes[bytes.len() - width..])?
        };
        match done {
            Ok(()) => Ok(()),
            Err(Refused::ReadOnly) => self.raise_fault(0x2531, bit / 8),
            Err(_) => self.raise_fault(0x2523, bit / 8),
        }
    }

    /// Reads bytes of an opaque instance variable, from its byte `at`.
    ///
    /// # Errors
    /// [`Abort`]; refused with `Outside` beyond the instance, `NoParam` in an FC.
    pub fn load_bytes<T: S7Type>(&mut self, variable: Static<T>, at: u32, into: &mut [u8]) -> Reply<()> {
        self.read(Area::Instance, (variable.bit_address() / 8).saturating_add(at), into)
    }

    /// Writes bytes of an opaque instance variable.
    ///
    /// # Errors
    /// [`Abort`]; refused with `Outside` beyond the instance, `NoParam` in an FC, `ReadOnly`.
    pub fn store_bytes<T: S7Type>(&mut self, variable: Static<T>, at: u32, from: &[u8]) -> Reply<()> {
        self.write(Area::Instance, (variable.bit_address() / 8).saturating_add(at), from)
    }
}

/// Bytes of an elementary type, 0 for a bit.
const fn width<T: Elementary>() -> usize {
    use crate::abi::ty;
    if T::TY == Bool::TY {
        return 0;
    }
    match T::TY {
        ty::BYTE | ty::CHAR => 1,
        ty::DWORD | ty::DINT | ty::REAL | ty::TIME | ty::TIME_OF_DAY => 4,
        _ => 2,
    }
}
