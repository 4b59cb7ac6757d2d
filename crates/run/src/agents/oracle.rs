//! A model that knows the truth, for measuring everything but the model.
//!
//! It answers only with marks that were drawn: no mask that covers the thing by half, then -1.
//! It does not tell the agent anything else.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};

use genmanip_agent::ask::{Answered, Marks, Question, ServiceError, Stage, VisionModel};
use genmanip_agent::grid::{Cell, Grid};
use genmanip_agent::segmentation::Mask;
use genmanip_core::glam::{DQuat, DVec3};
use genmanip_core::{Atom, AtomVerdict, Relation, TriedGrasp};
use genmanip_layout::{GoalPoseSettings, GoalSearch, Move, moves};
use genmanip_motion::Planner;
use genmanip_rollout::{RolloutSettings, Stage as Scene};
use genmanip_scene::relations::{PosedScene, judge_atom, judge_goal, planar_gap};
use rand::RngExt;
use serde_json::json;

use super::{Injection, Truth};

/// A mask must cover the thing by this much (intersection over union) to be its mask.
const SAME_MASK: f64 = 0.5;
/// Margins beyond this make an answer no better, m.
const AMPLE_M: f64 = 0.03;
/// Clearance below which a place counts as taken, m.
const TAKEN_M: f64 = 0.01;
/// Tried grasps within this distance of a point speak for it, m.
const NEAR_POINT_M: f64 = 0.03;
/// Height of a grid path over the table, m, and at its ends.
const CARRY_M: f64 = 0.28;
const END_M: f64 = 0.2;
/// Share of a cell's pixels that must be of a thing for the cell to be on it.
const ON_THING: f64 = 0.3;

/// How often the oracle answers wrongly on purpose, by stage, 0 to 1.
pub type ErrorRates = BTreeMap<Stage, f64>;

/// The oracle of one episode.
pub struct Oracle {
    truth: Truth,
    planner: Arc<Planner>,
    /// Per object, its grasps that were tried beforehand.
    grasps: Vec<Vec<TriedGrasp>>,
    errors: ErrorRates,
    /// The ask that it answers right whatever the rates say.
    forgiven: Option<usize>,
    /// What each sub-task that it worded is about.
    subtasks: Mutex<BTreeMap<String, Move>>,
}

impl Oracle {
    /// For one episode; `grasps` are those that were tried beforehand, per object.
    pub fn new(truth: Truth, planner: &Arc<Planner>, grasps: Vec<Vec<TriedGrasp>>, errors: ErrorRates) -> Self {
        Self { truth, planner: Arc::clone(planner), grasps, errors, forgiven: None, subtasks: Mutex::default() }
    }

    /// The same, but right in one ask: what would have come of it.
    #[must_use]
    pub fn forgiving(self, ask: Option<usize>) -> Self {
        Self { forgiven: ask, ..self }
    }

    /// Whether this answer is to be wrong, decided by the episode's seed and the number of the ask.
    fn errs(&self, question: &Question) -> bool {
        let rate = self.errors.get(&question.stage).copied().unwrap_or(0.0);
        let seed = self.truth.now().seed;
        let draw = |seed: genmanip_core::Seed| {
            seed.fork("oracle error").fork_index(question.ask as u64).rng().random::<f64>() < rate
        };
        let errs = rate > 0.0 && self.forgiven != Some(question.ask) && seed.is_some_and(draw);
        if errs {
            self.truth.now().injected.push(Injection { ask: question.ask, stage: question.stage });
        }
        errs
    }

    /// A number below a bound, of this ask's own.
    fn draw(&self, question: &Question, bound: usize) -> usize {
        let seed = self.truth.now().seed.unwrap_or(genmanip_core::Seed::new(0));
        seed.fork("oracle choice").fork_index(question.ask as u64).rng().random_range(0..bound.max(1))
    }

