//! Objects: descriptions, links and joints.

use std::sync::Arc;

use glam::{DMat3, DVec3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{Aabb, AssetRef, AssetUid, Piece, Pose, Shape, VisualPart};

/// Description of an object for people and language models.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ObjectCard {
    /// Uid of the asset; instance ids derive from it.
    pub uid: AssetUid,
    /// The asset that the card describes.
    pub asset: AssetRef,
    /// Short name, e.g. `Red Mug`.
    pub name: String,
    /// Description of the object in one sentence.
    pub description: String,
    /// Category, e.g. `mug`.
    pub category: String,
    /// Super-category, e.g. `tableware`.
    pub general_category: String,
    /// Colour words, most prominent first.
    pub colors: Vec<String>,
    /// Words for the materials, e.g. `ceramic`.
    pub materials: Vec<String>,
    /// Description of the shape in words, e.g. `cylinder with handle`.
    pub shape: String,
    /// Axis-aligned size in the canonical pose, m.
    #[schemars(with = "[f64; 3]")]
    pub size_m: DVec3,
    /// Mass, kg.
    pub mass_kg: f64,
    /// True if it has a cavity or rim that holds other objects.
    pub is_container: bool,
    /// True if it has joints; such objects are never carried.
    pub is_articulated: bool,
    /// Names of the states, empty for a rigid object.
    pub states: Vec<String>,
    /// True if the whole object can be grasped by an 8 cm gripper.
    pub can_grasp: bool,
    /// Further facts for instructions and search, each optional.
    #[serde(default, skip_serializing_if = "Annotations::is_empty")]
    pub annotations: Annotations,
}

/// Optional annotations of an asset; empty or `None` where nothing is known.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Annotations {
    /// Referring expressions for its appearance that avoid its name, e.g. `glossy red cup`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub looks: Vec<String>,
    /// Size of the cavity that objects can lie in, derived from the geometry; none for an articulated object.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub room: Option<CavitySize>,
    /// True if it breaks when dropped or squeezed.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub fragile: bool,
    /// True if it must stay upright while carried, e.g. because it is filled.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub upright_only: bool,
    /// Affordances, e.g. `pour`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub affordances: Vec<String>,
}

/// Inner size of a cavity.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CavitySize {
    /// Extent of the cavity along x and y at half height, metres.
    pub inside_m: [f64; 2],
    /// Depth of the cavity, metres.
    pub depth_m: f64,
}

impl Annotations {
    /// True if no annotation is set.
    pub fn is_empty(&self) -> bool {
        *self == Self::default()
    }
}

