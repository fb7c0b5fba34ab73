//! ASCII of the CP 341 (and the block check of 3964R) through a whole CP: end criteria, receive buffer, sending, and
//! errors with their numbers at P_SND_RK or P_RCV_RK and in the diagnostic buffer.
//! [TIA help "Configuration for point-to-point links"] (docs/cp341-events.md)

use ob1_firmware::Counter;
use ob1_params::Value;

use crate::cp341_bench::{Bench, Got, MS};

/// ASCII at 9600 8E1 with these keys.
fn ascii(keys: &[(&str, Value)]) -> Bench {
    let all: Vec<(&str, Value)> = [("protocol", "ascii".into())].into_iter().chain(keys.iter().cloned()).collect();
    Bench::new(&all)
}

/// CR LF ends a telegram.
fn by_end(keys: &[(&str, Value)]) -> Bench {
    let end = [
        ("end_criterion", "end-characters".into()),
        ("end_flags", Value::Int(2)),
        ("end_flag_1", Value::Int(13)),
        ("end_flag_2", Value::Int(10)),
    ];
    ascii(&end.into_iter().chain(keys.iter().cloned()).collect::<Vec<_>>())
}

fn telegram(text: &[u8]) -> Got {
    Got::Telegram(text.to_vec())
}

// ---- receiving ----

#[test]
fn a_bar_code_reader() {
    let mut bench = by_end(&[]);
    bench.has_said(b"4006381333931\r\n42\r\n");
    assert_eq!(bench.all(), [telegram(b"4006381333931\r\n"), telegram(b"42\r\n")], "at once, not after a silence");
    assert_eq!(bench.entries(), []);
}

/// "If ZVZ expires first: 0806h, fragment discarded." [TIA help "Configuration for point-to-point links"]
#[test]
fn a_telegram_without_its_end_is_0806h() {
    let mut bench = by_end(&[]);
    bench.has_said(b"40063\r");
    bench.pass(3 * MS);
    assert_eq!((bench.all(), bench.entries()), (vec![], vec![]), "ZVZ is 4 ms at 9600 baud");
    bench.pass(MS);
    assert_eq!((bench.all(), bench.entries()), (vec![Got::Error(0x0806)], vec![0x0806]));
    bench.has_said(b"42\r\n");
    assert_eq!(bench.all(), [telegram(b"42\r\n")]);
    let mut bench = ascii(&[("end_criterion", "length".into()), ("length", Value::Int(5)), ("zvz_ms", Value::Int(50))]);
    bench.has_said(b"123456789");
    assert_eq!(bench.all(), [telegram(b"12345")]);
    bench.pass(50 * MS);
    assert_eq!((bench.all(), bench.entries()), (vec![Got::Error(0x0806)], vec![0x0806]));
}

/// A character that cannot be read costs its telegram, because the partner does not repeat it.
#[test]
fn an_unreadable_character_is_told() {
    let mut bench = by_end(&[]);
    bench.has_said(b"40");
    bench.has_mumbled(b"06");
    bench.has_said(b"3\r\n42\r\n");
    assert_eq!(bench.all(), [Got::Error(0x080C), telegram(b"42\r\n")], "once a telegram");
    assert_eq!(bench.entries(), [0x080C], "one entry for both characters");
    bench.pass(20 * MS);
    bench.has_mumbled(b"06\r\n");
    assert_eq!((bench.all(), bench.entries()), (vec![Got::Error(0x080C)], vec![0x080C]), "another burst");
    bench.pass(20 * MS);
    bench.all();
    bench.entries();
    bench.breaks();
    bench.pass(20 * MS);
    assert_eq!((bench.all(), bench.entries()), (vec![Got::Error(0x080D)], vec![0x080D]));
}

