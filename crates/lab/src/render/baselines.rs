//! Comparison with other renderers: the same triangles, camera and light on one crowded table, objects at full
//! resolution.
//!
//! `docs/benchmark/against_renderers.py` runs MuJoCo's renderer and PyBullet's TinyRenderer in a Python environment
//! that has them, and documents the differences.

use genmanip_workspace::documents;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Arc;

use genmanip_assets::panda;
use genmanip_assets::worlds::default_world;
use genmanip_core::{Camera, Pose, Seed};
use genmanip_render::{FrameBuffers, FrameState, RenderAssets, RenderVariation, Renderer, ViewJob};
use genmanip_workspace::Progress;
use serde::{Deserialize, Serialize};
use serde_json::json;

use super::{CHANNELS, Grid, OBJECTS, draw, episode, objects, render_failed, sized};
use crate::LabError;

/// Minimum number of triangles of the scene.
const TRIANGLES: usize = 150_000;
/// Width and height of the compared images, px.
const SIZES: [[u32; 2]; 2] = [[512, 288], [1280, 720]];
/// Grid of object positions; the distinct objects repeat, and the first positions are used until the scene has
/// [`TRIANGLES`].
const GRID: Grid = Grid { columns: 10, from_m: [0.25, -0.585], step_m: [0.13, 0.13], jitter_m: [0.005, 0.005] };
const ROWS: usize = 6;
const PROGRAM: &str = include_str!("../../../../docs/benchmark/against_renderers.py");

/// CPU time of this renderer and of other engines on the same scene.
#[derive(Debug, Serialize)]
pub struct Baselines {
    /// Number of triangles of the scene.
    pub triangles: usize,
    /// Number of objects on the table.
    pub objects: usize,
    /// Comparisons by image size.
    pub sizes: BTreeMap<String, Comparison>,
}

/// CPU times per image of one size: colour, depth and ids of the static camera.
#[derive(Debug, Serialize)]
pub struct Comparison {
    /// This renderer, ms: median over the frames of an episode, each reusing the cache of the previous one.
    pub ms_static: f64,
    /// This renderer without a cached frame, ms.
    pub ms_first_frame: f64,
    /// MuJoCo's renderer, in one pass each for colour, depth and ids; `None` if it is not installed.
    pub mujoco: Option<Engine>,
    /// PyBullet's TinyRenderer, in one pass without anti-aliasing; `None` if it is not installed.
    pub pybullet: Option<Engine>,
    /// MuJoCo's CPU time divided by that of this renderer.
    pub times_mujoco: Option<f64>,
    /// PyBullet's CPU time divided by that of this renderer.
    pub times_pybullet: Option<f64>,
}

/// CPU time per image of another engine, ms, and differences of its depth and ids from those of this renderer.
#[derive(Debug, Serialize, Deserialize)]
pub struct Engine {
    /// Version of the Python package.
    pub version: String,
    /// OpenGL back end; empty for a renderer without OpenGL.
    pub gl_backend: String,
    /// OpenGL's `renderer` and `version` strings.
    #[serde(default)]
    pub gl: BTreeMap<String, String>,
    /// All channels together.
    pub ms: f64,
    /// Colour pass; `None` if one pass renders all channels.
    pub rgb_ms: Option<f64>,
    /// Depth pass; `None` if one pass renders all channels.
    pub depth_ms: Option<f64>,
    /// Ids pass; `None` if one pass renders all channels.
    pub ids_ms: Option<f64>,
    /// Difference of depth and ids from those of this renderer.
    pub difference: Difference,
}

/// Difference of depth and ids of two renderers.
#[derive(Debug, Serialize, Deserialize)]
pub struct Difference {
    /// Share of pixels with different ids, 0 to 1.
    pub ids_differ_share: f64,
    /// Median absolute depth difference over pixels with equal ids, mm.
    pub depth_median_mm: f64,
    /// 99.9th percentile over the same pixels, mm.
    pub depth_p99_9_mm: f64,
}

