//! Faults planted in sound scenarios.

use std::f64::consts::TAU;
use std::sync::Arc;

use genmanip_assets::Catalogue;
use genmanip_core::glam::DVec3;
use genmanip_core::{Atom, ObjectCard, Pose, Scenario, Seed, named_enum};
use genmanip_layout::{GoalOrder, GoalSearch, ReachCheck, moves, obstacles, posed};
use genmanip_relations::{PosedScene, ShapeCache, judge_atom};
use genmanip_studio::edit::{ChosenAsset, Operation, Placement};
use genmanip_studio::verdict::{Equipment, ProblemCode};
use genmanip_tasks::wording;
use rand::RngExt;

named_enum! {
    /// Kind of a planted fault.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub enum Fault {
        /// An object is lifted.
        Floating = "floating",
        /// An object is pushed into another.
        Overlap = "overlap",
        /// The object of the goal is beyond the arm's reach.
        Unreachable = "unreachable",
        /// The object of the goal is inside a tall container.
        Hidden = "hidden",
        /// The object of the goal is where it shall be.
        GoalHolds = "goal_holds",
        /// An object has moved away from what its edge names.
        EdgeFalse = "edge_false",
        /// The instruction fits two objects.
        Ambiguous = "ambiguous_sentence",
        /// A neighbour is in the way of every grasp.
        GraspBlocked = "grasp_blocked",
    }
}

/// A scenario with a fault.
pub struct Planted {
    /// The scenario.
    pub scenario: Arc<Scenario>,
    /// Ids of the objects of which one has to be named.
    pub objects: Vec<String>,
}

/// Uid of a tall container that hides small objects, and the thickness of its floor, m.
const HIDING: [&str; 3] = ["bin-2", "pen-holder-7", "jar-9"];

impl Fault {
    /// Codes of problems that tell the fault.
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

