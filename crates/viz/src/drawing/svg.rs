//! Minimal SVG writer.

use std::fmt::Write;

use super::colors::INK;
use crate::markup::escape;

/// Finished diagram. Only this crate creates one, with all text escaped, so that it can be embedded in HTML unchanged.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Svg(String);

impl Svg {
    /// Text of the SVG file.
    pub fn as_str(&self) -> &str {
        &self.0
    }

    /// Text of the SVG file.
    pub fn into_string(self) -> String {
        self.0
    }
}

impl std::fmt::Display for Svg {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.0)
    }
}

/// Point on the page, px: x to the right, y down.
pub type Point = [f64; 2];

/// Rectangle on the page, px: x to the right, y down from the upper left corner.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Area {
    pub x: f64,
    pub y: f64,
    pub width: f64,
    pub height: f64,
}

impl Area {
    pub fn around(center: Point, width: f64, height: f64) -> Self {
        Self { x: center[0] - width / 2.0, y: center[1] - height / 2.0, width, height }
    }

    pub fn center(&self) -> Point {
        [self.x + self.width / 2.0, self.y + self.height / 2.0]
    }

    pub fn grown(&self, by: f64) -> Self {
        Self { x: self.x - by, y: self.y - by, width: self.width + 2.0 * by, height: self.height + 2.0 * by }
    }

    pub fn contains(&self, point: Point) -> bool {
        (self.x..=self.x + self.width).contains(&point[0]) && (self.y..=self.y + self.height).contains(&point[1])
    }

    pub fn overlaps(&self, other: &Self) -> bool {
        self.x < other.x + other.width
            && other.x < self.x + self.width
            && self.y < other.y + other.height
            && other.y < self.y + self.height
    }

    pub fn within(&self, other: &Self) -> bool {
        other.contains([self.x, self.y]) && other.contains([self.x + self.width, self.y + self.height])
    }

    pub fn shifted(&self, by: Point) -> Self {
        Self { x: self.x + by[0], y: self.y + by[1], ..*self }
    }
}

/// Upper bound of a text's width, px, for the widest of the common system fonts; `size` is the font size, px.
pub fn text_width(text: &str, size: f64) -> f64 {
    let em = |character: char| match character {
        'i' | 'j' | 'l' | 'I' | '.' | ',' | ':' | ';' | '\'' | '|' | ' ' => 0.34,
        'f' | 't' | 'r' | '(' | ')' | '[' | ']' | '/' | '-' => 0.43,
        'm' | 'w' | 'M' | 'W' | '@' | '%' => 0.97,
        'A'..='Z' => 0.72,
        character if character.is_ascii() => 0.62,
        character if (character as u32) < 0x2e80 => 0.72,
        _ => 1.05,
    };
    text.chars().map(em).sum::<f64>() * size
}

/// Width of semi-bold text relative to regular text.
pub const BOLD: f64 = 1.1;

/// Breaks a text into at most `lines` lines of about `width` px each; an ellipsis replaces what does not fit.
pub fn wrap(text: &str, size: f64, width: f64, lines: usize) -> Vec<String> {
    let mut wrapped: Vec<String> = Vec::new();
    for word in text.split_whitespace() {
        match wrapped.last_mut() {
            Some(line) if text_width(line, size) + text_width(" ", size) + text_width(word, size) <= width => {
                line.push(' ');
                line.push_str(word);
            }
            _ => wrapped.push(word.to_owned()),
        }
    }
    let cut = wrapped.len() > lines;
    wrapped.truncate(lines);
    let count = wrapped.len();
    for (index, line) in wrapped.iter_mut().enumerate() {
        let must_end = cut && index + 1 == count;
        let room = width.max(size * 4.0) * 1.35;
        if must_end || text_width(line, size) > room {
            while text_width(line, size) + size > room && line.pop().is_some() {}
            line.push('…');
        }
    }
    wrapped
}

/// Horizontal alignment of a text at its position.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Anchor {
    Start,
    Middle,
}

/// Diagram under construction.
#[derive(Default)]
pub struct Canvas {
    body: String,
}

impl Canvas {
    /// Adds a rectangle with rounded corners; `style` holds further SVG attributes.
    pub fn rect(&mut self, area: &Area, radius: f64, style: &str) {
        let _ = writeln!(
            self.body,
            r#"<rect x="{}" y="{}" width="{}" height="{}" rx="{}" {style}/>"#,
            px(area.x),
            px(area.y),
            px(area.width),
            px(area.height),
            px(radius)
        );
    }

