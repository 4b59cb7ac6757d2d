//! Calibrations from rendered images of a board with known truth.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use genmanip_assets::Catalogue;
use genmanip_assets::worlds::default_world;
use genmanip_core::glam::{DQuat, DVec2, DVec3, Vec2, Vec3};
use genmanip_core::sensor::SENSORS;
use genmanip_core::{
    AppearanceFactor, Camera, CameraMount, CameraSensor, Distortion, Intrinsics, Material, ObjectModel, Pose, Seed,
    Texture, TriMesh, VisualPart,
};
use genmanip_real::boards::{Charuco, GreyImage, Layout, detect};
use genmanip_real::calibrate::{Board, CalibrationSettings, Mounting, Noise, calibrate};
use genmanip_real::synthetic::Scene;
use genmanip_render::{Channels, FrameBuffers, RenderAssets, Renderer, ViewJob, encode, sampling, sensor};
use genmanip_workspace::{WorkspaceError, documents, text_table};
use rand::RngExt;
use serde::Serialize;

use crate::board_sets;
use crate::quantile::Spread;

/// Printed ChArUco board.
const BOARD: Charuco = Charuco { columns: 9, rows: 6, square_m: 0.03, tag_m: 0.0225, first_id: 0 };
/// Texels per edge of a chessboard square. A power of two: markers have a whole number of texels per cell, and every
/// mip level halves exactly.
const TEXELS: f64 = 128.0;
/// Grey levels (8-bit sRGB) of ink and paper.
const PRINT: [u8; 2] = [30, 235];
/// Thickness of the board, m.
const THICKNESS_M: f32 = 0.003;
/// Height by which the scene is raised above the table of the rendered world, m.
const LIFT_M: f64 = 0.03;
/// Number of images without a board, to count false detections.
const EMPTY: usize = 100;
/// JPEG quality of noisy images, 1 to 100.
const JPEG_QUALITY: u8 = 90;

/// Accuracy of board detection and calibration on rendered images.
#[derive(Clone, Debug, Serialize)]
pub struct RenderedReport {
    /// Results by mounting and noise.
    pub setups: Vec<RenderedSetup>,
    /// Images without a board: number in which one was detected, and number of all.
    pub false_boards: [usize; 2],
}

/// Results of one mounting and noise.
#[derive(Clone, Debug, Default, Serialize)]
pub struct RenderedSetup {
    /// Mounting of the camera, by name: on the hand or fixed in the world.
    pub mounting: &'static str,
    /// Noise of sensor and robot.
    pub noise: &'static str,
    /// Number of sets, refused ones included.
    pub sets: usize,
    /// Reasons of refused calibrations, one per refused set.
    pub refused: Vec<String>,
    /// Number of images in which the board was detected, and of all images.
    pub boards: [usize; 2],
    /// Number of detected corners, and of all corners inside the images.
    pub corners: [usize; 2],
    /// Distance of a detected corner from its true pixel, px.
    pub corner_px: Spread,
    /// Position error of points on the table located with the calibrated camera, m.
    pub table_m: Spread,
    /// Error of the camera's position on its mount, m.
    pub position_m: Spread,
    /// Error of the camera's orientation on its mount, degrees.
    pub rotation_deg: Spread,
}

/// Number, views and noise of the sets, and output folder.
pub struct Settings<'a> {
    /// Number of sets of each mounting and noise.
    pub count: usize,
    /// Minimum and maximum number of views of a set.
    pub views: [usize; 2],
    /// Noises by name. The first one has no camera noise; all others also have the noise of a D435's colour images.
    pub noises: &'a [(&'static str, Noise)],
    /// Folder for the images, views and detected corners of each set; nothing is written if `None`.
    pub folder: Option<&'a Path>,
}

