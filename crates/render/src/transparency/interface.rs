//! Transparent interfaces in front of a batch of pixels.

use glam::Vec3A;
use multiversion::multiversion;

use crate::gbuffer::view::View;
use crate::render_scene::RenderScene;
use crate::scene::material::Material;
use crate::shading::{ShadedPart, Shading, ShadingPoint};
use crate::simd::{BatchColumn, CHUNK};

/// A pixel behind transparent layers.
#[derive(Clone, Copy, Debug)]
pub(super) struct Covered {
    pub pixel: u32,
    /// Index of the pixel in the list of edge pixels; `None` if it is not one.
    pub edge_pixel: Option<u32>,
    pub layers: [LayerSample; 2],
}

/// A transparent interface in front of a pixel.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct LayerSample {
    pub point: ShadingPoint,
    /// Share of the pixel that the interface covers, 0-1.
    pub coverage: f32,
}

/// Interfaces of one surface in front of a batch of pixels.
#[derive(Debug, Default)]
pub(super) struct Interface {
    /// True if the mesh is closed, so that light passes through a solid object.
    pub is_solid: bool,
    /// Image position (px), depth (m) and coverage (0-1).
    pub place: [BatchColumn; 2],
    pub depth: BatchColumn,
    pub coverage: BatchColumn,
    /// Unit normals in the world, towards the viewer.
    pub normal: [BatchColumn; 3],
    /// Linear display colour (0-1) reflected and scattered towards the viewer, and transmittance per colour channel.
    pub color: [BatchColumn; 3],
    pub passes: [BatchColumn; 3],
}

impl Interface {
    /// Shades the far (`index` 0) or near (`index` 1) interfaces of a batch of pixels. They belong to one part;
    /// `surface` is one more than the index of that part.
    pub fn shade(
        &mut self,
        pixels: &[Covered],
        index: usize,
        surface: u32,
        shading: &mut Shading,
        scene: &RenderScene<'_>,
        view: &View,
    ) {
        shading.clear();
        let [column, row] = &mut self.place;
        for (i, LayerSample { point: spot, coverage }) in pixels.iter().map(|pixel| &pixel.layers[index]).enumerate() {
            shading.push(*spot);
            (column[i], row[i], self.depth[i], self.coverage[i]) = (spot.x, spot.y, spot.depth, *coverage);
        }
        let part = surface as usize - 1;
        let material = &scene.materials[part];
        self.is_solid = scene.assets.parts[part].mesh.closed;
        shading.shade(&ShadedPart::new(scene, view, part));
        let (normal, facing) = shading.normals();
        let base = shading.bases();
        (self.color, self.normal) = (*shading.colors(), *normal);
        let is_shell = !self.is_solid;
        if material.texture.is_none() && !is_shell {
            let tint = material.tint(material.base, 1.0, is_shell).to_array();
            self.passes = tint.map(BatchColumn::of);
        } else {
            for i in 0..pixels.len() {
                let base = Vec3A::new(base[0][i], base[1][i], base[2][i]);
                let tint = material.tint(base, facing[i], is_shell);
                (self.passes[0][i], self.passes[1][i], self.passes[2][i]) = tint.into();
            }
        }
        attenuate(material, facing, &mut self.passes);
    }
}

/// Multiplies the transmittance by the share of light that is neither reflected nor scattered.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl+fma", "x86_64+avx2+fma"))]
fn attenuate(material: &Material, facing: &BatchColumn, passes: &mut [BatchColumn; 3]) {
    for i in 0..CHUNK {
        let share = material.passing(facing[i]);
        passes[0][i] *= share;
        passes[1][i] *= share;
        passes[2][i] *= share;
    }
}
