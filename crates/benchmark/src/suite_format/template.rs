//! Sentence templates: instructions with their referents blanked.

/// Words that are kept; a run of any other words becomes one blank. Collected by hand from the designer's phrases and
/// from recorded answers.
const FRAME: [&str; 74] = [
    "a", "after", "and", "are", "as", "at", "back", "be", "before", "beside", "between", "both", "bottom", "build",
    "by", "can", "clear", "close", "could", "down", "either", "ends", "far", "finally", "find", "first", "front",
    "get", "go", "grab", "help", "i", "in", "inside", "into", "is", "it", "left", "let", "me", "move", "near", "need",
    "next", "of", "on", "onto", "or", "pick", "place", "please", "put", "right", "robot's", "set", "side", "so",
    "stack", "take", "that", "the", "them", "then", "thing", "tidy", "time", "to", "together", "top", "tower", "up",
    "want", "what", "you",
];

/// The sentence in lower case with its referents blanked, e.g. `put the _ into the _`. Of an instruction that
/// states a need before the request, only the request is used.
///
/// ```
/// # use genmanip_benchmark::suite_format::template;
/// assert_eq!(template("Put the red mug into the wooden box."), "put the _ into the _");
/// assert_eq!(template("Soup is ready. Could you put what I need on the mat?"), template("could you put what I need on the tray"));
/// ```
pub fn template(instruction: &str) -> String {
    let request = instruction.trim_end_matches(['.', '?', '!', ' ']).rsplit(['.', ';']).next().unwrap_or_default();
    let mut words: Vec<&str> = Vec::new();
    let lower = request.to_lowercase();
    for word in lower.split(|c: char| c.is_whitespace() || c == ',' || c == ':').filter(|word| !word.is_empty()) {
        match FRAME.binary_search(&word) {
            Ok(_) => words.push(word),
            Err(_) if words.last() == Some(&"_") => {}
            Err(_) => words.push("_"),
        }
    }
    words.join(" ")
}
