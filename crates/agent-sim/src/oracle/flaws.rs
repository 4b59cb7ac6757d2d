//! Injected errors: plausible wrong answers of the oracle, which test the failure attribution.
//!
//! They are derived from the oracle's correct answer, and never by the attribution code under test.

use genmanip_agent::ask::{Marks, Question, QuestionKind};
use genmanip_agent::grid::Cell;
use genmanip_agent::perception::on_plane;
use genmanip_core::glam::DVec3;
use genmanip_core::{Atom, FailureClass, Relation, RelationKind};
use genmanip_layout::Move;
use genmanip_relations::{PosedObject, PosedScene, judge_atom};

use super::{HIGHEST_M, Oracle, Room, best_mask, checked, part_named};
use crate::annotator::distance;

/// Answer that ignores the requested format.
const PROSE: &str = "I would say it is the one in the middle, but please look for yourself.";
/// Table height in the world frame, m.
const TABLE_M: f64 = 0.0;
/// Levels of clearance that are accepted for a wrong placement.
const ROOMS: [Room; 2] = [Room::Ample, Room::Little];

/// Wrong answer that causes a failure of `class`; `None` if this question allows no such answer.
pub(super) fn answer(oracle: &Oracle, class: FailureClass, question: &Question) -> Option<String> {
    let answer = match (class, question.stage) {
        (FailureClass::Format, _) => return Some(PROSE.into()),
        (FailureClass::Decomposition, QuestionKind::Decompose) => decomposition(oracle, question),
        (FailureClass::GraspGrounding, QuestionKind::Object) => other_mask(oracle, question),
        (FailureClass::GraspProposal, QuestionKind::Part) => {
            let parts = oracle.parts(question).into_iter();
            parts.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, part)| part_named(part))
        }
        (FailureClass::GraspProposal, QuestionKind::GrabPoint) => {
            let points = oracle.points(question).into_iter();
            let worst = points.min_by(|a, b| a.0.0.total_cmp(&b.0.0).then(a.0.1.total_cmp(&b.0.1)));
            worst.map(|(_, point)| serde_json::json!({"selected_point": point + 1, "reason": "it looks firm"}))
        }
        (FailureClass::PlanGrounding, QuestionKind::GridPath | QuestionKind::PointToPoint) => {
            other_reference(oracle, question)
        }
        (FailureClass::PlanLocation, QuestionKind::GridPath | QuestionKind::PointToPoint) => {
            other_relation(oracle, question)
        }
        (FailureClass::PlanMotion, QuestionKind::GridPath) => out_of_reach(oracle, question),
        (FailureClass::Checker, QuestionKind::Check) => {
            let verdict = oracle.truth.verdict();
            // A check that overlooks a reached goal does not fail the episode; only a false *finished* does.
            let is_fatal = oracle.dials.once.is_none() || !verdict.success;
            is_fatal.then(|| checked(!verdict.success, verdict.score, serde_json::json!([])))
        }
        _ => None,
    };
    answer.map(|answer| answer.to_string())
}

/// Correct sub-tasks, except that the first names another object or another reference.
fn decomposition(oracle: &Oracle, question: &Question) -> Option<serde_json::Value> {
    let scene = oracle.truth.scene();
    let mut plan = oracle.plan(&scene);
    let step = plan.first()?.clone();
    let stage = oracle.truth.stage();
    let wanted: Vec<usize> = oracle.truth.undone(&scene).iter().flatten().map(|step| step.object).collect();
    let name = |object: usize| stage.name(object);
    let stands_apart = |other: &usize| !is_reference(&step, *other, &scene);
    let things = (0..scene.objects().len()).filter(stands_apart);
    let things = things.filter(|&other| wanted.iter().all(|&wanted| name(wanted) != name(other)));
    let mut wrong: Vec<Move> = things.map(|other| oracle.truth.about(&step, other)).collect();
    wrong.extend(to_others(oracle, &step, &scene));
    let chosen = oracle.draw(question, wrong.len());
    *plan.first_mut()? = wrong.into_iter().nth(chosen)?;
    Some(oracle.worded(plan))
}

