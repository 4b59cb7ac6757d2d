//! Candidate poses: sampled inside what the relations allow, kept only when every edge to a placed object holds.

use std::f64::consts::TAU;
use std::sync::Arc;

use genmanip_core::glam::{DVec2, DVec3};
use genmanip_core::{Aabb, GraphEdge, ObjectModel, Pose, Seed, Task};
use genmanip_scene::relations::{
    PosedObject, PosedScene, RelationSettings, ShapeCache, judge_atom, measure_pair, placement_window,
};
use rand::{Rng, RngExt};

use crate::LayoutSettings;
use crate::error::Rejections;
use crate::order::{PlacementPlan, Step};

/// What every draw of one task shares.
pub(crate) struct Context<'a> {
    pub task: &'a Task,
    pub models: &'a [Arc<ObjectModel>],
    pub plan: &'a PlacementPlan,
    pub settings: &'a LayoutSettings,
    pub relations: &'a RelationSettings,
}

/// One whole layout, objects in the order of the graph's nodes; `None` when some object found no place.
pub(crate) fn place_all(
    context: &Context,
    seed: Seed,
    shapes: &mut ShapeCache,
    rejections: &mut Rejections,
) -> Option<PosedScene> {
    let rng = &mut seed.rng();
    let origin = group_origin(context, rng);
    let mut scene = parked(context, shapes);
    let mut placed: Vec<usize> = Vec::new();
    for step in &context.plan.steps {
        let found = (0..context.settings.candidates_per_object).any(|_| {
            propose(context, step, origin, &placed, &mut scene, rng) && fits(context, step, &scene, &placed, rejections)
        });
        if !found {
            rejections.count(format!("no free place for {}", context.models[step.object].card.name));
            return None;
        }
        placed.push(step.object);
    }
    Some(scene)
}

/// All objects in their initial states, far from the table and from each other.
fn parked(context: &Context, shapes: &mut ShapeCache) -> PosedScene {
    let objects = context.models.iter().enumerate().map(|(index, model)| PosedObject {
        uid: model.card.uid.clone(),
        model: Arc::clone(model),
        pose: Pose::from_position(DVec3::new(-10.0 - index as f64, 0.0, 0.0)),
        joint_positions: initial_joints(context.task, index, model),
    });
    PosedScene::new(objects.collect(), shapes)
}

/// Joint positions of the object's initial state.
fn initial_joints(task: &Task, object: usize, model: &ObjectModel) -> Vec<f64> {
    let state = task.scene_graph.nodes[object].state.as_deref();
    state
        .and_then(|name| model.joint_states.iter().find(|state| state.name == name))
        .map_or_else(|| vec![0.0; model.joint_count()], |state| state.nominal.clone())
}

/// Where the first object goes, so that the sketch of the whole group fits the area.
fn group_origin(context: &Context, rng: &mut impl Rng) -> DVec2 {
    let (plan, settings) = (context.plan, context.settings);
    let mut draw = |area: [f64; 2], low: f64, high: f64| {
        let (from, to) = (area[0] - low, area[1] - high);
        let share = rng.random::<f64>();
        if from < to { from + (to - from) * share } else { (from + to) / 2.0 }
    };
    DVec2::new(
        draw(settings.x_m, plan.sketch_min.x, plan.sketch_max.x),
        draw(settings.y_m, plan.sketch_min.y, plan.sketch_max.y),
    )
}

