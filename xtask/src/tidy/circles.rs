//! No two files of a crate import each other, directly or through others: such files can only be read, tested and moved
//! together.
//!
//! Circles between a module and those below it are a rule of their own, [`Kind::Knots`]. A parent that only re-exports a
//! child does not use it. Tests are exempt.

use super::imports::{self, Imports};
use super::repository::Entry;
use super::violation::Violation;
use std::collections::{BTreeMap, BTreeSet};

/// Kind of circle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Kind {
    /// Imports between a module and those below it do not count.
    Circles,
    /// Circles that only imports between a module and those below it close.
    Knots,
}

/// Every circle of one kind in every crate, with the names that tie it.
pub fn check(files: &[Entry], kind: Kind) -> Vec<Violation> {
    let mut crates: BTreeMap<&str, Vec<&Entry>> = BTreeMap::new();
    for file in files.iter().filter(|file| file.path.ends_with(".rs")) {
        if let Some((root, _)) = file.path.split_once("/src/").filter(|(root, _)| is_package(root)) {
            crates.entry(root).or_default().push(file);
        }
    }
    crates.into_iter().flat_map(|(root, files)| Crate::read(root, &files).circles(kind)).collect()
}

/// `xtask`, or a folder right below `crates/`.
fn is_package(root: &str) -> bool {
    root == "xtask" || root.strip_prefix("crates/").is_some_and(|name| !name.contains('/'))
}

/// From the crate's root, without `crate`.
type Module = Vec<String>;

/// The modules of one crate.
#[derive(Default)]
struct Crate {
    /// Path from the repository's root, module and content.
    files: Vec<(String, Module, Imports)>,
    /// The file that holds a module.
    modules: BTreeMap<Module, usize>,
    definitions: BTreeSet<(Module, String)>,
    /// Paths that imported names at the level of a module stand for.
    names: BTreeMap<(Module, String), Module>,
    /// Modules whose names another module takes over as a whole.
    globs: BTreeMap<Module, Vec<Module>>,
}

/// Per pair of files the names that the first takes from the second.
type Edges = BTreeMap<(usize, usize), BTreeSet<String>>;

/// Re-exports followed before giving up.
const MAX_HOPS: usize = 16;

impl Crate {
    fn read(root: &str, files: &[&Entry]) -> Self {
        let mut all = Self::default();
        for file in files {
            let inside = &file.path[root.len() + "/src/".len()..];
            if let Some(module) = module_of(inside) {
                let imports = imports::read(&module, file.text.as_deref().unwrap_or_default());
                all.files.push((file.path.clone(), module, imports));
            }
        }
        let tests: Vec<Module> = all.files.iter().flat_map(|(_, _, found)| found.test_modules.clone()).collect();
        all.files.retain(|(_, module, _)| !tests.iter().any(|test| module.starts_with(test)));
        for (index, (_, module, imports)) in all.files.iter().enumerate() {
            all.modules.insert(module.clone(), index);
            all.modules.extend(imports.inline_modules.iter().map(|inner| (inner.clone(), index)));
            all.definitions.extend(imports.definitions.iter().cloned());
        }
        let uses: Vec<(Module, String, Module)> = (all.files.iter().flat_map(|(_, _, imports)| &imports.uses))
            .filter(|one| one.is_visible)
            .filter_map(|one| Some((one.module.clone(), one.name.clone(), all.absolute(&one.module, &one.path)?)))
            .collect();
        for (module, name, path) in uses {
            if name == "*" {
                all.globs.entry(module).or_default().push(path);
            } else {
                all.names.insert((module, name), path);
            }
        }
        all
    }

    /// A path from the crate's root; `None` when it leads out of the crate.
    fn absolute(&self, module: &[String], path: &[String]) -> Option<Module> {
        let mut stem = module.to_vec();
        let mut rest = path;
        match path.first()?.as_str() {
            "crate" => (stem, rest) = (Vec::new(), &path[1..]),
            "self" => rest = &path[1..],
            "super" => {}
            name => {
                let inner: Module = stem.iter().cloned().chain([name.to_owned()]).collect();
                if !self.modules.contains_key(&inner) {
                    let known = self.names.get(&(stem, name.to_owned()))?;
                    return Some(known.iter().chain(&path[1..]).cloned().collect());
                }
            }
        }
        while let Some(("super", behind)) = rest.split_first().map(|(first, behind)| (first.as_str(), behind)) {
            stem.pop()?;
            rest = behind;
        }
        stem.extend(rest.iter().cloned());
        Some(stem)
    }

