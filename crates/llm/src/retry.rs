//! Waiting times of retries.

use genmanip_core::Seed;
use rand::RngExt;

use crate::settings::ServerSettings;

/// Wait before retry number `retry` (from 0) [s]: exponential up to a limit, shortened by up to half at random so that
/// many clients do not return at once ("equal jitter").
pub(crate) fn backoff_s(settings: &ServerSettings, retry: u32, jitter: Seed) -> f64 {
    let longest = settings.first_backoff_s * 2f64.powi(retry.min(30) as i32);
    longest.min(settings.max_backoff_s) * jitter.fork_index(u64::from(retry)).rng().random_range(0.5..=1.0)
}

/// Wait requested by a `Retry-After` header [s]: a number, or an HTTP date relative to the server's own `Date` header,
/// so that no local clock is needed. Anything else is ignored.
pub(crate) fn retry_after_s(retry_after: Option<&str>, date: Option<&str>) -> Option<f64> {
    let text = retry_after?.trim();
    if let Ok(seconds) = text.parse::<f64>() {
        return (seconds.is_finite() && seconds >= 0.0).then_some(seconds);
    }
    let seconds = http_date_s(text)? - http_date_s(date?.trim())?;
    Some(seconds.max(0) as f64)
}

/// Seconds since 1970 of a date such as `Sun, 06 Nov 1994 08:49:37 GMT` (IMF-fixdate of RFC 9110, 5.6.7). `None` for
/// other formats.
fn http_date_s(text: &str) -> Option<i64> {
    let fields: Vec<&str> = text.split([' ', ':']).collect();
    let [_weekday, day, month, year, hour, minute, second, "GMT"] = fields[..] else {
        return None;
    };
    let months = ["Jan", "Feb", "Mar", "Apr", "May", "Jun", "Jul", "Aug", "Sep", "Oct", "Nov", "Dec"];
    let month = months.iter().position(|name| *name == month)? as i64 + 1;
    let number = |text: &str, largest: i64| text.parse::<i64>().ok().filter(|n| (0..=largest).contains(n));
    let days = days_from_civil(number(year, 9999)?, month, number(day, 31)?);
    Some(((days * 24 + number(hour, 23)?) * 60 + number(minute, 59)?) * 60 + number(second, 60)?)
}

/// Days since 1970-01-01 in the Gregorian calendar (Howard Hinnant, "chrono-compatible low-level date algorithms").
fn days_from_civil(year: i64, month: i64, day: i64) -> i64 {
    let year = if month <= 2 { year - 1 } else { year };
    let era = year.div_euclid(400);
    let year_of_era = year.rem_euclid(400);
    let day_of_year = (153 * ((month + 9) % 12) + 2) / 5 + day - 1;
    era * 146_097 + year_of_era * 365 + year_of_era / 4 - year_of_era / 100 + day_of_year - 719_468
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn waits_grow_stay_bounded_and_repeat() {
        let settings = ServerSettings { first_backoff_s: 1.0, max_backoff_s: 5.0, ..ServerSettings::default() };
        for seed in 0..50 {
            for (retry, longest) in [(0, 1.0), (1, 2.0), (2, 4.0), (3, 5.0), (4_000_000_000, 5.0)] {
                let wait = backoff_s(&settings, retry, Seed::new(seed));
                assert!((longest / 2.0..=longest).contains(&wait), "{retry}: {wait}");
                assert_eq!(wait, backoff_s(&settings, retry, Seed::new(seed)));
            }
        }
        assert_ne!(backoff_s(&settings, 0, Seed::new(1)), backoff_s(&settings, 0, Seed::new(2)));
    }

    #[test]
    fn retry_after() {
        let date = Some("Sun, 06 Nov 1994 08:49:37 GMT");
        for (header, expected) in [
            (None, None),
            (Some("2"), Some(2.0)),
            (Some(" 0.25 "), Some(0.25)),
            (Some("-1"), None),
            (Some("NaN"), None),
            (Some("inf"), None),
            (Some("soon"), None),
            (Some("Sun, 06 Nov 1994 08:50:00 GMT"), Some(23.0)),
            (Some("Mon, 01 Mar 2004 08:49:37 GMT"), Some(294_019_200.0)),
            (Some("Sun, 06 Nov 1994 08:00:00 GMT"), Some(0.0)),
            (Some("Sun, 06 Foo 1994 08:00:00 GMT"), None),
            (Some("Sun, 99 Nov 99999999999999999999 08:00:00 GMT"), None),
        ] {
            assert_eq!(retry_after_s(header, date), expected, "{header:?}");
        }
        assert_eq!(retry_after_s(Some("Sun, 06 Nov 1994 08:50:00 GMT"), None), None);
    }
}
