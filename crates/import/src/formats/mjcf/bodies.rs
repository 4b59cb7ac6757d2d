//! Bodies, geoms and joints.

use genmanip_core::{Joint, JointKind, MassProperties, Material, Piece, Pose, Shape};
use glam::{DMat3, DMat4, DQuat, DVec3};

use super::assets::Assets;
use super::settings::Settings;
use crate::ImportError;
use crate::collision::piece_volume;
use crate::files::{Files, shortened};
use crate::formats::solid;
use crate::formats::xml::Element;
use crate::raw::{MAX_LINKS, RawCollision, RawLink, RawMesh, Surface};
use crate::units_and_frame::transformed_mass;

/// Geom groups 0, 1 and 2 are visible.
const MAX_VISIBLE_GROUP: f64 = 2.5;
/// Range of an unlimited joint: rad, m.
const UNLIMITED: [f64; 2] = [std::f64::consts::PI, 0.2];
/// Default damping and dry friction of a joint, N·m·s/rad and N·m, or N·s/m and N.
const DAMPING: f64 = 0.1;
const FRICTION_LOSS: f64 = 0.05;

/// Links of the object in a world; bodies without joints are merged into their parents.
pub fn links(
    root: &Element,
    main: &str,
    settings: &Settings,
    assets: &Assets<'_>,
    files: &mut Files<'_>,
    notes: &mut Vec<String>,
) -> Result<Vec<RawLink>, ImportError> {
    let mut reader = Reader {
        settings,
        assets,
        files,
        notes,
        links: vec![RawLink { name: "body".into(), ..RawLink::default() }],
        free: 0,
    };
    let worlds: Vec<&Element> = root.all("worldbody").collect();
    // A `worldbody` from an included file is the scene around the object.
    let own = |world: &&&Element| world.place.0 == main && world.first("body").is_some();
    let is_scene = |world: &&Element| worlds.iter().any(|world| own(&world)) && !own(&world);
    let bodies: Vec<&Element> =
        worlds.iter().filter(|world| !is_scene(world)).flat_map(|world| world.all("body")).collect();
    let all = worlds.iter().flat_map(|world| world.all("body")).count();
    // If exactly one body moves freely, it is the object.
    let free: Vec<&Element> = bodies.iter().copied().filter(|body| is_free(body)).collect();
    let bodies = if free.len() == 1 { free } else { bodies };
    if bodies.len() < all {
        reader.notes.push(format!("ignored {} bodies of the surrounding scene", all - bodies.len()));
    }
    for body in &bodies {
        reader.body(body, 0, Pose::IDENTITY, "main")?;
    }
    // Next to bodies, the world's own geoms are floors and decoration.
    if bodies.is_empty() {
        for world in &worlds {
            reader.geoms(world, 0, Pose::IDENTITY, "main")?;
        }
    }
    if reader.free > 1 {
        let message = format!("{} bodies move freely, so the file contains several objects", reader.free);
        return Err(ImportError::new(main, message).hint("expected one object per file, not a scene"));
    }
    Ok(reader.links)
}

/// True if a body of the world moves freely.
fn is_free(body: &Element) -> bool {
    body.children
        .iter()
        .any(|child| child.tag == "freejoint" || (child.tag == "joint" && child.attribute("type") == Some("free")))
}

struct Reader<'a, 'b> {
    settings: &'a Settings,
    assets: &'a Assets<'a>,
    files: &'a mut Files<'b>,
    notes: &'a mut Vec<String>,
    links: Vec<RawLink>,
    free: usize,
}

