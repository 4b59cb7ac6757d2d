//! Looks of cameras: which response and photographs an image is rendered with.

use std::sync::Arc;

use genmanip_core::{Camera, WorkspaceAppearance, WorkspaceLight, World};
use glam::{Vec2, Vec3A};

use super::camera_look::CameraLook;
use super::photograph::{LinearPhotograph, decoded};
use super::response::Response;
use crate::error::RenderError;
use crate::gbuffer::view::CameraView;
use crate::lights::lighting::Lighting;
use crate::lights::sky::luminance;
use crate::scene::sampling;
use crate::scene::texture::srgb_from_linear;
use crate::scene::variation::RenderVariation;
use crate::shading::tone_map::tone_map;

/// Response and photographs for the image of one camera.
#[derive(Debug)]
pub(crate) struct Look<'a> {
    response: Option<&'a Response>,
    /// The camera's own photograph if it was taken from where the camera is.
    own: Option<&'a LinearPhotograph>,
    /// All photographs, the camera's own first.
    photographs: Vec<&'a LinearPhotograph>,
}

impl<'a> Look<'a> {
    /// Look of a camera's image; `None` if nothing was measured that concerns it.
    pub fn of(looks: &'a [CameraLook], camera: &Camera) -> Option<Self> {
        let response = looks.iter().find(|look| look.camera == camera.name).map(|look| &*look.response);
        let mut photographs: Vec<&LinearPhotograph> =
            looks.iter().filter_map(|look| look.photograph.as_deref()).collect();
        photographs.sort_by_key(|photograph| !photograph.is_of(camera));
        let own = photographs.first().copied().filter(|photograph| photograph.is_of(camera));
        (response.is_some() || !photographs.is_empty()).then_some(Self { response, own, photographs })
    }

    /// Display-linear colour of a radiance.
    #[inline]
    pub fn display(&self, radiance: Vec3A) -> Vec3A {
        match self.response {
            Some(response) => response.display(radiance),
            None => Vec3A::from_array(tone_map(radiance.to_array())),
        }
    }

    /// Display-linear colour of the background at a pixel position; `None` without an own photograph.
    pub fn background(&self, camera: &CameraView, place: Vec2) -> Option<Vec3A> {
        let own = self.own?;
        let ray = ((place - camera.center) / camera.focal).extend(1.0);
        own.along(ray.as_dvec3()).map(|radiance| self.display(radiance))
    }

    /// Photographed light of a surface point in the world (m) with a unit normal; `None` where it has to be rendered.
    pub fn surface(&self, point: Vec3A, normal: Vec3A, lighting: &Lighting) -> Option<Photographed> {
        if normal.z < UPWARD {
            return self.own?.at(point).map(Photographed::AsSeen);
        }
        let radiance = self.photographs.iter().find_map(|photograph| photograph.at(point))?;
        let light = lighting.key * lighting.to_light.dot(normal).max(0.0) + lighting.around(normal);
        Some(Photographed::Base(radiance / (light * lighting.exposure).max(Vec3A::splat(1e-4))))
    }
}

/// Smallest z of the normal of surfaces that are shaded again; others, as the sides of a table, stay as photographed.
const UPWARD: f32 = 0.7;

/// Photographed light of a surface.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Photographed {
    /// Base colour of a matt surface in the light of the scene.
    Base(Vec3A),
    /// Radiance to be shown as it is.
    AsSeen(Vec3A),
}

impl RenderVariation {
    /// Light and appearance of a world: the default ones, those measured in its workspace, then its randomisation.
    ///
    /// # Errors
    /// [`RenderError::BadCamera`] for a response without a rising tone curve, and for a photograph that is no JPEG of its
    /// camera's size.
    pub fn of_world(world: &World) -> Result<Self, RenderError> {
        let usual = match &world.appearance {
            None => Self::default(),
            Some(appearance) => Self::measured(appearance, &world.cameras)?,
        };
        Ok(world.look.as_ref().map_or_else(|| usual.clone(), |look| sampling::varied(&usual, look)))
    }

    fn measured(appearance: &WorkspaceAppearance, cameras: &[Camera]) -> Result<Self, RenderError> {
        let mut variation = Self { exposure: 1.0, ..Self::default() };
        if let Some(light) = &appearance.light {
            variation.set_light(light);
        }
        variation.measured.clone_from(&appearance.materials);
        variation.table_base = appearance.table_color.map(|color| color.map(|value| value as f32));
        for entry in &appearance.cameras {
            let bad = |problem: String| RenderError::BadCamera { camera: entry.camera.clone(), problem };
            let response = Response::new(&entry.response).ok_or_else(|| bad("its tone curve does not rise".into()))?;
            let camera = cameras.iter().find(|camera| camera.name == entry.camera);
            let photograph = entry.photograph.as_ref().zip(camera).map(|(photograph, camera)| {
                let (rgb, [width, height]) = decoded(&photograph.jpeg).map_err(bad)?;
                let expected = [camera.intrinsics.width, camera.intrinsics.height];
                let linear = LinearPhotograph::new(camera, response.radiance(&rgb));
                linear.filter(|_| expected == [width, height]).map(Arc::new).ok_or_else(|| {
                    let [columns, rows] = expected;
                    bad(format!("its photograph is {width}×{height}, expected {columns}×{rows} of a fixed camera"))
                })
            });
            let photograph = photograph.transpose()?;
            variation.looks.push(CameraLook { camera: entry.camera.clone(), response: response.into(), photograph });
        }
        Ok(variation)
    }

    /// Replaces key light and ambient light.
    pub fn set_light(&mut self, light: &WorkspaceLight) {
        // A colour with its largest channel 1, and that channel's value.
        let split = |color: [f64; 3]| {
            let brightest = color.iter().fold(0.0_f64, |most, &value| most.max(value));
            let share =
                color.map(|value| if brightest > 0.0 { srgb_from_linear((value / brightest) as f32) } else { 1.0 });
            (share, brightest as f32)
        };
        self.light_direction = light.direction.map(|axis| axis as f32);
        self.light_angular_radius = light.angular_radius_rad as f32;
        (self.light_color, self.light_intensity) = split(light.key);
        self.sky_color = split(light.ambient).0;
        // The studio's ground lights what faces down; a surface that faces up gets next to nothing of it.
        self.ground_color = self.sky_color;
        self.ambient_intensity = luminance(Vec3A::from_array(light.ambient.map(|value| value as f32)));
    }
}
