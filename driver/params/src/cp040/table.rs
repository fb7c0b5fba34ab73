//! The parameter tables of the CP 040 manual, as data. Record set 80h: BAUD, PROTOCOL and OPTION3 to OPTION16 are bytes
//! 0 to 15; OPTION n is byte n - 1. [S3 "Parameter data of ASCII"] and the sections of the other protocols.

use crate::cp240_table::{
    self, BYTE, ByteTables, DATA_BITS_ROW, FLAGS, Field, Kind, Layout, MASTER_ADDRESS, MASTER_WAIT, PARITY_ROW,
    SLAVE_ADDRESS, SLAVE_WAIT, STOP_BITS_ROW, TICKS, bits, whole,
};

/// The tables of a CP 040.
pub const CP040: ByteTables = ByteTables { protocols: &PROTOCOLS, fields };

/// Protocol codes (byte 1). 01h, 02h and 0Bh are printed in the manual; the others are those of the CP 240 (ours), of
/// which RK 512, ASCII-fragmented, EnOcean and M-Bus are missing.
const PROTOCOLS: [(&str, u8, Layout); 10] = {
    let mut own = [cp240_table::PROTOCOLS[0]; 10];
    let (mut n, mut row) = (0, 0);
    while row < cp240_table::PROTOCOLS.len() {
        if !matches!(cp240_table::PROTOCOLS[row].1, 0x05 | 0x06 | 0x11 | 0xE0 | 0xF0) {
            own[n] = cp240_table::PROTOCOLS[row];
            n += 1;
        }
        row += 1;
    }
    own
};

/// Baud rates, for every protocol: those of the CP 240, and one more. [S3 L343]
const RATES: [(&str, u8); cp240_table::RATES.len() + 1] = {
    let mut all = [("109700", 0x10); cp240_table::RATES.len() + 1];
    all.split_at_mut(cp240_table::RATES.len()).0.copy_from_slice(&cp240_table::RATES);
    all
};

const BAUD: Kind = Kind::Choice(&RATES);

/// Different from the CP 240, where hardware is 01b and XON/XOFF 10b. [HB300 manual 18-28, p. 60, 65]
const FLOW: Kind = Kind::Choice(&[("none", 0b00), ("hardware", 0b10), ("xon-xoff", 0b11)]);
/// "ZVZ parameterizable in ms steps" [S3 L291]
const MS: Kind = Kind::Number { min: 0, max: 65_535 };

const BAUD_ROW: Field = whole("baud", 0, BAUD, 0x00, "baud rate, bit/s");
const FLOW_ROW: Field = bits("flow", 2, 6, 2, FLOW, 0b00, "flow control");
const ZNA_ROW: Field = bits("zna_ms", 3, 0, 16, MS, 0, "ZNA: pause before the next command is executed");
const DUPLEX_ROW: Field = whole(
    "duplex",
    14,
    Kind::Choice(&[("half", 0), ("full", 1)]),
    0,
    "operating mode: half duplex (RS485, two wires) or full duplex (RS422, four wires)",
);
const PRESET_ROW: Field = whole(
    "preset",
    15,
    Kind::Choice(&[("none", 0), ("break", 1), ("idle", 2)]),
    0,
    "line preset of the receiver: none; break = R(A) 5 V, R(B) 0 V: detects breaks; idle = R(A) 0 V, R(B) 5 V",
);

const ASCII: &[Field] = &[
    BAUD_ROW,
    DATA_BITS_ROW,
    PARITY_ROW,
    STOP_BITS_ROW,
    FLOW_ROW,
    ZNA_ROW,
    // The default is not legible in our copy: 200 ms as for the CP 240 (ours).
    bits("zvz_ms", 5, 0, 16, MS, 200, "ZVZ: pause that ends a telegram; 0: three character times"),
    whole("receive_buffers", 7, Kind::Number { min: 1, max: 250 }, 1, "number of receive buffers"),
    DUPLEX_ROW,
    PRESET_ROW,
];

const STX_ETX: &[Field] = &[
    BAUD_ROW,
    DATA_BITS_ROW,
    PARITY_ROW,
    STOP_BITS_ROW,
    FLOW_ROW,
    ZNA_ROW,
    // Range and default: HB300 p. 66, of which [S3 L357] has the end.
    bits(
        "tmo_ms",
        5,
        0,
        16,
        MS,
        250,
        "TMO: longest pause between two characters of a telegram; 0: three character times",
    ),
    whole("start_flags", 7, FLAGS, 1, "number of start characters"),
    whole("start_flag_1", 8, BYTE, 0x02, "first start character"),
    whole("start_flag_2", 9, BYTE, 0x00, "second start character"),
    whole("end_flags", 10, FLAGS, 1, "number of end characters"),
    whole("end_flag_1", 11, BYTE, 0x03, "first end character"),
    whole("end_flag_2", 12, BYTE, 0x00, "second end character"),
    DUPLEX_ROW,
    PRESET_ROW,
];

/// Units of 20 ms, with other defaults than in the CP 240. [S3 L365]
const S3964: &[Field] = &[
    BAUD_ROW,
    DATA_BITS_ROW,
    PARITY_ROW,
    STOP_BITS_ROW,
    whole("zna_ms", 3, TICKS, 0, "ZNA: pause before the next command is executed"),
    whole("zvz_ms", 4, TICKS, 10, "ZVZ: longest pause between two characters of a telegram; 0: three character times"),
    whole("qvz_ms", 5, TICKS, 10, "QVZ: longest wait for the acknowledgement of the partner; 0: three character times"),
    whole("bwz_ms", 6, TICKS, 10, "BWZ: without a meaning where there is no RK 512"),
    whole("stx_repetitions", 7, BYTE, 5, "repetitions of STX after the first attempt"),
    whole("dbl", 8, BYTE, 6, "DBL: attempts to send a block"),
    whole("priority", 9, Kind::Choice(&[("low", 0), ("high", 1)]), 0, "which side gives way when both want to send"),
    DUPLEX_ROW,
    PRESET_ROW,
];

const fn modbus(address: (Kind, &'static str), wait: (Kind, &'static str)) -> [Field; 8] {
    [
        BAUD_ROW,
        DATA_BITS_ROW,
        PARITY_ROW,
        STOP_BITS_ROW,
        whole("address", 3, address.0, 1, address.1),
        bits("wait_ms", 4, 0, 16, wait.0, 0, wait.1),
        DUPLEX_ROW,
        PRESET_ROW,
    ]
}

const MODBUS_MASTER: &[Field] = &modbus(MASTER_ADDRESS, (MS, MASTER_WAIT));
const MODBUS_SLAVE: &[Field] = &modbus(SLAVE_ADDRESS, SLAVE_WAIT);

/// The rows of a protocol's table, byte 1 (the protocol) left out.
pub fn fields(layout: Layout) -> &'static [Field] {
    match layout {
        Layout::Ascii => ASCII,
        Layout::StxEtx => STX_ETX,
        Layout::S3964 => S3964,
        Layout::ModbusMaster => MODBUS_MASTER,
        Layout::ModbusSlave => MODBUS_SLAVE,
        Layout::MBus | Layout::EnOcean => &[],
    }
}
