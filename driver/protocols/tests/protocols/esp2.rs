//! EnOcean: every telegram table of the manuals, resynchronization, and the machine in virtual time.

use ob1_protocols::esp2::frame::{Bytes, Decoder, FRAME_BYTES, Step, TELEGRAM_BYTES, check_sum, encode};
use ob1_protocols::esp2::{Button, Command, Config, Esp2, Field, Message, Radio, SEND_TELEGRAMS, Switch, Telegram};
use ob1_protocols::{Input, Instant, LineInput, Machine, Order};
use proptest::prelude::*;

use crate::common;
use crate::common::check;

fn bytes(hex: &str) -> Bytes {
    let list: Vec<u8> = hex.split_whitespace().map(|b| u8::from_str_radix(b, 16).expect("a byte")).collect();
    list.try_into().unwrap_or_else(|list: Vec<u8>| panic!("{} bytes: {hex}", list.len()))
}

const AI: Button = Button { rocker: 0, o: false };
const BO: Button = Button { rocker: 1, o: true };
const DO: Button = Button { rocker: 3, o: true };
const ID: u32 = 0x0012_34C8;

fn rps(switch: Switch) -> Telegram {
    Telegram::Received(Radio::Rps { switch, type_2: true, id: ID, repeater: 0 })
}

