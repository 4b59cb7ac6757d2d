//! A scenario ready to simulate: models built, physics compiled.

use std::sync::{Arc, OnceLock};

use genmanip_assets::{AssetError, AssetSource};
use genmanip_core::{
    Atom, Camera, CameraRequest, Goal, InterchangeError, ObjectModel, ObjectState, PlacedObject, RobotModel, Scenario,
};
use genmanip_relations::{PosedObject, PosedScene, RelationSettings, Rest, ShapeCache};
use genmanip_render::RenderAssets;
use genmanip_sim::{Model, SceneObject, SimError};

use crate::RolloutSettings;
use crate::adapter::AdapterError;

/// Immutable data shared by all episodes of a scenario.
#[derive(Clone, Debug)]
pub struct Stage {
    /// Scenario that the stage was built from.
    pub scenario: Arc<Scenario>,
    /// Goal as judged, see [`genmanip_core::Task::judged_goal`].
    pub goal: Arc<Goal>,
    /// Objects whose pose or state the verdict depends on: those named by the goal, and those with named states.
    pub judged: Arc<[usize]>,
    /// Models of the objects, in the scenario's order.
    pub models: Vec<Arc<ObjectModel>>,
    /// Model of the robot.
    pub robot: Arc<RobotModel>,
    /// Compiled physics model of the scene.
    pub scene: Arc<Model>,
    /// Thresholds of the relations, from the scenario's world.
    pub relations: RelationSettings,
    /// Names of the objects for messages.
    names: Vec<String>,
    /// Initial scene for relations; later scenes share its shapes.
    posed: PosedScene,
    /// Render meshes, collected on first use and shared by all images of the stage.
    render_assets: Arc<OnceLock<Arc<RenderAssets>>>,
}

/// Any error that caused another one.
type Cause = Box<dyn std::error::Error + Send + Sync>;

