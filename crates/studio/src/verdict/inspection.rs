//! Inspection of one scenario: the stages of its verdict.

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::sync::Arc;

use genmanip_assets::AssetError;
use genmanip_core::{Atom, AtomVerdict, Measurement, ReferenceId, Scenario, Seed, Unit, VerifiedGrasp};
use genmanip_layout::{Move, ReachCheck, Rejection, first_drift, hidden, moves, obstacles, overlaps};
use genmanip_relations::{PosedScene, Rest, judge_edges, judge_goal, judge_states, planar_gap};
use genmanip_sim::SimError;

use super::equipment::{Equipment, VerdictError};
use super::problem::{Problem, ProblemCode, Stage, Verdict};
use super::support::{Below, support};
use super::wording::{self, in_sentence};

/// Maximum number of reachable grasps that are tested for collisions with neighbours.
const MAX_BLOCKED: usize = 24;
/// Number of random streams in which a grasp or a goal pose is searched before it counts as not existing.
const TRIES: u64 = 3;

/// A scenario under inspection. Stages may be requested in any order; their results are cached.
pub struct Inspection<'a> {
    /// The inspected scenario.
    pub(super) scenario: Arc<Scenario>,
    pub(super) equipment: &'a Equipment,
    /// The posed scene, or the reason why it cannot be built.
    posed: Result<PosedScene, AssetError>,
    pub(super) found: BTreeMap<Stage, Vec<Problem>>,
}

impl<'a> Inspection<'a> {
    /// An inspection without results yet.
    pub fn new(scenario: Arc<Scenario>, equipment: &'a Equipment) -> Self {
        let posed = equipment.scene(&scenario);
        Self { scenario, equipment, posed, found: BTreeMap::new() }
    }

    /// Problems that a stage finds.
    ///
    /// # Errors
    /// [`VerdictError`].
    pub fn problems(&mut self, stage: Stage) -> Result<Vec<Problem>, VerdictError> {
        if let Some(known) = self.found.get(&stage) {
            return Ok(known.clone());
        }
        let found = match (&self.posed, stage) {
            (_, Stage::Wording) => wording::problems(&self.scenario),
            (Err(error), Stage::Relations) => vec![self.missing(error)],
            // Without the objects, the other stages cannot be judged.
            (Err(_), _) => Vec::new(),
            (Ok(scene), Stage::Relations) => self.relations(scene),
            (Ok(scene), Stage::Collision) => self.collision(scene)?,
            (Ok(scene), Stage::Reach) => self.reach(scene)?,
            (Ok(scene), Stage::Visibility) => self.visibility(scene)?,
            (Ok(scene), Stage::Stability) => self.stability(scene)?,
            (Ok(scene), Stage::Goal) => self.goal(scene)?,
        };
        self.found.insert(stage, found.clone());
        Ok(found)
    }

    /// Verdict of all stages; `revision` is only copied into it.
    ///
    /// # Errors
    /// [`VerdictError`].
    pub fn verdict(&mut self, revision: u64) -> Result<Verdict, VerdictError> {
        let mut problems = Vec::new();
        for stage in Stage::ALL {
            problems.extend(self.problems(stage)?);
        }
        Ok(Verdict { revision, problems })
    }

    /// The posed scene; `None` if an object is missing.
    pub(super) fn scene(&self) -> Option<&PosedScene> {
        self.posed.as_ref().ok()
    }

    /// Name of an object or surface in a sentence: `the cola can`.
    pub(super) fn name(&self, id: &ReferenceId) -> String {
        let in_graph = self.scenario.task.scene_graph.index_of(id).is_some();
        let of_model = || {
            let scene = self.scene()?;
            scene.objects().find(|object| object.id == *id).map(|object| object.model.card.name.clone())
        };
        let of_surface = || self.scenario.world.surface(id).map(|surface| surface.name.clone());
        let name = if in_graph { None } else { of_model().or_else(of_surface) };
        format!("the {}", in_sentence(&name.unwrap_or_else(|| self.scenario.task.name_of(id))))
    }

