//! Ten tabs of one studio: each gets every edit, job and presence, and leaving ones leave nothing behind.

use serde_json::{Value, json};

use crate::client::{Studio, Tab};

const TABS: usize = 10;

#[test]
fn ten_tabs_answer() {
    let studio = Studio::new();
    let name = |index: usize| format!("tab {index}");
    let mut tabs: Vec<Tab> = (0..TABS).map(|index| studio.tab(&name(index))).collect();
    let all: Vec<String> = (0..TABS).map(name).collect();
    for tab in &mut tabs {
        tab.find(|message| message["type"] == "presence" && message["authors"] == json!(all));
    }
    // Each edits in turn; all others get it with its revision and author, in the same order.
    let objects = studio.scenario().objects.len();
    let mut states: Vec<Value> = Vec::new();
    for index in 0..TABS {
        let id = format!("edit {index}");
        tabs[index].command(&studio.shift(index % objects, 0.0005, index as u64, &id, &name(index)));
        states.clear();
        for tab in &mut tabs {
            let applied = tab.next("applied");
            assert_eq!(
                (&applied["author"], &applied["client_operation_id"], &applied["state"]["revision"]),
                (&json!(name(index)), &json!(id), &json!(index + 1)),
                "{}",
                tab.author
            );
            states.push(applied["state"]["objects"].clone());
        }
    }
    for tab in &mut tabs {
        tab.find(|message| {
            message["type"] == "verdict" && message["revision"] == json!(TABS) && message["done"] == true
        });
    }
    assert!(states.iter().all(|state| *state == states[0]), "all tabs show the same objects");
    // The job of one tab is told to all.
    let run = studio.post(&studio.scenario_path("/run"), &json!({ "policy": "do_nothing:seconds=1" }));
    assert_eq!(run.status, 200, "{}", run.text());
    for tab in &mut tabs {
        tab.find(|message| message["type"] == "run" && message["run"]["state"] == "done");
    }
    // The last one alone.
    let mut last = tabs.pop().unwrap();
    drop(tabs);
    last.find(|message| message["type"] == "presence" && message["authors"] == json!([last_name()]));
}

fn last_name() -> String {
    format!("tab {}", TABS - 1)
}
