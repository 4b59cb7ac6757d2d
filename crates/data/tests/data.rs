//! Integration tests: stores survive kills and corruption, exports are deterministic, and independent readers can read
//! them.

#![allow(clippy::unwrap_used)] // The exemption for tests does not reach helpers of an integration test.

mod mcap;
mod synthetic;

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use genmanip_core::glam::DVec3;
use genmanip_core::{
    ActionSpace, Document, EpisodeSource, Failure, FailureCause, InstanceId, PlacedObject, Pose, RotationEncoding,
};
use genmanip_data::export::ExtraColumns;
use genmanip_data::export::choice::{self, ACTIONS, ROTATIONS};
use genmanip_data::lerobot::{self, LerobotDataset};
use genmanip_data::{
    Attachment, DataError, EpisodeStore, ExportReport, ExportSettings, LerobotSettings, Provenance, Selection,
    genmanip_format, hdf5, zarr,
};
use serde_json::{Value, json};
use synthetic::{attach_images, episode, image, result, robot, scenario, tree};

/// Control steps of the three exported episodes; the last one is not a multiple of four.
const STEPS: [usize; 3] = [48, 60, 37];

/// Three successful episodes with images, a failed one, and an attempt without frames.
fn filled_store(root: &Path) -> EpisodeStore {
    let store = EpisodeStore::create(root).unwrap();
    for (number, steps) in STEPS.into_iter().enumerate() {
        store.write(&episode(number, steps, true), &[]).unwrap();
        attach_images(&store, number, steps, 15);
    }
    store.write(&episode(3, 20, false), &[]).unwrap();
    let mut failed = result(4, 0, false);
    failed.failures = vec![Failure { cause: FailureCause::NoGrasp, evidence: "0 of 64 candidates".into() }];
    store.write_result_only(&failed, Some(&scenario(4))).unwrap();
    store
}

fn export(store: &EpisodeStore, target: &Path, settings: &LerobotSettings) -> Result<ExportReport, DataError> {
    lerobot::export(store, &Selection::Verified, &robot(), settings, target)
}

#[test]
fn store_keeps_every_bit() {
    let folder = tempfile::tempdir().unwrap();
    let store = filled_store(&folder.path().join("store"));
    for (number, steps) in STEPS.into_iter().enumerate() {
        let written = episode(number, steps, true);
        let read = store.read(&written.result.id).unwrap();
        assert_eq!(read, written);
        let bits = |episode: &genmanip_core::Episode| -> Vec<u64> {
            let speeds = episode.frames.iter().flat_map(|frame| &frame.objects).map(|object| object.speed);
            let tcp = episode.frames.iter().flat_map(|frame| frame.tcp.rotation.to_array());
            episode.final_state.iter().copied().chain(speeds).chain(tcp).map(f64::to_bits).collect()
        };
        assert_eq!(bits(&read), bits(&written), "-0.0 and the last bits of quaternions included");
    }
    let ids = ["scenario-0-a0", "scenario-1-a0", "scenario-2-a0", "scenario-3-a0", "scenario-4-a0"];
    assert_eq!(store.ids().unwrap(), ids);
    assert!(!store.is_recorded("scenario-4-a0").unwrap());
    assert_eq!(store.read_scenario("scenario-4-a0").unwrap(), Some(scenario(4)));

    let again = filled_store(&folder.path().join("again"));
    assert_eq!(tree(store.root()), tree(again.root()), "equal episodes, equal bytes");
}

#[test]
fn episodes_are_selected_by_who_gave_their_commands() {
    let folder = tempfile::tempdir().unwrap();
    let store = EpisodeStore::create(folder.path().join("store")).unwrap();
    let made = [
        // The second synthetic episode holds a correction by the expert.
        ("expert", None, Provenance::Expert),
        ("expert", None, Provenance::Correction),
        ("learned_act", None, Provenance::Policy),
        ("teleop", Some(EpisodeSource::Teleop), Provenance::Teleop),
        ("teleop", Some(EpisodeSource::ScriptedTeleop), Provenance::ScriptedTeleop),
        ("expert", Some(EpisodeSource::Transfer), Provenance::Transfer),
        ("teleop", Some(EpisodeSource::Correction), Provenance::Correction),
    ];
    for (number, (policy, source, provenance)) in made.into_iter().enumerate() {
        let mut episode = episode(number, 9, number != 5);
        (episode.result.policy, episode.result.source) = (policy.into(), source);
        assert_eq!(Provenance::of(&episode.result), provenance, "{number}");
        store.write(&episode, &[]).unwrap();
    }
    for (sources, failed, expected) in [
        (&[][..], false, &[0, 1, 2, 3, 4, 6][..]),
        (&[], true, &[0, 1, 2, 3, 4, 5, 6]),
        (&[Provenance::Expert], true, &[0]),
        (&[Provenance::Transfer], false, &[]),
        (&[Provenance::Transfer, Provenance::Correction], true, &[1, 5, 6]),
        (&[Provenance::Teleop, Provenance::Policy], false, &[2, 3]),
    ] {
        let ids = Selection::of(sources, failed).ids(&store).unwrap();
        let expected: Vec<String> = expected.iter().map(|number| format!("scenario-{number}-a0")).collect();
        assert_eq!(ids, expected, "{sources:?}");
    }
}

