//! Spatial relations with their kind of geometry, logic and phrases. Crate `relations` decides whether one holds.

use glam::DVec2;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Spatial relations in the robot's frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Relation {
    /// Farther from the robot (+x).
    Front,
    /// Nearer to the robot (-x).
    Back,
    /// To the robot's left (+y).
    Left,
    /// To the robot's right (-y).
    Right,
    /// Close in the plane, neither in nor on nor beneath.
    Near,
    /// Resting on the reference or lying in it.
    Top,
    /// Resting on the reference, but not in it.
    On,
    /// Lying in a cavity of the reference.
    In,
    /// Between two references.
    Between,
}

impl Relation {
    /// All relations.
    pub const ALL: [Self; 9] =
        [Self::Front, Self::Back, Self::Left, Self::Right, Self::Near, Self::Top, Self::On, Self::In, Self::Between];

    /// Relations to a single reference: all relation words of the exchange format.
    pub const OF_PAIRS: [Self; 8] =
        [Self::Front, Self::Back, Self::Left, Self::Right, Self::Near, Self::Top, Self::On, Self::In];

    /// Relations to one side of the reference.
    pub const SIDES: [Self; 4] = [Self::Front, Self::Back, Self::Left, Self::Right];

    /// Relations in which the reference supports or contains the subject.
    pub const SUPPORTS: [Self; 3] = [Self::Top, Self::On, Self::In];

    /// Facts about the relation, which all crates share.
    pub const fn facts(self) -> &'static RelationFacts {
        match self {
            Self::Front => &RelationFacts {
                name: "front",
                kind: RelationKind::Side(Side { axis: HorizontalAxis::Depth, is_positive: true }),
                inverse: Some(Self::Back),
                implies: &[Self::Near],
                spellings: &["in front", "in front of", "front of"],
                described: "on the far side of",
                located: &["on the far side of"],
                directed: &["on the far side of"],
                quota: 0.14,
            },
            Self::Back => &RelationFacts {
                name: "back",
                kind: RelationKind::Side(Side { axis: HorizontalAxis::Depth, is_positive: false }),
                inverse: Some(Self::Front),
                implies: &[Self::Near],
                spellings: &["behind", "in back of", "back of"],
                described: "on the robot's side of",
                located: &["on the robot's side of"],
                directed: &["on the robot's side of"],
                quota: 0.14,
            },
            Self::Left => &RelationFacts {
                name: "left",
                kind: RelationKind::Side(Side { axis: HorizontalAxis::Width, is_positive: true }),
                inverse: Some(Self::Right),
                implies: &[Self::Near],
                spellings: &["left of", "to the left", "to the left of", "on the left of"],
                described: "to the robot's left of",
                located: &["to the robot's left of"],
                directed: &["to the robot's left of"],
                quota: 0.16,
            },
            Self::Right => &RelationFacts {
                name: "right",
                kind: RelationKind::Side(Side { axis: HorizontalAxis::Width, is_positive: false }),
                inverse: Some(Self::Left),
                implies: &[Self::Near],
                spellings: &["right of", "to the right", "to the right of", "on the right of"],
                described: "to the robot's right of",
                located: &["to the robot's right of"],
                directed: &["to the robot's right of"],
                quota: 0.16,
            },
            Self::Near => &RelationFacts {
                name: "near",
                kind: RelationKind::Around,
                inverse: Some(Self::Near),
                implies: &[],
                spellings: &[],
                described: "near",
                located: &["next to", "near", "close to", "beside"],
                directed: &["next to", "near", "close to", "beside"],
                quota: 0.10,
            },
            Self::Top => &RelationFacts {
                name: "top",
                kind: RelationKind::Support(Support::OnOrIn),
                inverse: None,
                implies: &[],
                spellings: &["on top", "on top of", "top of"],
                described: "on",
                located: &["on"],
                directed: &["on", "onto"],
                quota: 0.09,
            },
            Self::On => &RelationFacts {
                name: "on",
                kind: RelationKind::Support(Support::On),
                inverse: None,
                implies: &[Self::Top],
                spellings: &["onto", "upon"],
                described: "on",
                located: &["on", "on top of"],
                directed: &["on", "onto", "on top of"],
                quota: 0.06,
            },
            Self::In => &RelationFacts {
                name: "in",
                kind: RelationKind::Support(Support::In),
                inverse: None,
                implies: &[Self::Top],
                spellings: &["inside", "into", "inside of"],
                described: "in",
                located: &["in", "inside"],
                directed: &["into", "in", "inside"],
                quota: 0.09,
            },
            Self::Between => &RelationFacts {
                name: "between",
                kind: RelationKind::Between,
                inverse: None,
                implies: &[],
                spellings: &[],
                described: "between",
                located: &["between"],
                directed: &["between"],
                quota: 0.06,
            },
        }
    }

    /// Name in files.
    pub const fn name(self) -> &'static str {
        self.facts().name
    }

    /// Relation by its name in files; `None` for an unknown name.
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|relation| relation.name() == name)
    }

    /// Position of the subject relative to its references.
    pub const fn kind(self) -> RelationKind {
        self.facts().kind
    }

    /// Converse relation: that of the reference to the subject; `None` if there is none.
    pub const fn inverse(self) -> Option<Self> {
        self.facts().inverse
    }

    /// Side of the reference on which the subject is; `None` for relations without a side.
    pub const fn side(self) -> Option<Side> {
        match self.kind() {
            RelationKind::Side(side) => Some(side),
            RelationKind::Around | RelationKind::Support(_) | RelationKind::Between => None,
        }
    }

    /// True if the reference supports or contains the subject.
    pub const fn is_support(self) -> bool {
        matches!(self.kind(), RelationKind::Support(_))
    }

    /// True if the reference contains the subject.
    pub const fn is_inside(self) -> bool {
        matches!(self.kind(), RelationKind::Support(Support::In))
    }

    /// True if the relation has two references.
    pub const fn has_two_references(self) -> bool {
        matches!(self.kind(), RelationKind::Between)
    }

    /// True if `other` is this relation or holds wherever this relation holds.
    pub fn implies(self, other: Self) -> bool {
        self == other || self.facts().implies.contains(&other)
    }

    /// Text of the place in a description: `on the far side of the Plate`, `between the Plate and the Mug`.
    pub fn describe(self, reference: &str, second: Option<&str>) -> String {
        let second = second.map_or_else(String::new, |second| format!(" and the {second}"));
        format!("{} the {reference}{second}", self.facts().described)
    }
}

