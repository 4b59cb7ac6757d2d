//! Templates: JSON with expressions, conditionals and loops, expanded to plain JSON.
//!
//! - a string that starts with `=` is an expression; `{…}` in any other string is interpolated;
//! - `{"if": …, "then": …, "else": …}` is one of two values, or no list item if the chosen branch is missing;
//! - `{"for": "i", "count": …, "do": …}` in a list repeats `do` with `i` = 0, 1, …;
//! - `{"use": "name", …}` instantiates a shape or finish of the shared library with arguments.
//!
//! In a list, lists returned by `then`, `else`, `do` and shapes are spliced in.

use std::collections::BTreeMap;

use genmanip_core::Seed;
use serde_json::{Map, Value};

use super::expression::{Scope, evaluate, is_true, number, text_of};

/// Maximum nesting depth of shapes.
const MAX_DEPTH: usize = 24;
/// Maximum number of repetitions of a loop.
const MAX_REPEATS: f64 = 200.0;

/// Shape or finish that templates can use by its name.
#[derive(Clone, Debug, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Shape {
    /// Arguments with their defaults; `null` for a required argument.
    #[serde(default)]
    pub with: BTreeMap<String, Value>,
    /// Values derived from the arguments.
    #[serde(default)]
    pub vars: BTreeMap<String, Value>,
    /// Template that the arguments are inserted into.
    #[serde(rename = "do")]
    pub body: Value,
}

/// Shared shapes and finishes by name.
pub type Library = BTreeMap<String, Shape>;

/// Expands a template.
///
/// # Errors
/// A message with the failing expression and its error.
pub fn expand(template: &Value, scope: &dyn Scope, library: &Library) -> Result<Value, String> {
    Expander { library, depth: 0 }.value(template, scope)
}

#[derive(Clone, Copy)]
struct Expander<'a> {
    library: &'a Library,
    depth: usize,
}

impl Expander<'_> {
    fn value(self, template: &Value, scope: &dyn Scope) -> Result<Value, String> {
        match template {
            Value::String(text) => match text.strip_prefix('=') {
                Some(expression) => evaluate(expression, scope),
                None => sentence(text, scope).map(Value::String),
            },
            Value::Array(items) => self.list(items, scope).map(Value::Array),
            Value::Object(fields) if fields.contains_key("if") => {
                Ok(self.choice(fields, scope)?.unwrap_or(Value::Null))
            }
            Value::Object(fields) if fields.contains_key("use") => self.shape(fields, scope),
            Value::Object(fields) => {
                let mut expanded = Map::new();
                for (name, value) in fields {
                    let value = self.value(value, scope)?;
                    if !value.is_null() {
                        expanded.insert(name.clone(), value);
                    }
                }
                Ok(Value::Object(expanded))
            }
            plain => Ok(plain.clone()),
        }
    }

    fn list(self, items: &[Value], scope: &dyn Scope) -> Result<Vec<Value>, String> {
        let mut list = Vec::with_capacity(items.len());
        for item in items {
            let Some(fields) = item.as_object() else {
                list.push(self.value(item, scope)?);
                continue;
            };
            let mut splice = |value| match value {
                Value::Array(items) => list.extend(items),
                value => list.push(value),
            };
            if fields.contains_key("if") {
                if let Some(value) = self.choice(fields, scope)? {
                    splice(value);
                }
            } else if let Some(name) = fields.get("for") {
                let name = name.as_str().ok_or("`for` needs a name")?;
                let body = fields.get("do").ok_or("`for` needs `do`")?;
                let count = self.value(fields.get("count").ok_or("`for` needs `count`")?, scope)?;
                let count = count.as_f64().filter(|count| *count <= MAX_REPEATS);
                let count = count.ok_or("`count` needs a number up to 200")?;
                for index in 0..count.max(0.0).round() as usize {
                    let inner = NestedScope { own: [(name.to_owned(), number(index as f64))].into(), outer: scope };
                    splice(self.value(body, &inner)?);
                }
            } else if fields.contains_key("use") {
                splice(self.shape(fields, scope)?);
            } else {
                splice(self.value(item, scope)?);
            }
        }
        Ok(list)
    }

    fn choice(self, fields: &Map<String, Value>, scope: &dyn Scope) -> Result<Option<Value>, String> {
        let condition = fields.get("if").and_then(Value::as_str).ok_or("`if` needs an expression")?;
        let holds = is_true(&evaluate(condition.trim_start_matches('='), scope)?);
        fields.get(if holds { "then" } else { "else" }).map(|value| self.value(value, scope)).transpose()
    }

    fn shape(self, fields: &Map<String, Value>, scope: &dyn Scope) -> Result<Value, String> {
        let name = fields.get("use").and_then(Value::as_str).ok_or("`use` needs the name of a shape")?;
        let shape = self.library.get(name).ok_or_else(|| format!("unknown shape `{name}`"))?;
        if self.depth >= MAX_DEPTH {
            return Err(format!("shape `{name}` uses itself"));
        }
        let mut own = BTreeMap::new();
        for (argument, value) in fields.iter().filter(|(argument, _)| *argument != "use") {
            if !shape.with.contains_key(argument) {
                return Err(format!("shape `{name}` has no argument `{argument}`"));
            }
            own.insert(argument.clone(), self.value(value, scope)?);
        }
        let inner = ShapeScope { name, shape, own, stream: scope.stream(name) };
        Self { depth: self.depth + 1, ..self }.value(&shape.body, &inner)
    }
}

