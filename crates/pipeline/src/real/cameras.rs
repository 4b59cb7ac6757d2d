//! Cameras of a real robot: images from the bridge or from files that another program writes.

use std::collections::BTreeMap;
use std::io::Cursor;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use genmanip_core::limits::{self, Limit};
use genmanip_core::{Camera, CameraRequest, RgbdImage, RobotModel};
use genmanip_data::depth::decode_depth_png;
use genmanip_data::files;
use genmanip_real::bridge::CameraImage;
use genmanip_real::bridge::client::{ArmClient, Connection};
use genmanip_rollout::RolloutError;
use genmanip_workspace::WorkspaceError;
use serde::{Deserialize, Serialize};

/// Sources of the images, by the name of the camera in the world.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Rig {
    /// Sources; a camera without one comes from the bridge, under its own name.
    pub cameras: BTreeMap<String, Source>,
}

/// Source of the images of a camera.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "source", rename_all = "snake_case", deny_unknown_fields)]
pub enum Source {
    /// The bridge.
    Bridge {
        /// Name of the camera there.
        name: String,
    },
    /// A folder in which another program keeps the latest image: `color.png` (8 bits per channel) and, for depth,
    /// `depth.png` (16 bits, millimetres along the optical axis, aligned with the colours, 0 where unknown).
    Folder {
        /// The folder.
        folder: PathBuf,
        /// Largest age of an image, s.
        #[serde(default = "oldest_s")]
        oldest_s: f64,
    },
}

/// Default of the largest age of an image, s: several images of any camera.
fn oldest_s() -> f64 {
    1.0
}

/// Largest image file, bytes.
const IMAGE: Limit = limits::ATTACHMENT;

impl Rig {
    /// Reads the sources from a JSON file.
    ///
    /// # Errors
    /// When the file cannot be read, or is no list of sources.
    pub fn read(path: &Path) -> Result<Self, WorkspaceError> {
        let bytes = genmanip_workspace::documents::read_bytes(path, limits::WORLD_OR_SCENARIO)?;
        serde_json::from_slice(&bytes).map_err(|error| {
            WorkspaceError::input(format!("{} is no list of cameras", path.display())).because(error).with_hint(
                "such as {\"cameras\": {\"static\": {\"source\": \"folder\", \"folder\": \"/dev/shm/static\"}}}",
            )
        })
    }

    /// False for a camera that is known to give colours alone.
    pub fn gives_depth(&self, camera: &str) -> bool {
        match self.cameras.get(camera) {
            Some(Source::Folder { folder, .. }) => folder.join("depth.png").is_file(),
            _ => true,
        }
    }

    /// Image of a camera for a policy.
    ///
    /// # Errors
    /// If the source gives none, one of another shape than the calibrated camera's, or one that is too old.
    pub fn image<C: Connection>(
        &self,
        client: &mut ArmClient<C>,
        robot: &RobotModel,
        camera: &Camera,
        request: &CameraRequest,
    ) -> Result<RgbdImage, RolloutError> {
        let name = &request.name;
        if request.channels.ids || request.channels.normals {
            return Err(broken(name, "instance ids and normals are not measured by a real camera".into()));
        }
        let wanted = Some([camera.intrinsics.width, camera.intrinsics.height]);
        let taken = match self.cameras.get(name) {
            None => client.image(name, wanted).map_err(|error| broken(name, error.to_string()))?,
            Some(Source::Bridge { name: there }) => {
                client.image(there, wanted).map_err(|error| broken(name, error.to_string()))?
            }
            Some(Source::Folder { folder, oldest_s }) => {
                let exposed_s = client.state().measured_s;
                read_folder(folder, *oldest_s, exposed_s).map_err(|why| broken(name, why))?
            }
        };
        if request.channels.depth && taken.depth_m.is_empty() {
            return Err(broken(name, "the policy needs depth, and the camera gives none".into()));
        }
        developed(taken, client, robot, camera, request).map_err(|why| broken(name, why))
    }
}

fn broken(camera: &str, why: String) -> RolloutError {
    RolloutError::Robot(format!("camera `{camera}`: {why}").into())
}

