//! Random numbers that are the same in every run.

/// The numbers of a seed.
#[derive(Debug)]
pub struct Random(fastrand::Rng);

impl Random {
    pub fn new(seed: u64) -> Self {
        Self(fastrand::Rng::with_seed(seed))
    }

    /// 64 bits.
    pub fn bits(&mut self) -> u64 {
        self.0.u64(..)
    }

    /// A number below `below`, which is not 0.
    pub fn next(&mut self, below: u32) -> u32 {
        self.0.u32(..below)
    }

    /// One of the choices.
    pub fn of<T: Copy>(&mut self, choices: &[T]) -> T {
        choices[self.next(choices.len() as u32) as usize]
    }
}
