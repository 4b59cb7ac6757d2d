//! Objects of a whole catalogue that the author of a sentence means by a noun, and near ones where nothing has the name.

use genmanip_core::ObjectCard;
use genmanip_core::names::near_misses;

use super::{Lexicon, is_of, undescribed};

impl Lexicon {
    /// Those of some cards that a phrase means first: of the category that is its noun, or of the first sort that the
    /// noun may mean, and among these the ones with all its words in their names; and whether the noun is that category.
    pub fn plainest<'c>(&self, words: &[&str], cards: &[&'c ObjectCard]) -> (Vec<&'c ObjectCard>, bool) {
        let words = undescribed(words);
        let Some((noun, before)) = words.split_last() else { return (Vec::new(), false) };
        let noun = self.singular(noun);
        let pair = before.last().map(|before| format!("{before} {noun}"));
        let among = |keep: &dyn Fn(&ObjectCard) -> bool| -> Vec<&'c ObjectCard> {
            cards.iter().copied().filter(|card| keep(card)).collect()
        };
        let of_kind = among(&|card| card.category == noun || pair.as_ref() == Some(&card.category));
        // `salt shaker` is a category that holds pepper shakers too, and `tennis ball` means one ball.
        let called = |cards: Vec<&'c ObjectCard>| {
            let is_called = |card: &&&'c ObjectCard| {
                let name = card.name.to_lowercase();
                let has = |word: &str| name.split(' ').any(|part| part == word);
                has(&noun) && before.iter().all(|word| has(word))
            };
            let named: Vec<&ObjectCard> = cards.iter().filter(is_called).copied().collect();
            // One object whose name happens to repeat its category, such as the only `soda can`, is not the only one meant.
            let is_category = cards.iter().any(|card| pair.as_ref() == Some(&card.category));
            if named.len() > usize::from(is_category) { named } else { cards }
        };
        if !of_kind.is_empty() {
            return (called(of_kind), true);
        }
        let head = self.head(words).map_or_else(|| noun.clone(), |(head, _)| head);
        let sorts = self.heads.get(&head).map_or(&[][..], Vec::as_slice);
        let first = sorts.iter().map(|sort| among(&|card| is_of(sort, card))).find(|found| !found.is_empty());
        (called(first.unwrap_or_default()), false)
    }

    /// True if a noun is known only from the labels of packages: there are tins of pineapple, but no pineapple.
    pub fn is_label(&self, words: &[&str], cards: &[&ObjectCard]) -> bool {
        let front = undescribed(words);
        let Some(noun) = front.last().map(|noun| self.singular(noun)) else { return false };
        let is_called = |card: &&ObjectCard| {
            let name = card.name.to_lowercase();
            let core = name.split(" with ").next().unwrap_or_default();
            core.split(' ').next_back() == Some(noun.as_str()) || card.category.split(' ').any(|word| word == noun)
        };
        let pair = front.split_last().and_then(|(_, before)| Some(format!("{} {noun}", before.last()?)));
        let is_known = |noun: &String| self.heads.contains_key(noun);
        !is_known(&noun)
            && !pair.is_some_and(|pair| is_known(&pair))
            && !self.means_anything(&noun)
            && !words.contains(&"of")
            && !cards.iter().any(is_called)
    }

    /// True if the author of a phrase may mean an object that fits it.
    pub fn is_likely(&self, phrase: &[&str], card: &ObjectCard) -> bool {
        let unlikely = self.head(undescribed(phrase)).and_then(|(noun, _)| self.unlikely.get(&noun));
        !unlikely.is_some_and(|sorts| sorts.iter().any(|sort| is_of(sort, card)))
    }

    /// Cards to offer for a noun without a meaning: those that come closest, or those of the noun with nearly the same
    /// letters.
    pub fn nearby<'c>(&self, noun: &str, cards: impl Iterator<Item = &'c ObjectCard>) -> Vec<&'c ObjectCard> {
        let noun = self.singular(noun);
        let spelt = || {
            let known: Vec<&str> = self.heads.keys().map(String::as_str).filter(|word| word.len() > 3).collect();
            near_misses(&noun, &known).first().and_then(|word| self.heads.get(word))
        };
        let one = noun.strip_suffix('s').unwrap_or(&noun);
        let Some(sorts) = self.nearby.get(&noun).or_else(|| self.nearby.get(one)).or_else(spelt) else {
            return Vec::new();
        };
        cards.filter(|card| sorts.iter().any(|sort| is_of(sort, card))).collect()
    }
}
