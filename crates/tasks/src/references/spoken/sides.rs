//! Sides of an object: `on the right-hand side of the mug`, `to its left`, `on either side of the plate`.

use genmanip_core::Relation;

use super::super::command::{Command, Group, Number, Place};
use super::listener::Listener;
use super::verbs::is_verb;
use super::words::vocabulary;

impl Listener {
    /// Parses `on either side of the plate` after the objects that go there; `start` is the index of their first word.
    pub(super) fn either_side(&mut self, subjects: &[Group], start: usize) -> Option<Vec<Command>> {
        self.take_any(&vocabulary().either_side)?;
        let of = self.noun_phrase()?;
        let mut subjects = subjects.to_vec();
        // `a candle on either side of the book`
        if let ([one], "a" | "an" | "one") = (subjects.as_mut_slice(), self.token(start))
            && one.number == Number::One
        {
            one.number = Number::Many(2);
        }
        self.remember(subjects.clone());
        self.mind.place = None;
        Some(vec![Command::Sides { subjects, of }])
    }

    /// Parses `on the right-hand side of the mug`, `to its left`, `on the mug's right`.
    pub(super) fn side_place(&mut self) -> Option<Place> {
        let (relation, length, owner) = self.side_at(self.mind.next)?;
        let start = self.mind.next;
        self.mind.next += length;
        let relations = match relation {
            Relation::Left => &[Relation::Left][..],
            _ => &[Relation::Right][..],
        };
        let objects = match owner {
            Owner::Follows => match self.attempt(Self::pronoun) {
                Some(_) => self.antecedents(relations)?,
                None => vec![self.noun_phrase()?],
            },
            Owner::Pronoun => self.antecedents(relations)?,
            Owner::Words(words) => {
                let words = self.tokens[words.0..words.1].iter().map(|word| word.trim_end_matches("'s").to_owned());
                vec![Group::of(words.collect())]
            }
            Owner::None => match &self.mind.source {
                Some(source) => source.objects.clone(),
                // `the fork on the left of the plate and the knife on the right`
                None => match self.mind.place.clone().filter(|place| is_side(place.relations)) {
                    Some(place) => place.objects,
                    None => match self.next_owner() {
                        Some(owner) => vec![owner],
                        None => {
                            return self.blame(format!("`{}` of what?", self.tokens[start..self.mind.next].join(" ")));
                        }
                    },
                },
            },
        };
        Some(Place { relations, objects })
    }

    /// The object of the next side in this clause: `the fork to the left and the knife to the right of the plate`.
    pub(super) fn next_owner(&mut self) -> Option<Group> {
        let (before, end) = (self.mind.clone(), self.clause_end());
        let follows = |&index: &usize| matches!(self.side_at(index), Some((_, _, Owner::Follows)));
        let found = (before.next..end).find(follows).and_then(|index| {
            let (_, length, _) = self.side_at(index)?;
            self.mind.next = index + length;
            self.noun_phrase()
        });
        self.mind = before;
        found
    }

    /// True if the words at an index lead from a place to what goes there: `to its left put the spoon`.
    fn leads(&self, index: usize) -> bool {
        let word = self.token(index);
        (is_verb(word) || vocabulary().duties.contains(&word)) && self.is_determined(index + 1)
    }

    /// Side, number of tokens and owner of a phrase such as `on the right-hand side of`.
    pub(super) fn side_at(&self, index: usize) -> Option<(Relation, usize, Owner)> {
        let prepositions = ["over to", "to", "on", "onto", "at", "from", "by", "towards", "toward"];
        let first = prepositions.iter().find_map(|word| self.at_index(index, word)).unwrap_or(0);
        let mut next = index + first;
        let mut owner = Owner::Follows;
        if ["its", "their"].contains(&self.token(next)) {
            owner = Owner::Pronoun;
            next += 1;
        } else if self.token(next) == "the" {
            next += 1;
        }
        let is_side = |word: &str| word == "left" || word == "right";
        if !is_side(self.token(next)) {
            let end = (next..next + 4).find(|&at| self.token(at).ends_with("'s"))? + 1;
            if !is_side(self.token(end)) || first == 0 || ["robot's", "camera's"].contains(&self.token(end - 1)) {
                return None;
            }
            owner = Owner::Words((next, end));
            next = end;
        }
        let relation = if self.token(next) == "left" { Relation::Left } else { Relation::Right };
        next += 1;
        let is_long = ["hand side", "hand edge", "hand", "side", "edge"];
        next += is_long.iter().find_map(|word| self.at_index(next, word)).unwrap_or(0);
        match owner {
            Owner::Follows if ["of", "from"].contains(&self.token(next)) => next += 1,
            Owner::Follows if first > 0 && self.is_end(next) => owner = Owner::None,
            Owner::Follows => return None,
            _ if !self.is_end(next) && !self.leads(next) => return None,
            _ => {}
        }
        Some((relation, next - index, owner))
    }
}

/// True for the relations left and right.
pub(super) fn is_side(relations: &[Relation]) -> bool {
    matches!(relations, [Relation::Left] | [Relation::Right])
}

/// Owner of a side.
pub(super) enum Owner {
    /// A noun phrase follows.
    Follows,
    /// `its`
    Pronoun,
    /// The words from one index to another, in the possessive.
    Words((usize, usize)),
    /// None is named.
    None,
}
