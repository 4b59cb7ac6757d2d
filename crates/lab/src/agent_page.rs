//! Data of the failure page that `genmanip-lab agent` writes.

use std::collections::BTreeMap;

use genmanip_agent::ask::{TranscriptEvent, TranscriptRecorder};
use genmanip_agent_sim::EpisodeJudgements;
use genmanip_benchmark::{CaseMoment, FailureCase, FailurePage, KindFailures};
use genmanip_core::{AgentFailure, EpisodeResult, FailureClass, TaskKind};

/// Collector of the page's data, filled episode by episode.
#[derive(Default)]
pub(crate) struct Gathered {
    kinds: BTreeMap<&'static str, (usize, BTreeMap<FailureClass, usize>)>,
    relations: BTreeMap<(String, String), usize>,
    checks: [[usize; 2]; 2],
    cases: BTreeMap<FailureClass, FailureCase>,
}

impl Gathered {
    /// Counts an episode; the first failed episode of each class is kept as an example with its images.
    pub(crate) fn add(
        &mut self,
        kind: TaskKind,
        result: &EpisodeResult,
        judgements: &EpisodeJudgements,
        transcribed: &TranscriptRecorder,
    ) {
        let (episodes, causes) = self.kinds.entry(kind.name()).or_default();
        *episodes += 1;
        for (meant, came) in &judgements.placed {
            let came = came.map_or("nothing", |relation| relation.name());
            *self.relations.entry((meant.name().to_owned(), came.to_owned())).or_default() += 1;
        }
        for (row, counts) in self.checks.iter_mut().zip(judgements.checks) {
            row.iter_mut().zip(counts).for_each(|(sum, count)| *sum += count);
        }
        let Some(failure) = &result.agent_failure else { return };
        let Some(class) = failure.class else { return };
        *causes.entry(class).or_default() += 1;
        self.cases.entry(class).or_insert_with(|| case(result, (class, failure), transcribed));
    }

    /// Data of the page; failure classes in their fixed order, those that never occurred included.
    pub(crate) fn page(&self, title: &str, oracle: bool) -> FailurePage {
        let causes = |counts: &BTreeMap<FailureClass, usize>| {
            let count = |class: FailureClass| (class.name().to_owned(), counts.get(&class).copied().unwrap_or(0));
            FailureClass::ALL.into_iter().map(count).collect()
        };
        let kinds = self.kinds.iter().map(|(kind, (episodes, counts))| KindFailures {
            kind: (*kind).to_owned(),
            episodes: *episodes,
            causes: causes(counts),
        });
        FailurePage {
            title: title.into(),
            oracle,
            kinds: kinds.collect(),
            relations: self.relations.clone(),
            checks: self.checks,
            cases: self.cases.values().cloned().collect(),
        }
    }
}

fn case(
    result: &EpisodeResult,
    (class, blamed): (FailureClass, &AgentFailure),
    transcribed: &TranscriptRecorder,
) -> FailureCase {
    let transcript = transcribed.transcript();
    let pictures: BTreeMap<String, Vec<u8>> =
        transcribed.pictures().into_iter().filter_map(|(name, picture)| Some((name, picture.png().ok()?))).collect();
    let moment = |moment: &TranscriptEvent| match moment {
        TranscriptEvent::Asked(exchange) => CaseMoment {
            title: format!(
                "ask {}, {}: {}",
                exchange.ask,
                exchange.stage.name().replace('_', " "),
                exchange.instruction
            ),
            text: match &exchange.refused {
                Some(refused) => format!("{} ({refused})", exchange.answer),
                None => exchange.answer.clone(),
            },
            is_blamed: blamed.ask == Some(exchange.ask),
            pictures: (exchange.pictures.iter().chain(&exchange.chosen))
                .filter_map(|name| pictures.get(name).cloned())
                .collect(),
        },
        TranscriptEvent::Acted { time_s, what } => {
            CaseMoment { title: format!("{time_s:.1} s"), text: what.clone(), ..CaseMoment::default() }
        }
    };
    FailureCase {
        cause: class.name().into(),
        id: result.id.clone(),
        instruction: transcript.instruction.clone(),
        evidence: blamed.evidence.clone(),
        moments: transcript.moments.iter().map(moment).collect(),
    }
}
