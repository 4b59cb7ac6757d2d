//! Names of its own crate that one Rust file uses, read from its tokens; a compiler would know more, but must not be needed.

use super::lexer;

/// Imports, paths, definitions and modules of a file.
#[derive(Debug, Default)]
pub struct Imports {
    /// Every name that a `use` brings in.
    pub uses: Vec<Use>,
    /// Every path of at least two segments outside of `use`, with the module it stands in.
    pub paths: Vec<(Vec<String>, Vec<String>)>,
    /// Every identifier, for what a glob may bring in.
    pub words: Vec<String>,
    /// Items at the level of a module: the module and their name.
    pub definitions: Vec<(Vec<String>, String)>,
    /// Modules written out in the file itself.
    pub inline_modules: Vec<Vec<String>>,
    /// Modules of tests, in other files.
    pub test_modules: Vec<Vec<String>>,
}

/// One name that a `use` brings in.
#[derive(Debug, PartialEq)]
pub struct Use {
    /// The module that it is brought into, from the crate's root.
    pub module: Vec<String>,
    /// As it is written, from `crate`, `super`, `self` or the name of a module or crate on.
    pub path: Vec<String>,
    /// Name in this module; `*` for all.
    pub name: String,
    /// True for `pub use`, `pub(crate) use` and the like.
    pub is_public: bool,
    /// True at the level of the module, where others may name it, too; not in a function.
    pub is_visible: bool,
}

/// Reads the file of a module; tests are left out.
pub fn read(module: &[String], text: &str) -> Imports {
    let tokens = lexer::words_and_marks(text);
    let mut reader = Reader { tokens: &tokens, at: 0, found: Imports::default() };
    reader.module(module, 0);
    reader.found
}

/// Keywords that begin an item and are followed by its name.
const ITEMS: [&str; 8] = ["fn", "struct", "enum", "trait", "type", "const", "static", "union"];

/// As in [`Use`].
#[derive(Clone, Copy)]
struct Place {
    is_public: bool,
    is_visible: bool,
}

struct Reader<'a> {
    tokens: &'a [String],
    at: usize,
    found: Imports,
}

impl Reader<'_> {
    fn peek(&self, ahead: usize) -> &str {
        self.tokens.get(self.at + ahead).map_or("", String::as_str)
    }

    fn name(&self, ahead: usize) -> Option<&str> {
        Some(self.peek(ahead)).filter(|token| is_name(token))
    }

    /// Reads to the brace that closes the block, or to the end; `depth` counts the blocks around that are no modules.
    fn module(&mut self, module: &[String], depth: usize) {
        while self.at < self.tokens.len() {
            if self.is_for_tests() {
                self.skip_test(module);
                continue;
            }
            match self.peek(0) {
                "}" => {
                    self.at += 1;
                    return;
                }
                "{" => {
                    self.at += 1;
                    self.module(module, depth + 1);
                    continue;
                }
                "use" => {
                    let is_public = self.at > 0 && matches!(self.tokens[self.at - 1].as_str(), "pub" | ")");
                    self.at += 1;
                    self.use_tree(module, &[], Place { is_public, is_visible: depth == 0 });
                    continue;
                }
                "mod" if self.name(1).is_some() && self.peek(2) == "{" => {
                    let inner = child(module, self.peek(1));
                    self.found.inline_modules.push(inner.clone());
                    self.at += 3;
                    self.module(&inner, 0);
                    continue;
                }
                item if depth == 0 && ITEMS.contains(&item) => {
                    if let Some(name) = self.name(1) {
                        let name = name.to_owned();
                        self.found.definitions.push((module.to_vec(), name));
                    }
                }
                _ => {}
            }
            let before = if self.at == 0 { "" } else { self.tokens[self.at - 1].as_str() };
            if self.name(0).is_some() {
                self.found.words.push(self.peek(0).to_owned());
                if self.peek(1) == "::" && before != "::" {
                    let path = self.path();
                    self.found.paths.push((module.to_vec(), path));
                    continue;
                }
            }
            self.at += 1;
        }
    }

    /// `a::b::c`; ends behind it.
    fn path(&mut self) -> Vec<String> {
        let mut path = vec![self.peek(0).to_owned()];
        self.at += 1;
        while self.peek(0) == "::" && self.name(1).is_some() {
            path.push(self.peek(1).to_owned());
            self.at += 2;
        }
        path
    }

    /// One branch of what follows `use`, below `stem`.
    fn use_tree(&mut self, module: &[String], stem: &[String], place: Place) {
        let mut path = stem.to_vec();
        let is_outside = self.peek(0) == "::";
        while self.at < self.tokens.len() {
            match self.peek(0) {
                "::" => self.at += 1,
                "{" => {
                    self.at += 1;
                    while !matches!(self.peek(0), "}" | "") {
                        self.use_tree(module, &path, place);
                        if self.peek(0) == "," {
                            self.at += 1;
                        }
                    }
                    self.at += 1;
                    return;
                }
                token if is_name(token) || token == "*" => {
                    path.push(token.to_owned());
                    self.at += 1;
                    if self.peek(0) != "::" {
                        break;
                    }
                }
                _ => return,
            }
        }
        let mut name = path.last().cloned().unwrap_or_default();
        match name.as_str() {
            "*" => drop(path.pop()),
            "self" if path.len() > 1 => {
                path.pop();
                name = path.last().cloned().unwrap_or_default();
            }
            _ => {}
        }
        if self.peek(0) == "as" {
            name = self.peek(1).to_owned();
            self.at += 2;
        }
        if !is_outside {
            let Place { is_public, is_visible } = place;
            self.found.uses.push(Use { module: module.to_vec(), path, name, is_public, is_visible });
        }
    }

    /// True if an attribute like `#[cfg(test)]` begins here.
    fn is_for_tests(&self) -> bool {
        let begins = |words: &[&str]| words.iter().enumerate().all(|(ahead, word)| self.peek(ahead) == *word);
        begins(&["#", "[", "cfg", "(", "test"]) || begins(&["#", "[", "cfg", "(", "all", "(", "test"])
    }

    /// Passes over attributes and the item behind them.
    fn skip_test(&mut self, module: &[String]) {
        while self.peek(0) == "#" {
            self.skip_to(&["]"]);
        }
        while !matches!(self.peek(0), ";" | "{" | "") {
            if self.peek(0) == "mod" && self.peek(2) == ";" {
                let tests = child(module, self.peek(1));
                self.found.test_modules.push(tests);
            }
            self.at += 1;
        }
        let mut open = usize::from(self.peek(0) == "{");
        self.at += 1;
        while open > 0 && self.at < self.tokens.len() {
            match self.peek(0) {
                "{" => open += 1,
                "}" => open -= 1,
                _ => {}
            }
            self.at += 1;
        }
    }

    /// Behind the next of `ends` that no bracket encloses but those of the attribute itself.
    fn skip_to(&mut self, ends: &[&str]) {
        let mut open = 0;
        while self.at < self.tokens.len() {
            let token = self.peek(0).to_owned();
            self.at += 1;
            match token.as_str() {
                "[" => open += 1,
                "]" => open -= 1,
                _ => {}
            }
            if open == 0 && ends.contains(&token.as_str()) {
                return;
            }
        }
    }
}

