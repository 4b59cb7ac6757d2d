//! Goal verdict by the original GenManip's method: on point clouds of the final scene, seen by the fixed cameras.

use genmanip_core::{
    Atom, Camera, CameraMount, CloudVerdict, Episode, Goal, ImageChannels, InstanceId, ReferenceId, RgbdImage,
};
use genmanip_relations::observed::clouds_of_views;
use genmanip_relations::{CloudScene, Rest};
use genmanip_render::FIRST_OBJECT;

use crate::images::{Exposure, StageRenderer};
use crate::{RolloutError, Stage};

/// Verdict on the point clouds at the end of an episode; `None` for goals about joint states, which clouds do not show,
/// for scenarios without a fixed camera, and for episodes without frames.
///
/// # Errors
/// If the scene cannot be rendered.
pub fn cloud_verdict(stage: &Stage, episode: &Episode) -> Result<Option<CloudVerdict>, RolloutError> {
    let is_fixed = |camera: &&Camera| camera.mount == CameraMount::World;
    // GenManip's clouds are rendered without sensor effects.
    let perfect = |camera: &Camera| Camera { sensor: None, distortion: None, ..camera.clone() };
    let cameras: Vec<Camera> = stage.scenario.world.cameras.iter().filter(is_fixed).map(perfect).collect();
    let Some(frame) = episode.frames.last().filter(|_| is_shown(&stage.goal) && !cameras.is_empty()) else {
        return Ok(None);
    };
    let channels = ImageChannels { rgb: false, depth: true, ids: true, ..ImageChannels::RGB };
    let mut renderer = StageRenderer::new(stage)?;
    let exposure = Exposure::still(episode.result.seed);
    let views = cameras.iter().map(|camera| renderer.render_frame(frame, camera, channels, exposure));
    let views = views.collect::<Result<Vec<_>, _>>()?;
    Ok(Some(verdict_of_views(stage, &views, None)))
}

/// True if clouds can show whether a goal holds: they show no joint states.
pub fn is_shown(goal: &Goal) -> bool {
    !goal.alternatives.iter().flatten().any(|atom| matches!(atom, Atom::State { .. }))
}

/// Verdict on images with depth and instance ids of the objects; `held` is the object in the gripper.
pub fn verdict_of_views(stage: &Stage, views: &[RgbdImage], held: Option<usize>) -> CloudVerdict {
    let ids: Vec<&InstanceId> = stage.scenario.objects.iter().map(|object| &object.id).collect();
    let instances: Vec<u16> = (0..ids.len()).map(|index| FIRST_OBJECT + index as u16).collect();
    let clouds = ids.iter().zip(clouds_of_views(views, &instances));
    let scene = CloudScene::new(clouds.filter_map(|(id, cloud)| Some(((*id).clone().into(), cloud?))));
    let named = stage.goal.alternatives.iter().flatten().flat_map(Atom::ids);
    let mut unseen: Vec<ReferenceId> = named.filter(|id| scene.index_of(id).is_none()).cloned().collect();
    unseen.sort();
    unseen.dedup();
    let held = held.and_then(|object| scene.index_of(&(*ids.get(object)?).clone().into()));
    let rest = Rest { held, ..Rest::default() };
    let verdict = scene.judge_goal(&stage.goal, &rest, &stage.relations);
    CloudVerdict { success: verdict.success, score: verdict.score, unseen }
}
