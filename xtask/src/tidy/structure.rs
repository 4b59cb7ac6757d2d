//! Rules about files: their length, their names, what each crate must have and what is never committed.

use super::exceptions::{self, Exceptions};
use super::repository::Entry;
use super::violation::Violation;
use std::collections::BTreeMap;

const LONGEST: usize = 600;
const VAGUE: [&str; 6] = ["util", "utils", "helper", "helpers", "common", "misc"];
const MESHES: [&str; 14] =
    ["obj", "mtl", "stl", "dae", "ply", "glb", "gltf", "fbx", "off", "3mf", "usd", "usda", "usdc", "usdz"];

pub fn check(files: &[Entry], exceptions: &Exceptions) -> Vec<Violation> {
    let mut found = Vec::new();
    let mut test_programs: BTreeMap<&str, Vec<&str>> = BTreeMap::new();
    for file in files {
        let parts: Vec<&str> = file.path.split('/').collect();
        let text = file.text.as_deref().unwrap_or_default();
        if let ["crates", _, "src", ..] = parts[..] {
            found.extend(length(file, text, exceptions));
        }
        if let ["crates", name, "tests", rest @ ..] = &parts[..]
            && (matches!(rest, [one] if one.ends_with(".rs")) || matches!(rest, [_, "main.rs"]))
        {
            test_programs.entry(*name).or_default().push(&file.path);
        }
        if let ["crates", _, "src", "lib.rs" | "main.rs"] = parts[..] {
            found.extend(introduction(file, text));
        }
        if file.path.ends_with(".rs") {
            found.extend(vague_names(file, &parts, text));
        }
        found.extend(mesh(file, exceptions));
    }
    for (name, programs) in test_programs.into_iter().filter(|(_, programs)| programs.len() > 1) {
        found.push(Violation {
            place: format!("crates/{name}/tests"),
            what: format!("{} test programs: {}", programs.len(), programs.join(", ")),
            hint: "make them modules of one program: each costs its own linking".into(),
        });
    }
    for kind in ["long", "mesh"] {
        for (path, line) in exceptions.of_kind(kind) {
            let is_long = |file: &Entry| file.text.as_deref().unwrap_or_default().lines().count() > LONGEST;
            let is_needed = |file: &Entry| file.path == path && (kind == "mesh" || is_long(file));
            if !files.iter().any(is_needed) {
                found.push(exceptions::unneeded(format!("{}:{line}", exceptions::PATH), &format!("{kind} {path}")));
            }
        }
    }
    found
}

fn length(file: &Entry, text: &str, exceptions: &Exceptions) -> Option<Violation> {
    let lines = text.lines().count();
    let fine = !file.path.ends_with(".rs") || lines <= LONGEST || exceptions.has("long", &file.path);
    (!fine).then(|| Violation {
        place: file.path.clone(),
        what: format!("{lines} lines, at most {LONGEST}"),
        hint: format!("split it by topic, or list it with a reason in {}", exceptions::PATH),
    })
}

fn introduction(file: &Entry, text: &str) -> Option<Violation> {
    let first = text.lines().find(|line| !line.trim().is_empty()).unwrap_or_default();
    let said = first.strip_prefix("//!").unwrap_or_default().trim();
    said.is_empty().then(|| Violation {
        place: file.path.clone(),
        what: "the crate does not say what it is for".into(),
        hint: "begin the file with `//! ` and one sentence on its subject".into(),
    })
}

fn vague_names(file: &Entry, parts: &[&str], text: &str) -> Vec<Violation> {
    let in_path = parts.iter().map(|part| part.strip_suffix(".rs").unwrap_or(part)).find(|part| VAGUE.contains(part));
    let mut found = Vec::new();
    let mut report = |place: String, name: &str| {
        found.push(Violation {
            place,
            what: format!("a module called `{name}` says nothing about what is in it"),
            hint: "name it after what it does, or move each part to where it is used".into(),
        });
    };
    if let Some(name) = in_path {
        report(file.path.clone(), name);
    }
    for (number, line) in text.lines().enumerate() {
        let words: Vec<&str> =
            line.split(|c: char| !c.is_alphanumeric() && c != '_').filter(|w| !w.is_empty()).collect();
        if let Some(at) = words.iter().position(|word| *word == "mod")
            && at <= 2
            && line.trim_end().ends_with('{')
            && let Some(name) = words.get(at + 1).filter(|name| VAGUE.contains(name))
        {
            report(format!("{}:{}", file.path, number + 1), name);
        }
    }
    found
}

fn mesh(file: &Entry, exceptions: &Exceptions) -> Option<Violation> {
    let ending = file.path.rsplit_once('.').map(|(_, ending)| ending.to_ascii_lowercase())?;
    (MESHES.contains(&ending.as_str()) && !exceptions.has("mesh", &file.path)).then(|| Violation {
        place: file.path.clone(),
        what: "a mesh file: third-party geometry is never committed".into(),
        hint: format!("make it an optional pack; list your own with a reason in {}", exceptions::PATH),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn places(files: &[(&str, &str)], exceptions: &str) -> Vec<String> {
        let files: Vec<Entry> =
            files.iter().map(|(path, text)| Entry { path: (*path).into(), text: Some((*text).into()) }).collect();
        let exceptions = Exceptions::parse(exceptions).unwrap();
        check(&files, &exceptions).into_iter().map(|violation| violation.place).collect()
    }

    #[test]
    fn long_files_need_a_reason() {
        let long = "x\n".repeat(601);
        let path = "crates/a/src/b.rs";
        assert_eq!(places(&[(path, &long)], ""), [path]);
        assert!(places(&[(path, &long)], "long crates/a/src/b.rs: a table of the standard").is_empty());
        assert_eq!(places(&[(path, "x")], "long crates/a/src/b.rs: outdated"), ["xtask/tidy-exceptions.txt:1"]);
    }

    #[test]
    fn vague_module_names() {
        assert_eq!(places(&[("crates/a/src/utils.rs", "")], ""), ["crates/a/src/utils.rs"]);
        assert_eq!(places(&[("crates/a/tests/common/mod.rs", "")], ""), ["crates/a/tests/common/mod.rs"]);
        assert_eq!(places(&[("xtask/src/x.rs", "fn f() {}\npub mod helpers {")], ""), ["xtask/src/x.rs:2"]);
        assert!(places(&[("xtask/src/x.rs", "// the mod utils { is banned\nmod utility_network {")], "").is_empty());
    }

    #[test]
    fn each_crate_introduces_itself() {
        assert_eq!(places(&[("crates/a/src/lib.rs", "use std;\n//! Late.")], ""), ["crates/a/src/lib.rs"]);
        assert!(places(&[("crates/a/src/lib.rs", "\n//! Words.\nuse std;")], "").is_empty());
    }

    #[test]
    fn one_test_program_per_crate() {
        assert!(places(&[("crates/a/tests/it.rs", ""), ("crates/a/tests/it/x.rs", "")], "").is_empty());
        assert_eq!(places(&[("crates/a/tests/x.rs", ""), ("crates/a/tests/y/main.rs", "")], ""), ["crates/a/tests"]);
    }

    #[test]
    fn meshes() {
        assert_eq!(places(&[("crates/a/tests/hand.STL", "")], ""), ["crates/a/tests/hand.STL"]);
        assert!(
            places(&[("crates/a/cube.obj", "")], "mesh crates/a/cube.obj: written by hand for the test").is_empty()
        );
    }
}
