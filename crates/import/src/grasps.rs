//! Trying grasps of the catalogue's objects beforehand into one file, object by object; a file that is there is continued.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::atomic::AtomicBool;
use std::sync::{Arc, Mutex, PoisonError};

use genmanip_assets::{Catalogue, GraspFile, GraspProvenance, ObjectGrasps};
use genmanip_core::limits;
use genmanip_core::{Document, ObjectModel, Seed, TriedGrasp, World};
use genmanip_motion::{GraspSettings, PlannerSettings};
use genmanip_rollout::collect::in_parallel;
use genmanip_rollout::grasp_trial::{
    GraspTrials, MAX_FAILED_GRASPS, RobustnessSettings, TrialError, ViewSettings, WANTED_GRASPS, robust_grasps,
    tried_grasps,
};
use genmanip_workspace::text_table;
use serde::Serialize;
use serde_json::json;

use genmanip_workspace::Progress;
use genmanip_workspace::RunError;
use genmanip_workspace::documents;
use genmanip_workspace::worlds;

/// How grasps are tried.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct BakeSettings {
    /// The trials.
    pub trying: RobustnessSettings,
    /// Whether only a few grasps that always held are wanted of each object, as of one that somebody waits for.
    pub brief: bool,
    /// Where candidates come from.
    pub generator: GraspSettings,
    /// Name of the catalogue whose objects are tried.
    pub catalog: String,
}

/// What baking came to.
#[derive(Clone, Debug, PartialEq)]
pub struct Baked {
    /// One row per object of the file.
    pub rows: Vec<BakedRow>,
    /// Whether every wanted object is in the file.
    pub is_whole: bool,
}

/// The tried grasps of an object, counted.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct BakedRow {
    /// Uid of the object.
    pub uid: String,
    /// Its name.
    pub name: String,
    /// Grasps that were tried.
    pub grasps: usize,
    /// Grasps that held in every trial.
    pub always_held: usize,
    /// Trials of all of them.
    pub trials: u32,
    /// Trials that held.
    pub held: u32,
}

/// Tries grasps of the named objects, or of all that can be grasped, and keeps them in a file.
///
/// What the file holds already is kept if it was made alike for objects that have not changed.
/// When `stop` becomes true, objects under way are finished.
///
/// # Errors
/// When an object is unknown or cannot be grasped, the file cannot be read or written, or a trial broke.
#[expect(clippy::too_many_arguments, reason = "what is baked, where, how, and who listens")]
pub fn bake(
    out: &Path,
    uids: &[String],
    world: &World,
    settings: &BakeSettings,
    seed: Seed,
    workers: usize,
    progress: &dyn Progress,
    stop: &AtomicBool,
) -> Result<Baked, RunError> {
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
            // As importing makes them.
            true => json!({ "trying": trying, "physics": world.physics, "drives": robot.drives }),
        },
    };
    let catalogue = Catalogue::named(catalog).unwrap_or_else(Catalogue::builtin);
    let models = graspable(catalogue, uids)?;
    let known = if out.exists() { read(out)? } else { nothing(&made_by) };
    // What was made otherwise, or for objects that have changed, is made again; older files do not name the robot's hash.
    let known_robot = known.made_by.robot_hash.clone().or_else(|| made_by.robot_hash.clone());
    let is_made_alike = GraspProvenance { robot_hash: known_robot, ..known.made_by.clone() } == made_by;
    let kept = if is_made_alike { known.objects } else { BTreeMap::new() };
    let kept = kept
        .into_iter()
        .filter(|(uid, object)| catalogue.build(uid).is_ok_and(|model| model.has_physics(&object.physics_hash)))
        .collect::<BTreeMap<_, _>>();
    let missing: Vec<Arc<ObjectModel>> =
        models.iter().filter(|model| !kept.contains_key(&model.card.uid)).map(Arc::clone).collect();
    progress.note(&format!("{} objects to do, {} done before", missing.len(), models.len() - missing.len()));

    let trials =
        GraspTrials { catalogue, planner, robot, world: Arc::new(world.clone()), view: ViewSettings::default() };
    progress.begin("trying grasps", missing.len());
    let file = Mutex::new((GraspFile { made_by: made_by.clone(), objects: kept }, Ok(())));
    let finished = |model: &ObjectModel, grasps: Vec<TriedGrasp>| {
        let mut guard = file.lock().unwrap_or_else(PoisonError::into_inner);
        let object = ObjectGrasps { physics_hash: model.physics_hash(), grasps };
        guard.0.objects.insert(model.card.uid.clone(), object);
        // Whatever happens next, this object is done.
        let written = documents::write_file(out, guard.0.to_text().as_bytes());
        if guard.1.is_ok() {
            guard.1 = written;
        }
        progress.advance();
    };
    let tried = in_parallel(&missing, workers, stop, &|model| -> Result<(), TrialError> {
        let seed = made_by.seed.fork(&model.card.uid);
        let grasps = match brief {
            false => tried_grasps(&trials, model, trying, seed),
            true => robust_grasps(&trials, model, trying, WANTED_GRASPS, MAX_FAILED_GRASPS, seed),
        };
        finished(model, grasps?);
        Ok(())
    });
    tried.map_err(|error| {
        RunError::broken("baking stopped", error).with_hint("finished objects are kept; start again to continue")
    })?;
    progress.end();
    let (file, written) = file.into_inner().unwrap_or_else(PoisonError::into_inner);
    written?;
    let is_whole = models.iter().all(|model| file.objects.contains_key(&model.card.uid));
    Ok(Baked { rows: rows(catalogue, &file), is_whole })
}

