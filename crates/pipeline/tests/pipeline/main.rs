//! A run through the library alone, as a program that is not the command line makes it.

#![allow(clippy::unwrap_used)] // clippy's exemption covers test functions, not what they call

mod act;
mod arm;
mod documented;
mod driving;
mod ending;
mod learn;
mod remote;

use genmanip_workspace::task_files;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use genmanip_agent::ask::RecordedAnswers;
use genmanip_benchmark::{EvaluationReport, ReportSettings};
use genmanip_core::{Document, EpisodeResult, Seed};
use genmanip_motion::FeasibilitySettings;
use genmanip_pipeline::PolicyFactory;
use genmanip_pipeline::Run;
use genmanip_pipeline::collect::{CollectOptions, Collected, collect};
use genmanip_pipeline::evaluate::{EvaluateOptions, Suite, evaluate};
use genmanip_pipeline::folder::RunRecord;
use genmanip_pipeline::report::{gather, report};
use genmanip_rollout::collect::PipelineSettings;
use genmanip_rollout::expert::ExpertSettings;
use genmanip_viz::replay;
use genmanip_workspace::NoProgress;
use genmanip_workspace::Progress;
use genmanip_workspace::WorkspaceError;

const TASK: &str = "024_appearance";
const ALONE: CollectOptions =
    CollectOptions { workers: 1, repair: false, shard: None, verified: None, keep_going: false };

/// Counts what it hears, and raises a flag once enough is done.
struct Listener<'a> {
    done: AtomicUsize,
    begun: Mutex<Vec<(String, usize)>>,
    stop_after: usize,
    stop: &'a AtomicBool,
}

impl<'a> Listener<'a> {
    fn new(stop_after: usize, stop: &'a AtomicBool) -> Self {
        Self { done: AtomicUsize::new(0), begun: Mutex::default(), stop_after, stop }
    }
}

impl Progress for Listener<'_> {
    fn begin(&self, what: &str, total: usize) {
        self.begun.lock().unwrap().push((what.into(), total));
    }

    fn advance(&self) {
        if self.done.fetch_add(1, Ordering::Relaxed) + 1 == self.stop_after {
            self.stop.store(true, Ordering::Relaxed);
        }
    }

    fn end(&self) {}

    fn note(&self, _text: &str) {}
}

/// Episodes of a task in the default world with dataset images of 128 x 72 pixels; layouts are judged in the others.
fn run(episodes: usize) -> Run {
    let path = PathBuf::from(format!("{}/../../examples/tasks/{TASK}.json", env!("CARGO_MANIFEST_DIR")));
    let tasks = task_files::spool_tasks(&[path], &std::env::temp_dir()).unwrap();
    let mut world = (*genmanip_assets::worlds::default_world()).clone();
    for camera in world.cameras.iter_mut().filter(|camera| ["static", "wrist"].contains(&camera.name.as_str())) {
        camera.intrinsics = camera.intrinsics.filling(128, 72);
    }
    Run::new(tasks, episodes, PipelineSettings::in_world(world), Seed::new(3))
}

fn collected(folder: &Path, run: &Run, progress: &dyn Progress, stop: &AtomicBool) -> Collected {
    collect(folder, run.clone(), ALONE, progress, stop).unwrap()
}

/// The planner and the expert knew of grasps apart; today's settings still are what was fixed then.
#[test]
fn a_run_of_version_1_opens_with_its_settings_where_they_are_now() {
    let text = include_str!("../../../cli/testdata/version_1/run/run.json");
    let run = RunRecord::from_json(text).unwrap();
    assert_eq!(run.settings.layout.grasp, FeasibilitySettings::reach_only());
    assert_eq!(run.settings.expert, ExpertSettings::default());
    let changed = text.replacen("\"padding\": 0.001", "\"padding\": 0.002", 1).replacen(
        "\"finger_clearance_m\": 0.024",
        "\"finger_clearance_m\": 0.02",
        1,
    );
    let settings = RunRecord::from_json(&changed).unwrap().settings;
    assert!((settings.layout.grasp.clearance_m - 0.002).abs() < 1e-12, "{:?}", settings.layout.grasp);
    assert_eq!(settings.expert.feasibility.finger_room_m, Some(0.02));
    assert_eq!(RunRecord::from_json(&run.to_json()).unwrap(), run);
}

