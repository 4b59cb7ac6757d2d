//! Scene as one JSON message: task, objects, cameras, surfaces and robot, with the addresses of their meshes.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};

use genmanip_assets::robots;
use genmanip_core::{
    Atom, Camera, GraphEdge, Joint, JointKind, JointState, ObjectModel, PlacedObject, Pose, RobotModel, Scenario, Task,
    TaskKind, Workspace, World,
};
use genmanip_relations::{PosedObject, PosedScene, ShapeCache, joint_state};
use genmanip_tasks::wording;
use genmanip_workspace::WorkspaceError;
use serde::Serialize;

use super::meshes::{Body, MeshStore};

/// Most other wordings of an instruction that are shown.
const PARAPHRASES: usize = 4;

/// Scene of one revision of a scenario.
#[derive(Clone, Debug, Serialize)]
pub struct SceneMessage {
    /// Key of the scenario in addresses.
    pub key: String,
    /// Id of the scenario.
    pub id: String,
    /// True if the first edit makes a copy.
    pub read_only: bool,
    /// Collection that it belongs to.
    pub source: String,
    /// Key of the scenario of which it is a copy.
    pub parent: Option<String>,
    /// Revision that is shown.
    pub revision: u64,
    /// Everything that an edit may change.
    pub state: SceneState,
    /// Support surfaces, the table first.
    pub surfaces: Vec<SurfaceMessage>,
    /// Usable part of the table, metres.
    pub workspace: Workspace,
    /// Robot at its start.
    pub robot: RobotMessage,
}

/// Everything that an edit may change.
#[derive(Clone, Debug, Serialize)]
pub struct SceneState {
    /// Key of the scenario in addresses.
    pub key: String,
    /// Revision of the scenario.
    pub revision: u64,
    /// Kind of the task.
    pub kind: TaskKind,
    /// Instruction.
    pub instruction: String,
    /// Other wordings of it.
    pub paraphrases: Vec<String>,
    /// Alternatives of the goal, each a list of conditions.
    pub goal: Vec<Vec<Atom>>,
    /// Conditions of each alternative in words, alternatives joined by "or".
    pub goal_sentences: Vec<String>,
    /// Description of the initial scene.
    pub description: String,
    /// Relations of the initial scene.
    pub edges: Vec<GraphEdge>,
    /// Objects in the order of the scenario.
    pub objects: Vec<ObjectMessage>,
    /// Cameras of the world.
    pub cameras: Vec<CameraMessage>,
    /// True if the author has a command to undo.
    pub can_undo: bool,
    /// True if the author has a command to redo.
    pub can_redo: bool,
}

/// An object of the scene.
#[derive(Clone, Debug, Serialize)]
pub struct ObjectMessage {
    /// Id of the instance.
    pub id: String,
    /// Uid of its asset in the catalogue.
    pub uid: String,
    /// Display name.
    pub name: String,
    /// One sentence.
    pub description: String,
    /// Part that it plays in the task.
    pub role: Role,
    /// True if the gripper can hold it.
    pub graspable: bool,
    /// `world_from_object`.
    pub pose: Pose,
    /// Joint positions, rad or m.
    pub joint_positions: Vec<f64>,
    /// Joints, in the order of the positions.
    pub joints: Vec<JointMessage>,
    /// Names of its states.
    pub states: Vec<String>,
    /// Joint positions that set each state; joints that the state does not name stay as they are.
    pub state_joint_positions: BTreeMap<String, Vec<f64>>,
    /// State that it is in.
    pub state: Option<String>,
    /// Lowest and highest corner of its world-aligned bounds, metres.
    pub bounds_m: [[f64; 3]; 2],
    /// Links with their meshes.
    pub links: Vec<LinkMessage>,
}

/// A joint of an object.
#[derive(Clone, Debug, Serialize)]
pub struct JointMessage {
    /// Name, unique in the object.
    pub name: String,
    /// `hinge`, or `slide`.
    pub kind: &'static str,
    /// Smallest position, rad or m.
    pub lower: f64,
    /// Largest position, rad or m.
    pub upper: f64,
}

/// Part of an object in its task.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Role {
    /// Its place or state is in the goal.
    Moved,
    /// The goal refers to it.
    Reference,
    /// In the task's graph.
    Other,
    /// Unmentioned.
    Distractor,
}

/// A link with its mesh.
#[derive(Clone, Debug, Serialize)]
pub struct LinkMessage {
    /// Name of the link.
    pub name: String,
    /// Address of its mesh.
    pub mesh: String,
    /// Pose of the link.
    pub world_from_link: Pose,
}

