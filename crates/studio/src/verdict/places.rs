//! Free places of an object near its own, for repairs.

use std::f64::consts::TAU;

use genmanip_core::glam::{DVec2, DVec3};
use genmanip_core::{Aabb, Pose, World};
use genmanip_layout::LayoutSettings;
use genmanip_relations::{PosedScene, Rest, judge_edges, judge_goal, outlines_apart};

use super::inspection::Inspection;
use super::support::{Below, support};
use crate::edit::{Operation, Placement};

/// Radii of the rings of tried places, m.
const RINGS_M: [f64; 12] = [0.01, 0.02, 0.03, 0.045, 0.06, 0.08, 0.1, 0.13, 0.17, 0.22, 0.28, 0.35];
/// Number of places per ring.
const DIRECTIONS: usize = 16;
/// Spacing of the grid of places on the table, m.
const GRID_M: f64 = 0.06;
/// Gap to neighbours that is used if no place has the layout's gap, m; a gripper's fingers still fit beside most
/// objects.
const SMALL_GAP_M: f64 = 0.012;

/// An object with everything that rests on it, moved together.
pub(super) struct Group {
    /// Indices of the objects; the carrier is the first.
    pub members: Vec<usize>,
}

impl Group {
    /// The group of an object.
    pub fn of(scene: &PosedScene, world: &World, object: usize) -> Self {
        // An object that penetrates another one deeply counts as overlapping it, not as carried by it.
        let below: Vec<Option<Below>> = (0..scene.objects().len())
            .map(|index| support(scene, world, index))
            .map(|own| (own.gap_m >= -world.relations.sinking_m).then_some(own.below))
            .collect();
        let mut members = vec![object];
        let mut next = 0;
        while let Some(&carrier) = members.get(next) {
            let carried = (0..below.len()).filter(|&other| below[other] == Some(Below::Object(carrier)));
            let new: Vec<usize> = carried.filter(|other| !members.contains(other)).collect();
            members.extend(new);
            next += 1;
        }
        Self { members }
    }

    /// Operation that shifts the group by a vector, m.
    pub fn shifted(&self, scene: &PosedScene, by: DVec3) -> Operation {
        let objects = scene.objects().enumerate().filter(|(index, _)| self.members.contains(index));
        let placement = |object: &genmanip_relations::PosedObject| Placement {
            id: object.id.clone(),
            pose: Pose { position: object.pose.position + by, ..object.pose },
            joint_positions: None,
        };
        Operation::Place { objects: objects.map(|(_, object)| placement(object)).collect() }
    }
}

