//! The parameter tables of the CP 240 manual, as data. Everything else in this crate uses these rows.
//!
//! [S0 "Structure of the parameter bytes of ASCII"], [S0 "Structure of parameter bytes for STX/ETX"],
//! [S0 "Structure of parameter bytes for 3964(R) / 3964(R) with RK512"], [S0 "Modbus - Parameterization"].

/// The parameter layouts: what the 16 bytes mean with a protocol.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Layout {
    /// ASCII and ASCII-fragmented (01h, 11h).
    Ascii,
    /// STX/ETX, protocol code 02h.
    StxEtx,
    /// 3964, 3964R, each with and without RK 512.
    S3964,
    /// The Modbus masters, ASCII and RTU.
    ModbusMaster,
    /// The Modbus slaves, ASCII and RTU, short and long.
    ModbusSlave,
    /// M-Bus: only the protocol code.
    MBus,
    /// EnOcean: only the protocol code.
    EnOcean,
}

/// How the bits of a field are written as a value of the station file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// One of these names; the first row that matches is used in both directions, so the code to write comes first.
    Choice(&'static [(&'static str, u8)]),
    /// A number, `min..=max`, in steps of 1.
    Number {
        /// The smallest number allowed.
        min: u16,
        /// The largest number allowed.
        max: u16,
    },
    /// A time in milliseconds, kept in ticks of 20 ms, `min..=255`.
    Ticks {
        /// Smallest number of ticks.
        min: u16,
    },
}

/// One row of a table.
#[derive(Clone, Copy, Debug)]
pub struct Field {
    /// Key in the station file.
    pub key: &'static str,
    /// Parameter byte that holds it, 0 to 15.
    pub byte: usize,
    /// Lowest bit in the byte.
    pub shift: u8,
    /// Number of bits; 16: this byte (high) and the next one (low), like all words of an S7.
    pub bits: u8,
    /// How it is written.
    pub kind: Kind,
    /// Code that stands for the manual's default.
    pub default: u16,
    /// What it means, for people.
    pub text: &'static str,
}

/// The tables of a module whose parameters are 16 bytes.
#[derive(Clone, Copy, Debug)]
pub struct ByteTables {
    /// Name, code (byte 1) and layout of each protocol.
    pub protocols: &'static [(&'static str, u8, Layout)],
    /// The rows of a layout, byte 1 left out.
    pub fields: fn(Layout) -> &'static [Field],
}

/// Those of a CP 240.
pub const CP240: ByteTables = ByteTables { protocols: PROTOCOLS, fields: Layout::fields };

/// Tick of the times in the parameter bytes, milliseconds.
pub const TICK_MS: u16 = 20;

/// Protocol codes (byte 1). [S0 "Parameter description"]
pub const PROTOCOLS: &[(&str, u8, Layout)] = &[
    ("ascii", 0x01, Layout::Ascii),
    ("stx-etx", 0x02, Layout::StxEtx),
    ("3964", 0x03, Layout::S3964),
    ("3964r", 0x04, Layout::S3964),
    ("3964-rk512", 0x05, Layout::S3964),
    ("3964r-rk512", 0x06, Layout::S3964),
    ("modbus-master-ascii", 0x0A, Layout::ModbusMaster),
    ("modbus-master-rtu", 0x0B, Layout::ModbusMaster),
    ("modbus-slave-ascii-short", 0x0C, Layout::ModbusSlave),
    ("modbus-slave-rtu-short", 0x0D, Layout::ModbusSlave),
    ("ascii-fragmented", 0x11, Layout::Ascii),
    ("modbus-slave-ascii-long", 0x1C, Layout::ModbusSlave),
    ("modbus-slave-rtu-long", 0x1D, Layout::ModbusSlave),
    ("enocean", 0xE0, Layout::EnOcean),
    ("mbus", 0xF0, Layout::MBus),
];

/// Baud rates. 00h is the default; written explicitly, 9600 is 09h. 76800 and 115200 are in this order in the manual.
pub(crate) const RATES: [(&str, u8); 16] = [
    ("9600", 0x09),
    ("9600", 0x00),
    ("150", 0x01),
    ("300", 0x02),
    ("600", 0x03),
    ("1200", 0x04),
    ("1800", 0x05),
    ("2400", 0x06),
    ("4800", 0x07),
    ("7200", 0x08),
    ("14400", 0x0A),
    ("19200", 0x0B),
    ("38400", 0x0C),
    ("57600", 0x0D),
    ("115200", 0x0E),
    ("76800", 0x0F),
];

