//! The CP 240: programs around FC 0, 1, 8, 9, 11 and FC 2, 3, 4.

pub mod blocks;
mod draw;
mod orders;
mod partner;
pub mod serve;

use std::path::Path;

use crate::compare::random::Random;

use super::judge::cp240::Bench240;
use super::run::{self, Outcome};

pub use draw::{Case240, Facts, Protocol, Receiver, Role, Sender, Times, case};
pub use partner::Partner240;

/// Draws the case of a seed and runs it.
///
/// # Errors
/// The program cannot be built.
pub fn run(seed: u64, folder: &Path, log: bool) -> Result<Outcome, String> {
    let Case240 { case, facts } = case(&mut Random::new(seed ^ 0x0240_0240), seed);
    let mut judge = Bench240::new(facts);
    run::run(case, &mut judge, folder, log)
}
