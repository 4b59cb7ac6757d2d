//! Scene data shared by all passes of a job.

use crate::ambient::irradiance_grid::IrradianceGrids;
use crate::ambient::proxy_set::Proxies;
use crate::lights::lighting::Lighting;
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
    pub shadow: &'a ShadowMap,
    /// Ellipsoid proxies of all bodies, which occlude light even outside the image.
    pub proxies: &'a Proxies,
    /// Ambient irradiance on the support surfaces.
    pub irradiance_grids: &'a IrradianceGrids,
}
