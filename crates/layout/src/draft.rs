//! What one draw fixes before anything is placed: how every object is turned, and where that lets it be.

use std::f64::consts::{FRAC_PI_2, TAU};

use genmanip_core::glam::{DVec2, DVec3};
use genmanip_core::{Aabb, Atom, Pose, Relation, Workspace};
use genmanip_relations::placement_window;
use rand::{Rng, RngExt};

use crate::context::Context;
use crate::network::{Network, ORIGIN};

/// Headings tried until a thing fits into its container; chosen: a box that fits at a quarter of all headings is missed
/// once in a thousand draws.
const TURNS: usize = 24;

/// How far an articulated object may be turned from facing the robot, radians; chosen, so that its doors stay in reach.
const FACING_RAD: f64 = 0.25;

/// How far from parallel to the table's edges aligned things may be turned, radians; chosen, so that they look put there
/// by a person.
const ALIGNED_RAD: f64 = 0.1;

/// Room around a thing in a hollow, both sides together, and above it in a covered one, metres; chosen, more than settling
/// takes.
const HOLLOW_ROOM_M: [f64; 2] = [0.002, 0.004];

/// Distance from the edge of a place on or in a carrier, metres, and the share of the rest that is used; chosen, since the
/// place is a box and many carriers are round.
const EDGE_M: f64 = 0.012;
const USED: f64 = 0.75;

/// Every object's heading, and the networks of their centres in x and y.
#[derive(Clone, Debug)]
pub(crate) struct Draft {
    pub stances: Vec<Stance>,
    pub x: Network,
    pub y: Network,
    /// The alternative of the goal that room is kept for.
    pub alternative: Option<usize>,
}

/// How one object is turned in a draw.
#[derive(Clone, Debug)]
pub(crate) struct Stance {
    pub yaw: f64,
    /// Bounds with its origin at the world's.
    pub bounds: Aabb,
    /// Its hollows, with its origin at the world's.
    hollows: Vec<Aabb>,
    /// What carries things: all of it, or the body without what its joints move; with its origin at the world's.
    body: Aabb,
    /// Whether its hollows may be covered.
    is_articulated: bool,
    /// Which place of its carrier it takes, and whether it is put there from the side instead of let down from above.
    pub seat: Option<Seat>,
}

/// Where on or in its carrier an object goes, with the carrier's origin at the world's.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Seat {
    pub area: Aabb,
    /// Covered from above, so that nothing can be let down into it.
    pub covered: bool,
}

/// Edges that leave no room, by index.
pub(crate) struct Contradiction(pub Vec<usize>);

impl Draft {
    /// Turns every object at random and closes the networks; `aligned` turns them by quarters and uses the wide area.
    pub fn new(context: &Context, aligned: bool, rng: &mut impl Rng) -> Result<Self, Contradiction> {
        let mut stances: Vec<Option<Stance>> = vec![None; context.models.len()];
        for step in &context.steps {
            let carrier = step.support.and_then(|(support, relation)| Some((stances[support].clone()?, relation)));
            let stance = Stance::draw(context, step.object, carrier.as_ref(), aligned, rng);
            stances[step.object] = Some(stance.ok_or_else(|| Contradiction(step.support_edge.into_iter().collect()))?);
        }
        let stances: Vec<Stance> = stances.into_iter().flatten().collect();
        let alternatives = context.goal_rooms.len();
        let alternative = (alternatives > 0).then(|| rng.random_range(0..alternatives));
        let rooms = alternative.map_or(0, |index| context.goal_rooms[index].len());
        let network = Network::new(stances.len() + rooms);
        let mut draft = Self { x: network.clone(), y: network, alternative, stances };
        draft.bound(context, aligned);
        let conflict = draft.x.close().and(draft.y.close());
        conflict.map_err(Contradiction)?;
        Ok(draft)
    }

