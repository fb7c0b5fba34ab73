//! The receive buffer: whole telegrams in a ring of 1024 or 2048 bytes [S0 "Communication via back plane bus"], at a
//! CP 341 of 4096 [TIA help "Configuration for point-to-point links"].

use ob1_protocols::Part;

use ob1_words::cp240::BUFFER_BYTES;

/// Bytes of the largest buffer of a CP 240: EnOcean and M-Bus. [S0 L2916], [S0 L4133]
const BYTES_MAX: usize = 2048;

/// Bytes of the receive buffer of a CP 341. [TIA help "Configuration for point-to-point links"]
pub(crate) const BYTES_341: usize = 4096;

/// Telegrams the buffer can hold at most. [S0 "Properties"]
pub const TELEGRAMS_MAX: usize = 250;

/// Places beside the telegrams, for what a CP 040 tells of the ones that it could not receive.
pub(crate) const ERRORS_MAX: usize = 8;

/// Places for lengths: one for each telegram, and those for errors.
const PLACES: usize = TELEGRAMS_MAX + ERRORS_MAX;

/// In a length: more of the telegram follows, or the rest of it is lost.
const MORE: u16 = 0x8000;
const BROKEN: u16 = 0x4000;

/// The capacity of a buffer; the protocol decides it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Capacity {
    bytes: usize,
    telegrams: usize,
    /// A telegram replaces the waiting one.
    overwrites: bool,
}

impl Capacity {
    /// 1024 bytes, and as many telegrams as the parameters permit, 1 to 250.
    pub(crate) const fn buffers(n: u8) -> Self {
        let n = n as usize;
        let telegrams = if n == 0 {
            1
        } else if n > TELEGRAMS_MAX {
            TELEGRAMS_MAX
        } else {
            n
        };
        Self { bytes: BUFFER_BYTES, telegrams, overwrites: false }
    }

    /// 2048 bytes and `telegrams` telegrams, 1 to 250: EnOcean (150) [S0 L2916] and M-Bus (no number is printed) [S0
    /// L4133].
    pub(crate) const fn large(telegrams: u8) -> Self {
        Self { bytes: BYTES_MAX, ..Self::buffers(telegrams) }
    }

    /// With places for errors too.
    pub(crate) const fn with_errors(self) -> Self {
        Self { telegrams: self.telegrams + ERRORS_MAX, ..self }
    }

    /// A CP 341 (4096) or a CP 340 (1024): `bytes` bytes and `telegrams` telegrams, 1 to 250.
    pub(crate) const fn of_bytes(bytes: usize, telegrams: u8) -> Self {
        Self { bytes, ..Self::buffers(telegrams) }
    }

    /// One telegram, always the newest: "1 telegram + no overwrite protection".
    /// [TIA help "Configuration for point-to-point links"]
    pub(crate) const fn newest(self) -> Self {
        Self { telegrams: 1, overwrites: true, ..self }
    }
}

/// Received telegrams waiting for the CPU, oldest first.
#[derive(Debug)]
pub(crate) struct Ring<const BYTES: usize = BYTES_MAX> {
    bytes: [u8; BYTES],
    /// Begin of the oldest telegram.
    head: usize,
    /// Bytes in use, from `head` on.
    used: usize,
    /// Length of each telegram or part, with [`MORE`] and [`BROKEN`].
    lengths: [u16; PLACES],
    /// Place of the oldest length.
    first: usize,
    telegrams: usize,
    /// Bytes and telegrams permitted.
    capacity: Capacity,
}

impl<const BYTES: usize> Ring<BYTES> {
    pub(crate) const fn new() -> Self {
        Self {
            bytes: [0; BYTES],
            head: 0,
            used: 0,
            lengths: [0; PLACES],
            first: 0,
            telegrams: 0,
            capacity: Capacity::buffers(u8::MAX),
        }
    }

    /// Empties the buffer and sets what it may hold.
    pub(crate) fn clear(&mut self, capacity: Capacity) {
        (self.head, self.used, self.first, self.telegrams) = (0, 0, 0, 0);
        self.capacity = capacity;
    }

    /// Number of telegrams that wait for the CPU.
    pub(crate) const fn telegrams(&self) -> usize {
        self.telegrams
    }

    /// Whether a telegram replaces the waiting one.
    pub(crate) const fn overwrites(&self) -> bool {
        self.capacity.overwrites
    }

    /// Maximum length of the next telegram; 0: none is accepted.
    pub(crate) const fn room(&self) -> usize {
        if self.capacity.overwrites {
            self.capacity.bytes
        } else if self.telegrams < self.capacity.telegrams {
            self.capacity.bytes - self.used
        } else {
            0
        }
    }

    /// Appends a telegram; false (and nothing is kept of it) if it is empty or there is no room.
    pub(crate) fn push(&mut self, telegram: &[u8]) -> bool {
        if telegram.is_empty() || telegram.len() > self.room() {
            return false;
        }
        if self.capacity.overwrites {
            self.clear(self.capacity);
        }
        let begin = (self.head + self.used) % BYTES;
        let straight = telegram.len().min(BYTES - begin);
        let (front, back) = telegram.split_at(straight);
        self.bytes[begin..begin + straight].copy_from_slice(front);
        self.bytes[..back.len()].copy_from_slice(back);
        self.used += telegram.len();
        self.lengths[(self.first + self.telegrams) % PLACES] = telegram.len() as u16;
        self.telegrams += 1;
        true
    }

