use glam::DVec3;
use serde::Deserialize;

use crate::link_builder::LinkBuilder;
use crate::solid::Solid;

/// Collision only: a capsule per segment of a path, for bent shells that are drawn by other parts.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Capsules {
    /// Centres of the caps.
    pub path: Vec<DVec3>,
    /// One radius per segment.
    pub radii: Vec<f64>,
}

impl Capsules {
    pub(super) fn add_to(&self, link: &mut LinkBuilder) {
        let segments = self.path.windows(2).zip(&self.radii);
        link.solids.extend(segments.map(|(ends, &radius)| Solid::capsule(ends[0], ends[1], radius)));
    }
}
