//! The crates table of ARCHITECTURE.md, and whether the manifests obey it.

use super::manifest::Manifest;
use super::violation::Violation;
use crate::problem::{Problem, Result};
use std::collections::{BTreeMap, BTreeSet};

const PAGE: &str = "ARCHITECTURE.md";

/// One row: what a crate may use.
#[derive(Debug, PartialEq)]
pub struct Row {
    pub line: usize,
    /// Outside dependencies that are confined to the crates that name them.
    pub heavy: BTreeSet<String>,
    pub allowed: Allowed,
}

/// The last column.
#[derive(Debug, PartialEq)]
pub enum Allowed {
    All,
    Only(BTreeSet<String>),
}

/// The rows by crate, of the table that has the columns "crate", "heavy dependency" and "may depend on".
pub fn parse(page: &str) -> Result<BTreeMap<String, Row>> {
    let mut lines = page.lines().enumerate();
    let columns = lines.by_ref().map(|(_, line)| cells(line)).find(|cells| cells.iter().any(|c| c == "may depend on"));
    let position = |name: &str| columns.as_ref().and_then(|cells| cells.iter().position(|cell| cell == name));
    let (Some(name), Some(heavy), Some(allowed)) =
        (position("crate"), position("heavy dependency"), position("may depend on"))
    else {
        return Err(Problem {
            what: format!("{PAGE} has no table of the crates"),
            expected: "a Markdown table with the columns: crate | holds | heavy dependency | may depend on".into(),
            hint: "the tidy check reads its rules from that table".into(),
        });
    };
    let mut rows = BTreeMap::new();
    for (number, line) in lines.skip(1).take_while(|(_, line)| line.trim_start().starts_with('|')) {
        let cells = cells(line);
        let cell = |column: usize| cells.get(column).map_or("", String::as_str);
        let allowed = if cell(allowed) == "all" { Allowed::All } else { Allowed::Only(names(cell(allowed))) };
        rows.insert(cell(name).to_owned(), Row { line: number + 1, heavy: names(cell(heavy)), allowed });
    }
    Ok(rows)
}

/// The cells of a table line without the marks of code and emphasis.
fn cells(line: &str) -> Vec<String> {
    let Some(inner) = line.trim().strip_prefix('|') else {
        return Vec::new();
    };
    let inner = inner.strip_suffix('|').unwrap_or(inner);
    inner.split('|').map(|cell| cell.replace(['`', '*'], "").trim().to_owned()).collect()
}

/// `a, b` as a set; a dash is the empty one.
fn names(cell: &str) -> BTreeSet<String> {
    let names = cell.split(',').map(str::trim).filter(|name| !matches!(*name, "" | "–" | "-" | "—"));
    names.map(str::to_owned).collect()
}

/// `shared` are the outside dependencies that the root manifest offers to everybody.
pub fn check(rows: &BTreeMap<String, Row>, crates: &[Manifest], shared: &BTreeSet<String>) -> Vec<Violation> {
    let mut found = Vec::new();
    let mut report = |place: String, what: String, hint: &str| found.push(Violation { place, what, hint: hint.into() });
    for (name, row) in rows.iter().filter(|(name, _)| !crates.iter().any(|manifest| manifest.name == **name)) {
        report(
            format!("{PAGE}:{}", row.line),
            format!("the table names a crate that does not exist: {name}"),
            "the table holds what exists; plans are listed below it",
        );
    }
    for manifest in crates {
        let page = format!("crates/{}/Cargo.toml", manifest.name);
        if manifest.package != format!("genmanip-{}", manifest.name) && manifest.package != manifest.name {
            report(page.clone(), format!("the package is called {:?}", manifest.package), "call it genmanip-<folder>");
        }
        let Some(row) = rows.get(&manifest.name) else {
            report(page, format!("{PAGE} has no row for this crate"), "add a row that says what it may depend on");
            continue;
        };
        if let Allowed::Only(allowed) = &row.allowed {
            for (own, line) in manifest.own().filter(|(own, _)| !allowed.contains(*own)) {
                report(
                    format!("{page}:{line}"),
                    format!("{} must not depend on {own}", manifest.name),
                    "move the code to where it belongs, or change the table in ARCHITECTURE.md with the reason",
                );
            }
        }
        for (dependency, line) in manifest.dependencies.iter().filter(|(name, _)| !shared.contains(*name)) {
            let owners: Vec<&str> =
                rows.iter().filter(|(_, row)| row.heavy.contains(dependency)).map(|(name, _)| name.as_str()).collect();
            if !owners.is_empty() && !owners.contains(&manifest.name.as_str()) {
                report(
                    format!("{page}:{line}"),
                    format!("{dependency} is confined to {}", owners.join(", ")),
                    "use that crate's interface, or change the column \"heavy dependency\" with the reason",
                );
            }
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::super::manifest;
    use super::*;

    const PAGE: &str = "\
# Crates

| crate | holds | heavy dependency | may depend on |
|---|---|---|---|
| `core` | words | serde | – |
| `sim` | physics | mujoco-rs | core |
| `agent` | skills | – | core |
| `cli` | verbs | clap | all |

Planned: `policy`.
";

    fn found(manifests: &[(&str, &str)]) -> Vec<String> {
        let crates: Vec<Manifest> = manifests
            .iter()
            .map(|(name, rest)| {
                manifest::parse(name, &format!("[package]\nname = \"genmanip-{name}\"\n[dependencies]\n{rest}"))
            })
            .collect();
        let rows = parse(PAGE).unwrap();
        check(&rows, &crates, &["serde".to_owned()].into())
            .into_iter()
            .map(|v| format!("{}: {}", v.place, v.what))
            .collect()
    }

    const WHOLE: [(&str, &str); 4] = [
        ("core", "serde = \"1\""),
        ("sim", "genmanip-core = \"1\"\nserde = \"1\"\nmujoco-rs = \"1\""),
        ("agent", "genmanip-core = \"1\"\nbase64 = \"1\""),
        ("cli", "genmanip-sim = \"1\"\ngenmanip-agent = \"1\"\nclap = \"4\""),
    ];

    fn with(index: usize, name: &'static str, dependencies: &'static str) -> Vec<String> {
        let mut manifests = WHOLE;
        manifests[index] = (name, dependencies);
        found(&manifests)
    }

    #[test]
    fn the_last_column_is_obeyed() {
        assert_eq!(found(&WHOLE), Vec::<String>::new());
        let agent = "genmanip-core = \"1\"\ngenmanip-sim.workspace = true";
        assert_eq!(with(2, "agent", agent), ["crates/agent/Cargo.toml:5: agent must not depend on sim"]);
    }

    #[test]
    fn heavy_dependencies_stay_where_they_are_named() {
        assert_eq!(with(2, "agent", "mujoco-rs = \"7\""), ["crates/agent/Cargo.toml:4: mujoco-rs is confined to sim"]);
    }

    #[test]
    fn table_and_folders_name_the_same_crates() {
        assert_eq!(
            with(2, "policy", ""),
            [
                "ARCHITECTURE.md:7: the table names a crate that does not exist: agent",
                "crates/policy/Cargo.toml: ARCHITECTURE.md has no row for this crate"
            ]
        );
    }

    #[test]
    fn a_page_without_the_table_is_refused() {
        assert!(parse("# Nothing\n\n| crate | holds |\n").is_err());
    }
}
