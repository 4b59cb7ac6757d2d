//! Assembly of a scene's MJCF text.
//!
//! Names are stable and readable: bodies `table`, `surface/<id>` (further support surfaces), `floor`, `robot/<link>`
//! and `object/<name>/<link>`; joints `robot/<joint>` and `object/<name>/<joint>`; an object's free joint
//! `object/<name>`; actuators `arm/<joint>/position`, `arm/<joint>/velocity` and `grip`.
//! The keyframe `start` holds the robot at its start position with the gripper open, and every object at its initial
//! pose.

mod objects;
mod robot;

use genmanip_core::glam::DVec3;
use genmanip_core::{MassProperties, Material, Piece, Pose, RobotModel, Shape, SupportSurface, World};

use crate::SceneObject;
use crate::drive::setpoint_from_width;
use crate::engine_settings::CheckedSettings;
use crate::xml::Element;

pub(crate) use objects::{object_body, object_free_joint, object_joint};
pub(crate) use robot::{finger_joint, robot_body, robot_joint};

pub(crate) const TABLE: &str = "table";
pub(crate) const FLOOR: &str = "floor";
pub(crate) const START: &str = "start";
pub(crate) const GRIP: &str = "grip";

/// Model elements collected from robot and objects.
#[derive(Default)]
struct Parts {
    /// Meshes, shared between equal objects.
    assets: Vec<Element>,
    /// Bodies directly under the world body.
    bodies: Vec<Element>,
    /// Pairs of bodies excluded from contact.
    contacts: Vec<Element>,
    tendons: Vec<Element>,
    equalities: Vec<Element>,
    actuators: Vec<Element>,
    /// Initial `qpos` of all joints, in joint order.
    qpos: Vec<f64>,
    /// Initial controls, in actuator order.
    ctrl: Vec<f64>,
}

/// Assembles the MJCF document of a scene.
pub(crate) fn assemble(
    world: &World,
    robot: Option<&RobotModel>,
    objects: &[SceneObject],
    payload: Option<&MassProperties>,
    settings: &CheckedSettings,
) -> String {
    let mut parts = Parts::default();
    if let Some((robot, drives)) = robot.zip(settings.drives.as_ref()) {
        let start = world.robot.start.as_deref().unwrap_or(&robot.home);
        robot::add(&mut parts, robot, start, settings, drives, payload);
        parts.ctrl.extend(start);
        parts.ctrl.extend(robot.home.iter().map(|_| 0.0));
        parts.ctrl.push(setpoint_from_width(robot.gripper.max_width, drives));
    }
    objects::add(&mut parts, objects, settings);

    let table_friction = world.table().map_or(0.0, |table| table.friction);
    let mut bodies = Element::new("worldbody")
        .child(Element::new("light").numbers("pos", &[0.5, 0.0, 2.5]).numbers("dir", &[0.0, 0.0, -1.0]));
    for (index, fixed) in world.surfaces.iter().enumerate() {
        let own_friction = Some(fixed.friction).filter(|own| *own != table_friction);
        bodies.push(surface(fixed, index, settings, own_friction));
        if index == 0 {
            bodies.push(floor(world.floor_z_m));
        }
    }
    bodies.extend(parts.bodies);

    let mut root = Element::new("mujoco").text("model", "genmanip");
    root.extend([compiler(), options(settings), size(settings), defaults(settings, table_friction)]);
    let sections = [
        ("asset", parts.assets),
        ("contact", parts.contacts),
        ("tendon", parts.tendons),
        ("equality", parts.equalities),
        ("actuator", parts.actuators),
    ];
    root.push(bodies);
    for (tag, elements) in sections {
        if !elements.is_empty() {
            let mut section = Element::new(tag);
            section.extend(elements);
            root.push(section);
        }
    }
    let mut key = Element::named("key", START).numbers("qpos", &parts.qpos);
    if !parts.ctrl.is_empty() {
        key = key.numbers("ctrl", &parts.ctrl);
    }
    root.push(Element::new("keyframe").child(key));
    root.render()
}

fn compiler() -> Element {
    Element::new("compiler")
        .text("angle", "radian")
        .text("autolimits", "true")
        .text("inertiafromgeom", "false")
        // Where no thread can be created, the engine's compiler throws an exception, which terminates the process.
        .text("usethread", "false")
}

fn options(CheckedSettings { physics, engine, .. }: &CheckedSettings) -> Element {
    Element::new("option")
        .number("timestep", physics.timestep_s())
        .numbers("gravity", &[0.0, 0.0, -physics.gravity_m_s2])
        .text("integrator", "implicitfast")
        .text("cone", "elliptic")
        .number("impratio", engine.impedance_ratio)
        .text("solver", "Newton")
        .number("iterations", f64::from(engine.solver_iterations))
        // Divergence must be an error, but the engine would reset the state silently.
        .child(Element::new("flag").text("autoreset", "disable"))
}

fn size(settings: &CheckedSettings) -> Element {
    Element::new("size").text("memory", &format!("{}M", settings.engine.arena_mib))
}

