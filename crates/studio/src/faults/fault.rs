//! Kinds of faults, and how each is planted; the checks of the layout confirm each one.

use std::f64::consts::TAU;
use std::sync::Arc;

use genmanip_assets::Catalogue;
use genmanip_core::glam::{DVec2, DVec3};
use genmanip_core::{Atom, GraphEdge, InstanceId, ObjectCard, Pose, ReferenceId, Scenario, Seed, named_enum};
use genmanip_layout::{GoalOrder, GoalSearch, hidden, moves, overlaps};
use genmanip_relations::{judge_atom, outlines_apart};
use genmanip_tasks::wording;
use rand::seq::SliceRandom;
use rand::{Rng, RngExt};

use super::blocked;
use super::site::{Planted, Site};
use crate::edit::{ChosenAsset, Operation, Placement};
use crate::verdict::{Equipment, ProblemCode, edge_between};

named_enum! {
    /// Kind of a planted fault.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub enum Fault {
        /// An object floats above its support.
        Floating = "floating",
        /// An object penetrates another one.
        Overlap = "overlap",
        /// An object that the goal moves is beyond the arm's reach.
        Unreachable = "unreachable",
        /// An object that the goal moves is inside a tall container, where no camera sees it.
        Hidden = "hidden",
        /// The goal already holds.
        GoalHolds = "goal_holds",
        /// An object has been moved so that an edge of the scene graph is false.
        EdgeFalse = "edge_false",
        /// The instruction fits two objects.
        Ambiguous = "ambiguous_sentence",
        /// A neighbour obstructs every grasp of an object that the goal moves.
        GraspBlocked = "grasp_blocked",
    }
}

/// Minimum gap between a moved object and all others, m.
const APART_M: f64 = 0.02;
/// Range of the gap between the two objects of the same category, m.
const TWIN_GAP_M: [f64; 2] = [0.05, 0.12];
/// Maximum number of random places tried.
const DRAWS: usize = 300;

impl Fault {
    /// Problem codes of the verdict that count as finding this fault.
    pub fn codes(self) -> &'static [ProblemCode] {
        match self {
            Self::Floating => &[ProblemCode::Floating],
            Self::Overlap => &[ProblemCode::Overlap],
            Self::Unreachable => &[ProblemCode::Unreachable],
            Self::Hidden => &[ProblemCode::Hidden],
            Self::GoalHolds => &[ProblemCode::GoalHolds],
            Self::EdgeFalse => &[ProblemCode::EdgeFalse],
            Self::Ambiguous => &[ProblemCode::AmbiguousSentence],
            Self::GraspBlocked => &[ProblemCode::GraspBlocked],
        }
    }

    /// The scenario with the fault; `None` if this scene offers no place for it.
    pub fn plant(self, scenario: &Arc<Scenario>, equipment: &Equipment, seed: Seed) -> Option<Planted> {
        let scene = equipment.scene(scenario).ok()?;
        // With alternatives in the goal, a fault of one would leave the others feasible.
        let step = match moves(&scenario.task.judged_goal(), &scene).as_slice() {
            [only] => only.iter().find(|step| step.state().is_none()).cloned(),
            _ => None,
        };
        let site = Site { scenario, scene, equipment, step };
        let rng = &mut seed.rng();
        match self {
            Self::Floating => site.floating(rng),
            Self::Overlap => site.overlap(rng),
            Self::Unreachable => site.unreachable(rng),
            Self::Hidden => site.hidden(),
            Self::GoalHolds => site.goal_holds(seed),
            Self::EdgeFalse => site.edge_false(rng),
            Self::Ambiguous => site.ambiguous(rng),
            Self::GraspBlocked => blocked::plant(&site, rng),
        }
    }
}

