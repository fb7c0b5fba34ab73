//! The 16 parameter bytes of a CP 240, typed.

use crate::error::ParamError;
use ob1_serial::{Flow, LineSettings, Parity, Span, StopBits};

/// The interface of a CP 240, which its order number says and no parameter byte. [S0 L1351 ff.]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Interface {
    /// 240-1BA20: full duplex, with all modem lines. [S0 L1466 ff.]
    #[default]
    Rs232,
    /// 240-1CA21 on four wires: full duplex. [S0 L1511 ff.]
    Rs422,
    /// 240-1CA20, and 240-1CA21 on two wires: half duplex. [S0 L1492]
    Rs485,
}

impl Interface {
    /// Their names in the station file.
    pub const NAMES: [(&str, Self); 3] = [("rs232", Self::Rs232), ("rs422", Self::Rs422), ("rs485", Self::Rs485)];

    /// Its name in the station file.
    pub fn name(self) -> &'static str {
        Self::NAMES.iter().find(|(_, interface)| *interface == self).map_or("", |(name, _)| name)
    }

    /// Whether it has DTR, CTS, DSR, RI and CD; RTS is on every plug. [S0 L1466 ff.], [S0 L1504], [S0 L1526]
    pub const fn has_modem_lines(self) -> bool {
        matches!(self, Self::Rs232)
    }

    /// Two wires: "Serial bus connection in two-wire technology using half duplex mode" [S0 L1492]
    pub const fn is_half_duplex(self) -> bool {
        matches!(self, Self::Rs485)
    }
}

/// The parameters of a CP 240. Only [`Cp240::decode`] and [`Cp240::from_keys`] check the ranges given at the fields;
/// [`Cp240::encode`] writes the default in the place of a value that its field does not accept.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Cp240 {
    /// Baud rate, one of the table's.
    pub baud: u32,
    /// Data bits of a character, 5 to 8.
    pub data_bits: u8,
    /// Parity bit of a character.
    pub parity: Parity,
    /// Stop bits of a character.
    pub stop_bits: StopBits,
    /// The protocol and its parameters.
    pub protocol: Protocol,
    /// The interface. It is not in the bytes: what reads them assumes RS 232.
    pub interface: Interface,
}

/// Protocol and its own parameters.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Protocol {
    /// 01h ASCII, 11h ASCII-fragmented.
    Ascii(Ascii),
    /// 02h STX/ETX: telegrams between start and end characters.
    StxEtx(StxEtx),
    /// 03h 3964, 04h 3964R, 05h and 06h the same with RK 512.
    S3964(S3964),
    /// Codes 0Ah to 0Dh, 1Ch and 1Dh: see [`ModbusKind`].
    Modbus(Modbus),
    /// F0h M-Bus. It has no parameters: each telegram names its baud rate.
    MBus,
    /// E0h EnOcean. It has no parameters: the line goes to the module inside the CP.
    EnOcean,
}

impl Protocol {
    /// Whether a CP with it raises diagnostic interrupts: "Diagnosis data -" of the M-Bus module [S0 L4717],
    /// "Diagnosealarm nein" of the EnOcean module [S1 L781].
    pub const fn has_diagnostics(&self) -> bool {
        !matches!(self, Self::MBus | Self::EnOcean)
    }

    /// Whether the CP shows a start-up identifier and waits for FC 9: in the Modbus modes it "is ready for
    /// communication" with valid parameters [S0 "Commissioning"].
    pub const fn has_identifier(&self) -> bool {
        !matches!(self, Self::Modbus(_))
    }
}

/// Parameters of ASCII. Times in milliseconds, multiples of 20.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Ascii {
    /// Telegrams go to the CPU in blocks of 12 bytes as they come in.
    pub fragmented: bool,
    /// Who may stop the sender, and how.
    pub flow: Flow,
    /// ZNA, 0..5100: pause after the last bit before the order is done.
    pub zna_ms: u16,
    /// ZVZ, 0..5100: pause that ends a telegram; 0: about two character times.
    pub zvz_ms: u16,
    /// Number of receive buffers, 1..250.
    pub receive_buffers: u8,
}

