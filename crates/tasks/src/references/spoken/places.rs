//! Places: prepositions with their references, sides, and where an object comes from.

use genmanip_core::Relation;

use super::super::command::{Group, Number, Place};
use super::super::lexicon::is_color;
use super::super::words::{EXTREMES, LOOSE, PLACES};
use super::listener::Listener;
use super::sides::is_side;
use super::verbs::Class;
use super::words::vocabulary;

/// Prepositions that continue with another one or with nothing.
const MORE: [(&str, &[Relation]); 13] = [
    ("towards", &[Relation::Near]),
    ("toward", &[Relation::Near]),
    ("besides", &[Relation::Near]),
    ("at the front of", &[Relation::Front]),
    ("at the back of", &[Relation::Back]),
    ("at the rear of", &[Relation::Back]),
    ("to the top of", &[Relation::On, Relation::Top]),
    ("at the top of", &[Relation::On, Relation::Top]),
    ("->", &[Relation::In, Relation::On, Relation::Top]),
    ("next", &[]),
    ("on top", &[Relation::On, Relation::Top]),
    ("somewhere around", &[Relation::Near]),
    ("anywhere around", &[Relation::Near]),
];

/// True if a place begins at an index.
pub(super) fn begins_at(listener: &Listener, index: usize) -> bool {
    listener.preposition(index).is_some() || listener.side_at(index).is_some()
}

/// True if a place begins here.
pub(super) fn begins(listener: &Listener) -> bool {
    begins_at(listener, listener.mind.next)
}

impl Listener {
    /// One place or several alternatives, after words that do not matter.
    pub(super) fn places(&mut self) -> Option<Vec<Place>> {
        self.skip_modifiers();
        if self.ahead(0) == "," && begins_at(self, self.mind.next + 1) {
            self.mind.next += 1;
        }
        self.skip_modifiers();
        let unknown = vocabulary().unknown.iter().find(|word| self.at(word).is_some());
        if let Some(word) = unknown {
            return self.blame(format!("`{word}` is no relation that a goal can have"));
        }
        if let Some(length) = self.table_at(self.mind.next) {
            self.mind.next += length;
            self.take(",");
            self.skip_modifiers();
            if !begins(self) {
                return Some(vec![Place::table()]);
            }
        }
        let mut places = vec![self.place()?];
        while let Some(place) = self.attempt(|listener| {
            listener.take("or").then_some(())?;
            listener.skip_modifiers();
            match begins(listener) {
                true => listener.place(),
                // `on the plate or the saucer`
                false => Some(Place { relations: places[0].relations, objects: vec![listener.noun_phrase()?] }),
            }
        }) {
            places.push(place);
        }
        Some(places)
    }

    /// True where a result such as `so that it is behind the box` begins.
    pub(super) fn at_result(&mut self) -> bool {
        let before = self.mind.clone();
        let found = self.result();
        self.mind = before;
        found.is_some()
    }

    /// Takes the words of a result before its place: `so that it ends up`.
    pub(super) fn result(&mut self) -> Option<()> {
        self.attempt(|listener| {
            listener.take(",");
            listener.take_any(&vocabulary().results)?;
            listener.take_any(&["it", "they", "that", "this", "both", "he", "she"])?;
            listener.copula();
            while !begins(listener)
                && listener.take_any(&["right", "directly", "somewhere", "just", "exactly"]).is_some()
            {}
            (begins(listener) || listener.table_at(listener.mind.next).is_some()).then_some(())
        })
    }

