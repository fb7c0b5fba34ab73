//! ASCII features of the CP 341 that the CP 240 does not have: end characters, fixed length, the pause between
//! telegrams, the secondary signals; as message tables. One character takes 1 ms, ZVZ is 20 ms.
//! [TIA help "Configuration for point-to-point links"]

use ob1_protocols::ascii::{Ascii, Config, Criterion, Flags, Flow, Sending};
use ob1_protocols::signals::Times;
use ob1_protocols::{MS, Span};

use crate::common::check;
use crate::defaults;

fn config(criterion: Criterion) -> Config {
    Config { criterion, zvz: 20 * MS, ..defaults::ascii(MS) }
}

/// CR, or CR LF.
fn by_end(count: u8, sending: Sending) -> Config {
    config(Criterion::Characters { end: Flags::new([0x0D, 0x0A], count), sending })
}

fn one() -> Config {
    by_end(1, Sending::Through)
}

fn two() -> Config {
    by_end(2, Sending::Through)
}

fn run(config: &Config, table: &str) {
    check(&mut Ascii::<1024>::new(config), table);
}

/// The end characters belong to the telegram, which is delivered at once.
/// [TIA help "Configuration for point-to-point links"]
#[test]
fn a_telegram_ends_with_one_end_character() {
    run(
        &one(),
        "0   start
         10  rx 34 30
         29  rx 30
         30  rx 0D => got 34 30 30 0D
         90  rx 0D => got 0D
         150 rx 41 0A 0D => got 41 0A 0D",
    );
}

#[test]
fn a_telegram_ends_with_two_end_characters_in_their_order() {
    run(
        &two(),
        "0   start
         10  rx 34 0D
         20  rx 0A => got 34 0D 0A
         50  rx 0A 0D 41 0D 0D 0A => got 0A 0D 41 0D 0D 0A
         # The first of the next burst is no second of this one.
         80  rx 42 0D 0A 0A 0D 0A => got 42 0D 0A, got 0A 0D 0A",
    );
    // Twice the same character.
    let twice = Criterion::Characters { end: Flags::new([0x0D, 0x0D], 2), sending: Sending::Through };
    run(&config(twice), "0 start\n 10 rx 41 0D 42 0D 0D 0D => got 41 0D 42 0D 0D\n 11 rx 0D => got 0D 0D");
}

/// "If ZVZ expires first: 0806h, fragment discarded." [TIA help "Configuration for point-to-point links"]
#[test]
fn zvz_before_the_end_characters() {
    run(
        &two(),
        "0  start
         10 rx 34 30 0D
         30 timeout => !Receive: CharacterDelay
         31 rx 0A 41 0D 0A => got 0A 41 0D 0A",
    );
}

/// Characters after it in the same burst begin the next telegram, and are discarded when ZVZ expires before that has
/// ended. [TIA help "Configuration for point-to-point links"]
#[test]
fn what_follows_in_the_same_burst() {
    run(
        &one(),
        "0  start
         10 rx 41 0D 42 43 => got 41 0D
         29 rx 44 0D 45 => got 42 43 44 0D
         49 timeout => !Receive: CharacterDelay
         60 rx 46 0D => got 46 0D",
    );
    run(
        &config(Criterion::Length(3)),
        "0  start
         10 rx 41 42 43 44 45 => got 41 42 43
         29 rx 46 47 48 49 4A => got 44 45 46, got 47 48 49
         49 timeout => !Receive: CharacterDelay",
    );
}

/// Exactly this many characters, whatever they are; if ZVZ expires first: 0806h.
/// [TIA help "Configuration for point-to-point links"]
#[test]
fn a_telegram_of_fixed_length() {
    run(
        &config(Criterion::Length(5)),
        "0   start
         10  rx 0D 0A 11 13
         29  rx 00 => got 0D 0A 11 13 00
         50  rx 41 42 43 44
         70  timeout => !Receive: CharacterDelay
         71  rx 5*45 => got 5*45",
    );
    run(&config(Criterion::Length(1)), "0 start\n 10 rx 41 42 => got 41, got 42");
    run(
        &config(Criterion::Length(1024)),
        "0 start\n 10 rx 1024*41 42 => got 1024*41\n 30 timeout => !Receive: CharacterDelay",
    );
}

