//! Candidate places: sampled inside what the relations leave, kept only when every edge to a placed object holds.

use std::sync::Arc;

use genmanip_core::glam::{DVec2, DVec3};
use genmanip_core::{Aabb, Atom, ObjectCard, Pose, Relation, Seed, Unit};
use genmanip_relations::{
    PosedObject, PosedScene, RelationSettings, ShapeCache, Window, contact_below, judge_atom, outlines_apart,
    placement_window,
};
use rand::{Rng, RngExt};

use crate::between;
use crate::context::{Context, GoalRoom};
use crate::draft::{Contradiction, Draft, Seat};
use crate::order::Step;
use crate::rejection::{NamedObject, Rejection, Rejections};
use crate::visibility::Eye;

/// Free space around an object at its goal, metres; chosen, more than `GoalPoseSettings::clearance_m`, since here only
/// bounds are compared.
const GOAL_CLEARANCE_M: f64 = 0.02;

/// How much farther things may be put down than taken, metres; chosen, the exact answer comes after settling.
const GOAL_REACH_M: f64 = 0.03;

/// Height above its carrier from which an object is let down, metres; chosen, any height above it will do.
const ABOVE_M: f64 = 0.01;

/// Vertical distance from which things on different supports are above each other, metres; chosen, more than contacts
/// sink in.
const APART_M: f64 = 0.01;

/// Of the mean width of two objects, how near their middles may be before their outlines surely overlap; chosen, half of
/// what boxes side by side have.
const OVERLAPPING: f64 = 0.25;

/// What is kept beside the smallest gap for something that is still to stand between two others, metres; chosen.
const BETWEEN_SPARE_M: f64 = 0.005;

/// How often the search goes back to the last one that was in the way instead of any; chosen, so that it mostly changes
/// little and does not go in circles.
const BACK_TO_LAST: f64 = 0.6;

/// Where an object waits until it is placed, metres along x; chosen, far from any table.
const PARKED_M: f64 = -10.0;

/// A layout under way.
#[derive(Clone, Debug)]
pub(crate) struct Partial {
    pub scene: PosedScene,
    /// What has its place, in the order of placing.
    pub placed: Vec<usize>,
    /// The object that found none.
    pub stuck: Option<usize>,
}

/// One whole layout; what was reached when some object found no place.
pub(crate) fn place_all(
    context: &Context,
    seed: Seed,
    aligned: bool,
    shapes: &mut ShapeCache,
    rejections: &mut Rejections,
) -> Result<PosedScene, Option<Partial>> {
    let rng = &mut seed.rng();
    let draft = match Draft::new(context, aligned, rng) {
        Ok(draft) => draft,
        Err(Contradiction(edges)) => {
            rejections.count(Rejection::RelationsLeaveNoRoom);
            edges.iter().for_each(|&edge| rejections.blame(&context.edges[edge].0));
            return Err(None);
        }
    };
    let scene = parked(context, shapes);
    let mut search = Search { context, draft, scene, placed: Vec::new(), blockers: Vec::new(), eye: None };
    let mut furthest: Option<Partial> = None;
    let mut failures = 0;
    loop {
        let step = context.steps.get(search.placed.len());
        match step {
            Some(step) if search.find_place(step, rng, rejections) && search.can_be_seen(step, rejections) => {
                search.placed.push(step.object);
                continue;
            }
            None if search.goal_has_room(rng, rejections) => return Ok(search.scene),
            _ => {}
        }
        if furthest.as_ref().is_none_or(|partial| partial.placed.len() < search.placed.len()) {
            let (scene, placed) = (search.scene.clone(), search.placed.clone());
            furthest = Some(Partial { scene, placed, stuck: step.map(|step| step.object) });
        }
        failures += 1;
        let retreat = search.retreat(rng);
        if failures > context.settings.max_retreats || retreat.is_none() {
            if let Some(stuck) = furthest.as_ref().and_then(|partial| partial.stuck) {
                rejections.count(Rejection::NoPlace(search.named(stuck)));
            }
            return Err(furthest);
        }
        search.placed.truncate(retreat.unwrap_or(0));
    }
}

