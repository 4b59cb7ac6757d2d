//! Everything that can be drawn and does not change during a scenario.

use std::sync::Arc;

use genmanip_core::{Frame, Material, ObjectModel, Pose, RobotModel, TriMesh, VisualPart, World};
use glam::{Vec2, Vec3, Vec3A};

use crate::error::RenderError;
use crate::job::{FIRST_OBJECT, FrameState, ROBOT, TABLE};
use crate::surroundings;
use crate::texture::{MipTexture, linear_from_srgb};

/// Meshes, materials and textures of a robot, its objects and the table: immutable, shared by all frames of a scenario.
#[derive(Debug)]
pub struct RenderAssets {
    pub(crate) parts: Vec<Part>,
    robot: Option<Arc<RobotModel>>,
    objects: Vec<Arc<ObjectModel>>,
    body_count: usize,
}

/// One mesh of one material, in the frame of its body.
#[derive(Debug)]
pub(crate) struct Part {
    /// Index into the frame's body poses; `None` is fixed in the world.
    pub body: Option<usize>,
    pub instance: u16,
    pub positions: Vec<Vec3>,
    pub normals: Vec<Vec3>,
    pub uvs: Vec<Vec2>,
    pub triangles: Vec<[u32; 3]>,
    /// Where each triangle lies.
    pub faces: Vec<Face>,
    /// Texels per metre of each triangle; empty without texture.
    pub texel_density: Vec<f32>,
    pub bounds_center: Vec3,
    pub bounds_radius: f32,
    /// Closed and consistently wound: its back faces can never be seen from outside.
    pub closed: bool,
    /// Known to be convex: cannot darken itself.
    pub convex: bool,
    pub casts_shadow: bool,
    pub surface: Surface,
}

/// A triangle as planes in the body's frame: everything a ray needs without touching the corners.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Face {
    /// Unit normal; zero for a triangle without area.
    pub normal: Vec3,
    /// Distance of the plane from the origin along the normal.
    pub offset: f32,
    /// The weight of corner 1 at a point is `weight1.dot(point) + offset1`.
    pub weight1: Vec3,
    pub offset1: f32,
    /// The same for corner 2.
    pub weight2: Vec3,
    pub offset2: f32,
}

/// A material ready for shading: linear colour, no optional parameters.
#[derive(Debug)]
pub(crate) struct Surface {
    pub base: Vec3A,
    pub roughness: f32,
    pub metallic: f32,
    pub opacity: f32,
    /// Reflectance of a dielectric seen head-on.
    pub reflectance: f32,
    pub texture: Option<MipTexture>,
    /// Whether the texture is tinted by [`crate::RenderVariation::table_color`].
    pub is_table: bool,
}

/// Bits of a visibility id that name the triangle; the others name the part, plus one.
pub(crate) const TRIANGLE_BITS: u32 = 20;

impl RenderAssets {
    /// Collects what a scenario shows; without a world, nothing but robot and objects. Object `i` gets instance id [`FIRST_OBJECT`]` + i`.
    ///
    /// # Errors
    /// A mesh with an index beyond its corners, or more parts or triangles than ids can tell apart.
    pub fn new(
        robot: Arc<RobotModel>,
        objects: &[Arc<ObjectModel>],
        world: Option<&World>,
    ) -> Result<Arc<Self>, RenderError> {
        Self::collect(Some(robot), objects, world)
    }

