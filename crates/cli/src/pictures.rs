//! Pictures the command line makes: film strips and drawings.

use genmanip_assets::Catalogue;
use genmanip_core::{Episode, GraphEdge, Scenario};
use genmanip_bench::drawing::{DrawnEdge, EdgeRole, Footprint, LayoutPicture, PANDA_REACH_M, color_of_word, graph_svg, layout_svg};
use genmanip_render::{Channels, encode};
use genmanip_rollout::{Stage, images::Painter};
use genmanip_scene::relations::PosedObject;

use crate::error::Failed;

/// `count` moments of an episode, seen by the `static` camera, as JPEG files.
pub fn stills(stage: &Stage, episode: &Episode, count: usize, width: u32) -> Result<Vec<Vec<u8>>, Failed> {
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
        .map(|frame| {
            let picture = painter.paint(frame, &camera, Channels::RGB).map_err(|error| failed(&error))?;
            encode::jpeg(&picture, 85).map_err(|error| failed(&error))
        })
        .collect()
}

/// The scene graph and the layout from above, beside each other.
pub fn graph_beside_layout(scenario: &Scenario, catalogue: &Catalogue) -> Result<String, Failed> {
    Ok(genmanip_bench::drawing::beside(&graph_svg(&scenario.task), &layout_svg(&layout_picture(scenario, catalogue)?)))
}

/// What the drawing of a layout shows.
pub fn layout_picture(scenario: &Scenario, catalogue: &Catalogue) -> Result<LayoutPicture, Failed> {
    let footprints = scenario
        .objects
        .iter()
        .map(|placed| {
            let model = catalogue.instance(placed).map_err(|error| {
                Failed::because(format!("cannot draw scenario {}", scenario.id), &error)
            })?;
            let color = model.card.colors.first().map_or([128; 3], |word| color_of_word(word));
            let object = PosedObject::new(model, placed.pose, placed.joint_positions.clone());
            let polygons = object
                .footprint()
                .iter()
                .map(|polygon| polygon.iter().map(|point| point.to_array()).collect())
                .collect();
            Ok(Footprint { uid: placed.uid.clone(), name: object.model.card.name.clone(), color, polygons })
        })
        .collect::<Result<Vec<_>, Failed>>()?;
    let edge = |edge: &GraphEdge, role| DrawnEdge { edge: edge.clone(), role };
    Ok(LayoutPicture {
        workspace: scenario.workspace,
        footprints,
        edges: scenario.task.scene_graph.edges.iter().map(|e| edge(e, EdgeRole::Initial)).collect(),
        reach_m: PANDA_REACH_M.to_vec(),
    })
}