/// JSON output of the script.
#[derive(Deserialize)]
struct Answer {
    problems: Vec<String>,
    mujoco: Option<Engine>,
    pybullet: Option<Engine>,
}

/// Renders a scene of at least 150,000 triangles with this renderer and with the engines of a Python interpreter;
/// `None`, after a note with the reason, if the interpreter has none of them.
///
/// # Errors
/// If the scene cannot be rendered or written, or the script's output is invalid.
pub fn measure(python: &Path, seed: Seed, progress: &dyn Progress) -> Result<Option<Baselines>, LabError> {
    let missing = |why: String| {
        let hint = "--python names an interpreter with mujoco, pybullet and numpy";
        progress.note(&format!("other renderers are not measured: {why}; {hint}"));
    };
    if let Err(error) = Command::new(python).args(["-c", "import numpy"]).output() {
        missing(format!("{} cannot be started: {error}", python.display()));
        return Ok(None);
    }
    let (robot, world, seed) = (panda(), default_world(), seed.fork("crowd"));
    let kinds: Vec<_> =
        objects(seed.fork("objects"), false, OBJECTS)?.iter().map(|kind| Arc::new(kind.with_full_meshes())).collect();
    let mut crowd: Vec<_> = kinds.into_iter().cycle().take(GRID.columns * ROWS).collect();
    let count =
        |crowd: &[_]| RenderAssets::new(Arc::clone(&robot), crowd, Some(&world)).map(|assets| assets.triangle_count());
    while crowd.len() > 1 && count(&crowd[..crowd.len() - 1]).map_err(render_failed)? >= TRIANGLES {
        crowd.pop();
    }
    let assets = RenderAssets::new(Arc::clone(&robot), &crowd, Some(&world)).map_err(render_failed)?;
    let triangles = assets.triangle_count();
    if triangles < TRIANGLES {
        return Err(LabError::input(format!("the crowded table has {triangles} triangles, expected {TRIANGLES}")));
    }
    let frames = episode(&robot, &assets, crowd.len(), GRID, seed.fork("episode"))?;
    let Some(camera) = world.camera("static") else {
        return Err(LabError::input("the default world has no camera `static`"));
    };
    let mut baselines = Baselines { triangles, objects: crowd.len(), sizes: BTreeMap::new() };
    progress.begin("timing other renderers", SIZES.len());
    for size in SIZES {
        let camera = sized(camera, size);
        let folder = Scratch::new()?;
        write_scene(&assets, &frames[frames.len() / 2], &camera, &folder.0)?;
        let answer = ask(python, &folder.0)?;
        for problem in &answer.problems {
            missing(problem.clone());
        }
        if answer.mujoco.is_none() && answer.pybullet.is_none() {
            progress.end();
            return Ok(None);
        }
        let own = draw(&assets, &frames, &[camera.clone(), camera], false)?.cost;
        let times = |engine: &Option<Engine>| engine.as_ref().map(|engine| engine.ms / own.ms_static);
        let comparison = Comparison {
            ms_static: own.ms_static,
            ms_first_frame: own.ms_first_frame,
            times_mujoco: times(&answer.mujoco),
            times_pybullet: times(&answer.pybullet),
            mujoco: answer.mujoco,
            pybullet: answer.pybullet,
        };
        baselines.sizes.insert(format!("{}x{}", size[0], size[1]), comparison);
        progress.advance();
    }
    progress.end();
    Ok(Some(baselines))
}

/// Scratch folder, removed on drop.
struct Scratch(PathBuf);

