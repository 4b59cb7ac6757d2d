//! Held-out views of hidden worlds: images in the default and in the matched world, and their differences to the truth.

use std::path::Path;
use std::sync::Arc;

use genmanip_core::{CameraAppearance, ObjectModel, Pose, World};
use genmanip_render::{Channels, FrameBuffers, NOTHING, RenderVariation, Renderer, ViewJob, encode};
use genmanip_visual_matching::difference::delta_e;
use genmanip_visual_matching::flip::{PIXELS_PER_DEGREE, flip};
use genmanip_visual_matching::{Matched, Photo};
use genmanip_workspace::{WorkspaceError, documents};

use super::hidden::{Hidden, SIZE_PX, broken, posed};
use crate::quantile::Spread;

/// Arm posture of held-out views, rad: turned away from home.
pub const OTHER_POSTURE: [f64; 7] = [0.45, 0.1, -0.2, -2.0, 0.1, 2.1, 0.6];

/// Difference of one held-out view: mean ΔE2000 and FLIP.
#[derive(Clone, Copy)]
pub struct Difference {
    pub delta_e: f64,
    pub flip: f64,
}

/// Differences of a held-out view to the truth, in the default world and in the matched one. Kind 0 is the photographed
/// view with other objects and another posture of the arm; kind 1 is another place of the same camera, without background,
/// which nothing tells there.
pub fn held_out(
    hidden: &Hidden,
    matched: &Matched,
    kind: usize,
    index: usize,
    out: Option<&Path>,
) -> Result<[Difference; 2], WorkspaceError> {
    let truth = hidden.photo(kind, Some(&OTHER_POSTURE), &hidden.objects[1], ["same", "new"][kind])?;
    let mut world = matched.world.clone();
    if let Some(appearance) = &mut world.appearance {
        let response = matched.cameras[0].response.clone();
        let camera = hidden.world.cameras[1].name.clone();
        appearance.cameras.push(CameraAppearance { camera, response, photograph: None });
    }
    let [before, after] = [&hidden.world, &world].map(|world| drawn(hidden, world, kind, &hidden.objects[1]));
    let (before, after) = (before?, after?);
    if let Some(folder) = out {
        let name = ["same", "new"][kind];
        let sheet: [(&str, &[u8]); 3] = [("truth", &truth.rgb), ("before", &before.rgb), ("after", &after.rgb)];
        write_sheet(&folder.join(format!("{index:02}_{name}.png")), &sheet)?;
    }
    let counts = |at: usize| kind == 0 || before.instance[at] != NOTHING;
    Ok([&before, &after].map(|image| difference(&truth, image, &counts)))
}

/// Image of objects in a world, with the arm in the posture of held-out views.
pub fn drawn(
    hidden: &Hidden,
    world: &World,
    camera: usize,
    objects: &[(Arc<ObjectModel>, Pose)],
) -> Result<FrameBuffers, WorkspaceError> {
    let (assets, frame) = posed(world, &hidden.robot, Some(&OTHER_POSTURE), objects)?;
    let variation = RenderVariation::of_world(world).map_err(broken)?;
    let mut out = [FrameBuffers::default()];
    let job = ViewJob::new(&frame, &world.cameras[camera], Channels { instance: true, ..Channels::RGB });
    Renderer::new(assets, variation).render(&[job], &mut out).map_err(broken)?;
    let [image] = out;
    Ok(image)
}

/// Difference of an image to a photograph over the pixels that count.
pub fn difference(truth: &Photo, image: &FrameBuffers, counts: &dyn Fn(usize) -> bool) -> Difference {
    let mean = |values: &mut dyn Iterator<Item = f64>| {
        let (sum, count) = values.fold((0.0, 0.0_f64), |(sum, count), value| (sum + value, count + 1.0));
        sum / count.max(1.0)
    };
    let colors = delta_e(&truth.rgb, &image.rgb);
    let flips = flip(&truth.rgb, &image.rgb, image.width as usize, PIXELS_PER_DEGREE).unwrap_or_default();
    let chosen = |at: &usize| counts(*at);
    Difference {
        delta_e: mean(&mut (0..colors.len()).filter(chosen).map(|at| colors[at])),
        flip: mean(&mut (0..flips.len()).filter(chosen).map(|at| f64::from(flips[at]))),
    }
}

/// Images side by side.
fn write_sheet(path: &Path, images: &[(&str, &[u8])]) -> Result<(), WorkspaceError> {
    let [width, height] = SIZE_PX.map(|side| side as usize);
    let rows = (0..height).flat_map(|row| images.iter().map(move |(_, rgb)| &rgb[row * width * 3..][..width * 3]));
    let sheet: Vec<u8> = rows.flatten().copied().collect();
    let png = encode::png_rgb((width * images.len()) as u32, height as u32, &sheet).map_err(broken)?;
    documents::write_file(path, &png)
}

/// Medians before and after.
pub fn medians(views: &[[Difference; 2]], value: fn(&Difference) -> f64) -> [f64; 2] {
    [0, 1].map(|side| Spread::of(views.iter().map(|pair| value(&pair[side])).collect()).median)
}
