//! What all pictures of one job share.

use crate::assets::{RenderAssets, Surface};
use crate::backdrop::Backdrop;
use crate::lighting::Lighting;
use crate::occluders::Occluders;
use crate::shadow::ShadowMap;
use crate::table_light::TableLight;
use crate::variation::RenderVariation;

/// What is drawn and under which light.
pub(crate) struct Scene<'a> {
    pub assets: &'a RenderAssets,
    /// What the parts of the assets are made of under the variation.
    pub surfaces: &'a [Surface],
    pub variation: &'a RenderVariation,
    pub lighting: &'a Lighting,
    pub backdrop: &'a Backdrop,
    pub shadow: &'a ShadowMap,
    /// What holds back ambient light and is not told by the picture.
    pub occluders: &'a Occluders,
    /// The ambient light on the table.
    pub table_light: &'a TableLight,
}