    fn id(&self, index: usize) -> ReferenceId {
        self.scenario.objects[index].id.clone().into()
    }

    fn missing(&self, error: &AssetError) -> Problem {
        let assets = self.equipment.assets;
        let culprit = self.scenario.objects.iter().find(|object| assets.instance(object).is_err());
        let id = culprit.map(|object| object.id.clone().into());
        Problem::new(Stage::Relations, ProblemCode::MissingObject, id, error.to_string())
    }

    fn relations(&self, scene: &PosedScene) -> Vec<Problem> {
        let (task, settings) = (&self.scenario.task, &self.scenario.world.relations);
        let mut found = Vec::new();
        for verdict in judge_edges(scene, &task.scene_graph, settings).iter().filter(|verdict| !verdict.holds) {
            found.push(self.of_verdict(ProblemCode::EdgeFalse, verdict));
        }
        for verdict in judge_states(scene, &task.scene_graph, settings).iter().filter(|verdict| !verdict.holds) {
            found.push(self.of_verdict(ProblemCode::StateFalse, verdict));
        }
        let goal = judge_goal(scene, &task.judged_goal(), &Rest::default(), settings);
        if goal.success {
            let held = goal.best().unwrap_or_default();
            let words: Vec<String> = held.iter().map(|verdict| self.in_words(&verdict.atom)).collect();
            let object = held.first().map(|verdict| verdict.atom.subject().clone().into());
            let message = format!("the goal holds already: {}", words.join(", and "));
            let problem = Problem::new(Stage::Relations, ProblemCode::GoalHolds, object, message);
            found.push(match held.first().and_then(|verdict| verdict.atom.references().next()) {
                Some(other) => problem.with(other.clone()),
                None => problem,
            });
        }
        found
    }

    fn of_verdict(&self, code: ProblemCode, verdict: &AtomVerdict) -> Problem {
        let message = format!("{} is false: {}", self.in_words(&verdict.atom), verdict.explanation);
        let object = Some(verdict.atom.subject().clone().into());
        let problem = Problem::new(Stage::Relations, code, object, message);
        let problem = match verdict.measurements.iter().find(|measured| !measured.met) {
            Some(Measurement { value, threshold, unit: Unit::Metre, .. }) => {
                problem.measured(value * 1e3, threshold * 1e3, "mm")
            }
            Some(Measurement { value, threshold, unit, .. }) => problem.measured(*value, *threshold, unit.symbol()),
            None => problem,
        };
        match verdict.atom.references().next() {
            Some(other) => problem.with(other.clone()),
            None => problem,
        }
    }

    /// Text of a condition as a clause: `the cola can left of the mug`.
    fn in_words(&self, atom: &Atom) -> String {
        match atom {
            Atom::Relation { subject, relation, reference, second_reference } => {
                let second = second_reference.as_ref().map(|second| format!(" and {}", self.name(second)));
                let (subject, reference) = (self.name(subject), self.name(reference));
                format!("{subject} {} {reference}{}", relation.facts().located[0], second.unwrap_or_default())
            }
            Atom::State { object, state } => format!("{} {}", self.name(object), state.replace('_', " ")),
        }
    }

