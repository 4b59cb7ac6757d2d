//! The page and the results file, from realistic input.

#[path = "support/browser.rs"]
mod browser;
mod support;

use std::collections::BTreeMap;
use std::sync::Arc;

use genmanip_benchmark::*;
use genmanip_core::*;
use quick_xml::Reader;
use quick_xml::events::Event;

/// Parses a page, fails if it is not well-formed or self-contained, and returns its visible text.
fn check_report(page: &str, limit: usize) -> String {
    assert!(page.len() <= limit, "{} bytes", page.len());
    let mut reader = Reader::from_str(page);
    let (mut open, mut text): (Vec<String>, String) = (Vec::new(), String::new());
    loop {
        match reader.read_event().expect("well-formed") {
            Event::Eof => break,
            Event::Start(tag) | Event::Empty(tag) if tag.name().as_ref() == "link" => panic!("a link to {tag:?}"),
            Event::Start(tag) => {
                check_attributes(&tag);
                open.push(tag.name().as_ref().to_owned());
                if matches!(
                    open.last().expect("just pushed").as_str(),
                    "h1" | "h2" | "h3" | "p" | "tr" | "li" | "article"
                ) {
                    text.push('\n');
                }
            }
            Event::Empty(tag) => check_attributes(&tag),
            Event::End(_) => {
                open.pop().expect("opened before it is closed");
                text.push(' ');
            }
            Event::Text(part)
                if !open.iter().any(|tag| ["style", "script", "svg", "title"].contains(&tag.as_str())) =>
            {
                text += part.trim_end_matches('\n');
            }
            Event::GeneralRef(name) if !open.iter().any(|tag| tag == "svg") => text += &format!("&{};", &*name),
            _ => {}
        }
    }
    assert!(open.is_empty(), "still open: {open:?}");
    for outside in ["http:", "https:", "@import", "url("] {
        let found = page.replace("http://www.w3.org/2000/svg", "");
        assert!(!found.contains(outside), "the page refers to something outside: {outside}");
    }
    let lines = text.lines().map(|line| line.split_whitespace().collect::<Vec<_>>().join(" "));
    lines.filter(|line| !line.is_empty()).collect::<Vec<_>>().join("\n")
}

fn check_attributes(tag: &quick_xml::events::BytesStart) {
    for attribute in tag.attributes() {
        let attribute = attribute.expect("a well-formed attribute");
        let (name, value) = (attribute.key.as_ref(), attribute.value.as_ref());
        assert!(!name.starts_with("on"), "a handler in {tag:?}");
        match name {
            "src" => assert!(value.starts_with("data:image/jpeg;base64,"), "an outside picture"),
            "href" => assert!(value.starts_with("#task-") || value == "#episodes", "an outside link"),
            _ => {}
        }
    }
}

#[test]
fn a_small_report_reads_well() {
    let mut tasks = support::tasks();
    tasks.truncate(2);
    let page = report_html(&support::report_input(tasks), &ReportSettings::default()).unwrap();
    insta::assert_snapshot!("small_report", check_report(&page, 15_000_000));
}

#[test]
fn a_full_report_is_sound_and_the_same_each_time() {
    let input = support::report_input(support::tasks());
    let page = report_html(&input, &ReportSettings::default()).unwrap();
    let text = check_report(&page, 15_000_000);
    assert_eq!(page, report_html(&input, &ReportSettings::default()).unwrap());
    for section in &input.cases {
        assert!(text.contains(section.task.id.as_str()));
    }
    assert!(text.contains("Without a verified demonstration: 008_long_horizon."), "{text}");
}

