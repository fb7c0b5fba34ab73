//! The test functions that are served, as status list 0131 index 2 has them: by it a programming device decides what it
//! offers.

use ob1_model::TEST_FUNCTIONS;

use crate::wire::sub;

/// As the list has them: bits 0 to 7 of the first byte are functions 0 to 7, of the second 8 to 15; of the third 16 and
/// those behind it, bit 6 the blinking.
/// An S7-300 does not tell of 09: it is forced by 07. [recorded from a 315-2]
pub(super) fn bits(is_400: bool) -> [u8; 3] {
    let mut bits = [0; 3];
    for number in TEST_FUNCTIONS.into_iter().filter(|number| is_400 || *number != sub::TEST_FORCE) {
        if let Some(byte) = bits.get_mut(usize::from(number / 8)) {
            *byte |= 1 << (number % 8);
        }
    }
    bits
}
