//! Assets of a scenario: parts, meshes, materials and body shapes.

use std::sync::Arc;

use genmanip_core::glam::DVec3;
use genmanip_core::{Frame, ObjectModel, Pose, RobotModel, VisualPart, World};
use glam::Vec3A;

use crate::error::RenderError;
use crate::job::{FIRST_OBJECT, FrameState, ROBOT, TABLE, object_of_instance};
use crate::scene::body_shape::BodyShape;
use crate::scene::fixtures;
use crate::scene::material::Material;
use crate::scene::mesh::Mesh;
use crate::scene::supports::SupportTop;

/// Meshes, materials and textures of a robot, its objects and the fixtures: immutable, shared by all frames of a
/// scenario.
#[derive(Debug)]
pub struct RenderAssets {
    pub(crate) parts: Vec<Part>,
    robot: Option<Arc<RobotModel>>,
    objects: Vec<Arc<ObjectModel>>,
    body_count: usize,
    /// Shape of each body's opaque parts, by body index; `None` for a body without opaque parts.
    shapes: Vec<Option<BodyShape>>,
    supports: Vec<SupportTop>,
}

/// Mesh of one material, in the frame of its body.
#[derive(Debug)]
pub struct Part {
    /// Name of the visual part.
    pub name: String,
    /// Index into the frame's body poses; `None` for a fixture, whose frame is the world.
    pub body: Option<usize>,
    /// Instance id of the part's pixels.
    pub instance: u16,
    /// Mesh in full detail.
    pub mesh: Arc<Mesh>,
    /// True if the mesh is known to be convex, so that it causes no ambient occlusion on itself.
    pub convex: bool,
    /// True if the part casts shadows.
    pub casts_shadow: bool,
    /// True for a transparent part whose surface faces away from its centre (the outside of a cup, not its inside or
    /// rim).
    pub faces_out: bool,
    /// Material before a variation is applied.
    pub material: Material,
}

/// Number of low bits of a visibility id that hold the triangle index; the high bits hold the part number plus one.
pub(crate) const TRIANGLE_BITS: u32 = 20;

impl RenderAssets {
    /// Collects the parts of robot, objects and world; without a world there are no fixtures. Object `i` gets instance
    /// id [`FIRST_OBJECT`]` + i`.
    ///
    /// # Errors
    /// A mesh with a vertex index out of range, or more parts or triangles than a visibility id can hold.
    pub fn new(
        robot: Arc<RobotModel>,
        objects: &[Arc<ObjectModel>],
        world: Option<&World>,
    ) -> Result<Arc<Self>, RenderError> {
        Self::collect(Some(robot), objects, world)
    }

    /// Assets of objects without a robot, e.g. for thumbnails; a frame then poses only the objects' links.
    ///
    /// # Errors
    /// As [`RenderAssets::new`].
    pub fn without_robot(objects: &[Arc<ObjectModel>], world: Option<&World>) -> Result<Arc<Self>, RenderError> {
        Self::collect(None, objects, world)
    }

    fn collect(
        robot: Option<Arc<RobotModel>>,
        objects: &[Arc<ObjectModel>],
        world: Option<&World>,
    ) -> Result<Arc<Self>, RenderError> {
        let (mut parts, mut supports) = (Vec::new(), Vec::new());
        for fixed in world.map(fixtures::visuals).unwrap_or_default() {
            let part = Part::new(&fixed.visual, "surroundings", None, TABLE)?;
            supports.extend(SupportTop::of(parts.len(), &part.mesh).filter(|_| fixed.is_slab));
            parts.push(Part { convex: true, casts_shadow: fixed.casts_shadow, ..part });
        }
        let mut body = 0;
        for link in robot.iter().flat_map(|robot| &robot.links) {
            for visual in &link.visual {
                parts.push(Part::new(visual, &link.name, Some(body), ROBOT)?);
            }
            body += 1;
        }
        for (index, object) in objects.iter().enumerate() {
            let too_many = RenderError::TooLarge { what: "objects", got: objects.len(), limit: 60_000 };
            let instance = u16::try_from(index).ok().filter(|&i| i < 60_000).ok_or(too_many)? + FIRST_OBJECT;
            for link in &object.links {
                for visual in &link.visual {
                    parts.push(Part::new(visual, object.card.uid.as_str(), Some(body), instance)?);
                }
                body += 1;
            }
        }
        let limit = (1 << (32 - TRIANGLE_BITS)) - 2;
        if parts.len() > limit {
            return Err(RenderError::TooLarge { what: "visual parts", got: parts.len(), limit });
        }
        let shapes = shapes(&parts, body);
        Ok(Arc::new(Self { parts, robot, objects: objects.to_vec(), body_count: body, shapes, supports }))
    }

    /// All parts in the order of their numbers; see [`crate::internals`].
    #[doc(hidden)]
    pub fn parts(&self) -> &[Part] {
        &self.parts
    }

    /// Object to which a part belongs; `None` for parts of robot and fixtures.
    #[doc(hidden)]
    pub fn object_of(&self, part: &Part) -> Option<&ObjectModel> {
        self.objects.get(object_of_instance(part.instance)?).map(|object| &**object)
    }

    /// Number of poses in a [`FrameState`]: links of the robot and of all objects.
    pub fn body_count(&self) -> usize {
        self.body_count
    }

    /// Shape of a body's opaque parts; `None` if it has none.
    pub(crate) fn shape_of(&self, body: usize) -> Option<&BodyShape> {
        self.shapes[body].as_ref()
    }

