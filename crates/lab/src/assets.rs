//! Tests of generated or imported objects: stability, grasps, containers, named states.

use genmanip_workspace::worlds;
use std::collections::BTreeSet;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Instant;

use genmanip_assets::search::{Filter, Index};
use genmanip_assets::stable_poses::stable_poses;
use genmanip_assets::worlds::default_world;
use genmanip_assets::{AssetSource, Catalogue, Families, Family};
use genmanip_core::glam::DVec3;
use genmanip_core::{
    Annotations, AssetRef, AssetUid, MassProperties, ObjectCard, ObjectLink, ObjectModel, PhysicsFactors, Piece, Pose,
    Seed, Shape, World,
};
use genmanip_import::packs::{Packs, at_rest};
use genmanip_motion::PlannerSettings;
use genmanip_rollout::collect::in_parallel;
use genmanip_rollout::grasp_trial::{GraspTrials, RobustnessSettings, ViewSettings, robust_grasps};
use genmanip_sim::{Model, SceneObject, Sim, SimError};
use genmanip_workspace::Progress;
use serde::Serialize;

use crate::LabError;
use crate::clock::cpu_clock;

/// Position of the tested object, m, world frame.
const PLACE: DVec3 = DVec3::new(0.5, 0.0, 0.0);
/// Initial height above the support surface, m.
const DROP_M: f64 = 0.0005;
/// Time that a state must last, simulated s.
const WATCH_S: f64 = 2.0;
/// Rate of physics steps, Hz.
const STEPS_HZ: f64 = 480.0;
/// Maximum displacement of an object at rest within [`WATCH_S`], mm.
const MAX_DRIFT_MM: f64 = 0.1;
/// Maximum penetration of an object at rest, mm.
const MAX_PENETRATION_MM: f64 = 1.0;
/// Grasps tried before an object counts as not held.
const GRASPS: usize = 8;
/// Number of balls per container, dropped one at a time; their diameter as a share of the smallest width of the
/// opening; and clearance between a ball and the rim at the start, m.
const BALLS: u64 = 3;
const BALL_SHARE: f64 = 1.0 / 3.0;
const BALL_DROP_M: f64 = 0.01;
/// Minimum depth of a tested container, as a share of the smallest width of its opening: half the diameter of a ball.
/// Plates and trays are shallower and hold no balls.
const MIN_DEPTH: f64 = BALL_SHARE / 2.0;
/// Objects in the search benchmark, and results requested.
const SEARCHED: usize = 10_000;
const SHOWN: usize = 20;
/// Objects of the timed scene, physics steps per timing, and number of timings, of which the median is reported.
const SCENE_OBJECTS: usize = 12;
const SCENE_STEPS: u32 = 2000;
const TIMINGS: usize = 5;

/// Test results over all objects.
#[derive(Clone, Debug, Serialize)]
pub struct Measured {
    /// Number of objects generated or read.
    pub objects: usize,
    /// Number of objects that could not be made or simulated, or that did not rest in one of their stable poses.
    pub failed: usize,
    /// CPU time of generating them with their textures, s.
    pub build_cpu_s: f64,
    /// Number of distinct descriptions among the objects' cards.
    pub distinct_descriptions: usize,
    /// Largest displacement within 2 s after coming to rest, over all stable poses, mm.
    pub drift_mm_max: f64,
    /// Deepest penetration in the stable poses after coming to rest, mm.
    pub penetration_mm_max: f64,
    /// Number of graspable rigid objects.
    pub can_grasp: usize,
    /// Graspable objects that a grasp held in all three trials of lifting and shaking, with mass and friction varied by
    /// up to 20 %.
    pub grasp_verified: usize,
    /// Open containers with sufficient depth.
    pub containers: usize,
    /// Containers in which each of three balls was still below the rim 2 s after its drop.
    pub container_ok: usize,
    /// Named states of articulated objects.
    pub states: usize,
    /// Named states that lasted 2 s and that the joint positions distinguish from all other states.
    pub states_ok: usize,
    /// CPU time of compiling a scene of twelve objects of different families with the robot, ms.
    pub compile_ms: f64,
    /// Physics steps of that scene per second of CPU time, all objects awake.
    pub awake_steps_per_s: f64,
    /// Physics steps of the same scene per second of CPU time with MuJoCo's own `mj_step`.
    pub mujoco_steps_per_s: f64,
    /// CPU time of the slowest query among 10,000 objects, median of five runs of each query, ms.
    pub search_ms: f64,
    /// Wall time of `genmanip assets search` in the full catalogue, including the start of the program, best of five,
    /// ms.
    pub start_ms: f64,
    /// Problems of single objects.
    pub problems: Vec<Problem>,
}

