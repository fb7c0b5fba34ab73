//! ASCII: every branch as a message table. One character takes 1 ms.

use ob1_protocols::ascii::{Ascii, Config, Criterion, Flow};
use ob1_protocols::{MS, Span};

use crate::common::check;
use crate::defaults;

fn config() -> Config {
    defaults::ascii(MS)
}

fn run(config: &Config, table: &str) {
    check(&mut Ascii::<1024>::new(config), table);
}

/// [S0 "ASCII"]: done when the data have been transferred and ZNA has expired.
#[test]
fn an_order_is_done_zna_after_the_last_bit() {
    run(
        &Config { zna: 60 * MS, ..config() },
        "0   start
         0   order 41 42 43 => tx 41 42 43
         1   order 44 => sent Busy
         3   done
         63  timeout => sent ok
         70  order 44 => tx 44
         71  done
         80  rx 45            # full duplex
         131 timeout => sent ok
         280 timeout => got 45",
    );
    run(
        &config(),
        "0 start
         0 order 41 => tx 41
         1 done => sent ok
         2 order 1025*41 => sent TooLong
         3 order 1024*41 => tx 1024*41",
    );
}

/// [S0 "Communication via back plane bus"]: a telegram is complete with the expiration of ZVZ.
#[test]
fn a_telegram_ends_with_zvz() {
    run(
        &config(),
        "0   start
         10  rx 41
         209 rx 42 43
         409 timeout => got 41 42 43
         500 rx 44
         700 timeout => got 44",
    );
}

/// [S0 "Character delay time (ZVZ)"]: 0: about double character time.
#[test]
fn zvz_of_zero_is_two_characters() {
    run(
        &Config { zvz: Span::ZERO, ..config() },
        "0  start
         10 rx 41
         11 rx 42
         13 timeout => got 41 42",
    );
}

/// [S0 "Number of receive buffers"]: while it is occupied nothing can be received, not even the rest of a telegram.
#[test]
fn no_receive_buffer() {
    run(
        &config(),
        "0   start
         0   room 0
         10  rx 41 => !Receive: NoBuffer
         11  room 100
         12  rx 42
         212 timeout
         213 rx 43
         413 timeout => got 43",
    );
}

/// [S0 "Communication via back plane bus"]: too long for the ring buffer, or for what is left in it: rejected.
#[test]
fn telegram_length() {
    run(
        &config(),
        "0    start
         10   rx 1024*41
         210  timeout => got 1024*41
         300  rx 1025*41 => !Receive: TooLong
         301  rx 42
         501  timeout
         510  room 2
         511  rx 41 42 43
         711  timeout => !Receive: NoBuffer
         720  rx 41 42
         800  room 0
         920  timeout => !Receive: NoBuffer",
    );
}

/// A telegram with a character that could not be read is not passed on.
#[test]
fn line_faults() {
    run(
        &config(),
        "0   start
         10  rx 41
         11  fault Parity => !Receive: Line(Parity)
         12  rx 42
         212 timeout
         213 fault Break => !Receive: Line(Break)
         413 timeout
         414 fault Gone => !Idle: Line(Gone)
         420 rx 43
         620 timeout => got 43",
    );
}

/// [S0 "Communication with ASCII-fragmented"]: blocks of 12 bytes at once, the rest when the line falls silent; if
/// nothing is left, only the end. A receiver that has a part learns when the rest is lost.
#[test]
fn fragments() {
    run(
        &Config { criterion: Criterion::Fragments, ..config() },
        "0   start
         10  rx 11*41
         11  rx 42 43 => more 11*41 42
         211 timeout => got 43
         220 rx 12*44 => more 12*44
         420 timeout => end
         430 rx 12*44 => more 12*44
         431 room 5
         432 rx 12*45 46 => !Receive: NoBuffer, broken
         433 rx 47
         633 timeout
         640 rx 41 42 43
         840 timeout => got 41 42 43
         900 rx 12*44 => !Receive: NoBuffer
         901 room 1024
         902 rx 12*45
         1102 timeout
         1110 rx 12*44 41 => more 12*44
         1111 fault Parity => !Receive: Line(Parity), broken
         1112 rx 12*45
         1312 timeout",
    );
}

