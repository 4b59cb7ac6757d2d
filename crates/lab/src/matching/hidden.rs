//! Hidden worlds whose photographs are matched: light, table, room, materials, camera response and noise are drawn from a
//! seed.

use std::sync::Arc;

use genmanip_assets::worlds::default_world;
use genmanip_assets::{Catalogue, panda};
use genmanip_core::glam::{DVec2, DVec3, Vec2, Vec3};
use genmanip_core::sensor::SENSORS;
use genmanip_core::{
    AppearanceFactor, Camera, CameraResponse, CameraSensor, Material, MeasuredMaterial, ObjectModel, Pose, Projection,
    RobotModel, Seed, Texture, TriMesh, VisualPart, World,
};
use genmanip_render::color::{linear_from_srgb8, luminance, srgb8_from_linear};
use genmanip_render::internals::{Lighting, Material as PaintedMaterial};
use genmanip_render::{
    CameraLook, Channels, FrameBuffers, FrameState, RenderAssets, RenderVariation, Renderer, Response, ViewJob,
    sampling, sensor,
};
use genmanip_render_reference::{ReferenceSettings, trace};
use genmanip_visual_matching::chart::{COLORS, PATCHES};
use genmanip_visual_matching::{ChartPhoto, Photo, response::with_gains};
use genmanip_workspace::WorkspaceError;
use glam::{Mat3A, Vec3A};
use rand::{Rng, RngExt};

/// Width and height of the photographs, px.
pub const SIZE_PX: [u32; 2] = [384, 216];
/// Light paths per pixel of path-traced photographs.
const PATHS: u32 = 24;
/// Side of a patch of the chart, its border, and its thickness, m.
const PATCH_M: f64 = 0.042;
const BORDER_M: f64 = 0.006;
const THICKNESS_M: f64 = 0.002;
/// Error of the chart's corners, which a person picks in the image, px.
const CORNER_PX: f64 = 0.4;
/// Objects that throw shadows in the photographs, and other ones of held-out views; all stand on the table.
const CASTERS: [&str; 4] = ["mug", "milk carton", "soda can", "bottle"];

/// Content of a hidden world's photographs besides the empty table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Kind {
    /// The arm at its home position.
    pub arm: bool,
    /// One photograph with known objects.
    pub objects: bool,
    /// One photograph with a colour chart.
    pub chart: bool,
    /// Path-traced photographs with a tone curve that the matched response cannot have.
    pub traced: bool,
}

impl Kind {
    /// Kind of the world with this number: of ten, five have arm and objects, two the arm alone, one objects alone, and
    /// two nothing that throws a shadow, one of them without a chart; every fifth is path-traced.
    pub fn of(index: usize) -> Self {
        let (arm, objects, chart) = match index % 10 {
            0..=4 => (true, true, true),
            5 | 6 => (true, false, true),
            7 => (false, true, true),
            8 => (false, false, true),
            _ => (false, false, false),
        };
        Self { arm, objects, chart, traced: index % 5 == 2 }
    }
}

/// Objects with poses.
pub type Placed = Vec<(Arc<ObjectModel>, Pose)>;

/// A hidden world.
pub struct Hidden {
    /// Content of its photographs.
    pub kind: Kind,
    /// World with the camera `static`, which is photographed with, and the camera `aside`, a second place of it.
    pub world: World,
    /// Robot of the world.
    pub robot: Arc<RobotModel>,
    /// True response, with the light on the open table as unit of radiance.
    pub response: CameraResponse,
    /// True direction towards the key light.
    pub direction: DVec3,
    /// Objects of the photographs, and others, with poses.
    pub objects: [Placed; 2],
    /// The objects of the photographs at other places.
    pub layouts: [Placed; 3],
    /// True materials of the objects in the photographs.
    pub materials: Vec<MeasuredMaterial>,
    variation: RenderVariation,
    /// Response to the radiance of the renderer.
    shown: CameraResponse,
    seed: Seed,
}

