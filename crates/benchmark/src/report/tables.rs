//! HTML of tables, bars and numbers.

use genmanip_core::{Measurement, Unit};

use crate::statistics::{FailureCount, Mean, Rate};
use genmanip_viz::markup::escape;

/// A table in a box that scrolls sideways on narrow screens; cells are markup, the first column is a row heading.
pub(crate) fn table(class: &str, headings: &[&str], rows: &[Vec<String>]) -> String {
    let head: String = headings.iter().map(|heading| format!("<th scope=\"col\">{}</th>", escape(heading))).collect();
    let body: String = rows
        .iter()
        .map(|cells| {
            let cells: String = cells
                .iter()
                .enumerate()
                .map(|(column, cell)| match column {
                    0 => format!("<th scope=\"row\">{cell}</th>"),
                    _ => format!("<td>{cell}</td>"),
                })
                .collect();
            format!("<tr>{cells}</tr>\n")
        })
        .collect();
    format!(
        "<div class=\"scroll\"><table class=\"{class}\">\n<thead><tr>{head}</tr></thead>\n<tbody>\n{body}</tbody>\n</table></div>\n"
    )
}

/// A rate as a bar with its interval, and in figures.
pub(crate) fn rate_bar(rate: &Rate) -> String {
    if rate.trials == 0 {
        return "<span class=\"muted\">no trials</span>".into();
    }
    let percent = |share: f64| format!("{:.1}", 100.0 * share);
    format!(
        concat!(
            "<span class=\"rate\"><span class=\"bar\"><span class=\"fill\" style=\"width:{value}%\"></span>",
            "<span class=\"whisker\" style=\"left:{low}%;width:{spread}%\"></span></span>",
            "<span class=\"figure\">{value} %</span><span class=\"ci\">{low}-{high}</span></span>"
        ),
        value = percent(rate.value),
        low = percent(rate.low),
        spread = percent(rate.high - rate.low),
        high = percent(rate.high),
    )
}

/// A mean with its interval, in figures and with this unit.
pub(super) fn mean_text(mean: &Mean, decimals: usize, unit: &str) -> String {
    if mean.count == 0 {
        return "<span class=\"muted\">none</span>".into();
    }
    format!(
        "{:.decimals$}{unit} <span class=\"ci\">{:.decimals$}-{:.decimals$}</span>",
        mean.value, mean.low, mean.high
    )
}

/// Failure causes with counts, e.g. `goal missed 2, slipped 1`; `none` without failures.
pub(super) fn causes_text(counts: &[FailureCount]) -> String {
    if counts.is_empty() {
        return "<span class=\"muted\">none</span>".into();
    }
    let parts: Vec<String> =
        counts.iter().map(|entry| format!("{} {}", entry.cause.name().replace('_', " "), entry.count)).collect();
    escape(&parts.join(", "))
}

/// A value with its unit: metres as mm, radians as degrees, a fact as yes or no.
pub(super) fn quantity_text(value: f64, unit: Unit) -> String {
    if !value.is_finite() {
        return "not measured".into();
    }
    match unit {
        Unit::Metre => format!("{:.1} mm", 1000.0 * value),
        Unit::Radian => format!("{:.1}°", value.to_degrees()),
        Unit::Share => format!("{value:.3}"),
        Unit::Fact => if value > 0.0 { "yes" } else { "no" }.into(),
    }
}

/// The threshold with the direction of its comparison (≤ or ≥), inferred from the sign of the margin.
pub(super) fn threshold_text(measurement: &Measurement) -> String {
    let Measurement { value, threshold, margin, unit, .. } = *measurement;
    let at_most = ((threshold - value) - margin).abs() <= ((value - threshold) - margin).abs();
    let sign = match unit {
        Unit::Fact => "=",
        _ if at_most => "≤",
        _ => "≥",
    };
    format!("{sign} {}", quantity_text(threshold, unit))
}

/// The margin with its sign and unit; a dash for a fact, which has no margin.
pub(super) fn margin_text(measurement: &Measurement) -> String {
    let Measurement { margin, unit, .. } = *measurement;
    let sign = if margin >= 0.0 { "+" } else { "" };
    if unit == Unit::Fact { "–".into() } else { format!("{sign}{}", quantity_text(margin, unit)) }
}

/// A duration, given in s, in a readable unit.
pub(super) fn seconds_text(seconds: f64) -> String {
    match seconds {
        seconds if !seconds.is_finite() => "unknown".into(),
        seconds if seconds < 1.0 => format!("{:.0} ms", 1000.0 * seconds),
        seconds if seconds < 120.0 => format!("{seconds:.1} s"),
        seconds => format!("{} min {:02} s", seconds as u64 / 60, seconds as u64 % 60),
    }
}
