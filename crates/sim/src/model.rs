//! The compiled scene: immutable, shared between threads.

use std::collections::BTreeSet;
use std::sync::Arc;

use genmanip_core::{MassProperties, PhysicsSettings, RobotModel, SurfaceId, World};
use mujoco_rs::mujoco_c::_mjtObjBase as ObjectType;
use mujoco_rs::wrappers::MjModel;

use crate::body::BodyId;
use crate::engine_settings::CheckedSettings;
use crate::scene_object::SceneObject;
use crate::{ENGINE, SimError, engine_log, engine_version, mjcf};

/// A robot and objects in a world, compiled for the physics engine.
///
/// Immutable, `Send` and `Sync`: one scene serves any number of [`crate::Sim`]s on any number of threads.
#[derive(Debug)]
pub struct Model {
    mjcf: String,
    pub(crate) settings: CheckedSettings,
    pub(crate) model: Arc<MjModel>,
    pub(crate) robot: Option<RobotIndex>,
    pub(crate) objects: Vec<ObjectIndex>,
    /// Ids of the support surfaces, the table first.
    surfaces: Vec<SurfaceId>,
    /// [`BodyId`] of each body of the engine, in the engine's order.
    pub(crate) bodies: Vec<BodyId>,
}

/// Addresses of the robot in the engine's arrays.
#[derive(Debug)]
pub(crate) struct RobotIndex {
    pub model: RobotModel,
    /// Engine body of each link.
    pub link_bodies: Vec<usize>,
    pub arm_qpos: Vec<usize>,
    pub arm_dof: Vec<usize>,
    pub finger_joints: [usize; 2],
    pub finger_qpos: [usize; 2],
    /// Control indices: joint position targets, joint velocity targets, width set point.
    pub position_ctrl: Vec<usize>,
    pub velocity_ctrl: Vec<usize>,
    pub grip_ctrl: usize,
}

/// Addresses of an object in the engine's arrays.
#[derive(Debug)]
pub(crate) struct ObjectIndex {
    pub name: String,
    pub link_names: Vec<String>,
    pub root_qpos: usize,
    pub root_dof: usize,
    pub joint_qpos: Vec<usize>,
}

impl Model {
    /// Compiles a world with a robot, fixed at the world origin, and objects.
    ///
    /// # Errors
    /// Invalid settings, names or numbers, or a model that the engine rejects ([`SimError::Compile`] carries its
    /// message).
    pub fn compile(world: &World, robot: &RobotModel, objects: &[SceneObject]) -> Result<Self, SimError> {
        Self::compile_with(world, Some(robot), objects, None)
    }

    /// Compiles a world with a robot that carries a payload, to identify the arm: it is rigidly attached to the hand,
    /// with its centre in the hand's frame, touches nothing, and the drives do not compensate its weight.
    ///
    /// # Errors
    /// As [`Model::compile`].
    pub fn compile_with_payload(world: &World, robot: &RobotModel, payload: &MassProperties) -> Result<Self, SimError> {
        Self::compile_with(world, Some(robot), &[], Some(payload))
    }

    /// Compiles surfaces and objects without a robot, for fast settling of layouts.
    ///
    /// # Errors
    /// As [`Model::compile`].
    pub fn compile_without_robot(world: &World, objects: &[SceneObject]) -> Result<Self, SimError> {
        Self::compile_with(world, None, objects, None)
    }

    fn compile_with(
        world: &World,
        robot: Option<&RobotModel>,
        objects: &[SceneObject],
        payload: Option<&MassProperties>,
    ) -> Result<Self, SimError> {
        let engine = engine_version();
        if engine != ENGINE {
            return Err(SimError::EngineVersion { expected: ENGINE.into(), got: engine });
        }
        engine_log::silence();
        let settings = CheckedSettings::of(&world.physics, robot)?;
        check_surfaces(world)?;
        check_objects(objects)?;
        let mjcf = mjcf::assemble(world, robot, objects, payload, &settings);
        let model = MjModel::from_xml_string(&mjcf).map_err(|error| SimError::Compile(error.to_string()))?;
        let names = Names(&model);
        let robot = robot.map(|robot| names.robot(robot)).transpose()?;
        let objects = objects.iter().map(|object| names.object(object)).collect::<Result<Vec<_>, _>>()?;
        let bodies = names.bodies(world, robot.as_ref(), &objects)?;
        let surfaces = world.surfaces.iter().map(|surface| surface.id.clone()).collect();
        Ok(Self { mjcf, settings, model: Arc::new(model), robot, objects, surfaces, bodies })
    }

