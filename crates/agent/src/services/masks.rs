//! Segmentation masks from a server.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use genmanip_core::{Intrinsics, Pose, RgbdImage};
use genmanip_llm::Service;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::{read, transport_error};
use crate::segmentation::{Mask, SegmentError, SegmentQuestion, Segmenter};

/// Maximum number of masks accepted; automatic mask generators return a few hundred.
const MAX_MASKS: usize = 2000;
/// IoU threshold of non-maximum suppression, as in SAM's mask generator.
const SUPPRESSION_IOU: f64 = 0.8;
/// Maximum image side in a request (px).
const MAX_SIDE: u32 = 8192;

/// Request body of `POST /segment`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SegmentRequest {
    /// Size and projection of the image.
    pub intrinsics: Intrinsics,
    /// Camera pose; camera axes x right, y down, z forward; the world's z is up.
    pub world_from_camera: Pose,
    /// Colour: three bytes per pixel, row by row from the top left, 8-bit sRGB, in base64.
    pub rgb: String,
    /// Depth along the optical axis (m): 32-bit little-endian floats in the same order, 0 for none, in base64.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub depth_m: Option<String>,
    /// Pixels excluded from masks, e.g. those of the robot; none if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ignore: Option<RunLengths>,
    /// Pixels of an object to be segmented into parts; without it, the whole image is segmented into objects.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub within: Option<RunLengths>,
}

/// Response body; additional fields are ignored. The bare list that SAM 2's mask generator returns is accepted too,
/// with `predicted_iou` as score and compressed run lengths.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct SegmentReply {
    /// Masks of the segmented objects or parts.
    pub masks: Vec<ScoredMask>,
}

/// A mask with its score.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ScoredMask {
    /// Pixels of the mask, run-length encoded.
    pub segmentation: RunLengths,
    /// Confidence, higher is better; masks without a score keep the order of the response.
    #[serde(default)]
    pub score: Option<f64>,
}

/// A mask in COCO's uncompressed run-length encoding, as SAM 2 writes it with `uncompressed_rle`: column-major runs,
/// alternately outside and inside, starting outside.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct RunLengths {
    /// Number of rows, then of columns.
    pub size: [u32; 2],
    /// Lengths of the runs, pixels; the first one may be 0.
    pub counts: Vec<u32>,
}

impl RunLengths {
    /// Run lengths of a mask.
    pub fn of(mask: &Mask) -> Self {
        Self::of_pixels(mask.width, mask.height, &mask.pixels)
    }

    /// Run lengths of a mask given as row-major pixels.
    pub fn of_pixels(width: u32, height: u32, pixels: &[bool]) -> Self {
        let (mut counts, mut inside, mut run) = (Vec::new(), false, 0);
        for x in 0..width as usize {
            for y in 0..height as usize {
                let pixel = pixels.get(y * width as usize + x) == Some(&true);
                if pixel != inside {
                    counts.push(run);
                    (inside, run) = (pixel, 0);
                }
                run += 1;
            }
        }
        counts.push(run);
        Self { size: [height, width], counts }
    }

    /// Decodes the mask of an image of this size.
    ///
    /// # Errors
    /// Describes the inconsistency.
    pub fn mask(&self, width: u32, height: u32) -> Result<Mask, String> {
        if self.size != [height, width] {
            return Err(format!("size {:?}, expected {:?} (rows, columns)", self.size, [height, width]));
        }
        let all = u64::from(width) * u64::from(height);
        let sum = self.counts.iter().map(|run| u64::from(*run)).sum::<u64>();
        if sum != all {
            return Err(format!("its counts add up to {sum}, expected {all}"));
        }
        let mut pixels = vec![false; all as usize];
        let (mut place, mut inside) = (0, false);
        for &run in &self.counts {
            let covered = if inside { run as usize } else { 0 };
            for index in place..place + covered {
                let (x, y) = (index / height as usize, index % height as usize);
                pixels[y * width as usize + x] = true;
            }
            (place, inside) = (place + run as usize, !inside);
        }
        Ok(Mask { width, height, pixels })
    }
}

impl SegmentRequest {
    /// Request body of a question.
    pub fn of(question: &SegmentQuestion) -> Self {
        let image = question.image;
        let (width, height) = (image.width(), image.height());
        let depth: Vec<u8> = image.depth_m.iter().flat_map(|depth| depth.to_le_bytes()).collect();
        Self {
            intrinsics: image.intrinsics,
            world_from_camera: image.world_from_camera,
            rgb: STANDARD.encode(&image.rgb),
            depth_m: (!depth.is_empty()).then(|| STANDARD.encode(depth)),
            ignore: (!question.ignore.is_empty()).then(|| RunLengths::of_pixels(width, height, question.ignore)),
            within: question.within.map(RunLengths::of),
        }
    }

