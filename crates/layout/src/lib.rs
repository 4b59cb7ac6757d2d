//! Layout: turns a task into a scenario with initial object poses.
//!
//! Objects are placed in topological order of support. Each candidate pose is checked against every edge to the objects
//! placed so far. The complete layout is settled in physics without a robot and then validated: every edge of the
//! initial graph holds, no alternative of the goal holds yet, nothing penetrates or moves, the objects to be moved are
//! reachable and visible to a camera. The number of attempts is bounded, and every rejection is counted by its reason.

mod add_distractors;
pub mod articulation;
mod attempt;
mod audit;
#[cfg(test)]
mod audit_tests;
mod between;
mod capacity;
mod context;
mod distractors;

mod constraint_network;
mod error;
mod goal_pose;
#[cfg(test)]
mod goal_pose_tests;
mod moves;
pub mod obstacles;
mod order;
mod placed_object;
mod placement;
mod reach;
mod rejection;
mod sampled_layout;
mod settings;
mod visibility;

pub use add_distractors::add_distractors;
pub use audit::{AuditError, Drift, LayoutAudit, Overlap, audit, first_drift, overlaps, posed};
pub use distractors::is_harmless;
pub use error::{LayoutError, Unfinished};
pub use goal_pose::{GoalOrder, GoalPose, GoalSearch};
pub use moves::{Move, moves};
pub use reach::ReachCheck;
pub use rejection::{NamedObject, Rejection, Rejections};
pub use settings::{GoalPoseSettings, LayoutSettings};
pub use visibility::{Hidden, hidden};

use attempt::AttemptError;
use context::{Context, GoalRegion};
use genmanip_assets::{AssetSource, GraspLibrary};
use genmanip_core::{
    Atom, Goal, InstanceId, ObjectModel, ReferenceId, Relation, RobotModel, Scenario, Seed, Task, VerifiedGrasp,
    Workspace, World,
};
use genmanip_motion::Planner;
use genmanip_relations::{
    PosedObject, PosedScene, Rest, ShapeCache, judge_edges, judge_goal, judge_states, placement_window,
};
use placed_object::placed_object;
use placement::Partial;

/// Number of failed layouts after which objects are aligned with the table's edges and distractors use the smaller gap
/// of other objects, which takes less space. Chosen: random orientations look more natural.
const ALIGNED_AFTER: usize = 10;

/// Maximum number of candidate poses hidden from all cameras, mostly inside a container, before the task is rejected.
/// Chosen: each check takes about 5 ms, and a rejection should take less than 5 s.
const MAX_HIDDEN: usize = 250;

/// Maximum number of layouts in which the arm cannot bring a joint into its state before the task is rejected. Chosen:
/// each costs 0.2 s, so that a rejection takes less than 5 s; all 120 designed tasks of seed 680201 are still laid out.
const MAX_UNREACHABLE_STATES: usize = 15;

/// Phase of a layout attempt, in order.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Phase {
    /// Builds models and reads the graph.
    Preparing,
    /// Samples poses of the objects.
    Placing,
    /// Simulates the layout until it is at rest.
    Settling,
    /// Evaluates edges, states and goal of the settled layout.
    Judging,
    /// Checks grasps and free space at the goal.
    Reaching,
    /// Checks the visibility of the task's objects.
    Seeing,
}

/// Creates a layout of a task for the planner's robot. `grasps` are tried before new ones are sampled.
///
/// The same task, seed and settings give the same scenario, byte for byte.
///
/// # Errors
/// [`LayoutError::UnknownObject`] for an asset missing from the source; [`LayoutError::StaleGrasps`] and
/// [`LayoutError::Render`] for defects, see [`LayoutError::is_defect`]; [`LayoutError::Infeasible`] if every attempt
/// was rejected, with the counted reasons and the edges that were hardest to satisfy.
pub fn lay_out(
    task: &Task,
    assets: &dyn AssetSource,
    world: &World,
    planner: &Planner,
    grasps: &GraspLibrary,
    seed: Seed,
    settings: &LayoutSettings,
) -> Result<Scenario, LayoutError> {
    lay_out_observed(task, assets, world, planner, grasps, seed, settings, &mut |_| ())
}