/// The tables of S1 from "Description of ORG field" on, in their order: bytes, text, value. X is 00.
fn tables() -> Vec<(&'static str, &'static str, Telegram)> {
    use {Command as C, Message as M, Telegram as T};
    let n = |button, pressed, second, second_action| rps(Switch::N { button, pressed, second, second_action });
    vec![
        // RPS, N-messages
        ("0B 05 10 00 00 00 00 12 34 C8 30", "received RPS 001234C8 AI pressed", n(AI, true, AI, false)),
        ("0B 05 70 00 00 00 00 12 34 C8 30", "received RPS 001234C8 BO pressed", n(BO, true, AI, false)),
        ("0B 05 1F 00 00 00 00 12 34 C8 30", "received RPS 001234C8 AI and DO pressed", n(AI, true, DO, true)),
        ("0B 05 E0 00 00 00 00 12 34 C8 30", "received RPS 001234C8 DO released", n(DO, false, AI, false)),
        // RPS, U-messages, and a PTM type 1 after a repeater of level 2
        (
            "0B 05 70 00 00 00 00 12 34 C8 20",
            "received RPS 001234C8 buttons 3 pressed",
            rps(Switch::U { buttons: 3, pressed: true }),
        ),
        (
            "0B 05 00 00 00 00 00 12 34 C8 02",
            "received RPS 001234C8 buttons 0 released, repeated 2",
            T::Received(Radio::Rps {
                switch: Switch::U { buttons: 0, pressed: false },
                type_2: false,
                id: ID,
                repeater: 2,
            }),
        ),
        (
            "6B 05 10 00 00 00 FF 80 00 05 30",
            "send RPS FF800005 AI pressed",
            T::Transmit(Radio::Rps {
                switch: Switch::N { button: AI, pressed: true, second: AI, second_action: false },
                type_2: true,
                id: 0xFF80_0005,
                repeater: 0,
            }),
        ),
        // 1BS, 4BS, HRC
        (
            "0B 06 A5 00 00 00 00 12 34 C8 01",
            "received 1BS 001234C8 A5, repeated 1",
            T::Received(Radio::Bs1 { data: 0xA5, id: ID, repeater: 1 }),
        ),
        (
            "0B 07 03 02 01 0A 00 12 34 C8 0F",
            "received 4BS 001234C8 1 2 3, inputs 0A, repeated 15",
            T::Received(Radio::Bs4 { analog: [1, 2, 3], digital: 0x0A, id: ID, repeater: 15 }),
        ),
        (
            "0B 08 78 00 00 00 00 12 34 C8 00",
            "received HRC 001234C8 BO pressed, store",
            T::Received(Radio::Hrc { button: BO, pressed: true, store: true, id: ID, repeater: 0 }),
        ),
        (
            "0B 08 00 00 00 00 00 12 34 C8 00",
            "received HRC 001234C8 AI released",
            T::Received(Radio::Hrc { button: AI, pressed: false, store: false, id: ID, repeater: 0 }),
        ),
        // 6DT, MDA
        (
            "6B 0A 05 04 03 02 01 00 12 34 00",
            "send 6DT to modem 1234",
            T::Transmit(Radio::Modem { data: [5, 4, 3, 2, 1, 0], address: 0x1234, repeater: 0 }),
        ),
        (
            "0B 0B 00 00 00 00 12 34 00 00 00",
            "received MDA of modem 1234",
            T::Received(Radio::ModemAck { address: 0x1234, repeater: 0 }),
        ),
        // Commands and messages
        ("8B 89 45 6E 4F 63 65 61 6E 00 00", "INF_INIT \"EnOcean\"", T::Message(M::InfInit(*b"EnOcean\0\0"))),
        ("8B 58 00 00 00 00 00 00 00 00 00", "OK", T::Message(M::Ok)),
        ("8B 19 00 00 00 00 00 00 00 00 00", "ERR", T::Message(M::Err)),
        ("AB 58 00 00 00 00 00 00 00 00 00", "RD_IDBASE", T::Command(C::RdIdBase)),
        ("AB 18 FF 80 00 80 00 00 00 00 00", "SET_IDBASE FF800080", T::Command(C::SetIdBase(0xFF80_0080))),
        ("8B 98 FF 80 00 80 00 00 00 00 00", "INF_IDBASE FF800080", T::Message(M::InfIdBase(0xFF80_0080))),
        ("AB 08 01 00 00 00 00 00 00 00 00", "SET_RX_SENSITIVITY high", T::Command(C::SetRxSensitivity(true))),
        ("AB 48 00 00 00 00 00 00 00 00 00", "RD_RX_SENSITIVITY", T::Command(C::RdRxSensitivity)),
        ("8B 88 00 00 00 00 00 00 00 00 00", "INF_RX_SENSITIVITY low", T::Message(M::InfRxSensitivity(false))),
        ("AB 09 00 00 00 00 00 00 00 00 00", "SLEEP", T::Command(C::Sleep)),
        ("AB 0A 00 00 00 00 00 00 00 00 00", "RESET", T::Command(C::Reset)),
        ("AB 28 12 34 00 00 00 00 00 00 00", "MODEM_ON 1234", T::Command(C::ModemOn(0x1234))),
        ("AB 2A 00 00 00 00 00 00 00 00 00", "MODEM_OFF", T::Command(C::ModemOff)),
        ("AB 68 00 00 00 00 00 00 00 00 00", "RD_MODEM_STATUS", T::Command(C::RdModemStatus)),
        (
            "8B A8 01 12 34 00 00 00 00 00 00",
            "INF_MODEM_STATUS on, ID 1234",
            T::Message(M::InfModemStatus { on: true, id: 0x1234 }),
        ),
        ("AB 4B 00 00 00 00 00 00 00 00 00", "RD_SW_VER", T::Command(C::RdSwVer)),
        ("8B 8C 01 00 01 10 00 00 00 00 00", "INF_SW_VER 1.0.1.16", T::Message(M::InfSwVer([1, 0, 1, 16]))),
        ("8B 28 00 00 00 00 00 00 00 00 00", "ERR_MODEM_NOTWANTEDACK", T::Message(M::ErrModemNotWantedAck)),
        ("8B 29 00 00 00 00 00 00 00 00 00", "ERR_MODEM_NOTACK", T::Message(M::ErrModemNotAck)),
        ("8B 0C 00 00 00 00 00 00 00 00 00", "ERR_MODEM_DUP_ID", T::Message(M::ErrModemDupId)),
        ("8B 08 00 00 00 00 00 00 00 00 00", "ERR_SYNTAX in H_SEQ", T::Message(M::ErrSyntax(Field::HSeq))),
        ("8B 0B 00 00 00 00 00 00 00 00 00", "ERR_SYNTAX in ORG", T::Message(M::ErrSyntax(Field::Org))),
        ("8B 09 00 00 00 00 00 00 00 00 00", "ERR_SYNTAX in LENGTH", T::Message(M::ErrSyntax(Field::Length))),
        ("8B 0A 00 00 00 00 00 00 00 00 00", "ERR_SYNTAX in CHKSUM", T::Message(M::ErrSyntax(Field::ChkSum))),
        ("8B 22 00 00 00 00 00 00 00 00 00", "ERR_TX_IDRANGE", T::Message(M::ErrTxIdRange)),
        ("8B 1A 00 00 00 00 00 00 00 00 00", "ERR_IDRANGE", T::Message(M::ErrIdRange)),
        // In no table
        (
            "0B 09 01 02 03 04 05 06 07 08 09",
            "unknown, H_SEQ 0B ORG 09",
            T::Unknown([0x0B, 9, 1, 2, 3, 4, 5, 6, 7, 8, 9]),
        ),
    ]
}

