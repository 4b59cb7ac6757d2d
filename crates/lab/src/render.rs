//! Cost of rendering an episode over a crowded table, seen by the two data cameras.
//!
//! The arm moves as in an episode, pauses included, and carries an object. No physics runs, but resting objects move by
//! about a nanometre per frame, as they do in a simulation.

mod baselines;
mod judge;

use std::collections::BTreeMap;
use std::sync::Arc;

use genmanip_assets::worlds::default_world;
use genmanip_assets::{Catalogue, panda};
use genmanip_core::glam::{DQuat, DVec3};
use genmanip_core::{AssetUid, Camera, ObjectModel, Pose, RobotModel, Seed};
use genmanip_motion::{Chain, IkSettings, InverseKinematics};
use genmanip_render::{Channels, FrameBuffers, FrameState, RenderAssets, RenderVariation, Renderer, ViewJob};
use rand::RngExt;
use serde::Serialize;

use crate::LabError;
use crate::clock::cpu_clock;
use genmanip_workspace::Progress;
use genmanip_workspace::text_table;

pub use baselines::{Baselines, measure as measure_baselines};
pub use judge::{Flip, judge};

/// Number of objects on the table, in four rows of four, each with a texture.
const OBJECTS: usize = 16;
/// Maximum side of an object seen from above, m, so that objects on the grid do not touch.
const MAX_SIDE_M: f64 = 0.12;
/// Number of frames between two waypoints, and of a pause while the fingers close or open: about 5 s in all at 15 Hz.
const MOVE: usize = 12;
const PAUSE: usize = 5;
/// Width and height of the rendered images, px.
const SIZES: [[u32; 2]; 3] = [[512, 288], [1280, 720], [64, 64]];
/// Rendered channels: colour, depth and ids.
const CHANNELS: Channels = Channels { rgb: true, depth: true, instance: true, normal: false, parts: false };

/// Cost of rendering: CPU times of one thread, medians over the frames of the episode.
#[derive(Debug, Serialize)]
pub struct Report {
    /// Number of triangles of the scene at full resolution.
    pub triangles: usize,
    /// CPU times by image size.
    pub sizes: BTreeMap<String, Cost>,
    /// CPU time of depth and ids without colour, for the static camera at the first size, ms.
    pub geometry_ms: f64,
    /// Frames of the episode per second of CPU time at the first size, each rendered by both cameras.
    pub episode_frames_per_s: f64,
    /// Share of the static camera's pixels reused from the previous frame, at the first size.
    pub reuse_share: f64,
    /// True if every image of the first size has the bytes of one rendered from scratch.
    pub identical_with_reuse: bool,
    /// Comparison with other renderers on a more crowded table; `None` unless requested.
    pub vs: Option<Baselines>,
    /// Difference from path-traced images; `None` unless requested.
    pub flip: Option<Flip>,
}

/// CPU time per image of one size, ms.
#[derive(Debug, Serialize)]
pub struct Cost {
    /// Static camera, reusing the cache of its previous frame. It is rendered first, so its time includes the shadow
    /// map.
    pub ms_static: f64,
    /// Wrist camera, rendered second with the same shadow map.
    pub ms_wrist: f64,
    /// First image of the static camera, without a cached frame.
    pub ms_first_frame: f64,
}

/// Renders the episode at all sizes, and measures the cost.
///
/// # Errors
/// If the catalogue has too few textured objects, or rendering fails.
pub fn measure(seed: Seed, progress: &dyn Progress) -> Result<Report, LabError> {
    let robot = panda();
    let objects = objects(seed.fork("objects"), true, OBJECTS)?;
    let assets = RenderAssets::new(Arc::clone(&robot), &objects, Some(&default_world())).map_err(render_failed)?;
    let frames = episode(&robot, &assets, OBJECTS, GRID, seed.fork("episode"))?;
    let cameras = ["static", "wrist"].map(|name| default_world().camera(name).cloned());
    let [Some(fixed), Some(wrist)] = cameras else {
        return Err(LabError::input("the default world has no cameras `static` and `wrist`"));
    };
    let mut report = Report {
        triangles: assets.triangle_count(),
        sizes: BTreeMap::new(),
        geometry_ms: 0.0,
        episode_frames_per_s: 0.0,
        reuse_share: 0.0,
        identical_with_reuse: true,
        vs: None,
        flip: None,
    };
    progress.begin("drawing", SIZES.len());
    for (index, size) in SIZES.into_iter().enumerate() {
        let cameras = [&fixed, &wrist].map(|camera| sized(camera, size));
        let drawn = draw(&assets, &frames, &cameras, index == 0)?;
        if index == 0 {
            report.geometry_ms = geometry_ms(&assets, &frames, &cameras[0])?;
            report.episode_frames_per_s = frames.len() as f64 * 1e3 / drawn.total_ms;
            report.reuse_share = drawn.reuse_share;
            report.identical_with_reuse = drawn.is_identical;
        }
        report.sizes.insert(format!("{}x{}", size[0], size[1]), drawn.cost);
        progress.advance();
    }
    progress.end();
    Ok(report)
}