/// Parameters of STX/ETX. Times in milliseconds, multiples of 20.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct StxEtx {
    /// Who may stop the sender, and how.
    pub flow: Flow,
    /// ZNA, 0..5100: pause after the last bit before the order is done.
    pub zna_ms: u16,
    /// TMO, 20..5100: longest pause between two characters of a telegram.
    pub tmo_ms: u16,
    /// Number of start characters in use, 0..2.
    pub start_flags: u8,
    /// The start characters; only the first `start_flags` count.
    pub start: [u8; 2],
    /// Number of end characters in use, 0..2.
    pub end_flags: u8,
    /// The end characters; only the first `end_flags` count.
    pub end: [u8; 2],
}

/// Parameters of 3964(R), with and without RK 512. Times in milliseconds, multiples of 20.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct S3964 {
    /// 3964R: with block check character.
    pub bcc: bool,
    /// With RK 512 on top.
    pub rk512: bool,
    /// ZNA, 0..5100: pause after the last bit before the order is done.
    pub zna_ms: u16,
    /// ZVZ, 0..5100; 0: about two character times.
    pub zvz_ms: u16,
    /// QVZ, 0..5100; 0: about two character times.
    pub qvz_ms: u16,
    /// BWZ, 0..5100: from the acknowledgement of a request telegram to STX of the answer telegram; 0: not watched.
    pub bwz_ms: u16,
    /// Repetitions of STX after the first attempt.
    pub stx_repetitions: u8,
    /// DBL: attempts to send a block, the first included.
    pub dbl: u8,
    /// Which side gives way when both want to send.
    pub priority: Priority,
}

/// Priority of 3964(R): who gives way when both begin at the same time.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Priority {
    /// Gives way to the partner.
    Low,
    /// Goes first; the partner must have the other priority.
    High,
}

/// Parameters of the Modbus modes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Modbus {
    /// Master or slave, ASCII or RTU, short or long.
    pub kind: ModbusKind,
    /// Slave address, 1..255; that of a master, which does not count, also 0.
    pub address: u8,
    /// For the maker's internal tests; without effect here.
    pub debug: bool,
    /// Wait of the master in milliseconds, 1..60000; 0: by the baud rate. A slave ignores it.
    pub wait_ms: u16,
}

/// The Modbus modes, one for each protocol code.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum ModbusKind {
    /// 0Ah: a master with telegrams in ASCII.
    MasterAscii,
    /// 0Bh: a master with telegrams in RTU.
    MasterRtu,
    /// 0Ch: slave, ASCII, short areas.
    SlaveAsciiShort,
    /// 0Dh: slave, RTU, short areas.
    SlaveRtuShort,
    /// 1Ch: slave, ASCII, long areas.
    SlaveAsciiLong,
    /// 1Dh: slave, RTU, long areas.
    SlaveRtuLong,
}

impl ModbusKind {
    pub(crate) const NAMES: [(Self, &'static str); 6] = [
        (Self::MasterAscii, "modbus-master-ascii"),
        (Self::MasterRtu, "modbus-master-rtu"),
        (Self::SlaveAsciiShort, "modbus-slave-ascii-short"),
        (Self::SlaveRtuShort, "modbus-slave-rtu-short"),
        (Self::SlaveAsciiLong, "modbus-slave-ascii-long"),
        (Self::SlaveRtuLong, "modbus-slave-rtu-long"),
    ];

    /// Whether the CP is a master: it sends requests, and needs no address.
    pub const fn is_master(self) -> bool {
        matches!(self, Self::MasterAscii | Self::MasterRtu)
    }
}

impl Cp240 {
    /// The parameters of a CP that has received none: 9600 baud, ASCII, 8 data bits, even parity, 1 stop bit, no flow
    /// control, ZNA 0, ZVZ 200 ms, 1 receive buffer. [S0 "Note to default parameter!"]
    ///
    /// Not the default of the ASCII table, which has no parity.
    pub fn unconfigured() -> Self {
        Self {
            baud: 9600,
            data_bits: 8,
            parity: Parity::Even,
            stop_bits: StopBits::One,
            protocol: Protocol::Ascii(Ascii {
                fragmented: false,
                flow: Flow::None,
                zna_ms: 0,
                zvz_ms: 200,
                receive_buffers: 1,
            }),
            interface: Interface::Rs232,
        }
    }

