//! 3964(R), sending role: every branch of the procedure text as a message table. One character takes 1 ms.

use ob1_protocols::s3964::{Config, Priority, S3964};
use ob1_protocols::{MS, SECOND, Span};

use crate::common::check;
use crate::defaults;

/// Without the pause after a refusal, which has a separate table.
fn config(bcc: bool) -> Config {
    Config { quiet: Span::ZERO, ..defaults::cp240(bcc, MS) }
}

fn run(config: Config, table: &str) {
    check(&mut S3964::<1024>::new(config), table);
}

/// [S0 "Procedure"]: STX, DLE, text DLE ETX BCC, DLE.
#[test]
fn a_telegram_is_done_with_the_final_dle() {
    run(
        config(true),
        "0  start
         10 order 31       => tx STX
         11 done
         15 rx DLE         => tx 31 10 03 22
         19 done
         30 rx DLE         => sent ok
         31 order 41 42 43 => tx STX
         32 done
         33 rx DLE         => tx 41 42 43 10 03 53
         39 done
         40 rx DLE         => sent ok",
    );
}

/// [S0 "3964(R)"]: BCC only with 3964R. [S0 "Data Link Escape (DLE-character)"]: DLE is doubled.
#[test]
fn without_bcc_and_with_doubled_dle() {
    run(
        config(false),
        "0  start
         0  order 02 DLE ETX NAK => tx STX
         1  done
         2  rx DLE => tx 02 10 10 03 15 10 03
         9  done
         10 rx DLE => sent ok",
    );
}

/// Blocks are sent in pieces of 128 characters; the last one may be full.
#[test]
fn long_blocks() {
    run(
        config(false),
        "0    start
         0    order 126*31 => tx STX
         1    done
         2    rx DLE => tx 126*31 10 03
         130  done
         131  rx DLE => sent ok
         200  order 1024*10 => tx STX
         201  done
         202  rx DLE => tx 2048*10 10 03",
    );
}

/// [S0 "Timeout times"]: QVZ expires after STX: STX is repeated 5 times, then NAK and the end. QVZ begins when STX has
/// been sent.
#[test]
fn no_answer_to_stx() {
    run(
        config(true),
        "0    start
         0    order 31 => tx STX
         1    done
         501  timeout => !Connect: AckDelay, !Connect: Repetition(1), tx STX
         502  done
         1002 timeout => !Connect: AckDelay, !Connect: Repetition(2), tx STX
         1010 done       # a slow line: QVZ counts from here
         1510 timeout => !Connect: AckDelay, !Connect: Repetition(3), tx STX
         1511 done
         2011 timeout => !Connect: AckDelay, !Connect: Repetition(4), tx STX
         2012 done
         2512 timeout => !Connect: AckDelay, !Connect: Repetition(5), tx STX
         2513 done
         3013 timeout => !Connect: AckDelay, !Connect: Exhausted, tx NAK, sent AckDelay
         3014 done
         9000 order 31 => tx STX",
    );
}

/// [S0 "Timeout times"]: "the same sequence is completed when a NAK or any other character follows an STX".
#[test]
fn nak_and_other_characters_after_stx() {
    run(
        config(true),
        "0  start
         0  order 31 => tx STX
         1  done
         2  rx NAK => !Connect: Nak, !Connect: Repetition(1), tx STX
         3  done
         4  rx 41  => !Connect: Unexpected(65), !Connect: Repetition(2), tx STX
         5  done
         6  fault Parity => !Connect: Line(Parity), !Connect: Repetition(3), tx STX
         7  done
         8  rx NAK => !Connect: Nak, !Connect: Repetition(4), tx STX
         9  done
         10 rx NAK => !Connect: Nak, !Connect: Repetition(5), tx STX
         11 done
         12 rx NAK => !Connect: Nak, !Connect: Exhausted, tx NAK, sent Repetitions
         13 done",
    );
}