/// Told to stop after the first of two attempts, continued, evaluated with an argument, replayed, gathered for the page.
#[test]
fn a_run_is_collected_in_two_goes_evaluated_and_gathered() {
    let folder = tempfile::tempdir().unwrap();
    let (folder, run) = (folder.path().join("run"), run(2));

    let stop = AtomicBool::new(false);
    let first = collected(&folder, &run, &Listener::new(1, &stop), &stop);
    assert_eq!((first.interrupted, first.is_met(), first.finished, first.attempts), (true, false, 1, 2));
    let never = AtomicBool::new(false);
    let second = collected(&folder, &run, &NoProgress, &never);
    assert_eq!((second.interrupted, second.finished, second.rows.len()), (false, 2, 1));
    assert_eq!((second.rows[0].attempts, &second.dataset), (2, &None), "no images, no dataset");
    // Stopped before it could look at anything: all that is there counts, and no time is negative.
    let looked = collected(&folder, &run, &NoProgress, &AtomicBool::new(true));
    assert_eq!((looked.interrupted, looked.finished, looked.attempts), (true, 2, 2));
    assert!(!looked.table(false).contains("-0"), "{}", looked.table(false));
    let other = Run { seed: Seed::new(4), ..run.clone() };
    let refused = collect(&folder, other.clone(), ALONE, &NoProgress, &never).unwrap_err();
    assert!(matches!(refused, WorkspaceError::AnotherRun { .. }), "{refused:?}");

    let still = [PolicyFactory::resolve("do_nothing:seconds=0.5").unwrap()];
    let options = EvaluateOptions { out: Some(folder.clone()), workers: 1, ..EvaluateOptions::default() };
    let suite = Suite::of_run(&folder).unwrap();
    let (stop, listener) = (AtomicBool::new(false), Listener::new(0, &never));
    assert!(evaluate(&suite, &still, &options, &Listener::new(1, &stop), &stop).unwrap().is_empty(), "stopped");
    let reports = evaluate(&suite, &still, &options, &listener, &never).unwrap();
    assert_eq!((reports.len(), reports[0].results.len(), reports[0].summary.success.value), (1, 2, 0.0));
    assert!(folder.join("evaluation/do_nothing_seconds=0.5.json").is_file());
    assert_eq!(*listener.begun.lock().unwrap(), [("do_nothing_seconds=0.5".to_owned(), 1)], "the other was done");

    driving::a_session_ends_as_the_loop_does(&suite, &reports[0].results);

    ending::episodes_end_as_told(&suite);

    // Nobody fails at a task because a model's server is down: nothing is counted.
    let model = folder.with_file_name("model.toml");
    std::fs::write(&model, "[server]\nbase_url = \"http://127.0.0.1:9/v1\"\nmax_retries = 0\n").unwrap();
    let agent = [PolicyFactory::resolve(&format!("agent:vlm={}", model.display())).unwrap()];
    let down = evaluate(&suite, &agent, &options, &NoProgress, &never).unwrap_err();
    assert!(down.to_string().contains("ran no episode") && down.to_string().contains("cannot connect to"), "{down}");
    let limited = EvaluateOptions { max_cost: Some(1.0), ..options.clone() };
    let unpriced = evaluate(&suite, &agent, &limited, &NoProgress, &never).unwrap_err();
    assert!(unpriced.to_string().contains("say no price"), "{unpriced}");

    act::an_image_becomes_motions(&suite.scenarios[0].clone(), folder.parent().unwrap());

    let ids = [format!("{TASK}-000"), format!("{TASK}-001")];
    remote::a_server_leads_the_arm(&folder, ids.each_ref().map(String::as_str));

    // Answers are kept and given again: the same verdicts, byte for byte. A lost answer is named.
    let answers = folder.with_file_name("answers");
    let nowhere = EvaluateOptions { out: None, ..options.clone() };
    let agent = |model: &str| {
        let text = format!("agent:vlm={model},masks=oracle,answers={}", answers.display());
        evaluate(&suite, &[PolicyFactory::resolve(&text).unwrap()], &nowhere, &NoProgress, &never)
    };
    let told = |report: &EvaluationReport| -> Vec<EpisodeResult> {
        report.results.iter().map(|result| EpisodeResult { policy: String::new(), ..result.clone() }).collect()
    };
    let (asked, again) = (agent("oracle").unwrap(), agent("recorded").unwrap());
    let text = |reports: &[EvaluationReport]| serde_json::to_string(&told(&reports[0])).unwrap();
    assert_eq!(text(&asked), text(&again));
    assert_eq!(asked[0].results.len(), 2);
    for entry in std::fs::read_dir(&answers).unwrap() {
        let path = entry.unwrap().path();
        let mut recorded = RecordedAnswers::from_json(&std::fs::read_to_string(&path).unwrap()).unwrap();
        recorded.answers.truncate(1);
        std::fs::write(&path, recorded.to_json()).unwrap();
    }
    let lost = agent("recorded").unwrap_err().to_string();
    assert!(lost.contains("ran no episode"), "{lost}");

    // Failures of an agent have a class, a stage and a transcript.
    let asked_by = folder.with_file_name("asked");
    let text = format!("agent:vlm=random,masks=oracle,transcripts={}", asked_by.display());
    let random = evaluate(&suite, &[PolicyFactory::resolve(&text).unwrap()], &options, &NoProgress, &never).unwrap();
    assert_eq!(random[0].label, "agent_vlm=random_masks=oracle", "no path of this machine");
    let failed: Vec<&EpisodeResult> = random[0].results.iter().filter(|result| !result.success).collect();
    assert!(!failed.is_empty(), "random marks solve the task");
    for result in &failed {
        let failure = result.agent_failure.as_ref().unwrap();
        assert!(failure.class.is_some() && !result.failures.is_empty(), "{failure:?}");
        let transcript = Path::new(failure.transcript.as_ref().unwrap());
        assert!(transcript.is_file() && transcript.with_extension("html").is_file(), "{failure:?}");
    }
    let counted: usize = random[0].summary.agent_failures.iter().map(|entry| entry.count).sum();
    assert_eq!(counted, failed.len());
    let html = report(&folder, None, &ReportSettings::default(), &NoProgress).unwrap();
    assert!(html.contains("Failures of the agent") && html.contains("transcript.html\">transcript</a>"));

    let replayed = replay::check(&folder, true, None, 2, &NoProgress, &mut |_| ()).unwrap();
    assert!(replayed.len() == 2 && replayed.iter().all(|episode| episode.identical == Some(true)), "{replayed:?}");

    let input = gather(&folder, None, &NoProgress).unwrap();
    let [section] = &input.cases[..] else { panic!("{} sections", input.cases.len()) };
    let ids: Vec<&str> = section.attempts.iter().map(|attempt| attempt.id.as_str()).collect();
    assert_eq!(ids, [format!("{TASK}-000"), format!("{TASK}-001")]);
    let shown = section.shown.as_ref().unwrap();
    assert!(shown.success && shown.id == ids[0], "the first verified attempt is shown, not {}", shown.id);
    assert_eq!((section.film.len(), section.scenario.as_ref().map(|s| s.id.as_str())), (12, Some(ids[0])));
    assert_eq!((input.tasks.len(), input.episodes.len(), &input.rule), (1, 6, &None), "two attempts, four evaluated");

    // One episode, and one task with all its episodes; what is neither is refused with what is near.
    let second = format!("{TASK}-001");
    let of = |id: &str| gather(&folder, Some(id), &NoProgress);
    let episode = of(&second).unwrap();
    assert_eq!((episode.cases.len(), episode.cases[0].shown.as_ref().unwrap().id.as_str()), (1, second.as_str()));
    assert!(episode.episodes.iter().all(|row| row.id == second) && episode.summaries.is_empty());
    assert_eq!((of(TASK).unwrap().cases.len(), of(TASK).unwrap().episodes.len()), (2, 6));
    let refused = of("elsewhere").unwrap_err().to_string();
    assert!(refused.contains("no task and no episode `elsewhere` in the run"), "{refused}");
}

