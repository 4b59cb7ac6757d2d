//! Execution options of `collect`.

use genmanip_workspace::shard::Shard;

/// Execution options of `collect`; they do not change the results.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct CollectOptions {
    /// Number of worker threads.
    pub workers: usize,
    /// True to move damaged episodes to `damaged/` of the run and attempt them again; otherwise they are omitted.
    pub repair: bool,
    /// Part of the run to collect, without a dataset; `None` for the whole run.
    pub shard: Option<Shard>,
    /// Wanted number of verified demonstrations, for a run without a fixed number of attempts; a larger number extends
    /// the run.
    /// `None` for a run with a fixed number.
    pub verified: Option<usize>,
    /// True to go on after three attempts in a row that the policy to be corrected could not run.
    pub keep_going: bool,
}
