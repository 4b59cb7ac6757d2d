use std::collections::BTreeSet;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use genmanip_core::{Document, ObjectCard, Seed, Task, TaskKind};
use genmanip_llm::fake::{Behaviour, FakeServer, ScriptedChat};
use genmanip_llm::{ChatError, ChatModel, ChatReply, ChatRequest, Role};
use genmanip_task_writer::{
    Designed, Designer, GenerationEvent, GenerationOutcome, LlmSettings, PromptSet, Refusal, SamplingSettings,
    generate, sample_objects,
};
use genmanip_tasks::answer::Verdict;
use serde_json::{Value, json};

use crate::{catalogue, impatient, recorded_answers};

/// Every recorded answer, served over HTTP, gets the verdict in its file.
#[test]
fn recorded_answers_over_the_wire() {
    let cards = catalogue();
    let answers = recorded_answers();
    let server =
        FakeServer::scripted(answers.iter().map(|(_, answer)| Behaviour::Answer(answer.response.clone()))).unwrap();
    let mut settings = impatient(server.base_url());
    settings.generation.max_rounds = 1;
    let designer = Designer::open(&settings, Seed::new(1)).unwrap();
    let repairable = ["sloppy_json", "flat_dnf", "missing_edge_object", "edge_on_table"];
    let mut accepted = 0;
    for (name, answer) in &answers {
        let outcome = designer.design(&answer.request(name, &cards).unwrap());
        let expect = answer.expect.as_deref().unwrap();
        let round = &outcome.rounds[0];
        let expected = match expect {
            "valid" => Verdict::Valid,
            flaw if repairable.contains(&flaw) => Verdict::Repaired,
            _ => Verdict::Rejected,
        };
        assert_eq!(round.verdict, expected, "{name}: {:?}", round.flaws);
        assert_eq!(outcome.task().is_some(), expected != Verdict::Rejected, "{name}");
        if expected == Verdict::Rejected {
            assert!(outcome.refusal().unwrap().contains(expect), "{name}: {:?}", outcome.refusal());
        }
        accepted += usize::from(outcome.task().is_some());
    }
    assert_eq!((accepted, answers.len()), (22, 30));
}

/// The next question contains the violations of the first answer, and the second answer is accepted.
#[test]
fn violations_are_fed_back() {
    let (name, answer) =
        recorded_answers().into_iter().find(|(_, a)| a.expect.as_deref() == Some("unknown_uid")).unwrap();
    let (_, good) = recorded_answers().into_iter().find(|(name, _)| name.starts_with("012")).unwrap();
    let mut request = answer.request(&name, &catalogue()).unwrap();
    for card in good.request("", &catalogue()).unwrap().offered {
        if request.offered.iter().all(|other| other.uid != card.uid) {
            request.offered.push(card);
        }
    }
    let script: Arc<ScriptedChat> = Arc::new(ScriptedChat::new(["Sorry?".into(), answer.response, good.response]));
    let designer = Designer::with_model(Shared(Arc::clone(&script)), &LlmSettings::default()).unwrap();
    request.min_objects = 4;
    let outcome = designer.design(&request);
    let verdicts: Vec<Verdict> = outcome.rounds.iter().map(|round| round.verdict).collect();
    assert_eq!(verdicts, [Verdict::Rejected, Verdict::Rejected, Verdict::Valid], "{:?}", outcome.refusal());
    let last = script.seen().pop().unwrap();
    let roles: Vec<Role> = last.messages.iter().map(|message| message.role).collect();
    assert_eq!(roles, [Role::System, Role::User, Role::Assistant, Role::User, Role::Assistant, Role::User]);
    assert!(last.messages[3].text().contains("no_json"), "{}", last.messages[3].text());
    assert!(last.messages[5].text().contains("unknown_uid"), "{}", last.messages[5].text());
    assert_eq!(Task::from_json(&outcome.task().unwrap().to_json()).unwrap(), *outcome.task().unwrap());
}

