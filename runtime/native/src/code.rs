//! Memory that holds code: a sealed memory file, mapped readable and executable, never writable here.

use std::fs::File;
use std::io::{self, Write};
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};

use rustix::fs::{MemfdFlags, SealFlags, fcntl_add_seals, fcntl_get_seals, memfd_create};
use rustix::mm::{MapFlags, ProtFlags, mmap, munmap};

/// A memory file with these bytes, which nobody can change any more.
///
/// # Errors
/// The system has no room for it.
pub fn sealed(bytes: &[u8]) -> io::Result<OwnedFd> {
    // Without MFD_EXEC a system may refuse to execute it. Kernels before 6.3 do not know the flag.
    const EXEC: MemfdFlags = MemfdFlags::from_bits_retain(0x10);
    let flags = MemfdFlags::ALLOW_SEALING | MemfdFlags::CLOEXEC;
    let fd = memfd_create("ob1-code", flags | EXEC).or_else(|_| memfd_create("ob1-code", flags))?;
    let mut file = File::from(fd);
    file.write_all(bytes)?;
    fcntl_add_seals(&file, SealFlags::WRITE | SealFlags::GROW | SealFlags::SHRINK | SealFlags::SEAL)?;
    Ok(file.into())
}

/// A mapping of code.
#[derive(Debug)]
pub(crate) struct CodeMemory {
    address: *const u8,
    len: usize,
}

// SAFETY: the mapping is read and executed only, by whoever holds it.
unsafe impl Send for CodeMemory {}
// SAFETY: as above.
unsafe impl Sync for CodeMemory {}

impl CodeMemory {
    /// Maps a memory file of [`sealed`].
    pub(crate) fn map(fd: BorrowedFd<'_>) -> io::Result<Self> {
        let seals = fcntl_get_seals(fd)?;
        if !seals.contains(SealFlags::WRITE | SealFlags::SHRINK) {
            return Err(io::Error::other("a memory file that is not sealed"));
        }
        let len = rustix::fs::fstat(fd)?.st_size as usize;
        // SAFETY: a new mapping at an address that the system chooses. The file can neither shrink nor change.
        let address = unsafe {
            mmap(std::ptr::null_mut(), len.max(1), ProtFlags::READ | ProtFlags::EXEC, MapFlags::PRIVATE, fd, 0)?
        };
        Ok(Self { address: address.cast_const().cast(), len: len.max(1) })
    }

    /// Maps these bytes.
    pub(crate) fn of(bytes: &[u8]) -> io::Result<Self> {
        Self::map(sealed(bytes)?.as_fd())
    }

    /// The address of a byte.
    pub(crate) fn at(&self, offset: u32) -> Option<*const u8> {
        // SAFETY: inside the mapping.
        ((offset as usize) < self.len).then(|| unsafe { self.address.add(offset as usize) })
    }
}

impl Drop for CodeMemory {
    fn drop(&mut self) {
        // SAFETY: the mapping of `map`, which nobody else unmaps.
        let _ = unsafe { munmap(self.address.cast_mut().cast(), self.len) };
    }
}
