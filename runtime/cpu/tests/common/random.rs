//! Random numbers that are the same in every run.

/// xorshift.
#[derive(Debug)]
pub struct Random(pub u64);

impl Random {
    /// 64 bits.
    pub fn bits(&mut self) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0
    }

    /// A number below `below`, which is not 0.
    pub fn next(&mut self, below: u32) -> u32 {
        (self.bits() >> 33) as u32 % below
    }

    /// One of the choices.
    pub fn of<T: Copy>(&mut self, choices: &[T]) -> T {
        choices[self.next(choices.len() as u32) as usize]
    }
}
