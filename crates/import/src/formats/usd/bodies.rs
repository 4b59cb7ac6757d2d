//! Bodies of a stage: geometry, collision shapes and masses of all prims, assigned to the rigid body that each is part
//! of, and the joints; all in the world frame, in metres and kilograms.

use std::collections::BTreeMap;

use genmanip_core::Pose;
use glam::{DMat4, DVec3};
use openusd::sdf::Path;
use openusd::usd::{PrimPredicate, Stage, TimeCode};

use super::binding::Bindings;
use super::geometry::{GEOMETRY, Geometry, rigid};
use super::mass::{self, Collider, StatedMass};
use super::material::{Bound, Materials};
use super::units::Units;
use super::value::At;
use crate::files::{Files, shortened};
use crate::raw::{MAX_TRIANGLES, RawLink};

/// Maximum nesting depth of prims.
const MAX_DEPTH: usize = 256;
/// Types of prims that are read elsewhere or contribute nothing to an object, so that no note lists them.
const SILENT: [&str; 12] = [
    "",
    "Xform",
    "Scope",
    "Material",
    "Shader",
    "NodeGraph",
    "GeomSubset",
    "PhysicsScene",
    "PhysicsCollisionGroup",
    "SkelRoot",
    "Skeleton",
    "SkelAnimation",
];
/// Applied API schemas that are read or contribute nothing to an object, so that no note lists them.
const KNOWN_SCHEMAS: [&str; 17] = [
    "PhysicsRigidBodyAPI",
    "PhysicsMassAPI",
    "PhysicsCollisionAPI",
    "PhysicsMeshCollisionAPI",
    "PhysicsMaterialAPI",
    "PhysicsArticulationRootAPI",
    "MaterialBindingAPI",
    "PhysicsDriveAPI:angular",
    "PhysicsDriveAPI:linear",
    "GeomModelAPI",
    "SkelBindingAPI",
    "SemanticsLabelsAPI",
    "SemanticsAPI",
    "NodeDefAPI",
    "AssetPreviewsAPI",
    "VisibilityAPI",
    "CollectionAPI",
];

/// A rigid body, in the world frame.
#[derive(Default)]
pub struct Body {
    /// Path of its prim; empty for the body of everything that is fixed to the world.
    pub path: String,
    /// Geometry, collision shapes, mass and friction, in the world frame and without a joint.
    pub held: RawLink,
    /// True if it is kinematic (`physics:kinematicEnabled`): contacts do not move it.
    pub is_kinematic: bool,
    /// True if it is an articulation root (`PhysicsArticulationRootAPI`).
    pub is_root: bool,
    /// Mass that its own prim states, and position of that prim.
    stated: StatedMass,
    origin: DVec3,
    /// Statements about the mass of each collision shape.
    colliders: Vec<Collider>,
    /// Smallest and largest friction of its colliders; `None` if none states it.
    friction: Option<[f64; 2]>,
}

/// A joint prim.
pub struct JointPrim {
    /// The prim, for its type, axis, limits and drive.
    pub at: At,
    /// Index of each of the two bodies, and `world_from_joint` according to that body.
    pub ends: [(usize, Pose); 2],
}

/// Contents of a stage.
pub struct Contents {
    /// Bodies; the first one is everything that is fixed to the world.
    pub bodies: Vec<Body>,
    /// Enabled joints between the bodies.
    pub joints: Vec<JointPrim>,
    /// Semantic label of the first prim that has one, as a name for the object.
    pub label: Option<String>,
}

/// Values that a prim inherits from its ancestors.
#[derive(Clone)]
struct Above {
    /// `world_from_parent`, with the world in metres.
    world: DMat4,
    /// Index of the rigid body.
    body: usize,
    is_visible: bool,
    purpose: String,
    bindings: Bindings,
    is_collider: bool,
    approximation: String,
}

/// Material that a prim is drawn with: of previews, else of all purposes, else of final renders.
fn drawn(bindings: &Bindings, at: &At) -> Option<Path> {
    let path = at.prim.path();
    bindings.material(path, "preview").or_else(|| bindings.material(path, "full"))
}

