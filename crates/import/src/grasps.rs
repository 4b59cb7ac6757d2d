//! Grasp baking: tests grasps of the catalogue's objects in physics and stores the results in one file, resumably.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::atomic::AtomicBool;
use std::sync::{Arc, Mutex, PoisonError};

use genmanip_assets::{Catalogue, GraspFile, GraspProvenance, ObjectGrasps};
use genmanip_core::limits;
use genmanip_core::{AssetUid, Document, ObjectModel, Seed, VerifiedGrasp, World};
use genmanip_motion::{GraspSettings, PlannerSettings};
use genmanip_rollout::collect::in_parallel;
use genmanip_rollout::grasp_trial::{
    GraspTrials, MAX_FAILED_GRASPS, RobustnessSettings, TrialError, ViewSettings, WANTED_GRASPS, robust_grasps,
    verified_grasps,
};
use genmanip_workspace::text_table;
use serde::Serialize;
use serde_json::json;

use genmanip_workspace::Progress;
use genmanip_workspace::WorkspaceError;
use genmanip_workspace::documents;
use genmanip_workspace::worlds;

/// Settings of grasp baking, stored in the file.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct BakeSettings {
    /// Settings of the physics trials of a grasp.
    pub trying: RobustnessSettings,
    /// True to stop after the first few grasps of an object that held in every trial.
    pub brief: bool,
    /// Settings of the candidate generator.
    pub generator: GraspSettings,
    /// Name of the catalogue, which the file states.
    pub catalog: String,
}

/// Result of testing the grasps of all requested objects.
#[derive(Clone, Debug, PartialEq)]
pub struct Baked {
    /// One row per object in the file.
    pub rows: Vec<BakedRow>,
    /// True if every requested object is in the file; false after an interruption.
    pub is_whole: bool,
}

/// Counts of the grasps of an object that were tested.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct BakedRow {
    /// Uid of the object.
    pub uid: AssetUid,
    /// Name of the object.
    pub name: String,
    /// Number of tested grasps.
    pub grasps: usize,
    /// Number of grasps that held in every trial.
    pub always_held: usize,
    /// Number of trials over all grasps.
    pub trials: u32,
    /// Number of trials in which the object was held to the end.
    pub held: u32,
}

/// Tests grasps of the given objects, or of all graspable ones if none are given, and stores them in the file `out`.
///
/// Existing entries are kept if they were made with the same settings and their objects have not changed.
/// When `stop` becomes true, objects in progress are finished.
///
/// # Errors
/// If an object is unknown or not graspable, the file cannot be read or written, or a trial fails.
#[expect(clippy::too_many_arguments, reason = "inputs, output, settings and progress")]
pub fn bake(
    out: &Path,
    uids: &[AssetUid],
    world: &World,
    settings: &BakeSettings,
    seed: Seed,
    workers: usize,
    progress: &dyn Progress,
    stop: &AtomicBool,
) -> Result<Baked, WorkspaceError> {
    let BakeSettings { trying, brief, generator, catalog } = settings;
    let settings = PlannerSettings { grasp: generator.clone(), ..PlannerSettings::default() };
    let (planner, robot) = (worlds::planner(world, &settings)?, worlds::robot(world)?);
    let made_by = GraspProvenance {
        seed,
        genmanip_version: env!("CARGO_PKG_VERSION").into(),
        engine: genmanip_sim::engine_version(),
        robot: robot.name.clone(),
        robot_hash: Some(robot.physics_hash()),
        settings: match brief {
            false => {
                json!({ "trying": trying, "generator": generator, "physics": world.physics, "drives": robot.drives })
            }
            // The same settings as for grasps that an import tests.
            true => json!({ "trying": trying, "physics": world.physics, "drives": robot.drives }),
        },
    };
    let catalogue = Catalogue::named(catalog).unwrap_or_else(Catalogue::builtin);
    let models = graspable(catalogue, uids)?;
    let known = if out.exists() { read(out)? } else { empty(&made_by) };
    // Entries made with other settings or for changed objects are recomputed; older files do not record the robot's
    // hash.
    let known_robot = known.made_by.robot_hash.clone().or_else(|| made_by.robot_hash.clone());
    let is_made_alike = GraspProvenance { robot_hash: known_robot, ..known.made_by.clone() } == made_by;
    let kept = if is_made_alike { known.objects } else { BTreeMap::new() };
    let kept = kept
        .into_iter()
        .filter(|(uid, object)| catalogue.build(uid).is_ok_and(|model| model.has_physics(&object.physics_hash)))
        .collect::<BTreeMap<_, _>>();
    let missing: Vec<Arc<ObjectModel>> =
        models.iter().filter(|model| !kept.contains_key(&model.card.uid)).map(Arc::clone).collect();
    progress.note(&format!("{} objects to do, {} already done", missing.len(), models.len() - missing.len()));

    let trials = GraspTrials {
        catalogue,
        planner,
        robot,
        world: Arc::new(world.clone()),
        detector: None,
        view: ViewSettings::default(),
    };
    progress.begin("trying grasps", missing.len());
    let file = Mutex::new((GraspFile { made_by: made_by.clone(), objects: kept }, Ok(())));
    let finished = |model: &ObjectModel, grasps: Vec<VerifiedGrasp>| {
        let mut guard = file.lock().unwrap_or_else(PoisonError::into_inner);
        let object = ObjectGrasps { physics_hash: model.physics_hash(), grasps };
        guard.0.objects.insert(model.card.uid.clone(), object);
        // Write after every object, so that an interruption loses nothing.
        let written = documents::write_file(out, guard.0.to_text().as_bytes());
        if guard.1.is_ok() {
            guard.1 = written;
        }
        progress.advance();
    };
    let tried = in_parallel(&missing, workers, stop, &|model| -> Result<(), TrialError> {
        let seed = made_by.seed.fork(model.card.uid.as_str());
        let grasps = match brief {
            false => verified_grasps(&trials, model, trying, seed),
            true => robust_grasps(&trials, model, trying, WANTED_GRASPS, MAX_FAILED_GRASPS, seed),
        };
        finished(model, grasps?);
        Ok(())
    });
    tried.map_err(|error| {
        WorkspaceError::broken("baking stopped", error).with_hint("finished objects are kept; start again to continue")
    })?;
    progress.end();
    let (file, written) = file.into_inner().unwrap_or_else(PoisonError::into_inner);
    written?;
    let is_whole = models.iter().all(|model| file.objects.contains_key(&model.card.uid));
    Ok(Baked { rows: rows(catalogue, &file), is_whole })
}

