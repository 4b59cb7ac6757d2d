use std::collections::BTreeSet;

use genmanip_core::{NamedSurface, TaskKind};
use genmanip_task_writer::{Prompt, PromptSet};
use genmanip_tasks::answer::TaskRequest;

use crate::catalogue;

const FOLDER: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/prompts");

/// Every file in the folder is a used prompt with a unique name, a version and a text.
#[test]
fn every_prompt_file_is_used() {
    let set = PromptSet::load(None).unwrap();
    let kinds = TaskKind::ALL.map(|kind| (format!("kind_{}.md", kind.name()), set.kinds.of(kind)));
    let others = [
        ("system.md", &set.system),
        ("request.md", &set.request),
        ("repair.md", &set.repair),
        ("restart.md", &set.restart),
    ];
    let prompts: Vec<(String, &Prompt)> =
        kinds.into_iter().chain(others.map(|(file, prompt)| (file.to_owned(), prompt))).collect();
    for (file, prompt) in &prompts {
        let text = std::fs::read_to_string(format!("{FOLDER}/{file}")).unwrap();
        assert!(!prompt.text.trim().is_empty() && text.trim_end().ends_with(&prompt.text), "{file}");
        assert!(prompt.head.version >= 1 && prompt.head.id.starts_with("tosg."), "{file}: {:?}", prompt.head);
    }
    let ids: BTreeSet<&str> = prompts.iter().map(|(_, prompt)| prompt.head.id.as_str()).collect();
    assert_eq!(ids.len(), prompts.len());
    let texts: BTreeSet<&str> = prompts.iter().map(|(_, prompt)| prompt.text.as_str()).collect();
    assert_eq!(texts.len(), prompts.len());

    let used = prompts.iter().map(|(file, _)| file.clone()).chain(set.request.head.output_schema.clone()).collect();
    let files: BTreeSet<String> = std::fs::read_dir(FOLDER)
        .unwrap()
        .map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned())
        .collect();
    assert_eq!(files, used);
}

/// Rendered prompts contain every given value and no placeholder.
#[test]
fn all_placeholders_are_filled() {
    let set = PromptSet::load(None).unwrap();
    let cards = catalogue();
    let check = |text: String, values: &[&str]| {
        assert!(!text.contains("{{") && !text.contains("}}"), "{text}");
        for value in values {
            assert!(text.contains(value), "expected {value:?} in {text}");
        }
    };
    check(set.system_text(123_456), &["at most 123456 words"]);
    check(set.repair_text("- the mug flies"), &["- the mug flies"]);
    check(set.restart_text("- the mug sings"), &["- the mug sings"]);
    for kind in TaskKind::ALL {
        let kind_text = &set.kinds.of(kind).text;
        let surface = NamedSurface { id: "side_table".into(), name: "side table".into() };
        let request = TaskRequest {
            id: "any".into(),
            kind,
            offered: cards[..2].to_vec(),
            surfaces: vec![surface],
            min_objects: 123_456,
            between: false,
            source: "test".into(),
        };
        let text = set.request_text(&request);
        check(text, &["at least 123456 of", kind_text, &cards[1].description, "uid \"side_table\": side table."]);
        let ids: Vec<String> = set.stamps(kind).into_iter().map(|stamp| stamp.id).collect();
        let kind_id = format!("tosg.kind.{}", kind.name());
        assert_eq!(ids, ["tosg.system", "tosg.request", kind_id.as_str(), "tosg.repair", "tosg.restart"]);
    }
}

/// A folder with a missing schema or an empty file is rejected; nothing becomes an empty prompt.
#[test]
fn files_that_say_nothing_are_refused() {
    let request = std::fs::read_to_string(format!("{FOLDER}/request.md")).unwrap();
    let kind = "+++\nid = \"mine\"\nversion = 1\ninputs = []\n+++\n";
    for (file, text, expected) in [
        ("request.md", request.replace("tosg_answer.schema", "mine.schema"), "no such file: mine.schema.json"),
        ("kind_spatial.md", String::new(), "the first line is not `+++`: kind_spatial.md"),
        ("kind_spatial.md", format!("{kind}\n \n"), "the prompt text is empty: kind_spatial.md"),
        ("kind_spatial.md", format!("{kind}x").replace("mine", " "), "`id` must be a name"),
        ("kind_spatial.md", format!("{kind}x").replace("= 1", "= 0"), "`version` at least 1"),
    ] {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join(file), text).unwrap();
        let error = PromptSet::load(Some(folder.path())).unwrap_err().to_string();
        assert!(error.contains(expected), "{error}");
    }
}
