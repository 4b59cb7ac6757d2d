//! Random edits by two authors: cost of verdicts, agreement with the audit, and edits lost by a kill of the process.

use std::fs;
use std::path::Path;
use std::sync::Arc;

use genmanip_core::glam::DVec3;
use genmanip_core::{Camera, Document, Pose, Scenario, Seed};
use genmanip_layout::audit;
use genmanip_rollout::{Environment, RolloutSettings};
use genmanip_studio::edit::{ChosenAsset, Command, EditError, EditLog, EditedScenario, Operation, Placement, Stamp};
use genmanip_studio::scene::exported;
use genmanip_studio::scene::images::{Drawn, Painters};
use genmanip_studio::verdict::{Equipment, Inspection, Problem, ProblemCode, Stage};
use genmanip_tasks::references;
use genmanip_workspace::Progress;
use genmanip_workspace::task_checks::check_task;
use rand::{Rng, RngExt};

use super::measured::Measured;
use crate::LabError;
use crate::clock::{cpu_clock, process_clock};
use crate::quantile::Spread;

/// Operations per scenario before the next one is edited.
const PER_SCENARIO: usize = 25;
/// Maximum number of revisions by which an author's base is behind.
const MAX_BEHIND: u64 = 3;
/// Duration of the audit's simulation, simulated s.
const AUDIT_S: f64 = 2.0;
/// Last stage of the quick verdict, which a page shows right after an edit.
const QUICK: Stage = Stage::Collision;
const AUTHORS: [&str; 2] = ["ada", "bo"];

/// Applies random operations to scenarios in turn, judges each result, and simulates a kill after each scenario.
pub(super) fn measure(
    scenarios: &[Arc<Scenario>],
    operations: usize,
    equipment: &Equipment,
    seed: Seed,
    progress: &dyn Progress,
    measured: &mut Measured,
) -> Result<(), LabError> {
    let (mut quick_ms, mut all_ms, mut preview_ms) = (Vec::new(), Vec::new(), Vec::new());
    let painters = Painters::default();
    let mut operation_s = [Vec::new(), Vec::new()];
    let mut stage_ms = Stage::ALL.map(|stage| (stage.name(), 0.0));
    progress.begin("editing", operations);
    for (number, scenario) in (0..operations.div_ceil(PER_SCENARIO)).zip(scenarios.iter().cycle()) {
        let rng = &mut seed.fork_index(number as u64).rng();
        let folder = std::env::temp_dir().join(format!("genmanip-lab-studio-{}-{number}", std::process::id()));
        let path = folder.join("scenario.json");
        genmanip_workspace::documents::write_file(&path, scenario.to_json().as_bytes())?;
        let mut document = EditedScenario::open(&path, equipment.assets).map_err(stopped)?;
        let count = PER_SCENARIO.min(operations - number * PER_SCENARIO);
        for step in 0..count {
            let mut whole = process_clock();
            measured.operations += 1;
            let stamp = stamp(AUTHORS[rng.random_range(0..2)], &format!("{number}-{step}"));
            let base_revision = document.revision().saturating_sub(rng.random_range(0..=MAX_BEHIND));
            let seen = document.at_revision(base_revision).map_err(stopped)?;
            let command = Command { operation: random(&seen, rng), base_revision, stamp };
            let mut clock = cpu_clock();
            let applied = match rng.random_range(0..8) {
                0 => document.undo(&command.stamp),
                1 => document.redo(&command.stamp),
                _ => document.apply(&command),
            };
            match applied {
                Ok(_) => measured.applied += 1,
                Err(EditError::Conflict(_)) => measured.conflicts += 1,
                Err(EditError::Invalid { .. } | EditError::Nothing { .. }) => {}
                Err(error) => return Err(stopped(error)),
            }
            let mut inspection = Inspection::new(Arc::clone(document.scenario()), equipment);
            let mut before = 0.0;
            for ((_, total), stage) in stage_ms.iter_mut().zip(Stage::ALL) {
                inspection.problems(stage).map_err(|error| LabError::broken("a stage cannot be judged", error))?;
                let now = clock() * 1e3;
                *total += now - before;
                before = now;
                if stage == QUICK {
                    quick_ms.push(now);
                }
            }
            all_ms.push(before);
            preview_ms.extend(preview(&painters, &format!("{number}"), document.scenario(), equipment)?);
            mismatches(&mut inspection, document.scenario(), equipment, measured)?;
            operation_s[usize::from(2 * measured.operations > operations)].push(whole());
            progress.advance();
        }
        check_files(document, &path, equipment, measured)?;
        let _ = fs::remove_dir_all(&folder);
    }
    progress.end();
    let count = measured.operations.max(1) as f64;
    measured.stage_ms = stage_ms.map(|(name, total)| (name, total / count)).to_vec();
    measured.operation_s = operation_s.map(|all| all.iter().sum::<f64>() / all.len().max(1) as f64);
    let quick_ms = Spread::of(quick_ms);
    (measured.verdict_ms_p50, measured.verdict_ms_p95) = (quick_ms.median, quick_ms.p95);
    measured.all_checks_ms_p95 = Spread::of(all_ms).p95;
    measured.preview_ms_p95 = (!preview_ms.is_empty()).then(|| Spread::of(preview_ms).p95);
    Ok(())
}

