//! Changes of state: the part that a phrase names, and the action of a verb with its particle.

/// Part of an articulated object.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Part {
    Upper,
    Lower,
    Both,
    /// One of the drawers, whichever.
    Any,
    Other,
}

/// Action that changes the state of an articulated object.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Action {
    Open,
    Close,
    On,
    Off,
    Low,
    High,
    Press,
    /// Open to be filled, and close again.
    Reclose,
}

/// Removes the part from a noun phrase such as `microwave door` or `cabinet's top drawer`; `None` if it names none.
pub(super) fn own_part(words: &mut Vec<String>) -> Option<Part> {
    // `the bin with the flap`
    if words.iter().any(|word| word == "with") {
        return None;
    }
    let part = match words.last()?.as_str() {
        "door" | "lid" | "flap" | "screen" if words.len() > 1 => Part::Other,
        "drawer" | "drawers" => {
            let before = words.len().checked_sub(2).and_then(|index| words.get(index));
            let part = match before.map(String::as_str) {
                Some("top" | "upper") => Part::Upper,
                Some("bottom" | "lower") => Part::Lower,
                Some("both") => Part::Both,
                Some("of" | "two" | "middle" | "third" | "second" | "first") => return None,
                _ => {
                    // `the drawer`, `the cabinet's drawer`
                    let (part, is_noun) = match words.pop()?.as_str() {
                        "drawers" => (Part::Both, before_is_noun(words)),
                        _ => (Part::Any, before_is_noun(words)),
                    };
                    if is_noun {
                        words.iter_mut().for_each(|word| word.truncate(word.trim_end_matches("'s").len()));
                    } else {
                        words.extend(["drawer", "cabinet"].map(String::from));
                    }
                    return Some(part);
                }
            };
            words.truncate(words.len() - 1);
            part
        }
        _ => return None,
    };
    words.truncate(words.len() - 1);
    match words.last_mut() {
        Some(owner) => owner.truncate(owner.trim_end_matches("'s").len()),
        // Only cabinets have two drawers, so `top drawer` alone means a drawer cabinet.
        None => words.extend(["drawer", "cabinet"].map(String::from)),
    }
    Some(part)
}

/// True if the last word of a phrase names an object that has drawers.
fn before_is_noun(words: &[String]) -> bool {
    let last = words.last().map_or("", |word| word.trim_end_matches("'s"));
    ["cabinet", "dresser", "unit", "cupboard"].contains(&last)
}

/// The actions, each with the part it is done to, of which each fulfils a request to an object with these states: any
/// heat of a knob is on, and any drawer may be opened.
pub(crate) fn meanings(action: Action, part: Option<Part>, states: &[String]) -> Vec<(Action, Option<Part>)> {
    let has = |name: &str| states.iter().any(|state| state == name);
    match (action, part) {
        (Action::On, _) if has("low") && !has("on") => vec![(Action::Low, part), (Action::High, part)],
        (Action::Open, Some(Part::Any)) => vec![(action, Some(Part::Upper)), (action, Some(Part::Lower))],
        _ => vec![(action, part)],
    }
}

/// The action of a verb with its particle; `None` if they do not go together.
pub(super) fn action(verb: &str, particle: Option<&str>) -> Option<Action> {
    const HINGED: [&str; 19] = [
        "shove", "nudge", "open", "pull", "slide", "swing", "push", "flip", "lift", "pop", "prop", "crack", "get",
        "leave", "keep", "have", "make", "set", "fold",
    ];
    const SWITCHED: [&str; 15] = [
        "turn", "switch", "flick", "flip", "twist", "put", "get", "leave", "keep", "set", "have", "make", "click",
        "toggle", "snap",
    ];
    const TURNED: [&str; 17] = [
        "turn", "set", "switch", "put", "twist", "crank", "rotate", "dial", "adjust", "get", "flick", "have", "bring",
        "reduce", "increase", "lower", "raise",
    ];
    let Some(particle) = particle else { return alone(verb) };
    Some(match (verb, particle) {
        (_, "open" | "wide open") if HINGED.contains(&verb) => Action::Open,
        (_, "shut" | "closed") if HINGED.contains(&verb) || ["lower", "slam"].contains(&verb) => Action::Close,
        (_, "on") if SWITCHED.contains(&verb) => Action::On,
        (_, "off" | "to off" | "all the way down") if SWITCHED.contains(&verb) || verb == "shut" => Action::Off,
        ("turn" | "twist" | "crank" | "dial" | "rotate", "down") => Action::Low,
        ("turn" | "twist" | "crank" | "dial" | "rotate", "up") => Action::High,
        (_, low) if TURNED.contains(&verb) && low.ends_with("low") => Action::Low,
        (_, high) if TURNED.contains(&verb) && (high.ends_with("high") || high == "all the way up") => Action::High,
        ("draw" | "yank" | "tug" | "slide", "out") => Action::Open,
        ("slide" | "ease", "shut" | "closed") | ("slide" | "ease", "in") => Action::Close,
        ("flip" | "swing" | "tip" | "fold", "up") => Action::Open,
        ("flip" | "swing", "down") => Action::Close,
        ("open", "up" | "out") | ("lift" | "raise", "up") | ("pull", "out") => Action::Open,
        ("close" | "shut", "up") | ("close" | "lower" | "fold", "down") => Action::Close,
        ("press" | "push" | "hit" | "punch", "down" | "in") => Action::Press,
        _ => return None,
    })
}

/// The action of a verb without a particle; `None` if it has none.
fn alone(verb: &str) -> Option<Action> {
    Some(match verb {
        "open" | "lift" | "raise" | "unlatch" | "reopen" => Action::Open,
        "close" | "shut" | "lower" | "slam" | "seal" | "reclose" => Action::Close,
        "press" | "push" | "hit" | "click" | "tap" | "depress" | "trigger" | "punch" | "poke" | "bash" | "smash"
        | "thump" | "jab" | "prod" | "whack" | "strike" => Action::Press,
        "toggle" | "flick" | "flip" | "activate" | "start" | "start up" | "power on" | "power up" | "fire up"
        | "enable" | "engage" => Action::On,
        "deactivate" | "stop" | "power off" | "power down" | "kill" | "shut off" | "shut down" | "disable" => {
            Action::Off
        }
        _ => return None,
    })
}
