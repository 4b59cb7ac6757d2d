//! `genmanip assets`: search, show, draw, import, export, audit and freeze objects.

use genmanip_workspace::documents;
use genmanip_workspace::workers;
use genmanip_workspace::worlds;
use std::path::Path;
use std::sync::Arc;

use genmanip_assets::instances::{choose, to_text};
use genmanip_assets::metadata::{asset_metadata, geometry_metadata};
use genmanip_assets::search::Filter;
use genmanip_assets::{Catalogue, Families, Family, GraspLibrary, panda};
use genmanip_core::glam::DVec3;
use genmanip_core::{ObjectCard, ObjectModel, Pose, Seed};
use genmanip_import::Given;
use genmanip_import::audit::{self, Finding};
use genmanip_import::packs::{self, ImportRow, ImportSettings};
use genmanip_import::raw::Up;
use genmanip_viz::object_images;
use genmanip_workspace::Progress;
use genmanip_workspace::WorkspaceError;
use genmanip_workspace::text_table;
use serde_json::json;

use crate::args::{
    AssetsCommand, AuditArguments, ExportAssetArguments, FreezeArguments, ImportArguments, SearchArguments,
    SheetArguments, ShowAssetArguments,
};
use genmanip_terminal::Printer;
use genmanip_terminal::{ExitStatus, Failed};

/// Default maximum number of results of `assets search`.
const FOUND: usize = 20;
/// Pixels per side of the views of `show` and `audit`.
const VIEW_PX: u32 = 320;
/// Images per row of the sheet of `audit`.
const AUDITED_COLUMNS: usize = 6;

pub fn run(command: &AssetsCommand, packs: &Path, printer: &Printer) -> Result<ExitStatus, Failed> {
    match command {
        AssetsCommand::List(arguments) => search(arguments, usize::MAX, printer),
        AssetsCommand::Search(arguments) => search(arguments, FOUND, printer),
        AssetsCommand::Show(arguments) => show(arguments, printer),
        AssetsCommand::Sheet(arguments) => sheet(arguments, printer),
        AssetsCommand::Export(arguments) => export(arguments, printer),
        AssetsCommand::Audit(arguments) => audit(arguments, printer),
        AssetsCommand::Import(arguments) => import(arguments, packs, printer),
        AssetsCommand::Freeze(arguments) => freeze(arguments, printer),
    }
}

/// The catalogue of a name; the command line has validated the name, so the default is never used.
pub fn catalogue(name: &str) -> &'static Catalogue {
    Catalogue::named(name).unwrap_or_else(Catalogue::builtin)
}

fn search(arguments: &SearchArguments, limit: usize, printer: &Printer) -> Result<ExitStatus, Failed> {
    let index = catalogue(&arguments.catalog.catalog).index();
    let found = index.search(&arguments.query.join(" "), &Filter::default(), arguments.limit.unwrap_or(limit));
    let mut rows = vec![["uid", "name", "category", "size, mm", "what it is"].map(String::from).to_vec()];
    for one in &found {
        let card = one.card;
        rows.push(vec![
            card.uid.to_string(),
            card.name.clone(),
            card.category.clone(),
            card.size_m.to_array().map(|side| format!("{:.0}", side * 1e3)).join(" × "),
            card.description.clone(),
        ]);
    }
    printer.data(&found, &text_table(&rows));
    printer.say(format!("{} object{}", found.len(), if found.len() == 1 { "" } else { "s" }));
    Ok(if found.is_empty() { ExitStatus::NotMet } else { ExitStatus::Done })
}