#[test]
fn attachments_and_tracks_come_back() {
    let folder = tempfile::tempdir().unwrap();
    let store = EpisodeStore::create(folder.path().join("store")).unwrap();
    let notes = Attachment { name: "notes.txt".into(), bytes: b"hello".to_vec() };
    store.write(&episode(0, 9, true), &[notes]).unwrap();
    let id = "scenario-0-a0";
    assert_eq!(store.read_attachment(id, "notes.txt").unwrap(), b"hello");
    assert!(!store.has_tracks(id, 15, &["static".into()]));
    attach_images(&store, 0, 9, 15);
    attach_images(&store, 0, 9, 15); // replaces the first
    assert!(store.has_tracks(id, 15, &["static".into(), "wrist".into()]));
    let track = store.read_track(id, 15, "wrist").unwrap();
    assert_eq!((track.video.frames.len(), track.depth_png.len(), track.world_from_camera.len()), (3, 3, 3));
    let (width, height, depth_mm) = genmanip_data::depth::decode_depth_png(&track.depth_png[2]).unwrap();
    let (_, depth_m) = image(0, 1, 2);
    assert_eq!((width, height), (synthetic::WIDTH, synthetic::HEIGHT));
    let expected: Vec<u16> = depth_m.into_iter().map(genmanip_core::image::depth_to_mm).collect();
    assert_eq!(depth_mm, expected);
    assert!(store.sweep_partial().unwrap().is_empty());
}

#[test]
fn unfinished_files_are_never_read() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path().join("store");
    let store = filled_store(&root);
    let before = store.ids().unwrap();
    // Unfinished files of other hosts stay; older versions did not record the host.
    for other in [".other.partial-1", ".other.partial-00000000-00000000-1-1-1"] {
        fs::create_dir(root.join(other)).unwrap();
        assert_eq!(store.ids().unwrap(), before);
        assert_eq!(EpisodeStore::create(&root).unwrap().sweep_partial().unwrap(), Vec::<String>::new());
        assert!(root.join(other).exists());
    }
}