impl Reader<'_, '_> {
    /// Reads a body, in the frame of a link, and its descendants.
    fn body(&mut self, body: &Element, link: usize, link_from_around: Pose, class: &str) -> Result<(), ImportError> {
        let class = body.attribute("childclass").unwrap_or(class).to_owned();
        let mut link_from_body = link_from_around * self.settings.pose(body)?;
        let mut link = link;
        let (mut moving, mut named) = (Vec::new(), Vec::new());
        for joint in body.children.iter().filter(|child| child.tag == "joint" || child.tag == "freejoint") {
            let joint = self.settings.complete(joint, &class)?;
            let kind = if joint.tag == "freejoint" { "free" } else { joint.attribute("type").unwrap_or("hinge") };
            match kind {
                "free" => self.free += 1,
                "hinge" => moving.push((JointKind::Revolute, joint)),
                "slide" => moving.push((JointKind::Prismatic, joint)),
                other => named.push(other.to_owned()),
            }
        }
        // Several slides on the root place the whole object in an environment; they are not joints of the object.
        let slides = moving.iter().filter(|(kind, _)| *kind == JointKind::Prismatic).count();
        if slides >= 2 && link == 0 {
            self.free += 1;
            moving.clear();
        }
        if moving.len() > 1 {
            named.extend(moving.drain(1..).map(|(_, joint)| joint.attribute("name").unwrap_or("joint").to_owned()));
        }
        let name = body.attribute("name").unwrap_or("part");
        if !named.is_empty() {
            let (names, name) = (shortened(&named.join(", ")), shortened(name));
            self.notes.push(format!(
                "body {name}: only one hinge or slide per body is supported; joints {names} are treated as fixed"
            ));
        }
        if let Some((kind, joint)) = moving.pop() {
            let made = self.joint(&joint, kind, link, link_from_body)?;
            if self.links.len() == MAX_LINKS {
                return Err(body.wrong(format!("more than {MAX_LINKS} moving bodies")));
            }
            // The link's frame is the joint's, so the body is offset by the joint's position.
            link_from_body = Pose::from_position(-DVec3::from_array(joint.exactly::<3>("pos")?.unwrap_or_default()));
            let unique = self.links.iter().all(|link| link.name != name);
            let name = if unique { name.to_owned() } else { format!("{name}_{}", self.links.len()) };
            self.links.push(RawLink { name, joint: Some(made), ..RawLink::default() });
            link = self.links.len() - 1;
        }
        self.geoms(body, link, link_from_body, &class)?;
        if let Some(inertial) = body.first("inertial") {
            let mass = self.inertial(inertial, &link_from_body)?;
            self.add_mass(link, mass, true);
        }
        for child in body.all("body") {
            self.body(child, link, link_from_body, &class)?;
        }
        Ok(())
    }

    fn joint(
        &self,
        joint: &Element,
        kind: JointKind,
        parent: usize,
        parent_from_body: Pose,
    ) -> Result<Joint, ImportError> {
        let axis = DVec3::from_array(joint.exactly::<3>("axis")?.unwrap_or([0.0, 0.0, 1.0]));
        let axis = axis.try_normalize().ok_or_else(|| joint.wrong("its axis has no length"))?;
        let at = DVec3::from_array(joint.exactly::<3>("pos")?.unwrap_or_default());
        let is_limited = match joint.attribute("limited") {
            Some("true") => true,
            Some("false") => false,
            _ => self.settings.limits_by_range && joint.attributes.contains_key("range"),
        };
        let is_hinge = kind == JointKind::Revolute;
        let range = match joint.exactly::<2>("range")? {
            Some(range) if is_limited => range.map(|value| if is_hinge { self.settings.angle(value) } else { value }),
            _ => {
                let most = UNLIMITED[usize::from(!is_hinge)];
                [-most, most]
            }
        };
        if range[0] >= range[1] {
            return Err(joint.wrong(format!("expected an increasing range, got {} to {}", range[0], range[1])));
        }
        Ok(Joint {
            name: joint.attribute("name").map_or_else(|| format!("joint_{}", self.links.len()), str::to_owned),
            parent,
            kind,
            parent_from_joint: parent_from_body * Pose::from_position(at),
            axis,
            range,
            damping: joint.number("damping", DAMPING)?.max(0.0),
            friction_loss: joint.number("frictionloss", FRICTION_LOSS)?.max(0.0),
            stiffness: joint.number("stiffness", 0.0)?.max(0.0),
            spring_reference: {
                let value = joint.number("springref", 0.0)?;
                if is_hinge { self.settings.angle(value) } else { value }
            },
        })
    }

