//! A scenario made ready: models built, physics compiled.

use std::sync::{Arc, OnceLock};

use genmanip_assets::{AssetError, AssetSource};
use genmanip_core::{
    Camera, CameraRequest, Goal, InterchangeError, ObjectModel, ObjectState, PlacedObject, RobotModel, Scenario,
};
use genmanip_relations::{PosedObject, PosedScene, RelationSettings, Rest, ShapeCache};
use genmanip_render::RenderAssets;
use genmanip_sim::{Scene, SceneObject, SimError};

use crate::RolloutSettings;
use crate::adapter::AdapterError;

/// Everything immutable that episodes of one scenario share.
#[derive(Clone, Debug)]
pub struct Stage {
    /// The scenario.
    pub scenario: Arc<Scenario>,
    /// Its goal as it is judged, see [`genmanip_core::Task::judged_goal`].
    pub goal: Arc<Goal>,
    /// Objects whose place or state a look at the goal depends on: those it names, and those with named states.
    pub judged: Arc<[usize]>,
    /// Models of its objects, in its order.
    pub models: Vec<Arc<ObjectModel>>,
    /// The robot.
    pub robot: Arc<RobotModel>,
    /// Compiled physics.
    pub scene: Arc<Scene>,
    /// How relations are judged, as the scenario's world says.
    pub relations: RelationSettings,
    /// What people call its objects.
    names: Vec<String>,
    /// The scene at the start as relations see it; its shapes are shared by all later ones.
    posed: PosedScene,
    /// Meshes to draw, collected when the first image is asked for and shared by all images of the stage.
    drawn: Arc<OnceLock<Arc<RenderAssets>>>,
}

