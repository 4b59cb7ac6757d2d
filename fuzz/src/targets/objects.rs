//! Objects, robots and images from files.

use std::path::Path;

use genmanip_agent::image::RgbImage;
use genmanip_assets::robots::{self as built_in, PartKind, compose};
use genmanip_data::{depth, genmanip_format};
use genmanip_import::{Given, image, robots};
use genmanip_lab::hostile::imports::{FORMATS, valid};

use super::{Opened, message};
use crate::Failure;
use crate::input::Input;

/// An object of the format that the target names; the files beside it are read when it refers to them.
pub fn import(kind: &str, repository: &Path) -> Result<Opened, Failure> {
    let format = FORMATS.into_iter().find(|(known, _)| *known == kind).ok_or("an unknown format")?;
    let files = valid(repository, format)?;
    let read = move |input: &Input| {
        let mut file = |path: &str, _| {
            let found = input.files.iter().find(|(name, _)| name == path);
            found.map(|(_, bytes)| bytes.clone()).ok_or_else(|| "there is no such file".to_owned())
        };
        let described = input.files.iter().filter(|(name, _)| name.ends_with(format.1));
        described.into_iter().try_for_each(|(name, _)| {
            genmanip_import::import(name, &mut file, &Given::default(), None).map(drop).map_err(message)
        })
    };
    Ok(Opened { corpus: vec![Input { files }], read: Box::new(read) })
}

/// A small arm with every kind of geometry.
pub fn robots(_: &str, _: &Path) -> Result<Opened, Failure> {
    let folder = tempfile::tempdir()?;
    let read = move |input: &Input| {
        input.write(folder.path()).map_err(message)?;
        robots::read(folder.path(), &robots::Settings::default()).map(drop).map_err(message)
    };
    Ok(Opened { corpus: vec![Input { files: genmanip_lab::hostile::robot() }], read: Box::new(read) })
}

/// Robot files: the built-in robots and the examples, each with the arm and the gripper that it names.
pub fn robot_files(_: &str, repository: &Path) -> Result<Opened, Failure> {
    let parts = |input: &Input, kind: PartKind, name: &str| {
        let path = format!("{}s/{name}.json", kind.word());
        let found = input.files.iter().find(|(known, _)| *known == path);
        found.map(|(_, bytes)| String::from_utf8_lossy(bytes).into_owned())
    };
    let read = move |input: &Input| {
        let (name, bytes) = &input.files[0];
        let find = |kind: PartKind, part: &str| parts(input, kind, part).map_or_else(|| built_in::find(kind, part), Ok);
        compose(name, &String::from_utf8_lossy(bytes), &find).map(drop).map_err(message)
    };
    let folder = repository.join("crates/assets/data/robots");
    let all = Input::of_folder(&folder)?.files;
    let (parts, robots): (Vec<_>, Vec<_>) = all.into_iter().partition(|(name, _)| name.contains('/'));
    let corpus = robots.into_iter().map(|robot| Input { files: [vec![robot], parts.clone()].concat() }).collect();
    Ok(Opened { corpus, read: Box::new(read) })
}

/// Textures, depth images and images of the agent.
pub fn images(_: &str, repository: &Path) -> Result<Opened, Failure> {
    let (width, height) = (24, 16);
    let rgb: Vec<u8> = (0..3 * width * height).map(|index| (index * 7 % 251) as u8).collect();
    let depth_m: Vec<f32> = (0..width * height).map(|index| index as f32 * 0.01).collect();
    let card = repository.join("crates/import/testdata/sound/obj/card.png");
    let webp = repository.join("crates/import/testdata/red.webp");
    let corpus = vec![
        Input::file("red.webp", std::fs::read(webp)?),
        Input::file("card.png", std::fs::read(card)?),
        Input::file("depth.png", depth::encode_depth_png(&depth_m, width, height)?),
        Input::file("photo.jpg", genmanip_format::jpeg(&rgb, width, height)?),
    ];
    let read = |input: &Input| {
        let (bytes, mut pixels_left) = (&input.files[0].1, image::MAX_PIXELS);
        let texture = image::texture(bytes, &mut pixels_left).map(drop);
        let depth = depth::decode_depth_png(bytes).map(drop).map_err(message);
        let rgb = RgbImage::of_png(bytes).map(drop);
        texture.or(depth).or(rgb)
    };
    Ok(Opened { corpus, read: Box::new(read) })
}
