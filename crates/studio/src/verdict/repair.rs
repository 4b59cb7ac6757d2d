//! Repairs: operations that remove a problem without adding a blocking one.

use std::f64::consts::{PI, TAU};
use std::sync::Arc;

use genmanip_core::glam::{DQuat, DVec3};
use genmanip_core::{Atom, GraphEdge, ObjectModel, Pose, Relation, Scenario};
use genmanip_layout::{GoalOrder, GoalPoseSettings, GoalSearch, Move, moves};
use genmanip_relations::{Label, PosedScene, label_pair, planar_gap};
use genmanip_sim::SimError;

use super::equipment::{Equipment, VerdictError};
use super::inspection::Inspection;
use super::places::Group;
use super::problem::{Problem, ProblemCode, Repair, Stage};
use super::reword;
use super::support::{Below, support};
use crate::edit::{Operation, Placement};
use crate::scene::settling::{Settled, settle};

/// Maximum number of repairs offered per problem.
const MAX_REPAIRS: usize = 3;
/// Maximum number of candidates inspected per problem; each inspection may take a second.
const MAX_INSPECTED: usize = 14;
/// Step between tried yaw angles, degrees.
const TURN_DEG: i32 = 15;
/// Maximum horizontal gap to an object that may occlude another one, m.
const HIDING_M: f64 = 0.2;
/// Maximum horizontal gap between a goal's reference and an object that may take up the room, m.
const ROOM_M: f64 = 0.3;
/// Maximum number of repairs applied to one scenario by [`repair_all`].
const MAX_ROUNDS: usize = 12;

