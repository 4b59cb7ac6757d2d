//! Line chart as inline SVG, legible on light and dark pages.

use std::fmt::Write;

use genmanip_viz::markup::escape;

/// A line of a chart.
#[derive(Clone, Debug)]
pub struct Line {
    /// Name in the legend; empty for the only line of a chart.
    pub name: String,
    /// Points (x, y), ordered by x; points that are not finite are omitted, and the line connects their neighbours.
    pub points: Vec<[f64; 2]>,
    /// True to dash the line and give it the colour of the previous one, e.g. for that line's target.
    pub is_dashed: bool,
}

/// Chart of one or more lines.
#[derive(Clone, Debug)]
pub struct LineChart {
    /// Caption with the unit of the y values.
    pub caption: String,
    /// Name of the horizontal axis, with its unit.
    pub over: String,
    /// True for a logarithmic vertical axis; points with y ≤ 0 are then omitted.
    pub is_logarithmic: bool,
    /// Lines, in order of their colours.
    pub lines: Vec<Line>,
}

/// Width and height of the plot area, and its distances from the left and upper edge of the figure, px.
const PLOT: [f64; 4] = [420.0, 180.0, 62.0, 12.0];
/// Line colours that are legible on light and dark pages.
const COLORS: [&str; 6] = ["#0f9a8f", "#d97706", "#7c6fd6", "#d1495b", "#3b82c4", "#6b9a3a"];
/// Number of intervals between the labels of an axis.
const INTERVALS: usize = 4;

impl LineChart {
    /// A chart of one line.
    pub fn of(caption: &str, over: &str, points: Vec<[f64; 2]>) -> Self {
        let line = Line { name: String::new(), points, is_dashed: false };
        Self { caption: caption.into(), over: over.into(), is_logarithmic: false, lines: vec![line] }
    }

    /// The chart as an HTML figure; empty if there are no points.
    pub fn figure(&self) -> String {
        let scaled = |value: f64| if self.is_logarithmic { value.log10() } else { value };
        let points = |line: &Line| -> Vec<[f64; 2]> {
            let points = line.points.iter().map(|&[x, y]| [x, scaled(y)]);
            points.filter(|point| point.iter().all(|at| at.is_finite())).collect()
        };
        let lines: Vec<Vec<[f64; 2]>> = self.lines.iter().map(points).collect();
        let all: Vec<[f64; 2]> = lines.concat();
        if all.is_empty() {
            return String::new();
        }
        let range = |axis: usize| {
            let values = all.iter().map(|point| point[axis]);
            let low = values.clone().fold(f64::INFINITY, f64::min);
            let high = values.fold(f64::NEG_INFINITY, f64::max);
            if high > low { [low, high] } else { [low - 0.5, high + 0.5] }
        };
        let [width, height, left, top] = PLOT;
        let (x_range, y_range) = (range(0), range(1));
        let share = |value: f64, [low, high]: [f64; 2]| (value - low) / (high - low);
        let x = |value: f64| left + width * share(value, x_range);
        let y = |value: f64| top + height * (1.0 - share(value, y_range));
        let mut svg = String::new();
        for step in 0..=INTERVALS {
            let at = |[low, high]: [f64; 2]| low + (high - low) * step as f64 / INTERVALS as f64;
            let (across, up) = (at(x_range), at(y_range));
            let value = if self.is_logarithmic { 10_f64.powf(up) } else { up };
            let _ = writeln!(
                svg,
                "<path d=\"M{left} {y:.1}h{width}\" stroke=\"currentColor\" opacity=\"0.15\"/>\n\
                 <text x=\"{}\" y=\"{:.1}\" text-anchor=\"end\" opacity=\"0.7\">{}</text>\n\
                 <text x=\"{:.1}\" y=\"{}\" text-anchor=\"middle\" opacity=\"0.7\">{}</text>",
                left - 6.0,
                y(up) + 4.0,
                number(value),
                x(across),
                top + height + 16.0,
                number(across),
                y = y(up),
            );
        }
        let mut legend = String::new();
        let mut solid = 0;
        for (line, points) in self.lines.iter().zip(&lines) {
            solid += usize::from(!line.is_dashed);
            let color = COLORS[solid.saturating_sub(1) % COLORS.len()];
            let path: Vec<String> = points.iter().map(|&[at, value]| format!("{:.1},{:.1}", x(at), y(value))).collect();
            let dashes = if line.is_dashed { " stroke-dasharray=\"5 4\"" } else { "" };
            let _ = writeln!(
                svg,
                "<polyline points=\"{}\" fill=\"none\" stroke=\"{color}\" stroke-width=\"1.6\"{dashes}/>",
                path.join(" ")
            );
            if !line.name.is_empty() {
                let style = if line.is_dashed { "dashed" } else { "solid" };
                let _ = writeln!(
                    legend,
                    "<span style=\"white-space:nowrap;margin-right:1.2em\"><span style=\"display:inline-block;width:1.4em;\
                     border-top:2px {style} {color};margin:0 .4em .25em 0\"></span>{}</span>",
                    escape(&line.name)
                );
            }
        }
        let (across, down) = (left + width + 24.0, top + height + 36.0);
        format!(
            "<figure><svg viewBox=\"0 0 {across} {down}\" style=\"max-width:{across}px;width:100%;font:12px sans-serif\" \
             fill=\"currentColor\" role=\"img\" aria-label=\"{caption}\">\n{svg}<text x=\"{}\" y=\"{}\" \
             text-anchor=\"middle\" opacity=\"0.7\">{}</text>\n</svg>\n<figcaption>{caption} {legend}</figcaption></figure>\n",
            left + width / 2.0,
            top + height + 32.0,
            escape(&self.over),
            caption = escape(&self.caption),
        )
    }
}

/// A number with three significant digits.
fn number(value: f64) -> String {
    let size = value.abs();
    match size {
        _ if value == 0.0 => "0".into(),
        _ if !(1e-3..1e6).contains(&size) => format!("{value:.1e}"),
        _ => {
            let decimals = (2 - size.log10().floor() as i64).clamp(0, 5) as usize;
            let text = format!("{value:.decimals$}");
            if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_are_short() {
        let cases = [
            (0.0, "0"),
            (1e-5, "1.0e-5"),
            (0.012_34, "0.0123"),
            (0.5, "0.5"),
            (-2.0, "-2"),
            (123.456, "123"),
            (1094.0, "1094"),
        ];
        for (value, expected) in cases {
            assert_eq!(number(value), expected);
        }
    }

    #[test]
    fn lines_fill_their_plot_and_impossible_values_are_left_out() {
        let chart = LineChart::of("loss <1>", "steps", vec![[0.0, 1.0], [5.0, f64::NAN], [10.0, 3.0]]);
        let figure = chart.figure();
        assert!(figure.contains("points=\"62.0,192.0 482.0,12.0\""), "{figure}");
        assert!(figure.contains("loss &lt;1&gt;") && !figure.contains("NaN"), "{figure}");
        let logarithmic = LineChart { is_logarithmic: true, ..LineChart::of("", "", vec![[0.0, 0.0], [1.0, -1.0]]) };
        assert_eq!(logarithmic.figure(), "");
        // One point has a range of its own.
        assert!(LineChart::of("", "", vec![[1.0, 2.0]]).figure().contains("272.0,102.0"));
    }
}