fn empty(made_by: &GraspProvenance) -> GraspFile {
    GraspFile { made_by: made_by.clone(), objects: BTreeMap::new() }
}

/// Reads a file of `genmanip grasps bake`.
///
/// # Errors
/// If it cannot be read or is not a valid file.
pub fn read(path: &Path) -> Result<GraspFile, WorkspaceError> {
    GraspFile::from_json(&documents::read_text(path, limits::GRASPS)?).map_err(|error| {
        WorkspaceError::input(format!("{} is not a valid {} file", path.display(), GraspFile::SCHEMA))
            .because(error)
            .with_hint("expected a file that `genmanip grasps bake` wrote")
    })
}

/// Models of the given objects, or of all graspable ones if none are given.
fn graspable(catalogue: &Catalogue, uids: &[AssetUid]) -> Result<Vec<Arc<ObjectModel>>, WorkspaceError> {
    let all = catalogue.cards().iter().filter(|card| card.can_grasp && !card.is_articulated);
    let wanted: Vec<&AssetUid> =
        if uids.is_empty() { all.map(|card| &card.uid).collect() } else { uids.iter().collect() };
    wanted
        .into_iter()
        .map(|uid| {
            let model = catalogue
                .build(uid)
                .map_err(|error| WorkspaceError::input(format!("unknown object {uid}")).because(error))?;
            if !model.card.can_grasp || model.card.is_articulated {
                return Err(WorkspaceError::input(format!("object {uid} ({}) cannot be grasped", model.card.name))
                    .with_hint("expected a rigid object that fits an 8 cm gripper"));
            }
            Ok(model)
        })
        .collect()
}

fn rows(catalogue: &Catalogue, file: &GraspFile) -> Vec<BakedRow> {
    let row = |(uid, object): (&AssetUid, &ObjectGrasps)| BakedRow {
        uid: uid.clone(),
        name: catalogue.card(uid).map_or_else(String::new, |card| card.name.clone()),
        grasps: object.grasps.len(),
        always_held: object.grasps.iter().filter(|tried| tried.held == tried.trials).count(),
        trials: object.grasps.iter().map(|tried| tried.trials).sum(),
        held: object.grasps.iter().map(|tried| tried.held).sum(),
    };
    file.objects.iter().map(row).collect()
}

/// Formats the rows as a table.
pub fn table(rows: &[BakedRow]) -> String {
    let mut lines = vec![["uid", "object", "grasps", "always held", "held / trials"].map(String::from).to_vec()];
    for row in rows {
        lines.push(vec![
            row.uid.to_string(),
            row.name.clone(),
            row.grasps.to_string(),
            row.always_held.to_string(),
            format!("{}/{}", row.held, row.trials),
        ]);
    }
    text_table(&lines)
}