/// CPU time of the image of the first camera, all threads, ms; `None` for a scene without cameras.
fn preview(
    painters: &Painters,
    key: &str,
    scenario: &Scenario,
    equipment: &Equipment,
) -> Result<Option<f64>, LabError> {
    let Some(camera) = scenario.world.cameras.first() else { return Ok(None) };
    let mut clock = process_clock();
    let models = exported::models(scenario, equipment.assets)?;
    let scene = Drawn { key, scenario, models: &models, robot: equipment.planner.robot() };
    painters.draw(scene, &camera.name)?;
    Ok(Some(clock() * 1e3))
}

/// Compares the scenario in memory, on disk and reopened from its log; then truncates the last line of the log, as a
/// kill while it is written would, and counts lost edits.
fn check_files(
    document: EditedScenario,
    path: &Path,
    equipment: &Equipment,
    measured: &mut Measured,
) -> Result<(), LabError> {
    let revision = document.revision();
    let memory = document.scenario().to_json();
    let before = document.at_revision(revision.saturating_sub(1)).map_err(stopped)?.to_json();
    drop(document);
    let read = |path: &Path| fs::read(path).map_err(|error| LabError::file("read", path, error));
    let disk = read(path)?;
    let again = EditedScenario::open(path, equipment.assets).map_err(stopped)?;
    measured.equal_bytes &= disk == memory.as_bytes() && again.scenario().to_json() == memory;
    drop(again);
    if revision == 0 {
        return Ok(());
    }
    let log_path = EditLog::path_of(path);
    let log = read(&log_path)?;
    let last = log[..log.len() - 1].iter().rposition(|&byte| byte == b'\n').map_or(0, |end| end + 1);
    for length in [last, last + 1, (last + log.len()) / 2, log.len() - 1] {
        genmanip_workspace::documents::write_file(path, before.as_bytes())?;
        genmanip_workspace::documents::write_file(&log_path, &log[..length])?;
        let kept = EditedScenario::open(path, equipment.assets).map_or(0, |document| document.revision());
        measured.lost += usize::try_from((revision - 1).saturating_sub(kept)).unwrap_or(usize::MAX);
    }
    genmanip_workspace::documents::write_file(path, &disk)?;
    genmanip_workspace::documents::write_file(&log_path, &log)?;
    Ok(())
}

/// Compares a verdict with the layout audit and with the independent judgement of an episode at its start.
fn mismatches(
    inspection: &mut Inspection,
    scenario: &Arc<Scenario>,
    equipment: &Equipment,
    measured: &mut Measured,
) -> Result<(), LabError> {
    let robot = equipment.planner.robot();
    let audited = audit(scenario, equipment.assets, robot, &equipment.settings, AUDIT_S);
    let audited = match audited {
        Ok(audited) => audited,
        // A scene that cannot be simulated has no audit.
        Err(genmanip_layout::AuditError::Sim(_)) => return Ok(()),
        Err(error) => return Err(LabError::broken("the audit stopped", error)),
    };
    let verdict = inspection.verdict(0).map_err(|error| LabError::broken("a scenario cannot be judged", error))?;
    let count = |code: ProblemCode, stage: Stage| {
        verdict.problems.iter().filter(|problem| problem.code == code && problem.stage == stage).count()
    };
    let has = |code, stage| count(code, stage) > 0;
    let mismatch = references::check(&scenario.task).err();
    let is_misread = mismatch.is_some_and(|mismatch| !references::is_beyond_the_reader(&scenario.task, &mismatch));
    let sentence = [ProblemCode::AmbiguousSentence, ProblemCode::SentenceMismatch].into_iter();
    let said: Vec<&Problem> =
        verdict.problems.iter().filter(|problem| problem.blocking && problem.stage == Stage::Wording).collect();
    let is_said = said.iter().any(|problem| sentence.clone().any(|wanted| wanted == problem.code));
    let is_rejected = check_task(Path::new("task"), scenario.task.clone()).is_rejected();
    let false_ones = count(ProblemCode::EdgeFalse, Stage::Relations) + count(ProblemCode::StateFalse, Stage::Relations);
    let settings = &equipment.settings;
    let reached = is_reached(scenario, equipment)?;
    for (what, ours, theirs) in [
        ("edges and states", false_ones > 0, !audited.failed.is_empty()),
        ("number of false edges and states", false_ones == audited.failed.len(), true),
        ("goal", has(ProblemCode::GoalHolds, Stage::Relations), audited.goal_holds),
        ("overlap", has(ProblemCode::Overlap, Stage::Collision), audited.penetration_m > settings.max_penetration_m),
        ("visibility", has(ProblemCode::Hidden, Stage::Visibility), audited.hidden.is_some()),
        ("stability", has(ProblemCode::Unstable, Stage::Stability), audited.drift_m > settings.max_drift_m),
        ("sentence", is_said || !is_misread, true),
        ("task check", !said.is_empty(), is_rejected || is_misread),
        (
            "goal as an episode judges it",
            has(ProblemCode::GoalHolds, Stage::Relations),
            reached.unwrap_or(audited.goal_holds),
        ),
    ] {
        if ours != theirs {
            measured.verdict_mismatches += 1;
            let (drift_mm, depth_mm) = (audited.drift_m * 1e3, audited.penetration_m * 1e3);
            let numbers = format!("drift {drift_mm:.3} mm, overlap {depth_mm:.3} mm");
            measured
                .notes
                .push(format!("mismatch of {what} in {}: ours {ours}, audit {theirs} ({numbers})", scenario.id));
        }
    }
    Ok(())
}

