//! Distractors: objects that the task does not mention and that keep the instruction unambiguous.

use std::sync::Arc;

use genmanip_core::{AssetRef, Atom, InstanceId, ObjectCard, Seed, Task, TaskKind};
use rand::RngExt;

/// Maximum horizontal extent of a distractor (m). Chosen: visible in the images but not in the way.
const MAX_EXTENT_M: f64 = 0.2;

/// Samples up to `count` different assets as distractors, in random order.
pub(crate) fn sample(task: &Task, cards: &[ObjectCard], count: usize, seed: Seed) -> Vec<AssetRef> {
    let rng = &mut seed.fork("distractors").rng();
    let mut left: Vec<&ObjectCard> = cards.iter().filter(|card| fits(card) && is_harmless(card, task)).collect();
    let mut sampled: Vec<AssetRef> = Vec::new();
    while sampled.len() < count && !left.is_empty() {
        sampled.push(left.remove(rng.random_range(0..left.len())).asset.clone());
    }
    sampled
}

/// True if the task cannot refer to this object, as far as cards and graph can tell: it shares no name and no category
/// with an object of the task, and no word of the instruction describes it; if the instruction states a need instead of
/// naming objects, it is not in the same general category as the goal's objects.
pub fn is_harmless(card: &ObjectCard, task: &Task) -> bool {
    let known = || task.objects.iter().map(Arc::as_ref);
    let is_alike = |other: &ObjectCard| {
        other.uid == card.uid
            || other.name.eq_ignore_ascii_case(&card.name)
            || other.category.eq_ignore_ascii_case(&card.category)
    };
    let in_goal =
        |id: &InstanceId| task.goal.alternatives.iter().flatten().flat_map(Atom::ids).any(|named| named == id);
    let mut nodes = task.scene_graph.nodes.iter().zip(known());
    let serves_the_need = task.kind == TaskKind::CommonSense
        && nodes.any(|(node, other)| in_goal(&node.id) && other.general_category == card.general_category);
    let instruction_words: Vec<String> = words(&task.instruction).collect();
    let described = descriptions(card).any(|word| instruction_words.contains(&word));
    !known().any(is_alike) && !serves_the_need && !described
}

/// True for an object that is small enough and has no joints.
fn fits(card: &ObjectCard) -> bool {
    card.size_m.truncate().max_element() <= MAX_EXTENT_M && !card.is_articulated
}

/// Words that may describe an object.
fn descriptions(card: &ObjectCard) -> impl Iterator<Item = String> {
    let texts = [&card.name, &card.category, &card.general_category, &card.shape];
    texts.into_iter().chain(&card.colors).chain(&card.materials).flat_map(|text| words(text))
}

/// Lower-case words without a plural s; words of one or two letters are dropped.
fn words(text: &str) -> impl Iterator<Item = String> {
    text.split(|c: char| !c.is_alphanumeric())
        .filter(|word| word.len() > 2)
        .map(|word| word.to_lowercase().trim_end_matches('s').to_owned())
}
