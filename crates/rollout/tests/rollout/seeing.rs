//! Images in the loop: the cameras a policy asks for, drawn from the state, the same as those drawn afterwards.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex};

use genmanip_core::{
    ActionChunk, CameraRequest, EpisodeStart, ImageChannels, Observation, Policy, PolicyError, PolicySpec, RgbdImage,
    Seed,
};
use genmanip_rollout::images::{Painter, sensor_seed};
use genmanip_rollout::{Environment, RolloutSettings, run_episode};

use crate::{any_stage, episodes};

type Seen = Arc<Mutex<Vec<BTreeMap<String, Arc<RgbdImage>>>>>;

/// Applies recorded commands, half a second at a time, and keeps what it is shown.
struct Onlooker {
    cameras: Vec<CameraRequest>,
    commands: Vec<Vec<f32>>,
    seen: Seen,
}

impl Policy for Onlooker {
    fn spec(&self) -> PolicySpec {
        PolicySpec { cameras: self.cameras.clone(), ..PolicySpec::native("onlooker", 60.0) }
    }

    fn reset(&mut self, start: &EpisodeStart) -> Result<(), PolicyError> {
        let told: Vec<_> = start.cameras.iter().map(|c| (c.name.as_str(), c.intrinsics.width)).collect();
        assert_eq!(told, [("wrist", 96), ("static", 128)]);
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
fn a_policy_that_asks_for_two_cameras_gets_them() {
    let (stage, known) = &episodes()[1];
    let seen = Seen::default();
    let commands = known.frames[..120].iter().map(|frame| frame.command.clone()).collect();
    let mut policy = Onlooker { cameras: requests().to_vec(), commands, seen: Arc::clone(&seen) };
    let settings = RolloutSettings { settle_s: 0.0, ..RolloutSettings::default() };
    let episode = run_episode(stage, &mut policy, "looked", Seed::new(3), &settings).unwrap();
    assert_eq!(episode.frames, known.frames[..120], "looking changes nothing");
    let seen = seen.lock().unwrap();
    assert_eq!(seen.len(), 4, "at 0, 0.5, 1 and 1.5 s");
    let mut painter = Painter::new(stage).unwrap();
    for (look, images) in seen.iter().enumerate() {
        assert_eq!(images.len(), 2);
        for request in requests() {
            let camera = stage.camera(&request).unwrap();
            let seed = sensor_seed(Seed::new(3), 30 * look);
            let drawn = painter.paint(&episode.frames[30 * look], &camera, request.channels, seed).unwrap();
            // Points that see nothing are not numbers, which are never equal.
            let bits = |image: &RgbdImage| image.points_m.iter().flatten().map(|v| v.to_bits()).collect::<Vec<_>>();
            let image = &images[&request.name];
            assert_eq!(bits(image), bits(&drawn), "{} at look {look}", request.name);
            let without = |image: &RgbdImage| RgbdImage { points_m: Vec::new(), ..image.clone() };
            assert!(without(image) == without(&drawn), "{} at look {look}: as drawn from the record", request.name);
        }
    }
    let pixels = |name: &str, look: usize| seen[look][name].rgb.clone();
    assert!(pixels("wrist", 0) != pixels("wrist", 3), "the hand has moved");
    let wrist = &seen[0]["wrist"];
    assert_eq!(
        (wrist.rgb.len(), wrist.normals.len(), wrist.points_m.len(), wrist.ids.len()),
        (96 * 54 * 3, 96 * 54, 96 * 54, 0)
    );
    assert!(wrist.points_m.iter().any(|point| point[2].abs() < 1e-3), "it sees the table's top at z = 0");
}

/// Before the first step and after the last, and the meshes of a stage are collected once.
#[test]
fn images_can_be_had_at_any_time() {
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
