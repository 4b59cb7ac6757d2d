//! URDF as written by PartNet-Mobility, ManiSkill and pybullet: links with surfaces, joints, masses.

use std::collections::{BTreeMap, BTreeSet};

use genmanip_core::{Joint, JointKind, MassProperties, Material, Piece, Pose, Shape};
use glam::{DMat3, DMat4, DQuat, DVec3};

use super::xml::{self, Element};
use super::{mesh, obj, solid};
use crate::ImportError;
use crate::files::{Files, beside, shortened};
use crate::raw::{MAX_LINKS, RawCollision, RawLink, RawMesh, RawObject, Surface, Unit, Up};
use crate::units_and_frame::transformed_mass;

/// Default damping and dry friction of a joint, N·m·s/rad and N·m, or N·s/m and N: a door or drawer that stays where
/// it is left.
const DAMPING: f64 = 0.1;
const FRICTION_LOSS: f64 = 0.05;
/// Range of a continuous joint, rad.
const CONTINUOUS: [f64; 2] = [-std::f64::consts::PI, std::f64::consts::PI];

/// Reads the object of a URDF; links with fixed joints are merged into their parents.
///
/// # Errors
/// With the line of a joint to an unknown link, a loop, an invalid number or a missing mesh.
pub fn read(path: &str, files: &mut Files<'_>) -> Result<RawObject, ImportError> {
    let robot = xml::parse(path, files)?;
    if robot.tag != "robot" {
        return Err(robot.wrong("expected <robot>"));
    }
    let mut reader = Reader { path, files, notes: Vec::new(), colors: BTreeMap::new() };
    for material in robot.all("material") {
        if let (Some(name), Some(color)) = (material.attribute("name"), reader.color(material)?) {
            reader.colors.insert(name.to_owned(), color);
        }
    }
    let links: Vec<&Element> = robot.all("link").collect();
    if links.is_empty() || links.len() > 8 * MAX_LINKS {
        return Err(ImportError::new(path, format!("{} links; expected 1 to {}", links.len(), 8 * MAX_LINKS)));
    }
    let joints = robot.all("joint").map(|joint| reader.joint(joint)).collect::<Result<Vec<_>, _>>()?;
    let order = ordered(&robot, &links, &joints)?;
    // Index of the remaining link and pose in it, by the name of the original link.
    let mut places: BTreeMap<&str, (usize, Pose)> = BTreeMap::new();
    let mut made: Vec<RawLink> = Vec::new();
    for (node, name, hung) in order {
        let own = reader.link(node, name)?;
        let (index, pose) = match hung {
            None => {
                made.push(RawLink { name: name.to_owned(), ..RawLink::default() });
                (made.len() - 1, Pose::IDENTITY)
            }
            Some(joint) => {
                let (parent, parent_from_fixed) = places[joint.parent];
                let parent_from_joint = parent_from_fixed * joint.parent_from_joint;
                match &joint.moves {
                    None => (parent, parent_from_joint),
                    Some(moves) => {
                        let joint = Joint { parent, parent_from_joint, ..moves.clone() };
                        made.push(RawLink { name: name.to_owned(), joint: Some(joint), ..RawLink::default() });
                        (made.len() - 1, Pose::IDENTITY)
                    }
                }
            }
        };
        places.insert(name, (index, pose));
        merge(&mut made[index], own, &pose);
    }
    if made.len() > MAX_LINKS {
        return Err(ImportError::new(path, format!("{} moving links; at most {MAX_LINKS} are supported", made.len())));
    }
    let notes = reader.notes;
    let is_partnet = path.rsplit('/').next() == Some("mobility.urdf");
    Ok(RawObject {
        name: robot.attribute("name").unwrap_or_default().to_owned(),
        links: made,
        // PartNet-Mobility normalises every object to a diagonal of about two.
        unit: if is_partnet { Unit::Normalised } else { Unit::Metre },
        up: Up::Z,
        licence: None,
        creator: None,
        notes,
    })
}

/// A joint as written in the file.
struct FileJoint<'a> {
    parent: &'a str,
    child: &'a str,
    parent_from_joint: Pose,
    /// The motion; `None` for a fixed joint. Parent and frame are filled in later.
    moves: Option<Joint>,
}

struct Reader<'a, 'b> {
    path: &'a str,
    files: &'a mut Files<'b>,
    notes: Vec<String>,
    colors: BTreeMap<String, Material>,
}