/// A problem of one object.
#[derive(Clone, Debug, Serialize)]
pub struct Problem {
    /// Uid of the object; that of a generated one contains family and seed.
    pub uid: AssetUid,
    /// Description of the problem, for people.
    pub what: String,
}

/// Test results of one object.
#[derive(Clone, Debug, Default)]
struct Tried {
    failed: bool,
    drift_mm: f64,
    penetration_mm: f64,
    grasp: Option<bool>,
    container: Option<bool>,
    states: usize,
    states_ok: usize,
    problems: Vec<String>,
}

/// Source of the objects to test.
pub enum Objects<'a> {
    /// New objects of all families in turn, or of one family.
    New {
        /// Families to choose from.
        families: &'a Families,
        /// The only family to use.
        chosen: Option<&'a str>,
        /// Number of objects to generate.
        count: usize,
    },
    /// Objects of the packs in a folder.
    Imported(&'a Path),
}

/// Generates or reads objects, and tests each.
///
/// # Errors
/// If the chosen family is unknown, packs cannot be read or the robot does not exist; problems of an object are
/// results.
pub fn measure(
    objects: &Objects<'_>,
    seed: Seed,
    workers: usize,
    progress: &dyn Progress,
) -> Result<Measured, LabError> {
    let mut problems = Vec::new();
    let mut clock = cpu_clock();
    let models = match objects {
        Objects::New { families, chosen, count } => made(families, *chosen, *count, seed, &mut problems, progress)?,
        Objects::Imported(folder) => imported(folder, &mut problems)?,
    };
    let build_cpu_s = clock();
    let descriptions: BTreeSet<&str> = models.iter().map(|model| model.card.description.as_str()).collect();
    let world = default_world();
    let trials = GraspTrials {
        detector: None,
        catalogue: Catalogue::builtin(),
        planner: worlds::planner(&world, &PlannerSettings::default())?,
        robot: worlds::robot(&world)?,
        world: Arc::clone(&world),
        view: ViewSettings::default(),
    };
    progress.begin("trying", models.len());
    let tried = in_parallel(&models, workers, &AtomicBool::new(false), &|model: &Arc<ObjectModel>| {
        let tried = try_object(model, &trials, seed.fork(model.card.uid.as_str()));
        progress.advance();
        Ok::<_, LabError>(tried)
    })?;
    progress.end();
    let unmade = problems.len();
    for (model, one) in models.iter().zip(&tried) {
        let named = |what: &String| Problem { uid: model.card.uid.clone(), what: what.clone() };
        problems.extend(one.problems.iter().map(named));
    }
    let timing = time_scene(&models, &trials, &world)?;
    let most = |of: &dyn Fn(&Tried) -> f64| tried.iter().map(of).fold(0.0, f64::max);
    let with = |of: &dyn Fn(&Tried) -> bool| tried.iter().filter(|one| of(one)).count();
    Ok(Measured {
        objects: models.len(),
        failed: unmade + with(&|one| one.failed),
        build_cpu_s,
        distinct_descriptions: descriptions.len(),
        drift_mm_max: most(&|one| one.drift_mm),
        penetration_mm_max: most(&|one| one.penetration_mm),
        can_grasp: with(&|one| one.grasp.is_some()),
        grasp_verified: with(&|one| one.grasp == Some(true)),
        containers: with(&|one| one.container.is_some()),
        container_ok: with(&|one| one.container == Some(true)),
        states: tried.iter().map(|one| one.states).sum(),
        states_ok: tried.iter().map(|one| one.states_ok).sum(),
        compile_ms: timing.compile_ms,
        awake_steps_per_s: timing.awake_steps_per_s,
        mujoco_steps_per_s: timing.mujoco_steps_per_s,
        search_ms: search_ms(),
        start_ms: start_ms(),
        problems,
    })
}

