//! Decodes the input of a tty in `PARMRK` mode: `FF FF` is the byte FFh, `FF 00 00` a break (or a 00h with a fault),
//! `FF 00 xx` the byte xx received with a parity or framing fault (termios(3)).

/// A fault found between the bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Mark {
    /// Break, or the character 00h with a parity or framing fault: the tty does not distinguish them.
    Break,
    /// This byte arrived with a parity or framing fault.
    Faulty(u8),
}

/// The result of one call of [`ParmrkDecoder::decode`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Decoded {
    /// Raw bytes taken from the input.
    pub used: usize,
    /// Good bytes written to the output.
    pub written: usize,
    /// The fault that ended the run, after the bytes written.
    pub mark: Option<Mark>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
enum State {
    #[default]
    Plain,
    /// FFh has come: an escape begins.
    Escape,
    /// FFh 00h has come: the next byte is marked.
    Marked,
}

/// The decoder; it keeps its state when the end of a read cuts a sequence.
#[derive(Debug, Clone, Default)]
pub struct ParmrkDecoder {
    state: State,
}

impl ParmrkDecoder {
    /// Decodes from `raw` into `out` until a fault is found, `raw` is used up or `out` is full.
    ///
    /// A sequence that no tty produces (`FF xx` with xx neither 00h nor FFh) is delivered as it is.
    pub fn decode(&mut self, raw: &[u8], out: &mut [u8]) -> Decoded {
        let (mut used, mut written) = (0, 0);
        while used < raw.len() {
            // Room for two: an FFh that is not an escape after all is delivered together with the next byte.
            if out.len() - written < 2 {
                break;
            }
            let byte = raw[used];
            used += 1;
            match (self.state, byte) {
                (State::Plain, 0xFF) => self.state = State::Escape,
                (State::Plain, _) => {
                    out[written] = byte;
                    written += 1;
                }
                (State::Escape, 0x00) => self.state = State::Marked,
                (State::Escape, 0xFF) => {
                    self.state = State::Plain;
                    out[written] = 0xFF;
                    written += 1;
                }
                (State::Escape, _) => {
                    self.state = State::Plain;
                    out[written] = 0xFF;
                    out[written + 1] = byte;
                    written += 2;
                }
                (State::Marked, _) => {
                    self.state = State::Plain;
                    let mark = if byte == 0 { Mark::Break } else { Mark::Faulty(byte) };
                    return Decoded { used, written, mark: Some(mark) };
                }
            }
        }
        Decoded { used, written, mark: None }
    }

    /// Drops an unfinished sequence, after the device was reopened.
    pub fn reset(&mut self) {
        self.state = State::Plain;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Runs the decoder over `raw` in pieces of `piece` bytes.
    fn all(raw: &[u8], piece: usize) -> (Vec<u8>, Vec<(usize, Mark)>) {
        let mut decoder = ParmrkDecoder::default();
        let (mut bytes, mut marks) = (Vec::new(), Vec::new());
        for part in raw.chunks(piece) {
            let mut part = part;
            while !part.is_empty() {
                let mut out = [0; 8];
                let d = decoder.decode(part, &mut out);
                assert!(d.used > 0, "the decoder always moves on");
                bytes.extend_from_slice(&out[..d.written]);
                marks.extend(d.mark.map(|m| (bytes.len(), m)));
                part = &part[d.used..];
            }
        }
        (bytes, marks)
    }

    #[test]
    fn the_three_sequences() {
        assert_eq!(all(&[1, 0xFF, 0xFF, 2], 9), (vec![1, 0xFF, 2], vec![]));
        assert_eq!(all(&[1, 0xFF, 0, 0x41, 2], 9), (vec![1, 2], vec![(1, Mark::Faulty(0x41))]));
        assert_eq!(all(&[0xFF, 0, 0], 9), (vec![], vec![(0, Mark::Break)]));
        assert_eq!(all(&[0xFF, 0, 0xFF, 3], 9), (vec![3], vec![(0, Mark::Faulty(0xFF))]));
        assert_eq!(all(&[0xFF, 0x41], 9), (vec![0xFF, 0x41], vec![]), "not of a tty: as it is");
    }

    proptest! {
        #[test]
        fn encode_then_decode_in_any_pieces(
            items in proptest::collection::vec((any::<u8>(), prop_oneof![9 => Just(false), 1 => Just(true)]), 0..200),
            piece in 1usize..40,
        ) {
            let (mut raw, mut bytes, mut marks) = (Vec::new(), Vec::new(), Vec::new());
            for (byte, faulty) in items {
                if faulty {
                    raw.extend([0xFF, 0, byte]);
                    marks.push((bytes.len(), if byte == 0 { Mark::Break } else { Mark::Faulty(byte) }));
                } else {
                    raw.push(byte);
                    if byte == 0xFF {
                        raw.push(0xFF);
                    }
                    bytes.push(byte);
                }
            }
            prop_assert_eq!(all(&raw, piece), (bytes, marks));
        }
    }
}
