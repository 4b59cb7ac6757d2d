use sha2::{Digest, Sha256};

use super::*;

const WIDTH: usize = 512;
const HEIGHT: usize = 288;

/// Synthetic image resembling a rendered table: soft shading, a wood-like grain, a moving disk with a smooth edge.
fn scene(index: usize) -> Vec<u8> {
    let (cx, cy) = (150.0 + 4.0 * index as f64, 120.0 + 2.0 * index as f64);
    let mut rgb = Vec::with_capacity(WIDTH * HEIGHT * 3);
    for y in 0..HEIGHT {
        for x in 0..WIDTH {
            let (x, y) = (x as f64, y as f64);
            let grain = 6.0 * (0.35 * y + 2.0 * (0.02 * x).sin()).sin();
            let shade = 150.0 + 0.12 * x - 0.1 * y + grain;
            let cover = (40.5 - ((x - cx).powi(2) + (y - cy).powi(2)).sqrt()).clamp(0.0, 1.0);
            let light = 0.6 + 0.4 * ((x - cx) * 0.02).cos();
            let mix = |table: f64, disk: f64| (table * (1.0 - cover) + disk * light * cover).clamp(0.0, 255.0) as u8;
            rgb.extend([mix(shade, 200.0), mix(shade * 0.85, 60.0), mix(shade * 0.7, 50.0)]);
        }
    }
    rgb
}

fn encode(count: usize, settings: &VideoSettings) -> EncodedVideo {
    let mut encoder = VideoEncoder::new(WIDTH as u32, HEIGHT as u32, 15, settings).unwrap();
    for index in 0..count {
        encoder.push(&scene(index)).unwrap();
    }
    encoder.finish()
}

/// Luma planes of the decoded frames.
fn decode_luma(video: &EncodedVideo) -> Vec<Vec<u8>> {
    let config = DecoderConfig::new().flush_after_decode(Flush::NoFlush);
    let mut decoder = Decoder::with_api_config(OpenH264API::from_source(), config).unwrap();
    let mut planes = Vec::new();
    let mut keep = |image: &dyn Fn(usize) -> Vec<u8>| planes.push((0..HEIGHT).flat_map(image).collect());
    for frame in &video.frames {
        if let Some(image) = decoder.decode(frame).unwrap() {
            keep(&|row| image.y()[row * image.strides().0..][..WIDTH].to_vec());
        }
    }
    for image in decoder.flush_remaining().unwrap() {
        keep(&|row| image.y()[row * image.strides().0..][..WIDTH].to_vec());
    }
    planes
}

fn psnr(a: &[u8], b: &[u8]) -> f64 {
    let squares: f64 = a.iter().zip(b).map(|(a, b)| (f64::from(*a) - f64::from(*b)).powi(2)).sum();
    10.0 * (255.0_f64.powi(2) / (squares / a.len() as f64)).log10()
}

/// Encoding and decoding preserve colours.
#[test]
fn decoding_preserves_colours() {
    let video = encode(5, &VideoSettings::default());
    let mut index = 0;
    decode(&video, &mut |rgb| {
        assert_eq!(rgb.len(), WIDTH * HEIGHT * 3);
        for channel in 0..3 {
            let far: u64 =
                rgb.iter().zip(scene(index)).skip(channel).step_by(3).map(|(a, b)| u64::from(a.abs_diff(b))).sum();
            let mean = far as f64 / (WIDTH * HEIGHT) as f64;
            assert!(mean < 2.0, "frame {index}, channel {channel}: {mean} of 255 on average");
        }
        index += 1;
        Ok(())
    })
    .unwrap();
    assert_eq!(index, 5);
    let cut = EncodedVideo { frames: video.frames[1..].to_vec(), ..video };
    assert!(decode(&cut, &mut |_| Ok(())).is_err(), "the parameter sets are missing");
}

#[test]
fn default_quality_is_above_40_db() {
    let video = encode(12, &VideoSettings::default());
    let decoded = decode_luma(&video);
    assert_eq!(decoded.len(), 12, "no frame is skipped");
    for (index, luma) in decoded.iter().enumerate() {
        let quality_db = psnr(luma, &yuv::from_rgb(&scene(index), WIDTH, HEIGHT).y);
        assert!(quality_db > 40.0, "frame {index}: {quality_db:.1} dB");
    }
}

#[test]
fn equal_images_give_equal_bytes() {
    let first = encode(8, &VideoSettings::default());
    assert_eq!(encode(8, &VideoSettings::default()), first);
    let again = std::thread::spawn(|| encode(8, &VideoSettings::default())).join().unwrap();
    assert_eq!(again, first);
    assert_eq!(mux_mp4([&first, &again]).unwrap(), mux_mp4([&again, &first]).unwrap());
    assert_eq!(split(&first.to_bytes(), &first.frame_bytes()).unwrap(), first.frames);
}