/// `count` new objects, each with its own random stream, from the chosen family or from all families in turn.
fn made(
    families: &Families,
    chosen: Option<&str>,
    count: usize,
    seed: Seed,
    problems: &mut Vec<Problem>,
    progress: &dyn Progress,
) -> Result<Vec<Arc<ObjectModel>>, LabError> {
    let wanted: Vec<&Family> =
        families.all().filter(|family| chosen.is_none_or(|name| family.family == name)).collect();
    if wanted.is_empty() {
        return Err(LabError::input(format!("there is no family `{}`", chosen.unwrap_or_default())));
    }
    let mut models = Vec::new();
    progress.begin("making", count);
    for index in 0..count {
        let family = wanted[index % wanted.len()];
        let seed = seed.fork("assets").fork_index(index as u64);
        match families.instance(&family.family, &Default::default(), seed) {
            Ok(model) => models.push(Arc::new(model)),
            Err(error) => {
                problems.push(Problem {
                    uid: format!("{}-{}", family.family, seed.value()).into(),
                    what: error.to_string(),
                });
            }
        }
        progress.advance();
    }
    progress.end();
    Ok(models)
}

/// All objects of the packs in a folder.
fn imported(folder: &Path, problems: &mut Vec<Problem>) -> Result<Vec<Arc<ObjectModel>>, LabError> {
    let packs = Packs::read(folder)?;
    let mut models = Vec::new();
    for card in packs.cards() {
        match packs.model(&card.asset) {
            Ok(model) => models.push(model),
            Err(error) => problems.push(Problem { uid: card.uid.clone(), what: error.to_string() }),
        }
    }
    if models.is_empty() {
        return Err(LabError::input(format!("no pack in {} holds an object that can be read", folder.display())));
    }
    Ok(models)
}

fn try_object(model: &Arc<ObjectModel>, trials: &GraspTrials, seed: Seed) -> Tried {
    let world = &*trials.world;
    let mut tried = Tried::default();
    for pose in stable_poses(model) {
        let joints = model.joint_states.first().map_or_else(Vec::new, |state| state.nominal.clone());
        match at_rest(model, &pose.world_from_object, &joints, world) {
            Ok(at_rest) => {
                tried.drift_mm = tried.drift_mm.max(at_rest.drift_mm);
                tried.penetration_mm = tried.penetration_mm.max(at_rest.penetration_mm);
                if !at_rest.settled {
                    tried.problems.push(format!("does not come to rest {}", pose.name));
                }
                if at_rest.tilt_rad > 0.2 {
                    tried.problems.push(format!("falls over {}: turned by {:.2} rad", pose.name, at_rest.tilt_rad));
                }
                if at_rest.drift_mm > MAX_DRIFT_MM {
                    tried.problems.push(format!("drifts {:.3} mm {}", at_rest.drift_mm, pose.name));
                }
                if at_rest.penetration_mm > MAX_PENETRATION_MM {
                    tried
                        .problems
                        .push(format!("penetrates the table by {:.2} mm {}", at_rest.penetration_mm, pose.name));
                }
                tried.failed |= !at_rest.settled || at_rest.tilt_rad > 0.2;
            }
            Err(error) => {
                tried.failed = true;
                tried.problems.push(format!("the simulator refuses it {}: {error}", pose.name));
                return tried;
            }
        }
    }
    if model.card.can_grasp && !model.card.is_articulated {
        let found = robust_grasps(trials, model, &RobustnessSettings::fast(), 1, GRASPS, seed.fork("grasp"));
        tried.grasp = Some(found.as_ref().is_ok_and(|found| !found.is_empty()));
        match found {
            Ok(found) if found.is_empty() => tried.problems.push("no grasp held in every trial".into()),
            Ok(_) => {}
            Err(error) => tried.problems.push(format!("grasps cannot be tried: {error}")),
        }
    }
    if let Some(opening) = opening(&model.card.annotations) {
        let stayed = (0..BALLS).map(|ball| stays(model, opening, world, seed.fork("ball").fork_index(ball)));
        let stayed: Result<Vec<bool>, SimError> = stayed.collect();
        let all = stayed.is_ok_and(|stayed| stayed.iter().all(|stays| *stays));
        tried.container = Some(all);
        if !all {
            tried.problems.push("a ball of a third of the opening's width does not stay inside".into());
        }
    }
    for state in &model.joint_states {
        tried.states += 1;
        match state_holds(model, &state.name, &state.nominal, world) {
            Ok(None) => tried.states_ok += 1,
            Ok(Some(what)) => tried.problems.push(what),
            Err(error) => tried.problems.push(format!("state {}: {error}", state.name)),
        }
    }
    tried
}