impl Hidden {
    /// World with this number under a seed.
    ///
    /// # Errors
    /// When the catalogue lacks an object, or no response can be prepared.
    pub fn new(index: usize, seed: Seed) -> Result<Self, WorkspaceError> {
        let seed = seed.fork_index(index as u64);
        let kind = Kind::of(index);
        let rng = &mut seed.fork("hidden").rng();
        let vary = [AppearanceFactor::Light, AppearanceFactor::Background, AppearanceFactor::Material];
        let mut variation = sampling::sampled(seed.fork("look"), &vary);
        variation.exposure = 1.0;
        let mut world = (*default_world()).clone();
        let place = |camera: &str| world.camera(camera).map(sized).into_iter();
        let mut cameras: Vec<Camera> = place("static").chain(place("right")).collect();
        for camera in &mut cameras {
            camera.sensor = Some(CameraSensor { depth: None, color: SENSORS[0].sensor.color });
        }
        if let Some(aside) = cameras.get_mut(1) {
            aside.name = "aside".into();
        }
        for camera in &mut cameras {
            *camera = sampling::jittered(camera, 0.03, 0.02, rng);
        }
        world.cameras = cameras;
        let mut between = |low: f64, high: f64| rng.random_range(low..high);
        let lighting = Lighting::new(&variation, None);
        let light = lighting.key * lighting.to_light.z + lighting.around(Vec3A::Z);
        let light = light.to_array().map(f64::from);
        let gains = [0; 3].map(|_| between(0.75, 1.3));
        let exposure = between(0.7, 1.15) / f64::from(luminance(Vec3A::from_array(light.map(|value| value as f32))));
        let mut row = |own: usize| {
            let mut row = [0; 3].map(|_| between(-0.1, 0.06));
            row[own] = 1.0 - (row.iter().sum::<f64>() - row[own]);
            row
        };
        let matrix = [row(0), row(1), row(2)];
        let (contrast, white) = (between(0.9, 1.25), between(1.0, 2.0));
        let shape = CameraResponse { matrix, contrast, white, ..CameraResponse::default() };
        let shown = with_gains(gains.map(|gain| gain * exposure), shape);
        let seen = [0, 1, 2].map(|channel| shown.gains()[channel] * light[channel]);
        let response = with_gains(seen, shown.clone());
        let direction = Vec3::from_array(variation.light_direction).as_dvec3().normalize();
        let objects = [placed(&CASTERS[..2], seed.fork("casters"))?, placed(&CASTERS[2..], seed.fork("others"))?];
        let models = || objects[0].iter().map(|(model, _)| Arc::clone(model));
        let layouts = [0, 1, 2].map(|index| {
            let rng = &mut seed.fork("layouts").fork_index(index).rng();
            models().enumerate().map(|(index, model)| standing(model, index, rng)).collect()
        });
        let materials = repainted(models(), seed.fork("materials"));
        variation.measured.clone_from(&materials);
        let robot = panda();
        Ok(Self { kind, world, robot, response, direction, objects, layouts, materials, variation, shown, seed })
    }

    /// Photograph by a camera (its index in the world): with the arm at these joint positions, if any, and objects.
    ///
    /// # Errors
    /// When it cannot be rendered.
    pub fn photo(
        &self,
        camera: usize,
        arm: Option<&[f64]>,
        objects: &[(Arc<ObjectModel>, Pose)],
        label: &str,
    ) -> Result<Photo, WorkspaceError> {
        let camera = &self.world.cameras[camera];
        let (assets, frame) = posed(&self.world, &self.robot, arm, objects)?;
        let mut variation = self.variation.clone();
        let response =
            Response::new(&self.shown).ok_or_else(|| WorkspaceError::input("a response that does not rise"))?;
        let look = CameraLook { camera: camera.name.clone(), response: Arc::new(response), photograph: None };
        variation.looks = vec![look];
        let mut renderer = Renderer::new(Arc::clone(&assets), variation.clone());
        let job = ViewJob::new(&frame, camera, Channels::RGB);
        let mut out = [FrameBuffers::default()];
        renderer.render(&[job], &mut out).map_err(broken)?;
        let [mut image] = out;
        if self.kind.traced {
            let seed = self.seed.fork("paths").fork(label);
            let settings = ReferenceSettings { paths: PATHS, seed, threads: 1 };
            let traced = trace(&assets, &variation, &job, &settings).map_err(broken)?;
            let background = image.rgb.chunks_exact(3).map(|rgb| linear_from_srgb8([rgb[0], rgb[1], rgb[2]]));
            let filmic = |(radiance, behind): ([f32; 3], Vec3A)| {
                let radiance = Vec3A::from_array(radiance);
                // The tracer's background is an image colour without light: that of the rasterised image is taken.
                let is_background = radiance == Vec3A::ZERO;
                srgb8_from_linear(if is_background { behind } else { self.filmic(radiance) })
            };
            image.rgb = traced.radiance().into_iter().zip(background).flat_map(filmic).collect();
        }
        let seed = self.seed.fork("noise").fork(label);
        let image = sensor::developed(&renderer, camera, Channels::RGB, image, seed).map_err(broken)?;
        Ok(Photo { camera: camera.name.clone(), width: image.width, height: image.height, rgb: image.rgb })
    }

