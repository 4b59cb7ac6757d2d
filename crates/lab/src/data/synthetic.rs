//! Large synthetic dataset: cost of checking and opening it.

use genmanip_workspace::worlds;
use std::fs;
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use genmanip_assets::worlds::default_world;
use genmanip_core::{
    Camera, CameraMount, Ending, Episode, EpisodeResult, Frame, GoalVerdict, Intrinsics, ObjectState, Pose, RgbdImage,
    RobotModel, Scenario, Seed, Task,
};
use genmanip_data::lerobot::{self, LerobotDataset, LerobotSettings};
use genmanip_data::{CameraTrack, DataError, ExportSettings, TrackRecorder, VideoSettings};
use genmanip_dataset_tools::check;
use genmanip_rollout::collect::{PipelineSettings, Resources};
use genmanip_workspace::Progress;

use super::{CpuSeconds, Measured, broke, bytes_below};
use crate::LabError;
use crate::clock::process_clock;
use crate::episodes::laid_out;

/// Number of rows per episode, and side length of its square images, px.
const ROWS: usize = 30;
const SIDE_PX: u32 = 64;
/// Number of distinct scenarios and image sets; the episodes use them in turn.
const SCENARIOS: usize = 8;
/// Rows per second; one control step per row.
const RATE_HZ: u32 = 15;

/// Writes a dataset of `count` synthetic episodes into `folder`, which must not exist yet, opens and checks it. With
/// `shards`, the episodes are also written as that many datasets, which are merged.
///
/// # Errors
/// If no task can be laid out, a file cannot be written, or the check reports findings.
pub fn measure(
    (count, shards): (usize, Option<usize>),
    tasks: &[Task],
    seed: Seed,
    folder: &Path,
    progress: &dyn Progress,
) -> Result<Measured, LabError> {
    fs::create_dir(folder)
        .map_err(|error| LabError::broken(format!("cannot make the folder {}", folder.display()), error))?;
    let settings = PipelineSettings::in_world((*default_world()).clone());
    let planner = worlds::planner(&settings.world, &settings.planner)?;
    let robot = planner.robot();
    let mut scenarios = Vec::new();
    for task in tasks {
        if scenarios.len() < SCENARIOS
            && let Some((_, scenario)) = laid_out(task, Resources::builtin(&planner), &settings, seed.fork(&task.id))?
        {
            scenarios.push(scenario);
        }
    }
    if scenarios.is_empty() {
        return Err(LabError::input("no task could be laid out").with_hint("take another seed"));
    }
    let tracks = (0..SCENARIOS).map(tracks).collect::<Result<Vec<_>, _>>().map_err(broke)?;
    let dataset = folder.join("dataset");
    let lerobot = LerobotSettings {
        export: ExportSettings { fps: RATE_HZ, ..ExportSettings::default() },
        record: false,
        ..LerobotSettings::default()
    };
    progress.begin("writing", count);
    let mut clock = process_clock();
    let made = |number: usize| {
        progress.advance();
        let scenario = &scenarios[number % scenarios.len()];
        (episode(robot, scenario, number, seed), tracks[number % tracks.len()].clone())
    };
    let exported = lerobot::write(&mut (0..count).map(made), robot, &lerobot, &dataset).map_err(broke)?;
    progress.end();
    let write = clock();
    let clock = Instant::now();
    let opened = LerobotDataset::open(&dataset).map_err(broke)?.episodes().len();
    let open_s = clock.elapsed().as_secs_f64();
    let clock = Instant::now();
    let checked = check::check(&dataset, &[Arc::clone(robot)]).map_err(broke)?;
    let check_s = clock.elapsed().as_secs_f64();
    if let Some(finding) = checked.findings.first() {
        let what = format!("the written dataset is invalid: {finding:?}");
        return Err(LabError::input(what).with_hint("this is a defect of the program"));
    }
    let write_range = |numbers: std::ops::Range<usize>, target: &Path| {
        lerobot::write(&mut numbers.map(made), robot, &lerobot, target).map(drop).map_err(broke)
    };
    let merge_s = shards.map(|shards| merged(count, shards, &write_range, (folder, robot), progress)).transpose()?;
    let pictures = exported.frames * lerobot.export.cameras.len();
    let depth = lerobot::depth_path(&dataset);
    let bytes = bytes_below(&dataset.join("videos")) + bytes_below(&depth.join("data"));
    Ok(Measured {
        seed: seed.value(),
        episodes: opened,
        frames: exported.frames,
        cpu_s: CpuSeconds { write, ..CpuSeconds::default() },
        bytes_per_rgbd_frame: bytes as f64 / pictures as f64,
        encode_and_write_ms_per_rgbd_frame: 1e3 * write / pictures as f64,
        check_s: Some(check_s),
        open_s: Some(open_s),
        merge_s,
        dataset_bytes: bytes_below(&dataset) + bytes_below(&depth),
        ..Measured::default()
    })
}

/// Function that writes the episodes with these numbers as a dataset into a folder.
type Write<'a> = dyn Fn(std::ops::Range<usize>, &Path) -> Result<(), LabError> + 'a;

