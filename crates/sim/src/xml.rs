//! Minimal XML writer for readable MJCF.

use std::fmt::Write;

/// An element with attributes and children, written in insertion order.
#[derive(Clone, Debug, Default)]
pub struct Element {
    tag: &'static str,
    attributes: Vec<(&'static str, String)>,
    children: Vec<Element>,
}

impl Element {
    pub fn new(tag: &'static str) -> Self {
        Self { tag, ..Self::default() }
    }

    /// An element with a `name` attribute.
    pub fn named(tag: &'static str, name: &str) -> Self {
        Self::new(tag).text("name", name)
    }

    /// Adds an attribute; the value is escaped.
    pub fn text(mut self, key: &'static str, value: &str) -> Self {
        self.attributes.push((key, escaped(value)));
        self
    }

    /// Adds a list of numbers, each in its shortest round-trip form.
    pub fn numbers(mut self, key: &'static str, values: &[f64]) -> Self {
        self.attributes.push((key, join(values)));
        self
    }

    pub fn number(self, key: &'static str, value: f64) -> Self {
        self.numbers(key, &[value])
    }

    pub fn child(mut self, child: Self) -> Self {
        self.push(child);
        self
    }

    pub fn push(&mut self, child: Self) {
        self.children.push(child);
    }

    pub fn extend(&mut self, children: impl IntoIterator<Item = Self>) {
        self.children.extend(children);
    }

    pub fn render(&self) -> String {
        let mut out = String::new();
        self.write(&mut out, 0);
        out
    }

    fn write(&self, out: &mut String, depth: usize) {
        let indent = "  ".repeat(depth);
        out.push_str(&indent);
        out.push('<');
        out.push_str(self.tag);
        for (key, value) in &self.attributes {
            out.extend([" ", key, "=\"", value, "\""]);
        }
        if self.children.is_empty() {
            out.push_str("/>\n");
            return;
        }
        out.push_str(">\n");
        for child in &self.children {
            child.write(out, depth + 1);
        }
        out.extend([indent.as_str(), "</", self.tag, ">\n"]);
    }
}

fn join(values: &[f64]) -> String {
    let mut text = String::with_capacity(values.len() * 12);
    for (index, value) in values.iter().enumerate() {
        if index > 0 {
            text.push(' ');
        }
        // Writing to a string cannot fail.
        let _ = write!(text, "{value}");
    }
    text
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}
