//! Scratch: reads sentences from a file, prints goals.
use genmanip_assets::worlds::default_world;
use genmanip_assets::{Catalogue, GraspLibrary, panda};
use genmanip_core::{Atom, ReferenceId, Seed, Task};
use genmanip_layout::{LayoutSettings, lay_out};
use genmanip_motion::{Planner, PlannerSettings};
use genmanip_tasks::designer::{DesignSettings, task_from_sentence};

fn goal_of(task: &Task, names: bool) -> String {
    let kind = |id: &ReferenceId| {
        task.card(id)
            .map_or_else(|| id.to_string(), |card| if names { card.name.clone() } else { card.category.clone() })
    };
    let atom = |atom: &Atom| match atom {
        Atom::Relation { subject, relation, reference, second_reference } => {
            let second = second_reference.iter().map(|id| format!(" {}", kind(id))).collect::<String>();
            format!("{} {} {}{second}", kind(subject), relation.name(), kind(reference))
        }
        Atom::State { object, state } => format!("{} {state}", kind(object)),
    };
    let all = |atoms: &Vec<Atom>| atoms.iter().map(atom).collect::<Vec<_>>().join(" and ");
    task.goal.alternatives.iter().map(all).collect::<Vec<_>>().join(" or ")
}

fn is_expected(goal: &str, expected: &str) -> bool {
    fn rest<'g>(goal: &'g str, part: &str) -> Vec<&'g str> {
        let strip = |one: &str| goal.strip_prefix(one).or_else(|| goal.strip_prefix(&one.replace('_', " ")));
        part.split('/').filter_map(strip).collect()
    }
    let mut goals = vec![goal];
    for token in expected.split_inclusive(' ').map(str::trim) {
        let mut next = Vec::new();
        for goal in &goals {
            next.extend(rest(goal.trim_start(), token));
        }
        goals = next;
    }
    goals.iter().any(|goal| goal.trim().is_empty())
}

fn main() {
    let arguments: Vec<String> = std::env::args().collect();
    let text = std::fs::read_to_string(&arguments[1]).unwrap();
    let test = arguments.get(2).is_some_and(|a| a == "test");
    let lay = arguments.get(2).is_some_and(|a| a == "layout");
    let mut laid = 0;
    let planner = Planner::new(panda(), PlannerSettings::default()).unwrap();
    let cards = Catalogue::full().cards();
    let (mut made, mut wrong) = (0, 0);
    for line in text.lines().filter(|l| !l.starts_with('#') && !l.trim().is_empty()) {
        let (sentence, expected) = line.split_once(" => ").unwrap_or((line, ""));
        let result = task_from_sentence(sentence, cards, Seed::new(7), "task", &DesignSettings::default());
        if test {
            let question = expected.strip_prefix("? ").or(expected.strip_prefix('?'));
            let bad = match (&result, question) {
                (Ok(task), None) => (!is_expected(&goal_of(task, false), expected)).then(|| goal_of(task, false)),
                (Err(error), Some(part)) if error.to_string().contains(part) => None,
                (Ok(task), _) => Some(goal_of(task, false)),
                (Err(error), _) => Some(error.to_string()),
            };
            made += 1;
            if let Some(bad) = bad {
                wrong += 1;
                println!("{sentence}\n    GOT  {bad}\n    WANT {expected}");
            }
        } else {
            match result {
                Ok(task) => {
                    made += 1;
                    println!(
                        "{sentence}\n    {}   [{}]\n      ({expected})",
                        goal_of(&task, false),
                        goal_of(&task, true)
                    );
                    let edges: Vec<String> = task
                        .scene_graph
                        .edges
                        .iter()
                        .filter(|e| e.relation.is_support())
                        .map(|e| {
                            format!("{} {} {}", task.name_of(&e.subject), e.relation.name(), task.name_of(&e.reference))
                        })
                        .collect();
                    let states: Vec<String> = task
                        .scene_graph
                        .nodes
                        .iter()
                        .filter_map(|n| n.state.as_ref().map(|s| format!("{}={s}", task.name_of(&n.id))))
                        .collect();
                    if lay {
                        let out = lay_out(
                            &task,
                            Catalogue::full(),
                            &default_world(),
                            &planner,
                            GraspLibrary::builtin(),
                            Seed::new(1),
                            &LayoutSettings::default(),
                        );
                        match out {
                            Ok(_) => laid += 1,
                            Err(error) => println!("      NO LAYOUT {error}"),
                        }
                    }
                    println!("      start: {} {}", edges.join("; "), states.join("; "));
                }
                Err(error) => println!("{sentence}\n    ERR {}\n      ({expected})", error),
            }
        }
    }
    println!("{made} {wrong} laid {laid}");
}
