//! Objects from URDF as written by PartNet-Mobility, ManiSkill and pybullet: links with surfaces, joints, masses.

use std::collections::BTreeMap;

use genmanip_core::limits::{IMPORTED_MESH, SETTINGS};
use genmanip_core::{Joint, JointKind, MassProperties, Material, Piece, Pose};
use glam::{DMat3, DMat4, DVec3};

use super::{Form, Motion, form, links, mass, origin, robot};
use crate::ImportError;
use crate::files::{Files, beside, shortened};
use crate::formats::xml::Element;
use crate::formats::{self, dae, mesh, obj, solid};
use crate::raw::{MAX_LINKS, RawCollision, RawLink, RawObject, Surface, Unit, Up};
use crate::units_and_frame::transformed_mass;

/// Default damping and (`FRICTION_LOSS`) dry friction of a joint, N·m·s/rad and N·m, or N·s/m and N: enough to keep a
/// door or drawer in place when released.
const DAMPING: f64 = 0.1;
const FRICTION_LOSS: f64 = 0.05;
/// Range assigned to a turning joint without limits, rad, and (`SLIDE`) to a slide without limits, m.
const CONTINUOUS: [f64; 2] = [-std::f64::consts::PI, std::f64::consts::PI];
const SLIDE: [f64; 2] = [-0.2, 0.2];

/// Reads the object of a URDF; links with fixed joints are merged into their parents.
///
/// # Errors
/// With the line of a joint to an unknown link, a loop, an invalid number or a missing mesh.
pub fn read(path: &str, files: &mut Files<'_>) -> Result<RawObject, ImportError> {
    let robot = robot(path, files)?;
    let mut reader = Surfaces::new(path, files, &robot)?;
    let mut notes = Vec::new();
    let links = links(&robot, 8 * MAX_LINKS, &mut notes)?;
    reader.notes.append(&mut notes);
    // For each original link: index of the link it was merged into, and its pose there.
    let mut places: Vec<(usize, Pose)> = Vec::new();
    let mut made: Vec<RawLink> = Vec::new();
    for link in &links {
        let own = reader.link(link.node, link.name)?;
        let moving = |joint| RawLink { name: link.name.to_owned(), joint, ..RawLink::default() };
        let (index, pose) = match &link.joint {
            None => {
                made.push(moving(None));
                (made.len() - 1, Pose::IDENTITY)
            }
            Some((parent, joint)) => {
                let (parent, parent_from_fixed) = places[*parent];
                let parent_from_joint = parent_from_fixed * joint.parent_from_joint;
                let motion = joint.motion.as_ref().map(|motion| reader.joint(joint.name, joint.node, motion));
                match motion.transpose()? {
                    None => (parent, parent_from_joint),
                    Some(moves) => {
                        made.push(moving(Some(Joint { parent, parent_from_joint, ..moves })));
                        (made.len() - 1, Pose::IDENTITY)
                    }
                }
            }
        };
        places.push((index, pose));
        merge(&mut made[index], own, &pose);
    }
    if made.len() > MAX_LINKS {
        return Err(ImportError::new(path, format!("{} moving links; at most {MAX_LINKS} are supported", made.len())));
    }
    let is_empty = |link: &RawLink| link.surfaces.is_empty() && link.collision.is_empty();
    if let Some(missing) = reader.missing.take().filter(|_| made.iter().all(is_empty)) {
        return Err(missing);
    }
    let notes = std::mem::take(&mut reader.notes);
    let is_partnet = path.rsplit('/').next() == Some("mobility.urdf");
    let said = robot.attribute("name").unwrap_or_default().to_owned();
    Ok(RawObject {
        name: is_partnet.then(|| partnet_category(path, files)).flatten().unwrap_or(said),
        links: made,
        // PartNet-Mobility normalises every object to a diagonal of about two.
        unit: if is_partnet { Unit::Normalised } else { Unit::Metre },
        up: Up::Z,
        licence: None,
        creator: None,
        notes,
    })
}