    pub(super) fn skip_modifiers(&mut self) {
        loop {
            self.result();
            // `move it to behind the box`
            if self.ahead(0) == "to" && begins_at(self, self.mind.next + 1) {
                self.mind.next += 1;
            }
            let is_side = self.side_at(self.mind.next).is_some();
            if is_side || self.preposition(self.mind.next).is_some_and(|(relations, _)| !relations.is_empty()) {
                // `right next to` is a preposition, but `in the gap between` is not `in`.
                let before = self.mind.next;
                let phrases =
                    vocabulary().modifiers.iter().filter(|phrase| phrase.contains(' ')).copied().collect::<Vec<_>>();
                if self.take_any(&phrases).is_none() || !begins(self) {
                    self.mind.next = before;
                    return;
                }
            } else if self.take_any(&vocabulary().modifiers).is_none() {
                return;
            }
        }
    }

    /// Number of tokens of `on the table` and the like at an index; `None` for another place.
    fn table_at(&self, index: usize) -> Option<usize> {
        let first =
            ["on", "onto", "to", "upon", "on top of", "at"].iter().find_map(|word| self.at_index(index, word))?;
        let article = ["the bare", "the empty", "the", "my", "your", "our"];
        let second = article.iter().find_map(|word| self.at_index(index + first, word)).unwrap_or(0);
        let third = vocabulary().tables.iter().filter_map(|word| self.at_index(index + first + second, word)).max()?;
        let end = index + first + second + third;
        let goes_on = self.is_end(end) || begins_at(self, end) || vocabulary().modifiers.contains(&self.token(end));
        goes_on.then_some(end - index)
    }

    /// Place at which an object stands; `Some(None)` for the table, where it stands unless something else is said.
    pub(super) fn standing(&mut self) -> Option<Option<Place>> {
        if let Some(length) = self.table_at(self.mind.next) {
            self.mind.next += length;
            return Some(None);
        }
        self.place().map(Some)
    }

    /// A place with its references.
    pub(super) fn place(&mut self) -> Option<Place> {
        let place = self.attempt(Self::side_place).or_else(|| self.attempt(Self::plain_place))?;
        let is_same = self.mind.place.as_ref().is_some_and(|last| last.objects == place.objects);
        self.mind.centre = if is_same { place.objects.clone() } else { Vec::new() };
        self.mind.place = Some(place.clone());
        Some(place)
    }

    fn plain_place(&mut self) -> Option<Place> {
        let (relations, length) = self.preposition(self.mind.next)?;
        let said = self.token(self.mind.next).to_owned();
        self.mind.next += length;
        if relations.is_empty() {
            return None;
        }
        // `on either the tray or the coaster`
        self.take("either");
        // `drop the die inside`, `put the cube on top`
        let is_there = self.take_any(&["there", "here"]).is_some();
        if is_there || self.is_end(self.mind.next) {
            let host = self.antecedent(relations)?;
            let is_adverb = ["inside", "in", "into"].contains(&said.as_str()) || length == 2 && said == "on";
            return (is_there || is_adverb).then(|| Place { relations, objects: vec![host] });
        }
        let is_plural = ["them", "these", "those", "both"].contains(&self.ahead(0));
        if let Some(known) = self.attempt(Self::pronoun) {
            // `stack the red brick on the green brick and put the car next to them`
            if let ([one], true) = (known.as_slice(), is_plural)
                && one.number == Number::One
                && !one.words.last().is_some_and(|noun| noun.ends_with('s'))
            {
                return self.blame(format!("`{}` may mean several objects", self.clause(self.mind.next - 1)));
            }
            let host = if known.len() == 1 || relations == [Relation::Between] || self.mind.source.is_some() {
                self.antecedents(relations)
            } else {
                None
            };
            let Some(objects) = host else {
                return self.blame(format!("`{}` may mean several objects", self.clause(self.mind.next - 1)));
            };
            return Some(Place { relations, objects });
        }
        self.mind.is_any = ["a", "an"].contains(&self.ahead(0)) || self.at("its own").is_some();
        let mut objects = vec![self.noun_phrase()?];
        if relations == [Relation::Between] {
            if self.take("and") {
                objects.push(self.noun_phrase()?);
            } else if matches!(objects[0].number, Number::One | Number::Each(_)) {
                return self.blame(format!("`between` needs two objects, and `{}` is one", objects[0].words.join(" ")));
            }
        }
        let supports = |relations: &[Relation]| relations.iter().any(|relation| relation.is_support());
        // `on the board next to the bread`: the second place is the location of the board.
        if let [object] = objects.as_mut_slice()
            && object.at.is_none()
            && supports(relations)
            && self.preposition(self.mind.next).is_some_and(|(next, _)| !next.is_empty() && !supports(next))
        {
            object.at = Some(Box::new(self.place()?));
        }
        Some(Place { relations, objects })
    }

