//! A rough two-dimensional sketch of a scene, from which the edges of the graph are read.
//!
//! Every object gets a position at some distance from its neighbours: x away from the robot, y to the robot's left,
//! metres; the first object is at the origin. The sketch is itself a layout that satisfies the graph. An object that
//! may be rotated is represented by a square of its longer side; rotated, it extends beyond each side of the square by
//! up to 21 % of that side.

use genmanip_core::{
    Atom, GraphEdge, GraphNode, HorizontalAxis, InstanceId, ObjectCard, Relation, RelationKind, SceneGraph, Side,
};
use glam::DVec2;
use rand::{Rng, RngExt};

use super::balance::Balance;
use super::settings::DesignSettings;
use super::things::things;
use crate::references::sentence::TABLE;

/// Free space on the robot's side of a tall articulated container (see [`swings`]) for its door or drawers, metres.
const SWING_M: f64 = 0.16;

/// Largest bend at an object between two others, degrees. The relation allows 45; the margin is for layouts, which
/// deviate from the sketch.
const MAX_BEND_DEG: f64 = 30.0;

/// A goal condition with objects by index.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Condition {
    Relation(Link),
    State(usize, String),
    /// The object stands on the table itself.
    OnTable(usize),
}

/// A relation between objects by index.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Link {
    pub subject: usize,
    pub relation: Relation,
    pub reference: usize,
    pub second: Option<usize>,
}

#[derive(Clone, Copy, Debug)]
struct Rect {
    low: DVec2,
    high: DVec2,
}

/// Objects, their relations and their approximate positions.
#[derive(Clone, Debug)]
pub(super) struct Sketch<'a> {
    pub cards: Vec<&'a ObjectCard>,
    pub states: Vec<Option<String>>,
    pub edges: Vec<Link>,
    carriers: Vec<Option<usize>>,
    places: Vec<Rect>,
    /// Areas reserved for goal positions.
    kept_free: Vec<Rect>,
    /// Objects that nothing else is put on or in, and about which no further relations are stated; stored here, and
    /// enforced by the composer.
    pub closed: Vec<usize>,
}

impl<'a> Sketch<'a> {
    pub fn new() -> Self {
        Self {
            cards: Vec::new(),
            states: Vec::new(),
            edges: Vec::new(),
            carriers: Vec::new(),
            places: Vec::new(),
            kept_free: Vec::new(),
            closed: Vec::new(),
        }
    }

    pub fn len(&self) -> usize {
        self.cards.len()
    }

    pub fn carrier(&self, object: usize) -> Option<usize> {
        self.carriers[object]
    }

