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
    /// The goal has several moves, none, or one that is neither a state of an object nor a place on or in another.
    #[error("expected a goal with one move: a state of an object, or a place on or in another one")]
    NotOneMove,
    /// The joint is where it was.
    #[error("nothing moved: expected a joint that the hand moves")]
    NothingMoved,
    /// The hand did not touch what moved when it began to move.
    #[error("no contact of the hand with what moved at control step {step}")]
    NoContact {
        /// First control step of the motion.
        step: usize,
    },
    /// The fingers did not hold the object that was carried.
    #[error("the fingers did not hold the object: expected a grasp from the lift to the release")]
    NotHeld,
    /// The hand lost what it moved before the end.
    #[error(
        "the hand released the object at control step {step}, before the motion ended: expected one contact from begin to end"
    )]
    Released {
        /// Control step after the last one in contact.
        step: usize,
    },
    /// The episode cannot be replayed.
    #[error(transparent)]
    Replay(#[from] RolloutError),
}