/// The part of a 3964R frame that ASCII does not have: BCC. 0808h is entered with the NAK, and reported when the
/// partner does not repeat. (docs/cp341-events.md)
#[test]
fn a_wrong_block_check_character_is_0808h() {
    let mut bench = Bench::new(&[("protocol", "3964r".into())]);
    bench.pass(100 * MS);
    bench.heard();
    bench.has_said(&[0x02]);
    bench.pass(2 * MS);
    assert_eq!(bench.heard(), [0x10]);
    bench.has_said(&[0x41, 0x10, 0x03, 0xFF]);
    bench.pass(2 * MS);
    assert_eq!((bench.heard(), bench.all()), (vec![0x15], vec![]));
    assert!(bench.entries().contains(&0x0808));
    // 4 s for the repetition.
    bench.pass(5000 * MS);
    assert_eq!(bench.all(), [Got::Error(0x0808)]);
}

// ---- the receive buffer ----

/// 4096 bytes, oldest first; 080Ah when they are in use. [TIA help "Configuration for point-to-point links"]
#[test]
fn the_receive_buffer_holds_4096_bytes() {
    let mut bench = by_end(&[]);
    let long = |n: u8, bytes: usize| [vec![n; bytes - 2], b"\r\n".to_vec()].concat();
    for n in 1..=4 {
        bench.has_said(&long(n, 1000));
    }
    bench.has_said(&long(5, 97));
    assert_eq!(bench.entries(), [0x0408, 0x080A], "P_RCV_RK does not look; 4000 bytes are in use");
    bench.has_said(&long(6, 96));
    assert_eq!(bench.entries(), []);
    bench.has_said(b"7\r\n");
    assert_eq!(bench.entries(), [0x080A], "not one byte is free");
    // The telegram on offer comes first, because it was offered before the first error.
    let mut expected: Vec<Got> = (1..=4).map(|n| telegram(&long(n, 1000))).collect();
    expected.insert(1, Got::Error(0x080A));
    expected.insert(2, Got::Error(0x080A));
    expected.push(telegram(&long(6, 96)));
    assert_eq!(bench.all(), expected);
    bench.has_said(&long(8, 4096));
    assert_eq!(bench.all(), [telegram(&long(8, 4096))], "the longest telegram");
}

/// 0816h: longer than the buffer. (docs/cp341-events.md)
#[test]
fn a_telegram_longer_than_the_buffer_is_0816h() {
    let mut bench = by_end(&[("baud", Value::Int(115_200))]);
    bench.has_said(&[vec![b'x'; 4095], b"\r\n".to_vec()].concat());
    assert_eq!((bench.all(), bench.entries()), (vec![Got::Error(0x0816)], vec![0x0816]));
    bench.has_said(b"42\r\n");
    assert_eq!(bench.all(), [telegram(b"42\r\n")]);
}

/// 3964R: what is free of the buffer is too little for a block. That is not a block of a wrong length.
/// (080Ah and 0816h)
#[test]
fn a_block_that_finds_too_little_room_is_080ah() {
    let mut bench = Bench::new(&[("protocol", "3964r".into()), ("baud", Value::Int(115_200))]);
    bench.pass(100 * MS);
    bench.heard();
    for (length, answer) in [(4000, 0x10), (97, 0x15), (96, 0x10)] {
        bench.has_said(&[0x02]);
        bench.pass(2 * MS);
        assert_eq!(bench.heard(), [0x10]);
        let block: Vec<u8> = ob1_protocols::s3964::codec::block(&vec![b'x'; length], true).collect();
        bench.has_said(&block);
        bench.pass(2 * MS);
        assert_eq!(bench.heard(), [answer], "{length} bytes");
    }
    assert_eq!(bench.entries(), [0x080A, 0x0801], "the partner is to repeat it");
    assert_eq!(bench.all(), [telegram(&[b'x'; 4000]), Got::Error(0x080A), telegram(&[b'x'; 96])]);
}

/// [TIA help "Configuration for point-to-point links"]: 1 to 250 telegrams.
#[test]
fn as_many_telegrams_as_the_parameters_permit() {
    for (key, most) in [(None, 250), (Some(3), 3)] {
        let keys: Vec<(&str, Value)> = key.map(|n| ("receive_buffers", Value::Int(n))).into_iter().collect();
        let mut bench = by_end(&keys);
        for n in 0..most {
            bench.has_said(&[n as u8, 13, 10]);
        }
        assert_eq!(bench.entries(), []);
        bench.has_said(b"late\r\n");
        assert_eq!(bench.entries(), [0x080A], "{most} telegrams wait");
        let mut expected: Vec<Got> = (0..most).map(|n| telegram(&[n as u8, 13, 10])).collect();
        expected.insert(1, Got::Error(0x080A));
        assert_eq!(bench.all(), expected);
        bench.has_said(b"in time\r\n");
        assert_eq!(bench.all(), [telegram(b"in time\r\n")]);
    }
}

