//! Stack machine that evaluates the opcodes of a pickle.

use std::collections::BTreeMap;

use super::{Function, Kind, Node, ValueId};

/// Maximum number of values of a pickle: more than an episode of one hour needs.
const MAX_VALUES: usize = 4_000_000;
/// Maximum number of bytes copied by function calls; protocol 2 stores an image as text, which a call copies.
const MAX_COPIED_BYTES: usize = 256 << 20;
/// Maximum number of open marks, i.e. nesting depth. Bounds memory for hostile files.
const MAX_DEPTH: usize = 1000;
/// Maximum number of dimensions of an array, as in NumPy.
const MAX_DIMENSIONS: usize = 64;
/// Maximum number of characters of pickle contents quoted in an error.
const SHOWN: usize = 80;

/// State of the stack machine: input, position, arena of values, and stacks.
#[derive(Default)]
pub(super) struct Unpickler<'a> {
    bytes: &'a [u8],
    pub(super) at: usize,
    pub(super) values: Vec<Node>,
    stack: Vec<ValueId>,
    /// Stack height at each open mark.
    marks: Vec<usize>,
    memo: BTreeMap<u64, ValueId>,
    /// Bytes copied by function calls so far.
    copied: usize,
}

impl<'a> Unpickler<'a> {
    pub(super) fn new(bytes: &'a [u8]) -> Self {
        Self { bytes, ..Self::default() }
    }

    /// Evaluates the opcodes up to STOP; returns the index of the result.
    pub(super) fn run(&mut self) -> Result<ValueId, String> {
        loop {
            let code = self.take(1)?[0];
            match code {
                b'.' => return self.pop(),
                // PROTO and FRAME: their arguments are not needed.
                0x80 => drop(self.take(1)?),
                0x95 => drop(self.take(8)?),
                b'(' => {
                    if self.marks.len() >= MAX_DEPTH {
                        return Err(format!("expected values nested at most {MAX_DEPTH} deep, got more"));
                    }
                    self.marks.push(self.stack.len());
                }
                b'0' => drop(self.pop()?),
                b'1' => drop(self.pop_to_mark()?),
                b'2' => {
                    let top = self.top()?;
                    self.push_place(top)?;
                }
                b'N' => self.push(Node::None)?,
                0x88 => self.push(Node::Bool(true))?,
                0x89 => self.push(Node::Bool(false))?,
                b'I' | b'L' => {
                    let line = self.line()?;
                    let node = match (code, line.as_str()) {
                        (b'I', "00") => Node::Bool(false),
                        (b'I', "01") => Node::Bool(true),
                        (_, text) => Node::Int(parse_integer(text.trim_end_matches('L'))?),
                    };
                    self.push(node)?;
                }
                b'J' => {
                    let value = self.number(4)? as u32;
                    self.push(Node::Int(i64::from(value as i32)))?;
                }
                b'K' => self.integer(1)?,
                b'M' => self.integer(2)?,
                0x8a => {
                    let length = self.number(1)?;
                    self.long(length)?;
                }
                0x8b => {
                    let length = self.number(4)?;
                    self.long(length)?;
                }
                b'F' => {
                    let line = self.line()?;
                    let value = line.parse().map_err(|_| format!("expected a number, got {}", quoted(&line)))?;
                    self.push(Node::Float(value))?;
                }
                b'G' => {
                    let bytes = self.take(8)?;
                    let value = f64::from_be_bytes(bytes.try_into().unwrap_or_default());
                    self.push(Node::Float(value))?;
                }
                b'C' | b'U' => self.binary(1)?,
                b'B' | b'T' => self.binary(4)?,
                0x8e | 0x96 => self.binary(8)?,
                0x8c => self.text(1)?,
                b'X' => self.text(4)?,
                0x8d => self.text(8)?,
                b'V' => {
                    let line = self.line()?;
                    self.push(Node::Text(line))?;
                }
                b']' | 0x8f => self.push(Node::List(Vec::new()))?,
                b')' => self.push(Node::Tuple(Vec::new()))?,
                b'}' => self.push(Node::Dict(Vec::new()))?,
                b'l' | 0x91 => {
                    let entries = self.pop_to_mark()?;
                    self.push(Node::List(entries))?;
                }
                b't' => {
                    let entries = self.pop_to_mark()?;
                    self.push(Node::Tuple(entries))?;
                }
                0x85..=0x87 => {
                    let count = usize::from(code - 0x84);
                    let from = self.stack.len().checked_sub(count).ok_or_else(stack_underflow)?;
                    let entries = self.stack.split_off(from);
                    self.push(Node::Tuple(entries))?;
                }
                b'd' => {
                    let entries = pairs(self.pop_to_mark()?)?;
                    self.push(Node::Dict(entries))?;
                }
                b'a' => {
                    let entry = self.pop()?;
                    self.append(vec![entry])?;
                }
                b'e' | 0x90 => {
                    let entries = self.pop_to_mark()?;
                    self.append(entries)?;
                }
                b's' => {
                    let value = self.pop()?;
                    let key = self.pop()?;
                    self.set(vec![(key, value)])?;
                }
                b'u' => {
                    let entries = pairs(self.pop_to_mark()?)?;
                    self.set(entries)?;
                }
                b'p' => {
                    let index = parse_integer(&self.line()?)?;
                    self.memo_put(index as u64)?;
                }
                b'q' => {
                    let index = self.number(1)?;
                    self.memo_put(index)?;
                }
                b'r' => {
                    let index = self.number(4)?;
                    self.memo_put(index)?;
                }
                0x94 => self.memo_put(self.memo.len() as u64)?,
                b'g' => {
                    let index = parse_integer(&self.line()?)?;
                    self.memo_get(index as u64)?;
                }
                b'h' => {
                    let index = self.number(1)?;
                    self.memo_get(index)?;
                }
                b'j' => {
                    let index = self.number(4)?;
                    self.memo_get(index)?;
                }
                b'c' => {
                    let (module, name) = (self.line()?, self.line()?);
                    self.function(&module, &name)?;
                }
                0x93 => {
                    let (name, module) = (self.pop()?, self.pop()?);
                    let [module, name] = [module, name].map(|place| match &self.values[place] {
                        Node::Text(text) => Some(text.clone()),
                        _ => None,
                    });
                    let (Some(module), Some(name)) = (module, name) else {
                        return Err("expected the name of a function, got another value".into());
                    };
                    self.function(&module, &name)?;
                }
                b'R' => {
                    let (arguments, function) = (self.pop()?, self.pop()?);
                    let origin = self.call(function, arguments)?;
                    self.count_copied(&origin)?;
                    self.push(origin)?;
                }
                b'b' => {
                    let state = self.pop()?;
                    self.build(state)?;
                }
                code => return Err(format!("expected an opcode that builds plain values, got {code:#04x}")),
            }
        }
    }