    /// Tops of the support surfaces, in the order of the world.
    pub(crate) fn supports(&self) -> &[SupportTop] {
        &self.supports
    }

    /// Height (world z, m) of the support surface below a position: the highest one under it, or else the highest lower
    /// one beside it; `None` if no support surface is lower.
    pub(crate) fn ground_below(&self, place: DVec3) -> Option<f32> {
        let place = place.as_vec3a();
        let below = self.supports.iter().filter(|top| top.height < place.z);
        let ranked = below.map(|top| (top.is_under(place), top.height));
        ranked.max_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1))).map(|(_, height)| height)
    }

    /// Area-weighted mean linear colour of the support surfaces, `None` without any; see [`crate::internals`].
    #[doc(hidden)]
    pub fn ground_color(&self, materials: &[Material]) -> Option<Vec3A> {
        let area: f32 = self.supports.iter().map(SupportTop::area).sum();
        let share = |top: &SupportTop| materials[top.part].mean_color() * (top.area() / area);
        self.supports.iter().map(share).reduce(|a, b| a + b)
    }

    /// Number of the robot's bodies; they come before those of objects.
    pub(crate) fn robot_bodies(&self) -> usize {
        self.robot.as_ref().map_or(0, |robot| robot.links.len())
    }

    /// Number of triangles of all parts in full detail.
    pub fn triangle_count(&self) -> usize {
        self.parts.iter().map(|part| part.mesh.triangles.len()).sum()
    }

    /// Poses of all bodies. `arm` are joint positions (rad), `gripper_width` is the opening (m), and `objects` has
    /// `world_from_object` with joint positions (rad or m) of each object.
    ///
    /// # Errors
    /// When the number of objects is not that of the assets.
    pub fn frame_state<'a>(
        &self,
        arm: &[f64],
        gripper_width: f64,
        objects: impl IntoIterator<Item = (Pose, &'a [f64])>,
    ) -> Result<FrameState, RenderError> {
        let mut body_poses = self.robot.as_ref().map_or_else(Vec::new, |robot| robot.link_poses(arm, gripper_width));
        let mut count = 0;
        for (world_from_object, joint_positions) in objects {
            if let Some(model) = self.objects.get(count) {
                let links = model.link_poses(joint_positions);
                body_poses.extend(links.into_iter().map(|object_from_link| world_from_object * object_from_link));
            }
            count += 1;
        }
        if count != self.objects.len() {
            return Err(RenderError::ObjectCount { expected: self.objects.len(), got: count });
        }
        Ok(FrameState { body_poses })
    }

    /// Poses of all bodies in a recorded frame, which must have the same objects in the same order.
    ///
    /// # Errors
    /// As [`RenderAssets::frame_state`].
    pub fn frame_state_of(&self, frame: &Frame) -> Result<FrameState, RenderError> {
        let objects = frame.objects.iter().map(|object| (object.pose, object.joint_positions.as_slice()));
        self.frame_state(&frame.joint_position, frame.gripper_width, objects)
    }

    /// Pose `world_from_hand` at a frame, to which wrist cameras are mounted; the identity without a robot.
    pub fn world_from_hand(&self, frame: &FrameState) -> Pose {
        let hand = self.robot.as_ref().and_then(|robot| frame.body_poses.get(robot.hand));
        hand.copied().unwrap_or_default()
    }
}

/// Shape of each body, from its opaque parts that cast shadows; `None` for a body without such parts.
fn shapes(parts: &[Part], bodies: usize) -> Vec<Option<BodyShape>> {
    let mut meshes = vec![Vec::new(); bodies];
    for part in parts.iter().filter(|part| part.casts_shadow && !part.is_transparent()) {
        if let Some(own) = part.body.and_then(|body| meshes.get_mut(body)) {
            own.push(&*part.mesh);
        }
    }
    meshes.iter().map(|meshes| BodyShape::of(meshes)).collect()
}

impl Part {
    fn new(visual: &VisualPart, body_name: &str, body: Option<usize>, instance: u16) -> Result<Self, RenderError> {
        let mesh = &*visual.render_mesh;
        let corners = mesh.positions.len();
        if let Some(&index) = mesh.triangles.iter().flatten().find(|&&index| index as usize >= corners) {
            return Err(RenderError::BadMesh { body: body_name.into(), part: visual.name.clone(), index, corners });
        }
        let limit = 1 << TRIANGLE_BITS;
        if mesh.triangles.len() > limit {
            return Err(RenderError::TooLarge { what: "triangles in one mesh", got: mesh.triangles.len(), limit });
        }
        if !mesh.positions.iter().all(|position| position.is_finite()) {
            return Err(RenderError::NotFinite {
                what: format!("a corner of part `{}` of `{body_name}`", visual.name),
            });
        }
        let mesh = Mesh::shared(&visual.render_mesh, &visual.link_from_part);
        let material = Material::new(&visual.material);
        let faces_out = material.opacity < 1.0 && mesh.faces_out();
        Ok(Self {
            name: visual.name.clone(),
            body,
            instance,
            mesh,
            convex: false,
            casts_shadow: true,
            faces_out,
            material,
        })
    }

    /// True if the mesh's back faces are never visible, so that they can be culled.
    pub fn hides_back(&self, mesh: &Mesh) -> bool {
        mesh.closed && !self.is_transparent()
    }

    /// True if the material transmits light.
    pub fn is_transparent(&self) -> bool {
        self.material.opacity < 1.0
    }
}
