//! Candidate poses: sampled inside what the relations allow, kept only when every edge to a placed object holds.

use std::f64::consts::TAU;
use std::sync::Arc;

use genmanip_core::glam::{DVec2, DVec3};
use genmanip_core::{GraphEdge, ObjectModel, Pose, Seed, Task};
use genmanip_scene::relations::{PosedObject, PosedScene, RelationSettings, judge_atom, placement_window};
use rand::{Rng, RngExt};

use crate::error::Rejections;
use crate::order::{PlacementPlan, Step};
use crate::LayoutSettings;

/// One whole layout, objects in the order of the graph's nodes; `None` when some object found no place.
pub(crate) fn place_all(
    plan: &PlacementPlan,
    task: &Task,
    models: &[Arc<ObjectModel>],
    seed: Seed,
    settings: &LayoutSettings,
    relations: &RelationSettings,
    rejections: &mut Rejections,
) -> Option<Vec<PosedObject>> {
    let rng = &mut seed.rng();
    let origin = group_origin(plan, settings, rng);
    let mut placed: Vec<Option<PosedObject>> = vec![None; models.len()];
    for step in &plan.steps {
        let model = &models[step.object];
        let joints = initial_joints(task, step.object, model);
        let found = (0..settings.candidates_per_object).find_map(|_| {
            let pose = candidate(step, model, &joints, origin, &placed, settings, relations, rng)?;
            let object = PosedObject::new(Arc::clone(model), pose, joints.clone());
            fits(step, &object, task, &placed, settings, relations, rejections).then_some(object)
        });
        match found {
            Some(object) => placed[step.object] = Some(object),
            None => {
                rejections.count(format!("no free place for {}", model.card.name));
                return None;
            }
        }
    }
    placed.into_iter().collect()
}

/// Joint positions of the object's initial state.
fn initial_joints(task: &Task, object: usize, model: &ObjectModel) -> Vec<f64> {
    let state = task.scene_graph.nodes[object].state.as_deref();
    state
        .and_then(|name| model.joint_states.iter().find(|state| state.name == name))
        .map_or_else(|| vec![0.0; model.joint_count()], |state| state.nominal.clone())
}

/// Where the first object goes, so that the sketch of the whole group fits the area.
fn group_origin(plan: &PlacementPlan, settings: &LayoutSettings, rng: &mut impl Rng) -> DVec2 {
    let axis = |area: [f64; 2], low: f64, high: f64, rng: &mut dyn FnMut() -> f64| {
        let (from, to) = (area[0] - low, area[1] - high);
        if from < to { from + (to - from) * rng() } else { (from + to) / 2.0 }
    };
    let mut draw = || rng.random::<f64>();
    DVec2::new(
        axis(settings.x_m, plan.sketch_min.x, plan.sketch_max.x, &mut draw),
        axis(settings.y_m, plan.sketch_min.y, plan.sketch_max.y, &mut draw),
    )
}

#[allow(clippy::too_many_arguments)] // all of it is read-only context of one draw
fn candidate(
    step: &Step,
    model: &Arc<ObjectModel>,
    joints: &[f64],
    origin: DVec2,
    placed: &[Option<PosedObject>],
    settings: &LayoutSettings,
    relations: &RelationSettings,
    rng: &mut impl Rng,
) -> Option<Pose> {
    // Articulated objects face the robot; everything else may be turned.
    let yaw = if model.card.is_articulated { rng.random_range(-0.25..0.25) } else { rng.random_range(0.0..TAU) };
    let upright = Pose::from_position_yaw(DVec3::ZERO, yaw);
    let bounds = model.world_bounds(&upright, joints);
    let (size, offset) = (bounds.size(), bounds.center().truncate());

    if let Some(support) = step.support {
        let support = placed[support].as_ref()?;
        let target = support_point(support, size.truncate(), rng);
        let above = Pose::from_position_yaw((target - offset).extend(0.0), yaw);
        return Some(resting_on(model, joints, &above, support, settings.drop_m));
    }

    let mut low = DVec2::new(settings.x_m[0], settings.y_m[0]) + size.truncate() * 0.5;
    let mut high = DVec2::new(settings.x_m[1], settings.y_m[1]) - size.truncate() * 0.5;
    if step.relations.is_empty() {
        let spread = DVec2::new(rng.random_range(-0.02..0.02), rng.random_range(-0.02..0.02));
        let free = placed.iter().any(Option::is_some);
        let center = if free {
            DVec2::new(lerp(low.x, high.x, rng.random()), lerp(low.y, high.y, rng.random()))
        } else {
            (origin + step.sketch + spread).clamp(low.min(high), high.max(low))
        };
        return Some(Pose::from_position_yaw((center - offset).extend(0.0), yaw));
    }
    for &(relation, anchor) in &step.relations {
        let anchor = placed[anchor].as_ref()?;
        let window = placement_window(relation, &anchor.bounds(), size, relations)?;
        low = low.max(DVec2::new(window.x[0], window.y[0]));
        high = high.min(DVec2::new(window.x[1], window.y[1]));
    }
    if low.cmpgt(high).any() {
        return None;
    }
    let center = DVec2::new(lerp(low.x, high.x, rng.random()), lerp(low.y, high.y, rng.random()));
    Some(Pose::from_position_yaw((center - offset).extend(0.0), yaw))
}