    /// The move that a sub-task is about.
    fn step(&self, subtask: &str) -> Option<Move> {
        self.subtasks.lock().unwrap_or_else(PoisonError::into_inner).get(subtask).cloned()
    }

    fn decompose(&self, question: &Question) -> serde_json::Value {
        let stage = self.truth.stage();
        let scene = self.truth.scene();
        let holds = |atom: &Atom| judge_atom(&scene, atom, &stage.relations).holds;
        let undone = |plan: Vec<Move>| -> Vec<Move> {
            plan.into_iter().filter(|step| step.state().is_none() && !step.atoms.iter().all(holds)).collect()
        };
        let plans: Vec<Vec<Move>> = moves(&stage.goal, &scene).into_iter().map(undone).collect();
        let plan = plans.into_iter().filter(|plan| !plan.is_empty()).min_by_key(Vec::len).unwrap_or_default();
        let errs = self.errs(question);
        let mut known = self.subtasks.lock().unwrap_or_else(PoisonError::into_inner);
        let mut subtasks = Vec::new();
        for mut step in plan {
            if errs {
                // Another thing is named than the one that should move.
                step.object = (step.object + 1) % scene.objects().len().max(1);
            }
            let mut words = self.words(&step);
            while known.get(&words).is_some_and(|other| *other != step) {
                words.push_str(" (the other one)");
            }
            known.insert(words.clone(), step);
            subtasks.push(words);
        }
        if subtasks.is_empty() {
            // Nothing can be carried any more: a sub-task has to be named all the same.
            subtasks.push(stage.scenario.task.instruction.clone());
        }
        json!({ "subtasks": subtasks })
    }