#[test]
fn failures_of_an_agent_are_shown_by_class_and_stage() {
    let mut tasks = support::tasks();
    tasks.truncate(5);
    let mut input = support::report_input(tasks);
    let is_of_agent = |row: &&mut EpisodeRow| row.evaluation.as_deref() == Some("replay") && !row.outcome.success;
    let failure =
        |class, stage| AgentFailure { class, stage, ask: Some(3), evidence: "<that>".into(), transcript: None };
    let failures = [
        failure(Some(FailureClass::GraspGrounding), AgentStage::Object),
        failure(Some(FailureClass::PlanLocation), AgentStage::PointToPoint),
        failure(Some(FailureClass::PlanLocation), AgentStage::GridPath),
        failure(None, AgentStage::Check),
    ];
    let mut rows: Vec<_> = input.episodes.iter_mut().filter(is_of_agent).collect();
    assert!(rows.len() > failures.len());
    for (index, row) in rows.iter_mut().enumerate() {
        row.outcome.agent_failure = Some(failures[index.min(3)].clone());
    }
    let unclassified = rows.len() - 3;
    let counts =
        statistics::agent_failure_counts(rows.into_iter().filter_map(|row| row.outcome.agent_failure.as_ref()));
    assert_eq!((counts[0].class, counts[0].stage, counts[0].count), (None, AgentStage::Check, unclassified));
    input.summaries.iter_mut().find(|summary| summary.policy == "replay").unwrap().agent_failures = counts;
    let section = &mut input.cases[0];
    let transcript = Some("asked/e-1/transcript.json".to_owned());
    section.shown.as_mut().unwrap().agent_failure = Some(AgentFailure { transcript, ..failures[0].clone() });

    let page = report_html(&input, &ReportSettings::default()).unwrap();
    let link = "<a href=\"asked/e-1/transcript.json\">transcript</a>";
    assert!(page.contains(link));
    let text = check_report(&page.replace(link, ""), 15_000_000);
    for expected in [
        "Failures of the agent: replay".to_owned(),
        "Class object grid path point to point check All stages".into(),
        "grasp grounding 1 · · · 1".into(),
        "plan location · 1 1 · 2".into(),
        format!("not analysed · · · {unclassified} {unclassified}"),
        "analysis=yes".into(),
        "plan location at grid path".into(),
        "stopped at check".into(),
        "Agent: grasp grounding at object: &lt;that&gt;".into(),
    ] {
        assert!(text.contains(&expected), "{expected} in {text}");
    }
    assert_eq!(page.matches("Failures of the agent").count(), 1, "only where an agent failed");
}

#[test]
fn hostile_text_stays_text() {
    let hostile = "<script>alert('x')</script> & \"q\" <img src=http://x onerror=y>\u{1}";
    let mut tasks = support::tasks();
    tasks.truncate(1);
    let task = &mut tasks[0];
    task.instruction = hostile.into();
    task.scene_graph.description = hostile.into();
    Arc::make_mut(&mut task.objects[0]).name = hostile.into();
    let mut input = support::report_input(tasks);
    input.title = hostile.into();
    input.generated_by = hostile.into();
    input.commands = vec![hostile.into()];
    input.versions = vec![(hostile.into(), hostile.into())];
    input.notes = vec![hostile.into()];
    input.timings = vec![Timing { phase: hostile.into(), seconds: f64::NAN }];
    input.summaries[0].policy = hostile.into();
    input.comparisons[0].first = hostile.into();
    input.episodes[0].id = hostile.into();
    input.episodes[0].outcome.evidence = hostile.into();
    input.tasks[0].id = hostile.into();
    let section = &mut input.cases[0];
    section.attempts[0].id = hostile.into();
    let failure = Failure { cause: FailureCause::Slipped, evidence: hostile.into() };
    section.attempts[0].outcome = AttemptOutcome::Failed(failure.clone());
    section.results[0].policy = hostile.into();
    section.results[0].failures = vec![failure];
    let shown = section.shown.as_mut().unwrap();
    shown.id = hostile.into();
    let atom = &mut shown.verdict.alternatives[0][0];
    atom.explanation = hostile.into();
    atom.measurements[0].quantity = hostile.into();
    atom.measurements[1].value = f64::NAN;

    let page = report_html(&input, &ReportSettings::default()).unwrap();
    check_report(&page.replace("http://x", "outside"), 15_000_000);
    assert_eq!(page.matches("<script").count(), 1, "only our own");
    assert!(!page.contains("<img src=http"));
}

#[test]
fn a_large_report_is_thinned_until_it_fits_and_says_so() {
    let mut tasks = support::tasks();
    tasks.truncate(2);
    let input = support::report_input(tasks);
    let full = report_html(&input, &ReportSettings::default()).unwrap().len();
    let render = |max_bytes: usize| report_html(&input, &ReportSettings { max_bytes, ..ReportSettings::default() });

    let less = full - 5_000;
    let thinned = check_report(&render(less).unwrap(), less);
    assert!(thinned.contains("th image to keep this page small"), "{thinned}");
    let Err(ReportError::TooLarge { limit: 1000, got }) = render(1000) else { panic!("1000 bytes are too few") };
    let bare = check_report(&render(got).unwrap(), got);
    assert!(bare.contains("Film strips are omitted"), "{bare}");
}