fn nothing(made_by: &GraspProvenance) -> GraspFile {
    GraspFile { made_by: made_by.clone(), objects: BTreeMap::new() }
}

/// Reads a file of `genmanip grasps bake`.
///
/// # Errors
/// When it cannot be read or is no such file.
pub fn read(path: &Path) -> Result<GraspFile, RunError> {
    GraspFile::from_json(&documents::read_text(path, limits::GRASPS)?).map_err(|error| {
        RunError::input(format!("{} is no valid {} file", path.display(), GraspFile::SCHEMA))
            .because(error)
            .with_hint("expected a file that `genmanip grasps bake` wrote")
    })
}

/// The named objects, or all that can be grasped.
fn graspable(catalogue: &Catalogue, uids: &[String]) -> Result<Vec<Arc<ObjectModel>>, RunError> {
    let all = catalogue.cards().iter().filter(|card| card.can_grasp && !card.is_articulated);
    let wanted: Vec<&String> =
        if uids.is_empty() { all.map(|card| &card.uid).collect() } else { uids.iter().collect() };
    wanted
        .into_iter()
        .map(|uid| {
            let model =
                catalogue.build(uid).map_err(|error| RunError::input(format!("no object {uid}")).because(error))?;
            if !model.card.can_grasp || model.card.is_articulated {
                return Err(RunError::input(format!("object {uid} ({}) cannot be grasped", model.card.name))
                    .with_hint("expected a rigid thing that fits an 8 cm hand"));
            }
            Ok(model)
        })
        .collect()
}

fn rows(catalogue: &Catalogue, file: &GraspFile) -> Vec<BakedRow> {
    let row = |(uid, object): (&String, &ObjectGrasps)| BakedRow {
        uid: uid.clone(),
        name: catalogue.card(uid).map_or_else(String::new, |card| card.name.clone()),
        grasps: object.grasps.len(),
        always_held: object.grasps.iter().filter(|tried| tried.held == tried.trials).count(),
        trials: object.grasps.iter().map(|tried| tried.trials).sum(),
        held: object.grasps.iter().map(|tried| tried.held).sum(),
    };
    file.objects.iter().map(row).collect()
}

/// The rows as a table.
pub fn table(rows: &[BakedRow]) -> String {
    let mut lines = vec![["uid", "object", "grasps", "always held", "held / trials"].map(String::from).to_vec()];
    for row in rows {
        lines.push(vec![
            row.uid.clone(),
            row.name.clone(),
            row.grasps.to_string(),
            row.always_held.to_string(),
            format!("{}/{}", row.held, row.trials),
        ]);
    }
    text_table(&lines)
}
