//! Policies on servers, as the registry makes them.

use std::sync::Arc;
use std::time::Duration;

use genmanip_core::{ActionChunk, EpisodeStart, Observation, Policy, PolicyError, PolicySpec, RobotModel};
use genmanip_remote::Patience;
use genmanip_remote::openpi::{OpenpiPolicy, OpenpiSettings, Preset};
use genmanip_rollout::Cores;

use crate::error::RunError;

/// Environment variable that holds the server's API key, if it wants one.
const KEY: &str = "OPENPI_API_KEY";
/// A policy waits no longer than this for a server that is there, s.
pub(crate) const LONGEST_WAIT_S: f64 = 3600.0;

/// What is said about a server of openpi's protocol.
pub(crate) struct Named<'a> {
    pub url: &'a str,
    pub preset: &'a str,
    pub exterior: &'a str,
    pub wrist: &'a str,
    /// Actions of a chunk that are executed, or nothing.
    pub execute: &'a str,
    pub timeout_s: f64,
}

/// Settings for a server.
///
/// # Errors
/// A URL that is none, an unknown preset, and a number of steps that is none.
pub(crate) fn settings(named: &Named) -> Result<OpenpiSettings, RunError> {
    let input = |what: String, hint: &str| Err(RunError::input(what).with_hint(hint));
    let Named { url, preset, exterior, wrist, execute, timeout_s } = *named;
    if url.strip_prefix("ws://").is_none_or(str::is_empty) {
        return input(format!("policy openpi: url={url} is not possible"), "expected ws://HOST:PORT");
    }
    let known = Preset::ALL.map(Preset::name);
    let preset = Preset::ALL.into_iter().find(|it| it.name() == preset);
    let preset = preset.ok_or_else(|| RunError::unknown("preset", "presets", named.preset, &known))?;
    let execute_steps = match execute.parse::<usize>() {
        _ if execute.is_empty() => None,
        Ok(steps @ 1..=1000) => Some(steps),
        _ => return input(format!("policy openpi: execute={execute} is not possible"), "expected 1 to 1000 actions"),
    };
    Ok(OpenpiSettings {
        url: url.into(),
        preset,
        exterior: exterior.into(),
        wrist: wrist.into(),
        execute_steps,
        api_key: std::env::var(KEY).ok().filter(|key| !key.is_empty()),
        patience: Patience { answer: Duration::from_secs_f64(timeout_s), ..Patience::default() },
    })
}

/// The policy for one episode, which lends its core while it waits for the server.
pub(crate) fn openpi(
    settings: &OpenpiSettings,
    robot: &Arc<RobotModel>,
    cores: Option<&Arc<Cores>>,
) -> Box<dyn Policy> {
    let policy = OpenpiPolicy::new(settings.clone(), Arc::clone(robot));
    match cores {
        Some(cores) => Box::new(Lending { policy, cores: Arc::clone(cores) }),
        None => Box::new(policy),
    }
}

struct Lending<P> {
    policy: P,
    cores: Arc<Cores>,
}

impl<P: Policy> Policy for Lending<P> {
    fn spec(&self) -> PolicySpec {
        self.policy.spec()
    }

    fn reset(&mut self, start: &EpisodeStart) -> Result<(), PolicyError> {
        self.policy.reset(start)
    }

    fn act(&mut self, observation: &Observation) -> Result<ActionChunk, PolicyError> {
        let Self { policy, cores } = self;
        cores.lend(|| policy.act(observation))
    }
}