fn is_reference(step: &Move, object: usize, scene: &PosedScene) -> bool {
    step.atoms.iter().flat_map(Atom::references).any(|id| scene.index_of(id) == Some(object))
}

/// Variants of the move whose first reference is another object with a different name.
fn to_others(oracle: &Oracle, step: &Move, scene: &PosedScene) -> Vec<Move> {
    let stage = oracle.truth.stage();
    let Some(Atom::Relation { reference, .. }) = step.atoms.first() else { return Vec::new() };
    let Some(right) = scene.index_of(reference) else { return Vec::new() };
    let fits = |(other, _): &(usize, &PosedObject)| {
        *other != step.object && !is_reference(step, *other, scene) && stage.name(*other) != stage.name(right)
    };
    let aimed = |(_, posed): (usize, &PosedObject)| {
        let atom = |atom: &Atom| match atom {
            Atom::Relation { subject, relation, reference: known, second_reference } if known == reference => {
                let (subject, second_reference) = (subject.clone(), second_reference.clone());
                Atom::Relation { subject, relation: *relation, reference: posed.id.clone().into(), second_reference }
            }
            other => other.clone(),
        };
        Move { object: step.object, atoms: step.atoms.iter().map(atom).collect() }
    };
    scene.objects().enumerate().filter(fits).map(aimed).collect()
}

/// Answer with the mask of an object that need not move; `None` if there is none.
fn other_mask(oracle: &Oracle, question: &Question) -> Option<serde_json::Value> {
    let (Some(step), Marks::Masks(drawn)) = (oracle.step(&question.instruction), &question.marks) else { return None };
    let known = oracle.truth.masks(&question.view)?;
    let wanted: Vec<usize> =
        oracle.truth.undone(&oracle.truth.scene()).iter().flatten().map(|step| step.object).collect();
    let others = known.iter().filter(|(object, _)| *object != step.object && !wanted.contains(object));
    let masks: Vec<usize> = others.filter_map(|(_, mask)| best_mask(drawn, mask)).collect();
    // The answer states the name of the correct object, but the number of the wrong mask.
    masks.get(oracle.draw(question, masks.len())).map(|&mask| oracle.named(mask, step.object))
}

/// Move of the sub-task; `None` if the agent picked another object.
fn taken_step(oracle: &Oracle, question: &Question) -> Option<Move> {
    let Marks::Grid { moved, .. } = &question.marks else { return None };
    let step = oracle.step(&question.instruction)?;
    let object = oracle.taken(question, moved)?;
    (object == step.object).then_some(step)
}

/// True if the move would be completed with the centre of its object's underside at a point (world frame, m).
fn would_do(oracle: &Oracle, step: &Move, point: DVec3, scene: &PosedScene) -> bool {
    let mut after = scene.clone();
    let Some(bounds) = scene.bounds(step.object) else { return false };
    after.shift(step.object, point - bounds.center().with_z(bounds.min.z));
    let relations = &oracle.truth.stage().relations;
    let holds = |atom: &Atom| match atom {
        // The resting pose is unknown, so any point above the support counts as reached.
        Atom::Relation { relation, reference, .. } if relation.is_support() => {
            let carrier = after.index_of(reference).and_then(|carrier| after.bounds(carrier));
            carrier.is_some_and(|carrier| {
                (carrier.min.x..carrier.max.x).contains(&point.x) && (carrier.min.y..carrier.max.y).contains(&point.y)
            })
        }
        _ => judge_atom(&after, atom, relations).holds,
    };
    step.atoms.iter().all(holds)
}

