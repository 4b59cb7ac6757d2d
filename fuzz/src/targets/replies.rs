//! Bytes from the network: replies of model, segmentation and policy servers, and requests to our own services.

use std::path::Path;
use std::sync::Arc;

use genmanip_agent::segmentation::{RgbdSegmenter, SegmentQuestion, Segmenter};
use genmanip_agent::services::agent_request::ActRequest;
use genmanip_agent::services::grasps::GraspRequest;
use genmanip_agent::services::masks::SegmentRequest;
use genmanip_agent::services::{GraspQuestion, ServiceMasks};
use genmanip_assets::worlds;
use genmanip_core::glam::DVec3;
use genmanip_core::{Camera, Intrinsics, RgbdImage};
use genmanip_llm::fake::{completion, message as anthropic};
use genmanip_llm::{ChatError, Dialect, Service, Structure};
use genmanip_motion::PlannerSettings;
use genmanip_pipeline::sessions::SceneSource;
use genmanip_remote_policies::numpy::{Array, Numbers};
use genmanip_remote_policies::{decode, openpi, vla_eval};
use genmanip_serve::{Endpoint, EnvEndpoint};
use genmanip_workspace::worlds::planner;
use rmpv::Value;
use serde_json::json;

use super::{Opened, message};
use crate::Failure;
use crate::input::Input;

/// Completions of both dialects.
pub fn chat(_: &str, _: &Path) -> Result<Opened, Failure> {
    let text = "<think>Which one?</think>{\"number\": 2}";
    let listed = json!({"model": "m", "choices": [{"message": {"content": [{"type": "text", "text": text}]}}]});
    let corpus = [completion(text), anthropic(text), listed.to_string()];
    let read = |input: &Input| {
        let body = serde_json::from_slice(&input.files[0].1).map_err(message)?;
        let replies = Dialect::ALL.iter().map(|dialect| dialect.reply(&body, Structure::Plain, "http://server"));
        let refusals: Vec<String> = replies.filter_map(|reply| reply.err().map(message)).collect();
        if refusals.len() < Dialect::ALL.len() { Ok(()) } else { Err(refusals.join("; ")) }
    };
    Ok(Opened { corpus: corpus.map(|body| Input::file("reply.json", body)).to_vec(), read: Box::new(read) })
}

/// A service that answers with the input.
struct Replayed(serde_json::Value);

impl Service for Replayed {
    fn ask(&self, _: &serde_json::Value) -> Result<serde_json::Value, ChatError> {
        Ok(self.0.clone())
    }
}

/// Masks in COCO's run-length encoding.
pub fn masks(_: &str, _: &Path) -> Result<Opened, Failure> {
    let image = image();
    let (width, height) = (image.width(), image.height());
    let all = width * height;
    let runs = |counts: Vec<u32>| json!({"size": [height, width], "counts": counts});
    let reply = json!({"masks": [
        {"segmentation": runs(vec![40, 60, all - 100]), "score": 0.9, "area": 60},
        {"segmentation": runs(vec![0, 10, all - 10]), "score": 0.5},
        {"segmentation": runs(vec![all])},
    ]});
    let read = move |input: &Input| {
        let service = Replayed(serde_json::from_slice(&input.files[0].1).map_err(message)?);
        let question = SegmentQuestion { image: &image, ignore: &[], within: None };
        ServiceMasks::new(service).segment(&question).map(drop).map_err(message)
    };
    Ok(Opened { corpus: vec![Input::file("reply.json", reply.to_string())], read: Box::new(read) })
}

/// Action chunks of openpi and vla-eval.
pub fn policies(_: &str, _: &Path) -> Result<Opened, Failure> {
    let array = |rows: usize, width: usize| {
        let numbers = (0..rows * width).map(|index| index as f32 * 0.01).collect();
        Array { shape: vec![rows, width], numbers: Numbers::F32(numbers) }
    };
    let map =
        |entries: Vec<(&str, Value)>| Value::Map(entries.into_iter().map(|(key, value)| (key.into(), value)).collect());
    let timing = || map(vec![("infer_ms", 3.5.into())]);
    let openpi = |width| map(vec![("actions", array(10, width).value()), ("server_timing", timing())]);
    let payload = |width| map(vec![("actions", array(4, width).value_with_text_keys())]);
    let vla = |width| map(vec![("type", "action".into()), ("payload", payload(width)), ("seq", 1.into())]);
    let packed = |value: Value| {
        let mut bytes = Vec::new();
        rmpv::encode::write_value(&mut bytes, &value).map(|()| Input::file("reply.msgpack", bytes))
    };
    let corpus = [openpi(8), openpi(7), vla(8), vla(7)].map(packed).into_iter().collect::<Result<_, _>>()?;
    let read = |input: &Input| {
        let reply = decode(&input.files[0].1)?;
        let chunks = openpi::Preset::ALL.map(|preset| openpi::chunk(&reply, preset, 7));
        let others = vla_eval::Preset::ALL.map(|preset| vla_eval::chunk(&reply, 1, preset, 7));
        let refusals: Vec<String> = chunks.into_iter().chain(others).filter_map(Result::err).collect();
        let count = openpi::Preset::ALL.len() + vla_eval::Preset::ALL.len();
        if refusals.len() < count { Ok(()) } else { Err(refusals.join("; ")) }
    };
    Ok(Opened { corpus, read: Box::new(read) })
}