/// Telegrams received are delivered, dropped, or in the buffer.
fn balanced(bench: &Bench, in_buffer: u64) {
    let [received, delivered, dropped] =
        [Counter::TelegramsReceived, Counter::TelegramsDelivered, Counter::ReceiveAborted]
            .map(|counter| bench.count(counter));
    assert_eq!(received, delivered + dropped + in_buffer);
}

/// "1 telegram + no overwrite protection: always the newest telegram."
/// [TIA help "Configuration for point-to-point links"]
#[test]
fn the_newest_telegram_is_kept() {
    let mut bench = by_end(&[("receive_buffers", Value::Int(1)), ("prevent_overwriting", "no".into())]);
    // The first is offered at once, but P_RCV_RK does not look.
    bench.has_said(b"first\r\nsecond\r\nthird\r\n");
    assert_eq!(bench.entries(), []);
    // It gets the whole offered telegram, then the newest.
    assert_eq!(bench.all(), [telegram(b"first\r\n"), telegram(b"third\r\n")]);
    balanced(&bench, 0);
    // The telegram that is being taken is not mixed with another.
    let long = [vec![b'x'; 98], b"\r\n".to_vec()].concat();
    bench.has_said(&long);
    let length = bench.begin().expect("it is offered");
    bench.has_said(b"newer\r\n");
    bench.has_said(b"newest\r\n");
    assert_eq!(bench.finish(length), long);
    assert_eq!(bench.all(), [telegram(b"newest\r\n")]);
    balanced(&bench, 0);
    // Nobody takes it: the newest is offered in its place.
    bench.has_said(b"refused\r\nnext\r\n");
    bench.refuse();
    bench.pass(1000 * MS);
    assert_eq!(bench.all(), [telegram(b"next\r\n")]);
    bench.has_said(b"refused\r\n");
    bench.refuse();
    bench.pass(1000 * MS);
    assert_eq!(bench.all(), [telegram(b"refused\r\n")]);
    bench.has_said(b"on show\r\nafter EN_R\r\n");
    bench.pauses();
    assert_eq!(bench.all(), [telegram(b"after EN_R\r\n")]);
    balanced(&bench, 0);
    bench.has_said(b"stop\r\nwaits\r\n");
    bench.run(false);
    balanced(&bench, 1);
    bench.restart();
    assert_eq!(bench.all(), [telegram(b"waits\r\n")]);
    balanced(&bench, 0);
}

/// "CP 341: not cleared at CPU start; old telegrams are delivered first after RUN."
/// [TIA help "Configuration for point-to-point links"]
#[test]
fn the_receive_buffer_is_kept_through_a_stop() {
    let mut bench = by_end(&[]);
    bench.has_said(b"1\r\n2\r\n");
    bench.run(false);
    bench.has_said(b"3\r\n");
    bench.restart();
    bench.has_said(b"4\r\n");
    let all: Vec<Got> = (1..=4).map(|n| telegram(format!("{n}\r\n").as_bytes())).collect();
    assert_eq!(bench.all(), all);
    assert_eq!(bench.entries(), [0x0007, 0x0004, 0x0008]);
}

// ---- sending ----

