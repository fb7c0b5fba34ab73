//! FC 2 and FC 3.

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