fn show(arguments: &ShowAssetArguments, printer: &Printer) -> Result<ExitStatus, Failed> {
    let catalogue = Catalogue::all();
    let model = object_images::model(catalogue, &arguments.uid)?;
    let (card, geometry, known) = (&model.card, geometry_metadata(&model), asset_metadata(&model.card));
    let joints: Vec<_> = model.links.iter().filter_map(|link| link.joint.as_ref()).collect();
    let states: Vec<_> =
        model.joint_states.iter().map(|state| json!({"name": state.name, "joints": state.intervals})).collect();
    let grasps = GraspLibrary::builtin()
        .of(&panda(), &model)
        .map_err(|error| Failed::because("the tried grasps cannot be used", &error))?;
    let hashes = object_images::hashes(catalogue, &model)?;
    let value = json!({
        "card": card, "notes": known, "split": catalogue.split(&card.uid), "geometry": geometry,
        "joints": joints.iter().map(|joint| json!({
            "name": joint.name, "kind": joint.kind, "range": joint.range, "axis": joint.axis,
        })).collect::<Vec<_>>(),
        "states": states,
        "grasps": {"robot": panda().name, "tried": grasps.len(),
                   "always_held": grasps.iter().filter(|tried| tried.held == tried.trials).count()},
        "hashes": {"physics": hashes.physics, "judging": hashes.judging, "looks": hashes.looks},
    });
    let mut text = format!(
        "{} {}\n{}\n\ncategory   {}\nalso       {}\nuses       {}\nsize       {} mm, {:.3} kg, friction {}\nsplit      {}\n\
         pieces     {} convex collision pieces\ngrasps     {} tried with {}\n\nstands\n",
        card.uid,
        card.name,
        card.description,
        known.category_path.join(" > "),
        known.synonyms.join(", "),
        known.uses.join(", "),
        card.size_m.to_array().map(|side| format!("{:.0}", side * 1e3)).join(" × "),
        card.mass_kg,
        model.friction,
        catalogue.split(&card.uid).name(),
        geometry.pieces,
        grasps.len(),
        panda().name,
    );
    for pose in &geometry.stable_poses {
        text += &format!("  {:<19} centre of mass {:.0} mm inside its support\n", pose.name, pose.margin_m * 1e3);
    }
    text += "\nparts\n";
    for part in &geometry.parts {
        let size = part.link_bounds.size().to_array().map(|side| format!("{:.0}", side * 1e3)).join(" × ");
        text += &format!("  {:<10} {:<14} {size} mm  {}\n", part.link, part.name, part.affordances.join(", "));
    }
    for joint in &joints {
        text +=
            &format!("\njoint      {} ({:?}) {:.3} to {:.3}", joint.name, joint.kind, joint.range[0], joint.range[1]);
    }
    for state in &model.joint_states {
        text += &format!("\nstate      {}", state.name);
    }
    printer.data(&value, &text);
    if let Some(path) = &arguments.picture {
        documents::write_file(path, &views(&model, path)?)?;
        printer.say(format!("wrote {}", path.display()));
    }
    Ok(ExitStatus::Done)
}

/// Images of an object with all joints at 0, from the robot's side (left and right), from the far side and from above,
/// and one image of each named state.
fn views(model: &Arc<ObjectModel>, path: &Path) -> Result<Vec<u8>, WorkspaceError> {
    let at = Pose::from_position(DVec3::new(0.5, 0.0, 0.0));
    let closed = vec![0.0; model.joint_count()];
    let directions = [[-0.8, 0.5, 0.6], [-0.8, -0.5, 0.6], [0.8, 0.45, 0.5], [-0.25, 0.0, 1.0]].map(DVec3::from_array);
    let mut pictures = Vec::new();
    for direction in directions {
        pictures.push(object_images::portrait_from(model, &at, &closed, direction, VIEW_PX)?);
    }
    for state in &model.joint_states {
        pictures.push(object_images::portrait_from(model, &at, &state.nominal, directions[1], VIEW_PX)?);
    }
    object_images::tiled(&pictures, 4, VIEW_PX, path)
}

