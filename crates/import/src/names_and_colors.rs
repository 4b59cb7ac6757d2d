//! Names, colour words, descriptions and shape words, derived from file names and geometry.

use genmanip_core::{Material, Piece, Shape};
use glam::DVec3;

use crate::raw::RawObject;

/// File and folder names that say nothing about the object.
const UNINFORMATIVE: [&str; 32] = [
    "textured",
    "nontextured",
    "model",
    "models",
    "mobility",
    "object",
    "objects",
    "scene",
    "mesh",
    "meshes",
    "visual",
    "collision",
    "google_16k",
    "google_64k",
    "google_512k",
    "poisson",
    "tsdf",
    "clouds",
    "untitled",
    "model_normalized",
    "base",
    "default",
    "xml",
    "urdf",
    "assets",
    "texture",
    "root",
    "rootnode",
    "root node",
    "sketchfab_model",
    "node",
    "robot",
];
/// Extensions that are removed from names: some files state their own file name as the name of the robot or model.
const FILES: [&str; 10] = ["urdf", "xml", "obj", "glb", "gltf", "dae", "usd", "usda", "usdc", "usdz"];
/// Colour words of saturated colours, by upper bound of the hue in degrees.
const HUES: [(f64, &str); 8] = [
    (15.0, "red"),
    (42.0, "orange"),
    (68.0, "yellow"),
    (165.0, "green"),
    (195.0, "cyan"),
    (258.0, "blue"),
    (295.0, "purple"),
    (340.0, "pink"),
];

/// Name of an object whose files and folders say none.
pub const NAMELESS: &str = "Thing";

/// Name of an object: from the file name, otherwise the name stated in the file (`said`), otherwise the nearest
/// informative folder name.
pub fn name(path: &str, said: &str) -> String {
    let mut parts: Vec<&str> = path.split('/').collect();
    let file = parts.pop().unwrap_or_default();
    let stem = file.rsplit_once('.').map_or(file, |(stem, _)| stem);
    // Some robots are named after their file. Libraries name objects by hashes.
    let said = said.rsplit_once('.').filter(|(_, end)| FILES.contains(end)).map_or(said, |(name, _)| name);
    let said = said.strip_prefix("partnet_").filter(|rest| is_hash(rest)).map_or(said, |_| "");
    let is_informative =
        |part: &&str| !is_uninformative(part) && !is_hash(part) && part.chars().any(char::is_alphabetic);
    let candidates = [stem, said].into_iter().chain(parts.into_iter().rev());
    title(candidates.into_iter().find(is_informative).unwrap_or(NAMELESS))
}

/// True for numbers and hashes.
fn is_hash(word: &str) -> bool {
    let has_digit = word.chars().any(|c| c.is_ascii_digit());
    let is_long = word.len() >= 12 || word.chars().all(|c| c.is_ascii_digit());
    has_digit && is_long && word.chars().all(|c| c.is_ascii_hexdigit() || c == '-')
}

fn is_uninformative(word: &str) -> bool {
    UNINFORMATIVE.contains(&word.to_lowercase().as_str())
}

/// Capitalised words without leading numbers (as in YCB), uninformative words and punctuation.
pub fn title(text: &str) -> String {
    let mut spaced = String::new();
    let mut before = ' ';
    for c in text.chars().take(60) {
        if c.is_uppercase() && before.is_lowercase() {
            spaced.push(' ');
        }
        spaced.push(if c.is_alphanumeric() { c } else { ' ' });
        before = c;
    }
    let mut words: Vec<String> = spaced.split_whitespace().map(str::to_owned).collect();
    while words.len() > 1 && words[0].chars().next().is_some_and(char::is_numeric) {
        words.remove(0);
    }
    if words.iter().any(|word| !is_uninformative(word)) {
        words.retain(|word| !is_uninformative(word));
    }
    let capital = |word: &String| {
        let mut letters = word.chars();
        letters.next().map_or_else(String::new, |first| first.to_uppercase().chain(letters).collect::<String>())
    };
    let words: Vec<String> = words.iter().map(capital).collect();
    if words.is_empty() { NAMELESS.into() } else { words.join(" ") }
}