/// A repair that changed hardly anything is followed by a fresh conversation without the answers.
#[test]
fn a_model_that_repeats_itself_starts_afresh() {
    let is_bare = |answer: &str| answer.trim_start().starts_with('{');
    let (name, answer) = recorded_answers()
        .into_iter()
        .find(|(_, it)| it.expect.as_deref() == Some("valid") && is_bare(&it.response))
        .unwrap();
    let request = answer.request(&name, &catalogue()).unwrap();
    let description = |text: &str| {
        let mut changed: Value = serde_json::from_str(&answer.response).unwrap();
        changed["scene_graph"]["description"] = text.into();
        changed.to_string()
    };
    let flawed = description(genmanip_tasks::answer::DESCRIPTION_PLACEHOLDER);
    let other = "I would like to think about this first, and then again, until I know what to say.".to_owned();
    for (second, messages) in [(flawed.clone(), 2), (other, 6)] {
        let script = Arc::new(ScriptedChat::new([flawed.clone(), second, answer.response.clone()]));
        let designer = Designer::with_model(Shared(Arc::clone(&script)), &LlmSettings::default()).unwrap();
        let outcome = designer.design(&request);
        assert!(outcome.task().is_some(), "{:?}", outcome.refusal());
        let last = script.seen().pop().unwrap();
        assert_eq!(last.messages.len(), messages);
        let asked = last.messages.last().unwrap().text();
        assert_eq!(asked.contains("from the beginning"), messages == 2, "{asked}");
        assert!(asked.contains(if messages == 2 { "placeholder" } else { "no_json" }), "{asked}");
    }
}

/// Half an answer, as a server that reached its limit of tokens gives it.
struct CutOff(Shared);

impl ChatModel for CutOff {
    fn chat(&self, request: &ChatRequest) -> Result<ChatReply, ChatError> {
        Ok(ChatReply { finish_reason: Some("length".into()), ..self.0.chat(request)? })
    }
}

#[test]
fn an_answer_that_was_cut_off_is_not_asked_for_again() {
    let (name, answer) = recorded_answers().into_iter().find(|(_, it)| it.expect.as_deref() == Some("valid")).unwrap();
    let request = answer.request(&name, &catalogue()).unwrap();
    let half = answer.response[..answer.response.len() / 2].to_owned();
    let with_end = format!("{}\nThis scene", answer.response);
    for (response, is_task) in [(half, false), (with_end, true)] {
        let script: Arc<ScriptedChat> = Arc::new(ScriptedChat::new([response, "never asked".into()]));
        let designer = Designer::with_model(CutOff(Shared(Arc::clone(&script))), &LlmSettings::default()).unwrap();
        let outcome = designer.design(&request);
        assert_eq!((outcome.task().is_some(), script.seen().len()), (is_task, 1), "{:?}", outcome.refusal());
        if !is_task {
            assert!(outcome.refusal().unwrap().contains("max_tokens") && outcome.hint().contains("max_tokens"));
        }
    }
}

#[test]
fn rounds_and_quotations_are_bounded() {
    let mut settings = LlmSettings::default();
    settings.generation.max_rounds = 2;
    settings.generation.max_quoted_bytes = 1000;
    let script = Arc::new(ScriptedChat::new(["ä".repeat(400_000), "no".into(), "never asked".into()]));
    let designer = Designer::with_model(Shared(Arc::clone(&script)), &settings).unwrap();
    let outcome = designer.design(&recorded_answers()[0].1.request("x", &catalogue()).unwrap());
    assert!(matches!(outcome.result, Designed::Refused(Refusal::Invalid)));
    assert_eq!(outcome.rounds.len(), 2);
    let quoted = script.seen()[1].messages[2].text();
    assert!(quoted.len() < 1100 && quoted.ends_with("left out here)"), "{} bytes", quoted.len());
    insta::assert_snapshot!(outcome.refusal().unwrap());
}