    fn take(&mut self, count: usize) -> Result<&[u8], String> {
        let end = self.at.checked_add(count).filter(|end| *end <= self.bytes.len());
        let end = end.ok_or_else(|| format!("expected {count} more bytes, got the end"))?;
        let taken = &self.bytes[self.at..end];
        self.at = end;
        Ok(taken)
    }

    /// Little-endian integer of `bytes` bytes.
    fn number(&mut self, bytes: usize) -> Result<u64, String> {
        let mut wide = [0; 8];
        wide[..bytes].copy_from_slice(self.take(bytes)?);
        Ok(u64::from_le_bytes(wide))
    }

    fn line(&mut self) -> Result<String, String> {
        let rest = &self.bytes[self.at..];
        let length = rest.iter().position(|byte| *byte == b'\n').ok_or("expected a line, got the end")?;
        let line = std::str::from_utf8(&rest[..length]).map_err(|_| "expected text, got other bytes")?.to_owned();
        self.at += length + 1;
        Ok(line)
    }

    fn push(&mut self, node: Node) -> Result<(), String> {
        if self.values.len() >= MAX_VALUES {
            return Err(format!("expected at most {MAX_VALUES} values, got more"));
        }
        self.push_place(self.values.len())?;
        self.values.push(node);
        Ok(())
    }

    /// Pushes a reference to an existing value on the stack.
    fn push_place(&mut self, place: ValueId) -> Result<(), String> {
        if self.stack.len() >= MAX_VALUES {
            return Err(format!("expected at most {MAX_VALUES} values on the stack, got more"));
        }
        self.stack.push(place);
        Ok(())
    }

    fn pop(&mut self) -> Result<ValueId, String> {
        // Values below the last mark must not be popped.
        let floor = self.marks.last().copied().unwrap_or(0);
        if self.stack.len() <= floor {
            return Err(stack_underflow());
        }
        self.stack.pop().ok_or_else(stack_underflow)
    }

    fn top(&self) -> Result<ValueId, String> {
        self.stack.last().copied().ok_or_else(stack_underflow)
    }

    /// Pops all values since the last mark.
    fn pop_to_mark(&mut self) -> Result<Vec<ValueId>, String> {
        let from = self.marks.pop().ok_or("expected a mark, got none")?;
        if from > self.stack.len() {
            return Err(stack_underflow());
        }
        Ok(self.stack.split_off(from))
    }

