//! The codecs of Modbus: check values, decoding of what was encoded, and tolerance of any input.

use ob1_protocols::modbus::pdu::{self, Direction, Exception, Function, Match, Request};
use ob1_protocols::modbus::{FRAME_CHARACTERS, Failure, Mode, TELEGRAM_BYTES, ascii, rtu};
use proptest::prelude::*;

fn encode(mode: Mode, telegram: &[u8]) -> Vec<u8> {
    let mut frame = [0; FRAME_CHARACTERS];
    let len = mode.encode(telegram, &mut frame).expect("a telegram of permitted length");
    frame[..len].to_vec()
}

fn decode_ascii(frame: &[u8]) -> Result<Vec<u8>, Failure> {
    let mut telegram = [0; TELEGRAM_BYTES + 1];
    ascii::decode(frame, &mut telegram).map(|len| telegram[..len].to_vec())
}

/// Check values: CRC-16/MODBUS of "123456789" is 4B37h; the others from the Modbus specification and the manual's
/// example.
#[test]
fn check_values() {
    assert_eq!(rtu::crc(b"123456789"), 0x4B37);
    assert_eq!(encode(Mode::Rtu, &[0x02, 0x07]), [0x02, 0x07, 0x41, 0x12]);
    assert_eq!(encode(Mode::Rtu, &[1, 3, 0, 0, 0, 10]), [1, 3, 0, 0, 0, 10, 0xC5, 0xCD]);
    assert_eq!(encode(Mode::Ascii, &[1, 3, 0, 0, 0, 10]), b":01030000000AF2\r\n");
    assert_eq!(encode(Mode::Ascii, &[0xF7, 3, 0x13, 0x89, 0, 10]), b":F7031389000A60\r\n");
    // [S0 "Send block DB10"]
    let telegram: Vec<u8> = [5, 0x10, 0, 0, 0, 8, 0x10].into_iter().chain(0xA0..=0xAF).collect();
    assert_eq!(telegram.len(), 23);
    assert_eq!(rtu::decode(&encode(Mode::Rtu, &telegram)), Ok(&telegram[..]));
    assert_eq!(decode_ascii(&encode(Mode::Ascii, &telegram)), Ok(telegram));
}

/// The plain texts byte for byte; the first as the manual prints it. [S0 L2704-L2707]
#[test]
fn plain_texts() {
    let printed = [0x4552_524F_u32, 0x5200_0120, 0x4E4F_2044, 0x4154_4100].map(u32::to_be_bytes).concat();
    assert_eq!(Failure::NoData.telegram(), printed);
    let texts = ["NO DATA", "D LOST", "F OVERF", "F INCOM", "F FAULT", "F START"];
    for (n, (failure, text)) in Failure::ALL.into_iter().zip(texts).enumerate() {
        let expected = [b"ERROR\0", &[n as u8 + 1][..], b" ", text.as_bytes(), b"\0"].concat();
        assert_eq!(failure.telegram(), expected, "ERROR0{}", n + 1);
    }
}

#[test]
fn what_is_wrong_with_a_frame() {
    let table: [(&[u8], Failure); 11] = [
        (b"", Failure::Incomplete),
        (b"1103\r\n", Failure::Start),
        (b":01030000000AF2\r", Failure::Overflow),
        (b":01030000000AF2\n", Failure::Overflow),
        (b":01030000000AF\r\n", Failure::Incomplete),
        (b":01FF\r\n", Failure::Incomplete),
        (b":\r\n", Failure::Incomplete),
        (b":01030000000AF3\r\n", Failure::Fault),
        (b":01030000000aF2\r\n", Failure::Fault),
        (b":0103 000000AF2\r\n", Failure::Fault),
        (b":0103000000:0F2\r\n", Failure::Fault),
    ];
    for (frame, failure) in table {
        assert_eq!(decode_ascii(frame), Err(failure), "{}", String::from_utf8_lossy(frame));
    }
    assert_eq!(ascii::decode(b":01030000000AF2\r\n", &mut [0; 6]), Err(Failure::Overflow));
    assert_eq!(rtu::decode(&[1, 3, 0]), Err(Failure::Incomplete));
    assert_eq!(rtu::decode(&[1, 3, 0, 0, 0, 10, 0xC5, 0xCC]), Err(Failure::Fault));
    // CRC of nothing: neither address nor function code.
    assert_eq!(rtu::decode(&[0xFF, 0xFF]), Err(Failure::Incomplete));
}

