//! Outcome of a layout attempt that is not accepted.

use genmanip_sim::SimError;

use crate::error::LayoutError;
use crate::rejection::Rejection;

/// Reason for discarding a layout attempt.
pub(crate) enum AttemptError {
    /// The layout is invalid; another attempt may succeed.
    Rejected(Rejection),
    /// The layout could not be evaluated.
    Defect(LayoutError),
}

impl AttemptError {
    /// Classifies a simulation error: instability and dropped contacts reject the layout; everything else (out of
    /// memory, a broken library, an invalid world) is a defect.
    pub(crate) fn of_physics(error: SimError) -> Self {
        match error {
            SimError::Unstable { .. } | SimError::ContactsDropped { .. } => {
                Self::Rejected(Rejection::Physics(error.to_string()))
            }
            error => Self::Defect(LayoutError::Physics(error)),
        }
    }
}

impl From<Rejection> for AttemptError {
    fn from(reason: Rejection) -> Self {
        Self::Rejected(reason)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_shortage_is_no_verdict_about_the_task() {
        let unstable = SimError::Unstable { time_s: 0.1, what: "speed of the mug".into() };
        assert!(matches!(AttemptError::of_physics(unstable), AttemptError::Rejected(_)));
        // `unknown error` is the engine's message when out of memory.
        for error in [SimError::Compile("unknown error".into()), SimError::Settings("no table".into())] {
            let AttemptError::Defect(error) = AttemptError::of_physics(error) else { panic!("taken for a verdict") };
            assert!(error.is_defect(), "{error}");
        }
    }
}
