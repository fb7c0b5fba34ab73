//! Where the time of an order goes, as the status of a module says it.

use ob1_backplane::{SPREAD_BOUNDS, Spread};
use serde::{Deserialize, Serialize};

/// How long one stage of the orders of a CP took, or of the telegrams of its partner (docs/backplane.md, "Times").
#[derive(Clone, Debug, Default, PartialEq, Eq, Deserialize, Serialize)]
pub struct StageStatus {
    /// `order` or `telegram`.
    pub kind: String,
    /// The moment with which the stage ends; it begins with the one said before it.
    pub stage: String,
    /// How many have gone through it.
    pub count: u64,
    /// The mean time, in nanoseconds.
    pub mean_ns: u64,
    /// Upper bounds in nanoseconds, and how many took no longer, but longer than the bound before.
    pub buckets: Vec<(u64, u64)>,
}

impl StageStatus {
    /// What the account of a CP says of one stage.
    #[must_use]
    pub fn of(spread: Spread) -> Self {
        let count: u64 = spread.buckets.iter().sum();
        let bounds = SPREAD_BOUNDS.into_iter().chain([u64::MAX]);
        Self {
            kind: if spread.is_order { "order" } else { "telegram" }.to_owned(),
            stage: spread.stage.name().to_owned(),
            count,
            mean_ns: spread.total / count.max(1),
            buckets: bounds.zip(spread.buckets).filter(|(_, count)| *count > 0).collect(),
        }
    }
}
