//! Perturbation of one scenario along one axis.
//!
//! Ranges at dial 1 are chosen by hand: as large as the day-to-day variation in a laboratory, and still solvable.
//! Smaller dials scale the ranges proportionally. Ranges of light, background, texture and paint are in
//! `genmanip_render::sampling`.

use std::sync::Arc;

use genmanip_assets::{Catalogue, GraspLibrary};
use genmanip_core::sensor::SensorPreset;
use genmanip_core::{
    AppearanceFactor, AppearanceRandomisation, Atom, Camera, CameraMount, CameraSensor, ColorSensor, DepthSensor, Goal,
    InstanceId, ObjectCard, PlacedObject, Relation, Request, Scenario, Seed, TaskKind, World,
};
use genmanip_layout::{LayoutSettings, add_distractors, lay_out, obstacles, posed};
use genmanip_motion::{AllowedCollisions, Planner, PlannerSettings, PlanningScene};
use genmanip_relations::{Rest, ShapeCache, judge_goal};
use genmanip_render::sampling::jittered;
use genmanip_rollout::physics_variation::vary_physics;
use genmanip_tasks::references;
use genmanip_tasks::wording::{from_the_camera, paraphrases};
use rand::{Rng, RngExt};

use super::Axis;
use genmanip_workspace::WorkspaceError;
use genmanip_workspace::worlds;

/// Maximum translation of a camera along each axis, m, and rotation about each axis, rad, by the camera's mount.
const CAMERA: [(CameraMount, f64, f64); 2] = [(CameraMount::World, 0.06, 0.06), (CameraMount::Hand, 0.01, 0.03)];
/// Maximum deviation of each arm joint from its home, rad.
const START_RAD: f64 = 0.25;
/// Maximum number of postures sampled until one is collision-free.
const POSTURES: usize = 100;
/// Minimum distance from the joint limits, rad.
const LIMIT_RAD: f64 = 0.05;
/// Maximum change of the exposure, stops, and of the white-balance gains, as a share.
const EXPOSURE_STOPS: f64 = 0.7;
const WHITE_BALANCE: f64 = 0.12;
/// JPEG quality at dial 1, the lowest (of 1 to 100).
const JPEG_QUALITY: f64 = 40.0;
/// Number of distractors added at dial 1.
const DISTRACTORS: f64 = 5.0;
/// Number of paraphrases of the instruction to draw from.
const PARAPHRASES: usize = 8;
/// Maximum number of new requests sampled until the rule-based reader understands one.
const REQUESTS: usize = 200;

/// Perturbs scenarios along one axis; planner and settings are built once.
pub struct Perturber {
    axis: Axis,
    dial: f64,
    /// Planner of the robot in the world of the suite.
    pub planner: Arc<Planner>,
    layout: LayoutSettings,
}

impl Perturber {
    /// A perturber for scenarios of a world; `dial` in (0, 1] is the strength of the perturbation.
    ///
    /// # Errors
    /// If the robot of the world is unknown.
    pub fn new(world: &World, axis: Axis, dial: f64) -> Result<Self, WorkspaceError> {
        let planner = worlds::planner(world, &PlannerSettings::default())?;
        Ok(Self { axis, dial, planner, layout: LayoutSettings::default() })
    }

