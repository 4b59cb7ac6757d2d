//! Results of the measurement, and their tables.

use std::collections::BTreeMap;

use genmanip_workspace::text_table;
use serde::Serialize;

use super::resets::ResetRange;
use super::sources::Takes;

/// Names of the ablations: without the planner, with the object's body instead of the moving link's handle as frame,
/// without waiting for the hand, and judged at any step instead of after settling.
pub(super) const ABLATIONS: [&str; 4] = ["no_planner", "body_frame", "no_waiting", "any_step"];

/// Results by skill.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// Results by the name of the skill.
    pub skills: BTreeMap<&'static str, SkillReport>,
    /// Counts behind the results, by the name of the skill.
    pub details: BTreeMap<&'static str, Details>,
    /// Ranges of the initial scenes, which take turns.
    pub resets: [ResetRange; 3],
    /// Limitations of the measurement, for people.
    pub notes: Vec<&'static str>,
    /// CPU time of the measurement, s.
    pub cpu_s: f64,
}

/// Results of a skill; rates are shares of the scenes, 0-1.
#[derive(Clone, Debug, Serialize)]
pub struct SkillReport {
    /// Number of source demonstrations from which a skill was cut.
    pub source_demos: usize,
    /// Transfers that succeeded after settling.
    pub generation_rate: f64,
    /// Of these, those on the instance of the sources.
    pub same_instance: f64,
    /// Of these, those on other instances of its family.
    pub unseen_instances: f64,
    /// Share of the kept episodes whose goal still holds when they are replayed, settle once more and are judged again.
    pub kept_after_settling: f64,
    /// Episodes kept per hour of CPU time of one core.
    pub per_core_hour: f64,
    /// Success of the expert's analytic skill on the same scenes.
    pub analytic: f64,
    /// Success of MimicGen as published on the same scenes, by its own criterion.
    pub mimicgen: f64,
}

/// Counts behind a skill's rates.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Details {
    /// Takes of the scripted operator.
    pub takes: Takes,
    /// Number of scenes.
    pub scenes: usize,
    /// Successful transfers and scenes by range, on the instance of the sources.
    pub same_by_range: BTreeMap<&'static str, [usize; 2]>,
    /// Successful transfers and scenes by range, on other instances.
    pub unseen_by_range: BTreeMap<&'static str, [usize; 2]>,
    /// Kept episodes, and those of them whose goal does not hold when judged again.
    pub kept_and_failed_again: [usize; 2],
    /// Kept episodes that replay to the same bytes.
    pub replay_equal: usize,
    /// Reasons of failed transfers, with their number.
    pub failures: BTreeMap<String, usize>,
    /// Episodes of MimicGen whose goal holds after settling, and those whose goal held at any step.
    pub mimicgen_settled_and_any_step: [usize; 2],
    /// Reasons why the goal of MimicGen's episodes does not hold after settling, with their number.
    pub mimicgen_failures: BTreeMap<String, usize>,
    /// Episodes of MimicGen without noise on its actions, counted in the same way; zeros unless ablations are asked for.
    pub without_noise_settled_and_any_step: [usize; 2],
    /// Episodes of MimicGen with planned motions between its segments, as SkillGen, counted in the same way; zeros unless ablations are asked for.
    pub skillgen_settled_and_any_step: [usize; 2],
    /// Scenes in which the transfer succeeded and MimicGen by its own criterion did not, and the reverse.
    pub transfer_only_and_mimicgen_only: [usize; 2],
    /// Scenes in which the transfer succeeded and the analytic skill did not, and the reverse.
    pub transfer_only_and_analytic_only: [usize; 2],
    /// Uses of each skill in kept episodes.
    pub used: BTreeMap<String, usize>,
    /// Success without each ingredient, with the ablation's name; empty unless asked for.
    pub ablations: BTreeMap<&'static str, f64>,
    /// CPU time of the transfers, s.
    pub transfer_cpu_s: f64,
}

/// Text summary; with ablations, a second table with every arm under its own criterion and under ours.
pub fn describe(report: &Report) -> String {
    let share = |share: f64| format!("{:.1} %", share * 100.0);
    let header = ["skill", "sources", "same", "unseen", "analytic", "MimicGen", "holds again", "per core-hour"];
    let mut rows = vec![header.map(str::to_owned).to_vec()];
    rows.extend(report.skills.iter().map(|(name, skill)| {
        vec![
            (*name).to_owned(),
            skill.source_demos.to_string(),
            share(skill.same_instance),
            share(skill.unseen_instances),
            share(skill.analytic),
            share(skill.mimicgen),
            share(skill.kept_after_settling),
            format!("{:.0}", skill.per_core_hour),
        ]
    }));
    let mut text = text_table(&rows);
    if report.details.values().any(|detail| !detail.ablations.is_empty()) {
        text = format!("{text}\n\n{}", ablations(report));
    }
    text + &report.notes.iter().map(|note| format!("\n{note}")).collect::<String>()
}

/// Table of the arms: percent of the scenes, for the comparisons by their own criterion (any step) and by ours (after
/// settling).
fn ablations(report: &Report) -> String {
    let percent = |share: f64| format!("{:.0}", share * 100.0);
    let header = ["skill", "scenes", "analytic", "transfer"].into_iter().chain(ABLATIONS);
    let header = header.chain(["MimicGen own / ours", "without noise own / ours", "SkillGen-like own / ours"]);
    let mut rows = vec![header.map(|name| name.replace('_', " ")).collect::<Vec<_>>()];
    for (name, skill) in &report.skills {
        let Some(detail) = report.details.get(name) else { continue };
        let both = |[settled, any_step]: [usize; 2]| {
            [any_step, settled].map(|count| percent(count as f64 / detail.scenes.max(1) as f64)).join(" / ")
        };
        let mut row = vec![(*name).to_owned(), detail.scenes.to_string()];
        row.extend([skill.analytic, skill.generation_rate].map(percent));
        row.extend(ABLATIONS.map(|name| detail.ablations.get(name).copied().map_or_else(String::new, percent)));
        row.extend([both(detail.mimicgen_settled_and_any_step), both(detail.without_noise_settled_and_any_step)]);
        row.push(both(detail.skillgen_settled_and_any_step));
        rows.push(row);
    }
    text_table(&rows)
}
