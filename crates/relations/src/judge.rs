//! Judges conditions, goals and initial graphs.

use genmanip_core::{Atom, AtomVerdict, BetweenReading, Goal, GoalVerdict, Relation, SceneGraph, Unit};
use glam::DVec3;

use super::contact::Contact;
use super::extent::{Extent, Extents};
use super::pair::{PairGeometry, measure};
use super::requirement::{Requirement, SINKING, better, verdict};
use super::{PosedScene, RelationSettings};

/// State of motion of the objects. An object that is held by the gripper or not at rest meets no condition.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Rest {
    /// Index of the object in the gripper; `None` if the gripper holds none.
    pub held: Option<usize>,
    /// For each object, true if it moves; objects beyond the end of the list are at rest.
    pub moving: Vec<bool>,
}

impl Rest {
    fn disturbed(&self, index: usize) -> Option<&'static str> {
        if self.held == Some(index) {
            return Some("out of the gripper");
        }
        self.moving.get(index).copied().unwrap_or(false).then_some("at rest")
    }
}

/// Judges one condition on objects at rest.
///
/// A condition with an unknown id is not met, and the explanation says so.
pub fn judge_atom(scene: &PosedScene, atom: &Atom, settings: &RelationSettings) -> AtomVerdict {
    judge(scene, atom, &Rest::default(), settings)
}

/// Judges a goal: every condition of every alternative.
pub fn judge_goal(scene: &PosedScene, goal: &Goal, rest: &Rest, settings: &RelationSettings) -> GoalVerdict {
    judge_alternatives(scene, goal, rest, settings)
}

/// Judges a goal, for any representation of the objects.
pub(super) fn judge_alternatives(
    scene: &impl Extents,
    goal: &Goal,
    rest: &Rest,
    settings: &RelationSettings,
) -> GoalVerdict {
    GoalVerdict::from_alternatives(
        goal.alternatives
            .iter()
            .map(|conjunction| conjunction.iter().map(|atom| judge(scene, atom, rest, settings)).collect())
            .collect(),
    )
}

/// Judges every edge of an initial graph, in order.
pub fn judge_edges(scene: &PosedScene, graph: &SceneGraph, settings: &RelationSettings) -> Vec<AtomVerdict> {
    graph.edges.iter().map(|edge| judge_atom(scene, &edge.atom(), settings)).collect()
}

/// Judges the state of every node of an initial graph that has one, in order.
pub fn judge_states(scene: &PosedScene, graph: &SceneGraph, settings: &RelationSettings) -> Vec<AtomVerdict> {
    let atoms =
        graph.nodes.iter().filter_map(|node| Some(Atom::State { object: node.id.clone(), state: node.state.clone()? }));
    atoms.map(|atom| judge_atom(scene, &atom, settings)).collect()
}

/// Largest gap below an object that stands on the table itself, not on a plate or in a bowl there, metres. Chosen: half
/// of a thin coaster.
const RESTING_M: f64 = 0.002;

/// Judges one condition, for any representation of the objects.
pub(super) fn judge(scene: &impl Extents, atom: &Atom, rest: &Rest, settings: &RelationSettings) -> AtomVerdict {
    let word = match atom {
        Atom::State { state, .. } => state,
        Atom::Relation { relation, .. } => relation.name(),
    };
    let Some(indices) = atom.ids().map(|id| scene.find(id)).collect::<Option<Vec<_>>>() else {
        return verdict(atom, word, vec![Requirement::fact("in the scene", false)]);
    };
    let bodies: Vec<_> = indices.iter().filter_map(|&index| scene.extent(index)).collect();
    let mut other_readings = Vec::new();
    let mut requirements = match (atom, bodies.as_slice()) {
        (Atom::State { state, .. }, [body]) => body.state(state, settings),
        (Atom::Relation { relation: Relation::Between, .. }, [subject, one, other]) => {
            let centers = [one.center(), subject.center(), other.center()];
            let others = BetweenReading::ALL.into_iter().filter(|reading| *reading != settings.between);
            other_readings.extend(others.map(|reading| between(centers, reading, settings).measurement()));
            vec![between(centers, settings.between, settings)]
        }
        (Atom::Relation { relation: Relation::Between, .. }, _) => vec![Requirement::fact("two references", false)],
        (Atom::Relation { relation, .. }, [subject, reference, ..]) if indices[0] != indices[1] => {
            let pair = measure(*subject, *reference, settings);
            let mut requirements = relation_requirements(*relation, &pair, settings);
            if let Some(contact) = pair.a_over_b.filter(|_| scene.is_table(indices[1]) && relation.is_support()) {
                requirements.push(Requirement::at_most("height over the table", contact.gap_m, RESTING_M));
            }
            requirements
        }
        _ => vec![Requirement::fact("two different objects", false)],
    };
    let disturbed = indices.iter().find_map(|&index| rest.disturbed(index));
    requirements.extend(disturbed.map(|what| Requirement::fact(what, false)));
    AtomVerdict { other_readings, ..verdict(atom, word, requirements) }
}

