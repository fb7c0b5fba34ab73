//! The text that the master writes into the receive block when there is no valid answer. [S0 "Master doesn't receive
//! valid data"]

/// "Master doesn't receive valid data", with the numbers and texts of the manual.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum Failure {
    /// `ERROR01 NO DATA`: no telegram arrived within the delay time.
    NoData = 1,
    /// `ERROR02 D LOST`: the receive buffer is full, or an error occurred in the receive section (parity, frame,
    /// overrun, break).
    DataLost = 2,
    /// `ERROR03 F OVERF`: the end of the telegram was not recognized, or it is longer than permitted.
    Overflow = 3,
    /// `ERROR04 F INCOM`: only a part of a telegram has been received.
    Incomplete = 4,
    /// `ERROR05 F FAULT`: the check sum is wrong.
    Fault = 5,
    /// `ERROR06 F START`: the start character is wrong (ASCII).
    Start = 6,
}

impl Failure {
    /// All of them, in the order of their numbers.
    pub const ALL: [Self; 6] =
        [Self::NoData, Self::DataLost, Self::Overflow, Self::Incomplete, Self::Fault, Self::Start];

    /// The telegram in the receive block: `ERROR`, the number as a word, a blank, the text, 00h. `ERROR01 NO DATA` is
    /// `45 52 52 4F 52 00 01 20 4E 4F 20 44 41 54 41 00`. [S0 L2702-L2711]
    pub const fn telegram(self) -> &'static [u8] {
        match self {
            Self::NoData => b"ERROR\x00\x01 NO DATA\x00",
            Self::DataLost => b"ERROR\x00\x02 D LOST\x00",
            Self::Overflow => b"ERROR\x00\x03 F OVERF\x00",
            Self::Incomplete => b"ERROR\x00\x04 F INCOM\x00",
            Self::Fault => b"ERROR\x00\x05 F FAULT\x00",
            Self::Start => b"ERROR\x00\x06 F START\x00",
        }
    }
}
