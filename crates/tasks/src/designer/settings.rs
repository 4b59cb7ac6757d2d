//! Settings of the designer and all their defaults.

use genmanip_core::Relation;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Composition of tasks, and quotas for kinds and relations.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct DesignSettings {
    /// Smallest and largest number of objects in a scene.
    pub objects: [usize; 2],
    /// Designs tried per task before the task fails.
    pub max_draws: usize,
    /// Share of each relation among all edges and goal conditions of a batch.
    pub relation_quotas: RelationQuotas,
    /// Amplitude of the random noise in the choice of relations, in occurrences of a relation.
    pub chance: f64,
    /// Share of tasks whose goal has alternatives, for the kinds that allow it.
    pub disjunctions: f64,
    /// Share of scenes with a second instance of one object.
    #[serde(default)]
    pub copies: f64,
    /// Smallest and largest number of steps of a long-horizon task, within 2 to 4.
    #[serde(default = "two_to_four")]
    pub steps: [usize; 2],
    /// Relation of all goals, for the kinds that allow it; by default the quotas decide.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub goal_relation: Option<Relation>,
    /// Size along x and y of the area in which a scene is sketched, metres.
    pub area_m: [f64; 2],
    /// Smallest gap between the outlines of neighbours in the sketch, metres.
    pub gap_m: f64,
}

fn two_to_four() -> [usize; 2] {
    [2, 4]
}

impl Default for DesignSettings {
    fn default() -> Self {
        Self {
            objects: [3, 10],
            max_draws: 400,
            relation_quotas: RelationQuotas::default(),
            chance: 3.0,
            disjunctions: 0.2,
            copies: 0.0,
            steps: two_to_four(),
            goal_relation: None,
            area_m: [0.47, 0.78],
            gap_m: 0.035,
        }
    }
}

/// One share per relation; their sum is 1.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct RelationQuotas {
    /// Share of `front`: farther from the robot.
    pub front: f64,
    /// Share of `back`: nearer to the robot.
    pub back: f64,
    /// Share of `left`: to the robot's left.
    pub left: f64,
    /// Share of `right`: to the robot's right.
    pub right: f64,
    /// Share of `near`: close in the plane.
    pub near: f64,
    /// Share of `top`: resting on or lying in.
    pub top: f64,
    /// Share of `on`: resting on.
    pub on: f64,
    /// Share of `in`: lying in.
    pub r#in: f64,
    /// Share of `between`: between two others.
    pub between: f64,
}

impl RelationQuotas {
    /// Share of a relation. The exhaustive match requires a share for every new relation.
    pub fn of(&self, relation: Relation) -> f64 {
        match relation {
            Relation::Front => self.front,
            Relation::Back => self.back,
            Relation::Left => self.left,
            Relation::Right => self.right,
            Relation::Near => self.near,
            Relation::Top => self.top,
            Relation::On => self.on,
            Relation::In => self.r#in,
            Relation::Between => self.between,
        }
    }
}

impl Default for RelationQuotas {
    fn default() -> Self {
        // Shares are a choice: the directions have the largest, since most edges connect neighbours on the table; `on`
        // and `between` the smallest, since few objects fit on or between others.
        Self {
            front: 0.14,
            back: 0.14,
            left: 0.16,
            right: 0.16,
            near: 0.10,
            top: 0.09,
            on: 0.06,
            r#in: 0.09,
            between: 0.06,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quotas_are_shares_of_all_relations() {
        let quotas = RelationQuotas::default();
        let sum: f64 = Relation::ALL.iter().map(|&relation| quotas.of(relation)).sum();
        assert!((sum - 1.0).abs() < 1e-12, "{sum}");
        // The field names are those of the relations, and no relation is missing from `ALL`.
        let table = serde_json::to_value(quotas).unwrap();
        let names: Vec<&str> = Relation::ALL.map(Relation::name).to_vec();
        assert!(names.iter().all(|name| table[name].as_f64() > Some(0.0)), "{table}");
        assert_eq!(table.as_object().map(serde_json::Map::len), Some(names.len()));
    }
}
