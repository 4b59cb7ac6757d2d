//! Selection of an agent: settings, and services by name.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

use genmanip_agent::ask::{PromptSet, QuestionKind, TranscriptRecorder, VisionModel};
use genmanip_agent::segmentation::{RgbdSegmenter, Segmenter};
use genmanip_agent::services::{GraspSource, SampledGrasps, ServiceGrasps, ServiceMasks};
use genmanip_agent::{Agent, AgentSettings, Asks, PathKind, Preset, Services};
use genmanip_assets::GraspLibrary;
use genmanip_core::{FailureClass, Scenario, World};
use genmanip_llm::{HttpService, ServiceSettings};
use genmanip_motion::Planner;
use genmanip_rollout::{Cores, Stage};

use super::failure::EpisodeJudgements;
use super::grasps::FlawedGrasps;
use super::made_agent::MadeAgent;
use super::model::{ModelFile, SharedModel};
use super::{
    Annotator, ErrorInjection, GroundTruth, GroundTruthFeed, Oracle, OracleMasks, RandomMarks, Recording, TurnSnapshots,
};
use genmanip_workspace::WorkspaceError;

/// Maximum standard deviation (m) of a depth of 1 m; beyond it, objects cannot be distinguished from the table.
const MAX_DEPTH_ERROR_M: f64 = 0.05;

/// Configuration from which the agent of every episode is made.
#[derive(Clone)]
pub struct AgentChoice {
    /// Settings of the agent itself.
    pub settings: AgentSettings,
    /// Vision-language model that answers the agent's questions.
    pub model: ModelChoice,
    /// Source of object masks.
    pub masks: MaskChoice,
    /// Source of grasp proposals.
    pub grasps: GraspChoice,
    /// Errors that the oracle injects; without effect on other models.
    pub dials: ErrorInjection,
    /// True to judge answers against the ground truth even if no oracle is used (with an oracle they always are);
    /// results are then labelled `oracle`.
    pub is_analysed: bool,
    /// True to keep a snapshot of the agent before each turn, from which counterfactual episodes start.
    pub keeps_turns: bool,
    /// Folder in which answers are recorded, one file per scenario, and from which they are replayed; `None` for
    /// neither.
    pub answers: Option<PathBuf>,
    /// Folder of prompt files that replace the built-in ones; `None` for the built-in ones.
    pub prompts: Option<PathBuf>,
    /// True to keep the images with the transcript.
    pub keeps_pictures: bool,
}

/// Model that answers the agent's questions.
#[derive(Clone)]
pub enum ModelChoice {
    /// Ground truth of the simulator; results are labelled `oracle`.
    Oracle,
    /// Chat server, person or recorded answers, as configured in a settings file.
    Chat(Arc<SharedModel>),
    /// Random marks of the image: the baseline for tables.
    Random,
    /// Replay of the recorded answers only, see [`Recording`].
    Recorded,
}

/// Segmentation source of the agent.
#[derive(Clone)]
pub enum MaskChoice {
    /// Segmentation from colour and depth.
    Rgbd,
    /// Ids of the renderer; results are labelled `oracle`.
    Oracle,
    /// Mask server, see `genmanip_agent::services::masks`.
    Http(Arc<ServiceMasks<HttpService>>),
}

impl MaskChoice {
    /// Segmentation source from `rgbd`, `oracle` or `http:URL`.
    ///
    /// # Errors
    /// An unknown name, or an unusable URL.
    pub fn named(name: &str) -> Result<Self, WorkspaceError> {
        match (name, name.strip_prefix("http:")) {
            ("rgbd", _) => Ok(Self::Rgbd),
            ("oracle", _) => Ok(Self::Oracle),
            (_, Some(url)) => Ok(Self::Http(Arc::new(ServiceMasks::new(http(url)?)))),
            _ => {
                let known = ["oracle", "rgbd", "http:URL"];
                Err(WorkspaceError::unknown("source of masks", "sources of masks", name, &known))
            }
        }
    }
}

