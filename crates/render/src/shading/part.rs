//! A part to be shaded: material, placement and incoming light.

use glam::Vec3A;

use crate::ambient::irradiance_grid::IrradianceGrid;
use crate::ambient::proxies::Proxy;
use crate::gbuffer::view::{CameraView, PartView, View};
use crate::lights::lighting::Lighting;
use crate::lights::sky::Glossy;
use crate::matched::look::Look;
use crate::render_scene::RenderScene;
use crate::scene::material::Material;
use crate::scene::mesh::Face;

/// Share of the ambient light that comes from around the key light, and is occluded together with it: on objects, then
/// on support surfaces, whose irradiance grids account for most of it. Fitted to path-traced images.
const WITH_KEY: f32 = 0.1725;
const WITH_KEY_ON_SUPPORT: f32 = 0.091;

/// A part with its material and incoming light, as seen by a camera.
#[derive(Debug)]
pub(crate) struct ShadedPart<'a> {
    pub faces: &'a [Face],
    /// Camera position in the body's frame (m); `None` if the part's back faces are never visible.
    pub viewpoint: Option<Vec3A>,
    pub material: &'a Material,
    pub placed: &'a PartView,
    pub camera: &'a CameraView,
    pub light: PartLight<'a>,
    /// Response and photographs of the image; `None` for the usual tone mapping.
    pub look: Option<&'a Look<'a>>,
    /// True for a fixture, which photographs of the empty workspace show.
    pub is_fixture: bool,
}

/// Incoming light of a part.
#[derive(Debug)]
pub(crate) struct PartLight<'a> {
    pub lighting: &'a Lighting,
    /// Environment prefiltered for the part's roughness.
    pub glossy: Glossy,
    /// Irradiance grid; `None` unless the part is a support surface.
    pub irradiance_grid: Option<&'a IrradianceGrid>,
    /// World z of the support surface below the part (m), which reflects light onto it; `None` for fixtures.
    pub ground: Option<f32>,
    /// Share of the key light on the body and the surface around it that other bodies do not occlude, 0-1.
    pub ground_lit: f32,
    /// Proxy of the body if light enters its cavity; `None` otherwise.
    pub cavity: Option<&'a Proxy>,
    /// Factor on the albedo in multi-bounce ambient occlusion, 0-1: less for a body in the dark gripper.
    pub bounce: f32,
}

impl PartLight<'_> {
    /// Share of the ambient light occluded together with the key light.
    pub fn with_key(&self) -> f32 {
        if self.irradiance_grid.is_some() { WITH_KEY_ON_SUPPORT } else { WITH_KEY }
    }
}

impl<'a> ShadedPart<'a> {
    /// Gathers mesh, material, placement and light of part `index` (into the assets' parts) for a view.
    pub fn new(scene: &'a RenderScene<'_>, view: &'a View, index: usize) -> Self {
        let (part, material, placed) = (&scene.assets.parts[index], &scene.materials[index], &view.parts[index]);
        let mesh = placed.mesh(part);
        let light = PartLight {
            lighting: scene.lighting,
            glossy: scene.lighting.sky.glossy(material.roughness),
            irradiance_grid: scene.irradiance_grids.of(index as u16 + 1),
            ground: placed.ground,
            ground_lit: part.body.map_or(1.0, |body| scene.proxies.lit_of(body)),
            cavity: part.body.and_then(|body| scene.proxies.cavity_of(body)),
            bounce: part.body.map_or(1.0, |body| scene.proxies.bounce_of(body)),
        };
        let viewpoint = (!part.hides_back(mesh)).then_some(placed.viewpoint_in_body);
        let (look, is_fixture) = (scene.look, part.body.is_none());
        Self { faces: &mesh.faces, viewpoint, material, placed, camera: &view.camera, light, look, is_fixture }
    }
}