/// True if an episode's judge finds the goal reached in the initial state; `None` if no episode can be opened.
fn is_reached(scenario: &Arc<Scenario>, equipment: &Equipment) -> Result<Option<bool>, LabError> {
    let Ok(stage) = genmanip_rollout::Stage::open(Arc::clone(scenario), equipment.assets, equipment.planner.robot())
    else {
        return Ok(None);
    };
    let mut environment = Environment::new(RolloutSettings::default());
    environment.reset(&stage, scenario.seed);
    let verdict = environment.verdict().map_err(|error| LabError::broken("an episode cannot be judged", error))?;
    Ok(Some(verdict.success))
}

/// Random operation of any kind on random objects; it may be invalid for the scenario.
fn random(scenario: &Scenario, rng: &mut impl Rng) -> Operation {
    let of = |count: usize, rng: &mut dyn FnMut(usize) -> usize| rng(count.max(1));
    let mut pick = |count: usize| rng.random_range(0..count);
    let objects = &scenario.objects;
    let object = &objects[of(objects.len(), &mut pick)];
    let nodes = &scenario.task.scene_graph.nodes;
    let [node, other] =
        [0; 2].map(|_| nodes.get(of(nodes.len(), &mut pick)).map_or(&object.id, |node| &node.id).clone());
    let cards = genmanip_assets::Catalogue::builtin().cards();
    let uid = ChosenAsset::Uid(cards[of(cards.len(), &mut pick)].uid.clone());
    let choice = of(16, &mut pick);
    let id = object.id.clone();
    let [dx, dy, turn] = [(); 3].map(|()| rng.random_range(-0.12..0.12));
    let moved = Pose::new(
        object.pose.position + DVec3::new(dx, dy, 0.0),
        genmanip_core::glam::DQuat::from_rotation_z(20.0 * turn) * object.pose.rotation,
    );
    let at = Pose::from_position_yaw(DVec3::new(0.5 + dx, 2.5 * dy, 0.0), 20.0 * turn);
    match choice {
        0..=7 => Operation::Place { objects: vec![Placement { id, pose: moved, joint_positions: None }] },
        8 => Operation::Add { asset: uid, id: None, pose: at, distractor: false },
        9 => Operation::Add { asset: uid, id: None, pose: at, distractor: true },
        10 => Operation::Remove { object: id },
        11 => Operation::Duplicate { object: id, pose: None, id: None },
        12 => Operation::Swap { object: id, uid, id: None },
        13 => Operation::Instruction {
            text: format!("Move the {} next to the {}.", scenario.task.name_of(&node), scenario.task.name_of(&other))
                .to_lowercase(),
        },
        14 => {
            let edges = scenario.task.scene_graph.edges.iter().filter(|edge| edge.subject != node).cloned().collect();
            Operation::Edges { edges, description: None }
        }
        _ => {
            let known = scenario.world.cameras.first();
            let camera = known.map(|camera| Camera { name: "mine".into(), ..camera.clone() });
            camera.map_or(Operation::Remove { object: id }, |camera| Operation::Camera {
                camera: Box::new(camera),
                index: None,
            })
        }
    }
}

fn stamp(author: &str, id: &str) -> Stamp {
    Stamp { client_operation_id: id.to_owned(), author: author.to_owned(), at: "2026-01-01T00:00:00Z".to_owned() }
}

fn stopped(error: EditError) -> LabError {
    LabError::broken("editing stopped", error)
}
