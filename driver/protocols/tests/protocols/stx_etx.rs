//! STX/ETX: every branch as a message table. One character takes 1 ms.

use ob1_protocols::MS;
use ob1_protocols::ascii::Flow;
use ob1_protocols::stx_etx::{Config, Flags, StxEtx};

use crate::common::check;
use crate::defaults;

fn config() -> Config {
    defaults::stx_etx(MS)
}

/// Start characters `{` `(`, end characters `)` `}`, as many as given.
fn braces(start: u8, end: u8) -> Config {
    Config { start: Flags::new(*b"{(", start), end: Flags::new(*b")}", end), ..config() }
}

fn run(config: &Config, table: &str) {
    check(&mut StxEtx::<1024>::new(config), table);
}

/// [S0 "STX/ETX"]: the CP encloses the user data with STX and ETX. [S0 "Time delay after command (ZNA)"]
#[test]
fn an_order_is_enclosed_and_done_after_zna() {
    run(
        &Config { zna: 60 * MS, ..config() },
        "0   start
         0   order 41 42 => tx STX 41 42 ETX
         1   order 43 => sent Busy
         4   done
         64  timeout => sent ok
         70  order 43 => tx STX 43 ETX
         71  rx STX 45 ETX => got 45     # full duplex
         73  done
         133 timeout => sent ok",
    );
    run(
        &config(),
        "0 start
         0 order 41 => tx STX 41 ETX
         3 done => sent ok
         4 order 1025*41 => sent TooLong
         5 order 1024*41 => tx STX 1024*41 ETX",
    );
}

/// [S0 "Number of start flags"], [S0 "Number of end flags"]: 0..2; unused ones are ignored.
#[test]
fn none_one_or_two_characters() {
    for (start, end, sent) in [
        (0, 0, "41"),
        (0, 1, "41 29"),
        (0, 2, "41 29 7D"),
        (1, 0, "7B 41"),
        (1, 1, "7B 41 29"),
        (1, 2, "7B 41 29 7D"),
        (2, 0, "7B 28 41"),
        (2, 1, "7B 28 41 29"),
        (2, 2, "7B 28 41 29 7D"),
    ] {
        // And each configuration receives what it sends: at once if there is an end, otherwise after TMO.
        let arrival =
            if end > 0 { format!("20 rx {sent} => got 41") } else { format!("20 rx {sent}\n220 timeout => got 41") };
        run(&braces(start, end), &format!("0 start\n0 order 41 => tx {sent}\n9 done => sent ok\n{arrival}"));
    }
}

/// [S0 "STX/ETX"]: data must be preceded by STX; other characters are discarded. This is reported once, not for each
/// character.
#[test]
fn before_the_start_all_is_thrown_away() {
    run(
        &config(),
        "0   start
         10  rx 41 => !Idle: Unexpected(65)
         11  rx 42 ETX 43
         500 rx STX 44 ETX => got 44
         501 rx 45 => !Idle: Unexpected(69)",
    );
    // One of two start characters alone is discarded too.
    run(
        &braces(2, 1),
        "0   start
         10  rx 7B
         11  rx 41 => !Idle: Unexpected(123)
         12  rx 28 41 29
         20  rx 7B 7B 28 42 29 => got 42   # { {( B )
         30  rx 7B
         230 timeout => !Idle: Unexpected(123)
         231 rx 28 43 29",
    );
}

/// [S0 "STX/ETX"]: all the characters between STX and ETX; handed over when ETX has been received, not before.
#[test]
fn between_start_and_end_all_is_data() {
    run(
        &config(),
        "0   start
         10  rx STX 41
         209 rx 42
         408 rx 00 FF DLE NAK
         409 rx ETX => got 41 42 00 FF DLE NAK
         410 rx STX 43 ETX STX 44 ETX => got 43, got 44",
    );
    // One of two end characters alone is user data, and so is one of two start characters.
    run(
        &braces(2, 2),
        "0  start
         10 rx 7B 28 29 41 29 29 7D => got 29 41 29
         20 rx 7B 28 7B 42 29 7D => got 7B 42
         30 rx 7B 28 7D 28 29 7B 29 7D => got 7D 28 29 7B",
    );
}

/// [S0 "Technical Data Protocols"]: end recognition after TMO, if there are no end characters.
#[test]
fn without_end_characters_tmo_ends_the_telegram() {
    run(
        &braces(1, 0),
        "0   start
         10  rx 7B 41
         210 rx 42             # just in time
         410 timeout => got 41 42
         420 rx 43 => !Idle: Unexpected(67)
         500 rx 7B
         700 timeout => !Receive: Empty",
    );
    run(
        &braces(0, 0),
        "0   start
         10  rx 41
         209 rx 42
         409 timeout => got 41 42",
    );
    // A character held back belongs to the telegram.
    run(
        &braces(2, 0),
        "0   start
         10  rx 7B 28 41 7B
         210 timeout => got 41 7B",
    );
}

/// [S0 "Timeout (TMO)"]: a telegram whose end does not come is lost; the next one is not.
#[test]
fn tmo_within_a_telegram() {
    run(
        &config(),
        "0   start
         10  rx STX 41
         210 timeout => !Receive: CharacterDelay
         211 rx 42 ETX => !Idle: Unexpected(66)
         220 rx STX 43 ETX => got 43",
    );
    run(
        &braces(0, 2),
        "0   start
         10  rx 41
         12  rx 29
         212 timeout => !Receive: CharacterDelay
         220 rx 42 29 7D => got 42",
    );
}

