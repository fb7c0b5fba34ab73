//! RK 512, branch by branch of the procedure's text, in virtual time.

use ob1_protocols::rk512::{Config, OrderError, Refusal, code};
use ob1_protocols::{MS, SECOND, Span, s3964};

use crate::defaults;
use crate::rk512_table;
use crate::rk512_table::{CHAR, SEND_8, check_cp240 as check, cp240};

/// Samples of a CP 240's manual, each telegram with its characters on the line, check character included.
/// [RE 240 manual 12/42, p. 3-24, 3-25]
#[test]
fn the_samples_to_the_byte() {
    for (payload, wire) in [
        ("00 00 41 44 05 01 00 08 FF FF 01..10", "00 00 41 44 05 01 00 08 FF FF 01..0F 10 10 10 03 1A"),
        ("00 00 00 00", "00 00 00 00 10 03 13"),
        ("00 00 45 4D 00 10 00 20 06 04", "00 00 45 4D 00 10 10 00 20 06 04 10 03 39"),
        ("00 00 00 32", "00 00 00 32 10 03 21"),
        ("FF 00 41 44", "FF 00 41 44 10 03 E9"),
        ("FF 00 00 00", "FF 00 00 00 10 03 EC"),
    ] {
        let block: Vec<u8> = s3964::codec::block(&rk512_table::bytes(payload), true).collect();
        assert_eq!(block, rk512_table::bytes(wire), "{payload}");
    }
    // The machine's own, character by character: SEND and its reaction, FETCH with flag M 6.4 and its refusal.
    rk512_table::check::<1024>(
        cp240(true),
        "0 start
         1 order 00 00 41 44 05 01 00 08 FF FF | 01..10 => tx STX
         2 done
         3 rx DLE => tx 00 00 41 44 05 01 00 08 FF FF 01..0F 10 10 10 03 1A
         40 done
         41 rx DLE
         50 rx STX => tx DLE
         51 done
         60 rx 00 00 00 00 10 03 13 => tx DLE; ended ok
         61 done
         70 order 00 00 45 4D 00 10 00 20 06 04 => tx STX
         71 done
         72 rx DLE => tx 00 00 45 4D 00 10 10 00 20 06 04 10 03 39
         90 done
         91 rx DLE
         95 rx STX => tx DLE
         96 done
         99 rx 00 00 00 32 10 03 21 => tx DLE; !0909; ended Rejected(32)",
    );
    rk512_table::check::<1024>(
        cp240(true),
        "0 start
         1 rx STX => tx DLE
         2 done
         9 rx 00 00 45 4D 00 10 10 00 20 06 04 10 03 39 => tx DLE; asked 00 00 45 4D 00 10 00 20 06 04
         10 done
         12 answer refused 32 => !060F; tx STX
         13 done
         14 rx DLE => tx 00 00 00 32 10 03 21
         20 done
         21 rx DLE => answered ok",
    );
}

/// [S0 "Logical message sequence"], [S0 "Structure of the output message"].
#[test]
fn send_in_one_telegram() {
    check(&format!(
        "10 order {SEND_8} | 01..10 => tx STX
         20 takes {SEND_8} 01..10
         30 partner 00 00 00 00 => ended ok"
    ));
    check(&format!(
        "10 partner {SEND_8} 01..10 => asked {SEND_8} | 01..10
         20 answer taken => tx STX
         30 takes 00 00 00 00 => answered ok"
    ));
}

