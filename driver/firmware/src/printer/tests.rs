//! The bytes for the printer.

use ob1_params::{Cp341, Protocol341, Value};
use proptest::prelude::*;

use super::*;

fn printer(keys: &[(&str, Value)]) -> Printer {
    let fixed = [("protocol", Value::from("printer")), ("left_margin", Value::Int(0))];
    let given = fixed.into_iter().filter(|(key, _)| !keys.iter().any(|(other, _)| other == key));
    let parameters = Cp341::from_keys(given.chain(keys.iter().cloned())).expect("parameters");
    let Protocol341::Printer(parameters) = parameters.protocol else { panic!("another") };
    Printer::new(&parameters)
}

/// A job as P_PRINT sends it.
fn job(format: &[u8], variables: &[&[u8]]) -> Vec<u8> {
    let all = (0..VARIABLES).map(|at| variables.get(at).copied().unwrap_or_default()).chain([format]);
    let parts: Vec<&[u8]> = all.collect();
    let lengths = parts.iter().flat_map(|part| (part.len() as u16).to_be_bytes());
    lengths.chain(parts.iter().flat_map(|part| part.to_vec())).collect()
}

/// What one job prints, without its line end, and its STATUS.
fn shown(format: &str, variables: &[&[u8]]) -> (String, u16) {
    let printed = printer(&[]).print(&job(format.as_bytes(), variables)).expect("printed");
    let text = String::from_utf8(printed.bytes).expect("ASCII");
    (text.strip_suffix("\r\n").expect("a line end").to_owned(), printed.fault.map_or(0, |fault| fault as u16))
}

#[test]
fn display_types_are_those_of_the_table() {
    let real = |value: f32| value.to_be_bytes();
    let table: &[(&str, &[u8], &str)] = &[
        ("%A", &885_u16.to_be_bytes(), "04.06.1992"),
        ("%.2A", &885_u16.to_be_bytes(), "04.06.92"),
        ("%A", &0_u16.to_be_bytes(), "01.01.1990"),
        ("%D", &65_378_u16.to_be_bytes(), "2168-12-31"),
        ("%D", &3712_u16.to_be_bytes(), "2000-03-01"),
        ("%.4d", &3711_u16.to_be_bytes(), "2000-02-29"),
        ("%C", b"ABCDE", "ABCDE"),
        ("%F", &real(0.123456), "0.123456"),
        ("%F", &real(-0.5), "-0.50000"),
        ("%F", &real(12_345.678), "12345.68"),
        ("%F", &real(1e10), "10000000000"),
        ("%.1F", &real(-2.25), "-2.2"),
        ("%.0F", &real(2.6), "3"),
        ("%8.3f", &real(1.5), "   1.500"),
        ("%H", &[0x0A, 0xF0, 7], "0AF007"),
        ("%I", &(-32_767_i16).to_be_bytes(), "-32767"),
        ("%I", &i16::MIN.to_be_bytes(), "-32768"),
        ("%I", &i32::MIN.to_be_bytes(), "-2147483648"),
        ("%F", &real(f32::MAX), "340282346638528859811704183484516925440"),
        ("%F", &real(f32::from_bits(1)), "0.000000"),
        ("%R", &real(f32::from_bits(1)), "0.14E-44"),
        ("%R", &real(f32::MIN), "-0.34E+39"),
        ("%.1R", &real(0.96), "0.1E+01"),
        ("%R", &real(0.000_012), "0.12E-04"),
        ("%R", &real(-123.0), "-0.12E+03"),
        ("%.4R", &real(123.456), "0.1235E+03"),
        ("%.0R", &real(123.0), "1E+02"),
        ("%R", &real(0.0), "0.00E+00"),
        ("%S", b"is falling", "is falling"),
        ("%S", &[6, 4, b'f', b'u', b'l', b'l', 0, 0], "full"),
        ("%T", &184_205_250_i32.to_be_bytes(), "2d_3h_10m_5s_250ms"),
        ("%T", &(-5000_i32).to_be_bytes(), "-5s_0ms"),
        ("%T", &0_i32.to_be_bytes(), "0ms"),
        ("%T", &i32::MIN.to_be_bytes(), "-24d_20h_31m_23s_648ms"),
        ("%U", &[255], "255"),
        ("%U", &[255, 255], "65535"),
        ("%U", &[255; 4], "4294967295"),
        ("%X", &[0b1110_1100], "11101100"),
        ("%X", &[1, 128], "0000000110000000"),
        ("%Y", &[0x92, 6, 0x10, 0x15, 0x42, 0x59, 0x72, 0x34], "10.06.1992 - 15:42:59.723"),
        ("%Y", &[0x92, 2, 0x29, 0, 0, 0, 0, 0], "29.02.1992 - 00:00:00.000"),
        ("%Y", &[0x89, 0x12, 0x31, 0x23, 0x59, 0x59, 0x99, 0x90], "31.12.2089 - 23:59:59.999"),
        ("%Z", &56_579_723_u32.to_be_bytes(), "15:42:59.723"),
        ("%6I", &10_i16.to_be_bytes(), "    10"),
        ("%-6I|", &10_i16.to_be_bytes(), "10    |"),
        ("%12.4R", &real(1.0), "  0.1000E+01"),
    ];
    for (format, variable, expected) in table {
        assert_eq!(shown(format, &[variable]), ((*expected).to_owned(), 0), "{format} {variable:02X?}");
    }
}

