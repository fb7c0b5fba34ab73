//! 3964(R), receiving role: every branch of the procedure text as a message table. One character takes 1 ms.

use ob1_protocols::s3964::{Config, S3964};
use ob1_protocols::{MS, Span};

use crate::common::check;
use crate::defaults;

fn config(bcc: bool) -> Config {
    defaults::cp240(bcc, MS)
}

fn run(config: Config, table: &str) {
    check(&mut S3964::<1024>::new(config), table);
}

/// The check values of reference 5.1.
#[test]
fn telegrams_are_delivered_with_the_final_dle() {
    run(
        config(true),
        "0  start
         0  rx STX => tx DLE
         1  done
         2  rx 31 10 03
         3  rx 22 => tx DLE, got 31
         4  done
         10 rx STX => tx DLE
         11 done
         12 rx 41 42 43 10 03 53 => tx DLE, got 41 42 43
         13 done
         20 rx STX => tx DLE
         21 done
         22 rx 10 10 10 03 13 => tx DLE, got 10
         23 done
         30 rx STX => tx DLE
         31 done
         32 rx 10 10 10 10 10 03 13 => tx DLE, got 10 10
         33 done
         40 rx STX => tx DLE
         41 done
         42 rx 02 10 10 03 15 10 03 07 => tx DLE, got 02 10 03 15",
    );
}

/// Without BCC the block ends with DLE ETX.
#[test]
fn without_bcc() {
    run(
        config(false),
        "0  start
         0  rx STX => tx DLE
         1  done
         2  rx 31 10
         3  rx 03 => tx DLE, got 31
         4  done
         5  rx 22 => !Idle: Unexpected(34), tx NAK   # a BCC that nobody asked for",
    );
}

/// BCC = 10h is sent once. [TIA help "Configuration for point-to-point links"]
#[test]
fn a_check_character_that_looks_like_dle() {
    run(
        config(true),
        "0 start
         0 rx STX => tx DLE
         1 done
         2 rx 03 10 03 10 => tx DLE, got 03",
    );
}

/// [S0 "Passive operation"]: not STX: NAK. NAK itself is not answered.
#[test]
fn characters_while_the_line_is_free() {
    run(
        config(true),
        "0  start
         0  rx 41  => !Idle: Unexpected(65), tx NAK
         1  done
         2  rx NAK
         3  rx DLE => !Idle: Unexpected(16), tx NAK
         4  done
         5  fault Parity => !Idle: Line(Parity), tx NAK",
    );
}

/// One NAK at a time: it also answers what comes in while it is being sent.
#[test]
fn a_burst_does_not_pile_up_naks() {
    run(
        config(true),
        "0   start
         0   rx 41 42 => !Idle: Unexpected(65), tx NAK, !Idle: Unexpected(66)
         0.5 rx 43    => !Idle: Unexpected(67)
         1   done
         2   rx 44    => !Idle: Unexpected(68), tx NAK
         3   rx STX   => tx DLE",
    );
}

/// [S0 "Passive operation"]: ZVZ exceeded: NAK, and wait for a new connection. It runs from the end of our DLE, and
/// from each character.
#[test]
fn character_delay() {
    run(
        config(true),
        "0   start
         0   rx STX => tx DLE
         1   done
         201 timeout => !Receive: CharacterDelay, tx NAK
         202 done
         300 rx STX => tx DLE
         301 done
         500 rx 41
         699 rx 10
         899 timeout => !Receive: CharacterDelay, tx NAK
         900 done
         901 rx 41 => !Idle: Unexpected(65), tx NAK",
    );
}

/// [S0 "Character delay time (ZVZ)"]: 0: about double character time.
#[test]
fn character_delay_of_zero_is_two_characters() {
    run(
        Config { zvz: Span::ZERO, ..config(true) },
        "0 start
         0 rx STX => tx DLE
         1 done
         2 rx 41
         4 timeout => !Receive: CharacterDelay, tx NAK",
    );
}

/// A partner that does not wait for the end of our DLE: its characters are accepted, and ZVZ runs from them.
#[test]
fn characters_before_our_dle_is_out() {
    run(
        config(true),
        "0   start
         0   rx STX => tx DLE
         0.5 rx 41
         1   done
         200.5 timeout => !Receive: CharacterDelay, tx NAK",
    );
}

