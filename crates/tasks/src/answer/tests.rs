use genmanip_core::{ObjectCard, TaskKind};
use proptest::prelude::*;
use serde_json::{Value, json};

use super::*;

pub(super) fn catalogue() -> Vec<ObjectCard> {
    genmanip_assets::Catalogue::builtin().cards().to_vec()
}

pub(super) fn recorded() -> Vec<(String, RecordedAnswer)> {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/testdata/responses");
    let mut files: Vec<_> = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    files.sort();
    files
        .iter()
        .map(|path| {
            let name = path.file_stem().unwrap().to_string_lossy().into_owned();
            (name, RecordedAnswer::from_json(&std::fs::read_to_string(path).unwrap()).unwrap())
        })
        .collect()
}

/// A valid answer with mug 001, plate 008, apple 027, tumbler 004 and cabinet 057.
fn valid_answer() -> Value {
    json!({
        "instruction": "Do what the conditions say.",
        "goal_conditions": [[condition("027", "none", "top", "008")]],
        "scene_graph": {
            "description": "A mug in the middle.",
            "edges": [edge("027", "left", "001"), edge("008", "right", "001"), edge("004", "front", "001")],
            "nodes": [node("027", "none"), node("001", "none"), node("008", "none"), node("004", "none")],
        }
    })
}

fn condition(subject: &str, state: &str, position: &str, reference: &str) -> Value {
    json!({"obj1": "none", "obj1_uid": subject, "obj1_state": state,
           "obj2": "none", "obj2_uid": reference, "position": position})
}

fn edge(subject: &str, position: &str, reference: &str) -> Value {
    json!({"obj1": "none", "obj1_uid": subject, "position": position, "obj2": "none", "obj2_uid": reference})
}

fn node(uid: &str, state: &str) -> Value {
    json!({"obj_uid": uid, "state": state})
}

fn request(kind: TaskKind) -> TaskRequest {
    let uids = ["001", "002", "008", "027", "004", "057", "006"];
    let cards = catalogue();
    TaskRequest {
        id: "test".into(),
        kind,
        offered: uids.iter().map(|uid| cards.iter().find(|card| card.uid == *uid).unwrap().clone()).collect(),
        surfaces: Vec::new(),
        min_objects: 3,
        between: false,
        source: "test".into(),
    }
}

/// Flaws as `kind` if rejecting, `~kind` if repaired.
fn flaws(report: &AnswerReport) -> Vec<String> {
    let mark = |flaw: &Flaw| if flaw.repaired { "~" } else { "" };
    let mut names: Vec<String> =
        report.flaws.iter().map(|flaw| format!("{}{}", mark(flaw), flaw.kind.name())).collect();
    names.dedup();
    names
}

fn check_text(raw: &str, kind: TaskKind, expected: &[&str]) -> AnswerReport {
    let report = check_answer(raw, &request(kind));
    assert_eq!(flaws(&report), expected, "{}\n{:#?}", raw.chars().take(300).collect::<String>(), report.flaws);
    assert_eq!(report.task.is_some(), report.verdict != Verdict::Rejected);
    report
}

/// Changes a valid answer and compares the flaws.
fn check(change: impl FnOnce(&mut Value), expected: &[&str]) -> AnswerReport {
    check_kind(TaskKind::PickAndPlace, change, expected)
}

fn check_kind(kind: TaskKind, change: impl FnOnce(&mut Value), expected: &[&str]) -> AnswerReport {
    let mut answer = valid_answer();
    change(&mut answer);
    check_text(&answer.to_string(), kind, expected)
}

fn push(list: &mut Value, item: Value) {
    list.as_array_mut().unwrap().push(item);
}