/// Like [`lay_out`]; calls `begin` at the start of each phase.
///
/// # Errors
/// As [`lay_out`].
#[expect(clippy::too_many_arguments, reason = "input, what every layout has, seed, settings, and who measures")]
pub fn lay_out_observed(
    task: &Task,
    assets: &dyn AssetSource,
    world: &World,
    planner: &Planner,
    grasps: &GraspLibrary,
    seed: Seed,
    settings: &LayoutSettings,
    begin: &mut dyn FnMut(Phase),
) -> Result<Scenario, LayoutError> {
    begin(Phase::Preparing);
    let models = task
        .scene_graph
        .nodes
        .iter()
        .map(|node| assets.model(&node.asset).map_err(LayoutError::from))
        .collect::<Result<Vec<_>, _>>()?;
    check_robot(world, planner.robot())?;
    let known_grasps = models.iter().map(|model| grasps.of(planner.robot(), model)).collect::<Result<Vec<_>, _>>();
    let known_grasps = known_grasps.map_err(LayoutError::StaleGrasps)?;
    check_surfaces(task, world)?;
    let edges = indexed_edges(task)?;
    let id = |index: usize| task.scene_graph.nodes[index].id.clone();
    task.check_interchangeable()?;
    let goal = task.judged_goal();
    let mut context = Context {
        task,
        goal: &goal,
        joints: models.iter().enumerate().map(|(index, model)| initial_joints(task, index, model)).collect(),
        moved: task.scene_graph.nodes.iter().map(|node| is_moved(&goal, &node.id)).collect(),
        goal_regions: goal_regions(task, &goal, world),
        goal_betweens: goal_betweens(task, &goal),
        goal_sides: goal_sides(task, &goal),
        distractor_gap_m: settings.distractor_gap_m,
        robot: planner.robot(),
        grounds: grounds(&edges, models.len(), world),
        steps: order::steps(&edges, models.len(), id)?,
        models,
        edges,
        settings,
        world,
        reach_m: reach_m(world, planner.robot()),
        relations: &world.relations,
    };
    let (mut rejections, mut furthest, mut shapes) = (Rejections::default(), None, ShapeCache::default());
    if let Some(overfull) = capacity::overfull(&context, &placement::parked(&context, &mut shapes)) {
        return Err(overfull_error(&mut context, &overfull, seed, &mut shapes, assets));
    }
    let (mut restarts, mut unaccepted, mut unreachable_states) = (0, 0, 0);
    for restart in 0..settings.max_restarts {
        restarts += 1;
        begin(Phase::Placing);
        let attempt = seed.fork("layout").fork_index(restart as u64);
        let aligned = restart >= ALIGNED_AFTER;
        let sampled = distractors::sample(task, assets.cards(), settings.distractors, attempt);
        let models = sampled.iter().map(|asset| assets.model(asset)).collect::<Result<Vec<_>, _>>()?;
        context.set_distractors(models);
        if aligned {
            context.distractor_gap_m = settings.min_gap_m.min(settings.distractor_gap_m);
        }
        match placement::place_all(&context, attempt, aligned, &mut shapes, &mut rejections) {
            Ok(mut scene) => {
                match accept(&context, &mut scene, planner, &known_grasps, attempt, &mut rejections, begin) {
                    Ok(()) => return scenario(task, seed, &scene, assets, world),
                    Err(AttemptError::Defect(error)) => return Err(error),
                    Err(AttemptError::Rejected(reason)) => {
                        unreachable_states += usize::from(matches!(reason, Rejection::UnreachableState { .. }));
                        rejections.count(reason);
                        unaccepted += 1;
                        if unaccepted >= settings.max_unaccepted || unreachable_states >= MAX_UNREACHABLE_STATES {
                            break;
                        }
                    }
                }
            }
            Err(partial) => {
                keep_furthest(&mut furthest, partial);
                if rejections.most_unseen() >= MAX_HIDDEN {
                    break;
                }
            }
        }
    }
    let furthest = match &furthest {
        Some(partial) => unfinished(&context, partial, assets),
        None => without_conflicts(&mut context, seed, &rejections, &mut shapes, assets),
    };
    let furthest = furthest.map(Box::new);
    Err(LayoutError::Infeasible { task: task.id.clone(), restarts, rejections, furthest })
}

