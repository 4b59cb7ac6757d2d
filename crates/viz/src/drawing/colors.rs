//! Colours of the diagrams.

/// Lines and text of the initial scene.
pub const INK: &str = "#1f2937";
/// Secondary text.
pub const MUTED: &str = "#64748b";
/// Lines of the initial graph's edges.
pub const INITIAL: &str = "#475569";
/// Lines and text of goals.
pub const GOAL: &str = "#b45309";
/// Lines and text of errors and conflicts.
pub const CONFLICT: &str = "#b91c1c";
/// Thin lines around and between groups.
pub const HAIRLINE: &str = "#cbd5e1";
/// Background of a group.
pub const WASH: &str = "#f8fafc";
/// Background of a goal.
pub const GOAL_WASH: &str = "#fffbeb";

/// sRGB colour of a colour word of the catalogue; grey for an unknown word.
///
/// ```
/// assert_eq!(genmanip_viz::drawing::color_of_word("red"), [200, 55, 48]);
/// ```
pub fn color_of_word(word: &str) -> [u8; 3] {
    match word.to_ascii_lowercase().as_str() {
        "red" => [200, 55, 48],
        "orange" => [235, 134, 38],
        "amber" => [217, 150, 30],
        "gold" | "golden" => [212, 170, 60],
        "yellow" => [240, 205, 60],
        "green" => [76, 145, 72],
        "turquoise" => [64, 178, 172],
        "blue" => [52, 98, 190],
        "purple" => [125, 78, 160],
        "pink" => [233, 140, 170],
        "brown" => [140, 95, 60],
        "beige" => [222, 203, 170],
        "cream" => [243, 231, 204],
        "white" => [250, 250, 250],
        "silver" => [192, 197, 204],
        "transparent" => [222, 236, 242],
        "grey" | "gray" => [140, 145, 152],
        "black" => [40, 42, 46],
        _ => [160, 165, 172],
    }
}

/// Hexadecimal notation `#rrggbb` of an sRGB colour.
pub fn hex(color: [u8; 3]) -> String {
    format!("#{:02x}{:02x}{:02x}", color[0], color[1], color[2])
}