/// [S0 "Structure of additional messages"]: more than 128 bytes.
#[test]
fn send_with_follow_on_telegrams() {
    // 130 words are 128 + 128 + 4 bytes.
    check(
        "10 order 00 00 41 44 0A 00 00 82 FF FF | 128*61 128*62 4*63 => tx STX
         20 takes 00 00 41 44 0A 00 00 82 FF FF 128*61
         30 partner 00 00 00 00 => tx STX
         40 takes FF 00 41 44 128*62
         50 partner FF 00 00 00 => tx STX
         60 takes FF 00 41 44 4*63
         70 partner FF 00 00 00 => ended ok",
    );
    check(
        "10 partner 00 00 41 44 0A 00 00 82 FF FF 128*61 => tx STX
         20 takes 00 00 00 00
         30 partner FF 00 41 44 128*62 => tx STX
         40 takes FF 00 00 00
         50 partner FF 00 41 44 4*63 => asked 00 00 41 44 0A 00 00 82 FF FF | 128*61 128*62 4*63
         60 answer taken => tx STX
         70 takes FF 00 00 00 => answered ok",
    );
    // Exactly 128 bytes are one telegram, and the split from a literal reading of the tables is accepted.
    // [CP 341 manual 09/2008, p. 57]
    check(
        "10 order 00 00 41 44 0A 00 00 40 FF FF | 128*61 => tx STX
         20 takes 00 00 41 44 0A 00 00 40 FF FF 128*61
         30 partner 00 00 00 00 => ended ok
         40 partner 00 00 41 44 0A 00 00 80 FF FF 118*61 => tx STX
         50 takes 00 00 00 00
         60 partner FF 00 41 44 124*62 => tx STX
         70 takes FF 00 00 00
         80 partner FF 00 41 44 14*63 => asked 00 00 41 44 0A 00 00 80 FF FF | 118*61 124*62 14*63",
    );
}

/// [S0 "Structure of the input message"].
#[test]
fn fetch() {
    check(
        "10 order 00 00 45 44 05 01 00 02 FF FF => tx STX
         20 takes 00 00 45 44 05 01 00 02 FF FF
         30 partner 00 00 00 00 AA BB CC DD => ended ok AA BB CC DD",
    );
    check(
        "10 partner 00 00 45 44 05 01 00 02 FF FF => asked 00 00 45 44 05 01 00 02 FF FF
         20 answer data AA BB CC DD => tx STX
         30 takes 00 00 00 00 AA BB CC DD => answered ok",
    );
    check(
        "10 order 00 00 45 44 0A 00 00 42 FF FF => tx STX
         20 takes 00 00 45 44 0A 00 00 42 FF FF
         30 partner 00 00 00 00 128*61 => tx STX
         40 takes FF 00 45 44
         50 partner FF 00 00 00 4*62 => ended ok 128*61 4*62",
    );
    check(
        "10 partner 00 00 45 44 0A 00 00 42 FF FF => asked 00 00 45 44 0A 00 00 42 FF FF
         20 answer data 128*61 4*62 => tx STX
         30 takes 00 00 00 00 128*61
         40 partner FF 00 45 44 => tx STX
         50 takes FF 00 00 00 4*62 => answered ok",
    );
    // Pieces of 2 bytes.
    check(
        "10 order 00 00 45 44 05 01 00 02 FF FF => tx STX
         20 takes 00 00 45 44 05 01 00 02 FF FF
         30 partner 00 00 00 00 AA BB => tx STX
         40 takes FF 00 45 44
         50 partner FF 00 00 00 CC DD => ended ok AA BB CC DD",
    );
}

/// Every area, with its length in the header. [CP 341 manual 09/2008, p. 51]
#[test]
fn fetch_of_every_area() {
    for (letter, units, bytes) in
        [("44", 2, 4), ("58", 2, 4), ("45", 2, 2), ("41", 2, 2), ("4D", 2, 2), ("5A", 2, 4), ("54", 2, 4)]
    {
        let db = if matches!(letter, "44" | "58") { "07" } else { "00" };
        let header = format!("00 00 45 {letter} {db} 03 00 {units:02X} FF FF");
        check(&format!(
            "10 order {header} => tx STX
             20 takes {header}
             30 partner 00 00 00 00 {bytes}*5A => ended ok {bytes}*5A
             40 partner {header} => asked {header}
             50 answer data {bytes}*A5 => tx STX
             60 takes 00 00 00 00 {bytes}*A5 => answered ok"
        ));
    }
}

