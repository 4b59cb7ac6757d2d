//! One object of a compiled file: links of its moving bodies, with surfaces, collision geometry and mass.

use std::collections::BTreeMap;
use std::sync::Arc;

use genmanip_core::{Joint, JointKind, Material, Piece, Pose, Texture};
use genmanip_sim::{FlatBody, FlatGeom, FlatJoint, FlatJointKind, FlatShape, Flattened};
use glam::{DMat4, DQuat, DVec3};

use crate::ImportError;
use crate::files::shortened;
use crate::formats::{solid, urdf};
use crate::raw::{MAX_LINKS, RawCollision, RawLink, RawMesh, Surface};
use crate::units_and_frame::transformed_mass;

/// Geom groups 0, 1 and 2 are visible.
const MAX_VISIBLE_GROUP: i32 = 2;
/// Range assigned to a joint without limits: ±rad of a hinge, ±m of a slide.
const UNLIMITED: [f64; 2] = [std::f64::consts::PI, 0.2];
/// Damping and (`FRICTION_LOSS`) dry friction of a joint that states none: N·m·s/rad and N·m, or N·s/m and N.
const DAMPING: f64 = 0.1;
const FRICTION_LOSS: f64 = 0.05;
/// Sliding friction coefficient that MuJoCo assumes for a geom without one.
const UNSTATED_FRICTION: f64 = 1.0;

/// Links of the object in a world; bodies without joints are merged into their parents. `textures` are the textures of
/// files; the compiled file refers to each by the height of its placeholder image.
///
/// # Errors
/// If several bodies move freely, or there are too many moving bodies.
pub fn links(
    flat: &Flattened,
    main: &str,
    textures: &BTreeMap<u32, Arc<Texture>>,
    notes: &mut Vec<String>,
) -> Result<Vec<RawLink>, ImportError> {
    let mut reader = Reader {
        flat,
        main,
        textures,
        notes,
        links: vec![RawLink { name: "body".into(), ..RawLink::default() }],
        places: vec![None; flat.bodies.len()],
        free: 0,
    };
    let tops: Vec<usize> = (1..flat.bodies.len()).filter(|index| flat.bodies[*index].parent == 0).collect();
    // If exactly one body moves freely, it is the object.
    let free: Vec<usize> = tops.iter().copied().filter(|index| is_free(&flat.bodies[*index])).collect();
    let chosen = if free.len() == 1 { &free } else { &tops };
    if chosen.len() < tops.len() {
        reader.notes.push(format!("ignored {} bodies of the surrounding scene", tops.len() - chosen.len()));
    }
    for (index, body) in flat.bodies.iter().enumerate().skip(1) {
        let around = match body.parent {
            0 => chosen.contains(&index).then_some((0, Pose::IDENTITY)),
            parent => reader.places[parent],
        };
        if let Some(around) = around {
            reader.body(index, body, around)?;
        }
    }
    // If there are bodies, the world's own geoms are only floor and decoration.
    if let (true, Some(world)) = (tops.is_empty(), flat.bodies.first()) {
        reader.geoms(world, 0, Pose::IDENTITY);
    }
    if reader.free > 1 {
        let message = format!("{} bodies move freely, so the file contains several objects", reader.free);
        return Err(ImportError::new(main, message).hint("expected one object per file, not a scene"));
    }
    Ok(reader.links)
}

/// True if a body of the world moves freely.
fn is_free(body: &FlatBody) -> bool {
    body.joints.iter().any(|joint| joint.kind == FlatJointKind::Free)
}

struct Reader<'a> {
    flat: &'a Flattened,
    main: &'a str,
    textures: &'a BTreeMap<u32, Arc<Texture>>,
    notes: &'a mut Vec<String>,
    links: Vec<RawLink>,
    /// Link that contains each body, and the body's pose in it; `None` for bodies outside the object.
    places: Vec<Option<(usize, Pose)>>,
    free: usize,
}

