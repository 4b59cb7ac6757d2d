//! Adversarial texts for the answer parser: constructed worst cases, and a mutation fuzzer.
//!
//! For tests and measurements; a language model's output is untrusted input.

use std::collections::BTreeSet;

use genmanip_core::Seed;
use rand::{Rng, RngExt};

use super::{AnswerReport, MAX_ANSWER_BYTES, TaskRequest, Verdict, check_answer};

/// Tokens that parsers often have trouble with.
const TOKENS: [&str; 40] = [
    "{",
    "}",
    "[",
    "]",
    "\"",
    "'",
    ":",
    ",",
    "\\",
    "\\u",
    "\\ud800",
    "//",
    "/*",
    "*/",
    "#",
    "\n",
    "```",
    "```json\n",
    "null",
    "None",
    "true",
    "NaN",
    "-",
    "1e999",
    "-0",
    "00",
    "\u{0}",
    "\u{a0}",
    "é",
    "\u{1F600}",
    "\"none\"",
    "\"instruction\"",
    "\"goal_conditions\"",
    "\"scene_graph\"",
    "\"edges\"",
    "\"nodes\"",
    "\"obj1_uid\"",
    "\"position\"",
    "{}",
    "[]",
];

/// Maximum length of a fuzzed text, bytes; the constructed worst cases are longer.
const MAX_FUZZED_BYTES: usize = 1 << 16;

/// Maximum number of texts in the fuzzer's corpus.
const MAX_KEPT: usize = 2000;

