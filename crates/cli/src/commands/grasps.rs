//! `genmanip grasps bake` and `genmanip grasps show`.

use genmanip_assets::{Catalogue, GraspFile, panda};
use genmanip_core::grasp::GraspNetGrasp;
use genmanip_core::{AssetUid, Grasp, Seed, VerifiedGrasp};
use genmanip_import::grasps;
use genmanip_motion::GraspSettings;
use genmanip_rollout::grasp_trial::RobustnessSettings;
use genmanip_workspace::{task_files, text_table, workers, worlds};
use serde::Serialize;

use crate::args::{BakeArguments, ShowGraspsArguments};
use crate::commands::assets::catalogue;
use genmanip_terminal::Printer;
use genmanip_terminal::{ExitStatus, Failed};

/// Distance from the origin of a GraspNet row to the fingertips along the approach direction, m.
const DEPTH_M: f64 = 0.02;

pub fn bake(arguments: &BakeArguments, printer: &Printer) -> Result<ExitStatus, Failed> {
    let settings = grasps::BakeSettings {
        trying: match arguments.brief {
            true => RobustnessSettings::fast(),
            false => RobustnessSettings { trials: arguments.trials, ..RobustnessSettings::default() },
        },
        brief: arguments.brief,
        generator: GraspSettings { max_candidates: arguments.count, ..GraspSettings::default() },
        catalog: arguments.catalog.clone(),
    };
    let objects = match &arguments.objects {
        Some(text) => task_files::select_objects(text, catalogue(&arguments.catalog))?,
        None => Vec::new(),
    };
    let uids: Vec<AssetUid> = objects.into_iter().map(|card| card.uid).collect();
    let (seed, workers) = (Seed::new(arguments.seed), workers::workers(arguments.workers));
    let stop = genmanip_terminal::on_interrupt();
    let baked = grasps::bake(
        &arguments.out,
        &uids,
        &worlds::read_world_with(None, arguments.robot.as_deref())?,
        &settings,
        seed,
        workers,
        printer,
        &stop,
    )?;
    printer.data(&baked.rows, &grasps::table(&baked.rows));
    Ok(if baked.is_whole { ExitStatus::Done } else { ExitStatus::NotMet })
}

pub fn show(arguments: &ShowGraspsArguments, printer: &Printer) -> Result<ExitStatus, Failed> {
    let model = Catalogue::full()
        .build(&arguments.uid)
        .map_err(|error| Failed::because(format!("no object {}", arguments.uid), &error))?;
    let own = arguments.file.as_deref().map(grasps::read).transpose()?;
    let files: Vec<&GraspFile> = match &own {
        Some(own) => vec![own],
        None => vec![GraspFile::builtin(), GraspFile::instances()],
    };
    let from = arguments.file.as_deref().map_or("the built-in grasps".into(), |path| path.display().to_string());
    let help = "only rigid things that fit the hand have some; `genmanip grasps bake` makes them";
    let known = files.iter().find_map(|file| file.of(&model).transpose()).transpose();
    let grasps = known
        .map_err(|error| Failed::because(format!("{from}: cannot be used"), &error).hint(help))?
        .ok_or_else(|| {
            let (uid, name) = (&model.card.uid, &model.card.name);
            Failed::new(format!("{from}: holds no tried grasps of object {uid} ({name})")).hint(help)
        })?;
    let pad_height_m = panda().gripper.pad_size.y;
    let object_id = model.card.uid.as_str().parse().unwrap_or(-1);
    let shown = |tried: &VerifiedGrasp| {
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
    printer.data(&shown, &shown.describe());
    Ok(ExitStatus::Done)
}

/// Output of `grasps show`.
#[derive(Serialize)]
struct Shown {
    uid: AssetUid,
    name: String,
    physics_hash: String,
    grasps: Vec<ShownGrasp>,
}

#[derive(Serialize)]
struct ShownGrasp {
    object_from_tcp: Grasp,
    held: u32,
    trials: u32,
    /// One row of the GraspNet format (17 numbers) in the object's frame; its score is the share of trials that held.
    graspnet: Vec<f64>,
}

impl Shown {
    fn describe(&self) -> String {
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
        format!("{} {}: {} grasps, object frame\n{}", self.uid, self.name, self.grasps.len(), text_table(&lines))
    }
}
