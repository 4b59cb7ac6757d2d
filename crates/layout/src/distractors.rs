//! Objects that the task does not mention, chosen so that no instruction becomes ambiguous by them.

use std::sync::Arc;

use genmanip_core::{AssetRef, Atom, ObjectCard, Seed, Task, TaskKind};
use rand::RngExt;

/// Largest extent of a distractor on the table, metres; chosen: it is to be in the picture, not in the way.
const LARGEST_M: f64 = 0.2;

/// Up to `count` different assets, in the order of drawing.
pub(crate) fn draw(task: &Task, cards: &[ObjectCard], count: usize, seed: Seed) -> Vec<AssetRef> {
    let rng = &mut seed.fork("distractors").rng();
    let mut left: Vec<&ObjectCard> = cards.iter().filter(|card| is_harmless(card, task)).collect();
    let mut drawn: Vec<AssetRef> = Vec::new();
    while drawn.len() < count && !left.is_empty() {
        drawn.push(left.remove(rng.random_range(0..left.len())).asset.clone());
    }
    drawn
}

/// Whether nothing that the task says could mean this object, as far as cards and graph can tell:
/// it shares no name and no kind with an object of the task, and no word of the instruction describes it;
/// where the instruction names a need instead of things, it is not of the same group as what the goal is about.
fn is_harmless(card: &ObjectCard, task: &Task) -> bool {
    let known = || task.objects.iter().map(Arc::as_ref);
    let is_alike = |other: &ObjectCard| {
        other.uid == card.uid
            || other.name.eq_ignore_ascii_case(&card.name)
            || other.category.eq_ignore_ascii_case(&card.category)
    };
    let in_goal = |id: &str| task.goal.alternatives.iter().flatten().any(|atom| mentions(atom, id));
    let mut nodes = task.scene_graph.nodes.iter().zip(known());
    let serves_the_need = task.kind == TaskKind::CommonSense
        && nodes.any(|(node, other)| in_goal(&node.id) && other.general_category == card.general_category);
    let said: Vec<String> = words(&task.instruction).collect();
    let described = descriptions(card).any(|word| said.contains(&word));
    let fits = card.size_m.truncate().max_element() <= LARGEST_M && !card.is_articulated;
    fits && !known().any(is_alike) && !serves_the_need && !described
}

fn mentions(atom: &Atom, id: &str) -> bool {
    atom.subject() == id || crate::references(atom).any(|reference| reference == id)
}

/// Words by which people may call an object.
fn descriptions(card: &ObjectCard) -> impl Iterator<Item = String> {
    let texts = [&card.name, &card.category, &card.general_category, &card.shape];
    texts.into_iter().chain(&card.colors).chain(&card.materials).flat_map(|text| words(text))
}

/// Words in small letters without a plural's s; short ones say nothing.
fn words(text: &str) -> impl Iterator<Item = String> {
    text.split(|c: char| !c.is_alphanumeric())
        .filter(|word| word.len() > 2)
        .map(|word| word.to_lowercase().trim_end_matches('s').to_owned())
}