/// A camera with its pose in the world.
#[derive(Clone, Debug, Serialize)]
pub struct CameraMessage {
    /// Camera as in scenario files.
    #[serde(flatten)]
    pub camera: Camera,
    /// Pose with optical axes (x right, y down, z ahead); on the hand, for the robot at its start.
    pub world_from_camera: Pose,
}

/// A support surface.
#[derive(Clone, Debug, Serialize)]
pub struct SurfaceMessage {
    /// Id in the world.
    pub id: String,
    /// Display name.
    pub name: String,
    /// Centre of its top, metres.
    pub center_m: [f64; 3],
    /// Extent along its axes and thickness, metres.
    pub size_m: [f64; 3],
    /// Turn about z, rad.
    pub yaw_rad: f64,
}

/// The robot at its start.
#[derive(Clone, Debug, Serialize)]
pub struct RobotMessage {
    /// Name in the registry.
    pub name: String,
    /// Links with their meshes.
    pub links: Vec<LinkMessage>,
}

/// Models, meshes and shapes shared by all scenes.
#[derive(Debug, Default)]
pub struct SceneAssets {
    /// Files of the meshes.
    pub meshes: MeshStore,
    shapes: Mutex<ShapeCache>,
    /// Robots by their entry in a world.
    robots: Mutex<BTreeMap<String, Arc<RobotModel>>>,
}

impl SceneAssets {
    /// Robot of a world; the same `Arc` for equal entries.
    ///
    /// # Errors
    /// When it is not the one that the world was made with.
    pub fn robot(&self, world: &World) -> Result<Arc<RobotModel>, WorkspaceError> {
        let key = serde_json::to_string(&world.robot).unwrap_or_default();
        let mut known = self.robots.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(robot) = known.get(&key) {
            return Ok(Arc::clone(robot));
        }
        let robot = robots::of_world(world)
            .map_err(|error| WorkspaceError::input("the robot of the scenario cannot be used").because(error))?;
        known.insert(key, Arc::clone(&robot));
        Ok(robot)
    }

    /// Fields of a scene that no edit changes: surfaces, workspace and robot.
    ///
    /// # Errors
    /// When a mesh cannot be written, or as [`SceneAssets::robot`].
    pub fn fixed(&self, world: &World) -> Result<(Vec<SurfaceMessage>, RobotMessage), WorkspaceError> {
        let surfaces = world.surfaces.iter().map(|surface| SurfaceMessage {
            id: surface.id.clone(),
            name: surface.name.clone(),
            center_m: surface.top_center_m.to_array(),
            size_m: surface.size_m.to_array(),
            yaw_rad: surface.yaw_rad,
        });
        let robot = self.robot(world)?;
        let hashes = self.hashes(&Body::Robot(Arc::clone(&robot)), &robot.name)?;
        let poses = robot.link_poses(world.robot.start(), robot.gripper.max_width);
        let links = links(robot.links.iter().map(|link| link.name.as_str()), hashes, poses);
        Ok((surfaces.collect(), RobotMessage { name: robot.name.clone(), links }))
    }

    /// Everything that an edit may change; `models` are those of the scenario's objects, in their order.
    ///
    /// # Errors
    /// As [`SceneAssets::fixed`].
    pub fn state(
        &self,
        key: &str,
        scenario: &Scenario,
        models: &[Arc<ObjectModel>],
        revision: u64,
    ) -> Result<SceneState, WorkspaceError> {
        let task = &scenario.task;
        let objects = scenario.objects.iter().zip(models).map(|(placed, model)| self.object(scenario, placed, model));
        let robot = self.robot(&scenario.world)?;
        let link_poses = robot.link_poses(scenario.world.robot.start(), robot.gripper.max_width);
        let world_from_hand = link_poses.get(robot.hand).copied().unwrap_or_default();
        let cameras = scenario.world.cameras.iter().map(|camera| CameraMessage {
            camera: camera.clone(),
            world_from_camera: camera.world_from_camera(&world_from_hand),
        });
        Ok(SceneState {
            key: key.to_owned(),
            revision,
            kind: task.kind,
            instruction: task.instruction.clone(),
            paraphrases: wording::paraphrases(task, PARAPHRASES),
            goal: task.goal.alternatives.clone(),
            goal_sentences: task.goal.alternatives.iter().map(|all| goal_sentence(task, all)).collect(),
            description: task.scene_graph.description.clone(),
            edges: task.scene_graph.edges.clone(),
            objects: objects.collect::<Result<_, _>>()?,
            cameras: cameras.collect(),
            can_undo: false,
            can_redo: false,
        })
    }

