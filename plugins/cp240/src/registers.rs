//! The count words and their content [S0 L1829-L1880], `docs/cp240-registers.md`.

use ob1_words::cp240;
pub(crate) use ob1_words::cp240::{
    AREA, BROKEN_OFF, COUNT_BITS, FAILED, LINE, LINE_ANSWER, LINE_DTR, LINE_RTS, LINE_SET_DTR, LINE_SET_RTS, MORE,
    NO_PARAMETERS, OUTSIDE, REGISTER_BYTES, RESET, STARTUP, SYSTEM,
};

/// Offset of the TX words; RX is at 0.
pub(crate) const TX: u32 = 2;
/// Bytes of a telegram in one block.
pub(crate) const BLOCK_BYTES: u16 = cp240::BLOCK_BYTES as u16;
/// The bytes of a block, as in the registers.
pub(crate) type BlockBytes = [u8; cp240::BLOCK_BYTES];
/// Longest telegram: the CP's buffer.
pub(crate) const TELEGRAM_MAX: u16 = cp240::BUFFER_BYTES as u16;
/// Bytes of the offset at the beginning of a changed area.
pub(crate) const OFFSET_BYTES: u16 = cp240::OFFSET_BYTES as u16;

/// The bits that identify an answer to a line command: all except STATUS and DELTA_STATUS.
const LINE_ANSWER_MASK: u16 = 0xFC00;

/// The two words the CP writes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Words {
    /// Bytes of the received telegram still to be fetched.
    pub(crate) rx: u16,
    /// Echo of the count last sent.
    pub(crate) tx_echo: u16,
}

/// A decoded count word.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Count {
    /// Length of a telegram or of a block, 0 to 1024 bytes.
    Bytes(u16),
    /// The order failed, with the CP's error code.
    Failed(u8),
    /// The answer to a line command: STATUS and DELTA_STATUS of FC 8.
    Line {
        /// RTS, DTR, CD, RI, DSR, CTS in bits 5 to 0.
        status: u8,
        /// CD, RI, DSR, CTS in bits 3 to 0.
        delta: u8,
    },
    /// A system word: start-up identifier or synchronisation, for FC 9.
    System,
    /// Not valid: treated as absent.
    Nonsense,
}

impl Count {
    fn bytes(word: u16) -> Self {
        if word <= TELEGRAM_MAX { Count::Bytes(word) } else { Count::Nonsense }
    }
}

/// Decodes `RX`, ignoring the bit of a changed area.
pub(crate) fn rx_count(word: u16) -> Count {
    if word & SYSTEM != 0 { Count::System } else { Count::bytes(word & !AREA) }
}

/// Decodes `TX echo`. The bit of the output area is ignored.
pub(crate) fn tx_count(word: u16) -> Count {
    match word & !AREA {
        word if word & SYSTEM != 0 => Count::System,
        word if word & 0xFF00 == FAILED => Count::Failed(word as u8),
        word if word & LINE_ANSWER_MASK == LINE_ANSWER => {
            Count::Line { status: word as u8 & 0x3F, delta: (word >> cp240::LINE_DELTA_SHIFT) as u8 & 0x0F }
        }
        word => Count::bytes(word),
    }
}

impl Words {
    pub(crate) fn from_bytes(bytes: [u8; 4]) -> Self {
        let [a, b, c, d] = bytes;
        Self { rx: u16::from_be_bytes([a, b]), tx_echo: u16::from_be_bytes([c, d]) }
    }

    /// The number of the start-up that the CP shows, 1 to 255.
    pub(crate) fn start_up(self) -> Option<u8> {
        let number = self.tx_echo as u8;
        (self.rx == STARTUP && self.tx_echo & 0xFF00 == SYSTEM && number != 0).then_some(number)
    }

    /// True while the CP accepts no job: start-up not acknowledged, or no valid parameters.
    pub(crate) fn not_ready(self) -> bool {
        self.start_up().is_some() || self.rx == NO_PARAMETERS
    }
}