/// Answer with a cell that completes the move for a wrong reference. The cell is nearer to the wrong reference than to
/// the correct one; otherwise it would also count as a wrong location at the correct reference.
fn other_reference(oracle: &Oracle, question: &Question) -> Option<serde_json::Value> {
    let step = taken_step(oracle, question)?;
    let scene = oracle.truth.scene();
    let Marks::Grid { targets, .. } = &question.marks else { return None };
    let apart = |to: &Move, cell: &Cell| {
        let reference = to.atoms.iter().flat_map(Atom::references).next();
        let bounds = reference.and_then(|id| scene.index_of(id)).and_then(|object| scene.bounds(object));
        bounds.zip(targets.get(cell)).map(|(bounds, point)| distance(&bounds, *point))
    };
    let nearer = |other: &Move| {
        let cells = cells_of(oracle, question, &step, std::slice::from_ref(other), &scene);
        cells.into_iter().find(|cell| apart(other, cell).zip(apart(&step, cell)).is_some_and(|(it, right)| it < right))
    };
    let cells: Vec<Cell> = to_others(oracle, &step, &scene).iter().filter_map(nearer).collect();
    let chosen = cells.get(oracle.draw(question, cells.len()))?;
    Some(oracle.sent_to(question, *chosen, None))
}

/// Answer with a cell in a wrong relation to the correct reference.
fn other_relation(oracle: &Oracle, question: &Question) -> Option<serde_json::Value> {
    let step = taken_step(oracle, question)?;
    let scene = oracle.truth.scene();
    let Some(Atom::Relation { relation, .. }) = step.atoms.first() else { return None };
    let confused: Vec<Relation> = match relation.kind() {
        RelationKind::Side(_) => relation.inverse().into_iter().collect(),
        RelationKind::Support(_) => vec![Relation::Near],
        RelationKind::Around | RelationKind::Between => {
            vec![Relation::Left, Relation::Right, Relation::Front, Relation::Back]
        }
    };
    let other = |relation: &Relation| {
        let atom = |atom: &Atom| match atom {
            Atom::Relation { subject, reference, .. } => Atom::Relation {
                subject: subject.clone(),
                relation: *relation,
                reference: reference.clone(),
                second_reference: None,
            },
            state @ Atom::State { .. } => state.clone(),
        };
        // Only the first of several conditions is kept, which is the one that the instruction states.
        Move { object: step.object, atoms: step.atoms.iter().take(1).map(atom).collect() }
    };
    let others: Vec<Move> = confused.iter().map(other).collect();
    let cells = cells_of(oracle, question, &step, &others, &scene);
    let chosen = cells.get(oracle.draw(question, cells.len()))?;
    Some(oracle.sent_to(question, *chosen, None))
}

/// Cells that complete one of `others`, but neither `step` nor an unfinished goal move of its object.
fn cells_of(oracle: &Oracle, question: &Question, step: &Move, others: &[Move], scene: &PosedScene) -> Vec<Cell> {
    let Marks::Grid { targets, .. } = &question.marks else { return Vec::new() };
    let undone = oracle.truth.undone(scene);
    let wanted: Vec<&Move> =
        undone.iter().flatten().filter(|wanted| wanted.object == step.object).chain([step]).collect();
    let fits = |other: &Move| {
        let cell = oracle.cell_for(question, other, &ROOMS)?;
        let point = *targets.get(&cell)?;
        let is_meant = would_do(oracle, other, point, scene);
        (is_meant && !wanted.iter().any(|wanted| would_do(oracle, wanted, point, scene))).then_some(cell)
    };
    others.iter().filter_map(fits).collect()
}

/// Correct path with an additional cell that the arm cannot reach at the height [`HIGHEST_M`].
fn out_of_reach(oracle: &Oracle, question: &Question) -> Option<serde_json::Value> {
    let Marks::Grid { grid, .. } = &question.marks else { return None };
    let goal = oracle.cell(question)?;
    let over = |cell: Cell| Some(on_plane(&question.view, grid.center(cell), TABLE_M)? + DVec3::Z * HIGHEST_M);
    let far = grid.cells().filter_map(|cell| Some((over(cell)?, cell)));
    let far = far.filter(|(point, _)| !oracle.planner.reaches_from_above(*point));
    let (_, farthest) = far.max_by(|a, b| a.0.length().total_cmp(&b.0.length()))?;
    Some(oracle.sent_to(question, goal, Some(farthest)))
}
