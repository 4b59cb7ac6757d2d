//! Scene data shared by all passes of a job.

use glam::{Vec2, Vec3A};

use crate::ambient::irradiance_grid::IrradianceGrids;
use crate::ambient::proxy_set::Proxies;
use crate::gbuffer::view::CameraView;
use crate::lights::lighting::Lighting;
use crate::matched::look::Look;
use crate::scene::assets::RenderAssets;
use crate::scene::material::Material;
use crate::scene::variation::RenderVariation;
use crate::shading::backdrop::Backdrop;
use crate::shadow::map::ShadowMap;

/// Assets, materials, lights and lookup structures of a job.
pub(crate) struct RenderScene<'a> {
    pub assets: &'a RenderAssets,
    /// Materials of the parts under the renderer's variation.
    pub materials: &'a [Material],
    pub variation: &'a RenderVariation,
    pub lighting: &'a Lighting,
    pub backdrop: &'a Backdrop,
    /// Response and photographs that the image is rendered with; `None` for the usual tone mapping and backdrop.
    pub look: Option<&'a Look<'a>>,
    pub shadow: &'a ShadowMap,
    /// Ellipsoid proxies of all bodies, which occlude light even outside the image.
    pub proxies: &'a Proxies,
    /// Ambient irradiance on the support surfaces.
    pub irradiance_grids: &'a IrradianceGrids,
}

impl RenderScene<'_> {
    /// Display-linear background colour at a pixel position.
    pub fn background(&self, camera: &CameraView, place: Vec2) -> Vec3A {
        self.look.and_then(|look| look.background(camera, place)).unwrap_or_else(|| {
            let ray = camera.point_at(place, 1.0) - camera.viewpoint;
            self.backdrop.color(camera.viewpoint, ray)
        })
    }
}
