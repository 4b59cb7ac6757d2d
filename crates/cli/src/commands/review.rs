//! `genmanip review`: reviews of scenarios, certificates, agreement, balance, and the suite of what was approved.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;
use std::time::{SystemTime, UNIX_EPOCH};

use genmanip_benchmark::statistics::ReviewerAgreement;
use genmanip_core::Seed;
use genmanip_studio::collections::Collection;
use genmanip_studio::faults;
use genmanip_studio::review::{
    Agreement, Built, Dashboard, Decision, Review, ReviewDesk, ReviewError, ReviewQueue, ReviewState, Reviewable,
    Reviewer, build_suite, certify, read_desk,
};
use genmanip_terminal::{ExitStatus, Failed, Printer};
use genmanip_workspace::{WorkspaceError, documents, scenarios, text_table, workers};
use serde_json::{Map, Value, json};

use super::plural;
use crate::args::ReviewArguments;

pub fn run(arguments: &ReviewArguments, printer: &Printer) -> Result<ExitStatus, Failed> {
    let collection = Collection::open(&arguments.paths, &arguments.out, printer)?;
    collection.left_out.iter().for_each(|message| printer.say(message));
    if let (Some(folder), Some(count)) = (&arguments.plant, arguments.faults) {
        return plant_faults(arguments, &collection, folder, count, printer);
    }
    let (mut desk, left_out) = read_desk(&collection, &arguments.out)?;
    left_out.iter().for_each(|message| printer.say(message));
    desk.set_inputs(arguments.inputs.read(printer)?);
    let (mut answer, mut text, mut status) = (Map::new(), String::new(), ExitStatus::Done);
    let reviewed = decide(arguments, &mut desk)?;
    if !arguments.certify.is_empty() {
        status = let_expert_try(arguments, &mut desk, printer, &mut answer, &mut text)?;
    }
    let name = arguments.reviewer.as_deref().unwrap_or_default();
    if !reviewed.is_empty() {
        let states: Vec<ReviewState> = reviewed.iter().filter_map(|key| desk.state(key, name)).collect();
        states.iter().for_each(|state| text += &describe_state(state));
        answer.insert("reviewed".into(), json!(states));
    }
    if let Some(key) = &arguments.show {
        let item = found(&desk, key)?;
        let state = desk.state(&item.key, name);
        state.iter().for_each(|state| text += &describe_state(state));
        answer.insert("review".into(), json!(state));
    }
    if arguments.queue {
        let queue = desk.queue(name);
        text += &describe_queue(&queue);
        answer.insert("queue".into(), json!(queue));
    }
    if arguments.agreement {
        let agreement = desk.agreement();
        text += &describe_agreement(&agreement);
        answer.insert("agreement".into(), json!(agreement));
    }
    if arguments.balance {
        let dashboard = desk.dashboard(desk.targets());
        text += &describe_balance(&dashboard);
        answer.insert("balance".into(), json!(dashboard));
    }
    if let Some(folder) = &arguments.build {
        let built = build_suite(&desk, folder, &documents::stem(folder), arguments.per_kind, desk.targets())?;
        text += &describe_built(&built, folder);
        answer.insert("suite".into(), json!(built));
    }
    printer.data(&Value::Object(answer), &text);
    Ok(status)
}

/// Plants faults in the named scenarios; copies that the studio keeps are left alone.
fn plant_faults(
    arguments: &ReviewArguments,
    collection: &Collection,
    folder: &Path,
    count: usize,
    printer: &Printer,
) -> Result<ExitStatus, Failed> {
    let named = collection.iter().filter(|listed| !listed.path.starts_with(&arguments.out));
    let pool = named.map(|listed| Ok(Arc::new(scenarios::read_scenario(&listed.path)?)));
    let pool = pool.collect::<Result<Vec<_>, WorkspaceError>>()?;
    let stop = genmanip_terminal::on_interrupt();
    let Some(faulty) = faults::plant(&pool, count, Seed::new(arguments.seed), printer, &stop)? else {
        printer.say("interrupted; nothing was written");
        return Ok(ExitStatus::NotMet);
    };
    let list = faults::write(&faulty, folder)?;
    let mut counts = BTreeMap::<&str, usize>::new();
    faulty.iter().for_each(|one| *counts.entry(one.fault.name()).or_default() += 1);
    let mut text = format!("{} in {}\n", plural(faulty.len(), "faulty scenario"), folder.display());
    counts.iter().for_each(|(fault, count)| text += &format!("  {fault}: {count}\n"));
    text += &format!("{} names them: keep it from the reviewers, and give it to --planted\n", list.display());
    let ids: Vec<&str> = faulty.iter().map(|one| one.scenario.id.as_str()).collect();
    printer.data(&json!({"planted": list, "scenarios": ids, "faults": counts}), &text);
    Ok(ExitStatus::Done)
}