/// Calibrates random sets from rendered images, and runs the detector on images without a board.
///
/// # Errors
/// When an image cannot be rendered or written.
pub fn measure(settings: &Settings<'_>, seed: Seed) -> Result<RenderedReport, WorkspaceError> {
    let layout = BOARD.layout().map_err(WorkspaceError::input)?;
    let assets = board_assets(&layout)?;
    let mut setups = Vec::new();
    for mounting in [Mounting::EyeInHand, Mounting::EyeToHand] {
        for (index, (name, noise)) in settings.noises.iter().enumerate() {
            let sensor = if index == 0 { None } else { noisy_sensor() };
            let kind = Kind { mounting, name, noise, sensor, layout: &layout, assets: &assets };
            setups.push(kind.measured(settings, seed.fork(mounting.name()).fork(name))?);
        }
    }
    let false_boards = false_boards(EMPTY, &layout, seed.fork("empty"))?;
    Ok(RenderedReport { setups, false_boards })
}

/// Number of images without a board in which one was detected, and number of all.
fn false_boards(count: usize, layout: &Layout, seed: Seed) -> Result<[usize; 2], WorkspaceError> {
    let mut found = 0;
    for index in 0..count {
        found += usize::from(detect(&empty(index, seed.fork_index(index as u64))?, layout).is_ok());
    }
    Ok([found, count])
}

/// One combination of mounting and noise, with the assets to render it.
struct Kind<'a> {
    mounting: Mounting,
    name: &'static str,
    noise: &'a Noise,
    sensor: Option<CameraSensor>,
    layout: &'a Layout,
    assets: &'a Arc<RenderAssets>,
}

