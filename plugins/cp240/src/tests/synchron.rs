//! FC 9, each row of the table in `docs/cp240-registers.md`.

use super::fake_cp::FakeCp;
use crate::registers::{NO_PARAMETERS, RESET, STARTUP, SYSTEM, Words};
use crate::state::CpState;
use crate::synchron::{Bits, Step};

const EMPTY: Words = Words { rx: 0, tx_echo: 0 };
const IDLE: Bits = Bits { anl: false, null: false, reset: false };
const ANL: Bits = Bits { anl: true, null: false, reset: false };
const DELAY: Bits = Bits { anl: true, null: true, reset: false };

/// What the plugin remembers after acknowledging `number`.
fn after(number: u8, emptied: bool) -> CpState {
    let state = CpState::default();
    state.acknowledged.set(number);
    state.emptied.set(emptied);
    state
}

fn fresh() -> CpState {
    CpState::default()
}

fn start_up(number: u8) -> Words {
    Words { rx: STARTUP, tx_echo: SYSTEM | u16::from(number) }
}

#[test]
fn without_anl_nothing_happens_until_something_asks() {
    assert_eq!(IDLE.step(EMPTY, true, &fresh()), (IDLE, Step::Wait));
    assert_eq!(
        IDLE.step(Words { rx: 18, tx_echo: 30 }, true, &fresh()),
        (IDLE, Step::Wait),
        "telegrams are not its affair"
    );
    assert_eq!(
        IDLE.step(start_up(4), true, &fresh()),
        (DELAY, Step::Acknowledge(4, true)),
        "unasked: it sets ANL itself"
    );
    let reset = Bits { reset: true, ..IDLE };
    assert_eq!(reset.step(EMPTY, true, &fresh()), (Bits { anl: true, ..reset }, Step::RequestReset));
}

#[test]
fn anl_asks_for_a_reset_until_the_identifier_is_visible() {
    assert_eq!(ANL.step(EMPTY, true, &fresh()), (ANL, Step::RequestReset));
    assert_eq!(ANL.step(Words { rx: 18, tx_echo: 0 }, true, &fresh()), (ANL, Step::RequestReset));
    assert_eq!(
        ANL.step(EMPTY, false, &fresh()),
        (ANL, Step::RequestReset),
        "the CP is down: it finds the request when it is back"
    );
    assert_eq!(ANL.step(Words { rx: NO_PARAMETERS, tx_echo: SYSTEM | 1 }, true, &fresh()), (ANL, Step::Wait));
    assert_eq!(ANL.step(start_up(255), true, &fresh()), (DELAY, Step::Acknowledge(255, true)));
}

#[test]
fn words_that_only_look_like_a_start_up_are_none() {
    for words in [
        Words { rx: STARTUP, tx_echo: SYSTEM },
        Words { rx: STARTUP, tx_echo: 0x8101 },
        Words { rx: STARTUP, tx_echo: 1 },
        Words { rx: 0x8002, tx_echo: SYSTEM | 1 },
    ] {
        assert_eq!(IDLE.step(words, true, &fresh()), (IDLE, Step::Wait), "{words:04X?}");
    }
}

#[test]
fn after_the_acknowledgement_both_directions_must_be_empty() {
    assert_eq!(
        DELAY.step(start_up(4), true, &after(4, false)),
        (DELAY, Step::Acknowledge(4, false)),
        "the CP has not looked yet"
    );
    assert_eq!(
        DELAY.step(start_up(5), true, &after(4, false)),
        (DELAY, Step::Acknowledge(5, true)),
        "another start-up"
    );
    assert_eq!(DELAY.step(Words { rx: 0, tx_echo: 6 }, true, &after(4, false)), (DELAY, Step::Wait));
    assert_eq!(DELAY.step(EMPTY, true, &after(4, false)), (DELAY, Step::Empty));
    assert_eq!(DELAY.step(EMPTY, false, &after(4, false)), (DELAY, Step::Wait), "0 because the driver is down");
}

#[test]
fn an_emptied_cp_works_while_the_delay_runs() {
    let offers = Words { rx: 18, tx_echo: 0 };
    assert_eq!(DELAY.step(offers, true, &after(4, true)), (DELAY, Step::EndAfterDelay));
    assert_eq!(DELAY.step(EMPTY, false, &after(4, true)), (DELAY, Step::Wait), "its process has ended");
    assert_eq!(DELAY.step(start_up(5), true, &after(4, true)), (DELAY, Step::Acknowledge(5, true)));
}

#[test]
fn a_null_that_was_retentive_is_recognised() {
    assert_eq!(
        DELAY.step(EMPTY, true, &fresh()).1,
        Step::RequestReset,
        "nothing was acknowledged since the CPU's start-up"
    );
    assert_eq!(
        Bits { null: true, ..IDLE }.step(start_up(1), true, &after(9, false)),
        (DELAY, Step::Acknowledge(1, true))
    );
}

#[test]
fn cpu_and_cp_find_together() {
    let mut cp = FakeCp::working();
    let (mut bits, state, mut steps) = (ANL, fresh(), Vec::new());
    for _ in 0..6 {
        let (next, step) = bits.step(cp.words(), true, &state);
        bits = next;
        steps.push(step);
        match step {
            Step::RequestReset => cp.write(0, &RESET.to_be_bytes()),
            Step::Acknowledge(number, _) => {
                state.acknowledged.set(number);
                cp.write(0, &[0x80, 1, 0x80, number]);
            }
            Step::Empty => {
                cp.write(0, &[0; 4]);
                state.emptied.set(true);
            }
            Step::EndAfterDelay => bits = IDLE,
            Step::Wait => {}
        }
        cp.look();
    }
    let acknowledge = Step::Acknowledge(1, true);
    assert_eq!(steps, [Step::RequestReset, acknowledge, Step::Empty, Step::EndAfterDelay, Step::Wait, Step::Wait]);
    cp.receive(b"hello");
    assert_eq!(cp.words(), Words { rx: 5, tx_echo: 0 });
}
