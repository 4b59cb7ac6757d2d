//! Episodes of policies on scenarios: run as jobs, found in run folders, and played back as states.

mod episode_job;
mod kept_episodes;
mod moments;
mod offered_policies;
pub mod playback;

pub use episode_job::{EpisodeJob, NewEpisode};
pub use kept_episodes::{EpisodeRow, KeptEpisode, Place, find_episode, kept_episodes, run_folder_name};
pub use moments::{Moment, MomentKind, Moments};
pub use offered_policies::{OfferedPolicies, OfferedPolicy};
