//! Rules that end the episodes of an evaluation: time limit and stop on success.

use genmanip_rollout::collect::PipelineSettings;
use genmanip_rollout::evaluate::Case;
use genmanip_workspace::WorkspaceError;

use crate::policies::PolicyFactory;

/// Maximum time limit, simulated s. At 60 Hz, an hour takes about half a gigabyte of memory.
const MAX_HORIZON_S: f64 = 3600.0;

/// Changes to the rules that end an episode of an evaluation.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct EndingRules {
    /// Time limit, simulated s; `None` for those of the scenarios.
    pub horizon_s: Option<f64>,
    /// True to end an episode as soon as its goal has held for the settling time, with nothing held or moving; the
    /// verdict
    /// is still the one after settling. `None`: true exactly for policies that never end an episode themselves.
    pub stop_on_success: Option<bool>,
    /// True to end an episode at the first action that is out of reach; false to hold the previous command instead.
    pub stop_on_unreachable: bool,
}

impl EndingRules {
    /// The rules, if the time limit is valid.
    ///
    /// # Errors
    /// For a time limit that is not positive, not finite, or longer than an hour.
    pub fn check(self) -> Result<Self, WorkspaceError> {
        match self.horizon_s {
            Some(horizon_s) if !(horizon_s > 0.0 && horizon_s <= MAX_HORIZON_S) => {
                Err(WorkspaceError::input(format!("a horizon of {horizon_s} s is not possible"))
                    .with_hint(format!("expected simulated seconds, more than 0 and at most {MAX_HORIZON_S}")))
            }
            _ => Ok(self),
        }
    }

    /// True if the episodes of this policy end on success.
    pub(super) fn stops_on_success(self, policy: &PolicyFactory) -> bool {
        self.stop_on_success.unwrap_or_else(|| policy.never_finishes())
    }

    /// Settings of a suite, changed by these rules for a policy.
    pub(super) fn settings(self, of_suite: &PipelineSettings, policy: &PolicyFactory) -> PipelineSettings {
        let mut settings = of_suite.clone();
        settings.rollout.horizon_s = self.horizon_s.unwrap_or(settings.rollout.horizon_s);
        settings.rollout.stop_on_success |= self.stops_on_success(policy);
        settings.rollout.stop_on_unreachable |= self.stop_on_unreachable;
        settings
    }

    /// A case with the time limit of these rules, if they have one.
    pub(super) fn case(self, case: &Case) -> Case {
        Case { horizon_s: if self.horizon_s.is_some() { None } else { case.horizon_s }, ..case.clone() }
    }

    /// Label of a policy with all differences from its usual rules, so that evaluations with different rules have
    /// different labels.
    pub(super) fn label(self, policy: &PolicyFactory) -> String {
        let mut label = policy.label().to_owned();
        if let Some(horizon_s) = self.horizon_s {
            label += &format!("+horizon={horizon_s}");
        }
        if let Some(stops) = self.stop_on_success.filter(|stops| *stops != policy.never_finishes()) {
            label += if stops { "+stop_on_success" } else { "+no_stop_on_success" };
        }
        if self.stop_on_unreachable {
            label += "+stop_on_unreachable";
        }
        label
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_differs_is_in_the_label() {
        let finishes = PolicyFactory::resolve("do_nothing:seconds=2").unwrap();
        let never = PolicyFactory::resolve("do_nothing").unwrap().never_finishing();
        let cases = [
            (&finishes, None, None, "do_nothing_seconds=2", false),
            (&finishes, Some(30.0), None, "do_nothing_seconds=2+horizon=30", false),
            (&finishes, Some(2.5), Some(true), "do_nothing_seconds=2+horizon=2.5+stop_on_success", true),
            (&finishes, None, Some(false), "do_nothing_seconds=2", false),
            (&never, None, None, "do_nothing", true),
            (&never, None, Some(true), "do_nothing", true),
            (&never, None, Some(false), "do_nothing+no_stop_on_success", false),
        ];
        for (policy, horizon_s, stop_on_success, label, stops) in cases {
            let rules = EndingRules { horizon_s, stop_on_success, ..EndingRules::default() };
            assert_eq!((rules.label(policy).as_str(), rules.stops_on_success(policy)), (label, stops));
        }
        let strict = EndingRules { stop_on_unreachable: true, ..EndingRules::default() };
        assert_eq!(strict.label(&finishes), "do_nothing_seconds=2+stop_on_unreachable");
    }

    #[test]
    fn impossible_horizons_are_refused() {
        let check = |horizon_s| EndingRules { horizon_s: Some(horizon_s), ..EndingRules::default() }.check();
        for horizon_s in [0.0, -1.0, f64::NAN, f64::INFINITY, 3601.0] {
            let error = check(horizon_s).unwrap_err();
            assert!(error.to_string().contains("is not possible") && error.hint().is_some(), "{error}");
        }
        for horizon_s in [0.01, 30.0, 3600.0] {
            assert!(check(horizon_s).is_ok());
        }
    }
}
