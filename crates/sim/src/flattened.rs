//! MJCF of other programs, compiled by the engine: bodies, geoms, meshes, materials and joints as it understands them.

use std::collections::HashMap;

use genmanip_core::glam::{DMat3, DQuat, DVec3};
use genmanip_core::{MassProperties, Pose, Shape};
use mujoco_rs::mujoco_c::_mjtObjBase as ObjectType;
use mujoco_rs::wrappers::{
    MjModel, MjSpec, MjVfs, MjtGeomBase as GeomType, MjtJoint as JointType, MjtTexture as TextureType,
};

use crate::{SimError, engine_log};

/// Name of the main file among the files that the engine sees.
const MAIN: &str = "main.xml";
/// Role of the colour texture of a material (`mjTEXROLE_RGB`), and of one with opacity (`mjTEXROLE_RGBA`).
const COLOR_ROLES: [usize; 2] = [1, 8];

/// A compiled MJCF file: defaults, frames, replicas, attachments and fitted shapes are resolved.
#[derive(Clone, Debug, Default)]
pub struct Flattened {
    /// Bodies, parents first; the first is the world.
    pub bodies: Vec<FlatBody>,
    /// Meshes after scale and reference pose.
    pub meshes: Vec<FlatMesh>,
    /// Materials, to which [`FlatGeom::material`] refers.
    pub materials: Vec<FlatMaterial>,
    /// Textures, to which [`FlatMaterial::texture`] refers.
    pub textures: Vec<FlatTexture>,
    /// Warnings of the engine's compiler.
    pub warnings: Vec<String>,
}

/// Body of a compiled model.
#[derive(Clone, Debug)]
pub struct FlatBody {
    /// Name; empty if there is none.
    pub name: String,
    /// Index of the parent; the world is its own.
    pub parent: usize,
    /// Pose in the parent where all joints have their reference values.
    pub parent_from_body: Pose,
    /// Mass properties in the body's frame; massless for the world.
    pub mass: MassProperties,
    /// Joints to the parent; empty for a body welded to it.
    pub joints: Vec<FlatJoint>,
    /// Shapes of the body, for collision or display.
    pub geoms: Vec<FlatGeom>,
}

/// Kind of motion that a joint allows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FlatJointKind {
    /// Free motion.
    Free,
    /// Rotation about a point.
    Ball,
    /// Translation along an axis.
    Slide,
    /// Rotation about an axis.
    Hinge,
}

/// Joint of a compiled model; positions in rad or m.
#[derive(Clone, Debug)]
pub struct FlatJoint {
    /// Name; empty if there is none.
    pub name: String,
    /// Kind of motion: free, ball, slide or hinge.
    pub kind: FlatJointKind,
    /// Anchor in the body's frame, m.
    pub anchor: DVec3,
    /// Unit axis in the body's frame.
    pub axis: DVec3,
    /// Smallest and largest position; `None` without limits.
    pub range: Option<[f64; 2]>,
    /// Position at which the bodies have the poses of the file (MJCF's `ref`).
    pub reference: f64,
    /// Damping, N·m·s/rad or N·s/m.
    pub damping: f64,
    /// Dry friction, N·m or N.
    pub friction_loss: f64,
    /// Spring stiffness, N·m/rad or N/m.
    pub stiffness: f64,
    /// Rest position of the spring.
    pub spring_reference: f64,
}

