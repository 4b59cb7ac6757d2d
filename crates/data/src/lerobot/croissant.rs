//! Description of a data set's contents: a section of its `README.md`, and a Croissant 1.0 file (JSON-LD) for
//! catalogues.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use genmanip_core::AssetRef;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::{LerobotSettings, card, info};
use crate::columns::{cell, integer, text};
use crate::table::{self, Table};
use crate::{DataError, files};

/// Name of the Croissant file in the data set.
pub const CROISSANT: &str = "croissant.json";

/// Statistics of a data set for its card, and the files written.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Card {
    /// Paths of the written files.
    pub written: Vec<PathBuf>,
    /// Number of episodes and of successful ones, by kind of task.
    pub kinds: BTreeMap<String, [usize; 2]>,
    /// Number of distinct instructions.
    pub sentences: usize,
    /// Minimum and maximum seed of the episodes; `None` without seeds.
    pub seeds: Option<[i64; 2]>,
    /// Policy, engine and program version of the episodes.
    pub origins: BTreeSet<String>,
    /// Names of the scenes' objects: uid for catalogue objects, family for generated ones.
    pub objects: BTreeSet<String>,
    /// Hashes of imported objects, whose packs state their licences.
    pub imported: BTreeSet<String>,
}

/// Part of a scenario that names its objects.
#[derive(Deserialize)]
struct ScenarioObjects {
    objects: Vec<ScenarioObject>,
}

#[derive(Deserialize)]
struct ScenarioObject {
    asset: AssetRef,
}

/// Rewrites `README.md` with the contents of the data set, and writes `croissant.json`.
///
/// # Errors
/// If it is not a LeRobotDataset v3.0 of this program, or a file cannot be read or written.
pub fn write_card(dataset: &Path) -> Result<Card, DataError> {
    let settings = LerobotSettings::of(dataset)?;
    let info = info::read(dataset)?;
    let tables = table::files_below(&dataset.join("meta/episodes"))?;
    let mut contents = Card::default();
    let mut sentences = BTreeSet::new();
    let mut columns = BTreeMap::new();
    for path in &tables {
        contents.read(path, &mut sentences, &mut columns)?;
    }
    contents.sentences = sentences.len();
    let name = dataset.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    let is_depth = info["video_path"].is_null();
    let general =
        if is_depth { card::depth(name.trim_end_matches("-depth")) } else { card::color(&name, &settings, "v3.0") };
    let text = info::card_with_info(&format!("{general}\n{}", contents.describe()), &info);
    let described = croissant(&name, &info, &contents, &columns);
    let described = serde_json::to_string_pretty(&described)
        .map_err(|error| DataError::NotWritable { what: CROISSANT.into(), why: error.to_string() })?;
    for (file, text) in [("README.md", text), (CROISSANT, described + "\n")] {
        let path = dataset.join(file);
        files::write(&path, text.as_bytes())?;
        contents.written.push(path);
    }
    Ok(contents)
}

impl Card {
    fn read(
        &mut self,
        path: &Path,
        sentences: &mut BTreeSet<String>,
        columns: &mut BTreeMap<String, &'static str>,
    ) -> Result<(), DataError> {
        let batch = Table::open(path)?.whole(|name| !name.contains('/'))?;
        for field in batch.schema().fields() {
            let kind = match field.data_type().to_string().as_str() {
                "Int64" => "sc:Integer",
                "Boolean" => "sc:Boolean",
                "Float64" => "sc:Float",
                "Utf8" => "sc:Text",
                _ => continue,
            };
            columns.insert(field.name().clone(), kind);
        }
        for row in 0..batch.num_rows() {
            let word = |name: &str| text(&batch, name, row).map(|(text, _)| text).unwrap_or_default();
            let success = cell(&batch, "success", row).is_some_and(|cell| cell.first() == Some(&1.0));
            let counts = self.kinds.entry(word("task_kind")).or_default();
            counts[0] += 1;
            counts[1] += usize::from(success);
            sentences.insert(word("tasks"));
            if let Some(seed) = integer(&batch, "seed", row) {
                let [low, high] = self.seeds.unwrap_or([seed, seed]);
                self.seeds = Some([low.min(seed), high.max(seed)]);
            }
            self.origins.insert(format!(
                "{}, {}, genmanip {}",
                word("policy"),
                word("engine"),
                word("genmanip_version")
            ));
            let scenario: ScenarioObjects = serde_json::from_str(&word("scenario_json"))
                .map_err(|error| DataError::table(path, format!("scenario_json in row {row}: {error}")))?;
            for object in scenario.objects {
                match object.asset {
                    AssetRef::Builtin { uid, .. } => self.objects.insert(uid.to_string()),
                    AssetRef::Generated { family, .. } => self.objects.insert(family),
                    AssetRef::Imported { hash } => self.imported.insert(hash),
                };
            }
        }
        Ok(())
    }

