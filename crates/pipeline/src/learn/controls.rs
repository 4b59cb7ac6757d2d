//! Controls of a learned policy: variants that differ from it in one thing, for paired comparisons on the same layouts.

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use genmanip_core::Policy;
use genmanip_policy::{ImageInput, PolicyDescription, Preset, Seen};
use genmanip_workspace::{Progress, WorkspaceError};

use super::demonstrations;
use super::images;
use super::presets::settings;
use super::recorded::Recorded;
use crate::learned::policy::ChunkPolicy;
use crate::learned::{self, Execution, Learned, inputs};
use crate::policies::{PolicyContext, PolicyFactory};

/// Tested numbers of executed actions per chunk.
const EXECUTED: [usize; 5] = [1, 2, 4, 8, 16];
/// Grey level of an image without content.
const GREY: u8 = 128;

/// The policy of a folder, called `learned`, and its controls:
///
/// - `execute_N`: executes N actions of each chunk instead of the trained number;
/// - `no_images`: sees grey images; `other_images`: sees those of a demonstration on another layout;
/// - `nearest_replay`: replays open loop the demonstration whose goal objects lay nearest to the layout's (their
///   positions are simulator truth).
///
/// Returns `None` if interrupted.
///
/// # Errors
/// When the policy or the run cannot be read.
pub fn controls(
    policy: &Path,
    run: &Path,
    workers: usize,
    progress: &dyn Progress,
    stop: &AtomicBool,
) -> Result<Option<Vec<PolicyFactory>>, WorkspaceError> {
    let learned = learned::load(policy, Execution::default())?;
    let description = learned.description().clone();
    let mut all = vec![changed("learned", &learned, &description, |_, seen| seen.clone())?];
    for execute in EXECUTED {
        if execute <= description.model.chunk && execute != description.execute {
            let description = PolicyDescription { execute, ..description.clone() };
            all.push(changed(&format!("execute_{execute}"), &learned, &description, |_, seen| seen.clone())?);
        }
    }
    if !description.inputs.images.is_empty() {
        let grey: Vec<u8> = vec![GREY; description.inputs.images.iter().map(ImageInput::bytes).sum()];
        all.push(changed("no_images", &learned, &description, move |_, seen| Seen {
            rgb: grey.clone(),
            ..seen.clone()
        })?);
        let Some(read) = demonstrations::read(run, &[], &settings(description.preset, false), workers, progress, stop)?
        else {
            return Ok(None);
        };
        let Some(images) = images::of_rows(&read, workers, progress, stop)? else { return Ok(None) };
        let (images, execute) = (Arc::new(images), description.execute);
        let rows: Vec<usize> = read.frames.iter().map(Vec::len).collect();
        all.push(changed("other_images", &learned, &description, move |moment, seen| {
            let episode = moment.layout as usize % rows.len();
            let row = (moment.call * execute).min(rows[episode].saturating_sub(1));
            // An unreadable image becomes an empty one, which the network refuses by its size.
            Seen { rgb: images.read(episode, row).unwrap_or_default(), ..seen.clone() }
        })?);
    }
    let state = || settings(Preset::State, false);
    let Some(read) = demonstrations::read(run, &[], &state(), workers, progress, stop)? else { return Ok(None) };
    let recorded = Arc::new(Recorded::of(Preset::State, state(), &read));
    all.push(PolicyFactory::of("nearest_replay", move |episode: &PolicyContext| {
        let predict = recorded.lookup(|recorded, seen| {
            let distance = |start: &Vec<f32>| inputs::goal_distance(&recorded.description.inputs, &seen.numbers, start);
            let distances = recorded.starts.iter().map(distance).enumerate();
            distances.min_by(|(_, one), (_, other)| one.total_cmp(other)).map(|(place, _)| place)
        });
        let policy = ChunkPolicy::new("nearest_replay", &recorded.description, predict, episode.stage)?;
        Ok(Box::new(policy) as Box<dyn Policy>)
    })?);
    Ok(Some(all.into_iter().map(PolicyFactory::never_finishing).collect()))
}

/// Point in an episode at which a chunk is predicted.
struct Moment {
    /// Hash that identifies the layout.
    layout: u64,
    /// Number of earlier predictions in the episode.
    call: usize,
}

/// A factory of the policy with its inputs changed by `change`.
fn changed(
    name: &str,
    learned: &Arc<Learned>,
    description: &PolicyDescription,
    change: impl Fn(&Moment, &Seen) -> Seen + Send + Sync + 'static,
) -> Result<PolicyFactory, WorkspaceError> {
    let (learned, description, change) = (Arc::clone(learned), description.clone(), Arc::new(change));
    let own = name.to_owned();
    PolicyFactory::of(name, move |episode: &PolicyContext| {
        let (mut predict, change) = (learned.predict(), Arc::clone(&change));
        let mut moment = Moment { layout: episode.stage.scenario.seed.fork("other_images").value(), call: 0 };
        let predict = move |seen: &Seen| {
            let predicted = predict(&change(&moment, seen));
            moment.call += 1;
            predicted
        };
        Ok(Box::new(ChunkPolicy::new(&own, &description, predict, episode.stage)?) as Box<dyn Policy>)
    })
}