    /// Relations of the preposition at an index and its number of tokens; `None` if there is none, or if it belongs to a
    /// description.
    pub(super) fn preposition(&self, index: usize) -> Option<(&'static [Relation], usize)> {
        let table = MORE.iter().chain(&PLACES);
        let found = table.filter_map(|(phrase, relations)| Some((*relations, self.at_index(index, phrase)?)));
        let (relations, length) = found.max_by_key(|(_, length)| *length)?;
        if self.side_at(index).is_some() {
            return None;
        }
        let (word, follows) = (self.token(index), self.token(index + length));
        let alone = length == 1;
        if self.is_end(index + length) {
            let is_adverb = ["inside", "in"].contains(&word) && alone || self.at_index(index, "on top").is_some();
            return is_adverb.then_some((relations, length));
        }
        let is_loose = LOOSE.contains(&word) && alone;
        let is_object = match word {
            "to" | "by" => self.is_determined(index + length) || self.is_terse && Class::Carry.base(follows).is_none(),
            // `lettered in red`, `with a cross on top`
            "in" => self.is_determined(index + length) || !is_color(follows) || !self.is_end(index + length + 1),
            _ => self.is_determined(index + length) || follows != "top",
        };
        let is_level = is_loose && ["high", "low", "max", "full"].contains(&follows);
        let compares = EXTREMES.contains(&self.token(index.wrapping_sub(1)));
        (!compares && !is_level && (!is_loose || is_object)).then_some((relations, length))
    }

    /// The object to which a pronoun in a place refers; `None` if none or several were named.
    fn antecedent(&mut self, relations: &[Relation]) -> Option<Group> {
        match self.antecedents(relations)?.as_slice() {
            [one] => Some(one.clone()),
            _ => None,
        }
    }

    /// The objects to which a pronoun in a place refers: that from which this request takes something, or those of the
    /// request before. What something was put into is meant by `in it` rather than what was put there.
    pub(super) fn antecedents(&mut self, relations: &[Relation]) -> Option<Vec<Group>> {
        if let Some(source) = &self.mind.source {
            return Some(source.objects.clone());
        }
        let place = self.mind.place.as_ref().filter(|place| place.relations.contains(&Relation::In));
        let is_beside = !relations.iter().any(|relation| relation.is_support());
        if let Some(place) = place.filter(|_| is_beside || relations.contains(&Relation::In)) {
            return Some(place.objects.clone());
        }
        if is_beside && !self.mind.centre.is_empty() {
            return Some(self.mind.centre.clone());
        }
        // `the fork to the left of the plate and the knife to its right`
        if let Some(place) = self.mind.place.as_ref().filter(|place| is_side(place.relations) && is_side(relations)) {
            return Some(place.objects.clone());
        }
        // `take the spoon out of the pot and leave it beside it`
        if let ([subject], [topic]) = (self.mind.subjects.as_slice(), self.mind.topic.as_slice())
            && subject == topic
            && let Some(place) = subject.at.as_deref()
        {
            return Some(place.objects.clone());
        }
        if self.mind.topic.is_empty() {
            return self.blame(format!("`{}` names no object", self.clause(self.mind.next.saturating_sub(1))));
        }
        self.mind.pending.clear();
        Some(self.mind.topic.clone())
    }
}