    /// Section for the `README.md` of the data set, in Markdown.
    fn describe(&self) -> String {
        let mut text = "## Contents\n\n| kind of task | episodes | verified |\n|---|---|---|\n".to_owned();
        for (kind, [episodes, verified]) in &self.kinds {
            text += &format!("| {kind} | {episodes} | {verified} |\n");
        }
        let joined = |names: &BTreeSet<String>| names.iter().cloned().collect::<Vec<_>>().join(", ");
        text += &format!("\n{} different sentences.\n", self.sentences);
        if let Some([low, high]) = self.seeds {
            text +=
                &format!("Seeds of the episodes lie between {low} and {high}; each stands in the episodes table.\n");
        }
        for origin in &self.origins {
            text += &format!("Origin: {origin}.\n");
        }
        text += &format!("\nObjects of the program, CC0-1.0: {}.\n", joined(&self.objects));
        if !self.imported.is_empty() {
            text += &format!(
                "Imported objects, by hash: {}. Their licences stand in the packs that they came from and hold for the \
                 pictures of them; see to them before you pass the data set on.\n",
                joined(&self.imported)
            );
        }
        text
    }
}

/// Croissant description in JSON-LD of a data set with this `info.json` and these contents and columns.
fn croissant(name: &str, info: &Value, contents: &Card, columns: &BTreeMap<String, &'static str>) -> Value {
    let set = |id: &str, kind: &str, includes: &str| json!({"@type": "cr:FileSet", "@id": id, "name": id, "encodingFormat": kind, "includes": includes});
    let mut distribution = vec![
        set("row-files", "application/x-parquet", "data/*/*.parquet"),
        set("episode-files", "application/x-parquet", "meta/episodes/*/*.parquet"),
    ];
    let field = |records: &str, files: &str, column: &str, kind: &str| {
        json!({
            "@type": "cr:Field", "@id": format!("{records}/{column}"), "name": column, "dataType": kind,
            "source": {"fileSet": {"@id": files}, "extract": {"column": column}},
        })
    };
    let mut rows = Vec::new();
    for (key, entry) in info["features"].as_object().into_iter().flatten() {
        let kind = match entry["dtype"].as_str() {
            Some("video") => {
                distribution.push(set(key, "video/mp4", &format!("videos/{key}/*/*.mp4")));
                continue;
            }
            Some("image") => "sc:ImageObject",
            Some("bool") => "sc:Boolean",
            Some("int64") => "sc:Integer",
            _ => "sc:Float",
        };
        let mut described = field("rows", "row-files", key, kind);
        if entry["shape"] != json!([1]) && kind != "sc:ImageObject" {
            described["repeated"] = json!(true);
        }
        rows.push(described);
    }
    let episodes: Vec<Value> =
        columns.iter().map(|(column, kind)| field("episodes", "episode-files", column, kind)).collect();
    let total = |key: &str| info[key].as_u64().unwrap_or_default();
    let seeds = contents.seeds.map_or_else(String::new, |[low, high]| format!(", seeds {low} to {high}"));
    let origin = contents.origins.iter().cloned().collect::<Vec<_>>().join("; ");
    json!({
        "@context": {
            "@language": "en", "@vocab": "https://schema.org/", "sc": "https://schema.org/",
            "cr": "http://mlcommons.org/croissant/", "rai": "http://mlcommons.org/croissant/RAI/",
            "dct": "http://purl.org/dc/terms/", "citeAs": "cr:citeAs", "column": "cr:column",
            "conformsTo": "dct:conformsTo", "data": {"@id": "cr:data", "@type": "@json"},
            "dataType": {"@id": "cr:dataType", "@type": "@vocab"},
            "examples": {"@id": "cr:examples", "@type": "@json"}, "extract": "cr:extract", "field": "cr:field",
            "fileProperty": "cr:fileProperty", "fileObject": "cr:fileObject", "fileSet": "cr:fileSet",
            "format": "cr:format", "includes": "cr:includes", "isLiveDataset": "cr:isLiveDataset",
            "jsonPath": "cr:jsonPath", "key": "cr:key", "md5": "cr:md5", "parentField": "cr:parentField",
            "path": "cr:path", "recordSet": "cr:recordSet", "references": "cr:references", "regex": "cr:regex",
            "repeated": "cr:repeated", "replace": "cr:replace", "separator": "cr:separator", "source": "cr:source",
            "subField": "cr:subField", "transform": "cr:transform"
        },
        "@type": "sc:Dataset",
        "conformsTo": ["http://mlcommons.org/croissant/1.0", "http://mlcommons.org/croissant/RAI/1.0"],
        "name": name,
        "description": format!(
            "{} tabletop manipulation demonstrations, {} rows at {} Hz, robot {}, {} sentences{seeds}.",
            total("total_episodes"), total("total_frames"), total("fps"),
            info["robot_type"].as_str().unwrap_or_default(), contents.sentences
        ),
        "license": "https://creativecommons.org/publicdomain/zero/1.0/",
        "version": "1.0.0",
        "keywords": ["robotics", "manipulation", "simulation", "LeRobot"],
        "rai:dataCollection": format!("Simulated and verified after settling. Origin: {origin}."),
        "rai:dataCollectionType": "Software Collection",
        "distribution": distribution,
        "recordSet": [
            {"@type": "cr:RecordSet", "@id": "rows", "name": "rows", "field": rows},
            {"@type": "cr:RecordSet", "@id": "episodes", "name": "episodes", "field": episodes},
        ],
    })
}
