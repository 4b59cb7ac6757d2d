//! Execution options of `collect`.

use genmanip_workspace::shard::Shard;

/// Execution options of `collect`; they do not change the results.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct CollectOptions {
    /// Worker threads.
    pub workers: usize,
    /// True to move damaged episodes to `damaged/` of the run and make them anew; else they are omitted.
    pub repair: bool,
    /// The part of the run that is made, without its dataset; `None` for all of it.
    pub shard: Option<Shard>,
    /// Number of verified demonstrations of a run without a fixed number of attempts; a larger number extends the run.
    pub verified: Option<usize>,
    /// True to make every attempt, also after three in a row that the policy to correct did not run.
    pub keep_going: bool,
}