struct Drawn {
    cost: Cost,
    total_ms: f64,
    reuse_share: f64,
    is_identical: bool,
}

fn draw(
    assets: &Arc<RenderAssets>,
    frames: &[FrameState],
    cameras: &[Camera; 2],
    compare: bool,
) -> Result<Drawn, LabError> {
    let mut renderer = Renderer::new(Arc::clone(assets), RenderVariation::default());
    let mut judge = Renderer::new(Arc::clone(assets), RenderVariation::default());
    // Textures are prepared on first use, once per process, so the first image is not timed.
    let mut out = [FrameBuffers::default()];
    for camera in cameras {
        judge.render(&[ViewJob::new(&frames[0], camera, CHANNELS)], &mut out).map_err(render_failed)?;
    }
    let mut times_ms = [Vec::new(), Vec::new()];
    let mut shaded = 0;
    for frame in frames {
        for (index, camera) in cameras.iter().enumerate() {
            let job = ViewJob::new(frame, camera, CHANNELS);
            let mut clock = cpu_clock();
            renderer.render(&[job], &mut out).map_err(render_failed)?;
            times_ms[index].push(clock() * 1e3);
            if index == 0 && times_ms[0].len() > 1 {
                shaded += renderer.shaded_pixels();
            }
        }
    }
    // Compared in a run without timing, since a second renderer would evict the caches of the first.
    let is_identical = !compare || is_identical(&mut renderer, &mut judge, frames, cameras)?;
    let total_ms = times_ms.iter().flatten().sum();
    let first = times_ms[0].remove(0);
    let k = cameras[0].intrinsics;
    let pixels = (k.width * k.height) as usize * times_ms[0].len();
    let [ms_static, ms_wrist] = times_ms.map(median);
    Ok(Drawn {
        cost: Cost { ms_static, ms_wrist, ms_first_frame: first },
        total_ms,
        reuse_share: 1.0 - shaded as f64 / pixels.max(1) as f64,
        is_identical,
    })
}

/// True if the images of an episode have the same bytes as those that another renderer makes without reuse.
fn is_identical(
    renderer: &mut Renderer,
    judge: &mut Renderer,
    frames: &[FrameState],
    cameras: &[Camera; 2],
) -> Result<bool, LabError> {
    let (mut continued, mut anew) = ([FrameBuffers::default()], [FrameBuffers::default()]);
    renderer.forget();
    for frame in frames {
        for camera in cameras {
            let job = ViewJob::new(frame, camera, CHANNELS);
            renderer.render(&[job], &mut continued).map_err(render_failed)?;
            judge.forget();
            judge.render(&[job], &mut anew).map_err(render_failed)?;
            if anew[0] != continued[0] {
                return Ok(false);
            }
        }
    }
    Ok(true)
}

fn geometry_ms(assets: &Arc<RenderAssets>, frames: &[FrameState], camera: &Camera) -> Result<f64, LabError> {
    let mut renderer = Renderer::new(Arc::clone(assets), RenderVariation::default());
    let mut out = [FrameBuffers::default()];
    let mut times_ms = Vec::new();
    for frame in frames {
        let mut clock = cpu_clock();
        renderer.render(&[ViewJob::new(frame, camera, Channels::GEOMETRY)], &mut out).map_err(render_failed)?;
        times_ms.push(clock() * 1e3);
    }
    Ok(median(times_ms))
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(0.0)
}

fn sized(camera: &Camera, [width, height]: [u32; 2]) -> Camera {
    Camera { intrinsics: camera.intrinsics.filling(width, height), ..camera.clone() }
}

fn render_failed(error: genmanip_render::RenderError) -> LabError {
    LabError::broken("the table cannot be rendered", error)
}

/// Grid of object positions on the table, row by row away from the robot, with random jitter.
#[derive(Clone, Copy)]
struct Grid {
    /// Number of objects per row, placed from right to left.
    columns: usize,
    from_m: [f64; 2],
    step_m: [f64; 2],
    jitter_m: [f64; 2],
}

const GRID: Grid = Grid { columns: 4, from_m: [0.32, -0.3], step_m: [0.14, 0.2], jitter_m: [0.01, 0.02] };

/// Random objects of the catalogue that fit the grid, only textured ones if `is_textured`.
fn objects(seed: Seed, is_textured: bool, count: usize) -> Result<Vec<Arc<ObjectModel>>, LabError> {
    let catalogue = Catalogue::builtin();
    let mut rng = seed.rng();
    let fits = |size: DVec3| size.x.max(size.y) <= MAX_SIDE_M;
    let mut uids: Vec<&AssetUid> = catalogue
        .cards()
        .iter()
        .filter(|card| !card.is_articulated && fits(card.size_m))
        .map(|card| &card.uid)
        .collect();
    let mut objects = Vec::new();
    while objects.len() < count && !uids.is_empty() {
        let uid = uids.swap_remove(rng.random_range(0..uids.len()));
        let object =
            catalogue.build(uid).map_err(|error| LabError::broken(format!("object {uid} cannot be made"), error))?;
        let mut visuals = object.links.iter().flat_map(|link| &link.visual);
        if !is_textured || visuals.any(|visual| visual.material.texture.is_some()) {
            objects.push(object);
        }
    }
    if objects.len() < count {
        return Err(LabError::input(format!("{} objects that fit, expected {count}", objects.len())));
    }
    Ok(objects)
}