#[test]
fn recorded_answers_get_the_expected_verdicts() {
    let cards = catalogue();
    let mut counts = [0; 3];
    for (name, recorded) in recorded() {
        let report = check_answer(&recorded.response, &recorded.request(&name, &cards).unwrap());
        let expect = recorded.expect.as_deref().unwrap();
        counts[report.verdict as usize] += 1;
        let kinds: Vec<String> = report.flaws.iter().map(|flaw| flaw.kind.name()).collect();
        match expect {
            "valid" => assert_eq!((report.verdict, kinds), (Verdict::Valid, vec![]), "{name}"),
            "flat_dnf" | "sloppy_json" => {
                assert_eq!(report.verdict, Verdict::Repaired, "{name}: {:?}", report.flaws);
                assert!(kinds.iter().all(|kind| kind == expect), "{name}: {kinds:?}");
                assert!(!report.repairs.is_empty());
            }
            _ => assert_eq!((report.verdict, kinds), (Verdict::Rejected, vec![expect.to_owned()]), "{name}"),
        }
        assert_eq!(report.task.is_some(), report.verdict != Verdict::Rejected, "{name}");
    }
    assert_eq!(counts, [20, 2, 8], "valid, repaired, rejected");
}

/// Answers of small language models, with the flaws that a careful reader names; none of them means one task.
#[test]
fn answers_of_real_models_are_read_carefully() {
    let text = include_str!("../../testdata/real_answers.json");
    let exchanges: Vec<Value> = serde_json::from_str(text).unwrap();
    let cards = catalogue();
    assert_eq!(exchanges.len(), 16);
    for mut exchange in exchanges {
        let fields = exchange.as_object_mut().unwrap();
        let [name, expect] = ["name", "expect"].map(|key| fields.remove(key).unwrap());
        fields.retain(|key, _| ["task_type", "objects", "num_objects", "response"].contains(&key.as_str()));
        let recorded: RecordedAnswer = serde_json::from_value(exchange).unwrap();
        let report = check_answer(&recorded.response, &recorded.request("real", &cards).unwrap());
        let mut found: Vec<String> =
            report.flaws.iter().filter(|flaw| !flaw.repaired).map(|flaw| flaw.kind.name()).collect();
        found.sort();
        found.dedup();
        assert_eq!(json!(found), expect, "{name}: {:#?}", report.flaws);
        assert_eq!(report.verdict, Verdict::Rejected, "{name}");
    }
}

#[test]
fn every_prefix_of_every_recorded_answer_is_rejected() {
    let cards = catalogue();
    for (name, recorded) in recorded().iter().filter(|(_, recorded)| recorded.expect.as_deref() == Some("valid")) {
        let text = &recorded.response;
        let open = text.find('{').unwrap();
        let close = text.rfind('}').unwrap();
        let request = recorded.request(name, &cards).unwrap();
        for end in (open + 1..=close).step_by(7).filter(|&end| text.is_char_boundary(end)) {
            let report = check_answer(&text[..end], &request);
            assert_eq!(flaws(&report), ["truncated_json"], "{name} cut at {end}");
        }
    }
}

#[test]
fn surrounding_text_and_lenient_syntax() {
    let plain = valid_answer().to_string();
    let valid = |raw: String| check_text(&raw, TaskKind::PickAndPlace, &[]);
    valid(plain.clone());
    valid(format!("Sure {{smile}}!\n```json\n{plain}\n```\nAnything else?"));
    valid(format!("```{plain}```"));
    valid(format!("The set {{a, b}} is used.\n\n{plain}"));
    valid(format!("{plain}\n{plain}"));
    valid(format!("```JSON\n[{plain}]\n```"));
    valid(json!(plain).to_string());
    let sloppy = |raw: String| check_text(&raw, TaskKind::PickAndPlace, &["~sloppy_json"]);
    sloppy(plain.replace('"', "'"));
    sloppy(plain.replace("]}", ",]}").replace("}}", ",}/* end */}"));
    sloppy(plain.replace("\"nodes\"", "nodes"));
    sloppy(plain.replacen("middle.", "middle.\nOn the table.", 1));
    sloppy(format!("```\n// the task\n{}\n```", plain.replacen('{', "{ # task\n", 1)));
    let check_raw = |raw: &str, expected: &[&str]| check_text(raw, TaskKind::PickAndPlace, expected);
    check_raw(&format!("{{\"task\": {plain}}}"), &["~wrong_nesting"]);
    check_raw(&json!({"task": plain}).to_string(), &["~sloppy_json", "~wrong_nesting"]);
    check_raw(&format!("```json\n{}\n```", &plain[..plain.len() - 30]), &["truncated_json"]);
    check_raw("", &["no_json"]);
    check_raw("{}", &["missing_field"]);
    check_raw("{a b} {{}", &["malformed_json"]);
    check_raw(&"{\"a\":".repeat(100_000), &["too_large"]);
    check_raw(&"[".repeat(100_000), &["no_json"]);
    check_raw(&plain.replacen("\"nodes\"", "\"edges\"", 1), &["duplicate_key"]);
    check_raw(&format!("{plain}\n{}", plain.replace("027", "001")), &["several_answers"]);
    check_raw(&" ".repeat(MAX_ANSWER_BYTES + 1), &["too_large"]);
    check_raw(
        r#"{"instruction": 3, "goal_conditions": {}, "scene_graph": []}"#,
        &["wrong_type", "~flat_dnf", "~missing_field"],
    );
}