    /// The scenario with the fault; `None` if it has no place in this scene.
    pub fn plant(self, scenario: &Arc<Scenario>, equipment: &Equipment, seed: Seed) -> Option<Planted> {
        let scene = posed(scenario, equipment.assets, &mut ShapeCache::default()).ok()?;
        let rng = &mut seed.rng();
        let step = moves(&scenario.task.goal, &scene).into_iter().flatten().find(|step| step.state().is_none());
        let target = step.as_ref().map(|step| step.object);
        let id = |index: usize| scenario.objects[index].id.clone();
        let place = |index: usize, position: DVec3| Operation::Place {
            objects: vec![Placement {
                id: id(index),
                pose: Pose { position, ..scenario.objects[index].pose },
                joint_positions: None,
            }],
        };
        let done = |operations: &[Operation], objects: Vec<String>| {
            let mut changed = scenario.as_ref().clone();
            for operation in operations {
                changed = operation.apply(&changed, equipment.assets).ok()?.scenario;
            }
            Some(Planted { scenario: Arc::new(changed), objects })
        };
        let count = scenario.objects.len();
        match self {
            Self::Floating => {
                let free: Vec<usize> = (0..count).filter(|&index| is_alone(scenario, index)).collect();
                let index = *free.get(rng.random_range(0..free.len().max(1)))?;
                let lift = DVec3::Z * rng.random_range(0.004..0.05);
                done(&[place(index, scenario.objects[index].pose.position + lift)], vec![id(index)])
            }
            Self::Overlap => {
                let index = (0..count).find(|&index| is_alone(scenario, index))?;
                let other = (0..count).find(|&other| other != index && is_alone(scenario, other))?;
                let [one, two] = [scene.bounds(index)?, scene.bounds(other)?];
                let reach = 0.3 * (one.size().y.min(one.size().x) + two.size().y.min(two.size().x));
                let offset = (two.center() - one.center()).truncate() + reach * genmanip_core::glam::DVec2::Y;
                let position = scenario.objects[index].pose.position + offset.extend(0.0);
                done(&[place(index, position)], vec![id(index)])
            }
            Self::Unreachable => {
                let index = target.filter(|&index| is_alone(scenario, index))?;
                let area = scenario.world.table()?.area(0.05);
                let y = if rng.random::<bool>() { area.y[0] } else { area.y[1] };
                let position = DVec3::new(area.x[1], y, scenario.objects[index].pose.position.z);
                (!equipment.planner.reaches_from_above(position))
                    .then(|| done(&[place(index, position)], vec![id(index)]))?
            }
            Self::Hidden => {
                let index = target.filter(|&index| is_alone(scenario, index))?;
                let size = scene.bounds(index)?.size();
                let uid = HIDING.into_iter().find(|uid| {
                    let room = Catalogue::full().card(uid).and_then(|card| card.annotations.room);
                    room.is_some_and(|room| {
                        room.depth_m > 1.3 * size.z && room.inside_m[0].min(room.inside_m[1]) > size.x.hypot(size.y)
                    })
                })?;
                let model = Catalogue::full().build(uid).ok()?;
                let floor =
                    model.cavities(&[]).iter().map(|piece| piece.support(DVec3::NEG_Z).z).fold(f64::INFINITY, f64::min);
                let at = scenario.objects[index].pose.position;
                let container = Operation::Add {
                    asset: ChosenAsset::Uid(uid.into()),
                    id: None,
                    pose: Pose::from_position(DVec3 { z: 0.0, ..at }),
                    distractor: true,
                };
                done(&[container, place(index, at + DVec3::Z * floor)], vec![id(index)])
            }
            Self::GoalHolds => {
                let step = step?;
                let upright: Vec<_> = scene.objects().map(|object| object.pose.rotation).collect();
                let alternatives = moves(&scenario.task.goal, &scene);
                // One move alone fulfils the goal.
                alternatives.iter().find(|alternative| alternative.len() == 1)?;
                let search = GoalSearch {
                    scene: &scene,
                    upright: &upright,
                    workspace: &scenario.world.workspace,
                    relations: &scenario.world.relations,
                    settings: &equipment.settings.goal_pose,
                    order: GoalOrder::Margin,
                };
                let goal = search.goal_poses(&step, &[], &|_| true, seed).into_iter().next()?;
                done(&[place(step.object, goal.world_from_object.position)], vec![id(step.object)])
            }
            Self::EdgeFalse => {
                let edges = scenario.task.scene_graph.edges.iter().map(genmanip_core::GraphEdge::atom);
                let edge = edges.into_iter().find(|edge| {
                    let subject = scenario.index_of(edge.subject());
                    matches!(edge, Atom::Relation { relation, .. } if !relation.is_support())
                        && subject.is_some_and(|index| is_alone(scenario, index))
                })?;
                let index = scenario.index_of(edge.subject())?;
                let area = scenario.world.workspace;
                (0..50).find_map(|_| {
                    let x = rng.random_range(area.x[0] + 0.08..area.x[1] - 0.08);
                    let y = rng.random_range(area.y[0] + 0.08..area.y[1] - 0.08);
                    let position = DVec3::new(x, y, scenario.objects[index].pose.position.z);
                    let mut moved: PosedScene = scene.clone();
                    moved.shift(index, position - scenario.objects[index].pose.position);
                    let is_false = !judge_atom(&moved, &edge, &scenario.world.relations).holds;
                    let is_free = (0..count)
                        .all(|other| other == index || genmanip_relations::outlines_apart(&moved, index, other, 0.03));
                    (is_false && is_free).then(|| done(&[place(index, position)], vec![id(index)]))?
                })
            }
            Self::Ambiguous => {
                let index = target?;
                let (mut said, node) = (scenario.task.clone(), scenario.task.scene_graph.index_of(&id(index))?);
                let card = Arc::clone(&said.objects[node]);
                let alike = |other: &&ObjectCard| {
                    other.category == card.category
                        && other.uid != card.uid
                        && other.can_grasp
                        && scenario.index_of(&other.uid).is_none()
                };
                let other = Catalogue::full().cards().iter().find(alike)?;
                let name = card.category.replace('_', " ");
                said.objects[node] = Arc::new(ObjectCard { name, ..(*card).clone() });
                let text = wording::step(&said, &id(index), 0);
                let at = free_place(scenario, &scene)?;
                let add = Operation::Add {
                    asset: ChosenAsset::Uid(other.uid.clone()),
                    id: None,
                    pose: Pose::from_position(at),
                    distractor: false,
                };
                done(&[add, Operation::Instruction { text }], vec![id(index), other.uid.clone()])
            }
            Self::GraspBlocked => {
                let index = target.filter(|&index| is_alone(scenario, index))?;
                let blocked = blocking_neighbours(scenario, &scene, index, equipment)?;
                done(&[blocked], vec![id(index)])
            }
        }
    }
}