    /// The scene as MJCF text, which loads in any MuJoCo 3.17 without further files.
    pub fn mjcf(&self) -> &str {
        &self.mjcf
    }

    /// Physics settings of the world.
    pub fn physics(&self) -> &PhysicsSettings {
        &self.settings.physics
    }

    /// Model of the robot; `None` for a scene without one.
    pub fn robot(&self) -> Option<&RobotModel> {
        self.robot.as_ref().map(|index| &index.model)
    }

    /// Number of objects in the scene.
    pub fn object_count(&self) -> usize {
        self.objects.len()
    }

    /// Display name of a body, e.g. `Red Mug` for a rigid object or `Cabinet/drawer` for a link.
    pub fn body_name(&self, body: BodyId) -> String {
        match body {
            BodyId::Table => mjcf::TABLE.into(),
            BodyId::Surface { surface } => {
                self.surfaces.get(surface).map_or_else(|| format!("surface {surface}"), ToString::to_string)
            }
            BodyId::Floor => mjcf::FLOOR.into(),
            BodyId::Robot { link } => self
                .robot()
                .and_then(|robot| robot.links.get(link))
                .map_or_else(|| format!("robot/{link}"), |link| mjcf::robot_body(&link.name)),
            BodyId::Object { object, link } => match self.objects.get(object) {
                Some(index) if index.link_names.len() == 1 => index.name.clone(),
                Some(index) => format!("{}/{}", index.name, index.link_names.get(link).map_or("?", String::as_str)),
                None => format!("object {object}"),
            },
        }
    }
}

fn check_objects(objects: &[SceneObject]) -> Result<(), SimError> {
    let mut names = BTreeSet::new();
    for object in objects {
        if object.name.is_empty() || object.name.chars().any(char::is_control) {
            return Err(SimError::BadName(object.name.clone()));
        }
        if !names.insert(object.name.as_str()) {
            return Err(SimError::DuplicateName(object.name.clone()));
        }
        let expected = object.model.joint_count();
        if object.joint_positions.len() != expected {
            return Err(SimError::JointPositions {
                object: object.name.clone(),
                expected,
                got: object.joint_positions.len(),
            });
        }
        let finite = object.pose.position.is_finite()
            && object.pose.rotation.is_finite()
            && object.joint_positions.iter().all(|position| position.is_finite());
        if !finite {
            return Err(SimError::NotFinite(format!("the pose of object `{}`", object.name)));
        }
        if object.model.links.is_empty() {
            return Err(SimError::Compile(format!("object `{}` has no body", object.name)));
        }
    }
    Ok(())
}

fn check_surfaces(world: &World) -> Result<(), SimError> {
    let mut ids = BTreeSet::new();
    for surface in &world.surfaces {
        let numbers = [surface.top_center_m, surface.size_m];
        if !numbers.iter().all(|vector| vector.is_finite()) || !surface.yaw_rad.is_finite() {
            return Err(SimError::NotFinite(format!("support surface `{}`", surface.id)));
        }
        if !ids.insert(surface.id.as_str()) {
            return Err(SimError::DuplicateName(surface.id.to_string()));
        }
    }
    if world.surfaces.is_empty() {
        return Err(SimError::Settings("a world needs at least one support surface, the table".into()));
    }
    Ok(())
}

/// Joint id with its addresses in `qpos` and `qvel`.
struct JointAddress {
    id: usize,
    qpos: usize,
    dof: usize,
}

/// Name lookups in a compiled model.
struct Names<'a>(&'a MjModel);