/// Malicious run folders: rejected within bounds, and nothing outside is read.
#[test]
fn a_hostile_store_is_rejected() {
    let folder = tempfile::tempdir().unwrap();
    let (root, id) = (folder.path().join("store"), "scenario-0-a0");
    let outside = folder.path().join("outside.txt");
    fs::write(&outside, b"private").unwrap();
    let record = |change: &dyn Fn(&mut serde_json::Value)| {
        let path = root.join(id).join("episode.json");
        let mut record: serde_json::Value = serde_json::from_slice(&fs::read(&path).unwrap()).unwrap();
        change(&mut record);
        fs::write(path, record.to_string()).unwrap();
    };
    let frames = || root.join(id).join("frames.parquet");
    let replaced = |by: &dyn Fn(&Path)| {
        fs::remove_file(frames()).unwrap();
        by(&frames());
    };
    type Attack<'a> = (&'a str, &'a dyn Fn(), &'a str);
    let attacks: [Attack; 9] = [
        (
            "a name that leads outside",
            &|| record(&|r| r["files"][0]["name"] = "../../outside.txt".into()),
            "files[0].name",
        ),
        ("an absolute name", &|| record(&|r| r["files"][0]["name"] = "/etc/passwd".into()), "files[0].name"),
        ("a file listed twice", &|| record(&|r| r["files"][1] = r["files"][0].clone()), "files[1].name"),
        ("more frames than the table has", &|| record(&|r| r["result"]["frames"] = 2_000_000.into()), "2000000 rows"),
        ("a larger size", &|| record(&|r| r["files"][1]["bytes"] = 1.into()), "expected 1 bytes"),
        ("a link", &|| replaced(&|at| std::os::unix::fs::symlink(&outside, at).unwrap()), "not a regular file"),
        (
            "an endless device",
            &|| replaced(&|at| std::os::unix::fs::symlink("/dev/zero", at).unwrap()),
            "not a regular file",
        ),
        (
            "a pipe",
            &|| replaced(&|at| assert!(Command::new("mkfifo").arg(at).status().unwrap().success())),
            "not a regular file",
        ),
        ("a truncated record", &|| fs::write(root.join(id).join("episode.json"), "{\"schema\": ").unwrap(), "not JSON"),
    ];
    for (what, attack, expected) in attacks {
        let _ = fs::remove_dir_all(&root);
        let store = filled_store(&root);
        attack();
        let error = store.read(id).unwrap_err();
        assert!(error.is_damage() && error.to_string().contains(expected), "{what}: {error}");
        // The other episodes are still usable.
        assert!(store.read("scenario-1-a0").is_ok());
        let target = folder.path().join("dataset");
        let report = export(&store, &target, &LerobotSettings::default()).unwrap();
        assert_eq!((report.episodes, report.left_out.len(), report.left_out[0].0.as_str()), (2, 1, id), "{what}");
        let copied = tree(&target);
        assert!(copied.values().all(|bytes| !bytes.windows(7).any(|part| part == b"private")), "{what}");
        fs::remove_dir_all(&target).unwrap();
        fs::remove_dir_all(folder.path().join("dataset-depth")).unwrap();
    }
    // A link to an episode's folder is not an episode.
    let store = EpisodeStore::open(&root).unwrap();
    std::os::unix::fs::symlink(root.join("scenario-1-a0"), root.join("linked")).unwrap();
    fs::create_dir(root.join("notes")).unwrap();
    assert_eq!(store.list().unwrap().foreign, ["linked", "notes"]);
    assert!(!store.contains("linked"));
}

#[test]
fn a_killed_writer_leaves_only_complete_episodes() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path().join("store");
    let mut writer = Command::new(std::env::current_exe().unwrap())
        .args(["--exact", "write_until_killed", "--ignored"])
        .env("GENMANIP_TEST_STORE", &root)
        .stdout(std::process::Stdio::null())
        .spawn()
        .unwrap();
    let is_there = |id: &str| root.join(id).is_dir();
    let in_time = (0..600).any(|_| {
        std::thread::sleep(std::time::Duration::from_millis(50));
        is_there("scenario-2-a0")
    });
    writer.kill().unwrap(); // SIGKILL
    writer.wait().unwrap();
    assert!(in_time, "the writer wrote nothing in 30 s");

    let store = EpisodeStore::create(&root).unwrap();
    store.sweep_partial().unwrap();
    let cameras = ["static".to_owned(), "wrist".to_owned()];
    let kept = store.ids().unwrap();
    kept.iter().for_each(|id| drop(store.sweep_attempt(id).unwrap()));
    for id in &kept {
        store.read(id).unwrap();
        if store.has_tracks(id, 15, &cameras) {
            store.read_track(id, 15, "wrist").unwrap();
        }
    }
    // Continuing gives the same store as an uninterrupted run.
    let whole = EpisodeStore::create(folder.path().join("whole")).unwrap();
    for (number, store) in (0..kept.len() + 1).flat_map(|number| [(number, &store), (number, &whole)]) {
        let id = format!("scenario-{number}-a0");
        if !store.contains(&id) {
            store.write(&episode(number, 40, true), &[]).unwrap();
        }
        if !store.has_tracks(&id, 15, &cameras) {
            attach_images(store, number, 40, 15);
        }
    }
    assert_eq!(tree(store.root()), tree(whole.root()));
}

#[test]
#[ignore = "the process that a_killed_writer_leaves_only_complete_episodes kills"]
fn write_until_killed() {
    let Some(root) = std::env::var_os("GENMANIP_TEST_STORE") else { return };
    let store = EpisodeStore::create(root).unwrap();
    for number in 0..10_000 {
        store.write(&episode(number, 40, true), &[]).unwrap();
        attach_images(&store, number, 40, 15);
    }
}