/// Reads the prims of a stage below the given root prims.
///
/// # Errors
/// If a mesh is damaged, a transform is invalid, prims are nested too deeply, or there are too many triangles.
pub fn contents(
    stage: &Stage,
    roots: &[Path],
    units: Units,
    files: &mut Files<'_>,
    notes: &mut Vec<String>,
) -> Result<Contents, String> {
    let fixed = Body { is_kinematic: true, ..Body::default() };
    let mut reader = Reader {
        time: TimeCode::new(stage.start_time_code()),
        units,
        files,
        notes,
        materials: Materials::default(),
        contents: Contents { bodies: vec![fixed], joints: Vec::new(), label: None },
        body_of: BTreeMap::new(),
        joints: Vec::new(),
        unused: BTreeMap::new(),
        triangles: 0,
    };
    let top = Above {
        world: DMat4::from_scale(DVec3::splat(units.metres)),
        body: 0,
        is_visible: true,
        purpose: "default".into(),
        bindings: Bindings::default(),
        is_collider: false,
        approximation: "none".into(),
    };
    let mut open: Vec<(Path, Above, usize)> = roots.iter().rev().map(|path| (path.clone(), top.clone(), 0)).collect();
    while let Some((path, above, depth)) = open.pop() {
        if depth > MAX_DEPTH {
            return Err(format!("{path}: nested deeper than {MAX_DEPTH}"));
        }
        let status = stage.prim_status(path.clone()).map_err(|error| super::stage::plain(&error))?;
        if !PrimPredicate::DEFAULT_PROXIES.matches(status) {
            continue;
        }
        let at = At { prim: stage.prim(path), time: reader.time };
        let Some(own) = reader.prim(&at, &above)? else { continue };
        let children = at.prim.children().map_err(|error| super::stage::plain(&error))?;
        open.extend(children.iter().rev().map(|child| (child.path().clone(), own.clone(), depth + 1)));
    }
    reader.finish(top.world)
}

struct Reader<'a, 'b> {
    time: TimeCode,
    units: Units,
    files: &'a mut Files<'b>,
    notes: &'a mut Vec<String>,
    materials: Materials,
    contents: Contents,
    /// Body index and `world_from_prim` (world in metres) of each prim, by path.
    body_of: BTreeMap<String, (usize, DMat4)>,
    joints: Vec<At>,
    /// Number of unused prims by type, and of applications of unused schemas by name.
    unused: BTreeMap<String, usize>,
    triangles: usize,
}

impl Reader<'_, '_> {
    /// Reads a prim and returns the values that its children inherit; `None` if the children are to be skipped.
    fn prim(&mut self, at: &At, above: &Above) -> Result<Option<Above>, String> {
        let kind = at.kind();
        let (own, resets) = at.transform()?;
        let start = DMat4::from_scale(DVec3::splat(self.units.metres));
        let mut here = Above { world: if resets { start * own } else { above.world * own }, ..above.clone() };
        here.is_visible &= at.text("visibility").as_deref() != Some("invisible");
        if let Some(purpose) = at.text("purpose").filter(|purpose| purpose != "default") {
            here.purpose = purpose;
        }
        here.bindings = above.bindings.child(at);
        let schemas = at.schemas();
        let has = |name: &str| schemas.iter().any(|schema| schema == name);
        let is_body = has("PhysicsRigidBodyAPI") && at.flag("physics:rigidBodyEnabled") != Some(false);
        if is_body {
            here.body = self.contents.bodies.len();
            let is_kinematic = at.flag("physics:kinematicEnabled") == Some(true);
            let held = RawLink { name: at.name(), ..RawLink::default() };
            let is_root = has("PhysicsArticulationRootAPI");
            let path = at.prim.path().to_string();
            let origin = here.world.w_axis.truncate();
            self.contents.bodies.push(Body { path, held, is_kinematic, is_root, origin, ..Body::default() });
        }
        if has("PhysicsCollisionAPI") {
            here.is_collider = at.flag("physics:collisionEnabled") != Some(false);
        }
        if let Some(approximation) = at.text("physics:approximation") {
            here.approximation = approximation;
        }
        self.body_of.insert(at.prim.path().to_string(), (here.body, here.world));
        let stated =
            if has("PhysicsMassAPI") { StatedMass::read(at, &here.world, self.units) } else { StatedMass::default() };
        if is_body {
            self.contents.bodies[here.body].stated = stated;
        } else if stated.is_stated() && !(here.is_collider && GEOMETRY.contains(&kind.as_str())) {
            let path = shortened(&at.prim.path().to_string());
            self.notes.push(format!("{path}: its mass is not used, since it is neither a body nor a collider"));
        }
        self.label(at, &schemas);
        self.count_unused(&kind, &schemas);
        match kind.as_str() {
            "PointInstancer" => return Ok(None),
            kind if kind.starts_with("Physics") && kind.ends_with("Joint") => self.joints.push(at.clone()),
            kind if GEOMETRY.contains(&kind) => self.geometry(at, &here, stated)?,
            _ => {}
        }
        Ok(Some(here))
    }