/// [TIA help "PtP data link CP 341"]: a DX is `O D` on the line; `A X` is understood too.
#[test]
fn send_to_a_dx() {
    check(
        "10 order 00 00 4F 44 05 00 00 01 FF FF | 61 62 => tx STX
         20 takes 00 00 4F 44 05 00 00 01 FF FF 61 62
         30 partner 00 00 00 00 => ended ok
         40 partner 00 00 4F 44 05 00 00 01 FF FF 61 62 => asked 00 00 4F 44 05 00 00 01 FF FF | 61 62
         50 answer taken => tx STX
         60 takes 00 00 00 00 => answered ok
         70 partner 00 00 41 58 05 00 00 01 FF FF 61 62 => asked 00 00 4F 44 05 00 00 01 FF FF | 61 62",
    );
    // The follow-on telegrams have the same letters.
    check(
        "10 order 00 00 4F 44 05 00 00 41 FF FF | 130*61 => tx STX
         20 takes 00 00 4F 44 05 00 00 41 FF FF 128*61
         30 partner 00 00 00 00 => tx STX
         40 takes FF 00 4F 44 2*61
         50 partner FF 00 00 00 => ended ok",
    );
}

/// [S0 L1678]: 5 s for the reaction, from the acknowledgement of the telegram; [S0 L1635]: BWZ, DBL.
#[test]
fn no_reaction() {
    let order = format!("10 order {SEND_8} | 01..10 => tx STX");
    let telegram = format!("takes {SEND_8} 01..10");
    // The times of the parameter table: BWZ 2 s, DBL 6. The request is sent six times, and each has its 5 s.
    check(&format!(
        "{order}
         20 {telegram}
         2020 timeout => !Repetition(1); tx STX
         2030 {telegram}
         4030 timeout => !Repetition(2); tx STX
         4040 {telegram}
         6040 timeout => !Repetition(3); tx STX
         6050 {telegram}
         8050 timeout => !Repetition(4); tx STX
         8060 {telegram}
         10060 timeout => !Repetition(5); tx STX
         10070 {telegram}
         12070 timeout => !0A05; ended BwzExceeded
         12100 partner 00 00 00 00 => !0A01"
    ));
    // Without BWZ, or when something else keeps the line busy: the order ends 5 s after the acknowledgement.
    let mut config = cp240(true);
    config.line.bwz = Span::ZERO;
    rk512_table::check::<1024>(
        config,
        &format!(
            "0 start
         {order}
         20 {telegram}
         5020 timeout => !0A05; ended NoReaction
         5100 partner 00 00 00 00 => !0A01"
        ),
    );
    // DBL is exceeded first.
    let mut config = cp240(true);
    (config.line.bwz, config.line.block_attempts) = (500 * MS, 3);
    rk512_table::check::<1024>(
        config,
        &format!(
            "0 start
         {order}
         20 {telegram}
         520 timeout => !Repetition(1); tx STX
         530 {telegram}
         1030 timeout => !Repetition(2); tx STX
         1040 {telegram}
         1540 timeout => !0A05; ended BwzExceeded"
        ),
    );
    // The reaction to a telegram that is about to be repeated counts.
    check(&format!(
        "{order}
         20 {telegram}
         2020 timeout => !Repetition(1); tx STX
         2021 partner 00 00 00 00 => ended ok"
    ));
    // BWZ ends with STX: a slow reaction is waited for.
    rk512_table::check::<1024>(
        cp240(false),
        &format!(
            "0 start
         {order}
         20 {telegram}
         2010 rx STX => tx DLE
         2011 done
         2190 rx 00 00
         2370 rx 00 00 10
         2500 rx 03 => tx DLE; ended ok"
        ),
    );
    // Each follow-on telegram has its own 5 s.
    let mut config = cp240(true);
    config.line.bwz = Span::ZERO;
    rk512_table::check::<1024>(
        config,
        "0 start
         10 order 00 00 41 44 0A 00 00 42 FF FF | 132*61 => tx STX
         20 takes 00 00 41 44 0A 00 00 42 FF FF 128*61
         4900 partner 00 00 00 00 => tx STX
         5000 takes FF 00 41 44 4*61
         10000 timeout => !0A05; ended NoReaction",
    );
}

