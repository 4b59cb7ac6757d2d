//! Hostile answers of language models: worst-case time of the answer check, and a fuzzer for it.

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

/// Repetitions of a worst case; the fastest one counts, to exclude other load of the machine.
const REPETITIONS: usize = 5;

/// Maximum number of failures in the text summary.
const SHOWN: usize = 10;

/// Amount of fuzzing: number of texts, or CPU time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Amount {
    /// Number of texts to check.
    Texts(usize),
    /// CPU time, minutes.
    Minutes(f64),
}

/// Check of one text.
#[derive(Debug, Serialize)]
pub struct Timed {
    /// Name of the worst case.
    pub name: String,
    /// Length of the text, bytes.
    pub bytes: usize,
    /// Verdict of the answer check on the text.
    pub verdict: &'static str,
    /// CPU time of the check, fastest of five runs, ms.
    pub cpu_ms: f64,
}

/// Outcomes and cost of fuzzing the answer check.
#[derive(Debug, Default, Serialize)]
pub struct Fuzzed {
    /// Number of texts checked.
    pub executions: u64,
    /// Number of texts with new behaviour, kept in the corpus for further mutation.
    pub kept: usize,
    /// CPU time of fuzzing, mutations included, s.
    pub cpu_s: f64,
    /// CPU time of the slowest check, fastest of its repetitions, ms.
    pub slowest_ms: f64,
    /// Length of the slowest text, bytes.
    pub slowest_bytes: usize,
    /// Number of texts by verdict of the check.
    pub verdicts: BTreeMap<&'static str, u64>,
    /// Texts for which the check panicked or gave a contradictory report.
    pub broken: Vec<String>,
}

/// Results on recorded answers, worst cases and fuzzed texts.
#[derive(Debug, Serialize)]
pub struct Measurement {
    /// Number of recorded answers by verdict.
    pub recorded: BTreeMap<&'static str, usize>,
    /// Number of recorded answers with an expected verdict.
    pub expected: usize,
    /// Number of recorded answers that got the expected verdict.
    pub as_expected: usize,
    /// Largest CPU time of a worst case, ms.
    pub worst_ms: f64,
    /// Check of each worst case.
    pub worst_cases: Vec<Timed>,
    /// Outcomes and cost of fuzzing.
    pub fuzzed: Fuzzed,
}

/// Checks the recorded answers in a file or folder and the worst cases, and fuzzes.
///
/// # Errors
/// If a file cannot be read or is not a recorded answer.
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
            |error: Cause| LabError::input(format!("{} is not a recorded answer", path.display())).because(error);
        let text = documents::read_text(&path, limits::TASK)?;
        let answer = RecordedAnswer::from_json(&text).map_err(|error| not_recorded(error.into()))?;
        let request = answer.request("lab", Catalogue::builtin().cards());
        let request = request.map_err(|error| not_recorded(error.into()))?;
        recorded.push((answer, request));
    }
    Ok(recorded)
}

/// True if a valid answer is accepted unchanged, and a flawed one is rejected or repaired for exactly the expected
/// flaw.
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
            // Timed again, since a single timing may be disturbed by other load; the true cost of a text is
            // reproducible.
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

/// Text summary.
pub fn describe(measurement: &Measurement) -> String {
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
