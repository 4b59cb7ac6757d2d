//! Settings of the designer and all their defaults.

use std::collections::BTreeMap;

use genmanip_core::{Relation, RobotModel};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Composition of tasks, and quotas for kinds and relations.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct DesignSettings {
    /// Smallest and largest number of objects in a scene.
    pub objects: [usize; 2],
    /// Maximum number of designs tried per task before it fails.
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
    /// Relation of all goals, for the kinds that allow it; `None` if the quotas decide.
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

impl DesignSettings {
    /// These settings with the area, and with it the largest number of objects, scaled to the reach of a robot
    /// ([`RobotModel::reach_scale`]).
    #[must_use]
    pub fn scaled_to(self, robot: &RobotModel) -> Self {
        let ([x, y], [fewest, most]) = (self.area_m, self.objects);
        let scale = robot.reach_scale();
        let most = ((most as f64 * scale).round() as usize).max(fewest);
        Self { area_m: [x * scale, y * scale], objects: [fewest, most], ..self }
    }
}

/// Shares of relations that differ from the defaults in [`Relation::facts`]; the sum of all shares is 1.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(transparent)]
pub struct RelationQuotas(BTreeMap<Relation, f64>);

impl RelationQuotas {
    /// Share of a relation among all edges and goal conditions, 0-1.
    pub fn of(&self, relation: Relation) -> f64 {
        self.0.get(&relation).copied().unwrap_or(relation.facts().quota)
    }
}

impl Default for RelationQuotas {
    fn default() -> Self {
        Self(Relation::ALL.map(|relation| (relation, relation.facts().quota)).into())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_relation_without_a_share_of_its_own_has_the_default() {
        let quotas: RelationQuotas = serde_json::from_str(r#"{"in": 0.5}"#).unwrap();
        assert_eq!((quotas.of(Relation::In), quotas.of(Relation::On)), (0.5, 0.06));
        let table = serde_json::to_value(RelationQuotas::default()).unwrap();
        assert!(Relation::ALL.iter().all(|relation| table[relation.name()] == relation.facts().quota), "{table}");
        assert!(serde_json::from_str::<RelationQuotas>(r#"{"beneath": 0.5}"#).is_err());
    }
}