#[test]
fn too_long_or_empty_is_not_sent() {
    let mut frame = [0; FRAME_CHARACTERS];
    for mode in [Mode::Rtu, Mode::Ascii] {
        assert_eq!(mode.encode(&[], &mut frame), None);
        assert!(mode.encode(&[0; TELEGRAM_BYTES], &mut frame).is_some());
        assert_eq!(mode.encode(&[0; TELEGRAM_BYTES + 1], &mut frame), None);
    }
    assert_eq!(rtu::encode(&[1, 2], &mut [0; 3]), None);
    assert_eq!(ascii::encode(&[1, 2], &mut [0; 8]), None);
}

/// [S0 "Modbus - Function codes"]: each command telegram, its meaning, and its length according to its first bytes.
#[test]
fn requests() {
    let good: [(&[u8], Request<'_>); 8] = [
        (&[9, 1, 0, 5, 0, 10], Request::ReadBits { input: false, first: 5, count: 10 }),
        (&[9, 2, 0x07, 0xD0, 0x07, 0xD0], Request::ReadBits { input: true, first: 2000, count: 2000 }),
        (&[9, 3, 0, 1, 0, 125], Request::ReadWords { input: false, first: 1, count: 125 }),
        (&[9, 4, 0, 0, 0, 1], Request::ReadWords { input: true, first: 0, count: 1 }),
        (&[9, 5, 0, 7, 0xFF, 0], Request::WriteBit { at: 7, on: true }),
        (&[9, 6, 0, 7, 0x12, 0x34], Request::WriteWords { first: 7, data: &[0x12, 0x34] }),
        (&[9, 15, 0, 3, 0, 9, 2, 0xFF, 1], Request::WriteBits { first: 3, count: 9, data: &[0xFF, 1] }),
        (&[9, 16, 0, 3, 0, 1, 2, 0xAB, 0xCD], Request::WriteWords { first: 3, data: &[0xAB, 0xCD] }),
    ];
    for (telegram, request) in good {
        assert_eq!(Request::parse(telegram), Ok(request));
        assert_eq!(pdu::length(Direction::Request, telegram, 2), Some(telegram.len()));
    }
    let bad: [(&[u8], Exception); 17] = [
        (&[9], Exception::Function),
        (&[9, 7], Exception::Function),
        (&[9, 0x83, 0, 0, 0, 1], Exception::Function),
        (&[9, 3, 0, 0], Exception::Value),
        (&[9, 1, 0, 0, 0, 0], Exception::Value),
        (&[9, 1, 0, 0, 0x07, 0xD1], Exception::Value),
        (&[9, 3, 0, 0, 0, 0], Exception::Value),
        (&[9, 3, 0, 0, 0, 126], Exception::Value),
        (&[9, 3, 0, 0, 0, 1, 0], Exception::Value),
        (&[9, 5, 0, 0, 0xFF, 1], Exception::Value),
        (&[9, 5, 0, 0, 1, 0], Exception::Value),
        (&[9, 6, 0, 0, 1], Exception::Value),
        (&[9, 15, 0, 0, 0, 9, 1, 0], Exception::Value),
        (&[9, 15, 0, 0, 0, 0, 0], Exception::Value),
        (&[9, 16, 0, 0, 0, 1, 2, 0], Exception::Value),
        (&[9, 16, 0, 0, 0, 2, 2, 0, 0], Exception::Value),
        (&[9, 16, 0, 0, 0, 0, 0], Exception::Value),
    ];
    for (telegram, exception) in bad {
        assert_eq!(Request::parse(telegram), Err(exception), "{telegram:02X?}");
    }
}

#[test]
fn answers_and_their_requests() {
    let write = |code| [9, code, 0, 3, 0, 1, 2, 0xAB, 0xCD];
    let table: [(&[u8], &[u8], Match); 24] = [
        (&[9, 1, 0, 0, 0, 10], &[9, 1, 2, 0, 0], Match::Answer),
        (&[9, 1, 0, 0, 0, 10], &[9, 1, 1, 0], Match::Foreign),
        (&[9, 2, 0, 0, 0, 8], &[9, 2, 1, 0], Match::Answer),
        (&[9, 3, 0, 0, 0, 1], &[9, 3, 2, 0, 0], Match::Answer),
        (&[9, 4, 0, 0, 0, 1], &[9, 4, 2, 0, 0], Match::Answer),
        (&[9, 4, 0, 0, 0, 1], &[9, 3, 2, 0, 0], Match::Foreign),
        (&[9, 4, 0, 0, 0, 1], &[8, 4, 2, 0, 0], Match::Foreign),
        (&[9, 4, 0, 0, 0, 1], &[9, 4, 2, 0], Match::Short),
        (&[9, 4, 0, 0, 0, 1], &[9, 4], Match::Short),
        (&[9, 4, 0, 0, 0, 1], &[9], Match::Short),
        (&[9, 4, 0, 0, 0, 1], &[9, 4, 2, 0, 0, 0], Match::Long),
        (&[9, 4, 0, 0, 0, 1], &[9, 0x84, 2], Match::Answer),
        (&[9, 4, 0, 0, 0, 1], &[9, 0x84], Match::Short),
        (&[9, 4, 0, 0, 0, 1], &[9, 0x84, 2, 0], Match::Long),
        (&[9, 4, 0, 0, 0, 1], &[9, 0x83, 2], Match::Foreign),
        (&[9, 5, 0, 1, 0xFF, 0], &[9, 5, 0, 1, 0xFF, 0], Match::Answer),
        (&[9, 5, 0, 1, 0xFF, 0], &[9, 5, 0, 1, 0, 0], Match::Foreign),
        (&[9, 6, 0, 1, 1, 2], &[9, 6, 0, 1, 1, 2], Match::Answer),
        (&write(15), &[9, 15, 0, 3, 0, 1], Match::Answer),
        (&write(16), &[9, 16, 0, 3, 0, 1], Match::Answer),
        (&write(16), &[9, 16, 0, 3, 0, 2], Match::Foreign),
        (&write(16), &[9, 16, 0, 3, 0], Match::Short),
        // None of the eight: accepted unchanged. With an announced error its length is known.
        (&[9, 0x17, 1, 2, 3], &[9, 0x17, 7, 7, 7, 7], Match::Answer),
        (&[9, 0x17, 1, 2, 3], &[9, 0x97, 1, 1], Match::Long),
    ];
    for (request, answer, expected) in table {
        assert_eq!(pdu::matches(request, answer, 2), expected, "{request:02X?} {answer:02X?}");
    }
}

/// 32-bit extensions: four bytes per register. [S4 L838-L842]
#[test]
fn registers_of_four_bytes() {
    assert_eq!(pdu::matches(&[9, 3, 0, 0, 0, 2], &[9, 3, 8, 1, 2, 3, 4, 5, 6, 7, 8], 4), Match::Answer);
    assert_eq!(pdu::matches(&[9, 3, 0, 0, 0, 2], &[9, 3, 4, 1, 2, 3, 4], 4), Match::Foreign);
    assert_eq!(pdu::matches(&[9, 6, 0, 0, 1, 2, 3, 4], &[9, 6, 0, 0, 1, 2, 3, 4], 4), Match::Answer);
    assert_eq!(pdu::matches(&[9, 6, 0, 0, 1, 2, 3, 4], &[9, 6, 0, 0, 1, 2, 3, 5], 4), Match::Foreign);
    assert_eq!(pdu::length(Direction::Request, &[9, 6], 4), Some(8));
    assert_eq!(pdu::length(Direction::Answer, &[9, 16], 4), Some(6));
}

#[test]
fn function_codes() {
    for code in 0..=255 {
        let function = Function::of(code);
        assert_eq!(function.is_some(), [1, 2, 3, 4, 5, 6, 15, 16].contains(&code));
        assert!(function.is_none_or(|f| f as u8 == code && f.writes() == [5, 6, 15, 16].contains(&code)));
    }
}

proptest! {
    #[test]
    fn frames_undo_themselves(telegram in proptest::collection::vec(any::<u8>(), 2..=TELEGRAM_BYTES)) {
        let frame = encode(Mode::Rtu, &telegram);
        prop_assert_eq!(rtu::decode(&frame), Ok(&telegram[..]));
        prop_assert_eq!(rtu::crc(&frame), 0);
        prop_assert_eq!(decode_ascii(&encode(Mode::Ascii, &telegram)), Ok(telegram));
    }

    /// One inverted bit is detected wherever it is: by the CRC always, by the LRC because it changes one digit.
    #[test]
    fn one_bit_is_found(telegram in proptest::collection::vec(any::<u8>(), 2..40), at in any::<prop::sample::Index>()) {
        for mode in [Mode::Rtu, Mode::Ascii] {
            let mut frame = encode(mode, &telegram);
            let bit = at.index(8 * frame.len());
            frame[bit / 8] ^= 1 << (bit % 8);
            match mode {
                Mode::Rtu => prop_assert_eq!(rtu::decode(&frame), Err(Failure::Fault)),
                Mode::Ascii => prop_assert!(decode_ascii(&frame).is_err(), "{}", String::from_utf8_lossy(&frame)),
            }
        }
    }

    #[test]
    fn nothing_is_too_much(bytes in proptest::collection::vec(any::<u8>(), 0..600), registers in 0_usize..5) {
        let _ = rtu::decode(&bytes);
        let _ = decode_ascii(&bytes);
        let _ = Request::parse(&bytes);
        for direction in [Direction::Request, Direction::Answer] {
            let _ = pdu::length(direction, &bytes, registers);
        }
        let (request, answer) = bytes.split_at(bytes.len() / 2);
        let _ = pdu::matches(request, answer, registers);
    }
}
