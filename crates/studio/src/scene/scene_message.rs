//! Scene as one JSON message: task, objects, cameras, surfaces and robot, with the URLs of their meshes.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};

use genmanip_assets::robots;
use genmanip_core::{
    AssetUid, Atom, Camera, GraphEdge, InstanceId, Joint, JointKind, JointState, ObjectModel, PlacedObject, Pose,
    ReferenceId, RobotModel, Scenario, SurfaceId, Task, TaskKind, Workspace, World,
};
use genmanip_relations::{PosedObject, PosedScene, ShapeCache, joint_state};
use genmanip_tasks::wording;
use genmanip_workspace::WorkspaceError;
use serde::Serialize;

use super::meshes::{Body, MeshStore};

/// Maximum number of paraphrases of an instruction.
const PARAPHRASES: usize = 4;

/// Scene of one revision of a scenario.
#[derive(Clone, Debug, Serialize)]
pub struct SceneMessage {
    /// Key of the scenario in URLs.
    pub key: String,
    /// Id of the scenario.
    pub id: String,
    /// True if the scenario is read-only, so that the first edit makes a copy.
    pub read_only: bool,
    /// Collection that the scenario belongs to.
    pub source: String,
    /// Key of the scenario that this one was copied from; `None` for an original.
    pub parent: Option<String>,
    /// Revision that is shown.
    pub revision: u64,
    /// Everything that an edit may change.
    pub state: SceneState,
    /// Support surfaces, the table first.
    pub surfaces: Vec<SurfaceMessage>,
    /// Usable part of the table, m, world frame.
    pub workspace: Workspace,
    /// The robot in its initial configuration.
    pub robot: RobotMessage,
}

/// All parts of a scene that an edit can change.
#[derive(Clone, Debug, Serialize)]
pub struct SceneState {
    /// Key of the scenario in URLs.
    pub key: String,
    /// Revision of the scenario.
    pub revision: u64,
    /// Kind of the task.
    pub kind: TaskKind,
    /// Instruction of the task.
    pub instruction: String,
    /// Paraphrases of the instruction.
    pub paraphrases: Vec<String>,
    /// Alternatives of the goal, each a list of conditions.
    pub goal: Vec<Vec<Atom>>,
    /// One sentence per alternative of the goal, for people.
    pub goal_sentences: Vec<String>,
    /// Description of the initial scene.
    pub description: String,
    /// Edges of the initial scene graph.
    pub edges: Vec<GraphEdge>,
    /// Objects in the order of the scenario.
    pub objects: Vec<ObjectMessage>,
    /// Cameras of the world.
    pub cameras: Vec<CameraMessage>,
    /// True if the author can undo a command.
    pub can_undo: bool,
    /// True if the author can redo a command.
    pub can_redo: bool,
}

/// An object of the scene.
#[derive(Clone, Debug, Serialize)]
pub struct ObjectMessage {
    /// Id of the instance.
    pub id: InstanceId,
    /// Uid of the object's asset in the catalogue.
    pub uid: AssetUid,
    /// Name of the object for people.
    pub name: String,
    /// Description in one sentence.
    pub description: String,
    /// Role of the object in the task.
    pub role: Role,
    /// True if the gripper can grasp the object.
    pub graspable: bool,
    /// Pose of the object, `world_from_object`.
    pub pose: Pose,
    /// Joint positions, rad or m.
    pub joint_positions: Vec<f64>,
    /// Joints, in the order of the positions.
    pub joints: Vec<JointMessage>,
    /// Names of the object's states.
    pub states: Vec<String>,
    /// Joint positions that set each state, rad or m; joints that the state does not define keep their position.
    pub state_joint_positions: BTreeMap<String, Vec<f64>>,
    /// State that the object is in; `None` for none.
    pub state: Option<String>,
    /// Minimum and maximum corner of the axis-aligned bounding box, m, world frame.
    pub bounds_m: [[f64; 3]; 2],
    /// Links of the object that have a mesh.
    pub links: Vec<LinkMessage>,
}

