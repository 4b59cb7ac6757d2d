//! Value parsers of several subcommands.

pub(super) fn parse_scale(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(value) if (1e-6..=1e6).contains(&value) => Ok(value),
        _ => Err("expected metres per unit, 1e-6 to 1e6".into()),
    }
}

pub(super) fn parse_category(text: &str) -> Result<String, String> {
    let fits = |c: char| c.is_lowercase() || c == ' ' || c == '-';
    let is_noun = text.len() <= 40 && text.chars().all(fits) && text.trim() == text && !text.is_empty();
    if is_noun { Ok(text.to_owned()) } else { Err("expected a noun in lower case, such as `water bottle`".into()) }
}

pub(super) fn parse_sum(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(value) if (0.0..=1e9).contains(&value) && !f64::is_sign_negative(value) => Ok(value),
        _ => Err("expected a sum from 0 to 1e9".into()),
    }
}

pub(super) fn parse_rate(text: &str) -> Result<u32, String> {
    match text.parse() {
        Ok(fps @ (10 | 15 | 20 | 30 | 60)) => Ok(fps),
        _ => Err("expected 10, 15, 20, 30 or 60 (divisors of the 60 Hz control rate)".into()),
    }
}

pub(super) fn parse_yes(text: &str) -> Result<bool, String> {
    match text {
        "yes" => Ok(true),
        "no" => Ok(false),
        _ => Err("expected yes or no".into()),
    }
}