impl Reader<'_, '_> {
    fn joint<'x>(&mut self, node: &'x Element) -> Result<FileJoint<'x>, ImportError> {
        let link = |tag: &str| {
            let found = node.first(tag).and_then(|end| end.attribute("link"));
            found.ok_or_else(|| node.wrong(format!("expected <{tag} link=\"…\">")))
        };
        let (parent, child) = (link("parent")?, link("child")?);
        let kind = match node.attribute("type").unwrap_or_default() {
            "revolute" | "continuous" => Some(JointKind::Revolute),
            "prismatic" => Some(JointKind::Prismatic),
            "fixed" => None,
            other => {
                self.notes.push(format!(
                    "joint of type `{}` to {} treated as fixed",
                    shortened(other),
                    shortened(child)
                ));
                None
            }
        };
        let moves = match kind {
            None => None,
            Some(kind) => {
                let axis = match node.first("axis") {
                    Some(axis) => axis.exactly::<3>("xyz")?.unwrap_or([1.0, 0.0, 0.0]),
                    None => [1.0, 0.0, 0.0],
                };
                let axis =
                    DVec3::from_array(axis).try_normalize().ok_or_else(|| node.wrong("its axis has no length"))?;
                let range = match node.first("limit") {
                    Some(limit) if node.attribute("type") != Some("continuous") => {
                        [limit.number("lower", 0.0)?, limit.number("upper", 0.0)?]
                    }
                    _ => CONTINUOUS,
                };
                let dynamics = node.first("dynamics");
                let number = |name, otherwise| dynamics.map_or(Ok(otherwise), |node| node.number(name, otherwise));
                let name = node.attribute("name").unwrap_or(child).to_owned();
                if range[0] > range[1] {
                    return Err(node.wrong(format!("expected an increasing range, got {} to {}", range[0], range[1])));
                }
                // A joint with an empty range is fixed.
                (range[1] - range[0] > 1e-6).then_some(Joint {
                    name,
                    parent: 0,
                    kind,
                    parent_from_joint: Pose::IDENTITY,
                    axis,
                    range,
                    damping: number("damping", DAMPING)?.max(0.0),
                    friction_loss: number("friction", FRICTION_LOSS)?.max(0.0),
                    stiffness: 0.0,
                    spring_reference: 0.0,
                })
            }
        };
        Ok(FileJoint { parent, child, parent_from_joint: self.origin(node)?, moves })
    }

    /// Contents of a link, in its own frame.
    fn link(&mut self, node: &Element, name: &str) -> Result<RawLink, ImportError> {
        let mut link = RawLink { name: name.to_owned(), ..RawLink::default() };
        for visual in node.all("visual") {
            let material = match visual.first("material") {
                Some(material) => {
                    self.color(material)?.or_else(|| self.colors.get(material.attribute("name")?).cloned())
                }
                None => None,
            };
            let origin = self.origin(visual)?;
            let transform = DMat4::from_rotation_translation(origin.rotation, origin.position);
            let part = visual.attribute("name").unwrap_or(name).to_owned();
            for surface in self.surfaces(visual, material.as_ref())? {
                let mesh = surface.mesh.transformed(&transform);
                link.surfaces.push(Surface { name: part.clone(), mesh, ..surface });
            }
        }
        for collision in node.all("collision") {
            let origin = self.origin(collision)?;
            let Some(geometry) = collision.first("geometry") else { continue };
            if let Some(shape) = self.shape(geometry)? {
                link.collision.push(RawCollision::Piece(Piece { shape, link_from_piece: origin }));
            } else if let Some(mesh) = self.mesh(geometry)? {
                let transform = DMat4::from_rotation_translation(origin.rotation, origin.position);
                link.collision.push(RawCollision::Mesh(mesh.transformed(&transform)));
            }
        }
        if let Some(inertial) = node.first("inertial") {
            link.mass = self.mass(inertial)?;
        }
        if let Some(friction) = node.first("contact").and_then(|contact| contact.first("lateral_friction")) {
            link.friction = Some(friction.number("value", 0.6)?);
        }
        Ok(link)
    }

    fn mass(&self, node: &Element) -> Result<Option<MassProperties>, ImportError> {
        let Some(mass) = node.first("mass") else { return Ok(None) };
        let mass_kg = mass.number("value", 0.0)?;
        let mut moments = [0.0; 6];
        if let Some(inertia) = node.first("inertia") {
            for (value, name) in moments.iter_mut().zip(["ixx", "iyy", "izz", "ixy", "ixz", "iyz"]) {
                *value = inertia.number(name, 0.0)?;
            }
        }
        let [ixx, iyy, izz, ixy, ixz, iyz] = moments;
        let inertia = DMat3::from_cols(DVec3::new(ixx, ixy, ixz), DVec3::new(ixy, iyy, iyz), DVec3::new(ixz, iyz, izz));
        // A body with zero mass, as bases are often written, has no mass of its own.
        let own = MassProperties { mass_kg, center: DVec3::ZERO, inertia };
        Ok((mass_kg > 0.0).then_some(transformed_mass(&own, &self.origin(node)?)))
    }

    fn origin(&self, node: &Element) -> Result<Pose, ImportError> {
        let Some(origin) = node.first("origin") else { return Ok(Pose::IDENTITY) };
        let position = origin.exactly::<3>("xyz")?.unwrap_or_default();
        let [roll, pitch, yaw] = origin.exactly::<3>("rpy")?.unwrap_or_default();
        let rotation = DQuat::from_rotation_z(yaw) * DQuat::from_rotation_y(pitch) * DQuat::from_rotation_x(roll);
        Ok(Pose { position: DVec3::from_array(position), rotation })
    }

    fn color(&mut self, node: &Element) -> Result<Option<Material>, ImportError> {
        let rgba = match node.first("color") {
            Some(color) => color.exactly::<4>("rgba")?,
            None => None,
        };
        let texture = node.first("texture").and_then(|texture| texture.attribute("filename"));
        let texture = texture.and_then(|named| obj::texture(self.path, plain(named), self.files, &mut self.notes));
        if rgba.is_none() && texture.is_none() {
            return Ok(None);
        }
        let [r, g, b, a] = rgba.unwrap_or([1.0; 4]).map(|value| value.clamp(0.0, 1.0) as f32);
        Ok(Some(Material { opacity: a.max(0.05), texture, ..Material::plain([r, g, b], 0.5) }))
    }

    fn surfaces(&mut self, visual: &Element, material: Option<&Material>) -> Result<Vec<Surface>, ImportError> {
        let Some(geometry) = visual.first("geometry") else { return Ok(Vec::new()) };
        let own = material.cloned().unwrap_or_else(|| Material::plain(super::PLAIN, 0.5));
        if let Some(shape) = self.shape(geometry)? {
            return Ok(vec![Surface { name: String::new(), mesh: solid::mesh(&shape), material: own }]);
        }
        let Some(node) = geometry.first("mesh") else { return Ok(Vec::new()) };
        let (named, scale) = self.mesh_file(node)?;
        if super::extension(&named) != "obj" {
            let mesh = mesh(&named, self.files)?.transformed(&DMat4::from_scale(scale));
            return Ok(vec![Surface { name: String::new(), mesh, material: own }]);
        }
        let mut surfaces = obj::surfaces(&named, self.files, &mut self.notes)?;
        for surface in &mut surfaces {
            surface.mesh = std::mem::take(&mut surface.mesh).transformed(&DMat4::from_scale(scale));
            // The description's material overrides that of the mesh, unless the mesh has a texture.
            if let Some(material) = material.filter(|_| surface.material.texture.is_none()) {
                surface.material = material.clone();
            }
        }
        Ok(surfaces)
    }

    fn mesh(&mut self, geometry: &Element) -> Result<Option<RawMesh>, ImportError> {
        let Some(node) = geometry.first("mesh") else { return Ok(None) };
        let (named, scale) = self.mesh_file(node)?;
        Ok(Some(mesh(&named, self.files)?.transformed(&DMat4::from_scale(scale))))
    }

    fn mesh_file(&self, node: &Element) -> Result<(String, DVec3), ImportError> {
        let named = node.attribute("filename").ok_or_else(|| node.wrong("expected a filename"))?;
        let scale = match node.numbers("scale")?.as_deref() {
            None => DVec3::ONE,
            Some(&[all]) => DVec3::splat(all),
            Some(&[x, y, z]) => DVec3::new(x, y, z),
            Some(_) => return Err(node.wrong("expected one or three numbers as scale")),
        };
        Ok((beside(self.path, plain(named))?, scale))
    }

    fn shape(&self, geometry: &Element) -> Result<Option<Shape>, ImportError> {
        let Some(node) = geometry.children.first() else { return Ok(None) };
        let size = |name: &str| {
            let value = node.number(name, 0.0)?;
            if value > 0.0 { Ok(value) } else { Err(node.wrong(format!("{name}: expected a positive length"))) }
        };
        Ok(match node.tag.as_str() {
            "box" => {
                let size = DVec3::from_array(node.exactly::<3>("size")?.unwrap_or_default());
                if size.min_element() <= 0.0 {
                    return Err(node.wrong("expected three positive lengths as size"));
                }
                Some(Shape::Box { half_extents: size / 2.0 })
            }
            "sphere" => Some(Shape::Sphere { radius: size("radius")? }),
            "cylinder" => Some(Shape::Cylinder { radius: size("radius")?, half_height: size("length")? / 2.0 }),
            "capsule" => Some(Shape::Capsule { radius: size("radius")?, half_length: size("length")? / 2.0 }),
            _ => None,
        })
    }
}

