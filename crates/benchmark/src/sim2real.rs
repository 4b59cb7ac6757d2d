//! Agreement of simulation and reality: success rates of the same policies in both, from a table.
//!
//! ```
//! use genmanip_benchmark::{StatisticsSettings, sim2real};
//! let table = sim2real::parse("policy,sim,real\nocto,0.3,0.4\nrt-1,0.8,0.9\n").unwrap();
//! let report = sim2real::report(&table, &StatisticsSettings::default()).unwrap();
//! assert_eq!(report.overall.unwrap().mmrv.value, Some(0.0));
//! ```

mod figure;
mod measure;
mod table;

pub use figure::figure;
pub use measure::{Agreement, Estimate, PolicyRates, SimToReal, TaskAgreement, Violation, report};
pub use table::{Cell, Comparisons, Observed, Table, World, parse};

use std::path::Path;

use genmanip_core::limits;
use genmanip_workspace::{WorkspaceError, documents, text_table};

use crate::StatisticsSettings;

/// Report on the table in a file.
///
/// # Errors
/// If the file is no such table, or fewer than two policies were tried in both worlds.
pub fn report_file(path: &Path, settings: &StatisticsSettings) -> Result<SimToReal, WorkspaceError> {
    let text = documents::read_text(path, limits::RATES)?;
    let inside = |error: WorkspaceError| {
        let hint = error.hint();
        let error = WorkspaceError::input(format!("{error}: {}", path.display()));
        if let Some(hint) = hint { error.with_hint(hint) } else { error }
    };
    report(&parse(&text).map_err(inside)?, settings).map_err(inside)
}

/// Text summary.
pub fn describe(report: &SimToReal) -> String {
    let mut text = String::new();
    if let Some(all) = &report.overall {
        let head = [report.measure.as_str(), "simulation", "reality", "sim - real", "95 %"];
        let mut rows = vec![head.map(String::from).to_vec()];
        rows.extend(all.policies.iter().map(policy_row));
        text += &text_table(&rows);
        text.push('\n');
    }
    let head = ["task", "policies", "MMRV", "95 %", "Pearson", "95 %", "Spearman", "95 %", "Kendall", "95 %"];
    let mut rows = vec![head.map(String::from).to_vec()];
    rows.extend(report.overall.iter().map(|all| agreement_row("all", all)));
    let tasks = report.tasks.iter().filter(|_| report.tasks.len() > 1 || report.overall.is_none());
    rows.extend(tasks.map(|task| agreement_row(&task.task, &task.agreement)));
    text += &text_table(&rows);
    text += "MMRV: 0 is best, 1 is worst; correlations: 1 is best\n";
    if let Some(all) = &report.overall {
        text += &violations(all);
    }
    text.extend(report.warnings.iter().map(|warning| format!("warning: {warning}\n")));
    text
}

fn violations(all: &Agreement) -> String {
    let percent = |share: f64| format!("{:.1}", 100.0 * share);
    if all.violations.is_empty() {
        return "no rank violation: simulation orders the policies as reality does\n".into();
    }
    let head = ["rank violation", "better in reality by, points", "in simulation by", "share of resamples"];
    let mut rows = vec![head.map(String::from).to_vec()];
    rows.extend(all.violations.iter().map(|it| {
        let share = it.resamples.map_or_else(String::new, |share| format!("{} %", percent(share)));
        vec![format!("{} > {}", it.better, it.worse), percent(it.real_gap), percent(it.sim_gap), share]
    }));
    format!("\n{}", text_table(&rows))
}

fn policy_row(policy: &PolicyRates) -> Vec<String> {
    let percent = |share: f64| format!("{:.1} %", 100.0 * share);
    let points = |share: f64| format!("{:+.1}", 100.0 * share);
    let interval = match (policy.difference.low, policy.difference.high) {
        (Some(low), Some(high)) => format!("{} to {}", points(low), points(high)),
        _ => String::new(),
    };
    let difference = policy.difference.value.map_or_else(String::new, points);
    vec![policy.policy.clone(), percent(policy.sim), percent(policy.real), difference, interval]
}

