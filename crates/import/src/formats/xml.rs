//! XML elements that remember their file and line, with typed attribute access.

use std::collections::BTreeMap;

use genmanip_core::limits::IMPORTED_DESCRIPTION;
use roxmltree::{Document, Node, ParsingOptions};

use crate::ImportError;
use crate::files::{Files, XACRO, shortened};

/// Maximum number of elements and attributes, and (`MAX_DEPTH`) maximum nesting depth. Bounds time and memory for
/// hostile files.
const MAX_NODES: u32 = 400_000;
const MAX_DEPTH: usize = 128;
/// Maximum number of undeclared namespace prefixes. Bounds time for hostile files.
const MAX_PREFIXES: usize = 16;
/// Size that numbers stay below; none that is meant is larger.
const MAX_NUMBER: f64 = 1e9;

/// An XML element with its place in the file.
#[derive(Clone, Debug, Default)]
pub struct Element {
    /// Tag name without namespace prefix, except that of xacro.
    pub tag: String,
    /// Attributes by name.
    pub attributes: BTreeMap<String, String>,
    /// Child elements, in the order of the file.
    pub children: Vec<Element>,
    /// File and line of the element.
    pub place: (String, u32),
}

/// Parses a file and returns its root element. Entities are not expanded, and prefixes need not be declared. Tags of
/// xacro, the macro language of ROS, keep their prefix.
///
/// # Errors
/// With line and column of a syntax error.
pub fn parse(path: &str, files: &mut Files<'_>) -> Result<Element, ImportError> {
    let mut text = without_doctype(without_declaration(files.text(path, IMPORTED_DESCRIPTION)?));
    for _ in 0..MAX_PREFIXES {
        let options = ParsingOptions { allow_dtd: false, nodes_limit: MAX_NODES, ..ParsingOptions::default() };
        match Document::parse_with_options(&text, options) {
            Ok(document) => return element(path, document.root_element(), 0),
            Err(roxmltree::Error::UnknownNamespace(prefix, position)) => {
                let Some(declared) = with_prefix(&text, &prefix) else {
                    return Err(ImportError::new(path, format!("not XML: unknown prefix `{prefix}` at {position}")));
                };
                text = declared;
            }
            Err(error) => return Err(ImportError::new(path, format!("not XML: {error}"))),
        }
    }
    Err(ImportError::new(path, format!("more than {MAX_PREFIXES} undeclared prefixes")))
}

/// Text with its XML declaration blanked: XML wants it at the very beginning, but files often start with blank lines or
/// a comment.
fn without_declaration(text: String) -> String {
    let Some(start) = text.find("<?xml ") else { return text };
    let mut before = text[..start].trim_start();
    while let Some(comment) = before.strip_prefix("<!--") {
        before = comment.split_once("-->").map_or(comment, |(_, after)| after.trim_start());
    }
    match text[start..].find("?>") {
        Some(end) if before.is_empty() => blanked(&text, start..start + end + 2),
        _ => text,
    }
}

/// Text with a part replaced by blanks; lines keep their numbers.
fn blanked(text: &str, part: std::ops::Range<usize>) -> String {
    let blank: String = text[part.clone()].chars().map(|c| if c == '\n' { '\n' } else { ' ' }).collect();
    format!("{}{blank}{}", &text[..part.start], &text[part.end..])
}

/// Text with its document type declaration blanked; a declaration that defines entities is kept, and then rejected by
/// the parser.
fn without_doctype(text: String) -> String {
    let Some(start) = text.find("<!DOCTYPE") else { return text };
    let Some(end) = text[start..].find('>').map(|end| start + end + 1) else { return text };
    let declared = &text[start..end];
    if declared.contains('[') || text[..start].contains("<!--") {
        return text;
    }
    blanked(&text, start..end)
}

/// Text with a namespace prefix declared at the first element that uses it; `None` if none does.
fn with_prefix(text: &str, prefix: &str) -> Option<String> {
    let is_start = |(at, _): &(usize, &str)| text[at + 1..].starts_with(|c: char| c.is_alphabetic() || c == '_');
    let mut outside = 0;
    let (at, _) = text.match_indices('<').find(|found| {
        let is_inside = found.0 < outside;
        if let (false, Some(comment)) = (is_inside, text[found.0..].strip_prefix("<!--")) {
            outside = found.0 + comment.find("-->").map_or(text.len(), |end| end + 7);
        }
        !is_inside && is_start(found)
    })?;
    let end = at + text[at..].find(|c: char| c.is_whitespace() || c == '>' || c == '/')?;
    Some(format!("{} xmlns:{prefix}=\"{prefix}\"{}", &text[..end], &text[end..]))
}