impl Inspection<'_> {
    /// Repairs of a problem, best first; each removes it and adds no blocking one. Equal scenarios have equal repairs.
    ///
    /// # Errors
    /// [`VerdictError`].
    pub fn repairs(&mut self, problem: &Problem) -> Result<Vec<Repair>, VerdictError> {
        self.repairs_up_to(problem, MAX_REPAIRS)
    }

    fn repairs_up_to(&mut self, problem: &Problem, most: usize) -> Result<Vec<Repair>, VerdictError> {
        Ok(self.cures(problem, most)?.into_iter().map(|(repair, _)| repair).collect())
    }

    /// Up to `most` repairs of a problem, best first, each with the inspection of the repaired scenario.
    fn cures(&mut self, problem: &Problem, most: usize) -> Result<Vec<(Repair, Self)>, VerdictError> {
        let mut cures: Vec<(Repair, Self)> = Vec::new();
        for candidate in self.candidates(problem)?.into_iter().take(MAX_INSPECTED) {
            if cures.iter().any(|(known, _)| known.operation == candidate.operation) {
                continue;
            }
            if let Some(cured) = self.cured(problem, &candidate.operation)? {
                cures.push((candidate, cured));
                if cures.len() == most {
                    break;
                }
            }
        }
        Ok(cures)
    }

    /// Operation that moves objects to where physics lets them settle; `None` if nothing moves, an object falls over,
    /// or the objects do not come to rest.
    ///
    /// # Errors
    /// [`VerdictError`].
    pub fn settled(&self) -> Result<Option<Operation>, VerdictError> {
        let Some(scene) = self.scene() else { return Ok(None) };
        let models: Vec<Arc<ObjectModel>> = scene.objects().map(|object| Arc::clone(&object.model)).collect();
        let (moved, is_at_rest) = match settle(&self.scenario, &models) {
            Ok(settled) => settled,
            Err(SimError::Unstable { .. } | SimError::ContactsDropped { .. }) => return Ok(None),
            Err(error) => return Err(VerdictError::new(Stage::Stability, error)),
        };
        let placed = |object: usize| &self.scenario.objects[object];
        let max_tilt_rad = self.equipment.settings.max_settle_tilt_rad;
        let stands = moved.iter().all(|own| placed(own.object).pose.angle_to(&own.pose) <= max_tilt_rad);
        let placement = |own: Settled| Placement {
            id: placed(own.object).id.clone(),
            pose: own.pose,
            joint_positions: (!own.joint_positions.is_empty()).then_some(own.joint_positions),
        };
        let objects: Vec<Placement> = moved.into_iter().map(placement).collect();
        Ok((is_at_rest && stands && !objects.is_empty()).then_some(Operation::Place { objects }))
    }

    /// Inspection of the scenario after an operation; `None` if the problem remains or a blocking one is added.
    fn cured(&mut self, problem: &Problem, operation: &Operation) -> Result<Option<Self>, VerdictError> {
        let Ok(change) = operation.apply(&self.scenario, self.equipment.assets) else { return Ok(None) };
        let same_task = change.scenario.task == self.scenario.task;
        let mut after = Inspection::new(Arc::new(change.scenario), self.equipment);
        if same_task && let Some(known) = self.found.get(&Stage::Wording) {
            after.found.insert(Stage::Wording, known.clone());
        }
        // The stage of the problem is judged first, since most candidates fail there.
        let others = Stage::ALL.into_iter().filter(|&stage| stage != problem.stage);
        for stage in std::iter::once(problem.stage).chain(others) {
            let found = after.problems(stage)?;
            if found.iter().any(|found| found.is_same(problem)) {
                return Ok(None);
            }
            let known = self.problems(stage)?;
            if found.iter().any(|found| found.blocking && !known.iter().any(|known| known.is_same(found))) {
                return Ok(None);
            }
        }
        Ok(Some(after))
    }

    /// Operations that may remove a problem, best first.
    fn candidates(&self, problem: &Problem) -> Result<Vec<Repair>, VerdictError> {
        let index = problem.object.as_ref().and_then(|id| self.scenario.index_of(id));
        let other = problem.other.as_ref().and_then(|id| self.scenario.index_of(id));
        let mut found = Vec::new();
        match problem.code {
            ProblemCode::Floating => {
                found.extend(index.and_then(|index| self.lowered(index)));
                found.extend(self.dropped()?);
            }
            ProblemCode::Overlap => {
                let depth_m = problem.value.unwrap_or(0.0) * 1e-3;
                found.extend(index.filter(|_| other.is_none()).and_then(|index| self.lifted(index, depth_m)));
                for (upper, lower) in [(index, other), (other, index)] {
                    let (Some(upper), Some(lower), Some(scene)) = (upper, lower, self.scene()) else { continue };
                    if support(scene, &self.scenario.world, upper).below == Below::Object(lower) {
                        found.extend(self.lifted(upper, depth_m));
                    }
                }
                let freed = [index, other].into_iter().flatten().map(|index| self.moved(index, None));
                found.extend(alternated(freed.collect()));
                with_last(&mut found, self.dropped()?);
            }
            ProblemCode::Outside | ProblemCode::Unreachable => {
                found.extend(index.into_iter().flat_map(|index| self.moved(index, None)));
            }
            ProblemCode::Hidden => found.extend(index.into_iter().flat_map(|index| self.moved_into_view(index))),
            ProblemCode::GoalHolds => {
                let freed = [index, other].into_iter().flatten().map(|index| self.moved(index, None));
                let by_edges = index.into_iter().map(|index| self.by_edges(index));
                found.extend(alternated(freed.chain(by_edges).collect()));
            }
            ProblemCode::EdgeFalse => {
                let edges = self.scenario.task.scene_graph.edges.iter().map(GraphEdge::atom);
                let edge = edges.into_iter().find(|edge| {
                    problem.object.as_ref().is_some_and(|id| id == edge.subject())
                        && edge.references().next() == problem.other.as_ref()
                });
                let freed = [index, other].into_iter().flatten().map(|index| self.moved(index, edge.as_ref()));
                let by_edges = index.into_iter().map(|index| self.by_edges(index));
                found.extend(alternated(freed.chain(by_edges).collect()));
                with_last(&mut found, edge.into_iter().flat_map(|edge| self.with_other_edge(&edge)));
            }
            ProblemCode::StateFalse => found.extend(index.and_then(|index| self.in_state(index))),
            ProblemCode::AmbiguousSentence | ProblemCode::SentenceMismatch => {
                let sentences = reword::instructions(&self.scenario.task, MAX_REPAIRS);
                found.extend(
                    sentences.into_iter().map(|text| Repair {
                        label: format!("say: {text}"),
                        operation: Operation::Instruction { text },
                    }),
                );
            }
            ProblemCode::GraspBlocked => {
                let turned: Vec<Repair> = index.into_iter().flat_map(|index| self.turned(index)).collect();
                let neighbour = other.into_iter().flat_map(|other| self.moved(other, None)).collect();
                let object = index.into_iter().flat_map(|index| self.moved(index, None)).collect();
                found.extend(alternated(vec![turned, neighbour, object]));
            }
            ProblemCode::Unstable => {
                found.extend(self.dropped()?);
                found.extend(index.and_then(|index| self.upright(index)));
                found.extend(index.into_iter().flat_map(|index| self.moved(index, None)));
            }
            ProblemCode::NoGoalPose => found.extend(self.with_room(index, other)),
            ProblemCode::MissingObject => found.extend(index.map(|index| self.without(index))),
            ProblemCode::Rule => found.extend(index.and_then(|index| self.with_edge(index))),
        }
        Ok(found)
    }

    /// Candidate that lowers or lifts the object, with everything on it, onto its support.
    fn lowered(&self, index: usize) -> Option<Repair> {
        let scene = self.scene()?;
        let below = support(scene, &self.scenario.world, index);
        let by = DVec3::Z * -below.gap_m;
        let operation = Group::of(scene, &self.scenario.world, index).shifted(scene, by);
        let on = match below.below {
            Below::Object(other) => self.name(&self.scenario.objects[other].id),
            Below::Surface(surface) => self.name(&self.scenario.world.surfaces.get(surface)?.id),
            Below::Nothing => return None,
        };
        let label = format!("{} it by {:.1} mm onto {on}", if by.z < 0.0 { "lower" } else { "lift" }, by.z.abs() * 1e3);
        Some(Repair { label, operation })
    }

    fn lifted(&self, index: usize, by_m: f64) -> Option<Repair> {
        let scene = self.scene()?;
        let operation = Group::of(scene, &self.scenario.world, index).shifted(scene, DVec3::Z * by_m);
        let name = self.name(&self.scenario.objects[index].id);
        Some(Repair { label: format!("lift {name} by {:.1} mm", by_m * 1e3), operation })
    }

    /// Candidate that lets physics settle the scene; `None` if there is none.
    fn dropped(&self) -> Result<Option<Repair>, VerdictError> {
        let label = "let it settle by physics".to_owned();
        Ok(self.settled()?.map(|operation| Repair { label, operation }))
    }

    /// Candidates that move the object to free places: the nearest ones, then others spread ever further.
    fn moved(&self, index: usize, should_hold: Option<&Atom>) -> Vec<Repair> {
        let Some(scene) = self.scene() else { return Vec::new() };
        let group = Group::of(scene, &self.scenario.world, index);
        let shifts = self.free_shifts(&group, should_hold);
        let name = self.name(&self.scenario.objects[index].id);
        // An object that the goal moves must remain within reach of the arm.
        let is_carried = moves(&self.scenario.task.judged_goal(), scene)
            .iter()
            .flatten()
            .any(|step| step.object == index && step.state().is_none());
        let position = self.scenario.objects[index].pose.position;
        let in_reach = |shift: &&DVec3| !is_carried || self.equipment.planner.reaches_from_above(position + **shift);
        let repair = |shift: &DVec3| Repair {
            label: format!("move {name} to a free place, {}", in_words(*shift)),
            operation: group.shifted(scene, *shift),
        };
        let chosen = (0..MAX_INSPECTED).map(|number| number * (number + 1) / 2);
        let places: Vec<&DVec3> =
            shifts.iter().filter(in_reach).take(MAX_INSPECTED * (MAX_INSPECTED + 1) / 2).collect();
        chosen.filter_map(|at| places.get(at)).map(|shift| repair(shift)).collect()
    }

    /// Candidates that bring the object into view: it or an object near it is moved, or that one is removed.
    fn moved_into_view(&self, index: usize) -> Vec<Repair> {
        let Some(scene) = self.scene() else { return Vec::new() };
        let near = self.neighbours(scene, index, HIDING_M);
        let mut lists = vec![self.moved(index, None), self.uncovered(index)];
        lists.extend(near.iter().take(2).map(|&other| self.moved(other, None)));
        let nodes = &self.scenario.task.scene_graph;
        let distractor = near.iter().find(|other| nodes.index_of(&self.scenario.objects[**other].id).is_none());
        let removed = distractor.map(|&other| self.without(other));
        let mut repairs = alternated(lists);
        with_last(&mut repairs, removed);
        repairs
    }

    /// Candidates for an object that is by accident inside a container: the container is moved away and its contents
    /// are lowered onto the surface.
    fn uncovered(&self, index: usize) -> Vec<Repair> {
        let Some(scene) = self.scene() else { return Vec::new() };
        let world = &self.scenario.world;
        let mut edges = self.scenario.task.scene_graph.edges.iter();
        let is_meant = edges.any(|edge| edge.relation.is_support() && scene.index_of(&edge.subject) == Some(index));
        let Below::Object(container) = support(scene, world, index).below else { return Vec::new() };
        let floor = support(scene, world, container);
        if is_meant || matches!(floor.below, Below::Object(_) | Below::Nothing) {
            return Vec::new();
        }
        let bottom = |index: usize| scene.bounds(index).map_or(0.0, |bounds| bounds.min.z);
        let down = DVec3::Z * (bottom(container) - floor.gap_m - bottom(index));
        let (alone, inside) = (Group { members: vec![container] }, Group::of(scene, world, index));
        let Operation::Place { objects: lowered } = inside.shifted(scene, down) else { return Vec::new() };
        let name = self.name(&self.scenario.objects[container].id);
        let repair = |shift: DVec3| {
            let mut operation = alone.shifted(scene, shift);
            if let Operation::Place { objects } = &mut operation {
                objects.extend(lowered.iter().cloned());
            }
            Repair { label: format!("move {name} away from it, {}", in_words(shift)), operation }
        };
        self.free_shifts(&alone, None).into_iter().step_by(8).take(MAX_INSPECTED).map(repair).collect()
    }

    /// Candidates that move the object to poses where the edges with it as subject hold, found by goal-pose search.
    fn by_edges(&self, index: usize) -> Vec<Repair> {
        let Some(scene) = self.scene() else { return Vec::new() };
        let (world, id) = (&self.scenario.world, &self.scenario.objects[index].id);
        if Group::of(scene, world, index).members.len() > 1 {
            return Vec::new();
        }
        let edges = self.scenario.task.scene_graph.edges.iter().filter(|edge| edge.subject == *id);
        let step = Move { object: index, atoms: edges.map(GraphEdge::atom).collect() };
        let upright: Vec<DQuat> = scene.objects().map(|object| object.pose.rotation).collect();
        let search = GoalSearch {
            scene,
            upright: &upright,
            workspace: &world.workspace,
            relations: &world.relations,
            settings: &GoalPoseSettings::default(),
            order: GoalOrder::Margin,
        };
        let height_m = scene.bounds(index).map_or(0.0, |bounds| bounds.size().z);
        let usable = |pose: &Pose| self.equipment.planner.reaches_from_above(pose.position + DVec3::Z * height_m);
        let poses = search.goal_poses(&step, &[], &usable, self.scenario.seed.fork("studio"));
        let repair = |pose: Pose| Repair {
            label: format!("move {} to where its relations hold", self.name(id)),
            operation: Operation::Place { objects: vec![Placement { id: id.clone(), pose, joint_positions: None }] },
        };
        poses.into_iter().map(|goal| repair(goal.world_from_object)).collect()
    }

    /// Indices of the other objects up to a horizontal gap, m, nearest first.
    fn neighbours(&self, scene: &PosedScene, index: usize, within_m: f64) -> Vec<usize> {
        let gap = |other: usize| planar_gap(scene, index, other).unwrap_or(f64::INFINITY);
        let others = (0..scene.objects().len()).filter(|&other| other != index);
        let mut near: Vec<(f64, usize)> =
            others.map(|other| (gap(other), other)).filter(|(gap, _)| *gap < within_m).collect();
        near.sort_by(|one, other| one.0.total_cmp(&other.0));
        near.into_iter().map(|(_, other)| other).collect()
    }

    /// Candidates that rotate the object about the vertical, small angles first.
    fn turned(&self, index: usize) -> Vec<Repair> {
        let Some(scene) = self.scene() else { return Vec::new() };
        let Some((object, bounds)) = scene.objects().nth(index).zip(scene.bounds(index)) else { return Vec::new() };
        let group = Group::of(scene, &self.scenario.world, index);
        if group.members.len() > 1 {
            return Vec::new();
        }
        let pivot = bounds.center();
        // Few and widely spaced angles, since each candidate is inspected.
        let angles = [3, -3, 6, -6, 2, -2, 4, -4, 1, -1].map(|steps| steps * TURN_DEG);
        let repair = |degrees: i32| {
            let turn = DQuat::from_rotation_z(TAU * f64::from(degrees) / 360.0);
            let pose = Pose::new(pivot + turn * (object.pose.position - pivot), turn * object.pose.rotation);
            let side = if degrees > 0 { "counter-clockwise" } else { "clockwise" };
            Repair {
                label: format!("turn {} by {}° {side}", self.name(&object.id), degrees.abs()),
                operation: Operation::Place {
                    objects: vec![Placement { id: object.id.clone(), pose, joint_positions: None }],
                },
            }
        };
        angles.map(repair).into()
    }

    /// Candidate that puts the object upright at the same place.
    fn upright(&self, index: usize) -> Option<Repair> {
        let scene = self.scene()?;
        let object = scene.objects().nth(index)?;
        let surface = self.scenario.world.table()?;
        let position = DVec3 { z: surface.top_center_m.z, ..object.pose.position };
        let pose = Pose::from_position_yaw(position, object.pose.yaw());
        let label = format!("stand {} upright on {}", self.name(&object.id), self.name(&surface.id));
        let objects = vec![Placement { id: object.id.clone(), pose, joint_positions: None }];
        Some(Repair { label, operation: Operation::Place { objects } })
    }

    /// Candidates that make room at the goal: objects near its reference are moved away, or the reference itself is.
    fn with_room(&self, index: Option<usize>, anchor: Option<usize>) -> Vec<Repair> {
        let Some(scene) = self.scene() else { return Vec::new() };
        let Some(anchor) = anchor else { return Vec::new() };
        let near = self.neighbours(scene, anchor, ROOM_M).into_iter().filter(|&other| Some(other) != index);
        let mut freed: Vec<Vec<Repair>> = near.map(|other| self.moved(other, None)).collect();
        freed.push(self.moved(anchor, None));
        // Skip the nearest places, which hardly make room.
        freed.iter_mut().for_each(|repairs| drop(repairs.drain(..repairs.len().min(4))));
        alternated(freed)
    }

    fn without(&self, index: usize) -> Repair {
        let object = self.scenario.objects[index].id.clone();
        Repair { label: format!("remove {}", self.name(&object)), operation: Operation::Remove { object } }
    }

    /// Candidate that moves the object's joints into the state that the scene graph names.
    fn in_state(&self, index: usize) -> Option<Repair> {
        let graph = &self.scenario.task.scene_graph;
        let id = &self.scenario.objects[index].id;
        let state = graph.nodes.get(graph.index_of(id)?)?.state.clone()?;
        let label = format!("bring {} into the state {}", self.name(id), state.replace('_', " "));
        let operation = Operation::State { object: id.clone(), state: Some(state), joint_positions: None };
        Some(Repair { label, operation })
    }

    /// Candidates that replace a false edge of the scene graph by one that holds, or remove it.
    fn with_other_edge(&self, edge: &Atom) -> Vec<Repair> {
        let (graph, relations) = (&self.scenario.task.scene_graph, &self.scenario.world.relations);
        let pair = || {
            let [index, other] = [edge.subject(), edge.ids().nth(1)?].map(|id| self.scenario.index_of(id));
            edge_between(self.scene()?, index?, other?, relations)
        };
        let instead = pair().filter(|instead| !graph.edges.contains(instead));
        let with = |label: String, instead: Option<&GraphEdge>| {
            let edges =
                graph.edges.iter().filter_map(|known| if known.atom() == *edge { instead } else { Some(known) });
            Repair { label, operation: Operation::Edges { edges: edges.cloned().collect(), description: None } }
        };
        let changed = instead.map(|instead| {
            with(format!("put `{}` instead of `{edge}` into the scene graph", instead.atom()), Some(&instead))
        });
        changed.into_iter().chain([with(format!("strike `{edge}` from the scene graph"), None)]).collect()
    }

    /// Candidate that adds an edge that holds to an object without edges.
    fn with_edge(&self, index: usize) -> Option<Repair> {
        let scene = self.scene()?;
        let graph = &self.scenario.task.scene_graph;
        let id = &self.scenario.objects.get(index)?.id;
        graph.index_of(id)?;
        if graph.edges.iter().any(|edge| edge.atom().ids().any(|other| other == id)) {
            return None;
        }
        let others = (0..graph.nodes.len()).filter(|&other| other != index);
        let gap = |other: &usize| planar_gap(scene, index, *other).unwrap_or(f64::INFINITY);
        let other = others.min_by(|one, two| gap(one).total_cmp(&gap(two)))?;
        let edge = edge_between(scene, index, other, &self.scenario.world.relations)?;
        let label = format!("add `{}` to the scene graph", edge.atom());
        let edges = graph.edges.iter().cloned().chain([edge]).collect();
        Some(Repair { label, operation: Operation::Edges { edges, description: None } })
    }
}