/// Lower-case letters and digits joined by hyphens, for uids.
pub fn slug(name: &str) -> String {
    let parts: Vec<String> = name
        .to_lowercase()
        .split(|c: char| !c.is_ascii_alphanumeric())
        .filter(|part| !part.is_empty())
        .map(str::to_owned)
        .collect();
    let slug: String = parts.join("-").chars().take(32).collect();
    if slug.is_empty() { "thing".into() } else { slug.trim_end_matches('-').to_owned() }
}

/// Up to three colour words of the visuals, by decreasing share of the area.
pub fn colors(raw: &RawObject) -> Vec<String> {
    let mut shares: Vec<(&str, f64)> = Vec::new();
    for surface in raw.links.iter().flat_map(|link| &link.surfaces) {
        let area: f64 = surface.mesh.corners().map(|[a, b, c]| (b - a).cross(c - a).length() / 2.0).sum();
        for (word, share) in of_material(&surface.material) {
            match shares.iter_mut().find(|(known, _)| *known == word) {
                Some((_, sum)) => *sum += area * share,
                None => shares.push((word, area * share)),
            }
        }
    }
    let total: f64 = shares.iter().map(|(_, share)| share).sum();
    shares.sort_by(|a, b| b.1.total_cmp(&a.1));
    shares.iter().filter(|(_, share)| *share > 0.15 * total).take(3).map(|(word, _)| (*word).to_owned()).collect()
}

/// Colour words of a material with their shares.
fn of_material(material: &Material) -> Vec<(&'static str, f64)> {
    let tint = material.base_color;
    let Some(texture) = &material.texture else { return vec![(color_word(tint), 1.0)] };
    let pixels = texture.rgb.len() / 3;
    // A few thousand pixels determine the colour of a texture.
    let step = (pixels / 4096).max(1);
    let mut counts: Vec<(&str, f64)> = Vec::new();
    for pixel in texture.rgb.chunks_exact(3).step_by(step) {
        let word = color_word([0, 1, 2].map(|i| tint[i] * f32::from(pixel[i]) / 255.0));
        match counts.iter_mut().find(|(known, _)| *known == word) {
            Some((_, count)) => *count += 1.0,
            None => counts.push((word, 1.0)),
        }
    }
    let total: f64 = counts.iter().map(|(_, count)| count).sum::<f64>().max(1.0);
    counts.into_iter().map(|(word, count)| (word, count / total)).collect()
}

/// Colour word of an sRGB colour.
pub fn color_word(color: [f32; 3]) -> &'static str {
    let [r, g, b] = color.map(f64::from);
    let (most, least) = (r.max(g).max(b), r.min(g).min(b));
    let spread = most - least;
    if spread < 0.12 || spread < 0.16 * most {
        return match most {
            most if most < 0.22 => "black",
            most if most > 0.82 => "white",
            _ => "grey",
        };
    }
    let hue = 60.0
        * match () {
            () if most == r => ((g - b) / spread).rem_euclid(6.0),
            () if most == g => (b - r) / spread + 2.0,
            () => (r - g) / spread + 4.0,
        };
    let word = HUES.iter().find(|(end, _)| hue < *end).map_or("red", |(_, word)| *word);
    match word {
        "orange" | "red" | "yellow" if most < 0.62 && (10.0..60.0).contains(&hue) => "brown",
        "yellow" | "orange" if spread < 0.4 && most > 0.75 => "beige",
        _ if most < 0.15 => "black",
        word => word,
    }
}

/// One-sentence description: `An imported red and white box-shaped tea box, 8 cm tall.`
pub fn description(noun: &str, colors: &[String], shape: &str, size: DVec3) -> String {
    let colors = if colors.is_empty() { "grey".to_owned() } else { colors.join(" and ") };
    let shape = match shape {
        // "compact" says nothing about an object.
        "compact" => String::new(),
        "box" if noun.contains("box") => String::new(),
        "box" => "box-shaped ".into(),
        "cylinder" => "cylindrical ".into(),
        other if noun.contains(other) => String::new(),
        other => format!("{other} "),
    };
    let wide = size.x.max(size.y);
    let (longest, dimension) = match () {
        () if size.z > wide => (size.z, "tall"),
        () if wide > 1.5 * size.x.min(size.y) => (wide, "long"),
        () => (wide, "wide"),
    };
    let millimetres = (longest * 1e3).round();
    if millimetres < 100.0 {
        return format!("An imported {colors} {shape}{noun}, {millimetres} mm {dimension}.");
    }
    format!("An imported {colors} {shape}{noun}, {} cm {dimension}.", (longest * 100.0).round())
}