/// [TIA help "Configuration for point-to-point links"]: 20 s at the CP 341, no BWZ.
#[test]
fn the_cp_341_waits_longer() {
    let config = Config::cp341(defaults::cp341(true, CHAR));
    rk512_table::check::<4096>(
        config,
        &format!(
            "0 start => tx NAK
         2 done
         10 order {SEND_8} | 01..10 => tx STX
         20 takes {SEND_8} 01..10
         20020 timeout => !0A05; ended NoReaction"
        ),
    );
    assert_eq!([300, 600, 1200, 9600, 38_400, 115_200].map(|b| Config::reaction_at(b) / SECOND), [10, 7, 5, 5, 3, 3]);
}

/// [CP 341 manual 09/2008, p. 51]: 4096 bytes are 2048 words, in 32 telegrams.
#[test]
fn the_longest_orders() {
    let telegrams = |n: usize| {
        let mut table = String::from("0 start");
        let header = format!("00 00 41 44 01 00 {:02X} {:02X} FF FF", n / 2 / 256, n / 2 % 256);
        table += &format!("\n1 order {header} | {n}*61 => tx STX\n2 takes {header} 128*61");
        for piece in 1..n / 128 {
            let first = if piece == 1 { "00" } else { "FF" };
            table += &format!("\n{0} partner {first} 00 00 00 => tx STX\n{0} takes FF 00 41 44 128*61", 2 + piece);
        }
        table + "\n900 partner FF 00 00 00 => ended ok"
    };
    rk512_table::check::<1024>(cp240(true), &telegrams(1024));
    let mut line = defaults::cp341(true, CHAR);
    line.nak_at_start = false;
    rk512_table::check::<4096>(Config::cp341(line), &telegrams(4096));
    // An order longer than the buffer is not begun, and not accepted from the partner.
    check(
        "10 order 00 00 41 44 01 00 02 01 FF FF | 1026*61 => ended TooLong
         20 partner 00 00 41 44 01 00 02 01 FF FF 128*61 => !0608; tx STX
         30 takes 00 00 00 14
         40 partner 00 00 45 44 01 00 02 01 FF FF => !0608; tx STX
         50 takes 00 00 00 14",
    );
}

/// One order at a time; one whose data and header differ is not accepted.
#[test]
fn orders_that_are_not_begun() {
    check(
        "10 order 00 00 45 44 05 01 00 02 FF FF => tx STX
         11 order 00 00 45 44 06 01 00 02 FF FF => ended Busy
         20 takes 00 00 45 44 05 01 00 02 FF FF
         21 order 00 00 45 44 06 01 00 02 FF FF => ended Busy
         30 partner 00 00 00 00 AA BB CC DD => ended ok AA BB CC DD
         40 order 00 00 45 44 05 01 00 00 FF FF => ended Invalid
         50 order 00 00 41 44 05 01 00 02 FF FF | 01 02 03 => ended Invalid
         60 order 00 00 45 44 05 01 00 02 FF FF | 01 => ended Invalid",
    );
}

/// Class 9: the partner's error number ends the order, in the first reaction or in a later one.
#[test]
fn the_partner_refuses() {
    for (number, event) in [
        (0x0A, 0x0905),
        (0x0C, 0x0902),
        (0x10, 0x090B),
        (0x12, 0x0904),
        (0x14, 0x0903),
        (0x16, 0x090A),
        (0x2A, 0x090D),
        (0x32, 0x0909),
        (0x34, 0x090C),
        (0x36, 0x0908),
        (0x77, 0x090E),
    ] {
        check(&format!(
            "10 order {SEND_8} | 01..10 => tx STX
             20 takes {SEND_8} 01..10
             30 partner 00 00 00 {number:02X} => !{event:04X}; ended Rejected({number:02X})"
        ));
        check(&format!(
            "10 order 00 00 45 44 0A 00 00 42 FF FF => tx STX
             20 takes 00 00 45 44 0A 00 00 42 FF FF
             30 partner 00 00 00 00 128*61 => tx STX
             40 takes FF 00 45 44
             50 partner FF 00 00 {number:02X} => !{event:04X}; ended Rejected({number:02X})"
        ));
        assert_eq!(OrderError::Rejected(number).code(), number);
    }
    // 14h is the same for each area: "not DB/DX" is another number. (docs/cp341-events.md)
    check(
        "10 order 00 00 45 4D 00 10 00 20 FF FF => tx STX
         20 takes 00 00 45 4D 00 10 00 20 FF FF
         30 partner 00 00 00 14 => !0902; ended NoArea",
    );
    assert_eq!(OrderError::NoArea.code(), 0x14);
}