/// Opt-in, since it needs a browser: `GENMANIP_BROWSER=/usr/bin/chromium cargo test --release --workspace ten_thousand
/// -- --ignored --nocapture`.
#[test]
#[ignore = "needs a browser, named by GENMANIP_BROWSER"]
#[expect(clippy::print_stdout, reason = "the figures are what it is for")]
fn ten_thousand_rows_show_and_filter_quickly() {
    let mut input = support::report_input(support::tasks());
    let made = input.episodes.clone();
    let many = made.iter().cycle().take(10_000).enumerate();
    input.episodes =
        many.map(|(number, row)| EpisodeRow { id: format!("{}-{number:05}", row.id), ..row.clone() }).collect();
    let page = report_html(&input, &ReportSettings::default()).unwrap();
    let measured = browser::measure(&std::env::var("GENMANIP_BROWSER").unwrap(), &page);
    println!("{measured}");
    assert_eq!(measured["errors"], serde_json::json!([]));
    assert_eq!(measured["outcomes"], serde_json::json!([measured["cause"]]), "a cause leads to its rows");
    assert!(measured["rows"].as_u64().is_some_and(|rows| rows >= 100), "{measured}");
    for (name, most_ms) in [
        ("shown", 2000.0),
        ("first filter", 200.0),
        ("second filter", 200.0),
        ("clearing", 200.0),
        ("rows of a cause", 200.0),
    ] {
        assert!(measured["took"][name].as_f64().is_some_and(|took| took <= most_ms), "{name}: {measured}");
    }
}

#[test]
fn a_report_about_nothing_is_a_report() {
    let mut input = support::report_input(Vec::new());
    input.summaries.clear();
    input.comparisons.clear();
    let text = check_report(&report_html(&input, &ReportSettings::default()).unwrap(), 100_000);
    assert!(text.contains("No policy was evaluated."));
}

#[test]
fn a_control_that_succeeds_is_a_warning() {
    let mut tasks = support::tasks();
    tasks.truncate(1);
    let mut input = support::report_input(tasks);
    let baseline = input.summaries.iter_mut().find(|summary| summary.policy == "do_nothing").unwrap();
    baseline.success.successes = 1;
    let text = check_report(&report_html(&input, &ReportSettings::default()).unwrap(), 15_000_000);
    assert!(text.contains("The baseline policy do_nothing succeeded in 1 episode"), "{text}");
}

#[test]
fn episodes_that_a_mistake_left_out_are_named_and_take_the_rate_away() {
    let mut tasks = support::tasks();
    tasks.truncate(1);
    let mut input = support::report_input(tasks);
    let left =
        NotRun { id: "a-00".into(), scenario_id: "a".into(), reason: "it raised ValueError".into(), mistake: true };
    input.not_run.insert("do_nothing".into(), vec![left.clone(), left]);
    let text = check_report(&report_html(&input, &ReportSettings::default()).unwrap(), 15_000_000);
    assert!(text.contains("a-00 was not run (and 1 more): it raised ValueError"), "{text}");
    assert!(text.contains("– baseline, must be 0"), "no rate: {text}");
}

#[test]
fn a_correction_says_from_whom_and_when_it_took_over() {
    let mut tasks = support::tasks();
    tasks.truncate(1);
    let mut input = support::report_input(tasks);
    let shown = input.cases[0].shown.as_mut().unwrap();
    let evidence = "the cup left the gripper".into();
    let failures = vec![Failure { cause: FailureCause::Slipped, evidence }];
    shown.correction = Some(Correction { policy: "clumsy".into(), from_step: 204, failures });
    let text = check_report(&report_html(&input, &ReportSettings::default()).unwrap(), 15_000_000);
    assert!(text.contains("Taken over after 3.4 s from clumsy, which had failed: slipped, the cup left"), "{text}");
}

