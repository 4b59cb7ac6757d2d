//! Synthetic episodes in which all numbers differ, and images computed by a formula.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use genmanip_core::glam::{DMat3, DQuat, DVec3};
use genmanip_core::{
    AssetRef, Camera, CameraMount, Correction, Document, Ending, Episode, EpisodeResult, Failure, FailureCause, Frame,
    Goal, GoalVerdict, Gripper, Intrinsics, JointKind, MassProperties, ObjectState, PhysicsFactors, PlacedObject, Pose,
    RgbdImage, RobotJoint, RobotLink, RobotModel, Scenario, SceneGraph, Seed, Task, TaskKind, World,
};
use genmanip_data::{EpisodeStore, TrackRecorder, VideoSettings};

pub const WIDTH: u32 = 96;
pub const HEIGHT: u32 = 64;

/// A seven-joint arm, straight up, 10 cm per link.
pub fn robot() -> RobotModel {
    let link = |index: usize| RobotLink {
        name: format!("link{index}"),
        parent: index.checked_sub(1),
        parent_from_link: Pose::from_position(DVec3::new(0.0, 0.0, 0.1)),
        joint: (index > 0).then(|| RobotJoint {
            name: format!("joint{index}"),
            kind: JointKind::Revolute,
            axis: if index.is_multiple_of(2) { DVec3::Y } else { DVec3::Z },
            lower: -3.0,
            upper: 3.0,
            max_velocity: 2.0,
            max_acceleration: 10.0,
            max_jerk: 100.0,
            max_effort: 87.0,
            continuous: false,
            mimic: None,
        }),
        visual: Vec::new(),
        pieces: Vec::new(),
        mass: MassProperties { mass_kg: 1.0, center: DVec3::ZERO, inertia: DMat3::IDENTITY },
    };
    RobotModel {
        name: "panda".into(),
        links: (0..8).map(link).collect(),
        hand: 7,
        hand_from_tcp: Pose::from_position(DVec3::new(0.0, 0.0, 0.1034)),
        gripper: Gripper { fingers: [98, 99], max_width: 0.08, max_force: 70.0, pad_size: DVec3::splat(0.02) },
        home: vec![0.0; 7],
        drives: None,
        reach: None,
        hand_from_wrist_camera: None,
        never_colliding: Vec::new(),
    }
}

pub fn cameras() -> Vec<Camera> {
    let intrinsics = Intrinsics::from_vertical_fov(WIDTH, HEIGHT, 0.8);
    let fixed = Camera::looking_at("static", DVec3::new(1.3, 0.4, 0.7), DVec3::new(0.5, 0.0, 0.1), intrinsics);
    let mount_from_camera = Pose::from_position(DVec3::new(0.07, 0.0, 0.02));
    vec![fixed, Camera::new("wrist", CameraMount::Hand, mount_from_camera, intrinsics)]
}

/// Numbers in -1..1 without round values.
fn wiggle(seed: usize, index: usize) -> f64 {
    ((seed * 131 + index) as f64 * 0.7310585).sin()
}

pub fn scenario(number: usize) -> Scenario {
    let placed = |uid: &str, x: f64| PlacedObject {
        id: uid.parse().unwrap(),
        asset: AssetRef::builtin(uid, number as u32),
        physics_hash: format!("v2:{}", "0".repeat(16)),
        judging_hash: None,
        looks_hash: None,
        pose: Pose::from_position_yaw(DVec3::new(x, 0.1, 0.0), 0.3),
        joint_positions: Vec::new(),
        physics: PhysicsFactors::default(),
    };
    Scenario {
        id: format!("scenario-{number}"),
        task: Task {
            id: format!("task-{}", number % 2),
            kind: TaskKind::PickAndPlace,
            instruction: ["Put the red mug near the bowl.", "Move the bowl to the left."][number % 2].into(),
            goal: Goal::default(),
            scene_graph: SceneGraph::default(),
            objects: Vec::new(),
            surfaces: Vec::new(),
            interchangeable: Vec::new(),
            source: "made up".into(),
        },
        seed: Seed::new(7),
        // The number of objects differs between episodes.
        objects: (0..=number % 2).map(|object| placed(&format!("uid-{object}"), 0.4 + 0.1 * object as f64)).collect(),
        world: World {
            cameras: cameras(),
            ..World::from_json(include_str!("../../../core/testdata/world.json")).unwrap()
        },
        other_request: None,
        genmanip_version: "0.1.0".into(),
    }
}