fn sheet(arguments: &SheetArguments, printer: &Printer) -> Result<ExitStatus, Failed> {
    let own = arguments.families.as_deref().map(object_images::read_families).transpose()?;
    let families = own.as_ref().unwrap_or_else(|| Families::builtin());
    let models = match &arguments.family {
        Some(name) => new_objects(families, name, arguments.seed, arguments.count.unwrap_or(1))?,
        None => {
            let catalogue = catalogue(&arguments.catalog.catalog);
            let index = catalogue.index();
            let limit = arguments.count.unwrap_or(usize::MAX);
            let found = index.search(&arguments.query.join(" "), &Filter::default(), limit);
            found.iter().map(|one| object_images::model(catalogue, &one.card.uid)).collect::<Result<Vec<_>, _>>()?
        }
    };
    if models.is_empty() {
        return Err(Failed::new("there is nothing to draw").hint("see `genmanip assets list`"));
    }
    let picture = object_images::sheet(&models, arguments.columns, arguments.cell, &arguments.out, printer)?;
    documents::write_file(&arguments.out, &picture)?;
    let columns = arguments.columns.min(models.len());
    let place = |(index, model): (usize, &Arc<ObjectModel>)| {
        json!({"row": index / columns + 1, "column": index % columns + 1, "uid": model.card.uid, "name": model.card.name,
               "description": model.card.description, "accepted_names": asset_metadata(&model.card).accepted_names})
    };
    let rows: Vec<_> = models.iter().enumerate().map(place).collect();
    let line = |row: &serde_json::Value| {
        let text = |key: &str| row[key].as_str().unwrap_or_default().to_owned();
        format!("{:>3}, {:>2}  {}  {}", row["row"], row["column"], text("uid"), text("description"))
    };
    printer.data(&rows, &rows.iter().map(line).collect::<Vec<_>>().join("\n"));
    printer.say(format!("wrote {}", arguments.out.display()));
    Ok(ExitStatus::Done)
}

/// New objects: of the named family, or of every family for `all`, those of `count` consecutive seeds from `seed` on;
/// for `random`, `count` objects of random families with random seeds.
fn new_objects(families: &Families, name: &str, seed: u64, count: usize) -> Result<Vec<Arc<ObjectModel>>, Failed> {
    let wanted = families.all().filter(|family| name == "all" || family.family == name).collect::<Vec<_>>();
    let consecutive = || (seed..seed + count as u64).map(Seed::new);
    let instances: Vec<(&Family, Seed)> = if name == "random" {
        let all: Vec<&Family> = families.all().collect();
        let drawn = (0..count as u64).map(|index| Seed::new(seed).fork("sheet").fork_index(index));
        drawn.map(|drawn| (all[(drawn.value() % all.len() as u64) as usize], drawn.fork("object"))).collect()
    } else {
        wanted.iter().flat_map(|family| consecutive().map(|seed| (*family, seed))).collect()
    };
    let make = |(family, seed): &(&Family, Seed)| {
        let model = families.instance(&family.family, &std::collections::BTreeMap::new(), *seed);
        let broken = |error| Failed::because(format!("{} {} cannot be made", family.family, seed.value()), &error);
        model.map(Arc::new).map_err(broken)
    };
    let models = instances.iter().map(make).collect::<Result<Vec<_>, _>>()?;
    if models.is_empty() {
        let known: Vec<&str> = families.all().map(|family| family.family.as_str()).collect();
        return Err(Failed::new(format!("there is no family `{name}`")).hint(format!("there are {}", known.join(", "))));
    }
    Ok(models)
}

fn import(arguments: &ImportArguments, folder: &Path, printer: &Printer) -> Result<ExitStatus, Failed> {
    let fits = |name: &str| {
        !name.is_empty() && !name.starts_with('.') && name.chars().all(genmanip_core::names::fits_file_name)
    };
    if !fits(&arguments.pack) {
        return Err(Failed::misused(format!("--pack {} cannot name a folder", arguments.pack))
            .hint("use ASCII letters, digits and any of -_.+=@, no dot in front"));
    }
    let up = arguments.up.as_deref().map(|up| if up == "y" { Up::Y } else { Up::Z });
    let settings = ImportSettings {
        folder: folder.to_owned(),
        pack: arguments.pack.clone(),
        given: Given { scale: arguments.scale, up, category: arguments.category.clone(), tipped_up: None },
        licence: arguments.licence.clone(),
        without_grasps: arguments.no_grasps,
        seed: Seed::new(arguments.seed),
    };
    let world = worlds::read_world_with(None, Some(&arguments.robot))?;
    let stop = genmanip_terminal::on_interrupt();
    let found = packs::candidates(&arguments.paths, arguments.root.as_deref())?;
    let rows = packs::import(&found, &world, &settings, workers::workers(arguments.workers), printer, &stop)?;
    printer.data(&rows, &packs::table(&rows));
    let count = |of: &dyn Fn(&&ImportRow) -> bool| rows.iter().filter(of).count();
    let imported = count(&|row| row.error.is_none());
    let graspable = count(&|row| row.can_grasp);
    let held = match arguments.no_grasps {
        true => format!("no grasp was tried on {graspable} graspable ones"),
        false => format!("{} of {graspable} graspable ones were held in a trial", count(&|row| row.grasps > 0)),
    };
    printer.say(format!(
        "{imported} of {} imported into {}; {} rest on a table, {held}",
        found.len(),
        folder.join(&arguments.pack).display(),
        count(&|row| row.rests),
    ));
    let refused = found.len() - imported;
    Ok(if refused == 0 { ExitStatus::Done } else { ExitStatus::NotMet })
}