impl Reader<'_> {
    /// Reads a body; its parent lies in the given link at the given pose.
    fn body(
        &mut self,
        index: usize,
        body: &FlatBody,
        (mut link, link_from_parent): (usize, Pose),
    ) -> Result<(), ImportError> {
        let mut link_from_body = link_from_parent * body.parent_from_body;
        let (mut moving, mut fixed) = (Vec::new(), Vec::new());
        for joint in &body.joints {
            match joint.kind {
                FlatJointKind::Free => self.free += 1,
                FlatJointKind::Hinge => moving.push((JointKind::Revolute, joint)),
                FlatJointKind::Slide => moving.push((JointKind::Prismatic, joint)),
                FlatJointKind::Ball => fixed.push("ball"),
            }
        }
        // Several slides on the root body only position the object in an environment; they are not joints of the
        // object.
        if moving.iter().filter(|(kind, _)| *kind == JointKind::Prismatic).count() >= 2 && link == 0 {
            self.free += 1;
            moving.clear();
        }
        if moving.len() > 1 {
            fixed.extend(moving.drain(1..).map(|(_, joint)| or(&joint.name, "joint")));
        }
        let name = or(&body.name, "part");
        if !fixed.is_empty() {
            let (names, name) = (shortened(&fixed.join(", ")), shortened(name));
            self.notes.push(format!(
                "body {name}: only one hinge or slide per body is supported; joints {names} are treated as fixed"
            ));
        }
        if let Some((kind, joint)) = moving.pop() {
            if self.links.len() == MAX_LINKS {
                return Err(ImportError::new(self.main, format!("more than {MAX_LINKS} moving bodies")));
            }
            let made = self.joint(joint, kind, link, link_from_body);
            // The link's frame is at the joint, so the body is offset by the joint's position.
            link_from_body = Pose::from_position(-joint.anchor);
            let unique = self.links.iter().all(|link| link.name != name);
            let name = if unique { name.to_owned() } else { format!("{name}_{}", self.links.len()) };
            self.links.push(RawLink { name, joint: Some(made), ..RawLink::default() });
            link = self.links.len() - 1;
        }
        self.geoms(body, link, link_from_body);
        if body.mass.mass_kg > 0.0 {
            let mass = transformed_mass(&body.mass, &link_from_body);
            let known = &mut self.links[link].mass;
            *known = Some(known.take().map_or(mass, |own| urdf::combined(&own, &mass)));
        }
        self.places[index] = Some((link, link_from_body));
        Ok(())
    }

    fn joint(&self, joint: &FlatJoint, kind: JointKind, parent: usize, parent_from_body: Pose) -> Joint {
        let is_hinge = kind == JointKind::Revolute;
        let most = UNLIMITED[usize::from(!is_hinge)];
        // Body poses hold at the joint's reference position, but a link's frame is defined at position 0.
        let anchor_from_zero = match is_hinge {
            true => Pose { position: DVec3::ZERO, rotation: DQuat::from_axis_angle(joint.axis, -joint.reference) },
            false => Pose::from_position(joint.axis * -joint.reference),
        };
        let stated = |value: f64, otherwise: f64| if value > 0.0 { value } else { otherwise };
        Joint {
            name: if joint.name.is_empty() { format!("joint_{}", self.links.len()) } else { joint.name.clone() },
            parent,
            kind,
            parent_from_joint: parent_from_body * Pose::from_position(joint.anchor) * anchor_from_zero,
            axis: joint.axis,
            range: joint.range.unwrap_or([joint.reference - most, joint.reference + most]),
            damping: stated(joint.damping, DAMPING),
            friction_loss: stated(joint.friction_loss, FRICTION_LOSS),
            stiffness: joint.stiffness.max(0.0),
            spring_reference: joint.spring_reference,
        }
    }

    /// Adds a body's visual and collision geoms.
    fn geoms(&mut self, body: &FlatBody, link: usize, link_from_body: Pose) {
        let has_drawn_only = body.geoms.iter().any(|geom| !geom.collides && geom.group <= MAX_VISIBLE_GROUP);
        for geom in &body.geoms {
            let pose = link_from_body * geom.body_from_geom;
            let transform = DMat4::from_rotation_translation(pose.rotation, pose.position);
            let mesh = match &geom.shape {
                FlatShape::Unbounded(kind) => {
                    self.notes.push(format!("a geom of type {kind} is ignored"));
                    continue;
                }
                FlatShape::Primitive(shape) => solid::mesh(shape),
                FlatShape::Mesh(index) => {
                    let mesh = &self.flat.meshes[*index];
                    RawMesh {
                        positions: mesh.positions.clone(),
                        uvs: mesh.uvs.clone(),
                        triangles: mesh.triangles.clone(),
                    }
                }
            };
            let mesh = mesh.transformed(&transform);
            // By convention, group 0 is collision-only if other geoms are visual-only.
            let is_drawn = geom.group <= MAX_VISIBLE_GROUP
                && !(geom.collides && has_drawn_only && geom.group <= 0)
                && geom.rgba.is_none_or(|rgba| rgba[3] > 0.0);
            if geom.collides {
                self.links[link].collision.push(match &geom.shape {
                    FlatShape::Primitive(shape) => {
                        RawCollision::Piece(Piece { shape: shape.clone(), link_from_piece: pose })
                    }
                    // The engine uses the hull of a mesh.
                    FlatShape::Mesh(_) | FlatShape::Unbounded(_) => RawCollision::HullOf(mesh.positions.clone()),
                });
                if geom.friction != UNSTATED_FRICTION {
                    let link = &mut self.links[link];
                    link.friction = Some(link.friction.map_or(geom.friction, |known: f64| known.max(geom.friction)));
                }
            }
            if is_drawn {
                let surface = self.surface(geom, mesh);
                self.links[link].surfaces.push(surface);
            }
        }
    }

    /// A visual surface; a texture without texture coordinates is replaced by its mean colour.
    fn surface(&self, geom: &FlatGeom, mut mesh: RawMesh) -> Surface {
        let mesh_name = match &geom.shape {
            FlatShape::Mesh(index) => self.flat.meshes[*index].name.as_str(),
            FlatShape::Primitive(_) | FlatShape::Unbounded(_) => "",
        };
        let name = or(&geom.name, or(mesh_name, "surface")).to_owned();
        let Some(flat) = geom.material.map(|index| &self.flat.materials[index]) else {
            let material = colored(geom.rgba.unwrap_or([0.5, 0.5, 0.5, 1.0]), 0.5);
            return Surface { name, mesh, material };
        };
        let roughness = if flat.roughness >= 0.0 { flat.roughness } else { 1.0 - 0.8 * flat.shininess.clamp(0.0, 1.0) };
        let mut material = colored(geom.rgba.unwrap_or(flat.rgba), roughness.clamp(0.2, 0.9));
        material.metallic = flat.metallic.clamp(0.0, 1.0);
        let Some(drawn) = flat.texture.map(|index| &self.flat.textures[index]) else {
            return Surface { name, mesh, material };
        };
        let [width, height] = drawn.size;
        let texture = match self.textures.get(&height).filter(|_| width == 1) {
            Some(texture) => Arc::clone(texture),
            None => Arc::new(Texture { width, height, rgb: drawn.rgb.clone() }),
        };
        if mesh.uvs.len() == mesh.positions.len() && texture.width > 1 && !drawn.is_cube {
            mesh.uvs.iter_mut().for_each(|uv| *uv = [uv[0] * flat.repeat[0], uv[1] * flat.repeat[1]]);
            material.texture = Some(texture);
        } else {
            let pixels = (texture.rgb.len() / 3).max(1) as f32 * 255.0;
            let mean = |channel: usize| {
                texture.rgb.iter().skip(channel).step_by(3).map(|&value| f32::from(value)).sum::<f32>() / pixels
            };
            material.base_color = [0, 1, 2].map(|channel| material.base_color[channel] * mean(channel));
        }
        Surface { name, mesh, material }
    }
}

/// `name`, or `otherwise` if it is empty.
fn or<'a>(name: &'a str, otherwise: &'a str) -> &'a str {
    if name.is_empty() { otherwise } else { name }
}

fn colored([r, g, b, a]: [f32; 4], roughness: f32) -> Material {
    let [r, g, b, a] = [r, g, b, a].map(|value| value.clamp(0.0, 1.0));
    Material { opacity: a.max(0.05), ..Material::plain([r, g, b], roughness) }
}