/// Requirements for A to be in a relation to B.
fn relation_requirements(relation: Relation, pair: &PairGeometry, settings: &RelationSettings) -> Vec<Requirement> {
    let close = || Requirement::at_most("gap in the plane", pair.gap_m, settings.close_m);
    // If the bounds do not overlap along both axes, the projections are disjoint and the pair can be neither in nor on.
    let overlap_x = || Requirement::above("overlap along x", pair.overlap_x_m, 0.0);
    let overlap_y = || Requirement::above("overlap along y", pair.overlap_y_m, 0.0);
    let apart = |toward: f64, overlap: f64| {
        // On the wrong side, the object would have to cross the other one to reach the right side.
        let clear = if toward > 0.0 { -overlap } else { -overlap.abs() - 2.0 * toward.abs() };
        Requirement::at_least("clearance towards that side", clear, 0.0)
    };
    match relation {
        Relation::Left => vec![close(), overlap_x(), apart(pair.offset.y, pair.overlap_y_m)],
        Relation::Right => vec![close(), overlap_x(), apart(-pair.offset.y, pair.overlap_y_m)],
        Relation::Front => vec![close(), overlap_y(), apart(pair.offset.x, pair.overlap_x_m)],
        Relation::Back => vec![close(), overlap_y(), apart(-pair.offset.x, pair.overlap_x_m)],
        Relation::On => on(pair, settings),
        Relation::In => inside(pair, settings),
        Relation::Top => better(inside(pair, settings), on(pair, settings)),
        Relation::Near => {
            let ways = [pair, &pair.swapped()];
            let mut requirements = vec![close()];
            requirements
                .extend(ways.map(|pair| Requirement::clear_of("clearance from being inside", &inside(pair, settings))));
            requirements.extend(
                ways.map(|pair| {
                    Requirement::clear_of("clearance from resting on each other", &touching(pair, settings))
                }),
            );
            requirements
        }
        Relation::Between => vec![Requirement::fact("two references", false)],
    }
}

/// Requirements for A in B.
fn inside(pair: &PairGeometry, settings: &RelationSettings) -> Vec<Requirement> {
    // If each is in the other, the smaller one counts as being in the larger one.
    let share =
        Requirement::above("share of the surface inside", pair.a_in_b, settings.inside_share).in_unit(Unit::Share);
    let mut requirements = vec![share];
    if pair.b_in_a > settings.inside_share {
        requirements
            .push(Requirement::at_most("share of the other inside it", pair.b_in_a, pair.a_in_b).in_unit(Unit::Share));
    }
    requirements
}

/// Requirements for A resting on B, but not in it.
fn on(pair: &PairGeometry, settings: &RelationSettings) -> Vec<Requirement> {
    let mut requirements = touching(pair, settings);
    for (quantity, share) in
        [("share of the surface inside", pair.a_in_b), ("share of the other inside it", pair.b_in_a)]
    {
        if share > 0.0 {
            requirements.push(Requirement::at_most(quantity, share, settings.inside_share).in_unit(Unit::Share));
        }
    }
    requirements
}

/// Requirements for A touching B from above.
fn touching(pair: &PairGeometry, settings: &RelationSettings) -> Vec<Requirement> {
    match pair.a_over_b {
        Some(Contact { gap_m, rise_m }) => {
            let mut requirements = vec![
                Requirement::at_most("vertical gap", gap_m, settings.touching_gap_m),
                Requirement::at_most(SINKING, -gap_m, settings.sinking_m),
                Requirement::above("height of its middle over the other's", rise_m, 0.0),
            ];
            if pair.swapped().a_rests_on_b(settings) {
                requirements.push(Requirement::fact("the upper one", false));
            }
            requirements
        }
        None => {
            let common = pair.overlap_x_m.min(pair.overlap_y_m).min(0.0);
            vec![Requirement::above("overlap of the footprints", common.min(-pair.gap_m), 0.0)]
        }
    }
}

/// Requirement that the second of three centres lies between the first and the last: the polyline through them bends by
/// less than the limit at the second one.
fn between(centers: [DVec3; 3], reading: BetweenReading, settings: &RelationSettings) -> Requirement {
    let Some(bend_rad) = between_bend_rad(centers, reading) else {
        return Requirement::fact("three different places", false);
    };
    let quantity = match reading {
        BetweenReading::Plane => "bend of the way, seen from above, under the limit",
        BetweenReading::Space => "bend of the way under the limit",
    };
    Requirement::above(quantity, settings.between_angle_rad - bend_rad, 0.0).in_unit(Unit::Radian)
}

/// Angle by which the polyline through three points bends at the middle one, rad, seen from above or in space; `None`
/// if two successive points coincide there.
pub fn between_bend_rad([from, at, to]: [DVec3; 3], reading: BetweenReading) -> Option<f64> {
    let (mut there, mut onward) = (at - from, to - at);
    match reading {
        BetweenReading::Plane => (there.z, onward.z) = (0.0, 0.0),
        BetweenReading::Space => {}
    }
    (there.length() > 0.0 && onward.length() > 0.0).then(|| there.angle_between(onward))
}