    fn inertial(&self, inertial: &Element, link_from_body: &Pose) -> Result<MassProperties, ImportError> {
        let body_from_inertial = self.settings.pose(inertial)?;
        let mass_kg = inertial.number("mass", 0.0)?;
        let inertia = match (inertial.exactly::<3>("diaginertia")?, inertial.exactly::<6>("fullinertia")?) {
            (Some(diagonal), _) => DMat3::from_diagonal(DVec3::from_array(diagonal)),
            (None, Some([xx, yy, zz, xy, xz, yz])) => {
                DMat3::from_cols(DVec3::new(xx, xy, xz), DVec3::new(xy, yy, yz), DVec3::new(xz, yz, zz))
            }
            (None, None) => DMat3::ZERO,
        };
        let own = MassProperties { mass_kg, center: DVec3::ZERO, inertia };
        Ok(transformed_mass(&own, &(*link_from_body * body_from_inertial)))
    }

    fn add_mass(&mut self, link: usize, mass: MassProperties, replaces: bool) {
        let known = &mut self.links[link].mass;
        *known = match known.take() {
            _ if mass.mass_kg <= 0.0 => None,
            Some(own) if !replaces => Some(crate::formats::urdf::combined(&own, &mass)),
            _ => Some(mass),
        };
    }

    /// Adds a body's visual and collision geoms.
    fn geoms(&mut self, body: &Element, link: usize, link_from_body: Pose, class: &str) -> Result<(), ImportError> {
        let geoms = body.all("geom").map(|geom| self.settings.complete(geom, class)).collect::<Result<Vec<_>, _>>()?;
        let touches = |geom: &Element| -> Result<bool, ImportError> {
            Ok(geom.number("contype", 1.0)? != 0.0 || geom.number("conaffinity", 1.0)? != 0.0)
        };
        let mut has_drawn_only = false;
        for geom in &geoms {
            has_drawn_only |= !touches(geom)? && geom.number("group", 0.0)? < MAX_VISIBLE_GROUP;
        }
        let mut mass_kg = 0.0;
        for geom in &geoms {
            let kind =
                geom.attribute("type").unwrap_or(if geom.attributes.contains_key("mesh") { "mesh" } else { "sphere" });
            if matches!(kind, "plane" | "hfield" | "sdf") {
                self.notes.push(format!("a geom of type {kind} is ignored"));
                continue;
            }
            let (pose, shape) = self.shape(geom, kind)?;
            let pose = link_from_body * pose;
            let transform = DMat4::from_rotation_translation(pose.rotation, pose.position);
            let group = geom.number("group", 0.0)?;
            let touches = touches(geom)?;
            let mesh = match geom.attribute("mesh").filter(|_| kind == "mesh") {
                Some(name) => Some(self.assets.mesh(geom, name, self.files)?.transformed(&transform)),
                None => None,
            };
            let (material, repeat) = self.assets.material(geom, self.files, self.notes)?;
            // By convention, group 0 is collision-only if other geoms are visual-only.
            let is_drawn = group < MAX_VISIBLE_GROUP
                && !(touches && has_drawn_only && group < 0.5)
                && geom.exactly::<4>("rgba")?.is_none_or(|rgba| rgba[3] > 0.0);
            if is_drawn {
                let mesh = mesh.clone().or_else(|| Some(solid::mesh(shape.as_ref()?).transformed(&transform)));
                let name = geom.attribute("name").or(geom.attribute("mesh")).unwrap_or("surface").to_owned();
                self.links[link].surfaces.extend(mesh.map(|mesh| visual_surface(name, mesh, material, repeat)));
            }
            if touches {
                match (&shape, &mesh) {
                    (Some(shape), _) => self.links[link]
                        .collision
                        .push(RawCollision::Piece(Piece { shape: shape.clone(), link_from_piece: pose })),
                    // The engine uses the hull of a mesh.
                    (None, Some(mesh)) => self.links[link].collision.push(RawCollision::HullOf(mesh.positions.clone())),
                    (None, None) => {}
                }
                if let Some(friction) = geom.numbers("friction")?.and_then(|values| values.first().copied()) {
                    let link = &mut self.links[link];
                    link.friction = Some(link.friction.map_or(friction, |known: f64| known.max(friction)));
                }
            }
            let [from, to] = self.settings.mass_groups;
            if (from..=to).contains(&group) {
                if let Some([mass]) = geom.exactly::<1>("mass")? {
                    mass_kg += mass;
                } else if let Some([density]) = geom.exactly::<1>("density")? {
                    match &shape {
                        Some(shape) => mass_kg += density * piece_volume(&Piece::at(DVec3::ZERO, shape.clone())),
                        None => self.links[link].density = Some(density),
                    }
                }
            }
        }
        if mass_kg > 0.0 {
            self.add_mass(
                link,
                MassProperties { mass_kg, center: link_from_body.position, inertia: DMat3::ZERO },
                false,
            );
        }
        Ok(())
    }

