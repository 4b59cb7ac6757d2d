//! Fault of a blocked grasp: a neighbour so close to an object that no grasp of the object is left.

use std::f64::consts::TAU;

use genmanip_assets::Catalogue;
use genmanip_core::glam::{DVec2, DVec3};
use genmanip_core::{InstanceId, ObjectCard, Pose, Scenario, Seed};
use genmanip_layout::{LayoutSettings, ReachCheck, is_harmless, obstacles};
use genmanip_motion::FeasibilitySettings;
use genmanip_relations::{PosedScene, outlines_apart};
use rand::seq::SliceRandom;
use rand::{Rng, RngExt};

use super::site::{Planted, Site};
use crate::edit::{ChosenAsset, Operation};
use crate::verdict::Equipment;

/// Range of the gap between the object and its neighbour, m.
const GAP_M: [f64; 2] = [0.001, 0.006];
/// Minimum gap between the neighbour and all other objects, m.
const APART_M: f64 = 0.015;
/// Number of directions in which the neighbour is tried.
const DIRECTIONS: u32 = 8;
/// Number of objects of the catalogue that are tried as neighbours.
const ADDED: usize = 6;
/// Maximum horizontal extent of an added neighbour, m.
const MAX_EXTENT_M: f64 = 0.3;
/// Random streams of the grasp search before the object counts as blocked. Many, since the place is selected as the
/// worst of several, where a single search may fail by chance.
const STREAMS: u64 = 24;

/// Plants the fault by moving an object of the scene, or an added one, beside the target; `None` if that never blocks
/// it.
pub(super) fn plant(site: &Site, rng: &mut impl Rng) -> Option<Planted> {
    let index = site.target().filter(|&index| site.is_alone(index))?;
    let height_m = site.scene.bounds(index)?.size().z;
    let known = (0..site.count()).filter(|&other| other != index && site.is_alone(other));
    let tall = known.filter(|&other| site.scene.bounds(other).is_some_and(|bounds| bounds.size().z > 0.8 * height_m));
    let beside = |scene: &PosedScene, scenario: &Scenario, other: usize, rng: &mut _| {
        let site = Blocking { scene, scenario, equipment: site.equipment, index, other };
        site.shift(rng)
    };
    for other in tall {
        let Some(by) = beside(&site.scene, site.scenario, other, rng) else { continue };
        if site.keeps_the_rest(&site.moved(other, by)) {
            return found(site, &[site.shifted(other, by)], index, site.id(other));
        }
    }
    let fits = |card: &&ObjectCard| {
        let extents = card.size_m;
        extents.z > height_m
            && extents.truncate().max_element() <= MAX_EXTENT_M
            && !card.is_articulated
            && is_harmless(card, &site.scenario.task)
            && site.scenario.index_of(&InstanceId::new(&card.uid, 1)).is_none()
    };
    let mut cards: Vec<&ObjectCard> = Catalogue::full().cards().iter().filter(fits).collect();
    cards.shuffle(rng);
    cards.into_iter().take(ADDED).find_map(|card| {
        let id = InstanceId::new(&card.uid, 1);
        let at = |position: DVec3| Operation::Add {
            asset: ChosenAsset::Uid(card.uid.clone()),
            id: Some(id.clone()),
            pose: Pose::from_position(position),
            distractor: true,
        };
        let added = at(DVec3::ZERO).apply(site.scenario, site.equipment.assets).ok()?.scenario;
        let scene = site.equipment.scene(&added).ok()?;
        let other = added.index_of(&id)?;
        let by = beside(&scene, &added, other, rng)?;
        found(site, &[at(by)], index, id)
    })
}

fn found(site: &Site, operations: &[Operation], index: usize, neighbour: InstanceId) -> Option<Planted> {
    let planted = site.planted(operations, vec![site.id(index)])?;
    Some(Planted { neighbour: Some(neighbour), ..planted })
}

/// A target object and the neighbour that is to block it.
struct Blocking<'a> {
    scene: &'a PosedScene,
    scenario: &'a Scenario,
    equipment: &'a Equipment,
    index: usize,
    other: usize,
}

impl Blocking<'_> {
    /// Shift of the neighbour (m) after which no grasp of the target is left, although there is one without the
    /// neighbour; `None` if there is no such shift.
    fn shift(&self, rng: &mut impl Rng) -> Option<DVec3> {
        let Self { scene, index, other, .. } = *self;
        let middle = (scene.bounds(index)?.center() - scene.bounds(other)?.center()).truncate();
        let (turn, gap_m) = (rng.random_range(0.0..TAU), rng.random_range(GAP_M[0]..GAP_M[1]));
        let mut moved = scene.clone();
        (0..DIRECTIONS).find_map(|direction| {
            let away = DVec2::from_angle(turn + TAU * f64::from(direction) / f64::from(DIRECTIONS));
            // The smallest distance along this direction at which the two do not overlap.
            let by = (0..200).find_map(|step| {
                let by = (middle + away * (0.002 * f64::from(step))).extend(0.0);
                moved.shift(other, by);
                let is_apart = outlines_apart(&moved, index, other, gap_m);
                moved.shift(other, -by);
                is_apart.then_some(by)
            })?;
            moved.shift(other, by);
            let clear = (0..scene.objects().len())
                .all(|third| third == other || third == index || outlines_apart(&moved, other, third, APART_M));
            let is_blocked = clear && self.is_blocked(&moved);
            moved.shift(other, -by);
            is_blocked.then_some(by)
        })
    }

    fn is_blocked(&self, scene: &PosedScene) -> bool {
        let first = std::iter::once(Seed::new(1));
        !self.is_graspable(scene, None, first)
            && self.is_graspable(scene, Some(self.other), (1..=STREAMS).map(Seed::new))
            && !self.is_graspable(scene, None, (2..=STREAMS).map(Seed::new))
    }

    /// True if the layout's grasp search finds a grasp, with all arm configurations that the expert tries.
    fn is_graspable(
        &self,
        scene: &PosedScene,
        without: Option<usize>,
        mut streams: impl Iterator<Item = Seed>,
    ) -> bool {
        let Equipment { planner, grasps, .. } = self.equipment;
        let configurations = FeasibilitySettings::default().configurations;
        let grasp = FeasibilitySettings { configurations, ..FeasibilitySettings::reach_only() };
        let settings = LayoutSettings { grasp, ..LayoutSettings::default() };
        let known: Vec<_> =
            scene.objects().map(|object| grasps.of(planner.robot(), &object.model).unwrap_or_default()).collect();
        let occupied = obstacles::around(scene, without);
        streams.any(|seed| {
            let check = ReachCheck {
                scene,
                world: &self.scenario.world,
                planner,
                settings: &settings,
                known_grasps: &known,
                seed,
            };
            check.is_graspable(self.index, &occupied).unwrap_or(false)
        })
    }
}
