//! Programs around the blocks of the point-to-point CPs: CP 341 (`P_SND_RK`, `P_RCV_RK`), CP 340 (`P_SEND`, `P_RCV`),
//! SLIO CP 040 (FB 60, FB 61, FB 65). The judge knows the manuals and no code of the project.

pub mod blocks;
pub mod draw;
pub mod judge;
pub mod line;
pub mod modbus;
pub mod numbers;
pub mod partner;
pub mod pieces;
pub mod post;
pub mod receiver;
pub mod rule;
pub mod sender;
#[cfg(test)]
mod tests;

use std::path::Path;

use super::run::{self, Outcome};
use draw::Cp;

/// The case of a seed with a CP 341.
///
/// # Errors
/// The station cannot be built.
pub fn cp341(seed: u64, folder: &Path, log: bool) -> Result<Outcome, String> {
    one(Cp::Cp341, seed, folder, log)
}

/// The case of a seed with a CP 340.
///
/// # Errors
/// The station cannot be built.
pub fn cp340(seed: u64, folder: &Path, log: bool) -> Result<Outcome, String> {
    one(Cp::Cp340, seed, folder, log)
}

/// The case of a seed with a CP 040.
///
/// # Errors
/// The station cannot be built.
pub fn cp040(seed: u64, folder: &Path, log: bool) -> Result<Outcome, String> {
    one(Cp::Cp040, seed, folder, log)
}

fn one(cp: Cp, seed: u64, folder: &Path, log: bool) -> Result<Outcome, String> {
    let (case, setup) = draw::case(cp, seed);
    let mut judge = judge::PtpJudge::new(setup);
    run::run(case, &mut judge, folder, log)
}
