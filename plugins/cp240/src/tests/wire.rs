//! The count words.

use crate::registers::{Count, Words, rx_count, tx_count};

#[test]
fn words_are_sorted() {
    assert_eq!(tx_count(0x0400), Count::Bytes(1024));
    assert_eq!(tx_count(0x0401), Count::Nonsense);
    assert_eq!(tx_count(0x4400), Count::Bytes(1024));
    assert_eq!(tx_count(0x200A), Count::Failed(0x0A));
    assert_eq!(tx_count(0x210A), Count::Nonsense);
    assert_eq!(tx_count(0x8007), Count::System);
    assert_eq!(rx_count(0x200A), Count::Nonsense, "RX has no error code");
    assert_eq!(rx_count(0x4010), Count::Bytes(16), "a changed area");
    assert_eq!(rx_count(0x8001), Count::System);
    assert_eq!(rx_count(18), Count::Bytes(18));
}

#[test]
fn every_pair_of_words_is_one_thing() {
    for rx in 0..=u16::MAX {
        let words = Words { rx, tx_echo: 0x8001 };
        assert_eq!(words.start_up().is_some(), rx == 0x8001);
        assert_eq!(words.not_ready(), rx == 0x8001 || rx == 0x8003);
    }
}