/// Reason why an episode could not be run or replayed.
#[derive(Debug, thiserror::Error)]
pub enum RolloutError {
    /// An object is unknown, or its physics have changed.
    #[error(transparent)]
    Asset(#[from] AssetError),
    /// The task's groups of interchangeable objects are invalid.
    #[error(transparent)]
    Interchangeable(#[from] InterchangeError),
    /// The physics engine rejected the input, or the simulation became unstable.
    #[error(transparent)]
    Sim(#[from] SimError),
    /// Layout generation failed for a reason other than the task.
    #[error(transparent)]
    Layout(#[from] genmanip_layout::LayoutError),
    /// The scenario or recording belongs to another world.
    #[error("scenario {scenario}: world field {field}: expected {expected}, got {got}")]
    OtherWorld {
        /// Id of the scenario.
        scenario: String,
        /// Name of the differing field.
        field: String,
        /// Value of the field in the scenario.
        expected: String,
        /// Value of the field in the other world.
        got: String,
    },
    /// The policy's specification is not supported, or the policy cannot be made.
    #[error("policy `{policy}` is not supported: {source}")]
    Spec {
        /// Name of the policy.
        policy: String,
        /// Description of the unsupported part.
        source: Cause,
    },
    /// The policy stopped on a fault of the machine.
    #[error("policy `{policy}` stopped: {source}")]
    Policy {
        /// Name of the policy.
        policy: String,
        /// Description of the fault, e.g. lack of GPU memory.
        source: Cause,
    },
    /// The policy is unreachable or made a mistake, so the episode was not run; it may be retried.
    #[error("policy `{policy}` did not run: {reason}")]
    NotRun {
        /// Name of the policy.
        policy: String,
        /// Error of the connection, or description of the mistake.
        reason: String,
        /// True for a mistake of the policy's program; false if it is unreachable.
        mistake: bool,
    },
    /// An invalid or unreachable action; the environment is unchanged.
    #[error(transparent)]
    Action(#[from] AdapterError),
    /// A real robot or its cameras do not work, or cannot do what was asked.
    #[error("robot: {0}")]
    Robot(#[source] Cause),
    /// The environment was not reset.
    #[error("the environment has no episode: reset it first")]
    NotReset,
    /// The environment's episode is over.
    #[error("the episode is over after {frames} control steps: reset the environment, or restore an earlier state")]
    EpisodeOver {
        /// Number of control steps of the episode.
        frames: usize,
    },
    /// The scenario has no camera of that name.
    #[error("scenario {scenario} has no camera `{camera}`; its cameras are {known}")]
    UnknownCamera {
        /// Id of the scenario.
        scenario: String,
        /// Name of the camera that was requested.
        camera: String,
        /// Names of the scenario's cameras.
        known: String,
    },
    /// Rendering or encoding of images failed.
    #[error("images of scenario {scenario}: {source}")]
    Images {
        /// Id of the scenario.
        scenario: String,
        /// Error of the renderer or encoder.
        source: Cause,
    },
    /// The episode store could not be read or written.
    #[error(transparent)]
    Store(#[from] genmanip_data::DataError),
    /// One of several episodes could not be run.
    #[error("episode {id}")]
    Episode {
        /// Id of the episode.
        id: String,
        /// Error of that episode.
        source: Box<RolloutError>,
    },
}

impl RolloutError {
    /// Reason why a policy's specification is not supported; `None` for other errors.
    pub fn unsupported(&self) -> Option<&(dyn std::error::Error + Send + Sync + 'static)> {
        match self {
            Self::Spec { source, .. } => Some(source.as_ref()),
            Self::Episode { source, .. } => source.unsupported(),
            _ => None,
        }
    }
}

impl Stage {
    /// Builds the models, checks that robot and object physics match the scenario, and compiles the simulation.
    ///
    /// # Errors
    /// If an object is unknown or changed, or the physics engine rejects the scene.
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
        let objects: Vec<SceneObject> =
            scenario.objects.iter().zip(&models).map(|(placed, model)| SceneObject::placed(placed, model)).collect();
        // A robot without drives moves in planning and images alone.
        let scene = match robot.drives {
            Some(_) => Model::compile(&scenario.world, robot, &objects)?,
            None => Model::compile_without_robot(&scenario.world, &objects)?,
        };
        let scene = Arc::new(scene);
        let posed = scenario.objects.iter().zip(&models).map(|(placed, model)| PosedObject {
            id: placed.id.clone(),
            model: Arc::clone(model),
            pose: placed.pose,
            joint_positions: placed.joint_positions.clone(),
        });
        let posed = PosedScene::new(posed.collect(), &scenario.world.surfaces, &mut ShapeCache::default());
        let relations = scenario.world.relations;
        scenario.task.check_interchangeable()?;
        let goal = Arc::new(scenario.task.judged_goal().into_owned());
        let name = |(placed, model): (&PlacedObject, &Arc<ObjectModel>)| match placed.id == model.card.uid.as_str() {
            true => model.card.name.clone(),
            false => scenario.task.name_of(&placed.id),
        };
        let names = scenario.objects.iter().zip(&models).map(name).collect();
        let judged = scenario.objects.iter().zip(&models).enumerate().filter(|(_, (placed, model))| {
            let named = goal.alternatives.iter().flatten().flat_map(Atom::ids).any(|id| *id == placed.id);
            named || !model.joint_states.is_empty()
        });
        let judged = judged.map(|(index, _)| index).collect();
        let render_assets = Arc::default();
        let robot = Arc::clone(robot);
        Ok(Self { goal, judged, names, scenario, models, robot, scene, relations, posed, render_assets })
    }

    /// Initial scene, posed for evaluating relations.
    pub fn start(&self) -> &PosedScene {
        &self.posed
    }

    /// Scene with the given object states, posed for evaluating relations.
    pub fn posed(&self, states: &[ObjectState]) -> PosedScene {
        let mut scene = self.posed.clone();
        for (index, state) in states.iter().enumerate() {
            scene.set_pose(index, state.pose, &state.joint_positions);
        }
        scene
    }

    /// Gripped and moving objects, which satisfy no condition.
    pub fn rest(states: &[ObjectState], grasped: Option<usize>, settings: &RolloutSettings) -> Rest {
        Rest {
            held: grasped,
            moving: states
                .iter()
                .map(|state| state.speed > settings.rest_speed || state.angular_speed > settings.rest_angular_speed)
                .collect(),
        }
    }

    /// Render meshes of the stage, collected once.
    ///
    /// # Errors
    /// If a mesh is invalid.
    pub fn render_assets(&self) -> Result<Arc<RenderAssets>, RolloutError> {
        if let Some(assets) = self.render_assets.get() {
            return Ok(Arc::clone(assets));
        }
        let assets = RenderAssets::new(Arc::clone(&self.robot), &self.models, Some(&self.scenario.world))
            .map_err(|error| RolloutError::Images { scenario: self.scenario.id.clone(), source: error.into() })?;
        Ok(Arc::clone(self.render_assets.get_or_init(|| assets)))
    }

    /// Camera of a request, with the image size changed if the request says so.
    ///
    /// # Errors
    /// If the scenario has no camera of that name, or the size is zero.
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
            let what = format!("camera `{}` was requested with {width} x {height} pixels", request.name);
            return Err(RolloutError::Images { scenario: self.scenario.id.clone(), source: what.into() });
        }
        Ok(Camera { intrinsics: camera.intrinsics.resized(width, height), ..camera.clone() })
    }

    /// Rate of control steps, Hz.
    pub fn control_rate_hz(&self) -> f64 {
        f64::from(self.scene.physics().control_rate_hz)
    }

    /// Name of an object for messages.
    pub fn name(&self, object: usize) -> &str {
        self.names.get(object).map_or("?", String::as_str)
    }
}