/// This side was late, and the partner has repeated its request before the answer: that is not data. After that an STX
/// in front of the block may still be a request, so the block is refused once. Otherwise it is an ordinary character.
#[test]
fn a_request_that_was_repeated_before_our_dle() {
    run(
        config(true),
        "0   start
         0   rx STX STX => tx DLE, !Idle: Unexpected(2)
         0.5 rx STX => !Idle: Unexpected(2)
         1   done
         2   rx 31 10 03 22 => tx DLE, got 31
         3   done
         10  rx STX STX => tx DLE, !Idle: Unexpected(2)
         11  done
         12  rx STX STX 31 10 03 22 => !Receive: Unexpected(2), tx NAK
         13  done
         20  rx STX => tx DLE
         21  done
         22  rx STX STX 31 10 03 22 => tx DLE, got 02 02 31",
    );
}

/// [S0 L1631]: a partner that has not had our DLE repeats STX when its QVZ has expired. Where ZVZ is longer this is no
/// data, or each STX would keep the block open. An STX that comes sooner, or after another character, is data.
#[test]
fn a_request_that_is_repeated_because_our_dle_was_lost() {
    run(
        Config { qvz: 100 * MS, ..config(true) },
        "0   start
         0   rx STX => tx DLE
         1   done
         101 rx STX => !Idle: Unexpected(2), tx DLE
         102 done
         150 rx NAK          # the partner gives up ...
         160 rx STX          # ... and begins again
         260 rx STX => !Idle: Unexpected(2), tx DLE
         261 done
         262 rx 31 10 03 22 => tx DLE, got 31
         263 done
         300 rx STX => tx DLE
         301 done
         340 rx STX
         400 rx STX 31 10 03 22 => tx DLE, got 02 02 31
         401 done
         500 rx STX => tx DLE
         501 done
         502 rx 31 STX 32
         690 rx STX 10 03 10 => tx DLE, got 31 02 32 02",
    );
}

/// [S0 "Block check character (BCC-Byte)"]: differs: NAK instead of DLE; the CP 240 then waits for another connection
/// request, and an order of its own may go first.
#[test]
fn wrong_check_character() {
    run(
        config(true),
        "0  start
         0  rx STX => tx DLE
         1  done
         2  rx 31 10 03 23 => !Receive: BadCheck { computed: 34, received: 35 }, tx NAK
         3  done
         4  rx STX => tx DLE
         5  done
         6  rx 31 10 03 22 => tx DLE, got 31
         7  done
         8  rx STX => tx DLE
         9  order 32
         9  done
         10 rx 31 10 03 23 => !Receive: BadCheck { computed: 34, received: 35 }, tx NAK STX",
    );
}

/// DLE followed by neither DLE nor ETX, an unreadable character: noted, received to the end, refused.
/// [TIA help "Configuration for point-to-point links"]
#[test]
fn noted_errors_refuse_the_block_at_its_end() {
    run(
        config(true),
        "0  start
         0  rx STX => tx DLE
         1  done
         2  rx 31 10 41 32 => !Receive: BadDle(65)
         3  rx 10 03 22 => tx NAK
         4  done
         10 rx STX => tx DLE
         11 done
         12 rx 31
         13 fault Parity => !Receive: Line(Parity)
         14 rx 10 03
         15 rx 22 => tx NAK
         16 done
         20 rx STX => tx DLE
         21 done
         22 rx 31 10 03
         23 fault Framing => !Receive: Line(Framing), tx NAK    # in the place of BCC
         24 done
         30 rx STX => tx DLE
         31 done
         32 rx 31 10
         33 fault Overrun => !Receive: Line(Overrun)            # it may have been ETX: nothing more comes
         233 timeout => tx NAK",
    );
}

/// [S0 "Data Link Escape (DLE-character)"]: STX while it is not ready: NAK.
#[test]
fn no_receive_buffer() {
    run(
        config(true),
        "0  start
         0  room 0
         1  rx STX => !Idle: NoBuffer, tx NAK
         2  done
         3  room 1024
         4  rx STX => tx DLE
         5  done
         6  rx 31 10 03
         7  room 0                    # taken by something else meanwhile
         8  rx 22 => !Receive: NoBuffer, tx NAK
         9  done
         10 room 2
         11 rx STX => tx DLE
         12 done
         13 rx 41 42 43 10 03 53 => !Receive: NoBuffer, tx NAK
         14 done
         15 rx STX => tx DLE
         16 done
         17 rx 41 42 10 03 10 => tx DLE, got 41 42",
    );
}

