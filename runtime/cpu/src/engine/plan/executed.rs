//! How much each block of statements executes: which of them are worth optimising first.

use crate::accounts::Count;

/// Statements executed since the last start-up, for each of [`super::Plan::blocks`]. The scan writes it while the
/// engine is one that accounts for blocks ([`crate::engine::ACCOUNTING`]); anybody may read it meanwhile.
#[derive(Debug, Default)]
pub struct Executed(Box<[Count]>);

impl Executed {
    pub(crate) fn new(blocks: usize) -> Self {
        Self((0..blocks).map(|_| Count::default()).collect())
    }

    #[inline]
    pub(crate) fn add(&self, block: u32, statements: u64) {
        if let Some(count) = self.0.get(block as usize) {
            count.add(statements);
        }
    }

    /// The account begins at zero.
    pub(crate) fn forget(&self) {
        self.0.iter().for_each(|count| count.set(0));
    }

    /// Continues the account `before` of the same blocks.
    pub(crate) fn go_on_from(&self, before: &Self) {
        for (count, before) in self.0.iter().zip(&before.0) {
            count.set(before.get());
        }
    }

    /// The account so far. Single blocks of it may be a moment older than others.
    #[must_use]
    pub fn read(&self) -> Vec<u64> {
        self.0.iter().map(Count::get).collect()
    }
}
