//! Modules at their logical address.

use crate::abi;

use crate::Cx;
use crate::reply::{Reply, reply};
use crate::state::Zeroable;

/// A module as the CPU sees it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ModuleInfo {
    /// Logical base address, as LADDR gives it.
    pub address: u16,
    /// Bytes of its input registers.
    pub input_bytes: u16,
    /// Bytes of its output registers.
    pub output_bytes: u16,
    /// True while its driver answers.
    pub present: bool,
    /// Counts the driver's starts: a changed number means that everything the driver held is gone.
    pub generation: u32,
}

impl<'a, M: Zeroable> Cx<'a, M> {
    /// This plugin's memory for the module at a logical address: zeroed at every start-up.
    ///
    /// # Errors
    /// [`Abort`](crate::Abort); refused with `NoModule`, or `BadArgument` when the plugin has no such memory.
    #[inline]
    pub fn module_state(&mut self, address: u32) -> Reply<&'a M> {
        const { assert!(align_of::<M>() <= 16, "the host aligns module state to 16 bytes") };
        let ((host, call), mut state) = (self.edge(), core::ptr::null_mut());
        // SAFETY: `host` and `call` belong to the running entry (Cx::new).
        let status = unsafe { (host.module_state)(call, address, &raw mut state) };
        Ok(reply(status)?.and_then(|()| {
            // SAFETY: the host gives null, or memory of `module_state_size` bytes aligned to 16, zeroed at start-up and
            // used by this plugin alone, until the entry returns. That size is `size_of::<M>()`: the export macro takes
            // it from the type that is `Block::Module` of every block. M is Zeroable, and only ever seen through shared
            // references.
            unsafe { state.cast::<M>().as_ref() }.ok_or(crate::Refused::BadArgument)
        }))
    }
}

impl<M> Cx<'_, M> {
    /// The module at a logical base address.
    ///
    /// # Errors
    /// [`Abort`](crate::Abort); refused with `NoModule`.
    #[inline]
    pub fn module_info(&mut self, address: u32) -> Reply<ModuleInfo> {
        let ((host, call), size) = (self.edge(), size_of::<abi::ModuleInfo>() as u32);
        let mut info = abi::ModuleInfo { size, ..Default::default() };
        // SAFETY: `host` and `call` belong to the running entry (Cx::new); the size is set.
        let status = unsafe { (host.module_info)(call, address, &raw mut info) };
        Ok(reply(status)?.map(|()| ModuleInfo {
            address: info.address,
            input_bytes: info.input_bytes,
            output_bytes: info.output_bytes,
            present: info.present != 0,
            generation: info.generation,
        }))
    }

    /// Reads peripheral bytes directly from the module, past the process image.
    ///
    /// # Errors
    /// [`Abort`](crate::Abort); refused with `NoModule`, and `Absent` where the station file says `absent = "fault"`.
    /// Otherwise a driver that is down reads as 0.
    #[inline]
    pub fn io_read(&mut self, address: u32, into: &mut [u8]) -> Reply<()> {
        let (host, call) = self.edge();
        // SAFETY: as in `module_info`; pointer and length are those of a slice.
        reply(unsafe { (host.io_read)(call, address, into.as_mut_ptr(), into.len() as u32) })
    }

    /// Writes peripheral bytes to the module at once and all together, and into the process image where they lie inside
    /// it.
    ///
    /// # Errors
    /// [`Abort`](crate::Abort); refused as by [`Cx::io_read`].
    #[inline]
    pub fn io_write(&mut self, address: u32, from: &[u8]) -> Reply<()> {
        let (host, call) = self.edge();
        // SAFETY: as in `io_read`.
        reply(unsafe { (host.io_write)(call, address, from.as_ptr(), from.len() as u32) })
    }

    /// Reads a record (data set) of the module; returns the number of bytes copied.
    ///
    /// # Errors
    /// [`Abort`](crate::Abort); refused with `NoModule`, `Absent`, `NoRecord`.
    pub fn record_read(&mut self, address: u32, record: u8, into: &mut [u8]) -> Reply<usize> {
        let ((host, call), mut read, len) = (self.edge(), 0, into.len());
        // SAFETY: as in `io_read`.
        let status = unsafe { (host.record_read)(call, address, record, into.as_mut_ptr(), len as u32, &raw mut read) };
        Ok(reply(status)?.map(|()| len.min(read as usize)))
    }

    /// Writes a whole record (data set) of the module.
    ///
    /// # Errors
    /// [`Abort`](crate::Abort); refused as by [`Cx::record_read`].
    pub fn record_write(&mut self, address: u32, record: u8, from: &[u8]) -> Reply<()> {
        let (host, call) = self.edge();
        // SAFETY: as in `io_read`.
        reply(unsafe { (host.record_write)(call, address, record, from.as_ptr(), from.len() as u32) })
    }

    /// Raises a diagnostic interrupt (OB 82) for the module, with up to 16 bytes of its diagnostic data.
    ///
    /// # Errors
    /// [`Abort`](crate::Abort); refused with `NoModule`, `BadArgument` beyond 16 bytes.
    pub fn diagnostic_interrupt(&mut self, address: u32, data: &[u8]) -> Reply<()> {
        let (host, call) = self.edge();
        // SAFETY: as in `io_read`.
        reply(unsafe { (host.diagnostic_interrupt)(call, address, data.as_ptr(), data.len() as u32) })
    }
}
