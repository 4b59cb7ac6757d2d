//! `genmanip grasps bake` and `genmanip grasps show`.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};

use genmanip_assets::{Catalogue, GraspFile, GraspProvenance, ObjectGrasps, panda};
use genmanip_core::grasp::GraspNetGrasp;
use genmanip_core::{Document, Grasp, ObjectModel, Seed, TriedGrasp};
use genmanip_motion::{GraspSettings, PlannerSettings};
use genmanip_rollout::grasp_trial::{GraspTrials, TryingSettings, ViewSettings, try_all};
use genmanip_sim::SimSettings;
use serde::Serialize;
use serde_json::json;

use crate::args::{BakeArguments, ShowGraspsArguments};
use crate::error::{ExitStatus, Failed};
use crate::inputs;
use crate::printer::{Printer, table};

/// Largest file of grasps that is read, bytes.
const MAX_FILE_BYTES: u64 = 64 << 20;
/// What GraspNet rows say about the fingers: how far their tips are ahead of a row's origin, m.
const DEPTH_M: f64 = 0.02;

/// One line of the table of `bake`.
#[derive(Serialize)]
struct Row {
    uid: String,
    name: String,
    grasps: usize,
    /// Grasps that held in every trial.
    always_held: usize,
    trials: u32,
    held: u32,
}

/// What `show` prints.
#[derive(Serialize)]
struct Shown {
    uid: String,
    name: String,
    physics_hash: String,
    grasps: Vec<ShownGrasp>,
}

#[derive(Serialize)]
struct ShownGrasp {
    object_from_tcp: Grasp,
    held: u32,
    trials: u32,
    /// The 17 numbers of the GraspNet convention in the object's frame; the score is the share that held.
    graspnet: Vec<f64>,
}

pub fn bake(arguments: &BakeArguments, printer: &Printer) -> Result<ExitStatus, Failed> {
    let trying = TryingSettings { trials: arguments.trials, ..TryingSettings::default() };
    let grasp = GraspSettings { max_candidates: arguments.count, ..GraspSettings::default() };
    let planner = inputs::planner(&PlannerSettings { grasp: grasp.clone(), ..PlannerSettings::default() })?;
    let sim = SimSettings::default();
    let made_by = GraspProvenance {
        seed: Seed::new(arguments.seed),
        genmanip_version: env!("CARGO_PKG_VERSION").into(),
        engine: genmanip_sim::engine_version(),
        robot: panda().name.clone(),
        settings: json!({ "trying": trying, "generator": grasp, "physics": sim }),
    };
    let catalogue = Catalogue::builtin();
    let models = graspable(catalogue, &arguments.objects)?;
    let known = if arguments.out.exists() { read(&arguments.out)? } else { nothing(&made_by) };
    // What was made otherwise, or for objects that have changed, is made again.
    let kept = if known.made_by == made_by { known.objects } else { BTreeMap::new() };
    let kept = kept
        .into_iter()
        .filter(|(uid, object)| catalogue.build(uid).is_ok_and(|model| model.has_physics(&object.physics_hash)))
        .collect::<BTreeMap<_, _>>();
    let missing: Vec<Arc<ObjectModel>> =
        models.iter().filter(|model| !kept.contains_key(&model.card.uid)).map(Arc::clone).collect();
    printer.say(format!("{} objects to do, {} done before", missing.len(), models.len() - missing.len()));

    let trials = GraspTrials { catalogue, planner, robot: panda(), sim, view: ViewSettings::default() };
    let stop = crate::stop::on_interrupt();
    let bar = printer.progress("trying grasps", missing.len());
    let file = Mutex::new((GraspFile { made_by: made_by.clone(), objects: kept }, Ok(())));
    let finished = |model: &ObjectModel, grasps: Vec<TriedGrasp>| {
        let mut guard = file.lock().unwrap_or_else(PoisonError::into_inner);
        let object = ObjectGrasps { physics_hash: model.physics_hash(), grasps };
        guard.0.objects.insert(model.card.uid.clone(), object);
        // Whatever happens next, this object is done.
        let written = inputs::write_file(&arguments.out, guard.0.to_text().as_bytes());
        if guard.1.is_ok() {
            guard.1 = written;
        }
        bar.inc(1);
    };
    try_all(&trials, &missing, &trying, made_by.seed, inputs::workers(arguments.workers), &stop, &finished).map_err(
        |error| Failed::because("baking stopped", &error).hint("finished objects are kept; start again to continue"),
    )?;
    bar.finish_and_clear();
    let (file, written) = file.into_inner().unwrap_or_else(PoisonError::into_inner);
    written?;
    let rows = rows(catalogue, &file);
    printer.data(&rows, &in_words(&rows));
    let whole = models.iter().all(|model| file.objects.contains_key(&model.card.uid));
    Ok(if whole { ExitStatus::Done } else { ExitStatus::NotMet })
}