/// Why an episode could not be run or replayed.
#[derive(Debug, thiserror::Error)]
pub enum RolloutError {
    /// An object is unknown or its physics have changed.
    #[error(transparent)]
    Asset(#[from] AssetError),
    /// The task's groups of interchangeable copies make no sense.
    #[error(transparent)]
    Interchangeable(#[from] InterchangeError),
    /// The simulation refused or blew up.
    #[error(transparent)]
    Sim(#[from] SimError),
    /// A layout failed for a reason that is not the task's.
    #[error(transparent)]
    Layout(#[from] genmanip_layout::LayoutError),
    /// The scenario, or what was recorded in it, belongs to another world.
    #[error("scenario {scenario}: world field {field}: expected {expected}, got {got}")]
    OtherWorld {
        /// Id of the scenario.
        scenario: String,
        /// The field of the world that differs.
        field: String,
        /// What the scenario says.
        expected: String,
        /// What there is.
        got: String,
    },
    /// The policy asks for what this loop does not serve.
    #[error("policy `{policy}` cannot be served: {reason}")]
    Spec {
        /// Name of the policy.
        policy: String,
        /// What does not fit.
        reason: String,
    },
    /// The policy cannot be reached, so the episode was not run; it may be tried again.
    #[error("policy `{policy}` cannot be reached: {reason}")]
    NotRun {
        /// Name of the policy.
        policy: String,
        /// What its end said.
        reason: String,
    },
    /// What was given is no action, or asks for what the arm cannot do; nothing has changed.
    #[error(transparent)]
    Action(#[from] AdapterError),
    /// An environment without an episode.
    #[error("the environment has no episode: reset it first")]
    NotReset,
    /// An environment whose episode is over.
    #[error("the episode is over after {frames} control steps: reset the environment, or restore an earlier state")]
    EpisodeOver {
        /// Control steps of the episode.
        frames: usize,
    },
    /// The scenario has no such camera.
    #[error("scenario {scenario} has no camera `{camera}`, its cameras are {known}")]
    UnknownCamera {
        /// Id of the scenario.
        scenario: String,
        /// What was asked for.
        camera: String,
        /// Names of its cameras.
        known: String,
    },
    /// An image could not be made or encoded.
    #[error("images of scenario {scenario}: {reason}")]
    Images {
        /// Id of the scenario.
        scenario: String,
        /// What went wrong.
        reason: String,
    },
    /// The episode store failed.
    #[error(transparent)]
    Store(#[from] genmanip_data::DataError),
    /// An episode of several could not be run.
    #[error("episode {id}")]
    Episode {
        /// Id of the episode.
        id: String,
        /// Why.
        source: Box<RolloutError>,
    },
}

impl Stage {
    /// Builds the models, checks that their physics are those the scenario was made with, and compiles the scene.
    ///
    /// # Errors
    /// When an object is unknown or changed, or the physics engine refuses the scene.
    pub fn open(
        scenario: Arc<Scenario>,
        assets: &dyn AssetSource,
        robot: &Arc<RobotModel>,
    ) -> Result<Self, RolloutError> {
        let wanted = &scenario.world.robot;
        let fields = [
            ("robot.name", wanted.name.clone(), robot.name.clone()),
            ("robot.physics_hash", wanted.physics_hash.clone(), robot.physics_hash()),
            ("robot.home", format!("{:?}", wanted.home), format!("{:?}", robot.home)),
        ];
        if let Some((field, expected, got)) = fields.into_iter().find(|(_, expected, got)| expected != got) {
            return Err(RolloutError::OtherWorld { scenario: scenario.id.clone(), field: field.into(), expected, got });
        }
        let models = scenario.objects.iter().map(|placed| assets.instance(placed)).collect::<Result<Vec<_>, _>>()?;
        let objects: Vec<SceneObject> = scenario
            .objects
            .iter()
            .zip(&models)
            .map(|(placed, model)| SceneObject {
                name: placed.id.clone(),
                model: Arc::clone(model),
                pose: placed.pose,
                joint_positions: placed.joint_positions.clone(),
                physics: placed.physics,
            })
            .collect();
        let scene = Arc::new(Scene::compile(&scenario.world, robot, &objects)?);
        let posed = objects.into_iter().map(|object| PosedObject {
            id: object.name,
            model: object.model,
            pose: object.pose,
            joint_positions: object.joint_positions,
        });
        let posed = PosedScene::new(posed.collect(), &scenario.world.surfaces, &mut ShapeCache::default());
        let relations = scenario.world.relations;
        scenario.task.check_interchangeable()?;
        let goal = Arc::new(scenario.task.judged_goal().into_owned());
        let name = |(placed, model): (&PlacedObject, &Arc<ObjectModel>)| match placed.id == model.card.uid {
            true => model.card.name.clone(),
            false => scenario.task.name_of(&placed.id),
        };
        let names = scenario.objects.iter().zip(&models).map(name).collect();
        let judged = scenario.objects.iter().zip(&models).enumerate().filter(|(_, (placed, model))| {
            let named = goal.alternatives.iter().flatten().any(|atom| atom.objects().any(|id| id == placed.id));
            named || !model.joint_states.is_empty()
        });
        let judged = judged.map(|(index, _)| index).collect();
        let drawn = Arc::default();
        Ok(Self { goal, judged, names, scenario, models, robot: Arc::clone(robot), scene, relations, posed, drawn })
    }

    /// The scene at the start, as relations see it.
    pub fn start(&self) -> &PosedScene {
        &self.posed
    }

    /// The scene as relations see it, from simulator truth.
    pub fn posed(&self, states: &[ObjectState]) -> PosedScene {
        let mut scene = self.posed.clone();
        for (index, state) in states.iter().enumerate() {
            scene.set_pose(index, state.pose, &state.joint_positions);
        }
        scene
    }

    /// What is held or moving, so that it satisfies nothing.
    pub fn rest(states: &[ObjectState], grasped: Option<usize>, settings: &RolloutSettings) -> Rest {
        Rest {
            held: grasped,
            moving: states
                .iter()
                .map(|state| state.speed > settings.rest_speed || state.angular_speed > settings.rest_angular_speed)
                .collect(),
        }
    }

    /// What is drawn of this stage, collected once.
    ///
    /// # Errors
    /// When a mesh is broken.
    pub fn render_assets(&self) -> Result<Arc<RenderAssets>, RolloutError> {
        if let Some(assets) = self.drawn.get() {
            return Ok(Arc::clone(assets));
        }
        let assets = RenderAssets::new(Arc::clone(&self.robot), &self.models, Some(&self.scenario.world))
            .map_err(|error| RolloutError::Images { scenario: self.scenario.id.clone(), reason: error.to_string() })?;
        Ok(Arc::clone(self.drawn.get_or_init(|| assets)))
    }

    /// The camera that is asked for, at the size that is asked for.
    ///
    /// # Errors
    /// When the scenario has no camera of that name, or the size is zero.
    pub fn camera(&self, request: &CameraRequest) -> Result<Camera, RolloutError> {
        let cameras = &self.scenario.world.cameras;
        let Some(camera) = cameras.iter().find(|camera| camera.name == request.name) else {
            return Err(RolloutError::UnknownCamera {
                scenario: self.scenario.id.clone(),
                camera: request.name.clone(),
                known: cameras.iter().map(|camera| camera.name.as_str()).collect::<Vec<_>>().join(", "),
            });
        };
        let Some([width, height]) = request.size else { return Ok(camera.clone()) };
        if width == 0 || height == 0 {
            let reason = format!("camera `{}` was asked for {width} x {height} pixels", request.name);
            return Err(RolloutError::Images { scenario: self.scenario.id.clone(), reason });
        }
        Ok(Camera { intrinsics: camera.intrinsics.resized(width, height), ..camera.clone() })
    }

    /// Control steps per second.
    pub fn control_rate_hz(&self) -> f64 {
        f64::from(self.scene.physics().control_rate_hz)
    }

    /// Name of an object for people.
    pub fn name(&self, object: usize) -> &str {
        self.names.get(object).map_or("?", String::as_str)
    }
}
