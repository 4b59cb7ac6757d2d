//! Oracle: a model with access to the ground truth, which isolates errors of the agent's other components.
//!
//! It answers only with marks of the image: -1 if no mask matches the object with an IoU of 0.5.
//! It reveals nothing else to the agent.

mod flaws;

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};

use genmanip_agent::ask::{Marks, ModelReply, Question, QuestionKind, ServiceError, VisionModel};
use genmanip_agent::grid::{Cell, Grid};
use genmanip_agent::segmentation::Mask;
use genmanip_core::glam::{DQuat, DVec3};
use genmanip_core::{Atom, AtomVerdict, FailureClass, ReferenceId, VerifiedGrasp};
use genmanip_layout::{GoalOrder, GoalPoseSettings, GoalSearch, Move};
use genmanip_motion::Planner;
use genmanip_relations::{PosedScene, judge_atom, planar_gap};
use rand::RngExt;
use serde_json::json;

use super::GroundTruth;

/// Minimum IoU (intersection over union) of a proposed mask with the object's ground-truth mask. Chosen by hand.
const SAME_MASK: f64 = 0.5;
/// Goal margin (m) above which a placement's score does not grow; its clearance counts up to twice as much.
const AMPLE_M: f64 = 0.03;
/// Clearance (m) to other objects below which a placement counts as occupied.
const TAKEN_M: f64 = 0.01;
/// Radius (m) within which tried grasps count towards the score of a point.
const NEAR_POINT_M: f64 = 0.03;
/// Height (m) of a grid path: at its middle cell, and at its ends.
const CARRY_M: f64 = 0.28;
const END_M: f64 = 0.2;
/// Maximum path height that an answer may state, m; the height at the detour cell of a deliberately wrong path.
const HIGHEST_M: f64 = 0.5;
/// Minimum share of a cell's pixels that show the support object.
const ON_THING: f64 = 0.3;

/// Injected error rate per question kind, 0 to 1.
pub type ErrorRates = BTreeMap<QuestionKind, f64>;

/// Error injection of the oracle.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ErrorInjection {
    /// Error rate per question kind, 0-1; 0 if absent.
    pub rates: ErrorRates,
    /// Failure class to inject once per episode, at the first question that allows it; `None` to use `rates` instead.
    pub once: Option<FailureClass>,
}

/// Oracle of one episode.
pub struct Oracle {
    truth: GroundTruth,
    planner: Arc<Planner>,
    /// Precomputed grasps with trial results, by object index.
    grasps: Vec<Vec<VerifiedGrasp>>,
    dials: ErrorInjection,
    /// Move that each sub-task text of this oracle describes.
    subtasks: Arc<Mutex<BTreeMap<String, Move>>>,
}

impl Oracle {
    /// Oracle of one episode; `grasps` are precomputed grasps with trial results, by object index.
    pub fn new(
        truth: GroundTruth,
        planner: &Arc<Planner>,
        grasps: Vec<Vec<VerifiedGrasp>>,
        dials: ErrorInjection,
    ) -> Self {
        Self { truth, planner: Arc::clone(planner), grasps, dials, subtasks: Arc::default() }
    }

    /// Copy without error injection; it shares the map of sub-task texts with this oracle.
    #[must_use]
    pub fn honest(&self) -> Self {
        Self {
            truth: self.truth.clone(),
            planner: Arc::clone(&self.planner),
            grasps: self.grasps.clone(),
            dials: ErrorInjection::default(),
            subtasks: Arc::clone(&self.subtasks),
        }
    }

    /// Failure class of the error to inject into this answer: once per episode, or sampled by episode seed and question
    /// number; `None` for a correct answer.
    fn flaw(&self, question: &Question) -> Option<FailureClass> {
        if let Some(class) = self.dials.once {
            // The grasp source injects wrong grasps.
            if class == FailureClass::GraspProposal {
                return None;
            }
            // The agent asks again after a format error; all repetitions count as one error.
            let goes_on = class == FailureClass::Format && !question.refused.is_empty();
            return (goes_on || self.truth.injected().is_empty()).then_some(class);
        }
        let rate = self.dials.rates.get(&question.stage).copied().unwrap_or(0.0);
        let seed = self.truth.now().seed.filter(|_| rate > 0.0)?;
        let errs = seed.fork("oracle error").fork_index(question.ask as u64).rng().random::<f64>() < rate;
        errs.then(|| match question.stage {
            QuestionKind::Decompose => FailureClass::Decomposition,
            QuestionKind::Object => FailureClass::GraspGrounding,
            QuestionKind::Part | QuestionKind::GrabPoint => FailureClass::GraspProposal,
            QuestionKind::GridPath | QuestionKind::PointToPoint => {
                [FailureClass::PlanGrounding, FailureClass::PlanLocation][self.draw(question, 2)]
            }
            QuestionKind::Check => FailureClass::Checker,
        })
    }

