//! Frozen list of the generated objects that ship with the program.

use std::collections::BTreeSet;
use std::sync::OnceLock;

use genmanip_core::{ObjectCard, Seed};
use serde::{Deserialize, Serialize};

use crate::metadata::Split;
use crate::{AssetError, Families, Family};

const LIST: &str = include_str!("../data/instances.json");

/// One of this many objects of each training family is held out for testing.
const UNSEEN_EVERY: usize = 5;
/// Maximum number of seeds tried per requested object of a family.
const MAX_SEEDS: u64 = 40;

/// Entry of the list: a generated object.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GeneratedInstance {
    /// Train/test split of the object.
    pub split: Split,
    /// Card of the object as it was generated when the list was frozen.
    pub card: ObjectCard,
}

/// Frozen list of generated objects.
///
/// # Panics
/// Never in a tested build: the data file is compiled in.
pub fn generated_instances() -> &'static [GeneratedInstance] {
    static LISTED: OnceLock<Vec<GeneratedInstance>> = OnceLock::new();
    LISTED.get_or_init(|| crate::data_file::read("instances", LIST).expect("built-in data files are tested"))
}

/// Selects objects for a new list: the given numbers of rigid and articulated objects, spread evenly over the families.
/// Each family tries seeds 1, 2, … and skips names and descriptions already in use; `known` are the cards of other
/// objects.
///
/// # Errors
/// As [`Families::instance`].
pub fn choose(
    families: &Families,
    rigid: usize,
    articulated: usize,
    known: &[ObjectCard],
    advance: &mut dyn FnMut(),
) -> Result<Vec<GeneratedInstance>, AssetError> {
    let mut taken: BTreeSet<String> =
        known.iter().flat_map(|card| [card.name.clone(), card.description.clone()]).collect();
    let mut chosen = Vec::new();
    for (is_articulated, wanted) in [(false, rigid), (true, articulated)] {
        let of_kind: Vec<&Family> = families.all().filter(|family| family.articulated == is_articulated).collect();
        let mut missing = wanted;
        for (index, family) in of_kind.iter().enumerate() {
            let share = missing.div_ceil(of_kind.len() - index);
            let mut own = 0;
            for seed in (1..=share as u64 * MAX_SEEDS).map(Seed::new) {
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
                chosen.push(GeneratedInstance { split, card });
                advance();
            }
            missing -= own;
        }
    }
    Ok(chosen)
}

/// Text of the list file, one line per object.
pub fn to_text(list: &[GeneratedInstance]) -> String {
    let lines: Vec<String> = list.iter().map(|one| serde_json::to_string(one).unwrap_or_default()).collect();
    format!("[\n{}\n]\n", lines.join(",\n"))
}
