//! What is implausible about objects: weight, friction, size, pictures, surfaces, and differences between sources.

use genmanip_assets::Catalogue;
use genmanip_core::{AssetRef, ObjectModel};
use genmanip_import::collision::piece_volume;
use serde::Serialize;
use std::collections::BTreeMap;

use crate::assets;
use crate::error::RunError;
use crate::progress::Progress;

/// Mean densities that household things have, kg/m³: from foam and empty cartons to solid brass.
const DENSITY: [f64; 2] = [25.0, 9000.0];
/// Sliding friction coefficients between dry household surfaces.
const FRICTION: [f64; 2] = [0.2, 1.1];
/// Longest side of what stands on a table, m.
const LONGEST_M: [f64; 2] = [0.015, 0.45];
/// Pixels of a texture's longer side.
const PIXELS: [u32; 2] = [16, 1024];
/// Roughness: a mirror below, nothing above.
const ROUGHNESS: [f32; 2] = [0.02, 1.0];
/// Reflectance at normal incidence of what is no metal; 0.02 is water, 0.17 is diamond.
const REFLECTANCE: [f64; 2] = [0.02, 0.17];
/// Factor by which the mean density of a category may differ between sources.
const SOURCES_APART: f64 = 3.0;

/// Something implausible.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Finding {
    /// Uid of the object, or the category where sources differ.
    pub uid: String,
    /// Name of the object.
    pub name: String,
    /// Which quantity.
    pub what: String,
    /// What it is.
    pub got: String,
    /// What is plausible.
    pub expected: String,
}

/// Looks at every object of a catalogue.
///
/// # Errors
/// When an object cannot be built.
pub fn audit(catalogue: &Catalogue, progress: &dyn Progress) -> Result<Vec<Finding>, RunError> {
    let mut findings = Vec::new();
    // By category: densities of built-in and of other objects.
    let mut densities: BTreeMap<&str, [Vec<f64>; 2]> = BTreeMap::new();
    progress.begin("auditing", catalogue.cards().len());
    for card in catalogue.cards() {
        let model = assets::model(catalogue, &card.uid)?;
        findings.extend(of_object(&model));
        let source = usize::from(!matches!(card.asset, AssetRef::Builtin { .. }));
        densities.entry(&card.category).or_default()[source].push(density(&model));
        progress.advance();
    }
    progress.end();
    for (category, sources) in &densities {
        let mean = |values: &Vec<f64>| values.iter().sum::<f64>() / values.len().max(1) as f64;
        let [own, other] = [mean(&sources[0]), mean(&sources[1])];
        if own > 0.0 && other > 0.0 && (own / other).max(other / own) > SOURCES_APART {
            findings.push(Finding {
                uid: (*category).to_owned(),
                name: format!("all of category {category}"),
                what: "mean density of built-in and of other objects".into(),
                got: format!("{own:.0} and {other:.0} kg/m³"),
                expected: format!("less than {SOURCES_APART} times apart"),
            });
        }
    }
    Ok(findings)
}

/// What is implausible about one object.
pub fn of_object(model: &ObjectModel) -> Vec<Finding> {
    let mut findings = Vec::new();
    let mut check = |what: &str, got: f64, [low, high]: [f64; 2], unit: &str| {
        if !(low..=high).contains(&got) {
            findings.push(Finding {
                uid: model.card.uid.clone(),
                name: model.card.name.clone(),
                what: what.to_owned(),
                got: format!("{got:.3}{unit}"),
                expected: format!("{low} to {high}{unit}"),
            });
        }
    };
    check("density", density(model), DENSITY, " kg/m³");
    check("friction", model.friction, FRICTION, "");
    check("longest side", model.card.size_m.max_element(), LONGEST_M, " m");
    for part in model.links.iter().flat_map(|link| &link.visual) {
        let material = &part.material;
        if let Some(texture) = &material.texture {
            let longer = f64::from(texture.width.max(texture.height));
            check(&format!("texture of {}", part.name), longer, PIXELS.map(f64::from), " pixels");
        }
        check(&format!("roughness of {}", part.name), material.roughness.into(), ROUGHNESS.map(f64::from), "");
        if material.metallic == 0.0 {
            let ior = f64::from(material.ior);
            let reflectance = ((ior - 1.0) / (ior + 1.0)).powi(2);
            check(&format!("reflectance of {}", part.name), reflectance, REFLECTANCE, "");
        }
    }
    findings
}

/// Mass over the volume of the collision pieces, kg/m³.
fn density(model: &ObjectModel) -> f64 {
    let volume: f64 = model.links.iter().flat_map(|link| &link.pieces).map(piece_volume).sum();
    model.card.mass_kg / volume.max(1e-9)
}
