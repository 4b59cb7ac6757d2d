//! Lists of suitable cards by purpose, computed once for all designs of a task.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::rc::Rc;

use genmanip_core::{ObjectCard, Relation};

use super::things::{is_movable, things};

/// Purpose of a list of cards.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Purpose {
    /// Any card with an entry in `things.json`.
    Any,
    /// Objects to move; with a support relation, only those that some card can carry in it.
    Mover(Option<Relation>),
    /// Objects that hold something in this support relation.
    Carrier(Relation),
    /// Objects that can hold the given card, identified by its address.
    Host(*const ObjectCard, Relation),
    /// Objects that the given card can hold.
    Item(*const ObjectCard, Relation),
    /// Fillers, objects without a part in the goal, from these general categories; the list is identified by its address and length.
    Filler(*const &'static str, usize),
}

/// The cards of a catalogue, and the lists computed so far by purpose.
pub(super) struct Choices<'a> {
    cards: &'a [ObjectCard],
    lists: RefCell<BTreeMap<Purpose, Rc<[usize]>>>,
}

impl<'a> Choices<'a> {
    pub fn of(cards: &'a [ObjectCard]) -> Self {
        Self { cards, lists: RefCell::default() }
    }

    /// Cards with an entry in `things.json`.
    pub fn any(&self) -> impl Iterator<Item = &'a ObjectCard> + use<'a> {
        self.list(Purpose::Any, &|_| true)
    }

    /// Cards that can be moved; with a support relation, only those that another card can hold in it.
    pub fn movers(&self, relation: Option<Relation>) -> impl Iterator<Item = &'a ObjectCard> + use<'a> {
        let hosts: Vec<&ObjectCard> = relation.into_iter().flat_map(|relation| self.carriers(relation)).collect();
        self.list(Purpose::Mover(relation), &|card| {
            let has_place = |relation| hosts.iter().any(|host| things().may_carry(host, card, relation));
            is_movable(card) && relation.is_none_or(has_place)
        })
    }

    /// Cards that can hold something in this support relation.
    pub fn carriers(&self, relation: Relation) -> impl Iterator<Item = &'a ObjectCard> + use<'a> {
        self.list(Purpose::Carrier(relation), &|card| {
            things().host(card).is_some_and(|host| host.relations.contains(&relation))
        })
    }

    /// Cards that can hold `item` in this support relation.
    pub fn hosts(&self, item: &ObjectCard, relation: Relation) -> impl Iterator<Item = &'a ObjectCard> + use<'a> {
        self.list(Purpose::Host(item, relation), &|host| things().may_carry(host, item, relation))
    }

    /// Cards that `host` can hold in this support relation.
    pub fn items(&self, host: &ObjectCard, relation: Relation) -> impl Iterator<Item = &'a ObjectCard> + use<'a> {
        self.list(Purpose::Item(host, relation), &|item| things().may_carry(host, item, relation))
    }

    /// Rigid cards of these general categories, or of all if the list is empty.
    pub fn fillers(&self, groups: &'static [&'static str]) -> impl Iterator<Item = &'a ObjectCard> + use<'a> {
        self.list(Purpose::Filler(groups.as_ptr(), groups.len()), &|card| {
            !card.is_articulated && (groups.is_empty() || groups.contains(&card.general_category.as_str()))
        })
    }

    /// The list for a purpose, in the order of the cards; computed on first use.
    fn list(
        &self,
        purpose: Purpose,
        suits: &dyn Fn(&ObjectCard) -> bool,
    ) -> impl Iterator<Item = &'a ObjectCard> + use<'a> {
        let listed = self.lists.borrow().get(&purpose).cloned();
        let list = listed.unwrap_or_else(|| {
            let is_known = |index: &usize| suits(&self.cards[*index]) && things().kind(&self.cards[*index]).is_some();
            let list: Rc<[usize]> = (0..self.cards.len()).filter(is_known).collect();
            self.lists.borrow_mut().insert(purpose, Rc::clone(&list));
            list
        });
        let cards = self.cards;
        (0..list.len()).map(move |index| &cards[list[index]])
    }
}