/// A partner that starts in the middle of a block answers each character still being sent: STX is sent once, when
/// nothing more has come for 10 ms and two characters.
#[test]
fn after_a_refusal_stx_waits_until_the_line_is_quiet() {
    run(
        defaults::cp240(true, MS),
        "0    start
         0    order 8*31  => tx STX
         1    done
         2    rx DLE      => tx 8*31 10 03 13
         5    rx NAK      => back 8, !Output: Nak, !Output: Repetition(1)
         6    done
         8    rx NAK
         14   rx NAK
         26   timeout     => tx STX
         27   done
         28   rx NAK      => !Connect: Nak, !Connect: Repetition(1)
         40   timeout     => tx STX
         41   done
         541  timeout     => !Connect: AckDelay, !Connect: Repetition(2), tx STX
         542  done
         543  rx DLE      => tx 8*31 10 03 13
         554  done
         555  rx NAK      => !Acknowledge: Nak, !Output: Repetition(2)
         # Meanwhile the partner may send.
         560  rx STX      => tx DLE
         561  done
         562  rx 41 10 03 52 => tx DLE, got 41
         563  done
         567  timeout     => tx STX
         568  done
         569  rx DLE      => tx 8*31 10 03 13
         580  done
         581  rx DLE      => sent ok",
    );
}

/// The last attempt decides the error code: 0Ch when the partner's answer was invalid.
#[test]
fn garbage_after_the_last_stx_is_a_frame_error() {
    run(
        Config { connect_attempts: 1, ..config(true) },
        "0 start
         0 order 31 => tx STX
         1 done
         2 rx 55 => !Connect: Unexpected(85), !Connect: Exhausted, tx NAK, sent Frame",
    );
}

/// A character that ended before our STX had been sent cannot answer it; STX is the exception (initialisation
/// conflict).
#[test]
fn a_character_before_stx_is_out_is_no_answer() {
    run(
        config(true),
        "0   start
         0   order 31 => tx STX
         0.5 rx NAK
         0.6 rx DLE
         1   done
         2   rx DLE => tx 31 10 03 22",
    );
}

/// A line that reports the end of its output late must not cost the answer.
#[test]
fn the_answer_may_overtake_the_report_that_stx_is_out() {
    run(
        config(true),
        "0  start
         0  order 31 => tx STX
         2  rx DLE => tx 31 10 03 22
         7  rx DLE => sent ok
         8  done",
    );
}

/// A line that never reports it must not cost the order.
#[test]
fn a_line_that_never_says_done_ends_in_acknowledgement_delay() {
    run(
        Config { connect_attempts: 1, ..config(true) },
        "0    start
         0    order 31 => tx STX
         1501 timeout => !Connect: AckDelay, !Connect: Exhausted, tx NAK, sent AckDelay",
    );
    run(
        Config { block_attempts: 1, ..config(true) },
        "0    start
         0    order 31 => tx STX
         2    rx DLE => tx 31 10 03 22
         1006 timeout
         1506 timeout => !Acknowledge: AckDelay, !Output: Exhausted, tx NAK, sent AckDelay",
    );
}

/// [S0 "Timeout times"]: QVZ expires after the block: connection and block are repeated 5 times, then NAK.
#[test]
fn no_answer_to_the_block() {
    run(
        Config { block_attempts: 3, ..config(true) },
        "0    start
         0    order 31 => tx STX
         1    done
         2    rx DLE => tx 31 10 03 22
         6    done
         506  timeout => !Acknowledge: AckDelay, !Output: Repetition(1), tx STX
         507  done
         508  rx DLE => tx 31 10 03 22
         512  done
         1012 timeout => !Acknowledge: AckDelay, !Output: Repetition(2), tx STX
         1013 done
         1014 rx DLE => tx 31 10 03 22
         1018 done
         1518 timeout => !Acknowledge: AckDelay, !Output: Exhausted, tx NAK, sent AckDelay",
    );
}

/// [S0 "Timeout times"]: "or when a character other than DLE is received".
#[test]
fn other_answers_to_the_block() {
    run(
        Config { block_attempts: 4, ..config(true) },
        "0  start
         0  order 31 => tx STX
         1  done
         2  rx DLE => tx 31 10 03 22
         6  done
         7  rx NAK => !Acknowledge: Nak, !Output: Repetition(1), tx STX
         8  done
         9  rx DLE => tx 31 10 03 22
         13 done
         14 rx 41  => !Acknowledge: Unexpected(65), !Output: Repetition(2), tx STX
         15 done
         16 rx DLE => tx 31 10 03 22
         20 done
         21 fault Framing => !Acknowledge: Line(Framing), !Output: Repetition(3), tx STX
         22 done
         23 rx DLE => tx 31 10 03 22
         27 done
         28 rx NAK => !Acknowledge: Nak, !Output: Exhausted, tx NAK, sent Repetitions",
    );
}

