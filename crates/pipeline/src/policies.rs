//! Registry of all policies, by name and arguments.
//!
//! `NAME` or `NAME:key=value,key=value` becomes a [`PolicyFactory`], which makes one policy per episode. A new policy
//! is added as an entry of [`POLICIES`].

mod arguments;
mod given;
mod label;
mod watched;

use std::fmt;
use std::sync::Arc;

use genmanip_agent::ask::QuestionKind;
use genmanip_assets::GraspLibrary;
use genmanip_core::{Episode, Policy};
use genmanip_data::DataError;
use genmanip_data::lerobot::LerobotDataset;
use genmanip_motion::Planner;
use genmanip_rollout::baselines::{Blind, Clumsy, RandomActions};
use genmanip_rollout::collect::PipelineSettings;
use genmanip_rollout::expert::Expert;
use genmanip_rollout::policies::{DoNothing, OpenLoop};
use genmanip_rollout::{Cores, RolloutError, Stage};
use genmanip_skills::{Skill, Transfer, TransferSettings};

use crate::learned::{self, Execution, Learned};
use crate::remote;
use genmanip_agent_sim::{AgentChoice, ModelChoice, UsageAccount};
use genmanip_workspace::WorkspaceError;

pub use arguments::PolicyArgument;
use arguments::{AGENT_ARGUMENTS, LEARNED_ARGUMENTS, OPENPI_ARGUMENTS, PYTHON_ARGUMENTS, VLA_EVAL_ARGUMENTS};
use given::Given;
pub use label::InLabel;
pub(crate) use label::label;
use label::{MAX_LABEL, fits};
use watched::{BeforeTurn, Watched};

use crate::policy_spec::check_robot;
pub use crate::policy_spec::{mistaken, read_spec};

/// Largest decay of temporal ensembling, at which the oldest prediction alone counts.
const MAX_DECAY: f64 = 100.0;

/// All policies of the registry, in the order of lists for users.
pub const POLICIES: [PolicyEntry; 13] = [
    PolicyEntry {
        name: "expert",
        about: "plans with what the simulator knows; its results say oracle",
        arguments: &[],
        needs_record: false,
        is_usual: true,
        prepare: expert,
    },
    PolicyEntry {
        name: "replay",
        about: "applies the recorded commands of the episode without looking",
        arguments: &[],
        needs_record: true,
        is_usual: true,
        prepare: replay,
    },
    PolicyEntry {
        name: "do_nothing",
        about: "stands still: the control that shows that no scenario solves itself",
        arguments: &[PolicyArgument::new("seconds", "5", "how long it stands still, s")],
        needs_record: false,
        is_usual: true,
        prepare: do_nothing,
    },
    PolicyEntry {
        name: "random",
        about: "moves joints and fingers at random: the control that shows what chance reaches",
        arguments: &[PolicyArgument::new("seconds", "20", "how long it moves, s")],
        needs_record: false,
        is_usual: false,
        prepare: random,
    },
    PolicyEntry {
        name: "blind",
        about: "carries a random object to a random place with the expert's motions, blind to the instruction; labelled oracle",
        arguments: &[],
        needs_record: false,
        is_usual: false,
        prepare: blind,
    },
    PolicyEntry {
        name: "clumsy",
        about: "sets out as the expert does and misses its first thing, drops it or stops on the way; says oracle",
        arguments: &[],
        needs_record: false,
        is_usual: false,
        prepare: clumsy,
    },
    PolicyEntry {
        name: "playback",
        about: "applies the actions of a dataset, row by row, without looking; it acts as the dataset says",
        arguments: &[PolicyArgument::new("dataset", "", "folder of a LeRobot dataset").in_label(InLabel::Content)],
        needs_record: false,
        is_usual: false,
        prepare: playback,
    },
    PolicyEntry {
        name: "skill",
        about: "transfers skills that `genmanip skills record` cut from takes: skill:FILE; its results say oracle",
        arguments: &[PolicyArgument::new("file", "", "skill file, or folder of them").in_label(InLabel::Content)],
        needs_record: false,
        is_usual: false,
        prepare: skill,
    },
    PolicyEntry {
        name: "learned",
        about: "acts by a network that `genmanip train` made: learned:FOLDER",
        arguments: &LEARNED_ARGUMENTS,
        needs_record: false,
        is_usual: false,
        prepare: learned,
    },
    PolicyEntry {
        name: "agent",
        about: "asks a vision-language model and acts from RGB-D images; oracle services make its results oracle",
        arguments: &AGENT_ARGUMENTS,
        needs_record: false,
        is_usual: false,
        prepare: agent,
    },
    PolicyEntry {
        name: "openpi",
        about: "asks a policy server that speaks openpi's websocket protocol; its key is OPENPI_API_KEY",
        arguments: &OPENPI_ARGUMENTS,
        needs_record: false,
        is_usual: false,
        prepare: openpi,
    },
    PolicyEntry {
        name: "vla-eval",
        about: "asks a model server of vla-eval, the evaluation harness for vision-language-action models",
        arguments: &VLA_EVAL_ARGUMENTS,
        needs_record: false,
        is_usual: false,
        prepare: vla_eval,
    },
    PolicyEntry {
        name: "python",
        about: "asks a class of a Python module in a process of its own: python:MODULE:CLASS",
        arguments: &PYTHON_ARGUMENTS,
        needs_record: false,
        is_usual: false,
        prepare: python,
    },
];

