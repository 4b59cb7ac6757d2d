//! XML descriptions as trees of elements that know where they stand, with their numbers.

use std::collections::BTreeMap;

use genmanip_core::limits::IMPORTED_DESCRIPTION;
use roxmltree::{Document, Node, ParsingOptions};

use crate::ImportError;
use crate::files::{Files, shortened};

/// Most elements and attributes of a description, and how deep they nest.
const MOST_NODES: u32 = 400_000;
const MOST_DEPTH: usize = 128;

/// An element.
#[derive(Clone, Debug, Default)]
pub struct Element {
    /// Its name.
    pub tag: String,
    /// Its attributes.
    pub attributes: BTreeMap<String, String>,
    /// The elements in it.
    pub children: Vec<Element>,
    /// The file and line where it stands.
    pub place: (String, u32),
}

/// The root element of a file. Entities are not followed.
///
/// # Errors
/// With line and column of what is no XML.
pub fn parse(path: &str, files: &mut Files<'_>) -> Result<Element, ImportError> {
    let text = files.text(path, IMPORTED_DESCRIPTION)?;
    let options = ParsingOptions { allow_dtd: false, nodes_limit: MOST_NODES, ..ParsingOptions::default() };
    let document = Document::parse_with_options(&text, options);
    let document = document.map_err(|error| ImportError::new(path, format!("no XML: {error}")))?;
    element(path, document.root_element(), 0)
}

fn element(path: &str, node: Node<'_, '_>, depth: usize) -> Result<Element, ImportError> {
    if depth > MOST_DEPTH {
        return Err(ImportError::new(path, format!("elements nest deeper than {MOST_DEPTH}")));
    }
    let children = node.children().filter(Node::is_element).map(|child| element(path, child, depth + 1));
    Ok(Element {
        tag: node.tag_name().name().to_owned(),
        attributes: node
            .attributes()
            .map(|attribute| (attribute.name().to_owned(), attribute.value().to_owned()))
            .collect(),
        children: children.collect::<Result<_, _>>()?,
        place: (path.to_owned(), node.document().text_pos_at(node.range().start).row),
    })
}

impl Element {
    /// The text of an attribute.
    pub fn attribute(&self, name: &str) -> Option<&str> {
        self.attributes.get(name).map(String::as_str)
    }

    /// The elements of a name in it.
    pub fn all<'a>(&'a self, tag: &'a str) -> impl Iterator<Item = &'a Element> {
        self.children.iter().filter(move |child| child.tag == tag)
    }

    /// The first element of a name in it.
    pub fn first(&self, tag: &str) -> Option<&Element> {
        self.children.iter().find(|child| child.tag == tag)
    }

    /// An error at this element.
    pub fn wrong(&self, message: impl std::fmt::Display) -> ImportError {
        let (file, line) = &self.place;
        let name = self.attribute("name").map_or_else(String::new, |name| format!(" \"{}\"", shortened(name)));
        ImportError::new(file.as_str(), format!("line {line}: <{}{name}>: {message}", shortened(&self.tag)))
    }

    /// All numbers of an attribute; `None` without it.
    ///
    /// # Errors
    /// When one is no finite number.
    pub fn numbers(&self, name: &str) -> Result<Option<Vec<f64>>, ImportError> {
        let Some(text) = self.attribute(name) else { return Ok(None) };
        let number = |word: &str| word.parse().ok().filter(|value: &f64| value.is_finite() && value.abs() < 1e9);
        match text.split_whitespace().map(number).collect() {
            Some(values) => Ok(Some(values)),
            None => Err(self.wrong(format!("{name}=\"{}\": expected numbers", shortened(text)))),
        }
    }

    /// So many numbers of an attribute; `None` without it.
    ///
    /// # Errors
    /// When there are more or fewer, or one is no finite number.
    pub fn exactly<const N: usize>(&self, name: &str) -> Result<Option<[f64; N]>, ImportError> {
        let Some(values) = self.numbers(name)? else { return Ok(None) };
        let count = values.len();
        let values: Result<[f64; N], _> = values.try_into();
        values.map(Some).map_err(|_| self.wrong(format!("{name}: expected {N} numbers, got {count}")))
    }

    /// One number of an attribute, or what stands for it.
    ///
    /// # Errors
    /// As [`Element::exactly`].
    pub fn number(&self, name: &str, otherwise: f64) -> Result<f64, ImportError> {
        Ok(self.exactly::<1>(name)?.map_or(otherwise, |[value]| value))
    }
}
