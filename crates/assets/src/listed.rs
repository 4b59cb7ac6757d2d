//! The list of generated objects that come with the program, frozen by name and seed.

use std::collections::BTreeSet;
use std::sync::OnceLock;

use genmanip_core::{ObjectCard, Seed};
use serde::{Deserialize, Serialize};

use crate::notes::Split;
use crate::{AssetError, Families, Family};

const LIST: &str = include_str!("../data/instances.json");

/// Every so many-th object of a family that is trained on is kept for testing.
const UNSEEN_EVERY: usize = 5;
/// Seeds tried per wanted object of a family before it is left with fewer.
const MOST_SEEDS: u64 = 40;

/// A generated object of the list.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Listed {
    /// What may be trained on.
    pub split: Split,
    /// Its card, as the family made it when the list was frozen.
    pub card: ObjectCard,
}

/// The list.
///
/// # Panics
/// Never in a tested build: the data file is compiled in.
pub fn listed() -> &'static [Listed] {
    static LISTED: OnceLock<Vec<Listed>> = OnceLock::new();
    LISTED.get_or_init(|| crate::data_file::read("instances", LIST).expect("built-in data files are tested"))
}

/// Chooses a list anew: so many rigid and articulated objects, evenly over the families, from seeds 1, 2, … of each,
/// without those whose name or description another one has already; `known` are the cards of other objects.
///
/// # Errors
/// As [`Families::instance`].
pub fn choose(
    families: &Families,
    rigid: usize,
    articulated: usize,
    known: &[ObjectCard],
    advance: &mut dyn FnMut(),
) -> Result<Vec<Listed>, AssetError> {
    let mut taken: BTreeSet<String> =
        known.iter().flat_map(|card| [card.name.clone(), card.description.clone()]).collect();
    let mut chosen = Vec::new();
    for (is_articulated, wanted) in [(false, rigid), (true, articulated)] {
        let of_kind: Vec<&Family> = families.all().filter(|family| family.articulated == is_articulated).collect();
        let mut missing = wanted;
        for (index, family) in of_kind.iter().enumerate() {
            let share = missing.div_ceil(of_kind.len() - index);
            let mut own = 0;
            for seed in (1..=share as u64 * MOST_SEEDS).map(Seed::new) {
                if own == share {
                    break;
                }
                let card = families.card(&family.family, seed)?;
                if taken.contains(&card.name) || taken.contains(&card.description) {
                    continue;
                }
                taken.extend([card.name.clone(), card.description.clone()]);
                own += 1;
                let split = match () {
                    () if family.unseen => Split::UnseenFamily,
                    () if own % UNSEEN_EVERY == 0 => Split::UnseenInstance,
                    () => Split::Train,
                };
                chosen.push(Listed { split, card });
                advance();
            }
            missing -= own;
        }
    }
    Ok(chosen)
}

/// The text of the list's file: a line per object.
pub fn to_text(list: &[Listed]) -> String {
    let lines: Vec<String> = list.iter().map(|one| serde_json::to_string(one).unwrap_or_default()).collect();
    format!("[\n{}\n]\n", lines.join(",\n"))
}