    fn words(&self, step: &Move) -> String {
        let stage = self.truth.stage();
        let name = |id: &str| stage.start().index_of(id).map_or(id, |index| stage.name(index)).to_owned();
        let places: Vec<String> = step
            .atoms
            .iter()
            .filter_map(|atom| match atom {
                Atom::Relation { relation, reference, second_reference, .. } => {
                    let reference = name(reference);
                    Some(match relation {
                        Relation::Front => format!("on the far side of the {reference}"),
                        Relation::Back => format!("on the robot's side of the {reference}"),
                        Relation::Left => format!("to the robot's left of the {reference}"),
                        Relation::Right => format!("to the robot's right of the {reference}"),
                        Relation::Near => format!("near the {reference}"),
                        Relation::Top | Relation::On => format!("on the {reference}"),
                        Relation::In => format!("in the {reference}"),
                        Relation::Between => {
                            let second = second_reference.as_deref().map_or_else(String::new, name);
                            format!("between the {reference} and the {second}")
                        }
                    })
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
        let Some(mut number) = best else { return not_found };
        if self.errs(question) && drawn.len() > 1 {
            number = (number + 1 + self.draw(question, drawn.len() - 1)) % drawn.len();
        }
        let card = &self.truth.stage().models[step.object].card;
        let color = card.colors.first().cloned().unwrap_or_default();
        json!({"number": number + 1, "object_name": self.truth.stage().name(step.object), "color": color})
    }

    fn part(&self, question: &Question) -> serde_json::Value {
        let Marks::Masks(parts) = &question.marks else {
            return json!({"number": -1, "part_name": "not_found", "color": "not_found"});
        };
        let step = self.step(&question.instruction);
        let speaks = |part: &Mask| {
            step.as_ref().map_or(0.0, |step| {
                part.indices()
                    .filter_map(|index| question.view.point(index))
                    .map(|point| self.grasps_near(step.object, point))
                    .sum()
            })
        };
        let mut number = (0..parts.len()).max_by(|a, b| speaks(&parts[*a]).total_cmp(&speaks(&parts[*b]))).unwrap_or(0);
        if self.errs(question) && parts.len() > 1 {
            number = (number + 1 + self.draw(question, parts.len() - 1)) % parts.len();
        }
        json!({"number": number + 1, "part_name": format!("part {}", number + 1), "color": "unknown"})
    }

    /// How much tried grasps speak for holding an object at a point.
    fn grasps_near(&self, object: usize, point: DVec3) -> f64 {
        let scene = self.truth.scene();
        let Some(posed) = scene.objects().nth(object) else { return 0.0 };
        let near =
            |tried: &&TriedGrasp| posed.pose.transform_point(tried.grasp.pose.position).distance(point) < NEAR_POINT_M;
        self.grasps.get(object).into_iter().flatten().filter(near).map(TriedGrasp::share).sum()
    }

    fn grab_point(&self, question: &Question) -> serde_json::Value {
        let Marks::Points(points) = &question.marks else { return json!({"selected_point": 0, "reason": ""}) };
        let known = self.truth.masks(&question.view).unwrap_or_default();
        let of = |pixel: &usize| known.iter().find(|(_, mask)| mask.pixels[*pixel]).map(|(object, _)| *object);
        let object = points.iter().find_map(of);
        let scene = self.truth.scene();
        let worth = |pixel: usize| -> (f64, f64) {
            let (Some(object), Some(point)) = (object, question.view.point(pixel)) else { return (0.0, 0.0) };
            let middle = scene.bounds(object).map_or(point, |bounds| bounds.center());
            (self.grasps_near(object, point), -middle.distance(point))
        };
        let better = |a: &usize, b: &usize| {
            let (a, b) = (worth(points[*a]), worth(points[*b]));
            a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1))
        };
        let mut best = (0..points.len()).max_by(better).unwrap_or(0);
        if self.errs(question) {
            best = self.draw(question, points.len());
        }
        json!({"selected_point": best + 1, "reason": "most tried grasps are near it"})
    }

    /// The best cell for a move; any cell where none is good.
    fn cell(&self, question: &Question) -> Option<Cell> {
        let Marks::Grid { grid, targets, moved } = &question.marks else { return None };
        if self.errs(question) {
            let cells: Vec<Cell> = targets.keys().copied().collect();
            return cells.get(self.draw(question, cells.len())).copied();
        }
        let step = self.step(&question.instruction)?;
        let scene = self.truth.scene();
        let known = self.truth.masks(&question.view).unwrap_or_default();
        // Of what was taken by mistake the place is asked all the same.
        let taken = known.iter().max_by(|a, b| a.1.iou(moved).total_cmp(&b.1.iou(moved))).map(|(object, _)| *object);
        let object = taken.unwrap_or(step.object);
        let placed = Placed { oracle: self, scene: &scene, step: &step, object };
        let support = step.atoms.iter().find_map(|atom| match atom {
            Atom::Relation { relation, reference, .. } if relation.is_support() => scene.index_of(reference),
            _ => None,
        });
        let worth: Vec<(f64, Cell)> = match support {
            Some(support) => {
                let mask = known.iter().find(|(object, _)| *object == support).map(|(_, mask)| mask);
                placed.on(grid, targets, mask)
            }
            None => {
                // Rather a place with little room than none.
                let at = |room: Room| -> Vec<(f64, Cell)> {
                    targets.iter().filter_map(|(cell, point)| Some((placed.worth(*point, room)?, *cell))).collect()
                };
                [Room::Ample, Room::Little, Room::Any]
                    .into_iter()
                    .map(at)
                    .find(|worth| !worth.is_empty())
                    .unwrap_or_default()
            }
        };
        worth.into_iter().max_by(|a, b| a.0.total_cmp(&b.0).then(b.1.cmp(&a.1))).map(|(_, cell)| cell)
    }

    fn path(&self, question: &Question, grid: &Grid, moved: &Mask, goal: Cell) -> serde_json::Value {
        let width = moved.width as usize;
        let count = moved.indices().count().max(1) as f64;
        let sum = moved.indices().fold([0.0, 0.0], |sum, index| {
            [sum[0] + (index % width) as f64 / count, sum[1] + (index / width) as f64 / count]
        });
        let _ = question;
        let start = grid.cell_at(sum[0], sum[1]).unwrap_or(goal);
        let middle = Cell { row: (start.row + goal.row) / 2, column: (start.column + goal.column) / 2 };
        let step = |cell: Cell, height_m: f64| json!({"grid_number": cell.to_string(), "height_m": height_m, "claw_orientation": 0.0});
        let is_far = start.row.abs_diff(goal.row) + start.column.abs_diff(goal.column) > 3;
        let mut path = vec![step(start, END_M)];
        path.extend(is_far.then(|| step(middle, CARRY_M)));
        path.push(step(goal, END_M));
        json!({ "path": path })
    }

    fn finished(&self, question: &Question) -> serde_json::Value {
        let stage = self.truth.stage();
        let scene = self.truth.scene();
        let state = self.truth.now().state.clone();
        let rest = state.map(|state| Scene::rest(&state.objects, state.grasped, &RolloutSettings::default()));
        let verdict = judge_goal(&scene, &stage.goal, &rest.unwrap_or_default(), &stage.relations);
        let finished = verdict.success != self.errs(question);
        json!({"scene_description": format!("score {:.2}", verdict.score), "finished": finished})
    }
}

/// The drawn mask that covers a thing best, if any covers it by half.
fn best_mask(drawn: &[Mask], mask: &Mask) -> Option<usize> {
    let overlaps = drawn.iter().map(|other| other.iou(mask)).enumerate();
    overlaps.filter(|(_, iou)| *iou >= SAME_MASK).max_by(|a, b| a.1.total_cmp(&b.1)).map(|(index, _)| index)
}

/// How much room a place must have.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Room {
    /// Clear of everything, where things may stand.
    Ample,
    /// Clear of everything, by however little.
    Little,
    /// The best there is, even if the goal does not quite hold there.
    Any,
}