/// Worst cases with their names, most of them of [`MAX_ANSWER_BYTES`].
pub fn worst_cases() -> Vec<(&'static str, String)> {
    let most = MAX_ANSWER_BYTES;
    let filled = |unit: &str, around: usize| unit.repeat((most - around) / unit.len());
    let repeated = |unit: &str| filled(unit, 0);
    let wrapped =
        |before: &str, unit: &str, after: &str| format!("{before}{}{after}", filled(unit, before.len() + after.len()));
    let answer = |goal: &str, edges: &str, nodes: &str| {
        format!(
            r#"{{"instruction":"x","goal_conditions":{goal},"scene_graph":{{"description":"","edges":[{edges}],"nodes":[{nodes}]}}}}"#
        )
    };
    let edge = |one: &str, other: &str| {
        format!(r#"{{"obj1":"none","obj1_uid":"{one}","position":"left","obj2":"none","obj2_uid":"{other}"}}"#)
    };
    let listed = |unit: &str, count: usize| vec![unit; count].join(",");
    let long = "a".repeat(most / 4);
    let levels = most / 12;
    let around = answer("[[]]", "", "").len() + 4;
    let edges = |unit: String| answer("[[]]", &listed(&unit, (most - around) / (unit.len() + 1)), "");
    let long_names = |letter: &str| letter.repeat(3900);
    vec![
        ("open braces", repeated("{")),
        ("open brackets", repeated("[")),
        ("open keys", repeated("{\"")),
        ("nested objects", repeated("{'a':")),
        ("nested and closed", "{\"a\":".repeat(levels) + "1" + &"}".repeat(levels)),
        ("nested lists", wrapped("{\"edges\":", "[", "")),
        ("fences", repeated("```{")),
        ("fences that end", repeated("```{}```")),
        ("fences and prose", repeated("``` {a} ")),
        ("unterminated quotes", repeated("{\"a\": \"b ")),
        ("unterminated single quotes", repeated("{'")),
        ("one endless text", wrapped("{\"instruction\":\"", "x", "")),
        ("comments", wrapped("{", "//\n", "}")),
        ("block comments", wrapped("{", "/**/", "}")),
        ("open block comments", repeated("{/*")),
        ("a long block comment", wrapped("{/*", "* ", "")),
        ("hash comments", repeated("{#\n")),
        ("spaces", wrapped("{", " ", "}")),
        ("no-break spaces", wrapped("{", "\u{a0}", "}")),
        ("small objects", repeated("{a:1}")),
        ("small answers", repeated("{\"edges\":1,\"instruction\":1}")),
        ("different answers", repeated("{\"instruction\":1}{\"instruction\":2}")),
        ("repeated keys", wrapped("{", "\"a\":1,", "}")),
        ("repeated keys with lists", wrapped("{", "\"a\":[[1],[2]],", "}")),
        ("keys that differ at last", {
            let value = format!("[{}]", listed("1", 4000));
            wrapped("{\"instruction\":1,", &format!("\"a\":{value},"), "\"a\":2}")
        }),
        ("nested repeated keys", repeated("{\"a\":1,\"a\":")),
        ("numbers", wrapped("{\"edges\":[", "1,", "1]}")),
        ("long numbers", wrapped("{\"edges\":", "9", "}")),
        ("number signs", wrapped("{\"edges\":", "-+.eE", "}")),
        ("escapes", wrapped("{\"instruction\":\"", "\\n", "\"}")),
        ("unicode escapes", wrapped("{\"instruction\":\"", "\\ud83d\\ude00", "\"}")),
        ("half surrogates", wrapped("{\"instruction\":\"", "\\ud83d", "\"}")),
        ("control characters", wrapped("{\"instruction\":\"", "\n", "\"}")),
        ("emoji", wrapped("{\"instruction\":\"", "\u{1F600} ", "\"}")),
        ("emoji as prose", repeated("\u{1F600}{")),
        ("edges", edges(edge("027", "001"))),
        ("edges of strangers", edges(edge("070", "table"))),
        ("empty edges", edges("{}".into())),
        ("256 edges with long names", {
            let one = edge(&long_names("a"), "001");
            answer("[[]]", &listed(&one, 256), "")
        }),
        ("256 strangers with long names", {
            let all: Vec<String> = (0..256).map(|index| edge(&format!("{index}{}", long_names("o")), "001")).collect();
            answer("[[]]", &all.join(","), "")
        }),
        ("a goal of conditions", {
            let condition = edge("027", "001").replace("\"position\"", "\"obj1_state\":\"none\",\"position\"");
            let conjunction = format!("[{}]", listed(&condition, 30));
            answer(&format!("[{}]", listed(&conjunction, 45)), "", "")
        }),
        ("a goal of empty lists", answer(&format!("[{}]", listed("[]", 5000)), "", "")),
        ("long everything", {
            let texts = format!(r#"{{"obj_uid":"{long}","state":"{long}"}}"#);
            answer("[[]]", "", &texts)
        }),
        ("long keys", { format!(r#"{{"instruction":"","{long}":1,"{long}b":1,"{long}c":1}}"#) }),
        ("many unknown keys", {
            let keys: Vec<String> = (0..9000).map(|index| format!("\"{index}{}\":1", "k".repeat(90))).collect();
            format!("{{\"instruction\":\"\",{}}}", keys.join(","))
        }),
        ("a long instruction", {
            let words = filled("word ", around);
            answer("[[]]", "", "").replacen("\"x\"", &format!("\"{words}\""), 1)
        }),
        ("a wrapped wrapper", wrapped("{\"task\":{\"task\":{\"instruction\":\"", "x", "\"}}}")),
        ("one byte too long", "{".repeat(most + 1)),
    ]
}

/// Mutation fuzzer that keeps texts with a new combination of flaws.
pub struct Fuzzer {
    /// Initial texts, then the texts kept, each with the index of the initial text from which it derives.
    corpus: Vec<(usize, String)>,
    given: usize,
    outcomes: BTreeSet<String>,
    seed: Seed,
    made: u64,
}

impl Fuzzer {
    /// Starts from a corpus; `{}` if it is empty.
    pub fn new(corpus: Vec<String>, seed: Seed) -> Self {
        let corpus = if corpus.is_empty() { vec!["{}".into()] } else { corpus };
        let corpus: Vec<(usize, String)> = corpus.into_iter().enumerate().collect();
        Self { given: corpus.len(), corpus, outcomes: BTreeSet::new(), seed, made: 0 }
    }

    /// The next text, and the index of the initial text it derives from.
    pub fn text(&mut self) -> (usize, String) {
        let rng = &mut self.seed.fork_index(self.made).rng();
        self.made += 1;
        // Half of the texts derive directly from initial texts, because most of the texts kept are broken.
        let choices = if rng.random_bool(0.5) { self.given } else { self.corpus.len() };
        let (origin, text) = &self.corpus[rng.random_range(0..choices)];
        let mut bytes = text.clone().into_bytes();
        for _ in 0..[1, 1, 1, 2, 3, 8][rng.random_range(0..6)] {
            let (_, other) = &self.corpus[rng.random_range(0..self.corpus.len())];
            mutate(&mut bytes, other.as_bytes(), rng);
        }
        bytes.truncate(MAX_FUZZED_BYTES);
        (*origin, String::from_utf8_lossy(&bytes).into_owned())
    }

    /// Keeps a text whose report has a new combination of verdict and flaws.
    pub fn learn(&mut self, origin: usize, text: &str, report: &AnswerReport) {
        let kinds: BTreeSet<String> =
            report.flaws.iter().map(|flaw| format!("{}{}", flaw.kind.name(), flaw.repaired)).collect();
        let outcome = format!("{:?} {kinds:?}", report.verdict);
        if self.corpus.len() < MAX_KEPT && self.outcomes.insert(outcome) {
            self.corpus.push((origin, text.to_owned()));
        }
    }

    /// Number of texts in the corpus.
    pub fn kept(&self) -> usize {
        self.corpus.len()
    }
}

/// Violated invariant that must hold for every text: verdict, task and flaws of a report agree, and a second check
/// gives the same report. `None` if all hold.
pub fn inconsistency(text: &str, request: &TaskRequest, report: &AnswerReport) -> Option<&'static str> {
    let rejecting = report.flaws.iter().any(|flaw| !flaw.repaired);
    match report.verdict {
        Verdict::Rejected if report.task.is_some() => Some("a task was made of a rejected answer"),
        Verdict::Rejected if report.flaws.is_empty() => Some("rejected without a reason"),
        Verdict::Valid if !report.flaws.is_empty() => Some("valid in spite of a flaw"),
        Verdict::Valid | Verdict::Repaired if report.task.is_none() => Some("accepted without a task"),
        Verdict::Valid | Verdict::Repaired if rejecting => Some("accepted in spite of a flaw"),
        Verdict::Repaired if report.repairs.is_empty() => Some("repaired without saying how"),
        _ if check_answer(text, request) != *report => Some("judged otherwise the second time"),
        _ => None,
    }
}

fn mutate(bytes: &mut Vec<u8>, other: &[u8], rng: &mut impl Rng) {
    let at = rng.random_range(0..=bytes.len());
    let end = (at + (1 << rng.random_range(0..9))).min(bytes.len());
    match rng.random_range(0..12) {
        0 => drop(bytes.drain(at..end)),
        1 => bytes.truncate(at.max(1)),
        2 => drop(bytes.splice(at..at, TOKENS[rng.random_range(0..TOKENS.len())].bytes())),
        3 => drop(bytes.splice(at..end, TOKENS[rng.random_range(0..TOKENS.len())].bytes())),
        4 => {
            // Duplicates up to 256 bytes 1 to 32 times.
            let part = bytes[at..end].repeat(1 << rng.random_range(0..6));
            drop(bytes.splice(at..at, part));
        }
        5 => {
            let from = rng.random_range(0..=other.len());
            let part = &other[from..(from + (1 << rng.random_range(0..10))).min(other.len())];
            drop(bytes.splice(at..end, part.iter().copied()));
        }
        6..=9 => {
            // Replaces a value or object by another.
            let begins = |bytes: &[u8], byte: u8, from: usize| {
                bytes[from.min(bytes.len())..].iter().position(|&own| own == byte).map(|offset| from + offset)
            };
            let quote = [b'"', b'{', b'['][rng.random_range(0..3)];
            let close = match quote {
                b'{' => b'}',
                b'[' => b']',
                other => other,
            };
            if let Some(start) = begins(bytes, quote, at)
                && let Some(stop) = begins(bytes, close, start + 1)
                && let Some(from) = begins(other, quote, rng.random_range(0..=other.len()))
                && let Some(to) = begins(other, close, from + 1)
            {
                drop(bytes.splice(start..=stop, other[from..=to].iter().copied()));
            }
        }
        10 => {
            for byte in &mut bytes[at..end] {
                *byte = rng.random_range(0..128);
            }
        }
        _ => {
            if let Some(byte) = bytes.get_mut(at) {
                *byte ^= 1 << rng.random_range(0..8);
            }
        }
    }
    bytes.truncate(4 * MAX_FUZZED_BYTES);
}
