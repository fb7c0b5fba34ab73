//! RK 512: orders in both directions, telegrams and acknowledgements that get lost, and orders that end early.

use ob1_protocols::MS;
use ob1_protocols::rk512::{Area, Command, Coordination, Event, Flag, Request};

use crate::rk512_table;
use crate::rk512_table::{SEND_8, check_cp240 as check, cp240};

/// Quasi full duplex: the partner's order comes before its reaction to ours. [CP 341 manual 09/2008, p. 52 to 57]
#[test]
fn orders_in_both_directions() {
    check(&format!(
        "10 order {SEND_8} | 01..10 => tx STX
         20 takes {SEND_8} 01..10
         30 partner 00 00 45 44 05 01 00 02 FF FF => asked 00 00 45 44 05 01 00 02 FF FF
         40 answer data AA BB CC DD => tx STX
         50 takes 00 00 00 00 AA BB CC DD => answered ok
         60 partner 00 00 00 00 => ended ok"
    ));
    // Our order begins while the CPU has theirs; the reaction is sent first once both wait.
    check(&format!(
        "10 partner {SEND_8} 01..10 => asked {SEND_8} | 01..10
         20 order 00 00 45 44 05 01 00 02 FF FF => tx STX
         30 takes 00 00 45 44 05 01 00 02 FF FF
         40 partner 00 00 00 00 AA BB CC DD => ended ok AA BB CC DD
         50 answer taken => tx STX
         60 takes 00 00 00 00 => answered ok"
    ));
    // [S0 "Initialization conflict"]: low priority receives first, then begins again.
    check(&format!(
        "10 order 00 00 45 44 05 01 00 02 FF FF => tx STX
         11 partner {SEND_8} 01..10 => asked {SEND_8} | 01..10; tx STX
         12 answer taken
         20 takes 00 00 45 44 05 01 00 02 FF FF => tx STX
         30 takes 00 00 00 00 => answered ok
         40 partner 00 00 00 00 AA BB CC DD => ended ok AA BB CC DD"
    ));
}

/// A repeated telegram, because its acknowledgement or our reaction was lost, or BWZ ran out.
#[test]
fn repetitions_are_recognised() {
    // The CPU has not answered yet.
    check(&format!(
        "10 partner {SEND_8} 01..10 => asked {SEND_8} | 01..10
         20 partner {SEND_8} 01..10 => !Repeated
         30 answer taken => tx STX
         40 takes 00 00 00 00 => answered ok"
    ));
    // Our reaction has not been sent: its STX was overtaken.
    check(
        "10 partner 00 00 41 44 0A 00 00 82 FF FF 128*61 => tx STX
         11 partner 00 00 41 44 0A 00 00 82 FF FF 128*61 => !Repeated; tx STX
         20 takes 00 00 00 00
         30 partner FF 00 41 44 128*62 => tx STX
         31 partner FF 00 41 44 128*62 => !Repeated; tx STX
         40 takes FF 00 00 00
         50 partner FF 00 41 44 4*63 => asked 00 00 41 44 0A 00 00 82 FF FF | 128*61 128*62 4*63
         60 partner FF 00 41 44 4*63 => !Repeated
         70 answer taken => tx STX
         80 takes FF 00 00 00 => answered ok",
    );
    // Another order before our reaction: out of order, and the old one ends.
    check(&format!(
        "10 partner {SEND_8} 01..10 => asked {SEND_8} | 01..10
         20 partner 00 00 45 44 05 01 00 02 FF FF => !060E; answered Withdrawn 060E; tx STX
         30 takes 00 00 00 36
         40 answer taken"
    ));
}

