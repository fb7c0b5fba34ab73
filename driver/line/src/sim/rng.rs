//! The random numbers of the simulation: SplitMix64 (Steele, Lea, Flood: "Fast splittable pseudorandom number
//! generators"). Small, fast, and implemented here so that a seed always gives the same numbers.

use ob1_serial::Span;

/// A stream of random numbers.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SplitMix64(u64);

impl SplitMix64 {
    /// The stream of a seed; every seed is good.
    pub fn new(seed: u64) -> Self {
        Self(seed)
    }

    /// The next number of the sequence, evenly spread over all 64 bits.
    pub fn next_u64(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    /// A number in `0..bound`; 0 if `bound` is 0.
    pub fn below(&mut self, bound: u64) -> u64 {
        ((u128::from(self.next_u64()) * u128::from(bound)) >> 64) as u64
    }

    /// A time shorter than `bound`; zero if `bound` is zero.
    pub fn span_below(&mut self, bound: Span) -> Span {
        Span::from_nanos(self.below(bound.nanos()))
    }
}
