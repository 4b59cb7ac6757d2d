//! What all pictures of one job share.

use crate::ambient::irradiance_grid::IrradianceGrid;
use crate::ambient::proxies::AoProxies;
use crate::lights::lighting::Lighting;
use crate::scene::assets::RenderAssets;
use crate::scene::material::Material;
use crate::scene::variation::RenderVariation;
use crate::shading::backdrop::Backdrop;
use crate::shadow::map::ShadowMap;

/// What is drawn and under which light.
pub(crate) struct RenderScene<'a> {
    pub assets: &'a RenderAssets,
    /// What the parts of the assets are made of under the variation.
    pub surfaces: &'a [Material],
    pub variation: &'a RenderVariation,
    pub lighting: &'a Lighting,
    pub backdrop: &'a Backdrop,
    pub shadow: &'a ShadowMap,
    /// What holds back ambient light and is not told by the picture.
    pub proxies: &'a AoProxies,
    /// The ambient light on the table.
    pub irradiance_grid: &'a IrradianceGrid,
}