/// Strips the `package://` scheme of ROS; the package is the description's folder.
fn plain(named: &str) -> &str {
    named.strip_prefix("package://").map_or(named, |rest| rest.split_once('/').map_or(rest, |(_, inside)| inside))
}

/// Merges a fixed link into its parent.
fn merge(into: &mut RawLink, mut link: RawLink, pose: &Pose) {
    let transform = DMat4::from_rotation_translation(pose.rotation, pose.position);
    for mut surface in link.surfaces.drain(..) {
        surface.mesh = surface.mesh.transformed(&transform);
        into.surfaces.push(surface);
    }
    into.collision.extend(link.collision.drain(..).map(|collision| match collision {
        RawCollision::Piece(piece) => {
            RawCollision::Piece(Piece { link_from_piece: *pose * piece.link_from_piece, ..piece })
        }
        RawCollision::HullOf(points) => {
            RawCollision::HullOf(points.iter().map(|point| pose.transform_point(*point)).collect())
        }
        RawCollision::Mesh(mesh) => RawCollision::Mesh(mesh.transformed(&transform)),
    }));
    into.friction = into.friction.or(link.friction);
    if let Some(mass) = link.mass.map(|mass| transformed_mass(&mass, pose)) {
        into.mass = Some(match into.mass {
            None => mass,
            Some(own) => combined(&own, &mass),
        });
    }
}