    /// Cards of the objects in or on `host`.
    pub fn carried(&self, host: usize) -> Vec<&'a ObjectCard> {
        (0..self.len()).filter(|&other| self.carriers[other] == Some(host)).map(|other| self.cards[other]).collect()
    }

    pub fn contains(&self, card: &ObjectCard) -> bool {
        self.cards.iter().any(|known| known.uid == card.uid)
    }

    /// Adds the first object, at the origin; the area limits only the extent of the whole sketch.
    pub fn start(&mut self, card: &'a ObjectCard) -> usize {
        self.push(card, around(DVec2::ZERO, half(card), card), None)
    }

    /// Adds an object beside `anchor`, without stating the relation. `None` if there is no room, `anchor` is in or on
    /// another object, one of the two would block access to the other, or `relation` is neither a side nor `near`.
    pub fn beside(
        &mut self,
        card: &'a ObjectCard,
        relation: Relation,
        anchor: usize,
        settings: &DesignSettings,
        rng: &mut impl Rng,
    ) -> Option<usize> {
        let place = self.place_beside(card, relation, anchor, settings, rng)?;
        Some(self.push(card, place, None))
    }

    /// Reserves the room that a goal needs beside an object; false if there is none.
    pub fn keep_free(
        &mut self,
        card: &ObjectCard,
        relation: Relation,
        anchor: usize,
        settings: &DesignSettings,
        rng: &mut impl Rng,
    ) -> bool {
        let place = self.place_beside(card, relation, anchor, settings, rng);
        self.kept_free.extend(place);
        place.is_some()
    }

    /// Adds an object next to the area reserved last, in the direction of `relation`. `None` if nothing is reserved,
    /// `relation` has no direction, or there is no room.
    pub fn beyond(&mut self, card: &'a ObjectCard, relation: Relation, settings: &DesignSettings) -> Option<usize> {
        let free = *self.kept_free.last()?;
        let (half, middle) = (half(card), (free.low + free.high) * 0.5);
        let reach = (free.high - free.low) * 0.5 + half + DVec2::splat(settings.gap_m + 0.005);
        let place = around(middle + relation.side()?.direction() * reach, half, card);
        self.is_free(&place, settings).then(|| self.push(card, place, None))
    }

    /// True if the centres of two objects and of `middle`, assumed halfway between them on the table, bend by less than
    /// [`MAX_BEND_DEG`] in height. The top view is not tested: the sketch places all three nearly in line.
    pub fn is_straight(&self, first: usize, middle: &ObjectCard, last: usize) -> bool {
        let center = |object: usize| (self.places[object].low + self.places[object].high) * 0.5;
        let halfway = 0.5 * center(first).distance(center(last));
        let rise = |object: usize| (0.5 * (middle.size_m.z - self.cards[object].size_m.z)).atan2(halfway);
        (rise(first) + rise(last)).abs() < MAX_BEND_DEG.to_radians()
    }

    /// Puts an object in or on another; `None` if there is no room.
    pub fn put(&mut self, card: &'a ObjectCard, relation: Relation, host: usize) -> Option<usize> {
        let fits = things().may_carry(self.cards[host], card, relation)
            && things().shows(self.cards[host], card)
            && things().has_space_for(self.cards[host], &self.carried(host), card);
        if !fits || self.contains(card) || self.carriers[host].is_some() {
            return None;
        }
        Some(self.push_into(card, relation, host))
    }

    /// Puts an object where a sentence says that it is, whether or not it belongs there; `None` if there is no space for
    /// it beside what is there already, or if `host` is itself in or on something.
    pub fn put_said(&mut self, card: &'a ObjectCard, relation: Relation, host: usize) -> Option<usize> {
        let has_space = things().has_space_for(self.cards[host], &self.carried(host), card);
        if !has_space || self.contains(card) || self.carriers[host].is_some() {
            return None;
        }
        Some(self.push_into(card, relation, host))
    }

    fn push_into(&mut self, card: &'a ObjectCard, relation: Relation, host: usize) -> usize {
        let object = self.push(card, self.places[host], Some(host));
        self.edges.push(Link { subject: object, relation, reference: host, second: None });
        object
    }

    /// States a relation or its inverse, whichever is further below its quota.
    pub fn relate(
        &mut self,
        subject: usize,
        relation: Relation,
        reference: usize,
        balance: &mut Balance,
        settings: &DesignSettings,
    ) {
        let inverse = relation.inverse().filter(|inverse| {
            *inverse != relation && balance.lack(*inverse, settings) > balance.lack(relation, settings)
        });
        let link = match inverse {
            Some(inverse) => Link { subject: reference, relation: inverse, reference: subject, second: None },
            None => Link { subject, relation, reference, second: None },
        };
        balance.add(link.relation);
        self.edges.push(link);
    }

    fn push(&mut self, card: &'a ObjectCard, place: Rect, carrier: Option<usize>) -> usize {
        self.cards.push(card);
        self.states.push(None);
        self.carriers.push(carrier);
        self.places.push(place);
        self.len() - 1
    }

    fn place_beside(
        &self,
        card: &ObjectCard,
        relation: Relation,
        anchor: usize,
        settings: &DesignSettings,
        rng: &mut impl Rng,
    ) -> Option<Rect> {
        let hides = match relation.side() {
            Some(Side { axis: HorizontalAxis::Depth, is_positive: true }) => stands_before(self.cards[anchor], card),
            Some(Side { axis: HorizontalAxis::Depth, is_positive: false }) => {
                swings(self.cards[anchor]) || stands_before(card, self.cards[anchor])
            }
            Some(Side { axis: HorizontalAxis::Width, .. }) | None => false,
        };
        if self.carriers[anchor].is_some() || hides {
            return None;
        }
        let (half, place) = (half(card), self.places[anchor]);
        let (middle, other) = ((place.low + place.high) * 0.5, (place.high - place.low) * 0.5);
        let gap = settings.gap_m + 0.02 * rng.random::<f64>();
        let reach = half + other + DVec2::splat(gap);
        let offset = match relation.kind() {
            RelationKind::Around => {
                let sign = |flip: bool| if flip { 1.0 } else { -1.0 };
                reach * DVec2::new(sign(rng.random()), sign(rng.random()))
            }
            RelationKind::Side(side) => {
                let aside = 0.3 * half.min(other) * (2.0 * rng.random::<f64>() - 1.0);
                let direction = side.direction();
                direction * reach + aside * DVec2::new(direction.y.abs(), direction.x.abs())
            }
            RelationKind::Support(_) | RelationKind::Between => return None,
        };
        let place = around(middle + offset, half, card);
        self.is_free(&place, settings).then_some(place)
    }

    fn is_free(&self, place: &Rect, settings: &DesignSettings) -> bool {
        let on_table = self.places.iter().zip(&self.carriers).filter(|(_, carrier)| carrier.is_none());
        let mut taken = on_table.map(|(place, _)| place).chain(&self.kept_free);
        let gap = 0.9 * settings.gap_m;
        let all = self.places.iter().chain(&self.kept_free).chain([place]);
        let (low, high) =
            all.fold((DVec2::INFINITY, DVec2::NEG_INFINITY), |(low, high), r| (low.min(r.low), high.max(r.high)));
        (high - low).cmple(DVec2::from(settings.area_m)).all()
            && !taken.any(|other| (place.low - gap).cmplt(other.high).all() && other.low.cmplt(place.high + gap).all())
    }

    /// Ids of the objects in the graph.
    fn ids(&self) -> Vec<InstanceId> {
        InstanceId::numbered(self.cards.iter().map(|card| &card.uid))
    }

    pub fn graph(&self, description: String) -> SceneGraph {
        let ids = self.ids();
        let id = |object: usize| ids[object].clone();
        SceneGraph {
            description,
            nodes: self
                .cards
                .iter()
                .zip(&self.states)
                .zip(&ids)
                .map(|((card, state), id)| GraphNode { id: id.clone(), state: state.clone(), ..GraphNode::of(card) })
                .collect(),
            edges: self
                .edges
                .iter()
                .map(|link| GraphEdge {
                    subject: id(link.subject),
                    relation: link.relation,
                    reference: id(link.reference).into(),
                    second_reference: link.second.map(|second| id(second).into()),
                })
                .collect(),
        }
    }

    pub fn atom(&self, condition: &Condition) -> Atom {
        let ids = self.ids();
        let id = |object: usize| ids[object].clone();
        match condition {
            Condition::Relation(link) => Atom::Relation {
                subject: id(link.subject),
                relation: link.relation,
                reference: id(link.reference).into(),
                second_reference: link.second.map(|second| id(second).into()),
            },
            Condition::OnTable(object) => Atom::Relation {
                subject: id(*object),
                relation: Relation::On,
                reference: TABLE.into(),
                second_reference: None,
            },
            Condition::State(object, state) => Atom::State { object: id(*object), state: state.clone() },
        }
    }
}

/// Half extents along x and y (m): half the longer side in both, since an object may be rotated. Articulated objects
/// face the robot and keep their own extents.
fn half(card: &ObjectCard) -> DVec2 {
    let size = card.size_m.truncate();
    if card.is_articulated { size * 0.5 } else { DVec2::splat(size.max_element() * 0.5) }
}

fn swings(card: &ObjectCard) -> bool {
    card.is_articulated && card.is_container && card.size_m.z > 0.15
}

/// True if an object on the robot's side of an articulated one would block access to it: because it is taller, or
/// because it may itself be open, like a chest with its lid up.
fn stands_before(nearer: &ObjectCard, farther: &ObjectCard) -> bool {
    farther.is_articulated && (nearer.is_articulated || nearer.size_m.z > farther.size_m.z)
}

fn around(middle: DVec2, half: DVec2, card: &ObjectCard) -> Rect {
    let swing = if swings(card) { DVec2::new(SWING_M, 0.0) } else { DVec2::ZERO };
    Rect { low: middle - half - swing, high: middle + half }
}
