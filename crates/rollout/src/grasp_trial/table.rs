//! Tables with settled objects outside the catalogue, as scenes of grasp trials.

use std::f64::consts::TAU;
use std::sync::Arc;

use genmanip_assets::{Catalogue, variant};
use genmanip_core::glam::DVec3;
use genmanip_core::{AssetUid, ObjectCard, ObjectModel, PhysicsFactors, Pose, Seed, World};
use genmanip_sim::{Model, SceneObject, SettleSettings, Sim};
use rand::RngExt;

use super::{TrialClass, TrialError};

/// Categories of cards that are grasped by a handle or shaft and lie flat.
pub(super) const UTENSILS: [&str; 9] =
    ["spoon", "fork", "spatula", "ladle", "pan", "pen", "hammer", "screwdriver", "wrench"];

/// Mean position of the target and its spread, m. Chosen by hand: the middle of the area that the arm reaches from all
/// sides.
const MIDDLE: DVec3 = DVec3::new(0.5, 0.0, 0.0);
const SPREAD_M: f64 = 0.05;
/// Number of objects in clutter, and their spread around the mean position, m. Chosen by hand such that most are within
/// the gripper's width of another.
const CLUTTER: usize = 8;
const CLUTTER_SPREAD_M: f64 = 0.17;
/// Minimum gap between the reduced bounding circles in clutter, m. Chosen by hand.
const NEAR_M: f64 = 0.01;
/// Maximum positions sampled per object before it is omitted, and number of samples after which the area grows by a
/// quarter. Chosen by hand such that the last samples are drawn from twice the width.
const DRAWS: u32 = 2000;
const DRAWS_PER_AREA: u32 = 400;
/// Drop height of the objects, m. Chosen by hand: above rounding errors and below a bounce.
const DROP_M: f64 = 0.001;
/// Maximum settling time, simulated seconds. Twice that of a layout, since these objects start with gaps below them.
const SETTLE_S: f64 = 4.0;

/// Objects at rest; the first one is the target.
#[derive(Clone, Debug)]
pub struct Table {
    /// Models of the objects.
    pub models: Vec<Arc<ObjectModel>>,
    /// Poses `world_from_object`, in the order of the models.
    pub poses: Vec<Pose>,
}

impl Table {
    /// Samples the objects of a class and settles them.
    pub(super) fn settled(
        catalogue: &Catalogue,
        class: TrialClass,
        world: &World,
        seed: Seed,
    ) -> Result<Self, TrialError> {
        let graspable = |card: &&ObjectCard| card.can_grasp && !card.is_articulated;
        let is_utensil = |card: &ObjectCard| UTENSILS.contains(&card.category.as_str());
        let of_class = |utensils: bool| -> Vec<&ObjectCard> {
            catalogue.cards().iter().filter(graspable).filter(|card| is_utensil(card) == utensils).collect()
        };
        let (compact, utensils) = (of_class(false), of_class(true));
        let all: Vec<&ObjectCard> = compact.iter().chain(&utensils).copied().collect();
        let mut rng = seed.fork("things").rng();
        let mut draw = |from: &[&ObjectCard]| from[rng.random_range(0..from.len())].uid.clone();
        let uids: Vec<AssetUid> = match class {
            TrialClass::Compact => vec![draw(&compact)],
            TrialClass::Utensils => vec![draw(&utensils)],
            TrialClass::Clutter => std::iter::once(draw(&compact)).chain((1..CLUTTER).map(|_| draw(&all))).collect(),
        };
        let mut models = Vec::new();
        for (index, uid) in uids.iter().enumerate() {
            models.push(Arc::new(variant(&*catalogue.build(uid)?, seed.fork("variant").fork_index(index as u64))));
        }
        let mut table = Self { poses: places(&models, seed.fork("places")), models };
        table.models.truncate(table.poses.len());
        table.settle(world)?;
        Ok(table)
    }

    /// A single upright object at the mean position, at rest.
    pub(super) fn with_one(model: Arc<ObjectModel>, world: &World) -> Result<Self, TrialError> {
        let mut table = Self { models: vec![model], poses: vec![Pose::from_position(MIDDLE + DVec3::Z * DROP_M)] };
        table.settle(world)?;
        Ok(table)
    }

    fn settle(&mut self, world: &World) -> Result<(), TrialError> {
        let scene = Model::compile_without_robot(world, &self.objects())?;
        let mut settling = Sim::new(Arc::new(scene));
        settling.settle(&SettleSettings { max_seconds: SETTLE_S, ..SettleSettings::default() })?;
        self.poses = settling.object_states().iter().map(|state| state.pose).collect();
        Ok(())
    }

    /// The objects as simulation input.
    pub(super) fn objects(&self) -> Vec<SceneObject> {
        self.models
            .iter()
            .zip(&self.poses)
            .enumerate()
            .map(|(index, (model, &pose))| SceneObject {
                name: index.to_string(),
                model: Arc::clone(model),
                pose,
                joint_positions: Vec::new(),
                physics: PhysicsFactors::default(),
            })
            .collect()
    }
}

/// Upright poses with random yaw; the target near the mean position, the others at increasing distances until they fit.
fn places(models: &[Arc<ObjectModel>], seed: Seed) -> Vec<Pose> {
    let mut rng = seed.rng();
    let radius = |model: &ObjectModel| model.card.size_m.x.hypot(model.card.size_m.y) / 2.0;
    let mut placed: Vec<(Pose, f64)> = Vec::new();
    for model in models {
        let spread = if placed.is_empty() { SPREAD_M } else { CLUTTER_SPREAD_M };
        // Bounding circles of long objects are conservative: let them overlap by a third.
        let reach = 0.5 * radius(model) + 0.25 * model.card.size_m.x.min(model.card.size_m.y);
        for draw in 0..DRAWS {
            let wider = 1.0 + f64::from(draw / DRAWS_PER_AREA) * 0.25;
            let mut off = || wider * spread * (2.0 * rng.random::<f64>() - 1.0);
            let position = MIDDLE + DVec3::new(off(), off(), DROP_M);
            let yaw = TAU * rng.random::<f64>();
            let free = |(pose, other): &(Pose, f64)| pose.position.distance(position) > reach + other + NEAR_M;
            if placed.iter().all(free) {
                placed.push((Pose::from_position_yaw(position, yaw), reach));
                break;
            }
        }
    }
    placed.into_iter().map(|(pose, _)| pose).collect()
}