/// Stores the decisions of this call; returns the keys of the decided scenarios.
fn decide(arguments: &ReviewArguments, desk: &mut ReviewDesk) -> Result<Vec<String>, Failed> {
    let ReviewArguments { approve, reject, send_back, take_back, reviewer, .. } = arguments;
    let reasons = || Decision::Reject { reasons: arguments.reason.iter().copied().collect() };
    let all = approve
        .iter()
        .map(|key| (key, Decision::Approve))
        .chain(reject.iter().map(|key| (key, reasons())))
        .chain(send_back.iter().map(|key| (key, Decision::SendBack)))
        .chain(take_back.iter().map(|key| (key, Decision::TakeBack)));
    let mut keys = Vec::new();
    for (key, decision) in all {
        let item = found(desk, key)?.clone();
        let review = Review {
            scenario: item.id,
            content_sha256: item.content_sha256,
            reviewer: Reviewer {
                name: reviewer.clone().unwrap_or_default(),
                kind: arguments.reviewer_kind,
                version: arguments.reviewer_version.clone(),
            },
            decision,
            criteria: arguments.criterion.iter().copied().collect(),
            note: arguments.note.clone(),
            adjudicates: arguments.adjudicate,
            duration_s: None,
            client_operation_id: String::new(),
            at: now(),
        };
        desk.add(key, review).map_err(|error| match error {
            ReviewError::Log(_) => Failed::from(WorkspaceError::from(error)),
            error => Failed::new(format!("{key}: {error}")).hint("--show KEY says what was reviewed"),
        })?;
        keys.push(key.clone());
    }
    Ok(keys)
}

fn let_expert_try(
    arguments: &ReviewArguments,
    desk: &mut ReviewDesk,
    printer: &Printer,
    answer: &mut Map<String, Value>,
    text: &mut String,
) -> Result<ExitStatus, Failed> {
    let mut items: Vec<Reviewable> = Vec::new();
    for key in &arguments.certify {
        match key.as_str() {
            "all" => items.extend(desk.items().filter(|item| desk.trials(item).is_none()).cloned()),
            key => items.push(found(desk, key)?.clone()),
        }
    }
    let stop = genmanip_terminal::on_interrupt();
    let mut tried = Vec::new();
    let log = desk.log_mut();
    certify(&items, &now(), workers::workers(arguments.workers), printer, &stop, |trials| {
        log.add_trials(trials.clone())?;
        tried.push(trials);
        Ok(())
    })?;
    for trials in &tried {
        *text +=
            &format!("{}: the expert solved it {} of {} times\n", trials.scenario, trials.verified, trials.episodes);
    }
    let is_whole = tried.len() == items.len() && tried.iter().all(|trials| trials.certificate().is_some());
    answer.insert("trials".into(), json!(tried));
    Ok(if is_whole { ExitStatus::Done } else { ExitStatus::NotMet })
}

fn found<'a>(desk: &'a ReviewDesk, key: &str) -> Result<&'a Reviewable, Failed> {
    desk.get(key).ok_or_else(|| {
        Failed::new(format!("no scenario {key} is under review")).hint("`genmanip review --queue` lists the keys")
    })
}

fn now() -> String {
    genmanip_terminal::rfc3339(SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default().as_secs())
}

