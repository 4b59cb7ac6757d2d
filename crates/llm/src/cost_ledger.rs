//! Accounting of replies, tokens and cost.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::error::SettingsError;
use crate::reply::ChatReply;

/// Token prices of a model, from the user's settings.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Price {
    /// Price per million input tokens (conversation).
    pub input_per_million: f64,
    /// Price per million output tokens (reply).
    pub output_per_million: f64,
    /// Currency of both prices.
    #[serde(default = "default_currency")]
    pub currency: String,
}

impl Price {
    /// Validates the prices.
    ///
    /// # Errors
    /// Names the table `prices` if a price is negative or NaN.
    pub fn check(&self) -> Result<(), SettingsError> {
        let is_price = |amount: f64| amount >= 0.0;
        if is_price(self.input_per_million) && is_price(self.output_per_million) {
            return Ok(());
        }
        Err(SettingsError::Invalid { field: "prices", expected: "prices of 0 or more".into() })
    }
}

fn default_currency() -> String {
    "USD".into()
}

/// Totals of exchanges by requested model name.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Ledger {
    /// Totals by requested model name.
    pub models: BTreeMap<String, ModelUsage>,
}

/// Totals of the exchanges with one model.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct ModelUsage {
    /// Number of replies from a server.
    pub answers: u64,
    /// HTTP requests sent, retries included.
    pub requests: u64,
    /// Replies from cassettes, free of charge.
    pub replayed: u64,
    /// Number of replies without token usage, whose cost is unknown.
    pub uncounted: u64,
    /// Sum of prompt tokens, over the replies that report them.
    pub prompt_tokens: u64,
    /// Sum of completion tokens, over the replies that report them.
    pub completion_tokens: u64,
}

/// Cost of the exchanges with one model.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Cost {
    /// All prices and token counts are known.
    Known {
        /// Amount in units of the currency.
        amount: f64,
        /// Currency of the amount.
        currency: String,
    },
    /// Unknown, because a price or token usage is missing.
    Unknown,
}

impl Ledger {
    /// Adds a reply to the totals of the requested model.
    pub fn add(&mut self, model: &str, reply: &ChatReply) {
        let totals = self.models.entry(model.to_owned()).or_default();
        if reply.attempts == 0 {
            totals.replayed += 1;
            return;
        }
        totals.answers += 1;
        totals.requests += u64::from(reply.attempts);
        match reply.usage {
            Some(usage) => {
                totals.prompt_tokens = totals.prompt_tokens.saturating_add(usage.prompt_tokens);
                totals.completion_tokens = totals.completion_tokens.saturating_add(usage.completion_tokens);
            }
            None => totals.uncounted += 1,
        }
    }

    /// Cost per model. Failed requests are not included, since servers do not report their cost.
    pub fn costs(&self, prices: &BTreeMap<String, Price>) -> BTreeMap<String, Cost> {
        let cost = |model: &str, totals: &ModelUsage| match prices.get(model) {
            _ if totals.answers == 0 => Cost::Known {
                amount: 0.0,
                currency: prices.get(model).map_or_else(default_currency, |price| price.currency.clone()),
            },
            Some(price) if totals.uncounted == 0 => Cost::Known {
                amount: (totals.prompt_tokens as f64 * price.input_per_million
                    + totals.completion_tokens as f64 * price.output_per_million)
                    / 1e6,
                currency: price.currency.clone(),
            },
            _ => Cost::Unknown,
        };
        self.models.iter().map(|(model, totals)| (model.clone(), cost(model, totals))).collect()
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
