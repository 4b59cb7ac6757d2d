//! Backtracking search for object poses: sampled within the feasible intervals of the relations and accepted if every
//! edge to a placed object holds.

use std::sync::Arc;

use genmanip_core::glam::{DVec2, DVec3};
use genmanip_core::{Aabb, Atom, Pose, Relation, Seed, Unit};
use genmanip_relations::{
    PosedObject, PosedScene, RelationSettings, ShapeCache, Window, contact_below, judge_atom, outlines_apart,
    placement_window,
};
use rand::{Rng, RngExt};

use crate::between;
use crate::context::{Context, GoalRegion};
use crate::order::Step;
use crate::rejection::{NamedObject, Rejection, Rejections};
use crate::sampled_layout::{Contradiction, SampledLayout, SupportRegion};
use crate::visibility::VisibilityCheck;

/// Clearance around an object at its goal (m). Chosen larger than `GoalPoseSettings::clearance_m`, since only bounds
/// are compared here.
const GOAL_CLEARANCE_M: f64 = 0.02;

/// Additional reach allowed for placements (m). Chosen: the exact check follows after settling.
const GOAL_REACH_M: f64 = 0.03;

/// Initial height above the carrier when lowering an object onto it (m); any positive value works.
pub(crate) const LOWERING_HEIGHT_M: f64 = 0.01;

/// Minimum vertical gap of objects on different supports (m). Chosen larger than contact penetration.
const MIN_VERTICAL_GAP_M: f64 = 0.01;

/// Centre distance below which two outlines certainly overlap, as a share of the mean width. Chosen: half of the value
/// for adjacent boxes.
const OVERLAP_SHARE: f64 = 0.25;

/// Space kept in addition to the minimum gap for an object to be placed between two others (m); chosen.
const BETWEEN_MARGIN_M: f64 = 0.005;

/// Probability of backtracking to the last blocker instead of a random one. Chosen to change little without cycling.
const LAST_BLOCKER_PROBABILITY: f64 = 0.6;

/// Position of objects not placed yet, along x (m); far from any table.
const PARKED_M: f64 = -10.0;

/// A layout in which only some objects are placed.
#[derive(Clone, Debug)]
pub(crate) struct Partial {
    pub scene: PosedScene,
    /// Indices of placed objects, in placement order.
    pub placed: Vec<usize>,
    /// Index of the object without a valid pose; `None` if all objects have one.
    pub stuck: Option<usize>,
}

/// Places all objects; the error is the partial layout with the object that has no valid pose.
pub(crate) fn place_all(
    context: &Context,
    seed: Seed,
    aligned: bool,
    shapes: &mut ShapeCache,
    rejections: &mut Rejections,
) -> Result<PosedScene, Option<Partial>> {
    let rng = &mut seed.rng();
    let sampled = match SampledLayout::new(context, aligned, rng) {
        Ok(sampled) => sampled,
        Err(Contradiction(edges)) => {
            rejections.count(Rejection::RelationsInfeasible);
            edges.iter().for_each(|&edge| rejections.blame(&context.edges[edge].0));
            return Err(None);
        }
    };
    let scene = parked(context, shapes);
    let mut search = Search { context, sampled, scene, placed: Vec::new(), blockers: Vec::new(), visibility: None };
    let mut furthest: Option<Partial> = None;
    let mut failures = 0;
    loop {
        let step = context.steps.get(search.placed.len());
        match step {
            Some(step) if search.find_place(step, rng, rejections) && search.is_visible(step, rejections) => {
                search.placed.push(step.object);
                continue;
            }
            None if search.goal_has_space(rng, rejections) => return Ok(search.scene),
            _ => {}
        }
        if furthest.as_ref().is_none_or(|partial| partial.placed.len() < search.placed.len()) {
            let (scene, placed) = (search.scene.clone(), search.placed.clone());
            furthest = Some(Partial { scene, placed, stuck: step.map(|step| step.object) });
        }
        failures += 1;
        let backtrack = search.backtrack(rng);
        if failures > context.settings.max_retreats || backtrack.is_none() {
            if let Some(stuck) = furthest.as_ref().and_then(|partial| partial.stuck) {
                rejections.count(Rejection::NoPlace(search.named(stuck)));
            }
            return Err(furthest);
        }
        search.placed.truncate(backtrack.unwrap_or(0));
    }
}