fn describe_state(state: &ReviewState) -> String {
    let trials = state.trials.as_ref();
    let expert = trials.map_or("not tried by the expert".into(), |trials| {
        format!("solved by the expert {} of {} times", trials.verified, trials.episodes)
    });
    let mut text = format!("{}: {}, {expert}\n", state.row.key, state.row.standing.name());
    for review in &state.reviews {
        let decision = match &review.decision {
            Decision::Approve => "approved".into(),
            Decision::Reject { reasons } => {
                let reasons: Vec<&str> = reasons.iter().map(|reason| reason.name()).collect();
                format!("rejected: {}", reasons.join(", "))
            }
            Decision::SendBack => "sent back".into(),
            Decision::TakeBack => "taken back".into(),
        };
        let note = if review.note.is_empty() { String::new() } else { format!(" – {}", review.note) };
        text += &format!("  {}: {decision}{note}\n", review.reviewer.name);
    }
    text
}

fn describe_queue(queue: &ReviewQueue) -> String {
    let head = ["scenario", "kind", "standing", "to do", "expert", "like"].map(String::from);
    let mut rows = vec![head.to_vec()];
    for row in &queue.scenarios {
        let expert = if row.is_certified { "solved" } else { "" };
        let work = row.work.map(|work| json!(work).as_str().unwrap_or_default().to_owned());
        rows.push(vec![
            row.key.clone(),
            row.kind.name().into(),
            row.standing.name().into(),
            work.unwrap_or_default(),
            expert.to_owned(),
            row.group.map_or(String::new(), |group| format!("group {}", group + 1)),
        ]);
    }
    let next = queue.next.as_ref().map_or("nothing is left to review".into(), |key| format!("next: {key}"));
    format!("{}\n{next}\n", text_table(&rows))
}

fn describe_agreement(agreement: &Agreement) -> String {
    let head = ["", "pairs", "equal", "Cohen's kappa", "Gwet's AC1"].map(String::from);
    let row = |name: &str, found: &ReviewerAgreement| {
        let kappa = found.kappa.map_or("undefined".into(), |kappa| format!("{kappa:.2}"));
        let raw = format!("{:.0} %", 100.0 * found.raw);
        vec![name.to_owned(), found.items.to_string(), raw, kappa, format!("{:.2}", found.ac1)]
    };
    let Some(decision) = &agreement.decision else { return "no scenario has two reviews\n".into() };
    let mut rows = vec![head.to_vec(), row("decision", decision)];
    rows.extend(agreement.criteria.iter().map(|(criterion, found)| row(criterion.name(), found)));
    let mut text = text_table(&rows);
    for (name, found) in &agreement.planted {
        text += &format!(
            "{name}: found {} of {} planted faults, {} of {} sound ones refused\n",
            found.detected, found.planted, found.false_alarms, found.sound
        );
    }
    text
}

fn describe_balance(dashboard: &Dashboard) -> String {
    let mut rows = vec![["axis", "distance", "shares of the approved"].map(String::from).to_vec()];
    for axis in &dashboard.balance.axes {
        let shares: Vec<String> =
            axis.values.iter().map(|value| format!("{} {:.0} %", value.value, 100.0 * value.share)).collect();
        rows.push(vec![axis.axis.clone(), format!("{:.2}", axis.total_variation), shares.join(", ")]);
    }
    let standings: Vec<String> = dashboard.standings.iter().map(|(name, count)| format!("{count} {name}")).collect();
    let mut text = format!("{}\n\n{}", standings.join(", "), text_table(&rows));
    for one in &dashboard.policies {
        let (policy, scenarios) = (&one.policy, plural(one.scenarios, "scenario"));
        text += &format!("{policy}: {} of {} episodes succeed on {scenarios}\n", one.successes, one.episodes);
    }
    for one in &dashboard.left_out {
        text += &format!("{} left out: {}\n", plural(one.episodes, "episode"), one.reason);
    }
    let most = dashboard.helpful.first().filter(|one| one.gain > 0.0);
    let most = most.map(|one| format!("\nhelps most: {} ({})\n", one.key, one.reason));
    text += &most.unwrap_or_default();
    text
}

fn describe_built(built: &Built, folder: &Path) -> String {
    let mut text = format!("{} in {}\n", plural(built.suite.scenarios.len(), "scenario"), folder.display());
    for one in &built.choice.chosen {
        text += &format!("  {}: {}\n", one.scenario, one.reason);
    }
    let left = built.choice.rejected.len();
    text + &format!("{} not chosen; choice.json has the reasons\n", plural(left, "scenario"))
}