    /// Adds a circle; `style` holds further SVG attributes.
    pub fn circle(&mut self, center: Point, radius: f64, style: &str) {
        let (x, y) = (px(center[0]), px(center[1]));
        let _ = writeln!(self.body, r#"<circle cx="{x}" cy="{y}" r="{}" {style}/>"#, px(radius));
    }

    /// Adds a line through points, closed or open; `style` holds further SVG attributes.
    pub fn polyline(&mut self, points: &[Point], closed: bool, style: &str) {
        let tag = if closed { "polygon" } else { "polyline" };
        let points: Vec<String> = points.iter().map(|point| format!("{},{}", px(point[0]), px(point[1]))).collect();
        let _ = writeln!(self.body, r#"<{tag} points="{}" {style}/>"#, points.join(" "));
    }

    /// Adds a line through points with an arrow head at the last one.
    pub fn arrow(&mut self, points: &[Point], color: &str, width: f64, dashed: bool) {
        let [.., before, tip] = points else { return };
        let (dx, dy) = (tip[0] - before[0], tip[1] - before[1]);
        let length = dx.hypot(dy).max(1e-6);
        let (ux, uy) = (dx / length, dy / length);
        let base = [tip[0] - 9.0 * ux, tip[1] - 9.0 * uy];
        let mut shaft: Vec<Point> = points[..points.len() - 1].to_vec();
        shaft.retain(|point| (point[0] - tip[0]).hypot(point[1] - tip[1]) > 9.0);
        shaft.push(base);
        let dash = if dashed { r#" stroke-dasharray="5 4""# } else { "" };
        let style = format!(
            r#"fill="none" stroke="{color}" stroke-width="{}" stroke-linecap="round" stroke-linejoin="round"{dash}"#,
            px(width)
        );
        self.polyline(&shaft, false, &style);
        let head = [*tip, [base[0] - 4.2 * uy, base[1] + 4.2 * ux], [base[0] + 4.2 * uy, base[1] - 4.2 * ux]];
        self.polyline(&head, true, &format!(r#"fill="{color}""#));
    }

    /// Adds another diagram with its upper left corner at a point (px).
    pub fn group(&mut self, at: Point, other: Self) {
        let _ = writeln!(self.body, r#"<g transform="translate({} {})">"#, px(at[0]), px(at[1]));
        self.body += &other.body;
        self.body += "</g>\n";
    }

    /// Adds a text whose baseline is at a point; `style` holds further SVG attributes.
    pub fn text(&mut self, at: Point, size: f64, anchor: Anchor, style: &str, text: &str) {
        let anchor = match anchor {
            Anchor::Start => "",
            Anchor::Middle => r#" text-anchor="middle""#,
        };
        let (x, y, size) = (px(at[0]), px(at[1]), px(size));
        let _ =
            writeln!(self.body, r#"<text x="{x}" y="{y}" font-size="{size}"{anchor} {style}>{}</text>"#, escape(text));
    }

    /// Adds a short text, centred on a background plate that hides lines behind it; `ground` is the plate's colour.
    pub fn plate(&mut self, area: &Area, size: f64, [color, ground]: [&str; 2], text: &str) {
        self.rect(area, 4.0, &format!(r#"fill="{ground}" fill-opacity="0.92""#));
        let center = area.center();
        let style = format!(r#"fill="{color}" font-weight="600""#);
        self.text([center[0], center[1] + size * 0.35], size, Anchor::Middle, &style, text);
    }

    /// Text of the file with a white background; screen readers read `title`.
    pub fn finish(self, width: f64, height: f64, title: &str) -> Svg {
        let title = escape(title);
        Svg(format!(
            concat!(
                r#"<svg xmlns="http://www.w3.org/2000/svg" role="img" width="{w}" height="{h}" viewBox="0 0 {w} {h}" "#,
                r#"style="max-width:100%;height:auto;min-width:{least}px" "#,
                r#"font-family="system-ui, -apple-system, 'Segoe UI', Roboto, 'DejaVu Sans', sans-serif" fill="{ink}">"#,
                "\n<title>{title}</title>\n",
                r##"<rect width="{w}" height="{h}" fill="#ffffff"/>"##,
                "\n{body}</svg>\n"
            ),
            w = px(width.ceil()),
            h = px(height.ceil()),
            // On a narrow page the diagram shrinks to 78 % at most, beyond which its frame scrolls, so that text stays
            // readable.
            least = px((width * 0.78).floor()),
            ink = INK,
            title = title,
            body = self.body
        ))
    }
}

/// Number rounded to at most one decimal.
fn px(value: f64) -> String {
    let rounded = (value * 10.0).round() / 10.0;
    if rounded == rounded.trunc() { format!("{}", rounded as i64) } else { format!("{rounded:.1}") }
}