/// The acknowledgement of our reaction is lost; the partner's next telegram shows that it has it.
#[test]
fn a_lost_acknowledgement_of_the_reaction() {
    let lost = "12 done
         13 rx DLE => tx 00 00 00 00 10 03
         20 done
         520 timeout => !0707; !0701; tx STX";
    let table = |more: &str| {
        let mut config = cp240(false);
        config.line.qvz = 500 * MS;
        rk512_table::check::<1024>(config, &format!("0 start\n{more}"));
    };
    table(&format!(
        "10 partner 00 00 41 44 0A 00 00 42 FF FF 128*61 => tx STX
         {lost}
         521 partner FF 00 41 44 4*62 => asked 00 00 41 44 0A 00 00 42 FF FF | 128*61 4*62
         530 answer taken => tx STX
         540 takes FF 00 00 00 => answered ok"
    ));
    // After a whole order: the next one.
    table(&format!(
        "8 partner 00 00 41 44 0A 00 00 01 FF FF 61 62 => asked 00 00 41 44 0A 00 00 01 FF FF | 61 62
         10 answer taken => tx STX
         {lost}
         521 partner 00 00 45 44 0A 00 00 01 FF FF => answered ok; asked 00 00 45 44 0A 00 00 01 FF FF"
    ));
    // A follow-on telegram with the data of the last one: it cannot be known which one it is. An error, never wrong
    // data.
    table(
        "10 partner 00 00 41 44 0A 00 00 C2 FF FF 128*61 => tx STX
         11 takes 00 00 00 00
         12 partner FF 00 41 44 128*61 => tx STX
         13 done
         14 rx DLE => tx FF 00 00 00 10 03
         20 done
         520 timeout => !0707; !0701; tx STX
         521 partner FF 00 41 44 128*61 => !060E; tx STX
         530 takes FF 00 00 36",
    );
}

/// The acknowledgement of our telegram is lost; the reaction shows that the partner has it.
#[test]
fn a_lost_acknowledgement_of_our_telegram() {
    let mut config = cp240(false);
    config.line.qvz = 500 * MS;
    rk512_table::check::<1024>(
        config,
        "0 start
         10 order 00 00 45 44 05 01 00 01 FF FF => tx STX
         20 done
         21 rx DLE => tx 00 00 45 44 05 01 00 01 FF FF 10 03
         40 done
         540 timeout => !0707; !0701; tx STX
         541 partner 00 00 00 00 61 62 => ended ok 61 62
         900 order 00 00 45 44 05 01 00 01 FF FF => tx STX",
    );
}

/// If the procedure below fails, the order ends with the CP's error. [S0 "Timeout times"]
#[test]
fn the_line_fails() {
    let mut config = cp240(true);
    (config.line.connect_attempts, config.line.block_attempts) = (2, 2);
    rk512_table::check::<1024>(
        config.clone(),
        &format!(
            "0 start
         10 order {SEND_8} | 01..10 => tx STX
         11 refuses => !0702; !0701
         23.083334 timeout => tx STX
         24 refuses => !0702; !0709; tx NAK; !051A; ended Line(Repetitions)"
        ),
    );
    rk512_table::check::<1024>(
        config,
        &format!(
            "0 start
         10 partner {SEND_8} 01..10 => asked {SEND_8} | 01..10
         20 answer taken => tx STX
         21 refuses => !0702; !0701
         33.083334 timeout => tx STX
         34 refuses => !0702; !0709; tx NAK; !0612; answered Line(Repetitions)
         35 done
         40 partner {SEND_8} 01..10 => asked {SEND_8} | 01..10"
        ),
    );
}

/// The CPU's RESET ends each order once.
#[test]
fn abort() {
    check(&format!(
        "10 partner 00 00 45 44 05 01 00 02 FF FF => asked 00 00 45 44 05 01 00 02 FF FF
         20 order {SEND_8} | 01..10 => tx STX
         30 abort => back; ended Aborted; answered Aborted
         31 done
         40 answer data 01 02 03 04
         50 order {SEND_8} | 01..10 => tx STX
         60 takes {SEND_8} 01..10
         70 abort => back; ended Aborted
         80 partner 00 00 00 00 => !0A01"
    ));
}

/// Coordination flags and CPU numbers are passed on unchanged. [CP 341 manual 09/2008, p. 51]
#[test]
fn flags_go_through() {
    let flag = Flag { byte: 6, bit: 4 };
    let (command, area, coordination) = (Command::Fetch, Area::Memory, Coordination::new(Some(flag), None));
    let request = Request { command, area, db: 0, start: 16, length: 32, coordination };
    assert_eq!(request.header().to_vec(), rk512_table::bytes("00 00 45 4D 00 10 00 20 06 04"));
    check(
        "10 partner 00 00 45 4D 00 10 00 01 06 14 => asked 00 00 45 4D 00 10 00 01 06 14
         20 answer data 61 => tx STX
         30 takes 00 00 00 00 61 => answered ok",
    );
    assert_eq!(Event::Repeated.number(), None);
}
