//! The little that the rules need to know of a Cargo.toml.

use super::repository::Entry;
use super::violation::Violation;
use std::collections::{BTreeMap, BTreeSet};

const BUILD_SCRIPT: &str = "../../build/rpath.rs";

/// One package under `crates/`.
#[derive(Debug, Default, PartialEq)]
pub struct Manifest {
    /// The folder's name, which the tables use.
    pub name: String,
    pub package: String,
    /// Names of all dependencies (normal, development, build, per target), renames resolved, with their line.
    pub dependencies: BTreeMap<String, usize>,
    /// The build script, if one is named.
    pub build: Option<String>,
}

impl Manifest {
    /// The project's own crates among the dependencies, by folder name.
    pub fn own(&self) -> impl Iterator<Item = (&str, usize)> {
        let own = self.dependencies.iter().filter_map(|(name, line)| Some((name.strip_prefix("genmanip-")?, *line)));
        own.filter(|(name, _)| *name != self.name)
    }
}

/// All packages under `crates/`.
pub fn crates(files: &[Entry]) -> Vec<Manifest> {
    let manifests = files.iter().filter_map(|file| {
        let name = file.path.strip_prefix("crates/")?.strip_suffix("/Cargo.toml")?;
        (!name.contains('/')).then(|| parse(name, file.text.as_deref().unwrap_or_default()))
    });
    manifests.collect()
}

/// Dependencies that the root manifest shares with all crates, and that are therefore confined to none.
pub fn shared(root_manifest: &str) -> BTreeSet<String> {
    parse("", root_manifest).dependencies.into_keys().collect()
}

/// Reads line by line; of TOML's many ways to write a table, those that are used for dependencies.
pub fn parse(name: &str, text: &str) -> Manifest {
    let mut manifest = Manifest { name: name.to_owned(), ..Manifest::default() };
    let mut section = String::new();
    let mut whole_section = None; // the dependency in `[dependencies.NAME]`
    for (number, line) in text.lines().enumerate() {
        let line = without_comment(line).trim();
        if let Some(header) = line.strip_prefix('[').and_then(|rest| rest.strip_suffix(']')) {
            section = header.trim().to_owned();
            whole_section = one_dependency(&section).map(str::to_owned);
            if let Some(dependency) = &whole_section {
                manifest.dependencies.insert(dependency.clone(), number + 1);
            }
        } else if let Some((key, value)) = line.split_once('=') {
            let (key, value) = (key.trim(), value.trim());
            if let Some(alias) = &whole_section {
                if key == "package" {
                    manifest.dependencies.remove(alias);
                    manifest.dependencies.insert(unquoted(value).to_owned(), number + 1);
                }
            } else if is_dependencies(&section) {
                let alias = key.split('.').next().unwrap_or(key).trim_matches('"');
                let real = renamed(value).filter(|_| value.starts_with('{')).unwrap_or(alias);
                manifest.dependencies.insert(real.to_owned(), number + 1);
            } else if section == "package" && key == "name" {
                manifest.package = unquoted(value).to_owned();
            } else if section == "package" && key == "build" {
                manifest.build = Some(unquoted(value).to_owned());
            }
        }
    }
    manifest
}

fn is_dependencies(section: &str) -> bool {
    section.ends_with("dependencies") && !section.starts_with("package.metadata")
}

/// `foo` of `[dependencies.foo]` and `[target.'cfg(unix)'.dev-dependencies.foo]`.
fn one_dependency(section: &str) -> Option<&str> {
    let (table, name) = section.rsplit_once('.')?;
    (is_dependencies(table) && !name.ends_with("dependencies")).then(|| name.trim_matches('"'))
}

/// `real` of `{ package = "real", … }`.
fn renamed(value: &str) -> Option<&str> {
    let rest = value.split_once("package")?.1.trim_start().strip_prefix('=')?.trim_start().strip_prefix('"')?;
    rest.split('"').next()
}

fn unquoted(value: &str) -> &str {
    value.trim_matches(['"', '\''])
}

fn without_comment(line: &str) -> &str {
    let mut quoted = false;
    for (at, letter) in line.char_indices() {
        match letter {
            '"' => quoted = !quoted,
            '#' if !quoted => return &line[..at],
            _ => {}
        }
    }
    line
}

/// Every package that links the simulator, directly or not, tells its binaries where the library is.
pub fn check_run_path(crates: &[Manifest]) -> Vec<Violation> {
    let by_name: BTreeMap<&str, &Manifest> = crates.iter().map(|manifest| (manifest.name.as_str(), manifest)).collect();
    let mut found = Vec::new();
    for manifest in crates {
        let (mut seen, mut open) = (BTreeSet::new(), vec![manifest.name.as_str()]);
        while let Some(name) = open.pop() {
            if seen.insert(name) {
                open.extend(by_name.get(name).into_iter().flat_map(|next| next.own().map(|(own, _)| own)));
            }
        }
        if seen.contains("sim") && manifest.build.as_deref() != Some(BUILD_SCRIPT) {
            found.push(Violation {
                place: format!("crates/{}/Cargo.toml", manifest.name),
                what: "links the simulator, but its programs and tests would not find the library at run time".into(),
                hint: format!("under [package] write: build = \"{BUILD_SCRIPT}\""),
            });
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = r#"
[package]
name = "genmanip-layout" # comment
build = "../../build/rpath.rs"

[dependencies]
genmanip-core.workspace = true
glam = { version = "=0.34.2", features = ["serde"] } # a = b
renamed = { package = "genmanip-sim", path = "../sim" }

[dependencies.parry3d]
version = "0.1"

[target.'cfg(unix)'.dev-dependencies]
tempfile = "3"

[dev-dependencies.other]
package = "insta"

[features]
default = []
"#;

    #[test]
    fn all_ways_to_name_a_dependency() {
        let manifest = parse("layout", TEXT);
        let names: Vec<&str> = manifest.dependencies.keys().map(String::as_str).collect();
        assert_eq!(names, ["genmanip-core", "genmanip-sim", "glam", "insta", "parry3d", "tempfile"]);
        assert_eq!(manifest.package, "genmanip-layout");
        assert_eq!(manifest.build.as_deref(), Some(BUILD_SCRIPT));
        assert_eq!(manifest.own().map(|(name, _)| name).collect::<Vec<_>>(), ["core", "sim"]);
    }

    #[test]
    fn a_crate_that_reaches_the_simulator_indirectly_needs_the_run_path() {
        let sim = parse("sim", "[package]\nbuild = \"../../build/rpath.rs\"");
        let layout =
            parse("layout", "[package]\nbuild = \"../../build/rpath.rs\"\n[dependencies]\ngenmanip-sim = \"1\"");
        let bench = parse("bench", "[dependencies]\ngenmanip-layout = \"1\"");
        let found = check_run_path(&[sim, layout, bench, parse("core", "")]);
        assert_eq!(found.iter().map(|v| v.place.as_str()).collect::<Vec<_>>(), ["crates/bench/Cargo.toml"]);
    }
}
