//! The search through the secondary addresses: a wildcard pattern, narrowed digit by digit where several meters answer.

/// Digits of an identification.
const DIGITS: u32 = 8;
/// The wildcard digit Fh: any digit matches.
const ANY: u32 = 0xF;

/// A pattern of identifications, and the number of digits set.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Walk {
    /// The initial pattern: its digits Fh are searched, from the left.
    pub(crate) base: u32,
    /// The current pattern, eight digits.
    pub(crate) id: u32,
    /// The number of searched digits that are set.
    pub(crate) level: u8,
}

impl Walk {
    /// The start of a search.
    pub(crate) fn new(base: u32) -> Self {
        Self { base, id: base, level: 0 }
    }

    /// Sets one more digit to 0; false: all are set.
    pub(crate) fn narrow(&mut self) -> bool {
        let Some(shift) = self.place(self.level) else { return false };
        self.set(shift, 0);
        self.level += 1;
        true
    }

    /// Goes to the next pattern outside this one; false: this was the last.
    pub(crate) fn go_on(&mut self) -> bool {
        while let Some(shift) = self.level.checked_sub(1).and_then(|level| self.place(level)) {
            let digit = (self.id >> shift) & ANY;
            if digit < 9 {
                self.set(shift, digit + 1);
                return true;
            }
            self.set(shift, ANY);
            self.level -= 1;
        }
        false
    }

    fn set(&mut self, shift: u32, digit: u32) {
        self.id = self.id & !(ANY << shift) | digit << shift;
    }

    /// The bit position of the searched digit with this number.
    fn place(&self, number: u8) -> Option<u32> {
        let places = (0..DIGITS).rev().map(|digit| 4 * digit);
        places.filter(|shift| (self.base >> shift) & ANY == ANY).nth(number.into())
    }
}

#[cfg(test)]
mod tests {
    use super::Walk;

    #[test]
    fn the_way() {
        let mut walk = Walk::new(0xFFFF_FFFF);
        assert!(walk.narrow());
        assert_eq!(walk.id, 0x0FFF_FFFF);
        assert!(walk.narrow());
        assert_eq!(walk.id, 0x00FF_FFFF);
        for _ in 0..9 {
            assert!(walk.go_on());
        }
        assert_eq!((walk.id, walk.level), (0x09FF_FFFF, 2));
        assert!(walk.go_on());
        assert_eq!((walk.id, walk.level), (0x1FFF_FFFF, 1));
        let left = std::iter::from_fn(|| walk.go_on().then_some(walk.id)).last();
        assert_eq!((left, walk.level, walk.id), (Some(0x9FFF_FFFF), 0, 0xFFFF_FFFF));
    }

    #[test]
    fn digits_that_are_given_stay() {
        let mut walk = Walk::new(0x12F4_567F);
        assert!(walk.narrow() && walk.narrow());
        assert!(!walk.narrow());
        let mut seen = 1;
        while walk.go_on() {
            walk.narrow();
            assert_eq!(walk.id & 0xFF0F_FFF0, 0x1204_5670);
            seen += 1;
        }
        assert_eq!(seen, 100);
        assert!(!Walk::new(0x1234_5678).go_on());
    }
}