    fn integer(&mut self, bytes: usize) -> Result<(), String> {
        let value = self.number(bytes)?;
        self.push(Node::Int(value as i64))
    }

    fn long(&mut self, length: u64) -> Result<(), String> {
        let length = usize::try_from(length).ok().filter(|length| *length <= 8);
        let length = length.ok_or("expected an integer of at most 8 bytes, got a larger one")?;
        let value = self.number(length)?;
        let spare = 64 - 8 * length as u32;
        let value = if length == 0 { 0 } else { ((value << spare) as i64) >> spare };
        self.push(Node::Int(value))
    }

    /// Reads bytes that follow their length, an integer of `size` bytes.
    fn read_counted(&mut self, size: usize) -> Result<&[u8], String> {
        let length = self.number(size)?;
        self.take(usize::try_from(length).unwrap_or(usize::MAX))
    }

    fn binary(&mut self, size: usize) -> Result<(), String> {
        let bytes = self.read_counted(size)?.to_vec();
        self.push(Node::Bytes(bytes))
    }

    fn text(&mut self, size: usize) -> Result<(), String> {
        let text =
            std::str::from_utf8(self.read_counted(size)?).map_err(|_| "expected text, got other bytes")?.to_owned();
        self.push(Node::Text(text))
    }

    fn append(&mut self, entries: Vec<ValueId>) -> Result<(), String> {
        let list = self.top()?;
        match &mut self.values[list] {
            Node::List(known) => known.extend(entries),
            _ => return Err("expected a list to append to, got another value".into()),
        }
        Ok(())
    }

    fn set(&mut self, entries: Vec<(ValueId, ValueId)>) -> Result<(), String> {
        let dict = self.top()?;
        match &mut self.values[dict] {
            Node::Dict(known) => known.extend(entries),
            _ => return Err("expected a dictionary to add to, got another value".into()),
        }
        Ok(())
    }

    fn memo_put(&mut self, index: u64) -> Result<(), String> {
        let top = self.top()?;
        if self.memo.len() >= MAX_VALUES && !self.memo.contains_key(&index) {
            return Err(format!("expected at most {MAX_VALUES} values in the memo, got more"));
        }
        self.memo.insert(index, top);
        Ok(())
    }

    fn memo_get(&mut self, index: u64) -> Result<(), String> {
        let place =
            *self.memo.get(&index).ok_or_else(|| format!("expected a value at memo index {index}, got none"))?;
        self.push_place(place)
    }

    fn function(&mut self, module: &str, name: &str) -> Result<(), String> {
        let function = Function::named(module, name).ok_or_else(|| {
            let asked = quoted(&format!("{module}.{name}"));
            format!("expected plain values and NumPy arrays, got a call of {asked}, which is not executed")
        })?;
        self.push(Node::Function(function))
    }

    fn tuple(&self, place: ValueId) -> Result<&[ValueId], String> {
        match &self.values[place] {
            Node::Tuple(entries) => Ok(entries),
            _ => Err("expected the arguments of a function, got another value".into()),
        }
    }

    /// Adds the bytes copied by a call to the total, which is limited, since a few opcodes can copy a large value many
    /// times.
    fn count_copied(&mut self, origin: &Node) -> Result<(), String> {
        self.copied += match origin {
            Node::Bytes(bytes) => bytes.len(),
            Node::Text(text) => text.len(),
            Node::List(places) => places.len() * size_of::<ValueId>(),
            Node::Type { name, .. } => name.len(),
            _ => 0,
        };
        if self.copied > MAX_COPIED_BYTES {
            return Err(format!("expected calls that copy at most {MAX_COPIED_BYTES} bytes, got more"));
        }
        Ok(())
    }

