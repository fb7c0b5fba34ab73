//! The parameter tables of the CP 040, code by code. [S3 L341-L381]

use ob1_params::{Cp040, Flow, Parity, StopBits, Value};

const PROTOCOLS: [&str; 4] = ["ascii", "stx-etx", "3964r", "modbus-slave-rtu-short"];

fn with(protocol: &str, byte: usize, value: u8) -> [u8; 16] {
    let mut bytes = Cp040::defaults(protocol).expect(protocol).encode();
    bytes[byte] = value;
    bytes
}

/// 01h and 02h are printed, 0Bh is the master's; the others are those of the CP 240 (ours).
#[test]
fn protocol_codes() {
    let names = [
        (0x01, "ascii"),
        (0x02, "stx-etx"),
        (0x03, "3964"),
        (0x04, "3964r"),
        (0x0A, "modbus-master-ascii"),
        (0x0B, "modbus-master-rtu"),
        (0x0C, "modbus-slave-ascii-short"),
        (0x0D, "modbus-slave-rtu-short"),
        (0x1C, "modbus-slave-ascii-long"),
        (0x1D, "modbus-slave-rtu-long"),
    ];
    for code in 0..=255 {
        let known = names.iter().find(|(c, _)| *c == code);
        match known {
            Some((_, name)) => assert_eq!(Cp040::defaults(name).expect(name).encode()[1], code),
            None => assert_eq!(Cp040::decode(&with("ascii", 1, code)).expect_err("unknown").byte, Some(1)),
        }
    }
}

/// [S3 L343], [S3 L353], [S3 L365], [S3 L375]: the same list for each protocol, with 109700.
#[test]
fn baud_codes() {
    let printed = [
        (0x00, 9600),
        (0x01, 150),
        (0x02, 300),
        (0x03, 600),
        (0x04, 1200),
        (0x05, 1800),
        (0x06, 2400),
        (0x07, 4800),
        (0x08, 7200),
        (0x09, 9600),
        (0x0A, 14_400),
        (0x0B, 19_200),
        (0x0C, 38_400),
        (0x0D, 57_600),
        (0x0E, 115_200),
        (0x0F, 76_800),
        (0x10, 109_700),
    ];
    for protocol in PROTOCOLS {
        for (code, baud) in printed {
            let cp = Cp040::decode(&with(protocol, 0, code)).expect("a code of the list");
            assert_eq!(cp.common.line_settings().baud, baud, "{protocol} {code:02X}h");
        }
        for code in 0x11..=0xFF {
            assert_eq!(Cp040::decode(&with(protocol, 0, code)).expect_err("not permitted").byte, Some(0));
        }
    }
}

/// [S3 L377]: data bits, parity, stop bits as at the CP 240; flow control for ASCII and STX/ETX, in full duplex.
#[test]
fn transfer_parameter_byte() {
    for code in 0..=255_u8 {
        let stop_bits = [None, Some(StopBits::One), Some(StopBits::OneAndHalf), Some(StopBits::Two)];
        let stop_bits = stop_bits[usize::from(code >> 4 & 3)];
        let flow = [Some(Flow::None), None, Some(Flow::Hardware), Some(Flow::XonXoff)][usize::from(code >> 6)];
        let parity = [Parity::None, Parity::Odd, Parity::Even, Parity::Even][usize::from(code >> 2 & 3)];
        let all = PROTOCOLS.into_iter().zip([true, true, false, false]);
        for (protocol, _) in all.filter(|(_, has_flow)| *has_flow || code >> 6 == 0) {
            let mut bytes = with(protocol, 2, code);
            bytes[14] = 1;
            let read = Cp040::decode(&bytes);
            let good = stop_bits.is_some() && flow.is_some();
            assert_eq!(read.is_ok(), good, "{protocol} {code:08b}: {read:?}");
            if let Ok(cp) = read {
                let line = cp.common.line_settings();
                assert_eq!(
                    (line.data_bits, line.parity, Some(line.stop_bits), Some(line.flow)),
                    (5 + (code & 3), parity, stop_bits, flow)
                );
            }
        }
    }
}

/// Every number and time at its limits, and one beyond. [S3 L303], [S3 L305], [S3 L357], [S3 L367], [S3 L369]
#[test]
fn limits_of_every_field() {
    const MS: (i64, i64, i64) = (0, 65_535, 1);
    const TICKS: (i64, i64, i64) = (0, 5100, 20);
    const BYTE: (i64, i64, i64) = (0, 255, 1);
    const FLAGS: (i64, i64, i64) = (0, 2, 1);
    for (protocol, key, byte, (min, max, step)) in [
        ("ascii", "zna_ms", 3, MS),
        ("ascii", "zvz_ms", 5, MS),
        ("ascii", "receive_buffers", 7, (1, 250, 1)),
        ("stx-etx", "zna_ms", 3, MS),
        ("stx-etx", "start_flags", 7, FLAGS),
        ("stx-etx", "start_flag_1", 8, BYTE),
        ("stx-etx", "start_flag_2", 9, BYTE),
        ("stx-etx", "end_flags", 10, FLAGS),
        ("stx-etx", "end_flag_1", 11, BYTE),
        ("stx-etx", "end_flag_2", 12, BYTE),
        ("3964", "zna_ms", 3, TICKS),
        ("3964r", "zvz_ms", 4, TICKS),
        ("3964r", "qvz_ms", 5, TICKS),
        ("3964r", "stx_repetitions", 7, BYTE),
        ("3964r", "dbl", 8, BYTE),
        ("modbus-slave-rtu-long", "address", 3, (1, 255, 1)),
        ("modbus-master-ascii", "wait_ms", 4, MS),
    ] {
        let set = |value: i64| Cp040::from_keys([("protocol", Value::from(protocol)), (key, Value::Int(value))]);
        for value in [min, max] {
            let cp = set(value).unwrap_or_else(|error| panic!("{protocol}: {error}"));
            assert!(cp.to_keys().contains(&(key, Value::Int(value))), "{protocol} {key} = {value}");
            assert_eq!(Cp040::decode(&cp.encode()), Ok(cp));
        }
        for value in [min - step, max + step] {
            let error = set(value).expect_err(key);
            assert_eq!((error.key.as_str(), error.byte), (key, Some(byte)));
        }
    }
}