    /// Parameters from the bytes of a module: sixteen zeros stand for "none".
    ///
    /// # Errors
    /// A code that the table does not have, as [`Cp240::decode`] names it.
    pub fn of_bytes(bytes: &[u8; 16]) -> Result<Self, ParamError> {
        if *bytes == [0; 16] { Ok(Self::unconfigured()) } else { Self::decode(bytes) }
    }

    /// M-Bus: 2400 baud until a telegram names another rate [S0 L4298], 8 data bits, even parity, 1 stop bit as in EN
    /// 1434-3.
    pub const fn mbus() -> Self {
        Self {
            baud: 2400,
            data_bits: 8,
            parity: Parity::Even,
            stop_bits: StopBits::One,
            protocol: Protocol::MBus,
            interface: Interface::Rs232,
        }
    }

    /// EnOcean: 9600 baud [S1 L1919], 8 data bits, no parity, 1 stop bit, as for the TCM 120.
    pub const fn enocean() -> Self {
        Self {
            baud: 9600,
            data_bits: 8,
            parity: Parity::None,
            stop_bits: StopBits::One,
            protocol: Protocol::EnOcean,
            interface: Interface::Rs232,
        }
    }

    /// Name of the protocol, as in `protocol = `.
    pub fn protocol_name(&self) -> &'static str {
        match &self.protocol {
            Protocol::Ascii(p) if p.fragmented => "ascii-fragmented",
            Protocol::Ascii(_) => "ascii",
            Protocol::StxEtx(_) => "stx-etx",
            Protocol::S3964(p) => match (p.bcc, p.rk512) {
                (false, false) => "3964",
                (true, false) => "3964r",
                (false, true) => "3964-rk512",
                (true, true) => "3964r-rk512",
            },
            Protocol::Modbus(p) => ModbusKind::NAMES.iter().find(|(k, _)| *k == p.kind).map_or("", |(_, name)| name),
            Protocol::MBus => "mbus",
            Protocol::EnOcean => "enocean",
        }
    }

    /// The settings of the line.
    pub fn line_settings(&self) -> LineSettings {
        let flow = match &self.protocol {
            Protocol::Ascii(p) => p.flow,
            Protocol::StxEtx(p) => p.flow,
            Protocol::S3964(_) | Protocol::Modbus(_) | Protocol::MBus | Protocol::EnOcean => Flow::None,
        };
        LineSettings {
            baud: self.baud,
            data_bits: self.data_bits,
            parity: self.parity,
            stop_bits: self.stop_bits,
            flow,
            // "Physically, Modbus transmits via a serial half-duplex core" [S0 L2034]; so does M-Bus.
            half_duplex: self.interface.is_half_duplex()
                || matches!(self.protocol, Protocol::Modbus(_) | Protocol::MBus),
        }
    }

    /// Time of one character on the line, nanoseconds.
    pub fn char_time(&self) -> Span {
        self.line_settings().char_time()
    }

    /// Number of receive buffers: the parameter for ASCII; 250 telegrams otherwise [S0 "Properties"], and 250 blocks
    /// for ASCII-fragmented, where a block is not a telegram.
    pub fn receive_buffers(&self) -> u8 {
        match &self.protocol {
            Protocol::Ascii(p) if !p.fragmented => p.receive_buffers,
            _ => 250,
        }
    }
}
