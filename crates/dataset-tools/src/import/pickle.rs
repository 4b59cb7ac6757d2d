//! Restricted unpickler: reads plain values and NumPy arrays without executing anything.
//!
//! A pickle is a program for a stack machine that can call any Python function. This unpickler supports the opcodes
//! that build values, and replaces a few functions of NumPy and Python's standard library with its own code. Everything
//! else is rejected.
//!
//! Values are stored in one arena and refer to each other by index. Shared values are stored once, so that memory is
//! bounded by the size of the pickle, and cycles are harmless.

#[cfg(test)]
mod tests;
mod unpickler;
mod value;

use unpickler::Unpickler;
use value::{Function, Kind, Node, ValueId};

/// Values of a parsed pickle.
#[derive(Debug)]
pub(super) struct Pickle {
    values: Vec<Node>,
    root: ValueId,
}

/// Reference to a value of a pickle.
#[derive(Clone, Copy, Debug)]
pub(super) struct Value<'a> {
    pickle: &'a Pickle,
    place: ValueId,
}

impl<'a> Value<'a> {
    fn node(self) -> &'a Node {
        &self.pickle.values[self.place]
    }

    fn at(self, place: ValueId) -> Self {
        Self { place, ..self }
    }

    pub(super) fn text(self) -> Option<&'a str> {
        match self.node() {
            Node::Text(text) => Some(text),
            _ => None,
        }
    }

    /// Elements of a list or tuple; `None` for other types.
    pub(super) fn entries(self) -> Option<Vec<Value<'a>>> {
        match self.node() {
            Node::List(places) | Node::Tuple(places) => Some(places.iter().map(|place| self.at(*place)).collect()),
            _ => None,
        }
    }

    /// Value of a string key in a dictionary; `None` if it is missing or this is no dictionary.
    pub(super) fn get(self, key: &str) -> Option<Value<'a>> {
        let Node::Dict(entries) = self.node() else { return None };
        // A later entry with the same key replaces an earlier one.
        let found = entries.iter().rev().find(|(name, _)| self.at(*name).text() == Some(key));
        found.map(|(_, value)| self.at(*value))
    }

    /// Value of an integer; `None` for other types.
    pub(super) fn integer(self) -> Option<i64> {
        match self.node() {
            Node::Int(value) => Some(*value),
            _ => None,
        }
    }

    /// Contents of a byte string or `uint8` array, such as an image file; `None` for other types.
    pub(super) fn bytes(self) -> Option<&'a [u8]> {
        match self.node() {
            Node::Bytes(bytes) => Some(bytes),
            Node::Array { kind: Kind::Unsigned(1), bytes, .. } => self.at(*bytes).bytes(),
            _ => None,
        }
    }

    /// All numbers of a scalar, array or nested list, flattened; `None` if there are other values or too many numbers.
    /// The flag is false if a Python float or an array of another type than float32 is among them.
    pub(super) fn numbers(self) -> Option<(Vec<f64>, bool)> {
        let (mut numbers, mut is_single, mut visited) = (Vec::new(), true, 0);
        self.gather(&mut visited, 0, &mut numbers, &mut is_single)?;
        Some((numbers, is_single))
    }

    fn gather(self, visited: &mut usize, depth: usize, into: &mut Vec<f64>, is_single: &mut bool) -> Option<()> {
        /// Maximum count of numbers per value (a pose has 16); half the maximum count of visited nodes, which bounds
        /// the expansion of lists that share elements.
        const MOST: usize = 256;
        *visited += 1;
        if *visited > 2 * MOST {
            return None;
        }
        match self.node() {
            Node::Bool(value) => into.push(f64::from(u8::from(*value))),
            Node::Int(value) => into.push(*value as f64),
            Node::Float(value) => {
                *is_single = false;
                into.push(*value);
            }
            Node::Array { kind, bytes, .. } => {
                *is_single &= *kind == Kind::Float(4);
                let bytes = self.at(*bytes).bytes()?;
                into.extend(bytes.chunks_exact(kind.size()).take(MOST + 1).map(|bytes| number(*kind, bytes)));
            }
            Node::List(places) | Node::Tuple(places) if depth < 4 => {
                places.iter().try_for_each(|place| self.at(*place).gather(visited, depth + 1, into, is_single))?;
            }
            _ => return None,
        }
        (into.len() <= MOST).then_some(())
    }
}

fn number(kind: Kind, bytes: &[u8]) -> f64 {
    let mut wide = [0; 8];
    wide[..bytes.len()].copy_from_slice(bytes);
    let value = u64::from_le_bytes(wide);
    match kind {
        Kind::Bool | Kind::Unsigned(_) => value as f64,
        Kind::Int(size) => {
            let spare = 64 - 8 * size;
            (((value << spare) as i64) >> spare) as f64
        }
        Kind::Float(4) => f64::from(f32::from_bits(value as u32)),
        Kind::Float(_) => f64::from_bits(value),
    }
}

impl Pickle {
    /// Parses a pickle of protocols 0 to 5.
    ///
    /// # Errors
    /// If the pickle is damaged, too large, or calls a function that is not supported; the text has the expected and
    /// actual contents, and the byte offset.
    pub(super) fn read(bytes: &[u8]) -> Result<Self, String> {
        let mut unpickler = Unpickler::new(bytes);
        let root = unpickler.run().map_err(|why| format!("{why}, byte {}", unpickler.at))?;
        Ok(Self { values: unpickler.values, root })
    }

    pub(super) fn root(&self) -> Value<'_> {
        Value { pickle: self, place: self.root }
    }
}