/// A value that cannot be shown becomes asterisks, the job ends with the number, and the text around it is printed. [CP
/// 341 manual 09/2008, p. 103]
#[test]
fn what_is_wrong_shows_in_the_printout() {
    let two = &10_i16.to_be_bytes()[..];
    let table: &[(&str, &[&[u8]], &str, u16)] = &[
        ("%2.2", &[two], "******", 0x050A),
        ("a%Qb", &[two], "a******b", 0x050A),
        ("%", &[two], "******", 0x050A),
        ("%.I", &[two], "******", 0x050A),
        ("%0I", &[two], "******I", 0x050D),
        ("%303D", &[two], "******D", 0x050D),
        ("%.100F", &[two], "******F", 0x051B),
        ("%1I", &[two], "*", 0x050D),
        ("%3S", &[b"full"], "ful", 0x050D),
        ("%4D", &[two], "1990", 0x050D),
        ("%.3A", &[two], "**********", 0x051B),
        ("%I", &[b"abc"], "***********", 0x051C),
        ("%5I", &[b"abc"], "*****", 0x051C),
        ("%F", &[&f32::NAN.to_be_bytes()], "********", 0x050C),
        ("%5R", &[&f32::NEG_INFINITY.to_be_bytes()], "*****", 0x050C),
        ("%F", &[two], "********", 0x051C),
        ("%U", &[b"abc"], "**********", 0x051C),
        ("%X", &[b"abc"], "************************", 0x051C),
        ("%D", &[&65_379_u16.to_be_bytes()], "**********", 0x050C),
        ("%Z", &[&86_400_000_u32.to_be_bytes()], "************", 0x050C),
        ("%Y", &[&[0x92, 0x13, 1, 0, 0, 0, 0, 0]], "*************************", 0x050C),
        ("%Y", &[&[0x9A, 1, 1, 0, 0, 0, 0, 0]], "*************************", 0x050C),
        ("%Y", &[&[0x93, 2, 0x29, 0, 0, 0, 0, 0]], "*************************", 0x050C),
        ("%I %I!", &[two], "10 !", 0x0508),
        ("level", &[two], "level", 0x0509),
        ("%Q%I", &[two, two], "******10", 0x050A),
        ("a\\Qb", &[], "ab", 0x050B),
        ("a\\", &[], "a", 0x050B),
        ("a\\xb", &[], "ab", 0x050B),
        ("%N", &[&17_u16.to_be_bytes()], "******", 0x0505),
        ("%N", &[b"abc"], "******", 0x051C),
        ("a%P", &[two], "a******", 0x050A),
        // The first fault is the job's.
        ("%Q%1I", &[two, two], "*******", 0x050A),
    ];
    for (format, variables, expected, status) in table {
        assert_eq!(shown(format, variables), ((*expected).to_owned(), *status), "{format}");
    }
    assert_eq!(shown("100 %% \\\\", &[]), ("100 % \\".into(), 0));
}

