//! The tiers of the compiler.

/// How much time compiling may take.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Tier {
    /// Quickly: no optimisation.
    Fast,
    /// Optimised.
    #[default]
    Optimised,
}
