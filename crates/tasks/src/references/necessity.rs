//! Finds tasks whose distinctive clue is redundant: read without it, the instruction still states the same goal.

use genmanip_core::{Task, TaskKind};

use super::command::{Command, Group, Parsed, Place};
use super::grammar;
use super::lexicon::lexicon;
use super::{Mismatch, check_goal, understand};

/// A kind of information that identifies an object.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Clue {
    /// A need stated before the request: somebody is thirsty.
    Need,
    /// A location: the cup *that is on the tray*, the bowl *farthest from the robot*.
    Place,
    /// An appearance: the *blue* cup *with the square handle*.
    Trait,
}

/// First words of spatial superlatives.
const FARTHEST: [&str; 3] = ["farthest", "nearest", "closest"];

impl Clue {
    /// The clue that tasks of this kind test; `None` for kinds that test manipulation skill instead.
    pub fn of(kind: TaskKind) -> Option<Self> {
        match kind {
            TaskKind::CommonSense => Some(Self::Need),
            TaskKind::Spatial => Some(Self::Place),
            TaskKind::Appearance => Some(Self::Trait),
            _ => None,
        }
    }

    /// The parsed instruction without this clue.
    fn without(self, mut parsed: Parsed) -> Parsed {
        if self == Self::Need {
            parsed.context.clear();
        }
        parsed.commands.iter_mut().for_each(|command| each_group(command, &mut |group| self.strip(group)));
        parsed
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

/// True if the task's instruction states its goal even without the clue, so that the task does not test it.
///
/// ```
/// use genmanip_core::Task;
/// use genmanip_tasks::references::{Clue, is_needless};
/// # fn example(task: &Task) {
/// let is_valid = Clue::of(task.kind).is_none_or(|clue| !is_needless(task, clue));
/// # }
/// ```
pub fn is_needless(task: &Task, clue: Clue) -> bool {
    let Some(parsed) = grammar::read(&task.instruction) else { return false };
    let reading = understand(&clue.without(parsed), &task.objects, &task.scene_graph);
    reading.and_then(|reading| check_goal(task, &reading)).is_ok()
}

/// Number of objects that an instruction identifies by their location.
///
/// # Errors
/// [`Mismatch::Unreadable`] if the instruction is outside the grammar.
pub fn clues_at_places(task: &Task) -> Result<usize, Mismatch> {
    let unreadable = || Mismatch::Unreadable { phrase: task.instruction.clone() };
    let mut parsed = grammar::read(&task.instruction).ok_or_else(unreadable)?;
    let mut count = 0;
    let mut note = |group: &mut Group| {
        let is_farthest = group.words.iter().any(|word| FARTHEST.contains(&word.as_str()));
        count += usize::from(group.at.is_some() || is_farthest);
    };
    parsed.commands.iter_mut().for_each(|command| each_group(command, &mut note));
    Ok(count)
}

/// Visits every noun phrase of a command, including nested ones.
fn each_group(command: &mut Command, visit: &mut impl FnMut(&mut Group)) {
    fn group(one: &mut Group, visit: &mut impl FnMut(&mut Group)) {
        if let Some(at) = &mut one.at {
            place(at, visit);
        }
        one.except.iter_mut().for_each(|other| group(other, visit));
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
        Command::Change { object, .. } | Command::Given(object) => group(object, visit),
        Command::Sides { subjects, of } => {
            subjects.iter_mut().for_each(|own| group(own, visit));
            group(of, visit);
        }
        Command::Tower(groups) => groups.iter_mut().for_each(|own| group(own, visit)),
        Command::Either(commands) => commands.iter_mut().for_each(|own| each_group(own, visit)),
    }
}