    /// Random number below `bound` (0 or more), from a stream specific to this question.
    fn draw(&self, question: &Question, bound: usize) -> usize {
        let seed = self.truth.now().seed.unwrap_or(genmanip_core::Seed::new(0));
        seed.fork("oracle choice").fork_index(question.ask as u64).rng().random_range(0..bound.max(1))
    }

    /// Move described by a sub-task text; `None` if this oracle did not write it.
    fn step(&self, subtask: &str) -> Option<Move> {
        self.subtasks.lock().unwrap_or_else(PoisonError::into_inner).get(subtask).cloned()
    }

    /// Shortest non-empty plan of unfinished moves among the goal alternatives; empty if every move is finished.
    fn plan(&self, scene: &PosedScene) -> Vec<Move> {
        let plans = self.truth.undone(scene);
        plans.into_iter().filter(|plan| !plan.is_empty()).min_by_key(Vec::len).unwrap_or_default()
    }

    /// JSON answer with the sub-task texts of a plan; the texts are stored, so that later questions can be mapped to
    /// the moves.
    fn worded(&self, plan: Vec<Move>) -> serde_json::Value {
        let mut known = self.subtasks.lock().unwrap_or_else(PoisonError::into_inner);
        let mut subtasks = Vec::new();
        for step in plan {
            let mut words = self.words(&step);
            while known.get(&words).is_some_and(|other| *other != step) {
                words.push_str(" (the other one)");
            }
            known.insert(words.clone(), step);
            subtasks.push(words);
        }
        if subtasks.is_empty() {
            // No move is left, but the answer needs at least one sub-task.
            subtasks.push(self.truth.stage().scenario.task.instruction.clone());
        }
        json!({ "subtasks": subtasks })
    }

    fn words(&self, step: &Move) -> String {
        let stage = self.truth.stage();
        let name =
            |id: &ReferenceId| stage.start().index_of(id).map_or(id.as_str(), |index| stage.name(index)).to_owned();
        let places: Vec<String> = step
            .atoms
            .iter()
            .filter_map(|atom| match atom {
                Atom::Relation { relation, reference, second_reference, .. } => {
                    let second = second_reference.as_ref().map(name);
                    Some(relation.describe(&name(reference), second.as_deref()))
                }
                Atom::State { .. } => None,
            })
            .collect();
        format!("Pick up the {} and place it {}.", stage.name(step.object), places.join(" and "))
    }

    fn object(&self, question: &Question) -> serde_json::Value {
        let not_found = json!({"number": -1, "object_name": "not_found", "color": "not_found"});
        let (Some(step), Marks::Masks(drawn)) = (self.step(&question.instruction), &question.marks) else {
            return not_found;
        };
        let known = self.truth.masks(&question.view).unwrap_or_default();
        let Some((_, mask)) = known.iter().find(|(object, _)| *object == step.object) else { return not_found };
        let best = best_mask(drawn, mask);
        let Some(number) = best else { return not_found };
        self.named(number, step.object)
    }

    /// JSON answer with a mask number, and the name and colour of an object.
    fn named(&self, mask: usize, object: usize) -> serde_json::Value {
        let card = &self.truth.stage().models[object].card;
        let color = card.colors.first().cloned().unwrap_or_default();
        json!({"number": mask + 1, "object_name": self.truth.stage().name(object), "color": color})
    }

    fn part(&self, question: &Question) -> serde_json::Value {
        let best = self.parts(question).into_iter().max_by(|a, b| a.0.total_cmp(&b.0));
        match best {
            Some((_, part)) => part_named(part),
            None => json!({"number": -1, "part_name": "not_found", "color": "not_found"}),
        }
    }

