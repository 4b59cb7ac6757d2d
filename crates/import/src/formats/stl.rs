//! STL (binary or text) and MuJoCo's MSH: triangles without materials.

use glam::DVec3;

use crate::ImportError;
use crate::raw::{MAX_TRIANGLES, RawMesh};

/// Triangles of an STL file, without shared vertices.
///
/// # Errors
/// If it is neither binary nor text STL, has no triangles or more than [`MAX_TRIANGLES`], or a triangle is incomplete.
pub fn read(path: &str, bytes: &[u8]) -> Result<RawMesh, ImportError> {
    let corners = corners(path, bytes, MAX_TRIANGLES)?;
    if corners.is_empty() || corners.len() % 3 != 0 {
        return Err(ImportError::new(path, format!("{} vertices; expected three per triangle", corners.len())));
    }
    let triangles = (0..corners.len() as u32 / 3).map(|index| [3 * index, 3 * index + 1, 3 * index + 2]).collect();
    Ok(RawMesh { positions: corners, uvs: Vec::new(), triangles })
}

/// Vertices of the triangles of an STL file, three each; empty if the file has no triangles. In text files the number
/// of vertices is not checked, and bytes after the triangles of a binary file are ignored.
///
/// # Errors
/// If it is neither binary nor text STL, or has more than `max_triangles`.
pub fn corners(path: &str, bytes: &[u8], max_triangles: usize) -> Result<Vec<DVec3>, ImportError> {
    let is_text = bytes.trim_ascii_start().starts_with(b"solid");
    let count = bytes.get(80..84).and_then(|count| count.try_into().ok()).map(u32::from_le_bytes);
    let is_binary =
        count.is_some_and(|count| bytes.len() as u64 >= 84 + 50 * u64::from(count) && (count > 0 || !is_text));
    if is_binary {
        let count = count.unwrap_or(0) as usize;
        check_count(path, count, max_triangles)?;
        let triangles = bytes[84..].chunks_exact(50).take(count);
        Ok(triangles.flat_map(|triangle| triangle[12..48].chunks_exact(12).map(corner)).collect())
    } else if is_text {
        text_corners(path, bytes, max_triangles)
    } else if (80..84).contains(&bytes.len()) {
        // A header without triangles.
        Ok(Vec::new())
    } else {
        Err(ImportError::new(path, "neither text nor binary STL: its length does not match its number of triangles"))
    }
}

/// Triangles of an MSH file: four counts, then vertices, normals, texture coordinates and faces.
///
/// # Errors
/// If its length does not match its counts, it has more than [`MAX_TRIANGLES`], or a face refers to a missing vertex.
pub fn read_msh(path: &str, bytes: &[u8]) -> Result<RawMesh, ImportError> {
    let wrong = || ImportError::new(path, "not an MSH file: its length does not match its counts");
    let word = |index: usize| Some(i32::from_le_bytes(bytes.get(4 * index..4 * index + 4)?.try_into().ok()?));
    let count = |index| word(index).and_then(|value| usize::try_from(value).ok()).ok_or_else(wrong);
    let (corners, normals, uvs, faces) = (count(0)?, count(1)?, count(2)?, count(3)?);
    check_count(path, faces.max(corners / 3), MAX_TRIANGLES)?;
    let words = [3 * corners, 3 * normals.min(bytes.len()), 2 * uvs.min(bytes.len()), 3 * faces];
    if bytes.len() != 4 * (4 + words.iter().sum::<usize>()) || corners == 0 || faces == 0 {
        return Err(wrong());
    }
    let part = |index: usize| {
        let start = 4 * (4 + words[..index].iter().sum::<usize>());
        &bytes[start..start + 4 * words[index]]
    };
    let positions: Vec<DVec3> = part(0).chunks_exact(12).map(corner).collect();
    let single = |bytes: &[u8]| bytes.try_into().map_or(f32::NAN, f32::from_le_bytes);
    // Texture rows count from the top of the image, unlike in OBJ.
    let mut texture: Vec<[f32; 2]> = part(2).chunks_exact(8).map(|uv| [single(&uv[..4]), single(&uv[4..])]).collect();
    if texture.len() != positions.len() {
        texture.clear();
    }
    let mut triangles = Vec::with_capacity(faces);
    for face in part(3).chunks_exact(12) {
        let corner = |at: usize| face[4 * at..4 * at + 4].try_into().map_or(u32::MAX, u32::from_le_bytes);
        let triangle = [corner(0), corner(1), corner(2)];
        if triangle.iter().any(|&index| index as usize >= positions.len()) {
            return Err(ImportError::new(
                path,
                format!("a face refers to vertices {triangle:?} of {}", positions.len()),
            ));
        }
        triangles.push(triangle);
    }
    Ok(RawMesh { positions, uvs: texture, triangles })
}

fn check_count(path: &str, triangles: usize, max_triangles: usize) -> Result<(), ImportError> {
    if triangles > max_triangles {
        return Err(ImportError::new(path, format!("{triangles} triangles; at most {max_triangles} are supported"))
            .hint("reduce it in a modelling program first"));
    }
    Ok(())
}

fn corner(bytes: &[u8]) -> DVec3 {
    let number = |bytes: &[u8]| f64::from(bytes.try_into().map_or(f32::NAN, f32::from_le_bytes));
    DVec3::new(number(&bytes[..4]), number(&bytes[4..8]), number(&bytes[8..12]))
}

fn text_corners(path: &str, bytes: &[u8], max_triangles: usize) -> Result<Vec<DVec3>, ImportError> {
    let text = String::from_utf8_lossy(bytes);
    let mut corners = Vec::new();
    for (index, line) in text.lines().enumerate() {
        let Some(rest) = line.trim_start().strip_prefix("vertex") else { continue };
        let values: Vec<f64> = rest.split_whitespace().filter_map(|word| word.parse().ok()).collect();
        let &[x, y, z] = values.as_slice() else {
            return Err(ImportError::new(path, format!("line {}: expected three numbers after `vertex`", index + 1)));
        };
        corners.push(DVec3::new(x, y, z));
    }
    check_count(path, corners.len() / 3, max_triangles)?;
    Ok(corners)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn msh_files_are_read() {
        let mut bytes: Vec<u8> = [3_i32, 0, 3, 1].into_iter().flat_map(i32::to_le_bytes).collect();
        let numbers = [0.0_f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 2.0, 0.0, 0.0, 0.25, 1.0, 0.25, 0.0, 0.75];
        bytes.extend(numbers.into_iter().flat_map(f32::to_le_bytes));
        bytes.extend([0_i32, 1, 2].into_iter().flat_map(i32::to_le_bytes));
        let mesh = read_msh("a.msh", &bytes).unwrap();
        assert_eq!(mesh.positions, [DVec3::ZERO, DVec3::X, 2.0 * DVec3::Y]);
        assert_eq!((mesh.uvs, mesh.triangles), (vec![[0.0, 0.25], [1.0, 0.25], [0.0, 0.75]], vec![[0, 1, 2]]));
        bytes.pop();
        assert!(read_msh("a.msh", &bytes).is_err());
    }
}