impl Scratch {
    fn new() -> Result<Self, LabError> {
        let folder = std::env::temp_dir().join(format!("genmanip-renderers-{}", std::process::id()));
        std::fs::create_dir_all(&folder).map_err(|error| LabError::file("create", &folder, error))?;
        Ok(Self(folder))
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        // A folder that cannot be removed does no harm.
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

/// Writes meshes posed in the world frame, camera, light, and depth and ids of this renderer.
fn write_scene(assets: &Arc<RenderAssets>, frame: &FrameState, camera: &Camera, folder: &Path) -> Result<(), LabError> {
    let variation = RenderVariation::default();
    let mut out = [FrameBuffers::default()];
    let job = ViewJob::new(frame, camera, CHANNELS);
    Renderer::new(Arc::clone(assets), variation.clone()).render(&[job], &mut out).map_err(render_failed)?;
    let [FrameBuffers { depth_m, instance, .. }] = out;
    let bytes = |values: &[f32]| values.iter().flat_map(|value| value.to_le_bytes()).collect::<Vec<u8>>();
    let write = |name: &str, bytes: Vec<u8>| documents::write_file(&folder.join(name), &bytes);
    write("depth.f32", bytes(&depth_m))?;
    write("ids.u16", instance.iter().flat_map(|id| id.to_le_bytes()).collect())?;
    let mut meshes = Vec::new();
    for (index, part) in assets.parts().iter().enumerate() {
        let world_from_body = part.body.map_or(Pose::IDENTITY, |body| frame.body_poses[body]);
        let place = |position| world_from_body.transform_point(position).as_vec3().to_array();
        let corners: Vec<f32> = part.mesh.positions.iter().flat_map(|position| place(position.as_dvec3())).collect();
        let indices = part.mesh.triangles.iter().flatten().flat_map(|index| index.to_le_bytes()).collect();
        write(&format!("{index}.f32"), bytes(&corners))?;
        write(&format!("{index}.u32"), indices)?;
        meshes.push(
            json!({ "file": index.to_string(), "instance": part.instance, "color": part.material.base.to_array() }),
        );
    }
    let (pose, k) = (camera.mount_from_camera, camera.intrinsics);
    let axes = genmanip_core::glam::DMat3::from_quat(pose.rotation).transpose();
    let rows = [axes.x_axis, axes.y_axis, axes.z_axis].map(|row| row.to_array());
    let to_light = genmanip_core::glam::Vec3::from_array(variation.light_direction).normalize();
    let scene = json!({
        "camera": {
            "width": k.width, "height": k.height, "fx": k.fx, "fy": k.fy, "cx": k.cx, "cy": k.cy,
            "position": pose.position.to_array(), "rotation": rows,
        },
        "center": variation.shadow_center, "radius": variation.shadow_radius_m, "to_light": to_light.to_array(),
        "meshes": meshes,
    });
    write("scene.json", scene.to_string().into_bytes())
}

fn ask(python: &Path, folder: &Path) -> Result<Answer, LabError> {
    let started = Command::new(python).args(["-c", PROGRAM]).arg(folder).output();
    let output = started.map_err(|error| LabError::broken("the script for other renderers cannot be run", error))?;
    let text = String::from_utf8_lossy(&output.stdout);
    let line = text.lines().last().unwrap_or_default();
    serde_json::from_str(line).map_err(|error| {
        let talk = String::from_utf8_lossy(&output.stderr);
        let said = talk.lines().last().unwrap_or("nothing").to_owned();
        LabError::broken(format!("the script for other renderers ended with `{said}`"), error)
    })
}

/// Text summary.
pub fn describe(baselines: &Baselines) -> String {
    let mut text = format!("{} triangles, {} objects, static camera:\n", baselines.triangles, baselines.objects);
    for (size, comparison) in &baselines.sizes {
        text += &format!("  {size}: {:.1} ms, first {:.1} ms\n", comparison.ms_static, comparison.ms_first_frame);
        for (name, engine) in [("MuJoCo", &comparison.mujoco), ("PyBullet", &comparison.pybullet)] {
            let Some(engine) = engine else { continue };
            text += &format!(
                "    {name} {} ({}): {:.1} ms, {:.1} times; ids differ in {:.4} % of pixels, depth by {:.3} mm (p99.9)\n",
                engine.version,
                engine.gl.get("renderer").unwrap_or(&engine.gl_backend),
                engine.ms,
                engine.ms / comparison.ms_static,
                100.0 * engine.difference.ids_differ_share,
                engine.difference.depth_p99_9_mm,
            );
        }
    }
    text
}