/// Facts about a relation that designer, judge and prompts share.
#[derive(Clone, Copy, Debug)]
pub struct RelationFacts {
    /// Name in files and answers of language models.
    pub name: &'static str,
    /// Position of the subject relative to its references.
    pub kind: RelationKind,
    /// Relation of the reference to the subject; `None` if there is none.
    pub inverse: Option<Relation>,
    /// Further relations that hold wherever this one holds.
    pub implies: &'static [Relation],
    /// Longer spellings in answers of language models. All prompts state that front is the far side.
    pub spellings: &'static [&'static str],
    /// Preposition in descriptions of a scene.
    pub described: &'static str,
    /// Prepositions of designed instructions for a location: `in the bowl`. The first names the place of a step.
    pub located: &'static [&'static str],
    /// Prepositions of designed instructions for a direction: `into the bowl`.
    pub directed: &'static [&'static str],
    /// Default share of the relation among all edges and goal conditions of a designed batch; the sum of all is 1.
    /// Shares are a choice: the sides have the largest, since most edges connect neighbours on the table; `on` and
    /// `between` the smallest, since few objects fit on or between others.
    pub quota: f64,
}

/// Kind of geometry by which a relation is judged.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RelationKind {
    /// Beyond one side of the reference.
    Side(Side),
    /// Close to the reference in any direction.
    Around,
    /// Supported or contained by the reference.
    Support(Support),
    /// Between two references.
    Between,
}

/// Side of a reference in the robot's frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Side {
    /// Horizontal axis along which the bounds are apart.
    pub axis: HorizontalAxis,
    /// True if the subject has the larger coordinate.
    pub is_positive: bool,
}

impl Side {
    /// Unit vector from the reference to the subject, x and y of the robot's frame.
    pub fn direction(self) -> DVec2 {
        let along = match self.axis {
            HorizontalAxis::Depth => DVec2::X,
            HorizontalAxis::Width => DVec2::Y,
        };
        if self.is_positive { along } else { -along }
    }
}

/// Horizontal axis of the robot's frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum HorizontalAxis {
    /// x, away from the robot.
    Depth,
    /// y, to the robot's left.
    Width,
}

impl HorizontalAxis {
    /// The horizontal axis perpendicular to this one.
    pub const fn other(self) -> Self {
        match self {
            Self::Depth => Self::Width,
            Self::Width => Self::Depth,
        }
    }
}

/// Kind of support by the reference.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Support {
    /// On the reference.
    On,
    /// In the reference.
    In,
    /// On or in the reference.
    OnOrIn,
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Checks that the lists hold every relation of their kind.
    #[test]
    fn the_lists_hold_every_relation_of_their_kind() {
        let schema = serde_json::to_value(schemars::schema_for!(Relation)).unwrap();
        let variants = schema["oneOf"].as_array().unwrap().iter().map(|variant| variant["const"].as_str().unwrap());
        assert_eq!(variants.collect::<Vec<_>>(), Relation::ALL.map(Relation::name), "Relation::ALL");
        let those =
            |holds: fn(Relation) -> bool| Relation::ALL.into_iter().filter(|one| holds(*one)).collect::<Vec<_>>();
        assert_eq!(those(|one| !one.has_two_references()), Relation::OF_PAIRS, "Relation::OF_PAIRS");
        assert_eq!(those(|one| one.side().is_some()), Relation::SIDES, "Relation::SIDES");
        assert_eq!(those(Relation::is_support), Relation::SUPPORTS, "Relation::SUPPORTS");
    }

    #[test]
    fn the_facts_agree_with_each_other() {
        let mut spellings: Vec<&str> = Vec::new();
        for relation in Relation::ALL {
            let (name, facts) = (relation.name(), relation.facts());
            assert_eq!(serde_json::to_value(relation).unwrap(), name);
            assert_eq!(Relation::named(name), Some(relation));
            if let Some(inverse) = facts.inverse {
                assert_eq!(inverse.inverse(), Some(relation), "{name}");
                let opposite = relation.side().map(|side| Side { is_positive: !side.is_positive, ..side });
                assert_eq!(inverse.side(), opposite, "{name}");
            }
            assert!(facts.implies.iter().all(|other| *other != relation), "{name}");
            assert!(!facts.described.is_empty() && !facts.located.is_empty() && !facts.directed.is_empty(), "{name}");
            assert!(facts.quota > 0.0, "{name}");
            spellings.extend(facts.spellings.iter().copied().chain([name]));
        }
        let count = spellings.len();
        spellings.sort_unstable();
        spellings.dedup();
        assert_eq!(spellings.len(), count, "a spelling stands for two relations: {spellings:?}");
        let sum: f64 = Relation::ALL.iter().map(|relation| relation.facts().quota).sum();
        assert!((sum - 1.0).abs() < 1e-12, "the quotas of all relations add up to {sum}");
    }
}
