//! Repairs: operations that remove a problem and add none.

use std::f64::consts::{PI, TAU};
use std::sync::Arc;

use genmanip_core::glam::{DQuat, DVec3};
use genmanip_core::{Atom, GraphEdge, Pose, Relation, Scenario};
use genmanip_layout::at_rest;
use genmanip_relations::{Label, label_pair, planar_gap};

use super::equipment::{Equipment, VerdictError};
use super::inspection::Inspection;
use super::places::Group;
use super::problem::{Problem, ProblemCode, Repair, Stage};
use super::reword;
use super::support::{Below, support};
use crate::edit::{Operation, Placement};

/// Number of repairs offered per problem.
const MAX_REPAIRS: usize = 3;
/// Number of candidates that are inspected per problem; each inspection may take a second.
const MAX_INSPECTED: usize = 14;
/// Angle between tried headings, degrees.
const TURN_DEG: i32 = 15;
/// Displacement below which settling leaves an object where it is, m or rad.
const UNMOVED: f64 = 1e-5;
/// Number of repairs in a row.
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
        let candidates = self.candidates(problem)?;
        let mut repairs: Vec<Repair> = Vec::new();
        for candidate in candidates.into_iter().take(MAX_INSPECTED) {
            if repairs.iter().all(|known| known.operation != candidate.operation)
                && self.cures(problem, &candidate.operation)?
            {
                repairs.push(candidate);
                if repairs.len() == most {
                    break;
                }
            }
        }
        Ok(repairs)
    }

    /// The operation that lets physics settle the scene; `None` if the objects do not come to rest as they are.
    ///
    /// # Errors
    /// [`VerdictError`].
    pub fn settled(&self) -> Result<Option<Operation>, VerdictError> {
        let Some(scene) = self.scene() else { return Ok(None) };
        let states = match at_rest(scene, &self.scenario.world, &self.equipment.settings) {
            Ok(Some(states)) => states,
            Ok(None)
            | Err(genmanip_sim::SimError::Unstable { .. } | genmanip_sim::SimError::ContactsDropped { .. }) => {
                return Ok(None);
            }
            Err(error) => return Err(VerdictError::new(Stage::Stability, error)),
        };
        let moved = scene.objects().zip(states).filter_map(|(object, state)| {
            let joints = object.joint_positions.iter().zip(&state.joint_positions);
            let joints_moved = joints.clone().any(|(from, to)| (from - to).abs() > UNMOVED);
            let is_moved = object.pose.position.distance(state.pose.position) > UNMOVED
                || object.pose.angle_to(&state.pose) > UNMOVED.sqrt()
                || joints_moved;
            is_moved.then(|| Placement {
                id: object.id.clone(),
                pose: state.pose,
                joint_positions: joints_moved.then(|| state.joint_positions.clone()),
            })
        });
        let objects: Vec<Placement> = moved.collect();
        Ok((!objects.is_empty()).then_some(Operation::Place { objects }))
    }

    /// True if the operation removes the problem and adds no blocking one.
    fn cures(&mut self, problem: &Problem, operation: &Operation) -> Result<bool, VerdictError> {
        let Ok(change) = operation.apply(&self.scenario, self.equipment.assets) else { return Ok(false) };
        let same_task = change.scenario.task == self.scenario.task;
        let mut after = Inspection::new(Arc::new(change.scenario), self.equipment);
        // The stage of the problem first: most candidates fail there.
        let others = Stage::ALL.into_iter().filter(|&stage| stage != problem.stage);
        for stage in std::iter::once(problem.stage).chain(others) {
            if stage == Stage::Wording && same_task {
                continue;
            }
            let found = after.problems(stage)?;
            if found.iter().any(|found| found.is_same(problem)) {
                return Ok(false);
            }
            let known = self.problems(stage)?;
            if found.iter().any(|found| found.blocking && !known.iter().any(|known| known.is_same(found))) {
                return Ok(false);
            }
        }
        Ok(true)
    }

    /// Operations that may remove a problem, best first.
    fn candidates(&self, problem: &Problem) -> Result<Vec<Repair>, VerdictError> {
        let index = problem.object.as_deref().and_then(|id| self.scenario.index_of(id));
        let other = problem.other.as_deref().and_then(|id| self.scenario.index_of(id));
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
                found.extend(self.dropped()?);
            }
            ProblemCode::Outside | ProblemCode::Unreachable | ProblemCode::Hidden => {
                found.extend(index.into_iter().flat_map(|index| self.moved(index, None)));
            }
            ProblemCode::GoalHolds => {
                let freed = [index, other].into_iter().flatten().map(|index| self.moved(index, None));
                found.extend(alternated(freed.collect()));
            }
            ProblemCode::EdgeFalse => {
                let edges = self.scenario.task.scene_graph.edges.iter().map(GraphEdge::atom);
                let edge = edges.into_iter().find(|edge| {
                    Some(edge.subject()) == problem.object.as_deref() && edge.ids().nth(1) == problem.other.as_deref()
                });
                let freed = [index, other].into_iter().flatten().map(|index| self.moved(index, edge.as_ref()));
                found.extend(alternated(freed.collect()));
                found.extend(edge.and_then(|edge| self.without_edge(&edge)));
            }
            ProblemCode::StateFalse => found.extend(problem.object.as_deref().and_then(|id| self.in_state(id))),
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
            ProblemCode::MissingObject => found.extend(problem.object.clone().map(|object| Repair {
                label: format!("remove {}", self.name(&object)),
                operation: Operation::Remove { object },
            })),
            ProblemCode::Rule => found.extend(index.and_then(|index| self.with_edge(index))),
        }
        Ok(found)
    }

    /// The object lowered or lifted onto its support.
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

    /// The scene settled by physics.
    fn dropped(&self) -> Result<Option<Repair>, VerdictError> {
        let label = "let it settle by physics".to_owned();
        Ok(self.settled()?.map(|operation| Repair { label, operation }))
    }

    /// The object at free places, nearest first and then ever further apart.
    fn moved(&self, index: usize, should_hold: Option<&Atom>) -> Vec<Repair> {
        let Some(scene) = self.scene() else { return Vec::new() };
        let shifts = self.free_shifts(index, should_hold);
        let group = Group::of(scene, &self.scenario.world, index);
        let name = self.name(&self.scenario.objects[index].id);
        let chosen = (0..).map(|number: usize| number * (number + 1) / 2).take_while(|&at| at < shifts.len());
        let repair = |at: usize| Repair {
            label: format!("move {name} to a free place, {}", in_words(shifts[at])),
            operation: group.shifted(scene, shifts[at]),
        };
        chosen.map(repair).collect()
    }

    /// The object turned about the vertical, by small angles first.
    fn turned(&self, index: usize) -> Vec<Repair> {
        let Some(scene) = self.scene() else { return Vec::new() };
        let Some((object, bounds)) = scene.objects().nth(index).zip(scene.bounds(index)) else { return Vec::new() };
        let group = Group::of(scene, &self.scenario.world, index);
        if group.members.len() > 1 {
            return Vec::new();
        }
        let pivot = bounds.center();
        // Fewer angles, wide apart: each one is inspected.
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

    /// The object upright at its place.
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

    /// Room at the goal: bystanders near its reference moved away, or the reference itself.
    fn with_room(&self, index: Option<usize>, anchor: Option<usize>) -> Vec<Repair> {
        let Some(scene) = self.scene() else { return Vec::new() };
        let Some(anchor) = anchor else { return Vec::new() };
        let gap = |other: usize| planar_gap(scene, anchor, other).unwrap_or(f64::INFINITY);
        let others = (0..scene.objects().len()).filter(|&other| other != anchor && Some(other) != index);
        let mut near: Vec<(f64, usize)> =
            others.map(|other| (gap(other), other)).filter(|(gap, _)| *gap < 0.3).collect();
        near.sort_by(|one, other| one.0.total_cmp(&other.0));
        let mut freed: Vec<Vec<Repair>> = near.into_iter().map(|(_, other)| self.moved(other, None)).collect();
        freed.push(self.moved(anchor, None));
        // The nearest places hardly make room.
        freed.iter_mut().for_each(|repairs| drop(repairs.drain(..repairs.len().min(4))));
        alternated(freed)
    }

    /// The object's joints in the state that the graph names.
    fn in_state(&self, id: &str) -> Option<Repair> {
        let graph = &self.scenario.task.scene_graph;
        let state = graph.nodes.get(graph.index_of(id)?)?.state.clone()?;
        let label = format!("bring {} into the state {}", self.name(id), state.replace('_', " "));
        let operation = Operation::State { object: id.to_owned(), state: Some(state), joint_positions: None };
        Some(Repair { label, operation })
    }

    fn without_edge(&self, edge: &Atom) -> Option<Repair> {
        let edges = self.scenario.task.scene_graph.edges.iter().filter(|known| known.atom() != *edge);
        let label = format!("strike `{edge}` from the scene graph");
        Some(Repair { label, operation: Operation::Edges { edges: edges.cloned().collect(), description: None } })
    }

    /// A true edge for an object without one.
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
        let label = label_pair(scene, index, other, &self.scenario.world.relations)?.a_to_b?;
        let (subject, relation, reference) = match label {
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
        let name = |index: usize| self.scenario.objects[index].id.clone();
        let edge = GraphEdge { subject: name(subject), relation, reference: name(reference), second_reference: None };
        let label = format!("add `{}` to the scene graph", edge.atom());
        let edges = graph.edges.iter().cloned().chain([edge]).collect();
        Some(Repair { label, operation: Operation::Edges { edges, description: None } })
    }
}

