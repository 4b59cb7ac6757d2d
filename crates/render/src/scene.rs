//! What all pictures of one job share.

use crate::assets::RenderAssets;
use crate::shade::Lighting;
use crate::shadow::ShadowMap;
use crate::variation::RenderVariation;

/// What is drawn and under which light.
pub(crate) struct Scene<'a> {
    pub assets: &'a RenderAssets,
    pub variation: &'a RenderVariation,
    pub lighting: &'a Lighting,
    pub shadow: &'a ShadowMap,
}