/// An edge that holds between two objects; `None` if they are too far apart.
pub fn edge_between(
    scene: &PosedScene,
    index: usize,
    other: usize,
    settings: &genmanip_core::RelationSettings,
) -> Option<GraphEdge> {
    let (subject, relation, reference) = match label_pair(scene, index, other, settings)?.a_to_b? {
        Label::In => (index, Relation::In, other),
        Label::OutOf => (other, Relation::In, index),
        Label::On => (index, Relation::On, other),
        Label::Beneath => (other, Relation::On, index),
        Label::Left => (index, Relation::Left, other),
        Label::Right => (index, Relation::Right, other),
        Label::Front => (index, Relation::Front, other),
        Label::Back => (index, Relation::Back, other),
        Label::Near => (index, Relation::Near, other),
    };
    let id = |index: usize| Some(scene.objects().nth(index)?.id.clone());
    Some(GraphEdge { subject: id(subject)?, relation, reference: id(reference)?.into(), second_reference: None })
}

/// A scenario after all possible repairs.
#[derive(Clone, Debug)]
pub struct RepairedScenario {
    /// The repaired scenario.
    pub scenario: Arc<Scenario>,
    /// The repairs in the order of their application; each refers to the scenario after the previous ones.
    pub repairs: Vec<Repair>,
    /// Blocking problems that no repair removes.
    pub left: Vec<Problem>,
}

