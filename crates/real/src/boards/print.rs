//! Boards as SVG pages to print.

use std::fmt::Write;

use genmanip_core::glam::DVec2;

use super::layout::Layout;

/// Minimum white border around the pattern, mm. Chosen by hand.
pub const BORDER_MM: f64 = 5.0;

/// SVG page of width and height in mm with the board in its middle and a caption below; `None` if the page is too
/// small.
pub fn svg(layout: &Layout, page_mm: DVec2, caption: &str) -> Option<String> {
    let size_mm = layout.size_m * 1e3;
    let at = (page_mm - size_mm) / 2.0;
    if at.min_element() < BORDER_MM {
        return None;
    }
    // All black areas form one path, so that adjacent rectangles join without a seam.
    let mut path = String::new();
    for piece in layout.dark() {
        let (from, size) = (at + piece.at * 1e3, piece.size * 1e3);
        let _ = write!(path, "M{:.4} {:.4}h{:.4}v{:.4}h{:.4}z", from.x, from.y, size.x, size.y, -size.x);
    }
    let DVec2 { x: width, y: height } = page_mm;
    let below = at.y + size_mm.y + 4.0;
    Some(format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}mm\" height=\"{height}mm\" \
         viewBox=\"0 0 {width} {height}\">\n<rect width=\"{width}\" height=\"{height}\" fill=\"white\"/>\n\
         <path fill=\"black\" d=\"{path}\"/>\n\
         <text x=\"{:.4}\" y=\"{below:.4}\" font-family=\"sans-serif\" font-size=\"3\">{caption}</text>\n</svg>\n",
        at.x
    ))
}