/// Grasp source of the agent.
#[derive(Clone)]
pub enum GraspChoice {
    /// Built-in sampler on the object's point cloud.
    Rgbd,
    /// Grasp server, see `genmanip_agent::services::grasps`.
    Http(Arc<ServiceGrasps<HttpService>>),
}

impl GraspChoice {
    /// Grasp source from `rgbd` or `http:URL`; `known` lists the valid names for the error message.
    ///
    /// # Errors
    /// An unknown name, or an unusable URL.
    pub fn named(name: &str, known: &[&str]) -> Result<Self, WorkspaceError> {
        match (name, name.strip_prefix("http:")) {
            ("rgbd", _) => Ok(Self::Rgbd),
            (_, Some(url)) => Ok(Self::Http(Arc::new(ServiceGrasps::new(http(url)?)))),
            _ => Err(WorkspaceError::unknown("source of grasps", "sources of grasps", name, known)),
        }
    }

    /// Grasp service for the gripper of a planner.
    pub fn source(&self, planner: &Arc<Planner>) -> Arc<dyn GraspSource> {
        match self {
            Self::Rgbd => Arc::new(SampledGrasps::new(Arc::clone(planner))),
            Self::Http(service) => Arc::clone(service) as Arc<dyn GraspSource>,
        }
    }
}

impl AgentChoice {
    /// Configuration with oracle services and the settings of a preset.
    pub fn oracle(preset: Preset, path: PathKind) -> Self {
        Self {
            settings: AgentSettings { path, ..AgentSettings::preset(preset) },
            model: ModelChoice::Oracle,
            masks: MaskChoice::Oracle,
            grasps: GraspChoice::Rgbd,
            dials: ErrorInjection::default(),
            is_analysed: false,
            keeps_turns: false,
            answers: None,
            prompts: None,
            keeps_pictures: false,
        }
    }

    /// Configuration from names: model `oracle`, `random`, `recorded` or a settings file; masks `rgbd`, `oracle` or
    /// `http:URL`; path `p2p` or `grid`; preset `full` or `paper`.
    ///
    /// # Errors
    /// An unknown name, or an unusable settings file.
    pub fn named(model: &str, masks: &str, path: &str, preset: &str) -> Result<Self, WorkspaceError> {
        let preset = match preset {
            "full" => Preset::Full,
            "paper" => Preset::Paper,
            _ => return Err(WorkspaceError::unknown("preset", "presets", preset, &["full", "paper"])),
        };
        let path = match path {
            "p2p" => PathKind::P2p,
            "grid" => PathKind::Grid,
            _ => return Err(WorkspaceError::unknown("path", "paths", path, &["p2p", "grid"])),
        };
        let model = match model {
            "oracle" => ModelChoice::Oracle,
            "random" => ModelChoice::Random,
            "recorded" => ModelChoice::Recorded,
            file => ModelChoice::Chat(Arc::new(SharedModel::open(&ModelFile::read(Path::new(file))?)?)),
        };
        Ok(Self { model, masks: MaskChoice::named(masks)?, ..Self::oracle(preset, path) })
    }

    /// Sets the grasp source: `rgbd` or `http:URL`.
    ///
    /// # Errors
    /// An unknown name, or an unusable URL.
    pub fn with_grasps(self, name: &str) -> Result<Self, WorkspaceError> {
        let grasps = GraspChoice::named(name, &["rgbd", "http:URL"])?;
        Ok(Self { grasps, ..self })
    }

    /// Sets how many questions the agent asks: `every` or `needed`; empty for the preset's choice.
    ///
    /// # Errors
    /// Another name.
    pub fn with_asks(mut self, name: &str) -> Result<Self, WorkspaceError> {
        let known = Asks::ALL.map(Asks::name);
        match Asks::ALL.into_iter().find(|asks| asks.name() == name) {
            Some(asks) => self.settings.asks = asks,
            None if name.is_empty() => {}
            None => return Err(WorkspaceError::unknown("choice of questions", "choices of questions", name, &known)),
        }
        Ok(self)
    }

