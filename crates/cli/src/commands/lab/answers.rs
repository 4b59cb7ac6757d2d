//! `genmanip lab answers`: how long the check of an answer takes at worst, and whether anything breaks it.

use std::collections::BTreeMap;
use std::panic::{AssertUnwindSafe, catch_unwind};

use genmanip_assets::Catalogue;
use genmanip_core::Seed;
use genmanip_scene::answer::hostile::{Fuzzer, inconsistency, worst_cases};
use genmanip_scene::answer::{AnswerReport, RecordedAnswer, TaskRequest, Verdict, check_answer};
use serde::Serialize;

use super::cpu_clock;
use crate::args::AnswersArguments;
use crate::error::{ExitStatus, Failed};
use crate::inputs;
use crate::printer::{Printer, table};

/// Largest recorded answer that is read, bytes.
const MAX_BYTES: u64 = 16 << 20;

/// A worst case is timed so often and the quickest time counts: what it costs, not what else the machine did.
const REPETITIONS: usize = 5;

/// Texts that are shown when they break something.
const SHOWN: usize = 10;

/// One text and what came of it.
#[derive(Debug, Serialize)]
struct Row {
    name: String,
    bytes: usize,
    verdict: &'static str,
    cpu_ms: f64,
}

/// The fuzzer's part.
#[derive(Debug, Default, Serialize)]
struct Fuzzed {
    executions: u64,
    kept: usize,
    cpu_s: f64,
    slowest_ms: f64,
    /// Bytes of the slowest text.
    slowest_bytes: usize,
    verdicts: BTreeMap<&'static str, u64>,
    /// Texts that made the reader panic or contradict itself.
    broken: Vec<String>,
}

/// The measurement.
#[derive(Debug, Serialize)]
struct Measurement {
    /// Verdicts of the recorded answers.
    recorded: BTreeMap<&'static str, usize>,
    /// Recorded answers that say what is to be made of them, and those of which it is made.
    expected: usize,
    as_expected: usize,
    /// Largest processor time of a worst case, milliseconds.
    worst_ms: f64,
    worst_cases: Vec<Row>,
    fuzzed: Fuzzed,
}

pub fn run(arguments: &AnswersArguments, printer: &Printer) -> Result<ExitStatus, Failed> {
    let recorded = read(arguments)?;
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
    let worst_cases: Vec<Row> = worst_cases().iter().map(|(name, text)| timed(name, text, request)).collect();
    let measurement = Measurement {
        recorded: verdicts,
        expected,
        as_expected,
        worst_ms: worst_cases.iter().map(|row| row.cpu_ms).fold(0.0, f64::max),
        worst_cases,
        fuzzed: fuzz(&recorded, arguments, printer),
    };
    printer.data(&measurement, &in_words(&measurement));
    Ok(ExitStatus::Done)
}

fn read(arguments: &AnswersArguments) -> Result<Vec<(RecordedAnswer, TaskRequest)>, Failed> {
    let mut recorded = Vec::new();
    for path in inputs::expand(std::slice::from_ref(&arguments.answers))? {
        let not_recorded =
            |error: &dyn std::error::Error| Failed::because(format!("{} is no recorded answer", path.display()), error);
        let answer =
            RecordedAnswer::from_json(&inputs::read_text(&path, MAX_BYTES)?).map_err(|error| not_recorded(&error))?;
        let request = answer.request("lab", Catalogue::builtin().cards()).map_err(|error| not_recorded(&error))?;
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

fn timed(name: &str, text: &str, request: &TaskRequest) -> Row {
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
    Row { name: name.into(), bytes: text.len(), verdict, cpu_ms: quickest * 1e3 }
}

fn fuzz(recorded: &[(RecordedAnswer, TaskRequest)], arguments: &AnswersArguments, printer: &Printer) -> Fuzzed {
    let corpus = recorded.iter().map(|(answer, _)| answer.response.clone()).collect();
    let mut fuzzer = Fuzzer::new(corpus, Seed::new(arguments.seed).fork("fuzz"));
    let mut fuzzed = Fuzzed::default();
    let mut clock = cpu_clock();
    let begin = clock();
    let bar = printer.progress("fuzzing", arguments.count);
    let goes_on = |fuzzed: &Fuzzed, now: f64| match arguments.minutes {
        Some(minutes) => now - begin < minutes * 60.0,
        None => fuzzed.executions < arguments.count as u64,
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
        bar.inc(1);
    }
    bar.finish_and_clear();
    fuzzed.cpu_s = clock() - begin;
    fuzzed.kept = fuzzer.kept();
    fuzzed
}

fn in_words(measurement: &Measurement) -> String {
    let mut lines = vec![["worst case", "bytes", "verdict", "ms"].map(String::from).to_vec()];
    for row in &measurement.worst_cases {
        lines.push(vec![row.name.clone(), row.bytes.to_string(), row.verdict.into(), format!("{:.2}", row.cpu_ms)]);
    }
    let fuzzed = &measurement.fuzzed;
    let mut text = format!(
        "{}\nrecorded  {:?}; {} of {} as expected\nworst     {:.2} ms\n\
         fuzzed    {} texts in {:.0} s, {:?}, {} kept, slowest {:.2} ms ({} bytes), {} broken\n",
        table(&lines).trim_end(),
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
