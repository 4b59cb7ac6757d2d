//! Whether a sentence needs what makes it hard: read again with that left out, does it still say the same?

use genmanip_core::{Task, TaskKind};

use super::grammar::{self, Command, Group, Heard, Place};
use super::lexicon::lexicon;
use super::{Mismatch, is_goal_of, understand};

/// What tells a listener which thing is meant.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Clue {
    /// What is said beside the request: somebody is thirsty.
    Need,
    /// Where a thing is: the cup *that is on the tray*, the bowl *farthest from the robot*.
    Place,
    /// What a thing looks like: the *blue* cup *with the square handle*.
    Trait,
}

/// Words by which a superlative of places begins.
const FARTHEST: [&str; 3] = ["farthest", "nearest", "closest"];

impl Clue {
    /// The clue that tasks of a kind are about; tasks of the other kinds ask for skill, not for understanding.
    pub fn of(kind: TaskKind) -> Option<Self> {
        match kind {
            TaskKind::CommonSense => Some(Self::Need),
            TaskKind::Spatial => Some(Self::Place),
            TaskKind::Appearance => Some(Self::Trait),
            _ => None,
        }
    }

    /// What was heard, without this clue.
    fn left_out(self, mut heard: Heard) -> Heard {
        if self == Self::Need {
            heard.context.clear();
        }
        heard.commands.iter_mut().for_each(|command| each_group(command, &mut |group| self.strip(group)));
        heard
    }

    fn strip(self, group: &mut Group) {
        match self {
            Self::Need => {}
            Self::Place => {
                group.at = None;
                if let Some(index) = group.words.iter().position(|word| FARTHEST.contains(&word.as_str())) {
                    group.words.truncate(index);
                    if group.words.ends_with(&["that".to_owned(), "is".to_owned()]) {
                        group.words.truncate(index - 2);
                    }
                }
            }
            Self::Trait => {
                let words: Vec<&str> = group.words.iter().map(String::as_str).collect();
                group.words = lexicon().bare(&words).into_iter().map(String::from).collect();
            }
        }
    }
}

/// Whether a task's instruction means its goal also without a clue, so that nobody has to understand it.
///
/// ```
/// use genmanip_core::Task;
/// use genmanip_tasks::references::{Clue, is_needless};
/// # fn example(task: &Task) {
/// let is_valid = Clue::of(task.kind).is_none_or(|clue| !is_needless(task, clue));
/// # }
/// ```
pub fn is_needless(task: &Task, clue: Clue) -> bool {
    let Some(heard) = grammar::read(&task.instruction) else { return false };
    let reading = understand(&clue.left_out(heard), &task.objects, &task.scene_graph);
    reading.and_then(|reading| is_goal_of(task, &reading)).is_ok()
}

/// How many things an instruction tells by where they are.
///
/// # Errors
/// [`Mismatch::Unreadable`].
pub fn clues_at_places(task: &Task) -> Result<usize, Mismatch> {
    let unreadable = || Mismatch::Unreadable { phrase: task.instruction.clone() };
    let mut heard = grammar::read(&task.instruction).ok_or_else(unreadable)?;
    let mut count = 0;
    let mut note = |group: &mut Group| {
        let is_farthest = group.words.iter().any(|word| FARTHEST.contains(&word.as_str()));
        count += usize::from(group.at.is_some() || is_farthest);
    };
    heard.commands.iter_mut().for_each(|command| each_group(command, &mut note));
    Ok(count)
}

/// Visits every noun group of a command, those inside of others too.
fn each_group(command: &mut Command, visit: &mut impl FnMut(&mut Group)) {
    fn group(one: &mut Group, visit: &mut impl FnMut(&mut Group)) {
        if let Some(at) = &mut one.at {
            place(at, visit);
        }
        visit(one);
    }
    fn place(one: &mut Place, visit: &mut impl FnMut(&mut Group)) {
        one.objects.iter_mut().for_each(|own| group(own, visit));
    }
    match command {
        Command::Put { subjects, places } => {
            subjects.iter_mut().for_each(|own| group(own, visit));
            places.iter_mut().for_each(|own| place(own, visit));
        }
        Command::Change { object, .. } => group(object, visit),
        Command::Either(commands) => commands.iter_mut().for_each(|own| each_group(own, visit)),
    }
}
