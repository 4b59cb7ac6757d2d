//! Identification of hidden arms: errors, coverage of the intervals, parameters that cannot be identified, and effects
//! that the model lacks.

use std::collections::BTreeMap;

use genmanip_core::Seed;
use genmanip_identify::parameters::Parameter;
use genmanip_identify::{Identification, SearchSettings, identify};
use genmanip_workspace::{Progress, WorkspaceError, text_table};
use serde::Serialize;

use crate::clock::cpu_clock;
use crate::hidden_arms::{HiddenCase, Lacking, hidden_case};
use crate::quantile::Spread;

/// Accuracy and honesty of identifications. Errors are those of identified parameters under the right structure.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Report {
    /// Number of hidden arms.
    pub count: usize,
    /// Median error of the latency, ms.
    pub latency_ms_median: f64,
    /// Median relative error of joint damping.
    pub damping_median: f64,
    /// Median relative error of dry joint friction.
    pub friction_loss_median: f64,
    /// Median relative error of position and velocity gains.
    pub gains_median: f64,
    /// Median relative error of the payload's mass.
    pub payload_median: f64,
    /// Median error of the payload's mass, g.
    pub payload_g_median: f64,
    /// Median error of the payload's centre along one axis, mm.
    pub payload_center_mm_median: f64,
    /// Median error of the factor on pad friction.
    pub pad_friction_median: f64,
    /// Median error of the friction of the block on the table.
    pub table_friction_median: f64,
    /// Median relative errors of the frictions of pads and table.
    pub friction_relative_medians: [f64; 2],
    /// Share of the stated 95 % intervals that contain the truth, over all parameters; 0.95 is ideal.
    pub coverage: f64,
    /// The same by kind of parameter, with the number of intervals.
    pub coverage_by_kind: BTreeMap<&'static str, (f64, usize)>,
    /// Share of the parameters not planted as unidentifiable that were identified.
    pub identified: f64,
    /// Number of parameters that the recordings do not show.
    pub unidentifiable_planted: usize,
    /// Number of them that were named.
    pub unidentifiable_named: usize,
    /// Median ratio of the held-out tracking error before to that after.
    pub held_out_ratio_median: f64,
    /// The same under a wrong structure.
    pub wrong_structure_held_out_ratio_median: f64,
    /// Number of hidden arms with an effect that the model lacks.
    pub wrong_structure: usize,
    /// Share of them that were flagged.
    pub flagged: f64,
    /// The same by effect, with their number.
    pub flagged_by_effect: BTreeMap<Lacking, (f64, usize)>,
    /// Share of the others that were flagged in error.
    pub falsely_flagged: f64,
    /// Hidden arms that were not identified at all, with the reason.
    pub failed: Vec<String>,
    /// CPU time, s, without that of making the recordings.
    pub cpu_s: f64,
    /// Identified values of every arm beside the true ones.
    pub arms: Vec<Arm>,
}

/// Identified values of one hidden arm beside the true ones.
#[derive(Clone, Debug, Serialize)]
pub struct Arm {
    /// Number of the arm in its series.
    pub number: usize,
    /// Effect that the model lacks; `null` if the model is right.
    pub lacking: Option<Lacking>,
    /// True if the identification says that the model lacks something.
    pub is_flagged: bool,
    /// Held-out tracking error before over that after.
    pub held_out_ratio: f64,
    /// Identified parameters.
    pub estimates: Vec<Compared>,
}

/// One identified value beside the true one.
#[derive(Clone, Debug, Serialize)]
pub struct Compared {
    /// Name of the parameter.
    pub name: String,
    /// True value.
    pub truth: f64,
    /// Identified value.
    pub value: f64,
    /// 95 % interval.
    pub interval: [f64; 2],
}

impl Arm {
    fn of(number: usize, case: &HiddenCase, found: &Identification) -> Self {
        let estimates = found.parameters.iter().map(|it| Compared {
            name: it.name.clone(),
            truth: case.truth.get(it.parameter),
            value: it.value,
            interval: it.interval,
        });
        Self {
            number,
            lacking: case.lacking,
            is_flagged: found.is_structure_wrong,
            held_out_ratio: found.held_out.map_or(0.0, |it| it.ratio()),
            estimates: estimates.collect(),
        }
    }

    /// One line: what was found, and which intervals miss the truth.
    fn describe(&self) -> String {
        let is_missed = |it: &&Compared| !(it.interval[0]..=it.interval[1]).contains(&it.truth);
        let missed: Vec<String> = self
            .estimates
            .iter()
            .filter(is_missed)
            .map(|it| {
                format!("{} {:.4} [{:.4}, {:.4}] of {:.4}", it.name, it.value, it.interval[0], it.interval[1], it.truth)
            })
            .collect();
        let lacking = self.lacking.map_or("nothing".into(), |it| format!("{it:?}"));
        let flagged = if self.is_flagged { "flagged" } else { "not flagged" };
        format!(
            "arm {}: lacks {lacking}, {flagged}; held-out error {:.1} times smaller; {} of {} intervals miss {}",
            self.number,
            self.held_out_ratio,
            missed.len(),
            self.estimates.len(),
            missed.join("; ")
        )
    }
}

