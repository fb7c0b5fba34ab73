//! A serial device, opened by serialport; what serialport lacks (PARMRK, transmitter empty, low latency) is set on its
//! descriptor.

use std::io;
use std::ops::RangeInclusive;
use std::os::fd::{AsFd, AsRawFd, BorrowedFd};
use std::os::unix::fs::MetadataExt as _;
use std::path::{Path, PathBuf};

use rustix::event::PollFlags;
use rustix::fs::{FlockOperation, OFlags, fcntl_getfl, fcntl_setfl, flock, major};
use rustix::termios::{ControlModes, InputModes, OptionalActions, tcgetattr, tcsetattr};
use serialport::{ClearBuffer, DataBits, FlowControl, SerialPort, TTYPort};

use super::{Link, Opened, Passage};
use crate::line::{Instant, ModemLines, PollFds};
use crate::supported_frames::{Flow, LineSettings, Parity, StopBits, Warning};
use crate::sys;

/// An open or closed serial device.
pub(crate) struct SerialLink {
    path: PathBuf,
    port: Option<Port>,
}

struct Port {
    tty: TTYPort,
    /// The UART reports when its shift register is empty.
    knows_empty: bool,
    /// The device has modem lines.
    has_modem: bool,
    /// It is the pty of another program.
    is_pty: bool,
}

impl AsFd for Port {
    fn as_fd(&self) -> BorrowedFd<'_> {
        // SAFETY: the descriptor belongs to `tty`, which lives as long as the borrow of `self` and is closed only by
        // its own drop.
        unsafe { BorrowedFd::borrow_raw(self.tty.as_raw_fd()) }
    }
}

impl SerialLink {
    pub(crate) const fn new(path: PathBuf) -> Self {
        Self { path, port: None }
    }

    fn port(&self) -> io::Result<&Port> {
        self.port.as_ref().ok_or_else(|| io::ErrorKind::NotConnected.into())
    }
}

/// Whether a device is the end of a pty that programs open, by its number: in a container it has any name.
fn is_pty(path: &Path) -> io::Result<bool> {
    const UNIX98_PTY_SLAVES: RangeInclusive<u32> = 136..=143;
    Ok(UNIX98_PTY_SLAVES.contains(&major(std::fs::metadata(path)?.rdev())))
}

impl Link for SerialLink {
    fn open(&mut self, _now: Instant, settings: &LineSettings) -> io::Result<Opened> {
        // A pty outlives the program that opened it, because its creator keeps it open, and with it the exclusive mode
        // of TIOCEXCL: after a kill nobody could open it again. A lock ends with its process.
        let is_pty = is_pty(&self.path)?;
        let tty = builder(&self.path, settings).exclusive(!is_pty).open_native()?;
        let mut port = Port { tty, knows_empty: false, has_modem: false, is_pty };
        if is_pty {
            flock(&port, FlockOperation::NonBlockingLockExclusive)?;
        }
        let flags = fcntl_getfl(&port)?;
        fcntl_setfl(&port, flags | OFlags::NONBLOCK)?;
        let warnings = configure(&mut port, settings)?;
        // Bytes from before the settings are noise or outdated.
        port.tty.clear(ClearBuffer::Input)?;
        let _ = sys::low_latency(&port);
        port.knows_empty = sys::transmitter_empty(&port).is_some();
        port.has_modem = port.tty.read_clear_to_send().is_ok();
        self.port = Some(port);
        Ok(Opened::Yes(warnings))
    }

    fn apply(&mut self, settings: &LineSettings) -> io::Result<Vec<Warning>> {
        let port = self.port.as_mut().ok_or(io::ErrorKind::NotConnected)?;
        port.tty.set_baud_rate(settings.baud)?;
        port.tty.set_data_bits(data_bits(settings))?;
        port.tty.set_parity(parity(settings))?;
        port.tty.set_stop_bits(stop_bits(settings))?;
        port.tty.set_flow_control(flow(settings))?;
        configure(port, settings)
    }

    fn close(&mut self) {
        self.port = None;
    }