/// The manual's examples. [CP 341 manual 09/2008, p. 76]
#[test]
fn message_texts_come_behind_the_format_string() {
    let texts = "17 The pressure in the chamber\n18 \\Blevel %i\\b at %Z\n19 %N and %P\n";
    let mut printer = printer(&[("texts", texts.into()), ("emulation", "ibm".into())]);
    let number = |number: u16| number.to_be_bytes();
    let mut print = |format: &str, variables: &[&[u8]]| {
        let printout = printer.print(&job(format.as_bytes(), variables)).expect("printed");
        (String::from_utf8(printout.bytes).expect("ASCII"), printout.fault.map_or(0, |fault| fault as u16))
    };
    let string = b"\x0C\x0Ais falling\0\0";
    assert_eq!(print("%N %S", &[&number(17), string]), ("The pressure in the chamber is falling\r\n".into(), 0));
    // Its conversion statements take the variables that the format string has left.
    let time = 63_000_000_u32.to_be_bytes();
    let printed = print("%N: %S", &[&number(18), b"tank", &200_i16.to_be_bytes(), &time]);
    assert_eq!(printed, ("\x1BElevel 200\x1BF at 17:30:00.000: tank\r\n".into(), 0));
    assert_eq!(print("%N", &[&number(20)]), ("******\r\n".into(), 0x0506));
    assert_eq!(print("%N", &[&number(19)]), ("****** and ******\r\n".into(), 0x050A));
    assert_eq!(print("no line end\\x", &[]), ("no line end".into(), 0));
    assert_eq!(print("", &[]), ("\r\n".into(), 0));
}

#[test]
fn a_job_that_is_none_prints_nothing() {
    let mut printer = printer(&[]);
    let wide = b"%255C";
    let five = [b"%255C%255C%255C%255C".as_slice(), wide].concat();
    for (job, status) in [
        (vec![], 0x0301),
        (vec![0; 9], 0x0301),
        (vec![0, 0, 0, 0, 0, 0, 0, 0, 0, 1], 0x0301),
        (job(&five, &[b"x"]), 0x0507),
        (job(&[b'x'; 251], &[]), 0x0507),
    ] {
        assert_eq!(printer.print(&job), Err(status), "{job:02X?}");
    }
    assert_eq!(printer.print(&job(&[b'x'; 250], &[])).map(|printout| printout.bytes.len()), Ok(252));
    let mut small = self::printer(&[("lines_per_page", Value::Int(3))]);
    assert_eq!(small.print(&job(b"1\r\n2\r\n3\r\n4\r\n5", &[])), Err(0x051E));
}

#[test]
fn pages_have_margins_headers_and_footers() {
    let keys = [
        ("left_margin", Value::Int(2)),
        ("lines_per_page", Value::Int(5)),
        ("header_1", "page %P".into()),
        ("footer_1", "\\Uof %X".into()),
        ("footer_2", "-%p-".into()),
        ("emulation", "hp".into()),
        ("line_end", "lf".into()),
    ];
    let mut printer = printer(&keys);
    let mut print = |format: &[u8], variables: &[&[u8]]| {
        String::from_utf8(printer.print(&job(format, variables)).expect("printed").bytes).expect("ASCII")
    };
    assert_eq!(print(b"one", &[]), "  page 1\n  one\n");
    // The second line fills the page.
    let foot = |number: u16| format!("  \x1B&d0Dof %X\n  -{number}-\n\x0C");
    assert_eq!(print(b"two", &[]), format!("  two\n{}", foot(1)));
    // Line ends inside of a text count too, and each line has its margin.
    assert_eq!(print(b"three\nfour", &[]), format!("  page 2\n  three\n  four\n{}", foot(2)));
    assert_eq!(print(b"%P", &[&10_i16.to_be_bytes()]), "");
    assert_eq!(print(b"\\F", &[]), "", "nothing is on the page");
    assert_eq!(print(b"five\\x", &[]), "  page 10\n  five");
    assert_eq!(print(b" six", &[]), " six\n", "the line goes on");
    assert_eq!(print(b"\\F", &[]), format!("\n{}", foot(10)), "the foot is at the foot");
    assert_eq!(print(b"seven\\x", &[]), "  page 11\n  seven");
    assert_eq!(print(b"\\Feight", &[]), format!("\n\n{}  page 12\n  eight\n", foot(11)));
}

