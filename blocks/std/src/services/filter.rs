//! The filter of synchronous errors (SFC 36 to 38): which errors call no OB 121 or OB 122, and which of those have
//! occurred.
//!
//! Bit `n` of the programming errors is event 2520h + n, bit `n` of the access errors is event 2940h + n.
//! ["Handling Synchronous Errors"]

use ob1_model::FaultKind;

/// The filter of one priority class. It is empty when an OB begins.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ErrorFilter {
    /// Masked errors: programming, access.
    masked: [u32; 2],
    /// Masked errors that have occurred.
    occurred: [u32; 2],
}

/// Errors that exist: the bits a filter can have.
const EXIST: [u32; 2] = existing();

const fn bit(kind: FaultKind) -> Option<(usize, u32)> {
    match kind.number() {
        number @ 0x2520..=0x253F => Some((0, 1 << (number - 0x2520))),
        number @ 0x2940..=0x295F => Some((1, 1 << (number - 0x2940))),
        _ => None,
    }
}

const fn existing() -> [u32; 2] {
    let mut bits = [0, 0];
    let mut i = 0;
    while i < FaultKind::ALL.len() {
        if let Some((filter, mask)) = bit(FaultKind::ALL[i]) {
            bits[filter] |= mask;
        }
        i += 1;
    }
    bits
}

impl ErrorFilter {
    /// Masks errors, programming and access. True when one of them was masked already.
    pub fn mask(&mut self, errors: [u32; 2]) -> bool {
        let mut already = false;
        for (i, errors) in errors.into_iter().enumerate() {
            already |= self.masked[i] & errors != 0;
            self.masked[i] |= errors & EXIST[i];
        }
        already
    }

    /// Ends the masking of errors and forgets that they occurred. True when one of them was not masked.
    pub fn unmask(&mut self, errors: [u32; 2]) -> bool {
        let mut not_masked = false;
        for (i, errors) in errors.into_iter().enumerate() {
            not_masked |= errors & !self.masked[i] != 0;
            self.masked[i] &= !errors;
            self.occurred[i] &= !errors;
        }
        not_masked
    }

    /// Which of the queried errors have occurred; they are forgotten. The second value is true when one is not masked.
    pub fn query(&mut self, errors: [u32; 2]) -> ([u32; 2], bool) {
        let mut occurred = [0; 2];
        let mut not_masked = false;
        for (i, errors) in errors.into_iter().enumerate() {
            not_masked |= errors & !self.masked[i] != 0;
            occurred[i] = self.occurred[i] & errors;
            self.occurred[i] &= !errors;
        }
        (occurred, not_masked)
    }

    /// The masked errors: programming, access.
    pub const fn masked(&self) -> [u32; 2] {
        self.masked
    }

    /// Told of an error by the CPU: true when it is masked. It is noted then, and no OB is called.
    pub fn absorbs(&mut self, kind: FaultKind) -> bool {
        match bit(kind) {
            Some((filter, mask)) if self.masked[filter] & mask != 0 => {
                self.occurred[filter] |= mask;
                true
            }
            _ => false,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_masked_error_is_noted_until_it_is_asked_for() {
        let mut filter = ErrorFilter::default();
        assert!(!filter.absorbs(FaultKind::FcNotLoaded));
        assert!(!filter.mask([1 << 28, 1 << 2]));
        assert!(filter.absorbs(FaultKind::FcNotLoaded));
        assert!(filter.absorbs(FaultKind::PeripheralRead));
        assert!(!filter.absorbs(FaultKind::PeripheralWrite));
        assert_eq!(filter.query([1 << 28, 0]), ([1 << 28, 0], false));
        assert_eq!(filter.query([1 << 28, 1 << 3]), ([0, 0], true));
        assert!(!filter.unmask([1 << 28, 1 << 2]));
        assert!(!filter.absorbs(FaultKind::FcNotLoaded));
    }

    #[test]
    fn bits_without_an_error_are_not_masked() {
        let mut filter = ErrorFilter::default();
        filter.mask([u32::MAX, u32::MAX]);
        assert_eq!(filter.masked(), [0xF43F_03FE, 0x0000_000C]);
    }
}