/// Repairs of a whole scenario, one after another, and what is left.
#[derive(Clone, Debug)]
pub struct RepairedScenario {
    /// The scenario after the repairs.
    pub scenario: Arc<Scenario>,
    /// The repairs in order; each fits the scenario after the ones before it.
    pub repairs: Vec<Repair>,
    /// Blocking problems without a repair.
    pub left: Vec<Problem>,
}

/// Repairs all that can be repaired, the first problem first.
///
/// # Errors
/// [`VerdictError`].
pub fn repair_all(scenario: Arc<Scenario>, equipment: &Equipment) -> Result<RepairedScenario, VerdictError> {
    let mut repaired = RepairedScenario { scenario, repairs: Vec::new(), left: Vec::new() };
    'rounds: for _ in 0..MAX_ROUNDS {
        let mut inspection = Inspection::new(Arc::clone(&repaired.scenario), equipment);
        let verdict = inspection.verdict(0)?;
        repaired.left = verdict.blocking().cloned().collect();
        for problem in &repaired.left {
            let Some(repair) = inspection.repairs_up_to(problem, 1)?.into_iter().next() else { continue };
            if let Ok(change) = repair.operation.apply(&repaired.scenario, equipment.assets) {
                repaired.scenario = Arc::new(change.scenario);
                repaired.repairs.push(repair);
                continue 'rounds;
            }
        }
        break;
    }
    Ok(repaired)
}

/// Several lists in turn: the first of each, then the second of each.
fn alternated(lists: Vec<Vec<Repair>>) -> Vec<Repair> {
    let longest = lists.iter().map(Vec::len).max().unwrap_or(0);
    (0..longest).flat_map(|place| lists.iter().filter_map(move |list| list.get(place).cloned())).collect()
}

/// A shift in words: `3.1 cm to the left`.
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