#[test]
fn an_endless_page_has_no_form_feed() {
    let mut printer = printer(&[("lines_per_page", Value::Int(0)), ("character_set", "ibm-850".into())]);
    for _ in 0..300 {
        assert_eq!(printer.print(&job(b"\xFCber", &[])).map(|printout| printout.bytes), Ok(b"\x81ber\r\n".to_vec()));
    }
    assert_eq!(printer.print(&job(b"\\F", &[])).map(|printout| printout.bytes), Ok(b"\x0C".to_vec()));
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    /// Whatever the value: what is printed can be read back, and it keeps its width.
    #[test]
    fn what_is_printed_is_the_value(bits: u32, width in 1..=50_usize, left: bool, places in 0..=12_i32) {
        let bytes = bits.to_be_bytes();
        let show = |format: &str, bytes: &[u8]| shown(format, &[bytes]);
        prop_assert_eq!(show("%I", &bytes), ((bits as i32).to_string(), 0));
        prop_assert_eq!(show("%I", &bytes[2..]), ((bits as i16).to_string(), 0));
        prop_assert_eq!(show("%U", &bytes), (bits.to_string(), 0));
        prop_assert_eq!(show("%X", &bytes), (format!("{bits:032b}"), 0));
        prop_assert_eq!(show("%H", &bytes), (format!("{bits:08X}"), 0));
        let value = f32::from_bits(bits);
        let (text, status) = show(&format!("%.{places}R"), &bytes);
        if value.is_finite() {
            let (read, value) = (text.parse::<f64>().expect("a number"), f64::from(value));
            // Half of the last of its digits.
            let error = 0.5 * value.abs() * 10_f64.powi(1 - places.max(1));
            prop_assert!((read - value).abs() <= 1.000_001 * error, "{} is printed as {}", value, text);
        } else {
            prop_assert_eq!(status, 0x050C);
        }
        for display in ["I", "U", "X", "H", "F", "R", "T"] {
            let (whole, fault) = show(&format!("%{display}"), &bytes);
            let flag = if left { "-" } else { "" };
            let (text, status) = show(&format!("%{flag}{width}{display}"), &bytes);
            let fits = fault == 0 && whole.len() <= width;
            prop_assert_eq!(text.len(), width);
            prop_assert_eq!(status, if fault != 0 { fault } else if fits { 0 } else { 0x050D });
            if fits {
                prop_assert_eq!(if left { text.trim_end() } else { text.trim_start() }, whole);
            }
        }
    }
}

/// Any bytes at all: no panic, and what is printed is bounded.
#[test]
fn any_job_ends() {
    let mut random = fastrand::Rng::with_seed(0x2545_F491_4F6C_DD1D);
    let mut byte = || {
        let signs = b"%\\.-0123456789NSIFPxFBb\n\r";
        if random.u8(..4) == 0 { random.u8(..) } else { signs[random.usize(..signs.len())] }
    };
    let mut printer = printer(&[("texts", "1 %S %Z \\F %255C %-1I\n".into()), ("header_1", "%P\\".into())]);
    for round in 0..20_000 {
        let format: Vec<u8> = (0..round % 151).map(|_| byte()).collect();
        let variables: Vec<Vec<u8>> = (0..round % 5).map(|_| (0..1 + round % 8).map(|_| byte()).collect()).collect();
        let variables: Vec<&[u8]> = variables.iter().map(Vec::as_slice).collect();
        if let Ok(printout) = printer.print(&job(&format, &variables)) {
            assert!(printout.bytes.len() <= 4096, "{format:02X?}");
        }
    }
}