    /// Pose of a geom in its body, and its shape unless it is a mesh.
    fn shape(&self, geom: &Element, kind: &str) -> Result<(Pose, Option<Shape>), ImportError> {
        let mut pose = self.settings.pose(geom)?;
        let size = geom.numbers("size")?.unwrap_or_default();
        let at = |index: usize| {
            let value = size.get(index).copied().unwrap_or(0.0);
            if value > 0.0 {
                Ok(value)
            } else {
                Err(geom.wrong(format!("size: expected a positive length as number {}", index + 1)))
            }
        };
        let mut half = None;
        if let Some([a, b, c, d, e, f]) = geom.exactly::<6>("fromto")? {
            let (from, to) = (DVec3::new(a, b, c), DVec3::new(d, e, f));
            let along = (to - from).try_normalize().ok_or_else(|| geom.wrong("fromto: both ends are equal"))?;
            pose = Pose { position: (from + to) / 2.0, rotation: DQuat::from_rotation_arc(DVec3::Z, along) };
            half = Some(from.distance(to) / 2.0);
        }
        let shape = match kind {
            "mesh" => None,
            "sphere" => Some(Shape::Sphere { radius: at(0)? }),
            "capsule" => Some(Shape::Capsule { radius: at(0)?, half_length: half.map_or_else(|| at(1), Ok)? }),
            "cylinder" => Some(Shape::Cylinder { radius: at(0)?, half_height: half.map_or_else(|| at(1), Ok)? }),
            "ellipsoid" => Some(Shape::Ellipsoid { radii: DVec3::new(at(0)?, at(1)?, at(2)?) }),
            "box" => {
                let z = half.map_or_else(|| at(2), Ok)?;
                Some(Shape::Box { half_extents: DVec3::new(at(0)?, if half.is_some() { at(0)? } else { at(1)? }, z) })
            }
            other => return Err(geom.wrong(format!("unknown type `{}`", shortened(other)))),
        };
        Ok((pose, shape))
    }
}

/// A visual surface; a texture without texture coordinates is replaced by its mean colour.
fn visual_surface(name: String, mut mesh: RawMesh, mut material: Material, repeat: [f32; 2]) -> Surface {
    if let Some(texture) = material.texture.take() {
        if mesh.uvs.len() == mesh.positions.len() && texture.width > 1 {
            mesh.uvs.iter_mut().for_each(|uv| *uv = [uv[0] * repeat[0], uv[1] * repeat[1]]);
            material.texture = Some(texture);
        } else {
            let pixels = (texture.rgb.len() / 3).max(1) as f32 * 255.0;
            let mean = |channel: usize| {
                texture.rgb.iter().skip(channel).step_by(3).map(|&value| f32::from(value)).sum::<f32>() / pixels
            };
            material.base_color = [0, 1, 2].map(|channel| material.base_color[channel] * mean(channel));
        }
    }
    Surface { name, mesh, material }
}