/// Category in the metadata beside an object of PartNet-Mobility. `None` if there is none.
fn partnet_category(path: &str, files: &mut Files<'_>) -> Option<String> {
    let text = files.text(&beside(path, "meta.json").ok()?, SETTINGS).ok()?;
    let metadata: serde_json::Value = serde_json::from_str(&text).ok()?;
    metadata["model_cat"].as_str().map(shortened)
}

/// Reader of the visual surfaces of a URDF's links.
pub struct Surfaces<'a, 'b> {
    path: &'a str,
    files: &'a mut Files<'b>,
    /// Repairs and omissions so far, one sentence each.
    pub notes: Vec<String>,
    colors: BTreeMap<String, Material>,
    /// Error of the first missing mesh of an object; fatal only if no surface is left. `None` if no mesh is missing.
    missing: Option<ImportError>,
}

impl<'a, 'b> Surfaces<'a, 'b> {
    /// Reader with the materials of a robot.
    ///
    /// # Errors
    /// If a colour is invalid.
    pub fn new(path: &'a str, files: &'a mut Files<'b>, robot: &Element) -> Result<Self, ImportError> {
        let mut reader = Self { path, files, notes: Vec::new(), colors: BTreeMap::new(), missing: None };
        for material in robot.all("material") {
            if let (Some(name), Some(color)) = (material.attribute("name"), reader.color(material)?) {
                reader.colors.insert(name.to_owned(), color);
            }
        }
        Ok(reader)
    }

    /// Joint of an object; parent and frame are filled in later.
    fn joint(&mut self, name: &str, node: &Element, motion: &Motion<'_>) -> Result<Joint, ImportError> {
        let dynamics = node.first("dynamics");
        let number = |name, otherwise| dynamics.map_or(Ok(otherwise), |node| node.number(name, otherwise));
        let otherwise = if motion.kind == JointKind::Prismatic { SLIDE } else { CONTINUOUS };
        if motion.range.is_none() && !motion.continuous {
            let [lower, upper] = otherwise;
            self.notes
                .push(format!("joint {} states no limits: {lower:.2} to {upper:.2} are assumed", shortened(name)));
        }
        if let Some((leader, ..)) = motion.mimic {
            let [name, leader] = [name, leader].map(shortened);
            self.notes.push(format!("joint {name} should follow {leader}; joints of an object move by themselves"));
        }
        Ok(Joint {
            name: name.to_owned(),
            parent: 0,
            kind: motion.kind,
            parent_from_joint: Pose::IDENTITY,
            axis: motion.axis,
            range: motion.range.unwrap_or(otherwise),
            damping: number("damping", DAMPING)?.max(0.0),
            friction_loss: number("friction", FRICTION_LOSS)?.max(0.0),
            stiffness: 0.0,
            spring_reference: 0.0,
        })
    }

    /// Contents of a link, in its own frame.
    fn link(&mut self, node: &Element, name: &str) -> Result<RawLink, ImportError> {
        let mut link = RawLink { name: name.to_owned(), surfaces: self.visual(node, name)?, ..RawLink::default() };
        for collision in node.all("collision") {
            let link_from_piece = origin(collision)?;
            match form(self.path, collision, self.files, &mut self.notes)? {
                None => {}
                Some(Form::Shape(shape)) => link.collision.push(RawCollision::Piece(Piece { shape, link_from_piece })),
                Some(Form::Mesh(file, _)) if self.is_missing(&file) => {}
                Some(Form::Mesh(file, scale)) => {
                    let mesh = mesh(&file, self.files)?.transformed(&DMat4::from_scale(scale));
                    let Pose { position, rotation } = link_from_piece;
                    let transform = DMat4::from_rotation_translation(rotation, position);
                    link.collision.push(RawCollision::Mesh(mesh.transformed(&transform)));
                }
            }
        }
        if let Some(inertial) = node.first("inertial") {
            link.mass = mass(inertial)?;
        }
        if let Some(friction) = node.first("contact").and_then(|contact| contact.first("lateral_friction")) {
            link.friction = Some(friction.number("value", 0.6)?);
        }
        Ok(link)
    }