/// Each attempt to send the block has connection attempts of its own. (ours)
#[test]
fn connection_attempts_begin_anew_with_each_block() {
    run(
        Config { connect_attempts: 2, block_attempts: 2, ..config(true) },
        "0  start
         0  order 31 => tx STX
         1  done
         2  rx NAK => !Connect: Nak, !Connect: Repetition(1), tx STX
         3  done
         4  rx DLE => tx 31 10 03 22
         8  done
         9  rx NAK => !Acknowledge: Nak, !Output: Repetition(1), tx STX
         10 done
         11 rx NAK => !Connect: Nak, !Connect: Repetition(1), tx STX
         12 done
         13 rx NAK => !Connect: Nak, !Connect: Exhausted, tx NAK, sent Repetitions",
    );
}

/// A partner that interrupts the block: it is stopped and begun again. DLE while it is being sent is too early.
/// (docs/cp341-events.md)
#[test]
fn a_character_while_the_block_leaves() {
    run(
        config(true),
        "0  start
         0  order 6*31 => tx STX
         1  done
         2  rx DLE => tx 6*31 10 03 13
         5  rx NAK => back 5, !Output: Nak, !Output: Repetition(1), tx STX
         8  done
         9  rx DLE => tx 6*31 10 03 13
         11 rx DLE => !Output: Unexpected(16), back 6, !Output: Repetition(2), tx STX
         13 done
         14 rx DLE => tx 6*31 10 03 13
         16 fault Break => !Output: Line(Break), back, !Output: Repetition(3), tx STX
         24 done
         25 rx DLE => tx 6*31 10 03 13
         34 done
         35 rx DLE => sent ok",
    );
}

/// Characters taken back need no time: the answer to the new STX is recognised although the line reports late.
#[test]
fn time_of_what_was_taken_back() {
    run(
        config(true),
        "0 start
         0 order 6*31 => tx STX
         1 done
         2 rx DLE => tx 6*31 10 03 13
         5 rx NAK => back 5, !Output: Nak, !Output: Repetition(1), tx STX   # out at 7 ms instead of 12
         8 rx DLE => tx 6*31 10 03 13",
    );
}

/// [S0 "Initialization conflict"]: the lower priority sends DLE, receives, and then starts its own order again; the
/// attempt lost does not count.
#[test]
fn low_priority_yields_and_begins_again() {
    run(
        Config { connect_attempts: 1, ..config(true) },
        "0   start
         0   order 31 => tx STX
         1   rx STX => !Connect: Conflict { yielded: true }, tx DLE
         2   done
         3   rx 41 10 03
         4   rx 52 => tx DLE, got 41, tx STX
         6   done
         7   rx DLE => tx 31 10 03 22
         11  done
         12  rx DLE => sent ok",
    );
}

/// ... so all permitted attempts remain.
#[test]
fn a_lost_conflict_costs_no_attempt() {
    run(
        Config { connect_attempts: 2, ..config(true) },
        "0   start
         0   order 31 => tx STX
         1   rx STX => !Connect: Conflict { yielded: true }, tx DLE
         2   done
         3   rx 41 10 03 52 => tx DLE, got 41, tx STX
         5   done
         6   rx NAK => !Connect: Nak, !Connect: Repetition(1), tx STX
         7   done
         8   rx NAK => !Connect: Nak, !Connect: Exhausted, tx NAK, sent Repetitions",
    );
}

/// The same when the winning partner stays silent: ZVZ, NAK, own order again.
#[test]
fn low_priority_begins_again_when_the_winner_stays_silent() {
    run(
        Config { connect_attempts: 1, ..config(true) },
        "0   start
         0   order 31 => tx STX
         1   done
         2   rx STX => !Connect: Conflict { yielded: true }, tx DLE
         3   done
         203 timeout => !Receive: CharacterDelay, tx NAK STX
         205 done
         206 rx DLE => tx 31 10 03 22",
    );
}

/// The higher priority ignores STX and waits for DLE; QVZ keeps running.
/// [TIA help "Configuration for point-to-point links"]
#[test]
fn high_priority_ignores_stx() {
    run(
        Config { priority: Priority::High, connect_attempts: 2, ..config(true) },
        "0    start
         0    order 31 => tx STX
         1    rx STX => !Connect: Conflict { yielded: false }
         1    done
         2    rx DLE => tx 31 10 03 22
         6    done
         7    rx DLE => sent ok
         10   order 32 => tx STX
         11   done
         300  rx STX => !Connect: Conflict { yielded: false }
         511  timeout => !Connect: AckDelay, !Connect: Repetition(1), tx STX
         512  done
         1012 timeout => !Connect: AckDelay, !Connect: Exhausted, tx NAK, sent AckDelay",
    );
}