pub fn frame(number: usize, step: usize, objects: usize) -> Frame {
    let at = |index: usize| wiggle(number * 1000 + step, index);
    let pose = |offset: usize| Pose {
        position: DVec3::new(at(offset), at(offset + 1), at(offset + 2)),
        rotation: DQuat::from_euler(genmanip_core::glam::EulerRot::XYZ, at(offset + 3), at(offset + 4), at(offset + 5)),
    };
    Frame {
        time_s: step as f64 / 60.0,
        command: (0..8).map(|joint| at(joint) as f32).collect(),
        joint_position: (0..7).map(|joint| at(joint + 10)).collect(),
        joint_velocity: (0..7).map(|joint| at(joint + 20)).collect(),
        joint_torque: (0..7).map(|joint| at(joint + 30).abs() * 80.0).collect(),
        gripper_width: 0.04 + 0.04 * at(40),
        grip_force: at(41).abs() * 70.0,
        tcp: pose(50),
        objects: (0..objects)
            .map(|object| ObjectState {
                pose: pose(60 + 10 * object),
                joint_positions: vec![at(90); object],
                speed: if step == 0 { -0.0 } else { at(91).abs() },
                angular_speed: 1e-310 * at(92).abs(),
            })
            .collect(),
        // Each object in turn for ten steps, and none for ten.
        grasped: (step / 10).is_multiple_of(2).then_some((step / 20) % objects.max(1)),
        stray_contact_n: at(42).abs(),
    }
}

/// First control step of the correction in the second episode.
pub const CORRECTED_FROM: usize = 10;

pub fn result(number: usize, frames: usize, success: bool) -> EpisodeResult {
    EpisodeResult {
        id: format!("scenario-{number}-a0"),
        scenario_id: format!("scenario-{number}"),
        task_id: format!("task-{}", number % 2),
        policy: "expert".into(),
        oracle: true,
        seed: Seed::new(1).fork_index(number as u64),
        success,
        success_once: success,
        verdict: GoalVerdict { score: f64::from(u8::from(success)), success, alternatives: Vec::new() },
        ending: Some(Ending::Finished),
        failures: Vec::new(),
        agent_failure: None,
        source: None,
        duration_s: frames as f64 / 60.0,
        horizon_s: 60.0,
        control_rate_hz: 60.0,
        frames,
        unreachable_actions: 0,
        tcp_path_m: wiggle(number, 1).abs(),
        max_stray_contact_n: 0.1,
        stray_contact: None,
        world_hashes: None,
        cloud: None,
        other_request_success: None,
        // The second episode was taken over in the middle of its third row.
        expert: genmanip_core::ExpertStyle::Default,
        correction: (number == 1).then(|| Correction {
            policy: "clumsy".into(),
            from_step: CORRECTED_FROM,
            failures: vec![Failure { cause: FailureCause::Slipped, evidence: "it fell".into() }],
        }),
        engine: "mujoco 3.17.0".into(),
        genmanip_version: "0.1.0".into(),
    }
}

pub fn episode(number: usize, frames: usize, success: bool) -> Episode {
    let scenario = scenario(number);
    let objects = scenario.objects.len();
    Episode {
        result: result(number, frames, success),
        frames: (0..frames).map(|step| frame(number, step, objects)).collect(),
        initial_state: (0..29).map(|index| wiggle(number, index)).collect(),
        final_state: (0..29).map(|index| wiggle(number, index + 50)).collect(),
        scenario,
    }
}

/// A shaded background with a bright square whose position depends on the frame.
pub fn image(number: usize, camera: usize, row: usize) -> (Vec<u8>, Vec<f32>) {
    let (width, height) = (WIDTH as usize, HEIGHT as usize);
    let mut rgb = Vec::with_capacity(width * height * 3);
    let mut depth_m = Vec::with_capacity(width * height);
    let (left, top) = ((row * 7 + number * 13) % (width - 16), (row * 5 + camera * 17) % (height - 16));
    for y in 0..height {
        for x in 0..width {
            let inside = (left..left + 16).contains(&x) && (top..top + 16).contains(&y);
            let shade = |from: usize, to: usize, t: usize, n: usize| (from + (to - from) * t / n) as u8;
            let pixel = if inside {
                [230, 60 + 40 * camera as u8, 40]
            } else {
                [shade(60, 200, x, width), shade(80, 220, y, height), shade(90, 160, x + y, width + height)]
            };
            rgb.extend(pixel);
            depth_m.push(if x == 0 { 0.0 } else { 0.5 + 0.001 * (x + 3 * y + row) as f32 });
        }
    }
    (rgb, depth_m)
}

/// Renders the images of an episode at a rate and attaches them.
pub fn attach_images(store: &EpisodeStore, number: usize, frames: usize, fps: u32) {
    let tracks: Vec<_> = cameras()
        .iter()
        .enumerate()
        .map(|(index, camera)| {
            let mut recorder = TrackRecorder::new(camera, fps, &VideoSettings::default()).unwrap();
            for row in 0..frames.div_ceil(60 / fps as usize) {
                let (rgb, depth_m) = image(number, index, row);
                let hand = Pose::from_position(DVec3::new(0.4, 0.01 * row as f64, 0.5));
                let place = camera.world_from_camera(&hand);
                let image = RgbdImage { rgb, ..RgbdImage::of_depth(camera.intrinsics, place, depth_m) };
                recorder.push(&image).unwrap();
            }
            recorder.finish().unwrap()
        })
        .collect();
    store.attach_tracks(&result(number, frames, true).id, &tracks).unwrap();
}

/// Contents of all files below a folder.
pub fn tree(root: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut files = BTreeMap::new();
    let mut folders = vec![root.to_owned()];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else {
                files.insert(path.strip_prefix(root).unwrap().to_owned(), fs::read(&path).unwrap());
            }
        }
    }
    files
}