    /// Score (sum of success rates of tried grasps near its pixels) and index of each part.
    fn parts(&self, question: &Question) -> Vec<(f64, usize)> {
        let (Marks::Masks(parts), Some(step)) = (&question.marks, self.step(&question.instruction)) else {
            return Vec::new();
        };
        let speaks = |part: &Mask| {
            let seen = part.indices().filter_map(|index| question.view.point(index));
            seen.map(|point| self.grasps_near(step.object, point)).sum()
        };
        parts.iter().map(speaks).zip(0..).collect()
    }

    /// Sum of the success rates of an object's tried grasps within [`NEAR_POINT_M`] of a point in the world frame (m).
    fn grasps_near(&self, object: usize, point: DVec3) -> f64 {
        let scene = self.truth.scene();
        let Some(posed) = scene.objects().nth(object) else { return 0.0 };
        let near = |tried: &&VerifiedGrasp| {
            posed.pose.transform_point(tried.grasp.pose.position).distance(point) < NEAR_POINT_M
        };
        self.grasps.get(object).into_iter().flatten().filter(near).map(VerifiedGrasp::share).sum()
    }

    fn grab_point(&self, question: &Question) -> serde_json::Value {
        let better = |a: &((f64, f64), usize), b: &((f64, f64), usize)| {
            let (a, b) = (a.0, b.0);
            a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1))
        };
        let best = self.points(question).into_iter().max_by(better).map_or(0, |(_, point)| point);
        json!({"selected_point": best + 1, "reason": "most tried grasps are near it"})
    }

    /// Score and index of each candidate point: first by nearby tried grasps, then by closeness to the object's centre.
    fn points(&self, question: &Question) -> Vec<((f64, f64), usize)> {
        let Marks::Points(points) = &question.marks else { return Vec::new() };
        let known = self.truth.masks(&question.view).unwrap_or_default();
        let of = |pixel: &usize| known.iter().find(|(_, mask)| mask.pixels[*pixel]).map(|(object, _)| *object);
        let object = points.iter().find_map(of);
        let scene = self.truth.scene();
        let worth = |pixel: usize| -> (f64, f64) {
            let (Some(object), Some(point)) = (object, question.view.point(pixel)) else { return (0.0, 0.0) };
            let middle = scene.bounds(object).map_or(point, |bounds| bounds.center());
            (self.grasps_near(object, point), -middle.distance(point))
        };
        points.iter().map(|&pixel| worth(pixel)).zip(0..).collect()
    }

    /// Best target cell for the sub-task of a question; `None` if there is none or the sub-task is unknown.
    fn cell(&self, question: &Question) -> Option<Cell> {
        let Marks::Grid { moved, .. } = &question.marks else { return None };
        let step = self.step(&question.instruction)?;
        // If the agent picked another object than asked, that object is placed.
        let object = self.taken(question, moved).unwrap_or(step.object);
        let rooms = [Room::Ample, Room::Little, Room::Any];
        self.cell_for(question, &self.truth.about(&step, object), &rooms)
    }

    /// Index of the object whose ground-truth mask has the highest IoU with `moved`; `None` if no object is visible.
    fn taken(&self, question: &Question, moved: &Mask) -> Option<usize> {
        let known = self.truth.masks(&question.view).unwrap_or_default();
        known.iter().max_by(|a, b| a.1.iou(moved).total_cmp(&b.1.iou(moved))).map(|(object, _)| *object)
    }

    /// Best target cell for a move, from the first clearance level in `rooms` that has a candidate.
    fn cell_for(&self, question: &Question, step: &Move, rooms: &[Room]) -> Option<Cell> {
        let Marks::Grid { grid, targets, .. } = &question.marks else { return None };
        let scene = self.truth.scene();
        let placed = Placed { oracle: self, scene: &scene, step, object: step.object };
        let support = step.atoms.iter().find_map(|atom| match atom {
            Atom::Relation { relation, reference, .. } if relation.is_support() => scene.index_of(reference),
            _ => None,
        });
        let worth: Vec<(f64, Cell)> = match support {
            Some(support) => {
                let known = self.truth.masks(&question.view).unwrap_or_default();
                let mask = known.iter().find(|(object, _)| *object == support).map(|(_, mask)| mask);
                placed.on(grid, targets, mask)
            }
            None => {
                let at = |room: &Room| -> Vec<(f64, Cell)> {
                    targets.iter().filter_map(|(cell, point)| Some((placed.worth(*point, *room)?, *cell))).collect()
                };
                rooms.iter().map(at).find(|worth| !worth.is_empty()).unwrap_or_default()
            }
        };
        worth.into_iter().max_by(|a, b| a.0.total_cmp(&b.0).then(b.1.cmp(&a.1))).map(|(_, cell)| cell)
    }

    /// Answer that places the picked object in cell `goal`; a grid path also passes the cell `detour`, if given.
    fn sent_to(&self, question: &Question, goal: Cell, detour: Option<Cell>) -> serde_json::Value {
        match &question.marks {
            Marks::Grid { grid, moved, .. } if question.stage == QuestionKind::GridPath => {
                path(grid, moved, goal, detour)
            }
            _ => json!({"selected_point": {"type": "grid", "label": goal.to_string()}}),
        }
    }

    fn right_answer(&self, question: &Question) -> serde_json::Value {
        match question.stage {
            QuestionKind::Decompose => self.worded(self.plan(&self.truth.scene())),
            QuestionKind::Object => self.object(question),
            QuestionKind::Part => self.part(question),
            QuestionKind::GrabPoint => self.grab_point(question),
            QuestionKind::PointToPoint | QuestionKind::GridPath => match self.cell(question) {
                Some(cell) => self.sent_to(question, cell, None),
                // Without a suitable cell the answer is an invalid label, which the agent rejects.
                None => json!({"selected_point": {"type": "grid", "label": "none"}}),
            },
            QuestionKind::Check => {
                let verdict = self.truth.verdict();
                let remaining = match verdict.success {
                    true => json!([]),
                    false => self.worded(self.plan(&self.truth.scene()))["subtasks"].take(),
                };
                checked(verdict.success, verdict.score, remaining)
            }
        }
    }
}