/// Videos are identical on every machine, regardless of the encoder's assembly and the processor, as data sets of
/// different machines are merged. The hash is from a build without assembly; one with it gave the same.
#[test]
fn videos_are_the_same_on_every_machine() {
    // Integer arithmetic only, and motion by fractions of pixels, so that all prediction modes are used.
    let pixel = |x: usize, y: usize, index: usize| {
        let (moved, wave) = (x * 4 + index * 9, (x * x + 3 * y * y) / 64);
        let object = moved.abs_diff(400) + y.abs_diff(90) * 4 < 200;
        let grain = (x * 7919 + y * 104_729 + index * 31) % 97 % 5;
        [(wave + grain) % 256, (moved / 8 + y) % 256, if object { moved * 2 % 256 } else { y / 2 + grain }]
            .map(|value| value as u8)
    };
    let mut encoder = VideoEncoder::new(256, 144, 15, &VideoSettings { gop: 4, ..Default::default() }).unwrap();
    for index in 0..8 {
        let rows = (0..144).flat_map(|y| (0..256).flat_map(move |x| pixel(x, y, index)));
        encoder.push(&rows.collect::<Vec<_>>()).unwrap();
    }
    let video = encoder.finish().to_bytes();
    let hash = Sha256::digest(&video).iter().map(|byte| format!("{byte:02x}")).collect::<String>();
    assert_eq!(
        (video.len(), hash.as_str()),
        (32_498, "4423a493966ba81bbca58d17da8165f2a8f37da2be4cc032f5f63923c816e339")
    );
}

#[test]
fn groups_start_with_key_frames() {
    for gop in [1, 2, 5] {
        let video = encode(6, &VideoSettings { gop, ..Default::default() });
        let keys: Vec<bool> = video.frames.iter().map(|frame| is_keyframe(frame)).collect();
        let expected: Vec<bool> = (0..6).map(|index| index % gop == 0).collect();
        assert_eq!(keys, expected, "gop {gop}");
    }
}

#[test]
fn invalid_input_is_rejected() {
    let check = |outcome: Result<(), DataError>, expected: &str| {
        let message = outcome.unwrap_err().to_string();
        assert!(message.contains(expected), "expected `{expected}` in `{message}`");
    };
    let new = |width, height, fps, settings: &VideoSettings| VideoEncoder::new(width, height, fps, settings).map(drop);
    check(new(511, 288, 15, &VideoSettings::default()), "got 511×288");
    check(new(512, 0, 15, &VideoSettings::default()), "got 512×0");
    check(new(512, 288, 0, &VideoSettings::default()), "1 to 240");
    check(new(512, 288, 15, &VideoSettings { gop: 0, ..Default::default() }), "gop ≥ 1");
    check(new(512, 288, 15, &VideoSettings { qp: 52, ..Default::default() }), "qp ≤ 51");
    let mut encoder = VideoEncoder::new(512, 288, 15, &VideoSettings::default()).unwrap();
    check(encoder.push(&[0; 100]), "expected 442368, got 100");
    check(mux_mp4([]).map(drop), "no video");
    let (a, mut b) = (encode(2, &VideoSettings::default()), encode(2, &VideoSettings::default()));
    b.fps = 30;
    check(mux_mp4([&a, &b]).map(drop), "512×288 at 30 fps");
    check(split(b"abc", &[1, 1]).map(drop), "expected 3, got 2");
}

#[test]
fn colors_follow_bt601() {
    // Reference values of the standard for full-scale primaries.
    let cases = [
        ([0, 0, 0], [16, 128, 128]),
        ([255, 255, 255], [235, 128, 128]),
        ([255, 0, 0], [81, 90, 240]),
        ([0, 255, 0], [145, 54, 34]),
        ([0, 0, 255], [41, 240, 110]),
        ([128, 128, 128], [126, 128, 128]),
    ];
    for (rgb, expected) in cases {
        let image = yuv::from_rgb(&rgb.repeat(4), 2, 2);
        assert_eq!([image.y[3], image.u[0], image.v[0]], expected, "{rgb:?}");
    }
}

/// Prints size, quality and speed for several quantisers: `cargo test --release -p genmanip-data -- --ignored --nocapture`.
#[test]
#[ignore = "a measurement"]
#[allow(clippy::print_stdout)]
fn measure_quantisers() {
    for qp in [18, 20, 22, 24, 26, 28] {
        let start = std::time::Instant::now();
        let video = encode(60, &VideoSettings { gop: 2, qp });
        let seconds = start.elapsed().as_secs_f64();
        let worst = decode_luma(&video)
            .iter()
            .enumerate()
            .map(|(index, luma)| psnr(luma, &yuv::from_rgb(&scene(index), WIDTH, HEIGHT).y))
            .fold(f64::INFINITY, f64::min);
        let bytes = video.to_bytes().len() / 60;
        println!(
            "qp {qp}: {bytes} bytes per frame, worst {worst:.1} dB, {seconds:.2} s for 60 frames (image generation included)"
        );
    }
}