pub fn show(arguments: &ShowGraspsArguments, printer: &Printer) -> Result<ExitStatus, Failed> {
    let model = Catalogue::builtin()
        .build(&arguments.uid)
        .map_err(|error| Failed::because(format!("no object {}", arguments.uid), &error))?;
    let own = arguments.file.as_deref().map(read).transpose()?;
    let file = own.as_ref().unwrap_or_else(|| GraspFile::builtin());
    let grasps =
        file.of(&model).map_err(|error| Failed::because("the grasps cannot be used", &error))?.ok_or_else(|| {
            Failed::new(format!("no tried grasps of object {} ({})", model.card.uid, model.card.name))
                .hint("only rigid things that fit the hand have some; `genmanip grasps bake` makes them")
        })?;
    let pad_height_m = panda().gripper.pad_size.y;
    let object_id = model.card.uid.parse().unwrap_or(-1);
    let shown = |tried: &TriedGrasp| {
        let grasp = Grasp { score: tried.share(), ..tried.grasp.clone() };
        let row = GraspNetGrasp { grasp, height_m: pad_height_m, depth_m: DEPTH_M, object_id }.to_graspnet();
        let object_from_tcp = tried.grasp.clone();
        ShownGrasp { object_from_tcp, held: tried.held, trials: tried.trials, graspnet: row.to_vec() }
    };
    let shown = Shown {
        uid: model.card.uid.clone(),
        name: model.card.name.clone(),
        physics_hash: model.physics_hash(),
        grasps: grasps.iter().map(shown).collect(),
    };
    printer.data(&shown, &shown.in_words());
    Ok(ExitStatus::Done)
}

fn nothing(made_by: &GraspProvenance) -> GraspFile {
    GraspFile { made_by: made_by.clone(), objects: BTreeMap::new() }
}

fn read(path: &Path) -> Result<GraspFile, Failed> {
    GraspFile::from_json(&inputs::read_text(path, MAX_FILE_BYTES)?).map_err(|error| {
        Failed::because(format!("{} is no valid {} file", path.display(), GraspFile::SCHEMA), &error)
            .hint("expected a file that `genmanip grasps bake` wrote")
    })
}

/// The named objects, or all that can be grasped.
fn graspable(catalogue: &Catalogue, uids: &[String]) -> Result<Vec<Arc<ObjectModel>>, Failed> {
    let all = catalogue.cards().iter().filter(|card| card.can_grasp && !card.is_articulated);
    let wanted: Vec<&String> =
        if uids.is_empty() { all.map(|card| &card.uid).collect() } else { uids.iter().collect() };
    wanted
        .into_iter()
        .map(|uid| {
            let model = catalogue.build(uid).map_err(|error| Failed::because(format!("no object {uid}"), &error))?;
            if !model.card.can_grasp || model.card.is_articulated {
                return Err(Failed::new(format!("object {uid} ({}) cannot be grasped", model.card.name))
                    .hint("expected a rigid thing that fits an 8 cm hand"));
            }
            Ok(model)
        })
        .collect()
}

fn rows(catalogue: &Catalogue, file: &GraspFile) -> Vec<Row> {
    let row = |(uid, object): (&String, &ObjectGrasps)| Row {
        uid: uid.clone(),
        name: catalogue.card(uid).map_or_else(String::new, |card| card.name.clone()),
        grasps: object.grasps.len(),
        always_held: object.grasps.iter().filter(|tried| tried.held == tried.trials).count(),
        trials: object.grasps.iter().map(|tried| tried.trials).sum(),
        held: object.grasps.iter().map(|tried| tried.held).sum(),
    };
    file.objects.iter().map(row).collect()
}

fn in_words(rows: &[Row]) -> String {
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
    table(&lines)
}

impl Shown {
    fn in_words(&self) -> String {
        let head = ["held", "width mm", "x mm", "y mm", "z mm", "approach x y z", "score"];
        let mut lines = vec![head.map(String::from).to_vec()];
        for shown in &self.grasps {
            let grasp = &shown.object_from_tcp;
            let mm = |metres: f64| format!("{:.1}", metres * 1e3);
            let (at, along) = (grasp.pose.position, grasp.approach());
            lines.push(vec![
                format!("{}/{}", shown.held, shown.trials),
                mm(grasp.width),
                mm(at.x),
                mm(at.y),
                mm(at.z),
                format!("{:5.2} {:5.2} {:5.2}", along.x, along.y, along.z),
                format!("{:.2}", grasp.score),
            ]);
        }
        format!("{} {}: {} grasps, object frame\n{}", self.uid, self.name, self.grasps.len(), table(&lines))
    }
}
