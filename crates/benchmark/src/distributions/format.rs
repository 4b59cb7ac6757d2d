//! The document of a suite of task distributions, and its validation.

use std::collections::{BTreeMap, BTreeSet};

use genmanip_assets::Catalogue;
use genmanip_assets::metadata::Split as AssetSplit;
use genmanip_core::names::is_file_name;
use genmanip_core::{AssetUid, Atom, BetweenReading, Document, ObjectCard, Seed, TaskKind, named_enum};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

named_enum! {
    /// Split of the layouts of every distribution, by what is new compared with training.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, JsonSchema)]
    #[serde(rename_all = "snake_case")]
    pub enum Split {
        /// Layouts for demonstrations.
        Train = "train",
        /// Layouts for decisions during training, such as the choice of a checkpoint.
        Validation = "validation",
        /// Unseen layouts of the same objects as in `train`.
        Familiar = "familiar",
        /// Objects of the same categories as in `train` that `train` does not have.
        Instance = "instance",
        /// Objects of categories that `train` does not have.
        Category = "category",
        /// The same objects as in `train`, with a goal or wording that `train` does not have.
        Relation = "relation",
    }
}

/// Document `suite.json` of a suite of task distributions.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct DistributionsFile {
    /// Name, e.g. `genmanip-learn-10`.
    pub name: String,
    /// Seed of all layouts.
    pub seed: Seed,
    /// Meaning of *between* in all its layouts, initial and goal; overrides the world's. `space` if absent.
    #[serde(default = "BetweenReading::of_old_documents", skip_serializing_if = "BetweenReading::is_of_old_documents")]
    pub between: BetweenReading,
    /// Number of layouts of each distribution, by split.
    pub layouts: BTreeMap<Split, u64>,
    /// The distributions.
    pub distributions: Vec<Distribution>,
}

impl Document for DistributionsFile {
    const SCHEMA: &'static str = "genmanip.distributions/1";
}

/// A distribution of tasks: objects by role, and goals with their wordings.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Distribution {
    /// Name, e.g. `into`.
    pub name: String,
    /// Task category.
    pub kind: TaskKind,
    /// Simulated time available to a policy, s.
    pub horizon_s: f64,
    /// Roles of the objects that the instruction names.
    pub roles: Vec<Role>,
    /// Goals, one of which is drawn.
    pub goals: BySplit<Vec<GoalTemplate>>,
    /// Other objects on the table.
    pub distractors: Distractors,
}

/// A role in the goal, played by one object of a set.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Role {
    /// Name in goals and wordings, e.g. `object`.
    pub role: String,
    /// Uids of objects of the full catalogue, one of which is drawn.
    pub objects: BySplit<Vec<AssetUid>>,
}

/// Values by split. An absent one is that of `train`, which `validation` and `familiar` always share.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct BySplit<T> {
    /// Value of `train`, `validation` and `familiar`.
    pub train: T,
    /// Value of `instance`; that of `train` if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub instance: Option<T>,
    /// Value of `category`; that of `train` if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub category: Option<T>,
    /// Value of `relation`; that of `train` if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub relation: Option<T>,
}

impl<T> BySplit<T> {
    /// Value that applies to a split.
    pub fn of(&self, split: Split) -> &T {
        let own = match split {
            Split::Train | Split::Validation | Split::Familiar => None,
            Split::Instance => self.instance.as_ref(),
            Split::Category => self.category.as_ref(),
            Split::Relation => self.relation.as_ref(),
        };
        own.unwrap_or(&self.train)
    }
}

/// A condition on objects that are named by their roles.
pub type RoleAtom = Atom<String, String>;

/// A goal with roles in place of objects.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct GoalTemplate {
    /// Instructions, one of which is drawn; `{ROLE}` stands for the category of the role's object.
    pub wordings: Vec<String>,
    /// Conditions that all hold at the end.
    pub conditions: Vec<RoleAtom>,
    /// Names of initial states of articulated objects, by role.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub initial_states: BTreeMap<String, String>,
}

/// Objects that the instruction does not name; their categories differ from those that it names.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Distractors {
    /// Maximum number of distractors per layout; every number from 0 is equally likely.
    pub most: usize,
    /// Uids of objects of the full catalogue to draw from.
    pub objects: Vec<AssetUid>,
}

/// Minimum number of objects of the first role in `train`.
const MIN_INSTANCES: usize = 8;

impl DistributionsFile {
    /// Number of layouts of each distribution in a split.
    pub fn size(&self, split: Split) -> u64 {
        self.layouts.get(&split).copied().unwrap_or_default()
    }

