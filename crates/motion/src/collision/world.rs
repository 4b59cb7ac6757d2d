//! Obstacles, attached object and allowed contacts.

use std::sync::Arc;

use genmanip_core::{Piece, Pose};
use glam::DVec3;

use super::body::MovingBody;
use super::convex::{Convex, GeometryError};
use super::cover::{CoverBall, cover};
use super::mesh::mesh;
use super::narrow::Skeleton;
use super::points::{SurfaceError, cloud};
use super::probe::FacePlanes;
use super::surface::Surface;
use crate::rigid::Rigid;

/// Named obstacles in the world frame.
///
/// ```
/// use genmanip_core::{Piece, Pose, Shape, glam::DVec3};
/// use genmanip_motion::CollisionWorld;
///
/// let mut world = CollisionWorld::new();
/// let slab = Piece::at(DVec3::new(0.0, 0.0, -0.02), Shape::Box { half_extents: DVec3::new(0.5, 0.5, 0.02) });
/// world.add("table", &[slab], &Pose::from_position(DVec3::new(0.55, 0.0, 0.0)))?;
/// assert_eq!(world.names().collect::<Vec<_>>(), ["table"]);
/// # Ok::<(), genmanip_motion::GeometryError>(())
/// ```
#[derive(Clone, Debug, Default)]
pub struct CollisionWorld {
    pub(crate) obstacles: Vec<Obstacle>,
}

/// One obstacle: convex pieces with a pose, or a surface, world frame.
#[derive(Clone, Debug)]
pub(crate) struct Obstacle {
    pub(crate) name: String,
    pub(crate) pieces: Vec<Convex>,
    pub(crate) world_from_obstacle: Rigid,
    pub(crate) surface: Option<Arc<Surface>>,
}

/// An object held by the gripper, rigidly attached to the TCP; checked against obstacles and links.
#[derive(Clone, Debug)]
pub struct Attached {
    pub(crate) name: String,
    pub(crate) pieces: Vec<Convex>,
    /// Sphere cover, object frame.
    pub(crate) cover: Vec<CoverBall>,
    pub(crate) skeletons: Vec<Skeleton>,
    pub(crate) planes: Vec<FacePlanes>,
    pub(crate) tcp_from_object: Rigid,
}

/// Pairs of a moving body and an obstacle that may touch and are not checked (allowed collision matrix).
///
/// For example, gripper and grasped object, or carried object and its support.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct AllowedCollisions {
    pairs: Vec<(MovingBody, String)>,
    /// Names of obstacles ignored entirely.
    ignored: Vec<String>,
}

impl CollisionWorld {
    /// A world without obstacles.
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds or replaces an obstacle; `pieces` are in the obstacle frame.
    pub fn add(&mut self, name: &str, pieces: &[Piece], world_from_obstacle: &Pose) -> Result<(), GeometryError> {
        self.put(Obstacle {
            name: name.to_owned(),
            pieces: Convex::all(name, pieces)?,
            world_from_obstacle: finite_pose(name, world_from_obstacle)?,
            surface: None,
        });
        Ok(())
    }

    /// Adds or replaces a point cloud: spheres of `radius_m` around `points` (world frame).
    ///
    /// The acceleration structure is built once and shared by clones of the world. A cloud is checked like any other
    /// obstacle; near the start and goal of a motion single points may be as close as they are there, all others keep
    /// the padding.
    ///
    /// # Errors
    /// Fails if the cloud is empty, not finite or larger than a million points, or if the radius is out of range.
    pub fn add_points(&mut self, name: &str, points: &[DVec3], radius_m: f64) -> Result<(), SurfaceError> {
        self.put_surface(name, cloud(name, points, radius_m)?);
        Ok(())
    }

    /// Adds or replaces a triangle mesh; `corners` are vertices in the mesh frame, three indices per triangle.
    ///
    /// Only its surface is an obstacle: a robot that starts inside a closed mesh may move there. The acceleration
    /// structure is built once and shared by clones of the world.
    ///
    /// # Errors
    /// Fails if the mesh is empty, not finite or larger than a million triangles, a vertex is missing, or a triangle is
    /// degenerate.
    pub fn add_mesh(
        &mut self,
        name: &str,
        corners: &[DVec3],
        triangles: &[[u32; 3]],
        world_from_mesh: &Pose,
    ) -> Result<(), SurfaceError> {
        self.put_surface(name, mesh(name, corners, triangles, world_from_mesh)?);
        Ok(())
    }

