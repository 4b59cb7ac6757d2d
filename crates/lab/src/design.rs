//! Tasks of the rule-based designer: validity, variety, quotas and references.

use genmanip_core::{ObjectCard, Seed};
use genmanip_tasks::designer::{self, DesignReport, DesignSettings};

use crate::LabError;
use crate::clock::cpu_clock;
use genmanip_workspace::text_table;

/// Maximum number of flaws in the text summary; the JSON has all.
const SHOWN: usize = 20;

/// Designs `count` tasks about objects, the six kinds in turn, and validates them.
///
/// # Errors
/// If the designer finds no further task within its limit of draws.
pub fn measure(cards: &[ObjectCard], count: usize, seed: Seed) -> Result<DesignReport, LabError> {
    designer::measure(cards, count, seed, &DesignSettings::default(), &mut cpu_clock())
        .map_err(|error| LabError::broken("the designer gave up", error))
}

/// Text summary.
pub fn describe(report: &DesignReport) -> String {
    let mut rows = vec![["", "count", "quota"].map(String::from).to_vec()];
    for (name, occurrence) in report.kinds.iter().chain(&report.relations) {
        rows.push(vec![name.clone(), occurrence.count.to_string(), format!("{:.1}", occurrence.quota)]);
    }
    let mut text = format!(
        "tasks         {} in {:.2} s of CPU time\nvalid         {}\ndistinct      {} instructions ({:.1} %)\n\
         references    {} of {} unique\nlongest       {} words\nquotas        {:.1} % off at worst\n\n{}\n",
        report.tasks,
        report.cpu_s,
        report.valid,
        report.distinct_instructions,
        100.0 * report.distinct_share,
        report.references_unique,
        report.references,
        report.words_max,
        100.0 * report.worst_quota_deviation,
        text_table(&rows),
    );
    for (reason, count) in &report.rejections {
        text += &format!("{count:6} × {reason}\n");
    }
    for flaw in report.flaws.iter().take(SHOWN) {
        text += &format!("  {flaw}\n");
    }
    let hidden = report.flaws.len().saturating_sub(SHOWN);
    if hidden > 0 {
        text += &format!("  and {hidden} more; --json lists all\n");
    }
    text
}