    fn collision(&self, scene: &PosedScene) -> Result<Vec<Problem>, VerdictError> {
        let Equipment { settings, .. } = self.equipment;
        let world = &self.scenario.world;
        let mut found = Vec::new();
        let simulated = overlaps(scene, world, settings);
        for overlap in unless_unstable(Stage::Collision, simulated)?.unwrap_or_default() {
            let (depth_mm, limit_mm) = (overlap.depth_m * 1e3, settings.max_penetration_m * 1e3);
            let id = self.id(overlap.object);
            let (name, other) = (self.name(&id), self.name(&overlap.other));
            let message = format!("{name} overlaps {other} by {depth_mm:.1} mm (at most {limit_mm:.1} mm)");
            let problem = Problem::new(Stage::Collision, ProblemCode::Overlap, Some(id), message);
            found.push(problem.measured(depth_mm, limit_mm, "mm").with(overlap.other));
        }
        for index in 0..scene.objects().len() {
            let (below, id) = (support(scene, world, index), self.id(index));
            let name = self.name(&id);
            let limit_m = settings.drop_m;
            if below.below == Below::Nothing || !below.is_inside {
                let message = format!("{name} is not over the top of a table or another object");
                found.push(Problem::new(Stage::Collision, ProblemCode::Outside, Some(id), message));
            } else if below.gap_m > limit_m {
                let (gap_mm, limit_mm) = (below.gap_m * 1e3, limit_m * 1e3);
                let other = match below.below {
                    Below::Object(other) => self.id(other),
                    Below::Surface(surface) => world.surfaces[surface].id.clone().into(),
                    Below::Nothing => continue,
                };
                let message =
                    format!("{name} floats {gap_mm:.1} mm above {} (at most {limit_mm:.1} mm)", self.name(&other));
                let problem = Problem::new(Stage::Collision, ProblemCode::Floating, Some(id), message);
                found.push(problem.measured(gap_mm, limit_mm, "mm").with(other));
            }
        }
        Ok(found)
    }