    fn bound(&mut self, context: &Context, wide: bool) {
        let settings = context.settings;
        let workspace = context.world.workspace;
        let table = match wide {
            true => workspace.within(settings.wide_x_m, settings.wide_y_m),
            false => workspace.within(settings.x_m, settings.y_m),
        };
        let mut both = |a: usize, b: usize, x: [f64; 2], y: [f64; 2], edge: Option<usize>| {
            self.x.bound(a, b, x, edge);
            self.y.bound(a, b, y, edge);
        };
        for step in &context.steps {
            let stance = &self.stances[step.object];
            let half = stance.bounds.size() * 0.5;
            match step.support.zip(stance.seat) {
                Some(((support, _), seat)) => {
                    let carrier = self.stances[support].bounds.center().truncate();
                    let (middle, slack) = (seat.area.center().truncate() - carrier, seat.slack(half.truncate()));
                    let (low, high) = (middle - slack, middle + slack);
                    both(support + 1, step.object + 1, [low.x, high.x], [low.y, high.y], step.support_edge);
                }
                None => {
                    let area = context.area(context.grounds[step.object], table);
                    let inside = |[low, high]: [f64; 2], half: f64| [low + half, high - half];
                    both(ORIGIN, step.object + 1, inside(area.x, half.x), inside(area.y, half.y), step.support_edge);
                }
            }
            if context.moved[step.object] {
                let most = context.reach_m[1];
                both(ORIGIN, step.object + 1, [0.0, most], [-most, most], None);
            }
        }
        // Where the goal wants something, it must find room on the table and in reach.
        let rooms = self.alternative.map_or(&[][..], |index| &context.goal_rooms[index]);
        for (number, room) in rooms.iter().enumerate() {
            let at = context.models.len() + number + 1;
            let (size, far) = (self.stances[room.object].bounds.size(), context.reach_m[1]);
            let Workspace { x, y } = context.area(room.ground(), workspace);
            let half = size * 0.5;
            both(ORIGIN, at, [x[0] + half.x, far.min(x[1] - half.x)], [y[0] + half.y, y[1] - half.y], None);
            for &(relation, surface) in room.surfaces.iter().filter(|(relation, _)| !relation.is_support()) {
                if let Some(window) = context.surface_window(relation, surface, size) {
                    both(ORIGIN, at, window.x, window.y, None);
                }
            }
            for &(relation, anchor) in &room.anchors {
                let extent = self.stances[anchor].bounds.size();
                let centered = Aabb { min: extent * -0.5, max: extent * 0.5 };
                if let Some(window) = placement_window(relation, &centered, size, context.relations) {
                    both(anchor + 1, at, window.x, window.y, None);
                }
            }
        }
        for (edge, (atom, indices)) in context.edges.iter().enumerate() {
            let Atom::Relation { relation, reference, .. } = atom else { continue };
            if relation.is_support() {
                continue;
            }
            if let (&[subject], Some(surface)) = (indices.as_slice(), context.world.further_surface(reference)) {
                let size = self.stances[subject].bounds.size();
                if let Some(window) = context.surface_window(*relation, surface, size) {
                    both(ORIGIN, subject + 1, window.x, window.y, Some(edge));
                }
                continue;
            }
            let &[subject, reference] = indices.as_slice() else { continue };
            let (anchor, size) = (self.stances[reference].bounds.size(), self.stances[subject].bounds.size());
            let centered = Aabb { min: anchor * -0.5, max: anchor * 0.5 };
            let Some(window) = placement_window(*relation, &centered, size, context.relations) else { continue };
            let apart = (anchor + size) * 0.5 + DVec3::splat(context.gap(subject, reference));
            let (mut x, mut y) = (window.x, window.y);
            match relation {
                Relation::Left => y[0] = y[0].max(apart.y).min(y[1]),
                Relation::Right => y[1] = y[1].min(-apart.y).max(y[0]),
                Relation::Front => x[0] = x[0].max(apart.x).min(x[1]),
                Relation::Back => x[1] = x[1].min(-apart.x).max(x[0]),
                _ => {}
            }
            both(reference + 1, subject + 1, x, y, Some(edge));
        }
    }
}

impl Stance {
    /// A random heading; `None` when the object fits into its container in none of those tried.
    fn draw(
        context: &Context,
        object: usize,
        carrier: Option<&(Self, Relation)>,
        aligned: bool,
        rng: &mut impl Rng,
    ) -> Option<Self> {
        let model = &context.models[object];
        for _ in 0..TURNS {
            // Articulated objects face the robot; everything else may be turned.
            let yaw = match (model.card.is_articulated, aligned) {
                (true, _) => rng.random_range(-FACING_RAD..FACING_RAD),
                (false, true) => {
                    f64::from(rng.random_range(0..4)) * FRAC_PI_2 + rng.random_range(-ALIGNED_RAD..ALIGNED_RAD)
                }
                (false, false) => rng.random_range(0.0..TAU),
            };
            let pose = Pose::from_position_yaw(DVec3::ZERO, yaw);
            let bounds = model.world_bounds(&pose, &context.joints[object]);
            let seat = match carrier {
                Some((carrier, relation)) => match carrier.seat_for(*relation, &bounds, rng) {
                    None => continue,
                    seat => seat,
                },
                None => None,
            };
            let cavities = model.cavities(&context.joints[object]);
            let hollows = cavities.iter().map(|piece| Aabb::from_pieces(&pose, [piece])).collect();
            let root = model.links.first().map_or(bounds, |link| Aabb::from_pieces(&pose, &link.pieces));
            return Some(Self { yaw, bounds, hollows, body: root, is_articulated: model.card.is_articulated, seat });
        }
        None
    }

    /// Where the origin is when the middle of the bounds is at a point.
    pub fn pose(&self, center: DVec2, bottom: f64) -> Pose {
        let offset = self.bounds.center().truncate();
        Pose::from_position_yaw((center - offset).extend(bottom - self.bounds.min.z), self.yaw)
    }

    /// A place on or in this carrier for something of these bounds.
    fn seat_for(&self, relation: Relation, bounds: &Aabb, rng: &mut impl Rng) -> Option<Seat> {
        let size = bounds.size();
        let fits = |hollow: &&Aabb| (hollow.size() - size).truncate().min_element() > HOLLOW_ROOM_M[0];
        let fitting: Vec<&Aabb> = self.hollows.iter().filter(fits).collect();
        let from_above = |area: &Aabb| Seat { area: *area, covered: false };
        match (relation, self.is_articulated) {
            (Relation::In, true) => {
                let high: Vec<&Aabb> =
                    fitting.into_iter().filter(|hollow| hollow.size().z > size.z + HOLLOW_ROOM_M[1]).collect();
                let at = rng.random_range(0..high.len().max(1));
                high.get(at).map(|hollow| Seat { area: **hollow, covered: true })
            }
            (Relation::In, false) => fitting.first().map(|hollow| from_above(hollow)),
            (_, true) => Some(from_above(&self.body)),
            (_, false) => Some(from_above(fitting.first().copied().or(self.hollows.first()).unwrap_or(&self.body))),
        }
    }
}

impl Seat {
    /// How far the middle of an object may be off the middle of the place, metres.
    fn slack(&self, half: DVec2) -> DVec2 {
        (self.area.size().truncate() * 0.5 - half - DVec2::splat(EDGE_M)).max(DVec2::ZERO) * USED
    }
}