impl Inspection<'_> {
    /// Horizontal shifts of a group (m) to free places on its support, nearest first. There, the group is clear of
    /// other
    /// objects and within the workspace, no true edge becomes false, `should_hold` is true, and the goal is not
    /// reached.
    pub(super) fn free_shifts(&self, group: &Group, should_hold: Option<&genmanip_core::Atom>) -> Vec<DVec3> {
        let Some(scene) = self.scene() else { return Vec::new() };
        let (world, settings) = (&self.scenario.world, &self.equipment.settings);
        let object = group.members[0];
        let Some(bounds) = scene.bounds(object) else { return Vec::new() };
        let id = &self.scenario.objects[object].id;
        let mut edges = self.scenario.task.scene_graph.edges.iter();
        let is_carried = edges.any(|edge| edge.subject == *id && edge.relation.is_support());
        // An object that is by accident on another one is moved to the table.
        let carrier = match support(scene, world, object).below {
            Below::Object(carrier) if is_carried => Some(carrier),
            Below::Object(_) | Below::Surface(_) | Below::Nothing => None,
        };
        let surface = match support(scene, world, object).below {
            Below::Surface(surface) => surface,
            Below::Object(_) | Below::Nothing => 0,
        };
        let Some(surface) = world.surfaces.get(surface) else { return Vec::new() };
        let rise_m = if carrier.is_some() { 0.0 } else { surface.top_center_m.z - bounds.min.z };
        let center = bounds.center().truncate();
        let mut shifts: Vec<DVec3> = self
            .middles(scene, object, center)
            .into_iter()
            .flat_map(around)
            .map(|place| (place - center).extend(rise_m))
            .collect();
        let area = surface.area(0.0);
        let steps = |[low, high]: [f64; 2]| {
            (0..).map(move |step| low + GRID_M * f64::from(step)).take_while(move |&at| at <= high)
        };
        if carrier.is_none() {
            shifts.extend(
                steps(area.x).flat_map(|x| steps(area.y).map(move |y| (DVec2::new(x, y) - center).extend(rise_m))),
            );
        }
        shifts.sort_by(|one, other| one.truncate().length().total_cmp(&other.truncate().length()));
        let before = false_edges(self, scene);
        let mut moved = scene.clone();
        for gap_m in [settings.min_gap_m, SMALL_GAP_M] {
            let free: Vec<DVec3> = shifts
                .iter()
                .filter(|shift| {
                    let by = **shift;
                    if carrier.is_none() && !is_in_area(&bounds, by, world, settings, surface) {
                        return false;
                    }
                    group.members.iter().for_each(|&member| moved.shift(member, by));
                    let is_free = self.is_free(&moved, group, carrier, gap_m) && {
                        let after = false_edges(self, &moved);
                        after.iter().all(|edge| before.contains(edge))
                            && should_hold.is_none_or(|edge| !after.contains(edge))
                    };
                    group.members.iter().for_each(|&member| moved.shift(member, -by));
                    is_free
                })
                .copied()
                .collect();
            if !free.is_empty() {
                return free;
            }
        }
        Vec::new()
    }

    /// Centres of the rings of places: the object itself, and the objects that share an edge with it.
    fn middles(&self, scene: &PosedScene, object: usize, center: DVec2) -> Vec<DVec2> {
        let id = &self.scenario.objects[object].id;
        let edges = self.scenario.task.scene_graph.edges.iter().map(genmanip_core::GraphEdge::atom);
        let mut others: Vec<usize> = Vec::new();
        for edge in edges.filter(|edge| edge.ids().any(|other| other == id)) {
            others.extend(edge.ids().filter(|other| *other != id).filter_map(|other| self.scenario.index_of(other)));
        }
        let middles = others.into_iter().filter_map(|other| Some(scene.bounds(other)?.center().truncate()));
        std::iter::once(center).chain(middles).collect()
    }

    /// True if a group keeps its gap to everything else, is still on its support, and the goal is not reached.
    fn is_free(&self, moved: &PosedScene, group: &Group, carrier: Option<usize>, gap_m: f64) -> bool {
        let world = &self.scenario.world;
        let others = (0..moved.objects().len()).filter(|other| !group.members.contains(other));
        let carriers = std::iter::successors(carrier, |&carrier| match support(moved, world, carrier).below {
            Below::Object(next) if next != carrier => Some(next),
            Below::Object(_) | Below::Surface(_) | Below::Nothing => None,
        });
        let carriers: Vec<usize> = carriers.take(moved.objects().len()).collect();
        let on_carrier =
            carrier.is_none_or(|carrier| support(moved, world, group.members[0]).below == Below::Object(carrier));
        let clear = |other: usize| {
            carriers.contains(&other) || group.members.iter().all(|&member| outlines_apart(moved, member, other, gap_m))
        };
        let settings = &world.relations;
        on_carrier
            && others.into_iter().all(clear)
            && !judge_goal(moved, &self.scenario.task.judged_goal(), &Rest::default(), settings).success
    }
}

fn around(middle: DVec2) -> impl Iterator<Item = DVec2> {
    RINGS_M.into_iter().flat_map(move |radius| {
        (0..DIRECTIONS)
            .map(move |direction| middle + radius * DVec2::from_angle(TAU * direction as f64 / DIRECTIONS as f64))
    })
}

fn is_in_area(
    bounds: &Aabb,
    by: DVec3,
    world: &World,
    settings: &LayoutSettings,
    surface: &genmanip_core::SupportSurface,
) -> bool {
    let area = surface.area(0.0);
    let area = match world.table() {
        Some(table) if table.id == surface.id => {
            world.workspace.within(settings.wide_x_m, settings.wide_y_m).within(area.x, area.y)
        }
        _ => area,
    };
    let (low, high) = (bounds.min + by, bounds.max + by);
    low.x >= area.x[0] && high.x <= area.x[1] && low.y >= area.y[0] && high.y <= area.y[1]
}

fn false_edges(inspection: &Inspection, scene: &PosedScene) -> Vec<genmanip_core::Atom> {
    let verdicts = judge_edges(scene, &inspection.scenario.task.scene_graph, &inspection.scenario.world.relations);
    verdicts.into_iter().filter(|verdict| !verdict.holds).map(|verdict| verdict.atom).collect()
}