    /// Display colour with the true gains and matrix and the tone curve of K. Narkowicz, "ACES Filmic Tone Mapping Curve"
    /// (2016), scaled so that it keeps middle grey.
    fn filmic(&self, radiance: Vec3A) -> Vec3A {
        // Solves curve(SCALE * 0.18) = 0.18.
        const SCALE: f32 = 0.723_170_8;
        let matrix = Mat3A::from_cols_array_2d(&self.shown.matrix.map(|row| row.map(|value| value as f32))).transpose();
        let gains = Vec3A::from_array(self.shown.gains().map(|gain| gain as f32));
        let value = (matrix * (radiance * gains)).max(Vec3A::ZERO) * SCALE;
        let curve = (value * (value * 2.51 + 0.03)) / (value * (value * 2.43 + 0.59) + 0.14);
        curve.clamp(Vec3A::ZERO, Vec3A::ONE)
    }

    /// Photograph with the colour chart on the open table, and the picked corners.
    ///
    /// # Errors
    /// When it cannot be rendered.
    pub fn chart(&self, arm: Option<&[f64]>) -> Result<ChartPhoto, WorkspaceError> {
        let rng = &mut self.seed.fork("chart").rng();
        let (board, at) = (chart_board()?, self.open_place());
        let pose = Pose::from_position_yaw(at, std::f64::consts::FRAC_PI_2 + rng.random_range(-0.1..0.1));
        let photo = self.photo(0, arm, &[(board, pose)], "chart")?;
        let projection = Projection::of(&self.world.cameras[0], &Pose::IDENTITY);
        let [columns, rows] = PATCHES;
        let corner = |column: usize, row: usize| {
            let middle = patch_center(column, row);
            let pixel =
                projection.pixel(pose.transform_point(middle.extend(THICKNESS_M))).map_or(DVec2::ZERO, |it| it.0);
            pixel + DVec2::new(rng.random_range(-CORNER_PX..CORNER_PX), rng.random_range(-CORNER_PX..CORNER_PX))
        };
        let corners = [(0, 0), (columns - 1, 0), (columns - 1, rows - 1), (0, rows - 1)];
        let mut corner = corner;
        Ok(ChartPhoto { photo, corners_px: corners.map(|(column, row)| corner(column, row)) })
    }

    /// Place for the chart, on the side of the workspace that the arm does not shadow.
    fn open_place(&self) -> DVec3 {
        let side = if self.direction.y > 0.0 { 1.0 } else { -1.0 };
        DVec3::new(0.62, 0.22 * side, 0.0)
    }
}

/// Assets and frame of a world with the arm at these joint positions, if any, and objects.
///
/// # Errors
/// When a mesh is invalid.
pub fn posed(
    world: &World,
    robot: &Arc<RobotModel>,
    arm: Option<&[f64]>,
    objects: &[(Arc<ObjectModel>, Pose)],
) -> Result<(Arc<RenderAssets>, FrameState), WorkspaceError> {
    let models: Vec<Arc<ObjectModel>> = objects.iter().map(|(model, _)| Arc::clone(model)).collect();
    let joints: Vec<Vec<f64>> = models.iter().map(|model| vec![0.0; model.joint_count()]).collect();
    let poses = objects.iter().zip(&joints).map(|((_, pose), joints)| (*pose, joints.as_slice()));
    let assets = match arm {
        Some(_) => RenderAssets::new(Arc::clone(robot), &models, Some(world)),
        None => RenderAssets::without_robot(&models, Some(world)),
    };
    let assets = assets.map_err(broken)?;
    let frame = assets.frame_state(arm.unwrap_or_default(), robot.gripper.max_width, poses).map_err(broken)?;
    Ok((assets, frame))
}

/// The camera with images of the size of the photographs.
fn sized(camera: &Camera) -> Camera {
    let [width, height] = SIZE_PX;
    Camera { intrinsics: camera.intrinsics.resized(width, height), ..camera.clone() }
}

/// One object of each category, standing at random places of the workspace.
fn placed(categories: &[&str], seed: Seed) -> Result<Placed, WorkspaceError> {
    let catalogue = Catalogue::builtin();
    let rng = &mut seed.rng();
    let mut out = Vec::new();
    for (index, category) in categories.iter().enumerate() {
        let fits = catalogue
            .cards()
            .iter()
            .filter(|card| card.category.contains(category) && card.size_m.z > 0.06 && card.size_m.max_element() < 0.3);
        let fits: Vec<_> = fits.collect();
        let card = fits.get(rng.random_range(0..fits.len().max(1)));
        let card = card.ok_or_else(|| WorkspaceError::input(format!("the catalogue has no upright {category}")))?;
        let model = catalogue.build(&card.uid).map_err(broken)?;
        out.push(standing(model, index, rng));
    }
    Ok(out)
}

