//! Monte Carlo tables: what is flown, in how many pieces, and what is said about it.

mod plan;
mod report;
mod shard;

pub(crate) use plan::Plan;
pub(crate) use report::{Line, Report};
pub(crate) use shard::{Part, Shard, merge};
