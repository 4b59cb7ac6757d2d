//! A scenario made ready: models built, physics compiled.

use std::sync::Arc;

use genmanip_assets::{AssetError, AssetSource};
use genmanip_core::{Goal, ObjectModel, ObjectState, RobotModel, Scenario};
use genmanip_scene::relations::{PosedObject, PosedScene, RelationSettings, Rest, ShapeCache};
use genmanip_sim::{Scene, SceneObject, SimError};

use crate::RolloutSettings;

/// Everything immutable that episodes of one scenario share.
#[derive(Clone, Debug)]
pub struct Stage {
    /// The scenario.
    pub scenario: Arc<Scenario>,
    /// Its goal as it is judged, see [`genmanip_core::Task::judged_goal`].
    pub goal: Arc<Goal>,
    /// Models of its objects, in its order.
    pub models: Vec<Arc<ObjectModel>>,
    /// The robot.
    pub robot: Arc<RobotModel>,
    /// Compiled physics.
    pub scene: Arc<Scene>,
    /// How relations are judged, as the scenario's world says.
    pub relations: RelationSettings,
    /// The scene at the start as relations see it; its shapes are shared by all later ones.
    posed: PosedScene,
}

/// Why an episode could not be run or replayed.
#[derive(Debug, thiserror::Error)]
pub enum RolloutError {
    /// An object is unknown or its physics have changed.
    #[error(transparent)]
    Asset(#[from] AssetError),
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
    /// An environment without an episode.
    #[error("the environment has no episode: reset it first")]
    NotReset,
    /// An environment whose episode is over.
    #[error("the episode is over after {frames} control steps: reset the environment, or restore an earlier state")]
    EpisodeOver {
        /// Control steps of the episode.
        frames: usize,
    },
    /// A picture could not be made or encoded.
    #[error("images of episode {episode}: {reason}")]
    Images {
        /// Id of the episode.
        episode: String,
        /// What went wrong.
        reason: String,
    },
    /// The episode store failed.
    #[error(transparent)]
    Store(#[from] genmanip_data::DataError),
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
        let goal = Arc::new(scenario.task.judged_goal().into_owned());
        Ok(Self { goal, scenario, models, robot: Arc::clone(robot), scene, relations, posed })
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

    /// Control steps per second.
    pub fn control_rate_hz(&self) -> f64 {
        f64::from(self.scene.physics().control_rate_hz)
    }

    /// Name of an object for people.
    pub fn name(&self, object: usize) -> &str {
        self.models.get(object).map_or("?", |model| &model.card.name)
    }
}
