//! The parameter tables: every printed code and default, conversion between the two forms, and error texts.

use ob1_params::cp240_table::{CP240, Kind, Layout, PROTOCOLS};
use ob1_params::{Cp240, Flow, ModbusKind, Parity, Priority, Protocol, StopBits, Value};
use ob1_serial::Span;
use proptest::prelude::*;

/// The printed defaults of a layout, byte 1 set to a protocol of it.
fn defaults(protocol: &str) -> [u8; 16] {
    Cp240::defaults(protocol).expect(protocol).encode()
}

fn decode(bytes: [u8; 16]) -> Cp240 {
    Cp240::decode(&bytes).unwrap_or_else(|e| panic!("{bytes:02X?}: {e}"))
}

fn with(mut bytes: [u8; 16], byte: usize, value: u8) -> [u8; 16] {
    bytes[byte] = value;
    bytes
}

/// The default columns as printed, except the baud rate, which is written as 09h instead of 00h.
#[test]
fn printed_defaults() {
    assert_eq!(defaults("ascii"), [9, 0x01, 0x13, 0, 0, 10, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0]);
    assert_eq!(defaults("ascii-fragmented")[1], 0x11);
    assert_eq!(defaults("stx-etx"), [9, 0x02, 0x13, 0, 0, 10, 1, 2, 0, 1, 3, 0, 0, 0, 0, 0]);
    assert_eq!(defaults("3964"), [9, 0x03, 0x13, 0, 0, 10, 25, 100, 5, 6, 0, 0, 0, 0, 0, 0]);
    assert_eq!(defaults("modbus-master-rtu"), [9, 0x0B, 0x13, 0, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]);
}

/// [S0 "Note to default parameter!"]
#[test]
fn no_parameters_at_all() {
    let cp = Cp240::of_bytes(&[0; 16]).expect("sixteen zeros stand for no parameters");
    assert_eq!(cp, Cp240::unconfigured());
    assert_eq!(Cp240::decode(&cp.encode()), Ok(cp.clone()));
    assert_eq!(cp.line_settings().to_string(), "9600 8E1");
    assert_eq!(cp.encode(), [9, 0x01, 0x1B, 0, 0, 10, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0]);
    assert_eq!(decode(cp.encode()), cp);
}

#[test]
fn protocol_codes() {
    let printed = [
        (0x01, "ascii"),
        (0x02, "stx-etx"),
        (0x03, "3964"),
        (0x04, "3964r"),
        (0x05, "3964-rk512"),
        (0x06, "3964r-rk512"),
        (0x0A, "modbus-master-ascii"),
        (0x0B, "modbus-master-rtu"),
        (0x0C, "modbus-slave-ascii-short"),
        (0x0D, "modbus-slave-rtu-short"),
        (0x11, "ascii-fragmented"),
        (0x1C, "modbus-slave-ascii-long"),
        (0x1D, "modbus-slave-rtu-long"),
        (0xE0, "enocean"),
        (0xF0, "mbus"),
    ];
    for (code, name) in printed {
        assert_eq!(defaults(name)[1], code);
        assert_eq!(decode(defaults(name)).protocol_name(), name);
    }
    for code in 0..=255 {
        let known = printed.iter().any(|(c, _)| *c == code);
        let bytes = with(defaults("ascii"), 1, code);
        let unknown = Cp240::decode(&bytes).is_err_and(|e| e.key == "protocol" && e.byte == Some(1));
        assert_eq!(unknown, !known, "{code:02X}h");
    }
}

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
        (0x0F, 76_800),
        (0x0E, 115_200),
    ];
    for protocol in ["ascii", "stx-etx", "3964r"] {
        for (code, baud) in printed {
            assert_eq!(decode(with(defaults(protocol), 0, code)).baud, baud, "{code:02X}h");
        }
        assert!(Cp240::decode(&with(defaults(protocol), 0, 0x10)).is_err());
    }
    for (code, baud) in printed {
        let known = [0, 6, 7, 8, 9, 0xA, 0xB, 0xC].contains(&code);
        let read = Cp240::decode(&with(defaults("modbus-slave-rtu-short"), 0, code));
        assert_eq!(read.map(|cp| cp.baud).ok(), known.then_some(baud));
    }
}

