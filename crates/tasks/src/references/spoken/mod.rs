//! Reader of requests as people say them, for which the plain grammar is too narrow.
//!
//! A sentence is first brought into a plain form ([`normal`]): one spelling, no contractions, courtesies or adverbs of
//! manner. What it tells about the robot becomes a request ([`actors`]), and what it takes back is left out
//! ([`repairs`]). Then its clauses are read one after another ([`clauses`]); each is a request with a verb of a known
//! class ([`requests`], [`states`], [`towers`], [`frames`]), a request within words of politeness ([`courtesy`]), a wish
//! or statement of where or how something should be, a noun phrase with a place, a fact about the initial scene
//! ([`wishes`]), or an aside. Noun phrases ([`nouns`]) and places ([`places`], [`sides`], [`sources`]) are the same
//! everywhere. A clause of another form is not guessed: the reader says which words it did not understand.

mod actors;
mod clauses;
mod courtesy;
mod frames;
mod listener;
mod normal;
mod nouns;
mod places;
mod repairs;
mod requests;
mod sides;
mod sources;
mod states;
mod towers;
mod verbs;
mod wishes;
mod words;

use genmanip_core::Relation;

use super::change::Action;
use super::command::{Command, Group, Parsed};
use listener::Listener;

/// Reads a sentence; otherwise the reason why it is no request, as a message to its author.
pub(super) fn hear(text: &str) -> Result<Parsed, String> {
    let mut listener = Listener::new(repairs::repaired(actors::addressed(normal::tokens(text)))?);
    listener.check_measures()?;
    let mut parsed = Parsed::default();
    loop {
        listener.skip_courtesies();
        if listener.is_done() {
            break;
        }
        listener.check_mood()?;
        if let Some(commands) = listener.request().or_else(|| listener.late()) {
            // `open the cupboard and leave it open`
            for command in commands {
                if !parsed.commands.contains(&command) {
                    parsed.commands.push(command);
                }
            }
        } else if let Some(aside) = listener.aside() {
            parsed.context += &format!(" {aside}");
        } else {
            return Err(listener.complaint());
        }
    }
    parsed.commands.extend(listener.put_freed());
    if let Some(taken) = listener.mind.pending.first() {
        return Err(format!("no place is given for `{}`", taken.words.join(" ")));
    }
    reclose(&mut parsed.commands);
    let is_request = |command: &Command| !matches!(command, Command::Given(_));
    if parsed.commands.iter().any(is_request) { Ok(parsed) } else { Err("it asks for nothing".into()) }
}

/// Joins `open the drawer` and `close it` if something is put inside in between: only the end counts.
fn reclose(commands: &mut Vec<Command>) {
    let changes = |command: &Command, wanted: Action, owner: &Group| matches!(command, Command::Change { object, action, .. } if object.words == owner.words && *action == wanted);
    let fills = |command: &Command, owner: &Group| match command {
        Command::Put { places, .. } => places.iter().any(|place| {
            place.relations.contains(&Relation::In) && place.objects.iter().any(|object| object.words == owner.words)
        }),
        _ => false,
    };
    let joined = commands.iter().enumerate().find_map(|(opened, command)| {
        let Command::Change { object, action: Action::Open, .. } = command else { return None };
        let closed = (opened + 1..commands.len()).find(|&at| changes(&commands[at], Action::Close, object))?;
        commands[opened..closed].iter().any(|command| fills(command, object)).then_some((opened, closed))
    });
    if let Some((opened, closed)) = joined {
        if let Command::Change { action, .. } = &mut commands[closed] {
            *action = Action::Reclose;
        }
        commands.remove(opened);
    }
}