/// All objects in their initial states, far from the table and from each other.
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
    draft: Draft,
    scene: PosedScene,
    placed: Vec<usize>,
    /// What stood in the way of the object at hand.
    blockers: Vec<usize>,
    /// The cameras, once they were asked.
    eye: Option<Eye<'a>>,
}

impl<'a> Search<'a> {
    /// Puts the object where everything it is related to allows; false when no candidate fits.
    fn find_place(&mut self, step: &Step, rng: &mut impl Rng, rejections: &mut Rejections) -> bool {
        self.blockers.clear();
        let Some([low, high]) = self.window(step.object) else {
            rejections.count(Rejection::RelationsLeaveNoRoom);
            self.blame_relatives(step.object);
            return false;
        };
        (0..self.context.settings.candidates_per_object).any(|_| {
            let center = low + (high - low) * DVec2::new(rng.random(), rng.random());
            self.fits(step, center, rejections)
        })
    }

    /// Whether the cameras see an object that was put into something where that stands: else the search goes back to what
    /// holds it.
    fn can_be_seen(&mut self, step: &Step, rejections: &mut Rejections) -> bool {
        let Some((carrier, _)) = step.support else { return true };
        let top = |object: usize| self.scene.bounds(object).map(|bounds| bounds.max.z);
        if top(step.object) >= top(carrier) {
            return true;
        }
        let Context { world, robot, settings, .. } = self.context;
        let eye = match &mut self.eye {
            Some(eye) => Some(eye),
            // Whoever looks at the settled layout says what is wrong.
            eye => Eye::new(&self.scene, world, robot).ok().map(|new| eye.insert(new)),
        };
        let hidden = eye.map(|eye| eye.is_hidden_by(&[carrier], step.object, &self.scene, settings));
        if !matches!(hidden, Some(Ok(true))) {
            return true;
        }
        rejections.count(Rejection::Unseen(self.named(step.object)));
        self.blockers = vec![carrier];
        false
    }

    /// Opposite corners of where the middle of the object may be.
    fn window(&self, object: usize) -> Option<[DVec2; 2]> {
        let centers = || self.placed.iter().map(|&other| (other, self.center(other)));
        let x = self.draft.x.range(object, centers().map(|(other, center)| (other, center.x)));
        let y = self.draft.y.range(object, centers().map(|(other, center)| (other, center.y)));
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
        // Rounding may leave an interval of one point a hair too short.
        let (near, far) = (low.min(high), low.max(high));
        ((near - low).abs().max_element() < 1e-9).then_some([near, far])
    }

    /// Middle of a placed object's bounds.
    fn center(&self, object: usize) -> DVec2 {
        self.scene.bounds(object).map_or(DVec2::ZERO, |bounds| bounds.center().truncate())
    }

    /// Whether the object keeps its distance, its reach and every edge to what is placed, with its middle at `center`;
    /// it stands there then.
    fn fits(&mut self, step: &Step, center: DVec2, rejections: &mut Rejections) -> bool {
        let (context, object) = (self.context, step.object);
        let [least, most] = context.reach_m;
        if context.moved[object] && !(least..=most).contains(&center.length()) {
            rejections.count(Rejection::OutOfReach);
            self.blame_relatives(object);
            return false;
        }
        let stance = &self.draft.stances[object];
        match step.support.zip(stance.seat) {
            None => {
                let height = context.height(context.grounds[object]);
                let bounds = moved_to(&stance.bounds, center, height);
                let pose = stance.pose(center, height);
                // Most candidates fall here, by their bounds alone.
                if let Some(blocker) = self.neighbour(object, &bounds, None) {
                    return self.refuse(object, blocker, rejections);
                }
                self.put(object, pose);
            }
            Some(((carrier, _), seat)) => {
                let Some(bottom) = self.bottom_on(carrier, &seat) else { return false };
                let pose = stance.pose(center, bottom);
                self.put(object, pose);
                // Letting down is costly, and most candidates fall to their neighbours on the same carrier.
                let beside = |&other: &usize| context.support_of(other) == Some(carrier);
                let gap = |other| context.gap(object, other);
                let blocker = self.placed.iter().copied().filter(|other| beside(other));
                if let Some(blocker) =
                    blocker.into_iter().find(|&other| !outlines_apart(&self.scene, object, other, gap(other)))
                {
                    return self.refuse(object, blocker, rejections);
                }
                if !seat.covered
                    && !let_down(&mut self.scene, object, carrier, context.settings.drop_m, context.relations)
                {
                    rejections.count(Rejection::BesideItsCarrier);
                    self.blockers.push(carrier);
                    return false;
                }
            }
        }
        let Some(bounds) = self.scene.bounds(object) else { return false };
        if !self.is_on_its_surface(step) {
            rejections.count(Rejection::RelationsLeaveNoRoom);
            self.blame_relatives(object);
            return false;
        }
        if let Some(blocker) = self.neighbour(object, &bounds, Some(&self.scene)) {
            return self.refuse(object, blocker, rejections);
        }
        self.edges_hold(object, rejections)
    }