#[test]
fn transfer_parameter_byte() {
    use Parity::{Even, Odd};
    for code in 0..=255_u8 {
        let data_bits = 5 + (code & 3);
        let stop_bits = [None, Some(StopBits::One), Some(StopBits::OneAndHalf), Some(StopBits::Two)];
        let stop_bits = stop_bits[usize::from(code >> 4 & 3)];
        let flow = [Some(Flow::None), Some(Flow::Hardware), Some(Flow::XonXoff), None][usize::from(code >> 6)];
        // Both 10b and 11b are printed as even.
        let parity = [Parity::None, Odd, Even, Even][usize::from(code >> 2 & 3)];
        for (protocol, has_flow) in [("ascii", true), ("stx-etx", true), ("3964r", false), ("modbus-master-rtu", false)]
        {
            let read = Cp240::decode(&with(defaults(protocol), 2, code));
            // Where the bits of flow control are reserved, they may have any value. [S0 L1936], [S0 L2102]
            let good = stop_bits.is_some() && (!has_flow || flow.is_some());
            assert_eq!(read.is_ok(), good, "{protocol} {code:08b}: {read:?}");
            if let Ok(cp) = read {
                let line = cp.line_settings();
                assert_eq!((line.data_bits, line.parity, Some(line.stop_bits)), (data_bits, parity, stop_bits));
                assert_eq!(line.flow, if has_flow { flow.expect("checked") } else { Flow::None });
            }
        }
    }
}

/// Times are units of 20 ms. [S0 "Parameter description"]
#[test]
fn times_and_counts() {
    let cp = decode([0x0E, 0x04, 0x13, 0, 2, 3, 4, 5, 7, 8, 1, 0, 0, 0, 0, 0]);
    let Protocol::S3964(p) = &cp.protocol else { panic!("{cp:?}") };
    assert_eq!((p.zna_ms, p.zvz_ms, p.qvz_ms, p.bwz_ms), (40, 60, 80, 100));
    assert_eq!((p.stx_repetitions, p.dbl, p.priority, p.bcc, p.rk512), (7, 8, Priority::High, true, false));

    let cp = decode([0, 0x02, 0x13, 0, 0, 255, 2, 0x02, 0xFF, 2, 0x0D, 0x0A, 0, 0, 0, 0]);
    let Protocol::StxEtx(p) = &cp.protocol else { panic!("{cp:?}") };
    assert_eq!((p.tmo_ms, p.start_flags, p.start, p.end_flags, p.end), (5100, 2, [2, 0xFF], 2, [0x0D, 0x0A]));

    let cp = decode([9, 0x1D, 0x13, 0, 17, 1, 0xEA, 0x60, 0, 0, 0, 0, 0, 0, 0, 0]);
    let Protocol::Modbus(p) = &cp.protocol else { panic!("{cp:?}") };
    assert_eq!((p.kind, p.address, p.debug, p.wait_ms), (ModbusKind::SlaveRtuLong, 17, true, 60_000));
}

#[test]
fn character_times() {
    let time = |keys: [(&str, Value); 3]| {
        let keys = [("protocol", Value::from("ascii"))].into_iter().chain(keys);
        Cp240::from_keys(keys).expect("valid keys").char_time()
    };
    let frame = |baud: i64, parity: &str, stop: &str| {
        time([("baud", baud.into()), ("parity", parity.into()), ("stop_bits", stop.into())])
    };
    assert_eq!(frame(9600, "none", "1"), Span::from_nanos(1_041_667));
    assert_eq!(frame(9600, "even", "1"), Span::from_nanos(1_145_834));
    assert_eq!(frame(19_200, "odd", "1.5"), Span::from_nanos(598_959)); // 11.5 bits
    assert_eq!(frame(150, "even", "2"), Span::from_nanos(80_000_000));
}

/// The tables print no value for them, and hardware configurations write there: they are read over, and found.
/// [S0 L1896], [S0 L1936], [S0 L2102]
#[test]
fn reserved_bits_are_read_over_and_found() {
    for (protocol, byte, value) in [
        ("ascii", 3, 1),
        ("ascii", 7, 0xFF),
        ("ascii", 15, 1),
        ("3964r", 11, 1),
        ("3964r", 2, 0x53),
        ("stx-etx", 12, 1),
        ("modbus-master-rtu", 8, 1),
        ("modbus-slave-rtu-long", 2, 0xD3),
    ] {
        let plain = defaults(protocol);
        let record = with(plain, byte, value);
        assert_eq!(decode(record), decode(plain), "{protocol} {byte}");
        assert_eq!((CP240.reserved(&record), CP240.reserved(&plain)), (vec![byte], vec![]), "{protocol}");
    }
    assert_eq!(CP240.reserved(&with(with(defaults("3964r"), 3, 7), 15, 9)), [3, 15]);
    // "The other parameters are reserved and not evaluated." [S0 L4129], [S1 L937]
    for protocol in ["mbus", "enocean"] {
        assert_eq!(CP240.reserved(&with(defaults(protocol), 2, 0x13)), [], "{protocol}");
    }
    assert_eq!(CP240.reserved(&[0; 16]), [], "none at all");
}

