//! Objects: how people name them, what they are made of, and how they move.

use std::sync::Arc;

use glam::{DMat3, DVec3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{Aabb, AssetRef, Piece, Pose, Shape, VisualPart};

/// What a person or a language model is told about an object.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ObjectCard {
    /// What people and files call the asset; its instances are named after it.
    pub uid: String,
    /// The asset that the card describes.
    pub asset: AssetRef,
    /// Short name, e.g. `Red Mug`.
    pub name: String,
    /// One sentence.
    pub description: String,
    /// Kind of thing, e.g. `mug`.
    pub category: String,
    /// Group of kinds, e.g. `tableware`.
    pub general_category: String,
    /// Colour words, most visible first.
    pub colors: Vec<String>,
    /// Material words.
    pub materials: Vec<String>,
    /// Shape in words.
    pub shape: String,
    /// Axis-aligned size in the canonical pose.
    #[schemars(with = "[f64; 3]")]
    pub size_m: DVec3,
    /// Mass.
    pub mass_kg: f64,
    /// Whether it has a hollow or a rim that holds other things.
    pub is_container: bool,
    /// Whether it has joints; such objects are never carried.
    pub is_articulated: bool,
    /// Names of the states, empty for a rigid object.
    pub states: Vec<String>,
    /// Whether the whole object can be picked up by an 8 cm hand.
    pub can_grasp: bool,
    /// What else is known of it.
    #[serde(default, skip_serializing_if = "Annotations::is_empty")]
    pub annotations: Annotations,
}

/// What is known of an asset besides what everything has; nothing by default.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Annotations {
    /// Expressions for its looks that avoid its name, e.g. `glossy red cup`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub looks: Vec<String>,
    /// The hollow that things can lie in, derived from the geometry; none in an articulated object.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub room: Option<Room>,
    /// Whether it breaks when it is dropped or squeezed.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub fragile: bool,
    /// Whether it must stay upright while it is carried, e.g. because it is filled.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub upright_only: bool,
    /// What can be done with it, e.g. `pour`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub affordances: Vec<String>,
}

/// Room in a hollow.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Room {
    /// Extent of the hollow along x and y at mid height, metres.
    pub inside_m: [f64; 2],
    /// Depth of the hollow, metres.
    pub depth_m: f64,
}

impl Annotations {
    /// Whether nothing is known.
    pub fn is_empty(&self) -> bool {
        *self == Self::default()
    }
}

impl Room {
    /// The room in a convex cavity in the object's frame; `None` without height.
    pub fn of_cavity(cavity: &Piece) -> Option<Self> {
        let along = |direction: DVec3| cavity.support(direction).dot(direction);
        let (low, high) = (-along(DVec3::NEG_Z), along(DVec3::Z));
        let middle = 0.5 * (low + high);
        let [x, y] = match &cavity.shape {
            Shape::Hull { points } => {
                let points = points.iter().map(|point| cavity.link_from_piece.transform_point(*point));
                let (above, below): (Vec<DVec3>, Vec<DVec3>) = points.partition(|point| point.z >= middle);
                // Every corner of the cut lies on an edge, and every other segment cuts within.
                let cuts = above.iter().flat_map(|up| below.iter().map(move |down| (up, down)));
                let cuts = cuts.map(|(up, down)| down.lerp(*up, (middle - down.z) / (up.z - down.z)));
                let bounds = Aabb::from_points(cuts);
                [bounds.size().x, bounds.size().y]
            }
            _ => [DVec3::X, DVec3::Y].map(|axis| along(axis) + along(-axis)),
        };
        let depth_m = high - low;
        (depth_m > 0.0).then_some(Self { inside_m: [x, y], depth_m })
    }
}

/// An object as the simulator, the renderer and the planner need it.
///
/// The object's frame has its origin at the centre of the base in the canonical pose, +z up,
/// the front of an articulated object towards -x.
#[derive(Clone, Debug)]
pub struct ObjectModel {
    /// Annotations.
    pub card: ObjectCard,
    /// Family of the generator that made it, e.g. `mug`.
    pub family: String,
    /// The asset, as precisely as can be: with the version and seed that were used.
    pub asset: AssetRef,
    /// Bodies, parents first; a rigid object has exactly one.
    pub links: Vec<ObjectLink>,
    /// Sliding friction coefficient against a like surface.
    pub friction: f64,
    /// What each state in the card means for the joints.
    pub joint_states: Vec<JointState>,
}

/// One rigid body of an object.
#[derive(Clone, Debug)]
pub struct ObjectLink {
    /// Name, unique in the object.
    pub name: String,
    /// Index of the parent and the joint that connects to it; `None` for the root.
    pub joint: Option<Joint>,
    /// Surfaces to draw.
    pub visual: Vec<VisualPart>,
    /// Exact convex collision bodies.
    pub pieces: Vec<Piece>,
    /// Convex regions in the link's frame in which something counts as *in* the object; they move with the link.
    pub cavity: Vec<Piece>,
    /// Mass, centre and inertia.
    pub mass: MassProperties,
}

