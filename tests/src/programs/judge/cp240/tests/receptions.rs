//! FC 1.

use super::*;

#[test]
fn fc1_gives_something_else() {
    let mut rig = Rig::new(Protocol::P3964R);
    rig.sends(b"AAAAwhole");
    rig.gives(b"AAAAwhol");
    rig.sees_only("fc1-whole");
}

/// The check character is the same with 00h twice. The program reads it when the line has long been good.
#[test]
fn a_bad_line_has_doubled_a_character_that_the_check_does_not_see() {
    let run = |data: &[u8], calm: bool| {
        let mut rig = Rig::new(Protocol::P3964R);
        rig.sends(b"AAAA\0whole");
        rig.judge.seen.strict = if calm { Instant::START } else { rig.now };
        rig.gives(data);
        rig
    };
    run(b"AAAA\0\0whole", false).sees_nothing();
    run(b"AAAA\0\0whole", true).sees_only("fc1-whole");
    run(b"AAAA\0wholee", false).sees_only("fc1-whole");
}

/// A STX in it begins a telegram for a CP that was reset meanwhile.
#[test]
fn the_rest_of_a_telegram_has_the_check_character_of_the_whole() {
    let run = |data: &[u8], reset: bool| {
        let mut rig = Rig::new(Protocol::P3964R);
        if reset {
            rig.call(4, &[(modem::RESET, 1)], &[(modem::RESET, 1)]);
        }
        rig.sends(b"AAAA\x02\x02rest");
        rig.gives(data);
        rig
    };
    run(b"rest", true).sees_nothing();
    run(b"rest", false).sees_only("fc1-whole");
    run(b"est", true).sees_only("fc1-whole");
}

#[test]
fn fc1_gives_a_telegram_twice_or_too_late() {
    let mut rig = Rig::new(Protocol::P3964R);
    rig.sends(b"AAAAone");
    rig.sends(b"AAABtwo");
    rig.gives(b"AAABtwo");
    rig.gives(b"AAABtwo");
    rig.sees_only("fc1-twice");
    let mut rig = Rig::new(Protocol::P3964R);
    rig.sends(b"AAAAone");
    rig.sends(b"AAABtwo");
    rig.gives(b"AAABtwo");
    rig.gives(b"AAAAone");
    rig.sees_only("fc1-order");
}

#[test]
fn fc1_loses_a_telegram() {
    let mut rig = Rig::new(Protocol::P3964R);
    rig.sends(b"AAAAone");
    (0..100).for_each(|_| rig.call(2, &[], &[]));
    rig.end();
    rig.sees_only("fc1-lost");
}

#[test]
fn fc1_overwrites_what_was_not_taken() {
    let mut rig = Rig::new(Protocol::P3964R);
    let emfr = (receive::EMFR, 1);
    rig.call(2, &[emfr, (receive::ANZ, 5)], &[emfr, (receive::ANZ, 6)]);
    rig.sees_only("fc1-hold");
}

#[test]
fn pafe_is_taken_back_while_its_cause_stands() {
    // A RESET has taken the telegram, however long ago: this is the first call after it.
    for (reset, pause) in [(false, 0), (false, 200), (true, 200)] {
        let mut rig = Rig::new(Protocol::P3964R);
        rig.call(2, &[], &[(receive::PAFE, 2)]);
        (0..100).for_each(|_| rig.scan(&[]));
        if reset {
            rig.call(4, &[(modem::RESET, 1)], &[]);
        }
        (0..pause).for_each(|_| rig.scan(&[]));
        rig.call(2, &[(receive::PAFE, 2)], &[]);
        if reset { rig.sees_nothing() } else { rig.sees_only("fc1-pafe") }
    }
    let mut rig = Rig::new(Protocol::Rk512);
    let running = (fc4::ANZW, 2);
    rig.call(6, &[], &[running, (fc4::PAFE, 2)]);
    rig.call(6, &[running, (fc4::PAFE, 2)], &[running]);
    rig.sees_only("fc4-pafe");
}