/// The image at the size of the request, with the pose of the camera at its exposure.
fn developed<C: Connection>(
    taken: CameraImage,
    client: &ArmClient<C>,
    robot: &RobotModel,
    camera: &Camera,
    request: &CameraRequest,
) -> Result<RgbdImage, String> {
    let size = [camera.intrinsics.width, camera.intrinsics.height];
    let from = [taken.head.width, taken.head.height];
    // Resized alike in both directions, unless the policy asks for other pixels than the camera's.
    let is_like = u64::from(from[0]) * u64::from(size[1]) == u64::from(from[1]) * u64::from(size[0]);
    if request.size.is_none() && !is_like {
        let [width, height] = from;
        return Err(format!(
            "its images have {width} x {height} pixels, the calibrated camera has {} x {}",
            size[0], size[1]
        ));
    }
    let positions = client.positions_at(taken.head.exposed_s);
    let width_m = client.state().gripper.map_or(0.0, |gripper| gripper.width_m);
    let world_from_hand = robot.link_poses(positions, width_m)[robot.hand];
    let depth_m = if request.channels.depth || request.channels.points {
        resized_depth(&taken.depth_m, from, size)
    } else {
        Vec::new()
    };
    let mut image = RgbdImage {
        distortion: camera.distortion,
        rgb: if request.channels.rgb { resized_color(&taken.rgb, from, size) } else { Vec::new() },
        ..RgbdImage::of_depth(camera.intrinsics, camera.world_from_camera(&world_from_hand), depth_m)
    };
    if request.channels.points {
        let pixels = size[0] as usize * size[1] as usize;
        let point = |index| image.point(index).map_or([f32::NAN; 3], |point| point.as_vec3().to_array());
        image.points_m = (0..pixels).map(point).collect();
    }
    Ok(image)
}

/// Colours at another size: the mean of the pixels that a new one covers.
fn resized_color(rgb: &[u8], from: [u32; 2], to: [u32; 2]) -> Vec<u8> {
    if from == to {
        return rgb.to_vec();
    }
    let [columns, rows] = [0, 1].map(|axis| spans(from[axis], to[axis]));
    let stride = from[0] as usize;
    let mut out = Vec::with_capacity(3 * columns.len() * rows.len());
    for &(top, bottom) in &rows {
        for &(left, right) in &columns {
            let mut sums = [0_u32; 3];
            for row in top..bottom {
                for pixel in rgb[3 * (row * stride + left)..3 * (row * stride + right)].as_chunks::<3>().0 {
                    sums.iter_mut().zip(pixel).for_each(|(sum, value)| *sum += u32::from(*value));
                }
            }
            let count = ((bottom - top) * (right - left)) as u32;
            out.extend(sums.map(|sum| ((sum + count / 2) / count) as u8));
        }
    }
    out
}

/// Depth at another size: that of the pixel in the middle, since means of depths lie between surfaces.
fn resized_depth(depth_m: &[f32], from: [u32; 2], to: [u32; 2]) -> Vec<f32> {
    if from == to || depth_m.is_empty() {
        return depth_m.to_vec();
    }
    let [columns, rows] = [0, 1].map(|axis| spans(from[axis], to[axis]));
    let middle = |(first, last): &(usize, usize)| usize::midpoint(*first, last - 1);
    let row = |span| columns.iter().map(move |column| depth_m[middle(span) * from[0] as usize + middle(column)]);
    rows.iter().flat_map(row).collect()
}

/// Pixels that each new pixel of an axis covers, at least one.
fn spans(from: u32, to: u32) -> Vec<(usize, usize)> {
    let bound = |index: u32| (u64::from(index) * u64::from(from) / u64::from(to)) as usize;
    (0..to).map(|index| (bound(index), bound(index + 1).max(bound(index) + 1))).collect()
}