/// A point over the support where something of this size can lie, near the middle.
fn support_point(support: &PosedObject, size: DVec2, rng: &mut impl Rng) -> DVec2 {
    let bounds = support.bounds();
    let slack = ((bounds.size().truncate() - size) * 0.5 - DVec2::splat(0.02)).max(DVec2::ZERO) * 0.7;
    bounds.center().truncate()
        + DVec2::new(slack.x * rng.random_range(-1.0..1.0), slack.y * rng.random_range(-1.0..1.0))
}

/// The pose at which the object hovers `gap` above its support, found by bisection over exact distances.
pub(crate) fn resting_on(
    model: &Arc<ObjectModel>,
    joints: &[f64],
    pose: &Pose,
    support: &PosedObject,
    gap: f64,
) -> Pose {
    let at = |z: f64| Pose { position: pose.position.with_z(z), ..*pose };
    let touches = |z: f64| {
        PosedObject::new(Arc::clone(model), at(z), joints.to_vec()).distance(support) <= 0.0
    };
    let (mut low, mut high) = (support.bounds().min.z, support.bounds().max.z + 0.001);
    for _ in 0..14 {
        let middle = (low + high) / 2.0;
        if touches(middle) { low = middle } else { high = middle }
    }
    at(high + gap)
}

/// Whether a candidate keeps its distance, its reach and every edge to what is placed.
fn fits(
    step: &Step,
    object: &PosedObject,
    task: &Task,
    placed: &[Option<PosedObject>],
    settings: &LayoutSettings,
    relations: &RelationSettings,
    rejections: &mut Rejections,
) -> bool {
    let on_same_support = |other: usize| support_of(task, other) == step.support;
    for (index, other) in placed.iter().enumerate().filter_map(|(index, o)| Some((index, o.as_ref()?))) {
        if on_same_support(index) && object.gap_in_plane(other) < settings.min_gap_m {
            rejections.count("too close to a neighbour");
            return false;
        }
    }
    let is_moved = task.goal.alternatives.iter().flatten().any(|atom| atom.subject() == object.uid());
    let radius = object.bounds().center().truncate().length();
    if is_moved && !(settings.reach_m[0]..=settings.reach_m[1]).contains(&radius) {
        rejections.count("out of reach");
        return false;
    }
    let scene = PosedScene::new(placed.iter().flatten().cloned().chain([object.clone()]).collect());
    for edge in edges_between(task, object, placed) {
        let verdict = judge_atom(&scene, &edge.atom(), relations);
        let needed = if edge.relation.is_support() { 0.0 } else { settings.relation_margin_m };
        let settles_later = edge.relation.is_support();
        if !settles_later && (!verdict.holds || verdict.margin < needed) {
            rejections.count_edge("an edge cannot be satisfied", &edge.atom());
            return false;
        }
    }
    true
}

fn support_of(task: &Task, object: usize) -> Option<usize> {
    let uid = &task.scene_graph.nodes[object].uid;
    let edge = task.scene_graph.edges.iter().find(|edge| &edge.subject == uid && edge.relation.is_support())?;
    task.scene_graph.nodes.iter().position(|node| node.uid == edge.reference)
}

/// Edges of the graph whose objects are all placed once this one is.
fn edges_between<'a>(
    task: &'a Task,
    object: &'a PosedObject,
    placed: &'a [Option<PosedObject>],
) -> impl Iterator<Item = &'a GraphEdge> {
    let known = move |uid: &str| uid == object.uid() || placed.iter().flatten().any(|other| other.uid() == uid);
    task.scene_graph.edges.iter().filter(move |edge| {
        let members = [Some(&edge.subject), Some(&edge.reference), edge.second_reference.as_ref()];
        members.iter().flatten().any(|uid| *uid == object.uid()) && members.iter().flatten().all(|uid| known(uid))
    })
}

fn lerp(from: f64, to: f64, t: f64) -> f64 {
    from + (to - from) * t
}