/// The longest telegram has 1024 bytes. [S0 "Properties"]
#[test]
fn telegram_length() {
    run(
        config(true),
        "0  start
         0  rx STX => tx DLE
         1  done
         2  rx 1024*31
         3  rx 10 03 13 => tx DLE, got 1024*31
         4  done
         5  rx STX => tx DLE
         6  done
         7  rx 1025*31 => !Receive: TooLong
         8  rx 10 03 22 => tx NAK",
    );
}

/// A block without user data but with a correct check character is acknowledged; there is nothing to deliver. Without
/// check character it is a telegram that has lost its characters.
#[test]
fn an_empty_block() {
    run(
        config(true),
        "0  start
         0  rx STX => tx DLE
         1  done
         2  rx 10 03 13 => tx DLE, !Receive: Empty",
    );
    run(
        config(false),
        "0  start
         0  rx STX => tx DLE
         1  done
         2  rx 10 03 => !Receive: Empty, tx NAK",
    );
}

/// The final DLE was lost and the partner repeats: a new telegram for us, delivered again.
#[test]
fn a_repeated_block_is_delivered_twice() {
    run(
        config(true),
        "0   start
         0   rx STX => tx DLE
         1   done
         2   rx 31 10 03 22 => tx DLE, got 31
         3   done
         503 rx STX => tx DLE
         504 done
         505 rx 31 10 03 22 => tx DLE, got 31",
    );
}

/// A conflict with low priority and without a buffer: NAK, then the own order again.
#[test]
fn conflict_without_a_buffer() {
    run(
        Config { connect_attempts: 1, ..config(true) },
        "0  start
         0  room 0
         0  order 31 => tx STX
         1  done
         2  rx STX => !Connect: Conflict { yielded: true }, !Idle: NoBuffer, tx NAK STX
         4  done
         5  rx DLE => tx 31 10 03 22",
    );
}

/// RESET of the CPU drops the telegram being received.
#[test]
fn abort_drops_the_reception() {
    run(
        config(true),
        "0  start
         0  rx STX => tx DLE
         1  done
         2  rx 31
         3  abort => back
         4  rx 10 => !Idle: Unexpected(16), tx NAK",
    );
}

/// CP 341: NAK only after silence; 400 ms for a receive buffer, checked every 50 ms.
/// [TIA help "Configuration for point-to-point links"]
#[test]
fn what_the_cp_341_does_while_the_line_is_free() {
    run(
        Config { nak_at_start: false, ..defaults::cp341(true, MS) },
        "0    start
         0    rx 41 => !Idle: Unexpected(65)
         100  rx STX                          # part of the noise
         200  fault Parity
         420  timeout => tx NAK
         421  done
         430  room 0
         500  rx STX
         899  room 0
         900  timeout => !Idle: NoBuffer, tx NAK
         901  done
         1000 rx STX
         1120 room 100 => tx DLE
         1121 done
         1122 rx 31 10 03 22 => tx DLE, got 31
         1123 done
         1130 room 0
         1200 rx STX
         1210 rx 41 => !Idle: Unexpected(65)  # does not wait for our DLE: 0802h
         1430 timeout => tx NAK",
    );
}

/// CP 341: the repetition of a refused block must begin within 4 s, and own orders wait for it; at most 6 attempts.
/// [TIA help "Configuration for point-to-point links"]
#[test]
fn the_cp_341_waits_for_a_repetition() {
    run(
        Config { nak_at_start: false, block_attempts: 2, ..defaults::cp341(true, MS) },
        "0    start
         0    rx STX => tx DLE
         1    done
         2    rx 31 10 03 23 => !Receive: BadCheck { computed: 34, received: 35 }, tx NAK, !Receive: Refused(1)
         3    done
         10   order 32
         4003 timeout => !Idle: NoRepetition, tx STX
         4004 done
         4005 rx DLE => tx 32 10 03 21
         4009 done
         4010 rx DLE => sent ok
         5000 rx STX => tx DLE
         5001 done
         5002 rx 31 10 03 23 => !Receive: BadCheck { computed: 34, received: 35 }, tx NAK, !Receive: Refused(1)
         5003 done
         5004 rx STX => tx DLE
         5005 done
         5006 rx 31 10 03 23 => !Receive: BadCheck { computed: 34, received: 35 }, tx NAK, !Receive: Exhausted
         5007 done
         5008 order 32 => tx STX",
    );
}