#[test]
fn errors_name_the_cause_and_change_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path().join("store");
    let store = filled_store(&root);
    let before = tree(&root);
    let check = |outcome: Result<(), DataError>, expected: &str| {
        let message = outcome.unwrap_err().to_string();
        assert!(message.contains(expected), "expected `{expected}` in `{message}`");
        assert_eq!(tree(&root), before, "{message}");
    };
    check(store.write(&episode(0, 5, true), &[]), "already exists");
    check(store.read("scenario-1-b0").map(drop), "near: scenario-1-a0");
    check(store.read("scenario-4-a0").map(drop), "only the result");
    check(store.read_track("scenario-3-a0", 15, "static").map(drop), "no images_15hz/static.json");
    check(store.attach("scenario-0-a0", "../x", &[]), "cannot be a file name");
    let mut other = episode(7, 5, true);
    other.result.id = "..".into();
    check(store.write(&other, &[]), "cannot be a file name");
    let mut other = episode(7, 5, true);
    other.frames[2].objects.clear();
    check(store.write(&other, &[]), "objects in frame 2: expected 2, got 0");
    let mut other = episode(7, 5, true);
    other.result.tcp_path_m = f64::NAN;
    check(store.write(&other, &[]), "cannot be stored without loss");
    let mut other = episode(7, 5, true);
    other.scenario.objects[0].pose.position.x = f64::NAN;
    check(store.write(&other, &[]), "cannot be stored without loss");
    check(EpisodeStore::open(folder.path()).map(drop), "not an episode store");
    check(EpisodeStore::create("/proc/nowhere").map(drop), "cannot create the folder");

    let target = folder.path().join("dataset");
    let settings = |change: fn(&mut LerobotSettings)| {
        let mut settings = LerobotSettings::default();
        change(&mut settings);
        settings
    };
    let all = |settings: &LerobotSettings| {
        lerobot::export(&store, &Selection::Recorded, &robot(), settings, &target).map(drop)
    };
    check(all(&LerobotSettings::default()), "no images_15hz/static.json");
    check(all(&settings(|settings| settings.export.fps = 25)), "a divisor of 60 Hz");
    check(all(&settings(|settings| settings.export.cameras = vec!["left".into()])), "no images_15hz/left.json");
    assert!(!target.exists() && fs::read_dir(folder.path()).unwrap().count() == 1, "no temporary files");

    let frames = root.join("scenario-2-a0/frames.parquet");
    let mut bytes = fs::read(&frames).unwrap();
    bytes[100] ^= 1;
    fs::write(&frames, bytes).unwrap();
    let error = store.read("scenario-2-a0").unwrap_err();
    assert!(matches!(error, DataError::Damaged { .. }) && error.hint().unwrap().contains("scenario-2-a0"), "{error}");
    assert!(error.hint().unwrap().contains("--repair"));
}

#[test]
fn exports_are_deterministic_and_replace_only_the_runs_own() {
    let folder = tempfile::tempdir().unwrap();
    let store = filled_store(&folder.path().join("store"));
    let settings = LerobotSettings { episodes_per_file: 2, episodes_per_depth_file: 1, ..Default::default() };
    let report = export(&store, &folder.path().join("a"), &settings).unwrap();
    assert_eq!((report.episodes, report.frames), (3, 12 + 15 + 10));
    export(&store, &folder.path().join("b"), &settings).unwrap();
    let read = |name: &str| {
        let mut files = tree(&folder.path().join(name));
        files.remove(Path::new("README.md")); // holds the name
        files
    };
    assert_eq!(read("a"), read("b"));
    assert_eq!(read("a-depth"), read("b-depth"));

    let error = export(&store, &folder.path().join("a"), &settings).unwrap_err();
    assert!(matches!(error, DataError::Exists { .. }), "{error}");
    // Only a data set of the same run is replaced.
    let of_run = |run: &str| LerobotSettings { run: Some(run.into()), ..settings.clone() };
    for (name, run) in [("a", "mine"), ("store", "mine")] {
        let error = export(&store, &folder.path().join(name), &of_run(run)).unwrap_err();
        assert!(matches!(error, DataError::NotOurs { .. }), "{error}");
    }
    export(&store, &folder.path().join("b"), &of_run("mine")).unwrap_err();
    for name in ["b", "b-depth"] {
        fs::remove_dir_all(folder.path().join(name)).unwrap();
    }
    export(&store, &folder.path().join("b"), &of_run("mine")).unwrap();
    export(&store, &folder.path().join("b"), &of_run("mine")).unwrap();
    let error = export(&store, &folder.path().join("b"), &of_run("another")).unwrap_err();
    assert!(matches!(error, DataError::NotOurs { .. }), "{error}");

    // The included record is a valid store.
    let record = EpisodeStore::open(folder.path().join("a/extras/record")).unwrap();
    assert_eq!(record.read("scenario-1-a0").unwrap(), store.read("scenario-1-a0").unwrap());
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 5, "no temporary files");
}