    /// Decodes the image, the excluded pixels, and the object to segment into parts.
    ///
    /// # Errors
    /// Describes the inconsistency.
    pub fn read(&self) -> Result<(RgbdImage, Vec<bool>, Option<Mask>), String> {
        let (width, height) = (self.intrinsics.width, self.intrinsics.height);
        let image = decode_image(self.intrinsics, self.world_from_camera, &self.rgb, self.depth_m.as_deref())?;
        let named = |name: &'static str| move |error: String| format!("{name}: {error}");
        let ignore = self.ignore.as_ref().map(|runs| runs.mask(width, height)).transpose().map_err(named("ignore"))?;
        let within = self.within.as_ref().map(|runs| runs.mask(width, height)).transpose().map_err(named("within"))?;
        Ok((image, ignore.map_or_else(Vec::new, |mask| mask.pixels), within))
    }
}

/// Decodes the image of a request: `rgb` and `depth_m` as in [`SegmentRequest`].
///
/// # Errors
/// Describes the inconsistency.
pub(crate) fn decode_image(
    intrinsics: Intrinsics,
    world_from_camera: Pose,
    rgb: &str,
    depth_m: Option<&str>,
) -> Result<RgbdImage, String> {
    let Intrinsics { width, height, fx, fy, cx, cy } = intrinsics;
    if !(1..=MAX_SIDE).contains(&width) || !(1..=MAX_SIDE).contains(&height) {
        return Err(format!("an image of {width} x {height} pixels, expected 1 to {MAX_SIDE} each way"));
    }
    if ![fx, fy, cx, cy].iter().all(|value| value.is_finite()) || fx <= 0.0 || fy <= 0.0 {
        return Err("intrinsics that are not finite, or no focal length".into());
    }
    let Pose { position, rotation } = world_from_camera;
    if !(position.is_finite() && rotation.is_finite() && (rotation.length() - 1.0).abs() < 1e-3) {
        return Err("world_from_camera is no finite pose".into());
    }
    let count = width as usize * height as usize;
    let bytes = |name: &str, text: &str, expected: usize| {
        let bytes = STANDARD.decode(text).map_err(|error| format!("{name} is no base64: {error}"))?;
        let got = bytes.len();
        (got == expected).then_some(bytes).ok_or_else(|| format!("{name} has {got} bytes, expected {expected}"))
    };
    let rgb = bytes("rgb", rgb, 3 * count)?;
    let depth = depth_m.map(|depth| bytes("depth_m", depth, 4 * count)).transpose()?.unwrap_or_default();
    let depth = depth.chunks_exact(4).map(|four| f32::from_le_bytes([four[0], four[1], four[2], four[3]])).collect();
    Ok(RgbdImage { rgb, ..RgbdImage::of_depth(intrinsics, world_from_camera, depth) })
}

/// [`Segmenter`] that requests masks from a service.
#[derive(Clone, Debug)]
pub struct ServiceMasks<S> {
    service: S,
}

impl<S: Service> ServiceMasks<S> {
    /// Segmenter that sends its requests to `service`.
    pub fn new(service: S) -> Self {
        Self { service }
    }
}

impl<S: Service> Segmenter for ServiceMasks<S> {
    /// Masks by descending score, without excluded pixels, after non-maximum suppression.
    fn segment(&self, question: &SegmentQuestion) -> Result<Vec<Mask>, SegmentError> {
        let asked = serde_json::to_value(SegmentRequest::of(question))
            .map_err(|error| SegmentError::Service(format!("the question cannot be written: {error}")))?;
        let answer = self.service.ask(&asked).map_err(|error| SegmentError::Service(transport_error(&error)))?;
        let reply: SegmentReply = normalised(answer).and_then(read).map_err(SegmentError::Service)?;
        masks_of(reply, question).map_err(SegmentError::Service)
    }
}

/// Converts an answer in any accepted form to the JSON of [`SegmentReply`]: a bare list and compressed run lengths are
/// rewritten.
fn normalised(answer: Value) -> Result<Value, String> {
    let mut answer = if answer.is_array() { json!({"masks": answer}) } else { answer };
    for (index, mask) in answer.get_mut("masks").and_then(Value::as_array_mut).into_iter().flatten().enumerate() {
        if let (None, Some(score)) = (mask.get("score"), mask.get("predicted_iou").cloned())
            && let Some(fields) = mask.as_object_mut()
        {
            fields.insert("score".into(), score);
        }
        if let Some(counts) = mask.pointer_mut("/segmentation/counts")
            && let Some(text) = counts.as_str()
        {
            *counts = decompressed(text).map_err(|error| format!("mask {index}: {error}"))?.into();
        }
    }
    Ok(answer)
}