fn part_named(part: usize) -> serde_json::Value {
    json!({"number": part + 1, "part_name": format!("part {}", part + 1), "color": "unknown"})
}

fn checked(finished: bool, score: f64, remaining: serde_json::Value) -> serde_json::Value {
    json!({"scene_description": format!("score {score:.2}"), "finished": finished, "remaining": remaining})
}

/// Grid path from the object's cell to the goal, via the middle cell if they are more than 3 cells apart, and via
/// `detour` if given.
fn path(grid: &Grid, moved: &Mask, goal: Cell, detour: Option<Cell>) -> serde_json::Value {
    let width = moved.width as usize;
    let count = moved.indices().count().max(1) as f64;
    let sum = moved.indices().fold([0.0, 0.0], |sum, index| {
        [sum[0] + (index % width) as f64 / count, sum[1] + (index / width) as f64 / count]
    });
    let start = grid.cell_at(sum[0], sum[1]).unwrap_or(goal);
    let middle = Cell { row: (start.row + goal.row) / 2, column: (start.column + goal.column) / 2 };
    let step = |cell: Cell, height_m: f64| json!({"grid_number": cell.to_string(), "height_m": height_m, "claw_orientation": 0.0});
    let is_far = start.row.abs_diff(goal.row) + start.column.abs_diff(goal.column) > 3;
    let mut path = vec![step(start, END_M)];
    path.extend(is_far.then(|| step(middle, CARRY_M)));
    path.extend(detour.map(|cell| step(cell, HIGHEST_M)));
    path.push(step(goal, END_M));
    json!({ "path": path })
}

/// Index of the mask in `drawn` with the highest IoU with an object's mask; `None` if all are below [`SAME_MASK`].
fn best_mask(drawn: &[Mask], mask: &Mask) -> Option<usize> {
    let overlaps = drawn.iter().map(|other| other.iou(mask)).enumerate();
    overlaps.filter(|(_, iou)| *iou >= SAME_MASK).max_by(|a, b| a.1.total_cmp(&b.1)).map(|(index, _)| index)
}

/// Required clearance of a placement.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Room {
    /// Clearance of at least [`TAKEN_M`], inside the workspace.
    Ample,
    /// Any clearance that is not negative.
    Little,
    /// Any clearance, even if the goal does not hold there.
    Any,
}

/// Hypothetical placement of an object.
struct Placed<'a> {
    oracle: &'a Oracle,
    scene: &'a PosedScene,
    step: &'a Move,
    object: usize,
}