/// With every action specification, executing the rows of an episode in order reaches the recorded command at each row's end.
#[test]
fn every_action_specification_reproduces_the_recorded_commands() {
    let folder = tempfile::tempdir().unwrap();
    let store = filled_store(&folder.path().join("store"));
    let robot = robot();
    let spaces = ACTIONS.iter().flat_map(|(_, space)| {
        let rotations = if space.is_joint() { &ROTATIONS[..1] } else { &ROTATIONS[..] };
        rotations.iter().map(|(_, rotation)| choice::action(*space, *rotation))
    });
    for (number, spec) in spaces.enumerate() {
        let fps = [15, 20, 60][number % 3];
        let target = folder.path().join(format!("set-{number}"));
        let rows = ExportSettings { fps, action: spec, cameras: vec![], depth: false, ..ExportSettings::default() };
        let settings = LerobotSettings { export: rows, record: false, episodes_per_file: 2, ..Default::default() };
        export(&store, &target, &settings).unwrap();
        let dataset = LerobotDataset::open(&target).unwrap();
        let contract = dataset.contract();
        assert_eq!((contract.action, contract.rate_hz, contract.names.len()), (spec, f64::from(fps), spec.length(7)));
        assert_eq!(dataset.episodes().len(), STEPS.len());
        let mut all = Vec::new();
        for row in dataset.episodes() {
            let episode = store.read(&row.store_id).unwrap();
            let mut arm = episode.scenario.world.robot.home.clone();
            let mut pose = robot.tcp_pose(&arm);
            let actions = dataset.actions(row).unwrap();
            for (action, steps) in actions.iter().zip(episode.frames.chunks(60 / fps as usize)) {
                let command = &steps.last().unwrap().command;
                let target: Vec<f64> = command[..7].iter().map(|&q| f64::from(q)).collect();
                let (motion, grip) = action.split_at(action.len() - 1);
                let motion: Vec<f64> = motion.iter().map(|&value| f64::from(value)).collect();
                let held = spec.gripper.width_m(spec.gripper.number(command[7], &robot.gripper), &robot.gripper);
                assert!((spec.gripper.width_m(grip[0], &robot.gripper) - held).abs() < 1e-6);
                let moved = |share: f64| arm.iter().zip(&motion).map(|(q, v)| q + v * share).collect();
                let read = |numbers: &[f64]| {
                    let rotation = spec.rotation.decode(&numbers[3..]).unwrap();
                    Pose::new(DVec3::from_slice(&numbers[..3]), rotation)
                };
                match spec.space {
                    ActionSpace::JointPosition => arm = motion,
                    ActionSpace::JointDegrees => arm = motion.iter().map(|degrees| degrees.to_radians()).collect(),
                    ActionSpace::JointDelta => arm = moved(1.0),
                    ActionSpace::JointVelocity => arm = moved(1.0 / f64::from(fps)),
                    ActionSpace::EePose => pose = read(&motion),
                    ActionSpace::EeDelta => pose = spec.frame.apply(&read(&motion), &pose),
                }
                if spec.space.is_joint() {
                    pose = robot.tcp_pose(&arm);
                }
                let wanted = robot.tcp_pose(&target);
                let far = ((pose.position - wanted.position).length(), pose.angle_to(&wanted));
                assert!(far.0 < 2e-5 && far.1 < 2e-3, "{spec}: {far:?}");
            }
            assert_eq!(actions.len(), episode.frames.len().div_ceil(60 / fps as usize));
            if spec.space == ActionSpace::EePose && spec.rotation == RotationEncoding::QuatWxyz {
                let dots = actions.windows(2).map(|w| (3..7).map(|at| w[0][at] * w[1][at]).sum::<f32>());
                assert!(dots.into_iter().all(|dot| dot >= 0.0), "the sign of a quaternion jumps");
            }
            all.extend(actions);
        }
        let stats: Value = serde_json::from_slice(&fs::read(target.join("meta/stats.json")).unwrap()).unwrap();
        let mean = all.iter().map(|action| f64::from(action[0])).sum::<f64>() / all.len() as f64;
        assert!((stats["action"]["mean"][0].as_f64().unwrap() - mean).abs() < 1e-9, "{spec}: {}", stats["action"]);
    }
}