/// Latest image in a folder.
fn read_folder(folder: &Path, oldest_s: f64, exposed_s: f64) -> Result<CameraImage, String> {
    let color = folder.join("color.png");
    let written = std::fs::metadata(&color).and_then(|data| data.modified());
    let written = written.map_err(|error| format!("{} cannot be read: {error}", color.display()))?;
    let age_s = SystemTime::now().duration_since(written).map_or(0.0, |age| age.as_secs_f64());
    if age_s > oldest_s {
        return Err(format!("{} is {age_s:.1} s old, at most {oldest_s} s are expected", color.display()));
    }
    let bytes = files::read(&color, IMAGE).map_err(|error| error.to_string())?;
    let (width, height, rgb) = decode_color(bytes).map_err(|error| format!("{}: {error}", color.display()))?;
    let path = folder.join("depth.png");
    let depth_m = if path.is_file() {
        let bytes = files::read(&path, IMAGE).map_err(|error| error.to_string())?;
        let (columns, rows, depth_mm) = decode_depth_png(&bytes).map_err(|error| error.to_string())?;
        if (columns, rows) != (width, height) {
            return Err(format!(
                "{} has {columns} x {rows} pixels, the colours have {width} x {height}: align depth with colour",
                path.display()
            ));
        }
        depth_mm.into_iter().map(|depth_mm| f32::from(depth_mm) / 1000.0).collect()
    } else {
        Vec::new()
    };
    let head = genmanip_real::bridge::ImageHead {
        camera: folder.display().to_string(),
        width,
        height,
        has_depth: !depth_m.is_empty(),
        exposed_s,
    };
    Ok(CameraImage { head, rgb, depth_m })
}

fn decode_color(bytes: Vec<u8>) -> Result<(u32, u32, Vec<u8>), String> {
    let mut decoder = png::Decoder::new_with_limits(Cursor::new(bytes), png::Limits { bytes: 256 << 20 });
    decoder.set_transformations(png::Transformations::normalize_to_color8());
    let mut reader = decoder.read_info().map_err(|error| error.to_string())?;
    let size = reader.output_buffer_size().ok_or("the image is too large")?;
    let mut pixels = vec![0; size];
    let info = reader.next_frame(&mut pixels).map_err(|error| error.to_string())?;
    pixels.truncate(info.buffer_size());
    let rgb = match info.color_type {
        png::ColorType::Rgb => pixels,
        png::ColorType::Rgba => pixels.as_chunks::<4>().0.iter().flat_map(|&[r, g, b, _]| [r, g, b]).collect(),
        other => return Err(format!("expected colours, got {other:?}")),
    };
    Ok((info.width, info.height, rgb))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn images_are_resized_by_means_and_depth_by_the_middle() {
        let rgb: Vec<u8> = (0..4 * 2 * 3).map(|value| value as u8 * 10).collect();
        // Means of the red of pixels 0, 1, 4, 5: (0 + 30 + 120 + 150) / 4.
        assert_eq!(resized_color(&rgb, [4, 2], [2, 1])[0], 75);
        assert_eq!(resized_color(&rgb, [4, 2], [4, 2]), rgb);
        assert_eq!(resized_color(&rgb, [4, 2], [8, 4]).len(), 8 * 4 * 3);
        let depth: Vec<f32> = (0..8).map(|value| value as f32).collect();
        assert_eq!(resized_depth(&depth, [4, 2], [2, 1]), [0.0, 2.0]);
        assert_eq!(spans(3, 2), [(0, 1), (1, 3)]);
    }

    #[test]
    fn a_folder_gives_its_latest_image() {
        let folder = tempfile::tempdir().unwrap();
        let missing = read_folder(folder.path(), 1.0, 0.0).unwrap_err();
        assert!(missing.contains("color.png"), "{missing}");
        let png = genmanip_render::encode::png_rgb(2, 1, &[1, 2, 3, 4, 5, 6]).unwrap();
        std::fs::write(folder.path().join("color.png"), png).unwrap();
        let image = read_folder(folder.path(), 60.0, 0.25).unwrap();
        assert_eq!((image.rgb.as_slice(), image.depth_m.len()), (&[1, 2, 3, 4, 5, 6][..], 0));
        let depth = genmanip_data::depth::encode_mm_png(&[500, 0], 2, 1).unwrap();
        std::fs::write(folder.path().join("depth.png"), depth).unwrap();
        assert_eq!(read_folder(folder.path(), 60.0, 0.25).unwrap().depth_m, [0.5, 0.0]);
        let depth = genmanip_data::depth::encode_mm_png(&[500], 1, 1).unwrap();
        std::fs::write(folder.path().join("depth.png"), depth).unwrap();
        assert!(read_folder(folder.path(), 60.0, 0.25).unwrap_err().contains("align depth"));
        assert!(read_folder(folder.path(), 0.0, 0.25).unwrap_err().contains("s old"));
    }
}