/// Requests for masks, grasps, the agent and an environment; each input is named after its service.
pub fn services(_: &str, repository: &Path) -> Result<Opened, Failure> {
    let image = image();
    let planner = planner(&worlds::default_world(), &PlannerSettings::default())?;
    let scenes = Arc::new(SceneSource::of_tasks(&[repository.join("examples/tasks/012_pick_and_place.json")], None)?);
    let points = cube(DVec3::new(0.5, 0.0, 0.0));
    let question = GraspQuestion {
        points: &points,
        scene: &[],
        world_from_camera: image.world_from_camera,
        camera_positions: &[image.world_from_camera.position],
        table_height: 0.0,
    };
    let segment = SegmentRequest::of(&SegmentQuestion { image: &image, ignore: &[], within: None });
    let act = ActRequest {
        intrinsics: image.intrinsics,
        world_from_camera: image.world_from_camera,
        rgb: segment.rgb.clone(),
        depth_m: segment.depth_m.clone().unwrap_or_default(),
        joints: vec![0.0; 7],
        gripper_width_m: 0.08,
        instruction: "Put the apple on the plate.".into(),
        seed: 3,
    };
    let mut corpus = vec![
        Input::file("segment.json", serde_json::to_vec(&segment)?),
        Input::file("grasp.json", serde_json::to_vec(&GraspRequest::of(&question))?),
        Input::file("agent.json", serde_json::to_vec(&act)?),
    ];
    let channels = map(&[("rgb", true.into()), ("depth", true.into())]);
    let size = Value::Array(vec![32.into(), 24.into()]);
    let camera = map(&[("name", "static".into()), ("size", size), ("channels", channels)]);
    let gripper = map(&[("encoding", "width_m".into())]);
    let action = map(&[("space", "joint_position".into()), ("gripper", gripper)]);
    let cameras = Value::Array(vec![camera]);
    let settings = map(&[("action", action), ("rate_hz", 60.into()), ("cameras", cameras)]);
    corpus.push(packed("env.msgpack", &map(&[("ask", "open".into()), ("settings", settings)]))?);
    let read = move |input: &Input| {
        let (name, body) = &input.files[0];
        let endpoint = match name.as_str() {
            "segment.json" => Endpoint::Segment(RgbdSegmenter::default()),
            "grasp.json" => Endpoint::Grasp(Arc::clone(&planner)),
            "env.msgpack" => Endpoint::Env(Arc::new(EnvEndpoint::new(Arc::clone(&scenes), 1))),
            _ => {
                let request: ActRequest = serde_json::from_slice(body).map_err(message)?;
                return request.read(planner.robot().arm_dof()).map(drop);
            }
        };
        endpoint.answer(body).map(drop).map_err(message)
    };
    Ok(Opened { corpus, read: Box::new(read) })
}

fn map(entries: &[(&str, Value)]) -> Value {
    Value::Map(entries.iter().map(|(key, value)| ((*key).into(), value.clone())).collect())
}

/// A value in MessagePack.
fn packed(name: &str, value: &Value) -> Result<Input, Failure> {
    let mut bytes = Vec::new();
    rmpv::encode::write_value(&mut bytes, value)?;
    Ok(Input::file(name, bytes))
}

/// Points on the surface of a cube with sides of 4 cm, 5 mm apart.
fn cube(corner: DVec3) -> Vec<DVec3> {
    let grid = (0..9 * 9 * 9).map(|index| [index % 9, index / 9 % 9, index / 81]);
    let surface = grid.filter(|place| place.iter().any(|step| [0, 8].contains(step)));
    surface.map(|place| corner + 0.005 * DVec3::from_array(place.map(f64::from))).collect()
}

/// A table seen obliquely from above, with a red patch on it.
fn image() -> RgbdImage {
    let (width, height) = (32, 24);
    let intrinsics = Intrinsics::from_vertical_fov(width, height, 0.6);
    let world_from_camera = Camera::pose_looking_at(DVec3::new(1.4, 0.0, 1.0), DVec3::new(0.5, 0.0, 0.0));
    let is_red = |pixel: u32| (12..20).contains(&(pixel % width)) && (8..16).contains(&(pixel / width));
    let rgb = (0..width * height).flat_map(|pixel| if is_red(pixel) { [200, 30, 30] } else { [190, 170, 140] });
    let depth_m = (0..width * height).map(|pixel| if is_red(pixel) { 1.2 } else { 1.3 }).collect();
    RgbdImage { rgb: rgb.collect(), ..RgbdImage::of_depth(intrinsics, world_from_camera, depth_m) }
}
