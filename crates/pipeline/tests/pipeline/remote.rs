//! A policy on a server that speaks openpi's protocol.

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use genmanip_core::Episode;
use genmanip_data::EpisodeStore;
use genmanip_pipeline::PolicyFactory;
use genmanip_pipeline::evaluate::{EvaluateOptions, Suite, evaluate};
use genmanip_remote_policies::fake::{self, Answer};
use genmanip_workspace::NoProgress;

/// Rows of a chunk, as many as are executed of it.
const CHUNK: usize = 8;
/// Control steps of a row: 60 Hz commands at 15 Hz.
const STEPS: usize = 4;

/// The joint targets of an episode at 15 Hz, with a hand that is open or shut.
fn rows(episode: &Episode) -> Vec<Vec<f32>> {
    let last = |commands: &[genmanip_core::Frame]| commands.last().map(|frame| frame.command.clone());
    let commands: Vec<Vec<f32>> = episode.frames.chunks(STEPS).filter_map(last).collect();
    let narrowest = commands.iter().map(|command| command[7]).fold(f32::INFINITY, f32::min);
    let shut = |width: f32| f32::from(u8::from(width < narrowest + 0.002));
    commands.iter().map(|command| [&command[..7], &[shut(command[7])]].concat()).collect()
}

/// A server that knows the way of both episodes solves them; one that goes away costs only the episode under way, which
/// the next call makes.
pub fn a_server_leads_the_arm(run: &Path, ids: [&str; 2]) {
    let store = EpisodeStore::open(run.join("episodes")).unwrap();
    let ways = ids.map(|id| rows(&store.read(id).unwrap()));
    let mut suite = Suite::of_run(run).unwrap();
    let longest = ways.iter().map(Vec::len).max().unwrap_or_default();
    // It never says that it is finished.
    suite.settings.rollout.horizon_s = (longest * STEPS) as f64 / 60.0 + 1.0;
    let (second, is_back) = (Arc::new(AtomicUsize::new(usize::MAX)), Arc::new(AtomicBool::new(false)));
    let back = Arc::clone(&is_back);
    let address = fake::start(move |question| {
        // A new connection is the second episode, or a further one to it.
        if question.in_connection == 0 && question.number > 0 {
            second.fetch_min(question.number, Ordering::SeqCst);
        }
        let begun = second.load(Ordering::SeqCst);
        if question.number >= begun.saturating_add(2) && !back.load(Ordering::SeqCst) {
            return Answer::Drops;
        }
        let way = &ways[usize::from(question.number >= begun)];
        let first = question.in_connection * CHUNK;
        Answer::Actions((first..first + CHUNK).map(|row| way[row.min(way.len() - 1)].clone()).collect())
    })
    .unwrap();
    let policy = [PolicyFactory::resolve(&format!("openpi:url=ws://{address},preset=droid_jointpos")).unwrap()];
    let out = run.with_file_name("openpi");
    std::fs::create_dir(&out).unwrap();
    std::fs::copy(run.join("run.json"), out.join("run.json")).unwrap();
    let options = EvaluateOptions { out: Some(out), workers: 1, at_once: Some(1), ..EvaluateOptions::default() };
    let evaluated = || evaluate(&suite, &policy, &options, &NoProgress, &AtomicBool::new(false)).unwrap().remove(0);
    let cut = evaluated();
    assert!(cut.results.len() == 1 && cut.results[0].success, "{:?}", cut.results);
    assert!(!cut.results[0].oracle, "it sees images and joints alone");
    let [lost] = &cut.not_run[..] else { panic!("{:?}", cut.not_run) };
    assert!(lost.id.contains(ids[1]) && lost.reason.contains("the policy server ws://"), "{lost:?}");
    is_back.store(true, Ordering::SeqCst);
    let whole = evaluated();
    assert_eq!((whole.not_run.len(), &whole.results[0]), (0, &cut.results[0]), "what was finished is kept");
    assert!(whole.results[1].success, "{:?}", whole.results[1]);
}
