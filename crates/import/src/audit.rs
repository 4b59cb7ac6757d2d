//! Plausibility audit of objects: density, friction, size, textures, materials, and differences between sources.

use crate::collision::piece_volume;
use genmanip_assets::Catalogue;
use genmanip_core::{AssetRef, AssetUid, ObjectModel};
use serde::Serialize;
use std::collections::BTreeMap;

use genmanip_viz::object_images;
use genmanip_workspace::Progress;
use genmanip_workspace::WorkspaceError;

/// Plausible mean densities of household objects, kg/m³: from foam and empty cartons to solid brass.
const DENSITY: [f64; 2] = [25.0, 9000.0];
/// Plausible sliding friction coefficients between dry household surfaces.
const FRICTION: [f64; 2] = [0.2, 1.1];
/// Plausible longest side of a tabletop object, m.
const LONGEST_SIDE_M: [f64; 2] = [0.015, 0.45];
/// Plausible texture sizes: pixels along the longer side.
const PIXELS: [u32; 2] = [16, 1024];
/// Plausible roughness; a surface below the minimum would be a mirror.
const ROUGHNESS: [f32; 2] = [0.02, 1.0];
/// Plausible reflectance at normal incidence of dielectrics; 0.02 is water, 0.17 is diamond.
const REFLECTANCE: [f64; 2] = [0.02, 0.17];
/// Quantities compared between sources: name, unit, and maximum factor between the means of one category. Chosen by
/// hand: densities of breads differ by a factor of three at most, and an object twice as large is a different object.
const COMPARED: [(&str, &str, f64); 4] =
    [("density", " kg/m³", 3.0), ("longest side", " m", 2.5), ("friction", "", 2.0), ("roughness", "", 4.0)];

/// A value outside the plausible range.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Finding {
    /// Uid of the object, or the category for a difference between sources.
    #[serde(rename = "uid")]
    pub subject: String,
    /// Name of the object.
    pub name: String,
    /// Quantity, e.g. the density.
    pub what: String,
    /// Actual value with its unit.
    pub got: String,
    /// Plausible range with its unit.
    pub expected: String,
    /// Uids of example objects: the object itself, or one per source for a difference between sources.
    pub shown_by: Vec<AssetUid>,
}

/// Values of one object, in the order of [`COMPARED`].
type Measures = [f64; COMPARED.len()];

/// Uids with their values, by source.
type BySource<'a> = BTreeMap<String, Vec<(&'a AssetUid, Measures)>>;

/// Audits every object of a catalogue.
///
/// # Errors
/// If an object cannot be built.
pub fn audit(catalogue: &Catalogue, progress: &dyn Progress) -> Result<Vec<Finding>, WorkspaceError> {
    let mut findings = Vec::new();
    // Values of the objects by category, to compare their sources.
    let mut measured: BTreeMap<&str, BySource> = BTreeMap::new();
    progress.begin("auditing", catalogue.cards().len());
    for card in catalogue.cards() {
        let model = object_images::model(catalogue, &card.uid)?;
        findings.extend(of_object(&model));
        let of_source = measured.entry(&card.category).or_default().entry(source(&card.asset)).or_default();
        of_source.push((&card.uid, measures(&model)));
        progress.advance();
    }
    progress.end();
    findings.extend(measured.iter().flat_map(|(category, sources)| between_sources(category, sources)));
    Ok(findings)
}

/// Source of an object: the hand-written catalogue, procedural families, or an import.
fn source(asset: &AssetRef) -> String {
    match asset {
        AssetRef::Builtin { .. } => "made by hand".into(),
        AssetRef::Generated { .. } => "families".into(),
        AssetRef::Imported { .. } => "imported".into(),
    }
}