    fn call(&self, function: ValueId, arguments: ValueId) -> Result<Node, String> {
        let Node::Function(function) = &self.values[function] else {
            return Err("expected a function to call, got another value".into());
        };
        let arguments = self.tuple(arguments)?;
        let argument = |index: usize| arguments.get(index).map(|place| &self.values[*place]);
        match function {
            Function::Reconstruct => match argument(0) {
                Some(Node::Function(Function::NdArray)) => Ok(Node::EmptyArray),
                _ => Err("expected a NumPy array, got another type".into()),
            },
            Function::DType => match argument(0) {
                Some(Node::Text(name)) => Ok(Node::Type { name: name.clone(), is_big: false }),
                _ => Err("expected the name of a NumPy type, got another value".into()),
            },
            Function::Scalar => match (argument(0), argument(1), arguments.get(1)) {
                (Some(dtype @ Node::Type { .. }), Some(Node::Bytes(_)), Some(bytes)) => {
                    self.array(dtype, Vec::new(), *bytes)
                }
                _ => Ok(Node::Opaque),
            },
            Function::FromBuffer => match (arguments.first(), argument(1), arguments.get(2), argument(3)) {
                (Some(bytes), Some(dtype @ Node::Type { .. }), Some(shape), Some(Node::Text(order)))
                    if order == "C" =>
                {
                    self.array(dtype, self.shape(*shape)?, *bytes)
                }
                _ => Ok(Node::Opaque),
            },
            Function::Encode => match (argument(0), argument(1)) {
                // Protocol 2 encodes bytes as Latin-1 text.
                (Some(Node::Text(text)), Some(Node::Text(code))) if code == "latin1" => {
                    let bytes: Option<Vec<u8>> =
                        text.chars().map(|letter| u8::try_from(u32::from(letter)).ok()).collect();
                    bytes.map(Node::Bytes).ok_or_else(|| "expected Latin-1 text, got other characters".into())
                }
                _ => Err("expected Latin-1, got another encoding".into()),
            },
            Function::OrderedDict => Ok(Node::Dict(Vec::new())),
            Function::Set => Ok(argument(0).cloned().unwrap_or(Node::List(Vec::new()))),
            Function::NdArray => Err("expected an array with contents, got its type alone".into()),
        }
    }

    /// Evaluates the opcode BUILD, which sets the state of the value on top of the stack, here an array or a dtype.
    fn build(&mut self, state: ValueId) -> Result<(), String> {
        let top = self.top()?;
        let state = self.tuple(state).map_err(|_| "expected the state of an array or its type, got another value")?;
        let part = |index: usize| state.get(index).map(|place| &self.values[*place]);
        let built = match &self.values[top] {
            Node::Type { name, .. } => match (part(1), part(3)) {
                (Some(Node::Text(order)), Some(Node::None)) => Node::Type { name: name.clone(), is_big: order == ">" },
                // A structured dtype (named fields) is not supported: the array stays opaque.
                _ => Node::Opaque,
            },
            Node::Opaque => Node::Opaque,
            Node::EmptyArray => match (state.get(1), part(2), part(3), state.get(4)) {
                (Some(shape), Some(dtype @ Node::Type { .. }), Some(Node::Bool(false)), Some(bytes)) => {
                    self.array(dtype, self.shape(*shape)?, *bytes)?
                }
                (_, _, Some(Node::Bool(_)), _) => Node::Opaque,
                _ => return Err("expected shape, type and bytes of an array, got something else".into()),
            },
            _ => return Err("expected an array or its type before BUILD, got another value".into()),
        };
        self.values[top] = built;
        Ok(())
    }

    fn shape(&self, place: ValueId) -> Result<Vec<usize>, String> {
        let lengths = self.tuple(place)?;
        let length = |place: &ValueId| match self.values[*place] {
            Node::Int(length) => usize::try_from(length).ok(),
            _ => None,
        };
        let shape: Option<Vec<usize>> = lengths.iter().take(MAX_DIMENSIONS).map(length).collect();
        shape.ok_or_else(|| "expected the shape of an array, got another value".into())
    }

    /// A numeric array; arrays of other types are opaque.
    fn array(&self, dtype: &Node, shape: Vec<usize>, bytes: ValueId) -> Result<Node, String> {
        let Node::Type { name, is_big } = dtype else { return Ok(Node::Opaque) };
        let (Some(kind), Node::Bytes(held)) = (Kind::of(name), &self.values[bytes]) else { return Ok(Node::Opaque) };
        if *is_big && kind.size() > 1 {
            return Err(format!("expected little-endian numbers, got {} in big-endian order", quoted(name)));
        }
        let count = shape.iter().try_fold(kind.size(), |product, length| product.checked_mul(*length));
        if count != Some(held.len()) {
            let expected = count.map_or("far more".to_owned(), |count| count.to_string());
            return Err(format!("expected {expected} bytes for an array of shape {shape:?}, got {}", held.len()));
        }
        Ok(Node::Array { kind, shape, bytes })
    }
}

fn pairs(entries: Vec<ValueId>) -> Result<Vec<(ValueId, ValueId)>, String> {
    let (pairs, rest) = entries.as_chunks::<2>();
    if rest.is_empty() { Ok(pairs.iter().map(|[key, value]| (*key, *value)).collect()) } else { Err(stack_underflow()) }
}

fn parse_integer(text: &str) -> Result<i64, String> {
    text.trim().parse().map_err(|_| format!("expected an integer, got {}", quoted(text)))
}

fn stack_underflow() -> String {
    "expected a value on the stack, got none".into()
}

fn quoted(text: &str) -> String {
    text.chars().take(SHOWN).filter(|letter| !letter.is_control()).collect()
}