impl CavitySize {
    /// Size of a convex cavity in the object's frame; `None` if its height is zero.
    pub fn of_cavity(cavity: &Piece) -> Option<Self> {
        let along = |direction: DVec3| cavity.support(direction).dot(direction);
        let (low, high) = (-along(DVec3::NEG_Z), along(DVec3::Z));
        let middle = 0.5 * (low + high);
        let [x, y] = match &cavity.shape {
            Shape::Hull { points } => {
                let points = points.iter().map(|point| cavity.link_from_piece.transform_point(*point));
                let (above, below): (Vec<DVec3>, Vec<DVec3>) = points.partition(|point| point.z >= middle);
                // Segments between upper and lower corners: edges cut the plane at its outline, all others inside.
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

/// A complete object model for simulation, rendering and planning.
///
/// The object's frame has its origin at the centre of the base in the canonical pose, +z up; the front of an
/// articulated object faces -x.
#[derive(Clone, Debug)]
pub struct ObjectModel {
    /// Description of the object for people and language models.
    pub card: ObjectCard,
    /// Family that generated it, e.g. `mug`.
    pub family: String,
    /// The asset, fully specified with version and seed.
    pub asset: AssetRef,
    /// Bodies, parents first; a rigid object has exactly one.
    pub links: Vec<ObjectLink>,
    /// Sliding friction coefficient against the same surface.
    pub friction: f64,
    /// Joint intervals of each state listed in the card.
    pub joint_states: Vec<JointState>,
}

/// A rigid body of an object.
#[derive(Clone, Debug)]
pub struct ObjectLink {
    /// Name, unique in the object.
    pub name: String,
    /// Joint to the parent; `None` for the root.
    pub joint: Option<Joint>,
    /// Meshes with materials, for rendering.
    pub visual: Vec<VisualPart>,
    /// Convex pieces for collision, in the link's frame.
    pub pieces: Vec<Piece>,
    /// Convex regions in the link's frame in which an object counts as *in* this object; they move with the link.
    pub cavity: Vec<Piece>,
    /// Mass, centre of mass and inertia of the link.
    pub mass: MassProperties,
}

/// A joint between a link and its parent.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Joint {
    /// Name, unique in the object.
    pub name: String,
    /// Index of the parent link.
    pub parent: usize,
    /// Revolute or prismatic.
    pub kind: JointKind,
    /// Joint frame in the parent's frame; equals the child's frame at position 0.
    pub parent_from_joint: Pose,
    /// Unit axis in the joint frame.
    pub axis: DVec3,
    /// Smallest and largest position, rad or m.
    pub range: [f64; 2],
    /// Viscous damping, N·s/m or N·m·s/rad.
    pub damping: f64,
    /// Dry friction, N or N·m.
    pub friction_loss: f64,
    /// Spring towards `spring_reference`, N/m or N·m/rad; 0 for no spring.
    pub stiffness: f64,
    /// Rest position of the spring, rad or m.
    pub spring_reference: f64,
}

/// Kind of a joint, which has one degree of freedom.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum JointKind {
    /// Rotates about its axis.
    Revolute,
    /// Slides along its axis.
    Prismatic,
}

/// A named state: every listed joint lies in its interval.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct JointState {
    /// Name of the state, one of [`ObjectCard::states`].
    pub name: String,
    /// Names of joints, each with the closed interval of its position, rad or m.
    pub intervals: Vec<(String, [f64; 2])>,
    /// Representative position of each listed joint, rad or m, used to set the state.
    pub nominal: Vec<f64>,
}

/// Mass, centre of mass and inertia in the link's frame.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MassProperties {
    /// Mass, kg.
    pub mass_kg: f64,
    /// Centre of mass, m.
    pub center: DVec3,
    /// Inertia about the centre of mass in the link's axes, kg·m².
    pub inertia: DMat3,
}

impl ObjectModel {
    /// The same object, rendered with its full-resolution meshes.
    pub fn with_full_meshes(&self) -> Self {
        let mut model = self.clone();
        for part in model.links.iter_mut().flat_map(|link| &mut link.visual) {
            part.render_mesh = Arc::clone(&part.mesh);
        }
        model
    }

    /// Number of joints that can move.
    pub fn joint_count(&self) -> usize {
        self.links.iter().filter(|link| link.joint.is_some()).count()
    }

    /// `object_from_link` for each link, given joint positions in link order.
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

    /// True if any link has a cavity.
    pub fn is_hollow(&self) -> bool {
        self.links.iter().any(|link| !link.cavity.is_empty())
    }

    /// Collision pieces of all links in the object's frame, given joint positions in link order.
    pub fn pieces(&self, joint_positions: &[f64]) -> Vec<Piece> {
        self.placed(joint_positions, |link| &link.pieces)
    }

    /// Cavities of all links in the object's frame, given joint positions in link order.
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

    /// Bounds of the visual meshes in the object's frame, given joint positions in link order.
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

    /// Exact bounds of the visual meshes in the world frame, given joint positions in link order.
    pub fn world_bounds(&self, world_from_object: &Pose, joint_positions: &[f64]) -> Aabb {
        self.links.iter().zip(self.link_poses(joint_positions)).fold(Aabb::EMPTY, |bounds, (link, object_from_link)| {
            bounds.union(&Aabb::from_pieces(&(*world_from_object * object_from_link), &link.pieces))
        })
    }
}

impl JointKind {
    /// `joint_from_child` of a joint about or along a unit axis at a position, rad or m.
    pub fn motion(self, axis: DVec3, position: f64) -> Pose {
        match self {
            Self::Revolute => Pose { position: DVec3::ZERO, rotation: glam::DQuat::from_axis_angle(axis, position) },
            Self::Prismatic => Pose::from_position(axis * position),
        }
    }
}

impl Joint {
    /// `joint_from_child` at a position.
    pub fn motion(&self, position: f64) -> Pose {
        self.kind.motion(self.axis, position)
    }
}