/// Repairs blocking problems, the first one of the verdict first, until none can be repaired.
///
/// # Errors
/// [`VerdictError`].
pub fn repair_all(scenario: Arc<Scenario>, equipment: &Equipment) -> Result<RepairedScenario, VerdictError> {
    let mut inspection = Inspection::new(scenario, equipment);
    let mut repairs = Vec::new();
    loop {
        let left: Vec<Problem> = inspection.verdict(0)?.blocking().cloned().collect();
        let mut cure = None;
        for problem in left.iter().filter(|_| repairs.len() < MAX_ROUNDS) {
            cure = inspection.cures(problem, 1)?.pop();
            if cure.is_some() {
                break;
            }
        }
        match cure {
            Some((repair, cured)) => {
                repairs.push(repair);
                inspection = cured;
            }
            None => return Ok(RepairedScenario { scenario: inspection.scenario, repairs, left }),
        }
    }
}

/// Appends candidates and truncates the others, so that these are inspected too.
fn with_last(candidates: &mut Vec<Repair>, last: impl IntoIterator<Item = Repair>) {
    let last: Vec<Repair> = last.into_iter().collect();
    candidates.truncate(MAX_INSPECTED.saturating_sub(last.len()));
    candidates.extend(last);
}

/// Interleaves lists: the first of each, then the second of each.
fn alternated(lists: Vec<Vec<Repair>>) -> Vec<Repair> {
    let longest = lists.iter().map(Vec::len).max().unwrap_or(0);
    (0..longest).flat_map(|place| lists.iter().filter_map(move |list| list.get(place).cloned())).collect()
}

/// Text of a horizontal shift (m): `3.1 cm to the left`.
fn in_words(shift: DVec3) -> String {
    let distance_cm = shift.truncate().length() * 100.0;
    let angle = shift.y.atan2(shift.x);
    let direction = match (angle / (PI / 4.0)).round() as i32 {
        0 => "away from the robot",
        1 => "to the left and away from the robot",
        2 => "to the left",
        3 => "to the left and towards the robot",
        -1 => "to the right and away from the robot",
        -2 => "to the right",
        -3 => "to the right and towards the robot",
        _ => "towards the robot",
    };
    format!("{distance_cm:.1} cm {direction}")
}
