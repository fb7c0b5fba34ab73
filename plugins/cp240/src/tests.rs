//! The step functions against a CP made of `docs/cp240-registers.md` alone.

mod fragment;
mod line;
mod receive;
mod rk512;
mod send;
mod synchron;
mod wire;

/// What a CP that follows the register document would do, step by step.
mod fake_cp;