/// An object at a random place of the workspace, to the left or right by its index.
fn standing(model: Arc<ObjectModel>, index: usize, rng: &mut impl Rng) -> (Arc<ObjectModel>, Pose) {
    let side = if index.is_multiple_of(2) { 1.0 } else { -1.0 };
    let at = DVec3::new(rng.random_range(0.42..0.62), side * rng.random_range(0.08..0.26), 0.0);
    let pose = Pose::from_position_yaw(at, rng.random_range(-3.0..3.0));
    // The origin of an object lies anywhere in it: its lowest point is put onto the table.
    let low = lowest(&model);
    (model, Pose { position: at - DVec3::Z * low, ..pose })
}

/// Random materials of all opaque parts: up to 40 % more or less of each colour channel, and any roughness from 0.1.
fn repainted(models: impl Iterator<Item = Arc<ObjectModel>>, seed: Seed) -> Vec<MeasuredMaterial> {
    let rng = &mut seed.rng();
    let mut found: Vec<MeasuredMaterial> = Vec::new();
    for model in models {
        for part in model.links.iter().flat_map(|link| &link.visual).filter(|part| part.material.opacity >= 1.0) {
            let mean = PaintedMaterial::new(&part.material).mean_color().to_array().map(f64::from);
            let factor = [0, 1, 2].map(|channel| rng.random_range(0.6..1.4_f64).min(0.9 / mean[channel].max(1e-3)));
            let roughness = Some(rng.random_range(0.1..0.95));
            if !found.iter().any(|it| it.is_of(&model.card.uid, &part.name)) {
                let (object, part) = (model.card.uid.clone(), part.name.clone());
                found.push(MeasuredMaterial { object, part, color_factor: factor, roughness });
            }
        }
    }
    found
}

/// Lowest z of an object's visible parts in its own frame, m.
fn lowest(model: &ObjectModel) -> f64 {
    let links = model.link_poses(&vec![0.0; model.joint_count()]);
    let parts = model.links.iter().zip(links).flat_map(|(link, pose)| {
        link.visual.iter().flat_map(move |part| {
            let placed = pose * part.link_from_part;
            part.mesh.positions.iter().map(move |at| placed.transform_point(at.as_dvec3()).z)
        })
    });
    parts.fold(f64::INFINITY, f64::min)
}

/// Centre of a patch in the chart's frame: x to the right, y up, the top at the given thickness.
fn patch_center(column: usize, row: usize) -> DVec2 {
    DVec2::new((column as f64 + 0.5) * PATCH_M, -(row as f64 + 0.5) * PATCH_M)
        - DVec2::new(PATCHES[0] as f64 / 2.0 * PATCH_M, -(PATCHES[1] as f64) / 2.0 * PATCH_M)
}

/// The colour chart as an object: a thin matt board.
fn chart_board() -> Result<Arc<ObjectModel>, WorkspaceError> {
    const TEXELS: usize = 16;
    let [columns, rows] = PATCHES;
    let rgb = (0..rows * TEXELS).flat_map(|y| (0..columns * TEXELS).flat_map(move |x| color_at(x, y, TEXELS)));
    let texture = Texture { width: (columns * TEXELS) as u32, height: (rows * TEXELS) as u32, rgb: rgb.collect() };
    let half = Vec2::new(columns as f32, rows as f32) * (PATCH_M as f32 / 2.0);
    let mut mesh = TriMesh::default();
    for (x, y) in [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)] {
        mesh.positions.push(Vec3::new(x * half.x, y * half.y, THICKNESS_M as f32));
        mesh.normals.push(Vec3::Z);
        mesh.uvs.push(Vec2::new((x + 1.0) / 2.0, (1.0 - y) / 2.0));
    }
    mesh.triangles = vec![[0, 1, 2], [0, 2, 3]];
    let print = Material { texture: Some(Arc::new(texture)), ior: 1.0, ..Material::plain([1.0; 3], 1.0) };
    let catalogue = Catalogue::builtin();
    let mut model = (*catalogue.build(&catalogue.cards()[0].uid).map_err(broken)?).clone();
    model.links.truncate(1);
    model.links[0].joint = None;
    model.links[0].visual = vec![VisualPart::new("chart", mesh, print, Pose::IDENTITY)];
    Ok(Arc::new(model))
}

/// Colour of a texel of the chart: of its patch, or of the dark border around it.
fn color_at(x: usize, y: usize, texels: usize) -> [u8; 3] {
    let border = (BORDER_M / PATCH_M * texels as f64 / 2.0).round() as usize;
    let inside = |at: usize| (border..texels - border).contains(&(at % texels));
    if inside(x) && inside(y) { COLORS[y / texels * PATCHES[0] + x / texels] } else { [25; 3] }
}

/// Error of a photograph.
pub fn broken(error: impl std::error::Error + Send + Sync + 'static) -> WorkspaceError {
    WorkspaceError::broken("a hidden world cannot be photographed", error)
}
