//! What was asked, counted in answers, tokens and money.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::error::SettingsError;
use crate::reply::ChatReply;

/// What a model's tokens cost, from the user's settings.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Price {
    /// Per million tokens of the conversation.
    pub input_per_million: f64,
    /// Per million tokens of the answer.
    pub output_per_million: f64,
    /// Currency of both.
    #[serde(default = "dollars")]
    pub currency: String,
}

impl Price {
    /// Checks what the types do not say.
    ///
    /// # Errors
    /// Names the table `prices` when a price is negative or no number.
    pub fn check(&self) -> Result<(), SettingsError> {
        let is_price = |amount: f64| amount >= 0.0;
        if is_price(self.input_per_million) && is_price(self.output_per_million) {
            return Ok(());
        }
        Err(SettingsError::Invalid { field: "prices", expected: "prices of 0 or more".into() })
    }
}

fn dollars() -> String {
    "USD".into()
}

/// Sums over exchanges, by the name of the model that was asked for.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Ledger {
    /// Sums per model.
    pub models: BTreeMap<String, ModelUsage>,
}

/// Sums over the exchanges with one model.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct ModelUsage {
    /// Answers that came from a server.
    pub answers: u64,
    /// HTTP requests sent for them, retries included.
    pub requests: u64,
    /// Answers that came from cassettes and cost nothing.
    pub replayed: u64,
    /// Answers from a server that did not count its tokens.
    pub uncounted: u64,
    /// Tokens sent to the server.
    pub prompt_tokens: u64,
    /// Tokens the server answered with.
    pub completion_tokens: u64,
}

/// What one model cost.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Cost {
    /// Sum and currency.
    Known {
        /// In units of the currency.
        amount: f64,
        /// Its name.
        currency: String,
    },
    /// There is no price, or the server did not count.
    Unknown,
}

impl Ledger {
    /// Adds one answer.
    pub fn add(&mut self, model: &str, reply: &ChatReply) {
        let sums = self.models.entry(model.to_owned()).or_default();
        if reply.attempts == 0 {
            sums.replayed += 1;
            return;
        }
        sums.answers += 1;
        sums.requests += u64::from(reply.attempts);
        match reply.usage {
            Some(usage) => {
                sums.prompt_tokens = sums.prompt_tokens.saturating_add(usage.prompt_tokens);
                sums.completion_tokens = sums.completion_tokens.saturating_add(usage.completion_tokens);
            }
            None => sums.uncounted += 1,
        }
    }

    /// Cost per model. Requests that failed are not in it: no server says what those cost.
    pub fn costs(&self, prices: &BTreeMap<String, Price>) -> BTreeMap<String, Cost> {
        let cost = |model: &str, sums: &ModelUsage| match prices.get(model) {
            _ if sums.answers == 0 => Cost::Known {
                amount: 0.0,
                currency: prices.get(model).map_or_else(dollars, |price| price.currency.clone()),
            },
            Some(price) if sums.uncounted == 0 => Cost::Known {
                amount: (sums.prompt_tokens as f64 * price.input_per_million
                    + sums.completion_tokens as f64 * price.output_per_million)
                    / 1e6,
                currency: price.currency.clone(),
            },
            _ => Cost::Unknown,
        };
        self.models.iter().map(|(model, sums)| (model.clone(), cost(model, sums))).collect()
    }
}

impl std::fmt::Display for Cost {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Known { amount, currency } => write!(f, "{amount:.4} {currency}"),
            Self::Unknown => f.write_str("unknown"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reply::{Structure, Usage};

    fn reply(attempts: u32, usage: Option<(u64, u64)>) -> ChatReply {
        ChatReply {
            text: "x".into(),
            model: "exact name".into(),
            finish_reason: None,
            usage: usage.map(|(prompt_tokens, completion_tokens)| Usage { prompt_tokens, completion_tokens }),
            structure: Structure::Plain,
            attempts,
        }
    }

    fn check(replies: &[ChatReply], expected: &str) {
        let price = Price { input_per_million: 2.0, output_per_million: 10.0, currency: "EUR".into() };
        let prices = BTreeMap::from([("m".to_owned(), price)]);
        let mut ledger = Ledger::default();
        replies.iter().for_each(|reply| ledger.add("m", reply));
        assert_eq!(ledger.costs(&prices)["m"].to_string(), expected);
        if replies.iter().any(|reply| reply.attempts > 0) {
            assert_eq!(ledger.costs(&BTreeMap::new())["m"], Cost::Unknown);
        }
    }

    #[test]
    fn costs() {
        check(&[reply(1, Some((1_000_000, 0))), reply(3, Some((500_000, 100_000)))], "4.0000 EUR");
        check(&[reply(1, Some((1_000_000, 0))), reply(1, None)], "unknown");
        check(&[reply(0, Some((1_000_000, 0)))], "0.0000 EUR");
        check(&[reply(1, Some((u64::MAX, 0))), reply(1, Some((u64::MAX, 0)))], "36893488147419.1016 EUR");
    }
}