impl Kind<'_> {
    fn measured(&self, settings: &Settings<'_>, seed: Seed) -> Result<RenderedSetup, WorkspaceError> {
        let (mut corner_px, mut table, mut position, mut rotation) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        let mut report = RenderedSetup {
            mounting: self.mounting.name(),
            noise: self.name,
            sets: settings.count,
            ..RenderedSetup::default()
        };
        let [fewest, most] = settings.views;
        for index in 0..settings.count {
            let own = seed.fork_index(index as u64);
            let count = fewest + index % (most - fewest + 1);
            let mut scene = Scene::of_board(self.mounting, count, own.fork("scene"), |_| planned_board());
            if index % 2 == 1 {
                scene.camera.distortion = Some(Distortion { k1: -0.12, k2: 0.05, p1: 4e-4, p2: -3e-4, k3: 0.0 });
            }
            let mut views = scene.views(self.noise, own.fork("robot"));
            let folder = settings
                .folder
                .map(|folder| folder.join(format!("rendered_{}_{}_{index:03}", self.mounting.name(), self.name)));
            if let Some(folder) = &folder {
                board_sets::write(folder, &scene, &Board::Charuco(BOARD), &views)?;
            }
            let mut pixels: BTreeMap<String, Vec<(u32, f64, f64)>> = BTreeMap::new();
            let mut renderer = Renderer::new(Arc::clone(self.assets), sampled_look(own));
            for (view, hand) in views.iter_mut().zip(&scene.hands) {
                let image = self.photo(&mut renderer, &scene, hand, own.fork("photo").fork(&view.id))?;
                if let Some(folder) = &folder {
                    let png = encode::png_rgb(image.width, image.height, &image.rgb).map_err(broken)?;
                    documents::write_file(&folder.join(format!("{}.png", view.id)), &png)?;
                }
                let truth = self.true_corners(&scene, hand);
                let found = detect(&grey(&image)?, self.layout).unwrap_or_default();
                pixels.insert(view.id.clone(), found.iter().map(|(id, at)| (*id, at.x, at.y)).collect());
                report.boards[0] += usize::from(!found.is_empty());
                report.boards[1] += 1;
                report.corners[0] += found.len();
                report.corners[1] += truth.iter().flatten().count();
                corner_px.extend(found.iter().filter_map(|(id, at)| Some(truth[*id as usize]?.distance(*at))));
                view.corners =
                    found.iter().map(|(id, at)| (self.layout.corners[*id as usize].at.extend(0.0), *at)).collect();
            }
            if let Some(folder) = &folder {
                let text = serde_json::to_vec(&pixels).map_err(broken)?;
                documents::write_file(&folder.join("corners.json"), &text)?;
            }
            views.retain(|view| view.corners.len() >= 6);
            match calibrate(&scene.camera, self.mounting, &views, Vec::new(), &CalibrationSettings::default()) {
                Ok(found) => {
                    let pose = found.camera.mount_from_camera;
                    table.extend(scene.table_errors_m(&pose));
                    position.push(pose.position.distance(scene.mount_from_camera.position));
                    rotation.push(pose.angle_to(&scene.mount_from_camera).to_degrees());
                }
                Err(error) => report.refused.push(error.to_string()),
            }
        }
        report.corner_px = Spread::of(corner_px);
        report.table_m = Spread::of(table);
        report.position_m = Spread::of(position);
        report.rotation_deg = Spread::of(rotation);
        Ok(report)
    }

    /// Image of the board when the hand is at a pose.
    fn photo(
        &self,
        renderer: &mut Renderer,
        scene: &Scene,
        hand: &Pose,
        seed: Seed,
    ) -> Result<FrameBuffers, WorkspaceError> {
        let lift = Pose::from_position(DVec3::Z * LIFT_M);
        let world_from_camera = lift
            * match self.mounting {
                Mounting::EyeInHand => *hand * scene.mount_from_camera,
                Mounting::EyeToHand => scene.mount_from_camera,
            };
        let world_from_print = world_from_camera * scene.camera_from_board(hand) * planned_from_print();
        let frame = renderer.assets().frame_state(&[], 0.0, [(world_from_print, &[][..])]).map_err(broken)?;
        let camera = Camera {
            distortion: scene.camera.distortion,
            sensor: self.sensor,
            ..Camera::new("calibrated", CameraMount::World, world_from_camera, scene.camera.intrinsics)
        };
        photographed(renderer, &frame, &camera, seed)
    }

    /// True pixel of every corner of the board, by corner id; `None` outside the image.
    fn true_corners(&self, scene: &Scene, hand: &Pose) -> Vec<Option<DVec2>> {
        let Intrinsics { width, height, .. } = scene.camera.intrinsics;
        let last = DVec2::new(f64::from(width), f64::from(height)) - 1.0;
        let camera_from_print = scene.camera_from_board(hand) * planned_from_print();
        let pixel = |at: DVec2| scene.camera.pixel(camera_from_print.transform_point(at.extend(0.0)));
        let is_inside = |pixel: &DVec2| pixel.cmpge(DVec2::ZERO).all() && pixel.cmple(last).all();
        self.layout.corners.iter().map(|corner| pixel(corner.at).filter(is_inside)).collect()
    }
}

/// Corners of the printed board in a frame whose z points out of the print.
fn planned_board() -> Board {
    let Charuco { columns, rows, square_m, .. } = BOARD;
    Board::Grid { columns: columns - 1, rows: rows - 1, spacing_m: square_m }
}

fn planned_from_print() -> Pose {
    let Charuco { rows, square_m, .. } = BOARD;
    let corner = DVec3::new(-square_m, f64::from(rows - 1) * square_m, 0.0);
    Pose::new(corner, DQuat::from_rotation_x(std::f64::consts::PI))
}

/// Noise of a D435's colour images, and compression.
fn noisy_sensor() -> Option<CameraSensor> {
    let color =
        SENSORS[0].sensor.color.map(|color| genmanip_core::ColorSensor { jpeg_quality: Some(JPEG_QUALITY), ..color });
    Some(CameraSensor { depth: None, color })
}

fn sampled_look(seed: Seed) -> genmanip_render::RenderVariation {
    let vary = [AppearanceFactor::Light, AppearanceFactor::Background, AppearanceFactor::Material];
    sampling::sampled(seed.fork("look"), &vary)
}

