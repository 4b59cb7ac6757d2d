//! Transcript of an agent's episode as an HTML page, stored beside its images.

use genmanip_agent::ask::{Exchange, Transcript, TranscriptEvent};
use genmanip_core::AgentFailure;
use genmanip_viz::markup::escape;

/// HTML page of a transcript: the agent's questions with their images, the answers, and the actions of the arm, in
/// order.
///
/// `blamed` is the analysis of a failed episode; the page shows its class, stage and question. Images are linked by
/// their file names, so the page must be in the folder of the images. It needs no scripts, and is also well-formed XML.
pub fn transcript_page(transcript: &Transcript, blamed: Option<&AgentFailure>) -> String {
    let Transcript { instruction, preset, moments, failure } = transcript;
    let asked = moments.iter().filter(|moment| matches!(moment, TranscriptEvent::Asked(_))).count();
    let exchanges = moments.iter().filter_map(|moment| match moment {
        TranscriptEvent::Asked(exchange) => exchange.usage,
        TranscriptEvent::Acted { .. } => None,
    });
    let tokens: u64 = exchanges.map(|usage| usage.prompt_tokens + usage.completion_tokens).sum();
    let tokens = if tokens > 0 { format!(", {tokens} tokens") } else { String::new() };
    let failure = failure.as_ref().map_or_else(String::new, |failure| {
        format!("<p class=\"failed\">Ended at {}</p>\n", escape(&failure.to_string()))
    });
    format!(
        concat!(
            "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\" />\n",
            "<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\" />\n",
            "<meta name=\"color-scheme\" content=\"light dark\" />\n",
            "<title>{instruction}</title>\n<style>\n{style}</style>\n</head>\n<body>\n<main>\n<h1>{instruction}</h1>\n",
            "<p class=\"facts\">Agent, preset {preset}: {asked} questions{tokens}, {picks} picks</p>\n",
            "{failure}{blame}<ol>\n{moments}</ol>\n</main>\n</body>\n</html>\n"
        ),
        instruction = escape(instruction),
        style = include_str!("transcript_page.css"),
        preset = escape(preset),
        asked = asked,
        tokens = tokens,
        picks = transcript.picks(),
        failure = failure,
        blame = blamed.map_or_else(String::new, blame),
        moments = moments.iter().map(|it| moment(it, blamed.and_then(|blamed| blamed.ask))).collect::<String>(),
    )
}

/// HTML of a failure's class, stage and evidence, with a link to the question.
fn blame(blamed: &AgentFailure) -> String {
    let AgentFailure { class, stage, ask, evidence, .. } = blamed;
    let class = class.map_or_else(|| "unclassified".to_owned(), |class| class.name().replace('_', " "));
    let question = ask.map_or_else(String::new, |ask| format!(", <a href=\"#ask-{ask}\">question {ask}</a>"));
    let stage = stage.name().replace('_', " ");
    format!("<p class=\"failed\">Failure: {class}, stage {stage}{question}: {}</p>\n", escape(evidence))
}

/// HTML of an event; the question with number `blamed` is marked.
fn moment(moment: &TranscriptEvent, blamed: Option<usize>) -> String {
    match moment {
        TranscriptEvent::Acted { time_s, what } => {
            format!("<li class=\"acted\"><p><b>{time_s:.1} s</b> The arm {}.</p></li>\n", escape(what))
        }
        TranscriptEvent::Asked(exchange) => asked(exchange, blamed == Some(exchange.ask)),
    }
}

fn asked(exchange: &Exchange, is_blamed: bool) -> String {
    let Exchange { ask, stage, prompt, instruction, pictures, chosen, answer, refused, usage } = exchange;
    let stage = stage.name().replace('_', " ");
    let images: String = pictures
        .iter()
        .map(|name| (name, "Image"))
        .chain(chosen.iter().map(|name| (name, "Answer in the image")))
        .map(|(name, what)| {
            let (name, about) = (escape(name), escape(&format!("{what} of question {ask}: {name}")));
            format!("<a href=\"{name}\"><img src=\"{name}\" alt=\"{about}\" loading=\"lazy\" /></a>")
        })
        .collect();
    let refused = refused
        .as_ref()
        .map_or_else(String::new, |reason| format!("<p class=\"failed\">Rejected: {}</p>", escape(reason)));
    let usage = usage
        .map_or_else(String::new, |usage| format!(", {} + {} tokens", usage.prompt_tokens, usage.completion_tokens));
    format!(
        concat!(
            "<li class=\"asked{blamed}\" id=\"ask-{ask}\"><h2>Question {ask}: {stage}</h2>\n<div class=\"images\">{images}</div>\n",
            "<details><summary>{prompt} version {version}{usage}</summary><pre>{instruction}</pre></details>\n",
            "<pre class=\"answer\">{answer}</pre>{refused}</li>\n"
        ),
        ask = ask,
        blamed = if is_blamed { " blamed" } else { "" },
        stage = escape(&stage),
        images = images,
        prompt = escape(&prompt.id),
        version = prompt.version,
        usage = usage,
        instruction = escape(instruction),
        answer = escape(answer),
        refused = refused,
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use genmanip_agent::ask::{PromptStamp, QuestionKind};
    use genmanip_core::{AgentStage, FailureClass};
    use genmanip_llm::Usage;

    #[test]
    fn the_page_shows_questions_images_answers_and_actions_in_order() {
        let prompt = PromptStamp { id: "agent.object".into(), version: 3, sha256: "0".into() };
        let exchange = Exchange {
            ask: 4,
            stage: QuestionKind::Object,
            prompt,
            instruction: "Which <mark> is the cup?".into(),
            pictures: vec!["004_object_overview.png".into()],
            chosen: Some("004_object_chosen.png".into()),
            answer: "{\"mark\": 2}".into(),
            refused: Some("there is no mark 2".into()),
            usage: Some(Usage { prompt_tokens: 700, completion_tokens: 12 }),
        };
        let transcript = Transcript {
            instruction: "Put the cup & the lid away.".into(),
            preset: "full".into(),
            moments: vec![
                TranscriptEvent::Asked(exchange),
                TranscriptEvent::Acted { time_s: 2.25, what: "takes the cup".into() },
            ],
            failure: None,
        };
        let blamed = AgentFailure {
            class: Some(FailureClass::GraspGrounding),
            stage: AgentStage::Object,
            ask: Some(4),
            evidence: "the mask is that of Lid".into(),
            transcript: None,
        };
        assert!(!transcript_page(&transcript, None).contains("asked blamed"));
        let page = transcript_page(&transcript, Some(&blamed));
        let places = [
            "<h1>Put the cup &amp; the lid away.</h1>",
            "preset full: 1 questions, 712 tokens, 1 picks",
            "Failure: grasp grounding, stage object, <a href=\"#ask-4\">question 4</a>: the mask is that of Lid",
            "<li class=\"asked blamed\" id=\"ask-4\">",
            "Question 4: object",
            "src=\"004_object_overview.png\"",
            "src=\"004_object_chosen.png\"",
            "agent.object version 3, 700 + 12 tokens",
            "Which &lt;mark&gt; is the cup?",
            "{&quot;mark&quot;: 2}",
            "Rejected: there is no mark 2",
            "<b>2.2 s</b> The arm takes the cup.",
        ]
        .map(|expected| page.find(expected).unwrap_or_else(|| panic!("{expected} in {page}")));
        assert!(places.is_sorted(), "{places:?}");
    }
}