/// A list of tasks, one document per line, is the same as its files; what is wrong has its line.
#[test]
fn a_list_of_tasks_is_read_line_by_line() {
    let folder = tempfile::tempdir().unwrap();
    let tasks = task_files::designed_tasks(3, 5, genmanip_assets::Catalogue::builtin()).unwrap();
    let lines: Vec<String> = tasks.iter().map(|task| task.to_value().to_string()).collect();
    let check = |text: &str, expected: Result<usize, &str>| {
        let list = folder.path().join("tasks.jsonl");
        std::fs::write(&list, text).unwrap();
        match (task_files::spool_tasks(std::slice::from_ref(&list), folder.path()), expected) {
            (Ok(spooled), Ok(count)) => {
                let read: Vec<_> = spooled.iter().map(Result::unwrap).collect();
                assert_eq!(read, tasks[..count]);
                assert_eq!(task_files::read_tasks(&[list]).unwrap(), read);
            }
            (Err(error), Err(part)) => {
                let place = list.display();
                assert!(error.to_string().contains(&part.replace("LIST", &place.to_string())), "{part} in {error}");
            }
            (read, expected) => panic!("{read:?}, expected {expected:?}"),
        }
    };
    check(&format!("{}\n\n{}\r\n{}", lines[0], lines[1], lines[2]), Ok(3));
    check("", Ok(0));
    check(&format!("{}\n{}\n", lines[0], lines[0]), Err("(the second: LIST:2)"));
    check(&format!("{}\n{{\"schema\": \"genmanip.task/9\"}}", lines[0]), Err("LIST:2"));
    check(&format!("{}\n{{", lines[0]), Err("LIST:2 is no task document"));
}
