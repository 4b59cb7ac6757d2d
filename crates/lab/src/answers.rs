//! Hostile answers: how long the check of an answer takes at worst, and whether anything breaks it.

use genmanip_workspace::documents;
use genmanip_workspace::task_files;
use std::collections::BTreeMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

use genmanip_assets::Catalogue;
use genmanip_core::{Seed, limits};
use genmanip_tasks::answer::hostile::{Fuzzer, inconsistency, worst_cases};
use genmanip_tasks::answer::{AnswerReport, RecordedAnswer, TaskRequest, Verdict, check_answer};
use serde::Serialize;

use crate::LabError;
use crate::clock::cpu_clock;
use genmanip_workspace::Cause;
use genmanip_workspace::Progress;
use genmanip_workspace::text_table;

/// A worst case is timed so often and the quickest time counts: what it costs, not what else the machine did.
const REPETITIONS: usize = 5;

/// Texts that are shown when they break something.
const SHOWN: usize = 10;

/// How much is fuzzed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Amount {
    /// So many texts.
    Texts(usize),
    /// For so many minutes of processor time.
    Minutes(f64),
}

/// One text and what came of it.
#[derive(Debug, Serialize)]
pub struct Timed {
    /// What makes it a worst case.
    pub name: String,
    /// Its length.
    pub bytes: usize,
    /// The verdict.
    pub verdict: &'static str,
    /// Processor time of the check.
    pub cpu_ms: f64,
}

/// The fuzzer's part.
#[derive(Debug, Default, Serialize)]
pub struct Fuzzed {
    /// Texts that were checked.
    pub executions: u64,
    /// Texts that were new enough to start from.
    pub kept: usize,
    /// Processor time of all.
    pub cpu_s: f64,
    /// Processor time of the slowest check.
    pub slowest_ms: f64,
    /// Bytes of the slowest text.
    pub slowest_bytes: usize,
    /// How many texts had which verdict.
    pub verdicts: BTreeMap<&'static str, u64>,
    /// Texts that made the reader panic or contradict itself.
    pub broken: Vec<String>,
}

/// The measurement.
#[derive(Debug, Serialize)]
pub struct Measurement {
    /// Verdicts of the recorded answers.
    pub recorded: BTreeMap<&'static str, usize>,
    /// Recorded answers that say what is to be made of them.
    pub expected: usize,
    /// Those of which it is made.
    pub as_expected: usize,
    /// Largest processor time of a worst case, milliseconds.
    pub worst_ms: f64,
    /// Each worst case.
    pub worst_cases: Vec<Timed>,
    /// What the fuzzer found.
    pub fuzzed: Fuzzed,
}

/// Checks the recorded answers in a file or folder, worst cases, and what a fuzzer makes of them.
///
/// # Errors
/// When a file cannot be read or is no recorded answer.
pub fn measure(answers: &Path, amount: Amount, seed: Seed, progress: &dyn Progress) -> Result<Measurement, LabError> {
    let recorded = read(answers)?;
    let mut verdicts = BTreeMap::new();
    let (mut expected, mut as_expected) = (0, 0);
    for (answer, request) in &recorded {
        let report = check_answer(&answer.response, request);
        *verdicts.entry(report.verdict.name()).or_default() += 1;
        if let Some(wanted) = &answer.expect {
            expected += 1;
            as_expected += usize::from(is_as_expected(wanted, &report));
        }
    }
    let (_, request) = &recorded[0];
    let worst_cases: Vec<Timed> = worst_cases().iter().map(|(name, text)| timed(name, text, request)).collect();
    Ok(Measurement {
        recorded: verdicts,
        expected,
        as_expected,
        worst_ms: worst_cases.iter().map(|row| row.cpu_ms).fold(0.0, f64::max),
        worst_cases,
        fuzzed: fuzz(&recorded, amount, seed, progress),
    })
}

fn read(answers: &Path) -> Result<Vec<(RecordedAnswer, TaskRequest)>, LabError> {
    let mut recorded = Vec::new();
    for path in task_files::expand(&[answers.to_owned()])? {
        let not_recorded =
            |error: Cause| LabError::input(format!("{} is no recorded answer", path.display())).because(error);
        let text = documents::read_text(&path, limits::TASK)?;
        let answer = RecordedAnswer::from_json(&text).map_err(|error| not_recorded(error.into()))?;
        let request = answer.request("lab", Catalogue::builtin().cards());
        let request = request.map_err(|error| not_recorded(error.into()))?;
        recorded.push((answer, request));
    }
    Ok(recorded)
}