    fn object(
        &self,
        scenario: &Scenario,
        placed: &PlacedObject,
        model: &Arc<ObjectModel>,
    ) -> Result<ObjectMessage, WorkspaceError> {
        let task = &scenario.task;
        let hashes = self.hashes(&Body::Object(Arc::clone(model)), &model.card.uid)?;
        let poses = model.link_poses(&placed.joint_positions).into_iter().map(|link| placed.pose * link);
        let bounds = model.world_bounds(&placed.pose, &placed.joint_positions);
        let named = task.card(&placed.id).is_some();
        Ok(ObjectMessage {
            id: placed.id.clone(),
            uid: model.card.uid.clone(),
            name: if named { task.name_of(&placed.id) } else { model.card.name.clone() },
            description: model.card.description.clone(),
            role: role(task, &placed.id),
            graspable: model.card.can_grasp,
            pose: placed.pose,
            joint_positions: placed.joint_positions.clone(),
            joints: joints(model).map(JointMessage::of).collect(),
            states: model.card.states.clone(),
            state_joint_positions: states(model, &placed.joint_positions),
            state: self.current_state(scenario, placed, model),
            bounds_m: [bounds.min.to_array(), bounds.max.to_array()],
            links: links(model.links.iter().map(|link| link.name.as_str()), hashes, poses),
        })
    }

    /// State that an articulated object is in, as it is judged.
    fn current_state(&self, scenario: &Scenario, placed: &PlacedObject, model: &Arc<ObjectModel>) -> Option<String> {
        if model.joint_states.is_empty() {
            return None;
        }
        let object = PosedObject {
            id: placed.id.clone(),
            model: Arc::clone(model),
            pose: placed.pose,
            joint_positions: placed.joint_positions.clone(),
        };
        let mut shapes = self.shapes.lock().unwrap_or_else(PoisonError::into_inner);
        let scene = PosedScene::new(vec![object], &[], &mut shapes);
        joint_state(&scene, 0, &scenario.world.relations)
    }

    fn hashes(&self, body: &Body, name: &str) -> Result<Vec<Option<String>>, WorkspaceError> {
        let broken = |error| WorkspaceError::broken(format!("the mesh of {name} cannot be written"), error);
        self.meshes.hashes(body).map_err(broken)
    }
}

fn links<'a>(
    names: impl Iterator<Item = &'a str>,
    hashes: Vec<Option<String>>,
    world_from_links: impl IntoIterator<Item = Pose>,
) -> Vec<LinkMessage> {
    let link = |((name, hash), world_from_link): ((&str, Option<String>), Pose)| {
        Some(LinkMessage { name: name.to_owned(), mesh: format!("/meshes/{}.glb", hash?), world_from_link })
    };
    names.zip(hashes).zip(world_from_links).filter_map(link).collect()
}

fn joints(model: &ObjectModel) -> impl Iterator<Item = &Joint> {
    model.links.iter().filter_map(|link| link.joint.as_ref())
}

impl JointMessage {
    fn of(joint: &Joint) -> Self {
        let [lower, upper] = joint.range;
        let kind = match joint.kind {
            JointKind::Revolute => "hinge",
            JointKind::Prismatic => "slide",
        };
        Self { name: joint.name.clone(), kind, lower, upper }
    }
}

/// Joint positions that set each state of an object whose joints are at `now`.
fn states(model: &ObjectModel, now: &[f64]) -> BTreeMap<String, Vec<f64>> {
    let positions = |state: &JointState| {
        let position = |(index, joint): (usize, &Joint)| {
            let listed = state.intervals.iter().position(|(name, _)| *name == joint.name);
            let nominal = listed.and_then(|index| state.nominal.get(index).copied());
            nominal.or_else(|| now.get(index).copied()).unwrap_or(0.0)
        };
        joints(model).enumerate().map(position).collect()
    };
    model.joint_states.iter().map(|state| (state.name.clone(), positions(state))).collect()
}

fn role(task: &Task, id: &str) -> Role {
    let mut atoms = task.goal.alternatives.iter().flatten();
    if atoms.clone().any(|atom| atom.subject() == id) {
        Role::Moved
    } else if atoms.any(|atom| atom.objects().any(|other| other == id)) {
        Role::Reference
    } else if task.scene_graph.index_of(id).is_some() {
        Role::Other
    } else {
        Role::Distractor
    }
}

/// Conditions of an alternative as a sentence.
fn goal_sentence(task: &Task, all: &[Atom]) -> String {
    let name = |id: &str| task.name_of(id);
    let words = |atom: &Atom| match atom {
        Atom::Relation { subject, relation, reference, second_reference } => {
            let second = second_reference.as_deref().map(name);
            format!("the {} is {}", name(subject), relation.describe(&name(reference), second.as_deref()))
        }
        Atom::State { object, state } => format!("the {} is {state}", name(object)),
    };
    all.iter().map(words).collect::<Vec<_>>().join(", and ")
}