/// Error for a task whose objects cannot fit, in the form of a failed search.
fn overfull_error(
    context: &mut Context,
    overfull: &capacity::Overfull,
    seed: Seed,
    shapes: &mut ShapeCache,
    assets: &dyn AssetSource,
) -> LayoutError {
    let mut rejections = Rejections::default();
    let node = &context.task.scene_graph.nodes[overfull.object];
    let name = context.models[overfull.object].card.name.clone();
    rejections.count(Rejection::TooClose);
    rejections.count(Rejection::NoPlace(NamedObject { id: node.id.clone(), name }));
    overfull.edges.iter().for_each(|&edge| rejections.blame(&context.edges[edge].0));
    let furthest = without_conflicts(context, seed, &rejections, shapes, assets).map(Box::new);
    LayoutError::Infeasible { task: context.task.id.clone(), restarts: 0, rejections, furthest }
}

/// Settles a layout and validates it; the error is the reason for a rejection.
fn accept(
    context: &Context,
    scene: &mut PosedScene,
    planner: &Planner,
    known_grasps: &[&[VerifiedGrasp]],
    seed: Seed,
    rejections: &mut Rejections,
    begin: &mut dyn FnMut(Phase),
) -> Result<(), AttemptError> {
    let Context { task, goal, settings, world, relations, .. } = *context;
    let holds_goal = |scene: &PosedScene| judge_goal(scene, goal, &Rest::default(), relations).success;
    if holds_goal(scene) {
        return Err(Rejection::GoalHolds.into());
    }
    begin(Phase::Settling);
    audit::settle(scene, world, settings)?;
    begin(Phase::Judging);
    let edges = judge_edges(scene, &task.scene_graph, relations);
    if let Some(verdict) = edges.iter().find(|verdict| !verdict.holds) {
        rejections.blame(&verdict.atom);
        return Err(Rejection::EdgeLost.into());
    }
    if let Some(verdict) = judge_states(scene, &task.scene_graph, relations).iter().find(|verdict| !verdict.holds) {
        return Err(Rejection::StateLost(verdict.atom.clone()).into());
    }
    if holds_goal(scene) {
        return Err(Rejection::GoalHolds.into());
    }
    begin(Phase::Reaching);
    let reach = ReachCheck { scene, world, planner, settings, known_grasps, seed };
    if let Some(reason) = reach.at_home().or_else(|| reach.unreachable(goal)) {
        return Err(reason.into());
    }
    begin(Phase::Seeing);
    let first_hidden = visibility::first_hidden(scene, world, task.scene_graph.nodes.len(), planner.robot(), settings);
    if let Some(reason) = first_hidden.map_err(|error| AttemptError::Defect(error.into()))? {
        return Err(reason.into());
    }
    // The stability check comes last, because it is slow and rarely rejects.
    begin(Phase::Settling);
    audit::check_stability(scene, world, settings)
}

/// Checks that the planner's robot and home configuration match the world.
fn check_robot(world: &World, robot: &RobotModel) -> Result<(), LayoutError> {
    let wanted = &world.robot;
    let differs =
        |field: &'static str, expected: String, got: String| Err(LayoutError::OtherRobot { field, expected, got });
    if wanted.name != robot.name {
        return differs("robot.name", wanted.name.clone(), robot.name.clone());
    }
    if wanted.home != robot.home {
        return differs("robot.home", format!("{:?}", wanted.home), format!("{:?}", robot.home));
    }
    Ok(())
}

/// Minimum and maximum distance of a moved object from the robot's axis (m); the whole workspace if the reach is
/// unknown.
fn reach_m(world: &World, robot: &RobotModel) -> [f64; 2] {
    let Workspace { x, y } = world.workspace;
    let corner = x[0].abs().max(x[1].abs()).hypot(y[0].abs().max(y[1].abs()));
    robot.reach.map_or([0.0, corner], |reach| reach.from_above_m)
}

/// Checks that the world has every surface of the task and that no object id equals a surface id.
fn check_surfaces(task: &Task, world: &World) -> Result<(), LayoutError> {
    if let Some(missing) = task.surfaces.iter().find(|named| world.further_surface(&named.id).is_none()) {
        let known = world.named_surfaces().into_iter().map(|surface| surface.id).collect();
        return Err(LayoutError::UnknownSurface { id: missing.id.clone(), known });
    }
    match task.scene_graph.nodes.iter().find(|node| world.surface(&node.id).is_some()) {
        Some(node) => Err(LayoutError::ObjectLikeSurface { id: node.id.clone() }),
        None => Ok(()),
    }
}

