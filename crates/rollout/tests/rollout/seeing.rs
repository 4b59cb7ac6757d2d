//! Images in the loop: a policy's cameras are rendered from the current state, equal to images rendered afterwards.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex};

use genmanip_core::{
    ActionChunk, CameraRequest, CameraSensor, EpisodeStart, ImageChannels, Observation, Policy, PolicyError,
    PolicySpec, RgbdImage, Seed,
};
use genmanip_rollout::images::{Exposure, StageRenderer};
use genmanip_rollout::{Environment, RolloutSettings, run_episode};

use crate::{any_stage, episodes, stage};

type Seen = Arc<Mutex<Vec<BTreeMap<String, Arc<RgbdImage>>>>>;

/// Applies recorded commands, half a second at a time, and keeps the observed images.
struct Observer {
    cameras: Vec<CameraRequest>,
    commands: Vec<Vec<f32>>,
    seen: Seen,
}

impl Policy for Observer {
    fn spec(&self) -> PolicySpec {
        PolicySpec { cameras: self.cameras.clone(), ..PolicySpec::native("observer", 60.0) }
    }

    fn reset(&mut self, start: &EpisodeStart) -> Result<(), PolicyError> {
        let cameras: Vec<_> = start.cameras.iter().map(|c| (c.name.as_str(), c.intrinsics.width)).collect();
        assert_eq!(cameras, [("wrist", 96), ("static", 128)]);
        Ok(())
    }

    fn act(&mut self, observation: &Observation) -> Result<ActionChunk, PolicyError> {
        self.seen.lock().unwrap().push(observation.images.clone());
        let rest = self.commands.split_off(self.commands.len().min(30));
        let actions = std::mem::replace(&mut self.commands, rest);
        Ok(ActionChunk { actions, finished: self.commands.is_empty() })
    }
}

fn requests() -> [CameraRequest; 2] {
    [
        CameraRequest::new("wrist", ImageChannels { normals: true, points: true, ..ImageChannels::RGB }).sized(96, 54),
        CameraRequest::new("static", ImageChannels::RGBD).sized(128, 72),
    ]
}

#[test]
fn a_policy_receives_the_cameras_it_requests() {
    let (stage, known) = &episodes()[1];
    let seen = Seen::default();
    let commands = known.frames[..120].iter().map(|frame| frame.command.clone()).collect();
    let mut policy = Observer { cameras: requests().to_vec(), commands, seen: Arc::clone(&seen) };
    let settings = RolloutSettings { settle_s: 0.0, ..RolloutSettings::default() };
    let episode = run_episode(stage, &mut policy, "observed", Seed::new(3), &settings).unwrap();
    assert_eq!(episode.frames, known.frames[..120], "observing changes nothing");
    let seen = seen.lock().unwrap();
    assert_eq!(seen.len(), 4, "at 0, 0.5, 1 and 1.5 s");
    let mut renderer = StageRenderer::new(stage).unwrap();
    for (look, images) in seen.iter().enumerate() {
        assert_eq!(images.len(), 2);
        for request in requests() {
            let camera = stage.camera(&request).unwrap();
            let exposure = Exposure::of(&episode, 30 * look);
            let drawn = renderer.render_frame(&episode.frames[30 * look], &camera, request.channels, exposure).unwrap();
            // Points of background pixels are NaN, which is never equal.
            let bits = |image: &RgbdImage| image.points_m.iter().flatten().map(|v| v.to_bits()).collect::<Vec<_>>();
            let image = &images[&request.name];
            assert_eq!(bits(image), bits(&drawn), "{} at look {look}", request.name);
            let without = |image: &RgbdImage| RgbdImage { points_m: Vec::new(), ..image.clone() };
            assert!(
                without(image) == without(&drawn),
                "{} at look {look}: as rendered from the recording",
                request.name
            );
        }
    }
    let pixels = |name: &str, look: usize| seen[look][name].rgb.clone();
    assert!(pixels("wrist", 0) != pixels("wrist", 3), "the gripper has moved");
    let wrist = &seen[0]["wrist"];
    assert_eq!(
        (wrist.rgb.len(), wrist.normals.len(), wrist.points_m.len(), wrist.ids.len()),
        (96 * 54 * 3, 96 * 54, 96 * 54, 0)
    );
    assert!(wrist.points_m.iter().any(|point| point[2].abs() < 1e-3), "it sees the table's top at z = 0");
}

/// Images are available before the first step and after the last, and the meshes of a stage are collected once.
#[test]
fn images_are_available_at_any_time() {
    let stage = any_stage();
    let mut environment = Environment::new(RolloutSettings { settle_s: 0.2, ..RolloutSettings::default() });
    environment.reset(stage, Seed::new(1));
    let first = environment.observe(&requests()).unwrap();
    for frame in &episodes()[1].1.frames[..60] {
        environment.step(&frame.command).unwrap();
    }
    environment.settle().unwrap();
    let last = environment.observe(&requests()).unwrap();
    assert_eq!((first.time_s, last.time_s), (0.0, 1.2));
    assert!(first.images["static"].rgb != last.images["static"].rgb);
    let again = stage.clone().render_assets().unwrap();
    assert!(Arc::ptr_eq(&again, &stage.render_assets().unwrap()));
}

/// With an exposure longer than a control step, a policy's images equal those rendered from the recording: blurred while
/// the arm moves, sharp before; depth is instantaneous.
#[test]
fn motion_during_the_exposure_is_blurred() {
    let (sharp, known) = &episodes()[1];
    let mut scenario = (*sharp.scenario).clone();
    for camera in &mut scenario.world.cameras {
        camera.sensor = CameraSensor::with_shutter(camera.sensor, 0.025);
    }
    let blurred = stage(scenario);
    let mut environment = Environment::new(RolloutSettings::default());
    environment.reset(&blurred, Seed::new(5));
    let cameras = ["wrist", "static"].map(|name| CameraRequest::new(name, ImageChannels::RGBD).sized(160, 90));
    let mut episode = known.clone();
    episode.result.seed = Seed::new(5);
    let mut renderers = [sharp, &blurred].map(|stage| StageRenderer::new(stage).unwrap());
    let mut drawn = |index: usize, request: &CameraRequest| {
        [sharp, &blurred].map(|stage| {
            let renderer = &mut renderers[usize::from(!std::ptr::eq(stage, sharp))];
            let camera = stage.camera(request).unwrap();
            let exposure = Exposure::of(&episode, index);
            renderer.render_frame(&episode.frames[index], &camera, request.channels, exposure).unwrap()
        })
    };
    // The fastest motion near the beginning, and its neighbours.
    let distance = |index: &usize| known.frames[*index].tcp.position.distance(known.frames[index - 1].tcp.position);
    let fastest = (2..180).max_by(|a, b| distance(a).total_cmp(&distance(b))).unwrap();
    for (index, frame) in known.frames[..=fastest].iter().enumerate() {
        if [0, 1, fastest - 7, fastest].contains(&index) {
            let seen = environment.observe(&cameras).unwrap();
            for request in &cameras {
                let [perfect, again] = drawn(index, request);
                let image = &seen.images[&request.name];
                assert!(**image == again, "{} at step {index}: as rendered from the recording", request.name);
                assert_eq!(image.depth_m, perfect.depth_m, "{} at step {index}", request.name);
                assert!(image.rgb == perfect.rgb || index > 0, "{}: nothing moved before", request.name);
                assert!(image.rgb != perfect.rgb || index < fastest, "{} at step {index}: blurred", request.name);
            }
        }
        environment.step(&frame.command).unwrap();
    }
}
