//! Geometry: visual meshes, and colliders, which are invisible by their purpose `guide`.

use genmanip_core::glam::{DVec3, Vec3};
use genmanip_core::{Piece, Shape, VisualPart};
use genmanip_import::collision::hull::convex_hull;
use genmanip_render::encode::EncodeError;

use super::materials::friction_name;
use super::text::{Writer, list, quat, triple};

impl Writer<'_> {
    pub(super) fn visual(&mut self, part: &VisualPart) -> Result<(), EncodeError> {
        let mesh = &part.render_mesh;
        let material = self.material(&part.material)?;
        self.open("Mesh", &part.name, &[], &["MaterialBindingAPI"]);
        let counts = vec!["3"; mesh.triangles.len()].join(", ");
        let corners = list(mesh.triangles.iter().flatten(), |corner| corner.to_string());
        let point = |at: &Vec3| format!("({}, {}, {})", at.x, at.y, at.z);
        let low = mesh.positions.iter().copied().reduce(|a, b| a.min(b)).unwrap_or_default();
        let high = mesh.positions.iter().copied().reduce(|a, b| a.max(b)).unwrap_or_default();
        self.line(&format!("float3[] extent = [{}, {}]", point(&low), point(&high)));
        self.line(&format!("int[] faceVertexCounts = [{counts}]"));
        self.line(&format!("int[] faceVertexIndices = [{corners}]"));
        self.line(&format!("rel material:binding = </World/materials/{material}>"));
        if mesh.normals.len() == mesh.positions.len() {
            let normals = list(mesh.normals.iter(), point);
            self.line(&format!("normal3f[] normals = [{normals}] ("));
            self.line("    interpolation = \"vertex\"");
            self.line(")");
        }
        self.line(&format!("point3f[] points = [{}]", list(mesh.positions.iter(), point)));
        if part.material.texture.is_some() && mesh.uvs.len() == mesh.positions.len() {
            let uvs = list(mesh.uvs.iter(), |uv| format!("({}, {})", uv.x, 1.0 - uv.y));
            self.line(&format!("texCoord2f[] primvars:st = [{uvs}] ("));
            self.line("    interpolation = \"vertex\"");
            self.line(")");
        }
        self.line("uniform token subdivisionScheme = \"none\"");
        self.placed(&part.link_from_part);
        self.close();
        Ok(())
    }

    /// Writes convex pieces as colliders with a sliding friction coefficient.
    pub(super) fn pieces(&mut self, pieces: &[Piece], friction: f64) {
        if pieces.is_empty() {
            return;
        }
        let friction = format!("{friction}");
        let material = friction_name(&friction);
        self.frictions.insert(friction);
        for (index, piece) in pieces.iter().enumerate() {
            let (kind, lines, scale) = shape(&piece.shape);
            let schemas: &[&str] = match kind {
                "Mesh" => &["PhysicsCollisionAPI", "PhysicsMeshCollisionAPI", "MaterialBindingAPI"],
                _ => &["PhysicsCollisionAPI", "MaterialBindingAPI"],
            };
            self.open(kind, &format!("collider_{index}"), &[], schemas);
            lines.iter().for_each(|line| self.line(line));
            self.line(&format!("rel material:binding:physics = </World/materials/{material}>"));
            self.line("uniform token purpose = \"guide\"");
            self.line(&format!("quatd xformOp:orient = {}", quat(piece.link_from_piece.rotation)));
            if let Some(scale) = scale {
                self.line(&format!("double3 xformOp:scale = {}", triple(scale)));
            }
            self.line(&format!("double3 xformOp:translate = {}", triple(piece.link_from_piece.position)));
            let scale = if scale.is_some() { ", \"xformOp:scale\"" } else { "" };
            self.line(&format!("uniform token[] xformOpOrder = [\"xformOp:translate\", \"xformOp:orient\"{scale}]"));
            self.close();
        }
    }
}

/// Prim type, attribute lines and scale of a shape; the scale is `None` where the attributes hold the size.
fn shape(shape: &Shape) -> (&'static str, Vec<String>, Option<DVec3>) {
    let round = |kind: &'static str, radius: f64, height: f64| {
        let axis = "uniform token axis = \"Z\"".to_owned();
        (kind, vec![axis, format!("double height = {height}"), format!("double radius = {radius}")], None)
    };
    match shape {
        Shape::Box { half_extents } => ("Cube", vec!["double size = 2".into()], Some(*half_extents)),
        Shape::Sphere { radius } => ("Sphere", vec![format!("double radius = {radius}")], None),
        Shape::Ellipsoid { radii } => ("Sphere", vec!["double radius = 1".into()], Some(*radii)),
        Shape::Cylinder { radius, half_height } => round("Cylinder", *radius, 2.0 * half_height),
        Shape::Capsule { radius, half_length } => round("Capsule", *radius, 2.0 * half_length),
        Shape::Hull { points } => ("Mesh", hull(points), None),
    }
}

/// Attribute lines of a mesh that is the convex hull of the points.
fn hull(points: &[DVec3]) -> Vec<String> {
    let (corners, triangles) = convex_hull(points).unwrap_or_default();
    vec![
        format!("int[] faceVertexCounts = [{}]", vec!["3"; triangles.len()].join(", ")),
        format!("int[] faceVertexIndices = [{}]", list(triangles.iter().flatten(), |corner| corner.to_string())),
        "uniform token physics:approximation = \"convexHull\"".into(),
        format!("point3f[] points = [{}]", list(corners.iter(), |corner| triple(*corner))),
        "uniform token subdivisionScheme = \"none\"".into(),
    ]
}
