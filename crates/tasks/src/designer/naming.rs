//! Referring expressions by name, appearance or position, each meant to refer to one object of its scene only.
//!
//! [`crate::references`] checks the proposals afterwards with a vocabulary of its own.

use genmanip_core::{AssetRef, ObjectCard, Relation};
use rand::seq::IndexedRandom;
use rand::{Rng, RngExt};

use super::facts::{Facts, Known};
use super::phrasing::phrases;
use super::sketch::Sketch;
use super::things::{Group, things};

/// Ratio of the volumes of two bounding boxes above which their objects are called the larger and the smaller one.
/// Chosen by hand.
const LARGER_VOLUME_RATIO: f64 = 1.7;

/// Style of a referring expression.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Style {
    /// By its name or category.
    Plain,
    /// By its position.
    Place,
    /// By its appearance.
    Looks,
}

/// True if descriptions of the object's appearance are known.
pub(super) fn has_looks(card: &ObjectCard) -> bool {
    !card.annotations.looks.is_empty()
}

/// Finds expressions for the objects of a finished scene.
pub(super) struct Namer<'s, 'a> {
    scene: &'s Sketch<'a>,
    facts: Facts,
}

/// A noun, and the objects of the scene that it may refer to.
struct Word<'a> {
    one: &'a str,
    several: Option<&'a str>,
    meant: Vec<usize>,
}

impl<'s, 'a> Namer<'s, 'a> {
    pub fn new(scene: &'s Sketch<'a>) -> Self {
        Self { scene, facts: Facts::new(scene) }
    }

    /// An expression with its article; `None` if none refers to this object only.
    pub fn name(&self, object: usize, style: Style, rng: &mut impl Rng) -> Option<String> {
        let options = match style {
            Style::Plain => self.plain(object),
            Style::Looks => self.looks(object),
            Style::Place => self.by_place(object, rng),
        };
        options.choose(rng).map(|text| format!("the {text}")).map(|text| text.replace("the whatever", "whatever"))
    }

    fn plain(&self, object: usize) -> Vec<String> {
        let card = self.scene.cards[object];
        let name = card.name.to_lowercase();
        let is_sayable = name.chars().all(|c| c.is_alphabetic() || c == ' ' || c == '-');
        let adjectives: Vec<&str> = name.split(' ').collect();
        let adjectives = &adjectives[..adjectives.len().saturating_sub(1)];
        let fits = |other: &ObjectCard| {
            let text = format!("{} {}", other.name, other.colors.first().map_or("", String::as_str)).to_lowercase();
            adjectives.iter().all(|adjective| text.contains(adjective))
        };
        let mut options = Vec::new();
        let alike = self.alike(object);
        if is_sayable && !alike.iter().any(|&other| fits(self.scene.cards[other])) {
            options.push(name);
        }
        let words = things().words(card);
        if alike.is_empty() {
            options.extend(words.map(|words| words.noun.clone()));
        }
        // Generated objects are also offered by colour and noun: many of their names are too long or technical for a
        // sentence.
        if let (AssetRef::Generated { .. }, Some(words), Some(color)) = (&card.asset, words, card.colors.first())
            && !alike.iter().any(|&other| self.scene.cards[other].colors.contains(color))
        {
            options.push(format!("{color} {}", words.noun));
        }
        options
    }

    /// Other objects to which the noun also applies. Interchangeable copies of the object do not count: the expression
    /// need not tell them apart.
    fn alike(&self, object: usize) -> Vec<usize> {
        let is_other = |other: &usize| self.scene.cards[*other].uid != self.scene.cards[object].uid;
        self.meant_by_noun(object).into_iter().filter(is_other).collect()
    }

    fn meant_by_noun(&self, object: usize) -> Vec<usize> {
        let card = self.scene.cards[object];
        (0..self.scene.len()).filter(|&other| things().is_alike(card, self.scene.cards[other])).collect()
    }

    fn meant_by_group(&self, group: &Group) -> Option<Vec<usize>> {
        let category = |object: &usize| &self.scene.cards[*object].category;
        let all = 0..self.scene.len();
        let doubtful = all.clone().any(|object| group.doubtful.contains(category(&object)));
        (!doubtful).then(|| all.filter(|object| group.members.contains(category(object))).collect())
    }

    fn looks(&self, object: usize) -> Vec<String> {
        let card = self.scene.cards[object];
        let mut options = card.annotations.looks.clone();
        let kin = self.meant_by_noun(object);
        let volume = |object: usize| self.scene.cards[object].size_m.element_product();
        if let Some(words) = things().words(card)
            && kin.len() == 2
            && kin.iter().all(|&one| things().words(self.scene.cards[one]) == Some(words))
        {
            let other = if kin[0] == object { kin[1] } else { kin[0] };
            if volume(object) > LARGER_VOLUME_RATIO * volume(other) {
                options.extend([format!("larger of the two {}", words.plural), format!("bigger {}", words.noun)]);
            }
            if LARGER_VOLUME_RATIO * volume(object) < volume(other) {
                options.extend([format!("smaller of the two {}", words.plural), format!("smaller {}", words.noun)]);
            }
        }
        options
    }

