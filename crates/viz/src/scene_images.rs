//! Images of episodes and layouts: stills, film strips and diagrams.

use crate::drawing::color_of_word;
use crate::{DrawnEdge, EdgeRole, Footprint, PlaceWindow, Refusal, Svg, TopView, explain_svg};
use genmanip_assets::{AssetSource, robots};
use genmanip_core::glam::DVec2;
use genmanip_core::{
    Atom, Episode, ImageChannels, PlacedObject, ReferenceId, RgbdImage, Scenario, SupportSurface, Task, World,
};
use genmanip_layout::LayoutError;
use genmanip_relations::{PosedObject, PosedScene, ShapeCache, Window};
use genmanip_render::encode;
use genmanip_rollout::Stage;
use genmanip_rollout::images::{Exposure, StageRenderer};

use genmanip_workspace::{Cause, WorkspaceError};

/// Colour in diagrams of support surfaces other than the table, sRGB: a shade darker than the table's.
const SURFACE_COLOR: [u8; 3] = [226, 218, 205];

/// JPEG files of `count` evenly spaced moments of an episode, seen by the camera `static`; `painter` must be for the
/// episode's stage.
///
/// # Errors
/// When the scenario has no such camera, or a frame cannot be rendered.
pub fn stills(
    painter: &mut StageRenderer,
    episode: &Episode,
    count: usize,
    width: u32,
) -> Result<Vec<Vec<u8>>, WorkspaceError> {
    paint(painter, episode, count, width)?
        .iter()
        .map(|picture| jpeg(&episode.result.id, picture.width(), picture.height(), &picture.rgb))
        .collect()
}

/// One JPEG with `count` evenly spaced moments side by side, seen by the camera `static`.
///
/// # Errors
/// As [`stills`].
pub fn film_strip(stage: &Stage, episode: &Episode, count: usize) -> Result<Vec<u8>, WorkspaceError> {
    let pictures = paint(&mut painter(stage)?, episode, count, 384)?;
    let (width, height) = pictures.first().map_or((0, 0), |picture| (picture.width(), picture.height()));
    let mut rgb = Vec::with_capacity((width * height) as usize * 3 * pictures.len());
    for row in 0..height as usize {
        for picture in &pictures {
            let bytes = picture.width() as usize * 3;
            rgb.extend_from_slice(&picture.rgb[row * bytes..(row + 1) * bytes]);
        }
    }
    jpeg(&episode.result.id, width * pictures.len() as u32, height, &rgb)
}

/// Renderer for frames of a stage.
///
/// # Errors
/// When a mesh of the stage is invalid.
pub fn painter(stage: &Stage) -> Result<StageRenderer, WorkspaceError> {
    StageRenderer::new(stage).map_err(|error| not_drawn(&stage.scenario.id, error))
}

/// Error for an episode or scenario that cannot be rendered.
pub fn not_drawn(id: &str, error: impl Into<Cause>) -> WorkspaceError {
    WorkspaceError::broken(format!("cannot draw {id}"), error).with_hint(
        "it was changed, or recorded with other objects or another robot; `genmanip replay --check` says what is sound",
    )
}

fn paint(
    painter: &mut StageRenderer,
    episode: &Episode,
    count: usize,
    width: u32,
) -> Result<Vec<RgbdImage>, WorkspaceError> {
    let scenario = &episode.scenario;
    let camera = scenario
        .world
        .camera("static")
        .ok_or_else(|| WorkspaceError::input(format!("scenario {} has no camera `static`", scenario.id)))?;
    let camera = genmanip_core::Camera {
        intrinsics: camera.intrinsics.resized(width, width * camera.intrinsics.height / camera.intrinsics.width),
        ..camera.clone()
    };
    let last = episode.frames.len().saturating_sub(1);
    (0..count)
        .map(|index| last * index / count.saturating_sub(1).max(1))
        .filter_map(|index| episode.frames.get(index).map(|frame| (index, frame)))
        .map(|(index, frame)| {
            let exposure = Exposure::of(episode, index);
            let drawn = painter.render_frame(frame, &camera, ImageChannels::RGB, exposure);
            drawn.map_err(|error| not_drawn(&episode.result.id, error))
        })
        .collect()
}

fn jpeg(episode: &str, width: u32, height: u32, rgb: &[u8]) -> Result<Vec<u8>, WorkspaceError> {
    encode::jpeg_rgb(width, height, rgb, 85)
        .map_err(|error| WorkspaceError::broken(format!("cannot encode a picture of {episode}"), error))
}

/// Top view of a layout, to be drawn.
///
/// # Errors
/// When an object is not in the catalogue.
pub fn top_view(scenario: &Scenario, catalogue: &dyn AssetSource) -> Result<TopView, WorkspaceError> {
    let edges = scenario.task.scene_graph.edges.iter();
    Ok(TopView {
        workspace: scenario.world.workspace,
        footprints: footprints(&scenario.id, &scenario.objects, &scenario.world, catalogue)?,
        edges: edges.map(|edge| DrawnEdge { edge: edge.clone(), role: EdgeRole::Initial }).collect(),
        reach_m: reach_m(&scenario.world),
        windows: Vec::new(),
    })
}