/// Differences between the sources of one category: for each quantity, the two sources that are farthest apart.
fn between_sources(category: &str, sources: &BySource) -> Vec<Finding> {
    let compare = |(quantity, (what, unit, factor)): (usize, &(&str, &str, f64))| {
        let mean = |(source, objects): (&String, &Vec<(&AssetUid, Measures)>)| {
            let mean = objects.iter().map(|(_, measures)| measures[quantity]).sum::<f64>() / objects.len() as f64;
            // The object closest to the mean is the example of its source.
            let off = |measures: &Measures| (measures[quantity] - mean).abs();
            let typical = objects.iter().min_by(|a, b| off(&a.1).total_cmp(&off(&b.1)))?.0;
            Some((source.clone(), mean, typical.clone()))
        };
        let mut means: Vec<_> = sources.iter().filter_map(mean).filter(|(_, mean, _)| *mean > 0.0).collect();
        means.sort_by(|a, b| a.1.total_cmp(&b.1));
        let ((low, least, small), (high, most, large)) = (means.first()?, means.last()?);
        (most / least > *factor).then(|| Finding {
            subject: category.to_owned(),
            name: format!("all of category {category}"),
            what: format!("mean {what} of {low} and {high}"),
            got: format!("{least:.3} and {most:.3}{unit}"),
            expected: format!("at most {factor} times apart"),
            shown_by: vec![small.clone(), large.clone()],
        })
    };
    COMPARED.iter().enumerate().filter_map(compare).collect()
}

/// Density (kg/m³), longest side (m), friction, and mean roughness of the visual parts.
fn measures(model: &ObjectModel) -> Measures {
    let parts: Vec<f64> =
        model.links.iter().flat_map(|link| &link.visual).map(|part| part.material.roughness.into()).collect();
    let roughness = parts.iter().sum::<f64>() / parts.len().max(1) as f64;
    [density(model), model.card.size_m.max_element(), model.friction, roughness]
}

/// Implausible values of one object.
pub fn of_object(model: &ObjectModel) -> Vec<Finding> {
    let mut findings = Vec::new();
    let mut check = |what: &str, got: f64, [low, high]: [f64; 2], unit: &str| {
        if !(low..=high).contains(&got) {
            findings.push(Finding {
                subject: model.card.uid.to_string(),
                name: model.card.name.clone(),
                what: what.to_owned(),
                got: format!("{got:.3}{unit}"),
                expected: format!("{low} to {high}{unit}"),
                shown_by: vec![model.card.uid.clone()],
            });
        }
    };
    check("density", density(model), DENSITY, " kg/m³");
    check("friction", model.friction, FRICTION, "");
    check("longest side", model.card.size_m.max_element(), LONGEST_SIDE_M, " m");
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn differences_between_sources_are_found_with_examples() {
        let [odd, usual] = ["odd", "usual"].map(AssetUid::from);
        let objects = |density: f64| vec![(&odd, [9.0 * density, 0.1, 0.5, 0.5]), (&usual, [density, 0.1, 0.5, 0.5])];
        let sources =
            |other: f64| BTreeMap::from([("families".into(), objects(100.0)), ("imported".into(), objects(other))]);
        assert_eq!(between_sources("mug", &sources(250.0)), Vec::new());
        let found = between_sources("mug", &sources(350.0));
        let [finding] = &found[..] else { panic!("{found:?}") };
        assert_eq!(finding.what, "mean density of families and imported");
        assert_eq!(finding.got, "500.000 and 1750.000 kg/m³");
        assert_eq!(finding.shown_by.len(), 2);
        let alone = BTreeMap::from([("families".to_owned(), objects(100.0))]);
        assert_eq!(between_sources("mug", &alone), Vec::new());
    }

    #[test]
    fn implausible_values_are_reported() {
        let model = genmanip_assets::Catalogue::builtin().build("001").unwrap();
        assert_eq!(of_object(&model), Vec::new());
        let mut heavy = (*model).clone();
        heavy.card.mass_kg *= 100.0;
        heavy.friction = 0.01;
        heavy.links[0].visual[0].material.roughness = 0.0;
        let found = of_object(&heavy);
        let quantities: Vec<&str> = found.iter().map(|finding| finding.what.split(' ').next().unwrap()).collect();
        assert_eq!(quantities, ["density", "friction", "roughness"], "{found:?}");
        assert!(found.iter().all(|finding| finding.shown_by == ["001"]));
    }
}