fn expert(_given: &Given) -> Result<Prepared, WorkspaceError> {
    Ok(Prepared::of(expert_of))
}

fn random(given: &Given) -> Result<Prepared, WorkspaceError> {
    let duration_s = given.number("seconds", 0.0..=600.0)?;
    Ok(Prepared::of(move |episode| Ok(RandomActions::new(episode.stage, duration_s))))
}

fn blind(_given: &Given) -> Result<Prepared, WorkspaceError> {
    Ok(Prepared::of(|episode| Ok(Blind::new(episode.stage, expert_of(episode)?))))
}

fn clumsy(_given: &Given) -> Result<Prepared, WorkspaceError> {
    Ok(Prepared::of(|episode| Ok(Clumsy::new(episode.stage, expert_of(episode)?))))
}

fn expert_of(episode: &PolicyContext) -> Result<Expert, WorkspaceError> {
    Expert::new(episode.stage, episode.planner, episode.grasps, episode.settings.expert.clone())
        .map_err(|error| WorkspaceError::broken("the expert cannot be made", error))
}

fn replay(_given: &Given) -> Result<Prepared, WorkspaceError> {
    Ok(Prepared::of(|episode| {
        let recorded = episode.recorded.ok_or_else(|| {
            WorkspaceError::input(format!("nothing was recorded on scenario {}", episode.stage.scenario.id))
                .with_hint("the policy replay needs stored episodes, as `genmanip collect` makes them")
        })?;
        Ok(OpenLoop::replay(recorded))
    }))
}

fn playback(given: &Given) -> Result<Prepared, WorkspaceError> {
    let Some(folder) = given.folder("dataset") else {
        return Err(WorkspaceError::input("policy playback needs a dataset")
            .with_hint("expected playback:dataset=FOLDER, a dataset as `genmanip export` and `collect` write them"));
    };
    let unreadable = |error: DataError| {
        WorkspaceError::input(format!("cannot play {} back", folder.display()))
            .because(error)
            .with_hint("name a dataset that `genmanip export --to lerobot` or `collect` wrote")
    };
    let dataset = LerobotDataset::open(&folder).map_err(unreadable)?;
    let prepared = Prepared::of(move |episode| {
        let (contract, scenario) = (dataset.contract(), &episode.stage.scenario.id);
        check_robot(&contract.robot, episode.stage)?;
        let not_run = |reason| WorkspaceError::Unreachable { policy: "playback".into(), reason };
        let rows = dataset.episodes().iter().find(|row| row.scenario_id == *scenario);
        let rows = rows.ok_or_else(|| not_run(format!("the dataset has no episode of scenario {scenario}")))?;
        let actions = dataset.actions(rows).map_err(|error| not_run(error.to_string()))?;
        Ok(OpenLoop::playback(contract, actions))
    });
    Ok(Prepared { is_recorded: true, ..prepared })
}

fn skill(given: &Given) -> Result<Prepared, WorkspaceError> {
    let Some(file) = given.folder("file") else {
        return Err(WorkspaceError::input("policy skill needs a skill").with_hint(
            "expected skill:FILE, a skill file as `genmanip skills record` writes it, or a folder of them",
        ));
    };
    let skills: Arc<[Skill]> = crate::skills::read(&[file])?.into();
    let settings = TransferSettings::default();
    Ok(Prepared::of(move |episode| {
        Ok(Transfer::new(episode.stage, episode.planner, Arc::clone(&skills), settings.clone()))
    }))
}

fn learned(given: &Given) -> Result<Prepared, WorkspaceError> {
    let learned = loaded(given)?;
    // Its predicted end is only an estimate, so its episodes end once the goal holds.
    Ok(Prepared::new(move |episode: &PolicyContext| learned.act_on(episode.stage)).never_finishing())
}

