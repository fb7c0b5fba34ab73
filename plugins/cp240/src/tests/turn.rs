//! Whose turn it is.

use ob1_sdk::ModuleInfo;

use crate::turn::{GIVEN_UP, Key, Role, Take, Turn};

const MS: u64 = 1_000_000;
const A: Key = Key::new(Role::Send, 1);
const B: Key = Key::new(Role::Send, 2);
const C: Key = Key::new(Role::Line, 0);

fn module(generation: u32) -> ModuleInfo {
    ModuleInfo { address: 256, input_bytes: 16, output_bytes: 16, present: true, generation }
}

#[test]
fn who_asks_first_comes_next_however_rarely_it_is_called() {
    let (turn, cp) = (Turn::default(), module(1));
    assert_eq!(turn.take(A, &cp, 0), Take::Yes);
    turn.claim.note(5);
    assert_eq!(turn.take(C, &cp, MS), Take::No);
    assert_eq!(turn.take(B, &cp, 2 * MS), Take::No);
    turn.claim.release();
    for now in 3..500 {
        assert_eq!(turn.take(A, &cp, now * MS), Take::No, "C has asked before");
        assert_eq!(turn.take(B, &cp, now * MS), Take::No, "C has asked before");
    }
    assert_eq!(turn.take(C, &cp, 500 * MS), Take::Yes);
    turn.claim.release();
    assert_eq!(turn.take(A, &cp, 501 * MS), Take::No, "B has asked before");
    assert_eq!(turn.take(B, &cp, 501 * MS), Take::Yes);
}

#[test]
fn who_no_longer_asks_loses_its_place_and_who_is_not_called_its_claim() {
    let (turn, cp) = (Turn::default(), module(1));
    turn.take(A, &cp, 0);
    turn.claim.note(5);
    turn.take(B, &cp, 0);
    turn.take(C, &cp, 900 * MS);
    turn.claim.release();
    assert_eq!(turn.take(C, &cp, 1100 * MS), Take::Yes, "B has given up");
    turn.claim.note(1);
    assert_eq!(turn.take(A, &cp, 1100 * MS + GIVEN_UP - 1), Take::No);
    assert!(turn.claim.continues(C, 1, &cp, 1100 * MS + GIVEN_UP), "nobody has taken it");
    assert_eq!(turn.take(A, &cp, 1100 * MS + 2 * GIVEN_UP), Take::Over);
    assert!(!turn.claim.continues(C, 1, &cp, 1101 * MS + 2 * GIVEN_UP));
    assert_eq!(turn.take(A, &module(2), 1102 * MS + 2 * GIVEN_UP), Take::Over, "another start of the CP");
}

#[test]
fn a_job_of_another_block_is_never_continued() {
    let (turn, cp) = (Turn::default(), module(1));
    turn.take(A, &cp, 0);
    turn.claim.note(7);
    assert!(!turn.claim.continues(A, 8, &cp, 1), "other control words");
    assert!(!turn.claim.continues(A, 0, &cp, 1));
    assert!(turn.claim.continues(B, 7, &cp, 1), "its parameters have changed: nobody else has a job");
    assert_eq!(turn.take(B, &cp, 2 * GIVEN_UP), Take::Over);
    turn.claim.note(7);
    assert!(!turn.claim.continues(A, 7, &cp, 2 * GIVEN_UP), "A comes back, with the same control words");
    assert!(turn.claim.continues(B, 7, &cp, 2 * GIVEN_UP));
}

#[test]
fn the_owner_without_its_control_bits_begins_again_and_a_twin_waits() {
    let (turn, cp) = (Turn::default(), module(1));
    turn.take(A, &cp, 0);
    turn.claim.note(5);
    for now in 1..9 {
        assert_eq!(turn.take(A, &cp, now * MS), Take::No, "a twin");
        assert!(turn.claim.continues(A, 5, &cp, now * MS));
    }
    assert_eq!(turn.take(A, &cp, 9 * MS), Take::No);
    assert_eq!(turn.take(A, &cp, 10 * MS), Take::Over, "nobody has called with the control bits in between");
}

/// An ANZ or a LANG that was changed while the block waited, or a data block that was deleted.
#[test]
fn who_ends_before_its_turn_keeps_nobody_waiting() {
    let (turn, cp) = (Turn::default(), module(1));
    turn.take(A, &cp, 0);
    turn.claim.note(5);
    assert_eq!(turn.take(B, &cp, MS), Take::No);
    assert!(!turn.leave(A), "its job goes on");
    assert!(turn.claim.holds(&cp));
    assert!(!turn.leave(B));
    turn.claim.release();
    assert_eq!(turn.take(C, &cp, 2 * MS), Take::Yes, "B no longer asks");
    assert!(turn.leave(C), "its job has not begun");
    assert_eq!(turn.take(A, &cp, 3 * MS), Take::Yes);
}