/// A lost telegram is followed to its end, so that the next one is whole.
#[test]
fn the_telegram_after_a_lost_one_is_whole() {
    run(
        &one(),
        "0  start
         10 rx 41
         11 fault Parity => !Receive: Line(Parity)
         12 fault Framing => !Idle: Line(Framing)     # costs nothing more
         13 rx 42 0D 43 0D => got 43 0D
         20 fault Break => !Receive: Line(Break)
         40 timeout
         41 rx 44 0D => got 44 0D
         # An end character that could not be read is none.
         50 rx 45
         51 fault Parity => !Receive: Line(Parity)
         52 rx 46 0D 47 0D => got 47 0D",
    );
    run(
        &two(),
        "0  start
         10 rx 41 0D
         11 fault Parity => !Receive: Line(Parity)
         12 rx 0A 42 0D 0A 43 0D 0A => got 43 0D 0A",
    );
    run(
        &config(Criterion::Length(3)),
        "0  start
         10 rx 41
         11 fault Parity => !Receive: Line(Parity)
         12 rx 42 43 44 45 => got 43 44 45",
    );
}

/// [TIA help "Configuration for point-to-point links"]: 080Ah without a free receive buffer, 0816h longer than the
/// longest.
#[test]
fn no_room_and_too_long() {
    run(
        &one(),
        "0  start
         0  room 0
         10 rx 41 => !Receive: NoBuffer
         11 room 100
         12 rx 42 0D 43 0D => got 43 0D
         20 room 2
         30 rx 44 45 0D => !Receive: NoBuffer
         31 rx 46 0D => got 46 0D",
    );
    run(
        &one(),
        "0  start
         10 rx 1023*41 0D => got 1023*41 0D
         20 rx 1025*41 => !Receive: TooLong
         21 rx 0D 42 0D => got 42 0D",
    );
}

/// XON and XOFF never belong to a telegram, and do not count. [TIA help "Configuration for point-to-point links"]
#[test]
fn flow_control_characters_do_not_count() {
    let config = Config { flow: Flow::XonXoff, ..config(Criterion::Length(3)) };
    run(&config, "0 start => tx XON\n 1 done\n 10 rx 41 XOFF XON 42 43 => got 41 42 43");
}

/// "Up to and including the end character; not found within LEN: 050Eh."
/// [TIA help "Configuration for point-to-point links"]
#[test]
fn sending_up_to_the_end_characters() {
    run(
        &one(),
        "0  start
         0  order 41 42 0D 43 0D => tx 41 42 0D
         3  done => sent ok
         10 order 0D => tx 0D
         11 done => sent ok
         20 order 41 42 0A => sent NoEnd
         21 order 1023*41 0D 42 => tx 1023*41 0D",
    );
    run(
        &two(),
        "0  start
         0  order 0A 0D 42 0D 0A 43 => tx 0A 0D 42 0D 0A
         5  done => sent ok
         10 order 41 0D => sent NoEnd",
    );
}

/// "Exactly LEN" [TIA help "Configuration for point-to-point links"]
#[test]
fn sending_as_much_as_there_is() {
    run(
        &by_end(1, Sending::Whole),
        "0  start
         0  order 41 0D 42 => tx 41 0D 42
         3  done => sent ok
         10 order 41 => tx 41
         11 done => sent ok
         20 order 1024*41 => tx 1024*41",
    );
}

/// "LEN bytes plus the end characters; exceeding the maximum length: 050Eh."
/// [TIA help "Configuration for point-to-point links"]
#[test]
fn sending_with_end_characters_appended() {
    run(
        &by_end(2, Sending::Appended),
        "0    start
         0    order 41 0D => tx 41 0D 0D 0A
         4    done => sent ok
         10   order 1023*41 => sent NoEnd
         11   order 1022*41 => tx 1022*41 0D 0A
         1035 done => sent ok",
    );
    run(&by_end(1, Sending::Appended), "0 start\n 0 order 1024*41 => sent NoEnd\n 1 order 1023*41 => tx 1023*41 0D");
}