    /// Sets the standard deviation (m) of depth measurements at 1 m; a larger value of the world's cameras takes
    /// precedence.
    ///
    /// # Errors
    /// A number outside the valid range.
    pub fn with_depth_error(mut self, error_m: f64) -> Result<Self, WorkspaceError> {
        if !(0.0..=MAX_DEPTH_ERROR_M).contains(&error_m) {
            let what = format!("depth error of {error_m} m: expected 0 to {MAX_DEPTH_ERROR_M} m at a distance of 1 m");
            return Err(
                WorkspaceError::input(what).with_hint("0.0036 is that of a RealSense D435, 0.0014 that of a D415")
            );
        }
        self.settings.depth_error_m = error_m;
        Ok(self)
    }

    /// Sets the folder in which answers are recorded and from which they are replayed.
    ///
    /// # Errors
    /// No folder for the model `recorded`.
    pub fn with_answers(self, folder: Option<PathBuf>) -> Result<Self, WorkspaceError> {
        if folder.is_none() && matches!(self.model, ModelChoice::Recorded) {
            return Err(WorkspaceError::input("recorded answers lie in a folder, and none is named")
                .with_hint("expected agent:vlm=recorded,answers=FOLDER"));
        }
        Ok(Self { answers: folder, ..self })
    }

    /// Grasp service for the robot of a planner.
    pub fn grasp_source(&self, planner: &Arc<Planner>) -> Arc<dyn GraspSource> {
        self.grasps.source(planner)
    }

    /// Sets an error rate of the oracle: `STAGE=SHARE`, e.g. `object=0.2`.
    ///
    /// # Errors
    /// An unknown stage, or a share outside of 0 to 1.
    pub fn add_error(&mut self, text: &str) -> Result<(), WorkspaceError> {
        let (name, share) = text.split_once('=').unwrap_or((text, ""));
        let known = QuestionKind::ALL.map(QuestionKind::name);
        let stage = QuestionKind::ALL.into_iter().find(|stage| stage.name() == name);
        let stage = stage.ok_or_else(|| WorkspaceError::unknown("stage", "stages", name, &known))?;
        let share = share.parse().ok().filter(|share| (0.0..=1.0).contains(share)).ok_or_else(|| {
            WorkspaceError::input(format!("`{text}` is no share of errors")).with_hint("expected STAGE=SHARE, 0 to 1")
        })?;
        self.dials.rates.insert(stage, share);
        Ok(())
    }

    /// Name of the agent in results: its services, and settings that differ from the preset.
    pub fn name(&self) -> String {
        let AgentSettings { preset, path, ctof, arrows, reasoning, asks, .. } = &self.settings;
        let path = if *path == PathKind::Grid { "grid" } else { "p2p" };
        let mut name =
            format!("agent vlm={} masks={} path={path} preset={}", self.model.name(), self.masks.name(), preset.name());
        if let GraspChoice::Http(_) = self.grasps {
            name += " grasps=http";
        }
        if *asks != AgentSettings::preset(*preset).asks {
            name += &format!(" asks={}", asks.name());
        }
        name += if *ctof { " ctof" } else { "" };
        name += if *arrows { "" } else { " no arrows" };
        name += if *reasoning { " reasoning" } else { "" };
        name += if self.settings.rounds == 1 { " open loop" } else { "" };
        match self.settings.cameras.first() {
            Some(camera) if *camera != AgentSettings::preset(*preset).cameras[0] => {
                name += &format!(" camera={camera}")
            }
            _ => {}
        }
        if let Some(class) = self.dials.once {
            name += &format!(" flaw={}", class.name());
        }
        for (stage, rate) in self.dials.rates.iter().filter(|(_, rate)| **rate > 0.0) {
            name += &format!(" err_{}={rate}", stage.name());
        }
        name
    }

