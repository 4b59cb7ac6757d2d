//! Ambient occlusion and bounce light: SSAO, ellipsoid proxies, and the irradiance grid of the support surface.

pub(crate) mod cavity;
pub(crate) mod irradiance_grid;
pub(crate) mod proxies;
pub(crate) mod proxy_set;
pub(crate) mod ssao;
