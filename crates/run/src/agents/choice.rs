//! Which agent: its settings and its services, by name.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

use genmanip_agent::ask::{PromptSet, Stage, Transcribed, VisionModel};
use genmanip_agent::segmentation::{RgbdSegmenter, Segmenter};
use genmanip_agent::{Agent, AgentSettings, PathKind, Preset, Services};
use genmanip_assets::GraspLibrary;
use genmanip_core::{ActionChunk, Document, EpisodeStart, Observation, Policy, PolicyError, PolicySpec};
use genmanip_motion::Planner;
use genmanip_rollout::{Cores, Stage as Scene};

use super::model::{ModelFile, SharedModel};
use super::{ErrorRates, Heard, Oracle, OracleMasks, Truth, WithTruth, Witness};
use crate::error::RunError;
use crate::inputs;

/// An agent that can be made for any episode.
#[derive(Clone)]
pub struct AgentChoice {
    /// How it works.
    pub settings: AgentSettings,
    /// Who answers its questions.
    pub model: ModelChoice,
    /// Where its masks come from.
    pub masks: MaskChoice,
    /// How often the oracle errs on purpose.
    pub errors: ErrorRates,
    /// The ask that the oracle answers right whatever the rates say: a counterfactual, since everything before it is
    /// the same.
    pub forgiven: Option<usize>,
    /// Folder of prompt files that replace the built-in ones.
    pub prompts: Option<PathBuf>,
    /// Whether pictures are kept with the transcript.
    pub keeps_pictures: bool,
}

/// Who answers the agent's questions.
#[derive(Clone)]
pub enum ModelChoice {
    /// The simulator's truth; results say oracle.
    Oracle,
    /// A chat server, a person or recorded answers, as a settings file says.
    Chat(Arc<SharedModel>),
}

/// Where the agent's masks come from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MaskChoice {
    /// Colour and depth alone.
    Rgbd,
    /// The renderer's ids; results say oracle.
    Oracle,
}

/// An agent made for one episode.
pub struct MadeAgent {
    /// The policy.
    pub policy: Box<dyn Policy>,
    /// What it asks and does.
    pub transcribed: Transcribed,
    /// What its oracle services know, where it has any.
    pub truth: Option<Truth>,
    /// What its answers were worth, where the truth is known.
    pub heard: Arc<Mutex<Heard>>,
}

impl AgentChoice {
    /// Oracle services and the settings of a preset.
    pub fn oracle(preset: Preset, path: PathKind) -> Self {
        Self {
            settings: AgentSettings { path, ..AgentSettings::preset(preset) },
            model: ModelChoice::Oracle,
            masks: MaskChoice::Oracle,
            errors: BTreeMap::new(),
            forgiven: None,
            prompts: None,
            keeps_pictures: false,
        }
    }

    /// From names: `oracle` or a settings file for the model, `rgbd` or `oracle` for the masks, `p2p` or `grid`, `full` or
    /// `paper`.
    ///
    /// # Errors
    /// A name that nobody knows, and a settings file that cannot be used.
    pub fn named(model: &str, masks: &str, path: &str, preset: &str) -> Result<Self, RunError> {
        let preset = match preset {
            "full" => Preset::Full,
            "paper" => Preset::Paper,
            _ => return Err(RunError::unknown("preset", "presets", preset, &["full", "paper"])),
        };
        let path = match path {
            "p2p" => PathKind::P2p,
            "grid" => PathKind::Grid,
            _ => return Err(RunError::unknown("path", "paths", path, &["p2p", "grid"])),
        };
        let model = match model {
            "oracle" => ModelChoice::Oracle,
            file => ModelChoice::Chat(Arc::new(SharedModel::open(&ModelFile::read(Path::new(file))?)?)),
        };
        let masks = match masks {
            "rgbd" => MaskChoice::Rgbd,
            "oracle" => MaskChoice::Oracle,
            _ => return Err(RunError::unknown("source of masks", "sources of masks", masks, &["oracle", "rgbd"])),
        };
        Ok(Self { model, masks, ..Self::oracle(preset, path) })
    }

    /// Lets the oracle err: `STAGE=SHARE`, e.g. `object=0.2`.
    ///
    /// # Errors
    /// An unknown stage, or a share outside of 0 to 1.
    pub fn add_error(&mut self, text: &str) -> Result<(), RunError> {
        let (name, share) = text.split_once('=').unwrap_or((text, ""));
        let known = Stage::ALL.map(Stage::name);
        let stage = Stage::ALL.into_iter().find(|stage| stage.name() == name);
        let stage = stage.ok_or_else(|| RunError::unknown("stage", "stages", name, &known))?;
        let share = share.parse().ok().filter(|share| (0.0..=1.0).contains(share)).ok_or_else(|| {
            RunError::input(format!("`{text}` is no share of errors")).with_hint("expected STAGE=SHARE, 0 to 1")
        })?;
        self.errors.insert(stage, share);
        Ok(())
    }

    /// The name in results: what serves the agent, and how it works.
    pub fn name(&self) -> String {
        let AgentSettings { preset, path, ctof, arrows, .. } = &self.settings;
        let path = if *path == PathKind::Grid { "grid" } else { "p2p" };
        let mut name =
            format!("agent vlm={} masks={} path={path} preset={}", self.model.name(), self.masks.name(), preset.name());
        name += if *ctof { " ctof" } else { "" };
        name += if *arrows { "" } else { " no arrows" };
        for (stage, rate) in self.errors.iter().filter(|(_, rate)| **rate > 0.0) {
            name += &format!(" err_{}={rate}", stage.name());
        }
        name
    }