/// True if no support edge names the object, so that it stands on the table alone.
fn is_alone(scenario: &Scenario, index: usize) -> bool {
    let id = &scenario.objects[index].id;
    let supports = |edge: &&genmanip_core::GraphEdge| edge.relation.is_support();
    !scenario.task.scene_graph.edges.iter().filter(supports).any(|edge| edge.subject == *id || edge.reference == *id)
}

/// A place on the table far from all objects.
fn free_place(scenario: &Scenario, scene: &PosedScene) -> Option<DVec3> {
    let area = scenario.world.workspace;
    let places = (1..20).flat_map(|x| (1..20).map(move |y| (f64::from(x) / 20.0, f64::from(y) / 20.0)));
    let places = places.map(|(x, y)| {
        DVec3::new(area.x[0] + x * (area.x[1] - area.x[0]), area.y[0] + y * (area.y[1] - area.y[0]), 0.0)
    });
    let gap = |place: &DVec3| {
        let bounds = (0..scenario.objects.len()).filter_map(|index| scene.bounds(index));
        bounds
            .map(|bounds| (bounds.center() - *place).truncate().length() - 0.5 * bounds.size().truncate().length())
            .fold(f64::INFINITY, f64::min)
    };
    places.max_by(|one, other| gap(one).total_cmp(&gap(other))).filter(|place| gap(place) > 0.08)
}

/// Another object put so close to the one of the goal that no grasp of it is left.
fn blocking_neighbours(
    scenario: &Scenario,
    scene: &PosedScene,
    index: usize,
    equipment: &Equipment,
) -> Option<Operation> {
    let robot = equipment.planner.robot();
    let known: Vec<_> =
        scene.objects().map(|object| equipment.grasps.of(robot, &object.model).unwrap_or_default()).collect();
    let bounds = scene.bounds(index)?;
    for other in (0..scenario.objects.len()).filter(|&other| other != index && is_alone(scenario, other)) {
        let theirs = scene.bounds(other)?;
        if theirs.size().z < 0.8 * bounds.size().z {
            continue;
        }
        for direction in 0..8 {
            let angle = TAU * f64::from(direction) / 8.0;
            let toward = genmanip_core::glam::DVec2::from_angle(angle);
            let mut moved = scene.clone();
            let middle = bounds.center().truncate() - theirs.center().truncate();
            // The smallest distance along this direction at which they are apart.
            let Some(shift) = (0..80).find_map(|step| {
                let shift = (middle + toward * (0.005 * f64::from(step))).extend(0.0);
                moved.shift(other, shift);
                let is_apart = genmanip_relations::outlines_apart(&moved, index, other, 0.002);
                moved.shift(other, -shift);
                is_apart.then_some(shift)
            }) else {
                continue;
            };
            moved.shift(other, shift);
            let clear = (0..scenario.objects.len()).all(|third| {
                third == other || third == index || genmanip_relations::outlines_apart(&moved, other, third, 0.01)
            });
            let check = |scene| ReachCheck {
                scene,
                world: &scenario.world,
                planner: &equipment.planner,
                settings: &equipment.settings,
                known_grasps: &known,
                seed: Seed::new(1),
            };
            if clear && check(&moved).is_graspable(index, &obstacles::around(&moved, None)).is_ok_and(|yes| !yes) {
                let object = &scenario.objects[other];
                let pose = Pose { position: object.pose.position + shift, ..object.pose };
                return Some(Operation::Place {
                    objects: vec![Placement { id: object.id.clone(), pose, joint_positions: None }],
                });
            }
        }
    }
    None
}