    /// The file that holds what a path from the crate's root names, and the name; re-exports are followed.
    ///
    /// Files that hand on what does not lie below them are added to `via`.
    fn file_of(&self, path: &[String], hops: usize, via: &mut BTreeSet<usize>) -> Option<(usize, String)> {
        let depth = (0..=path.len()).rev().find(|&depth| self.modules.contains_key(&path[..depth]))?;
        let (module, rest) = path.split_at(depth);
        let file = self.modules[module];
        let Some((name, behind)) = rest.split_first() else {
            return Some((file, module.last().cloned().unwrap_or_else(|| "crate".to_owned())));
        };
        let here = Some((file, name.clone()));
        let key = (module.to_vec(), name.clone());
        if hops == 0 || self.definitions.contains(&key) {
            return here;
        }
        let by_name = self.names.get(&key).map(|known| known.iter().chain(behind).cloned().collect::<Module>());
        let by_glob = || {
            let globs = self.globs.get(module)?.iter();
            let below = |glob: &Module| glob.iter().chain(rest).cloned().collect::<Module>();
            globs.map(below).find(|path| {
                let (stem, name) = path.split_at(path.len() - rest.len());
                let key = (stem.to_vec(), name[0].clone());
                self.definitions.contains(&key) || self.names.contains_key(&key)
            })
        };
        let Some(next) = by_name.or_else(by_glob) else { return here };
        let found = self.file_of(&next, hops - 1, via)?;
        if !self.files[found.0].1.starts_with(&self.files[file].1) {
            via.insert(file);
        }
        Some(found)
    }

    fn edges(&self, kind: Kind) -> Edges {
        let mut edges = Edges::new();
        let counts = |from: usize, to: usize, is_used: bool| match kind {
            Kind::Circles => !self.is_below(to, from) && !self.is_below(from, to),
            Kind::Knots => to != from && (is_used || !self.is_below(to, from)),
        };
        for (from, (_, _, imports)) in self.files.iter().enumerate() {
            let words: BTreeSet<&str> = imports.words.iter().map(String::as_str).collect();
            // With whether the file itself uses the name: a parent that only hands on what lies below it does not.
            let is_used = |one: &imports::Use| words.contains(one.name.as_str());
            let uses = imports.uses.iter().filter(|one| one.name != "*");
            let uses = uses.map(|one| (&one.module, one.path.clone(), is_used(one)));
            let paths = imports.paths.iter().map(|(module, path)| (module, path.clone(), true));
            // Of a glob only what is named counts.
            let of_globs = imports.uses.iter().filter(|one| one.name == "*").flat_map(|one| {
                let below = |word: &String| one.path.iter().chain([word]).cloned().collect::<Module>();
                let words = imports.words.iter().filter(|word| self.is_known(&one.module, &one.path, word));
                words.map(move |word| (&one.module, below(word), true))
            });
            for (module, path, is_used) in uses.chain(paths).chain(of_globs) {
                let Some(path) = self.absolute(module, &path) else { continue };
                let mut via = BTreeSet::new();
                let Some((to, name)) = self.file_of(&path, MAX_HOPS, &mut via) else { continue };
                for to in via.into_iter().chain([to]).filter(|&to| counts(from, to, is_used)) {
                    edges.entry((from, to)).or_default().insert(name.clone());
                }
            }
        }
        edges
    }

    /// True if the module that `path` names in `module` defines or imports a name.
    fn is_known(&self, module: &[String], path: &[String], name: &str) -> bool {
        let key = self.absolute(module, path).map(|path| (path, name.to_owned()));
        key.is_some_and(|key| self.definitions.contains(&key) || self.names.contains_key(&key))
    }

    /// True if the first file's module lies below the second's.
    fn is_below(&self, file: usize, parent: usize) -> bool {
        self.files[file].1.starts_with(&self.files[parent].1)
    }

    fn circles(&self, kind: Kind) -> Vec<Violation> {
        let strict = self.edges(Kind::Circles);
        let known = self.groups(&strict);
        match kind {
            Kind::Circles => known.iter().map(|group| self.violation(group, &strict)).collect(),
            Kind::Knots => {
                let edges = self.edges(kind);
                self.groups(&edges).difference(&known).map(|group| self.violation(group, &edges)).collect()
            }
        }
    }

    /// Groups of files of which each leads to every other.
    fn groups(&self, edges: &Edges) -> BTreeSet<BTreeSet<usize>> {
        let reached: Vec<BTreeSet<usize>> = (0..self.files.len()).map(|from| reached(from, edges)).collect();
        let group = |file: usize| -> BTreeSet<usize> {
            reached[file].iter().copied().filter(|&other| reached[other].contains(&file)).collect()
        };
        (0..self.files.len()).map(group).filter(|group| !group.is_empty()).collect()
    }

