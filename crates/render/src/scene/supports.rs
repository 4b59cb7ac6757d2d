//! Support surfaces: the horizontal tops of the world's slabs.

use glam::{Vec2, Vec3A};

use crate::scene::mesh::Mesh;

/// Top of a support surface.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SupportTop {
    /// Part of its slab.
    pub part: usize,
    /// Height in the world (m).
    pub height: f32,
    /// Corners of its bounding rectangle in the world (m).
    pub low: Vec2,
    pub high: Vec2,
}

impl SupportTop {
    /// Top of a slab that is fixed in the world; `None` if it is not horizontal.
    pub fn of(part: usize, slab: &Mesh) -> Option<Self> {
        let height = slab.positions.iter().map(|place| place.z).reduce(f32::max)?;
        let top = slab.positions.iter().filter(|place| height - place.z < 1e-6).map(|place| place.truncate());
        let (low, high) = top.fold((Vec2::MAX, Vec2::MIN), |(low, high), at| (low.min(at), high.max(at)));
        low.cmplt(high).all().then_some(Self { part, height, low, high })
    }

    /// Area of the bounding rectangle [m²].
    pub fn area(&self) -> f32 {
        (self.high - self.low).element_product()
    }

    /// True if the rectangle is above or below a position.
    pub fn is_under(&self, place: Vec3A) -> bool {
        let flat = place.truncate();
        self.low.cmple(flat).all() && flat.cmple(self.high).all()
    }
}