/// Shape of an object in one or two words.
pub fn shape(size: DVec3, pieces: &[Piece], is_hollow: bool) -> String {
    if let [piece] = pieces {
        match piece.shape {
            Shape::Box { .. } => return "box".into(),
            Shape::Cylinder { .. } => return "cylinder".into(),
            Shape::Sphere { .. } | Shape::Ellipsoid { .. } => return "round".into(),
            _ => {}
        }
    }
    let wide = size.x.max(size.y);
    match () {
        () if is_hollow => "hollow".into(),
        () if size.z > 1.8 * wide => "tall".into(),
        () if wide > 3.0 * size.z && wide > 3.0 * size.x.min(size.y) => "long".into(),
        () if wide > 3.0 * size.z => "flat".into(),
        () => "compact".into(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_come_from_files_or_folders() {
        for (path, said, expected) in [
            ("ycb/002_master_chef_can/google_16k/textured.obj", "", "Master Chef Can"),
            ("can.xml", "", "Can"),
            ("can-visual.xml", "", "Can"),
            ("base_link.stl", "", "Link"),
            ("partnet/45132/mobility.urdf", "StorageFurniture", "StorageFurniture"),
            ("a/redMug-3.glb", "", "Red Mug 3"),
            ("model.obj", "", "Thing"),
            ("SteelBolt/model.urdf", "model.urdf", "Steel Bolt"),
            ("RedMug/model.urdf", "mug.urdf", "Mug"),
            ("bottles/3f2a9c81b7e04d55/model.obj", "", "Bottles"),
            ("bottle/mobility.urdf", "partnet_3f2a9c81b7e04d55", "Bottle"),
            ("can-2048/model.obj", "", "Can 2048"),
        ] {
            assert_eq!(name(path, said).replace(' ', ""), expected.replace(' ', ""), "{path}");
        }
        assert_eq!(slug("Master Chef Can/#"), "master-chef-can");
    }

    #[test]
    fn descriptions_are_sentences() {
        for (noun, colors, shape, size, expected) in [
            (
                "food tin",
                &["red"][..],
                "cylinder",
                [0.05, 0.05, 0.08],
                "An imported red cylindrical food tin, 80 mm tall.",
            ),
            (
                "cereal box",
                &["orange", "white"],
                "box",
                [0.1, 0.03, 0.15],
                "An imported orange and white cereal box, 15 cm tall.",
            ),
            ("hammer", &[], "long", [0.35, 0.1, 0.07], "An imported grey long hammer, 35 cm long."),
            ("mug", &["white"], "hollow", [0.08, 0.07, 0.066], "An imported white hollow mug, 80 mm wide."),
            ("ball", &["black"], "round", [0.05, 0.05, 0.05], "An imported black round ball, 50 mm wide."),
        ] {
            let colors: Vec<String> = colors.iter().map(|color| (*color).to_owned()).collect();
            assert_eq!(description(noun, &colors, shape, DVec3::from_array(size)), expected);
        }
    }

    #[test]
    fn colours_have_their_usual_words() {
        for (color, word) in [
            ([0.8, 0.1, 0.1], "red"),
            ([0.9, 0.5, 0.1], "orange"),
            ([0.4, 0.25, 0.1], "brown"),
            ([0.1, 0.6, 0.2], "green"),
            ([0.1, 0.2, 0.8], "blue"),
            ([0.95, 0.95, 0.93], "white"),
            ([0.5, 0.5, 0.5], "grey"),
            ([0.05, 0.05, 0.06], "black"),
            ([0.9, 0.85, 0.2], "yellow"),
        ] {
            assert_eq!(color_word(color), word, "{color:?}");
        }
    }
}