    /// Makes the agent of one episode. While the agent waits for a model, its thread lends its core to other threads of
    /// `cores`.
    ///
    /// # Errors
    /// An unusable prompt file or setting, or grasps that were tried with other physics.
    pub fn make(
        &self,
        stage: &Stage,
        planner: &Arc<Planner>,
        grasps: &GraspLibrary,
        cores: Option<&Arc<Cores>>,
    ) -> Result<MadeAgent, WorkspaceError> {
        let truth = GroundTruth::new(stage);
        let oracle = match self.model {
            ModelChoice::Oracle => Some(Arc::new(self.oracle_of(&truth, planner, grasps)?)),
            _ => None,
        };
        let model = self.answering(oracle, &stage.scenario, cores)?;
        self.make_asking(model, truth, planner)
    }

    /// Model that answers the questions of an episode; `oracle` if the configuration selects the oracle.
    ///
    /// # Errors
    /// Recorded answers that cannot be read.
    pub fn answering(
        &self,
        oracle: Option<Arc<Oracle>>,
        scenario: &Scenario,
        cores: Option<&Arc<Cores>>,
    ) -> Result<Arc<dyn VisionModel>, WorkspaceError> {
        let model: Option<Arc<dyn VisionModel>> = match &self.model {
            ModelChoice::Oracle => oracle.map(|oracle| oracle as Arc<dyn VisionModel>),
            ModelChoice::Chat(shared) => Some(Arc::new(shared.service(cores))),
            ModelChoice::Random => Some(Arc::new(RandomMarks(scenario.seed))),
            ModelChoice::Recorded => None,
        };
        match (&self.answers, model) {
            (Some(folder), model) => Ok(Arc::new(Recording::open(folder, &scenario.id, model)?)),
            (None, Some(model)) => Ok(model),
            (None, None) => Err(WorkspaceError::input("nobody answers the agent's questions")),
        }
    }

    /// The oracle of one episode.
    ///
    /// # Errors
    /// Grasps that were tried with other physics.
    pub fn oracle_of(
        &self,
        truth: &GroundTruth,
        planner: &Arc<Planner>,
        grasps: &GraspLibrary,
    ) -> Result<Oracle, WorkspaceError> {
        let tried = truth.stage().models.iter().map(|model| Ok(grasps.of(planner.robot(), model)?.to_vec()));
        let tried: Result<Vec<_>, genmanip_assets::AssetError> = tried.collect();
        let tried = tried.map_err(|error| WorkspaceError::broken("the oracle cannot be made", error))?;
        Ok(Oracle::new(truth.clone(), planner, tried, self.dials.clone()))
    }

    /// Makes the agent for one image, without a simulator.
    ///
    /// # Errors
    /// Oracle services, which need the simulator; an unusable prompt file or setting.
    pub fn for_one_image(&self, planner: &Arc<Planner>) -> Result<(Agent, TranscriptRecorder), WorkspaceError> {
        let needs_simulator = |what: &str| {
            let hint = "expected --vlm FILE, and --masks rgbd or http:URL";
            Err(WorkspaceError::input(format!("{what} are the simulator's, and here is none")).with_hint(hint))
        };
        let model: Arc<dyn VisionModel> = match &self.model {
            ModelChoice::Chat(shared) => Arc::new(shared.service(None)),
            ModelChoice::Oracle | ModelChoice::Random | ModelChoice::Recorded => {
                return needs_simulator("the oracle's answers");
            }
        };
        let segmenter: Arc<dyn Segmenter> = match &self.masks {
            MaskChoice::Rgbd => Arc::new(RgbdSegmenter::default()),
            MaskChoice::Http(service) => Arc::clone(service) as Arc<dyn Segmenter>,
            MaskChoice::Oracle => return needs_simulator("the oracle's masks"),
        };
        let prompts = Arc::new(self.prompt_set()?);
        let transcribed = TranscriptRecorder::new(true);
        let services = Services { model, segmenter, grasps: self.grasp_source(planner), prompts };
        let agent = Agent::new(self.settings.clone().for_one_image(), services, planner, transcribed.clone());
        Ok((agent.map_err(|error| WorkspaceError::broken("the agent cannot be made", error))?, transcribed))
    }