/// "At a master parameterization the address is ignored." [S0 L2572] "In slave mode this parameter [the delay time] is
/// ignored." [S0 L2177]
#[test]
fn what_a_modbus_mode_ignores_may_have_any_value() {
    let address = |protocol: &str, address| Cp240::decode(&with(defaults(protocol), 4, address)).is_ok();
    let wait = |protocol: &str| Cp240::decode(&with(with(defaults(protocol), 6, 0xFF), 7, 0xFF)).is_ok();
    for mode in ["ascii", "rtu"] {
        let (master, slave) = (format!("modbus-master-{mode}"), format!("modbus-slave-{mode}-long"));
        assert!(address(&master, 0) && address(&master, 255) && address(&slave, 255));
        assert!(!address(&slave, 0) && !wait(&master) && wait(&slave));
    }
}

/// Numbers stand by their size, whatever the order of the table.
#[test]
fn baud_rates_are_listed_by_size() {
    let refused = |protocol: &str| {
        Cp240::from_keys([("protocol", Value::from(protocol)), ("baud", Value::Int(9601))]).expect_err("9601").allowed
    };
    let all = "150, 300, 600, 1200, 1800, 2400, 4800, 7200, 9600, 14400, 19200, 38400, 57600, 76800, 115200";
    assert_eq!(refused("ascii"), all);
    assert_eq!(refused("modbus-master-rtu"), "2400, 4800, 7200, 9600, 14400, 19200, 38400");
    let error = Cp240::decode(&with(defaults("ascii"), 0, 0x20)).expect_err("no such code");
    assert!(error.allowed.starts_with("00h (9600), 01h (150)"), "{}", error.allowed);
}

/// Every field refuses values just outside its range, by code and by key, and names itself.
#[test]
fn limits_of_every_field() {
    for (protocol, _, layout) in PROTOCOLS {
        for field in layout.fields() {
            let refuse = |value: i64| {
                let keys = [("protocol", Value::from(*protocol)), (field.key, Value::Int(value))];
                let error = Cp240::from_keys(keys).expect_err(field.key);
                assert_eq!((error.key.as_str(), error.byte), (field.key, Some(field.byte)));
                assert!(!error.allowed.is_empty() && !error.remedy.is_empty());
            };
            let accept = |value: i64| {
                let keys = [("protocol", Value::from(*protocol)), (field.key, Value::Int(value))];
                let cp = Cp240::from_keys(keys).unwrap_or_else(|e| panic!("{e}"));
                assert!(cp.to_keys().contains(&(field.key, Value::Int(value))), "{} = {value}", field.key);
                assert_eq!(decode(cp.encode()), cp);
            };
            match field.kind {
                Kind::Number { min, max } => {
                    accept(min.into());
                    accept(max.into());
                    refuse(i64::from(min) - 1);
                    refuse(i64::from(max) + 1);
                }
                Kind::Ticks { min } => {
                    accept(i64::from(min) * 20);
                    accept(5100);
                    refuse(i64::from(min) * 20 - 20);
                    refuse(5120);
                    refuse(210);
                }
                Kind::Choice(_) => refuse(3),
            }
        }
    }
}

