//! Support surfaces: the horizontal tops of the world's slabs.

use glam::{Vec2, Vec3A};

use crate::scene::mesh::Mesh;

/// Horizontal top of a support surface.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SupportTop {
    /// Index of the slab in `RenderAssets::parts`.
    pub part: usize,
    /// World z (m).
    pub height: f32,
    /// Lower and upper corner of the bounding rectangle in the world (x, y; m).
    pub low: Vec2,
    pub high: Vec2,
}

impl SupportTop {
    /// Top of a slab that is fixed in the world; `None` if the slab is not horizontal.
    pub fn of(part: usize, slab: &Mesh) -> Option<Self> {
        let height = slab.positions.iter().map(|place| place.z).reduce(f32::max)?;
        let top = slab.positions.iter().filter(|place| height - place.z < 1e-6).map(|place| place.truncate());
        let (low, high) = top.fold((Vec2::MAX, Vec2::MIN), |(low, high), at| (low.min(at), high.max(at)));
        low.cmplt(high).all().then_some(Self { part, height, low, high })
    }

    /// Area of the bounding rectangle (m²).
    pub fn area(&self) -> f32 {
        (self.high - self.low).element_product()
    }

    /// True if the position lies above or below the bounding rectangle.
    pub fn is_under(&self, place: Vec3A) -> bool {
        let flat = place.truncate();
        self.low.cmple(flat).all() && flat.cmple(self.high).all()
    }
}
