//! Comparison of worlds: by field for people, by hash for results.

use std::collections::BTreeMap;

use crate::hash::hexadecimal;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use sha2::{Digest, Sha256};

use super::World;

/// Part of a world that a field belongs to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum WorldPart {
    /// Affects motion: surfaces, robot, physics settings.
    Physics,
    /// Affects verdicts: relation settings, usable areas.
    Judging,
    /// Affects appearance: cameras, appearance randomisation, names, legs.
    Looks,
}

impl WorldPart {
    /// All parts, in the order of this enum.
    pub const ALL: [Self; 3] = [Self::Physics, Self::Judging, Self::Looks];

    /// Name of the part in files and messages.
    pub fn name(self) -> &'static str {
        match self {
            Self::Physics => "physics",
            Self::Judging => "judging",
            Self::Looks => "looks",
        }
    }
}

/// One hash per part of a world, twelve hexadecimal digits each; stored with every result.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct WorldHashes {
    /// Hash of [`WorldPart::Physics`].
    pub physics: String,
    /// Hash of [`WorldPart::Judging`].
    pub judging: String,
    /// Hash of [`WorldPart::Looks`].
    pub looks: String,
}

impl WorldHashes {
    /// Hash of one part.
    pub fn of(&self, part: WorldPart) -> &str {
        match part {
            WorldPart::Physics => &self.physics,
            WorldPart::Judging => &self.judging,
            WorldPart::Looks => &self.looks,
        }
    }
}

/// A field in which two worlds differ.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct WorldDifference {
    /// Part that the field belongs to.
    pub part: WorldPart,
    /// Field path, e.g. `physics.gravity_m_s2` or `surfaces.0.size_m.1`.
    pub field: String,
    /// Value in the first world; `nothing` if absent.
    pub ours: String,
    /// Value in the second world; `nothing` if absent.
    pub theirs: String,
}

impl std::fmt::Display for WorldDifference {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} ({}): {} here, {} there", self.field, self.part.name(), self.ours, self.theirs)
    }
}

impl World {
    /// A hash per part over its fields in name order; numbers are compared by value, not spelling.
    pub fn hashes(&self) -> WorldHashes {
        let fields = self.fields();
        let of = |part: WorldPart| {
            let mut hasher = Sha256::new();
            for (field, value) in fields.iter().filter(|(field, _)| part_of(field) == part) {
                hasher.update(format!("{field}={value}\n"));
            }
            hexadecimal(&hasher.finalize()[..6])
        };
        WorldHashes { physics: of(WorldPart::Physics), judging: of(WorldPart::Judging), looks: of(WorldPart::Looks) }
    }

    /// All fields in which the worlds differ, sorted by path; `self` is the first world.
    pub fn differences(&self, other: &Self) -> Vec<WorldDifference> {
        let (ours, theirs) = (self.fields(), other.fields());
        let fields: std::collections::BTreeSet<&String> = ours.keys().chain(theirs.keys()).collect();
        let text = |side: &BTreeMap<String, String>, field: &String| {
            side.get(field).map_or_else(|| "nothing".into(), |value| shortened(value))
        };
        fields
            .into_iter()
            .filter(|field| ours.get(*field) != theirs.get(*field))
            .map(|field| WorldDifference {
                part: part_of(field),
                field: field.clone(),
                ours: text(&ours, field),
                theirs: text(&theirs, field),
            })
            .collect()
    }

    /// The first difference that forbids replaying one world's recordings in the other; `None` if there is none or only
    /// appearance differs.
    pub fn refusal(&self, other: &Self) -> Option<WorldDifference> {
        self.differences(other).into_iter().find(|difference| difference.part != WorldPart::Looks)
    }

    /// All values by dotted field path.
    fn fields(&self) -> BTreeMap<String, String> {
        let mut fields = BTreeMap::new();
        collect(&serde_json::to_value(self).unwrap_or_default(), String::new(), &mut fields);
        fields
    }
}

/// Text of a value, cut if it is long, as that of a photograph.
fn shortened(value: &str) -> String {
    const LONGEST: usize = 200;
    match value.char_indices().nth(LONGEST) {
        Some((end, _)) => format!("{}… ({} bytes)", &value[..end], value.len()),
        None => value.to_owned(),
    }
}

/// Part that a field belongs to.
fn part_of(field: &str) -> WorldPart {
    let parts: Vec<&str> = field.split('.').collect();
    match parts.as_slice() {
        ["surfaces", _, "name" | "legs", ..] => WorldPart::Looks,
        ["surfaces", _, "edge_margin_m"] => WorldPart::Judging,
        ["surfaces" | "floor_z_m" | "robot" | "physics", ..] => WorldPart::Physics,
        ["workspace" | "relations", ..] => WorldPart::Judging,
        _ => WorldPart::Looks,
    }
}

fn collect(value: &Value, place: String, fields: &mut BTreeMap<String, String>) {
    let below = |name: &str| if place.is_empty() { name.to_owned() } else { format!("{place}.{name}") };
    match value {
        Value::Object(map) => map.iter().for_each(|(name, value)| collect(value, below(name), fields)),
        Value::Array(list) => {
            list.iter().enumerate().for_each(|(index, value)| collect(value, below(&index.to_string()), fields));
        }
        // 30 and 30.0 are the same number; the shortest round-trip text of a float is the same on every platform.
        Value::Number(number) => {
            fields.insert(place, number.as_f64().map_or_else(|| number.to_string(), |value| format!("{value:?}")));
        }
        other => {
            fields.insert(place, other.to_string());
        }
    }
}
