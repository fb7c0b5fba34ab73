//! FC 8.

use super::fake_cp::FakeCp;
use crate::line::command;
use crate::registers::{Count, tx_count};

#[test]
fn the_command_has_the_masked_states() {
    assert_eq!(command(false, false, false, false), 0x1800);
    assert_eq!(command(true, false, false, false), 0x1801);
    assert_eq!(command(false, true, false, false), 0x1802);
    assert_eq!(command(false, false, true, false), 0x1804);
    assert_eq!(command(false, false, false, true), 0x1808);
    assert_eq!(command(true, true, true, true), 0x180F);
}

/// The next command, or a telegram, may overwrite the 0 before the CP has seen it.
#[test]
fn command_answer_and_back() {
    let mut cp = FakeCp::working();
    cp.lines = 0x1C00 | 0b1001 << 6 | 0b10_0101;
    cp.write(2, &command(true, false, true, false).to_be_bytes());
    cp.look();
    assert_eq!(cp.log, [0x1805]);
    assert_eq!(tx_count(cp.words().tx_echo), Count::Line { status: 0b10_0101, delta: 0b1001 });
    cp.write(2, &[0, 0]);
    cp.look();
    cp.write(2, &0x1800_u16.to_be_bytes());
    cp.look();
    cp.write(2, &[0, 2, b'a', b'b']);
    cp.look();
    cp.write(2, &[0, 0]);
    cp.look();
    assert_eq!(cp.transmitted, [b"ab".to_vec()]);
}

#[test]
fn words_that_only_look_like_an_answer_are_none() {
    for nonsense in [0x1800, 0x1BFF, 0x0800, 0xFFFF, 1025] {
        assert!(!matches!(tx_count(nonsense), Count::Line { .. }), "{nonsense:04X}h");
    }
}
