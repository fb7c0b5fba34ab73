//! M-Bus master: every branch as a message table, and the frames as bytes.
//!
//! At 9600 baud a bit takes 104.166 us: the answer is awaited for 84.37478 ms, the pause is 3.437478 ms.

use ob1_protocols::MBus;
use ob1_protocols::mbus::Config;
use ob1_protocols::mbus::frame::{FRAME_MAX, Frame, FrameError, Progress, USER_MAX};

use crate::common::check;

fn run(table: &str) {
    check(&mut MBus::new(Config::cp240()), table);
}

/// [S0 "Examples"]: BBh, 7Bh, FEh is sent as 10 7B FE 79 16. The received telegram of the manual has misprints: the L
/// fields of `08 02 72 01 02 03` are 06h, its check sum is 82h, and 7 bytes reach the program.
#[test]
fn the_examples_of_the_manual() {
    run("0     start
         0     order BB 7B FE => baud 2400, tx 10 7B FE 79 16
         23    done
         60    rx 68 06 06 68 08 02 72 01 02 03 82 16 => got 00 08 02 72 01 02 03, sent ok");
}

/// [S0 "Overview of M-Bus telegrams"]: the length including the baud rate decides the frame.
#[test]
fn the_length_tells_the_frame() {
    run("0  start
         0  order BD E5           => baud 9600, tx E5
         1  done                  => got 01, sent ok          # nobody answers a single character
         10 order BD 40 05        => baud 9600, tx 10 40 05 45 16
         11 done
         12 rx E5                 => got 00 E5, sent ok
         20 order BD 53 05 BB     => baud 9600, tx 68 03 03 68 53 05 BB 13 16
         21 done
         22 rx E5                 => got 00 E5, sent ok
         30 order BD 53 05 51 07 08 => baud 9600, tx 68 05 05 68 53 05 51 07 08 B8 16
         31 done
         32 rx E5                 => got 00 E5, sent ok
         40 order BD 53 05 51 252*00 => baud 9600, tx 68 FF FF 68 53 05 51 252*00 A9 16
         41 done
         42 rx E5                 => got 00 E5, sent ok");
}

/// A lone baud rate is not a telegram, a lone character other than E5h is not a frame, 253 bytes of user data are too
/// many.
#[test]
fn what_is_no_frame_is_refused() {
    run("0 start
         0 order BB               => sent Frame
         1 order BB 7B            => sent Frame
         2 order BB 53 05 51 253*00 => sent TooLong");
}

/// [S0 "Overview of M-Bus telegrams"]: B8h is 300, BBh 2400, BDh 9600, anything else 2400 baud.
#[test]
fn the_first_byte_is_the_baud_rate() {
    for (code, baud) in [("B8", 300), ("BB", 2400), ("BD", 9600), ("00", 2400), ("BC", 2400), ("FF", 2400)] {
        run(&format!(
            "0 start
             0 order {code} 40 FF => baud {baud}, tx 10 40 FF 3F 16
             9 done => got 01, sent ok"
        ));
    }
}

/// [S0 L4300-L4342]: C and A field pass as they are: every function, every address. An answer E5h means "no such data"
/// [S0 L4316-L4317]; at 255 all listen and none answers [S0 L4339].
#[test]
fn every_function_and_address_passes() {
    for c in [0x40, 0x5A, 0x5B, 0x7A, 0x7B] {
        for a in 0..=255_u8 {
            let sum = a.wrapping_add(c);
            let end = match a {
                255 => "9 done => got 01, sent ok".to_owned(),
                _ => "9 done\n12 rx E5 => got 00 E5, sent ok".to_owned(),
            };
            run(&format!(
                "0 start\n0 order BD {c:02X} {a:02X} => baud 9600, tx 10 {c:02X} {a:02X} {sum:02X} 16\n{end}"
            ));
        }
    }
}

/// [S0 "FCB bit"]: 330 bit times plus 50 ms, two repetitions, 33 bit times of pause.
#[test]
fn a_missing_answer_is_asked_for_three_times() {
    run("0          start
         0          order BD 7B 05 => baud 9600, tx 10 7B 05 80 16
         6          done
         90.37478   timeout => !Acknowledge: AckDelay, !Output: Repetition(1), tx 10 7B 05 80 16
         96         done
         180.37478  timeout => !Acknowledge: AckDelay, !Output: Repetition(2), tx 10 7B 05 80 16
         186        done
         270.37478  timeout => !Acknowledge: AckDelay
         273.812258 timeout => !Acknowledge: Exhausted, got 01, sent ok");
    // At 300 baud: 1100 ms plus 50 ms.
    run("0          start
         0          order B8 7B 05 => baud 300, tx 10 7B 05 80 16
         184        done
         1333.99989 timeout => !Acknowledge: AckDelay, !Output: Repetition(1), tx 10 7B 05 80 16");
}

/// [S0 "FCB bit"]: "the same procedure starts when the master receives a defective respond"; the repetition waits for a
/// silent bus.
#[test]
fn a_defective_answer_is_asked_for_again() {
    run("0          start
         0          order BD 7B 05 => baud 9600, tx 10 7B 05 80 16
         6          done
         10         rx 68 03 03 68 08 05 72 00 16 => !Acknowledge: BadCheck { computed: 127, received: 0 }
         12         rx 01 02            # what follows belongs to it
         15.437478  timeout => !Output: Repetition(1), tx 10 7B 05 80 16
         21         done
         25         rx 68 03 04 => !Acknowledge: Unexpected(4)
         28.437478  timeout => !Output: Repetition(2), tx 10 7B 05 80 16
         34         done
         40         rx 68 03 03 68 08 05 72 7F 16 => got 00 08 05 72, sent ok");
}

/// Each defect of a frame, and a frame that breaks off.
#[test]
fn every_defect_of_an_answer() {
    let defects = [
        ("rx 41", "Unexpected(65)"),
        ("rx 68 02 02", "Unexpected(2)"),
        ("rx 68 03 03 69", "Unexpected(105)"),
        ("rx 68 03 03 68 08 05 72 7F 17", "Unexpected(23)"),
        ("rx 10 08 05 0D 17", "Unexpected(23)"),
        // Two slaves at one address.
        ("rx E5 E5", "Unexpected(229)"),
    ];
    for (input, what) in defects {
        run(&format!(
            "0  start
             0  order BD 7B 05 => baud 9600, tx 10 7B 05 80 16
             6  done
             10 {input} => !Acknowledge: {what}
             13.437478 timeout => !Output: Repetition(1), tx 10 7B 05 80 16"
        ));
    }
    run("0  start
         0  order BD 7B 05 => baud 9600, tx 10 7B 05 80 16
         6  done
         10 rx 68 03 03 68
         40 timeout => !Acknowledge: CharacterDelay
         43.437478 timeout => !Output: Repetition(1), tx 10 7B 05 80 16");
    run("0  start
         0  order BD 7B 05 => baud 9600, tx 10 7B 05 80 16
         6  done
         10 rx 68 03 03
         11 fault Parity => !Acknowledge: Line(Parity)
         12 rx 08 05
         15.437478 timeout => !Output: Repetition(1), tx 10 7B 05 80 16");
}

/// An answer may come in pieces, and after the echo of a level converter.
#[test]
fn pieces_and_echoes() {
    run("0  start
         0  order BD 7B 05 => baud 9600, tx 10 7B 05 80 16
         3  rx 10 7B 05          # echo while our output leaves
         6  done
         10 rx 10 7B 05 80 16 68 03
         20 rx 03 68 08 05
         45 rx 72 7F 16 => got 00 08 05 72, sent ok
         50 rx E5 => !Idle: Unexpected(229)");
}

/// [S0 "Response byte"]: bit 1 in the case of a short circuit; there was no answer either.
#[test]
fn a_short_circuit_ends_the_order() {
    run("0  start
         0  order BD 7B 05 => baud 9600, tx 10 7B 05 80 16
         2  fault Break => !Output: Line(Break), back, got 03, sent ok
         10 order BD 7B 05 => baud 9600, tx 10 7B 05 80 16
         16 done
         20 fault Break => !Acknowledge: Line(Break), back, got 03, sent ok
         30 fault Break => !Idle: Line(Break)");
}

/// Ours: a line that stays at 0 reports its break only once. The break counts until a character comes in.
#[test]
fn a_short_circuit_counts_until_a_character_comes_in() {
    run("0          start
         0          fault Break => !Idle: Line(Break)
         10         order BD 40 FF => baud 9600, tx 10 40 FF 3F 16
         16         done => got 03, sent ok
         20         order BD 7B 05 => baud 9600, tx 10 7B 05 80 16
         26         done
         110.37478  timeout => !Acknowledge: AckDelay, !Output: Repetition(1), tx 10 7B 05 80 16
         116        done
         200.37478  timeout => !Acknowledge: AckDelay, !Output: Repetition(2), tx 10 7B 05 80 16
         206        done
         290.37478  timeout => !Acknowledge: AckDelay
         293.812258 timeout => !Acknowledge: Exhausted, got 03, sent ok
         300        rx 00 => !Idle: Unexpected(0)
         310        order BD 40 FF => baud 9600, tx 10 40 FF 3F 16
         316        done => got 01, sent ok");
}

/// Ours: a device that never falls silent does not prolong the order. Three of the longest frames are 897 ms at 9600
/// baud.
#[test]
fn a_babbler_does_not_hold_the_order() {
    let mut table = String::from("0 start\n0 order BD 7B 05 => baud 9600, tx 10 7B 05 80 16\n0 done\n");
    table += "50 rx 41 => !Acknowledge: Unexpected(65)\n";
    for at in 0..311 {
        table += &format!("{} rx 41\n", 51 + 3 * at);
    }
    table += "981.556538 timeout => !Output: Repetition(1), tx 10 7B 05 80 16\n";
    run(&table);
}

/// Ours: an order waits until there is room for its answer, so that no answer is lost.
#[test]
fn an_order_waits_for_room() {
    run("0  start
         0  room 255
         1  order BD 40 05
         2  order BD 40 06 => sent Busy
         30 room 256 => baud 9600, tx 10 40 05 45 16
         40 abort => back, sent Aborted
         41 abort");
}

#[test]
fn frames_survive_the_line() {
    let data: Vec<u8> = (0..USER_MAX).map(|i| i as u8).collect();
    let frames = [
        Frame::Single,
        Frame::Short { c: 0x5B, a: 0xFD },
        Frame::Long { c: 0x08, a: 1, ci: 0x72, data: &[] },
        Frame::Long { c: 0x08, a: 1, ci: 0x72, data: &data[..1] },
        Frame::Long { c: 0x18, a: 250, ci: 0x73, data: &data },
    ];
    for frame in frames {
        let mut bytes = [0; FRAME_MAX];
        let length = frame.encode(&mut bytes);
        assert_eq!(Frame::decode(&bytes[..length]), Progress::Whole(frame, length));
        for cut in 0..length {
            assert_eq!(Frame::decode(&bytes[..cut]), Progress::More, "{frame:?} cut at {cut}");
        }
        // One flipped bit is detected or gives another start; only in the single character a flip may begin another
        // frame.
        for (place, bit) in (0..length).flat_map(|place| (0..8).map(move |bit| (place, bit))).filter(|_| length > 1) {
            bytes[place] ^= 1 << bit;
            assert!(
                !matches!(Frame::decode(&bytes[..length]), Progress::Whole(_, n) if n == length),
                "{frame:?}, bit {bit} of byte {place}"
            );
            bytes[place] ^= 1 << bit;
        }
    }
    assert_eq!(Frame::decode(&[0x00]), Progress::Wrong(FrameError::Start(0)));
}
