//! Whether the cameras see what matters: each task object large enough and not hidden in at least one of them.

use std::sync::Arc;

use genmanip_core::glam::DVec3;
use genmanip_core::{Camera, Pose, RobotModel};
use genmanip_render::{
    Channels, Environment, FIRST_OBJECT, FrameBuffers, RenderAssets, RenderVariation, Renderer, ViewJob,
};
use genmanip_scene::relations::PosedScene;

use crate::LayoutSettings;

/// Cameras of prompt-based systems, which must see the objects.
const PROMPT_CAMERAS: [&str; 3] = ["overview", "left", "right"];

/// The reason when some object is too small or too hidden in every prompt camera.
pub(crate) fn hidden(scene: &PosedScene, robot: &Arc<RobotModel>, settings: &LayoutSettings) -> Option<String> {
    let models: Vec<_> = scene.objects().map(|object| Arc::clone(&object.model)).collect();
    let assets = RenderAssets::new(Arc::clone(robot), &models, &Environment::default()).ok()?;
    let mut renderer = Renderer::new(Arc::clone(&assets), RenderVariation::default());
    let cameras: Vec<Camera> =
        Camera::default_rig().into_iter().filter(|camera| PROMPT_CAMERAS.contains(&camera.name.as_str())).collect();
    let away = Pose::from_position(DVec3::new(0.0, 0.0, -50.0));
    // Everything, or one object alone on the table with the robot out of the way.
    let mut ids = |alone: Option<usize>| -> Option<Vec<FrameBuffers>> {
        let poses = scene.objects().enumerate().map(|(index, object)| {
            let shown = alone.is_none_or(|alone| alone == index);
            (if shown { object.pose } else { away }, object.joint_positions.as_slice())
        });
        let mut state = assets.frame_state(&robot.home, robot.gripper.max_width, poses).ok()?;
        if alone.is_some() {
            state.body_poses[..robot.links.len()].fill(away);
        }
        let jobs: Vec<ViewJob> =
            cameras.iter().map(|camera| ViewJob::new(&state, camera, Channels::GEOMETRY)).collect();
        let mut buffers = vec![FrameBuffers::default(); jobs.len()];
        renderer.render(&jobs, &mut buffers).ok()?;
        Some(buffers)
    };
    let count = |picture: &FrameBuffers, object: usize| {
        let wanted = FIRST_OBJECT + object as u16;
        picture.instance.iter().filter(|&&id| id == wanted).count()
    };
    let together = ids(None)?;
    for (index, object) in scene.objects().enumerate() {
        let alone = ids(Some(index))?;
        let seen = together.iter().zip(&alone).any(|(together, alone)| {
            let (visible, whole) = (count(together, index), count(alone, index));
            visible >= settings.min_pixels && visible as f64 >= settings.min_visible_share * whole as f64
        });
        if !seen {
            return Some(format!("{} is not seen by any prompt camera", object.model.card.name));
        }
    }
    None
}
