//! A STRING's characters on the stack: blocks allocate nothing.

/// Up to 254 characters, as a STRING holds them.
#[derive(Clone, Copy)]
pub(crate) struct Text {
    len: u8,
    bytes: [u8; Text::MAX],
}

impl Text {
    /// Characters a STRING can hold.
    pub(crate) const MAX: usize = 254;

    /// A text without characters.
    pub(crate) const fn new() -> Self {
        Self { len: 0, bytes: [0; Self::MAX] }
    }

    /// As long as the two length bytes of a STRING say: not longer than its maximum.
    pub(crate) fn with_len([max, len]: [u8; 2]) -> Self {
        Self { len: len.min(max).min(Self::MAX as u8), ..Self::new() }
    }

    pub(crate) fn as_slice(&self) -> &[u8] {
        &self.bytes[..usize::from(self.len)]
    }

    pub(crate) fn as_mut_slice(&mut self) -> &mut [u8] {
        &mut self.bytes[..usize::from(self.len)]
    }
}

/// Pieces put one after the other: up to two whole STRINGs, so that the caller sees what does not fit.
pub(crate) struct Joined {
    len: usize,
    bytes: [u8; 2 * Text::MAX],
}

impl Joined {
    /// The pieces in order. More than two STRINGs' worth is cut off.
    pub(crate) fn of(pieces: &[&[u8]]) -> Self {
        let mut joined = Self { len: 0, bytes: [0; 2 * Text::MAX] };
        for piece in pieces {
            let room = joined.bytes.len() - joined.len;
            let piece = &piece[..piece.len().min(room)];
            joined.bytes[joined.len..joined.len + piece.len()].copy_from_slice(piece);
            joined.len += piece.len();
        }
        joined
    }

    pub(crate) fn as_slice(&self) -> &[u8] {
        &self.bytes[..self.len]
    }
}
