//! CP 240: the sixteen bytes in each direction, and the meaning of their count words (docs/cp240-registers.md).

/// Register bytes in each direction. [S0 L1839]
pub const REGISTER_BYTES: usize = 16;

/// Bytes of user data in one block. [S0 L1831]
pub const BLOCK_BYTES: usize = 12;

/// Maximum telegram length, and size of the send and of the receive buffer. [S0 L1827]
pub const BUFFER_BYTES: usize = 1024;

/// `RX`: start-up identifier; `RX echo`: the start-up is acknowledged.
pub const STARTUP: u16 = 0x8001;

/// `RX echo`: reset request.
pub const RESET: u16 = 0x8002;

/// `RX`: no valid parameters.
pub const NO_PARAMETERS: u16 = 0x8003;

/// Marks a system word.
pub const SYSTEM: u16 = 0x8000;

/// `TX echo`: the order ended with an error, the code is in the low byte; `TX`: the CPU has seen this.
pub const FAILED: u16 = 0x2000;

/// `TX`: Modbus output area, `ANZ OR 4000h` [S0 L2311]. `RX` and `RX echo`: the telegram is a changed area of the
/// Modbus slave "long" and begins with its offset.
pub const AREA: u16 = 0x4000;

/// `RX`, ASCII-fragmented: more of the telegram follows this block. Without a count: the telegram is complete; with
/// [`BROKEN_OFF`]: its rest is lost. `RX echo` may contain or omit the bit; the bit alone acknowledges the last two
/// cases.
pub const MORE: u16 = 0x2000;

/// `RX`: the rest of the telegram is lost.
pub const BROKEN_OFF: u16 = MORE | COUNT_BITS;

/// `RX echo`: the CPU cannot store the changed area because its own area is too short.
pub const OUTSIDE: u16 = FAILED | 0x02;

/// Framing of RK 512: an order of this CPU (`TX`) and its result (`RX`).
pub const OWN_ORDER: u16 = 0x0800;

/// Framing of RK 512: an order of the partner (`RX`) and the CPU's answer (`TX`). Alone, without a count, in `RX
/// echo`: the CPU accepts orders of the partner.
pub const PARTNER_ORDER: u16 = 0x1000;

/// Framing bits of a line command in `TX` and of its answer in `TX echo`.
pub const LINE: u16 = 0x1800;

/// Line command: the new state of RTS.
pub const LINE_RTS: u16 = 1 << 0;
/// Line command: the new state of DTR.
pub const LINE_DTR: u16 = 1 << 1;
/// Line command: set RTS to the new state.
pub const LINE_SET_RTS: u16 = 1 << 2;
/// Line command: set DTR to the new state.
pub const LINE_SET_DTR: u16 = 1 << 3;

/// `TX echo`: the answer to a line command. STATUS is in bits 0 to 5, DELTA_STATUS in bits 6 to 9. [S0 "STATUS,
/// DELTA_STATUS"]
pub const LINE_ANSWER: u16 = LINE | 1 << 10;

/// First bit of DELTA_STATUS in the answer to a line command; STATUS begins at bit 0.
pub const LINE_DELTA_SHIFT: u16 = 6;

/// Bytes of the offset at the beginning of a changed area of the Modbus slave "long".
pub const OFFSET_BYTES: usize = 2;

/// The five bits above a count: the kind of the word.
pub const KIND: u16 = 0xF800;

/// RK 512: bytes of a header.
pub const RK512_HEADER_BYTES: usize = 10;

/// RK 512: bytes before the data of a result and of an answer.
pub const RK512_RESULT_BYTES: usize = 4;

/// Bits 0 to 10 are a count; a word with any other bit set is not a plain count.
pub const COUNT_BITS: u16 = 0x07FF;

/// The register bytes of one direction.
pub type Registers = [u8; REGISTER_BYTES];

/// First word (`RX`, `RX echo`), big-endian.
pub const fn rx_word(registers: &Registers) -> u16 {
    u16::from_be_bytes([registers[0], registers[1]])
}

/// Second word (`TX echo`, `TX`), big-endian.
pub const fn tx_word(registers: &Registers) -> u16 {
    u16::from_be_bytes([registers[2], registers[3]])
}

/// The block after the words.
pub fn block(registers: &Registers) -> &[u8] {
    &registers[REGISTER_BYTES - BLOCK_BYTES..]
}

/// The registers with these words and this block, filled with zeros.
pub fn compose(rx: u16, tx: u16, block: &[u8]) -> Registers {
    let mut registers = [0; REGISTER_BYTES];
    registers[..2].copy_from_slice(&rx.to_be_bytes());
    registers[2..4].copy_from_slice(&tx.to_be_bytes());
    for (to, from) in registers[4..].iter_mut().zip(block) {
        *to = *from;
    }
    registers
}

/// A word as a line command: its bits 0 to 10.
pub const fn line_command(word: u16) -> Option<u16> {
    if word & KIND == LINE { Some(word & COUNT_BITS) } else { None }
}

/// A word as framing and count of RK 512; `None` for other words.
pub const fn framed_count(word: u16) -> Option<(u16, usize)> {
    match word & KIND {
        framing @ (OWN_ORDER | PARTNER_ORDER) => Some((framing, (word & COUNT_BITS) as usize)),
        0 if word == 0 => Some((0, 0)),
        _ => None,
    }
}

/// Whether a word is a first count of any protocol: a count, possibly framed or for the Modbus output area.
pub const fn is_telegram_of_any_kind(word: u16) -> bool {
    word & COUNT_BITS != 0 && matches!(word & KIND, 0 | AREA | OWN_ORDER | PARTNER_ORDER)
}

/// A word as a count of bytes, possibly too large for a telegram.
pub const fn count(word: u16) -> Option<usize> {
    if word & !COUNT_BITS == 0 { Some(word as usize) } else { None }
}