/// Samples behind a report.
#[derive(Default)]
struct Tally {
    errors: BTreeMap<&'static str, Vec<f64>>,
    payload_g: Vec<f64>,
    frictions: [Vec<f64>; 2],
    covered: BTreeMap<&'static str, (usize, usize)>,
    identified: (usize, usize),
    ratios: [Vec<f64>; 2],
    flagged: BTreeMap<Lacking, (usize, usize)>,
    falsely: (usize, usize),
}

/// Identifies `count` hidden arms of a series, from a number on.
///
/// # Errors
/// When a hidden arm cannot be made.
pub fn measure(first: usize, count: usize, seed: Seed, progress: &dyn Progress) -> Result<Report, WorkspaceError> {
    let mut clock = cpu_clock();
    let mut report = Report { count, ..Report::default() };
    let mut tally = Tally::default();
    progress.begin("hidden arms", count);
    for index in first..first + count {
        let case = hidden_case(index, seed.fork_index(index as u64))?;
        let began = clock();
        let held_out = std::slice::from_ref(&case.held_out);
        let settings = SearchSettings::default();
        match identify(&case.world, &case.robot, &case.recordings, held_out, &settings) {
            Ok(found) => {
                tally.add(&case, &found, &mut report);
                report.arms.push(Arm::of(index, &case, &found));
                progress.note(&report.arms[report.arms.len() - 1].describe());
            }
            Err(error) => report.failed.push(format!("{index}: {error}")),
        }
        report.cpu_s += clock() - began;
        progress.advance();
    }
    progress.end();
    tally.finish(&mut report);
    Ok(report)
}

/// Kind of a parameter, over all joints.
fn kind(parameter: Parameter) -> &'static str {
    match parameter {
        Parameter::Kp(_) => "kp",
        Parameter::Kv(_) => "kv",
        Parameter::Damping(_) => "damping",
        Parameter::FrictionLoss(_) => "friction_loss",
        Parameter::Latency => "latency",
        Parameter::PayloadMass => "payload_mass",
        Parameter::PayloadCenter(_) => "payload_center",
        Parameter::TableFriction => "table_friction",
        Parameter::PadFriction => "pad_friction",
        Parameter::Restitution => "restitution",
    }
}

impl Tally {
    fn add(&mut self, case: &HiddenCase, found: &Identification, report: &mut Report) {
        let is_named = |parameter: &&Parameter| found.unidentified.iter().any(|it| it.parameter == **parameter);
        report.unidentifiable_planted += case.planted.len();
        report.unidentifiable_named += case.planted.iter().filter(is_named).count();
        let ratio = found.held_out.map_or(0.0, |it| it.ratio());
        self.ratios[usize::from(case.lacking.is_some())].push(ratio);
        if let Some(lacking) = case.lacking {
            let (flagged, all) = self.flagged.entry(lacking).or_default();
            *flagged += usize::from(found.is_structure_wrong);
            *all += 1;
            return;
        }
        self.falsely.0 += usize::from(found.is_structure_wrong);
        self.falsely.1 += 1;
        let is_shown = |parameter: Parameter| case.recordings.iter().any(|it| parameter.is_shown_by(it.motion));
        self.identified.0 += found.parameters.len();
        self.identified.1 += found.parameters.len()
            + found
                .unidentified
                .iter()
                .filter(|it| is_shown(it.parameter) && !case.planted.contains(&it.parameter))
                .count();
        for estimate in found.parameters.iter().filter(|it| !case.planted.contains(&it.parameter)) {
            let truth = case.truth.get(estimate.parameter);
            let off = (estimate.value - truth).abs();
            let error = match estimate.parameter {
                Parameter::Latency => 1e3 * off,
                Parameter::TableFriction | Parameter::PadFriction => off,
                Parameter::PayloadCenter(_) => 1e3 * off,
                _ => off / truth,
            };
            let name = kind(estimate.parameter);
            self.errors.entry(name).or_default().push(error);
            if estimate.parameter == Parameter::PayloadMass {
                self.payload_g.push(1e3 * off);
            }
            if let Some(index) =
                [Parameter::PadFriction, Parameter::TableFriction].iter().position(|it| *it == estimate.parameter)
            {
                self.frictions[index].push(off / truth);
            }
            let (covered, all) = self.covered.entry(name).or_default();
            *covered += usize::from((estimate.interval[0]..=estimate.interval[1]).contains(&truth));
            *all += 1;
        }
    }

