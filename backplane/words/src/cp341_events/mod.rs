//! Event numbers of the CP 341 and the CP 340, class and number as in STATUS, with text and remedy in our own words.
//! [TIA help "PtP data link CP 341"], [S4 "7.3 Table of Errors / Events"]
//!
//! One table for the diagnostic buffer's text, for `docs/cp341-events.md`, and for the test that checks which test
//! provokes each number. "The numbers mean the same in every block." [S4 L1709]

mod driver;
mod job;
mod module;
mod partner;

/// Why a number does not occur here, or that it does.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Origin {
    /// The CP, a block or the driver reports it.
    Here,
    /// It names a state that cannot arise in this CP; the number is kept for the text.
    FactOnly,
    /// It belongs to another module (CP 440, CP 441, Modbus slave driver).
    OtherModule,
    /// A fault of the hardware or of the original firmware.
    HardwareFault,
}

impl Origin {
    /// Its name in the documents; none for [`Origin::Here`].
    pub const fn reason(self) -> &'static str {
        match self {
            Self::Here => "",
            Self::FactOnly => "fact only",
            Self::OtherModule => "other module",
            Self::HardwareFault => "hardware fault",
        }
    }
}

/// An event number with what is to be said about it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Row {
    /// Class (high byte) and number (low byte).
    pub number: u16,
    /// What has happened, as a sentence without its number.
    pub text: &'static str,
    /// The remedy; empty for mere information.
    pub remedy: &'static str,
    /// Whether it occurs here.
    pub origin: Origin,
}

const fn here(number: u16, text: &'static str, remedy: &'static str) -> Row {
    Row { number, text, remedy, origin: Origin::Here }
}

const fn other(origin: Origin, number: u16, text: &'static str) -> Row {
    Row { number, text, remedy: "", origin }
}

/// The classes, with their names. [TIA help "PtP data link CP 341"], [S4 L1725-L1736]
pub const CLASSES: [(u8, &str); 13] = [
    (0x00, "Start-up of the CP"),
    (0x01, "Hardware of the CP"),
    (0x02, "Initialisation"),
    (0x03, "Parameters of the block"),
    (0x04, "Traffic between CP and CPU, seen by the CP"),
    (0x05, "Job of the CPU"),
    (0x06, "Job of the partner (RK 512)"),
    (0x07, "Sending"),
    (0x08, "Receiving"),
    (0x09, "Error number in the partner's response (RK 512)"),
    (0x0A, "Error in the partner's response (RK 512)"),
    (0x0E, "Loadable driver"),
    (0x1E, "Traffic between block and CP, seen by the block"),
];

/// All rows, in the order of their numbers.
pub fn rows() -> impl Iterator<Item = &'static Row> {
    module::ROWS.iter().chain(job::ROWS).chain(partner::ROWS).chain(driver::ROWS)
}

/// The row of a number.
pub fn row(number: u16) -> Option<&'static Row> {
    rows().find(|row| row.number == number)
}

/// Name of a number's class.
pub fn class(number: u16) -> Option<&'static str> {
    CLASSES.iter().find(|(class, _)| u16::from(*class) == number >> 8).map(|(_, name)| *name)
}