/// A thing that is put somewhere, in thought.
struct Placed<'a> {
    oracle: &'a Oracle,
    scene: &'a PosedScene,
    step: &'a Move,
    object: usize,
}

impl Placed<'_> {
    /// How well a point on the table serves, by its margins; `None` where it does not.
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

    /// Cells on what carries the thing, the better the nearer to a place where the goal holds.
    fn on(&self, grid: &Grid, targets: &BTreeMap<Cell, DVec3>, carrier: Option<&Mask>) -> Vec<(f64, Cell)> {
        let stage = self.oracle.truth.stage();
        let upright: Vec<DQuat> = self.scene.objects().map(|object| object.pose.rotation).collect();
        let search = GoalSearch {
            scene: self.scene,
            upright: &upright,
            workspace: &stage.scenario.world.workspace,
            relations: &stage.relations,
            settings: &GoalPoseSettings { count: 30, ..GoalPoseSettings::default() },
        };
        let step = Move { object: self.object, ..self.step.clone() };
        let seed = self.oracle.truth.now().seed.unwrap_or(genmanip_core::Seed::new(0));
        let places = search.places(&step, &[], &|_| true, seed.fork("oracle place"));
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
    fn answer(&self, question: &Question) -> Result<Answered, ServiceError> {
        let answer = match question.stage {
            Stage::Decompose => self.decompose(question),
            Stage::Object => self.object(question),
            Stage::Part => self.part(question),
            Stage::GrabPoint => self.grab_point(question),
            Stage::PointToPoint | Stage::GridPath => {
                let cell = self.cell(question);
                match (&question.marks, cell) {
                    (Marks::Grid { grid, moved, .. }, Some(cell)) if question.stage == Stage::GridPath => {
                        self.path(question, grid, moved, cell)
                    }
                    (_, Some(cell)) => json!({"selected_point": {"type": "grid", "label": cell.to_string()}}),
                    // It knows no cell that serves, and says so in a form that is refused.
                    (_, None) => json!({"selected_point": {"type": "grid", "label": "none"}}),
                }
            }
            Stage::Check => self.finished(question),
        };
        Ok(Answered { text: answer.to_string(), usage: None })
    }
}