fn agreement_row(name: &str, agreement: &Agreement) -> Vec<String> {
    let mut row = vec![name.to_owned(), agreement.policies.len().to_string()];
    for estimate in [&agreement.mmrv, &agreement.pearson, &agreement.spearman, &agreement.kendall] {
        row.push(estimate.value.map_or_else(|| "–".into(), |value| format!("{value:.3}")));
        row.push(match (estimate.low, estimate.high) {
            (Some(low), Some(high)) => format!("{low:.2} to {high:.2}"),
            _ => String::new(),
        });
    }
    row
}

#[cfg(test)]
mod tests {
    use super::*;

    fn text(name: &str) -> String {
        let path = format!("{}/../../examples/sim2real/{name}", env!("CARGO_MANIFEST_DIR"));
        std::fs::read_to_string(path).unwrap()
    }

    fn read(text: &str) -> SimToReal {
        report(&parse(text).unwrap(), &StatisticsSettings::default()).unwrap()
    }

    #[test]
    fn rates_of_policies_are_compared_overall_and_per_task() {
        let found = read(&text("rates.csv"));
        let all = found.overall.as_ref().unwrap();
        assert_eq!((all.policies.len(), found.tasks.len()), (6, 3), "{found:?}");
        for estimate in [&all.mmrv, &all.pearson, &all.spearman, &all.kendall] {
            let (value, low, high) = (estimate.value.unwrap(), estimate.low.unwrap(), estimate.high.unwrap());
            assert!(low <= value && value <= high && low < high, "{estimate:?}");
        }
        assert_eq!(found, read(&text("rates.csv")), "the same table gives the same intervals");
        let words = describe(&found);
        for said in ["simulation", "all ", "drawer", "MMRV"] {
            assert!(words.contains(said), "{said}: {words}");
        }
        let picture = figure(all, &found.measure);
        assert!(picture.starts_with("<svg") && picture.matches("<circle").count() == 6, "{picture}");
        quick_xml::Reader::from_str(&picture).read_event().unwrap();
    }

    #[test]
    fn pairs_give_strengths_in_both_worlds() {
        let found = read(&text("pairs.csv"));
        let all = found.overall.as_ref().unwrap();
        assert_eq!(found.measure, "chance of winning");
        assert!(all.pearson.value.unwrap() > 0.8 && all.policies.len() == 5, "{all:?}");
        let order: Vec<&str> = all.policies.iter().map(|policy| policy.policy.as_str()).collect();
        assert_eq!(order, ["a", "b", "c", "d", "e"]);
        assert!(all.policies[0].real > all.policies[4].real);
    }

    #[test]
    fn intervals_narrow_with_trials_and_are_absent_without() {
        let table = |trials: &str| {
            let rows = ["a,0.9,0.8", "b,0.2,0.4", "c,0.5,0.5", "d,0.6,0.7", "e,0.1,0.2"];
            rows.iter().fold("policy,sim,real,trials\n".to_owned(), |text, row| format!("{text}{row},{trials}\n"))
        };
        let width = |trials: &str| {
            let pearson = read(&table(trials)).overall.unwrap().pearson;
            pearson.high.zip(pearson.low).map(|(high, low)| high - low)
        };
        assert!(width("10").unwrap() > 2.0 * width("1000").unwrap());
        assert_eq!(width(""), None);
    }

    #[test]
    fn what_is_missing_is_said() {
        let few = read("policy,sim,real\na,0.9,0.8\nb,0.2,0.4\n");
        assert!(few.warnings.iter().any(|it| it.contains("2 policies; with fewer than 5")), "{few:?}");
        let half = read("task,policy,sim,real\nx,a,1,1\nx,b,0,0.5\ny,a,1,\n");
        assert!(half.warnings.iter().any(|it| it.contains("policy a on task y was not tried in reality")), "{half:?}");
        let uneven = read("task,policy,sim,real\nx,a,1,1\nx,b,0,0.5\ny,c,1,0.3\ny,d,0.2,0.1\n");
        assert!(uneven.overall.is_none() && uneven.tasks.len() == 2, "{uneven:?}");
        let settings = StatisticsSettings::default();
        for text in ["policy,sim,real\na,0.5,\nb,,0.5\n", "policy,sim,real\na,0.5,0.4\n"] {
            let error = report(&parse(text).unwrap(), &settings).unwrap_err();
            assert!(error.to_string().contains("fewer than two policies"), "{error}");
        }
    }
}