/// Writes the episodes as shards, merges and checks them; returns the wall time of merging, s.
fn merged(
    count: usize,
    shards: usize,
    write: &Write,
    (folder, robot): (&Path, &Arc<RobotModel>),
    progress: &dyn Progress,
) -> Result<f64, LabError> {
    let shards = shards.min(count);
    let range = |shard: usize| shard * count / shards..(shard + 1) * count / shards;
    let paths: Vec<_> = (0..shards).map(|shard| folder.join("shards").join(format!("{shard:05}"))).collect();
    progress.begin("writing shards", count);
    paths.iter().enumerate().try_for_each(|(shard, path)| write(range(shard), path))?;
    progress.end();
    progress.begin("merging", 2 * count);
    let (clock, target) = (Instant::now(), folder.join("merged"));
    genmanip_dataset_tools::edit::merge(&paths, &target, &mut |_| progress.advance()).map_err(broke)?;
    let seconds = clock.elapsed().as_secs_f64();
    progress.end();
    match check::check(&target, &[Arc::clone(robot)]).map_err(broke)?.findings.first() {
        None => Ok(seconds),
        Some(finding) => Err(LabError::input(format!("the merged dataset is invalid: {finding:?}"))
            .with_hint("this is a defect of the program")),
    }
}

/// Synthetic episode: the arm's joints oscillate about home, and the tool pose follows; nothing else moves.
fn episode(robot: &RobotModel, scenario: &Scenario, number: usize, seed: Seed) -> Episode {
    let scenario = Scenario { id: format!("{}-{number}", scenario.id), ..scenario.clone() };
    let swing = |joint: usize, row: usize| {
        0.3 * ((number * 7 + joint) as f64 * 0.7310585).sin() * (row as f64 * 0.1 + joint as f64).sin()
    };
    let home = &scenario.world.robot.home;
    let arm = |row: usize| home.iter().enumerate().map(|(joint, home)| home + swing(joint, row)).collect::<Vec<f64>>();
    let width = |row: usize| 0.04 + 0.03 * (row as f64 * 0.2 + number as f64).sin();
    let frames = (0..ROWS).map(|row| Frame {
        time_s: row as f64 / f64::from(RATE_HZ),
        command: arm(row + 1).iter().chain([&width(row + 1)]).map(|value| *value as f32).collect(),
        tcp: robot.tcp_pose(&arm(row)),
        joint_velocity: (0..home.len()).map(|joint| swing(joint, row)).collect(),
        joint_torque: (0..home.len()).map(|joint| 10.0 * swing(joint, row)).collect(),
        joint_position: arm(row),
        gripper_width: width(row),
        grip_force: swing(2, row).abs(),
        objects: scenario
            .objects
            .iter()
            .map(|object| ObjectState {
                pose: object.pose,
                joint_positions: object.joint_positions.clone(),
                speed: 0.0,
                angular_speed: 0.0,
            })
            .collect(),
        grasped: (row > 10 && row < 20).then_some(0),
        stray_contact_n: 0.0,
    });
    let result = EpisodeResult {
        id: format!("synthetic-{number:06}"),
        scenario_id: scenario.id.clone(),
        task_id: scenario.task.id.clone(),
        policy: "synthetic".into(),
        oracle: true,
        seed: seed.fork_index(number as u64),
        success: true,
        success_once: true,
        verdict: GoalVerdict { score: 1.0, success: true, alternatives: Vec::new() },
        ending: Some(Ending::Finished),
        failures: Vec::new(),
        duration_s: ROWS as f64 / f64::from(RATE_HZ),
        horizon_s: 60.0,
        control_rate_hz: f64::from(RATE_HZ),
        frames: ROWS,
        unreachable_actions: 0,
        tcp_path_m: 1.0,
        max_stray_contact_n: 0.0,
        stray_contact: None,
        world_hashes: None,
        cloud: None,
        other_request_success: None,
        correction: None,
        expert: genmanip_core::ExpertStyle::Default,
        agent_failure: None,
        source: None,
        engine: "none".into(),
        genmanip_version: env!("CARGO_PKG_VERSION").into(),
    };
    Episode { frames: frames.collect(), initial_state: Vec::new(), final_state: Vec::new(), result, scenario }
}

/// Synthetic images of every camera: a square that moves over a shaded background.
fn tracks(number: usize) -> Result<Vec<CameraTrack>, DataError> {
    let intrinsics = Intrinsics::from_vertical_fov(SIDE_PX, SIDE_PX, 0.8);
    ExportSettings::default()
        .cameras
        .iter()
        .enumerate()
        .map(|(which, name)| {
            let pose = Pose::default();
            let camera = Camera::new(name, CameraMount::World, pose, intrinsics);
            let mut recorder = TrackRecorder::new(&camera, RATE_HZ, &VideoSettings::default())?;
            for row in 0..ROWS {
                let (rgb, depth_m) = picture(number * 5 + which * 3, row);
                recorder.push(&RgbdImage { rgb, ..RgbdImage::of_depth(intrinsics, pose, depth_m) })?;
            }
            recorder.finish()
        })
        .collect()
}

fn picture(shade: usize, row: usize) -> (Vec<u8>, Vec<f32>) {
    let side = SIDE_PX as usize;
    let (left, top) = ((row * 3 + shade * 7) % (side - 16), (row * 2 + shade * 5) % (side - 16));
    let mut rgb = Vec::with_capacity(side * side * 3);
    let mut depth_m = Vec::with_capacity(side * side);
    for (y, x) in (0..side).flat_map(|y| (0..side).map(move |x| (y, x))) {
        let is_inside = (left..left + 16).contains(&x) && (top..top + 16).contains(&y);
        let ground = [60 + 2 * x + shade, 80 + 2 * y, 90 + x + shade].map(|value| value.min(255) as u8);
        rgb.extend(if is_inside { [230, 60, 40] } else { ground });
        depth_m.push(if is_inside { 0.5 } else { 0.8 + 0.001 * y as f32 });
    }
    (rgb, depth_m)
}