/// Shape of a geom.
#[derive(Clone, Debug)]
pub enum FlatShape {
    /// A primitive, also one fitted to a mesh.
    Primitive(Shape),
    /// A mesh, by its index in [`Flattened::meshes`].
    Mesh(usize),
    /// A plane, height field or signed distance field, by its name.
    Unbounded(&'static str),
}

/// Geom of a compiled model: a shape attached to a body.
#[derive(Clone, Debug)]
pub struct FlatGeom {
    /// Name; empty if there is none.
    pub name: String,
    /// Shape in its own frame.
    pub shape: FlatShape,
    /// Pose of the geom in the body's frame.
    pub body_from_geom: Pose,
    /// Visibility group of MuJoCo.
    pub group: i32,
    /// True if it can collide with any other geom.
    pub collides: bool,
    /// Sliding friction coefficient.
    pub friction: f64,
    /// Colour, 0-1; `None` for the engine's default colour, which the colour of the material replaces.
    pub rgba: Option<[f32; 4]>,
    /// Index in [`Flattened::materials`]; `None` without a material.
    pub material: Option<usize>,
}

/// A triangle mesh in the frame of its geom; texture coordinates per vertex, (0, 0) first pixel of the first row.
#[derive(Clone, Debug, Default)]
pub struct FlatMesh {
    /// Name; empty if there is none.
    pub name: String,
    /// Vertices, m.
    pub positions: Vec<DVec3>,
    /// Texture coordinates; empty if there are none.
    pub uvs: Vec<[f32; 2]>,
    /// Vertex indices, counter-clockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
}

/// Material of a compiled model.
#[derive(Clone, Debug)]
pub struct FlatMaterial {
    /// Red, green, blue and opacity, 0-1.
    pub rgba: [f32; 4],
    /// Index of the colour texture in [`Flattened::textures`]; `None` without one.
    pub texture: Option<usize>,
    /// Number of repetitions of the texture along its two axes.
    pub repeat: [f32; 2],
    /// Shininess, 0-1.
    pub shininess: f32,
    /// Metallic factor, 0-1; negative if unspecified.
    pub metallic: f32,
    /// Roughness, 0-1; negative if unspecified.
    pub roughness: f32,
}

/// Texture of a compiled model.
#[derive(Clone, Debug)]
pub struct FlatTexture {
    /// Name; empty if there is none.
    pub name: String,
    /// Width and height, pixels; the height of a cube texture is that of its six faces.
    pub size: [u32; 2],
    /// True for a cube or sky texture, which texture coordinates do not address.
    pub is_cube: bool,
    /// Red, green and blue of each pixel, row by row.
    pub rgb: Vec<u8>,
}

impl Flattened {
    /// Compiles MJCF text. Files that it includes or names are read from `files` (name and content) only.
    ///
    /// # Errors
    /// [`SimError::Mjcf`] with the engine's message.
    pub fn compile(xml: &str, files: &[(String, Vec<u8>)]) -> Result<Self, SimError> {
        if xml.contains('\0') {
            return Err(SimError::Mjcf("the text has a null character".into()));
        }
        engine_log::silence();
        let mut known = MjVfs::new();
        let main = (MAIN, xml.as_bytes());
        for (name, bytes) in std::iter::once(main).chain(files.iter().map(|(name, bytes)| (name.as_str(), &bytes[..])))
        {
            known.add_from_buffer(name, bytes).map_err(|error| SimError::Mjcf(format!("{name}: {error}")))?;
        }
        let refused = |error: mujoco_rs::error::MjEditError| SimError::Mjcf(error.to_string());
        let mut spec = MjSpec::from_xml_vfs(MAIN, &known).map_err(refused)?;
        let model = spec.compile_with_vfs(&known).map_err(refused)?;
        let warnings = (0..spec.num_warnings()).filter_map(|index| spec.warning(index).map(str::to_owned)).collect();
        let flat = Self {
            bodies: (0..model.body_parentid().len()).map(|index| body(&model, index)).collect(),
            meshes: (0..model.mesh_vertadr().len()).map(|index| mesh(&model, index)).collect(),
            materials: (0..model.mat_rgba().len()).map(|index| material(&model, index)).collect(),
            textures: (0..model.tex_width().len()).map(|index| texture(&model, index)).collect(),
            warnings,
        };
        flat.check()?;
        Ok(flat)
    }

