//! Expressions in family data, whose values are numbers, strings, colours, lists and records.
//!
//! ```text
//! h * 0.9    wide ? 0.08 : 0.06    color.hex    mix(a, '#ffffff', 0.3)    cm(h)
//! ```

use std::f64::consts::PI;

use genmanip_core::Seed;
use rand::RngExt;
use serde_json::Value;

use crate::color::Color;

/// Variable lookup and random streams for expressions.
pub trait Scope {
    /// Value of a variable.
    ///
    /// # Errors
    /// If the variable is unknown, or its own expression fails.
    fn value(&self, name: &str) -> Result<Value, String>;

    /// Seed of the random stream with this label.
    fn stream(&self, label: &str) -> Seed;
}

/// Evaluates an expression.
///
/// # Errors
/// A message with what was expected and the remaining text.
pub fn evaluate(text: &str, scope: &dyn Scope) -> Result<Value, String> {
    let mut parser = Parser { text, rest: text, scope };
    let value = parser.ternary().and_then(|value| match parser.peek() {
        None => Ok(value),
        Some(_) => Err(format!("expected the end, got `{}`", parser.rest)),
    });
    value.map_err(|error| format!("`{text}`: {error}"))
}

/// JSON number, stored as an integer if it is whole, so that it can be used as a count.
pub fn number(value: f64) -> Value {
    if value.fract() == 0.0 && value.abs() < 1e15 {
        return Value::from(value as i64);
    }
    serde_json::Number::from_f64(value).map_or(Value::Null, Value::Number)
}

/// Truthiness: everything except `false`, 0, null and the empty string is true.
pub fn is_true(value: &Value) -> bool {
    match value {
        Value::Null => false,
        Value::Bool(value) => *value,
        Value::Number(value) => value.as_f64() != Some(0.0),
        Value::String(text) => !text.is_empty(),
        Value::Array(_) | Value::Object(_) => true,
    }
}

struct Parser<'a> {
    text: &'a str,
    rest: &'a str,
    scope: &'a dyn Scope,
}

impl<'a> Parser<'a> {
    fn peek(&mut self) -> Option<char> {
        self.rest = self.rest.trim_start();
        self.rest.chars().next()
    }

    fn take(&mut self, token: &str) -> bool {
        self.rest = self.rest.trim_start();
        let taken = self.rest.strip_prefix(token);
        self.rest = taken.unwrap_or(self.rest);
        taken.is_some()
    }

    fn expect(&mut self, token: &str) -> Result<(), String> {
        if self.take(token) { Ok(()) } else { Err(format!("expected `{token}` before `{}`", self.rest)) }
    }

    fn ternary(&mut self) -> Result<Value, String> {
        let condition = self.any()?;
        if !self.take("?") {
            return Ok(condition);
        }
        let then = self.ternary()?;
        self.expect(":")?;
        let other = self.ternary()?;
        Ok(if is_true(&condition) { then } else { other })
    }

    fn any(&mut self) -> Result<Value, String> {
        let mut value = self.all()?;
        while self.take("||") {
            let other = self.all()?;
            value = Value::Bool(is_true(&value) || is_true(&other));
        }
        Ok(value)
    }

    fn all(&mut self) -> Result<Value, String> {
        let mut value = self.comparison()?;
        while self.take("&&") {
            let other = self.comparison()?;
            value = Value::Bool(is_true(&value) && is_true(&other));
        }
        Ok(value)
    }

    fn comparison(&mut self) -> Result<Value, String> {
        let value = self.sum()?;
        for (token, check) in [
            ("==", None),
            ("!=", None),
            ("<=", Some((|a, b| a <= b) as fn(f64, f64) -> bool)),
            (">=", Some(|a, b| a >= b)),
            ("<", Some(|a, b| a < b)),
            (">", Some(|a, b| a > b)),
        ] {
            if self.take(token) {
                let other = self.sum()?;
                let holds = match check {
                    Some(check) => check(as_number(&value)?, as_number(&other)?),
                    None => same(&value, &other) == (token == "=="),
                };
                return Ok(Value::Bool(holds));
            }
        }
        Ok(value)
    }

    fn sum(&mut self) -> Result<Value, String> {
        let mut value = self.product()?;
        loop {
            if self.take("+") {
                let other = self.product()?;
                value = match (&value, &other) {
                    (Value::String(a), b) => Value::String(format!("{a}{}", text_of(b))),
                    (a, b) => number(as_number(a)? + as_number(b)?),
                };
            } else if self.take("-") {
                value = number(as_number(&value)? - as_number(&self.product()?)?);
            } else {
                return Ok(value);
            }
        }
    }

