//! Bounding box and shape class of a body's opaque parts.

use glam::Vec3;

use crate::scene::mesh::Mesh;

/// Bounding box of a body's opaque parts in its frame, and their shape class.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct BodyShape {
    /// Lower and upper corner (m).
    pub low: Vec3,
    pub high: Vec3,
    /// True if some of the surface faces the centre (`has_inside`), or at least the share `HOLLOW` of it, as in a
    /// bowl (`is_concave`).
    pub has_inside: bool,
    pub is_concave: bool,
}

/// Smallest share of the surface that faces the centre of a concave body: 0 for a box or a ball, 0.5 for a bowl. Chosen
/// by hand.
const HOLLOW: f32 = 0.3;
/// Same share for `has_inside`: above rounding errors, below the dimple of an apple. Chosen by hand.
const INSIDE: f32 = 1e-3;

impl BodyShape {
    /// Centre of the bounding box (m).
    pub fn middle(&self) -> Vec3 {
        (self.low + self.high) * 0.5
    }

    /// Shape of a body from its meshes; `None` without vertices.
    pub fn of(meshes: &[&Mesh]) -> Option<Self> {
        let corners = || meshes.iter().flat_map(|mesh| &mesh.positions).copied();
        let (low, high) = corners().map(|at| (at, at)).reduce(|(low, high), (at, _)| (low.min(at), high.max(at)))?;
        let middle = (low + high) * 0.5;
        let (mut inward, mut all) = (0.0, 0.0);
        for mesh in meshes {
            for triangle in &mesh.triangles {
                let [a, b, c] = triangle.map(|corner| mesh.positions[corner as usize]);
                let across = (b - a).cross(c - a);
                let area = across.length();
                all += area;
                inward += if across.dot(middle - (a + b + c) / 3.0) > 0.0 { area } else { 0.0 };
            }
        }
        let (has_inside, is_concave) = (inward > INSIDE * all, inward > HOLLOW * all);
        Some(Self { low, high, has_inside, is_concave })
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use genmanip_assets::Catalogue;
    use genmanip_core::ObjectModel;

    use crate::RenderAssets;

    /// Shape classes of catalogue objects of several categories.
    #[test]
    fn bowls_are_told_by_their_meshes() {
        let catalogue = Catalogue::builtin();
        let shape_of = |kind: &str| {
            let card = catalogue.cards().iter().find(|card| card.category == kind).expect(kind);
            let model: Arc<ObjectModel> = catalogue.build(&card.uid).unwrap();
            *RenderAssets::without_robot(&[model], None).unwrap().shape_of(0).unwrap()
        };
        for (kind, is_concave) in
            [("cube", false), ("apple", false), ("food tin", false), ("bowl", true), ("mug", true)]
        {
            assert_eq!(shape_of(kind).is_concave, is_concave, "{kind}");
        }
    }
}