    /// Rejects poses, masses and vertices that are not finite.
    fn check(&self) -> Result<(), SimError> {
        let wrong = self.bodies.iter().find(|body| {
            let poses = body.geoms.iter().map(|geom| geom.body_from_geom).chain([body.parent_from_body]);
            let are_finite = |pose: Pose| pose.position.is_finite() && pose.rotation.is_finite();
            !poses.into_iter().all(are_finite) || !body.mass.mass_kg.is_finite() || !body.mass.inertia.is_finite()
        });
        if let Some(body) = wrong {
            return Err(SimError::Mjcf(format!("body `{}` has numbers that are not finite", body.name)));
        }
        match self.meshes.iter().find(|mesh| !mesh.positions.iter().all(|position| position.is_finite())) {
            Some(mesh) => Err(SimError::Mjcf(format!("mesh `{}` has numbers that are not finite", mesh.name))),
            None => Ok(()),
        }
    }
}

fn body(model: &MjModel, index: usize) -> FlatBody {
    let axes = DMat3::from_quat(rotation(model.body_iquat()[index]));
    let principal = DMat3::from_diagonal(DVec3::from_array(model.body_inertia()[index]));
    let range = |first: i32, count: i32| (0..count.max(0)).map(move |offset| (first + offset) as usize);
    FlatBody {
        name: name(model, ObjectType::mjOBJ_BODY, index),
        parent: model.body_parentid()[index] as usize,
        parent_from_body: pose(model.body_pos()[index], model.body_quat()[index]),
        mass: MassProperties {
            mass_kg: model.body_mass()[index],
            center: DVec3::from_array(model.body_ipos()[index]),
            inertia: axes * principal * axes.transpose(),
        },
        joints: range(model.body_jntadr()[index], model.body_jntnum()[index]).map(|at| joint(model, at)).collect(),
        geoms: range(model.body_geomadr()[index], model.body_geomnum()[index]).map(|at| geom(model, at)).collect(),
    }
}

fn joint(model: &MjModel, index: usize) -> FlatJoint {
    let (position, freedom) = (model.jnt_qposadr()[index] as usize, model.jnt_dofadr()[index] as usize);
    FlatJoint {
        name: name(model, ObjectType::mjOBJ_JOINT, index),
        kind: match model.jnt_type()[index] {
            JointType::mjJNT_FREE => FlatJointKind::Free,
            JointType::mjJNT_BALL => FlatJointKind::Ball,
            JointType::mjJNT_SLIDE => FlatJointKind::Slide,
            JointType::mjJNT_HINGE => FlatJointKind::Hinge,
        },
        anchor: DVec3::from_array(model.jnt_pos()[index]),
        axis: DVec3::from_array(model.jnt_axis()[index]),
        range: model.jnt_limited()[index].then(|| model.jnt_range()[index]),
        reference: model.qpos0()[position],
        damping: model.dof_damping()[freedom],
        friction_loss: model.dof_frictionloss()[freedom],
        stiffness: model.jnt_stiffness()[index],
        spring_reference: model.qpos_spring()[position],
    }
}

fn geom(model: &MjModel, index: usize) -> FlatGeom {
    let [x, y, z] = model.geom_size()[index];
    let primitive = FlatShape::Primitive;
    let at = |id: i32| usize::try_from(id).ok();
    let rgba = model.geom_rgba()[index];
    FlatGeom {
        name: name(model, ObjectType::mjOBJ_GEOM, index),
        shape: match model.geom_type()[index] {
            GeomType::mjGEOM_SPHERE => primitive(Shape::Sphere { radius: x }),
            GeomType::mjGEOM_CAPSULE => primitive(Shape::Capsule { radius: x, half_length: y }),
            GeomType::mjGEOM_CYLINDER => primitive(Shape::Cylinder { radius: x, half_height: y }),
            GeomType::mjGEOM_ELLIPSOID => primitive(Shape::Ellipsoid { radii: DVec3::new(x, y, z) }),
            GeomType::mjGEOM_BOX => primitive(Shape::Box { half_extents: DVec3::new(x, y, z) }),
            GeomType::mjGEOM_MESH => {
                at(model.geom_dataid()[index]).map_or(FlatShape::Unbounded("mesh"), FlatShape::Mesh)
            }
            GeomType::mjGEOM_PLANE => FlatShape::Unbounded("plane"),
            GeomType::mjGEOM_HFIELD => FlatShape::Unbounded("hfield"),
            GeomType::mjGEOM_SDF => FlatShape::Unbounded("sdf"),
        },
        body_from_geom: pose(model.geom_pos()[index], model.geom_quat()[index]),
        group: model.geom_group()[index],
        collides: model.geom_contype()[index] != 0 || model.geom_conaffinity()[index] != 0,
        friction: model.geom_friction()[index][0],
        // The engine draws a geom whose colour is the default one in that of its material.
        rgba: (rgba != [0.5, 0.5, 0.5, 1.0]).then_some(rgba),
        material: at(model.geom_matid()[index]),
    }
}

/// Mesh `index` of a model, with one vertex per pair of position and texture coordinate.
fn mesh(model: &MjModel, index: usize) -> FlatMesh {
    let of = |address: i32| usize::try_from(address).unwrap_or(0);
    let (vertex, face) = (of(model.mesh_vertadr()[index]), of(model.mesh_faceadr()[index]));
    let count = of(model.mesh_vertnum()[index]);
    let position = |at: usize| {
        let [x, y, z] = model.mesh_vert()[vertex + at].map(f64::from);
        DVec3::new(x, y, z)
    };
    let mut made = FlatMesh {
        name: name(model, ObjectType::mjOBJ_MESH, index),
        positions: (0..count).map(position).collect(),
        ..FlatMesh::default()
    };
    let faces = face..face + of(model.mesh_facenum()[index]);
    let Ok(coordinate) = usize::try_from(model.mesh_texcoordadr()[index]) else {
        made.triangles = model.mesh_face()[faces].iter().map(|corners| corners.map(|corner| corner as u32)).collect();
        return made;
    };
    let mut known: HashMap<(i32, i32), u32> = HashMap::new();
    let mut positions = Vec::new();
    for (corners, places) in model.mesh_face()[faces.clone()].iter().zip(&model.mesh_facetexcoord()[faces]) {
        made.triangles.push([0, 1, 2].map(|side| {
            *known.entry((corners[side], places[side])).or_insert_with(|| {
                positions.push(made.positions[corners[side] as usize]);
                made.uvs.push(model.mesh_texcoord()[coordinate + of(places[side])]);
                positions.len() as u32 - 1
            })
        }));
    }
    made.positions = positions;
    made
}

fn material(model: &MjModel, index: usize) -> FlatMaterial {
    let textures = model.mat_texid()[index];
    FlatMaterial {
        rgba: model.mat_rgba()[index],
        texture: COLOR_ROLES.iter().find_map(|role| usize::try_from(*textures.get(*role)?).ok()),
        repeat: model.mat_texrepeat()[index],
        shininess: model.mat_shininess()[index],
        metallic: model.mat_metallic()[index],
        roughness: model.mat_roughness()[index],
    }
}

fn texture(model: &MjModel, index: usize) -> FlatTexture {
    let size = [model.tex_width()[index], model.tex_height()[index]].map(|side| side.max(0) as u32);
    let channels = model.tex_nchannel()[index].max(1) as usize;
    let start = usize::try_from(model.tex_adr()[index]).unwrap_or(usize::MAX);
    let end = start.saturating_add(size[0] as usize * size[1] as usize * channels);
    let data = model.tex_data().get(start..end).unwrap_or_default();
    let color = |pixel: &[u8]| match pixel {
        [r, g, b, ..] => [*r, *g, *b],
        [gray, ..] => [*gray; 3],
        [] => [0; 3],
    };
    let rgb = data.chunks_exact(channels).flat_map(color).collect();
    let is_cube = model.tex_type()[index] != TextureType::mjTEXTURE_2D;
    FlatTexture { name: name(model, ObjectType::mjOBJ_TEXTURE, index), size, is_cube, rgb }
}

fn name(model: &MjModel, kind: ObjectType, index: usize) -> String {
    model.id_to_name(kind, index).unwrap_or_default().to_owned()
}

fn pose(position: [f64; 3], quaternion: [f64; 4]) -> Pose {
    Pose { position: DVec3::from_array(position), rotation: rotation(quaternion) }
}

fn rotation([w, x, y, z]: [f64; 4]) -> DQuat {
    DQuat::from_xyzw(x, y, z, w)
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;

    /// Without the check, the engine would write a warning into the current folder.
    #[test]
    fn numbers_that_are_none_are_refused_and_leave_no_log() {
        let geom = "<geom size='0.1' mass='1'/>";
        let file = |pos: &str| format!("<mujoco><worldbody><body pos='{pos}'>{geom}</body></worldbody></mujoco>");
        assert_eq!(Flattened::compile(&file("0 0 1"), &[]).unwrap().bodies.len(), 2);
        assert!(Flattened::compile(&file("0 0 nan"), &[]).is_err());
        assert!(!Path::new("MUJOCO_LOG.TXT").exists());
    }
}