    fn label(&mut self, at: &At, schemas: &[String]) {
        if self.contents.label.is_some() {
            return;
        }
        let names = schemas.iter().filter_map(|schema| {
            let (kind, name) = schema.split_once(':')?;
            match kind {
                "SemanticsLabelsAPI" => Some(format!("semantics:labels:{name}")),
                "SemanticsAPI" => Some(format!("semantic:{name}:params:semanticData")),
                _ => None,
            }
        });
        self.contents.label = names.into_iter().find_map(|name| at.text(&name)).map(|label| shortened(&label));
    }

    fn count_unused(&mut self, kind: &str, schemas: &[String]) {
        let is_read = SILENT.contains(&kind) || GEOMETRY.contains(&kind) || kind.starts_with("Physics");
        let kinds = (!is_read).then(|| kind.to_owned());
        let is_known = |schema: &&String| {
            KNOWN_SCHEMAS.iter().any(|known| schema.as_str() == *known || schema.starts_with(&format!("{known}:")))
        };
        let schemas = schemas.iter().filter(|schema| !is_known(schema)).cloned();
        for name in kinds.into_iter().chain(schemas) {
            *self.unused.entry(shortened(&name)).or_default() += 1;
        }
    }

    fn geometry(&mut self, at: &At, here: &Above, stated: StatedMass) -> Result<(), String> {
        let is_drawn = here.is_visible && matches!(here.purpose.as_str(), "default" | "render");
        if !is_drawn && !here.is_collider {
            self.notes.push(format!("{}: neither drawn nor a collider", shortened(&at.prim.path().to_string())));
            return Ok(());
        }
        let geometry = Geometry::read(at, self.notes)?;
        if ["points", "xformOp:transform", "xformOp:translate"]
            .iter()
            .any(|name| at.prim.attribute(*name).num_time_samples().unwrap_or(0) > 1)
        {
            self.notes.push(format!("{}: animated; its first pose is used", shortened(&at.prim.path().to_string())));
        }
        if is_drawn {
            let own = drawn(&here.bindings, at);
            let mut read = |material: &Path| self.materials.read(&at.other(material), self.files, self.notes);
            let mut subsets = Vec::new();
            for child in at.prim.children().unwrap_or_default() {
                let child = At { prim: child, time: at.time };
                let is_part =
                    child.kind() == "GeomSubset" && child.text("elementType").is_none_or(|kind| kind == "face");
                let material = is_part.then(|| drawn(&here.bindings.child(&child), &child)).flatten();
                if let Some(material) = material.filter(|material| Some(material) != own.as_ref()) {
                    subsets.push((child.indices("indices"), read(&material)));
                }
            }
            let whole = own.as_ref().map_or_else(Bound::painted, read);
            let surfaces = geometry.surfaces(at, &here.world, &subsets, &whole);
            self.triangles += surfaces.iter().map(|surface| surface.mesh.triangles.len()).sum::<usize>();
            self.contents.bodies[here.body].held.surfaces.extend(surfaces);
        }
        if here.is_collider {
            let collision = geometry.collision(&here.world, &here.approximation);
            if let crate::raw::RawCollision::Mesh(mesh) = &collision {
                self.triangles += mesh.triangles.len();
            }
            let [friction, material_density] = self.surface_physics(at, here);
            let body = &mut self.contents.bodies[here.body];
            body.colliders.push(Collider { stated, material_density });
            body.held.collision.push(collision);
            if let Some(friction) = friction {
                let [least, most] = body.friction.unwrap_or([friction; 2]);
                body.friction = Some([least.min(friction), most.max(friction)]);
            }
        }
        if self.triangles > MAX_TRIANGLES {
            return Err(format!("more than {MAX_TRIANGLES} triangles"));
        }
        Ok(())
    }