/// Data sets without a valid action contract are rejected.
#[test]
fn a_data_set_without_a_valid_contract_is_rejected() {
    let folder = tempfile::tempdir().unwrap();
    let store = filled_store(&folder.path().join("store"));
    let target = folder.path().join("set");
    let rows = ExportSettings { cameras: vec![], depth: false, ..Default::default() };
    export(&store, &target, &LerobotSettings { export: rows, record: false, ..Default::default() }).unwrap();
    let contract = target.join("meta/action_contract.json");
    let valid = fs::read_to_string(&contract).unwrap();
    let change = |from: &str, to: &str| {
        assert!(valid.contains(from), "{valid}");
        fs::write(&contract, valid.replacen(from, to, 1)).unwrap();
    };
    change("joint_position", "joint_torque");
    assert!(LerobotDataset::open(&target).unwrap_err().to_string().contains("joint_torque"));
    change("\"gripper_width\"", "\"gripper_width\", \"base\"");
    let dataset = LerobotDataset::open(&target).unwrap();
    let error = dataset.actions(&dataset.episodes()[0]).unwrap_err().to_string();
    assert!(error.contains("expected 9 numbers per row"), "{error}");
    fs::remove_file(&contract).unwrap();
    assert!(LerobotDataset::open(&target).unwrap_err().is_missing());
    assert!(LerobotDataset::open(&folder.path().join("nowhere")).unwrap_err().is_missing());
}

#[test]
fn an_independent_reader_agrees() {
    let Some(python) = python() else { return };
    let folder = tempfile::tempdir().unwrap();
    let store = filled_store(&folder.path().join("store"));
    let settings = LerobotSettings {
        export: ExportSettings { is_varied: true, has_corrections: true, ..Default::default() },
        episodes_per_file: 2,
        episodes_per_depth_file: 2,
        ..Default::default()
    };
    export(&store, &folder.path().join("set"), &settings).unwrap();
    fs::write(folder.path().join("expected.json"), expectations(&store, folder.path()).to_string()).unwrap();
    assert_reader_agrees(&python, folder.path(), "set");
}

fn assert_reader_agrees(python: &Path, folder: &Path, dataset: &str) {
    let output = Command::new(python)
        .arg(Path::new(env!("CARGO_MANIFEST_DIR")).join("testdata/read_lerobot.py"))
        .arg(folder.join(dataset))
        .arg("--expected")
        .arg(folder.join("expected.json"))
        .output()
        .unwrap();
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    assert!(output.status.success(), "{}{}", text(&output.stdout), text(&output.stderr));
    let summary: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(summary["episodes"], 3, "{summary}");
    assert_eq!(summary["video_frames_decoded"], 2 * 37, "{summary}");
    assert_eq!(summary["depth_frames_decoded"], 2 * 37, "{summary}");
    let color_error = summary["largest_color_error"].as_f64().unwrap();
    assert!(color_error < 3.0, "of 255, chroma subsampling of hard edges included: {summary}");
}

/// Expected values computed without the exporter's code: numbers of selected frames, and raw images.
fn expectations(store: &EpisodeStore, folder: &Path) -> Value {
    let mut frames = Vec::new();
    let mut first = 0;
    for (number, steps) in STEPS.into_iter().enumerate() {
        let rows = steps.div_ceil(4);
        let source = store.read(&result(number, steps, true).id).unwrap();
        for row in [0, 1, rows / 2, rows - 1] {
            let now = &source.frames[row * 4];
            let last = &source.frames[(row * 4 + 3).min(steps - 1)];
            let state: Vec<f64> = now.joint_position.iter().copied().chain([now.gripper_width]).collect();
            let mut images = serde_json::Map::new();
            for (camera, name) in ["static", "wrist"].into_iter().enumerate() {
                let (rgb, depth_m) = image(number, camera, row);
                let file = |ending: &str| folder.join(format!("{number}-{row}-{name}.{ending}"));
                fs::write(file("rgb"), rgb).unwrap();
                let depth_mm = depth_m.iter().flat_map(|depth| ((depth * 1000.0).round() as u16).to_le_bytes());
                fs::write(file("mm"), depth_mm.collect::<Vec<u8>>()).unwrap();
                images.insert(name.into(), json!({"rgb": file("rgb"), "depth_mm": file("mm")}));
            }
            frames.push(json!({
                "index": first + row, "episode": number, "row": row, "state": state, "action": last.command,
                "task": source.scenario.task.instruction, "seed": source.result.seed.value(),
                "variation_seed": source.result.seed.fork("variation").value(),
                "is_correction": number == 1 && row * 4 >= synthetic::CORRECTED_FROM,
                "corrected": if number == 1 { json!(["clumsy", "slipped", synthetic::CORRECTED_FROM]) }
                             else { json!(["", "", -1]) },
                "scenario": source.scenario.to_value(), "images": images,
            }));
        }
        first += rows;
    }
    json!({"frames": frames, "width": synthetic::WIDTH, "height": synthetic::HEIGHT})
}

