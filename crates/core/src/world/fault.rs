//! Invalid values in worlds.

/// An invalid value in a world.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize)]
pub struct WorldFault {
    /// Field path, e.g. `surfaces[1].size_m`.
    pub place: String,
    /// Expected value.
    pub expected: String,
    /// Actual value.
    pub got: String,
    /// Suggested fix; may be empty.
    pub hint: String,
}

impl std::fmt::Display for WorldFault {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}: expected {}, got {}", self.place, self.expected, self.got)?;
        if self.hint.is_empty() { Ok(()) } else { write!(f, " (hint: {})", self.hint) }
    }
}

impl WorldFault {
    /// A fault at a field path, without a suggested fix.
    pub fn new(place: impl Into<String>, expected: impl Into<String>, got: impl ToString) -> Self {
        Self { place: place.into(), expected: expected.into(), got: got.to_string(), hint: String::new() }
    }

    /// Message with the expected and the actual value, without the field path.
    pub fn expectation(&self) -> String {
        format!("expected {}, got {}", self.expected, self.got)
    }

    /// The same fault with a suggested fix.
    #[must_use]
    pub fn hint(self, hint: impl Into<String>) -> Self {
        Self { hint: hint.into(), ..self }
    }
}
