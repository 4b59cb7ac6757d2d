//! Every default of the designer on one screen.

use genmanip_core::Relation;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// How tasks are composed and how often each kind and relation should occur.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct DesignSettings {
    /// Fewest and most objects in a scene.
    pub objects: [usize; 2],
    /// Designs tried per task before it is given up.
    pub max_draws: usize,
    /// Share of each relation among all edges and goal conditions of a batch, in the order
    /// front, back, left, right, near, top, on, in, between; their sum is 1.
    pub relation_quotas: [f64; 9],
    /// How many occurrences of a relation chance may outweigh.
    pub chance: f64,
    /// Share of tasks whose goal has alternatives, where the kind allows them.
    pub disjunctions: f64,
    /// Share of scenes with a second copy of something.
    #[serde(default)]
    pub copies: f64,
    /// Size along x and y of the area that a scene is sketched in, metres.
    pub area_m: [f64; 2],
    /// Smallest gap between the outlines of neighbours in the sketch, metres.
    pub gap_m: f64,
}

impl Default for DesignSettings {
    fn default() -> Self {
        Self {
            objects: [3, 10],
            max_draws: 400,
            //                front back  left  right near  top   on    in    between
            relation_quotas: [0.14, 0.14, 0.16, 0.16, 0.10, 0.09, 0.06, 0.09, 0.06],
            chance: 3.0,
            disjunctions: 0.2,
            copies: 0.0,
            area_m: [0.47, 0.78],
            gap_m: 0.035,
        }
    }
}

impl DesignSettings {
    /// Share of a relation among all edges and goal conditions.
    pub fn relation_quota(&self, relation: Relation) -> f64 {
        Relation::ALL.iter().position(|known| *known == relation).map_or(0.0, |index| self.relation_quotas[index])
    }
}
