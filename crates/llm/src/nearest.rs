//! Nearest recorded request to one without a recording, and their first difference.

use std::collections::BTreeMap;

use crate::error::{NearestCassette, shortened};
use crate::recorded::{RecordedMessage, RecordedPart, RecordedText};
use crate::request::RecordedRequest;

/// Cassette with the largest share of common lines; the first of equals. `None` without cassettes.
pub(crate) fn nearest(asked: &RecordedRequest, cassettes: &[(String, RecordedRequest)]) -> Option<NearestCassette> {
    let wanted = lines(asked);
    let mut best: Option<(f64, &(String, RecordedRequest))> = None;
    for cassette in cassettes {
        let similarity = similarity(&wanted, &lines(&cassette.1));
        if best.is_none_or(|(most, _)| similarity > most) {
            best = Some((similarity, cassette));
        }
    }
    best.map(|(_, (file, recorded))| NearestCassette { file: file.clone(), difference: difference(asked, recorded) })
}

/// Multiset of the lines of all texts, with one line per image.
fn lines(request: &RecordedRequest) -> BTreeMap<String, usize> {
    let mut counts = BTreeMap::from([(request.model.clone(), 1)]);
    for piece in request.messages.iter().flat_map(pieces) {
        for line in piece.lines() {
            *counts.entry(line.to_owned()).or_default() += 1;
        }
    }
    counts
}

/// Parts of a message as texts.
fn pieces(message: &RecordedMessage) -> Vec<String> {
    let text = |text: &RecordedText| text.0.clone();
    let part = |part: &RecordedPart| match part {
        RecordedPart::Text(words) => text(words),
        RecordedPart::Image(image) => image.to_string(),
    };
    message.text.iter().map(text).chain(message.parts.iter().map(part)).collect()
}

/// Jaccard index of two multisets of lines.
fn similarity(a: &BTreeMap<String, usize>, b: &BTreeMap<String, usize>) -> f64 {
    let common: usize = a.iter().map(|(line, count)| (*count).min(b.get(line).copied().unwrap_or(0))).sum();
    let all = a.values().sum::<usize>() + b.values().sum::<usize>() - common;
    common as f64 / all.max(1) as f64
}

fn difference(asked: &RecordedRequest, recorded: &RecordedRequest) -> String {
    let differs = |place: String, asked: &str, recorded: &str| {
        format!("{place}: asked {:?}, recorded {:?}", shortened(asked, 80), shortened(recorded, 80))
    };
    if asked.model != recorded.model {
        return differs("model".into(), &asked.model, &recorded.model);
    }
    for (index, (a, b)) in asked.messages.iter().zip(&recorded.messages).enumerate() {
        if a.role != b.role {
            return differs(format!("messages[{index}].role"), &format!("{:?}", a.role), &format!("{:?}", b.role));
        }
        let (ours, theirs) = (pieces(a), pieces(b));
        let is_one_text = a.parts.is_empty() && b.parts.is_empty();
        for part in 0..ours.len().max(theirs.len()) {
            let lines = |pieces: &[String]| -> Vec<String> {
                pieces.get(part).into_iter().flat_map(|piece| piece.split('\n')).map(String::from).collect()
            };
            let (ours, theirs) = (lines(&ours), lines(&theirs));
            for line in 0..ours.len().max(theirs.len()) {
                let (x, y) = (ours.get(line), theirs.get(line));
                if x != y {
                    let part = if is_one_text { String::new() } else { format!(" part {part}") };
                    let place = format!("messages[{index}]{part} line {}", line + 1);
                    let shown = |line: Option<&String>| line.map_or("nothing".to_owned(), String::clone);
                    return differs(place, &shown(x), &shown(y));
                }
            }
        }
    }
    if asked.messages.len() != recorded.messages.len() {
        return differs(
            "the number of messages".into(),
            &asked.messages.len().to_string(),
            &recorded.messages.len().to_string(),
        );
    }
    if asked.parameters != recorded.parameters {
        let text = |request: &RecordedRequest| serde_json::to_string(&request.parameters).unwrap_or_default();
        return differs("parameters".into(), &text(asked), &text(recorded));
    }
    "reply_schema".into()
}
