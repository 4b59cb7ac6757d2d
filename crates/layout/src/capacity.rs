//! What surely finds no room, told before anything is drawn: the footprints that must stand beside each other on a
//! surface or in a hollow, against the room there.
//!
//! Footprints that keep a gap from each other stay apart when each grows by half the gap, so their grown areas must fit
//! into the room grown as much. That is the least they need, however they are turned: what passes may still not fit.

use std::f64::consts::PI;

use genmanip_core::glam::DVec2;
use genmanip_core::{Aabb, Pose, Relation};
use genmanip_relations::PosedScene;

use crate::context::Context;

/// Things that must stand on one surface or in one object.
pub(crate) struct Overfull {
    /// The largest of them.
    pub object: usize,
    /// The edges that put them there, as indices.
    pub edges: Vec<usize>,
}

/// The first surface or object that has less room than the task's objects on it or in it need; `scene` holds all objects.
pub(crate) fn overfull(context: &Context, scene: &PosedScene) -> Option<Overfull> {
    let nodes = context.task.scene_graph.nodes.len();
    let grounds = (0..context.world.surfaces.len()).map(|ground| (None, ground));
    let carriers = (0..nodes).map(|carrier| (Some(carrier), 0));
    grounds.chain(carriers).find_map(|(carrier, ground)| {
        let stands_there = |object: usize| match carrier {
            None => context.grounds[object] == ground && context.support_of(object).is_none(),
            Some(carrier) => context.support_of(object) == Some(carrier),
        };
        let steps = || context.steps.iter().filter(|step| step.object < nodes && stands_there(step.object));
        let objects: Vec<usize> = steps().map(|step| step.object).collect();
        let is_in = steps().all(|step| step.support.is_none_or(|(_, relation)| relation == Relation::In));
        if objects.len() < 2 || !is_in {
            return None;
        }
        let gap = context.gap(objects[0], objects[1]);
        let area = |object: usize| grown_area(scene.outline(object).unwrap_or_default(), gap);
        let room = match carrier {
            None => ground_room(context, ground, gap),
            Some(carrier) => hollow_room(context, carrier, gap),
        };
        let needed: f64 = objects.iter().map(|&object| area(object)).sum();
        (needed > room).then(|| Overfull {
            object: objects.iter().copied().max_by(|&a, &b| area(a).total_cmp(&area(b))).unwrap_or(objects[0]),
            edges: steps().filter_map(|step| step.support_edge).collect(),
        })
    })
}

/// Room for objects on a surface, square metres.
fn ground_room(context: &Context, ground: usize, gap: f64) -> f64 {
    let settings = context.settings;
    let area = context.area(ground, context.world.workspace.within(settings.wide_x_m, settings.wide_y_m));
    let [x, y] = [area.x, area.y].map(|[low, high]| (high - low).max(0.0));
    rectangle(DVec2::new(x, y), gap)
}

/// Room in all hollows of an object together, square metres; of a hollow that is no box, of the box around it.
fn hollow_room(context: &Context, carrier: usize, gap: f64) -> f64 {
    let cavities = context.models[carrier].cavities(&context.joints[carrier]);
    let size = |piece| Aabb::from_pieces(&Pose::IDENTITY, [piece]).size().truncate();
    cavities.iter().map(|piece| rectangle(size(piece), gap)).sum()
}

fn rectangle(size: DVec2, gap: f64) -> f64 {
    grown_area(&[DVec2::ZERO, DVec2::new(size.x, 0.0), size, DVec2::new(0.0, size.y)], gap)
}

/// Area of a convex outline that grows by half a gap on all sides, after Steiner's formula.
fn grown_area(outline: &[DVec2], gap: f64) -> f64 {
    let sides = || outline.iter().zip(outline.iter().cycle().skip(1));
    let area = 0.5 * sides().map(|(a, b)| a.perp_dot(*b)).sum::<f64>().abs();
    let around: f64 = sides().map(|(a, b)| a.distance(*b)).sum();
    let by = 0.5 * gap;
    area + around * by + PI * by * by
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn outlines_grow_on_all_sides() {
        let square = [[0.0, 0.0], [0.2, 0.0], [0.2, 0.2], [0.0, 0.2]].map(DVec2::from);
        let grown = 0.2 * 0.2 + 4.0 * 0.2 * 0.01 + PI * 0.01 * 0.01;
        assert!((grown_area(&square, 0.02) - grown).abs() < 1e-12);
        assert!((rectangle(DVec2::splat(0.2), 0.02) - grown).abs() < 1e-12);
        // Four squares with gaps in two rows fill a square exactly, but for its corners.
        let needed = 4.0 * grown_area(&square, 0.02);
        assert!(needed <= rectangle(DVec2::splat(0.42), 0.02) && needed > rectangle(DVec2::splat(0.41), 0.02));
    }
}