/// A start within a telegram: the end before it was lost.
#[test]
fn a_start_within_a_telegram() {
    run(
        &config(),
        "0  start
         10 rx STX 41 STX => !Receive: Restarted
         11 rx 42 ETX => got 42
         20 rx STX STX 43 ETX => !Receive: Restarted, got 43",
    );
    run(
        &braces(2, 1),
        "0  start
         10 rx 7B 28 41 7B 28 => !Receive: Restarted
         11 rx 42 29 => got 42",
    );
}

/// Start and end may be the same character.
#[test]
fn quotes() {
    run(
        &Config { start: Flags::new([0x22, 0], 1), end: Flags::new([0x22, 0], 1), ..config() },
        "0  start
         10 rx 22 41 22 => got 41
         11 rx 22 42 22 22 43 22 => got 42, got 43
         20 rx 22 44
         21 fault Parity => !Receive: Line(Parity)
         22 rx 22               # its end, not a start
         23 rx 22 45 22 => got 45",
    );
}

/// Telegrams without user data are not delivered.
#[test]
fn empty() {
    run(
        &config(),
        "0  start
         10 rx STX ETX => !Receive: Empty
         11 rx STX 41 ETX => got 41",
    );
    // A reader that ends its lines with CR LF and sends an empty one.
    run(
        &Config { start: Flags::NONE, end: Flags::new(*b"\r\n", 2), ..config() },
        "0  start
         10 rx 0D 0A => !Receive: Empty
         11 rx 41 0D 42 0D 0A => got 41 0D 42",
    );
}

/// [S0 "Communication via back plane bus"]: when the buffer is filled up, new telegrams are rejected.
#[test]
fn no_receive_buffer() {
    run(
        &config(),
        "0   start
         0   room 0
         10  rx STX => !Receive: NoBuffer
         11  rx 41
         12  room 100
         13  rx 42 ETX
         14  rx STX 43 ETX => got 43
         20  rx STX 44
         21  room 0
         22  rx ETX => !Receive: NoBuffer
         23  room 100
         24  rx STX 45
         25  room 0
         26  rx STX => !Receive: Restarted, !Receive: NoBuffer
         27  room 100
         28  rx STX 46 ETX => got 46",
    );
    run(
        &braces(0, 1),
        "0   start
         0   room 0
         10  rx 41 => !Receive: NoBuffer
         11  room 100
         12  rx 42 29
         13  rx 43 29 => got 43",
    );
}

/// [S0 "Communication via back plane bus"]: rejected, whether it is too long for the ring buffer or what is left of it
/// is too short. Only the first is a wrong length.
#[test]
fn telegram_length() {
    run(
        &config(),
        "0  start
         10 rx STX 1024*41 ETX => got 1024*41
         11 rx STX 1025*41 => !Receive: TooLong
         12 rx 42 ETX STX 43 ETX => got 43
         20 room 2
         21 rx STX 41 42 43 ETX => !Receive: NoBuffer
         22 rx STX 41 42 ETX => got 41 42",
    );
    run(
        &braces(1, 0),
        "0   start
         10  rx 7B 1025*41 => !Receive: TooLong
         11  rx 42
         211 timeout
         212 rx 7B 43
         412 timeout => got 43",
    );
}

/// A telegram with a character that could not be read is not passed on.
#[test]
fn line_faults() {
    run(
        &config(),
        "0   start
         5   fault Framing => !Receive: Line(Framing)   # it may have been STX
         6   fault Framing => !Idle: Line(Framing)
         10  rx STX 41
         11  fault Parity => !Receive: Line(Parity)
         12  rx 42 ETX
         20  rx STX 43 ETX => got 43
         30  rx STX 44
         31  fault Break => !Receive: Line(Break)
         32  rx STX 45 ETX => got 45
         40  rx STX 46
         41  fault Gone => !Receive: Line(Gone)   # silence deals with it
         240 timeout => !Receive: CharacterDelay",
    );
    // Without start characters it may have been the first character of a telegram.
    run(
        &braces(0, 1),
        "0   start
         10  fault Parity => !Receive: Line(Parity)
         11  rx 41 29
         12  rx 42 29 => got 42
         20  fault Parity => !Receive: Line(Parity)
         220 timeout
         221 rx 43 29 => got 43",
    );
}

/// [S0 "Flow control"]: as for ASCII; XON and XOFF do not belong to a telegram.
#[test]
fn flow_control() {
    run(
        &Config { flow: Flow::XonXoff, ..config() },
        "0   start => tx XON
         10  order 20*41 => tx STX 15*41
         15  rx XOFF
         26  done
         100 rx XON => tx 5*41 ETX
         106 done => sent ok
         200 rx STX 41 XOFF 42 XON ETX => got 41 42
         300 rx STX 41
         301 room 0
         302 rx ETX => !Receive: NoBuffer, tx XOFF
         322 room 49
         342 room 50 => tx XON",
    );
    run(
        &Config { flow: Flow::Hardware, ..config() },
        "0  start => rts on
         1  cts off
         10 order 41
         20 cts on => tx STX 41 ETX
         23 done => sent ok",
    );
    run(
        &Config { flow: Flow::Hardware, ..config() },
        "0     start => rts on
         1     cts off
         10    order 41
         20010 timeout => !Output: AckDelay, sent AckDelay",
    );
}

/// RESET of the CPU.
#[test]
fn abort() {
    run(
        &config(),
        "0  start
         10 rx STX 41
         11 order 42 43 => tx STX 42 43 ETX
         12 abort => back, sent Aborted
         13 rx 44 ETX => !Idle: Unexpected(68)
         14 rx STX 45 ETX => got 45",
    );
}