/// Loads the learned policy of `FOLDER` or `FOLDER,key=value`, the arguments after `learned:`.
///
/// # Errors
/// For an unknown or invalid argument, or a policy that cannot be loaded.
pub(crate) fn load_learned(arguments: &str) -> Result<Arc<Learned>, WorkspaceError> {
    loaded(&Given::parse("learned", &LEARNED_ARGUMENTS, arguments)?)
}

fn loaded(given: &Given) -> Result<Arc<Learned>, WorkspaceError> {
    let Some(folder) = given.folder("folder") else {
        return Err(WorkspaceError::input("policy learned needs the folder of a policy")
            .with_hint("expected learned:FOLDER, a policy as `genmanip train` writes it"));
    };
    let execution =
        Execution { execute: given.count("execute")?, ensemble: given.optional("ensemble", 0.0..=MAX_DECAY)? };
    learned::load(&folder, execution)
}

fn do_nothing(given: &Given) -> Result<Prepared, WorkspaceError> {
    let duration_s = given.number("seconds", 0.0..=600.0)?;
    Ok(Prepared::of(move |_| Ok(DoNothing { duration_s })))
}

fn agent(given: &Given) -> Result<Prepared, WorkspaceError> {
    let mut choice =
        AgentChoice::named(given.text("vlm"), given.text("masks"), given.text("path"), given.text("preset"))?
            .with_grasps(given.text("grasps"))?
            .with_asks(given.text("asks"))?
            .with_answers(given.folder("answers"))?;
    (choice.settings.ctof, choice.settings.arrows) = (given.is_yes("ctof")?, given.is_yes("arrows")?);
    choice.settings.reasoning = given.is_yes("reasoning")?;
    choice.is_analysed = given.is_yes("analysis")?;
    choice.settings = choice.settings.shown_by(given.text("camera"));
    match given.text("loop") {
        "closed" => {}
        "open" => choice.settings = choice.settings.open_loop(),
        other => return Err(WorkspaceError::unknown("loop", "loops", other, &["closed", "open"])),
    }
    choice.prompts = given.folder("prompts");
    let transcripts = given.folder("transcripts");
    choice.keeps_pictures = transcripts.is_some();
    let rates = [
        ("err_decompose", QuestionKind::Decompose),
        ("err_object", QuestionKind::Object),
        ("err_part", QuestionKind::Part),
        ("err_grab_point", QuestionKind::GrabPoint),
        ("err_path", QuestionKind::GridPath),
        ("err_path", QuestionKind::PointToPoint),
        ("err_check", QuestionKind::Check),
    ];
    for (name, stage) in rates {
        choice.dials.rates.insert(stage, given.number(name, 0.0..=1.0)?);
    }
    let account = match &choice.model {
        ModelChoice::Chat(shared) => Some(Arc::clone(shared.account())),
        ModelChoice::Oracle | ModelChoice::Random | ModelChoice::Recorded => None,
    };
    let is_recorded = matches!(choice.model, ModelChoice::Recorded);
    let prepared = Prepared::of(move |episode| {
        let made = choice.make(episode.stage, episode.planner, episode.grasps, episode.cores)?;
        let folder = transcripts.as_ref().map(|folder| folder.join(&episode.stage.scenario.id));
        Ok(made.transcribing(folder))
    });
    Ok(Prepared { account, is_recorded, ..prepared })
}

fn openpi(given: &Given) -> Result<Prepared, WorkspaceError> {
    let server = remote::server(&remote::Named {
        url: given.text("url"),
        preset: given.text("preset"),
        exterior: given.text("exterior"),
        wrist: given.text("wrist"),
        execute: given.text("execute"),
        timeout_s: given.number("timeout_s", 0.1..=remote::MAX_WAIT_S)?,
    })?;
    let make = move |episode: &PolicyContext| server.policy(episode.stage, episode.cores);
    Ok(Prepared::new(make).never_finishing())
}

fn vla_eval(given: &Given) -> Result<Prepared, WorkspaceError> {
    let patience_s = given.number("timeout_s", 0.1..=remote::MAX_WAIT_S)?;
    let (url, preset) = (given.text("url"), given.text("preset"));
    let settings = remote::vla_eval_settings(url, preset, [given.text("exterior"), given.text("wrist")], patience_s)?;
    Ok(Prepared::new(move |episode: &PolicyContext| {
        Ok(remote::vla_eval(&settings, episode.planner.robot(), episode.cores))
    })
    .never_finishing())
}