#[test]
fn the_tables_of_the_manuals() {
    for (hex, text, value) in tables() {
        assert_eq!(Telegram::parse(&bytes(hex)), value, "{hex}");
        assert_eq!(value.emit(), bytes(hex), "{value:?}");
        assert_eq!(value.to_string(), text);
    }
}

#[test]
fn what_does_not_count_is_not_looked_at() {
    let noise = "0B 0B 11 22 33 44 12 34 55 66 F3";
    let acknowledge = Telegram::Received(Radio::ModemAck { address: 0x1234, repeater: 3 });
    assert_eq!(Telegram::parse(&bytes(noise)), acknowledge, "MDA: don't care");
    let switch = Telegram::parse(&bytes("0B 05 10 11 22 33 00 12 34 C8 F0"));
    assert_eq!(switch, Telegram::parse(&bytes("0B 05 10 00 00 00 00 12 34 C8 30")));
    assert_eq!(Telegram::parse(&bytes("AB 58 FF FF FF FF FF FF FF FF FF")), Telegram::Command(Command::RdIdBase));
}

/// The check sum, computed by hand: 0B+05+70+00+12+34+C8+30 = 1BEh.
#[test]
fn a_frame_is_fourteen_bytes() {
    let frame = encode(&bytes("0B 05 70 00 00 00 00 12 34 C8 30"));
    assert_eq!(frame, [0xA5, 0x5A, 0x0B, 0x05, 0x70, 0, 0, 0, 0, 0x12, 0x34, 0xC8, 0x30, 0xBE]);
}

/// The frames among these characters.
fn found(characters: &[u8]) -> Vec<Bytes> {
    let mut decoder = Decoder::new();
    let step = |byte: &u8| match decoder.feed(*byte) {
        Step::Telegram(telegram) => Some(telegram),
        _ => None,
    };
    characters.iter().filter_map(step).collect()
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn any_bytes_are_a_telegram(raw: Bytes) {
        let telegram = Telegram::parse(&raw);
        let emitted = telegram.emit();
        prop_assert_eq!(emitted[..2].to_vec(), raw[..2].to_vec());
        prop_assert_eq!(Telegram::parse(&emitted), telegram);
    }

    /// A frame is found after any characters, even after a frame that has lost its end; then the next one.
    #[test]
    fn a_frame_is_found_behind_anything(mut noise: Vec<u8>, cut in 0..FRAME_BYTES, telegram: [u8; 10]) {
        let mut wanted: Bytes = [0x0B; TELEGRAM_BYTES];
        wanted[1..].copy_from_slice(&telegram);
        // By chance noise may begin a frame that swallows the first one, but never the second as well.
        noise.extend(&encode(&wanted)[..cut]);
        for _ in 0..2 {
            noise.extend(encode(&wanted));
        }
        prop_assert!(found(&noise).contains(&wanted), "{noise:02X?}");
    }
}