    /// Visual surfaces of a link, in its frame.
    ///
    /// # Errors
    /// If a number is invalid or a mesh is missing or damaged.
    pub fn visual(&mut self, node: &Element, name: &str) -> Result<Vec<Surface>, ImportError> {
        let mut all = Vec::new();
        for visual in node.all("visual") {
            let material = match visual.first("material") {
                Some(material) => {
                    self.color(material)?.or_else(|| self.colors.get(material.attribute("name")?).cloned())
                }
                None => None,
            };
            let origin = origin(visual)?;
            let transform = DMat4::from_rotation_translation(origin.rotation, origin.position);
            let part = visual.attribute("name").unwrap_or(name).to_owned();
            for surface in self.surfaces(visual, material.as_ref())? {
                let mesh = surface.mesh.transformed(&transform);
                all.push(Surface { name: part.clone(), mesh, ..surface });
            }
        }
        Ok(all)
    }

    /// True if a mesh of an object is missing, which is noted; for a robot, a missing mesh is an error.
    fn is_missing(&mut self, file: &str) -> bool {
        let Some(error) = self.files.is_object().then(|| self.files.bytes(file, IMPORTED_MESH).err()).flatten() else {
            return false;
        };
        self.notes.push(format!("a mesh is left out: {error}"));
        self.missing.get_or_insert(error);
        true
    }

    fn color(&mut self, node: &Element) -> Result<Option<Material>, ImportError> {
        let rgba = match node.first("color") {
            Some(color) => color.exactly::<4>("rgba")?,
            None => None,
        };
        let texture = node.first("texture").and_then(|texture| texture.attribute("filename"));
        let texture = texture.and_then(|named| match self.files.locate(self.path, named) {
            Ok(file) => obj::image(&file, self.files, &mut self.notes),
            Err(error) => {
                self.notes.push(format!("texture ignored: {error}"));
                None
            }
        });
        if rgba.is_none() && texture.is_none() {
            return Ok(None);
        }
        let [r, g, b, a] = rgba.unwrap_or([1.0; 4]).map(|value| value.clamp(0.0, 1.0) as f32);
        Ok(Some(Material { opacity: a.max(0.05), texture, ..Material::plain([r, g, b], 0.5) }))
    }

    fn surfaces(&mut self, visual: &Element, material: Option<&Material>) -> Result<Vec<Surface>, ImportError> {
        let own = material.cloned().unwrap_or_else(|| Material::plain(formats::PLAIN, 0.5));
        let (file, scale) = match form(self.path, visual, self.files, &mut self.notes)? {
            None => return Ok(Vec::new()),
            Some(Form::Shape(shape)) => {
                return Ok(vec![Surface { name: String::new(), mesh: solid::mesh(&shape), material: own }]);
            }
            Some(Form::Mesh(file, _)) if self.is_missing(&file) => return Ok(Vec::new()),
            Some(Form::Mesh(file, scale)) => (file, scale),
        };
        let mut surfaces = match formats::extension(&file).as_str() {
            "obj" => obj::surfaces(&file, self.files, &mut self.notes)?,
            "dae" => dae::surfaces(&file, self.files, &mut self.notes)?.surfaces,
            _ => vec![Surface { name: String::new(), mesh: mesh(&file, self.files)?, material: own }],
        };
        for surface in &mut surfaces {
            surface.mesh = std::mem::take(&mut surface.mesh).transformed(&DMat4::from_scale(scale));
            // The description's material overrides that of the mesh, unless the mesh has a texture.
            if let Some(material) = material.filter(|_| surface.material.texture.is_none()) {
                surface.material = material.clone();
            }
        }
        Ok(surfaces)
    }
}

/// Merges a link with a fixed joint into its parent, at `pose` in the parent's frame.
pub fn merge(into: &mut RawLink, mut link: RawLink, pose: &Pose) {
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
    into.friction = into.friction.into_iter().chain(link.friction).reduce(f64::max);
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