    /// Verified grasps of the objects with nodes, in the order of the nodes.
    fn known_grasps(&self, scene: &PosedScene, stage: Stage) -> Result<Vec<&'a [VerifiedGrasp]>, VerdictError> {
        let Equipment { planner, grasps, .. } = self.equipment;
        let nodes = self.scenario.task.scene_graph.nodes.len();
        let known = scene.objects().take(nodes).map(|object| grasps.of(planner.robot(), &object.model));
        known.collect::<Result<_, _>>().map_err(|error| VerdictError::new(stage, error))
    }

    /// Reachability check of the layout with this random stream.
    fn check<'s>(&'s self, scene: &'s PosedScene, known: &'s [&'s [VerifiedGrasp]], seed: Seed) -> ReachCheck<'s> {
        let Equipment { planner, settings, .. } = self.equipment;
        ReachCheck { scene, world: &self.scenario.world, planner, settings, known_grasps: known, seed }
    }

    fn seeds(&self) -> impl Iterator<Item = Seed> + use<> {
        let seed = self.scenario.seed.fork("studio");
        (0..TRIES).map(move |number| seed.fork_index(number))
    }

    fn reach(&self, scene: &PosedScene) -> Result<Vec<Problem>, VerdictError> {
        let grasps = self.known_grasps(scene, Stage::Reach)?;
        let mut fewest: Option<Vec<Problem>> = None;
        let mut judged: BTreeMap<usize, Option<Problem>> = BTreeMap::new();
        for alternative in moves(&self.scenario.task.judged_goal(), scene) {
            let mut found = Vec::new();
            for step in alternative.iter().filter(|step| step.state().is_none()) {
                let problem = match judged.entry(step.object) {
                    Entry::Occupied(known) => known.get().clone(),
                    Entry::Vacant(new) => new.insert(self.ungraspable(scene, &grasps, step.object)?).clone(),
                };
                found.extend(problem);
            }
            if found.is_empty() {
                return Ok(Vec::new());
            }
            if fewest.as_ref().is_none_or(|fewest| found.len() < fewest.len()) {
                fewest = Some(found);
            }
        }
        Ok(fewest.unwrap_or_default())
    }

    /// Problem that explains why an object cannot be grasped.
    fn ungraspable(
        &self,
        scene: &PosedScene,
        known: &[&[VerifiedGrasp]],
        object: usize,
    ) -> Result<Option<Problem>, VerdictError> {
        let id = self.id(object);
        let name = self.name(&id);
        let unreachable =
            |message: String| Ok(Some(Problem::new(Stage::Reach, ProblemCode::Unreachable, Some(id.clone()), message)));
        let among_all = obstacles::around(scene, None);
        let checks: Vec<ReachCheck> = self.seeds().map(|seed| self.check(scene, known, seed)).collect();
        let mut candidates = Vec::new();
        // Known grasps, which do not depend on the random stream, then sampled ones of each stream.
        let groups = checks.iter().take(1).map(|check| check.known(object));
        for group in groups.chain(checks.iter().map(|check| check.sampled(object))) {
            let group = match group {
                Ok(group) => group,
                Err(reason) => return unreachable(format!("{name} has no grasps: {reason}")),
            };
            if !checks[0].feasible(object, &among_all, group.clone(), 1).is_empty() {
                return Ok(None);
            }
            candidates.extend(group);
        }
        let others: Vec<usize> = (0..scene.objects().len()).filter(|&other| other != object).collect();
        let only = |kept: Option<usize>| {
            let mut occupied = among_all.clone();
            for &other in others.iter().filter(|&&other| Some(other) != kept) {
                occupied.remove(self.id(other).as_str());
            }
            occupied
        };
        let in_reach = checks[0].feasible(object, &only(None), candidates, MAX_BLOCKED);
        if in_reach.is_empty() {
            return unreachable(format!("no grasp of {name} is in reach of the arm"));
        }
        // For each grasp, the neighbours that it would hit.
        let mut hits: Vec<Vec<usize>> = vec![Vec::new(); in_reach.len()];
        for &other in &others {
            let occupied = only(Some(other));
            for (grasp, hits) in in_reach.iter().zip(&mut hits) {
                if checks[0].feasible(object, &occupied, vec![grasp.clone()], 1).is_empty() {
                    hits.push(other);
                }
            }
        }
        let fewest = hits.iter().map(Vec::len).filter(|&count| count > 0).min().unwrap_or(0);
        // The nearest neighbour that obstructs the grasps with the fewest obstructing neighbours.
        let is_in_the_way = |other: usize| hits.iter().any(|hits| hits.len() == fewest && hits.contains(&other));
        let gap_m = |other: usize| planar_gap(scene, object, other).unwrap_or(f64::INFINITY);
        let rank = |one: &usize, two: &usize| {
            is_in_the_way(*two).cmp(&is_in_the_way(*one)).then(gap_m(*one).total_cmp(&gap_m(*two)))
        };
        let Some(other) = others.into_iter().min_by(rank) else { return Ok(None) };
        let (gap_mm, limit_mm) = (gap_m(other) * 1e3, self.equipment.settings.min_gap_m * 1e3);
        let more = if fewest == 1 { "" } else { " and others" };
        let other = self.id(other);
        let message = format!("every grasp of {name} would hit {}{more}, {gap_mm:.0} mm beside it", self.name(&other));
        let problem = Problem::new(Stage::Reach, ProblemCode::GraspBlocked, Some(id.clone()), message);
        Ok(Some(problem.measured(gap_mm, limit_mm, "mm").with(other)))
    }

    fn visibility(&self, scene: &PosedScene) -> Result<Vec<Problem>, VerdictError> {
        let Equipment { planner, settings, .. } = self.equipment;
        let nodes = self.scenario.task.scene_graph.nodes.len();
        let found = hidden(scene, &self.scenario.world, nodes, nodes, planner.robot(), settings);
        let found = found.map_err(|error| VerdictError::new(Stage::Visibility, error))?;
        let problem = |seen: &genmanip_layout::Hidden| {
            let id = self.id(seen.object);
            let (share, limit) = (seen.share * 100.0, settings.min_visible_share * 100.0);
            let message = format!(
                "no prompt camera sees enough of {}: at most {share:.0} % of it, {} pixels (at least {limit:.0} %, {} pixels)",
                self.name(&id),
                seen.pixels,
                settings.min_pixels
            );
            let problem = Problem::new(Stage::Visibility, ProblemCode::Hidden, Some(id), message);
            problem.measured(share, limit, "%")
        };
        Ok(found.iter().map(problem).collect())
    }

    fn stability(&self, scene: &PosedScene) -> Result<Vec<Problem>, VerdictError> {
        let settings = &self.equipment.settings;
        let drift = unless_unstable(Stage::Stability, first_drift(scene, &self.scenario.world, settings))?;
        Ok(match drift {
            None => {
                let message = "the simulation of the scene becomes unstable";
                vec![Problem::new(Stage::Stability, ProblemCode::Unstable, None, message)]
            }
            Some(None) => Vec::new(),
            Some(Some(drift)) => {
                let id = self.id(drift.object);
                let (drift_mm, limit_mm) = (drift.drift_m * 1e3, settings.max_drift_m * 1e3);
                let message =
                    format!("{} moves by {drift_mm:.1} mm when left alone (at most {limit_mm:.1} mm)", self.name(&id));
                let problem = Problem::new(Stage::Stability, ProblemCode::Unstable, Some(id), message);
                vec![problem.measured(drift_mm, limit_mm, "mm")]
            }
        })
    }

    fn goal(&self, scene: &PosedScene) -> Result<Vec<Problem>, VerdictError> {
        let known = self.known_grasps(scene, Stage::Goal)?;
        let mut reason = None;
        for alternative in moves(&self.scenario.task.judged_goal(), scene) {
            let infeasible = |seed: Seed| self.check(scene, &known, seed).infeasible(&alternative);
            let mut rejections = self.seeds().map(infeasible);
            let first = rejections.next().flatten();
            // No stream decides if a state is reachable, and a search that fails is the most expensive of all checks.
            let is_settled = matches!(first, Some(Rejection::UnreachableState { .. }));
            // The goal is reachable if it is with one stream; otherwise the first reason is reported.
            if first.is_none() || !is_settled && rejections.any(|rejection| rejection.is_none()) {
                return Ok(Vec::new());
            }
            reason = reason.or(first.map(|first| (first, alternative)));
        }
        Ok(reason.map(|(rejection, alternative)| self.of_goal(scene, &rejection, &alternative)).into_iter().collect())
    }

    fn of_goal(&self, scene: &PosedScene, rejection: &Rejection, alternative: &[Move]) -> Problem {
        let id = match rejection {
            Rejection::NoSpaceAtGoal(object) | Rejection::UnreachableState { object, .. } => Some(object.id.clone()),
            _ => alternative.first().and_then(|step| Some(scene.objects().nth(step.object)?.id.clone())),
        };
        let atoms = alternative.iter().flat_map(|step| &step.atoms);
        let wanted = atoms.filter(|atom| Some(atom.subject()) == id.as_ref()).map(|atom| self.in_words(atom));
        let wanted = wanted.collect::<Vec<_>>().join(", and ");
        match rejection {
            Rejection::UnreachableState { .. } => {
                let message = format!("the arm cannot bring about: {wanted}");
                Problem::new(Stage::Goal, ProblemCode::Unreachable, id.map(Into::into), message)
            }
            rejection => {
                let message = format!("no free pose was found for the goal: {wanted} ({rejection})");
                let anchor = alternative.iter().flat_map(|step| &step.atoms);
                let anchor =
                    anchor.filter(|atom| Some(atom.subject()) == id.as_ref()).find_map(|atom| atom.references().next());
                let problem = Problem::new(Stage::Goal, ProblemCode::NoGoalPose, id.clone().map(Into::into), message);
                match anchor {
                    Some(anchor) => problem.with(anchor.clone()),
                    None => problem,
                }
            }
        }
    }
}

/// Result of a simulation; `None` if it became unstable, which is a problem of the scene. Other errors are those of the
/// program.
fn unless_unstable<T>(stage: Stage, simulated: Result<T, SimError>) -> Result<Option<T>, VerdictError> {
    match simulated {
        Ok(value) => Ok(Some(value)),
        Err(SimError::Unstable { .. } | SimError::ContactsDropped { .. }) => Ok(None),
        Err(error) => Err(VerdictError::new(stage, error)),
    }
}
