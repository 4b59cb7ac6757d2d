//! Building blocks of scenes: destinations with free room, objects to move, distractors that look alike, and fillers.

use genmanip_core::{ObjectCard, Relation, RelationKind};
use rand::RngExt;
use rand::seq::IndexedRandom;
use rand_chacha::ChaCha8Rng;

use super::balance::Balance;
use super::choices::Choices;
use super::naming::{Style, chance, has_looks};
use super::settings::DesignSettings;
use super::sketch::{Condition, Link, Sketch};
use super::things::{is_movable, things};

/// Maximum number of attempts to find room for one object before the design is rejected.
const PLACE_DRAWS: usize = 12;

/// Longest side of an object that goes between two others, metres. A longer one would push the two references too far
/// apart.
const MAX_SIZE_BETWEEN_M: f64 = 0.066;

/// Probability that a filler is chosen from the categories of the scene's theme.
const THEME_PROBABILITY: f64 = 0.85;

/// Goal position of a moved object: a relation to one reference, or to two for `between`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Place {
    pub relation: Relation,
    pub reference: usize,
    pub second: Option<usize>,
}

impl Place {
    /// The goal condition "`subject` is at this place".
    pub fn of(self, subject: usize) -> Condition {
        let Self { relation, reference, second } = self;
        Condition::Relation(Link { subject, relation, reference, second })
    }
}

/// A scene under construction, with the settings, random numbers and quotas that decide what is added next.
///
/// Methods that choose or add objects return `None` if no card suits or there is no room; the design is then rejected.
pub(super) struct Composer<'a> {
    pub choices: &'a Choices<'a>,
    pub settings: &'a DesignSettings,
    pub rng: ChaCha8Rng,
    /// Relations counted in the previous tasks and in this one so far.
    pub balance: Balance,
    pub sketch: Sketch<'a>,
    /// General categories that most fillers of this scene come from; empty until an object to move is chosen.
    pub theme: &'static [&'static str],
}

const KITCHEN: &[&str] = &["tableware", "kitchen", "packaged goods", "food"];
const DESK: &[&str] = &["office and toys", "office", "toys", "tools", "containers", "household", "bathroom"];