const BAUD: Kind = Kind::Choice(&RATES);

/// The parameter table omits 7200 baud, but the technical data list it [S0 L2822]; the code is that of the other
/// tables.
const BAUD_MODBUS: Kind = Kind::Choice(&[
    ("9600", 0x09),
    ("9600", 0x00),
    ("2400", 0x06),
    ("4800", 0x07),
    ("7200", 0x08),
    ("14400", 0x0A),
    ("19200", 0x0B),
    ("38400", 0x0C),
]);

const DATA_BITS: Kind = Kind::Choice(&[("5", 0b00), ("6", 0b01), ("7", 0b10), ("8", 0b11)]);
/// Both 10b and 11b are printed as "even".
const PARITY: Kind = Kind::Choice(&[("none", 0b00), ("odd", 0b01), ("even", 0b10), ("even", 0b11)]);
/// The Modbus table prints only 11b as "even", the description of the byte both [S0 L2155]: 11b is written, both are
/// accepted.
const PARITY_MODBUS: Kind = Kind::Choice(&[("none", 0b00), ("odd", 0b01), ("even", 0b11), ("even", 0b10)]);
const STOP_BITS: Kind = Kind::Choice(&[("1", 0b01), ("1.5", 0b10), ("2", 0b11)]);
const FLOW: Kind = Kind::Choice(&[("none", 0b00), ("hardware", 0b01), ("xon-xoff", 0b10)]);
pub(crate) const BYTE: Kind = Kind::Number { min: 0, max: 255 };
pub(crate) const FLAGS: Kind = Kind::Number { min: 0, max: 2 };
pub(crate) const TICKS: Kind = Kind::Ticks { min: 0 };

pub(crate) const fn bits(
    key: &'static str,
    byte: usize,
    shift: u8,
    bits: u8,
    kind: Kind,
    default: u16,
    text: &'static str,
) -> Field {
    Field { key, byte, shift, bits, kind, default, text }
}

pub(crate) const fn whole(key: &'static str, byte: usize, kind: Kind, default: u16, text: &'static str) -> Field {
    bits(key, byte, 0, 8, kind, default, text)
}

const BAUD_ROW: Field = whole("baud", 0, BAUD, 0x00, "baud rate, bit/s");
pub(crate) const DATA_BITS_ROW: Field = bits("data_bits", 2, 0, 2, DATA_BITS, 0b11, "data bits of a character");
pub(crate) const PARITY_ROW: Field = bits("parity", 2, 2, 2, PARITY, 0b00, "parity bit");
pub(crate) const STOP_BITS_ROW: Field = bits("stop_bits", 2, 4, 2, STOP_BITS, 0b01, "stop bits");
const FLOW_ROW: Field = bits("flow", 2, 6, 2, FLOW, 0b00, "flow control");
const ZNA_ROW: Field = whole("zna_ms", 4, TICKS, 0, "ZNA: pause before the next command is executed");
const ZVZ_ROW: Field =
    whole("zvz_ms", 5, TICKS, 10, "ZVZ: longest pause between two characters of a telegram; 0: two character times");

const ASCII: &[Field] = &[
    BAUD_ROW,
    DATA_BITS_ROW,
    PARITY_ROW,
    STOP_BITS_ROW,
    FLOW_ROW,
    ZNA_ROW,
    ZVZ_ROW,
    whole("receive_buffers", 6, Kind::Number { min: 1, max: 250 }, 1, "number of receive buffers"),
];

const STX_ETX: &[Field] = &[
    BAUD_ROW,
    DATA_BITS_ROW,
    PARITY_ROW,
    STOP_BITS_ROW,
    FLOW_ROW,
    ZNA_ROW,
    // "the maximum time between two messages" [S0 L2016]: the silence after which the next message may begin. The
    // technical data call it "Character delay time TMO" [S0 L2800].
    whole("tmo_ms", 5, Kind::Ticks { min: 1 }, 10, "TMO: longest pause between two characters of a telegram"),
    whole("start_flags", 6, FLAGS, 1, "number of start characters"),
    whole("start_flag_1", 7, BYTE, 0x02, "first start character"),
    whole("start_flag_2", 8, BYTE, 0x00, "second start character"),
    whole("end_flags", 9, FLAGS, 1, "number of end characters"),
    whole("end_flag_1", 10, BYTE, 0x03, "first end character"),
    whole("end_flag_2", 11, BYTE, 0x00, "second end character"),
];