/// Per object, the index of the support surface below it, directly or through its carriers.
fn grounds(edges: &[(Atom, Vec<usize>)], count: usize, world: &World) -> Vec<usize> {
    let of_edge = |(atom, indices): &(Atom, Vec<usize>)| match atom {
        Atom::Relation { relation, reference, .. } if relation.is_support() => {
            let surface = world.further_surface(reference);
            Some((*indices.first()?, surface, indices.get(1).copied()))
        }
        _ => None,
    };
    let supports: Vec<_> = edges.iter().filter_map(of_edge).collect();
    let ground = |mut object: usize| {
        // Support cycles are reported elsewhere; here the limit only makes the loop end.
        for _ in 0..count {
            match supports.iter().find(|(subject, ..)| *subject == object) {
                Some((_, Some(surface), _)) => return *surface,
                Some((_, None, Some(carrier))) => object = *carrier,
                _ => return 0,
            }
        }
        0
    };
    (0..count).map(ground).collect()
}

/// Edges of the graph with the node indices of their objects, subject first; surfaces get no index.
fn indexed_edges(task: &Task) -> Result<Vec<(Atom, Vec<usize>)>, LayoutError> {
    let graph = &task.scene_graph;
    let index_of = |id: &ReferenceId, edge: &Atom| {
        let found = graph.index_of(id);
        found.ok_or_else(|| LayoutError::NotANode { edge: edge.to_string(), id: id.clone() })
    };
    graph
        .edges
        .iter()
        .map(|edge| {
            let atom = edge.atom();
            let ids = atom
                .ids()
                .enumerate()
                .filter(|(place, id)| *place == 0 || task.surface(id).is_none())
                .map(|(_, id)| id);
            let indices = ids.map(|id| index_of(id, &atom)).collect::<Result<Vec<_>, _>>()?;
            Ok((atom, indices))
        })
        .collect()
}

fn is_moved(goal: &Goal, id: &InstanceId) -> bool {
    let atoms = || goal.alternatives.iter().flatten();
    atoms().any(|atom| matches!(atom, Atom::Relation { .. }) && atom.subject() == id)
}

/// Per goal alternative, the target regions of moved objects relative to objects and surfaces that stay.
fn goal_regions(task: &Task, goal: &Goal, world: &World) -> Vec<Vec<GoalRegion>> {
    let index_of = |id: &ReferenceId| task.scene_graph.index_of(id);
    let of_alternative = |atoms: &Vec<Atom>| {
        let mut regions: Vec<GoalRegion> = Vec::new();
        for atom in atoms {
            let Atom::Relation { subject, relation, reference, .. } = atom else { continue };
            let moves = |id: &ReferenceId| {
                atoms.iter().any(|atom| matches!(atom, Atom::Relation { .. }) && *atom.subject() == *id)
            };
            let surface = world.further_surface(reference);
            let (Some(object), anchor) = (index_of(subject), index_of(reference)) else { continue };
            if moves(reference) || relation.has_two_references() || (anchor.is_none() && surface.is_none()) {
                continue;
            }
            let at = regions.iter().position(|region| region.object == object).unwrap_or_else(|| {
                regions.push(GoalRegion { object, anchors: Vec::new(), surfaces: Vec::new() });
                regions.len() - 1
            });
            regions[at].anchors.extend(anchor.map(|anchor| (*relation, anchor)));
            regions[at].surfaces.extend(surface.map(|surface| (*relation, surface)));
        }
        regions
    };
    goal.alternatives.iter().map(of_alternative).collect()
}

/// Per goal alternative, the `between` relations with two references that stay.
fn goal_betweens(task: &Task, goal: &Goal) -> Vec<Vec<[usize; 3]>> {
    let index_of = |id: &ReferenceId| task.scene_graph.index_of(id);
    let of_alternative = |atoms: &Vec<Atom>| {
        let moves = |id: &ReferenceId| atoms.iter().any(|atom| *atom.subject() == *id);
        let wanted = atoms.iter().filter_map(|atom| match atom {
            Atom::Relation { subject, relation: Relation::Between, reference, second_reference: Some(second) }
                if !moves(reference) && !moves(second) =>
            {
                Some([index_of(subject)?, index_of(reference)?, index_of(second)?])
            }
            _ => None,
        });
        wanted.collect()
    };
    goal.alternatives.iter().map(of_alternative).collect()
}