/// All objects in their initial joint states, far from the table and from each other.
pub(crate) fn parked(context: &Context, shapes: &mut ShapeCache) -> PosedScene {
    let objects = context.models.iter().enumerate().map(|(index, model)| PosedObject {
        id: context.id(index),
        model: Arc::clone(model),
        pose: Pose::from_position(DVec3::new(PARKED_M - index as f64, 0.0, 0.0)),
        joint_positions: context.joints[index].clone(),
    });
    PosedScene::new(objects.collect(), &context.world.surfaces, shapes)
}

struct Search<'a> {
    context: &'a Context<'a>,
    sampled: SampledLayout,
    scene: PosedScene,
    placed: Vec<usize>,
    /// Indices of the placed objects that prevented a pose of the current object.
    blockers: Vec<usize>,
    /// Visibility check, created on first use.
    visibility: Option<VisibilityCheck<'a>>,
}

impl<'a> Search<'a> {
    /// Samples a pose that satisfies all constraints; false if no candidate does.
    fn find_place(&mut self, step: &Step, rng: &mut impl Rng, rejections: &mut Rejections) -> bool {
        self.blockers.clear();
        let Some([low, high]) = self.window(step.object) else {
            rejections.count(Rejection::RelationsInfeasible);
            self.block_relatives(step.object);
            return false;
        };
        (0..self.context.settings.candidates_per_object).any(|_| {
            let center = low + (high - low) * DVec2::new(rng.random(), rng.random());
            self.fits(step, center, rejections)
        })
    }

    /// True if an object inside another one is visible to a camera; otherwise the search backtracks to the container.
    fn is_visible(&mut self, step: &Step, rejections: &mut Rejections) -> bool {
        let Some((carrier, _)) = step.support else { return true };
        let top = |object: usize| self.scene.bounds(object).map(|bounds| bounds.max.z);
        if top(step.object) >= top(carrier) {
            return true;
        }
        let Context { world, robot, settings, .. } = self.context;
        let visibility = match &mut self.visibility {
            Some(visibility) => Some(visibility),
            // Rendering errors are reported by the check of the settled layout.
            visibility => VisibilityCheck::new(&self.scene, world, robot).ok().map(|new| visibility.insert(new)),
        };
        let hidden =
            visibility.map(|visibility| visibility.is_hidden_by(&[carrier], step.object, &self.scene, settings));
        if !matches!(hidden, Some(Ok(true))) {
            return true;
        }
        rejections.count(Rejection::Unseen(self.named(step.object)));
        self.blockers = vec![carrier];
        false
    }

    /// Feasible region of the object's centre, as opposite corners; `None` if it is empty.
    fn window(&self, object: usize) -> Option<[DVec2; 2]> {
        let centers = || self.placed.iter().map(|&other| (other, self.center(other)));
        let x = self.sampled.x.range(object, centers().map(|(other, center)| (other, center.x)));
        let y = self.sampled.y.range(object, centers().map(|(other, center)| (other, center.y)));
        let (mut low, mut high) = (DVec2::new(x[0], y[0]), DVec2::new(x[1], y[1]));
        for (atom, indices) in &self.context.edges {
            if let (Atom::Relation { relation: Relation::Between, .. }, &[subject, one, other]) =
                (atom, indices.as_slice())
            {
                let place = |index: usize| self.placed.contains(&index).then(|| self.center(index));
                if let Some([least, most]) = between::window(object, [subject, one, other], place) {
                    (low, high) = (low.max(least), high.min(most));
                }
            }
        }
        // Rounding may make the ends of a single-point interval swap.
        let (near, far) = (low.min(high), low.max(high));
        ((near - low).abs().max_element() < 1e-9).then_some([near, far])
    }

    /// Centre of a placed object's bounds in the table plane (m).
    fn center(&self, object: usize) -> DVec2 {
        self.scene.bounds(object).map_or(DVec2::ZERO, |bounds| bounds.center().truncate())
    }