    fn finish(mut self, report: &mut Report) {
        let share = |part: usize, all: usize| part as f64 / all.max(1) as f64;
        let median = |names: &[&str]| {
            let all = names.iter().flat_map(|name| self.errors.get(name).cloned().unwrap_or_default());
            Spread::of(all.collect()).median
        };
        report.latency_ms_median = median(&["latency"]);
        report.damping_median = median(&["damping"]);
        report.friction_loss_median = median(&["friction_loss"]);
        report.gains_median = median(&["kp", "kv"]);
        report.payload_median = median(&["payload_mass"]);
        report.payload_center_mm_median = median(&["payload_center"]);
        report.pad_friction_median = median(&["pad_friction"]);
        report.table_friction_median = median(&["table_friction"]);
        report.friction_relative_medians = std::mem::take(&mut self.frictions).map(|errors| Spread::of(errors).median);
        report.payload_g_median = Spread::of(std::mem::take(&mut self.payload_g)).median;
        let [right, wrong] = self.ratios;
        report.held_out_ratio_median = Spread::of(right).median;
        report.wrong_structure_held_out_ratio_median = Spread::of(wrong).median;
        let (covered, all) = self.covered.values().fold((0, 0), |sum, it| (sum.0 + it.0, sum.1 + it.1));
        report.coverage = share(covered, all);
        report.coverage_by_kind = self.covered.iter().map(|(name, it)| (*name, (share(it.0, it.1), it.1))).collect();
        report.identified = share(self.identified.0, self.identified.1);
        let (flagged, wrong) = self.flagged.values().fold((0, 0), |sum, it| (sum.0 + it.0, sum.1 + it.1));
        report.wrong_structure = wrong;
        report.flagged = share(flagged, wrong);
        report.flagged_by_effect = self.flagged.iter().map(|(name, it)| (*name, (share(it.0, it.1), it.1))).collect();
        report.falsely_flagged = share(self.falsely.0, self.falsely.1);
    }
}

/// Text summary.
pub fn describe(report: &Report) -> String {
    let percent = |share: f64| format!("{:.1} %", 100.0 * share);
    let row = |name: &str, error: String, kinds: &[&str]| {
        let (covered, all) = kinds
            .iter()
            .filter_map(|kind| report.coverage_by_kind.get(kind))
            .fold((0.0, 0), |(covered, all), (share, count)| (covered + share * *count as f64, all + count));
        let covered = if all == 0 { "-".into() } else { percent(covered / all as f64) };
        vec![name.to_string(), error, all.to_string(), covered]
    };
    let friction = |error: f64, of: usize| format!("{error:.4}, {}", percent(report.friction_relative_medians[of]));
    let head = ["parameter", "median error", "intervals", "95 %"];
    let rows = vec![
        head.map(String::from).to_vec(),
        row("latency", format!("{:.3} ms", report.latency_ms_median), &["latency"]),
        row("gains", percent(report.gains_median), &["kp", "kv"]),
        row("damping", percent(report.damping_median), &["damping"]),
        row("friction loss", percent(report.friction_loss_median), &["friction_loss"]),
        row(
            "payload",
            format!("{}, {:.1} g", percent(report.payload_median), report.payload_g_median),
            &["payload_mass"],
        ),
        row("payload's centre", format!("{:.2} mm", report.payload_center_mm_median), &["payload_center"]),
        row("pad friction", friction(report.pad_friction_median, 0), &["pad_friction"]),
        row("table friction", friction(report.table_friction_median, 1), &["table_friction"]),
    ];
    let mut text = text_table(&rows);
    text += &format!(
        "{} hidden arms, {:.1} s of CPU time each; coverage of all intervals {}; {} of the parameters that can be \
         identified were\n",
        report.count,
        report.cpu_s / report.count.max(1) as f64,
        percent(report.coverage),
        percent(report.identified),
    );
    text += &format!(
        "not shown by the recordings: {} parameters, {} named\n",
        report.unidentifiable_planted, report.unidentifiable_named
    );
    text += &format!(
        "held-out tracking error {:.1} times smaller; {:.1} times under a wrong structure, {} of which flagged; {} \
         flagged in error\n",
        report.held_out_ratio_median,
        report.wrong_structure_held_out_ratio_median,
        percent(report.flagged),
        percent(report.falsely_flagged),
    );
    for (effect, (share, all)) in &report.flagged_by_effect {
        text += &format!("{effect:?}: {} of {all} flagged\n", percent(*share));
    }
    report.failed.iter().fold(text, |text, line| text + "failed: " + line + "\n")
}
