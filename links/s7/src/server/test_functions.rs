//! The test functions that are served: one table for the dispatch and for status list 0131 index 2, by which a
//! programming device decides what it offers. A function that is added to `test_jobs` is added here, and nowhere else.

use crate::wire::sub;

/// Their numbers.
pub(super) const SERVED: [u8; 6] =
    [sub::TEST_STATUS, sub::TEST_MODIFY, sub::TEST_ENABLE, sub::TEST_DELETE, sub::TEST_LIST, sub::TEST_BLINK];

/// As the list has them: bits 0 to 7 of the first byte are functions 0 to 7, of the second 8 to 15; of the third 16 and
/// those behind it, bit 6 the blinking.
pub(super) fn bits() -> [u8; 3] {
    let mut bits = [0; 3];
    for number in SERVED {
        if let Some(byte) = bits.get_mut(usize::from(number / 8)) {
            *byte |= 1 << (number % 8);
        }
    }
    bits
}