    /// The perturbed scenario, with the id and seed of the original.
    ///
    /// # Errors
    /// If the scenario cannot be perturbed along this axis; the error is the reason.
    pub fn change(&self, scenario: &Scenario, seed: Seed) -> Result<Scenario, String> {
        let mut changed = scenario.clone();
        let (world, rng) = (&mut changed.world, &mut seed.rng());
        match self.axis {
            Axis::Layout => changed.objects = self.laid_out_anew(scenario, seed)?,
            Axis::Camera => world.cameras.iter_mut().for_each(|camera| self.shift(camera, rng)),
            Axis::RobotStart => world.robot.start = Some(self.posture(scenario, rng)?),
            Axis::Light => world.look = Some(self.look(AppearanceFactor::Light, seed)),
            Axis::Background => world.look = Some(self.look(AppearanceFactor::Background, seed)),
            Axis::Texture => world.look = Some(self.look(AppearanceFactor::Material, seed)),
            Axis::Paint => world.look = Some(self.look(AppearanceFactor::Objects, seed)),
            Axis::Sensor => {
                let sensor = self.sensor(rng);
                world.cameras.iter_mut().for_each(|camera| camera.sensor = Some(sensor));
            }
            Axis::Physics => vary_physics(&mut changed, seed, self.dial),
            Axis::Distractors => {
                let count = (self.dial * DISTRACTORS).ceil() as usize;
                let more = add_distractors(scenario, Catalogue::builtin(), count, seed, &self.layout);
                let more = more.map_err(|error| error.to_string())?;
                changed.objects = more.ok_or("there is no room for more things")?.objects;
            }
            Axis::Wording => {
                let mut all = paraphrases(&scenario.task, PARAPHRASES);
                all.extend(from_the_camera(&scenario.task));
                let chosen = (!all.is_empty()).then(|| rng.random_range(0..all.len()));
                let chosen = chosen.ok_or("the reader accepts no other wording")?;
                changed.task.instruction.clone_from(&all[chosen]);
            }
            Axis::Instruction => exchange(&mut changed, rng)?,
        }
        Ok(changed)
    }

    fn laid_out_anew(&self, scenario: &Scenario, seed: Seed) -> Result<Vec<PlacedObject>, String> {
        let (catalogue, grasps) = (Catalogue::builtin(), GraspLibrary::builtin());
        let (task, world) = (&scenario.task, &scenario.world);
        let anew = lay_out(task, catalogue, world, &self.planner, grasps, seed, &self.layout);
        anew.map(|anew| anew.objects).map_err(|error| match error.is_defect() {
            true => error.to_string(),
            false => "there is no other layout".into(),
        })
    }

    fn shift(&self, camera: &mut Camera, rng: &mut impl Rng) {
        if let Some((_, shift_m, turn_rad)) = CAMERA.iter().find(|(mount, ..)| *mount == camera.mount) {
            *camera = jittered(camera, self.dial * shift_m, self.dial * turn_rad, rng);
        }
    }

    /// Random collision-free arm configuration near home.
    fn posture(&self, scenario: &Scenario, rng: &mut impl Rng) -> Result<Vec<f64>, String> {
        let scene = posed(scenario, Catalogue::builtin(), &mut ShapeCache::default());
        let around = obstacles::around(&scene.map_err(|error| error.to_string())?, None);
        let robot = self.planner.robot();
        let nothing = AllowedCollisions::none();
        let gripper_width = robot.gripper.max_width;
        let around = PlanningScene { world: &around, attached: None, allowed: &nothing, gripper_width };
        let draw = |rng: &mut dyn FnMut() -> f64| -> Vec<f64> {
            let joints = robot.arm_joints().zip(&robot.home);
            let near = joints.map(|(joint, &home)| {
                (home + self.dial * START_RAD * (2.0 * rng() - 1.0))
                    .clamp(joint.lower + LIMIT_RAD, joint.upper - LIMIT_RAD)
            });
            near.collect()
        };
        let mut postures = (0..POSTURES).map(|_| draw(&mut || rng.random::<f64>()));
        let free = postures.find(|posture| self.planner.check(&around, posture).is_none());
        free.ok_or_else(|| "the arm touches something in every posture that was drawn".into())
    }

    fn look(&self, vary: AppearanceFactor, seed: Seed) -> AppearanceRandomisation {
        AppearanceRandomisation { strength: self.dial, ..AppearanceRandomisation::new(seed, vec![vary]) }
    }

