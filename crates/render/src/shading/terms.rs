//! Terms of the reflected radiance of a batch of points.

use glam::Vec3A;

use crate::simd::BatchColumn;

/// Intermediate terms and result of [`super::reflect::reflect`], by point.
#[derive(Clone, Debug, Default)]
pub(super) struct ShadingTerms {
    pub normal: [BatchColumn; 3],
    pub(super) viewer: [BatchColumn; 3],
    /// Cosine between normal and direction to the viewer, clamped to 0.001-1.
    pub facing: BatchColumn,
    /// Ambient light for diffuse and for specular reflection (linear RGB).
    pub(super) around: [BatchColumn; 3],
    pub(super) mirrored: [BatchColumn; 3],
    /// Split-sum scale and bias of the ambient Fresnel term.
    pub(super) scale: BatchColumn,
    pub(super) bias: BatchColumn,
    /// Cosine between normal and direction to the key light; 0 on surfaces that face away from it.
    pub(super) lit: BatchColumn,
    /// Cosine times shadow mask: arriving share of the key light.
    pub(super) strength: BatchColumn,
    /// Share of the ambient light occluded together with the key light.
    pub(super) occluded_ambient: BatchColumn,
    /// Factor on the interreflected key light in concave corners, 0-1.
    pub(super) corner: BatchColumn,
    /// Specular lobe of the key light, and its Schlick weight.
    pub(super) lobe: BatchColumn,
    pub(super) weight: BatchColumn,
    pub color: [BatchColumn; 3],
}

impl ShadingTerms {
    /// Resulting colour of a point.
    #[inline(always)]
    pub(super) fn color_at(&self, point: usize) -> Vec3A {
        Vec3A::new(self.color[0][point], self.color[1][point], self.color[2][point])
    }
}

/// Direction to the viewer reflected about the normal (both unit vectors); `twice` is twice their dot product.
#[inline(always)]
pub(super) fn mirrored(normal: [f32; 3], viewer: [f32; 3], twice: f32) -> [f32; 3] {
    let along = |axis: usize| normal[axis].mul_add(twice, -viewer[axis]);
    [along(0), along(1), along(2)]
}