/// "A pause of at least ZVZ is kept between two telegrams": the order ends before it.
/// [TIA help "Configuration for point-to-point links"]
#[test]
fn a_pause_between_two_telegrams() {
    let config = Config { pause: 20 * MS, ..config(Criterion::Silence) };
    run(
        &config,
        "0  start
         0  order 41 => tx 41
         1  done => sent ok
         2  order 42
         3  order 43 => sent Busy
         21 timeout => tx 42
         22 done => sent ok
         42 order 44 => tx 44
         43 done => sent ok
         44 order 45
         50 abort => back, sent Aborted
         100 order 46 => tx 46",
    );
    run(
        &Config { pause: Span::ZERO, ..config },
        "0 start\n 0 order 41 => tx 41\n 1 done => sent ok\n 1 order 42 => tx 42",
    );
}

// ---- automatic use of the secondary signals ----

fn with_signals(rts_off_ms: u64, output_wait_ms: u64) -> Config {
    let signals = Times { rts_off: rts_off_ms * MS, output_wait: output_wait_ms * MS };
    Config { signals: Some(signals), ..config(Criterion::Silence) }
}

/// RTS ON, waiting time, data, time to RTS OFF. [S4 L811], [S4 L813], [S4 L815]
#[test]
fn signals_around_a_telegram() {
    run(
        &with_signals(30, 50),
        "0   start => rts off, dtr on
         1   lines cts dsr
         10  order 41 42 => rts on
         60  timeout => tx 41 42
         62  done => sent ok
         70  rx 43                   # while DSR is ON
         90  timeout => got 43
         92  timeout => rts off
         # The next one takes RTS over, with the whole waiting time.
         100 order 44 => rts on
         150 timeout => tx 44
         151 done => sent ok
         160 order 45 => rts on
         161 lines dsr               # CTS may come as late as the end of the waiting time
         200 lines cts dsr
         210 timeout => tx 45
         211 done => sent ok
         212 lines dsr               # after the data CTS does not count
         241 timeout => rts off",
    );
    run(
        &with_signals(0, 0),
        "0  start => rts off, dtr on
         1  lines cts dsr
         10 order 41 => rts on, tx 41
         11 done => sent ok
         11 timeout => rts off",
    );
}

/// 0818h. [S4 L814], [S4 L817]
#[test]
fn signals_that_go_off() {
    run(
        &with_signals(30, 50),
        "0   start => rts off, dtr on
         1   lines dsr
         10  order 41 => rts on
         60  timeout => !Output: Signals, rts off, sent Signals
         70  lines cts
         71  order 41 => !Output: Signals, sent Signals
         80  lines cts dsr
         90  order 41 => rts on
         100 lines cts => !Output: Signals, rts off, sent Signals
         110 lines cts dsr
         120 order 41 42 => rts on
         170 timeout => tx 41 42
         171 lines dsr => back 1, !Output: Signals, rts off, sent Signals
         180 lines cts dsr
         190 order 41 42 => rts on
         240 timeout => tx 41 42
         241 lines cts => back 1, !Output: Signals, rts off, sent Signals
         250 lines cts dsr
         260 order 41 => rts on
         270 abort => back, rts off, sent Aborted",
    );
}

/// "Data can be received as soon as the DSR line is set to ON"; a receipt is aborted when it goes OFF. [S4 L816],
/// [S4 L817]
#[test]
fn nothing_is_received_while_dsr_is_off() {
    run(
        &with_signals(30, 50),
        "0  start => rts off, dtr on
         1  lines cts
         10 rx 41
         11 fault Parity
         20 lines cts dsr
         30 rx 42
         31 lines cts => !Receive: Signals
         32 rx 43
         33 lines cts dsr
         34 rx 44                    # the rest of it
         54 timeout
         60 rx 45
         80 timeout => got 45",
    );
    // With XON/XOFF, DSR OFF does not stop the output.
    run(
        &Config { flow: Flow::XonXoff, ..with_signals(0, 0) },
        "0  start => rts off, dtr on, tx XON
         1  done
         2  lines cts
         3  rx XOFF
         4  lines cts dsr
         5  order 41 => rts on, tx 41",
    );
}

/// If a line does not report its signals, they count as ON.
#[test]
fn a_line_without_signals() {
    run(&with_signals(0, 50), "0 start => rts off, dtr on\n 10 order 41 => rts on\n 60 timeout => tx 41");
}
