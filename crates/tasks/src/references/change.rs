//! Changes of state: the part that a phrase names, and the action of a verb with its particle.

/// Part of an articulated object.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Part {
    Upper,
    Lower,
    Both,
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
}

/// Removes the part from a noun phrase such as `microwave door` or `cabinet's top drawer`; `None` if it names none.
pub(super) fn own_part(words: &mut Vec<String>) -> Option<Part> {
    let part = match words.last()?.as_str() {
        "door" | "lid" | "flap" | "screen" if words.len() > 1 => Part::Other,
        "drawer" | "drawers" => {
            let before = words.len().checked_sub(2).and_then(|index| words.get(index));
            let part = match before.map(String::as_str) {
                Some("top" | "upper") => Part::Upper,
                Some("bottom" | "lower") => Part::Lower,
                Some("both") => Part::Both,
                _ => return None,
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

/// The action of a verb with its particle; `None` if they do not go together.
pub(super) fn action(verb: &str, particle: Option<&str>) -> Option<Action> {
    Some(match (verb, particle) {
        ("open" | "lift" | "raise", None | Some("up")) | ("pull", Some("out" | "open")) => Action::Open,
        ("flip" | "swing" | "push" | "open", Some("open")) => Action::Open,
        ("close" | "lower", None | Some("down")) | ("push" | "fold" | "pull", Some("shut")) | ("shut", None) => {
            Action::Close
        }
        ("turn" | "switch" | "flip", Some("on")) => Action::On,
        ("turn" | "switch" | "shut" | "set" | "flip", Some("off" | "to off")) => Action::Off,
        ("turn" | "set", Some("to low" | "down to low" | "on low")) => Action::Low,
        ("turn" | "set", Some("to high" | "all the way up" | "up to high" | "on high")) => Action::High,
        ("press" | "hit" | "push", None) | ("press" | "push", Some("down")) => Action::Press,
        _ => return None,
    })
}