#[test]
fn shape_of_the_answer() {
    check(|answer| answer["goal_conditions"] = answer["goal_conditions"][0].clone(), &["~flat_dnf"]);
    check(|answer| answer["goal_conditions"] = answer["goal_conditions"][0][0].clone(), &["~flat_dnf"]);
    check(|answer| answer["goal_conditions"] = json!([answer["goal_conditions"].clone()]), &["~wrong_nesting"]);
    check(|answer| answer["goal_conditions"] = json!([]), &["empty_goal"]);
    check(|answer| push(&mut answer["goal_conditions"], json!([])), &["empty_goal"]);
    check(|answer| push(&mut answer["goal_conditions"], condition("001", "none", "left", "008")), &["wrong_type"]);
    check(|answer| answer["reasoning"] = json!("because"), &["~unknown_field"]);
    check(|answer| answer["instruction"] = json!("  "), &["empty_instruction"]);
    check(|answer| answer["instruction"] = json!("word ".repeat(30)), &[]);
    check(|answer| answer["instruction"] = json!("word ".repeat(31)), &["instruction_too_long"]);
    let lifted = |answer: &mut Value| {
        let graph = answer.as_object_mut().unwrap().remove("scene_graph").unwrap();
        answer.as_object_mut().unwrap().extend(graph.as_object().unwrap().clone());
    };
    check(lifted, &["~wrong_nesting"]);
    let without_obj2 = |answer: &mut Value| {
        answer["goal_conditions"][0][0].as_object_mut().unwrap().remove("obj2");
    };
    check(without_obj2, &["~missing_field"]);
}

#[test]
fn names_uids_and_words() {
    let goal = |key: &'static str, value: &'static str| {
        move |answer: &mut Value| answer["goal_conditions"][0][0][key] = json!(value)
    };
    check(goal("obj1_uid", "070"), &["unknown_uid"]);
    check(goal("obj1_uid", "003"), &["unknown_uid"]);
    check(goal("obj1_uid", "27"), &["~uid_spelling"]);
    check(goal("obj1_uid", "O27"), &["~uid_spelling"]);
    check(|answer| answer["goal_conditions"][0][0]["obj1_uid"] = json!(27), &["~uid_spelling"]);
    check(goal("obj1", "red apple"), &[]);
    check(goal("obj1", "Fruit"), &[]);
    check(goal("obj1", "Red Mug"), &["uid_name_mismatch"]);
    check(goal("obj1", "red mug"), &["uid_name_mismatch"]);
    check(goal("position", "on top of"), &["~relation_spelling"]);
    check(goal("position", "behind"), &["~relation_spelling"]);
    check(goal("position", "above"), &["unknown_relation"]);
    check(goal("position", "none"), &["incomplete_condition"]);
    check(goal("obj2_uid", "none"), &["incomplete_condition"]);
    check(goal("obj2_uid", "table"), &["goal_on_table"]);
    check(goal("obj1_state", "open"), &["unknown_state"]);
    let named_only = |answer: &mut Value| {
        answer["goal_conditions"][0][0]["obj1"] = json!("Red Apple");
        answer["goal_conditions"][0][0]["obj1_uid"] = json!("none");
    };
    check(named_only, &["~missing_uid"]);
}