    /// Whether an object keeps within the top of the surface it stands on, and clear of all surfaces and their boards.
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

    fn refuse(&mut self, object: usize, blocker: usize, rejections: &mut Rejections) -> bool {
        rejections.count(Rejection::TooClose);
        // On a carrier it is the relations to it that leave no room.
        for step in self.context.steps.iter().filter(|step| step.object == object || step.object == blocker) {
            if let Some(edge) = step.support_edge {
                rejections.blame(&self.context.edges[edge].0);
            }
        }
        self.blockers.push(blocker);
        false
    }

    /// Height at which an object starts above its carrier, or stands in a covered place.
    fn bottom_on(&self, carrier: usize, seat: &Seat) -> Option<f64> {
        let posed = self.scene.objects().nth(carrier)?;
        let bounds = self.scene.bounds(carrier)?;
        Some(if seat.covered {
            posed.pose.position.z + seat.area.min.z + self.context.settings.drop_m
        } else {
            bounds.max.z + ABOVE_M
        })
    }

    /// A placed object that is too close: for certain by its bounds, or exactly when a scene with the object is given.
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
            // Things on different supports may be above each other.
            if !beside && apart.z > APART_M {
                return false;
            }
            match scene {
                Some(scene) => !outlines_apart(scene, object, other, gap),
                // Middles this close are never apart, whatever the outlines.
                None => {
                    let offset = (bounds.center() - theirs.center()).truncate().abs();
                    let shorter = |bounds: &Aabb| bounds.size().truncate().min_element();
                    beside && offset.max_element() < OVERLAPPING * (shorter(bounds) + shorter(&theirs))
                }
            }
        })
    }

    /// Whether every edge whose objects are all placed once this one is holds with a margin.
    fn edges_hold(&mut self, object: usize, rejections: &mut Rejections) -> bool {
        let context = self.context;
        for (atom, indices) in context.edges.iter().filter(|(_, indices)| indices.contains(&object)) {
            let Atom::Relation { relation, .. } = atom else { continue };
            let unknown = |index: &&usize| **index != object && !self.placed.contains(index);
            let holds = match (relation, indices.iter().find(unknown)) {
                // Judged after settling, when it has come to rest.
                (relation, _) if relation.is_support() => true,
                (_, None) => {
                    let verdict = judge_atom(&self.scene, atom, context.relations);
                    verdict.holds
                        && verdict.normalised_margin() >= Unit::Metre.normalise(context.settings.relation_margin_m)
                }
                (Relation::Between, Some(&subject)) if subject == indices[0] && indices.len() == 3 => {
                    let stance = &self.draft.stances[subject];
                    let gap = context.settings.min_gap_m + BETWEEN_SPARE_M;
                    between::leaves_room(&self.scene, [indices[1], indices[2]], stance, gap, context)
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
        let wanted = self.draft.alternative.and_then(|index| context.goal_betweens.get(index));
        for &[subject, one, other] in wanted.into_iter().flatten() {
            let concerns = (one == object || other == object) && is_here(one) && is_here(other);
            let stance = &self.draft.stances[subject];
            if concerns && !between::leaves_room(&self.scene, [one, other], stance, GOAL_CLEARANCE_M, context) {
                rejections.count(Rejection::NoRoomBetween(self.named(subject)));
                self.blockers.push(if one == object { other } else { one });
                return false;
            }
        }
        true
    }

    /// Whether the objects that the drawn alternative moves to a place on the table would find a free one there.
    fn goal_has_room(&mut self, rng: &mut impl Rng, rejections: &mut Rejections) -> bool {
        self.blockers.clear();
        let rooms = self.draft.alternative.and_then(|index| self.context.goal_rooms.get(index));
        for room in rooms.into_iter().flatten() {
            if room.anchors.iter().any(|(relation, _)| relation.is_support()) || self.is_free_somewhere(room, rng) {
                continue;
            }
            rejections.count(Rejection::NoRoomAtGoal(self.named(room.object)));
            self.blockers.extend(room.anchors.iter().map(|(_, anchor)| anchor));
            return false;
        }
        true
    }

    fn is_free_somewhere(&mut self, room: &GoalRoom, rng: &mut impl Rng) -> bool {
        let context = self.context;
        let bounds = self.draft.stances[room.object].bounds;
        let ground = room.ground();
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
        for &(relation, anchor) in &room.anchors {
            let anchor = self.scene.bounds(anchor);
            let window = anchor.and_then(|at| placement_window(relation, &at, bounds.size(), context.relations));
            narrow(window);
        }
        for &(relation, surface) in room.surfaces.iter().filter(|(relation, _)| !relation.is_support()) {
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
            let blocker = self.placed.iter().copied().filter(|&other| other != room.object).find(|&other| {
                let overlap = |at: Aabb| at.min.cmplt(there.max).all() && there.min.cmplt(at.max).all();
                self.scene.bounds(other).is_some_and(overlap)
            });
            self.blockers.extend(blocker);
            blocker.is_none() && center.length() < context.reach_m[1] + GOAL_REACH_M
        })
    }

    fn named(&self, object: usize) -> NamedObject {
        let context = self.context;
        let node = context.task.scene_graph.nodes.get(object);
        let ObjectCard { uid, name, .. } = &context.models[object].card;
        NamedObject { id: node.map_or(uid, |node| &node.id).clone(), name: name.clone() }
    }

    /// Whatever the object is tied to by relations stands in its way.
    fn blame_relatives(&mut self, object: usize) {
        let tied = |&other: &usize| {
            self.draft.x.ties(object, other)
                || self.context.edges.iter().any(|(_, indices)| indices.contains(&object) && indices.contains(&other))
        };
        let relatives: Vec<usize> = self.placed.iter().copied().filter(tied).collect();
        self.blockers.extend(relatives);
    }

    /// How many objects keep their places when the search goes back; `None` when nothing is in the way.
    ///
    /// Mostly to the last one that was in the way, now and then to any of them, so that it does not go in circles.
    fn retreat(&self, rng: &mut impl Rng) -> Option<usize> {
        let mut culprits: Vec<usize> =
            (0..self.placed.len()).filter(|&position| self.blockers.contains(&self.placed[position])).collect();
        if culprits.is_empty() {
            culprits = (0..self.placed.len()).collect();
        }
        let last = *culprits.last()?;
        Some(if rng.random_bool(BACK_TO_LAST) { last } else { culprits[rng.random_range(0..culprits.len())] })
    }
}

/// Bounds with their middle over a point and their bottom at a height.
fn moved_to(bounds: &Aabb, center: DVec2, height: f64) -> Aabb {
    let by = (center - bounds.center().truncate()).extend(height - bounds.min.z);
    Aabb { min: bounds.min + by, max: bounds.max + by }
}

/// Lets an object that hovers above another down until `gap` metres remain; false when it is not above it.
pub(crate) fn let_down(
    scene: &mut PosedScene,
    object: usize,
    carrier: usize,
    gap: f64,
    relations: &RelationSettings,
) -> bool {
    let Some(fall) = contact_below(scene, object, carrier, relations) else { return false };
    scene.shift(object, DVec3::Z * (gap - fall.gap_m));
    true
}
