//! Memory that holds code: a sealed memory file, mapped readable and executable, never writable here.

use std::fs::File;
use std::io::{self, Write};
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};

use rustix::fs::{MemfdFlags, SealFlags, fcntl_add_seals, fcntl_get_seals, memfd_create};
use rustix::mm::{MapFlags, ProtFlags, mmap, munmap};

/// An empty memory file for code. It can be filled and sealed later, when the process may no longer make one.
///
/// # Errors
/// The system has no descriptor or no memory left.
pub fn memory_file() -> io::Result<File> {
    // Without MFD_EXEC a system may refuse to execute it. Kernels before 6.3 do not know the flag.
    const EXEC: MemfdFlags = MemfdFlags::from_bits_retain(0x10);
    let flags = MemfdFlags::ALLOW_SEALING | MemfdFlags::CLOEXEC;
    let fd = memfd_create("ob1-code", flags | EXEC).or_else(|_| memfd_create("ob1-code", flags))?;
    Ok(File::from(fd))
}

/// A memory file with these bytes, which nobody can change any more.
///
/// # Errors
/// The system has no room for it.
pub fn seal(mut file: File, bytes: &[u8]) -> io::Result<OwnedFd> {
    file.write_all(bytes)?;
    fcntl_add_seals(&file, SEALS)?;
    Ok(file.into())
}

/// Nobody can write it, and it keeps its length.
const SEALS: SealFlags = SealFlags::WRITE.union(SealFlags::GROW).union(SealFlags::SHRINK).union(SealFlags::SEAL);

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
    /// Maps a memory file of [`seal`].
    pub(crate) fn map(fd: BorrowedFd<'_>) -> io::Result<Self> {
        let seals = fcntl_get_seals(fd)?;
        if !seals.contains(SEALS) {
            return Err(io::Error::other("a memory file that is not sealed"));
        }
        let len = rustix::fs::fstat(fd)?.st_size as usize;
        // SAFETY: a new mapping at an address that the system chooses. The file can neither shrink nor change.
        let address = unsafe {
            mmap(std::ptr::null_mut(), len.max(1), ProtFlags::READ | ProtFlags::EXEC, MapFlags::PRIVATE, fd, 0)?
        };
        Ok(Self { address: address.cast_const().cast(), len: len.max(1) })
    }

    /// Maps these bytes through a memory file of their own.
    pub(crate) fn of(bytes: &[u8]) -> io::Result<Self> {
        Self::map(seal(memory_file()?, bytes)?.as_fd())
    }

    /// All bytes of the mapping.
    pub(crate) fn bytes(&self) -> &[u8] {
        // SAFETY: mapped readable, as long as `self`; sealed, so that nobody can change them.
        unsafe { std::slice::from_raw_parts(self.address, self.len) }
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
