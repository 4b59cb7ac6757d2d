//! Policies on servers and in other processes, for the policy registry.

use std::sync::Arc;
use std::time::Duration;

use genmanip_core::{ActionChunk, EpisodeStart, Observation, Policy, PolicyError, PolicySpec, RobotModel};
use genmanip_remote_policies::Timeouts;
use genmanip_remote_policies::openpi::{OpenpiPolicy, OpenpiSettings, Preset};
use genmanip_remote_policies::process::{ProcessSettings, Processes};
use genmanip_remote_policies::served::Offer;
use genmanip_remote_policies::vla_eval::{self, VlaEvalPolicy, VlaEvalSettings};
use genmanip_rollout::{Cores, Stage};

use crate::policy_spec::{check_robot, mistaken, read_spec};
use genmanip_workspace::WorkspaceError;

/// Environment variable with the API key of the server; needed only by servers that demand one.
const KEY: &str = "OPENPI_API_KEY";
/// Name of the preset for servers that describe their policy themselves, as `genmanip serve policy` does.
const DESCRIBED: &str = "genmanip";
/// Default names of the cameras: exterior and wrist.
pub(crate) const CAMERAS: [&str; 2] = ["static", "wrist"];
/// Maximum waiting time of a policy for an answer of a reachable server, s.
pub(crate) const MAX_WAIT_S: f64 = 3600.0;

/// Arguments of the policy `openpi`, as text.
pub(crate) struct Named<'a> {
    pub url: &'a str,
    pub preset: &'a str,
    pub exterior: &'a str,
    pub wrist: &'a str,
    /// Number of executed actions per chunk; empty for that of the preset.
    pub execute: &'a str,
    pub timeout_s: f64,
}

/// A policy server with openpi's protocol.
pub(crate) enum Server {
    /// A server with the observations and actions of a preset.
    Preset(OpenpiSettings),
    /// A server that describes its observations and actions.
    Described { url: String, execute_steps: Option<usize>, timeouts: Timeouts },
}

/// Validated settings of a server.
///
/// # Errors
/// For an invalid URL, an unknown preset, cameras for a server that names its own, and an invalid number of steps.
pub(crate) fn server(named: &Named) -> Result<Server, WorkspaceError> {
    let input = |what: String, hint: &str| Err(WorkspaceError::input(what).with_hint(hint));
    let Named { url, preset, exterior, wrist, execute, timeout_s } = *named;
    check_url("openpi", url)?;
    let execute_steps = match execute.parse::<usize>() {
        _ if execute.is_empty() => None,
        Ok(steps @ 1..=1000) => Some(steps),
        _ => return input(format!("policy openpi: execute={execute} is not possible"), "expected 1 to 1000 actions"),
    };
    let timeouts = Timeouts { answer: Duration::from_secs_f64(timeout_s), ..Timeouts::default() };
    if preset == DESCRIBED {
        if [exterior, wrist] != CAMERAS {
            let what = format!("policy openpi: preset={DESCRIBED} takes no exterior and wrist");
            return input(what, "leave them out; the server names its cameras");
        }
        return Ok(Server::Described { url: url.into(), execute_steps, timeouts });
    }
    let known: Vec<&str> = Preset::ALL.map(Preset::name).into_iter().chain([DESCRIBED]).collect();
    let preset = Preset::ALL.into_iter().find(|it| it.name() == preset);
    let preset = preset.ok_or_else(|| WorkspaceError::unknown("preset", "presets", named.preset, &known))?;
    Ok(Server::Preset(OpenpiSettings {
        url: url.into(),
        preset,
        exterior: exterior.into(),
        wrist: wrist.into(),
        execute_steps,
        api_key: std::env::var(KEY).ok().filter(|key| !key.is_empty()),
        timeouts,
    }))
}

impl Server {
    /// The policy for one episode; it releases its core to other episodes while it waits for the server.
    ///
    /// # Errors
    /// When a server that describes its policy is unreachable, or the policy is for another robot.
    pub(crate) fn policy(&self, stage: &Stage, cores: Option<&Arc<Cores>>) -> Result<Box<dyn Policy>, WorkspaceError> {
        match self {
            Self::Preset(settings) => Ok(lending(OpenpiPolicy::new(settings.clone(), Arc::clone(&stage.robot)), cores)),
            Self::Described { url, execute_steps, timeouts } => {
                let unreachable = |reason: String| WorkspaceError::Unreachable { policy: "openpi".into(), reason };
                let offer = Offer::of(url, *timeouts).map_err(|error| unreachable(error.to_string()))?;
                let spec = read_spec("openpi", &offer.spec)
                    .map_err(|mistakes| unreachable(format!("the policy of the server {url}: {mistakes}")))?;
                check_robot(&offer.robot, stage)?;
                let spec = PolicySpec { execute_steps: execute_steps.unwrap_or(spec.execute_steps), ..spec };
                Ok(lending(offer.policy(spec, stage.robot.arm_dof()), cores))
            }
        }
    }
}

