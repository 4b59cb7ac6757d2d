//! Index of an episode across several data sets.

/// Index of a data set among those to be merged or edited, and of an episode in it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct EpisodeRef {
    pub(super) source: usize,
    pub(super) episode: usize,
}