#[test]
fn the_initial_graph() {
    let add_edge = |edge: Value| move |answer: &mut Value| push(&mut answer["scene_graph"]["edges"], edge);
    let add_node = |node: Value| move |answer: &mut Value| push(&mut answer["scene_graph"]["nodes"], node);
    let replace_edge = |edge: Value| move |answer: &mut Value| answer["scene_graph"]["edges"][2] = edge;
    // Drop the edge if the object has another one; otherwise its place is unknown.
    check(add_edge(edge("004", "left", "none")), &["~missing_edge_object"]);
    check(replace_edge(edge("004", "left", "none")), &["~missing_edge_object", "isolated_object"]);
    // "On the table" is a place, even if it is the only information about an object.
    check(add_edge(edge("004", "top", "table")), &["~edge_on_table"]);
    let report = check(replace_edge(edge("004", "top", "table")), &["~edge_on_table"]);
    assert_eq!(report.task.unwrap().scene_graph.edges.len(), 2);
    let named_table =
        json!({"obj1": "none", "obj1_uid": "004", "position": "top", "obj2": "Table", "obj2_uid": "none"});
    check(add_edge(named_table), &["~edge_on_table"]);
    check(add_edge(edge("001", "right", "027")), &[]);
    check(add_edge(edge("001", "left", "027")), &["contradictory_edges"]);
    check(add_edge(edge("027", "right", "001")), &["contradictory_edges"]);
    check(add_edge(edge("008", "left", "027")), &["contradictory_edges"]);
    check(add_edge(edge("027", "front", "001")), &["contradictory_edges"]);
    check(add_edge(edge("027", "top", "001")), &["contradictory_edges"]);
    check(add_edge(edge("027", "near", "001")), &[]);
    check(add_edge(edge("001", "left", "001")), &["self_relation"]);
    check(add_edge(edge("004", "in", "027")), &["not_a_container"]);
    check(add_edge(edge("004", "none", "027")), &["missing_relation"]);
    check(add_edge(edge("002", "left", "027")), &["~missing_node"]);
    check(add_edge(edge("057", "left", "027")), &["missing_node"]);
    check(add_node(node("002", "none")), &["isolated_object"]);
    check(add_node(node("001", "none")), &["~duplicate_node"]);
    check(add_node(node("057", "ajar")), &["unknown_state", "isolated_object"]);
    check(
        |answer: &mut Value| {
            push(&mut answer["scene_graph"]["edges"], edge("002", "top", "008"));
            push(&mut answer["scene_graph"]["edges"], edge("002", "top", "001"));
            push(&mut answer["scene_graph"]["nodes"], node("002", "none"));
        },
        &["two_supports"],
    );
    let placeholder = |answer: &mut Value| answer["scene_graph"]["description"] = json!(DESCRIPTION_PLACEHOLDER);
    check(placeholder, &["placeholder"]);
    let too_few = |answer: &mut Value| {
        answer["scene_graph"]["edges"] = json!([edge("027", "left", "008")]);
        answer["scene_graph"]["nodes"] = json!([node("027", "none"), node("008", "none")]);
    };
    check(too_few, &["too_few_objects"]);
}