/// Class 10: telegrams that are not valid reactions. (docs/cp341-events.md)
#[test]
fn bad_reactions() {
    let fetch = "10 order 00 00 45 44 05 01 00 02 FF FF => tx STX
         20 takes 00 00 45 44 05 01 00 02 FF FF";
    for (reaction, ends) in [
        ("00 00 00 00", "!0A03; ended BadReaction(Data)"), // no data
        ("00 00 00 00 01 02 03 04 05", "!0A03; ended BadReaction(Data)"), // too many
        ("01 00 00 00 01 02 03 04", "!0A02; ended BadReaction(Structure)"),
        ("00 00 00", "!0A02; ended BadReaction(Structure)"),
        ("FF 00 00 00 01 02 03 04", "!0A01; ended BadReaction(Sequence)"),
        ("00 00 00 32 01 02 03 04", "!0A03; ended BadReaction(Data)"), // data with an error number
    ] {
        check(&format!("{fetch}\n30 partner {reaction} => {ends}"));
    }
    check(&format!(
        "10 order {SEND_8} | 01..10 => tx STX
         20 takes {SEND_8} 01..10
         30 partner 00 00 00 00 01 => !0A04; ended BadReaction(SendData)"
    ));
    check(&format!(
        "10 order {SEND_8} | 01..10 => tx STX
         20 takes {SEND_8} 01..10
         30 partner 00 00 00 45 58 39 => !0A04; ended BadReaction(SendData)"
    ));
    // The first reaction repeated after a follow-on telegram is out of order.
    check(
        "10 order 00 00 41 44 0A 00 00 42 FF FF | 132*61 => tx STX
         20 takes 00 00 41 44 0A 00 00 42 FF FF 128*61
         30 partner 00 00 00 00 => tx STX
         40 takes FF 00 41 44 4*61
         50 partner 00 00 00 00 => !0A01; ended BadReaction(Sequence)",
    );
    // Without an order, and before ours can have arrived (only its STX has been sent): it belongs to an earlier one.
    check(&format!(
        "10 partner 00 00 00 00 => !0A01
         20 partner 01 00 00 00 => !0A02
         30 order {SEND_8} | 01..10 => tx STX
         31 partner 00 00 00 00 => !0A01; tx STX
         40 takes {SEND_8} 01..10
         50 partner 00 00 00 00 => ended ok"
    ));
    for bad in [OrderError::NoReaction, OrderError::BwzExceeded, OrderError::Invalid, OrderError::TooLong] {
        assert!([0x07, 0x0A, 0x0C, 0x17].contains(&bad.code()));
    }
}

