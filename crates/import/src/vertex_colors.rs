//! Conversion of vertex colours to a texture with one pixel per colour.

use std::collections::BTreeMap;
use std::sync::Arc;

use genmanip_core::{Material, Texture};

use crate::raw::RawMesh;

/// Maximum number of colours of a mesh, a square number; if there are more, all are rounded to 16 shades per channel.
const MAX_COLORS: usize = 4096;
/// Maximum difference per channel of colours that are merged, on a scale of 0 to 255.
const ALIKE: u8 = 3;

/// Paints each triangle of a mesh in the mean colour of its vertices (sRGB, 0 to 1); vertices are split where colours
/// meet.
pub fn paint(mesh: RawMesh, colors: &[[f32; 3]], material: &mut Material) -> RawMesh {
    let byte = |value: f32| if value.is_finite() { (value.clamp(0.0, 1.0) * 255.0).round() as u8 } else { 128 };
    let mean = |triangle: &[u32; 3]| {
        let of = |channel: usize| triangle.iter().map(|corner| colors[*corner as usize][channel]).sum::<f32>() / 3.0;
        [0, 1, 2].map(|channel| byte(of(channel)))
    };
    let own: Vec<[u8; 3]> = mesh.triangles.iter().map(mean).collect();
    let bounds = |pick: fn(u8, u8) -> u8| own.iter().copied().reduce(|a, b| [0, 1, 2].map(|i| pick(a[i], b[i])));
    let (Some(low), Some(high)) = (bounds(u8::min), bounds(u8::max)) else { return mesh };
    if (0..3).all(|channel| high[channel] - low[channel] <= ALIKE) {
        let tint = [0, 1, 2].map(|i| (f32::from(low[i]) + f32::from(high[i])) / 510.0);
        material.base_color = [0, 1, 2].map(|i| material.base_color[i] * tint[i]);
        return mesh;
    }
    let mut palette: BTreeMap<[u8; 3], usize> = own.iter().map(|color| (*color, 0)).collect();
    let rounded = |color: [u8; 3]| color.map(|channel| channel & 0xf0 | channel >> 4);
    let is_rounded = palette.len() > MAX_COLORS;
    if is_rounded {
        palette = own.iter().map(|color| (rounded(*color), 0)).collect();
    }
    palette.values_mut().enumerate().for_each(|(number, place)| *place = number);
    let side = (palette.len() as f64).sqrt().ceil() as usize;
    let mut rgb: Vec<u8> = palette.keys().flatten().copied().collect();
    // The rest of the texture is filled with colours of the object, so that they do not distort its colour words.
    let filled = rgb.len();
    rgb.extend((filled..3 * side * side).map(|at| own[at % own.len()][at % 3]).collect::<Vec<_>>());
    material.texture = Some(Arc::new(Texture { width: side as u32, height: side as u32, rgb }));
    let mut painted = RawMesh::default();
    let mut known: BTreeMap<(u32, usize), u32> = BTreeMap::new();
    for (triangle, color) in mesh.triangles.iter().zip(&own) {
        let place = palette[&if is_rounded { rounded(*color) } else { *color }];
        let uv = [place % side, place / side].map(|at| (at as f32 + 0.5) / side as f32);
        painted.triangles.push(triangle.map(|corner| {
            *known.entry((corner, place)).or_insert_with(|| {
                painted.positions.push(mesh.positions[corner as usize]);
                painted.uvs.push(uv);
                painted.positions.len() as u32 - 1
            })
        }));
    }
    painted
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;

    fn strip() -> RawMesh {
        let positions = (0..4).map(|i| DVec3::new(f64::from(i & 1), f64::from(i >> 1), 0.0)).collect();
        RawMesh { positions, uvs: Vec::new(), triangles: vec![[0, 1, 2], [2, 1, 3]] }
    }

    #[test]
    fn triangles_have_the_mean_colour_of_their_vertices() {
        let mut material = Material::plain([1.0; 3], 0.5);
        let [red, blue] = [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]];
        let painted = paint(strip(), &[red, red, red, blue], &mut material);
        let texture = material.texture.unwrap();
        let color = |triangle: &[u32; 3]| {
            let [u, v] = painted.uvs[triangle[0] as usize];
            let pixel =
                (v * texture.height as f32) as usize * texture.width as usize + (u * texture.width as f32) as usize;
            [0, 1, 2].map(|channel| texture.rgb[3 * pixel + channel])
        };
        assert_eq!(painted.triangles.iter().map(color).collect::<Vec<_>>(), [[255, 0, 0], [170, 0, 85]]);
        assert_eq!((painted.positions.len(), painted.uvs.len()), (6, 6), "the shared edge is divided");
        let mut material = Material::plain([1.0, 0.5, 1.0], 0.5);
        assert_eq!(paint(strip(), &[[0.2, 0.4, 0.6]; 4], &mut material), strip(), "one colour needs no texture");
        assert!(material.texture.is_none() && (material.base_color[1] - 0.2).abs() < 0.01, "{material:?}");
    }
}
