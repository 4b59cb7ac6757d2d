//! Reference to an episode of several data sets.

/// Reference to an episode of one of several data sets.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct EpisodeRef {
    pub(super) source: usize,
    pub(super) episode: usize,
}
