//! Relations judged on point clouds from rendered depth and ids (profile `seed`), compared with the same relations
//! judged on posed meshes.

use genmanip_workspace::worlds;
use std::collections::BTreeMap;
use std::sync::Arc;

use genmanip_assets::{Catalogue, GraspLibrary};
use genmanip_core::{
    Atom, AtomVerdict, Camera, InstanceId, Pose, Relation, RgbdImage, RobotModel, Scenario, Seed, Task, World,
};
use genmanip_layout::{GoalOrder, GoalPoseSettings, GoalSearch, LayoutSettings, lay_out, moves, posed};
use genmanip_motion::PlannerSettings;
use genmanip_relations::observed::clouds_of_views;
use genmanip_relations::{CloudScene, PosedScene, Rest, ShapeCache, is_clear, judge_atom, judge_goal};
use genmanip_render::{Channels, FIRST_OBJECT, FrameBuffers, RenderAssets, RenderVariation, Renderer, ViewJob};
use serde::Serialize;

use crate::LabError;
use crate::clock::cpu_clock;
use genmanip_workspace::Progress;
use genmanip_workspace::text_table;

/// Minimum distance of every measured quantity of a condition from its threshold, m; conditions closer to a threshold
/// are excluded.
const MARGIN_M: f64 = 0.01;

/// Maximum number of disagreements in the text summary; the JSON has all.
const SHOWN: usize = 20;

/// Agreement of the two judgements on conditions of one kind.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct Tally {
    /// Number of conditions compared.
    pub compared: usize,
    /// Number of compared conditions with the same verdict.
    pub agreed: usize,
    /// Number of compared conditions that hold on posed meshes.
    pub hold: usize,
    /// Number of conditions excluded for being too close to a threshold.
    pub excluded: usize,
}

/// Agreement on all conditions of all scenes.
#[derive(Debug, Default, Serialize)]
pub struct Agreement {
    /// Number of scenes judged; each task gives up to two, before and after its moves.
    pub scenes: usize,
    /// Number of tasks without a layout.
    pub refused: usize,
    /// Number of conditions compared.
    pub compared: usize,
    /// Number of compared conditions with the same verdict.
    pub agreed: usize,
    /// Number of conditions excluded for being too close to a threshold.
    pub excluded: usize,
    /// Share of compared conditions with the same verdict, 0 to 1.
    pub agreed_share: f64,
    /// Agreement by relation, and for `label` and `goal`.
    pub by_relation: BTreeMap<String, Tally>,
    /// Number of objects that no camera sees sufficiently for a cloud.
    pub unseen_objects: usize,
    /// CPU time of rendering and judging a scene, ms.
    pub cpu_ms_per_scene: f64,
    /// Compared conditions with different verdicts, with the explanations of both.
    pub disagreements: Vec<String>,
}

/// Settings and resources for rendering and judging.
struct Bench {
    robot: Arc<RobotModel>,
    cameras: Vec<Camera>,
    world: Arc<World>,
    shapes: ShapeCache,
}

/// Makes `count` layouts, of the tasks in turn; renders each before and after the goal's moves, and judges the point
/// clouds of three cameras.
///
/// # Errors
/// If a scene cannot be rendered.
pub fn measure(
    tasks: &[Task],
    world: &Arc<World>,
    count: usize,
    seed: Seed,
    progress: &dyn Progress,
) -> Result<Agreement, LabError> {
    let planner = worlds::planner(world, &PlannerSettings::default())?;
    let mut bench = Bench {
        robot: Arc::clone(planner.robot()),
        cameras: world.prompt_cameras().into_iter().cloned().collect(),
        world: Arc::clone(world),
        shapes: ShapeCache::default(),
    };
    let seed = seed.fork("rendered relations");
    let mut agreement = Agreement::default();
    let mut clock = cpu_clock();
    let mut judging_s = 0.0;
    progress.begin("judging", count);
    for (index, task) in (0..count).zip(tasks.iter().cycle()) {
        progress.advance();
        let seed = seed.fork_index(index as u64);
        let (catalogue, grasps) = (Catalogue::builtin(), GraspLibrary::builtin());
        let scenario = match lay_out(task, catalogue, world, &planner, grasps, seed, &LayoutSettings::default()) {
            Ok(scenario) => scenario,
            Err(error) if error.is_defect() => {
                return Err(LabError::broken(format!("laying out {} stopped", task.id), error));
            }
            Err(_) => {
                agreement.refused += 1;
                continue;
            }
        };
        let initial = bench.posed(&scenario)?;
        let reached = after_moves(&initial, task, &bench.world, seed);
        for (scene, moment) in std::iter::once((&initial, "before")).chain(reached.iter().map(|scene| (scene, "after")))
        {
            let start = clock();
            bench.compare(scene, task, &format!("{index} {} {moment}", task.id), seed, &mut agreement)?;
            judging_s += clock() - start;
        }
    }
    progress.end();
    agreement.agreed_share = agreement.agreed as f64 / agreement.compared.max(1) as f64;
    agreement.cpu_ms_per_scene = judging_s * 1e3 / agreement.scenes.max(1) as f64;
    Ok(agreement)
}