#[test]
fn a_frame_behind_a_mutilated_one_is_not_lost() {
    let wanted = bytes("0B 05 70 00 00 00 00 12 34 C8 30");
    let whole = encode(&wanted);
    for cut in 0..FRAME_BYTES {
        let characters = [&whole[..cut], &whole[..]].concat();
        assert_eq!(found(&characters), [wanted], "cut behind {cut}");
    }
    let mut wrong = whole;
    wrong[FRAME_BYTES - 1] ^= 1;
    assert_eq!(found(&[wrong, whole].concat()), [wanted], "check sum");
    assert_eq!(found(&[0xA5, 0xA5, 0x5A, 0x5A, 0xA5]), [] as [Bytes; 0]);
    let inside = bytes("0B 07 A5 5A 0B 05 A5 5A 0B A5 5A");
    assert_eq!(found(&encode(&inside)), [inside], "synchronization bytes among the data");
    assert_eq!(check_sum(&[0xFF; TELEGRAM_BYTES]), 0xF5);
}

/// The request for the ID base.
const RD_IDBASE: &str = "A5 5A AB 58 0 0 0 0 0 0 0 0 0 03";
/// Its answer: FF800080, where bits 6..0 are ignored.
const INF_IDBASE: &str = "A5 5A 8B 98 FF 80 00 FF 0 0 0 0 0 A1";

fn machine(table: &str) {
    let table = table.replace("RD_IDBASE", RD_IDBASE).replace("INF_IDBASE", INF_IDBASE);
    check(&mut Esp2::new(Config::cp240()), &table);
}

#[test]
fn the_id_base_is_asked_for_and_ored_with_the_last_seven_bits() {
    machine(
        "0   start               => tx RD_IDBASE
         1   order 6B 05 2 0 0 0 0 0 32 67 06 => sent ok   # FC 101 of the manual; waits for the ID base
         15  done
         30  rx INF_IDBASE       => tx A5 5A 6B 05 2 0 0 0 FF 80 00 E7 06 DE   # 80 OR 67
         31  order AA            => sent ok
         45  done                => tx AA                  # WAKE: one byte
         46  done
         47  order 6B 0A 5 4 3 2 1 0 12 34 0 => sent ok, tx A5 5A 6B 0A 5 4 3 2 1 0 12 34 0 CA   # 6DT has no ID
         61  done
         62  order AB 58 0 0 0 0 0 0 0 0 0 => sent ok, tx RD_IDBASE
         77  done
         90  rx INF_IDBASE       => got 8B 98 FF 80 00 FF 0 0 0 0 0   # this one the program has asked for",
    );
}

#[test]
fn a_module_that_does_not_tell_its_id_base() {
    machine(
        "0   start               => tx RD_IDBASE
         15  done
         250 timeout             => !Connect: Repetition(1), tx AA RD_IDBASE   # it may sleep
         251 order 6B 06 2 0 0 0 12 34 56 78 0 => sent ok
         266 done
         500 timeout             => !Connect: Repetition(2), tx AA RD_IDBASE
         515 done
         750 timeout             => !Connect: AckDelay, tx A5 5A 6B 06 2 0 0 0 12 34 56 78 0 87   # as the program has written it
         765 done
         900 fault Gone          => !Idle: Line(Gone)",
    );
}

