//! Scatter plot of simulation against reality, as SVG.

use std::fmt::Write;

use genmanip_viz::markup::escape;

use super::measure::Agreement;

/// Side length of the square plot area, SVG pixels.
const SIDE: f64 = 320.0;
/// Margin around the plot area for axes and their names, SVG pixels.
const MARGIN: f64 = 60.0;
/// Width of the policies' names to the right of the plot area, SVG pixels.
const NAMES: f64 = 120.0;

/// Scatter plot of the policies: success rate in simulation to the right, in reality upwards. The diagonal is perfect
/// agreement.
pub fn figure(agreement: &Agreement, measure: &str) -> String {
    let (width, height) = (SIDE + 2.0 * MARGIN + NAMES, SIDE + 2.0 * MARGIN);
    let x = |rate: f64| MARGIN + rate * SIDE;
    let y = |rate: f64| MARGIN + (1.0 - rate) * SIDE;
    let mut svg = format!(
        concat!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" font-family=\"sans-serif\" ",
            "font-size=\"12\">\n<rect width=\"{width}\" height=\"{height}\" fill=\"#fff\"/>\n",
            "<rect x=\"{margin}\" y=\"{margin}\" width=\"{side}\" height=\"{side}\" fill=\"none\" stroke=\"#888\"/>\n",
            "<line x1=\"{left}\" y1=\"{bottom}\" x2=\"{right}\" y2=\"{top}\" stroke=\"#bbb\" stroke-dasharray=\"4 4\"/>\n"
        ),
        width = width,
        height = height,
        margin = MARGIN,
        side = SIDE,
        left = x(0.0),
        right = x(1.0),
        bottom = y(0.0),
        top = y(1.0),
    );
    for step in 0..=4 {
        let rate = f64::from(step) / 4.0;
        let label = format!("{:.0} %", 100.0 * rate);
        let (across, down) = (x(rate), y(rate));
        let _ = writeln!(svg, "<text x=\"{across}\" y=\"{}\" text-anchor=\"middle\">{label}</text>", y(0.0) + 18.0);
        let _ = writeln!(svg, "<text x=\"{}\" y=\"{}\" text-anchor=\"end\">{label}</text>", x(0.0) - 6.0, down + 4.0);
    }
    let measure = escape(measure);
    let (middle, below) = (x(0.5), y(0.0) + 40.0);
    let _ = writeln!(svg, "<text x=\"{middle}\" y=\"{below}\" text-anchor=\"middle\">{measure} in simulation</text>");
    let _ = writeln!(svg, "<text x=\"{}\" y=\"{}\">{measure} in reality</text>", x(0.0), y(1.0) - 12.0);
    for policy in &agreement.policies {
        let (across, down) = (x(policy.sim), y(policy.real));
        let _ = writeln!(svg, "<circle cx=\"{across:.1}\" cy=\"{down:.1}\" r=\"4\" fill=\"#2563eb\"/>");
        let _ =
            writeln!(svg, "<text x=\"{:.1}\" y=\"{:.1}\">{}</text>", across + 7.0, down + 4.0, escape(&policy.policy));
    }
    svg + "</svg>\n"
}