/// [S0 "Flow control"]: XON = 11h, XOFF = 13h. They are not delivered; XOFF stops us, XON lets us continue.
#[test]
fn xoff_stops_us() {
    run(
        &Config { flow: Flow::XonXoff, ..config() },
        "0   start => tx XON
         1   done
         10  order 20*41 => tx 16*41
         15  rx XOFF
         26  done                  # what is leaving leaves
         100 rx XOFF XON => tx 4*41
         104 done => sent ok
         200 rx 41 XOFF 42 XON
         400 timeout => got 41 42
         500 order 17*41 => tx 16*41
         510 rx XOFF XON XOFF
         516 done
         600 rx XON => tx 41
         601 done => sent ok",
    );
}

/// An order does not wait for XON forever. [TIA help "Configuration for point-to-point links"]
#[test]
fn waiting_for_xon_has_an_end() {
    run(
        &Config { flow: Flow::XonXoff, ..config() },
        "0     start => tx XON
         0     rx XOFF
         10    order 41
         20010 timeout => !Output: AckDelay, sent AckDelay
         20030 order 41 => tx 41     # the XON may have been lost; a partner that is really full says XOFF again
         20031 rx XOFF
         20032 done => sent ok",
    );
}

/// Without flow control the two characters are data.
#[test]
fn xon_and_xoff_are_data_without_flow_control() {
    run(
        &config(),
        "0   start
         0   rx XOFF 41 XON
         200 timeout => got XOFF 41 XON",
    );
}

/// While no receive buffer is free the partner is stopped.
#[test]
fn we_stop_the_partner() {
    run(
        &Config { flow: Flow::XonXoff, ..config() },
        "0   start => tx XON
         1   room 1
         10  rx 41 42
         210 timeout => !Receive: NoBuffer, tx XOFF
         220 rx 43              # it was under way already
         250 room 49
         300 room 50 => tx XON
         420 timeout => got 43",
    );
    // The sink of the tables keeps its room, so it is taken away just before the end.
    run(
        &Config { flow: Flow::XonXoff, ..config() },
        "0   start => tx XON
         10  rx 41
         100 room 0
         210 timeout => !Receive: NoBuffer, tx XOFF
         250 room 0
         290 room 100 => tx XON",
    );
    run(
        &Config { flow: Flow::Hardware, ..config() },
        "0   start => rts on
         10  rx 41
         100 room 0
         210 timeout => !Receive: NoBuffer, rts off
         235 room 100 => rts on",
    );
}

/// [S0 "Flow control"]: hardware flow control uses RTS and CTS.
#[test]
fn cts_stops_us() {
    run(
        &Config { flow: Flow::Hardware, ..config() },
        "0   start => rts on
         1   cts off
         10  order 41
         20  cts on => tx 41
         21  done => sent ok
         30  order 20*42 => tx 16*42
         40  cts off
         46  done
         50  cts on => tx 4*42
         54  done => sent ok",
    );
}

/// A driver below us that holds back the output by itself: the order still ends.
#[test]
fn output_that_never_leaves() {
    run(
        &config(),
        "0     start
         0     order 41 42 => tx 41 42
         20002 timeout => back, !Output: AckDelay, sent AckDelay",
    );
}

/// RESET of the CPU.
#[test]
fn abort() {
    run(
        &Config { zna: 60 * MS, ..config() },
        "0   start
         0   rx 41
         1   order 42 => tx 42
         2   done
         3   abort => back, sent Aborted
         4   abort => back
         500 rx 43
         700 timeout => got 43",
    );
}