/// Run lengths from COCO's compressed text: groups of five bits, least significant first. From the fourth run on, each
/// is stored as the difference from the run two before it.
fn decompressed(text: &str) -> Result<Vec<i64>, String> {
    let mut counts: Vec<i64> = Vec::new();
    let (mut value, mut shift) = (0_i64, 0);
    for byte in text.bytes() {
        let group = byte.checked_sub(48).filter(|group| *group < 64 && shift < 40);
        let group = i64::from(group.ok_or("its counts are neither numbers nor COCO's compressed text")?);
        value |= (group & 0x1f) << shift;
        shift += 5;
        if group & 0x20 != 0 {
            continue;
        }
        if group & 0x10 != 0 {
            value |= -1 << shift;
        }
        let before = if counts.len() > 2 { counts[counts.len() - 2] } else { 0 };
        counts.push(value.saturating_add(before));
        (value, shift) = (0, 0);
    }
    if shift == 0 { Ok(counts) } else { Err("its compressed counts end within a number".into()) }
}

fn masks_of(mut reply: SegmentReply, question: &SegmentQuestion) -> Result<Vec<Mask>, String> {
    if reply.masks.len() > MAX_MASKS {
        return Err(format!("the answer has {} masks, expected at most {MAX_MASKS}", reply.masks.len()));
    }
    if let Some(index) = reply.masks.iter().position(|mask| mask.score.is_some_and(|score| !score.is_finite())) {
        return Err(format!("the score of mask {index} is not finite"));
    }
    let (width, height) = (question.image.width(), question.image.height());
    let mut masks: Vec<(f64, Mask)> = Vec::new();
    for (index, scored) in reply.masks.drain(..).enumerate() {
        let mut mask = scored.segmentation.mask(width, height).map_err(|error| format!("mask {index}: {error}"))?;
        for (pixel, inside) in mask.pixels.iter_mut().enumerate() {
            let is_asked = question.within.is_none_or(|within| within.pixels.get(pixel) == Some(&true));
            *inside &= is_asked && question.ignore.get(pixel) != Some(&true);
        }
        masks.push((scored.score.unwrap_or(0.0), mask));
    }
    masks.sort_by(|one, other| other.0.total_cmp(&one.0));
    let mut kept: Vec<Mask> = Vec::new();
    for (_, mask) in masks {
        if mask.area() > 0 && kept.iter().all(|other| other.iou(&mask) < SUPPRESSION_IOU) {
            kept.push(mask);
        }
    }
    Ok(kept)
}

#[cfg(test)]
mod tests {
    use super::*;
    use genmanip_llm::ChatError;
    use proptest::prelude::*;

    struct Fixed(Value);

    impl Service for Fixed {
        fn ask(&self, _: &Value) -> Result<Value, ChatError> {
            Ok(self.0.clone())
        }
    }

    fn image() -> RgbdImage {
        let intrinsics = Intrinsics::from_vertical_fov(3, 2, 0.5);
        RgbdImage { rgb: (0..18).collect(), ..RgbdImage::of_depth(intrinsics, Pose::IDENTITY, vec![1.5; 6]) }
    }

    proptest! {
        #[test]
        fn runs_come_back(width in 1_u32..9, height in 1_u32..9, bits in prop::collection::vec(any::<bool>(), 81)) {
            let mask = Mask { width, height, pixels: bits[..(width * height) as usize].to_vec() };
            prop_assert_eq!(RunLengths::of(&mask).mask(width, height), Ok(mask));
        }
    }

    #[test]
    fn runs_are_those_of_coco() {
        // Three columns of two pixels: outside, inside, outside.
        let pixels = vec![false, true, false, false, true, false];
        let runs = RunLengths::of(&Mask { width: 3, height: 2, pixels });
        assert_eq!(runs, RunLengths { size: [2, 3], counts: vec![2, 2, 2] });
    }

    #[test]
    fn questions_come_back() {
        let (image, ignore) = (image(), vec![false, true, false, false, false, true]);
        let question = SegmentQuestion { image: &image, ignore: &ignore, within: None };
        let value = serde_json::to_value(SegmentRequest::of(&question)).unwrap();
        let request: SegmentRequest = serde_json::from_value(value).unwrap();
        assert_eq!(request.read(), Ok((image, ignore, None)));
    }

