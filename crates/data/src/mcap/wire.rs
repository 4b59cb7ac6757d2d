//! Minimal Protocol Buffers encoding, and message descriptors for readers.

/// Encoder of a Protocol Buffers message.
#[derive(Clone, Debug, Default)]
pub struct Wire(Vec<u8>);

impl Wire {
    pub fn into_bytes(self) -> Vec<u8> {
        self.0
    }

    /// Adds a non-negative integer or an enumeration value.
    #[must_use]
    pub fn number(mut self, field: u32, value: u64) -> Self {
        self.key(field, 0);
        self.varint(value);
        self
    }

    #[must_use]
    pub fn flag(self, field: u32, value: bool) -> Self {
        self.number(field, u64::from(value))
    }

    #[must_use]
    pub fn double(mut self, field: u32, value: f64) -> Self {
        self.key(field, 1);
        self.0.extend(value.to_le_bytes());
        self
    }

    #[must_use]
    pub fn fixed32(mut self, field: u32, value: u32) -> Self {
        self.key(field, 5);
        self.0.extend(value.to_le_bytes());
        self
    }

    #[must_use]
    pub fn bytes(mut self, field: u32, value: &[u8]) -> Self {
        self.key(field, 2);
        self.varint(value.len() as u64);
        self.0.extend_from_slice(value);
        self
    }

    #[must_use]
    pub fn text(self, field: u32, value: &str) -> Self {
        self.bytes(field, value.as_bytes())
    }

    #[must_use]
    pub fn message(self, field: u32, value: Self) -> Self {
        self.bytes(field, &value.0)
    }

    /// Adds a packed repeated field of doubles.
    #[must_use]
    pub fn doubles(self, field: u32, values: &[f64]) -> Self {
        self.bytes(field, &values.iter().flat_map(|value| value.to_le_bytes()).collect::<Vec<u8>>())
    }

    fn key(&mut self, field: u32, kind: u64) {
        self.varint(u64::from(field) << 3 | kind);
    }

    fn varint(&mut self, mut value: u64) {
        while value >= 0x80 {
            self.0.push(value as u8 | 0x80);
            value >>= 7;
        }
        self.0.push(value as u8);
    }
}

/// Field type, see `FieldDescriptorProto.Type`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    Double,
    Int64,
    Int32,
    Fixed32,
    Bool,
    Text,
    Bytes,
    /// Another message, by full name.
    Message(&'static str),
    /// Enumeration nested in the message, by full name.
    Enum(&'static str),
}

/// Field of a message: name, number, type, and true if repeated.
pub type Field = (&'static str, u32, Kind, bool);

/// Message type of a Protocol Buffers schema.
#[derive(Debug)]
pub struct Message {
    pub package: &'static str,
    pub name: &'static str,
    pub fields: &'static [Field],
    /// Name and values of its nested enumeration, if any.
    pub values: Option<(&'static str, &'static [&'static str])>,
}

impl Message {
    fn full_name(&self) -> String {
        format!("{}.{}", self.package, self.name)
    }

    fn describe(&self) -> Wire {
        let mut described = Wire::default().text(1, self.name);
        for (name, number, kind, is_repeated) in self.fields {
            let (code, type_name) = match kind {
                Kind::Double => (1, None),
                Kind::Int64 => (3, None),
                Kind::Int32 => (5, None),
                Kind::Fixed32 => (7, None),
                Kind::Bool => (8, None),
                Kind::Text => (9, None),
                Kind::Message(name) => (11, Some(name)),
                Kind::Bytes => (12, None),
                Kind::Enum(name) => (14, Some(name)),
            };
            let label = if *is_repeated { 3 } else { 1 };
            let field = Wire::default().text(1, name).number(3, u64::from(*number)).number(4, label).number(5, code);
            let field = type_name.map_or(field.clone(), |name| field.text(6, &format!(".{name}")));
            described = described.message(2, field);
        }
        if let Some((name, values)) = self.values {
            let mut enumeration = Wire::default().text(1, name);
            for (number, value) in (0..).zip(values) {
                enumeration = enumeration.message(2, Wire::default().text(1, value).number(2, number));
            }
            described = described.message(4, enumeration);
        }
        described
    }
}

/// `FileDescriptorSet` with a message and its dependencies, one file per package.
pub fn descriptor(name: &str, known: &[Message]) -> Vec<u8> {
    let mut needed: Vec<&Message> = Vec::new();
    let mut asked = vec![name.to_owned()];
    while let Some(name) = asked.pop() {
        let Some(message) = known.iter().find(|message| message.full_name() == name) else { continue };
        if !needed.iter().any(|other| std::ptr::eq(*other, message)) {
            needed.push(message);
            asked.extend(message.fields.iter().filter_map(|(_, _, kind, _)| match kind {
                Kind::Message(name) => Some((*name).to_owned()),
                _ => None,
            }));
        }
    }
    let package = name.rsplit_once('.').map_or("", |(package, _)| package);
    let file = |package: &str| format!("{}/{}.proto", package.replace('.', "/"), name.replace('.', "_"));
    let mut others: Vec<&str> =
        needed.iter().map(|message| message.package).filter(|other| *other != package).collect();
    others.sort_unstable();
    others.dedup();
    let mut set = Wire::default();
    for own in others.iter().copied().chain([package]) {
        let mut described = Wire::default().text(1, &file(own)).text(2, own);
        for other in others.iter().filter(|_| own == package) {
            described = described.text(3, &file(other));
        }
        for message in needed.iter().filter(|message| message.package == own) {
            described = described.message(4, message.describe());
        }
        set = set.message(1, described.text(12, "proto3"));
    }
    set.into_bytes()
}