    /// Friction (dynamic, else static) and density (kg/m³) of a collider's physics material.
    fn surface_physics(&mut self, at: &At, here: &Above) -> [Option<f64>; 2] {
        let Some(path) = here.bindings.material(at.prim.path(), "physics") else { return [None; 2] };
        let material = at.other(&path);
        if material.positive("physics:restitution").is_some() {
            self.notes.push(format!("material {}: its restitution is not used", shortened(&path.to_string())));
        }
        let dynamic = material.positive("physics:dynamicFriction");
        let friction = dynamic.or_else(|| material.positive("physics:staticFriction"));
        [friction, material.positive("physics:density").map(|density| self.units.density(density))]
    }

    fn finish(mut self, world: DMat4) -> Result<Contents, String> {
        for at in std::mem::take(&mut self.joints) {
            let path = at.prim.path().to_string();
            if at.flag("physics:jointEnabled") == Some(false) {
                self.notes.push(format!("joint {}: it is switched off", shortened(&path)));
                continue;
            }
            let mut ends = Vec::new();
            for side in [0, 1] {
                let target = at.targets(&format!("physics:body{side}")).into_iter().next();
                let place = match &target {
                    None => Some((0, world)),
                    Some(target) => self.body_of.get(target.as_str()).copied(),
                };
                let Some((body, world_from_prim)) = place else {
                    let target = target.map_or_else(String::new, |target| shortened(target.as_str()));
                    self.notes.push(format!(
                        "joint {}: left out, since {target} is not part of the object",
                        shortened(&path)
                    ));
                    break;
                };
                let at_prim = at.vector(&format!("physics:localPos{side}")).unwrap_or_default();
                let turn = at.rotation(&format!("physics:localRot{side}")).unwrap_or_default();
                let rotation = rigid(&world_from_prim).rotation * turn;
                ends.push((body, Pose { position: world_from_prim.transform_point3(at_prim), rotation }));
            }
            if let Ok(ends) = <[(usize, Pose); 2]>::try_from(ends) {
                self.contents.joints.push(JointPrim { at, ends });
            }
        }
        for body in &mut self.contents.bodies {
            body.held.mass = mass::of_body(&body.stated, &body.colliders, &body.held.collision, body.origin);
            body.held.friction = body.friction.map(|[_, most]| most);
            if let Some([least, most]) = body.friction.filter(|[least, most]| least < most) {
                // In the stage's precision.
                let [least, most] = [least as f32, most as f32];
                let name =
                    if body.path.is_empty() { "what is fixed to the world".into() } else { shortened(&body.path) };
                self.notes
                    .push(format!("{name}: its colliders have frictions of {least} to {most}; the largest is used"));
            }
        }
        if !self.unused.is_empty() {
            let names: Vec<String> = self.unused.iter().map(|(name, count)| format!("{name} ({count})")).collect();
            self.notes.push(format!("not used: {}", names.join(", ")));
        }
        Ok(self.contents)
    }
}