    #[test]
    fn the_best_of_like_masks_is_taken_and_ignored_pixels_are_left_out() {
        let answer = json!({"masks": [
            {"segmentation": {"size": [2, 3], "counts": [2, 4]}, "score": 0.5, "area": 4},
            {"segmentation": {"size": [2, 3], "counts": [2, 4]}, "score": 0.9},
            {"segmentation": {"size": [2, 3], "counts": [0, 2, 4]}},
            {"segmentation": {"size": [2, 3], "counts": [6]}},
        ]});
        let (image, ignore) = (image(), vec![true, false, false, false, false, false]);
        let question = SegmentQuestion { image: &image, ignore: &ignore, within: None };
        let masks = ServiceMasks::new(Fixed(answer)).segment(&question).unwrap();
        let inside: Vec<Vec<usize>> = masks.iter().map(|mask| mask.indices().collect()).collect();
        assert_eq!(inside, [vec![1, 2, 4, 5], vec![3]]);
    }

    /// Compressed run lengths as pycocotools writes them.
    fn compressed(counts: &[u32]) -> String {
        let mut text = String::new();
        for (index, &count) in counts.iter().enumerate() {
            let before = if index > 2 { i64::from(counts[index - 2]) } else { 0 };
            let mut left = i64::from(count) - before;
            loop {
                let group = left & 0x1f;
                left >>= 5;
                let is_last = if group & 0x10 != 0 { left == -1 } else { left == 0 };
                text.push(char::from(48 + u8::try_from(group).unwrap() + if is_last { 0 } else { 0x20 }));
                if is_last {
                    break;
                }
            }
        }
        text
    }

    proptest! {
        #[test]
        fn compressed_runs_come_back(counts in prop::collection::vec(0_u32..3_000_000, 0..20)) {
            let read: Vec<u32> =
                decompressed(&compressed(&counts)).unwrap().into_iter().map(|run| u32::try_from(run).unwrap()).collect();
            prop_assert_eq!(read, counts);
        }
    }

    #[test]
    fn the_list_of_sam_is_read() {
        assert_eq!(decompressed("222"), Ok(vec![2, 2, 2]));
        assert_eq!(decompressed("0\\95:"), Ok(vec![0, 300, 5, 310]));
        let mask = |counts: &str, iou: f64| {
            json!({"segmentation": {"size": [2, 3], "counts": counts}, "area": 4, "bbox": [0, 0, 3, 2],
                "predicted_iou": iou, "point_coords": [[1.0, 1.0]], "stability_score": 0.97, "crop_box": [0, 0, 3, 2]})
        };
        let image = image();
        let question = SegmentQuestion { image: &image, ignore: &[], within: None };
        let masks = ServiceMasks::new(Fixed(json!([mask("222", 0.8), mask("04", 0.9)]))).segment(&question);
        assert!(masks.unwrap_err().to_string().contains("mask 1: its counts add up to 4"));
        let masks = ServiceMasks::new(Fixed(json!([mask("222", 0.8), mask("024", 0.9)]))).segment(&question).unwrap();
        let inside: Vec<Vec<usize>> = masks.iter().map(|mask| mask.indices().collect()).collect();
        assert_eq!(inside, [vec![0, 3], vec![1, 4]], "the better one first");
        assert_eq!(ServiceMasks::new(Fixed(json!([]))).segment(&question).unwrap(), []);
    }

    #[test]
    fn hostile_answers_are_one_clear_error() {
        let runs = |counts: Value| json!({"masks": [{"segmentation": {"size": [2, 3], "counts": counts}}]});
        let cases = [
            (json!(7), "the segmentation service: its answer is wrong at ."),
            (runs(json!("a~")), "mask 0: its counts are neither numbers nor COCO's compressed text"),
            (runs(json!("2P")), "mask 0: its compressed counts end within a number"),
            (runs(json!("2O")), "the segmentation service: its answer is wrong at masks[0].segmentation.counts[1]: "),
            (json!({"masks": 7}), "the segmentation service: its answer is wrong at masks: "),
            (
                runs(json!([-1, 7])),
                "the segmentation service: its answer is wrong at masks[0].segmentation.counts[0]: ",
            ),
            (
                runs(json!([4_294_967_295_u32, 4_294_967_295_u32])),
                "mask 0: its counts add up to 8589934590, expected 6",
            ),
            (runs(json!([5])), "mask 0: its counts add up to 5, expected 6"),
            (
                json!({"masks": [{"segmentation": {"size": [9, 9], "counts": [81]}}]}),
                "mask 0: size [9, 9], expected [2, 3]",
            ),
            (json!({"masks": vec![json!({"segmentation": {"size": [2, 3], "counts": [6]}}); 2001]}), "2001 masks"),
        ];
        let image = image();
        for (answer, expected) in cases {
            let question = SegmentQuestion { image: &image, ignore: &[], within: None };
            let error = ServiceMasks::new(Fixed(answer)).segment(&question).unwrap_err().to_string();
            assert!(error.contains(expected) && error.len() < 400, "{error}");
        }
    }
}
