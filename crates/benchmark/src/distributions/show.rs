//! Summary of a suite of task distributions.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use genmanip_core::Atom;
use genmanip_workspace::{WorkspaceError, text_table};
use serde::Serialize;

use super::format::{Distribution, DistributionsFile, RoleAtom, Split, card};
use super::suite::{Distributions, SplitChoice};

/// Summary of a suite of task distributions.
#[derive(Clone, Debug, Serialize)]
pub struct DistributionsOverview {
    /// Document of the suite.
    #[serde(flatten)]
    pub file: DistributionsFile,
    /// Number of frozen layouts by distribution.
    pub frozen: BTreeMap<String, usize>,
    /// First instruction of each split, by distribution.
    pub instructions: BTreeMap<String, BTreeMap<Split, String>>,
}

/// Summary of a suite from its folder.
///
/// # Errors
/// As [`Distributions::open`] and [`Distributions::draw`].
pub fn show(folder: &Path) -> Result<DistributionsOverview, WorkspaceError> {
    let suite = Distributions::open(folder)?;
    let (mut frozen, mut instructions) = (BTreeMap::new(), BTreeMap::<_, BTreeMap<_, _>>::new());
    for split in Split::ALL {
        for drawn in suite.draw(&SplitChoice { split, distribution: None, first: Some(1) })? {
            *frozen.entry(drawn.distribution.clone()).or_default() +=
                suite.frozen_layouts(&drawn.distribution, split).len();
            instructions.entry(drawn.distribution).or_default().insert(split, drawn.task.instruction);
        }
    }
    Ok(DistributionsOverview { file: suite.file, frozen, instructions })
}

/// Text summary.
pub fn describe(shown: &DistributionsOverview) -> String {
    let file = &shown.file;
    let sizes = Split::ALL.map(|split| format!("{} {}", split.name(), file.size(split))).join(", ");
    let mut text = format!(
        "{}: {} task distributions, seed {}\nlayouts of each: {sizes}\n\n",
        file.name,
        file.distributions.len(),
        file.seed
    );
    let head = ["distribution", "kind", "goal", "train", "instance", "category", "distractors", "time limit", "frozen"];
    let row = |one: &Distribution| {
        let of = |split| objects(one, split);
        vec![
            one.name.clone(),
            one.kind.name().into(),
            goals(one),
            of(Split::Train),
            of(Split::Instance),
            of(Split::Category),
            format!("0-{}", one.distractors.most),
            format!("{} s", one.horizon_s),
            shown.frozen.get(&one.name).copied().unwrap_or_default().to_string(),
        ]
    };
    let head = head.map(String::from).to_vec();
    text += &text_table(&[head].into_iter().chain(file.distributions.iter().map(row)).collect::<Vec<_>>());
    text += "\ntrain, instance, category: objects (categories) of the first role\n\nfirst instruction\n";
    for (name, of_split) in &shown.instructions {
        for (split, instruction) in of_split {
            text += &format!("  {name:14} {:10} {instruction}\n", split.name());
        }
    }
    text
}

/// Text with the number of the first role's objects in a split, and of their categories.
fn objects(distribution: &Distribution, split: Split) -> String {
    let objects = distribution.roles.first().map(|role| role.objects.of(split));
    let uids = objects.into_iter().flatten();
    let categories: BTreeSet<&str> = uids.filter_map(|uid| Some(card(uid)?.category.as_str())).collect();
    format!("{} ({})", objects.map_or(0, Vec::len), categories.len())
}

/// Text of the relations and joint states that the goals of `train` require.
fn goals(distribution: &Distribution) -> String {
    let name = |atom: &RoleAtom| match atom {
        Atom::Relation { relation, .. } => relation.name().to_owned(),
        Atom::State { state, .. } => state.clone(),
    };
    let of_goal = |conditions: &Vec<RoleAtom>| conditions.iter().map(name).collect::<Vec<_>>().join(" and ");
    let goals: Vec<String> = distribution.goals.train.iter().map(|goal| of_goal(&goal.conditions)).collect();
    goals.join(", ")
}
