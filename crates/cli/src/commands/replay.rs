//! `genmanip replay`.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use genmanip_assets::{Catalogue, panda};
use genmanip_core::Episode;
use genmanip_data::EpisodeStore;
use genmanip_rollout::{Stage, replay};
use genmanip_sim::SimSettings;
use serde::Serialize;

use crate::args::ReplayArguments;
use crate::error::{ExitStatus, Failed};
use crate::inputs;
use crate::pictures;
use crate::printer::{Printer, table};

#[derive(Serialize)]
struct Row {
    episode: String,
    frames: usize,
    identical: bool,
    largest_difference: f64,
}

pub fn run(arguments: &ReplayArguments, printer: &Printer) -> Result<ExitStatus, Failed> {
    let (store, ids) = locate(&arguments.episodes)?;
    if ids.is_empty() {
        return Err(Failed::new(format!("no recorded episode at {}", arguments.episodes.display()))
            .hint("collect episodes first; attempts without a layout are not recorded"));
    }
    let robot = panda();
    let bar = printer.progress("replaying", ids.len());
    let mut rows = Vec::new();
    for id in &ids {
        let failed = |error: &dyn std::error::Error| Failed::because(format!("cannot replay {id}"), error);
        let episode: Episode = store.read(id).map_err(|error| failed(&error))?;
        let scenario = Arc::new(episode.scenario.clone());
        let stage = Stage::open(scenario, Catalogue::builtin(), &robot, &SimSettings::default()).map_err(|error| {
            failed(&error).hint("the episode was recorded with other physics; use the version it names")
        })?;
        if let Some(path) = &arguments.strip {
            let path = if ids.len() == 1 { path.clone() } else { numbered(path, id) };
            inputs::write_file(&path, &pictures::film_strip(&stage, &episode, 8)?)?;
            printer.say(format!("wrote {}", path.display()));
        }
        if arguments.check || arguments.strip.is_none() {
            let check = replay::check(&stage, &episode).map_err(|error| failed(&error))?;
            rows.push(Row {
                episode: id.clone(),
                frames: check.frames,
                identical: check.identical,
                largest_difference: check.largest_difference,
            });
        }
        bar.inc(1);
    }
    bar.finish_and_clear();
    let mut lines = vec![["episode", "frames", "final state"].map(String::from).to_vec()];
    for row in &rows {
        let state = if row.identical { "identical".into() } else { format!("differs by {:e}", row.largest_difference) };
        lines.push(vec![row.episode.clone(), row.frames.to_string(), state]);
    }
    printer.data(&rows, &table(&lines));
    Ok(if rows.iter().all(|row| row.identical) { ExitStatus::Done } else { ExitStatus::NotMet })
}

/// The store and the recorded episodes meant by a path: an episode's folder, a store, or a run.
fn locate(path: &Path) -> Result<(EpisodeStore, Vec<String>), Failed> {
    let unusable = |error: &dyn std::error::Error| {
        Failed::because(format!("no episodes at {}", path.display()), error)
            .hint("name an episode folder, the `episodes` folder of a run, or the run itself")
    };
    let inside = path.join("episodes");
    let root: PathBuf = if inside.is_dir() { inside } else { path.to_owned() };
    if root.join("episode.json").is_file() {
        let id = root.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let parent = root.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let store = EpisodeStore::open(parent).map_err(|error| unusable(&error))?;
        return Ok((store, vec![id]));
    }
    let store = EpisodeStore::open(&root).map_err(|error| unusable(&error))?;
    let mut recorded = Vec::new();
    for id in store.ids().map_err(|error| unusable(&error))? {
        if store.is_recorded(&id).map_err(|error| unusable(&error))? {
            recorded.push(id);
        }
    }
    Ok((store, recorded))
}

fn numbered(path: &Path, id: &str) -> PathBuf {
    let extension = path.extension().unwrap_or_default().to_string_lossy();
    path.with_file_name(format!("{}-{id}.{extension}", inputs::stem(path)))
}