    /// Objects without a robot, e.g. for thumbnails; a frame then poses the objects' links only.
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
        let mut parts = Vec::new();
        for fixed in world.map(surroundings::visuals).unwrap_or_default() {
            let part = Part::new(&fixed.visual, "surroundings", None, TABLE)?;
            let surface = Surface { is_table: fixed.is_table, ..part.surface };
            parts.push(Part { surface, convex: true, casts_shadow: fixed.casts_shadow, ..part });
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
                    parts.push(Part::new(visual, &object.card.uid, Some(body), instance)?);
                }
                body += 1;
            }
        }
        let limit = (1 << (32 - TRIANGLE_BITS)) - 2;
        if parts.len() > limit {
            return Err(RenderError::TooLarge { what: "visual parts", got: parts.len(), limit });
        }
        Ok(Arc::new(Self { parts, robot, objects: objects.to_vec(), body_count: body }))
    }

    /// Number of poses in a [`FrameState`]: links of the robot and of all objects.
    pub fn body_count(&self) -> usize {
        self.body_count
    }

    /// Number of triangles of everything together.
    pub fn triangle_count(&self) -> usize {
        self.parts.iter().map(|part| part.triangles.len()).sum()
    }

    /// Poses of all bodies from joint positions, the opening width between the pads,
    /// and `world_from_object` with joint positions for each object.
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

    /// Poses of all bodies at a recorded frame whose objects are those of the assets, in the same order.
    ///
    /// # Errors
    /// As [`RenderAssets::frame_state`].
    pub fn frame_state_of(&self, frame: &Frame) -> Result<FrameState, RenderError> {
        let objects = frame.objects.iter().map(|object| (object.pose, object.joint_positions.as_slice()));
        self.frame_state(&frame.joint_position, frame.gripper_width, objects)
    }

    /// `world_from_hand` at a frame, to which hand cameras are mounted; the world's origin without a robot.
    pub fn world_from_hand(&self, frame: &FrameState) -> Pose {
        let hand = self.robot.as_ref().and_then(|robot| frame.body_poses.get(robot.hand));
        hand.copied().unwrap_or_default()
    }
}

impl Part {
    fn new(visual: &VisualPart, body_name: &str, body: Option<usize>, instance: u16) -> Result<Self, RenderError> {
        let mesh = &*visual.mesh;
        let corners = mesh.positions.len();
        if let Some(&index) = mesh.triangles.iter().flatten().find(|&&index| index as usize >= corners) {
            return Err(RenderError::BadMesh { body: body_name.into(), part: visual.name.clone(), index, corners });
        }
        let limit = 1 << TRIANGLE_BITS;
        if mesh.triangles.len() > limit {
            return Err(RenderError::TooLarge { what: "triangles in one mesh", got: mesh.triangles.len(), limit });
        }
        let place = |point: Vec3| visual.link_from_part.transform_point(point.as_dvec3()).as_vec3();
        let turn = |vector: Vec3| visual.link_from_part.transform_vector(vector.as_dvec3()).as_vec3();
        let positions: Vec<Vec3> = mesh.positions.iter().copied().map(place).collect();
        if !positions.iter().all(|position| position.is_finite()) {
            return Err(RenderError::NotFinite {
                what: format!("a corner of part `{}` of `{body_name}`", visual.name),
            });
        }
        let faces = mesh.triangles.iter().map(|triangle| Face::new(triangle.map(|i| positions[i as usize]))).collect();
        let normals = if mesh.normals.len() == corners {
            mesh.normals.iter().copied().map(turn).collect()
        } else {
            smooth_normals(&positions, &mesh.triangles)
        };
        let uvs = if mesh.uvs.len() == corners { mesh.uvs.clone() } else { vec![Vec2::ZERO; corners] };
        let surface = Surface::new(&visual.material);
        let texel_density = surface.texture.as_ref().map_or_else(Vec::new, |texture| {
            mesh.triangles.iter().map(|&triangle| texel_density(texture, &positions, &uvs, triangle)).collect()
        });
        let (low, high) = positions
            .iter()
            .fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), &point| (low.min(point), high.max(point)));
        let bounds_center = if corners == 0 { Vec3::ZERO } else { (low + high) * 0.5 };
        let bounds_radius = positions.iter().map(|point| point.distance(bounds_center)).fold(0.0, f32::max);
        let closed = surface.opacity >= 1.0 && is_closed(mesh);
        let triangles = mesh.triangles.clone();
        Ok(Self {
            body,
            instance,
            positions,
            normals,
            uvs,
            triangles,
            faces,
            texel_density,
            bounds_center,
            bounds_radius,
            closed,
            convex: false,
            casts_shadow: true,
            surface,
        })
    }

    /// Corners of a triangle in the body's frame.
    #[cfg(test)]
    pub fn corners(&self, triangle: usize) -> [Vec3; 3] {
        self.triangles[triangle].map(|index| self.positions[index as usize])
    }

    pub fn is_transparent(&self) -> bool {
        self.surface.opacity < 1.0
    }
}

