//! Which cards come into question for what, worked out once for all designs of a task.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::rc::Rc;

use genmanip_core::{ObjectCard, Relation};

use super::things::{is_movable, things};

/// What cards are sought for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Purpose {
    /// Anything that there are words for.
    Any,
    /// To be moved, where a place for it exists in this relation of support.
    Mover(Option<Relation>),
    /// To carry anything in this relation of support.
    Carrier(Relation),
    /// To carry a card, which is told by its address.
    Host(*const ObjectCard, Relation),
    /// To be carried by one.
    Item(*const ObjectCard, Relation),
    /// To stand about, from some groups of things, told by their address and number.
    Filler(*const &'static str, usize),
}

/// The cards, and lists of them by purpose.
pub(super) struct Choices<'a> {
    cards: &'a [ObjectCard],
    lists: RefCell<BTreeMap<Purpose, Rc<[usize]>>>,
}

impl<'a> Choices<'a> {
    pub fn of(cards: &'a [ObjectCard]) -> Self {
        Self { cards, lists: RefCell::default() }
    }

    /// Cards that the designer has words for.
    pub fn any(&self) -> impl Iterator<Item = &'a ObjectCard> + use<'a> {
        self.list(Purpose::Any, &|_| true)
    }

    /// Cards that can be moved, and in this relation of support be put in or on another.
    pub fn movers(&self, relation: Option<Relation>) -> impl Iterator<Item = &'a ObjectCard> + use<'a> {
        let hosts: Vec<&ObjectCard> = relation.into_iter().flat_map(|relation| self.carriers(relation)).collect();
        self.list(Purpose::Mover(relation), &|card| {
            let has_place = |relation| hosts.iter().any(|host| things().may_carry(host, card, relation));
            is_movable(card) && relation.is_none_or(has_place)
        })
    }

    /// Cards that carry things in a relation of support.
    pub fn carriers(&self, relation: Relation) -> impl Iterator<Item = &'a ObjectCard> + use<'a> {
        self.list(Purpose::Carrier(relation), &|card| {
            things().host(card).is_some_and(|host| host.relations.contains(&relation))
        })
    }

    /// Cards that may carry an item.
    pub fn hosts(&self, item: &ObjectCard, relation: Relation) -> impl Iterator<Item = &'a ObjectCard> + use<'a> {
        self.list(Purpose::Host(item, relation), &|host| things().may_carry(host, item, relation))
    }

    /// Cards that a host may carry.
    pub fn items(&self, host: &ObjectCard, relation: Relation) -> impl Iterator<Item = &'a ObjectCard> + use<'a> {
        self.list(Purpose::Item(host, relation), &|item| things().may_carry(host, item, relation))
    }

    /// Rigid cards of these groups of things; of all where none is named.
    pub fn fillers(&self, groups: &'static [&'static str]) -> impl Iterator<Item = &'a ObjectCard> + use<'a> {
        self.list(Purpose::Filler(groups.as_ptr(), groups.len()), &|card| {
            !card.is_articulated && (groups.is_empty() || groups.contains(&card.general_category.as_str()))
        })
    }

    /// In the order of the cards.
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