/// The number of each refusal, and its event number here (class 6).
#[test]
fn orders_that_are_refused() {
    for (telegram, event, code) in [
        ("00 00 41", 0x0610, 0x34),
        ("00 00 41 44 05 01 00 01 FF", 0x0610, 0x34),
        ("01 00 41 44 05 01 00 01 FF FF 61 62", 0x0601, 0x10),
        ("00 01 41 44 05 01 00 01 FF FF 61 62", 0x0601, 0x10),
        ("00 00 42 44 05 01 00 01 FF FF 61 62", 0x0602, 0x16),
        ("00 00 41 4D 05 01 00 01 FF FF 61 62", 0x0604, 0x10), // SEND goes to data blocks only
        ("00 00 4F 58 05 01 00 01 FF FF 61 62", 0x0604, 0x10),
        ("00 00 45 51 05 01 00 01 FF FF", 0x0604, 0x10),
        ("00 00 41 44 00 01 00 01 FF FF 61 62", 0x0606, 0x14), // DB 0
        ("00 00 41 44 05 01 00 00 FF FF", 0x0608, 0x14),
        ("00 00 41 44 05 01 00 01 06 08 61 62", 0x0609, 0x0C), // bit 8
        ("00 00 41 44 05 01 00 01 FF 04 61 62", 0x0609, 0x0C), // a bit without a byte
        ("00 00 41 44 05 01 00 01 C8 00 61 62", 0x0609, 0x0C), // M 200.0
        ("00 00 41 44 05 01 00 01 06 54 61 62", 0x060A, 0x0C), // CPU 5
        ("00 00 41 44 05 01 00 01 FF FF", 0x060B, 0x34),
        ("00 00 41 44 05 01 00 01 FF FF 61 62 63", 0x060B, 0x34),
        ("00 00 41 44 15 04 00 04 FF FF AA BB", 0x060B, 0x34), // lost its end: nothing more would come
        ("00 00 41 44 05 01 00 40 FF FF 127*61", 0x060B, 0x34),
        ("00 00 41 44 05 01 00 50 FF FF 129*61", 0x060B, 0x34), // more than 128 in one telegram
        ("00 00 45 44 05 01 00 01 FF FF 61 62", 0x060C, 0x34),
        ("FF 00 41 44 61 62", 0x060E, 0x36),
        ("FF 00 45 44", 0x060E, 0x36),
        ("FF 00 45", 0x0610, 0x34),
    ] {
        let first = &telegram[..2];
        let first = if first == "FF" { "FF" } else { "00" };
        check(&format!(
            "10 partner {telegram} => !{event:04X}; tx STX
             20 takes {first} 00 00 {code:02X}
             30 partner {SEND_8} 01..10 => asked {SEND_8} | 01..10"
        ));
    }
    // Every number of the table has its reaction.
    for refusal in Refusal::ALL {
        assert!(refusal.number() & 0xFF00 == 0x0600 && refusal.code() != code::OK, "{refusal:?}");
    }
}

/// The same within an open order, which is dropped.
#[test]
fn follow_on_telegrams_that_are_refused() {
    let begin = "10 partner 00 00 41 44 0A 00 00 82 FF FF 128*61 => tx STX
         20 takes 00 00 00 00";
    for (telegram, event, reaction) in [
        ("FF 00 45 44", 0x0603, "FF 00 00 16"),
        ("FF 00 4F 44 128*61", 0x0605, "FF 00 00 10"), // a DX, not the DB
        ("FF 00 41 44", 0x0611, "FF 00 00 34"),
        ("FF 00 41 44 129*61", 0x0611, "FF 00 00 34"),
        ("FF 00 41 44 127*61", 0x0611, "FF 00 00 34"),
        ("00 00 41 44 0B 00 00 01 FF FF 61 62", 0x060E, "00 00 00 36"),
        ("00 00 41 44 0A 00 00 82 FF FF 128*61", 0x060E, "00 00 00 36"), // our reaction had arrived: out of order
        ("FF 01 41 44 61", 0x0601, "FF 00 00 10"),
    ] {
        check(&format!(
            "{begin}
             30 partner {telegram} => !{event:04X}; tx STX
             40 takes {reaction}
             50 partner FF 00 41 44 128*61 => !060E; tx STX
             60 takes FF 00 00 36"
        ));
    }
    // More in total than announced.
    check(
        "10 partner 00 00 41 44 0A 00 00 41 FF FF 128*61 => tx STX
         20 takes 00 00 00 00
         30 partner FF 00 41 44 61 62 63 => !0611; tx STX
         40 takes FF 00 00 34",
    );
    // The last one has lost its end: the partner would take the acknowledgement for "all is stored".
    check(
        "10 partner 00 00 41 44 0A 00 00 42 FF FF 128*61 => tx STX
         20 takes 00 00 00 00
         30 partner FF 00 41 44 61 62 => !0611; tx STX
         40 takes FF 00 00 34",
    );
    // FETCH: data, and the wrong area.
    for (telegram, event, reaction) in
        [("FF 00 45 44 61", 0x060C, "FF 00 00 34"), ("FF 00 45 4D", 0x0605, "FF 00 00 10")]
    {
        check(&format!(
            "10 partner 00 00 45 44 0A 00 00 42 FF FF => asked 00 00 45 44 0A 00 00 42 FF FF
             20 answer data 132*61 => tx STX
             30 takes 00 00 00 00 128*61
             40 partner {telegram} => !{event:04X}; answered Withdrawn {event:04X}; tx STX
             50 takes {reaction}"
        ));
    }
}