/// Frames of a motion that picks an object, carries it over the grid and places it.
fn episode(
    robot: &Arc<RobotModel>,
    assets: &RenderAssets,
    objects: usize,
    grid: Grid,
    seed: Seed,
) -> Result<Vec<FrameState>, LabError> {
    let mut rng = seed.rng();
    let mut jitter = |size: f64| (rng.random_range(0..=1000_u32) as f64 / 500.0 - 1.0) * size;
    let mut poses: Vec<Pose> = (0..objects)
        .map(|index| {
            let (row, column) = ((index / grid.columns) as f64, (index % grid.columns) as f64);
            let [x, y] = [grid.from_m[0] + grid.step_m[0] * row, grid.from_m[1] + grid.step_m[1] * column];
            let at = DVec3::new(x + jitter(grid.jitter_m[0]), y + jitter(grid.jitter_m[1]), 0.0);
            Pose::from_position_yaw(at, jitter(3.0))
        })
        .collect();
    let carried = 5 + usize::from(jitter(1.0) > 0.0);
    let (from, to) = (poses[carried].position, DVec3::new(0.45 + jitter(0.05), 0.4 * jitter(1.0).signum(), 0.0));
    let tcp = |at: DVec3, z: f64| Pose::new(at.with_z(z), DQuat::from_rotation_x(std::f64::consts::PI));
    // Waypoints, with the gripper width (m) reached there, and true if the object is carried on the way there.
    let (open, shut) = (robot.gripper.max_width, 0.03);
    let path = [
        (Some(tcp(from, 0.25)), open, false),
        (Some(tcp(from, 0.06)), open, false),
        (Some(tcp(from, 0.06)), shut, false),
        (Some(tcp(from, 0.28)), shut, true),
        (Some(tcp(to, 0.28)), shut, true),
        (Some(tcp(to, 0.06)), shut, true),
        (Some(tcp(to, 0.06)), open, false),
        (None, open, false),
    ];
    let chain = Chain::new(robot).map_err(|error| LabError::broken("the robot has no arm", error))?;
    let ik = InverseKinematics::new(chain.clone(), IkSettings::default());
    let mut frames = Vec::new();
    let (mut arm, mut width) = (robot.home.clone(), open);
    for (goal, goal_width, is_carried) in path {
        let solutions = goal.map_or_else(|| vec![robot.home.clone()], |goal| ik.solve(&goal, &arm));
        let Some(next) = solutions.into_iter().next() else {
            return Err(LabError::input("a waypoint of the episode is out of reach; try another seed"));
        };
        let rests = next.iter().zip(&arm).all(|(a, b)| (a - b).abs() < 1e-6);
        let count = if rests { PAUSE } else { MOVE };
        let (start, start_width) = (arm.clone(), width);
        let start_tcp = chain.tcp_pose(&start);
        let held = start_tcp.inverse() * poses[carried];
        for step in 1..=count {
            let t = step as f64 / count as f64;
            let t = t * t * (3.0 - 2.0 * t);
            arm = start.iter().zip(&next).map(|(a, b)| a + (b - a) * t).collect();
            width = start_width + (goal_width - start_width) * t;
            if is_carried {
                poses[carried] = chain.tcp_pose(&arm) * held;
            }
            let tremble = 1e-9 * (frames.len() as f64).sin();
            let placed = poses
                .iter()
                .map(|pose| (Pose { position: pose.position + DVec3::splat(tremble), ..*pose }, [].as_slice()));
            frames.push(assets.frame_state(&arm, width, placed).map_err(render_failed)?);
        }
    }
    Ok(frames)
}

/// Text summary.
pub fn describe(report: &Report) -> String {
    let mut rows = vec![["pixels", "static, ms", "wrist, ms", "first, ms"].map(String::from).to_vec()];
    for (size, cost) in &report.sizes {
        let numbers = [cost.ms_static, cost.ms_wrist, cost.ms_first_frame].map(|ms| format!("{ms:.2}"));
        rows.push(std::iter::once(size.clone()).chain(numbers).collect());
    }
    let flip = report.flip.as_ref().map_or_else(String::new, |flip| {
        let scenes = flip.scenes.len();
        format!("FLIP to traced pictures: mean {:.3} over {scenes} scenes, {} paths per pixel\n", flip.mean, flip.paths)
    });
    format!(
        "{}\n{} triangles; depth and ids alone {:.2} ms; {:.0} moments a second, both cameras\n\
         {:.0} % of the static camera's pixels are kept from frame to frame, {}\n{flip}",
        text_table(&rows).trim_end(),
        report.triangles,
        report.geometry_ms,
        report.episode_frames_per_s,
        100.0 * report.reuse_share,
        if report.identical_with_reuse { "with the same bytes" } else { "but the bytes differ" },
    ) + &report.vs.as_ref().map_or_else(String::new, baselines::describe)
}