/// Interpolates the `{expressions}` of a string.
fn sentence(text: &str, scope: &dyn Scope) -> Result<String, String> {
    let mut words = String::new();
    let mut rest = text;
    while let Some((before, after)) = rest.split_once('{') {
        let (expression, after) = after.split_once('}').ok_or_else(|| format!("`{text}`: `{{` without `}}`"))?;
        words += before;
        words += &text_of(&evaluate(expression, scope)?);
        rest = after;
    }
    Ok(words + rest)
}

/// Scope that adds variables to another scope.
struct NestedScope<'a> {
    own: BTreeMap<String, Value>,
    outer: &'a dyn Scope,
}

impl Scope for NestedScope<'_> {
    fn value(&self, name: &str) -> Result<Value, String> {
        self.own.get(name).map_or_else(|| self.outer.value(name), |value| Ok(value.clone()))
    }

    fn stream(&self, label: &str) -> Seed {
        self.outer.stream(label)
    }
}

/// Scope inside a shape: only its arguments and derived values.
struct ShapeScope<'a> {
    name: &'a str,
    shape: &'a Shape,
    own: BTreeMap<String, Value>,
    stream: Seed,
}

impl Scope for ShapeScope<'_> {
    fn value(&self, name: &str) -> Result<Value, String> {
        if let Some(value) = self.own.get(name) {
            return Ok(value.clone());
        }
        if let Some(value) = self.shape.vars.get(name) {
            return expand(value, self, &Library::new());
        }
        match self.shape.with.get(name) {
            Some(Value::Null) => Err(format!("shape `{}` needs `{name}`", self.name)),
            Some(default) => expand(default, self, &Library::new()),
            None => Err(format!("unknown variable `{name}` in shape `{}`", self.name)),
        }
    }

    fn stream(&self, label: &str) -> Seed {
        self.stream.fork(label)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    struct Size;

    impl Scope for Size {
        fn value(&self, name: &str) -> Result<Value, String> {
            if name == "h" { Ok(number(2.0)) } else { Err(format!("there is no `{name}`")) }
        }

        fn stream(&self, label: &str) -> Seed {
            Seed::new(0).fork(label)
        }
    }

    #[test]
    fn templates_expand() {
        let library: Library =
            serde_json::from_value(json!({"two": {"with": {"a": null, "b": "=a * 10"}, "do": ["=a", "=b"]}})).unwrap();
        let check = |template: Value, expected: Value| {
            assert_eq!(expand(&template, &Size, &library), Ok(expected), "{template}");
        };
        check(json!({"x": "=h + 1", "y": "h is {h}"}), json!({"x": 3, "y": "h is 2"}));
        check(json!([{"if": "h > 1", "then": [1, 2]}, {"if": "h > 2", "then": 3}]), json!([1, 2]));
        check(json!([{"for": "i", "count": "=h", "do": {"at": ["=i", 0]}}]), json!([{"at": [0, 0]}, {"at": [1, 0]}]));
        check(json!([{"use": "two", "a": "=h"}, 5]), json!([2, 20, 5]));
        check(json!([[1, 2], ["=h"]]), json!([[1, 2], [2]]));
        for wrong in [json!({"use": "two"}), json!({"use": "none"}), json!({"use": "two", "c": 1}), json!("{h")] {
            assert!(expand(&wrong, &Size, &library).is_err(), "{wrong}");
        }
    }
}
