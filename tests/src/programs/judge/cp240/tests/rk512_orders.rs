//! FC 2, FC 3, and what FC 4 may refuse.

use super::*;

#[test]
fn an_order_of_rk_512_that_arrives_is_good() {
    let mut rig = Rig::new(Protocol::Rk512);
    rig.feed();
    rig.fc3(4, 2, 0);
    rig.order_comes(true);
    rig.fc3(2, 4, 0);
    rig.sees_nothing();
}

#[test]
fn anzw_has_bits_that_exclude_each_other() {
    for anzw in [0x000C, 0x0006, 0x0010, 0x7708] {
        let mut rig = Rig::new(Protocol::Rk512);
        rig.feed();
        rig.fc3(0, 2, 0);
        rig.order_comes(false);
        rig.fc3(2, anzw, 0);
        rig.sees("rk-anzw");
    }
}

#[test]
fn fc3_with_pafe_and_the_old_done() {
    let mut rig = Rig::new(Protocol::Rk512);
    rig.feed();
    rig.fc3(4, 4, 2);
    rig.sees_only("rk-pafe-anzw");
    let mut rig = Rig::new(Protocol::Rk512);
    rig.feed();
    rig.fc3(0, 0, 9);
    rig.sees_only("rk-pafe");
}

#[test]
fn fc3_never_ends() {
    let mut rig = Rig::new(Protocol::Rk512);
    rig.feed();
    (0..1500).for_each(|_| rig.fc3(2, 2, 0));
    rig.sees_only("rk-live");
}

/// A CP that has started anew does not know what was sent before: the first order waits, as after one without reaction.
#[test]
fn an_order_after_a_new_synchronisation_waits() {
    let run = |starts: u32, killed: bool, calls: usize| {
        let mut rig = Rig::new(Protocol::Rk512);
        if killed {
            rig.judge.deed(rig.now, &Deed::Kill);
            (0..400).for_each(|_| rig.scan(&[]));
        }
        for _ in 0..starts {
            rig.call(4, &[(modem::ANL, 1)], &[(modem::ANL, 1)]);
            rig.call(4, &[(modem::ANL, 1)], &[]);
        }
        (0..100).for_each(|_| rig.scan(&[]));
        rig.feed();
        (0..calls).for_each(|_| rig.fc3(2, 2, 0));
        rig
    };
    run(1, false, 1200).sees_only("rk-live");
    for (starts, killed) in [(2, false), (1, true)] {
        run(starts, killed, 1200).sees_nothing();
        run(starts, killed, 2000).sees_only("rk-live");
    }
}

#[test]
fn fc3_says_done_and_nothing_came() {
    let mut rig = Rig::new(Protocol::Rk512);
    rig.feed();
    rig.fc3(0, 2, 0);
    rig.fc3(2, 4, 0);
    rig.sees_only("rk-false-done");
    // It has not even begun: the bit is that of the order before.
    let mut rig = Rig::new(Protocol::Rk512);
    rig.feed();
    rig.fc3(4, 4, 0);
    rig.sees_only("rk-false-done");
}

#[test]
fn fc3_says_error_for_no_reason() {
    let mut rig = Rig::new(Protocol::Rk512);
    rig.feed();
    rig.fc3(0, 2, 0);
    rig.order_comes(true);
    rig.fc3(2, 0x0708, 0);
    rig.sees_only("rk-false-error");
    let mut rig = Rig::new(Protocol::Rk512);
    rig.feed();
    rig.fc3(0, 2, 0);
    rig.fc3(2, 0x0708, 0);
    rig.sees_only("rk-no-reason");
}

/// The CP takes it for that of this order: nothing in it says otherwise.
#[test]
fn fc3_fails_by_the_reaction_to_an_order_before() {
    let run = |late: bool| {
        let mut rig = Rig::new(Protocol::Rk512);
        rig.feed();
        rig.fc3(0, 2, 0);
        rig.order_comes(true);
        rig.now += CYCLE;
        rig.order_comes(true);
        let now = rig.now;
        let Partner240::Rk512(rk, _) = &mut rig.partner else { unreachable!("RK 512") };
        rk.line.manners = Manners { late: 1, ..Manners::GOOD };
        (rk.orders[0].command, rk.line.sent[0].acknowledged) = (b'E', Some(if late { now } else { now - CYCLE }));
        rig.fc3(2, 0x0C08, 0);
        rig
    };
    run(true).sees_nothing();
    run(false).sees_only("rk-false-error");
}

#[test]
fn an_order_that_was_sent_twice() {
    let mut rig = Rig::new(Protocol::Rk512);
    rig.feed();
    rig.fc3(0, 2, 0);
    rig.order_comes(true);
    rig.order_comes(true);
    rig.fc3(2, 4, 0);
    rig.sees_only("rk-twice");
}

#[test]
fn fc3_goes_on_after_a_reset() {
    let mut rig = Rig::new(Protocol::Rk512);
    rig.feed();
    rig.fc3(0, 2, 0);
    rig.call(4, &[(modem::RESET, 1)], &[(modem::RESET, 1)]);
    rig.order_comes(true);
    rig.fc3(2, 4, 0);
    rig.sees_only("rk-reset");
}

/// Each of the two orders after one without its reaction waits for that, and no other one.
#[test]
fn an_order_waits_for_the_reaction_to_one_before() {
    let run = |code: u32, between: usize, calls: usize| {
        let mut rig = Rig::new(Protocol::Rk512);
        let manners = |rig: &mut Rig, manners| {
            let Partner240::Rk512(rk, _) = &mut rig.partner else { unreachable!("RK 512") };
            rk.manners = manners;
        };
        manners(&mut rig, Manners::ABSENT);
        rig.feed();
        rig.fc3(0, 2, 0);
        rig.fc3(2, code << 8 | 8, 0);
        manners(&mut rig, Manners::GOOD);
        for _ in 0..between {
            rig.feed();
            rig.fc3(4, 2, 0);
            rig.order_comes(true);
            rig.fc3(2, 4, 0);
        }
        rig.feed();
        (0..calls).for_each(|_| rig.fc3(2, 2, 0));
        rig
    };
    for between in 0..2 {
        run(0x07, between, 1200).sees_nothing();
        run(0x07, between, 1400).sees_only("rk-live");
        // The partner has refused it: there was a reaction.
        run(0x10, between, 1200).sees_only("rk-live");
    }
    run(0x07, 2, 1200).sees_only("rk-live");
}

#[test]
fn fc4_that_is_no_longer_called_refuses_nothing() {
    for (calls, finds) in [(60, false), (0, true)] {
        let mut rig = Rig::new(Protocol::Rk512);
        rig.call(6, &[], &[]);
        (0..calls).for_each(|_| rig.scan(&[]));
        request(&mut rig, 60, 0x2A);
        rig.scan(&[]);
        if finds { rig.sees_only("fc4-refused") } else { rig.sees_nothing() }
    }
}

/// There is one reaction for the reaction that was too short and for the order.
#[test]
fn the_cp_refuses_an_order_in_which_something_else_comes() {
    for (short, error, finds) in [(true, 0x34, false), (true, 0x2A, true), (false, 0x34, true)] {
        let mut rig = Rig::new(Protocol::Rk512);
        rig.call(6, &[], &[]);
        rig.sends(if short { &[0, 0, 7] } else { &[0, 0, 0, 7] });
        request(&mut rig, 60, error);
        rig.call(6, &[], &[]);
        if finds { rig.sees_only("fc4-refused") } else { rig.sees_nothing() }
    }
}