    fn prompt_set(&self) -> Result<PromptSet, WorkspaceError> {
        PromptSet::load(self.prompts.as_deref())
            .map_err(|error| WorkspaceError::input("the agent's prompts cannot be used").because(error))
    }

    /// Makes the agent of one episode with a given model.
    ///
    /// # Errors
    /// An unusable prompt file or setting.
    pub fn make_asking(
        &self,
        model: Arc<dyn VisionModel>,
        truth: GroundTruth,
        planner: &Arc<Planner>,
    ) -> Result<MadeAgent, WorkspaceError> {
        let is_served = matches!(self.model, ModelChoice::Oracle) || matches!(self.masks, MaskChoice::Oracle);
        let knows = is_served || self.is_analysed;
        let segmenter: Arc<dyn Segmenter> = match &self.masks {
            MaskChoice::Rgbd => Arc::new(RgbdSegmenter::default()),
            MaskChoice::Oracle => Arc::new(OracleMasks::new(truth.clone())),
            MaskChoice::Http(service) => Arc::clone(service) as Arc<dyn Segmenter>,
        };
        let transcribed = TranscriptRecorder::new(self.keeps_pictures);
        let mut grasps = self.grasp_source(planner);
        if self.dials.once == Some(FailureClass::GraspProposal) {
            let (truth, asks) = (truth.clone(), transcribed.clone());
            grasps = Arc::new(FlawedGrasps { source: grasps, truth, asks });
        }
        let judgements = Arc::new(Mutex::new(EpisodeJudgements::default()));
        let (mut model, mut grasps) = (model, grasps);
        if knows {
            let annotator = Annotator::new(model, truth.clone(), planner, Arc::clone(&judgements), self.settings.asks);
            grasps = Arc::new(annotator.of_grasps(grasps));
            model = Arc::new(annotator);
        }
        let prompts = self.prompt_set()?;
        let services = Services { model, segmenter, grasps, prompts: Arc::new(prompts) };
        let told_m = depth_error_m(&truth.stage().scenario.world, &self.settings.cameras);
        let depth_error_m = told_m.max(self.settings.depth_error_m);
        let settings = AgentSettings { depth_error_m, ..self.settings.clone() };
        let agent = Agent::new(settings, services, planner, transcribed.clone())
            .map_err(|error| WorkspaceError::broken("the agent cannot be made", error))?
            .named(self.name());
        if !knows {
            return Ok(MadeAgent::new(agent, transcribed, None, judgements));
        }
        let turns = self.keeps_turns.then(TurnSnapshots::default);
        let jams = self.dials.once == Some(FailureClass::GraspExecution);
        let policy = GroundTruthFeed::new(agent, truth.clone()).with_jam(jams).with_snapshots(turns.clone());
        Ok(MadeAgent::new(policy, transcribed, Some(truth), judgements).keeping(turns))
    }
}

impl ModelChoice {
    /// Name of the model in results.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Oracle => "oracle",
            Self::Chat(_) => "chat",
            Self::Random => "random",
            Self::Recorded => "recorded",
        }
    }
}

impl MaskChoice {
    /// Name of the segmentation source in results.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Rgbd => "rgbd",
            Self::Oracle => "oracle",
            Self::Http(_) => "http",
        }
    }
}

/// Largest standard deviation (m) of depth measurements at 1 m among cameras, from their depth sensors; 0 for ideal
/// cameras.
fn depth_error_m(world: &World, cameras: &[String]) -> f64 {
    let sensors = cameras.iter().filter_map(|name| world.camera(name)?.sensor?.depth);
    sensors.map(|depth| depth.error_at_1_m()).fold(0.0, f64::max)
}

/// Client of a service; checks the URL but sends nothing.
fn http(url: &str) -> Result<HttpService, WorkspaceError> {
    // Accepts `http:URL` and plain `http://…`.
    let url = if url.starts_with("//") { format!("http:{url}") } else { url.to_owned() };
    HttpService::new(ServiceSettings::at(&url))
        .map_err(|error| WorkspaceError::input(format!("the service {url} cannot be asked")).because(error))
}