/// Validated settings of a model server of vla-eval.
///
/// # Errors
/// For an invalid URL, and an unknown preset.
pub(crate) fn vla_eval_settings(
    url: &str,
    preset: &str,
    [exterior, wrist]: [&str; 2],
    patience_s: f64,
) -> Result<VlaEvalSettings, WorkspaceError> {
    check_url("vla-eval", url)?;
    let known = vla_eval::Preset::ALL.map(vla_eval::Preset::name);
    let found = vla_eval::Preset::ALL.into_iter().find(|it| it.name() == preset);
    let preset = found.ok_or_else(|| WorkspaceError::unknown("preset", "presets", preset, &known))?;
    let timeouts = Timeouts { answer: Duration::from_secs_f64(patience_s), ..Timeouts::default() };
    Ok(VlaEvalSettings { url: url.into(), preset, exterior: exterior.into(), wrist: wrist.into(), timeouts })
}

/// The policy for one episode; it releases its core to other episodes while it waits for the server.
pub(crate) fn vla_eval(
    settings: &VlaEvalSettings,
    robot: &Arc<RobotModel>,
    cores: Option<&Arc<Cores>>,
) -> Box<dyn Policy> {
    lending(VlaEvalPolicy::new(settings.clone(), Arc::clone(robot)), cores)
}

fn lending(policy: impl Policy + 'static, cores: Option<&Arc<Cores>>) -> Box<dyn Policy> {
    match cores {
        Some(cores) => Box::new(Lending { policy, cores: Arc::clone(cores) }),
        None => Box::new(policy),
    }
}

/// Pool of Python processes that run a policy class, given as `MODULE:CLASS`.
///
/// # Errors
/// For a text that is not `MODULE:CLASS`.
pub(crate) fn processes(class: &str, python: &str, patience_s: f64) -> Result<Arc<Processes>, WorkspaceError> {
    let is_name = |text: &str| !text.is_empty() && text.chars().all(|c| c.is_alphanumeric() || c == '_');
    let is_class = |(module, name): (&str, &str)| module.split('.').all(is_name) && is_name(name);
    if !class.split_once(':').is_some_and(is_class) {
        return Err(WorkspaceError::input(format!("policy python: `{class}` names no class"))
            .with_hint("expected python:MODULE:CLASS, e.g. python:my_policy:MyPolicy for MyPolicy in my_policy.py"));
    }
    let answer = Duration::from_secs_f64(patience_s);
    Ok(Processes::new(ProcessSettings { class: class.into(), python: python.into(), answer }))
}

/// The policy for one episode, named after its class; it releases its core to other episodes while it waits for its
/// process.
pub(crate) fn python(
    processes: &Arc<Processes>,
    cores: Option<&Arc<Cores>>,
) -> Result<Box<dyn Policy>, WorkspaceError> {
    let class = &processes.settings().class;
    let name = class.rsplit(':').next().unwrap_or(class);
    let policy = processes.policy(|given| read_spec(name, &given)).map_err(|error| match error {
        PolicyError::Unreachable(reason) => WorkspaceError::Unreachable { policy: class.clone(), reason },
        error => mistaken(&format!("policy {class}"), &error.to_string()),
    })?;
    Ok(lending(policy, cores))
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
        let Self { policy, cores } = self;
        cores.lend(|| policy.reset(start))
    }

    fn act(&mut self, observation: &Observation) -> Result<ActionChunk, PolicyError> {
        let Self { policy, cores } = self;
        cores.lend(|| policy.act(observation))
    }
}

/// Fails for a URL that is not a websocket address (`ws://…`).
fn check_url(policy: &str, url: &str) -> Result<(), WorkspaceError> {
    match url.strip_prefix("ws://") {
        Some(rest) if !rest.is_empty() => Ok(()),
        _ => {
            let what = format!("policy {policy}: url={url} is not possible");
            Err(WorkspaceError::input(what).with_hint("expected ws://HOST:PORT"))
        }
    }
}