/// Answers with a valid task of the first offered objects, for any subset.
fn plausible_answer(request: &Value) -> String {
    let text = request["messages"][1]["content"].as_str().unwrap();
    let field = |line: &str, after: &str, until: &str| {
        line.split_once(after).unwrap().1.split_once(until).unwrap().0.to_owned()
    };
    let objects: Vec<(String, String, bool)> = text
        .lines()
        .filter(|line| line.starts_with("- uid "))
        .map(|line| (field(line, "uid \"", "\""), field(line, "\": ", "."), line.contains("picked up: yes")))
        .collect();
    let moved = objects.iter().position(|object| object.2).unwrap();
    let mut order: Vec<usize> = (0..objects.len()).filter(|index| *index != moved).collect();
    order.insert(0, moved);
    let order = &order[..4];
    let edge = |a: usize, position: &str, b: usize| json!({"obj1": objects[a].1, "obj1_uid": objects[a].0, "position": position, "obj2": objects[b].1, "obj2_uid": objects[b].0});
    let mut condition = edge(order[0], "right", order[1]);
    condition["obj1_state"] = "none".into();
    json!({
        "scene_graph": {
            "description": "A row.",
            "edges": [edge(order[0], "left", order[1]), edge(order[2], "right", order[1]), edge(order[3], "right", order[2])],
            "nodes": order.iter().map(|index| json!({"obj_uid": objects[*index].0, "state": "none"})).collect::<Vec<_>>(),
        },
        "instruction": format!("Put the {} to the right of the {}.", objects[order[0]].1, objects[order[1]].1),
        "goal_conditions": [[condition]],
    })
    .to_string()
}

/// One and four workers give the same tasks, and never more open requests than workers.
#[test]
fn generation_does_not_depend_on_the_number_of_workers() {
    let run = |workers: usize| {
        let (open, most) = (Arc::new(AtomicUsize::new(0)), Arc::new(AtomicUsize::new(0)));
        let counts = (Arc::clone(&open), Arc::clone(&most));
        let server = FakeServer::start(move |request| {
            counts.1.fetch_max(counts.0.fetch_add(1, Ordering::SeqCst) + 1, Ordering::SeqCst);
            std::thread::sleep(Duration::from_millis(10));
            counts.0.fetch_sub(1, Ordering::SeqCst);
            Behaviour::Answer(plausible_answer(&request.body))
        })
        .unwrap();
        let mut settings = impatient(server.base_url());
        settings.generation.workers = workers;
        let outcomes = generate(&settings, TaskKind::PickAndPlace, 12, Seed::new(5), &catalogue()).unwrap();
        assert!(most.load(Ordering::SeqCst) <= workers);
        outcomes
    };
    let (one, four) = (run(1), run(4));
    let text = |outcomes: &[GenerationOutcome]| outcomes.iter().map(GenerationOutcome::to_json).collect::<String>();
    assert_eq!(text(&one), text(&four));
    for outcome in &one {
        assert!(outcome.task().is_some(), "{:?}", outcome.refusal());
    }
    let instructions: BTreeSet<&str> = one.iter().map(|outcome| outcome.task().unwrap().instruction.as_str()).collect();
    assert_eq!(instructions.len(), 12);
    let ledger = GenerationOutcome::ledger(&one);
    let usage = &ledger.models["scripted"];
    assert_eq!((usage.answers, usage.requests, usage.prompt_tokens), (12, 12, 1200));
}

/// With one task of each kind, all workers ask at once; news of every round arrives before a task is done.
#[test]
fn all_workers_serve_all_kinds() {
    let (open, most) = (Arc::new(AtomicUsize::new(0)), Arc::new(AtomicUsize::new(0)));
    let counts = (Arc::clone(&open), Arc::clone(&most));
    let server = FakeServer::start(move |_| {
        counts.1.fetch_max(counts.0.fetch_add(1, Ordering::SeqCst) + 1, Ordering::SeqCst);
        std::thread::sleep(Duration::from_millis(100));
        counts.0.fetch_sub(1, Ordering::SeqCst);
        Behaviour::Answer("No.".into())
    })
    .unwrap();
    let mut settings = impatient(server.base_url());
    (settings.generation.workers, settings.generation.max_rounds) = (3, 2);
    let news = Mutex::new(Vec::new());
    let designer = Designer::open(&settings, Seed::new(1)).unwrap();
    let kinds = [TaskKind::PickAndPlace, TaskKind::Spatial, TaskKind::Articulated].map(|kind| (kind, 1));
    let outcomes = designer.generate(&kinds, Seed::new(1), &catalogue(), &|event| {
        let (id, what) = match event {
            GenerationEvent::Asked { id, .. } => (id, "asked"),
            GenerationEvent::Rejected { id, .. } => (id, "rejected"),
            GenerationEvent::Done(outcome) => (outcome.id.as_str(), "done"),
        };
        news.lock().unwrap().push((id.to_owned(), what));
    });
    assert_eq!(outcomes.iter().map(|outcome| outcome.kind).collect::<Vec<_>>(), kinds.map(|(kind, _)| kind));
    assert_eq!(most.load(Ordering::SeqCst), 3);
    for outcome in &outcomes {
        let of: Vec<&str> =
            news.lock().unwrap().iter().filter(|(id, _)| *id == outcome.id).map(|(_, what)| *what).collect();
        assert_eq!(of, ["asked", "rejected", "asked", "rejected", "done"]);
    }
}