fn scenario(task: &Task, number: u64) -> Scenario {
    Scenario {
        id: format!("{}-{number:02}", task.id),
        task: task.clone(),
        seed: Seed::new(number),
        objects: Vec::new(),
        world: World::from_json(include_str!("../../core/testdata/world.json")).expect("a whole world"),
        other_request: None,
        genmanip_version: "0.1.0".into(),
    }
}

#[test]
fn an_evaluation_survives_its_file_and_refuses_what_does_not_belong_to_it() {
    let tasks = support::tasks();
    let scenarios: Vec<Scenario> = tasks.iter().flat_map(|task| (0..3).map(|number| scenario(task, number))).collect();
    let results: Vec<EpisodeResult> = tasks
        .iter()
        .flat_map(|task| (0..3).map(|number| support::result(task, "expert", number, number != 1, None)))
        .collect();
    let settings = StatisticsSettings::default();
    let none = BTreeMap::new();
    let make = |results: Vec<EpisodeResult>| EvaluationReport::new("demo", &scenarios, results, &none, &settings);

    let whole = make(results.clone()).unwrap();
    assert_eq!(EvaluationReport::from_json(&whole.to_json()).unwrap(), whole);
    assert!(whole.to_json().starts_with("{\n  \"schema\": \"genmanip.evaluation/2\""));
    assert_eq!((whole.oracle, whole.summary.success.trials), (true, 30));

    let mut mixed = results.clone();
    mixed[3].policy = "other".into();
    let mut foreign = results.clone();
    foreign[3].scenario_id = "elsewhere".into();
    let twice: Vec<EpisodeResult> = results.iter().chain(&results[..1]).cloned().collect();
    for (results, expected) in [
        (Vec::new(), "no results"),
        (mixed, "expected results of policy expert only, got one of other"),
        (foreign, "elsewhere, which is not in suite demo"),
        (twice, "two results for scenario"),
    ] {
        let error = make(results).unwrap_err().to_string();
        assert!(error.contains(expected), "{error}");
    }
}

/// The reference is the expert's shortest verified path; unsolved scenarios have none, and their episodes do not count.
#[test]
fn spl_is_measured_against_the_shortest_verified_way_of_the_expert() {
    let task = &support::tasks()[0];
    let scenarios: Vec<Scenario> = (0..3).map(|number| scenario(task, number)).collect();
    let collected = |policy: &str, number: u64, success: bool, tcp_path_m: f64| EpisodeResult {
        tcp_path_m,
        ..support::result(task, policy, number, success, None)
    };
    let references = reference_paths_m(&[
        collected("expert", 0, true, 1.8),
        collected("expert", 0, true, 1.5),
        collected("expert", 0, false, 0.2),
        collected("expert", 1, false, 0.7),
        collected("replay", 2, true, 0.9),
    ]);
    let id = |number: usize| scenarios[number].id.clone();
    assert_eq!(references, [(id(0), 1.5)].into());

    let results: Vec<EpisodeResult> = (0..3).map(|number| collected("learned", number, true, 3.0)).collect();
    let settings = StatisticsSettings::default();
    let evaluate = |references: &BTreeMap<String, f64>| {
        EvaluationReport::new("demo", &scenarios, results.clone(), references, &settings).unwrap()
    };
    let report = evaluate(&references);
    let spl = report.summary.spl.unwrap();
    assert_eq!((spl.count, spl.value, &report.reference_paths_m), (1, 0.5, &references));
    assert_eq!(evaluate(&BTreeMap::new()).summary.spl, None, "absent, not 0");
    // Files of earlier versions have no references.
    let mut old = report.to_value();
    old.as_object_mut().unwrap().remove("reference_paths_m");
    assert_eq!(EvaluationReport::from_value(old).unwrap().reference_paths_m, BTreeMap::new());
}

#[test]
fn the_schema_on_disk_is_that_of_the_type() {
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../schemas/evaluation.schema.json");
    let text = serde_json::to_string_pretty(&schemars::schema_for!(EvaluationReport)).unwrap() + "\n";
    if std::env::var_os("GENMANIP_UPDATE_SCHEMAS").is_some() {
        std::fs::write(&path, &text).unwrap();
    }
    let stored = std::fs::read_to_string(&path).unwrap_or_default();
    assert!(stored == text, "schemas/evaluation.schema.json is stale: run the tests with GENMANIP_UPDATE_SCHEMAS=1");
}