/// Assets of a scene with the board over a table.
fn board_assets(layout: &Layout) -> Result<Arc<RenderAssets>, WorkspaceError> {
    let catalogue = Catalogue::builtin();
    let uid = &catalogue.cards()[0].uid;
    let mut model = (*catalogue.build(uid).map_err(broken)?).clone();
    model.links.truncate(1);
    model.links[0].joint = None;
    model.links[0].visual = vec![board_part(layout)];
    RenderAssets::without_robot(&[Arc::new(model)], Some(&default_world())).map_err(broken)
}

/// Thin box that shows the print on its face at z = 0, seen from negative z.
fn board_part(layout: &Layout) -> VisualPart {
    let border_m = BOARD.square_m / 2.0;
    let raster = layout.raster(BOARD.square_m / TEXELS, border_m);
    let rgb = raster.values().iter().flat_map(|&value| [PRINT[usize::from(value > 127)]; 3]).collect();
    let texture = Texture { width: raster.width() as u32, height: raster.height() as u32, rgb };
    let (low, high) = (DVec2::splat(-border_m).as_vec2(), (layout.size_m + border_m).as_vec2());
    let corner = |x: f32, y: f32, z: f32| Vec3::new([low.x, high.x][x as usize], [low.y, high.y][y as usize], z);
    let mut mesh = TriMesh::default();
    let mut face = |corners: [[f32; 3]; 4], shows_print: bool| {
        let first = mesh.positions.len() as u32;
        let points = corners.map(|[x, y, z]| corner(x, y, z * THICKNESS_M));
        let normal = (points[1] - points[0]).cross(points[2] - points[0]).normalize();
        mesh.positions.extend(points);
        mesh.normals.extend([normal; 4]);
        // All other faces sample one texel of the white border.
        mesh.uvs.extend(corners.map(|[x, y, _]| if shows_print { Vec2::new(x, y) } else { Vec2::splat(0.001) }));
        mesh.triangles.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
    };
    face([[0., 0., 0.], [0., 1., 0.], [1., 1., 0.], [1., 0., 0.]], true);
    face([[0., 0., 1.], [1., 0., 1.], [1., 1., 1.], [0., 1., 1.]], false);
    face([[0., 0., 0.], [1., 0., 0.], [1., 0., 1.], [0., 0., 1.]], false);
    face([[0., 1., 0.], [0., 1., 1.], [1., 1., 1.], [1., 1., 0.]], false);
    face([[0., 0., 0.], [0., 0., 1.], [0., 1., 1.], [0., 1., 0.]], false);
    face([[1., 0., 0.], [1., 1., 0.], [1., 1., 1.], [1., 0., 1.]], false);
    let paper = Material { texture: Some(Arc::new(texture)), ..Material::plain([1.0; 3], 0.9) };
    VisualPart::new("board", mesh, paper, Pose::IDENTITY)
}

/// Image of a table with objects and no board.
fn empty(index: usize, seed: Seed) -> Result<GreyImage, WorkspaceError> {
    const OBJECTS: usize = 12;
    let mut rng = seed.rng();
    let catalogue = Catalogue::builtin();
    let cards = catalogue.cards();
    let objects: Vec<Arc<ObjectModel>> = (0..OBJECTS)
        .map(|_| catalogue.build(&cards[rng.random_range(0..cards.len())].uid))
        .collect::<Result<_, _>>()
        .map_err(broken)?;
    let assets = RenderAssets::without_robot(&objects, Some(&default_world())).map_err(broken)?;
    let joints: Vec<Vec<f64>> = objects.iter().map(|object| vec![0.0; object.joint_count()]).collect();
    let poses: Vec<Pose> = (0..OBJECTS)
        .map(|_| {
            let at = DVec3::new(rng.random_range(0.3..0.7), rng.random_range(-0.3..0.3), 0.0);
            Pose::from_position_yaw(at, rng.random_range(-3.0..3.0))
        })
        .collect();
    let placed = poses.iter().zip(&joints).map(|(pose, joints)| (*pose, joints.as_slice()));
    let frame = assets.frame_state(&[], 0.0, placed).map_err(broken)?;
    let eye = DVec3::new(rng.random_range(-0.1..0.9), rng.random_range(-0.6..0.6), rng.random_range(0.25..0.9));
    let intrinsics = Intrinsics { width: 640, height: 480, fx: 605.0, fy: 605.0, cx: 319.5, cy: 239.5 };
    let camera = Camera {
        sensor: if index.is_multiple_of(2) { None } else { noisy_sensor() },
        ..Camera::looking_at("empty", eye, DVec3::new(0.5, 0.0, 0.05), intrinsics)
    };
    let mut renderer = Renderer::new(assets, sampled_look(seed));
    grey(&photographed(&mut renderer, &frame, &camera, seed)?)
}