#[test]
fn the_goal() {
    let goal = |alternatives: Value| move |answer: &mut Value| answer["goal_conditions"] = alternatives;
    let relation = |subject: &str, position: &str, reference: &str| condition(subject, "none", position, reference);
    let already = &["goal_already_satisfied"];
    check(goal(json!([[relation("027", "left", "001")]])), already);
    check(goal(json!([[relation("027", "near", "001")]])), already);
    check(goal(json!([[relation("001", "left", "027")], [relation("027", "left", "001")]])), already);
    check(goal(json!([[relation("001", "right", "027")]])), &["circular_goal"]);
    check(goal(json!([[relation("001", "near", "027")]])), &["circular_goal"]);
    check(goal(json!([[relation("001", "left", "027")]])), &[]);
    check(goal(json!([[relation("027", "left", "001"), relation("027", "left", "004")]])), &[]);
    check(goal(json!([[relation("008", "left", "001")]])), &["not_graspable"]);
    let opposite = json!([[relation("027", "left", "001"), relation("027", "right", "001")]]);
    check(goal(opposite), &["contradictory_goal"]);
    check(goal(json!([[relation("027", "top", "002")]])), &["missing_node"]);
    check(goal(json!([[relation("027", "left", "027")]])), &["self_relation"]);
    // A contradictory graph hides its implications, but not flaws of the goal itself.
    let both = |answer: &mut Value| {
        answer["goal_conditions"] = json!([[relation("027", "left", "001")], [relation("008", "left", "004")]]);
        push(&mut answer["scene_graph"]["edges"], edge("001", "left", "027"));
    };
    check(both, &["contradictory_edges", "not_graspable"]);
}

#[test]
fn states_and_kinds() {
    let cabinet = |state: &'static str, goal: Value| {
        move |answer: &mut Value| {
            push(&mut answer["scene_graph"]["edges"], edge("057", "back", "001"));
            push(&mut answer["scene_graph"]["nodes"], node("057", state));
            answer["goal_conditions"] = goal;
        }
    };
    let state = |state: &str| condition("057", state, "none", "none");
    let articulated = TaskKind::Articulated;
    check_kind(articulated, cabinet("closed", json!([[state("top_open")]])), &[]);
    check_kind(articulated, cabinet("closed", json!([[state("Top Open")]])), &["~state_spelling"]);
    check_kind(articulated, cabinet("closed", json!([[state("half_open")]])), &["unknown_state"]);
    check_kind(articulated, cabinet("closed", json!([[state("closed")]])), &["goal_already_satisfied"]);
    check_kind(articulated, cabinet("none", json!([[state("closed")]])), &["missing_state"]);
    let two = json!([[state("top_open"), state("bottom_open")]]);
    check_kind(articulated, cabinet("closed", two), &["contradictory_goal"]);
    check_kind(articulated, |_| {}, &["wrong_kind"]);
    check(cabinet("closed", json!([[state("top_open")]])), &["wrong_kind"]);
    check_kind(TaskKind::LongHorizon, |_| {}, &["wrong_kind"]);
    let beside = |word: &str| json!([[state("top_open"), condition("057", word, "left", "001")]]);
    check_kind(articulated, cabinet("closed", beside("closed")), &["not_graspable"]);
    check_kind(articulated, cabinet("closed", beside("top_open")), &["mixed_condition", "not_graspable"]);
}

/// `genmanip-lab answers` measures their speed.
#[test]
fn worst_cases_are_rejected() {
    for (name, text) in hostile::worst_cases() {
        assert!(text.len() <= MAX_ANSWER_BYTES + 1, "{name}: {}", text.len());
        let request = request(TaskKind::Spatial);
        let report = check_answer(&text, &request);
        assert_eq!(report.verdict, Verdict::Rejected, "{name}");
        assert_eq!(hostile::inconsistency(&text, &request, &report), None, "{name}");
    }
}

#[test]
fn fuzzed_answers_get_consistent_reports() {
    let cards = catalogue();
    let recorded = recorded();
    let corpus = recorded.iter().map(|(_, answer)| answer.response.clone()).collect();
    let mut fuzzer = hostile::Fuzzer::new(corpus, genmanip_core::Seed::new(1));
    let requests: Vec<TaskRequest> =
        recorded.iter().map(|(name, answer)| answer.request(name, &cards).unwrap()).collect();
    let mut taken = 0;
    for _ in 0..6000 {
        let (origin, text) = fuzzer.text();
        let request = &requests[origin];
        let report = check_answer(&text, request);
        assert_eq!(hostile::inconsistency(&text, request, &report), None, "{text:?}\n{report:#?}");
        taken += usize::from(report.task.is_some());
        fuzzer.learn(origin, &text, &report);
    }
    assert!(taken > 20 && fuzzer.kept() > 100, "{taken} taken, {} kept", fuzzer.kept());
}

