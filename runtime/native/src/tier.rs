//! The tiers of the compiler.

/// How much time compiling may take.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Tier {
    /// Quickly, without optimisation: the first code of a station.
    Fast,
    /// Optimised: runs faster, takes longer to make.
    #[default]
    Optimised,
}
