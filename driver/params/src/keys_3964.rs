//! The keys of 3964(R) that the Siemens CPs have: delays, attempts, priority.

use crate::keyed::{Key341, choice, number};

/// ZVZ of 3964(R), at least `least` milliseconds.
pub(crate) const fn zvz_of_3964(least: i64) -> Key341 {
    number("zvz_ms", (least, 65_530, 10), "220", "ZVZ: longest pause between two characters of a telegram")
}

/// QVZ, at least `least` milliseconds.
pub(crate) const fn qvz(least: i64) -> Key341 {
    let text = "QVZ: longest wait for an acknowledgement; 2000 with block check, 550 without";
    number("qvz_ms", (least, 65_530, 10), "", text)
}

/// Attempts and priority of 3964(R).
pub(crate) const ATTEMPTS: &[Key341; 3] = &[
    number("connect_attempts", (1, 255, 1), "6", "attempts to get a connection, the first included"),
    number("block_attempts", (1, 255, 1), "6", "attempts to get a telegram through, the first included"),
    choice("priority", &["high", "low"], "high", "who goes first when both want to send"),
];
