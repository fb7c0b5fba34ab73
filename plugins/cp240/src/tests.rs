//! The step functions against a CP written only from `docs/cp240-registers.md`.

mod fragment;
mod line;
mod receive;
mod rk512;
mod send;
mod synchron;
mod turn;
mod wire;

/// A CP that follows the register document, step by step.
mod fake_cp;