fn python(given: &Given) -> Result<Prepared, WorkspaceError> {
    let patience_s = given.number("timeout_s", 0.1..=remote::MAX_WAIT_S)?;
    let processes = remote::processes(given.text("class"), given.text("python"), patience_s)?;
    Ok(Prepared::new(move |episode: &PolicyContext| remote::python(&processes, episode.cores)))
}

/// A policy of the registry.
pub struct PolicyEntry {
    /// Name on the command line and in results.
    pub name: &'static str,
    /// Description in one line.
    pub about: &'static str,
    /// Arguments that the policy accepts.
    pub arguments: &'static [PolicyArgument],
    /// True if it needs an episode recorded on the same scenario.
    pub needs_record: bool,
    /// True if it is run when no policy is named; policies that call services are not.
    pub is_usual: bool,
    /// Function that validates the arguments; called once per factory.
    prepare: fn(&Given) -> Result<Prepared, WorkspaceError>,
}

/// Inputs for making a policy for one episode.
#[derive(Clone, Copy)]
pub struct PolicyContext<'a> {
    /// Stage of the episode; only policies that declare it may read simulator truth from it.
    pub stage: &'a Stage,
    /// Episode recorded on the same scenario; `None` without one.
    pub recorded: Option<&'a Episode>,
    /// Planner of the robot.
    pub planner: &'a Arc<Planner>,
    /// Library of verified grasps.
    pub grasps: &'a GraspLibrary,
    /// Settings of the run.
    pub settings: &'a PipelineSettings,
    /// Cores shared by concurrent episodes; a policy that waits for a service releases its core meanwhile. `None` if
    /// the number of episodes is not limited by cores.
    pub cores: Option<&'a Arc<Cores>>,
}

type Make = Box<dyn Fn(&PolicyContext) -> Result<Box<dyn Policy>, WorkspaceError> + Send + Sync>;

/// A policy with validated arguments.
struct Prepared {
    make: Make,
    /// Usage account of the service that it calls and that may cost money; `None` for other policies.
    account: Option<Arc<UsageAccount>>,
    /// True if the policy never ends an episode itself.
    never_finishes: bool,
    /// True if the policy acts on recordings made elsewhere, such as recorded model answers.
    is_recorded: bool,
}

impl Prepared {
    fn new(make: impl Fn(&PolicyContext) -> Result<Box<dyn Policy>, WorkspaceError> + Send + Sync + 'static) -> Self {
        Self { make: Box::new(make), account: None, never_finishes: false, is_recorded: false }
    }

    fn of<P: Policy + 'static>(
        make: impl Fn(&PolicyContext) -> Result<P, WorkspaceError> + Send + Sync + 'static,
    ) -> Self {
        Self::new(move |episode| Ok(Box::new(make(episode)?)))
    }

    fn never_finishing(self) -> Self {
        Self { never_finishes: true, ..self }
    }
}

/// Factory of a policy, which makes an instance per episode.
pub struct PolicyFactory {
    name: String,
    label: String,
    needs_record: bool,
    named_folders: Vec<String>,
    prepared: Prepared,
}

impl PolicyFactory {
    /// Factory from `NAME` or `NAME:key=value,key=value`.
    ///
    /// # Errors
    /// [`WorkspaceError::UnknownName`] for an unknown policy or argument; an error that explains an invalid value.
    pub fn resolve(text: &str) -> Result<Self, WorkspaceError> {
        let (name, arguments) = text.split_once(':').unwrap_or((text, ""));
        let known = POLICIES.each_ref().map(|entry| entry.name);
        let entry = POLICIES.iter().find(|entry| entry.name == name);
        let entry = entry.ok_or_else(|| WorkspaceError::unknown("policy", "policies", name, &known))?;
        let given = Given::parse(entry.name, entry.arguments, arguments)?;
        let prepared = (entry.prepare)(&given)?;
        let (name, label, named_folders) = (entry.name.into(), given.label(), given.named_folders());
        Ok(Self { name, label, needs_record: entry.needs_record, named_folders, prepared })
    }

    /// Factory of a policy of the calling program, with a name of its own. `make` is called once per episode, from any
    /// thread.
    ///
    /// # Errors
    /// For a name that cannot be part of a file name, or is too long.
    pub fn of(
        name: &str,
        make: impl Fn(&PolicyContext) -> Result<Box<dyn Policy>, WorkspaceError> + Send + Sync + 'static,
    ) -> Result<Self, WorkspaceError> {
        if name.is_empty() || name.starts_with('.') || !name.chars().all(fits) || name.len() > MAX_LABEL {
            return Err(WorkspaceError::input(format!("`{name}` cannot be the name of a policy")).with_hint(
                "it names a file: letters, digits and -_.+=@, no dot at the beginning, at most 100 of them",
            ));
        }
        let (name, label) = (name.to_owned(), name.to_owned());
        let named_folders = Vec::new();
        Ok(Self { name, label, needs_record: false, named_folders, prepared: Prepared::new(make) })
    }

