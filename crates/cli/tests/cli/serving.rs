//! `genmanip serve agent` on loopback, with a model behind HTTP.

use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::process::{Child, Stdio};

use genmanip_agent::segmentation::SegmentQuestion;
use genmanip_agent::services::masks::SegmentRequest;
use genmanip_core::glam::{DVec2, DVec3};
use genmanip_core::{Camera, Intrinsics, RgbdImage};
use genmanip_llm::fake::answering;
use serde_json::{Value, json};

use super::{REPOSITORY, example, genmanip, program};

/// A red cube of 5 cm on a table before the robot, seen from the far side at a slant.
fn one_cube() -> RgbdImage {
    let intrinsics = Intrinsics::from_vertical_fov(320, 180, 0.6);
    let world_from_camera = Camera::pose_looking_at(DVec3::new(1.4, 0.0, 1.0), DVec3::new(0.5, 0.0, 0.0));
    let (low, high) = (DVec3::new(0.475, -0.125, 0.0), DVec3::new(0.525, -0.075, 0.05));
    let (mut depth, mut rgb) = (Vec::new(), Vec::new());
    for pixel in 0..320 * 180 {
        let (x, y) = (f64::from(pixel % 320), f64::from(pixel / 320));
        let along = world_from_camera.transform_vector(intrinsics.unproject(DVec2::new(x, y), 1.0));
        let eye = world_from_camera.position;
        let (one, other) = ((low - eye) / along, (high - eye) / along);
        let (near, far) = (one.min(other).max_element(), one.max(other).min_element());
        let (color, at) = if near < far { ([200, 30, 30], near) } else { ([190, 170, 140], -eye.z / along.z) };
        rgb.extend::<[u8; 3]>(color);
        depth.push(at as f32);
    }
    RgbdImage { rgb, ..RgbdImage::of_depth(intrinsics, world_from_camera, depth) }
}

/// The program, which listens; it is ended with the test.
pub(super) struct Serving {
    child: Child,
    pub(super) address: String,
}

impl Serving {
    pub(super) fn start(folder: &std::path::Path, arguments: &[&str]) -> Self {
        let mut child = program(folder, arguments).stderr(Stdio::piped()).spawn().unwrap();
        let mut line = String::new();
        BufReader::new(child.stderr.take().unwrap()).read_line(&mut line).unwrap();
        let address = line.split("://").nth(1).and_then(|rest| rest.split(['/', ';']).next());
        let address = address.unwrap_or_else(|| panic!("no address in {line}")).to_owned();
        Self { child, address }
    }

    /// SIGKILL.
    pub(super) fn kill(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }

    /// Status and body of a request.
    fn ask(&self, method: &str, path: &str, body: &str) -> (u16, Vec<u8>) {
        let mut stream = TcpStream::connect(&self.address).unwrap();
        let length = body.len();
        write!(
            stream,
            "{method} {path} HTTP/1.1\r\nhost: localhost\r\nconnection: close\r\ncontent-length: {length}\r\n\r\n{body}"
        )
        .unwrap();
        let mut answer = Vec::new();
        stream.read_to_end(&mut answer).unwrap();
        let head = answer.windows(4).position(|four| four == b"\r\n\r\n").unwrap();
        let status = String::from_utf8_lossy(&answer[9..12]).parse().unwrap();
        (status, answer[head + 4..].to_vec())
    }

    fn json(&self, method: &str, path: &str, body: &str) -> (u16, Value) {
        let (status, body) = self.ask(method, path, body);
        (status, serde_json::from_slice(&body).unwrap())
    }
}

impl Drop for Serving {
    fn drop(&mut self) {
        self.kill();
    }
}