    /// The agent for one episode; while it waits for a model, its thread lends its core to the others of `cores`.
    ///
    /// # Errors
    /// A prompt file or a setting that cannot be used, and grasps that were tried with other physics.
    pub fn make(
        &self,
        stage: &Scene,
        planner: &Arc<Planner>,
        grasps: &GraspLibrary,
        cores: Option<&Arc<Cores>>,
    ) -> Result<MadeAgent, RunError> {
        let truth = Truth::new(stage);
        let model: Arc<dyn VisionModel> = match &self.model {
            ModelChoice::Oracle => Arc::new(self.oracle_of(&truth, planner, grasps)?),
            ModelChoice::Chat(shared) => Arc::new(shared.service(cores)),
        };
        self.make_asking(model, truth, planner)
    }

    /// The oracle of one episode.
    ///
    /// # Errors
    /// Grasps that were tried with other physics.
    pub fn oracle_of(&self, truth: &Truth, planner: &Arc<Planner>, grasps: &GraspLibrary) -> Result<Oracle, RunError> {
        let tried = truth.stage().models.iter().map(|model| Ok(grasps.of(planner.robot(), model)?.to_vec()));
        let tried: Result<Vec<_>, genmanip_assets::AssetError> = tried.collect();
        let tried = tried.map_err(|error| RunError::broken("the oracle cannot be made", error))?;
        Ok(Oracle::new(truth.clone(), planner, tried, self.errors.clone()).forgiving(self.forgiven))
    }

    /// The agent for one episode with any other model.
    ///
    /// # Errors
    /// A prompt file or a setting that cannot be used.
    pub fn make_asking(
        &self,
        model: Arc<dyn VisionModel>,
        truth: Truth,
        planner: &Arc<Planner>,
    ) -> Result<MadeAgent, RunError> {
        let knows = matches!(self.model, ModelChoice::Oracle) || self.masks == MaskChoice::Oracle;
        let segmenter: Arc<dyn Segmenter> = match self.masks {
            MaskChoice::Rgbd => Arc::new(RgbdSegmenter::default()),
            MaskChoice::Oracle => Arc::new(OracleMasks::new(truth.clone())),
        };
        let heard = Arc::new(Mutex::new(Heard::default()));
        let model = match knows {
            true => Arc::new(Witness::new(model, truth.clone(), Arc::clone(&heard))) as Arc<dyn VisionModel>,
            false => model,
        };
        let prompts = PromptSet::load(self.prompts.as_deref())
            .map_err(|error| RunError::input("the agent's prompts cannot be used").because(error))?;
        let transcribed = Transcribed::new(self.keeps_pictures);
        let services = Services { model, segmenter, prompts: Arc::new(prompts) };
        let agent = Agent::new(self.settings.clone(), services, planner, transcribed.clone())
            .map_err(|error| RunError::broken("the agent cannot be made", error))?
            .named(self.name());
        Ok(match knows {
            true => {
                let policy = Box::new(WithTruth::new(agent, truth.clone()));
                MadeAgent { policy, transcribed, truth: Some(truth), heard }
            }
            false => MadeAgent { policy: Box::new(agent), transcribed, truth: None, heard },
        })
    }
}

impl ModelChoice {
    /// Its name in results.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Oracle => "oracle",
            Self::Chat(_) => "chat",
        }
    }
}

impl MaskChoice {
    /// Its name in results.
    pub fn name(self) -> &'static str {
        match self {
            Self::Rgbd => "rgbd",
            Self::Oracle => "oracle",
        }
    }
}

/// A policy whose agent's transcript is written after each of its turns.
pub struct Transcribing {
    policy: Box<dyn Policy>,
    transcribed: Transcribed,
    folder: PathBuf,
    /// Pictures that were written.
    written: usize,
}

impl Transcribing {
    /// Writes into `folder`.
    pub fn new(made: MadeAgent, folder: PathBuf) -> Self {
        Self { policy: made.policy, transcribed: made.transcribed, folder, written: 0 }
    }
}

impl Policy for Transcribing {
    fn spec(&self) -> PolicySpec {
        self.policy.spec()
    }

    fn reset(&mut self, start: &EpisodeStart) -> Result<(), PolicyError> {
        self.written = 0;
        self.policy.reset(start)
    }

    fn act(&mut self, observation: &Observation) -> Result<ActionChunk, PolicyError> {
        let chunk = self.policy.act(observation);
        let kept = keep(&self.transcribed, self.written, &self.folder);
        self.written = kept.map_err(|error| PolicyError::Unsuited(format!("its transcript: {error}")))?;
        chunk
    }
}

/// Writes a transcript and its pictures from number `first` on into a folder; returns how many pictures there are.
///
/// # Errors
/// When a file cannot be written or a picture not be encoded.
pub fn keep(transcribed: &Transcribed, first: usize, folder: &Path) -> Result<usize, RunError> {
    let pictures = transcribed.pictures();
    for (name, picture) in pictures.iter().skip(first) {
        let path = folder.join(name);
        let png = picture.png().map_err(|error| RunError::file("write", &path, error))?;
        inputs::write_file(&path, &png)?;
    }
    inputs::write_file(&folder.join("transcript.json"), transcribed.transcript().to_json().as_bytes())?;
    Ok(pictures.len())
}