proptest! {
    #[test]
    fn never_panics_on_garbage(bytes in prop::collection::vec(any::<u8>(), 0..400)) {
        check_answer(&String::from_utf8_lossy(&bytes), &request(TaskKind::Spatial));
    }

    #[test]
    fn never_panics_on_json_like_text(text in "[{}\\[\\]\",:'/*# a-z0-9\\\\u\\n-]{0,200}") {
        check_answer(&text, &request(TaskKind::Spatial));
    }

    /// A mutated answer is rejected, or gives a task that satisfies every rule.
    #[test]
    fn mutations_are_caught_or_harmless(
        which in 0..30usize,
        edits in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>(), 0..4u8), 1..6),
    ) {
        let cards = catalogue();
        let (name, recorded) = &recorded()[which];
        let mut bytes = recorded.response.clone().into_bytes();
        for (at, byte, edit) in edits {
            let at = at.index(bytes.len());
            match edit {
                0 => { bytes.remove(at); }
                1 => bytes.insert(at, byte % 128),
                2 => bytes[at] = b"{}[]\",:'0123456789 /"[usize::from(byte) % 20],
                _ => { let end = (at + usize::from(byte)).min(bytes.len()); bytes.drain(at..end); }
            }
            if bytes.is_empty() { return Ok(()); }
        }
        let request = recorded.request(name, &cards).unwrap();
        let report = check_answer(&String::from_utf8_lossy(&bytes), &request);
        if let Some(task) = &report.task {
            prop_assert!(task.instruction.split_whitespace().count() <= 30);
            prop_assert!(task.scene_graph.nodes.len() >= request.min_objects);
            prop_assert_eq!(task.objects.len(), task.scene_graph.nodes.len());
            prop_assert!(task.goal.alternatives.iter().all(|alternative| !alternative.is_empty()));
        }
    }
}

/// `between` is an option: if off, it is not a position of the format; if on, it takes a third object.
#[test]
fn between_is_an_option_of_the_request() {
    let goal = |third: Value| {
        let mut condition = condition("027", "none", "between", "001");
        condition["obj3"] = "none".into();
        condition["obj3_uid"] = third;
        condition
    };
    let check = |condition: Value, between: bool| {
        let mut answer = valid_answer();
        answer["goal_conditions"] = json!([[condition]]);
        let request = TaskRequest { between, ..request(TaskKind::PickAndPlace) };
        check_answer(&answer.to_string(), &request)
    };
    assert!(flaws(&check(goal("008".into()), false)).contains(&"unknown_relation".into()));
    let report = check(goal("008".into()), true);
    assert_eq!(report.verdict, Verdict::Valid, "{:?}", report.flaws);
    let atom = &report.task.unwrap().goal.alternatives[0][0];
    assert_eq!(atom.to_string(), "027 between 001 and 008");
    assert_eq!(flaws(&check(goal("none".into()), true)), ["incomplete_condition"]);
    assert_eq!(flaws(&check(goal("001".into()), true)), ["self_relation"]);
    assert_eq!(flaws(&check(goal("099".into()), true)), ["unknown_uid"]);
}