impl Face {
    fn new(corners: [Vec3; 3]) -> Self {
        // In double precision: small triangles have large gradients.
        let [a, b, c] = corners.map(Vec3::as_dvec3);
        let (ab, ac) = (b - a, c - a);
        let area = ab.cross(ac);
        let normal = area.normalize_or_zero();
        let inverse = area.length_squared().max(1e-30).recip();
        let (weight1, weight2) = (ac.cross(area) * inverse, area.cross(ab) * inverse);
        Self {
            normal: normal.as_vec3(),
            offset: normal.dot(a) as f32,
            weight1: weight1.as_vec3(),
            offset1: -weight1.dot(a) as f32,
            weight2: weight2.as_vec3(),
            offset2: -weight2.dot(a) as f32,
        }
    }
}

impl Surface {
    fn new(material: &Material) -> Self {
        let ior = material.ior.max(1.0);
        Self {
            base: linear_from_srgb(material.base_color),
            roughness: material.roughness.clamp(0.05, 1.0),
            metallic: material.metallic.clamp(0.0, 1.0),
            opacity: material.opacity.clamp(0.0, 1.0),
            reflectance: ((ior - 1.0) / (ior + 1.0)).powi(2),
            texture: material.texture.as_ref().and_then(MipTexture::new),
            is_table: false,
        }
    }
}

fn area_vector(positions: &[Vec3], triangle: [u32; 3]) -> Vec3 {
    let [a, b, c] = triangle.map(|index| positions[index as usize]);
    (b - a).cross(c - a)
}

fn smooth_normals(positions: &[Vec3], triangles: &[[u32; 3]]) -> Vec<Vec3> {
    let mut normals = vec![Vec3::ZERO; positions.len()];
    for &triangle in triangles {
        let area = area_vector(positions, triangle);
        triangle.iter().for_each(|&index| normals[index as usize] += area);
    }
    normals.into_iter().map(Vec3::normalize_or_zero).collect()
}

fn texel_density(texture: &MipTexture, positions: &[Vec3], uvs: &[Vec2], triangle: [u32; 3]) -> f32 {
    let [a, b, c] = triangle.map(|index| uvs[index as usize]);
    let uv_area = (b - a).perp_dot(c - a).abs();
    let area = area_vector(positions, triangle).length();
    (texture.texels() * uv_area / area.max(1e-12)).sqrt()
}

/// Whether every edge, after joining corners at equal places, is walked as often forwards as backwards,
/// and the mesh is not inside out.
fn is_closed(mesh: &TriMesh) -> bool {
    // Corners by their place, and edges, each as one number, which is quickly sorted.
    let key = |position: &Vec3| {
        let [x, y, z] = position.to_array().map(|value| u128::from((value + 0.0).to_bits()));
        x << 64 | y << 32 | z
    };
    let mut corners: Vec<u128> =
        mesh.positions.iter().zip(0..).map(|(place, index)| key(place) << 32 | index).collect();
    corners.sort_unstable();
    let mut joined = vec![0_u64; corners.len()];
    let mut place = 0;
    for (rank, corner) in corners.iter().enumerate() {
        if rank > 0 && corners[rank - 1] >> 32 != corner >> 32 {
            place += 1;
        }
        joined[*corner as u32 as usize] = place;
    }
    // The lowest bit tells the direction.
    let mut edges: Vec<u64> = mesh
        .triangles
        .iter()
        .flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]])
        .map(|edge| edge.map(|index| joined[index as usize]))
        .filter(|[from, to]| from != to)
        .map(|[from, to]| if from < to { from << 32 | to << 1 | 1 } else { to << 32 | from << 1 })
        .collect();
    edges.sort_unstable();
    let forwards = |same: &[u64]| same.iter().filter(|edge| *edge & 1 == 1).count();
    let balanced = edges.chunk_by(|a, b| a >> 1 == b >> 1).all(|same| forwards(same) * 2 == same.len());
    let volume: f64 = mesh.corners().map(|[a, b, c]| a.dot(b.cross(c))).sum();
    balanced && volume > 0.0
}