    /// Factories of the policies that are run by default, with default arguments; those that need a recorded episode
    /// only if `is_recorded`.
    ///
    /// # Errors
    /// Never, since the default arguments are valid.
    pub fn all(is_recorded: bool) -> Result<Vec<Self>, WorkspaceError> {
        let usable = POLICIES.iter().filter(|entry| entry.is_usual && (is_recorded || !entry.needs_record));
        usable.map(|entry| Self::resolve(entry.name)).collect()
    }

    /// Name of the policy, as in results.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Label of the policy's evaluations, usable as a file name: the name with those arguments that differ from their
    /// defaults and change results. It is the same on every machine.
    pub fn label(&self) -> &str {
        &self.label
    }

    /// Arguments whose label does not identify their content, as `NAME=FOLDER`.
    pub(crate) fn named_folders(&self) -> &[String] {
        &self.named_folders
    }

    /// True if the policy needs an episode recorded on the same scenario.
    pub fn needs_record(&self) -> bool {
        self.needs_record
    }

    /// True if the policy acts on recordings. They may lack a scenario, so an episode that is not run says nothing
    /// about the others.
    pub(crate) fn is_recorded(&self) -> bool {
        self.needs_record || self.prepared.is_recorded
    }

    /// The policy for one episode.
    ///
    /// # Errors
    /// When the policy does not support this episode; [`WorkspaceError::Unreachable`] when it runs elsewhere and is
    /// unreachable; [`WorkspaceError::Mistaken`] when its program made a mistake.
    pub fn make(&self, episode: &PolicyContext) -> Result<Box<dyn Policy>, WorkspaceError> {
        (self.prepared.make)(episode)
    }

    /// The error in the form that the episode loop reports: not run, if the policy is unreachable or made a mistake;
    /// otherwise an unsupported contract.
    pub(crate) fn refusal(&self, error: WorkspaceError) -> RolloutError {
        match error {
            WorkspaceError::Unreachable { policy, reason } => RolloutError::NotRun { policy, reason, mistake: false },
            WorkspaceError::Mistaken { what, hint, .. } => RolloutError::NotRun {
                policy: self.label().into(),
                reason: format!("{what}\nhint: {hint}"),
                mistake: true,
            },
            error => RolloutError::Spec { policy: self.label().into(), source: error.into() },
        }
    }

    /// The same policy, marked as never ending an episode itself.
    #[must_use]
    pub fn never_finishing(mut self) -> Self {
        self.prepared = self.prepared.never_finishing();
        self
    }

    /// The same policy with a callback: `before_turn` gets the simulated time of the episode, s, before each decision.
    /// If it returns false, the episode ends and counts as not run. The label is unchanged.
    #[must_use]
    pub fn watched(mut self, before_turn: impl Fn(f64) -> bool + Send + Sync + 'static) -> Self {
        let (make, before_turn): (_, BeforeTurn) = (self.prepared.make, Arc::new(before_turn));
        self.prepared.make = Box::new(move |context| {
            Ok(Box::new(Watched { policy: make(context)?, before_turn: Arc::clone(&before_turn) }))
        });
        self
    }

    /// True if the policy never ends an episode itself. Unless other rules are given, its episodes end once the goal
    /// has held for the settling time.
    pub fn never_finishes(&self) -> bool {
        self.prepared.never_finishes
    }

    /// Usage account of the policy's service, with requests and cost so far; `None` unless it may cost money.
    pub fn account(&self) -> Option<&Arc<UsageAccount>> {
        self.prepared.account.as_ref()
    }
}

impl fmt::Debug for PolicyFactory {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("PolicyFactory").field("label", &self.label).finish_non_exhaustive()
    }
}

/// Text that lists the policies and their arguments, one per line.
pub fn describe() -> String {
    let mut text = String::new();
    for entry in &POLICIES {
        text += &format!("{:<11} {}\n", entry.name, entry.about);
        for PolicyArgument { name, default, about, .. } in entry.arguments {
            text += &format!("{:<11} {name}={default}: {about}\n", "");
        }
    }
    text
}

#[cfg(test)]
mod tests;