#[test]
fn what_is_received_and_what_is_not() {
    machine(
        "0   start               => tx RD_IDBASE
         15  done
         30  rx INF_IDBASE
         40  rx A5 5A 0B 05 70 0 0
         45  rx 0 0 12 34 C8 30 BE => got 0B 05 70 0 0 0 0 12 34 C8 30   # in two pieces
         60  rx 55 55 A5 5A 0B 05 70 0 0 0 0 12 34 C8 30 BF => !Idle: Unexpected(85), !Receive: BadCheck { computed: 190, received: 191 }
         70  rx A5 5A 0B 05
         320 timeout             => !Receive: CharacterDelay
         330 rx A5 5A 0B 05
         331 fault Framing       => !Receive: Line(Framing)
         340 rx A5 5A 0B 05 70 0 0 0 0 12 34 C8 30 BE => got 0B 05 70 0 0 0 0 12 34 C8 30
         350 room 10
         360 rx A5 5A 0B 05 70 0 0 0 0 12 34 C8 30 BE => !Receive: NoBuffer   # new ones are ignored
         370 room 11
         380 rx A5 5A 0B 05 70 0 0 0 0 12 34 C8 30 BE => got 0B 05 70 0 0 0 0 12 34 C8 30",
    );
}

#[test]
fn telegrams_of_other_lengths_are_refused() {
    machine(
        "0   start               => tx RD_IDBASE
         1   order 55            => sent Frame
         2   order 10*6B         => sent Frame
         3   order 12*6B         => sent TooLong",
    );
}

/// 2048 bytes hold 146 frames; the 147th waits for a place, and waiting telegrams are dropped when the line is lost.
#[test]
fn the_send_buffer_is_finite() {
    assert_eq!(SEND_TELEGRAMS, 146);
    let mut machine = Esp2::new(Config::cp240());
    let mut out = common::Recorder { room: 1024, ..Default::default() };
    let order = [0x6B, 5, 0, 0, 0, 0, 0, 0, 0, 0, 0];
    machine.step(Instant::START, Input::Tick, &mut out);
    for n in 0..SEND_TELEGRAMS {
        assert!(!machine.busy());
        machine.step(Instant::from_nanos(1), Input::Order(Order::Send(&order)), &mut out);
        assert_eq!((out.log.last().map(String::as_str), machine.waiting()), (Some("sent ok"), n + 1));
    }
    out.log.clear();
    machine.step(Instant::from_nanos(2), Input::Order(Order::Send(&order)), &mut out);
    assert!(machine.busy() && out.log.is_empty());
    machine.step(Instant::from_nanos(3), Input::Order(Order::Send(&order)), &mut out);
    assert_eq!(out.log, ["sent Busy"]);
    out.log.clear();
    machine.step(Instant::from_nanos(4), Input::Line(LineInput::TxDone), &mut out);
    let answer = encode(&Telegram::Message(Message::InfIdBase(0xFF80_0000)).emit());
    machine.step(Instant::from_nanos(5), Input::Line(LineInput::Rx(&answer)), &mut out);
    assert_eq!(out.log, ["tx A5 5A 6B 05 00 00 00 00 FF 80 00 00 00 EF", "sent ok"]);
    assert_eq!((machine.waiting(), machine.busy(), machine.id_base()), (146, false, Some(0xFF80_0000)));
    out.log.clear();
    machine.step(Instant::from_nanos(6), Input::Order(Order::Send(&order)), &mut out);
    machine.step(Instant::from_nanos(7), Input::Order(Order::Abort), &mut out);
    assert_eq!((out.log.join(", "), machine.waiting()), ("back, sent Aborted".into(), 0));
}

#[test]
fn a_line_that_goes_takes_what_waits_with_it() {
    machine(
        "0   start               => tx RD_IDBASE
         1   order 6B 05 2 0 0 0 0 0 32 67 06 => sent ok
         2   fault Gone          => !Idle: Line(Gone)
         3   rx INF_IDBASE
         15  done
         20  order 6B 06 2 0 0 0 0 0 0 1 0 => sent ok, tx A5 5A 6B 06 2 0 0 0 FF 80 00 81 0 73",
    );
}