/// Goal alternatives with only directional relations, which can be evaluated before settling.
fn goal_sides(task: &Task, goal: &Goal) -> Vec<(Vec<Atom>, Vec<usize>)> {
    let is_side = |atom: &Atom| matches!(atom, Atom::Relation { relation, .. } if !relation.is_support());
    let sides = goal.alternatives.iter().filter(|atoms| atoms.iter().all(is_side));
    sides
        .map(|atoms| {
            let ids = atoms.iter().flat_map(Atom::ids);
            (atoms.clone(), ids.filter_map(|id| task.scene_graph.index_of(id)).collect())
        })
        .collect()
}

/// Joint positions of an object's initial state, which are all 0 without a state.
fn initial_joints(task: &Task, object: usize, model: &ObjectModel) -> Vec<f64> {
    let state = task.scene_graph.nodes.get(object).and_then(|node| node.state.as_deref());
    state
        .and_then(|name| model.joint_states.iter().find(|state| state.name == name))
        .map_or_else(|| vec![0.0; model.joint_count()], |state| state.nominal.clone())
}

fn keep_furthest(furthest: &mut Option<Partial>, partial: Option<Partial>) {
    if let Some(partial) = partial
        && furthest.as_ref().is_none_or(|best| best.placed.len() < partial.placed.len())
    {
        *furthest = Some(partial);
    }
}

/// Layout of all objects without the conflicting edges, for the error report.
fn without_conflicts(
    context: &mut Context,
    seed: Seed,
    rejections: &Rejections,
    shapes: &mut ShapeCache,
    assets: &dyn AssetSource,
) -> Option<Unfinished> {
    let conflicts = rejections.conflicting_edges();
    let (worst, _) = conflicts.first()?;
    let edges = context.edges.clone();
    let (_, indices) = edges.iter().find(|(atom, _)| atom == *worst)?;
    context.edges.retain(|(atom, _)| !conflicts.iter().any(|(conflict, _)| *conflict == atom));
    let nodes = context.task.scene_graph.nodes.len();
    context.set_distractors(Vec::new());
    let task = context.task;
    context.steps = order::steps(&context.edges, nodes, |index| task.scene_graph.nodes[index].id.clone()).ok()?;
    context.goal_regions.clear();
    context.goal_betweens.clear();
    context.goal_sides.clear();
    let seed = seed.fork("without conflicts");
    let scene = placement::place_all(context, seed, true, shapes, &mut Rejections::default()).ok()?;
    context.edges.clone_from(&edges);
    unfinished(context, &Partial { scene, placed: (0..nodes).collect(), stuck: indices.first().copied() }, assets)
}

/// Partial layout of a failed attempt with the object that could not be placed; `None` if no object is stuck.
fn unfinished(context: &Context, partial: &Partial, assets: &dyn AssetSource) -> Option<Unfinished> {
    let stuck = partial.stuck?;
    let objects: Vec<&PosedObject> = partial.scene.objects().collect();
    let size = partial.scene.bounds(stuck)?.size();
    let windows = context.edges.iter().filter_map(|(atom, indices)| {
        let Atom::Relation { relation, .. } = atom else { return None };
        let (relation, anchor) = match indices.as_slice() {
            [subject, anchor] if *subject == stuck => (*relation, *anchor),
            [anchor, object] if *object == stuck => (relation.inverse()?, *anchor),
            _ => return None,
        };
        let bounds = partial.placed.contains(&anchor).then(|| partial.scene.bounds(anchor))??;
        Some((atom.clone(), placement_window(relation, &bounds, size, context.relations)?))
    });
    Some(Unfinished {
        windows: windows.collect(),
        placed: partial.placed.iter().filter_map(|&index| placed_object(objects[index], assets).ok()).collect(),
        object: objects[stuck].id.clone(),
    })
}

fn scenario(
    task: &Task,
    seed: Seed,
    scene: &PosedScene,
    assets: &dyn AssetSource,
    world: &World,
) -> Result<Scenario, LayoutError> {
    Ok(Scenario {
        id: format!("{}-{seed}", task.id),
        task: task.clone(),
        seed,
        objects: scene.objects().map(|object| placed_object(object, assets)).collect::<Result<_, _>>()?,
        world: world.clone(),
        other_request: None,
        genmanip_version: env!("CARGO_PKG_VERSION").into(),
    })
}
