//! Memory of a CPU at the beginning of a reservation: whatever 32-bit offset wrong code may form, it reaches the arena
//! or traps, and never other memory of the process.

use std::ptr::NonNull;

use ob1_arena::Arena;
use rustix::io::Errno;
use rustix::mm::{Advice, MapFlags, MprotectFlags, ProtFlags, madvise, mmap_anonymous, mprotect, munmap};

/// Bytes reserved: every 32-bit offset, and after the last of them a double word and more.
pub const RESERVED_BYTES: u64 = (1 << 32) + GUARD;
/// Bytes after the last offset.
const GUARD: u64 = 64 * 1024;
/// A page of any machine we run on divides it.
const PAGE: usize = 64 * 1024;

/// The address space, which is released when it is dropped.
struct Reservation {
    at: NonNull<core::ffi::c_void>,
    len: usize,
}

// SAFETY: it is an address range without content of its own, which any thread may give back.
unsafe impl Send for Reservation {}
// SAFETY: nothing can be done with a shared one.
unsafe impl Sync for Reservation {}

impl Drop for Reservation {
    fn drop(&mut self) {
        // SAFETY: exactly what was mapped; its bytes are used no more, because the arena that had them drops this.
        let _ = unsafe { munmap(self.at.as_ptr(), self.len) };
    }
}

/// `len` bytes of 0, up to 4 GiB, at the beginning of [`RESERVED_BYTES`] without access rights. It costs address space,
/// no memory; core dumps leave the rest out.
///
/// # Errors
/// The system has no such address space: a limit on it (`ulimit -v`), or on locked memory when later mappings are
/// locked.
pub fn reserve(len: usize) -> Result<Arena, Errno> {
    let reserved = usize::try_from(RESERVED_BYTES).map_err(|_| Errno::NOMEM)?;
    let accessible = len.checked_next_multiple_of(PAGE).filter(|len| *len as u64 <= 1 << 32).ok_or(Errno::NOMEM)?;
    let flags = MapFlags::PRIVATE | MapFlags::NORESERVE;
    // SAFETY: a new mapping at a place of the kernel's choice touches nothing that is there.
    let at = unsafe { mmap_anonymous(std::ptr::null_mut(), reserved, ProtFlags::empty(), flags)? };
    let at = NonNull::new(at).ok_or(Errno::NOMEM)?;
    let reservation = Reservation { at, len: reserved };
    // SAFETY: the pages lie in the mapping just made.
    unsafe { mprotect(at.as_ptr(), accessible, MprotectFlags::READ | MprotectFlags::WRITE)? };
    // SAFETY: as above; the advice changes no content.
    let _ = unsafe { madvise(at.as_ptr().byte_add(accessible), reserved - accessible, Advice::LinuxDontDump) };
    let bytes = NonNull::slice_from_raw_parts(at.cast::<u8>(), len);
    // SAFETY: the bytes are mapped, zeroed and ours until the reservation is dropped. Of its other bytes those up to
    // the end of the page are zeros that nobody uses, and the rest has no access rights.
    Ok(unsafe { Arena::from_parts(bytes, RESERVED_BYTES, Box::new(reservation)) })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_arena_can_be_used_and_comes_in_any_number() {
        // More at once than one might have room for if they took memory.
        let mut arenas: Vec<Arena> = (0..64).map(|_| reserve(100_000).expect("address space")).collect();
        for (n, arena) in (0u8..).zip(&mut arenas) {
            assert_eq!((arena.len(), arena.reserved()), (100_000, RESERVED_BYTES));
            assert!(arena.iter().all(|byte| *byte == 0));
            arena.fill(n);
        }
        assert!((0u8..).zip(&arenas).all(|(n, arena)| arena.iter().all(|byte| *byte == n)));
    }

    #[test]
    fn more_than_offsets_reach_is_refused() {
        assert_eq!(reserve((1 << 32) + 1).map(|arena| arena.len()), Err(Errno::NOMEM));
        assert_eq!(reserve(usize::MAX).map(|arena| arena.len()), Err(Errno::NOMEM));
    }

    #[test]
    fn behind_the_arena_nothing_has_access_rights() {
        let arena = reserve(1).expect("address space");
        let first = arena.as_ptr() as usize;
        let maps = std::fs::read_to_string("/proc/self/maps").expect("the system tells its mappings");
        let rights = |address: usize| {
            let line = maps.lines().find(|line| {
                let (from, to) = line.split(' ').next().and_then(|range| range.split_once('-')).expect("a range");
                let number = |hex| usize::from_str_radix(hex, 16).expect("hexadecimal");
                (number(from)..number(to)).contains(&address)
            });
            line.expect("it is mapped").split(' ').nth(1).expect("rights").to_owned()
        };
        assert_eq!(rights(first), "rw-p");
        let last = first + u32::MAX as usize + 8;
        for address in [first + PAGE, first + (1 << 31), first + u32::MAX as usize, last] {
            assert_eq!(rights(address), "---p", "{address:x}");
        }
    }
}