    /// Moves the object to `center` and returns true if clearance, reach and every edge to placed objects hold.
    fn fits(&mut self, step: &Step, center: DVec2, rejections: &mut Rejections) -> bool {
        let (context, object) = (self.context, step.object);
        let [least, most] = context.reach_m;
        if context.must_be_reached(object) && !(least..=most).contains(&center.length()) {
            rejections.count(Rejection::OutOfReach);
            self.block_relatives(object);
            return false;
        }
        let oriented = &self.sampled.objects[object];
        match step.support.zip(oriented.support_region) {
            None => {
                let height = context.height(context.grounds[object]);
                let bounds = moved_to(&oriented.bounds, center, height);
                let pose = oriented.pose(center, height);
                // Bounds that certainly overlap reject most candidates cheaply.
                if let Some(blocker) = self.neighbour(object, &bounds, None) {
                    return self.reject_for(object, blocker, rejections);
                }
                self.put(object, pose);
            }
            Some(((carrier, _), support_region)) => {
                let Some(bottom) = self.bottom_on(carrier, &support_region) else { return false };
                let pose = oriented.pose(center, bottom);
                self.put(object, pose);
                // Neighbours on the same carrier are checked first: lowering is expensive, and they reject most
                // candidates.
                let beside = |&other: &usize| context.support_of(other) == Some(carrier);
                let gap = |other| context.gap(object, other);
                let blocker = self.placed.iter().copied().filter(|other| beside(other));
                if let Some(blocker) =
                    blocker.into_iter().find(|&other| !outlines_apart(&self.scene, object, other, gap(other)))
                {
                    return self.reject_for(object, blocker, rejections);
                }
                if !support_region.covered
                    && !lower_onto(&mut self.scene, object, carrier, context.settings.drop_m, context.relations)
                {
                    rejections.count(Rejection::BesideItsCarrier);
                    self.blockers.push(carrier);
                    return false;
                }
            }
        }
        let Some(bounds) = self.scene.bounds(object) else { return false };
        if !self.is_on_its_surface(step) {
            rejections.count(Rejection::RelationsInfeasible);
            self.block_relatives(object);
            return false;
        }
        if let Some(blocker) = self.neighbour(object, &bounds, Some(&self.scene)) {
            return self.reject_for(object, blocker, rejections);
        }
        self.edges_hold(object, rejections)
    }

    /// True if an object is within the top of its surface and clear of all surfaces and boards.
    fn is_on_its_surface(&self, step: &Step) -> bool {
        let ground = self.context.grounds[step.object];
        let surface = self.context.world.surfaces.get(ground).filter(|_| ground > 0 && step.support.is_none());
        let outline = self.scene.outline(step.object).unwrap_or_default();
        surface.is_none_or(|surface| surface.is_over_top(outline.iter().copied(), 0.0))
            && !self.scene.hits_surface(step.object, self.context.settings.min_gap_m)
    }

    fn put(&mut self, object: usize, pose: Pose) {
        let now = self.scene.objects().nth(object).map(|posed| posed.pose);
        match now {
            Some(now) if now.rotation == pose.rotation => self.scene.shift(object, pose.position - now.position),
            _ => self.scene.set_pose(object, pose, &self.context.joints[object]),
        }
    }

    fn reject_for(&mut self, object: usize, blocker: usize, rejections: &mut Rejections) -> bool {
        rejections.count(Rejection::TooClose);
        // Objects on a carrier are too close because of their support edges, which therefore count as conflicting.
        for step in self.context.steps.iter().filter(|step| step.object == object || step.object == blocker) {
            if let Some(edge) = step.support_edge {
                rejections.blame(&self.context.edges[edge].0);
            }
        }
        self.blockers.push(blocker);
        false
    }

    /// Height of an object's underside before it is lowered onto its carrier, or in a covered cavity (m); `None` for an
    /// unknown carrier.
    fn bottom_on(&self, carrier: usize, support_region: &SupportRegion) -> Option<f64> {
        let posed = self.scene.objects().nth(carrier)?;
        let bounds = self.scene.bounds(carrier)?;
        Some(if support_region.covered {
            posed.pose.position.z + support_region.area.min.z + self.context.settings.drop_m
        } else {
            bounds.max.z + LOWERING_HEIGHT_M
        })
    }

