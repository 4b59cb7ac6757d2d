//! Reasons why an episode gives no skill, or a skill cannot be used.

use genmanip_rollout::RolloutError;

/// Reason why no skill can be cut from an episode.
#[derive(Debug, thiserror::Error)]
pub enum SkillError {
    /// The episode did not reach its goal.
    #[error("episode {episode} did not reach its goal: expected one that succeeded")]
    Failed {
        /// Id of the episode.
        episode: String,
    },
    /// The goal has several moves, or none.
    #[error("expected a goal with one move: one state of an object, or one object to carry")]
    NotOneMove,
    /// The joint or the object is where it was.
    #[error("nothing moved: expected a joint or an object that the hand moves")]
    NothingMoved,
    /// The hand did not touch what moved when it began to move.
    #[error("no contact of the hand with what moved at control step {step}")]
    NoContact {
        /// First control step of the motion.
        step: usize,
    },
    /// The hand lost what it moved before the end.
    #[error("the hand let go at control step {step}, before the motion ended: expected one contact from begin to end")]
    LetGo {
        /// Control step after the last one in contact.
        step: usize,
    },
    /// An object was moved without being held.
    #[error("the object was not held while it moved: expected a grasp")]
    NotHeld,
    /// The episode cannot be replayed.
    #[error(transparent)]
    Replay(#[from] RolloutError),
}