fn placed(name: &str, model: &Arc<ObjectModel>, pose: Pose, joints: &[f64]) -> SceneObject {
    let joint_positions = if joints.is_empty() { vec![0.0; model.joint_count()] } else { joints.to_vec() };
    let physics = PhysicsFactors::default();
    SceneObject { name: name.to_owned(), model: Arc::clone(model), pose, joint_positions, physics }
}

/// Smallest width of the opening of a container with sufficient depth, m; `None` for other objects.
fn opening(annotations: &Annotations) -> Option<f64> {
    let room = annotations.room?;
    let opening = room.inside_m[0].min(room.inside_m[1]);
    (room.depth_m >= MIN_DEPTH * opening).then_some(opening)
}

/// True if a ball dropped near the centre of the opening is within the walls and below the rim 2 s later.
fn stays(model: &Arc<ObjectModel>, opening: f64, world: &World, seed: Seed) -> Result<bool, SimError> {
    use rand::RngExt;
    let radius = opening * BALL_SHARE / 2.0;
    let cavities = model.cavities(&[]);
    let bounds = genmanip_core::Aabb::from_pieces(&Pose::IDENTITY, &cavities);
    let mut rng = seed.rng();
    let mut off = || (rng.random::<f64>() - 0.5) * opening / 3.0;
    let above = bounds.center().with_z(bounds.max.z + radius + BALL_DROP_M) + DVec3::new(off(), off(), 0.0);
    let ball = Arc::new(ball(radius));
    let objects = [
        placed("0", model, Pose::from_position(PLACE + DVec3::Z * DROP_M), &[]),
        placed("1", &ball, Pose::from_position(PLACE + above), &[]),
    ];
    let mut sim = Sim::new(Arc::new(Model::compile_without_robot(world, &objects)?));
    sim.advance((2.0 * STEPS_HZ) as u32)?;
    let states = sim.object_states();
    let inside = states[0].pose.inverse().transform_point(states[1].pose.position);
    let (low, high) = (bounds.min, bounds.max);
    Ok(inside.x > low.x && inside.x < high.x && inside.y > low.y && inside.y < high.y && inside.z - radius < high.z)
}