/// Combined mass properties of two bodies.
pub fn combined(a: &MassProperties, b: &MassProperties) -> MassProperties {
    let mass_kg = a.mass_kg + b.mass_kg;
    let center = (a.center * a.mass_kg + b.center * b.mass_kg) / mass_kg;
    let about = |one: &MassProperties| {
        let d = one.center - center;
        let outer = DMat3::from_cols(d * d.x, d * d.y, d * d.z);
        one.inertia + (DMat3::from_diagonal(DVec3::splat(d.length_squared())) - outer) * one.mass_kg
    };
    MassProperties { mass_kg, center, inertia: about(a) + about(b) }
}

type Ordered<'b, 'x> = Vec<(&'x Element, &'x str, Option<&'b FileJoint<'x>>)>;

/// Links, parents first, each with its joint.
fn ordered<'b, 'x>(
    robot: &'x Element,
    links: &[&'x Element],
    joints: &'b [FileJoint<'x>],
) -> Result<Ordered<'b, 'x>, ImportError> {
    let mut nodes: BTreeMap<&str, &'x Element> = BTreeMap::new();
    for link in links {
        let name = link.attribute("name").ok_or_else(|| link.wrong("expected a name"))?;
        if nodes.insert(name, link).is_some() {
            return Err(link.wrong("duplicate link name"));
        }
    }
    let mut hung: BTreeMap<&str, &FileJoint<'x>> = BTreeMap::new();
    for joint in joints {
        for end in [joint.parent, joint.child] {
            if !nodes.contains_key(end) {
                return Err(robot.wrong(format!("a joint refers to the unknown link `{}`", shortened(end))));
            }
        }
        if hung.insert(joint.child, joint).is_some() {
            return Err(robot.wrong(format!("link `{}` has two parent joints", shortened(joint.child))));
        }
    }
    let roots: Vec<&str> = nodes.keys().copied().filter(|name| !hung.contains_key(name)).collect();
    let [root] = roots.as_slice() else {
        return Err(robot.wrong(format!("expected exactly one root link, got {}", roots.len())));
    };
    let (mut order, mut known) = (vec![(nodes[root], *root, None)], BTreeSet::from([*root]));
    while order.len() < nodes.len() {
        let before = order.len();
        // In file order, so that equal objects get equal indices.
        for joint in joints.iter().filter(|joint| known.contains(joint.parent)).collect::<Vec<_>>() {
            if known.insert(joint.child) {
                order.push((nodes[joint.child], joint.child, Some(joint)));
            }
        }
        if order.len() == before {
            return Err(robot.wrong("some links form a loop"));
        }
    }
    Ok(order)
}