    /// Sensor of a D435 with changed exposure and white balance.
    fn sensor(&self, rng: &mut impl Rng) -> CameraSensor {
        let usual = SensorPreset::named("d435").map(|preset| preset.sensor).unwrap_or_default();
        let mut within = |most: f64| self.dial * most * (2.0 * rng.random::<f64>() - 1.0);
        let color = usual.color.map(|color| ColorSensor {
            exposure_stops: within(EXPOSURE_STOPS),
            white_balance: [1.0 + within(WHITE_BALANCE), 1.0, 1.0 + within(WHITE_BALANCE)],
            read_noise_e: color.read_noise_e * (1.0 + 3.0 * self.dial),
            jpeg_quality: Some((100.0 - self.dial * (100.0 - JPEG_QUALITY)) as u8),
            ..color
        });
        let depth =
            usual.depth.map(|depth| DepthSensor { disparity_error_px: depth.disparity_error_px * self.dial, ..depth });
        CameraSensor { depth, color }
    }
}

/// Relations that a new request can ask for, with their prepositions.
const ASKED: [(Relation, &str); 5] = [
    (Relation::Near, "next to"),
    (Relation::Left, "to the left of"),
    (Relation::Right, "to the right of"),
    (Relation::Front, "in front of"),
    (Relation::In, "into"),
];

/// Free space around an object that is to be put into another one, m. Chosen by hand.
const AROUND_M: f64 = 0.01;

/// True if the first object, in its initial orientation, fits into the second's cavity.
fn fits((object, container): (&ObjectCard, &ObjectCard)) -> bool {
    let size = object.size_m.truncate().max_element() + AROUND_M;
    container.annotations.room.is_some_and(|room| room.inside_m.into_iter().all(|inside| size <= inside))
}

/// Replaces the instruction and goal by a request for something else, which the reader understands and which does not
/// hold yet. The original goal is judged as well.
fn exchange(scenario: &mut Scenario, rng: &mut impl Rng) -> Result<(), String> {
    let scene = posed(scenario, Catalogue::builtin(), &mut ShapeCache::default()).map_err(|error| error.to_string())?;
    let task = &scenario.task;
    let known = task.judged_goal().into_owned();
    // An object with several copies has no unique name.
    let ids: Vec<&InstanceId> =
        task.scene_graph.nodes.iter().map(|node| &node.id).filter(|id| id.copy().is_none()).collect();
    let movable: Vec<&InstanceId> =
        ids.iter().copied().filter(|id| task.card(id).is_some_and(|card| card.can_grasp)).collect();
    if movable.is_empty() || ids.len() < 2 {
        return Err("there is nothing else to ask for".into());
    }
    for _ in 0..REQUESTS {
        let subject = movable[rng.random_range(0..movable.len())];
        let reference = ids[rng.random_range(0..ids.len())];
        let (relation, words) = ASKED[rng.random_range(0..ASKED.len())];
        // The new request moves another object, so that a policy that ignores the instruction does not succeed by
        // chance.
        if subject == reference || known.alternatives.iter().flatten().any(|atom| atom.subject() == subject) {
            continue;
        }
        if relation == Relation::In && !task.card(subject).zip(task.card(reference)).is_some_and(fits) {
            continue;
        }
        let mut other = task.clone();
        let name = |id: &InstanceId| task.name_of(id).to_lowercase();
        other.kind = TaskKind::PickAndPlace;
        other.instruction = format!("Put the {} {words} the {}.", name(subject), name(reference));
        let (subject, reference) = (subject.clone(), reference.clone().into());
        other.goal =
            Goal { alternatives: vec![vec![Atom::Relation { subject, relation, reference, second_reference: None }]] };
        other.interchangeable = Vec::new();
        let is_done = judge_goal(&scene, &other.goal, &Rest::default(), &scenario.world.relations).success;
        if is_done || references::check(&other).is_err() {
            continue;
        }
        let before = Request { instruction: task.instruction.clone(), goal: known.clone() };
        scenario.task = other;
        scenario.other_request = Some(before);
        return Ok(());
    }
    Err("the reader understands nothing else that could be asked for".into())
}