/// A sound answer is taken at once; a flawed one is refused or repaired for its flaw and no other.
fn is_as_expected(wanted: &str, report: &AnswerReport) -> bool {
    if wanted == "valid" {
        return report.verdict == Verdict::Valid;
    }
    !report.flaws.is_empty() && report.flaws.iter().all(|flaw| flaw.kind.name() == wanted)
}

fn timed(name: &str, text: &str, request: &TaskRequest) -> Timed {
    let mut clock = cpu_clock();
    let mut quickest = f64::INFINITY;
    let mut verdict = "";
    for _ in 0..REPETITIONS {
        let start = clock();
        let report = check_answer(text, request);
        verdict = report.verdict.name();
        drop(report);
        quickest = quickest.min(clock() - start);
    }
    Timed { name: name.into(), bytes: text.len(), verdict, cpu_ms: quickest * 1e3 }
}

fn fuzz(recorded: &[(RecordedAnswer, TaskRequest)], amount: Amount, seed: Seed, progress: &dyn Progress) -> Fuzzed {
    let corpus = recorded.iter().map(|(answer, _)| answer.response.clone()).collect();
    let mut fuzzer = Fuzzer::new(corpus, seed.fork("fuzz"));
    let mut fuzzed = Fuzzed::default();
    let mut clock = cpu_clock();
    let begin = clock();
    progress.begin("fuzzing", if let Amount::Texts(count) = amount { count } else { 0 });
    let goes_on = |fuzzed: &Fuzzed, now: f64| match amount {
        Amount::Minutes(minutes) => now - begin < minutes * 60.0,
        Amount::Texts(count) => fuzzed.executions < count as u64,
    };
    while goes_on(&fuzzed, clock()) {
        let (origin, text) = fuzzer.text();
        let (_, request) = &recorded[origin];
        fuzzed.executions += 1;
        let start = clock();
        let report = catch_unwind(AssertUnwindSafe(|| check_answer(&text, request)));
        let ms = (clock() - start) * 1e3;
        if ms > fuzzed.slowest_ms && report.is_ok() {
            // One reading may tell of the machine; what a text costs shows again.
            let again = timed("", &text, request).cpu_ms.min(ms);
            if again > fuzzed.slowest_ms {
                (fuzzed.slowest_ms, fuzzed.slowest_bytes) = (again, text.len());
            }
        }
        match report {
            Ok(report) => {
                *fuzzed.verdicts.entry(report.verdict.name()).or_default() += 1;
                if let Some(what) = inconsistency(&text, request, &report) {
                    fuzzed.broken.push(format!("{what}: {text:?}"));
                }
                fuzzer.learn(origin, &text, &report);
            }
            Err(_) => fuzzed.broken.push(format!("a panic: {text:?}")),
        }
        progress.advance();
    }
    progress.end();
    fuzzed.cpu_s = clock() - begin;
    fuzzed.kept = fuzzer.kept();
    fuzzed
}

/// The same in words.
pub fn in_words(measurement: &Measurement) -> String {
    let mut lines = vec![["worst case", "bytes", "verdict", "ms"].map(String::from).to_vec()];
    for row in &measurement.worst_cases {
        lines.push(vec![row.name.clone(), row.bytes.to_string(), row.verdict.into(), format!("{:.2}", row.cpu_ms)]);
    }
    let fuzzed = &measurement.fuzzed;
    let mut text = format!(
        "{}\nrecorded  {:?}; {} of {} as expected\nworst     {:.2} ms\n\
         fuzzed    {} texts in {:.0} s, {:?}, {} kept, slowest {:.2} ms ({} bytes), {} broken\n",
        text_table(&lines).trim_end(),
        measurement.recorded,
        measurement.as_expected,
        measurement.expected,
        measurement.worst_ms,
        fuzzed.executions,
        fuzzed.cpu_s,
        fuzzed.verdicts,
        fuzzed.kept,
        fuzzed.slowest_ms,
        fuzzed.slowest_bytes,
        fuzzed.broken.len(),
    );
    for broken in fuzzed.broken.iter().take(SHOWN) {
        text += &format!("  {broken}\n");
    }
    text
}
