//! Point clouds as binary PLY files, readable by Open3D, CloudCompare, MeshLab and Blender.

use genmanip_core::perception::PointCloud;

/// Encodes a point cloud as little-endian PLY: `x y z` as 32-bit floats in metres, then `red green blue` as bytes if
/// the points have colours.
pub fn encode(cloud: &PointCloud) -> Vec<u8> {
    let PointCloud { points_m, colors } = cloud;
    let is_colored = !colors.is_empty();
    let color = if is_colored { "property uchar red\nproperty uchar green\nproperty uchar blue\n" } else { "" };
    let mut file = format!(
        "ply\nformat binary_little_endian 1.0\ncomment world frame, metres\nelement vertex {}\n\
         property float x\nproperty float y\nproperty float z\n{color}end_header\n",
        points_m.len()
    )
    .into_bytes();
    for (index, point) in points_m.iter().enumerate() {
        file.extend(point.iter().flat_map(|value| value.to_le_bytes()));
        if is_colored {
            file.extend(colors.get(index).copied().unwrap_or_default());
        }
    }
    file
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_point_takes_twelve_bytes_plus_three_for_colour() {
        for (colors, bytes) in [(vec![], 12), (vec![[1, 2, 3], [4, 5, 6]], 15)] {
            let cloud = PointCloud { points_m: vec![[0.5, -1.0, 2.0], [3.0, 0.0, 0.25]], colors };
            let file = encode(&cloud);
            let end = file.windows(11).position(|part| part == b"end_header\n").unwrap() + 11;
            assert!(String::from_utf8_lossy(&file[..end]).contains("element vertex 2\n"));
            assert_eq!(file[end..].len(), 2 * bytes);
            assert_eq!(file[end + bytes..][..4], 3.0_f32.to_le_bytes());
            if bytes == 15 {
                assert_eq!(file[end + 12..][..3], [1, 2, 3]);
            }
        }
    }
}