    /// First placed object that is too close, by bounds alone (certain overlap), or exactly if a scene with the object
    /// is given; `None` if all are far enough.
    fn neighbour(&self, object: usize, bounds: &Aabb, scene: Option<&PosedScene>) -> Option<usize> {
        let context = self.context;
        self.placed.iter().copied().find(|&other| {
            let Some(theirs) = self.scene.bounds(other) else { return false };
            let gap = context.gap(object, other);
            let apart = (bounds.min - theirs.max).max(theirs.min - bounds.max);
            let planar = apart.truncate().max(DVec2::ZERO).length();
            let beside = context.support_of(object) == context.support_of(other)
                && context.grounds[object] == context.grounds[other];
            if planar >= gap || context.carries(other, object) || context.carries(object, other) {
                return false;
            }
            // Objects on different supports may be above each other.
            if !beside && apart.z > MIN_VERTICAL_GAP_M {
                return false;
            }
            match scene {
                Some(scene) => !outlines_apart(scene, object, other, gap),
                // Centres this close always overlap, whatever the outlines.
                None => {
                    let offset = (bounds.center() - theirs.center()).truncate().abs();
                    let shorter = |bounds: &Aabb| bounds.size().truncate().min_element();
                    beside && offset.max_element() < OVERLAP_SHARE * (shorter(bounds) + shorter(&theirs))
                }
            }
        })
    }

    /// True if every edge whose objects are all placed holds with a margin.
    fn edges_hold(&mut self, object: usize, rejections: &mut Rejections) -> bool {
        let context = self.context;
        for (atom, indices) in context.edges.iter().filter(|(_, indices)| indices.contains(&object)) {
            let Atom::Relation { relation, .. } = atom else { continue };
            let unknown = |index: &&usize| **index != object && !self.placed.contains(index);
            let holds = match (relation, indices.iter().find(unknown)) {
                // Support relations are judged after settling.
                (relation, _) if relation.is_support() => true,
                (_, None) => {
                    let verdict = judge_atom(&self.scene, atom, context.relations);
                    verdict.holds
                        && verdict.normalised_margin() >= Unit::Metre.normalise(context.settings.relation_margin_m)
                }
                (Relation::Between, Some(&subject)) if subject == indices[0] && indices.len() == 3 => {
                    let oriented = &self.sampled.objects[subject];
                    let gap = context.settings.min_gap_m + BETWEEN_MARGIN_M;
                    between::leaves_space(&self.scene, [indices[1], indices[2]], oriented, gap, context)
                }
                _ => true,
            };
            if !holds {
                rejections.count(Rejection::EdgeUnsatisfied);
                rejections.blame(atom);
                self.blockers.extend(indices.iter().filter(|&&index| index != object));
                return false;
            }
        }
        let is_here = |index: usize| index == object || self.placed.contains(&index);
        for (atoms, objects) in &context.goal_sides {
            let concerns = objects.contains(&object) && objects.iter().all(|&index| is_here(index));
            if concerns && atoms.iter().all(|atom| judge_atom(&self.scene, atom, context.relations).holds) {
                rejections.count(Rejection::GoalHolds);
                self.blockers.extend(objects.iter().filter(|&&index| index != object));
                return false;
            }
        }
        let wanted = self.sampled.alternative.and_then(|index| context.goal_betweens.get(index));
        for &[subject, one, other] in wanted.into_iter().flatten() {
            let concerns = (one == object || other == object) && is_here(one) && is_here(other);
            let oriented = &self.sampled.objects[subject];
            if concerns && !between::leaves_space(&self.scene, [one, other], oriented, GOAL_CLEARANCE_M, context) {
                rejections.count(Rejection::NoSpaceBetween(self.named(subject)));
                self.blockers.push(if one == object { other } else { one });
                return false;
            }
        }
        true
    }

    /// True if some position on the table in the goal regions of the sampled goal alternative is free for each moved
    /// object.
    fn goal_has_space(&mut self, rng: &mut impl Rng, rejections: &mut Rejections) -> bool {
        self.blockers.clear();
        let regions = self.sampled.alternative.and_then(|index| self.context.goal_regions.get(index));
        for region in regions.into_iter().flatten() {
            if region.anchors.iter().any(|(relation, _)| relation.is_support()) || self.is_free_somewhere(region, rng) {
                continue;
            }
            rejections.count(Rejection::NoSpaceAtGoal(self.named(region.object)));
            self.blockers.extend(region.anchors.iter().map(|(_, anchor)| anchor));
            return false;
        }
        true
    }

