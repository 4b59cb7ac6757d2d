//! Check of images stored in tables: complete PNG files of the declared size.

use std::collections::BTreeSet;

use super::findings::Findings;
use super::metadata::{Feature, Metadata};
use genmanip_data::DataError;
use genmanip_data::columns::image_files;
use genmanip_data::depth::decode_depth_png;
use genmanip_data::table::Table;

/// Every how many depth images one is decoded; checksums of all images are verified.
const DECODED_EVERY: usize = 64;

pub(super) fn check(metadata: &Metadata, findings: &mut Findings) {
    let features: Vec<&Feature> = metadata.info.features.iter().filter(|feature| feature.is_image()).collect();
    if features.is_empty() {
        return;
    }
    let files: BTreeSet<&str> = metadata.episodes.iter().map(|episode| episode.data.as_str()).collect();
    for file in files {
        if let Err(error) = check_file(metadata, &features, file, findings)
            && !error.is_missing()
        {
            findings.add("depth", file, "", "a readable table", error);
        }
    }
}

fn check_file(
    metadata: &Metadata,
    features: &[&Feature],
    file: &str,
    findings: &mut Findings,
) -> Result<(), DataError> {
    let path = metadata.root.join(file);
    let known = Table::open(&path)?.names();
    for feature in features.iter().filter(|feature| known.contains(&feature.key)) {
        let mut row = 0;
        // A struct of bytes and path has two leaves under one name.
        for batch in Table::open(&path)?.columns(&[&feature.key])? {
            let batch = batch?;
            let Some(images) = batch.column_by_name(&feature.key).and_then(|column| image_files(column)) else {
                findings.add("features", file, format!("column {}", feature.key), "image bytes", "another type");
                break;
            };
            for image in images {
                let rgb = feature.rgb_size().map(|[height, width]| vec![height, width, 3]);
                let shape = rgb.as_ref().unwrap_or(&feature.shape);
                let wrong = match image {
                    None => Some("nothing".to_owned()),
                    Some(file) => flaw(file, shape, row % DECODED_EVERY == 0),
                };
                if let Some(found) = wrong {
                    let expected = format!("a PNG image of shape {:?}", feature.shape);
                    findings.add("depth", file, format!("row {row}, {}", feature.key), expected, found);
                }
                row += 1;
            }
        }
    }
    Ok(())
}

/// Description of the first flaw of a PNG file; `None` if it is valid.
fn flaw(file: &[u8], shape: &[usize], is_decoded: bool) -> Option<String> {
    let Some(mut rest) = file.strip_prefix(b"\x89PNG\r\n\x1a\n") else { return Some("not a PNG file".into()) };
    let mut size = None;
    let mut is_ended = false;
    while let Some((head, tail)) = rest.split_at_checked(8) {
        let length = u32::from_be_bytes(head[..4].try_into().unwrap_or_default()) as usize;
        let (Some(body), Some(sum)) = (tail.get(..length), tail.get(length..).and_then(|tail| tail.get(..4))) else {
            return Some("a truncated file".into());
        };
        let mut crc = flate2::Crc::new();
        crc.update(&head[4..]);
        crc.update(body);
        if crc.sum().to_be_bytes() != *sum {
            return Some(format!("a wrong checksum of chunk {}", String::from_utf8_lossy(&head[4..])));
        }
        if &head[4..] == b"IHDR"
            && let Some((width, height)) = body.split_at_checked(4).and_then(|(w, h)| Some((w, h.get(..4)?)))
        {
            let side = |bytes: &[u8]| u32::from_be_bytes(bytes.try_into().unwrap_or_default()) as usize;
            size = Some([side(height), side(width)]);
        }
        is_ended |= &head[4..] == b"IEND";
        rest = &tail[length + 4..];
    }
    if !is_ended {
        return Some("a truncated file".into());
    }
    if size.as_ref().map(<[usize; 2]>::as_slice) != shape.get(..2) {
        return Some(format!("size {size:?}"));
    }
    match is_decoded && shape.get(2) == Some(&1) {
        true => decode_depth_png(file).err().map(|error| error.to_string()),
        false => None,
    }
}