/// v3.0, v2.1 and Zarr exports of one store hold the same numbers, images, times and sentences.
#[test]
fn all_formats_hold_the_same_data() {
    let Some(python) = python() else { return };
    let folder = tempfile::tempdir().unwrap();
    let store = filled_store(&folder.path().join("store"));
    let path = |name: &str| folder.path().join(name);
    for (number, (spec, cameras)) in [
        (choice::action(ActionSpace::EeDelta, RotationEncoding::AxisAngle), vec!["static".to_owned(), "wrist".into()]),
        (choice::action(ActionSpace::JointVelocity, RotationEncoding::SixD), vec!["wrist".into()]),
    ]
    .into_iter()
    .enumerate()
    {
        let rows = ExportSettings { action: spec, cameras: cameras.clone(), ..Default::default() };
        let settings = LerobotSettings { export: rows.clone(), episodes_per_file: 2, ..Default::default() };
        let [v30, v21, zarr] = ["v30", "v21", "zarr"].map(|name| path(&format!("{name}-{number}")));
        let reports = [
            export(&store, &v30, &settings).unwrap(),
            lerobot::export_v21(&store, &Selection::Verified, &robot(), &settings, &v21).unwrap(),
            zarr::export(&store, &Selection::Verified, &robot(), &rows, &zarr).unwrap(),
        ];
        assert!(reports.iter().all(|report| (report.episodes, report.frames) == (3, 12 + 15 + 10)), "{reports:?}");
        let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("testdata/compare_formats.py");
        let output = Command::new(&python).arg(script).args([&v30, &v21, &zarr]).output().unwrap();
        let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
        assert!(output.status.success(), "{}{}", text(&output.stdout), text(&output.stderr));
        let compared: Value = serde_json::from_slice(&output.stdout).unwrap();
        let pictures = 37 * cameras.len();
        assert_eq!((&compared["pictures"], &compared["depth"]), (&pictures.into(), &pictures.into()), "{compared}");

        let again = zarr::export(&store, &Selection::Verified, &robot(), &rows, &zarr).unwrap_err();
        assert!(matches!(again, DataError::Exists { .. }), "{again}");
        let again = lerobot::export_v21(&store, &Selection::Verified, &robot(), &settings, &v21).unwrap_err();
        assert!(matches!(again, DataError::Exists { .. }), "{again}");
    }
}

#[test]
fn the_original_genmanip_layout_holds_the_same_data() {
    let Some(python) = python() else { return };
    let folder = tempfile::tempdir().unwrap();
    let store = filled_store(&folder.path().join("store"));
    let [v30, paper] = ["v30", "paper"].map(|name| folder.path().join(name));
    let settings = LerobotSettings::default();
    export(&store, &v30, &settings).unwrap();
    let report = genmanip_format::export(&store, &Selection::Verified, &robot(), &settings.export, &paper).unwrap();
    assert_eq!((report.episodes, report.frames), (3, 12 + 15 + 10));
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("testdata/compare_genmanip_layout.py");
    let output = Command::new(python).arg(script).args([&v30, &paper]).output().unwrap();
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    assert!(output.status.success(), "{}{}", text(&output.stdout), text(&output.stderr));
    let compared: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!((&compared["episodes"], &compared["pictures"]), (&3.into(), &74.into()), "{compared}");
    assert!(compared["worst_color"].as_f64().unwrap() < 3.0, "of 255, hard edges included: {compared}");
    let again = genmanip_format::export(&store, &Selection::Verified, &robot(), &settings.export, &paper).unwrap_err();
    assert!(matches!(again, DataError::Exists { .. }), "{again}");
}