    fn is_free_somewhere(&mut self, region: &GoalRegion, rng: &mut impl Rng) -> bool {
        let context = self.context;
        let bounds = self.sampled.objects[region.object].bounds;
        let ground = region.ground();
        let area = context.area(ground, context.world.workspace);
        let half = bounds.size().truncate() * 0.5;
        let mut low = DVec2::new(area.x[0], area.y[0]) + half;
        let mut high = DVec2::new(area.x[1], area.y[1]) - half;
        let mut narrow = |window: Option<Window>| {
            if let Some(window) = window {
                low = low.max(DVec2::new(window.x[0], window.y[0]));
                high = high.min(DVec2::new(window.x[1], window.y[1]));
            }
        };
        for &(relation, anchor) in &region.anchors {
            let anchor = self.scene.bounds(anchor);
            let window = anchor.and_then(|at| placement_window(relation, &at, bounds.size(), context.relations));
            narrow(window);
        }
        for &(relation, surface) in region.surfaces.iter().filter(|(relation, _)| !relation.is_support()) {
            narrow(context.surface_window(relation, surface, bounds.size()));
        }
        if low.cmpgt(high).any() {
            return false;
        }
        let clearance = DVec3::new(GOAL_CLEARANCE_M, GOAL_CLEARANCE_M, 0.0);
        (0..context.settings.candidates_per_object).any(|_| {
            let center = low + (high - low) * DVec2::new(rng.random(), rng.random());
            let there = moved_to(&bounds, center, context.height(ground));
            let there = Aabb { min: there.min - clearance, max: there.max + clearance };
            let blocker = self.placed.iter().copied().filter(|&other| other != region.object).find(|&other| {
                let overlap = |at: Aabb| at.min.cmplt(there.max).all() && there.min.cmplt(at.max).all();
                self.scene.bounds(other).is_some_and(overlap)
            });
            self.blockers.extend(blocker);
            blocker.is_none() && center.length() < context.reach_m[1] + GOAL_REACH_M
        })
    }

    fn named(&self, object: usize) -> NamedObject {
        let context = self.context;
        NamedObject { id: context.id(object), name: context.models[object].card.name.clone() }
    }

    /// Adds all placed objects that share an edge or a bound with this one to the blockers.
    fn block_relatives(&mut self, object: usize) {
        let is_related = |&other: &usize| {
            self.sampled.x.are_related(object, other)
                || self.context.edges.iter().any(|(_, indices)| indices.contains(&object) && indices.contains(&other))
        };
        let relatives: Vec<usize> = self.placed.iter().copied().filter(is_related).collect();
        self.blockers.extend(relatives);
    }

    /// Number of objects that stay placed when backtracking; `None` if nothing is placed.
    ///
    /// Backtracks mostly to the last blocker, sometimes to a random one to avoid cycling.
    fn backtrack(&self, rng: &mut impl Rng) -> Option<usize> {
        let mut candidates: Vec<usize> =
            (0..self.placed.len()).filter(|&position| self.blockers.contains(&self.placed[position])).collect();
        if candidates.is_empty() {
            candidates = (0..self.placed.len()).collect();
        }
        let last = *candidates.last()?;
        Some(if rng.random_bool(LAST_BLOCKER_PROBABILITY) {
            last
        } else {
            candidates[rng.random_range(0..candidates.len())]
        })
    }
}

/// Bounds translated to a centre in the plane and a height of the underside (m).
fn moved_to(bounds: &Aabb, center: DVec2, height: f64) -> Aabb {
    let by = (center - bounds.center().truncate()).extend(height - bounds.min.z);
    Aabb { min: bounds.min + by, max: bounds.max + by }
}

/// Lowers (or raises) an object until its vertical gap to the carrier is `gap` (m); false if it is not above the
/// carrier.
pub(crate) fn lower_onto(
    scene: &mut PosedScene,
    object: usize,
    carrier: usize,
    gap: f64,
    relations: &RelationSettings,
) -> bool {
    let Some(contact) = contact_below(scene, object, carrier, relations) else { return false };
    scene.shift(object, DVec3::Z * (gap - contact.gap_m));
    true
}