fn element(path: &str, node: Node<'_, '_>, depth: usize) -> Result<Element, ImportError> {
    if depth > MAX_DEPTH {
        return Err(ImportError::new(path, format!("elements are nested deeper than {MAX_DEPTH}")));
    }
    let children = node.children().filter(Node::is_element).map(|child| element(path, child, depth + 1));
    Ok(Element {
        tag: match node.tag_name().namespace() {
            Some(namespace) if namespace.contains("xacro") => format!("xacro:{}", node.tag_name().name()),
            Some(_) | None => node.tag_name().name().to_owned(),
        },
        attributes: node
            .attributes()
            .map(|attribute| (attribute.name().to_owned(), attribute.value().to_owned()))
            .collect(),
        children: children.collect::<Result<_, _>>()?,
        place: (path.to_owned(), node.document().text_pos_at(node.range().start).row),
    })
}

impl Element {
    /// The value of an attribute. `None` if it is absent.
    pub fn attribute(&self, name: &str) -> Option<&str> {
        self.attributes.get(name).map(String::as_str)
    }

    /// The children with a tag.
    pub fn all<'a>(&'a self, tag: &'a str) -> impl Iterator<Item = &'a Element> {
        self.children.iter().filter(move |child| child.tag == tag)
    }

    /// The first child with a tag. `None` if there is none.
    pub fn first(&self, tag: &str) -> Option<&Element> {
        self.children.iter().find(|child| child.tag == tag)
    }

    /// An error at this element.
    pub fn wrong(&self, message: impl std::fmt::Display) -> ImportError {
        let (file, line) = &self.place;
        let name = self.attribute("name").map_or_else(String::new, |name| format!(" \"{}\"", shortened(name)));
        ImportError::new(file.as_str(), format!("line {line}: <{}{name}>: {message}", shortened(&self.tag)))
    }

    /// All numbers of an attribute; `None` if it is absent.
    ///
    /// # Errors
    /// If one is not a finite number.
    pub fn numbers(&self, name: &str) -> Result<Option<Vec<f64>>, ImportError> {
        self.numbers_where(name, |value| value.abs() < MAX_NUMBER)
    }

    /// One number of an attribute; an infinite or enormous one, as files write for "unlimited", becomes the largest that
    /// other attributes may have. `None` if it is absent.
    ///
    /// # Errors
    /// If there are several, or it is not a number.
    pub fn bounded(&self, name: &str) -> Result<Option<f64>, ImportError> {
        match self.numbers_where(name, |value| !value.is_nan())?.as_deref() {
            None => Ok(None),
            Some([value]) => Ok(Some(value.clamp(-MAX_NUMBER, MAX_NUMBER))),
            Some(several) => Err(self.wrong(format!("{name}: expected 1 number, got {}", several.len()))),
        }
    }

    fn numbers_where(&self, name: &str, accepted: impl Fn(f64) -> bool) -> Result<Option<Vec<f64>>, ImportError> {
        let Some(text) = self.attribute(name) else { return Ok(None) };
        let number = |word: &str| word.parse().ok().filter(|value: &f64| accepted(*value));
        match text.split_whitespace().map(number).collect() {
            Some(values) => Ok(Some(values)),
            None => {
                let error = self.wrong(format!("{name}=\"{}\": expected numbers", shortened(text)));
                Err(match text {
                    text if text.contains("${") || text.contains("$(") => error.hint(XACRO),
                    text if text.contains(',') => {
                        error.hint("numbers are separated by blanks; decimals follow a point")
                    }
                    _ => error,
                })
            }
        }
    }

    /// Exactly `N` numbers of an attribute; `None` if it is absent.
    ///
    /// # Errors
    /// If there are more or fewer, or one is not a finite number.
    pub fn exactly<const N: usize>(&self, name: &str) -> Result<Option<[f64; N]>, ImportError> {
        let Some(values) = self.numbers(name)? else { return Ok(None) };
        let count = values.len();
        let values: Result<[f64; N], _> = values.try_into();
        values.map(Some).map_err(|_| self.wrong(format!("{name}: expected {N} numbers, got {count}")))
    }

    /// One number of an attribute, or the default.
    ///
    /// # Errors
    /// As [`Element::exactly`].
    pub fn number(&self, name: &str, otherwise: f64) -> Result<f64, ImportError> {
        Ok(self.exactly::<1>(name)?.map_or(otherwise, |[value]| value))
    }
}