fn defaults(CheckedSettings { physics, engine, drives }: &CheckedSettings, table_friction: f64) -> Element {
    let [turning, rolling] = physics.rotational_friction_m;
    let fixed = |name: &str, friction: f64, rgba: [f64; 4]| {
        Element::new("default")
            .text("class", name)
            .child(Element::new("geom").numbers("friction", &[friction, turning, rolling]).numbers("rgba", &rgba))
    };
    let mut defaults = Element::new("default").child(
        Element::new("geom")
            .number("condim", 4.0)
            .numbers("solref", &engine.contact_solref)
            .numbers("solimp", &engine.contact_solimp),
    );
    defaults.push(fixed("fixed", table_friction, [0.8, 0.78, 0.74, 1.0]));
    if let Some(drives) = drives {
        defaults.push(fixed("robot", drives.hull_friction, [0.9, 0.9, 0.9, 1.0]));
        defaults.push(
            Element::new("default").text("class", "pad").child(
                Element::new("geom")
                    .number("condim", 4.0)
                    .number("priority", 1.0)
                    .numbers("friction", &drives.pad_friction)
                    .numbers("solref", &engine.pad_solref)
                    .numbers("solimp", &engine.pad_solimp)
                    .numbers("rgba", &[0.2, 0.2, 0.2, 1.0]),
            ),
        );
    }
    // Six contact dimensions: without rolling friction a ball would never come to rest.
    defaults.push(Element::new("default").text("class", "object").child(Element::new("geom").number("condim", 6.0)));
    defaults
}

/// Body of a support surface, fixed, with its frame centred in the slab.
fn surface(surface: &SupportSurface, index: usize, settings: &CheckedSettings, friction: Option<f64>) -> Element {
    let name = surface_body(surface, index);
    let slab_from_surface = DVec3::Z * (surface.size_m.z * 0.5);
    let center = surface.top_center_m - slab_from_surface;
    let mut body = Element::named("body", &name).numbers("pos", &center.to_array());
    if surface.yaw_rad != 0.0 {
        body = body.numbers("quat", &surface.world_from_surface().to_wxyz_array());
    }
    let [turning, rolling] = settings.physics.rotational_friction_m;
    let fixed = |name: &str, half_extents: DVec3| {
        let geom = Element::named("geom", name)
            .text("class", "fixed")
            .text("type", "box")
            .numbers("size", &half_extents.to_array());
        match friction {
            Some(sliding) => geom.numbers("friction", &[sliding, turning, rolling]),
            None => geom,
        }
    };
    body.push(fixed(&name, surface.size_m * 0.5));
    for (number, board) in surface.boards.iter().enumerate() {
        let center = board.center_m + slab_from_surface;
        let geom = fixed(&format!("{name}/{}", number + 1), board.size_m * 0.5);
        body.push(geom.numbers("pos", &center.to_array()));
    }
    body
}

/// Body name of a support surface: `table` for the world's first one, `surface/<id>` for the others.
pub(crate) fn surface_body(surface: &SupportSurface, index: usize) -> String {
    if index == 0 { TABLE.into() } else { format!("surface/{}", surface.id) }
}

fn floor(z_m: f64) -> Element {
    Element::named("body", FLOOR).numbers("pos", &[0.0, 0.0, z_m]).child(
        Element::named("geom", FLOOR).text("class", "fixed").text("type", "plane").numbers("size", &[3.0, 3.0, 0.1]),
    )
}

fn with_pose(element: Element, outer_from_inner: &Pose) -> Element {
    element.numbers("pos", &outer_from_inner.position.to_array()).numbers("quat", &outer_from_inner.to_wxyz_array())
}

fn inertial(mass: &MassProperties) -> Element {
    let i = mass.inertia;
    Element::new("inertial")
        .numbers("pos", &mass.center.to_array())
        .number("mass", mass.mass_kg)
        .numbers("fullinertia", &[i.x_axis.x, i.y_axis.y, i.z_axis.z, i.y_axis.x, i.z_axis.x, i.z_axis.y])
}

/// The geom of a piece; a hull refers to the mesh asset of the given name.
fn geom(name: &str, class: &'static str, piece: &Piece, mesh: &str) -> Element {
    let geom = with_pose(Element::named("geom", name).text("class", class), &piece.link_from_piece);
    match &piece.shape {
        Shape::Box { half_extents } => geom.text("type", "box").numbers("size", &half_extents.to_array()),
        Shape::Sphere { radius } => geom.text("type", "sphere").number("size", *radius),
        Shape::Ellipsoid { radii } => geom.text("type", "ellipsoid").numbers("size", &radii.to_array()),
        Shape::Cylinder { radius, half_height } => {
            geom.text("type", "cylinder").numbers("size", &[*radius, *half_height])
        }
        Shape::Capsule { radius, half_length } => {
            geom.text("type", "capsule").numbers("size", &[*radius, *half_length])
        }
        Shape::Hull { .. } => geom.text("type", "mesh").text("mesh", mesh),
    }
}

/// Mesh asset of a hull, whose convex hull the engine computes from the points; `None` for other shapes.
fn mesh(piece: &Piece, name: &str) -> Option<Element> {
    let Shape::Hull { points } = &piece.shape else { return None };
    let numbers: Vec<f64> = points.iter().flat_map(|point| point.to_array()).collect();
    Some(Element::named("mesh", name).text("inertia", "convex").numbers("vertex", &numbers))
}

fn color(material: Option<&Material>) -> [f64; 4] {
    material.map_or([0.6, 0.6, 0.6, 1.0], |material| {
        let [r, g, b] = material.base_color.map(f64::from);
        [r, g, b, f64::from(material.opacity)]
    })
}