#[test]
fn a_dead_server_is_not_asked_for_ever() {
    let server = FakeServer::scripted([]).unwrap();
    let mut settings = impatient(server.base_url());
    settings.generation.workers = 1;
    let heard = Mutex::new(0);
    let designer = Designer::open(&settings, Seed::new(1)).unwrap();
    let outcomes = designer.generate(&[(TaskKind::Spatial, 10)], Seed::new(1), &catalogue(), &|event| {
        *heard.lock().unwrap() += u32::from(matches!(event, GenerationEvent::Done(_)));
    });
    assert_eq!((outcomes.len(), *heard.lock().unwrap()), (10, 10));
    assert!(matches!(outcomes[2].result, Designed::Refused(Refusal::Unanswered { .. })));
    assert!(outcomes[3..].iter().all(|outcome| outcome.result == Designed::Refused(Refusal::NotAsked)));
    assert_eq!(server.seen().len(), 3);
}

/// Over many seeds, the required objects of each kind are offered, and every general category is sampled.
#[test]
fn subsets_suit_the_kind_and_use_the_whole_catalogue() {
    let cards = catalogue();
    let settings = SamplingSettings::default();
    for kind in TaskKind::ALL {
        let mut seen = BTreeSet::new();
        for seed in 0..300 {
            let offered = sample_objects(&cards, kind, &settings, Seed::new(seed)).unwrap();
            let uids: BTreeSet<&str> = offered.iter().map(|card| card.uid.as_str()).collect();
            assert_eq!(uids.len(), settings.offered, "{kind:?} {seed}");
            let movable = |card: &&ObjectCard| card.can_grasp && !card.is_articulated;
            let articulated = offered.iter().filter(|card| card.is_articulated).count();
            if kind == TaskKind::Articulated {
                assert!(articulated > 0);
            } else {
                assert_eq!(articulated, 0);
                assert!(offered.iter().filter(movable).count() >= 2 && offered.iter().any(|card| card.is_container));
            }
            if kind == TaskKind::Appearance {
                let alike =
                    |card: &ObjectCard| offered.iter().filter(|other| other.category == card.category).count() > 1;
                assert!(offered.iter().any(alike), "{seed}");
            }
            let general: BTreeSet<&str> = offered.iter().map(|card| card.general_category.as_str()).collect();
            assert!(general.len() >= 4, "{kind:?} {seed}: {general:?}");
            assert_eq!(offered, sample_objects(&cards, kind, &settings, Seed::new(seed)).unwrap());
            seen.extend(offered.into_iter().map(|card| card.uid));
        }
        let allowed = cards.iter().filter(|card| kind == TaskKind::Articulated || !card.is_articulated).count();
        assert_eq!(seen.len(), allowed, "{kind:?}");
    }
    for (few, part) in [(&cards[..3], "the catalogue has 3"), (&cards[56..64], "states")] {
        let kind = if part == "states" { TaskKind::Spatial } else { TaskKind::Articulated };
        let settings = SamplingSettings { articulated_elsewhere: true, ..SamplingSettings::default() };
        let error = sample_objects(few, kind, &settings, Seed::new(0)).unwrap_err().to_string();
        assert!(error.contains(part) || error.contains("picked up"), "{error}");
    }
}