fn photographed(
    renderer: &mut Renderer,
    frame: &genmanip_render::FrameState,
    camera: &Camera,
    seed: Seed,
) -> Result<FrameBuffers, WorkspaceError> {
    let ideal = sensor::pinhole(camera).map_err(broken)?;
    let job = ViewJob::new(frame, &ideal, sensor::needed(camera, Channels::RGB));
    let mut out = [FrameBuffers::default()];
    renderer.render(&[job], &mut out).map_err(broken)?;
    let [picture] = out;
    sensor::developed(renderer, camera, Channels::RGB, picture, seed).map_err(broken)
}

fn grey(image: &FrameBuffers) -> Result<GreyImage, WorkspaceError> {
    GreyImage::from_rgb(image.width as usize, image.height as usize, &image.rgb)
        .ok_or_else(|| WorkspaceError::input("an image of another size than it says"))
}

fn broken(error: impl std::error::Error + Send + Sync + 'static) -> WorkspaceError {
    WorkspaceError::broken("a board cannot be rendered", error)
}

/// Text summary.
pub fn describe(report: &RenderedReport) -> String {
    let of = |[found, all]: [usize; 2]| format!("{found} of {all}");
    let head =
        ["rendered", "noise", "sets", "refused", "boards", "corners", "corner, px", "table, mm", "rotation, deg"];
    let mut rows = vec![head.map(String::from).to_vec()];
    rows.extend(report.setups.iter().map(|it| {
        vec![
            it.mounting.into(),
            it.noise.into(),
            it.sets.to_string(),
            it.refused.len().to_string(),
            of(it.boards),
            of(it.corners),
            it.corner_px.text(1.0),
            it.table_m.text(1e3),
            it.rotation_deg.text(1.0),
        ]
    }));
    let [found, all] = report.false_boards;
    text_table(&rows) + &format!("boards found in {found} of {all} images without one\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rendered_boards_calibrate_a_camera() {
        let layout = BOARD.layout().unwrap();
        let assets = board_assets(&layout).unwrap();
        let noise = Noise::default();
        let settings = Settings { count: 1, views: [8, 8], noises: &[], folder: None };
        for (mounting, sensor) in [(Mounting::EyeInHand, None), (Mounting::EyeToHand, noisy_sensor())] {
            let kind = Kind { mounting, name: "test", noise: &noise, sensor, layout: &layout, assets: &assets };
            let report = kind.measured(&settings, Seed::new(3)).unwrap();
            assert!(report.boards == [8, 8] && report.refused.is_empty(), "{report:?}");
            assert!(report.corners[0] as f64 > 0.95 * report.corners[1] as f64, "{report:?}");
            assert!(report.corner_px.median < 0.1 && report.corner_px.p95 < 0.3, "{report:?}");
            assert!(report.table_m.median < 2e-3, "{report:?}");
        }
        assert_eq!(false_boards(4, &layout, Seed::new(3)).unwrap(), [0, 4]);
    }
}