impl Names<'_> {
    fn id(&self, kind: ObjectType, name: &str) -> Result<usize, SimError> {
        self.0.name_to_id(kind, name).ok_or_else(|| SimError::Compile(format!("the compiled model lacks `{name}`")))
    }

    fn joint(&self, name: &str) -> Result<JointAddress, SimError> {
        let id = self.id(ObjectType::mjOBJ_JOINT, name)?;
        Ok(JointAddress { id, qpos: self.0.jnt_qposadr()[id] as usize, dof: self.0.jnt_dofadr()[id] as usize })
    }

    fn robot(&self, robot: &RobotModel) -> Result<RobotIndex, SimError> {
        let arm: Vec<JointAddress> =
            robot.arm_joints().map(|joint| self.joint(&mjcf::robot_joint(&joint.name))).collect::<Result<_, _>>()?;
        let finger = |number: usize| -> Result<JointAddress, SimError> {
            let name = mjcf::finger_joint(robot, number)
                .ok_or_else(|| SimError::Settings(format!("robot `{}` has a finger without a joint", robot.name)))?;
            self.joint(&name)
        };
        let fingers = [finger(0)?, finger(1)?];
        let drives = |kind: &str| -> Result<Vec<usize>, SimError> {
            robot
                .arm_joints()
                .map(|joint| self.id(ObjectType::mjOBJ_ACTUATOR, &format!("arm/{}/{kind}", joint.name)))
                .collect()
        };
        Ok(RobotIndex {
            link_bodies: robot
                .links
                .iter()
                .map(|link| self.id(ObjectType::mjOBJ_BODY, &mjcf::robot_body(&link.name)))
                .collect::<Result<_, _>>()?,
            arm_qpos: arm.iter().map(|joint| joint.qpos).collect(),
            arm_dof: arm.iter().map(|joint| joint.dof).collect(),
            finger_joints: fingers.each_ref().map(|joint| joint.id),
            finger_qpos: fingers.each_ref().map(|joint| joint.qpos),
            position_ctrl: drives("position")?,
            velocity_ctrl: drives("velocity")?,
            grip_ctrl: self.id(ObjectType::mjOBJ_ACTUATOR, mjcf::GRIP)?,
            model: robot.clone(),
        })
    }

    fn object(&self, object: &SceneObject) -> Result<ObjectIndex, SimError> {
        let root = self.joint(&mjcf::object_free_joint(&object.name))?;
        let joints = object.model.links.iter().filter_map(|link| link.joint.as_ref());
        Ok(ObjectIndex {
            name: object.name.clone(),
            link_names: object.model.links.iter().map(|link| link.name.clone()).collect(),
            root_qpos: root.qpos,
            root_dof: root.dof,
            joint_qpos: joints
                .map(|joint| Ok(self.joint(&mjcf::object_joint(&object.name, &joint.name))?.qpos))
                .collect::<Result<_, SimError>>()?,
        })
    }

    fn bodies(
        &self,
        world: &World,
        robot: Option<&RobotIndex>,
        objects: &[ObjectIndex],
    ) -> Result<Vec<BodyId>, SimError> {
        let mut bodies = vec![BodyId::Floor; self.0.nbody() as usize];
        for (index, surface) in world.surfaces.iter().enumerate() {
            let body = self.id(ObjectType::mjOBJ_BODY, &mjcf::surface_body(surface, index))?;
            bodies[body] = if index == 0 { BodyId::Table } else { BodyId::Surface { surface: index } };
        }
        for (link, &body) in robot.iter().flat_map(|robot| robot.link_bodies.iter().enumerate()) {
            bodies[body] = BodyId::Robot { link };
        }
        for (object, index) in objects.iter().enumerate() {
            for (link, name) in index.link_names.iter().enumerate() {
                let body = self.id(ObjectType::mjOBJ_BODY, &mjcf::object_body(&index.name, name))?;
                bodies[body] = BodyId::Object { object, link };
            }
        }
        Ok(bodies)
    }
}
