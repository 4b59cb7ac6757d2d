//! Early rejection of tasks that cannot fit: total footprint of the objects on a surface or in a cavity against its
//! area.
//!
//! Footprints separated by a gap stay disjoint if each is dilated by half the gap, so the sum of dilated areas must not
//! exceed the dilated available area. This bound is necessary, not sufficient, and independent of orientation.

use std::f64::consts::PI;

use genmanip_core::glam::DVec2;
use genmanip_core::{Aabb, Pose};
use genmanip_relations::PosedScene;

use crate::context::Context;

/// Objects that exceed the capacity of one surface or container.
pub(crate) struct Overfull {
    /// Index of the largest of the objects.
    pub object: usize,
    /// Indices of the support edges of these objects.
    pub edges: Vec<usize>,
}

/// First surface or container whose capacity is exceeded, `None` if there is none; `scene` contains all objects.
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
        let is_in = steps().all(|step| step.support.is_none_or(|(_, relation)| relation.is_inside()));
        if objects.len() < 2 || !is_in {
            return None;
        }
        let gap = context.gap(objects[0], objects[1]);
        let area = |object: usize| dilated_area(scene.outline(object).unwrap_or_default(), gap);
        let available = match carrier {
            None => surface_area(context, ground, gap),
            Some(carrier) => cavity_area(context, carrier, gap),
        };
        let needed: f64 = objects.iter().map(|&object| area(object)).sum();
        (needed > available).then(|| Overfull {
            object: objects.iter().copied().max_by(|&a, &b| area(a).total_cmp(&area(b))).unwrap_or(objects[0]),
            edges: steps().filter_map(|step| step.support_edge).collect(),
        })
    })
}

/// Available area on a surface, dilated by half the gap [m²].
fn surface_area(context: &Context, ground: usize, gap: f64) -> f64 {
    let settings = context.settings;
    let area = context.area(ground, settings.area(&context.world.workspace, context.robot.reach_scale(), true));
    let [x, y] = [area.x, area.y].map(|[low, high]| (high - low).max(0.0));
    rectangle(DVec2::new(x, y), gap)
}

/// Total area of an object's cavities, each dilated by half the gap [m²]; cavities that are not boxes count with their
/// bounding box.
fn cavity_area(context: &Context, carrier: usize, gap: f64) -> f64 {
    let cavities = context.models[carrier].cavities(&context.joints[carrier]);
    let size = |piece| Aabb::from_pieces(&Pose::IDENTITY, [piece]).size().truncate();
    cavities.iter().map(|piece| rectangle(size(piece), gap)).sum()
}

fn rectangle(size: DVec2, gap: f64) -> f64 {
    dilated_area(&[DVec2::ZERO, DVec2::new(size.x, 0.0), size, DVec2::new(0.0, size.y)], gap)
}

/// Area of a convex outline dilated by half a gap (Steiner's formula) [m²].
fn dilated_area(outline: &[DVec2], gap: f64) -> f64 {
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
        let dilated = 0.2 * 0.2 + 4.0 * 0.2 * 0.01 + PI * 0.01 * 0.01;
        assert!((dilated_area(&square, 0.02) - dilated).abs() < 1e-12);
        assert!((rectangle(DVec2::splat(0.2), 0.02) - dilated).abs() < 1e-12);
        // Four squares with gaps, in two rows, need exactly the dilated large square except for its rounded corners.
        let needed = 4.0 * dilated_area(&square, 0.02);
        assert!(needed <= rectangle(DVec2::splat(0.42), 0.02) && needed > rectangle(DVec2::splat(0.41), 0.02));
    }
}
