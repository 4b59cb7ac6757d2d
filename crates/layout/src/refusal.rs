//! Why a placed layout is not kept: because of the layout, or because nobody can tell.

use genmanip_sim::SimError;

use crate::error::LayoutError;
use crate::rejection::Rejection;

/// Why a placed layout is not kept.
pub(crate) enum Refusal {
    /// It is not good enough; another attempt may be.
    Rejected(Rejection),
    /// Nobody can tell.
    Defect(LayoutError),
}

impl Refusal {
    /// What physics say about a layout: only a simulation that ran and blew up, or has more contacts than it can hold,
    /// tells about the layout. Everything else (no memory, a broken library, a world that it refuses) does not.
    pub(crate) fn of_physics(error: SimError) -> Self {
        match error {
            SimError::Unstable { .. } | SimError::ContactsDropped { .. } => {
                Self::Rejected(Rejection::Physics(error.to_string()))
            }
            error => Self::Defect(LayoutError::Physics(error)),
        }
    }
}

impl From<Rejection> for Refusal {
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
        assert!(matches!(Refusal::of_physics(unstable), Refusal::Rejected(_)));
        // What the engine says when it gets no memory.
        for error in [SimError::Compile("unknown error".into()), SimError::Settings("no table".into())] {
            let Refusal::Defect(error) = Refusal::of_physics(error) else { panic!("taken for a verdict") };
            assert!(error.is_defect(), "{error}");
        }
    }
}