impl Site<'_> {
    fn floating(&self, rng: &mut impl Rng) -> Option<Planted> {
        let free: Vec<usize> = (0..self.count()).filter(|&index| self.is_alone(index)).collect();
        let index = *free.get(rng.random_range(0..free.len().max(1)))?;
        let lift = DVec3::Z * rng.random_range(0.004..0.05);
        self.planted(&[self.shifted(index, lift)], vec![self.id(index)])
    }

    /// Moves one object towards another until the simulator reports an overlap of the two.
    fn overlap(&self, rng: &mut impl Rng) -> Option<Planted> {
        let mut pairs: Vec<(usize, usize)> = (0..self.count())
            .flat_map(|one| (0..self.count()).map(move |other| (one, other)))
            .filter(|&(one, other)| one != other && self.is_alone(one) && self.is_alone(other))
            .collect();
        pairs.shuffle(rng);
        // Preferably with all edges still true; most edges become false when their objects overlap.
        [true, false].into_iter().find_map(|keeps_edges| {
            pairs.iter().take(6).find_map(|&(index, other)| self.overlapping(index, other, keeps_edges, rng))
        })
    }

    fn overlapping(&self, index: usize, other: usize, keeps_edges: bool, rng: &mut impl Rng) -> Option<Planted> {
        let [one, two] = [self.scene.bounds(index)?, self.scene.bounds(other)?];
        let reach = 0.3 * (one.size().truncate().min_element() + two.size().truncate().min_element());
        let turn = rng.random_range(0.0..TAU);
        (0..8).find_map(|direction| {
            let away = DVec2::from_angle(turn + TAU * f64::from(direction) / 8.0);
            let by = ((two.center() - one.center()).truncate() + reach * away).extend(0.0);
            let moved = self.moved(index, by);
            let is_clear = (0..self.count())
                .all(|third| third == index || third == other || outlines_apart(&moved, index, third, APART_M));
            if !is_clear || self.is_reached(&moved) || (keeps_edges && !self.keeps_edges(&moved)) {
                return None;
            }
            let found = overlaps(&moved, &self.scenario.world, &self.equipment.settings).ok()?;
            let ids = [self.id(index), self.id(other)];
            let is_real = found.iter().any(|overlap| {
                let two: [&ReferenceId; 2] = [&self.scenario.objects[overlap.object].id, &overlap.other];
                ids.iter().all(|id| two.contains(&&**id))
            });
            is_real.then(|| self.planted(&[self.shifted(index, by)], ids.into()))?
        })
    }

    fn unreachable(&self, rng: &mut impl Rng) -> Option<Planted> {
        let index = self.target().filter(|&index| self.is_alone(index))?;
        let area = self.scenario.world.table()?.area(0.05);
        let mut sides = area.y;
        sides.shuffle(rng);
        sides.into_iter().find_map(|y| {
            let from = self.scenario.objects[index].pose.position;
            let position = DVec3::new(area.x[1], y, from.z);
            let is_far = !self.equipment.planner.reaches_from_above(position);
            (is_far && self.is_clear(&self.moved(index, position - from), index, APART_M))
                .then(|| self.planted(&[self.shifted(index, position - from)], vec![self.id(index)]))?
        })
    }

    /// Moves the object into the smallest container that hides it from all cameras.
    fn hidden(&self) -> Option<Planted> {
        let index = self.target().filter(|&index| self.is_alone(index))?;
        let size = self.scene.bounds(index)?.size();
        let at = self.scenario.objects[index].pose.position;
        let mut containers: Vec<&ObjectCard> = Catalogue::full()
            .cards()
            .iter()
            .filter(|card| {
                card.annotations.room.is_some_and(|room| {
                    room.depth_m > 1.3 * size.z && room.inside_m[0].min(room.inside_m[1]) > size.x.hypot(size.y)
                })
            })
            .filter(|card| !card.is_articulated && genmanip_layout::is_harmless(card, &self.scenario.task))
            .collect();
        containers.sort_by(|one, other| one.size_m.x.total_cmp(&other.size_m.x));
        containers.into_iter().take(8).find_map(|card| {
            let model = Catalogue::full().build(&card.uid).ok()?;
            let floor_m =
                model.cavities(&[]).iter().map(|piece| piece.support(DVec3::NEG_Z).z).fold(f64::INFINITY, f64::min);
            let container = Operation::Add {
                asset: ChosenAsset::Uid(card.uid.clone()),
                id: None,
                pose: Pose::from_position(DVec3 { z: 0.0, ..at }),
                distractor: true,
            };
            let operations = [container, self.shifted(index, DVec3::Z * floor_m)];
            let planted = self.planted(&operations, vec![self.id(index)])?;
            let scene = self.equipment.scene(&planted.scenario).ok()?;
            let container = scene.objects().len() - 1;
            let clear = (0..self.count()).all(|other| other == index || outlines_apart(&scene, container, other, 0.01));
            let Equipment { planner, settings, .. } = self.equipment;
            let seen = hidden(&scene, &self.scenario.world, index + 1, index + 1, planner.robot(), settings).ok()?;
            (clear && self.keeps_the_rest(&scene) && seen.iter().any(|seen| seen.object == index)).then_some(planted)
        })
    }

    /// Carries out a single move that fulfils the goal, preferably with all edges still true.
    fn goal_holds(&self, seed: Seed) -> Option<Planted> {
        let step = self.step.as_ref()?;
        let upright: Vec<_> = self.scene.objects().map(|object| object.pose.rotation).collect();
        let goal = moves(&self.scenario.task.judged_goal(), &self.scene);
        if goal.iter().any(|steps| steps.len() > 1) {
            return None;
        }
        let search = GoalSearch {
            scene: &self.scene,
            upright: &upright,
            workspace: &self.scenario.world.workspace,
            relations: &self.scenario.world.relations,
            settings: &genmanip_layout::GoalPoseSettings::default(),
            order: GoalOrder::Margin,
        };
        let goals = search.goal_poses(step, &[], &|_| true, seed);
        let placed = |goal: &genmanip_layout::GoalPose| {
            let mut moved = self.scene.clone();
            moved.set_pose(step.object, goal.world_from_object, &self.scenario.objects[step.object].joint_positions);
            moved
        };
        let goal = goals.iter().find(|goal| self.keeps_edges(&placed(goal))).or(goals.first())?;
        let objects = vec![Placement { id: self.id(step.object), pose: goal.world_from_object, joint_positions: None }];
        self.is_reached(&placed(goal))
            .then(|| self.planted(&[Operation::Place { objects }], vec![self.id(step.object)]))?
    }

    fn edge_false(&self, rng: &mut impl Rng) -> Option<Planted> {
        let mut edges: Vec<Atom> = self.scenario.task.scene_graph.edges.iter().map(GraphEdge::atom).collect();
        edges.shuffle(rng);
        edges.into_iter().find_map(|edge| {
            let index = self.scenario.index_of(edge.subject()).filter(|&index| self.is_alone(index))?;
            let area = self.scenario.world.workspace;
            (0..DRAWS).find_map(|_| {
                let x = rng.random_range(area.x[0] + 0.08..area.x[1] - 0.08);
                let y = rng.random_range(area.y[0] + 0.08..area.y[1] - 0.08);
                let from = self.scenario.objects[index].pose.position;
                let by = DVec3::new(x, y, from.z) - from;
                let moved = self.moved(index, by);
                let relations = &self.scenario.world.relations;
                let only_it = !judge_atom(&moved, &edge, relations).holds
                    && self.false_edges(&moved).iter().all(|known| *known == edge)
                    && !self.is_reached(&moved);
                (only_it && self.is_clear(&moved, index, 0.03))
                    .then(|| self.planted(&[self.shifted(index, by)], vec![self.id(index)]))?
            })
        })
    }

    /// Adds a second object of the target's category, and an instruction that names only the category.
    fn ambiguous(&self, rng: &mut impl Rng) -> Option<Planted> {
        let index = self.target()?;
        let [alternative] = self.scenario.task.goal.alternatives.as_slice() else { return None };
        if alternative.iter().any(|atom| *atom.subject() != self.id(index)) {
            return None;
        }
        let (mut said, node) = (self.scenario.task.clone(), self.scenario.task.scene_graph.index_of(&self.id(index))?);
        let card = Arc::clone(&said.objects[node]);
        let alike = |other: &&ObjectCard| {
            other.category == card.category
                && other.uid != card.uid
                && other.can_grasp
                && self.scenario.index_of(&InstanceId::new(&other.uid, 1)).is_none()
        };
        let other = Catalogue::full().cards().iter().find(alike)?;
        let id = InstanceId::new(&other.uid, 1);
        let name = card.category.replace('_', " ");
        said.objects[node] = Arc::new(ObjectCard { name, ..(*card).clone() });
        let text = wording::step(&said, &self.id(index), 0);
        let area = self.scenario.world.workspace;
        (0..DRAWS).find_map(|_| {
            let x = rng.random_range(area.x[0] + 0.05..area.x[1] - 0.05);
            let y = rng.random_range(area.y[0] + 0.05..area.y[1] - 0.05);
            let add = Operation::Add {
                asset: ChosenAsset::Uid(other.uid.clone()),
                id: Some(id.clone()),
                pose: Pose::from_position(DVec3::new(x, y, 0.0)),
                distractor: false,
            };
            let added = add.apply(self.scenario, self.equipment.assets).ok()?.scenario;
            let scene = self.equipment.scene(&added).ok()?;
            let twin = added.index_of(&id)?;
            let nodes = added.task.scene_graph.nodes.len();
            let gaps = (0..added.objects.len()).filter(|&one| one != twin);
            let gaps: Vec<(f64, usize)> =
                gaps.filter_map(|one| Some((genmanip_relations::planar_gap(&scene, twin, one)?, one))).collect();
            let nearest = gaps.iter().filter(|(_, one)| *one < nodes).min_by(|one, two| one.0.total_cmp(&two.0))?;
            let is_free = gaps.iter().all(|(gap_m, _)| *gap_m >= TWIN_GAP_M[0]) && nearest.0 <= TWIN_GAP_M[1];
            if !is_free || self.is_reached(&scene) {
                return None;
            }
            let edge = edge_between(&scene, twin, nearest.1, &self.scenario.world.relations)?;
            let edges = added.task.scene_graph.edges.iter().cloned().chain([edge]).collect();
            let operations =
                [add, Operation::Edges { edges, description: None }, Operation::Instruction { text: text.clone() }];
            self.planted(&operations, vec![self.id(index), id.clone()])
        })
    }
}
