//! FC 8.

use super::fake_cp::FakeCp;
use crate::line::{Step, command, step};
use crate::registers::{FAILED, NO_PARAMETERS, STARTUP, SYSTEM, Words};

const IDLE: Words = Words { rx: 0, tx_echo: 0 };

#[test]
fn the_command_has_the_masked_states() {
    assert_eq!(command(false, false, false, false), 0x1800);
    assert_eq!(command(true, false, false, false), 0x1801);
    assert_eq!(command(false, true, false, false), 0x1802);
    assert_eq!(command(false, false, true, false), 0x1804);
    assert_eq!(command(false, false, false, true), 0x1808);
    assert_eq!(command(true, true, true, true), 0x180F);
}

#[test]
fn command_answer_and_back() {
    let mut cp = FakeCp::working();
    cp.lines = 0x1C00 | 0b1001 << 6 | 0b10_0101;
    assert_eq!(step(cp.words(), false, false, false), Step::Command);
    cp.write(2, &command(true, false, true, false).to_be_bytes());
    assert_eq!(step(cp.words(), true, true, false), Step::Wait, "the CP has not looked yet");
    cp.look();
    assert_eq!(cp.log, [0x1805]);
    assert_eq!(step(cp.words(), true, true, false), Step::Done { status: 0b10_0101, delta: 0b1001 });
    cp.write(2, &[0, 0]);
    assert_eq!(step(cp.words(), false, false, false), Step::Wait, "the next one only when the answer has gone");
    cp.look();
    assert_eq!(step(cp.words(), false, false, false), Step::Command);
    // A telegram directly after it overwrites the 0 before the CP has seen it.
    cp.write(2, &0x1800_u16.to_be_bytes());
    cp.look();
    cp.write(2, &[0, 2, b'a', b'b']);
    cp.look();
    cp.write(2, &[0, 0]);
    cp.look();
    assert_eq!(cp.transmitted, [b"ab".to_vec()]);
}

/// [S0 L1035]: not while a transmit command is running. It waits.
#[test]
fn it_waits_for_fc_0() {
    assert_eq!(step(IDLE, false, false, true), Step::Wait, "a job of FC 0 whose first count has not been seen");
    for tx_echo in [30, 6, FAILED | 7] {
        assert_eq!(step(Words { rx: 0, tx_echo }, false, false, false), Step::Wait);
    }
    assert_eq!(step(Words { rx: 18, tx_echo: 0 }, false, false, false), Step::Command, "receiving goes on beside it");
}

#[test]
fn a_cp_that_was_reset_or_lost_has_forgotten_the_command() {
    for words in [Words { rx: STARTUP, tx_echo: SYSTEM | 3 }, Words { rx: NO_PARAMETERS, tx_echo: SYSTEM }] {
        assert_eq!(step(words, true, true, false), Step::Lost);
        assert_eq!(step(words, false, false, false), Step::Wait);
    }
    assert_eq!(step(IDLE, true, false, false), Step::Lost, "another process");
    assert_eq!(step(Words { rx: 0, tx_echo: 0x1C3F }, true, false, false), Step::Lost);
    for nonsense in [0x1800, 0x1BFF, 0x0800, 0xFFFF, 1025] {
        assert_eq!(step(Words { rx: 0, tx_echo: nonsense }, true, true, false), Step::Wait, "{nonsense:04X}h");
    }
}