impl Bench {
    fn posed(&mut self, scenario: &Scenario) -> Result<PosedScene, LabError> {
        posed(scenario, Catalogue::builtin(), &mut self.shapes)
            .map_err(|error| LabError::broken(format!("cannot build the objects of {}", scenario.id), error))
    }

    /// Renders a scene with the robot at home and makes a point cloud of each object.
    fn clouds(&self, scene: &PosedScene) -> Result<CloudScene, LabError> {
        let drawn = |error| LabError::broken("cannot render the scene", error);
        let models: Vec<_> = scene.objects().map(|object| Arc::clone(&object.model)).collect();
        let assets = RenderAssets::new(Arc::clone(&self.robot), &models, Some(&self.world)).map_err(drawn)?;
        let poses = scene.objects().map(|object| (object.pose, object.joint_positions.as_slice()));
        let state = assets.frame_state(&self.robot.home, self.robot.gripper.max_width, poses).map_err(drawn)?;
        let jobs: Vec<ViewJob> =
            self.cameras.iter().map(|camera| ViewJob::new(&state, camera, Channels::GEOMETRY)).collect();
        let mut pictures = vec![FrameBuffers::default(); jobs.len()];
        Renderer::new(assets, RenderVariation::default()).render(&jobs, &mut pictures).map_err(drawn)?;
        let views: Vec<RgbdImage> = self
            .cameras
            .iter()
            .zip(pictures)
            .map(|(camera, picture)| picture.into_image(camera, camera.world_from_camera(&Pose::IDENTITY)))
            .collect();
        let instances: Vec<u16> = (0..models.len()).map(|index| FIRST_OBJECT + index as u16).collect();
        let clouds = scene.objects().zip(clouds_of_views(&views, &instances));
        Ok(CloudScene::new(clouds.filter_map(|(object, cloud)| Some((object.id.clone().into(), cloud?)))))
    }

    /// Compares every pair of objects with every relation and label, one *between* triple per object, and the goal.
    fn compare(
        &self,
        scene: &PosedScene,
        task: &Task,
        place: &str,
        seed: Seed,
        agreement: &mut Agreement,
    ) -> Result<(), LabError> {
        let clouds = self.clouds(scene)?;
        let ids: Vec<&InstanceId> = scene.objects().map(|object| &object.id).collect();
        agreement.scenes += 1;
        agreement.unseen_objects += ids.iter().filter(|id| clouds.index_of(id).is_none()).count();
        for atom in atoms(&ids, seed) {
            let Atom::Relation { relation, .. } = &atom else { continue };
            let kind = relation.name().to_owned();
            let told = |verdict: &AtomVerdict| verdict.explanation.clone();
            let (exact, seen) =
                (judge_atom(scene, &atom, &self.world.relations), clouds.judge_atom(&atom, &self.world.relations));
            let clear = is_clear(&exact, MARGIN_M);
            agreement.note(&kind, clear, exact.holds, exact.holds == seen.holds, || {
                format!("{place}: {atom:?}: geometry {}; cloud {}", told(&exact), told(&seen))
            });
        }
        for one in 0..ids.len() {
            for other in (0..ids.len()).filter(|&other| other != one) {
                let exact = genmanip_relations::label_pair(scene, one, other, &self.world.relations);
                let (Some(exact), Some(a), Some(b)) = (exact, clouds.index_of(ids[one]), clouds.index_of(ids[other]))
                else {
                    continue;
                };
                let seen = clouds.label_pair(a, b, &self.world.relations).and_then(|pair| pair.a_to_b);
                let words = Relation::OF_PAIRS
                    .map(|word| judge_atom(scene, &relation(ids[one], word, ids[other]), &self.world.relations));
                let clear = words.iter().all(|verdict| is_clear(verdict, MARGIN_M));
                agreement.note("label", clear, exact.a_to_b.is_some(), exact.a_to_b == seen, || {
                    format!("{place}: {} to {}: geometry {:?}; cloud {seen:?}", ids[one], ids[other], exact.a_to_b)
                });
            }
        }
        let exact = judge_goal(scene, &task.goal, &Rest::default(), &self.world.relations);
        let seen = clouds.judge_goal(&task.goal, &Rest::default(), &self.world.relations);
        let clear = exact.alternatives.iter().flatten().all(|verdict| is_clear(verdict, MARGIN_M));
        agreement.note(
            "goal",
            clear,
            exact.success,
            (exact.success, exact.score) == (seen.success, seen.score),
            || format!("{place}: goal: geometry {}; cloud {}", exact.score, seen.score),
        );
        Ok(())
    }
}