    fn poll_fds<'a>(&'a self, want_write: bool, fds: &mut PollFds<'a>) {
        if let Some(port) = &self.port {
            let out = if want_write { PollFlags::OUT } else { PollFlags::empty() };
            fds.push(port.as_fd(), PollFlags::IN | out);
        }
    }

    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        Ok(rustix::io::read(self.port()?, buffer)?)
    }

    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        Ok(rustix::io::write(self.port()?, bytes)?)
    }

    fn marks_faults(&self) -> bool {
        true
    }

    fn passage(&self) -> Passage {
        if self.port.as_ref().is_some_and(|port| port.is_pty) { Passage::Program } else { Passage::Wire }
    }

    fn drained(&mut self) -> Option<bool> {
        let port = self.port.as_ref()?;
        if port.tty.bytes_to_write().ok()? > 0 {
            return Some(false);
        }
        if port.knows_empty { sys::transmitter_empty(port) } else { None }
    }

    fn take_back(&mut self) -> usize {
        let Some(port) = &self.port else { return 0 };
        let waiting = port.tty.bytes_to_write().unwrap_or(0) as usize;
        if waiting > 0 && port.tty.clear(ClearBuffer::Output).is_ok() { waiting } else { 0 }
    }

    fn modem_lines(&mut self) -> Option<ModemLines> {
        let port = self.port.as_mut().filter(|port| port.has_modem)?;
        Some(ModemLines {
            cts: port.tty.read_clear_to_send().ok()?,
            dsr: port.tty.read_data_set_ready().ok()?,
            ri: port.tty.read_ring_indicator().ok()?,
            cd: port.tty.read_carrier_detect().ok()?,
        })
    }

    fn set_modem_lines(&mut self, rts: bool, dtr: bool) {
        if let Some(port) = self.port.as_mut().filter(|port| port.has_modem) {
            // A line that vanishes here is noticed at the next read.
            let _ = port.tty.write_request_to_send(rts);
            let _ = port.tty.write_data_terminal_ready(dtr);
        }
    }
}

fn builder(path: &std::path::Path, settings: &LineSettings) -> serialport::SerialPortBuilder {
    serialport::new(path.to_string_lossy(), settings.baud)
        .data_bits(data_bits(settings))
        .parity(parity(settings))
        .stop_bits(stop_bits(settings))
        .flow_control(flow(settings))
}

/// Sets what serialport leaves out, reads everything back, and names the settings that the device did not accept.
fn configure(port: &mut Port, settings: &LineSettings) -> io::Result<Vec<Warning>> {
    let mut termios = tcgetattr(&port)?;
    termios.input_modes |= InputModes::INPCK | InputModes::PARMRK;
    termios.input_modes &= !(InputModes::IGNPAR | InputModes::IGNBRK | InputModes::BRKINT | InputModes::ISTRIP);
    tcsetattr(&port, OptionalActions::Now, &termios)?;

    let termios = tcgetattr(&port)?;
    let modes = termios.control_modes;
    let mut warnings = Vec::new();
    let mut missing = |what: &str, asked: &dyn std::fmt::Display| {
        warnings.push(Warning(format!("the line cannot do {what} {asked} ({settings} was asked for)")));
    };
    let bits = match modes & ControlModes::CSIZE {
        ControlModes::CS5 => 5,
        ControlModes::CS6 => 6,
        ControlModes::CS7 => 7,
        _ => 8,
    };
    if bits != settings.data_bits {
        missing("data bits", &settings.data_bits);
    }
    let has = match (modes.contains(ControlModes::PARENB), modes.contains(ControlModes::PARODD)) {
        (false, _) => Parity::None,
        (true, true) => Parity::Odd,
        (true, false) => Parity::Even,
    };
    if has != settings.parity {
        missing("parity", &settings.parity);
    }
    if modes.contains(ControlModes::CSTOPB) != (settings.stop_bits == StopBits::Two) {
        missing("stop bits", &settings.stop_bits);
    }
    if (termios.output_speed(), termios.input_speed()) != (settings.baud, settings.baud) {
        missing("baud rate", &format_args!("{}, it runs at {}", settings.baud, termios.output_speed()));
    }
    if !termios.input_modes.contains(InputModes::PARMRK) {
        missing("marking of faults", &"");
    }
    Ok(warnings)
}

const fn data_bits(settings: &LineSettings) -> DataBits {
    match settings.data_bits {
        5 => DataBits::Five,
        6 => DataBits::Six,
        7 => DataBits::Seven,
        _ => DataBits::Eight,
    }
}

const fn parity(settings: &LineSettings) -> serialport::Parity {
    match settings.parity {
        Parity::None => serialport::Parity::None,
        Parity::Odd => serialport::Parity::Odd,
        Parity::Even => serialport::Parity::Even,
    }
}

/// 1.5 stop bits never get here: [`LineSettings::check`] refuses them.
const fn stop_bits(settings: &LineSettings) -> serialport::StopBits {
    match settings.stop_bits {
        StopBits::One => serialport::StopBits::One,
        StopBits::OneAndHalf | StopBits::Two => serialport::StopBits::Two,
    }
}

/// The protocol handles XON and XOFF itself: a tty that stops its output at XOFF would also hold back the protocol's
/// own XON, and two partners that have stopped each other would stay silent for ever.
const fn flow(settings: &LineSettings) -> FlowControl {
    match settings.flow {
        Flow::None | Flow::XonXoff => FlowControl::None,
        Flow::Hardware => FlowControl::Hardware,
    }
}
