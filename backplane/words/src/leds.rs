//! The four LEDs on the front of a CP. [S0 "LEDs"]

/// The LEDs as they are now.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Leds {
    /// PW, yellow: power supply. CP 040: RUN.
    pub power: bool,
    /// TxD, green: the module sends.
    pub transmit: bool,
    /// RxD, green: the module receives.
    pub receive: bool,
    /// ER (CP 240), SF (CP 340, CP 341), IF or MF (CP 040), red: an error.
    pub error: bool,
}

impl Leds {
    /// All LEDs off: the module has no power.
    pub const NONE: Self = Self { power: false, transmit: false, receive: false, error: false };
}