/// The HDF5 C library, through h5py, reads files written without it.
#[test]
fn hdf5_holds_the_same_data() {
    let Some(python) = python_with("pyarrow, av, numpy, h5py") else { return };
    let folder = tempfile::tempdir().unwrap();
    let store = filled_store(&folder.path().join("store"));
    let [v30, demos] = ["v30", "hdf5"].map(|name| folder.path().join(name));
    let settings = LerobotSettings::default();
    export(&store, &v30, &settings).unwrap();
    let write = || hdf5::export(&store, &Selection::Verified, &robot(), &settings.export, &demos);
    let report = write().unwrap();
    assert_eq!((report.episodes, report.frames), (3, 12 + 15 + 10));
    let first = tree(&demos);
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("testdata/compare_hdf5.py");
    let output = Command::new(python).arg(script).args([&v30, &demos]).output().unwrap();
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    assert!(output.status.success(), "{}{}", text(&output.stdout), text(&output.stderr));
    let compared: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!((&compared["episodes"], &compared["pictures"]), (&3.into(), &74.into()), "{compared}");
    assert!(compared["columns"].as_u64().unwrap() > 40, "{compared}");
    let again = write().unwrap_err();
    assert!(matches!(again, DataError::Exists { .. }), "{again}");
    fs::remove_dir_all(&demos).unwrap();
    write().unwrap();
    assert_eq!(tree(&demos), first, "the same bytes again");
}

/// Columns of simulator ground truth: objects by slot, zeros in empty slots.
#[test]
fn simulator_ground_truth_is_exported_on_request() {
    let folder = tempfile::tempdir().unwrap();
    let store = filled_store(&folder.path().join("store"));
    let rows =
        ExportSettings { columns: vec![ExtraColumns::Sim], cameras: vec![], depth: false, ..ExportSettings::default() };
    let settings = LerobotSettings { export: rows, ..LerobotSettings::default() };
    let dataset = folder.path().join("dataset");
    export(&store, &dataset, &settings).unwrap();
    let info: Value = serde_json::from_slice(&fs::read(dataset.join("meta/info.json")).unwrap()).unwrap();
    let shape = |key: &str| info["features"][key]["shape"].clone();
    assert_eq!((shape("sim.object_pose"), shape("sim.grasped_object")), (json!([112]), json!([1])));
    let usual = folder.path().join("usual");
    export(
        &store,
        &usual,
        &LerobotSettings { export: ExportSettings { columns: vec![], ..settings.export.clone() }, ..settings },
    )
    .unwrap();
    let info: Value = serde_json::from_slice(&fs::read(usual.join("meta/info.json")).unwrap()).unwrap();
    assert!(info["features"].get("sim.object_pose").is_none());

    let mut crowded = episode(5, 8, true);
    let state = crowded.frames[0].objects[0].clone();
    let placed = crowded.scenario.objects[0].clone();
    for number in 0..20 {
        crowded
            .scenario
            .objects
            .push(PlacedObject { id: InstanceId::new(&"more".into(), number + 1), ..placed.clone() });
        crowded.frames.iter_mut().for_each(|frame| frame.objects.push(state.clone()));
    }
    let crowd = EpisodeStore::create(folder.path().join("crowd")).unwrap();
    crowd.write(&crowded, &[]).unwrap();
    let rows =
        ExportSettings { columns: vec![ExtraColumns::Sim], cameras: vec![], depth: false, ..ExportSettings::default() };
    let settings = LerobotSettings { export: rows, ..LerobotSettings::default() };
    let error = export(&crowd, &folder.path().join("crowded"), &settings).unwrap_err();
    assert!(error.to_string().contains("expected at most 16, got 22"), "{error}");
}

/// A Python interpreter with pyarrow and av; required in CI.
fn python() -> Option<PathBuf> {
    python_with("pyarrow, av, numpy")
}

fn python_with(modules: &str) -> Option<PathBuf> {
    let made_by_setup = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../.python/bin/python");
    let python = std::env::var_os("GENMANIP_PYTHON").map_or(made_by_setup, PathBuf::from);
    let usable = Command::new(&python).args(["-c", &format!("import {modules}")]).output();
    if usable.is_ok_and(|output| output.status.success()) {
        return Some(python);
    }
    let message = format!("no Python with {modules} at {}; `cargo xtask setup` makes it", python.display());
    assert!(std::env::var("CI").as_deref() != Ok("true"), "{message}");
    writeln_skip(&message);
    None
}

#[allow(clippy::print_stderr)] // Tests report why they are skipped.
fn writeln_skip(message: &str) {
    eprintln!("skipped: {message}");
}
