//! Writer of OpenUSD text (usda) with UsdPhysics: a whole scenario for scene graph tools and simulators.
//!
//! Units are metres and kilograms, and z points up. All links of the robot and of objects are rigid bodies with
//! colliders and masses, connected by joints. UsdPhysics supports joint axes along x, y or z only, so each joint frame
//! is rotated to have its x along the axis.

mod geometry;
mod materials;
mod text;

use std::sync::Arc;

use genmanip_core::glam::{DMat3, DQuat, DVec3};
use genmanip_core::{
    Camera, CameraMount, JointKind, MassProperties, ObjectModel, Piece, Pose, RobotModel, Scenario, VisualPart,
};
use genmanip_render::encode::EncodeError;
use genmanip_render::internals::fixtures;
use text::{Writer, quat, quoted, triple};

/// Horizontal aperture of all cameras, in USD's tenths of a scene unit (its default). Only the ratio of focal length to
/// aperture affects the image.
const APERTURE: f64 = 20.955;
/// Pose of a USD camera frame (y up, z backward) in the optical frame of OpenCV (y down, z forward): half a turn about
/// x.
const OPTICAL_FROM_USD: Pose = Pose { position: DVec3::ZERO, rotation: DQuat::from_xyzw(1.0, 0.0, 0.0, 0.0) };

/// A stage as text, and the textures that it refers to.
#[derive(Clone, Debug, PartialEq)]
pub struct Stage {
    /// Contents of the usda file.
    pub text: String,
    /// Texture files: name in the folder of textures, and content as PNG.
    pub textures: Vec<(String, Vec<u8>)>,
}

/// USD stage of a scenario in its initial state: support surfaces, robot, objects with bodies and joints, and cameras.
///
/// `models` are those of the scenario's objects, in the same order. `textures` is the folder of the texture files,
/// relative to the usda file; this function writes no file.
///
/// # Errors
/// When the number of pixels of a texture does not match its size.
pub fn scenario_usd(
    scenario: &Scenario,
    models: &[Arc<ObjectModel>],
    robot: &RobotModel,
    textures: &str,
) -> Result<Stage, EncodeError> {
    let mut usd = Writer { folder: textures, ..Writer::default() };
    usd.line("#usda 1.0");
    usd.line("(");
    usd.line("    customLayerData = {");
    usd.line(&format!("        string generator = {}", quoted(concat!("genmanip ", env!("CARGO_PKG_VERSION")))));
    usd.line(&format!("        string scenario = {}", quoted(&scenario.id)));
    usd.line(&format!("        string instruction = {}", quoted(&scenario.task.instruction)));
    usd.line("    }");
    for line in ["defaultPrim = \"World\"", "kilogramsPerUnit = 1", "metersPerUnit = 1", "upAxis = \"Z\""] {
        usd.line(&format!("    {line}"));
    }
    usd.line(")");
    usd.open("Xform", "World", &[("kind", "\"assembly\"")], &[]);
    usd.open("PhysicsScene", "physics", &[], &[]);
    usd.line("vector3f physics:gravityDirection = (0, 0, -1)");
    usd.line(&format!("float physics:gravityMagnitude = {}", scenario.world.physics.gravity_m_s2.abs()));
    usd.close();
    usd.surfaces(scenario)?;
    let positions = scenario.world.robot.start();
    usd.robot(robot, positions)?;
    for (placed, model) in scenario.objects.iter().zip(models) {
        usd.object(placed.id.as_str(), &placed.pose, model, &placed.joint_positions)?;
    }
    let world_from_hand =
        robot.link_poses(positions, robot.gripper.max_width).get(robot.hand).copied().unwrap_or_default();
    usd.open("Scope", "cameras", &[], &[]);
    for camera in &scenario.world.cameras {
        let world_from_camera = match camera.mount {
            CameraMount::World => camera.mount_from_camera,
            CameraMount::Hand => world_from_hand * camera.mount_from_camera,
        };
        usd.camera(camera, &world_from_camera);
    }
    usd.close();
    usd.materials()?;
    usd.close();
    Ok(Stage { text: usd.text, textures: usd.files })
}

/// Properties of a link that UsdPhysics needs.
struct Body<'a> {
    name: &'a str,
    /// Pose of the link in the frame of its robot or object.
    pose: Pose,
    visual: &'a [VisualPart],
    pieces: &'a [Piece],
    mass: &'a MassProperties,
    /// Index of the parent body and the joint to it.
    joint: Option<(usize, Connection<'a>)>,
}

/// A joint of a body to its parent.
struct Connection<'a> {
    name: &'a str,
    /// Frame of the joint in the parent link, which is the frame of the child link at joint position 0.
    parent_from_joint: Pose,
    /// Kind, axis in the joint frame, and range (rad or m); `None` for a fixed joint.
    motion: Option<(JointKind, DVec3, [f64; 2])>,
    /// Damping (N·m·s/rad or N·s/m), stiffness (N·m/rad or N/m), and rest position of the spring (rad or m).
    drive: [f64; 3],
}