/// The words of the errors, as a user sees them.
#[test]
fn mistakes_in_words() {
    let error =
        |keys: &[(&'static str, Value)]| Cp240::from_keys(keys.iter().cloned()).expect_err("a mistake").to_string();
    let s3964r = ("protocol", Value::from("3964r"));
    assert_eq!(
        error(&[s3964r.clone(), ("qvz_ms", Value::Int(510))]),
        "parameter `qvz_ms` (byte 6): 510 is not allowed; allowed: 0..5100 in steps of 20; \
         the nearest is 520 (QVZ: longest wait for the acknowledgement of the partner; 0: two character times)"
    );
    assert_eq!(
        error(&[s3964r.clone(), ("priorty", Value::from("high"))]),
        "there is no parameter `priorty` here; allowed: with protocol \"3964r\": baud, data_bits, parity, \
         stop_bits, zna_ms, zvz_ms, qvz_ms, bwz_ms, stx_repetitions, dbl, priority; did you mean `priority`?"
    );
    assert!(error(&[s3964r.clone(), ("receive_buffers", Value::Int(1))]).contains("belongs to another protocol"));
    assert_eq!(
        error(&[("protocol", Value::from("enocean")), ("baud", Value::Int(57600))]),
        "there is no parameter `baud` here; allowed: protocol \"enocean\" alone, it has no parameters; `baud` belongs to \
         another protocol; remove it"
    );
    assert!(error(&[s3964r.clone(), ("parity", Value::from("evn"))]).contains("did you mean \"even\"?"));
    assert!(error(&[s3964r.clone(), ("baud", Value::Int(1)), ("baud", Value::Int(2))]).contains("each key once"));
    assert!(error(&[("protocol", Value::from("3946r"))]).contains("did you mean \"3964r\"?"));
    let missing = error(&[("baud", Value::Int(9600))]);
    assert!(
        missing.starts_with("the parameter `protocol` is missing; ") && missing.contains("add `protocol"),
        "{missing}"
    );
    assert_eq!(
        Cp240::decode(&with(defaults("3964r"), 10, 2)).expect_err("priority 2").to_string(),
        "parameter `priority` (byte 10): 02h is not allowed; allowed: 00h (low), 01h (high); correct the byte or write \
         `priority = ...` instead (which side gives way when both want to send)"
    );
}

/// The rows of a layout do not overlap: no bit belongs to two of them.
#[test]
fn rows_do_not_overlap() {
    for layout in Layout::ALL {
        let mut taken = [0_u8; 16];
        taken[1] = 0xFF;
        for field in layout.fields() {
            let bytes = if field.bits == 16 { 2 } else { 1 };
            let mask = if field.bits >= 8 { 0xFF } else { ((1_u16 << field.bits) - 1) as u8 } << field.shift;
            for byte in &mut taken[field.byte..field.byte + bytes] {
                assert_eq!(*byte & mask, 0, "{}", field.key);
                *byte |= mask;
            }
        }
    }
}

/// Any valid record: one of the protocols, each field with one of its codes.
fn any_cp() -> impl Strategy<Value = Cp240> {
    (0..PROTOCOLS.len(), proptest::collection::vec(any::<prop::sample::Index>(), 16)).prop_map(|(protocol, picks)| {
        let (name, _, layout) = PROTOCOLS[protocol];
        let mut keys = vec![("protocol", Value::from(name))];
        for (field, pick) in layout.fields().iter().zip(picks) {
            let value = match field.kind {
                Kind::Choice(names) => Value::from(names[pick.index(names.len())].0),
                Kind::Number { min, max } => {
                    Value::Int((usize::from(min) + pick.index(usize::from(max - min) + 1)) as i64)
                }
                Kind::Ticks { min } => Value::Int(20 * (usize::from(min) + pick.index(256 - usize::from(min))) as i64),
            };
            keys.push((field.key, value));
        }
        Cp240::from_keys(keys).expect("values of the table")
    })
}

proptest! {
    #[test]
    fn bytes_and_back(cp in any_cp()) {
        prop_assert_eq!(Cp240::decode(&cp.encode()), Ok(cp));
    }

    #[test]
    fn keys_and_back(cp in any_cp()) {
        prop_assert_eq!(Cp240::from_keys(cp.to_keys()), Ok(cp));
    }

    /// Any 16 bytes are read or refused; what is read keeps its meaning when it is written again.
    #[test]
    fn any_bytes(bytes: [u8; 16], protocol in 0..PROTOCOLS.len(), known: bool) {
        let bytes = if known { with(bytes, 1, PROTOCOLS[protocol].1) } else { bytes };
        if let Ok(cp) = Cp240::decode(&bytes) {
            prop_assert_eq!(Cp240::decode(&cp.encode()), Ok(cp));
        }
    }

    /// Any key and value are read or refused.
    #[test]
    fn any_keys(key in ".{0,12}", number: i64, text in ".{0,12}") {
        for value in [Value::Int(number), Value::Str(text)] {
            let read = Cp240::from_keys([("protocol", Value::from("ascii")), (key.as_str(), value)]);
            prop_assert!(read.is_ok() || !read.unwrap_err().to_string().is_empty());
        }
    }
}