/// The complete prompt, as a snapshot for review.
#[test]
fn the_prompt() {
    let script = Arc::new(ScriptedChat::new(["-"]));
    let mut settings = LlmSettings::default();
    settings.generation.max_rounds = 1;
    let designer = Designer::with_model(Shared(Arc::clone(&script)), &settings).unwrap();
    designer.design(&recorded_answers()[2].1.request("x", &catalogue()).unwrap());
    let messages = &script.seen()[0].messages;
    assert!(
        messages[0].text().contains(genmanip_tasks::answer::DESCRIPTION_PLACEHOLDER),
        "the prompt gives another one"
    );
    insta::assert_snapshot!(format!("{}\n\n---- user ----\n\n{}", messages[0].text(), messages[1].text()));
}

/// The schema uses only the subset supported by strict servers, and accepts every valid recorded answer.
#[test]
fn the_schema_fits_the_answers() {
    let prompts = PromptSet::load(None).unwrap();
    for (name, answer) in recorded_answers() {
        let asked = prompts.reply_schema(&answer.request(&name, &catalogue()).unwrap());
        let (schema, grammar) = (asked.schema, asked.grammar.unwrap());
        assert_closed(&schema);
        assert_closed(&grammar);
        let text = answer.response.trim().trim_start_matches("```json").split("```").next().unwrap();
        match serde_json::from_str::<Value>(text) {
            Ok(value) if answer.expect.as_deref() == Some("valid") => {
                assert_eq!(conflict(&schema, &value, "$"), None, "{name}");
                assert_eq!(conflict(&grammar, &value, "$"), None, "{name}");
            }
            Ok(value) if answer.expect.as_deref() == Some("not_graspable") => {
                assert_eq!(conflict(&schema, &value, "$"), None, "{name}");
                assert!(conflict(&grammar, &value, "$").is_some(), "{name}");
            }
            Ok(value) if answer.expect.as_deref() == Some("unknown_uid") => {
                assert!(conflict(&schema, &value, "$").is_some(), "{name}");
            }
            _ => {}
        }
    }
}

fn assert_closed(schema: &Value) {
    if schema["type"] == "object" {
        let names: Vec<&String> = schema["properties"].as_object().unwrap().keys().collect();
        assert_eq!(serde_json::to_value(names).unwrap(), schema["required"]);
        assert_eq!(schema["additionalProperties"], false);
    }
    match schema {
        Value::Object(fields) => fields.values().for_each(assert_closed),
        Value::Array(items) => items.iter().for_each(assert_closed),
        Value::String(text) => assert!(!text.contains("{{"), "{text}"),
        _ => {}
    }
}

fn conflict(schema: &Value, value: &Value, path: &str) -> Option<String> {
    if let Some(shapes) = schema["anyOf"].as_array() {
        let conflicts: Option<Vec<String>> = shapes.iter().map(|shape| conflict(shape, value, path)).collect();
        return conflicts.map(|conflicts| format!("{path}: no shape fits, {}", conflicts.join("; ")));
    }
    match (schema["type"].as_str().unwrap(), value) {
        ("object", Value::Object(fields)) => {
            let properties = schema["properties"].as_object().unwrap();
            let unknown = fields.keys().find(|name| !properties.contains_key(*name));
            unknown.map(|name| format!("{path}.{name} unknown")).or_else(|| {
                properties.iter().find_map(|(name, schema)| match fields.get(name) {
                    Some(value) => conflict(schema, value, &format!("{path}.{name}")),
                    None => Some(format!("{path}.{name} missing")),
                })
            })
        }
        ("array", Value::Array(items))
            if schema["minItems"].as_u64().is_some_and(|least| (items.len() as u64) < least)
                || schema["maxItems"].as_u64().is_some_and(|most| items.len() as u64 > most) =>
        {
            Some(format!("{path}: {} items", items.len()))
        }
        ("array", Value::Array(items)) => {
            items.iter().find_map(|item| conflict(&schema["items"], item, &format!("{path}[]")))
        }
        ("string", Value::String(_)) => match schema.get("enum") {
            Some(allowed) if !allowed.as_array().unwrap().contains(value) => Some(format!("{path}: {value}")),
            _ => None,
        },
        (expected, value) => Some(format!("{path}: {value} is no {expected}")),
    }
}

/// Lets a test inspect the script after passing it on.
pub struct Shared(pub Arc<ScriptedChat>);

impl ChatModel for Shared {
    fn chat(&self, request: &ChatRequest) -> Result<ChatReply, ChatError> {
        self.0.chat(request)
    }
}