    /// Maximum length of the next part of a telegram: the last place is reserved for its end.
    pub(crate) const fn room_for_part(&self) -> usize {
        if self.telegrams + 1 < self.capacity.telegrams { self.room() } else { 0 }
    }

    /// Appends a part of a telegram, or the mark of its end.
    pub(crate) fn push_part(&mut self, bytes: &[u8], part: Part) -> bool {
        let place = (self.first + self.telegrams) % PLACES;
        if bytes.is_empty() && self.telegrams < self.capacity.telegrams {
            self.lengths[place] = 0;
            self.telegrams += 1;
        } else if !self.push(bytes) {
            return false;
        }
        self.lengths[place] |= match part {
            Part::More => MORE,
            Part::Last => 0,
            Part::Broken => BROKEN,
        };
        true
    }

    /// Number of complete telegrams.
    pub(crate) fn complete(&self) -> usize {
        let places = (self.first..self.first + self.telegrams).map(|place| self.lengths[place % PLACES]);
        places.filter(|length| length & (MORE | BROKEN) == 0).count()
    }

    /// Length of the oldest telegram, or part.
    pub(crate) fn oldest(&self) -> Option<usize> {
        (self.telegrams > 0).then(|| usize::from(self.lengths[self.first] & !(MORE | BROKEN)))
    }

    /// What follows the oldest part: the rest of its telegram, nothing, or its loss.
    pub(crate) const fn oldest_part(&self) -> Part {
        match self.lengths[self.first] & (MORE | BROKEN) {
            0 => Part::Last,
            MORE => Part::More,
            _ => Part::Broken,
        }
    }

    /// Copies out of the oldest telegram, from byte `at` on.
    pub(crate) fn copy(&self, at: usize, into: &mut [u8]) {
        for (offset, byte) in into.iter_mut().enumerate() {
            *byte = self.bytes[(self.head + at + offset) % BYTES];
        }
    }

    /// Drops the oldest telegram.
    pub(crate) fn pop(&mut self) {
        if let Some(length) = self.oldest() {
            self.head = (self.head + length) % BYTES;
            self.used -= length;
            self.first = (self.first + 1) % PLACES;
            self.telegrams -= 1;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::collections::VecDeque;

    #[test]
    fn bytes_and_telegrams_are_limited() {
        let mut ring = <Ring>::new();
        ring.clear(Capacity::buffers(250));
        assert!(ring.push(&[7; 1024]));
        assert_eq!(ring.room(), 0);
        assert!(!ring.push(&[1]), "full");
        ring.clear(Capacity::buffers(2));
        assert!(ring.push(&[1]) && ring.push(&[2]));
        assert_eq!(ring.room(), 0, "two receive buffers are two telegrams");
        ring.pop();
        assert_eq!(ring.room(), 1023);
        assert!(!ring.push(&[]), "there are no empty telegrams");
        ring.clear(Capacity::large(150));
        assert!(ring.push(&[7; 1800]) && (1..150).all(|n| ring.push(&[n as u8])));
        assert_eq!(ring.room(), 0, "150 telegrams, though only 1949 bytes");
    }

    #[test]
    fn the_newest_telegram_takes_the_place_of_the_one_before() {
        let mut ring = Ring::<BYTES_341>::new();
        ring.clear(Capacity::of_bytes(BYTES_341, 1).newest());
        assert!(ring.push(&[1; 4096]) && ring.push(&[2; 4095]) && !ring.push(&[3; 4097]));
        assert_eq!((ring.telegrams(), ring.oldest(), ring.room()), (1, Some(4095), 4096));
        let mut out = [0; 4095];
        ring.copy(0, &mut out);
        assert_eq!(out, [2; 4095]);
    }

    proptest! {
        #[test]
        fn telegrams_come_out_as_they_went_in(
            lengths in proptest::collection::vec((1usize..=1024, any::<bool>()), 0..300),
            limit in 1u8..=250,
            large in any::<bool>(),
        ) {
            let mut ring = <Ring>::new();
            let capacity = if large { Capacity::large(limit) } else { Capacity::buffers(limit) };
            ring.clear(capacity);
            let mut model: VecDeque<Vec<u8>> = VecDeque::new();
            for (n, (length, take)) in lengths.into_iter().enumerate() {
                let telegram: Vec<u8> = (0..length).map(|i| (i * 7 + n) as u8).collect();
                let used: usize = model.iter().map(Vec::len).sum();
                let fits = model.len() < usize::from(limit) && used + length <= if large { 2048 } else { 1024 };
                prop_assert_eq!(ring.push(&telegram), fits);
                if fits {
                    model.push_back(telegram);
                }
                if take && let Some(expected) = model.pop_front() {
                    let mut out = vec![0; ring.oldest().unwrap()];
                    ring.copy(0, &mut out);
                    prop_assert_eq!(out, expected);
                    ring.pop();
                }
                prop_assert_eq!(ring.telegrams(), model.len());
            }
        }
    }
}