impl Placed<'_> {
    /// Score of a point on the table (world frame, m), from goal margin and clearance; `None` if it is unsuitable.
    fn worth(&self, point: DVec3, room: Room) -> Option<f64> {
        let stage = self.oracle.truth.stage();
        let bounds = self.scene.bounds(self.object)?;
        let mut after = self.scene.clone();
        let to = point - bounds.center().with_z(bounds.min.z);
        after.shift(self.object, to);
        let verdicts: Vec<AtomVerdict> =
            self.step.atoms.iter().map(|atom| judge_atom(&after, atom, &stage.relations)).collect();
        if !verdicts.iter().all(|verdict| verdict.holds) && room != Room::Any {
            return None;
        }
        let gaps = (0..after.objects().len()).filter(|other| *other != self.object);
        let clear = gaps.filter_map(|other| planar_gap(&after, self.object, other)).fold(f64::INFINITY, f64::min);
        let workspace = &stage.scenario.world.workspace;
        let moved = after.bounds(self.object)?;
        let inside = (moved.min.x - workspace.x[0])
            .min(workspace.x[1] - moved.max.x)
            .min(moved.min.y - workspace.y[0])
            .min(workspace.y[1] - moved.max.y);
        let reached = self.oracle.planner.reaches_from_above(point + DVec3::Z * bounds.size().z);
        let least = match room {
            Room::Ample => TAKEN_M,
            Room::Little => 0.0,
            Room::Any => f64::NEG_INFINITY,
        };
        let is_out = clear < least || room == Room::Ample && inside < 0.0;
        if is_out || !reached && room != Room::Any {
            return None;
        }
        let margin = verdicts.iter().map(AtomVerdict::normalised_margin).fold(f64::INFINITY, f64::min);
        Some(margin.min(AMPLE_M) + 0.5 * clear.min(2.0 * AMPLE_M))
    }

    /// Cells on the support object, each with a score that grows with closeness to a goal pose.
    fn on(&self, grid: &Grid, targets: &BTreeMap<Cell, DVec3>, carrier: Option<&Mask>) -> Vec<(f64, Cell)> {
        let stage = self.oracle.truth.stage();
        let upright: Vec<DQuat> = self.scene.objects().map(|object| object.pose.rotation).collect();
        let search = GoalSearch {
            scene: self.scene,
            upright: &upright,
            workspace: &stage.scenario.world.workspace,
            relations: &stage.relations,
            settings: &GoalPoseSettings { count: 30, ..GoalPoseSettings::default() },
            order: GoalOrder::Margin,
        };
        let step = Move { object: self.object, ..self.step.clone() };
        let seed = self.oracle.truth.now().seed.unwrap_or(genmanip_core::Seed::new(0));
        let places = search.goal_poses(&step, &[], &|_| true, seed.fork("oracle place"));
        let share = |cell: Cell| {
            let Some(mask) = carrier else { return 1.0 };
            let [left, top, right, bottom] = grid.edges(cell).map(|edge| edge as usize);
            let pixels =
                (top..bottom).flat_map(|row| (left..right).map(move |column| row * mask.width as usize + column));
            let area = ((right - left) * (bottom - top)).max(1) as f64;
            pixels.filter(|pixel| mask.pixels[*pixel]).count() as f64 / area
        };
        let most = targets.keys().map(|cell| share(*cell)).fold(0.0, f64::max);
        let worth = |(cell, point): (&Cell, &DVec3)| {
            let share = share(*cell);
            let is_on = share >= ON_THING.min(0.9 * most) && share > 0.0;
            let distance =
                |place: &genmanip_layout::GoalPose| place.bounds.center().truncate().distance(point.truncate());
            let near = places.iter().map(distance).fold(f64::INFINITY, f64::min);
            is_on.then_some((-near.min(1.0) + 0.002 * share, *cell))
        };
        targets.iter().filter_map(worth).collect()
    }
}

impl VisionModel for Oracle {
    fn answer(&self, question: &Question) -> Result<ModelReply, ServiceError> {
        let wrong = self.flaw(question).and_then(|class| Some((class, flaws::answer(self, class, question)?)));
        let text = match wrong {
            Some((class, text)) => {
                self.truth.record_injected(question.ask, class);
                text
            }
            None => self.right_answer(question).to_string(),
        };
        Ok(ModelReply { text, usage: None, cut_off: false })
    }
}
