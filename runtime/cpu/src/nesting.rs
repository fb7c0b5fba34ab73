//! How deep organization blocks and native blocks can be nested on the thread that runs the CPU, and the stack that
//! takes. Blocks of statements need what the engine says: nothing, when they are nested inside its own stack.
//!
//! A priority class runs one organization block at a time, and in its class one for a synchronous error. OB 80 may
//! interrupt its own class once. So the loaded organization blocks determine how many run at most at one time; in each
//! of them `nesting_depth` native blocks can be nested when a plugin is there that calls blocks.

use ob1_model::{BlockId, BlockKind};

use crate::interrupts::{SLOTS, ob_of, priority_of};
use crate::{CpuConfig, LoadError};

/// What the thread needs outside of all blocks.
const BASE: usize = 64 * 1024;
/// An organization block: the interrupt or error that calls it, and the engine that runs it.
const ORGANIZATION_BLOCK: usize = 6 * 1024;
/// A standard block; it calls no other.
const STANDARD_BLOCK: usize = 16 * 1024;
/// The CPU's part of a call by a native block.
const NESTED_CALL: usize = 4 * 1024;

/// Stack, in bytes, that a native block of a plugin may use in one call, without that of the blocks it calls.
pub const PLUGIN_STACK_BYTES: usize = 32 * 1024;

/// What nests on one stack at most.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Nesting {
    /// Organization blocks at one time.
    pub(crate) obs: usize,
    /// Bytes of stack for all.
    pub(crate) stack: usize,
}

impl Nesting {
    /// For these loaded blocks; `plugins`: one of the native blocks is of a plugin; `per_block`: stack that the engine
    /// needs for a nested block of statements; `most`: the largest stack there can be.
    pub(crate) fn new(
        config: &CpuConfig,
        loaded: &dyn Fn(BlockId) -> bool,
        plugins: bool,
        per_block: usize,
        most: usize,
    ) -> Result<Self, LoadError> {
        let ob = |number: u16| loaded(BlockId::new(BlockKind::Ob, number));
        let any = |numbers: &[u16]| usize::from(numbers.iter().any(|number| ob(*number)));
        let mut classes = [false; 32];
        for number in (0..SLOTS).map(ob_of).filter(|number| ob(*number)) {
            classes[usize::from(priority_of(number))] = true;
        }
        let interrupts = classes.into_iter().filter(|used| *used).count();
        let cycle = any(&[1, 100, 101, 102]);
        let errors = any(&[80]) + any(&[82, 85, 86]) + any(&[88]);
        let obs = (cycle + interrupts + errors) * (1 + any(&[121, 122]));
        let natives = match plugins {
            true => usize::from(config.nesting_depth) * (PLUGIN_STACK_BYTES + NESTED_CALL),
            false => STANDARD_BLOCK,
        };
        let statements = usize::from(config.nesting_depth) * per_block;
        let each = ORGANIZATION_BLOCK + natives + statements;
        let stack = BASE + obs * each;
        if stack > most {
            return Err(LoadError::Stack { bytes: stack, obs, nesting: config.nesting_depth, most });
        }
        // Room for programs that come later.
        Ok(Self { obs, stack: (stack + usize::from(config.spare_obs) * each).min(most) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::MOST_STACK_BYTES;

    fn with(obs: &[u16], depth: u8, plugins: bool) -> Result<Nesting, LoadError> {
        let config = CpuConfig { nesting_depth: depth, ..CpuConfig::default() };
        Nesting::new(&config, &|id| id.kind == BlockKind::Ob && obs.contains(&id.number), plugins, 0, MOST_STACK_BYTES)
    }

    #[test]
    fn organization_blocks_at_one_time() {
        for (loaded, obs) in [
            (&[][..], 0),
            (&[1], 1),
            (&[1, 100, 102], 1),
            (&[1, 121], 2),
            (&[1, 121, 122], 2),
            (&[1, 10, 17], 2),
            (&[1, 20, 23, 35, 40], 5),
            (&[1, 35, 80, 82, 85, 86, 121], 8),
            (&[1, 88, 122], 4),
            (&[1, 81, 83, 90], 1),
        ] {
            assert_eq!(with(loaded, 24, false).map(|n| n.obs), Ok(obs), "{loaded:?}");
        }
    }

    #[test]
    fn what_does_not_fit_is_refused() {
        let all: Vec<u16> = (0..128).collect();
        let most = with(&all, 24, true).expect("the default nesting depth fits with everything loaded");
        assert_eq!(most.obs, 52);
        assert!(most.stack <= MOST_STACK_BYTES && with(&all, 64, false).is_ok());
        let error = with(&all, 64, true).expect_err("too much");
        assert_eq!(error.number(), 13);
        assert!(error.to_string().contains("nesting_depth"), "{error}");
    }
}
