use genmanip_assets::{Catalogue, panda, worlds::default_world};
use genmanip_core::glam::{DQuat, DVec3};
use genmanip_core::{Camera, Pose};
use genmanip_render::{Channels, FrameBuffers, FrameState, RenderAssets, RenderVariation, Renderer, ViewJob, encode};
use std::sync::Arc;

fn cpu() -> f64 {
    static START: std::sync::OnceLock<std::time::Instant> = std::sync::OnceLock::new();
    START.get_or_init(std::time::Instant::now).elapsed().as_secs_f64() * 1e3
}
fn hash(bytes: impl IntoIterator<Item = u8>) -> u64 {
    bytes.into_iter().fold(0xcbf2_9ce4_8422_2325, |h, b| (h ^ u64::from(b)).wrapping_mul(0x100_0000_01b3))
}
fn main() {
    let args: Vec<String> = std::env::args().collect();
    let text = std::fs::read_to_string(&args[1]).unwrap();
    let (w, h): (u32, u32) = (args[2].parse().unwrap(), args[3].parse().unwrap());
    let repeats: usize = args.get(4).map_or(1, |t| t.parse().unwrap());
    let which = args.get(5).cloned().unwrap_or_else(|| "both".into());
    let save = args.get(6).cloned();
    let catalogue = Catalogue::builtin();
    let mut objects = Vec::new();
    let mut rows: Vec<Vec<f64>> = Vec::new();
    for line in text.lines() {
        let words: Vec<&str> = line.split_whitespace().collect();
        if words.len() == 1 {
            objects.push(catalogue.build(words[0]).unwrap());
        } else {
            rows.push(words.iter().map(|t| t.parse().unwrap()).collect());
        }
    }
    let world = default_world();
    let assets = RenderAssets::new(panda(), &objects, Some(&world)).unwrap();
    let frames: Vec<FrameState> = rows
        .iter()
        .map(|row| {
            let n = row.len() - 7 * objects.len() - 1;
            let placed = row[n + 1..].chunks(7).map(|c| {
                (
                    Pose { position: DVec3::new(c[0], c[1], c[2]), rotation: DQuat::from_xyzw(c[3], c[4], c[5], c[6]) },
                    [].as_slice(),
                )
            });
            assets.frame_state(&row[..n], row[n], placed).unwrap()
        })
        .collect();
    let channels = Channels { rgb: true, depth: true, instance: true, normal: false, parts: false };
    let cameras: Vec<Camera> = ["static", "wrist"]
        .iter()
        .map(|name| {
            let c = world.camera(name).unwrap();
            Camera { intrinsics: c.intrinsics.filling(w, h), ..c.clone() }
        })
        .collect();
    let mut best = vec![vec![f64::INFINITY; frames.len()]; 2];
    let mut sums = [0u64; 2];
    let mut same = true;
    for repeat in 0..=repeats {
        let mut renderer = Renderer::new(Arc::clone(&assets), RenderVariation::default());
        let mut judge = Renderer::new(Arc::clone(&assets), RenderVariation::default());
        let mut out = [FrameBuffers::default()];
        for (f, frame) in frames.iter().enumerate() {
            for (i, camera) in cameras.iter().enumerate() {
                if which == "static" && i == 1 || which == "wrist" && i == 0 {
                    continue;
                }
                let job = ViewJob::new(frame, camera, channels);
                let start = cpu();
                renderer.render(&[job], &mut out).unwrap();
                let t = cpu() - start;
                if repeat > 0 {
                    best[i][f] = best[i][f].min(t);
                } else {
                    let mut anew = [FrameBuffers::default()];
                    judge.forget();
                    judge.render(&[job], &mut anew).unwrap();
                    same &= anew[0] == out[0];
                    let one = hash(
                        out[0]
                            .rgb
                            .iter()
                            .copied()
                            .chain(out[0].depth_m.iter().flat_map(|d| d.to_le_bytes()))
                            .chain(out[0].instance.iter().flat_map(|d| d.to_le_bytes())),
                    );
                    sums[i] = sums[i].wrapping_mul(31).wrapping_add(one);
                    if let Some(folder) = &save
                        && f % 12 == 5
                    {
                        std::fs::create_dir_all(folder).unwrap();
                        std::fs::write(
                            format!("{folder}/{}-{f}.png", ["static", "wrist"][i]),
                            encode::png_rgb(w, h, &out[0].rgb).unwrap(),
                        )
                        .unwrap();
                    }
                }
            }
        }
    }
    for i in 0..2 {
        let mut times = best[i].clone();
        if i == 0 {
            times.remove(0);
        }
        times.sort_by(f64::total_cmp);
        println!(
            "{} median {:.2} mean {:.2} hash {:016x}",
            ["static", "wrist"][i],
            times[times.len() / 2],
            times.iter().sum::<f64>() / times.len() as f64,
            sums[i]
        );
    }
    println!("same with reuse: {same}");
}
