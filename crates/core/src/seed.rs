//! Seeds: explicit randomness with labelled, order-independent sub-streams.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use schemars::JsonSchema;
use serde::de::Error;
use serde::{Deserialize, Deserializer, Serialize};
use sha2::{Digest, Sha256};

/// Root of a random stream, at most 53 bits wide so that every JSON reader represents it exactly.
///
/// Functions that need randomness take a `Seed` and fork it with one label per purpose, so that an additional draw in
/// one place does not shift the numbers drawn elsewhere.
///
/// ```
/// use genmanip_core::Seed;
/// let episode = Seed::new(1).fork("episode").fork_index(3);
/// assert_eq!(episode, Seed::new(1).fork("episode").fork_index(3));
/// assert_ne!(episode, Seed::new(1).fork("episode").fork_index(4));
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, JsonSchema)]
#[serde(transparent)]
pub struct Seed(u64);

impl<'de> Deserialize<'de> for Seed {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let value = u64::deserialize(deserializer)?;
        let too_large = || D::Error::custom(format_args!("expected a seed of at most {}, got {value}", Self::MAX));
        if value <= Self::MAX { Ok(Self(value)) } else { Err(too_large()) }
    }
}

impl Seed {
    /// The largest seed, 2^53 - 1.
    pub const MAX: u64 = (1 << 53) - 1;

    /// A seed from any number. Bits above the 53rd are dropped; user input above [`Seed::MAX`] is rejected before.
    pub fn new(value: u64) -> Self {
        Self(value & Self::MAX)
    }

    /// The seed as a number, at most [`Seed::MAX`].
    pub fn value(self) -> u64 {
        self.0
    }

    /// Seed of the sub-stream for one purpose, which the label names.
    #[must_use]
    pub fn fork(self, label: &str) -> Self {
        let mut hasher = Sha256::new();
        hasher.update(self.0.to_le_bytes());
        hasher.update(label.as_bytes());
        let digest = hasher.finalize();
        let mut first = [0; 8];
        first.copy_from_slice(&digest[..8]);
        Self::new(u64::from_le_bytes(first))
    }

    /// Seed of the `index`-th sub-stream of a series (episodes, attempts, samples).
    #[must_use]
    pub fn fork_index(self, index: u64) -> Self {
        self.fork(&format!("#{index}"))
    }

    /// Generator of this stream: ChaCha8, counter-based and identical on every machine.
    pub fn rng(self) -> ChaCha8Rng {
        ChaCha8Rng::seed_from_u64(self.0)
    }
}

impl std::fmt::Display for Seed {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        self.0.fmt(f)
    }
}
