//! How the TCM 120 decodes characters into telegrams, and what is a syntax error. [S1 "ERR_SYNTAX"]

use ob1_protocols::esp2::Field;
use ob1_protocols::esp2::frame::Bytes;

/// The result of a character.
pub(super) enum Step {
    More,
    Syntax(Field),
    Telegram(Bytes),
}

/// A5, 5A, then H_SEQ and LENGTH, ten bytes and the checksum, not checked.
#[derive(Clone, Debug)]
pub(super) struct Framing {
    characters: [u8; 14],
    seen: usize,
}

impl Framing {
    pub(super) const fn new() -> Self {
        Self { characters: [0; 14], seen: 0 }
    }

    pub(super) fn feed(&mut self, byte: u8) -> Step {
        match (self.seen, byte) {
            (0, 0xA5) => self.seen = 1,
            (1, 0x5A) => self.seen = 2,
            (1, 0xA5) => {}
            (0 | 1, _) => self.seen = 0,
            (at, _) => {
                self.characters[at] = byte;
                self.seen += 1;
            }
        }
        if self.seen < 14 {
            return Step::More;
        }
        self.seen = 0;
        let [_, _, telegram @ .., sum] = self.characters;
        let (h_seq, length) = (telegram[0] >> 5, telegram[0] & 0x1F);
        if length != 11 {
            Step::Syntax(Field::Length)
        } else if telegram.iter().map(|byte| u16::from(*byte)).sum::<u16>() % 256 != u16::from(sum) {
            Step::Syntax(Field::ChkSum)
        } else if h_seq != 3 && h_seq != 5 {
            Step::Syntax(Field::HSeq)
        } else {
            Step::Telegram(telegram)
        }
    }
}