/// A joint of an object.
#[derive(Clone, Debug, Serialize)]
pub struct JointMessage {
    /// Name of the joint, unique within the object.
    pub name: String,
    /// Type: `hinge` or `slide`.
    pub kind: &'static str,
    /// Lower limit, rad or m.
    pub lower: f64,
    /// Upper limit, rad or m.
    pub upper: f64,
}

/// Role of an object in a task.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Role {
    /// The goal requires a relation with the object as subject, or a state of it.
    Moved,
    /// The goal uses the object as a reference.
    Reference,
    /// The object is in the task's scene graph, but not in the goal.
    Other,
    /// The object is not in the task's scene graph.
    Distractor,
}

/// A link with its mesh.
#[derive(Clone, Debug, Serialize)]
pub struct LinkMessage {
    /// Name of the link.
    pub name: String,
    /// URL of the link's mesh, a GLB file.
    pub mesh: String,
    /// Pose of the link, `world_from_link`.
    pub world_from_link: Pose,
}

/// A camera with its pose.
#[derive(Clone, Debug, Serialize)]
pub struct CameraMessage {
    /// The camera as in scenario files.
    #[serde(flatten)]
    pub camera: Camera,
    /// Pose of the optical frame (x right, y down, z forwards); for a camera on the hand, at the robot's initial
    /// configuration.
    pub world_from_camera: Pose,
}

/// A support surface.
#[derive(Clone, Debug, Serialize)]
pub struct SurfaceMessage {
    /// Id of the surface in the world.
    pub id: SurfaceId,
    /// Name of the surface for people.
    pub name: String,
    /// Centre of the upper side, m, world frame.
    pub center_m: [f64; 3],
    /// Extents along the surface's x and y axes, and thickness, m.
    pub size_m: [f64; 3],
    /// Yaw about the vertical, rad.
    pub yaw_rad: f64,
}

/// The robot in its initial configuration.
#[derive(Clone, Debug, Serialize)]
pub struct RobotMessage {
    /// Name of the robot in the registry.
    pub name: String,
    /// Links of the robot that have a mesh.
    pub links: Vec<LinkMessage>,
}

/// Caches of models, meshes and shapes, shared by all scenes.
#[derive(Debug, Default)]
pub struct SceneAssets {
    /// Cache of the mesh files.
    pub meshes: MeshStore,
    shapes: Mutex<ShapeCache>,
    /// Robots by their entry in a world, as JSON.
    robots: Mutex<BTreeMap<String, Arc<RobotModel>>>,
}

impl SceneAssets {
    /// Robot of a world; equal entries give the same `Arc`.
    ///
    /// # Errors
    /// When the robot is unknown, or differs from the one that the world was made with.
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

    /// Parts of a scene that no edit changes: surfaces and robot.
    ///
    /// # Errors
    /// When a mesh cannot be encoded, or as [`SceneAssets::robot`].
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

    /// Parts of a scene that an edit can change; `models` are those of the scenario's objects, in the order of the
    /// objects.
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
        let hashes = self.hashes(&Body::Object(Arc::clone(model)), model.card.uid.as_str())?;
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

    /// State that an articulated object is in, by the same rule as in judging; `None` for none.
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

/// Joint positions that set each state of an object whose present joint positions are `now`.
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

fn role(task: &Task, id: &InstanceId) -> Role {
    let mut atoms = task.goal.alternatives.iter().flatten();
    if atoms.clone().any(|atom| atom.subject() == id) {
        Role::Moved
    } else if atoms.any(|atom| atom.ids().any(|other| other == id)) {
        Role::Reference
    } else if task.scene_graph.index_of(id).is_some() {
        Role::Other
    } else {
        Role::Distractor
    }
}

/// Text of the conditions of one alternative, for people.
fn goal_sentence(task: &Task, all: &[Atom]) -> String {
    let name = |id: &ReferenceId| task.name_of(id);
    let words = |atom: &Atom| match atom {
        Atom::Relation { subject, relation, reference, second_reference } => {
            let second = second_reference.as_ref().map(name);
            format!("the {} is {}", name(subject), relation.describe(&name(reference), second.as_deref()))
        }
        Atom::State { object, state } => format!("the {} is {state}", name(object)),
    };
    all.iter().map(words).collect::<Vec<_>>().join(", and ")
}