const S3964: &[Field] = &[
    BAUD_ROW,
    DATA_BITS_ROW,
    PARITY_ROW,
    STOP_BITS_ROW,
    ZNA_ROW,
    ZVZ_ROW,
    whole("qvz_ms", 6, TICKS, 25, "QVZ: longest wait for the acknowledgement of the partner; 0: two character times"),
    whole(
        "bwz_ms",
        7,
        TICKS,
        100,
        "BWZ: longest wait from the acknowledged request to the answer telegram (RK 512); 0: not watched",
    ),
    // The table prints 5, the description 3.
    whole("stx_repetitions", 8, BYTE, 5, "repetitions of STX after the first attempt"),
    whole("dbl", 9, BYTE, 6, "DBL: attempts to send a block, the first included"),
    whole("priority", 10, Kind::Choice(&[("low", 0), ("high", 1)]), 0, "which side gives way when both want to send"),
];

/// "At a master parameterization the address is ignored." [S0 L2572]
pub(crate) const MASTER_ADDRESS: (Kind, &str) = (BYTE, "slave address; a master ignores it");
pub(crate) const SLAVE_ADDRESS: (Kind, &str) = (Kind::Number { min: 1, max: 255 }, "slave address");
/// "In slave mode this parameter is ignored." [S0 L2177]
pub(crate) const SLAVE_WAIT: (Kind, &str) =
    (Kind::Number { min: 0, max: 65_535 }, "wait of a master; a slave has none");
pub(crate) const MASTER_WAIT: &str = "wait of the master; 0: computed from the baud rate";

const fn modbus(address: (Kind, &'static str), wait: (Kind, &'static str)) -> [Field; 7] {
    [
        whole("baud", 0, BAUD_MODBUS, 0x00, "baud rate, bit/s"),
        DATA_BITS_ROW,
        bits("parity", 2, 2, 2, PARITY_MODBUS, 0b00, "parity bit"),
        STOP_BITS_ROW,
        whole("address", 4, address.0, 1, address.1),
        whole("debug", 5, Kind::Choice(&[("off", 0), ("on", 1)]), 0, "for internal tests; leave it off"),
        bits("wait_ms", 6, 0, 16, wait.0, 0, wait.1),
    ]
}

const MODBUS_MASTER: &[Field] = &modbus(MASTER_ADDRESS, (Kind::Number { min: 0, max: 60_000 }, MASTER_WAIT));
const MODBUS_SLAVE: &[Field] = &modbus(SLAVE_ADDRESS, SLAVE_WAIT);

impl Layout {
    /// The rows of this layout, byte 1 (the protocol) left out.
    pub fn fields(self) -> &'static [Field] {
        match self {
            Self::Ascii => ASCII,
            Self::StxEtx => STX_ETX,
            Self::S3964 => S3964,
            Self::ModbusMaster => MODBUS_MASTER,
            Self::ModbusSlave => MODBUS_SLAVE,
            Self::MBus | Self::EnOcean => &[],
        }
    }

    /// Whether bytes that belong to no field may have any value: "The other parameters are reserved and not evaluated."
    /// [S0 L4129], [S1 L937]
    pub fn ignores_reserved(self) -> bool {
        matches!(self, Self::MBus | Self::EnOcean)
    }

    /// All layouts, each once.
    pub const ALL: [Self; 7] =
        [Self::Ascii, Self::StxEtx, Self::S3964, Self::ModbusMaster, Self::ModbusSlave, Self::MBus, Self::EnOcean];
}

impl Field {
    /// The allowed values as text: `5, 6, 7, 8`, `1..250`, `0..5100 in steps of 20`.
    pub fn allowed(&self) -> String {
        match self.kind {
            Kind::Choice(names) => {
                let mut list: Vec<&str> = Vec::new();
                for (name, _) in names {
                    if !list.contains(name) {
                        list.push(name);
                    }
                }
                // The code to write comes first in the table; people look for numbers by their size.
                if list.iter().all(|name| name.parse::<u32>().is_ok()) {
                    list.sort_by_key(|name| name.parse::<u32>().ok());
                }
                list.join(", ")
            }
            Kind::Number { min, max } => format!("{min}..{max}"),
            Kind::Ticks { min } => format!("{}..{} in steps of {TICK_MS}", min * TICK_MS, 255 * TICK_MS),
        }
    }
}
