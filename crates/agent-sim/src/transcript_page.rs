//! Transcript of an agent's episode as an HTML page beside its images.

use genmanip_agent::ask::{Exchange, Transcript, TranscriptEvent};
use genmanip_viz::markup::escape;

/// The page: what the agent was asked, with the images that it saw, its answers, and what the arm did, in order.
///
/// Images are named, not embedded: the page belongs into their folder. It is complete without scripts, and also
/// well-formed XML.
pub fn transcript_page(transcript: &Transcript) -> String {
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
            "{failure}<ol>\n{moments}</ol>\n</main>\n</body>\n</html>\n"
        ),
        instruction = escape(instruction),
        style = include_str!("transcript_page.css"),
        preset = escape(preset),
        asked = asked,
        tokens = tokens,
        picks = transcript.picks(),
        failure = failure,
        moments = moments.iter().map(moment).collect::<String>(),
    )
}

fn moment(moment: &TranscriptEvent) -> String {
    match moment {
        TranscriptEvent::Acted { time_s, what } => {
            format!("<li class=\"acted\"><p><b>{time_s:.1} s</b> The arm {}.</p></li>\n", escape(what))
        }
        TranscriptEvent::Asked(exchange) => asked(exchange),
    }
}

fn asked(exchange: &Exchange) -> String {
    let Exchange { ask, stage, prompt, instruction, pictures, answer, refused, usage } = exchange;
    let stage = stage.name().replace('_', " ");
    let images: String = pictures
        .iter()
        .map(|name| {
            let (name, about) = (escape(name), escape(&format!("Image of question {ask}: {name}")));
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
            "<li class=\"asked\" id=\"ask-{ask}\"><h2>Question {ask}: {stage}</h2>\n<div class=\"images\">{images}</div>\n",
            "<details><summary>{prompt} version {version}{usage}</summary><pre>{instruction}</pre></details>\n",
            "<pre class=\"answer\">{answer}</pre>{refused}</li>\n"
        ),
        ask = ask,
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
        let page = transcript_page(&transcript);
        let places = [
            "<h1>Put the cup &amp; the lid away.</h1>",
            "preset full: 1 questions, 712 tokens, 1 picks",
            "Question 4: object",
            "src=\"004_object_overview.png\"",
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