fn child(module: &[String], name: &str) -> Vec<String> {
    module.iter().cloned().chain([name.to_owned()]).collect()
}

fn is_name(token: &str) -> bool {
    token.starts_with(|letter: char| letter.is_alphabetic() || letter == '_') && token != "as"
}

#[cfg(test)]
mod tests {
    use super::*;

    fn uses(text: &str) -> Vec<String> {
        let found = read(&["here".to_owned()], text);
        let show = |one: &Use| format!("{} as {} in {}", one.path.join("::"), one.name, one.module.join("::"));
        found.uses.iter().map(show).collect()
    }

    #[test]
    fn use_trees_are_taken_apart() {
        assert_eq!(
            uses("pub(crate) use crate::a::{self, b::C, d as e};"),
            ["crate::a as a in here", "crate::a::b::C as C in here", "crate::a::d as e in here",]
        );
        assert_eq!(
            uses("use super::*; mod inner { use super::X; }"),
            ["super as * in here", "super::X as X in here::inner"]
        );
        assert_eq!(uses("use ::outside::X;"), Vec::<String>::new());
    }

    #[test]
    fn tests_comments_and_texts_are_left_out() {
        let text = "#[cfg(test)] use crate::a::B;\n#[cfg(test)]\n#[path = \"x\"] mod far;\n\
                    #[cfg(test)] mod tests { use crate::c::D; fn f() { if x { y() } } }\n\
                    // use crate::e::F;\n/* use crate::g::H; /* nested */ */ const T: &str = r#\"use crate::i::J;\"#;\n\
                    const Q: char = '\"'; fn f<'a>(_: &'a str) -> &'static str { \"\\\" use crate::k::L;\" }\nuse crate::m::N;";
        assert_eq!(uses(text), ["crate::m::N as N in here"]);
        assert_eq!(read(&[], text).test_modules, [["far"]]);
    }

    #[test]
    fn paths_are_found_where_they_are_used() {
        let found = read(&[], "fn f(x: &crate::a::B) -> usize { super::c::d::<u8>(x) + inner::e() }");
        let paths: Vec<String> = found.paths.iter().map(|(_, path)| path.join("::")).collect();
        assert_eq!(paths, ["crate::a::B", "super::c::d", "inner::e"]);
        assert_eq!(found.definitions, [(vec![], "f".to_owned())]);
    }
}
