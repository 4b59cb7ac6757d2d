//! Assembly of the MJCF text of a scene.
//!
//! Names are stable and readable: bodies `table`, `floor`, `robot/<link>`, `object/<name>/<link>`;
//! joints carry the same prefix; actuators are `arm/<joint>/position`, `arm/<joint>/velocity` and `grip`.
//! The key frame `start` holds the robot at home with the gripper open and every object where it was placed.

mod objects;
mod robot;

use genmanip_core::{MassProperties, Material, Piece, Pose, RobotModel, Shape};

use crate::drive::setpoint_from_width;
use crate::xml::Element;
use crate::{SceneObject, SimSettings};

pub(crate) use objects::{object_body, object_free_joint, object_joint};
pub(crate) use robot::{finger_joint, robot_body, robot_joint};

pub(crate) const TABLE: &str = "table";
pub(crate) const FLOOR: &str = "floor";
pub(crate) const START: &str = "start";
pub(crate) const GRIP: &str = "grip";

/// The table's slab: x 0.15..0.95, y ±0.55, a margin around the usable area; top at z = 0.
const TABLE_CENTER_M: [f64; 3] = [0.55, 0.0, -0.1];
const TABLE_HALF_EXTENTS_M: [f64; 3] = [0.4, 0.55, 0.1];
/// Where things end that leave the table.
const FLOOR_Z_M: f64 = -0.8;

/// What the parts of a scene add to the model.
#[derive(Default)]
struct Parts {
    /// Meshes, shared between equal objects.
    assets: Vec<Element>,
    /// Bodies under the world.
    bodies: Vec<Element>,
    /// Contact exclusions.
    contacts: Vec<Element>,
    tendons: Vec<Element>,
    equalities: Vec<Element>,
    actuators: Vec<Element>,
    /// Start values of the positions, in the order in which the joints are written.
    qpos: Vec<f64>,
    /// Start values of the controls, in the order in which the actuators are written.
    ctrl: Vec<f64>,
}

/// The whole document.
pub(crate) fn assemble(robot: Option<&RobotModel>, objects: &[SceneObject], settings: &SimSettings) -> String {
    let mut parts = Parts::default();
    if let Some(robot) = robot {
        robot::add(&mut parts, robot, settings);
        parts.ctrl.extend(&robot.home);
        parts.ctrl.extend(robot.home.iter().map(|_| 0.0));
        parts.ctrl.push(setpoint_from_width(robot.gripper.max_width, settings));
    }
    objects::add(&mut parts, objects, settings);

    let mut world = Element::new("worldbody")
        .child(Element::new("light").numbers("pos", &[0.5, 0.0, 2.5]).numbers("dir", &[0.0, 0.0, -1.0]))
        .child(slab())
        .child(floor());
    world.extend(parts.bodies);

    let mut root = Element::new("mujoco").text("model", "genmanip");
    root.extend([compiler(), options(settings), size(settings), defaults(settings)]);
    let sections = [
        ("asset", parts.assets),
        ("contact", parts.contacts),
        ("tendon", parts.tendons),
        ("equality", parts.equalities),
        ("actuator", parts.actuators),
    ];
    root.push(world);
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
    Element::new("compiler").text("angle", "radian").text("autolimits", "true").text("inertiafromgeom", "false")
}

fn options(settings: &SimSettings) -> Element {
    Element::new("option")
        .number("timestep", settings.timestep_s())
        .numbers("gravity", &[0.0, 0.0, -settings.gravity])
        .text("integrator", "implicitfast")
        .text("cone", "elliptic")
        .number("impratio", settings.impedance_ratio)
        .text("solver", "Newton")
        .number("iterations", f64::from(settings.solver_iterations))
        // A diverged simulation is an error of ours, not something to reset silently.
        .child(Element::new("flag").text("autoreset", "disable"))
}

fn size(settings: &SimSettings) -> Element {
    Element::new("size").text("memory", &format!("{}M", settings.arena_mib))
}

fn defaults(settings: &SimSettings) -> Element {
    let [turning, rolling] = settings.object_rotational_friction;
    let fixed = |name: &str, friction: f64, rgba: [f64; 4]| {
        Element::new("default")
            .text("class", name)
            .child(Element::new("geom").numbers("friction", &[friction, turning, rolling]).numbers("rgba", &rgba))
    };
    let mut defaults = Element::new("default").child(
        Element::new("geom")
            .number("condim", 4.0)
            .numbers("solref", &settings.contact_solref)
            .numbers("solimp", &settings.contact_solimp),
    );
    defaults.push(fixed("fixed", settings.table_friction, [0.8, 0.78, 0.74, 1.0]));
    defaults.push(fixed("robot", settings.robot_friction, [0.9, 0.9, 0.9, 1.0]));
    defaults.push(
        Element::new("default").text("class", "pad").child(
            Element::new("geom")
                .number("condim", 4.0)
                .number("priority", 1.0)
                .numbers("friction", &settings.pad_friction)
                .numbers("solref", &settings.pad_solref)
                .numbers("solimp", &settings.pad_solimp)
                .numbers("rgba", &[0.2, 0.2, 0.2, 1.0]),
        ),
    );
    // Six contact dimensions: without rolling friction a ball would never come to rest.
    defaults.push(Element::new("default").text("class", "object").child(Element::new("geom").number("condim", 6.0)));
    defaults
}

fn slab() -> Element {
    Element::named("body", TABLE).numbers("pos", &TABLE_CENTER_M).child(
        Element::named("geom", TABLE).text("class", "fixed").text("type", "box").numbers("size", &TABLE_HALF_EXTENTS_M),
    )
}

fn floor() -> Element {
    Element::named("body", FLOOR).numbers("pos", &[0.0, 0.0, FLOOR_Z_M]).child(
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

/// The geometry of a piece; a hull refers to the mesh of the given name.
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

/// The mesh a hull needs; the engine takes the convex hull of its points.
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
