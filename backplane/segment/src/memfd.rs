//! Shared memory as a sealed memfd: no process that has it can shrink it, so none can kill this process with SIGBUS.

use core::ffi::CStr;
use core::ptr::NonNull;
use std::io;
use std::os::fd::{AsFd, AsRawFd, BorrowedFd, OwnedFd};
use std::path::{Path, PathBuf};

use memmap2::{MmapOptions, MmapRaw};
use rustix::fs::{self, FallocateFlags, FlockOperation, MemfdFlags, Mode, OFlags, SealFlags};
use rustix::io::Errno;

use crate::fault::SegmentError;

/// Seals a file must carry before we map it: its size can never change.
const NEEDED_SEALS: SealFlags = SealFlags::SHRINK.union(SealFlags::GROW);

/// Those of a window: its receiver can neither shrink it nor write into it.
const WINDOW_SEALS: SealFlags = NEEDED_SEALS.union(SealFlags::FUTURE_WRITE);

/// A mapped file of fixed size, and its descriptor.
pub(crate) struct SharedMemory {
    map: MmapRaw,
    file: OwnedFd,
}

impl SharedMemory {
    /// A new anonymous file of `len` bytes, all allocated and zero, sealed and mapped.
    pub(crate) fn create(name: &CStr, len: usize) -> Result<Self, SegmentError> {
        let flags = MemfdFlags::CLOEXEC | MemfdFlags::ALLOW_SEALING;
        let file = fs::memfd_create(name, flags).map_err(|source| failed("making the segment", source))?;
        // fallocate also sets the size; without allocated pages the first write would raise SIGBUS when memory is full.
        fs::fallocate(&file, FallocateFlags::empty(), 0, len as u64)
            .map_err(|source| failed("allocating the segment", source))?;
        fs::fcntl_add_seals(&file, NEEDED_SEALS | SealFlags::SEAL)
            .map_err(|source| failed("sealing the segment", source))?;
        Self::map(file, len)
    }

    /// The same for memory that others may only read: this mapping is writable, and no other writable one can ever be
    /// made.
    pub(crate) fn create_window(name: &CStr, len: usize) -> Result<Self, SegmentError> {
        let flags = MemfdFlags::CLOEXEC | MemfdFlags::ALLOW_SEALING;
        let file = fs::memfd_create(name, flags).map_err(|source| failed("making the window", source))?;
        fs::fallocate(&file, FallocateFlags::empty(), 0, len as u64)
            .map_err(|source| failed("allocating the window", source))?;
        let memory = Self::map(file, len)?;
        fs::fcntl_add_seals(&memory.file, WINDOW_SEALS | SealFlags::SEAL)
            .map_err(|source| failed("sealing the window", source))?;
        Ok(memory)
    }

    /// Maps, only for reading, a window created by another process.
    pub(crate) fn look_through(file: OwnedFd, len: usize) -> Result<Self, SegmentError> {
        let (file, len) = Self::checked(file, &[len], WINDOW_SEALS)?;
        let map = MmapOptions::new().len(len).map_raw_read_only(&file);
        let map = map.map_err(|source| SegmentError::Io { action: "mapping the window", source })?;
        Ok(Self { map, file })
    }

    /// Opens and maps a file of exactly one of these sizes.
    pub(crate) fn open(path: &Path, sizes: &[usize]) -> Result<Self, SegmentError> {
        let flags = OFlags::RDWR | OFlags::CLOEXEC | OFlags::NONBLOCK;
        let file = fs::open(path, flags, Mode::empty()).map_err(|source| failed("opening the segment", source))?;
        Self::of(file, sizes)
    }

    /// Maps an open file of exactly one of these sizes, created by another process.
    pub(crate) fn of(file: OwnedFd, sizes: &[usize]) -> Result<Self, SegmentError> {
        let (file, len) = Self::checked(file, sizes, NEEDED_SEALS)?;
        Self::map(file, len)
    }

    /// The file and its size, when it has these seals and one of these sizes.
    fn checked(file: OwnedFd, sizes: &[usize], needed: SealFlags) -> Result<(OwnedFd, usize), SegmentError> {
        // Seals first, then the size: in the other order the file could still be shrunk in between. Files without seals
        // (on a disk, a device) answer EINVAL: they are not sealed.
        let seals = fs::fcntl_get_seals(&file).map_err(|_| SegmentError::NotSealed)?;
        if !seals.contains(needed) {
            return Err(SegmentError::NotSealed);
        }
        let found = fs::fstat(&file).map_err(|source| failed("looking at the segment", source))?.st_size;
        match sizes.iter().find(|size| usize::try_from(found).as_ref() == Ok(size)) {
            Some(size) => Ok((file, *size)),
            None => {
                let expected = sizes.first().map_or(0, |size| *size as u64);
                Err(SegmentError::Size { found: u64::try_from(found).unwrap_or(0), expected })
            }
        }
    }

    fn map(file: OwnedFd, len: usize) -> Result<Self, SegmentError> {
        let map = MmapOptions::new().len(len).map_raw(&file);
        let map = map.map_err(|source| SegmentError::Io { action: "mapping the segment", source })?;
        Ok(Self { map, file })
    }

    /// Start of the mapping: page-aligned.
    pub(crate) fn start(&self) -> Result<NonNull<u8>, SegmentError> {
        NonNull::new(self.map.as_mut_ptr()).ok_or_else(|| failed("mapping the segment", Errno::FAULT))
    }

    /// Its length in bytes.
    pub(crate) fn len(&self) -> usize {
        self.map.len()
    }

    pub(crate) fn path(&self) -> PathBuf {
        PathBuf::from(format!("/proc/{}/fd/{}", std::process::id(), self.file.as_raw_fd()))
    }

    /// Locks the file for this process (`F_SETLK`, the whole file).
    pub(crate) fn lock(&self) -> Result<(), SegmentError> {
        match fs::fcntl_lock(&self.file, FlockOperation::NonBlockingLockExclusive) {
            Ok(()) => Ok(()),
            Err(Errno::AGAIN | Errno::ACCESS) => Err(SegmentError::InUse),
            Err(source) => Err(failed("locking the segment", source)),
        }
    }

    pub(crate) fn descriptor(&self) -> BorrowedFd<'_> {
        self.file.as_fd()
    }
}

fn failed(action: &'static str, source: Errno) -> SegmentError {
    SegmentError::Io { action, source: io::Error::from(source) }
}
