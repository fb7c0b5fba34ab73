//! The parameters of a CP 340: those of a CP 341 with narrower limits, without RK 512 and loadable drivers. [CP 340
//! manual 04/2011, p. 64, 67, 72]

use ob1_serial::Span;

use crate::keyed::{CHARACTER, CLEAR, Key341, Protocols, baud, choice, number};
use crate::keys_3964::{ATTEMPTS, qvz, zvz_of_3964};
use crate::{cp341_ascii, printer};

/// Longest telegram of a CP 340 in bytes. [CP 340 manual 04/2011, p. 67]
const LONGEST: i64 = 1024;

/// Shortest ZVZ of ASCII, and its default, in milliseconds. [CP 340 manual 04/2011, p. 67]
const ZVZ_MS: i64 = 4;

/// The character frame. [CP 340 manual 04/2011, p. 64]
const FRAME: &[Key341] = &[baud(&["2400", "4800", "9600", "19200"]), CHARACTER[0], CHARACTER[1], CHARACTER[2]];

/// The manual prints 20 ms as default of ZVZ, but its text says 220 ms; here it is 220. [CP 340 manual 04/2011, p. 64]
const S3964: &[Key341] = &[zvz_of_3964(10), qvz(10), ATTEMPTS[0], ATTEMPTS[1], ATTEMPTS[2]];

/// [CP 340 manual 04/2011, p. 67]
const LIMITS: &[Key341] = &[
    number(
        "zvz_ms",
        (ZVZ_MS, 65_535, 1),
        "",
        "ZVZ: longest pause between two characters of a telegram; 4 at 9600 baud",
    ),
    cp341_ascii::length(LONGEST),
];

/// [CP 340 manual 04/2011, p. 72]
const BUFFER: &[Key341] =
    &[choice(CLEAR, &["yes", "no"], "yes", "the receive buffer is emptied at each start-up of the CPU")];

/// The protocols, by name, with the rows that belong to each.
pub const PROTOCOLS_340: Protocols = &[
    (cp341_ascii::NAME, &[FRAME, cp341_ascii::CRITERION, LIMITS, cp341_ascii::FLOW, cp341_ascii::DRIVER, BUFFER]),
    ("3964", &[FRAME, S3964, BUFFER]),
    ("3964r", &[FRAME, S3964, BUFFER]),
    (printer::NAME, &[FRAME, cp341_ascii::FLOW, printer::DRIVER]),
];

/// "The minimum character delay time is the time required to transfer 4 characters", in whole milliseconds: 4 at 9600
/// baud, like the table's default. [CP 340 manual 04/2011, p. 67]
pub(crate) fn least_zvz_ms(char_time: Span) -> i64 {
    (4 * char_time).millis() as i64
}

/// 4 ms, or the shortest possible time if that is longer. (ours below 9600 baud)
pub(crate) fn default_zvz_ms(char_time: Span) -> i64 {
    least_zvz_ms(char_time).max(ZVZ_MS)
}

#[cfg(test)]
mod tests {
    use crate::cp341::{Cp341, Protocol341};
    use crate::cp341_ascii::EndOf341;
    use crate::module_types::CpKind;
    use crate::parameter_bytes::Value;

    fn cp(protocol: &str, keys: &[(&str, Value)]) -> Result<Cp341, String> {
        let keys = [("protocol", Value::from(protocol))].into_iter().chain(keys.iter().cloned());
        Cp341::of_kind(CpKind::Cp340, keys).map_err(|error| error.to_string())
    }

    #[test]
    fn defaults_are_the_manuals() {
        let Ok(cp) = cp("ascii", &[]) else { panic!("parameters") };
        let Protocol341::Ascii(ascii) = &cp.protocol else { panic!("{:?}", cp.protocol) };
        assert_eq!((cp.kind, cp.line.to_string().as_str()), (CpKind::Cp340, "9600 8E1"));
        assert_eq!((ascii.zvz_ms, ascii.receive_buffers, ascii.overwrites, ascii.clear_buffer), (4, 250, false, true));
        for (protocol, qvz) in [("3964", 550), ("3964r", 2000)] {
            let cp = self::cp(protocol, &[]).expect("parameters");
            let Protocol341::S3964(p) = &cp.protocol else { panic!("{:?}", cp.protocol) };
            assert_eq!((p.zvz_ms, p.qvz_ms, p.connect_attempts, p.block_attempts, p.rk512), (220, qvz, 6, 6, false));
            assert!(p.clear_buffer);
        }
    }

    #[test]
    fn zvz_is_four_characters_at_least() {
        for (baud, default) in [(2400, 18), (4800, 9), (9600, 4), (19_200, 4)] {
            let baud = ("baud", Value::Int(baud));
            let cp = self::cp("ascii", std::slice::from_ref(&baud)).expect("parameters");
            let Protocol341::Ascii(ascii) = &cp.protocol else { panic!("{:?}", cp.protocol) };
            assert_eq!(ascii.zvz_ms, default);
            assert!(self::cp("ascii", &[baud.clone(), ("zvz_ms", Value::Int(default.into()))]).is_ok());
            let shorter = self::cp("ascii", &[baud, ("zvz_ms", Value::Int(i64::from(default) - 1))]);
            assert!(shorter.is_err_and(|error| error.contains("zvz_ms")));
        }
    }

    #[test]
    fn what_a_cp_340_does_not_have_is_refused() {
        for (protocol, keys, says) in [
            ("3964r-rk512", None, "ascii, 3964, 3964r, printer"),
            ("modbus-ascii-master-32", None, "ascii, 3964, 3964r, printer"),
            ("3964r", Some(("baud", Value::Int(38_400))), "2400, 4800, 9600, 19200"),
            ("3964r", Some(("zvz_ms", Value::Int(0))), "the nearest is 10"),
            ("3964r", Some(("reaction", Value::from("20s"))), "remove it"),
        ] {
            let error = cp(protocol, keys.as_slice()).expect_err("refused");
            assert!(error.contains(says), "{protocol}: {error}");
        }
        let by_length = |length| cp("ascii", &[("end_criterion", "length".into()), ("length", Value::Int(length))]);
        assert!(by_length(1025).is_err_and(|error| error.contains("the nearest is 1024")));
        let Ok(Protocol341::Ascii(ascii)) = by_length(1024).map(|cp| cp.protocol) else { panic!("refused") };
        assert_eq!(ascii.end, EndOf341::Length(1024));
    }
}
