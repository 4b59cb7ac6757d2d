//! Images of the rasteriser.

use divan::Bencher;
use genmanip::core::{CameraRequest, ImageChannels, Seed};
use genmanip::rollout::images::{Exposure, StageRenderer};
use genmanip::workspace::scenarios::read_stage;

/// A scenario of the frozen suite.
pub const SCENARIO: &str = "suites/genmanip-200-rc/scenarios/001_long_horizon-000.json";

/// Colour and depth of the initial state; the renderer keeps what did not change, as during an episode.
#[divan::bench(args = ["static", "wrist"], sample_count = 20)]
fn rgbd_512x288(bencher: Bencher, camera: &str) {
    let stage = read_stage(&crate::repository(SCENARIO)).expect("the suite's scenarios are those of this program");
    let camera = stage.camera(&CameraRequest::new(camera, ImageChannels::RGBD).sized(512, 288)).expect("a data camera");
    let mut renderer = StageRenderer::new(&stage).expect("valid meshes");
    let views = [(&camera, ImageChannels::RGBD)];
    bencher.bench_local(|| {
        let objects = stage.scenario.objects.iter().map(|object| (object.pose, object.joint_positions.as_slice()));
        let arm = &stage.scenario.world.robot.home;
        renderer.render_state(arm, 0.08, objects, &views, Exposure::still(Seed::new(0))).expect("an image")
    });
}