/// Diagram of a scenario: the scene graph of its task beside the layout.
///
/// # Errors
/// When an object is not in the catalogue.
pub fn explained(scenario: &Scenario, catalogue: &dyn AssetSource) -> Result<Svg, WorkspaceError> {
    Ok(explain_svg(&scenario.task, &top_view(scenario, catalogue)?, None))
}

/// Diagram of a task without a layout: the objects placed in the furthest attempt, where each relation would allow the
/// next object, and the conflicting relations.
///
/// # Errors
/// When an object is not in the catalogue.
pub fn explained_refusal(
    task: &Task,
    error: &LayoutError,
    world: &World,
    catalogue: &dyn AssetSource,
) -> Result<Svg, WorkspaceError> {
    let name = |id: &ReferenceId| task.name_of(id);
    let describe = |atom: &Atom| match atom {
        Atom::Relation { subject, relation, reference, second_reference } => {
            let second = second_reference.iter().map(|id| format!(" and {}", name(id)));
            format!("{} {} {}{}", name(subject), relation.name(), name(reference), second.collect::<String>())
        }
        Atom::State { object, state } => format!("{} is {state}", name(object)),
    };
    let (mut refusal, mut placed, mut windows) = (Refusal::default(), Vec::new(), Vec::new());
    if let LayoutError::Infeasible { restarts, rejections, furthest, .. } = error {
        refusal.headline = format!("No layout in {restarts} attempts");
        refusal.reasons = rejections.reasons().into_iter().map(|(reason, count)| (reason.to_string(), count)).collect();
        let edges = rejections.conflicting_edges().into_iter();
        refusal.conflict_labels = edges.map(|(atom, count)| (describe(atom), count)).collect();
        refusal.conflicts = rejections.conflicting_edges().into_iter().map(|(atom, _)| atom.clone()).collect();
        if let Some(furthest) = furthest {
            refusal.headline += &format!(": no place for {}", name(&furthest.object));
            placed.clone_from(&furthest.placed);
            let window = |(atom, at): &(Atom, Window)| PlaceWindow { x: at.x, y: at.y, label: describe(atom) };
            windows = furthest.windows.iter().map(window).collect();
        }
    } else {
        refusal.headline = error.to_string();
    }
    let role = |atom: &Atom| if refusal.conflicts.contains(atom) { EdgeRole::Conflict } else { EdgeRole::Initial };
    let edges = task.scene_graph.edges.iter();
    let picture = TopView {
        workspace: world.workspace,
        footprints: footprints(&task.id, &placed, world, catalogue)?,
        edges: edges.map(|edge| DrawnEdge { role: role(&edge.atom()), edge: edge.clone() }).collect(),
        reach_m: reach_m(world),
        windows,
    };
    Ok(explain_svg(task, &picture, Some(&refusal)))
}

/// Reach of the world's robot that its manufacturer publishes, m; empty if unknown.
fn reach_m(world: &World) -> Vec<f64> {
    let robot = robots::named(&world.robot.name).ok();
    robot.and_then(|robot| robot.reach).map(|reach| reach.max_m).into_iter().collect()
}

/// Outlines, seen from above, of objects and of support surfaces other than the table.
fn footprints(
    of: &str,
    objects: &[PlacedObject],
    world: &World,
    catalogue: &dyn AssetSource,
) -> Result<Vec<Footprint>, WorkspaceError> {
    let mut shapes = ShapeCache::default();
    let footprint = |placed: &PlacedObject| {
        let model = catalogue.instance(placed).map_err(|error| {
            WorkspaceError::broken(format!("cannot draw object {} of {of}", placed.id), error)
                .with_hint("objects that were imported are in packs: name their folder with --packs")
        })?;
        let color = model.card.colors.first().map_or([128; 3], |word| color_of_word(word));
        let name = model.card.name.clone();
        let object = PosedObject {
            id: placed.id.clone(),
            model,
            pose: placed.pose,
            joint_positions: placed.joint_positions.clone(),
        };
        let scene = PosedScene::new(vec![object], &[], &mut shapes);
        let corners = |polygon: &[DVec2]| polygon.iter().map(|point| point.to_array()).collect();
        let polygons = scene.footprints(0).into_iter().map(corners).collect();
        Ok(Footprint { id: placed.id.clone().into(), name, color, polygons })
    };
    let surface = |surface: &SupportSurface| Footprint {
        id: surface.id.clone().into(),
        name: surface.name.clone(),
        color: SURFACE_COLOR,
        polygons: vec![surface.top_corners().iter().map(|corner| [corner.x, corner.y]).collect()],
    };
    let surfaces = world.surfaces.iter().skip(1).map(|further| Ok(surface(further)));
    surfaces.chain(objects.iter().map(footprint)).collect()
}
