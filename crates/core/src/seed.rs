//! Randomness as an argument: labelled, order-independent sub-streams.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use schemars::JsonSchema;
use serde::de::Error;
use serde::{Deserialize, Deserializer, Serialize};
use sha2::{Digest, Sha256};

/// The root of a random stream, at most 53 bits wide so that every JSON reader keeps it exact.
///
/// Functions that need chance take a `Seed` and fork it by a label per purpose;
/// one more draw in one place then never shifts the numbers drawn in another.
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

    /// A seed from any number; bits above the 53rd are ignored, so numbers that people choose are refused above
    /// [`Seed::MAX`] before.
    pub fn new(value: u64) -> Self {
        Self(value & Self::MAX)
    }

    /// The number to print or to store.
    pub fn value(self) -> u64 {
        self.0
    }

    /// The sub-stream for one purpose.
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

    /// The sub-stream of the `index`-th of many equal things (episodes, attempts, samples).
    #[must_use]
    pub fn fork_index(self, index: u64) -> Self {
        self.fork(&format!("#{index}"))
    }

    /// The generator of this stream: ChaCha8, counter based and the same on every machine.
    pub fn rng(self) -> ChaCha8Rng {
        ChaCha8Rng::seed_from_u64(self.0)
    }
}

impl std::fmt::Display for Seed {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        self.0.fmt(f)
    }
}