    fn put_surface(&mut self, name: &str, surface: Arc<Surface>) {
        let (name, surface) = (name.to_owned(), Some(surface));
        self.put(Obstacle { name, pieces: vec![], world_from_obstacle: Rigid::IDENTITY, surface });
    }

    fn put(&mut self, obstacle: Obstacle) {
        match self.obstacles.iter_mut().find(|other| other.name == obstacle.name) {
            Some(slot) => *slot = obstacle,
            None => self.obstacles.push(obstacle),
        }
    }

    /// Number of points or triangles of an obstacle; `None` if it is no cloud or mesh, or unknown.
    pub fn facet_count(&self, name: &str) -> Option<usize> {
        let obstacle = self.obstacles.iter().find(|obstacle| obstacle.name == name)?;
        obstacle.surface.as_ref().map(|surface| surface.facet_count())
    }

    /// Removes an obstacle; returns true if it existed.
    pub fn remove(&mut self, name: &str) -> bool {
        let before = self.obstacles.len();
        self.obstacles.retain(|obstacle| obstacle.name != name);
        self.obstacles.len() < before
    }

    /// Obstacle names in insertion order.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.obstacles.iter().map(|obstacle| obstacle.name.as_str())
    }
}

impl Attached {
    /// Attaches an object with frame at `tcp_from_object`; `pieces` are in the object frame.
    pub fn new(name: &str, pieces: &[Piece], tcp_from_object: &Pose) -> Result<Self, GeometryError> {
        let tcp_from_object = finite_pose(name, tcp_from_object)?;
        let pieces = Convex::all(name, pieces)?;
        let cover = pieces.iter().flat_map(cover).collect();
        let skeletons = pieces.iter().map(Skeleton::new).collect();
        let planes = pieces.iter().map(FacePlanes::new).collect();
        Ok(Self { name: name.to_owned(), pieces, cover, skeletons, planes, tcp_from_object })
    }

    /// Name of the object, as in collision reports.
    pub fn name(&self) -> &str {
        &self.name
    }
}

impl AllowedCollisions {
    /// Every pair is checked.
    pub const NONE: Self = Self { pairs: Vec::new(), ignored: Vec::new() };

    /// Every pair is checked, see [`Self::NONE`].
    pub fn none() -> Self {
        Self::NONE
    }

    /// Allows contact between a moving body and an obstacle.
    #[must_use]
    pub fn and(mut self, id: MovingBody, obstacle: &str) -> Self {
        self.pairs.push((id, obstacle.to_owned()));
        self
    }

    /// Allows contact of the hand and both fingers with an obstacle (to be grasped or just released).
    #[must_use]
    pub fn and_gripper(self, robot: &genmanip_core::RobotModel, obstacle: &str) -> Self {
        let [left, right] = robot.gripper.fingers;
        [robot.hand, left, right].into_iter().fold(self, |allowed, link| allowed.and(MovingBody::Link(link), obstacle))
    }

    /// Allows contact of the attached object with an obstacle (its support).
    #[must_use]
    pub fn and_attached(self, obstacle: &str) -> Self {
        self.and(MovingBody::Attached, obstacle)
    }

    /// Excludes an obstacle from all checks.
    #[must_use]
    pub fn and_all(mut self, obstacle: &str) -> Self {
        self.ignored.push(obstacle.to_owned());
        self
    }

    /// True if a pair may touch.
    pub fn contains(&self, id: MovingBody, obstacle: &str) -> bool {
        self.ignored.iter().any(|name| name == obstacle)
            || self.pairs.iter().any(|(other, name)| *other == id && name == obstacle)
    }
}

fn finite_pose(owner: &str, pose: &Pose) -> Result<Rigid, GeometryError> {
    if pose.position.is_finite() && pose.rotation.is_finite() {
        return Ok(Rigid::from(pose));
    }
    let what = "its pose is not finite".to_owned();
    Err(GeometryError { owner: owner.to_owned(), index: 0, what })
}