/// The three ways of [TIA help "Configuration for point-to-point links"].
#[test]
fn sending_with_end_characters() {
    let mut bench = by_end(&[]);
    assert_eq!(bench.job(b"go\r\nrest"), Ok(()));
    assert_eq!(bench.heard(), b"go\r\n");
    assert_eq!(bench.job(b"no end\n"), Err(0x050E));
    assert_eq!((bench.heard(), bench.entries()), (vec![], vec![0x050E]));
    let mut bench = by_end(&[("sending", "whole".into())]);
    assert_eq!(bench.job(b"go\r\nrest"), Ok(()));
    assert_eq!(bench.heard(), b"go\r\nrest");
    let mut bench = by_end(&[("sending", "append-end".into())]);
    assert_eq!(bench.job(b"go"), Ok(()));
    assert_eq!(bench.heard(), b"go\r\n");
    assert_eq!(bench.job(&[b'x'; 4095]), Err(0x050E), "4097 characters");
    assert_eq!((bench.heard(), bench.entries()), (vec![], vec![0x050E]));
    assert_eq!(bench.job(&[b'x'; 4094]), Ok(()));
    assert_eq!(bench.heard().len(), 4096);
}

/// "A pause of at least ZVZ is kept between two telegrams (also between two FB 8 jobs)"; DONE comes before.
/// [TIA help "Configuration for point-to-point links"]
#[test]
fn two_jobs_are_parted_by_zvz() {
    let pause = |keys: &[(&str, Value)]| {
        let mut bench = ascii(&[&[("zvz_ms", Value::Int(100))], keys].concat());
        let begin = bench.now;
        assert_eq!(bench.job(b"1"), Ok(()));
        assert!(bench.now - begin < 10 * MS, "DONE when all characters are out");
        assert_eq!(bench.job(b"2"), Ok(()));
        let [(first, b'1'), (second, b'2')] = bench.heard[..] else { panic!("{:?}", bench.heard) };
        second - bench.char_time() - first
    };
    let length = ("end_criterion", Value::from("length"));
    assert_eq!(pause(&[]), 100 * MS);
    assert_eq!(pause(std::slice::from_ref(&length)), 100 * MS);
    assert!(pause(&[length, ("send_pause", "no".into())]) < 5 * MS);
    assert!(pause(&[("end_criterion", "end-characters".into()), ("sending", "whole".into())]) < 5 * MS);
}

/// 0708h: XOFF or CTS OFF for longer than the waiting time. [TIA help "Configuration for point-to-point links"]
#[test]
fn waiting_for_the_partner_ends_with_0708h() {
    let wait = ("flow_wait_ms", Value::Int(500));
    let mut bench = ascii(&[("flow", "xon-xoff".into()), wait.clone()]);
    assert_eq!(bench.heard(), [0x11], "XON after the parameters");
    bench.has_said(&[0x13]);
    let begin = bench.now;
    assert_eq!(bench.job(b"never"), Err(0x0708));
    assert!((500 * MS..510 * MS).contains(&(bench.now - begin)));
    assert_eq!((bench.heard(), bench.entries()), (vec![], vec![0x0708]));
    let mut bench = ascii(&[("flow", "rts-cts".into()), wait]);
    assert_eq!(bench.outputs(), (true, false), "RTS ON after the parameters");
    bench.switches(false, true);
    assert_eq!(bench.job(b"never"), Err(0x0708));
    bench.switches(true, true);
    assert_eq!(bench.job(b"now"), Ok(()));
    assert_eq!((bench.heard(), bench.entries()), (b"now".to_vec(), vec![0x0708]));
}

/// The partner is stopped when the number of telegrams is reached, and released when the CPU has taken one.
/// [TIA help "Configuration for point-to-point links"]
#[test]
fn the_partner_is_stopped_by_the_number_of_telegrams() {
    let keys = [("flow", Value::from("xon-xoff")), ("receive_buffers", Value::Int(2)), ("zvz_ms", Value::Int(10))];
    let mut bench = ascii(&keys);
    bench.heard();
    for text in [b"1", b"2"] {
        bench.has_said(text);
        bench.pass(15 * MS);
    }
    assert_eq!(bench.heard(), [0x13]);
    // A partner that does not obey: 080Ah, and the telegram is lost.
    bench.has_said(b"3");
    bench.pass(15 * MS);
    assert_eq!(bench.entries(), [0x080A]);
    assert_eq!(bench.all(), [telegram(b"1"), Got::Error(0x080A), telegram(b"2")]);
    bench.pass(20 * MS);
    assert_eq!(bench.heard(), [0x11]);
}