/// How one link moves against its parent.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Joint {
    /// Name, unique in the object.
    pub name: String,
    /// Index of the parent link.
    pub parent: usize,
    /// Turning or sliding.
    pub kind: JointKind,
    /// Joint frame in the parent's frame; the child's frame coincides with it at position 0.
    pub parent_from_joint: Pose,
    /// Unit axis in the joint frame.
    pub axis: DVec3,
    /// Smallest and largest position, radians or metres.
    pub range: [f64; 2],
    /// Viscous damping, N·s/m or N·m·s/rad.
    pub damping: f64,
    /// Dry friction, N or N·m.
    pub friction_loss: f64,
    /// Spring towards `spring_reference`, N/m or N·m/rad; 0 without spring.
    pub stiffness: f64,
    /// Rest position of the spring.
    pub spring_reference: f64,
}

/// Turning or sliding.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum JointKind {
    /// Turns about its axis.
    Revolute,
    /// Slides along its axis.
    Prismatic,
}

/// A named state: every listed joint lies in its interval.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct JointState {
    /// One of the card's states.
    pub name: String,
    /// Joint name and the closed interval of its position.
    pub intervals: Vec<(String, [f64; 2])>,
    /// A position per listed joint to put the object into that state.
    pub nominal: Vec<f64>,
}

/// Mass, its centre and the inertia about that centre, in the link's frame.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MassProperties {
    /// Mass.
    pub mass_kg: f64,
    /// Centre of mass.
    pub center: DVec3,
    /// Inertia about the centre, axes of the link, kg·m².
    pub inertia: DMat3,
}

impl ObjectModel {
    /// The same object, drawn by all triangles that judges measure.
    pub fn drawn_as_measured(&self) -> Self {
        let mut model = self.clone();
        for part in model.links.iter_mut().flat_map(|link| &mut link.visual) {
            part.drawn = Arc::clone(&part.mesh);
        }
        model
    }

    /// Number of movable joints.
    pub fn joint_count(&self) -> usize {
        self.links.iter().filter(|link| link.joint.is_some()).count()
    }

    /// `object_from_link` for each link, given a position for each joint in the order of the links.
    pub fn link_poses(&self, joint_positions: &[f64]) -> Vec<Pose> {
        let mut poses: Vec<Pose> = Vec::with_capacity(self.links.len());
        let mut positions = joint_positions.iter().copied();
        for link in &self.links {
            let pose = match &link.joint {
                None => Pose::IDENTITY,
                Some(joint) => {
                    let parent = poses.get(joint.parent).copied().unwrap_or_default();
                    parent * joint.parent_from_joint * joint.motion(positions.next().unwrap_or(0.0))
                }
            };
            poses.push(pose);
        }
        poses
    }

    /// Whether anything counts as in the object anywhere.
    pub fn is_hollow(&self) -> bool {
        self.links.iter().any(|link| !link.cavity.is_empty())
    }

    /// The collision pieces of all links in the object's frame, given a position for each joint in the order of the links.
    pub fn pieces(&self, joint_positions: &[f64]) -> Vec<Piece> {
        self.placed(joint_positions, |link| &link.pieces)
    }

    /// The cavities of all links in the object's frame, given a position for each joint in the order of the links.
    pub fn cavities(&self, joint_positions: &[f64]) -> Vec<Piece> {
        self.placed(joint_positions, |link| &link.cavity)
    }

    fn placed(&self, joint_positions: &[f64], of: impl Fn(&ObjectLink) -> &[Piece]) -> Vec<Piece> {
        let mut placed = Vec::new();
        for (link, object_from_link) in self.links.iter().zip(self.link_poses(joint_positions)) {
            placed.extend(of(link).iter().map(|piece| Piece {
                shape: piece.shape.clone(),
                link_from_piece: object_from_link * piece.link_from_piece,
            }));
        }
        placed
    }

    /// Bounds in the object's frame of what is drawn of it, given a position for each joint in the order of the links.
    pub fn visual_bounds(&self, joint_positions: &[f64]) -> Aabb {
        let links = self.links.iter().zip(self.link_poses(joint_positions));
        let corners = links.flat_map(|(link, object_from_link)| {
            link.visual.iter().flat_map(move |part| {
                let object_from_part = object_from_link * part.link_from_part;
                part.mesh.positions.iter().map(move |corner| object_from_part.transform_point(corner.as_dvec3()))
            })
        });
        Aabb::from_points(corners)
    }

    /// Exact bounds in the world.
    pub fn world_bounds(&self, world_from_object: &Pose, joint_positions: &[f64]) -> Aabb {
        self.links.iter().zip(self.link_poses(joint_positions)).fold(Aabb::EMPTY, |bounds, (link, object_from_link)| {
            bounds.union(&Aabb::from_pieces(&(*world_from_object * object_from_link), &link.pieces))
        })
    }
}

impl Joint {
    /// `joint_from_child` at a position.
    pub fn motion(&self, position: f64) -> Pose {
        match self.kind {
            JointKind::Revolute => {
                Pose { position: DVec3::ZERO, rotation: glam::DQuat::from_axis_angle(self.axis, position) }
            }
            JointKind::Prismatic => Pose::from_position(self.axis * position),
        }
    }
}