/// A wooden ball, centred on its origin.
fn ball(radius: f64) -> ObjectModel {
    let mass_kg = 700.0 * 4.0 / 3.0 * std::f64::consts::PI * radius.powi(3);
    let inertia = genmanip_core::glam::DMat3::from_diagonal(DVec3::splat(0.4 * mass_kg * radius * radius));
    ObjectModel {
        card: ObjectCard {
            uid: "ball".into(),
            asset: AssetRef::Imported { hash: "ball".into() },
            name: "Ball".into(),
            description: "A ball.".into(),
            category: "ball".into(),
            general_category: "toys".into(),
            colors: Vec::new(),
            materials: Vec::new(),
            shape: "sphere".into(),
            size_m: DVec3::splat(2.0 * radius),
            mass_kg,
            is_container: false,
            is_articulated: false,
            states: Vec::new(),
            can_grasp: true,
            annotations: Annotations::default(),
        },
        family: "ball".into(),
        asset: AssetRef::Imported { hash: "ball".into() },
        links: vec![ObjectLink {
            name: "body".into(),
            joint: None,
            visual: Vec::new(),
            pieces: vec![Piece::at(DVec3::ZERO, Shape::Sphere { radius })],
            cavity: Vec::new(),
            mass: MassProperties { mass_kg, center: DVec3::ZERO, inertia },
        }],
        friction: 0.5,
        joint_states: Vec::new(),
    }
}

/// Problem of a state, if any: it must last, and no other state's intervals may contain its joint positions.
fn state_holds(
    model: &Arc<ObjectModel>,
    name: &str,
    nominal: &[f64],
    world: &World,
) -> Result<Option<String>, SimError> {
    let start = Pose::from_position(PLACE + DVec3::Z * DROP_M);
    let mut sim = Sim::new(Arc::new(Model::compile_without_robot(world, &[placed("0", model, start, nominal)])?));
    sim.advance((WATCH_S * STEPS_HZ) as u32)?;
    let joints = sim.object_states()[0].joint_positions.clone();
    let names: Vec<&String> = model.links.iter().filter_map(|link| Some(&link.joint.as_ref()?.name)).collect();
    let holding: Vec<&str> = model
        .joint_states
        .iter()
        .filter(|state| {
            state.intervals.iter().all(|(joint, [low, high])| {
                let index = names.iter().position(|known| *known == joint);
                index.is_some_and(|index| (*low..=*high).contains(&joints[index]))
            })
        })
        .map(|state| state.name.as_str())
        .collect();
    let wrong =
        || format!("put into state {name}, its joints are at {joints:.3?} 2 s later, which is state {holding:?}");
    Ok((holding != [name]).then(wrong))
}

struct Timing {
    compile_ms: f64,
    awake_steps_per_s: f64,
    mujoco_steps_per_s: f64,
}

/// Times a scene with the robot and, in rows on the table, the first small object of each of up to twelve families.
fn time_scene(models: &[Arc<ObjectModel>], trials: &GraspTrials, world: &World) -> Result<Timing, LabError> {
    let mut families = BTreeSet::new();
    let small = |model: &&Arc<ObjectModel>| model.card.size_m.x.max(model.card.size_m.y) < 0.2;
    let first = models.iter().filter(small).filter(|model| families.insert(model.family.clone()));
    let objects: Vec<SceneObject> = first
        .take(SCENE_OBJECTS)
        .enumerate()
        .map(|(index, model)| {
            let place = DVec3::new(0.3 + 0.21 * (index % 3) as f64, -0.4 + 0.26 * (index / 3) as f64, DROP_M);
            placed(&index.to_string(), model, Pose::from_position(place), &[])
        })
        .collect();
    let broken = |error: SimError| LabError::broken("the timed scene failed", error);
    let median = |mut values: Vec<f64>| {
        values.sort_by(f64::total_cmp);
        values[values.len() / 2]
    };
    let mut clock = cpu_clock();
    let mut timed = |work: &mut dyn FnMut() -> Result<(), SimError>| -> Result<f64, SimError> {
        let start = clock();
        work()?;
        Ok(clock() - start)
    };
    let (mut compile, mut awake, mut bare) = (Vec::new(), Vec::new(), Vec::new());
    for _ in 0..TIMINGS {
        let mut scene = None;
        compile.push(
            timed(&mut || {
                scene = Some(Arc::new(Model::compile(world, &trials.robot, &objects)?));
                Ok(())
            })
            .map_err(broken)?,
        );
        let Some(scene) = scene else { continue };
        let mut sim = Sim::new(Arc::clone(&scene));
        sim.advance(STEPS_HZ as u32).map_err(broken)?;
        let state = sim.state();
        awake.push(timed(&mut || sim.advance(SCENE_STEPS)).map_err(broken)?);
        sim.set_state(&state).map_err(broken)?;
        bare.push(
            timed(&mut || {
                sim.advance_bare(SCENE_STEPS);
                Ok(())
            })
            .map_err(broken)?,
        );
    }
    Ok(Timing {
        compile_ms: median(compile) * 1e3,
        awake_steps_per_s: f64::from(SCENE_STEPS) / median(awake),
        mujoco_steps_per_s: f64::from(SCENE_STEPS) / median(bare),
    })
}