    fn violation(&self, group: &BTreeSet<usize>, edges: &Edges) -> Violation {
        let path = |file: usize| self.files[file].0.as_str();
        let ties = edges.iter().filter(|((from, to), _)| group.contains(from) && group.contains(to));
        let lines = ties.map(|(&(from, to), names)| {
            let names: Vec<&str> = names.iter().map(String::as_str).collect();
            format!("\n      {} -> {}: {}", path(from), path(to), names.join(", "))
        });
        Violation {
            place: group.first().map_or_else(String::new, |&file| path(file).to_owned()),
            what: format!("{} files import each other in a circle:{}", group.len(), lines.collect::<String>()),
            hint: "move what both need into a file of its own, or to the side that needs nothing of the other".into(),
        }
    }
}

/// All files that imports lead to, perhaps back to the first.
fn reached(from: usize, edges: &Edges) -> BTreeSet<usize> {
    let mut reached = BTreeSet::new();
    let mut open = vec![from];
    while let Some(file) = open.pop() {
        let next = edges.range((file, 0)..=(file, usize::MAX)).map(|((_, to), _)| *to);
        open.extend(next.filter(|&to| reached.insert(to)).collect::<Vec<_>>());
    }
    reached
}

/// The module of a file, from its path inside of `src`; `None` for tests and other programs.
fn module_of(inside: &str) -> Option<Module> {
    let parts: Vec<&str> = inside.strip_suffix(".rs")?.split('/').collect();
    if parts.contains(&"tests") || parts[0] == "bin" {
        return None;
    }
    let parts = match parts.as_slice() {
        ["lib" | "main"] => &[],
        [folders @ .., "mod"] => folders,
        all => all,
    };
    Some(parts.iter().map(|part| (*part).to_owned()).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The circles of a crate, as the names of their files.
    fn circles(files: &[(&str, &str)], kind: Kind) -> Vec<String> {
        let path = |name: &str| format!("crates/a/src/{name}.rs");
        let entry = |(name, text): &(&str, &str)| Entry { path: path(name), text: Some((*text).to_owned()) };
        let files: Vec<Entry> = files.iter().map(entry).collect();
        let ties = |violation: Violation| {
            let lines = violation.what.lines().skip(1).map(|line| line.trim().replace("crates/a/src/", ""));
            lines.collect::<Vec<_>>().join("; ").replace(".rs", "")
        };
        check(&files, kind).into_iter().map(ties).collect()
    }

    #[test]
    fn files_that_import_each_other() {
        let check = |name: &str, files: &[(&str, &str)], expected: &[&str]| {
            assert_eq!(circles(files, Kind::Circles), expected, "{name}");
        };
        check(
            "two",
            &[
                ("lib", "mod x; mod y;"),
                ("x", "use crate::y::Y; pub struct X;"),
                ("y", "use crate::x::X; pub struct Y;"),
            ],
            &["x -> y: Y; y -> x: X"],
        );
        check(
            "three, by paths that are not imported first",
            &[
                ("lib", "mod x; mod y; mod z;"),
                ("x", "pub fn f() { crate::y::g() }"),
                ("y", "pub fn g() { super::z::h() }"),
                ("z", "use crate::x; pub fn h() { x::f() }"),
            ],
            &["x -> y: g; y -> z: h; z -> x: f, x"],
        );
        check(
            "through super, in a folder",
            &[
                ("lib", "mod a;"),
                ("a/mod", "mod x; mod y;"),
                ("a/x", "use super::y::{self, Y}; pub struct X(Y, y::Z);"),
                ("a/y", "use super::x::X; pub struct Y; pub struct Z;"),
            ],
            &["a/x -> a/y: Y, Z, y; a/y -> a/x: X"],
        );
        check(
            "hidden by re-exports of the parent, one of them a glob",
            &[
                ("lib", "mod a; mod b; pub use a::X; pub use b::*;"),
                ("a", "pub struct X; fn f(_: crate::Y) {}"),
                ("b", "use crate::X; pub struct Y(X);"),
            ],
            &["a -> b: Y; b -> a: X"],
        );
        check(
            "a glob of the parent",
            &[
                ("lib", "mod x; mod y; use x::X; use y::Y;"),
                ("x", "use super::*; pub struct X(Y);"),
                ("y", "use super::*; pub struct Y(Box<X>);"),
            ],
            &["x -> y: Y; y -> x: X"],
        );
        check(
            "one that hands on what lies beside it",
            &[
                ("lib", "mod x; mod y; mod z;"),
                ("x", "use crate::y::Z; pub struct X;"),
                ("y", "pub use crate::z::Z; use crate::x::X;"),
                ("z", "pub struct Z;"),
            ],
            &["x -> y: Z; y -> x: X"],
        );
        check(
            "a folder's module and a file outside of it",
            &[
                ("lib", "mod a; mod b;"),
                ("a", "mod x; pub use x::X; use crate::b::B;"),
                ("a/x", "use crate::b::B; pub struct X;"),
                ("b", "use crate::a::X; pub struct B;"),
            ],
            &["a/x -> b: B; b -> a/x: X"],
        );
    }

    #[test]
    fn what_is_no_circle() {
        let check = |name: &str, files: &[(&str, &str)]| {
            assert_eq!(circles(files, Kind::Circles), Vec::<String>::new(), "{name}")
        };
        check(
            "parent and child",
            &[("lib", "mod x; use x::X; pub struct Y;"), ("x", "use crate::Y; pub struct X(Y);")],
        );
        check(
            "parent and child below the root",
            &[("lib", "mod a;"), ("a", "mod x; use x::X; pub struct Y;"), ("a/x", "use super::Y; pub struct X(Y);")],
        );
        check(
            "tests, in the file and beside it",
            &[
                ("lib", "mod x; mod y; #[cfg(test)] mod trials;"),
                ("x", "pub struct X; #[cfg(test)] mod tests { use crate::y::Y; }"),
                ("y", "use crate::x::X; use crate::trials; pub struct Y;"),
                ("trials", "use crate::y::Y;"),
                ("y/tests", "use crate::x::X;"),
            ],
        );
        check(
            "a name of another crate, in a comment and in a text",
            &[
                ("lib", "mod x; mod y;"),
                ("x", "use other::y::Y; // use crate::y::Y;\nconst T: &str = \"use crate::y::Y;\";"),
                ("y", "use crate::x::T; pub struct Y;"),
            ],
        );
        check(
            "one way only",
            &[("lib", "mod x; mod y; mod z;"), ("x", "use crate::{y::Y, z::Z};"), ("y", "use crate::z::Z;"), ("z", "")],
        );
    }

    #[test]
    fn knots_between_parent_and_child() {
        let check = |name: &str, files: &[(&str, &str)], expected: &[&str]| {
            assert_eq!(circles(files, Kind::Knots), expected, "{name}");
        };
        check(
            "a parent that uses its child, which takes a type of the parent",
            &[("lib", "mod x; use x::f; pub struct Y; fn g() { f() }"), ("x", "use crate::Y; pub fn f(_: Y) {}")],
            &["lib -> x: f; x -> lib: Y"],
        );
        check(
            "by a path, below the root",
            &[
                ("lib", "mod a;"),
                ("a/mod", "mod x; pub struct Y; fn g() { x::f() }"),
                ("a/x", "use super::Y; pub fn f(_: Y) {}"),
            ],
            &["a/mod -> a/x: f; a/x -> a/mod: Y"],
        );
        check(
            "through a grandchild",
            &[
                ("lib", "mod a; pub struct Y; fn g() { a::g() }"),
                ("a/mod", "mod x; pub fn g() { x::f() }"),
                ("a/x", "pub fn f(_: crate::Y) {}"),
            ],
            &["lib -> a/mod: g; a/mod -> a/x: f; a/x -> lib: Y"],
        );
        check(
            "a parent that re-exports its child",
            &[("lib", "mod x; pub use x::f; pub struct Y;"), ("x", "use crate::Y; pub fn f(_: Y) {}")],
            &[],
        );
        check(
            "a child that takes a sibling's type by way of the parent",
            &[
                ("lib", "mod x; mod y; pub use y::Y; fn g() { x::f() }"),
                ("x", "use crate::Y; pub fn f(_: Y) {}"),
                ("y", "pub struct Y;"),
            ],
            &[],
        );
        check(
            "tests of the parent",
            &[
                ("lib", "mod x; pub struct Y; #[cfg(test)] mod tests { use super::x::f; fn g() { f() } }"),
                ("x", "use crate::Y; pub fn f(_: Y) {}"),
            ],
            &[],
        );
        let siblings = [
            ("lib", "mod x; mod y;"),
            ("x", "use crate::y::Y; pub struct X;"),
            ("y", "use crate::x::X; pub struct Y;"),
        ];
        check("a circle of siblings, which is the other kind", &siblings, &[]);
    }

    #[test]
    fn crates_are_apart() {
        let entry = |path: &str, text: &str| Entry { path: path.into(), text: Some(text.into()) };
        let files = [entry("crates/a/src/x.rs", "use crate::y::Y;"), entry("crates/b/src/y.rs", "use crate::x::X;")];
        assert!(check(&files, Kind::Circles).is_empty());
    }
}