#[test]
fn an_agent_over_http_plans_from_an_image() {
    let folder = tempfile::tempdir().unwrap();
    let model = answering([
        ("Split what is still to be done", json!({"subtasks": ["Move the red cube to the left."]})),
        ("Which numbered thing", json!({"number": 1, "object_name": "cube", "color": "red"})),
        ("five numbered points", json!({"selected_point": 1, "reason": "it is there"})),
        ("In which cell", json!({"selected_point": {"type": "grid", "label": "E9"}})),
    ])
    .unwrap();
    std::fs::write(folder.path().join("model.toml"), format!("[server]\nbase_url = \"{}\"\n", model.base_url()))
        .unwrap();
    let serving = Serving::start(folder.path(), &["serve", "agent", "--vlm", "model.toml", "--address", "127.0.0.1:0"]);
    let (status, health) = serving.json("GET", "/health", "");
    assert_eq!((status, &health["service"]), (200, &json!("agent")));

    let image = one_cube();
    let mut question =
        serde_json::to_value(SegmentRequest::of(&SegmentQuestion { image: &image, ignore: &[], within: None }))
            .unwrap();
    question["joints"] = json!([0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785]);
    question["gripper_width_m"] = json!(0.08);
    question["instruction"] = json!("Move the red cube to the left.");
    let (status, begun) = serving.json("POST", "/agent", &question.to_string());
    assert_eq!((status, &begun), (202, &json!({"job": "1", "state_at": "/agent/jobs/1"})));
    let (status, job) = serving.json("GET", "/agent/jobs/1?wait_s=60", "");
    assert_eq!((status, &job["state"], &job["error"]), (200, &json!("done"), &Value::Null), "{job}");
    let acted = &job["acted"];
    assert_eq!(acted["failure"], Value::Null, "{}", acted["failure"]);
    let steps = acted["steps"].as_array().unwrap();
    assert!(steps.len() == 2 && steps[0]["waypoints"].as_array().unwrap().len() >= 3, "{}", steps.len());
    assert_eq!(job["transcript"]["schema"], json!("genmanip.agent_transcript/1"));
    let pictures: Vec<&str> = job["pictures"].as_array().unwrap().iter().filter_map(Value::as_str).collect();
    assert!(pictures.contains(&"001_object_masks.png"), "{pictures:?}");
    let (status, png) = serving.ask("GET", "/agent/jobs/1/pictures/001_object_masks.png", "");
    assert!(status == 200 && png.starts_with(b"\x89PNG"), "{status}");

    // The same question, wrong in one place each.
    let cases: [(&str, Value, u16, &str); 4] = [
        ("joints", json!([0, 0, 0]), 400, "joints has 3 numbers, expected 7"),
        ("instruction", json!(""), 400, "instruction has 0 bytes"),
        ("depth_m", json!("AAAA"), 400, "depth_m has 3 bytes"),
        ("seed", json!("one"), 400, "at seed: invalid type"),
    ];
    for (field, value, expected, message) in cases {
        let mut wrong = question.clone();
        wrong[field] = value;
        let (status, answer) = serving.json("POST", "/agent", &wrong.to_string());
        let said = answer["error"]["message"].as_str().unwrap_or_default();
        assert!(status == expected && said.contains(message), "{status} {said}");
    }
    for (path, expected) in [("/agent/jobs/2", 404), ("/agent/jobs/x", 404), ("/agent/jobs/1?wait_s=1e9", 400)] {
        assert_eq!(serving.json("GET", path, "").0, expected, "{path}");
    }
    assert_eq!(serving.json("GET", "/agent", "").0, 405);
}

#[test]
fn an_agent_that_needs_the_simulator_is_not_offered() {
    let folder = tempfile::tempdir().unwrap();
    let outcome = genmanip(folder.path(), &["serve", "agent", "--vlm", "oracle"]);
    outcome.assert_refused(&["the oracle's answers are the simulator's", "expected --vlm FILE"]);
}

/// Demonstrations with grasps from depth images alone: of our sampler in the program, and of the same behind HTTP.
#[test]
fn demonstrations_with_grasps_from_images() {
    let folder = tempfile::tempdir().unwrap();
    let task = example("021_spatial");
    let collect = |grasps: &str, out: &str| {
        let usual = ["collect", &task, "--episodes", "1", "--no-dataset", "--json"];
        genmanip(folder.path(), &[&usual[..], &["--grasps", grasps, "--out", out]].concat())
    };
    let verified = |outcome: &super::Outcome| outcome.json(0)[0]["verified"].clone();
    assert_eq!(verified(&collect("rgbd", "rgbd")), json!(1));
    let serving = Serving::start(folder.path(), &["serve", "grasp", "--address", "127.0.0.1:0"]);
    let url = format!("http://{}/grasp", serving.address);
    assert_eq!(verified(&collect(&url, "http")), json!(1));
    let bare = format!("http://{}", serving.address);
    collect(&bare, "bare").assert_refused(&["the grasp service", "404", "whole address", "/segment"]);

    // A server that is gone is no failed attempt: the run stops, and the same call continues it.
    drop(serving);
    collect(&url, "gone").assert_refused(&["the grasp service"]);
    assert!(!folder.path().join("gone/episodes/021_spatial-000").exists());
    collect("camera", "wrong").assert_refused(&["unknown source of grasps `camera`", "mesh, rgbd, http:URL"]);
    assert!(!folder.path().join("wrong").exists(), "nothing is touched");
}

#[test]
fn the_studio_offers_the_scenarios_that_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let scenario = format!("{REPOSITORY}/suites/genmanip-200-rc/scenarios/009_appearance-000.json");
    let studio = Serving::start(folder.path(), &["studio", &scenario, "--port", "0", "--no-open", "--author", "ada"]);
    let (status, session) = studio.json("GET", "/api/session", "");
    assert_eq!((status, &session["author"], &session["needs_token"]), (200, &json!("ada"), &json!(false)));
    let (_, rows) = studio.json("GET", "/api/scenarios", "");
    assert_eq!((&rows[0]["key"], &rows[0]["read_only"]), (&json!("009_appearance-000"), &json!(true)), "{rows}");
    assert_eq!(genmanip(folder.path(), &["studio", "none.json", "--no-open"]).code, Some(1));

    let scene = folder.path().join("scene.glb");
    let written = genmanip(folder.path(), &["export", &scenario, "--glb", "--out", scene.to_str().unwrap()]);
    assert_eq!(written.code, Some(0), "{written:?}");
    assert!(std::fs::read(&scene).unwrap().starts_with(b"glTF"));
}