/// CPU time of the slowest query, ms. The queries are, for each category of the catalogue, its name, its name with a
/// colour, and its name with this colour negated.
fn search_ms() -> f64 {
    let cards = Catalogue::full().cards();
    let copies = (0..SEARCHED).map(|copy| {
        let card = &cards[copy % cards.len()];
        (ObjectCard { uid: format!("{}-{copy}", card.uid).into(), ..card.clone() }, Default::default())
    });
    let index = Index::new(copies);
    let mut asked = BTreeSet::new();
    let mut clock = cpu_clock();
    let mut slowest = 0.0_f64;
    for card in cards.iter().filter(|card| asked.insert(&card.category)) {
        let color = card.colors.first().map_or("red", String::as_str);
        for query in
            [card.category.clone(), format!("{color} {}", card.category), format!("{} not {color}", card.category)]
        {
            let mut times = [0.0; TIMINGS];
            for time in &mut times {
                let start = clock();
                std::hint::black_box(index.search(&query, &Filter::default(), SHOWN));
                *time = clock() - start;
            }
            times.sort_by(f64::total_cmp);
            slowest = slowest.max(times[TIMINGS / 2] * 1e3);
        }
    }
    slowest
}

/// Wall time of `genmanip assets search` in the full catalogue, best of five, ms; 0 if the program cannot be started.
fn start_ms() -> f64 {
    let Ok(program) = crate::program() else { return 0.0 };
    let runs = (0..5).filter_map(|_| {
        let start = Instant::now();
        let arguments = ["assets", "search", "mug", "--limit", "1", "--catalog", "full", "--quiet"];
        let output = std::process::Command::new(&program).args(arguments).output().ok()?;
        output.status.success().then(|| start.elapsed().as_secs_f64() * 1e3)
    });
    let best = runs.fold(f64::INFINITY, f64::min);
    if best.is_finite() { best } else { 0.0 }
}

/// Text summary.
pub fn describe(measured: &Measured) -> String {
    let Measured { objects, failed, build_cpu_s, distinct_descriptions, drift_mm_max, penetration_mm_max, .. } =
        measured;
    let share = |part: usize, of: usize| format!("{part} of {of} ({:.1} %)", 100.0 * part as f64 / of.max(1) as f64);
    let mut text = format!(
        "objects       {objects}, {failed} failed, made in {build_cpu_s:.1} s of CPU time\ndescriptions  {}\n\
         at rest       drift at most {drift_mm_max:.3} mm in 2 s, penetration {penetration_mm_max:.3} mm\n\
         grasps        {}\ncontainers    {}\nstates        {}\nscene of 12   compiled in {:.1} ms, {:.0} steps/s \
         (the engine's own step: {:.0})\nstart         {:.0} ms wall\n\
         search        {:.2} ms among 10,000\n",
        share(*distinct_descriptions, *objects),
        share(measured.grasp_verified, measured.can_grasp),
        share(measured.container_ok, measured.containers),
        share(measured.states_ok, measured.states),
        measured.compile_ms,
        measured.awake_steps_per_s,
        measured.mujoco_steps_per_s,
        measured.start_ms,
        measured.search_ms,
    );
    for Problem { uid, what } in &measured.problems {
        text += &format!("  {uid}: {what}\n");
    }
    text
}
