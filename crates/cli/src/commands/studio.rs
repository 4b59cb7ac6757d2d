//! `genmanip studio`: scenario editor in the browser, which validates every change immediately.

use std::net::{Ipv4Addr, SocketAddr};
use std::process::{Command, Stdio};

use genmanip_studio::collections::Collection;
use genmanip_studio::run::{OfferedPolicies, find_episode};
use genmanip_studio::server::{self, StudioSettings, Token};

use super::plural;
use crate::args::StudioArguments;
use genmanip_terminal::Printer;
use genmanip_terminal::{ExitStatus, Failed, environment};

pub fn run(arguments: &StudioArguments, printer: &Printer) -> Result<ExitStatus, Failed> {
    let StudioArguments { paths, out, port, no_open, allow_others, episode, policies, questions, review, author } =
        arguments;
    let policies = OfferedPolicies::new(policies)?;
    let collection = Collection::open(paths, out, printer)?;
    collection.left_out.iter().for_each(|message| printer.say(message));
    let scenarios = collection.iter().count();
    if scenarios == 0 {
        return Err(Failed::new("there is no scenario to show").hint("name scenario files, a suite, a run or tasks"));
    }
    let fragment = episode.as_deref().map_or(Ok(String::new()), |name| fragment_of(&collection, name))?;
    let no_token = |error| Failed::because("the system gives no random numbers for a token", &error);
    let token = allow_others.then(Token::random).transpose().map_err(no_token)?;
    let address = SocketAddr::from((if *allow_others { Ipv4Addr::UNSPECIFIED } else { Ipv4Addr::LOCALHOST }, *port));
    let settings = StudioSettings {
        address,
        out: out.clone(),
        author: author.clone().or_else(git_author).or_else(user).unwrap_or_else(|| "somebody".into()),
        token: token.clone(),
        policies,
        questions: questions.clone(),
        review: review.read(printer)?,
    };
    let server = server::start(collection, settings)
        .map_err(|error| Failed::because("the studio cannot be opened", &error).hint("choose another --port"))?;
    let secret = token.map_or_else(String::new, |token| format!("?token={}", token.text()));
    let own = format!("http://127.0.0.1:{}/{secret}{fragment}", server.address().port());
    printer.say(format!("studio with {} at {own}; Ctrl-C ends it", plural(scenarios, "scenario")));
    if *allow_others {
        printer.say("from other machines: the same address with the name of this one instead of 127.0.0.1");
    }
    if !no_open && !open_in_browser(&own) {
        printer.say("no browser was opened: open the address yourself");
    }
    server.wait();
    Ok(ExitStatus::Done)
}

/// Fragment of the page's address that opens an episode.
fn fragment_of(collection: &Collection, name: &str) -> Result<String, Failed> {
    let (key, episode) = find_episode(collection, name).ok_or_else(|| {
        Failed::new(format!("no episode `{name}` in what is named"))
            .hint("name its run, and the label of its evaluation: `genmanip studio RUN --episode expert/ID`")
    })?;
    Ok(format!("#{key}/{episode}"))
}

/// Opens an address in the user's browser; false if there is no desktop or it cannot be opened.
fn open_in_browser(address: &str) -> bool {
    let is_mac = cfg!(target_os = "macos");
    let has_desktop = is_mac || environment("DISPLAY").is_some() || environment("WAYLAND_DISPLAY").is_some();
    let program = if is_mac { "open" } else { "xdg-open" };
    let quiet =
        || Command::new(program).arg(address).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null()).spawn();
    has_desktop && quiet().is_ok()
}

/// Author name of git's configuration (`user.name`); `None` without git or a name.
fn git_author() -> Option<String> {
    let output = Command::new("git").args(["config", "user.name"]).stderr(Stdio::null()).output().ok()?;
    let name = String::from_utf8(output.stdout).ok()?.trim().to_owned();
    (output.status.success() && !name.is_empty()).then_some(name)
}

fn user() -> Option<String> {
    environment("USER").or_else(|| environment("USERNAME"))
}