/// The CPU's error number is sent unchanged. [S0 "Coordination flags"]: 32h.
#[test]
fn the_cpu_refuses() {
    for (number, event) in
        [(0x32, 0x060F), (0x14, 0x0607), (0x10, 0x0604), (0x0C, 0x0609), (0x2A, 0x060D), (0x0A, 0x0301)]
    {
        check(&format!(
            "10 partner {SEND_8} 01..10 => asked {SEND_8} | 01..10
             20 answer refused {number:02X} => !{event:04X}; tx STX
             30 takes 00 00 00 {number:02X} => answered ok"
        ));
    }
    // After follow-on telegrams the refusal is the reaction to the last of them.
    check(
        "10 partner 00 00 41 44 0A 00 00 41 FF FF 128*61 => tx STX
         20 takes 00 00 00 00
         30 partner FF 00 41 44 61 62 => asked 00 00 41 44 0A 00 00 41 FF FF | 128*61 61 62
         40 answer refused 14 => !0607; tx STX
         50 takes FF 00 00 14 => answered ok",
    );
    // An answer that does not match the order, and one without an order.
    check(&format!(
        "10 partner {SEND_8} 01..10 => asked {SEND_8} | 01..10
         20 answer data 01 02 => !0301; tx STX
         30 takes 00 00 00 0A => answered ok
         40 answer taken"
    ));
    check(
        "10 partner 00 00 45 44 05 01 00 02 FF FF => asked 00 00 45 44 05 01 00 02 FF FF
         20 answer data 01 02 03 => !0301; tx STX
         30 takes 00 00 00 0A => answered ok",
    );
}

/// 060Dh: the CPU is in STOP, or does not answer in time.
#[test]
fn nobody_serves() {
    check(&format!(
        "10 serve off
         20 partner {SEND_8} 01..10 => !060D; tx STX
         30 takes 00 00 00 2A
         40 serve on
         50 partner {SEND_8} 01..10 => asked {SEND_8} | 01..10
         60 serve off => !060D; answered Withdrawn 060D; tx STX
         70 takes 00 00 00 2A
         80 serve on
         90 partner {SEND_8} 01..10 => asked {SEND_8} | 01..10
         4090 timeout => !060D; answered Withdrawn 060D; tx STX
         4100 takes 00 00 00 2A
         4200 answer taken"
    ));
}

/// The partner does not continue: its order is dropped after 5 s.
#[test]
fn an_order_that_stops_half_way() {
    check(
        "10 partner 00 00 41 44 0A 00 00 82 FF FF 128*61 => tx STX
         20 takes 00 00 00 00
         5020 timeout => !060E
         5030 partner FF 00 41 44 128*61 => !060E; tx STX
         5040 takes FF 00 00 36",
    );
    check(
        "10 partner 00 00 45 44 0A 00 00 42 FF FF => asked 00 00 45 44 0A 00 00 42 FF FF
         20 answer data 132*61 => tx STX
         30 takes 00 00 00 00 128*61
         5030 timeout => !060E; answered Abandoned",
    );
}