impl Writer<'_> {
    fn surfaces(&mut self, scenario: &Scenario) -> Result<(), EncodeError> {
        self.open("Xform", "surfaces", &[], &[]);
        for fixture in fixtures(&scenario.world) {
            self.visual(&fixture.visual)?;
        }
        for surface in &scenario.world.surfaces {
            self.open("Xform", &format!("{}_shape", surface.id), &[], &[]);
            self.placed(&surface.world_from_surface());
            self.pieces(&surface.pieces(), surface.friction);
            self.close();
        }
        self.close();
        Ok(())
    }

    fn robot(&mut self, robot: &RobotModel, positions: &[f64]) -> Result<(), EncodeError> {
        let poses = robot.link_poses(positions, robot.gripper.max_width);
        let body = |(link, pose): (&'_ genmanip_core::RobotLink, Pose)| {
            let motion = link.joint.as_ref().map(|joint| (joint.kind, joint.axis, [joint.lower, joint.upper]));
            let name = link.joint.as_ref().map_or_else(|| link.name.clone(), |joint| joint.name.clone());
            (name, motion, pose)
        };
        let known: Vec<_> = robot.links.iter().zip(poses).map(body).collect();
        let bodies: Vec<Body<'_>> = robot
            .links
            .iter()
            .zip(&known)
            .map(|(link, (joint, motion, pose))| Body {
                name: &link.name,
                pose: *pose,
                visual: &link.visual,
                pieces: &link.pieces,
                mass: &link.mass,
                joint: link.parent.map(|parent| {
                    let connection = Connection {
                        name: joint,
                        parent_from_joint: link.parent_from_link,
                        motion: *motion,
                        drive: [0.0; 3],
                    };
                    (parent, connection)
                }),
            })
            .collect();
        let friction = robot.drives.as_ref().map_or(1.0, |drives| drives.hull_friction);
        self.group(&robot.name, &Pose::IDENTITY, &[], &bodies, friction, true)
    }

    fn object(&mut self, id: &str, pose: &Pose, model: &ObjectModel, positions: &[f64]) -> Result<(), EncodeError> {
        let poses = model.link_poses(positions);
        let bodies: Vec<Body<'_>> = model
            .links
            .iter()
            .zip(poses)
            .map(|(link, pose)| Body {
                name: &link.name,
                pose,
                visual: &link.visual,
                pieces: &link.pieces,
                mass: &link.mass,
                joint: link.joint.as_ref().map(|joint| {
                    let connection = Connection {
                        name: &joint.name,
                        parent_from_joint: joint.parent_from_joint,
                        motion: Some((joint.kind, joint.axis, joint.range)),
                        drive: [joint.damping, joint.stiffness, joint.spring_reference],
                    };
                    (joint.parent, connection)
                }),
            })
            .collect();
        let card = &model.card;
        let facts = [("id", id), ("name", &card.name), ("category", &card.category)];
        self.group(id, pose, &facts, &bodies, model.friction, false)
    }

    /// Writes the bodies of a robot or object and their joints. `facts` become custom attributes; `is_fixed` fixes the
    /// first body to the world.
    fn group(
        &mut self,
        name: &str,
        pose: &Pose,
        facts: &[(&str, &str)],
        bodies: &[Body<'_>],
        friction: f64,
        is_fixed: bool,
    ) -> Result<(), EncodeError> {
        let name = self.open("Xform", name, &[("kind", "\"component\"")], &[]);
        facts.iter().for_each(|(key, value)| self.line(&format!("custom string genmanip:{key} = {}", quoted(value))));
        self.placed(pose);
        let has_joints = bodies.iter().any(|body| body.joint.is_some());
        let mut paths: Vec<String> = Vec::new();
        for (index, body) in bodies.iter().enumerate() {
            let root = (index == 0 && has_joints).then_some("PhysicsArticulationRootAPI");
            let schemas: Vec<&str> = ["PhysicsRigidBodyAPI", "PhysicsMassAPI"].into_iter().chain(root).collect();
            let own = self.open("Xform", body.name, &[], &schemas);
            paths.push(format!("/World/{name}/{own}"));
            self.mass(body.mass);
            self.placed(&body.pose);
            for part in body.visual.iter().filter(|part| !part.render_mesh.triangles.is_empty()) {
                self.visual(part)?;
            }
            self.pieces(body.pieces, friction);
            self.close();
        }
        if is_fixed {
            self.open("PhysicsFixedJoint", "base_joint", &[], &[]);
            self.line(&format!("rel physics:body1 = <{}>", paths[0]));
            self.close();
        }
        for (body, path) in bodies.iter().zip(&paths) {
            if let Some((parent, joint)) = &body.joint {
                self.joint(joint, &paths[*parent], path);
            }
        }
        self.close();
        Ok(())
    }

    fn mass(&mut self, mass: &MassProperties) {
        let (moments, axes) = principal(mass.inertia);
        self.line(&format!("point3f physics:centerOfMass = {}", triple(mass.center)));
        self.line(&format!("float3 physics:diagonalInertia = {}", triple(moments)));
        self.line(&format!("float physics:mass = {}", mass.mass_kg));
        self.line(&format!("quatf physics:principalAxes = {}", quat(axes)));
    }

    fn joint(&mut self, joint: &Connection<'_>, parent: &str, child: &str) {
        let turn = joint.motion.map_or(DQuat::IDENTITY, |(_, axis, _)| DQuat::from_rotation_arc(DVec3::X, axis));
        let (kind, drive) = match joint.motion {
            None => ("PhysicsFixedJoint", None),
            Some((JointKind::Revolute, ..)) => ("PhysicsRevoluteJoint", Some("angular")),
            Some((JointKind::Prismatic, ..)) => ("PhysicsPrismaticJoint", Some("linear")),
        };
        let [damping, stiffness, rest] = joint.drive;
        let applied =
            drive.filter(|_| damping > 0.0 || stiffness > 0.0).map(|drive| format!("PhysicsDriveAPI:{drive}"));
        self.open(kind, joint.name, &[], &applied.iter().map(String::as_str).collect::<Vec<_>>());
        self.line(&format!("rel physics:body0 = <{parent}>"));
        self.line(&format!("rel physics:body1 = <{child}>"));
        let frame = joint.parent_from_joint * Pose { position: DVec3::ZERO, rotation: turn };
        self.line(&format!("point3f physics:localPos0 = {}", triple(frame.position)));
        self.line("point3f physics:localPos1 = (0, 0, 0)");
        self.line(&format!("quatf physics:localRot0 = {}", quat(frame.rotation)));
        self.line(&format!("quatf physics:localRot1 = {}", quat(turn)));
        if let (Some((kind, _, range)), Some(drive)) = (joint.motion, drive) {
            // UsdPhysics has revolute joints in degrees, and their drive gains per degree.
            let unit = if kind == JointKind::Revolute { 1_f64.to_degrees() } else { 1.0 };
            self.line("uniform token physics:axis = \"X\"");
            self.line(&format!("float physics:lowerLimit = {}", range[0] * unit));
            self.line(&format!("float physics:upperLimit = {}", range[1] * unit));
            if applied.is_some() {
                self.line(&format!("float drive:{drive}:physics:damping = {}", damping / unit));
                self.line(&format!("float drive:{drive}:physics:stiffness = {}", stiffness / unit));
                self.line(&format!("float drive:{drive}:physics:targetPosition = {}", rest * unit));
            }
        }
        self.close();
    }

    /// Writes a pinhole camera with the same focal lengths and principal point; distortion is left out.
    fn camera(&mut self, camera: &Camera, world_from_camera: &Pose) {
        let seen = &camera.intrinsics;
        let (width, height) = (f64::from(seen.width), f64::from(seen.height));
        let focal = APERTURE * seen.fx / width;
        let vertical = focal * height / seen.fy;
        // Offset of the image's centre from the optical axis: pixel centres are at integers, and y points up.
        let off = [APERTURE * (0.5 - (seen.cx + 0.5) / width), vertical * ((seen.cy + 0.5) / height - 0.5)];
        self.open("Camera", &camera.name, &[], &[]);
        self.line("float2 clippingRange = (0.01, 20)");
        self.line(&format!("float focalLength = {focal}"));
        self.line(&format!("float horizontalAperture = {APERTURE}"));
        self.line(&format!("float horizontalApertureOffset = {}", off[0]));
        self.line(&format!("float verticalAperture = {vertical}"));
        self.line(&format!("float verticalApertureOffset = {}", off[1]));
        self.placed(&(*world_from_camera * OPTICAL_FROM_USD));
        self.close();
    }
}

/// Principal moments of an inertia tensor, and the rotation `body_from_principal`, by Jacobi rotations.
fn principal(inertia: DMat3) -> (DVec3, DQuat) {
    let (mut m, mut axes) = (inertia, DMat3::IDENTITY);
    for sweep in 0..60 {
        let (p, q) = [(0, 1), (0, 2), (1, 2)][sweep % 3];
        if m.col(q)[p].abs() < 1e-300 {
            continue;
        }
        let angle = 0.5 * (2.0 * m.col(q)[p]).atan2(m.col(q)[q] - m.col(p)[p]);
        let (sin, cos) = angle.sin_cos();
        let mut turn = DMat3::IDENTITY;
        turn.col_mut(p)[p] = cos;
        turn.col_mut(q)[q] = cos;
        turn.col_mut(q)[p] = sin;
        turn.col_mut(p)[q] = -sin;
        m = turn.transpose() * m * turn;
        axes *= turn;
    }
    let moments = DVec3::new(m.x_axis.x, m.y_axis.y, m.z_axis.z);
    (moments, DQuat::from_mat3(&axes).normalize())
}