impl Agreement {
    fn note(&mut self, kind: &str, clear: bool, holds: bool, agrees: bool, told: impl FnOnce() -> String) {
        let tally = self.by_relation.entry(kind.to_owned()).or_default();
        if !clear {
            tally.excluded += 1;
            self.excluded += 1;
            return;
        }
        tally.compared += 1;
        tally.agreed += usize::from(agrees);
        tally.hold += usize::from(holds);
        self.compared += 1;
        self.agreed += usize::from(agrees);
        if !agrees {
            self.disagreements.push(format!("{kind}: {}", told()));
        }
    }
}

/// The scene after the moves of the goal's first alternative, each object at its best goal pose; `None` if there are no
/// moves or no free poses.
fn after_moves(scene: &PosedScene, task: &Task, world: &World, seed: Seed) -> Option<PosedScene> {
    let mut after = scene.clone();
    let steps = moves(&task.goal, scene).into_iter().next()?;
    let upright: Vec<_> = scene.objects().map(|object| object.pose.rotation).collect();
    let (workspace, relations) = (&world.workspace, &world.relations);
    let settings = &GoalPoseSettings { count: 1, ..GoalPoseSettings::default() };
    for (index, step) in steps.iter().enumerate() {
        let object = after.objects().nth(step.object)?.clone();
        let order = GoalOrder::Margin;
        let search = GoalSearch { scene: &after, upright: &upright, workspace, relations, settings, order };
        let seed = seed.fork("goal").fork_index(index as u64);
        let places = search.goal_poses(step, &steps[index + 1..], &|_| true, seed);
        after.set_pose(step.object, places.first()?.world_from_object, &object.joint_positions);
    }
    Some(after)
}

fn relation(subject: &InstanceId, relation: Relation, reference: &InstanceId) -> Atom {
    Atom::Relation { subject: subject.clone(), relation, reference: reference.clone().into(), second_reference: None }
}

/// Conditions to compare: every ordered pair with every relation of pairs, and for every object *between* with one
/// random pair of others.
fn atoms(ids: &[&InstanceId], seed: Seed) -> Vec<Atom> {
    let mut atoms = Vec::new();
    for (index, subject) in ids.iter().enumerate() {
        let others: Vec<&InstanceId> = ids.iter().copied().filter(|other| other != subject).collect();
        atoms.extend(others.iter().flat_map(|other| Relation::OF_PAIRS.map(|word| relation(subject, word, other))));
        if others.len() >= 2 {
            let draw = (seed.fork("between").fork_index(index as u64).value() % others.len() as u64) as usize;
            atoms.push(Atom::Relation {
                subject: (*subject).clone(),
                relation: Relation::Between,
                reference: others[draw].clone().into(),
                second_reference: Some(others[(draw + 1) % others.len()].clone().into()),
            });
        }
    }
    atoms
}

/// Text summary.
pub fn describe(agreement: &Agreement) -> String {
    let mut lines = vec![["kind", "agree", "compared", "of them true", "excluded"].map(String::from).to_vec()];
    for (kind, tally) in &agreement.by_relation {
        let numbers = [tally.agreed, tally.compared, tally.hold, tally.excluded].map(|number| number.to_string());
        lines.push(std::iter::once(kind.clone()).chain(numbers).collect());
    }
    let mut text = format!(
        "{}\n{} of {} agree ({:.2} %) in {} scenes; {:.1} ms a scene; {} objects unseen\n",
        text_table(&lines).trim_end(),
        agreement.agreed,
        agreement.compared,
        100.0 * agreement.agreed_share,
        agreement.scenes,
        agreement.cpu_ms_per_scene,
        agreement.unseen_objects,
    );
    for disagreement in agreement.disagreements.iter().take(SHOWN) {
        text += &format!("  {disagreement}\n");
    }
    text
}