    /// Words that also apply to other objects, so that only the position makes the reference unique.
    fn words(&self, object: usize) -> Vec<Word<'a>> {
        let card = self.scene.cards[object];
        let mut words = Vec::new();
        if let Some(said) = things().words(card) {
            words.push(Word { one: &said.noun, several: Some(&said.plural), meant: self.meant_by_noun(object) });
        }
        for (word, group) in things().groups_of(card) {
            if let Some(meant) = self.meant_by_group(group) {
                words.push(Word { one: word, several: None, meant });
            }
        }
        words.push(Word { one: "object", several: None, meant: (0..self.scene.len()).collect() });
        words.retain(|word| word.meant.len() > 1);
        words
    }

    fn by_place(&self, object: usize, rng: &mut impl Rng) -> Vec<String> {
        let mut options = Vec::new();
        for word in self.words(object) {
            let others: Vec<usize> = word.meant.iter().copied().filter(|&other| other != object).collect();
            self.beside_something(object, &word, &others, &mut options, rng);
            self.between_two(object, &word, &others, &mut options, rng);
            if word.one != "object" && others.iter().all(|&other| self.scene.carrier(other).is_none()) {
                self.at_the_end(object, &word, &others, &mut options);
            }
        }
        options
    }

    fn beside_something(
        &self,
        object: usize,
        word: &Word,
        others: &[usize],
        options: &mut Vec<String>,
        rng: &mut impl Rng,
    ) {
        let support = self.scene.edges.iter().find(|link| link.subject == object && link.relation.is_support());
        let relations = Relation::SIDES.into_iter().chain(support.map(|link| link.relation));
        for relation in relations {
            for anchor in (0..self.scene.len()).filter(|&anchor| anchor != object) {
                let known = |other: usize| self.facts.known(self.scene, other, relation, anchor);
                let mut rivals = others.iter().filter(|&&other| other != anchor);
                let needed = others.iter().any(|&other| other != anchor);
                if known(object) != Known::Yes || !needed || !rivals.all(|&other| known(other) == Known::No) {
                    continue;
                }
                let Some(reference) = self.name(anchor, Style::Plain, rng) else { continue };
                let place = phrases().place(relation, self.scene.cards[anchor], &reference, "", rng);
                let is = phrases().which(self.scene.cards[object], rng);
                options.push(match word.one {
                    "object" => format!("whatever is {place}"),
                    one => format!("{one} {is} {place}"),
                });
            }
        }
    }

    fn between_two(&self, object: usize, word: &Word, others: &[usize], options: &mut Vec<String>, rng: &mut impl Rng) {
        for link in &self.scene.edges {
            let (Relation::Between, Some(second)) = (link.relation, link.second) else { continue };
            let ends = [link.reference, second];
            let outside = |&other: &usize| ends.contains(&other) || self.is_outside(other, ends);
            if link.subject != object || !others.iter().all(outside) {
                continue;
            }
            let names = ends.map(|end| self.name(end, Style::Plain, rng));
            let [Some(first), Some(last)] = names else { continue };
            let mut places = vec![format!("between {first} and {last}")];
            let kin = self.meant_by_noun(ends[0]);
            let said = ends.map(|end| things().words(self.scene.cards[end]));
            if let [Some(first), Some(last)] = said
                && kin.len() == 2
                && kin.contains(&ends[1])
                && first == last
            {
                places = vec![format!("between the two {}", first.plural)];
            }
            let is = phrases().which(self.scene.cards[object], rng);
            options.extend(places.into_iter().map(|place| match word.one {
                "object" => format!("whatever is {place}"),
                one => format!("{one} {is} {place}"),
            }));
        }
    }

    /// True if the object is certainly beyond both of the others on one axis, so that it cannot be between them.
    fn is_outside(&self, object: usize, ends: [usize; 2]) -> bool {
        let beyond = |order: &dyn Fn(usize, usize) -> bool| {
            ends.iter().all(|&end| order(object, end)) || ends.iter().all(|&end| order(end, object))
        };
        beyond(&|a, b| self.facts.is_farther(a, b)) || beyond(&|a, b| self.facts.is_lefter(a, b))
    }

    fn at_the_end(&self, object: usize, word: &Word, others: &[usize], options: &mut Vec<String>) {
        let facts = &self.facts;
        let one = word.one;
        if others.iter().all(|&other| facts.is_farther(object, other)) {
            options
                .extend([format!("{one} farthest from the robot"), format!("{one} that is farthest from the robot")]);
        }
        if others.iter().all(|&other| facts.is_farther(other, object)) {
            options.extend([format!("{one} nearest to the robot"), format!("{one} that is closest to the robot")]);
        }
        if others.iter().all(|&other| facts.is_lefter(object, other)) {
            options.push(format!("{one} farthest to the robot's left"));
        }
        if others.iter().all(|&other| facts.is_lefter(other, object)) {
            options.push(format!("{one} farthest to the robot's right"));
        }
        if let ([a, b], Some(several)) = (others, word.several) {
            let ordered = |order: &dyn Fn(usize, usize) -> bool| {
                (order(*a, object) && order(object, *b)) || (order(*b, object) && order(object, *a))
            };
            if ordered(&|a, b| facts.is_farther(a, b)) || ordered(&|a, b| facts.is_lefter(a, b)) {
                options.push(format!("middle one of the three {several}"));
            }
        }
    }
}

/// True with probability `share`.
pub(super) fn chance(share: f64, rng: &mut impl Rng) -> bool {
    rng.random::<f64>() < share
}