/// Puts the object at a candidate pose; false when there is none.
fn propose(
    context: &Context,
    step: &Step,
    origin: DVec2,
    placed: &[usize],
    scene: &mut PosedScene,
    rng: &mut impl Rng,
) -> bool {
    let model = &context.models[step.object];
    let joints = initial_joints(context.task, step.object, model);
    // Articulated objects face the robot; everything else may be turned.
    let yaw = if model.card.is_articulated { rng.random_range(-0.25..0.25) } else { rng.random_range(0.0..TAU) };
    let bounds = model.world_bounds(&Pose::from_position_yaw(DVec3::ZERO, yaw), &joints);
    let (size, offset) = (bounds.size(), bounds.center().truncate());
    let at = |center: DVec2, z: f64| Pose::from_position_yaw((center - offset).extend(z), yaw);

    if let Some(support) = step.support {
        let Some(carrier) = scene.bounds(support) else { return false };
        let target = support_point(&carrier, size.truncate(), rng);
        scene.set_pose(step.object, at(target, carrier.max.z + 0.01 - bounds.min.z), &joints);
        return let_down(scene, step.object, support, context.settings.drop_m, context.relations);
    }
    let settings = context.settings;
    let mut low = DVec2::new(settings.x_m[0], settings.y_m[0]) + size.truncate() * 0.5;
    let mut high = DVec2::new(settings.x_m[1], settings.y_m[1]) - size.truncate() * 0.5;
    for &(relation, anchor) in &step.relations {
        let Some(anchor) = scene.bounds(anchor) else { return false };
        let Some(window) = placement_window(relation, &anchor, size, context.relations) else { return false };
        low = low.max(DVec2::new(window.x[0], window.y[0]));
        high = high.min(DVec2::new(window.x[1], window.y[1]));
    }
    if low.cmpgt(high).any() {
        return false;
    }
    let mut share = || rng.random::<f64>();
    let mut center = low + (high - low) * DVec2::new(share(), share());
    if placed.is_empty() {
        let spread = DVec2::new(share() - 0.5, share() - 0.5) * 0.04;
        center = (origin + step.sketch + spread).clamp(low, high);
    }
    scene.set_pose(step.object, at(center, -bounds.min.z), &joints);
    true
}

/// A point over the carrier where something of this size can lie, near the middle.
fn support_point(carrier: &Aabb, size: DVec2, rng: &mut impl Rng) -> DVec2 {
    let slack = ((carrier.size().truncate() - size) * 0.5 - DVec2::splat(0.02)).max(DVec2::ZERO) * 0.7;
    carrier.center().truncate() + slack * DVec2::new(rng.random_range(-1.0..1.0), rng.random_range(-1.0..1.0))
}

/// Lets an object that hovers above another down until `gap` metres remain; false when it is not above it.
pub(crate) fn let_down(
    scene: &mut PosedScene,
    object: usize,
    carrier: usize,
    gap: f64,
    relations: &RelationSettings,
) -> bool {
    let fall = measure_pair(scene, object, carrier, relations).and_then(|pair| pair.a_over_b);
    let Some((fall, posed)) = fall.zip(scene.objects().nth(object)) else { return false };
    let (mut pose, joints) = (posed.pose, posed.joint_positions.clone());
    pose.position.z -= fall.gap_m - gap;
    scene.set_pose(object, pose, &joints);
    true
}

/// Whether a candidate keeps its distance, its reach and every edge to what is placed.
fn fits(context: &Context, step: &Step, scene: &PosedScene, placed: &[usize], rejections: &mut Rejections) -> bool {
    let settings = context.settings;
    let uid = &context.models[step.object].card.uid;
    let shares_support = |other: usize| context.plan.support_of(other) == step.support;
    for &other in placed.iter().filter(|&&other| shares_support(other)) {
        let gap = measure_pair(scene, step.object, other, context.relations).map_or(0.0, |pair| pair.gap_m);
        if gap < settings.min_gap_m {
            rejections.count("too close to a neighbour");
            return false;
        }
    }
    let is_moved = context.task.goal.alternatives.iter().flatten().any(|atom| atom.subject() == uid);
    let radius = scene.bounds(step.object).map_or(0.0, |bounds| bounds.center().truncate().length());
    if is_moved && !(settings.reach_m[0]..=settings.reach_m[1]).contains(&radius) {
        rejections.count("out of reach");
        return false;
    }
    for edge in edges_between(context, uid, placed) {
        if edge.relation.is_support() {
            // Judged after settling, when it has come to rest.
            continue;
        }
        let verdict = judge_atom(scene, &edge.atom(), context.relations);
        if !verdict.holds || verdict.margin < settings.relation_margin_m {
            rejections.count_edge("an edge cannot be satisfied", &edge.atom());
            return false;
        }
    }
    true
}

/// Edges of the graph whose objects are all placed once this one is.
fn edges_between<'a>(context: &'a Context, uid: &'a str, placed: &'a [usize]) -> impl Iterator<Item = &'a GraphEdge> {
    let known = move |other: &str| other == uid || placed.iter().any(|&index| context.models[index].card.uid == other);
    context.task.scene_graph.edges.iter().filter(move |edge| {
        let members =
            || [Some(&edge.subject), Some(&edge.reference), edge.second_reference.as_ref()].into_iter().flatten();
        members().any(|member| member == uid) && members().all(|member| known(member))
    })
}