    fn product(&mut self) -> Result<Value, String> {
        let mut value = self.unary()?;
        loop {
            if self.take("*") {
                value = number(as_number(&value)? * as_number(&self.unary()?)?);
            } else if self.take("/") {
                value = number(as_number(&value)? / as_number(&self.unary()?)?);
            } else if self.take("%") {
                value = number(as_number(&value)?.rem_euclid(as_number(&self.unary()?)?));
            } else {
                return Ok(value);
            }
        }
    }

    fn unary(&mut self) -> Result<Value, String> {
        if self.take("-") {
            return Ok(number(-as_number(&self.unary()?)?));
        }
        if self.peek() == Some('!') && !self.rest.starts_with("!=") {
            self.expect("!")?;
            return Ok(Value::Bool(!is_true(&self.unary()?)));
        }
        let mut value = self.primary()?;
        loop {
            if self.rest.starts_with('.') {
                self.expect(".")?;
                let name = self.name();
                let member = value.get(name).cloned();
                value = member.ok_or_else(|| format!("there is no `.{name}` before `{}`", self.rest))?;
            } else if self.take("[") {
                let index = as_number(&self.ternary()?)?;
                self.expect("]")?;
                let item = value.get(index.max(0.0) as usize).cloned();
                value = item.ok_or_else(|| format!("there is no item {index}"))?;
            } else {
                return Ok(value);
            }
        }
    }

    fn primary(&mut self) -> Result<Value, String> {
        match self.peek() {
            Some('(') => {
                self.expect("(")?;
                let value = self.ternary()?;
                self.expect(")")?;
                Ok(value)
            }
            Some('\'') => {
                self.expect("'")?;
                let (text, rest) = self.rest.split_once('\'').ok_or("a text has no end")?;
                self.rest = rest;
                Ok(Value::String(text.to_owned()))
            }
            Some(c) if c.is_ascii_digit() || c == '.' => {
                let end = self.rest.find(|c: char| !(c.is_ascii_digit() || c == '.')).unwrap_or(self.rest.len());
                let (digits, rest) = self.rest.split_at(end);
                self.rest = rest;
                digits.parse().map(number).map_err(|_| format!("`{digits}` is no number"))
            }
            Some(c) if c.is_ascii_alphabetic() => {
                let name = self.name();
                if !self.take("(") {
                    return if name == "pi" { Ok(number(PI)) } else { self.scope.value(name) };
                }
                let mut arguments = Vec::new();
                while !self.take(")") {
                    if !arguments.is_empty() {
                        self.expect(",")?;
                    }
                    arguments.push(self.ternary()?);
                }
                self.call(name, &arguments)
            }
            _ => Err(format!("expected a value before `{}`", self.rest)),
        }
    }

    fn name(&mut self) -> &'a str {
        let end = self.rest.find(|c: char| !(c.is_ascii_alphanumeric() || c == '_')).unwrap_or(self.rest.len());
        let (name, rest) = self.rest.split_at(end);
        self.rest = rest;
        name
    }

    fn call(&self, name: &str, arguments: &[Value]) -> Result<Value, String> {
        let wrong = || format!("{name}({} arguments) is unknown in `{}`", arguments.len(), self.text);
        let numbers: Vec<f64> = arguments.iter().filter_map(Value::as_f64).collect();
        let text = arguments.first().and_then(Value::as_str);
        let value = match (name, numbers.as_slice(), text) {
            ("min", [_, ..], None) => numbers.iter().copied().fold(f64::INFINITY, f64::min),
            ("max", [_, ..], None) => numbers.iter().copied().fold(f64::NEG_INFINITY, f64::max),
            ("clamp", &[x, low, high], None) => x.max(low).min(high),
            ("lerp", &[a, b, t], None) => a + (b - a) * t,
            ("sqrt", &[x], None) => x.sqrt(),
            ("sin", &[x], None) => x.sin(),
            ("cos", &[x], None) => x.cos(),
            ("abs", &[x], None) => x.abs(),
            ("floor", &[x], None) => x.floor(),
            ("round", &[x], None) => x.round(),
            // Texts for sentences: metres become whole centimetres or millimetres in digits, small counts become words.
            ("cm", &[x], None) => return Ok(Value::String(format!("{:.0}", x * 100.0))),
            ("mm", &[x], None) => return Ok(Value::String(format!("{:.0}", x * 1000.0))),
            ("count", &[x], None) => return Ok(Value::String(count_word(x))),
            // Each label and index draw an independent random number.
            ("draw", &[index, low, high], Some(label)) => {
                let seed = self.scope.stream(label).fork_index(index.max(0.0) as u64);
                low + (high - low) * seed.rng().random::<f64>()
            }
            ("mix", &[share], Some(a)) => {
                let b = arguments.get(1).and_then(Value::as_str).ok_or_else(wrong)?;
                return blended(a, b, share).map(Value::String);
            }
            ("dark", &[share], Some(color)) => return blended(color, "#000000", share).map(Value::String),
            ("light", &[share], Some(color)) => return blended(color, "#ffffff", share).map(Value::String),
            ("jitter", &[most], Some(color)) => {
                let mut rng = self.scope.stream(&format!("jitter {color}")).rng();
                let share = most * (2.0 * rng.random::<f64>() - 1.0);
                let other = if share < 0.0 { "#000000" } else { "#ffffff" };
                return blended(color, other, share.abs()).map(Value::String);
            }
            ("upper", [], Some(text)) => return Ok(Value::String(text.to_uppercase())),
            ("title", [], Some(text)) => return Ok(Value::String(title(text))),
            ("a", [], Some(text)) => return Ok(Value::String(with_article(text))),
            _ => return Err(wrong()),
        };
        Ok(number(value))
    }
}

