//! Time limits, and the end of policies that never say that they are finished.

use std::sync::atomic::AtomicBool;

use genmanip_core::{ActionChunk, Ending, EpisodeStart, Observation, Policy, PolicyError, PolicySpec};
use genmanip_pipeline::PolicyFactory;
use genmanip_pipeline::evaluate::{EndingRules, EvaluateOptions, Suite, evaluate};
use genmanip_rollout::policies::OpenLoop;
use genmanip_workspace::NoProgress;

/// Replays a recording, then holds the last command forever.
struct Endless {
    replay: OpenLoop,
    last: Option<Vec<f32>>,
}

impl Policy for Endless {
    fn spec(&self) -> PolicySpec {
        PolicySpec { name: "endless".into(), ..self.replay.spec() }
    }

    fn reset(&mut self, start: &EpisodeStart) -> Result<(), PolicyError> {
        self.replay.reset(start)
    }

    fn act(&mut self, observation: &Observation) -> Result<ActionChunk, PolicyError> {
        let actions = match &self.last {
            Some(last) => vec![last.clone(); 6],
            None => self.replay.act(observation)?.actions,
        };
        self.last = actions.last().cloned();
        Ok(ActionChunk { actions, finished: false })
    }
}

fn endless() -> PolicyFactory {
    let make = |episode: &genmanip_pipeline::policies::PolicyContext| -> Result<Box<dyn Policy>, _> {
        Ok(Box::new(Endless { replay: OpenLoop::replay(episode.recorded.unwrap()), last: None }))
    };
    PolicyFactory::of("endless", make).unwrap().never_finishing()
}

/// An endless policy that solves its tasks ends on success unless told otherwise; a short horizon cuts every policy off.
pub fn episodes_end_as_told(suite: &Suite) {
    let check = |horizon_s, stop_on_success, label: &str, ending: Ending, success: bool| {
        let ending_rules = EndingRules { horizon_s, stop_on_success, ..EndingRules::default() };
        let options = EvaluateOptions { workers: 1, ending: ending_rules, ..EvaluateOptions::default() };
        let reports = evaluate(suite, &[endless()], &options, &NoProgress, &AtomicBool::new(false)).unwrap();
        let report = &reports[0];
        assert_eq!((report.label.as_str(), report.horizon_s), (label, horizon_s));
        assert_eq!(report.stop_on_success, stop_on_success.unwrap_or(true), "{label}");
        for result in &report.results {
            assert_eq!((result.ending, result.success), (Some(ending), success), "{label}: {result:?}");
            assert_eq!(result.horizon_s, horizon_s.unwrap_or(suite.settings.rollout.horizon_s), "{label}");
            assert!(ending != Ending::Success || result.duration_s < 60.0, "{label}: {} s", result.duration_s);
        }
    };
    check(None, None, "endless", Ending::Success, true);
    check(Some(2.0), None, "endless+horizon=2", Ending::Horizon, false);
    check(Some(40.0), Some(false), "endless+horizon=40+no_stop_on_success", Ending::Horizon, true);
    let ending = EndingRules { horizon_s: Some(f64::NAN), ..EndingRules::default() };
    let options = EvaluateOptions { workers: 1, ending, ..EvaluateOptions::default() };
    let refused = evaluate(suite, &[endless()], &options, &NoProgress, &AtomicBool::new(false)).unwrap_err();
    assert!(refused.to_string().contains("a horizon of NaN s is not possible"), "{refused}");
}