/// A second apple is offered as `027#2`; the instruction does not specify which of the two is meant.
#[test]
fn instances_are_offered_and_identified_by_number() {
    let offered = || {
        let mut request = request(TaskKind::PickAndPlace);
        request.offered.push(request.offered[3].clone());
        request
    };
    assert_eq!(offered().ids(), ["001", "002", "008", "027", "004", "057", "006", "027#2"]);
    let answer = |subject: &str, edges: [Value; 3], nodes: &[&str]| {
        let mut answer = valid_answer();
        answer["instruction"] = json!("Put the red apple on the plate.");
        answer["goal_conditions"] = json!([[condition(subject, "none", "top", "008")]]);
        answer["scene_graph"]["edges"] = json!(edges);
        answer["scene_graph"]["nodes"] = nodes.iter().map(|uid| node(uid, "none")).collect();
        answer
    };
    let both = ["027", "027#2", "001", "008"];
    let apart = || [edge("027", "left", "001"), edge("027#2", "front", "001"), edge("008", "right", "001")];
    let on_plate = || [edge("027", "on", "008"), edge("027#2", "front", "001"), edge("008", "right", "001")];
    let alone = || [edge("027#2", "left", "001"), edge("008", "right", "001"), edge("004", "front", "001")];
    for (answer, expected, goal, ids) in [
        (answer("027#2", apart(), &both), &[][..], "027#2 top 008", "027 027#2 001 008"),
        (answer("27#2", apart(), &both), &["~uid_spelling"], "027#2 top 008", "027 027#2 001 008"),
        (answer("027#3", apart(), &both), &["unknown_uid"], "", ""),
        (answer("027#2", on_plate(), &both), &["goal_already_satisfied"], "", ""),
        (answer("027#2", alone(), &["027#2", "001", "008", "004"]), &[], "027 top 008", "027 001 008 004"),
    ] {
        let report = check_answer(&answer.to_string(), &offered());
        assert_eq!(flaws(&report), expected, "{:#?}", report.flaws);
        let Some(task) = report.task else { continue };
        let nodes: Vec<&str> = task.scene_graph.nodes.iter().map(|node| node.id.as_str()).collect();
        assert_eq!((task.goal.alternatives[0][0].to_string(), nodes.join(" ")), (goal.to_owned(), ids.to_owned()));
        let open = if ids.contains('#') { vec![["027", "027#2"].as_slice()] } else { Vec::new() };
        assert_eq!(task.interchangeable, open);
    }
}

#[test]
fn objects_may_be_on_or_near_a_fixed_surface() {
    let surface = genmanip_core::NamedSurface { id: "side_table".into(), name: "side table".into() };
    let request = TaskRequest { surfaces: vec![surface.clone()], ..request(TaskKind::PickAndPlace) };
    let check = |change: &dyn Fn(&mut Value), expected: &[&str]| {
        let mut answer = valid_answer();
        change(&mut answer);
        let report = check_answer(&answer.to_string(), &request);
        assert_eq!(flaws(&report), expected, "{:#?}", report.flaws);
        report.task
    };
    let goal = |atom: Value| move |answer: &mut Value| answer["goal_conditions"] = json!([[atom]]);
    let task = check(&goal(condition("027", "none", "top", "side_table")), &[]).unwrap();
    assert_eq!((task.surfaces.as_slice(), task.scene_graph.nodes.len()), ([surface].as_slice(), 4));
    assert_eq!(task.name_of(&"side_table".into()), "side table");
    assert!(check(&|_| (), &[]).unwrap().surfaces.is_empty(), "surfaces not named by the task are omitted");
    check(&goal(condition("027", "none", "near", "side_table")), &[]);
    check(&|answer| push(&mut answer["scene_graph"]["edges"], edge("004", "on", "side_table")), &[]);
    check(&|answer| push(&mut answer["scene_graph"]["nodes"], node("side_table", "none")), &["~edge_on_table"]);
    check(&goal(condition("027", "none", "left", "side_table")), &["unknown_relation"]);
    check(&goal(condition("027", "none", "in", "side_table")), &["unknown_relation"]);
    check(&goal(condition("side_table", "none", "near", "027")), &["not_graspable"]);
    check(
        &|answer| {
            answer["scene_graph"]["edges"][2] = edge("004", "top", "side_table");
            answer["goal_conditions"] = json!([[condition("004", "none", "on", "side_table")]]);
        },
        &["goal_already_satisfied"],
    );
}