/// Noun phrase with its indefinite article: `a red mug`, `an old mug`.
fn with_article(text: &str) -> String {
    format!("{} {text}", if takes_an(text.trim_start()) { "an" } else { "a" })
}

/// True if a word starts with a vowel sound, judged by its first letter.
pub(super) fn takes_an(word: &str) -> bool {
    word.starts_with(['a', 'e', 'i', 'o', 'u', 'A', 'E', 'I', 'O'])
}

/// Text with a capital first letter in every word.
fn title(text: &str) -> String {
    let mut start = true;
    text.chars()
        .map(|c| {
            let shown = if start { c.to_ascii_uppercase() } else { c };
            start = c == ' ' || c == '-';
            shown
        })
        .collect()
}

fn count_word(value: f64) -> String {
    let words = ["no", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten"];
    let index = value.round().max(0.0) as usize;
    words.get(index).map_or_else(|| index.to_string(), |word| (*word).to_owned())
}

fn blended(a: &str, b: &str, share: f64) -> Result<String, String> {
    let parse = |text: &str| Color::parse(text).ok_or_else(|| format!("expected a colour #rrggbb, got \"{text}\""));
    let (Color(a), Color(b)) = (parse(a)?, parse(b)?);
    let channel = |i: usize| (f64::from(a[i] + (b[i] - a[i]) * share as f32).clamp(0.0, 1.0) * 255.0).round() as u8;
    Ok(format!("#{:02x}{:02x}{:02x}", channel(0), channel(1), channel(2)))
}

/// Text of a value as it appears in a sentence.
pub fn text_of(value: &Value) -> String {
    match value {
        Value::String(text) => text.clone(),
        Value::Number(number) => {
            let rounded = (number.as_f64().unwrap_or(0.0) * 1000.0).round() / 1000.0;
            format!("{rounded}")
        }
        other => other.to_string(),
    }
}

fn as_number(value: &Value) -> Result<f64, String> {
    match value {
        Value::Bool(value) => Ok(f64::from(u8::from(*value))),
        value => value.as_f64().ok_or_else(|| format!("expected a number, got {value}")),
    }
}

fn same(a: &Value, b: &Value) -> bool {
    match (a.as_f64(), b.as_f64()) {
        (Some(a), Some(b)) => a == b,
        _ => a == b,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Names;

    impl Scope for Names {
        fn value(&self, name: &str) -> Result<Value, String> {
            match name {
                "h" => Ok(number(0.1)),
                "kind" => Ok("wide".into()),
                "color" => Ok(serde_json::json!({"word": "red", "hex": "#ff0000", "list": [1, 2]})),
                _ => Err(format!("there is no `{name}`")),
            }
        }

        fn stream(&self, label: &str) -> Seed {
            Seed::new(1).fork(label)
        }
    }

    #[test]
    fn expressions_have_values() {
        let check = |text: &str, expected: Value| assert_eq!(evaluate(text, &Names), Ok(expected), "{text}");
        check("1 + 2 * 3 - 4 / 2", number(5.0));
        check("-(h + 0.1) * 10", number(-2.0));
        check("kind == 'wide' ? 3 : 4", number(3.0));
        check("h > 0.2 || kind != 'wide'", Value::Bool(false));
        check("!(h < 0.2) && 1", Value::Bool(false));
        check("color.list[1] + min(4, 3, 5)", number(5.0));
        check("mix(color.hex, '#0000ff', 0.5)", "#800080".into());
        check("'a ' + color.word + ' ' + cm(h)", "a red 10".into());
        check("title('dark blue')", "Dark Blue".into());
        check("clamp(7, 0, lerp(2, 4, 0.5))", number(3.0));
    }

    #[test]
    fn invalid_expressions_are_explained() {
        for text in ["", "1 +", "x", "color.size", "min()", "'a", "1 2", "nope(1)", "'a' * 2", "color.list[9]", "(1"] {
            let error = evaluate(text, &Names).unwrap_err();
            assert!(error.starts_with(&format!("`{text}`: ")), "{error}");
        }
    }
}
