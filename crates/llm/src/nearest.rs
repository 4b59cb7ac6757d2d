//! Which recorded question is most like one that was never recorded, and where the two part.

use std::collections::BTreeMap;

use crate::wire::shortened;
use crate::{Cassette, ChatRequest, NearestCassette};

/// The cassette with the largest share of common lines; the first of equals. `None` without cassettes.
pub(crate) fn nearest(request: &ChatRequest, cassettes: &[(String, Cassette)]) -> Option<NearestCassette> {
    let wanted = lines(request);
    let mut best: Option<(f64, &(String, Cassette))> = None;
    for cassette in cassettes {
        let likeness = likeness(&wanted, &lines(&cassette.1.request));
        if best.is_none_or(|(most, _)| likeness > most) {
            best = Some((likeness, cassette));
        }
    }
    best.map(|(_, (file, cassette))| NearestCassette {
        file: file.clone(),
        difference: difference(request, &cassette.request),
    })
}

fn lines(request: &ChatRequest) -> BTreeMap<&str, usize> {
    let mut counts = BTreeMap::from([(request.model.as_str(), 1)]);
    for line in request.messages.iter().flat_map(|message| message.text.lines()) {
        *counts.entry(line).or_default() += 1;
    }
    counts
}

/// Common lines over all lines, each counted as often as it occurs (Jaccard index of multisets).
fn likeness(a: &BTreeMap<&str, usize>, b: &BTreeMap<&str, usize>) -> f64 {
    let common: usize = a.iter().map(|(line, count)| (*count).min(b.get(line).copied().unwrap_or(0))).sum();
    let all = a.values().sum::<usize>() + b.values().sum::<usize>() - common;
    common as f64 / all.max(1) as f64
}

fn difference(asked: &ChatRequest, recorded: &ChatRequest) -> String {
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
        let (mut ours, mut theirs) = (a.text.split('\n'), b.text.split('\n'));
        for line in 1.. {
            match (ours.next(), theirs.next()) {
                (None, None) => break,
                (x, y) if x != y => {
                    let place = format!("messages[{index}] line {line}");
                    return differs(place, x.unwrap_or("nothing"), y.unwrap_or("nothing"));
                }
                _ => {}
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
        let text = |request: &ChatRequest| serde_json::to_string(&request.parameters).unwrap_or_default();
        return differs("parameters".into(), &text(asked), &text(recorded));
    }
    "reply_schema".into()
}
