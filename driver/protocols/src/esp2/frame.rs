//! The frame of the EnOcean serial protocol, version 2: A5 5A, H_SEQ and LENGTH, ORG, nine bytes, check sum. [S1 L1704]
//!
//! ```text
//! A5 5A | H_SEQ LENGTH | ORG | nine bytes | check sum      14 bytes on the line
//!       |<--- the telegram: 11 bytes ---->|               what the program sees
//! ```
//!
//! All of S0's tables that show more or fewer bytes are misprints: S1 has 14 in each.

/// The two bytes every frame begins with.
pub const SYNC: [u8; 2] = [0xA5, 0x5A];

/// WAKE: the one telegram that is a single byte, without a frame. [S1 "WAKE"]
pub const WAKE: u8 = 0xAA;

/// Bytes of a telegram, as the program sees it. [S1 "11Byte Telegramm für EnOcean-Kommunikation"]
pub const TELEGRAM_BYTES: usize = 11;

/// Bytes of a frame on the line.
pub const FRAME_BYTES: usize = TELEGRAM_BYTES + 3;

/// The value of LENGTH in every frame: the number of bytes that follow it, including the check sum.
const LENGTH: u8 = 11;

/// LENGTH is the lower five bits, H_SEQ the upper three.
const LENGTH_BITS: u8 = 0x1F;

/// H_SEQ and LENGTH, ORG, nine bytes.
pub type Bytes = [u8; TELEGRAM_BYTES];

/// The sum of all bytes between the synchronization bytes and the check sum, modulo 256.
pub fn check_sum(telegram: &Bytes) -> u8 {
    telegram.iter().fold(0, |sum, byte| sum.wrapping_add(*byte))
}

/// The telegram in its frame. [S1 "Aufgaben der CPU"]
pub fn encode(telegram: &Bytes) -> [u8; FRAME_BYTES] {
    let mut frame = [0; FRAME_BYTES];
    frame[..2].copy_from_slice(&SYNC);
    frame[2..FRAME_BYTES - 1].copy_from_slice(telegram);
    frame[FRAME_BYTES - 1] = check_sum(telegram);
    frame
}

/// The effect of a character.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Step {
    /// The frame continues, or has begun.
    More,
    /// A character that belongs to no frame.
    Noise(u8),
    /// A frame is complete and its check sum right.
    Telegram(Bytes),
    /// What looked like a frame is not a valid one.
    Wrong {
        /// Computed from what came in.
        computed: u8,
        /// The check sum that came in.
        received: u8,
    },
}

/// Finds frames among characters. After characters that are not a frame it restarts at the first A5 5A that can begin
/// one, even if it is among those characters: a frame that follows a mutilated one is not lost.
#[derive(Clone, Debug)]
pub struct Decoder {
    window: [u8; FRAME_BYTES],
    len: usize,
}

impl Default for Decoder {
    fn default() -> Self {
        Self::new()
    }
}

impl Decoder {
    /// At a quiet line.
    pub const fn new() -> Self {
        Self { window: [0; FRAME_BYTES], len: 0 }
    }

    /// Drops an incomplete frame; true if there was one.
    pub const fn reset(&mut self) -> bool {
        let open = self.is_open();
        self.len = 0;
        open
    }

    /// Whether something has begun that may become a frame.
    pub const fn is_open(&self) -> bool {
        self.len > 0
    }

    /// Takes one character; reports a frame with its last character.
    pub fn feed(&mut self, byte: u8) -> Step {
        // Never full here: a window of FRAME_BYTES is evaluated below.
        if let Some(place) = self.window.get_mut(self.len) {
            *place = byte;
            self.len += 1;
        }
        if !self.begins() {
            let first = self.window[0];
            self.realign();
            return Step::Noise(first);
        }
        if self.len < FRAME_BYTES {
            return Step::More;
        }
        let mut telegram = [0; TELEGRAM_BYTES];
        telegram.copy_from_slice(&self.window[2..FRAME_BYTES - 1]);
        let (computed, received) = (check_sum(&telegram), self.window[FRAME_BYTES - 1]);
        if computed == received {
            self.len = 0;
            return Step::Telegram(telegram);
        }
        self.realign();
        Step::Wrong { computed, received }
    }

    /// Whether the window may contain the beginning of a frame.
    fn begins(&self) -> bool {
        let has = &self.window[..self.len];
        has.iter().zip(SYNC).all(|(byte, sync)| *byte == sync)
            && has.get(2).is_none_or(|byte| byte & LENGTH_BITS == LENGTH)
    }

    /// Drops at least one character, and as many more until the rest may begin a frame.
    fn realign(&mut self) {
        loop {
            self.window.copy_within(1.., 0);
            self.len -= 1;
            if self.len == 0 || self.begins() {
                return;
            }
        }
    }
}