    /// First fault of the document, with its JSON path or the name of the distribution; `None` if there is none.
    ///
    /// Checked are sizes, names, uids and roles, that the given object sets fit their splits, and that `relation` has
    /// no goal of `train`. Not checked are that some role has a set of its own for `instance` and `category`, and that
    /// objects can be placed.
    pub fn fault(&self) -> Option<String> {
        let missing = Split::ALL.into_iter().find(|split| self.size(*split) == 0);
        if let Some(split) = missing {
            return Some(format!("$.layouts: there is no layout of split `{}`", split.name()));
        }
        let names: BTreeSet<&str> = self.distributions.iter().map(|it| it.name.as_str()).collect();
        if names.is_empty() || names.len() < self.distributions.len() || !names.iter().all(|name| is_file_name(name)) {
            return Some("$.distributions: expected distributions with names of their own, fit for files".into());
        }
        let faults = self.distributions.iter().find_map(|one| Some((one.name.clone(), one.fault()?)));
        faults.map(|(name, fault)| format!("distribution `{name}`: {fault}"))
    }
}

impl Distribution {
    fn fault(&self) -> Option<String> {
        if !(self.horizon_s.is_finite() && self.horizon_s > 0.0) {
            return Some("expected a positive horizon_s".into());
        }
        let Some(first) = self.roles.first() else { return Some("expected at least one role".into()) };
        if first.objects.train.len() < MIN_INSTANCES {
            let count = first.objects.train.len();
            return Some(format!("role `{}` has {count} objects to train on, expected {MIN_INSTANCES}", first.role));
        }
        if let Some(uid) = self.distractors.objects.iter().find(|uid| card(uid).is_none()) {
            return Some(unknown(uid));
        }
        let roles = self.roles.iter().find_map(Role::fault);
        roles.or_else(|| Split::ALL.into_iter().find_map(|split| self.goals_fault(split)))
    }

    fn goals_fault(&self, split: Split) -> Option<String> {
        let goals = self.goals.of(split);
        if goals.is_empty() || goals.iter().any(|goal| goal.wordings.is_empty() || goal.conditions.is_empty()) {
            return Some(format!("{}: expected goals, each with wordings and conditions", split.name()));
        }
        if split == Split::Relation && goals.iter().any(|goal| self.goals.train.contains(goal)) {
            return Some("relation: it has a goal of train".into());
        }
        for goal in goals {
            let named = |atom| std::iter::once(Atom::subject(atom)).chain(Atom::references(atom));
            let named = goal.conditions.iter().flat_map(named).chain(goal.initial_states.keys()).map(String::as_str);
            let said = goal.wordings.iter().flat_map(|wording| placeholders(wording));
            if let Some(role) = named.chain(said).find(|name| self.roles.iter().all(|role| role.role != *name)) {
                return Some(format!("{}: there is no role `{role}`", split.name()));
            }
        }
        None
    }
}

impl Role {
    fn fault(&self) -> Option<String> {
        let BySplit { train, instance, category, relation } = &self.objects;
        let all = || {
            let further = [instance, category, relation].into_iter().flatten().flatten();
            train.iter().chain(further)
        };
        if let Some(uid) = all().find(|uid| card(uid).is_none()) {
            return Some(unknown(uid));
        }
        if Split::ALL.into_iter().any(|split| self.objects.of(split).is_empty()) {
            return Some(format!("role `{}` has an empty set of objects", self.role));
        }
        let catalogue = Catalogue::full();
        let of = |uid: &AssetUid| card(uid).map(|card| card.category.as_str()).unwrap_or_default();
        let trained: BTreeSet<&str> = train.iter().map(of).collect();
        let is_wrong = |uid: &&AssetUid, split: Split| {
            let (is_trained, known) = (trained.contains(of(uid)), catalogue.split(*uid));
            match split {
                Split::Train | Split::Validation | Split::Familiar | Split::Relation => known != AssetSplit::Train,
                Split::Instance => known != AssetSplit::UnseenInstance || !is_trained,
                Split::Category => is_trained,
            }
        };
        let own = [(Split::Train, Some(train)), (Split::Instance, instance.as_ref())];
        let own = own.into_iter().chain([(Split::Category, category.as_ref()), (Split::Relation, relation.as_ref())]);
        let mut wrong = own.filter_map(|(split, uids)| uids?.iter().find(|uid| is_wrong(uid, split)).zip(Some(split)));
        wrong.next().map(|(uid, split)| {
            format!("role `{}`: object `{uid}` does not belong into split `{}`", self.role, split.name())
        })
    }
}

/// Card of an object of the full catalogue.
pub(super) fn card(uid: &AssetUid) -> Option<&'static ObjectCard> {
    Catalogue::full().card(uid)
}

fn unknown(uid: &AssetUid) -> String {
    format!("object `{uid}` is not in the full catalogue")
}

/// Names in braces within a wording.
pub(super) fn placeholders(wording: &str) -> impl Iterator<Item = &str> {
    wording.split('{').skip(1).filter_map(|rest| Some(rest.split_once('}')?.0))
}