fn export(arguments: &ExportAssetArguments, printer: &Printer) -> Result<ExitStatus, Failed> {
    let model = object_images::model(Catalogue::all(), &arguments.uid)?;
    let write = |name: &str, text: &str| documents::write_file(&arguments.out.join(name), text.as_bytes());
    let mtl = format!("{}.mtl", model.card.uid);
    let (geometry, materials) = object_images::obj(&model, &mtl);
    write(&format!("{}.obj", model.card.uid), &geometry)?;
    write(&mtl, &materials)?;
    write(&format!("{}.xml", model.card.uid), &object_images::mjcf(&model)?)?;
    let described =
        json!({"card": model.card, "notes": asset_metadata(&model.card), "geometry": geometry_metadata(&model)});
    write(&format!("{}.json", model.card.uid), &serde_json::to_string_pretty(&described).unwrap_or_default())?;
    let files = ["obj", "mtl", "xml", "json"].map(|end| format!("{}.{end}", model.card.uid));
    printer.data(&json!({"folder": arguments.out, "files": files}), &files.join("\n"));
    Ok(ExitStatus::Done)
}

fn audit(arguments: &AuditArguments, printer: &Printer) -> Result<ExitStatus, Failed> {
    let catalogue = catalogue(&arguments.catalog.catalog);
    let findings = audit::audit(catalogue, printer)?;
    if let Some(path) = arguments.sheet.as_deref().filter(|_| !findings.is_empty()) {
        let uids = findings.iter().flat_map(|finding| &finding.shown_by);
        let models: Vec<_> = uids.map(|uid| object_images::model(catalogue, uid)).collect::<Result<_, _>>()?;
        documents::write_file(path, &object_images::sheet(&models, AUDITED_COLUMNS, VIEW_PX, path, printer)?)?;
        printer.say(format!("wrote {}", path.display()));
    }
    let mut rows = vec![["uid", "name", "what", "got", "expected", "shown by"].map(String::from).to_vec()];
    for Finding { subject, name, what, got, expected, shown_by } in &findings {
        rows.push([subject, name, what, got, expected, &shown_by.join(", ")].map(String::clone).to_vec());
    }
    let text = if findings.is_empty() { "nothing implausible\n".to_owned() } else { text_table(&rows) };
    printer.data(&findings, &text);
    Ok(if findings.is_empty() { ExitStatus::Done } else { ExitStatus::NotMet })
}

fn freeze(arguments: &FreezeArguments, printer: &Printer) -> Result<ExitStatus, Failed> {
    let known = Catalogue::builtin().cards();
    let of_kind =
        |articulated: bool| known.iter().filter(|card: &&ObjectCard| card.is_articulated == articulated).count();
    let (rigid, articulated) = (arguments.rigid - of_kind(false), arguments.articulated - of_kind(true));
    let own = arguments.families.as_deref().map(object_images::read_families).transpose()?;
    let families = own.as_ref().unwrap_or_else(|| Families::builtin());
    printer.begin("choosing", rigid + articulated);
    let list = choose(families, rigid, articulated, known, &mut || printer.advance())
        .map_err(|error| Failed::because("a family cannot make an object", &error))?;
    printer.end();
    write_list(&arguments.out, &to_text(&list))?;
    printer.say(format!("{} objects, of {} wanted", list.len(), rigid + articulated));
    Ok(ExitStatus::Done)
}

fn write_list(path: &Path, text: &str) -> Result<(), WorkspaceError> {
    documents::write_file(path, text.as_bytes())
}
