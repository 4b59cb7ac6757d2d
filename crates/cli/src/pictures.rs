//! Pictures the command line makes: film strips and drawings.

use genmanip_assets::Catalogue;
use genmanip_bench::drawing::{PANDA_REACH_M, color_of_word};
use genmanip_bench::{DrawnEdge, EdgeRole, Footprint, LayoutPicture};
use genmanip_core::{Episode, GraphEdge, Scenario};
use genmanip_render::{Channels, FrameBuffers, encode};
use genmanip_rollout::{Stage, images::Painter};
use genmanip_scene::relations::{PosedObject, PosedScene, ShapeCache};

use crate::error::Failed;

/// `count` moments of an episode, seen by the `static` camera, as JPEG files.
pub fn stills(stage: &Stage, episode: &Episode, count: usize, width: u32) -> Result<Vec<Vec<u8>>, Failed> {
    paint(stage, episode, count, width)?
        .iter()
        .map(|picture| jpeg(&episode.result.id, picture.width, picture.height, &picture.rgb))
        .collect()
}

fn jpeg(episode: &str, width: u32, height: u32, rgb: &[u8]) -> Result<Vec<u8>, Failed> {
    encode::jpeg_rgb(width, height, rgb, 85)
        .map_err(|error| Failed::because(format!("cannot encode a picture of {episode}"), &error))
}

fn paint(stage: &Stage, episode: &Episode, count: usize, width: u32) -> Result<Vec<FrameBuffers>, Failed> {
    let failed = |error: &dyn std::error::Error| Failed::because(format!("cannot draw {}", episode.result.id), error);
    let camera = episode
        .scenario
        .cameras
        .iter()
        .find(|camera| camera.name == "static")
        .ok_or_else(|| Failed::new(format!("scenario {} has no camera `static`", episode.scenario.id)))?;
    let camera = genmanip_core::Camera {
        intrinsics: camera.intrinsics.resized(width, width * camera.intrinsics.height / camera.intrinsics.width),
        ..camera.clone()
    };
    let mut painter = Painter::new(stage).map_err(|error| failed(&error))?;
    let last = episode.frames.len().saturating_sub(1);
    (0..count)
        .filter_map(|index| episode.frames.get(last * index / count.saturating_sub(1).max(1)))
        .map(|frame| painter.paint(frame, &camera, Channels::RGB).map_err(|error| failed(&error)))
        .collect()
}

/// `count` moments beside each other as one JPEG.
pub fn film_strip(stage: &Stage, episode: &Episode, count: usize) -> Result<Vec<u8>, Failed> {
    let pictures = paint(stage, episode, count, 384)?;
    let (width, height) = pictures.first().map_or((0, 0), |picture| (picture.width, picture.height));
    let mut rgb = Vec::with_capacity((width * height) as usize * 3 * pictures.len());
    for row in 0..height as usize {
        for picture in &pictures {
            let bytes = picture.width as usize * 3;
            rgb.extend_from_slice(&picture.rgb[row * bytes..(row + 1) * bytes]);
        }
    }
    jpeg(&episode.result.id, width * pictures.len() as u32, height, &rgb)
}

/// What the drawing of a layout shows.
pub fn layout_picture(scenario: &Scenario, catalogue: &Catalogue) -> Result<LayoutPicture, Failed> {
    let mut shapes = ShapeCache::default();
    let footprints = scenario
        .objects
        .iter()
        .map(|placed| {
            let model = catalogue
                .instance(placed)
                .map_err(|error| Failed::because(format!("cannot draw scenario {}", scenario.id), &error))?;
            let color = model.card.colors.first().map_or([128; 3], |word| color_of_word(word));
            let name = model.card.name.clone();
            let object = PosedObject {
                uid: placed.uid.clone(),
                model,
                pose: placed.pose,
                joint_positions: placed.joint_positions.clone(),
            };
            let scene = PosedScene::new(vec![object], &mut shapes);
            let polygons = scene
                .footprints(0)
                .into_iter()
                .map(|polygon| polygon.iter().map(|point| point.to_array()).collect())
                .collect();
            Ok(Footprint { uid: placed.uid.clone(), name, color, polygons })
        })
        .collect::<Result<Vec<_>, Failed>>()?;
    let edge = |edge: &GraphEdge, role| DrawnEdge { edge: edge.clone(), role };
    Ok(LayoutPicture {
        workspace: scenario.workspace,
        footprints,
        edges: scenario.task.scene_graph.edges.iter().map(|e| edge(e, EdgeRole::Initial)).collect(),
        reach_m: vec![PANDA_REACH_M],
    })
}
