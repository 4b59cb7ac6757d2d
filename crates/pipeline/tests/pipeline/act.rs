//! The agent on images of files, with a model behind HTTP.

use std::sync::Arc;

use genmanip_agent::image::RgbImage;
use genmanip_agent_sim::AgentChoice;
use genmanip_agent_sim::act_on_files::{ActFiles, act};
use genmanip_assets::Catalogue;
use genmanip_core::{AgentStage, CameraRequest, ImageChannels, RgbdImage, Scenario, Seed};
use genmanip_data::depth::encode_depth_png;
use genmanip_llm::fake::answering;
use genmanip_rollout::{Environment, RolloutSettings, Stage};
use genmanip_workspace::worlds;
use serde_json::json;

/// Input files of the agent: the overview image at the start of a scenario, as a real camera would provide it.
pub fn files_of(scenario: &Arc<Scenario>, folder: &std::path::Path) -> ActFiles {
    let planner = worlds::planner(&scenario.world, &Default::default()).unwrap();
    let stage = Stage::open(Arc::clone(scenario), Catalogue::builtin(), planner.robot()).unwrap();
    let mut environment = Environment::new(RolloutSettings::default());
    environment.reset(&stage, Seed::new(1));
    let seen = environment.observe(&[CameraRequest::new("overview", ImageChannels::RGBD)]).unwrap();
    let image: &RgbdImage = &seen.images["overview"];
    let (width, height) = (image.width(), image.height());
    let path = |name: &str| folder.join(name);
    std::fs::write(path("rgb.png"), RgbImage::new(width, height, image.rgb.clone()).unwrap().png().unwrap()).unwrap();
    std::fs::write(path("depth.png"), encode_depth_png(&image.depth_m, width, height).unwrap()).unwrap();
    let camera = json!({"intrinsics": image.intrinsics, "world_from_camera": image.world_from_camera});
    std::fs::write(path("camera.json"), camera.to_string()).unwrap();
    ActFiles {
        rgb: path("rgb.png"),
        depth: path("depth.png"),
        camera: path("camera.json"),
        joints: environment.joint_positions().unwrap(),
        gripper_width_m: 0.08,
        instruction: scenario.task.instruction.clone(),
        seed: Seed::new(2),
        out: folder.join("act"),
    }
}

/// Runs the agent on image files: motions start at the arm's configuration, and each question's image is written.
pub fn an_image_becomes_motions(scenario: &Arc<Scenario>, folder: &std::path::Path) {
    let files = files_of(scenario, folder);
    let server = answering([
        ("Split what is still to be done", json!({"subtasks": ["Pick up the thing and place it in the middle."]})),
        ("Which numbered thing", json!({"number": 1, "object_name": "thing", "color": "any"})),
        ("In which cell", json!({"selected_point": {"type": "grid", "label": "E9"}})),
    ])
    .unwrap();
    let model = folder.join("act.toml");
    std::fs::write(&model, format!("[server]\nbase_url = \"{}\"\n", server.base_url())).unwrap();
    let choice = AgentChoice::named(&model.display().to_string(), "rgbd", "p2p", "full").unwrap();
    let planner = worlds::planner(&scenario.world, &Default::default()).unwrap();
    let acted = act(&choice, &planner, &files).unwrap();
    for picture in ["000_decompose_picture", "001_object_masks", "002_point_to_point_grid"] {
        assert!(files.out.join(format!("{picture}.png")).is_file(), "{picture}");
    }
    assert!(files.out.join("transcript.json").is_file() && files.out.join("motions.json").is_file());
    match (&acted.failure, acted.steps.first()) {
        // Which thing is the first is the segmentation's matter; it may be one that cannot be taken.
        (Some(failure), _) => assert!(matches!(failure.stage, AgentStage::Grasp | AgentStage::Motion), "{failure}"),
        (None, Some(pick)) => {
            let start: Vec<f64> = pick.trajectory[0].iter().take(7).copied().map(f64::from).collect();
            assert!(start.iter().zip(&files.joints).all(|(one, other)| (one - other).abs() < 0.02), "{start:?}");
            assert!(acted.steps.len() == 2 && acted.steps[1].start_s > 1.0 && pick.waypoints.len() >= 3, "{acted:?}");
        }
        (None, None) => panic!("neither motions nor a reason"),
    }

    let refused = |files: ActFiles, choice: &AgentChoice| act(choice, &planner, &files).unwrap_err().to_string();
    let oracle = AgentChoice::named("oracle", "rgbd", "p2p", "full").unwrap();
    let cases = [
        (refused(ActFiles { joints: vec![0.0; 3], ..files.clone() }, &choice), "3 joint positions, and the arm has 7"),
        (refused(ActFiles { depth: files.rgb.clone(), ..files.clone() }, &choice), "rgb.png"),
        (refused(ActFiles { camera: files.depth.clone(), ..files.clone() }, &choice), "depth.png"),
        (refused(files, &oracle), "the oracle's answers are the simulator's"),
    ];
    for (error, expected) in cases {
        assert!(error.contains(expected), "{error}, expected {expected}");
    }
}
