use glam::DVec3;
use serde::Deserialize;

use crate::link_builder::LinkBuilder;
use crate::solid::Solid;

/// Collision-only capsules along a path, for curved shells whose visuals come from other parts.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Capsules {
    /// Centres of the hemispherical caps, m.
    pub path: Vec<DVec3>,
    /// Radius of each segment, m.
    pub radii: Vec<f64>,
}

impl Capsules {
    pub(super) fn add_to(&self, link: &mut LinkBuilder) {
        let segments = self.path.windows(2).zip(&self.radii);
        link.solids.extend(segments.map(|(ends, &radius)| Solid::capsule(ends[0], ends[1], radius)));
    }
}