/// STX in the place of the acknowledgement is a character other than DLE.
#[test]
fn stx_instead_of_the_final_dle_repeats_the_block() {
    run(
        config(true),
        "0  start
         0  order 31 => tx STX
         1  done
         2  rx DLE => tx 31 10 03 22
         6  done
         7  rx STX => !Acknowledge: Unexpected(2), !Output: Repetition(1), tx STX",
    );
}

/// An order waits while a telegram is received, and begins when that is acknowledged.
#[test]
fn an_order_waits_for_the_end_of_a_reception() {
    run(
        config(true),
        "0  start
         0  rx STX => tx DLE
         1  done
         2  rx 41
         3  order 31
         4  rx 10 03
         5  rx 52 => tx DLE, got 41, tx STX
         7  done
         8  rx DLE => tx 31 10 03 22",
    );
}

/// ZNA: "the delay time that must expire before a command is executed". [S0 "Time delay after command (ZNA)"]
#[test]
fn zna_keeps_two_orders_apart() {
    run(
        Config { zna: 40 * MS, ..config(true) },
        "0  start
         0  order 31 => tx STX
         1  done
         2  rx DLE => tx 31 10 03 22
         6  done
         7  rx DLE => sent ok
         8  order 32
         47 timeout => tx STX
         48 done
         49 rx DLE => tx 32 10 03 21
         53 done
         54 rx DLE => sent ok
         55 abort => back          # RESET: nothing to wait for any more
         56 order 33 => tx STX",
    );
}

/// One order at a time; none longer than the buffer. [S0 "Message too long": 17h]
#[test]
fn orders_that_cannot_be_taken() {
    run(
        config(true),
        "0  start
         0  order 1025*31 => sent TooLong
         1  order 31 => tx STX
         2  order 32 => sent Busy
         2  done
         3  rx DLE => tx 31 10 03 22
         7  done
         8  rx DLE => sent ok",
    );
}

/// RESET of the CPU: the order ends, once.
#[test]
fn abort_ends_the_order_wherever_it_is() {
    run(
        config(true),
        "0  start
         0  abort => back
         1  order 31 => tx STX
         2  abort => back, sent Aborted
         2  done
         3  rx DLE => !Idle: Unexpected(16), tx NAK
         4  done
         5  order 31 => tx STX
         6  done
         7  rx DLE => tx 31 10 03 22
         8  abort => back 3, sent Aborted
         9  done
         20 order 31 => tx STX
         21 done
         22 rx DLE => tx 31 10 03 22
         26 done
         27 abort => back, sent Aborted
         28 abort => back",
    );
}

/// A pulled cable is silence: it is reported, then the times run out as with a partner that is off.
#[test]
fn an_open_circuit_runs_into_qvz() {
    run(
        Config { connect_attempts: 1, ..config(true) },
        "0    start
         0    order 31 => tx STX
         1    done
         2    fault Gone => !Connect: Line(Gone)
         501  timeout => !Connect: AckDelay, !Connect: Exhausted, tx NAK, sent AckDelay",
    );
}

/// CP 341: NAK at start; a disturbed block is followed by silence, NAK and a repetition; BREAK ends the order.
/// [TIA help "Configuration for point-to-point links"]
#[test]
fn what_the_cp_341_does_otherwise() {
    run(
        Config { qvz: 500 * MS, repetition_wait: 4 * SECOND, quiet: Span::ZERO, ..defaults::cp341(true, MS) },
        "0   start => tx NAK
         1   done
         10  order 6*31 => tx STX
         11  done
         12  rx DLE => tx 6*31 10 03 13
         14  rx 55 => !Output: Unexpected(85), back 6
         16  done
         100 rx 55
         320 timeout => tx NAK, !Output: Repetition(1), tx STX
         322 done
         323 rx DLE => tx 6*31 10 03 13
         325 fault Break => !Output: Line(Break), back 5, sent Frame",
    );
}

/// QVZ of 0 ms, on a line that never reports the end of its output: the time expires in the tick in which it begins,
/// and after the tick no expired time is left.
#[test]
fn a_time_of_0_ms_is_over_in_the_same_tick() {
    run(
        Config { qvz: Span::ZERO, block_attempts: 1, ..config(true) },
        "0    start
         0    order 31 => tx STX
         5    rx DLE => tx 31 10 03 22
         1009 timeout => !Acknowledge: AckDelay, !Output: Exhausted, tx NAK, sent AckDelay",
    );
}