impl<'a> Composer<'a> {
    /// A random card that suits, is not in the scene yet, and has an entry in `things.json`; `None` if there is none.
    pub fn pick(&mut self, suits: impl Fn(&ObjectCard) -> bool) -> Option<&'a ObjectCard> {
        self.pick_of(self.choices.any(), suits)
    }

    /// A random card of `among` that suits and is not in the scene yet; `None` if there is none.
    pub fn pick_of(
        &mut self,
        among: impl Iterator<Item = &'a ObjectCard>,
        suits: impl Fn(&ObjectCard) -> bool,
    ) -> Option<&'a ObjectCard> {
        let scene = &self.sketch;
        let options: Vec<&'a ObjectCard> = among.filter(|card| suits(card) && !scene.contains(card)).collect();
        options.choose(&mut self.rng).copied()
    }

    /// An object to move. It also sets the theme of the scene.
    pub fn pick_mover(&mut self, suits: impl Fn(&ObjectCard) -> bool) -> Option<&'a ObjectCard> {
        self.pick_mover_for(None, suits)
    }

    /// Like [`Self::pick_mover`], restricted to objects that some card can hold in the support relation `support`.
    pub fn pick_mover_for(
        &mut self,
        support: Option<Relation>,
        suits: impl Fn(&ObjectCard) -> bool,
    ) -> Option<&'a ObjectCard> {
        let card = self.pick_of(self.choices.movers(support), suits)?;
        self.theme = if KITCHEN.contains(&card.general_category.as_str()) { KITCHEN } else { DESK };
        Some(card)
    }

    /// A card that can hold `item` in the given support relation.
    pub fn pick_host(
        &mut self,
        item: &ObjectCard,
        relation: Relation,
        suits: impl Fn(&ObjectCard) -> bool,
    ) -> Option<&'a ObjectCard> {
        self.pick_of(self.choices.hosts(item, relation), suits)
    }

    /// A rigid object that only fills the table, mostly from the scene's theme.
    pub fn pick_filler(&mut self) -> Option<&'a ObjectCard> {
        let theme = if chance(THEME_PROBABILITY, &mut self.rng) { self.theme } else { &[] };
        self.pick_of(self.choices.fillers(theme), |_| true)
    }

    /// Adds an object next to a random object of the scene, and returns its index like the other methods that add one.
    /// without room.
    pub fn add(&mut self, card: &'a ObjectCard) -> Option<usize> {
        self.add_with(card, None)
    }

    /// Adds an object to move. Nothing will be put on it, and for a goal around the reference it does not start next to
    /// it.
    pub fn add_to_move(&mut self, card: &'a ObjectCard, place: Place, style: Style) -> Option<usize> {
        let object = match place.relation.kind() == RelationKind::Around && style != Style::Place {
            true => self.add_away_from(card, place.reference, style)?,
            false => self.add_styled(card, style)?,
        };
        self.sketch.closed.push(object);
        Some(object)
    }

    fn add_away_from(&mut self, card: &'a ObjectCard, place: usize, style: Style) -> Option<usize> {
        let others = |composer: &Self| (0..composer.sketch.len()).filter(|&other| other != place).collect::<Vec<_>>();
        if others(self).is_empty() {
            let filler = self.pick_filler().filter(|filler| filler.uid != card.uid)?;
            self.add(filler)?;
        }
        let anchor = *others(self).choose(&mut self.rng)?;
        let relation = self.balance.choose(&Relation::SIDES, self.settings, &mut self.rng)?;
        let object = self.add_beside(card, relation, anchor)?;
        if style == Style::Looks {
            self.add_look_alikes(card);
        }
        Some(object)
    }

    /// Adds one or two objects that look like a card, if there are any: a distractor for an expression by appearance.
    fn add_look_alikes(&mut self, card: &ObjectCard) {
        for _ in 0..self.rng.random_range(1..=2) {
            if let Some(twin) = self.pick(|other| looks_like(other, card)) {
                self.add(twin);
            }
        }
    }

    fn add_with(&mut self, card: &'a ObjectCard, relation: Option<Relation>) -> Option<usize> {
        if self.sketch.len() == 0 {
            return Some(self.sketch.start(card));
        }
        let beside: Vec<Relation> = Relation::OF_PAIRS.into_iter().filter(|relation| !relation.is_support()).collect();
        for _ in 0..PLACE_DRAWS {
            let anchor = self.rng.random_range(0..self.sketch.len());
            let relation = relation.or_else(|| self.balance.choose(&beside, self.settings, &mut self.rng))?;
            if let Some(object) = self.add_beside(card, relation, anchor) {
                return Some(object);
            }
        }
        None
    }

    /// Adds an object in a direction relation to the given one.
    pub fn add_beside(&mut self, card: &'a ObjectCard, relation: Relation, anchor: usize) -> Option<usize> {
        if self.sketch.contains(card) {
            return None;
        }
        let object = self.sketch.beside(card, relation, anchor, self.settings, &mut self.rng)?;
        self.sketch.relate(object, relation, anchor, &mut self.balance, self.settings);
        Some(object)
    }

    /// A goal position in the given relation with enough free room for `item`; adds the references that it needs.
    pub fn destination(&mut self, item: &ObjectCard, relation: Relation, style: Style) -> Option<Place> {
        if relation.is_support() {
            let host = self.pick_host(item, relation, |card| style != Style::Looks || has_looks(card))?;
            let reference = self.add_styled(host, style)?;
            self.sketch.closed.push(reference);
            return Some(Place { relation, reference, second: None });
        }
        let anchor = match style {
            Style::Looks => self.pick(|card| !card.is_articulated && has_looks(card) && card.uid != item.uid)?,
            _ => self.pick_filler().filter(|card| card.uid != item.uid)?,
        };
        let reference = self.add_styled(anchor, style)?;
        let mut place = Place { relation, reference, second: None };
        if relation.has_two_references() {
            let aside = if chance(0.6, &mut self.rng) { Relation::Left } else { Relation::Front };
            if item.size_m.x.max(item.size_m.y) > MAX_SIZE_BETWEEN_M {
                return None;
            }
            let twin = anchor.category.clone();
            let like = self.pick(|card| card.category == twin && card.uid != item.uid);
            let end = match like.filter(|_| style == Style::Plain && self.rng.random()) {
                Some(card) => card,
                None => self.pick_filler().filter(|card| card.uid != item.uid)?,
            };
            place.second = Some(self.add_beyond(item, aside, reference, end)?);
        } else {
            self.keep_free(item, relation, reference)?;
        }
        Some(place)
    }

    /// Adds `end` on a random side of `reference`, with free room for `item` between them.
    pub fn add_across(&mut self, item: &ObjectCard, reference: usize, end: &'a ObjectCard) -> Option<usize> {
        let aside = *Relation::SIDES.choose(&mut self.rng)?;
        self.add_beyond(item, aside, reference, end)
    }

    /// Adds `end` on one side of `reference`, with free room for `item` between them.
    fn add_beyond(
        &mut self,
        item: &ObjectCard,
        aside: Relation,
        reference: usize,
        end: &'a ObjectCard,
    ) -> Option<usize> {
        self.sketch.keep_free(item, aside, reference, self.settings, &mut self.rng).then_some(())?;
        let second = self.sketch.beyond(end, aside, self.settings)?;
        self.sketch.is_straight(reference, item, second).then_some(())?;
        self.sketch.relate(second, aside, reference, &mut self.balance, self.settings);
        Some(second)
    }

    /// Reserves free room for `item` beside `anchor`.
    pub fn keep_free(&mut self, item: &ObjectCard, relation: Relation, anchor: usize) -> Option<()> {
        (0..PLACE_DRAWS)
            .any(|_| self.sketch.keep_free(item, relation, anchor, self.settings, &mut self.rng))
            .then_some(())
    }

    /// Adds an object, and with it the distractors that make a reference of this style necessary.
    pub fn add_styled(&mut self, card: &'a ObjectCard, style: Style) -> Option<usize> {
        match style {
            Style::Plain => self.add(card),
            Style::Looks => {
                let object = self.add(card)?;
                self.add_look_alikes(card);
                Some(object)
            }
            Style::Place => self.add_placed(card),
        }
    }

    /// Adds an object and another one of its kind at positions that distinguish them.
    fn add_placed(&mut self, card: &'a ObjectCard) -> Option<usize> {
        match self.rng.random_range(0..10) {
            0..3 => self.add_between(card),
            3..5 if is_movable(card) => {
                let object = self.add_on_something(card)?;
                let twin = self.pick(|other| shares_noun(other, card))?;
                self.add(twin)?;
                Some(object)
            }
            5..7 => self.add_to_row(card),
            _ => self.add_opposite(card),
        }
    }

    /// Adds an object that stands on or in another one, from which it is easy to take.
    pub fn add_on_something(&mut self, card: &'a ObjectCard) -> Option<usize> {
        let host = self.pick(|host| things().may_be_taken_from(host, card))?;
        let host = self.add(host)?;
        self.sketch.closed.push(host);
        let relation = self.support_relation(host)?;
        self.put(card, relation, host)
    }

    fn support_relation(&mut self, host: usize) -> Option<Relation> {
        let relations = &things().host(self.sketch.cards[host])?.relations;
        self.balance.choose(relations, self.settings, &mut self.rng)
    }

    /// Puts an object in or on another one of the scene.
    pub fn put(&mut self, card: &'a ObjectCard, relation: Relation, host: usize) -> Option<usize> {
        let object = self.sketch.put(card, relation, host)?;
        self.balance.add(relation);
        Some(object)
    }

    /// Adds `card` on one side of an anchor and another object of its kind on another side.
    fn add_opposite(&mut self, card: &'a ObjectCard) -> Option<usize> {
        let anchor = self.pick_filler().filter(|anchor| !shares_noun(anchor, card) && anchor.uid != card.uid)?;
        let anchor = self.add(anchor)?;
        let side = *Relation::SIDES.choose(&mut self.rng)?;
        let object = self.add_beside(card, side, anchor)?;
        let twin = self.pick(|other| shares_noun(other, card))?;
        let mut sides: Vec<Relation> = Relation::SIDES.into_iter().filter(|other| *other != side).collect();
        while !sides.is_empty() {
            let other = sides.swap_remove(self.rng.random_range(0..sides.len()));
            if self.add_beside(twin, other, anchor).is_some() {
                return Some(object);
            }
        }
        None
    }

    /// Adds `card` between two others and, if there is one, another object of its kind beyond one of them.
    fn add_between(&mut self, card: &'a ObjectCard) -> Option<usize> {
        let first = self.pick_filler().filter(|first| !shares_noun(first, card) && first.uid != card.uid)?;
        let category = first.category.clone();
        let like = self.pick(|other| other.category == category && other.uid != first.uid);
        let last = match like.filter(|_| self.rng.random()) {
            Some(like) => like,
            None => self.pick_filler().filter(|last| !shares_noun(last, card) && last.uid != card.uid)?,
        };
        let side = *Relation::SIDES.choose(&mut self.rng)?;
        let (_, object, last) = self.add_triple(first, card, last, side)?;
        if let Some(twin) = self.pick(|other| shares_noun(other, card)) {
            self.add_beside(twin, side, last)?;
        }
        Some(object)
    }

    /// Adds three objects in a row and states that the middle one is between the others.
    fn add_triple(
        &mut self,
        first: &'a ObjectCard,
        middle: &'a ObjectCard,
        last: &'a ObjectCard,
        side: Relation,
    ) -> Option<(usize, usize, usize)> {
        if first.uid == last.uid || middle.uid == last.uid || first.uid == middle.uid {
            return None;
        }
        let first = self.add(first)?;
        let middle = self.add_beside(middle, side, first)?;
        let last = self.add_beside(last, side, middle)?;
        self.say_between(middle, first, last)?;
        Some((first, middle, last))
    }

    /// Adds `card` at a random position in a row of three objects of its kind.
    fn add_to_row(&mut self, card: &'a ObjectCard) -> Option<usize> {
        let side = *Relation::SIDES.choose(&mut self.rng)?;
        let position = self.rng.random_range(0..3);
        let mut object = None;
        let mut before: Option<usize> = None;
        for index in 0..3 {
            let member = if index == position {
                card
            } else {
                self.pick(|other| shares_noun(other, card) && other.uid != card.uid)?
            };
            let added = match before {
                None => self.add(member)?,
                Some(before) => self.add_beside(member, side, before)?,
            };
            if index == position {
                object = Some(added);
            }
            before = Some(added);
        }
        object
    }

    /// Adds objects until the scene has `count` of them, preferring the relations furthest below their quotas.
    pub fn fill(&mut self, count: usize) {
        if self.settings.copies > 0.0 && chance(self.settings.copies, &mut self.rng) {
            self.add_copy();
        }
        for _ in 0..4 * count {
            let missing = count.saturating_sub(self.sketch.len());
            if missing == 0 {
                return;
            }
            let Some(relation) = self.balance.choose(&Relation::ALL, self.settings, &mut self.rng) else { return };
            match relation.kind() {
                RelationKind::Between if missing >= 2 => self.fill_between(),
                RelationKind::Between => None,
                RelationKind::Support(_) => self.fill_host(relation, missing),
                RelationKind::Side(_) | RelationKind::Around => {
                    self.pick_filler().and_then(|card| self.add_with(card, Some(relation)))
                }
            };
        }
    }

    /// Adds a second instance of a rigid object that stands on the table.
    fn add_copy(&mut self) -> Option<usize> {
        let suits =
            |&object: &usize| !self.sketch.cards[object].is_articulated && self.sketch.carrier(object).is_none();
        let options: Vec<usize> = (0..self.sketch.len()).filter(suits).collect();
        let &object = options.choose(&mut self.rng)?;
        let card = self.sketch.cards[object];
        for _ in 0..PLACE_DRAWS {
            let anchor = self.rng.random_range(0..self.sketch.len());
            let relation = self.balance.choose(&Relation::SIDES, self.settings, &mut self.rng)?;
            if let Some(copy) = self.sketch.beside(card, relation, anchor, self.settings, &mut self.rng) {
                self.sketch.relate(copy, relation, anchor, &mut self.balance, self.settings);
                if self.sketch.closed.contains(&object) {
                    self.sketch.closed.push(copy);
                }
                return Some(copy);
            }
        }
        None
    }

    fn fill_between(&mut self) -> Option<usize> {
        let anchor = self.rng.random_range(0..self.sketch.len());
        let side = *Relation::SIDES.choose(&mut self.rng)?;
        let middle = self.pick_filler()?;
        let middle = self.add_beside(middle, side, anchor)?;
        let last = self.pick_filler()?;
        let last = self.add_beside(last, side, middle)?;
        self.say_between(middle, anchor, last)?;
        Some(last)
    }

    /// States that an object is between two others; `None` if their heights differ too much.
    fn say_between(&mut self, middle: usize, first: usize, last: usize) -> Option<()> {
        self.sketch.is_straight(first, self.sketch.cards[middle], last).then_some(())?;
        self.sketch.edges.push(Link {
            subject: middle,
            relation: Relation::Between,
            reference: first,
            second: Some(last),
        });
        self.balance.add(Relation::Between);
        Some(())
    }

    fn fill_host(&mut self, relation: Relation, missing: usize) -> Option<usize> {
        let open = |composer: &Self, host: usize| {
            let rigid = !composer.sketch.cards[host].is_articulated;
            rigid && !composer.sketch.closed.contains(&host) && composer.sketch.carrier(host).is_none()
        };
        let hosts: Vec<usize> = (0..self.sketch.len()).filter(|&host| open(self, host)).collect();
        for &host in &hosts {
            let card = self.sketch.cards[host];
            let item = self.pick_of(self.choices.items(card, relation), |_| true);
            if let Some(object) = item.and_then(|item| self.put(item, relation, host)) {
                return Some(object);
            }
        }
        if missing < 2 {
            return None;
        }
        let host = self.pick_of(self.choices.carriers(relation), |_| true)?;
        let item = self.pick_of(self.choices.items(host, relation), |_| true)?;
        let host = self.add(host)?;
        self.put(item, relation, host)
    }

    /// True if another object of the scene looks like this one.
    pub fn has_look_alike(&self, object: usize) -> bool {
        let cards = &self.sketch.cards;
        (0..cards.len()).any(|other| other != object && looks_like(cards[other], cards[object]))
    }

    /// A random number of objects for the scene, within the settings.
    pub fn object_count(&mut self) -> usize {
        let [fewest, most] = self.settings.objects;
        let spread = (most - fewest) as f64 + 1.0;
        let share = 0.5 * (self.rng.random::<f64>() + self.rng.random::<f64>());
        fewest + (share * spread) as usize
    }
}

/// True if one of the words for `other` also applies to `one`.
pub(super) fn shares_noun(one: &ObjectCard, other: &ObjectCard) -> bool {
    one.category == other.category
        || things().groups_of(other).any(|(_, group)| group.members.contains(&one.category))
        || things().kind(other).is_some_and(|kind| kind.alike.contains(&one.category))
}

/// True if the two are of one kind, or of one class and colour.
fn looks_like(one: &ObjectCard, other: &ObjectCard) -> bool {
    let class = |card: &ObjectCard| things().kind(card).map(|kind| kind.class.clone());
    shares_noun(one, other) || (class(one) == class(other) && one.colors.first() == other.colors.first())
}
