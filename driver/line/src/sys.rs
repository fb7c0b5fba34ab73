//! The ioctls of a serial port that neither serialport nor rustix wraps.

use std::io;
use std::os::fd::AsFd;

use rustix::io::Errno;
use rustix::ioctl::{Getter, Opcode, Setter, ioctl};

// Values of the generic ABI (x86, ARM, RISC-V). The others (MIPS, PowerPC, SPARC) number them differently: there the
// line runs without "transmitter empty" and without the low-latency flag.
const TIOCSERGETLSR: Opcode = 0x5459;
const TIOCGSERIAL: Opcode = 0x541E;
const TIOCSSERIAL: Opcode = 0x541F;
const GENERIC: bool = cfg!(any(
    target_arch = "x86",
    target_arch = "x86_64",
    target_arch = "arm",
    target_arch = "aarch64",
    target_arch = "riscv64",
    target_arch = "loongarch64"
));

/// Transmitter physically empty (`TIOCSER_TEMT`).
const TEMT: u32 = 0x01;
/// `ASYNC_LOW_LATENCY` in `serial_struct.flags`: characters are handed over at once.
const LOW_LATENCY: i32 = 1 << 13;

/// The kernel's `struct serial_struct` up to `flags`, and more room than the rest of it takes on any architecture.
#[repr(C)]
#[derive(Clone, Copy)]
struct SerialStruct {
    kind: i32,
    line: i32,
    port: u32,
    irq: i32,
    flags: i32,
    rest: [u64; 16],
}

/// Whether the shift register of the UART is empty; `None` if the driver cannot tell.
pub(crate) fn transmitter_empty(fd: impl AsFd) -> Option<bool> {
    if !GENERIC {
        return None;
    }
    // SAFETY: TIOCSERGETLSR writes one unsigned int, and nothing else, through the pointer.
    let lsr: u32 = unsafe { ioctl(fd, Getter::<TIOCSERGETLSR, u32>::new()) }.ok()?;
    Some(lsr & TEMT != 0)
}

/// Asks the driver to pass on bytes at once. Best effort: a port without it works, only with more delay.
pub(crate) fn low_latency(fd: impl AsFd) -> Result<(), Errno> {
    if !GENERIC {
        return Err(Errno::NOTTY);
    }
    let fd = fd.as_fd();
    // SAFETY: TIOCGSERIAL writes one `struct serial_struct`; `SerialStruct` begins like it and is larger.
    let mut serial: SerialStruct = unsafe { ioctl(fd, Getter::<TIOCGSERIAL, SerialStruct>::new()) }?;
    serial.flags |= LOW_LATENCY;
    // SAFETY: TIOCSSERIAL reads one `struct serial_struct`, here the one just filled in by the kernel.
    unsafe { ioctl(fd, Setter::<TIOCSSERIAL, SerialStruct>::new(serial)) }
}

/// The error number, even if a library has kept only its kind.
pub(crate) fn errno_of(error: &io::Error) -> Option<u32> {
    let number = error.raw_os_error().or(match error.kind() {
        io::ErrorKind::NotFound => Some(Errno::NOENT.raw_os_error()),
        io::ErrorKind::PermissionDenied => Some(Errno::ACCESS.raw_os_error()),
        io::ErrorKind::AlreadyExists => Some(Errno::EXIST.raw_os_error()),
        io::ErrorKind::ConnectionRefused => Some(Errno::CONNREFUSED.raw_os_error()),
        io::ErrorKind::TimedOut => Some(Errno::TIMEDOUT.raw_os_error()),
        io::ErrorKind::AddrInUse => Some(Errno::ADDRINUSE.raw_os_error()),
        _ => None,
    })?;
    u32::try_from(number).ok()
}
