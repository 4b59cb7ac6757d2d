//! Ambient occlusion and bounce light: SSAO, ellipsoid proxies, and the irradiance grid of the support surface.

mod cavity;
pub(crate) mod irradiance_grid;
pub(crate) mod proxies;
mod reflection_proxies;
pub(crate) mod ssao;
