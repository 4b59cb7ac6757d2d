//! `genmanip doctor`: checks of this machine: what is installed, what is missing and how to fix it.

use std::path::Path;
use std::process::Command;
use std::sync::Arc;

use genmanip_assets::panda;
use genmanip_assets::worlds::default_world;
use genmanip_sim::{Model, Sim};
use genmanip_workspace::text_table;
use serde::Serialize;

use genmanip_terminal::Printer;
use genmanip_terminal::{ExitStatus, Failed};

/// Number of control steps of the physics test.
const HELD_STEPS: usize = 6;

#[derive(Serialize)]
struct Finding {
    what: &'static str,
    ok: bool,
    /// True if `collect` and `evaluate` do not work without it.
    needed: bool,
    found: String,
    mend: String,
}

pub fn run(printer: &Printer) -> Result<ExitStatus, Failed> {
    let findings = [processor(), physics(), python(), disk()];
    let mut rows = vec![["", "part", "found", "how to fix it"].map(String::from).to_vec()];
    for finding in &findings {
        let mark = match (finding.ok, finding.needed) {
            (true, _) => "ok",
            (false, true) => "missing",
            (false, false) => "optional",
        };
        rows.push(vec![mark.into(), finding.what.into(), finding.found.clone(), finding.mend.clone()]);
    }
    printer.data(&findings, &text_table(&rows));
    Ok(if findings.iter().all(|finding| finding.ok || !finding.needed) { ExitStatus::Done } else { ExitStatus::NotMet })
}

fn processor() -> Finding {
    processor_with(std::thread::available_parallelism().map_or(1, usize::from), has_fused_products())
}

/// Finding on the processor. Rendering times without AVX2 or fused multiply-add were measured in emulation, see
/// docs/benchmark.md.
fn processor_with(cores: usize, has_fused_products: bool) -> Finding {
    let found = format!("{cores} cores, {} {}", std::env::consts::ARCH, std::env::consts::OS);
    let (found, mend) = match has_fused_products {
        true => (found, String::new()),
        false => (
            format!("{found}, without AVX2 or FMA: images take three to four times as long"),
            "let a virtual machine see the processor as it is (in QEMU `-cpu host`), if it is one".into(),
        ),
    };
    Finding { what: "processor", ok: has_fused_products, needed: false, found, mend }
}

/// True if the processor has fused multiply-add instructions (on x86-64 also AVX2), which rendering uses.
fn has_fused_products() -> bool {
    #[cfg(target_arch = "x86_64")]
    {
        is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma")
    }
    #[cfg(not(target_arch = "x86_64"))]
    {
        true
    }
}

/// Compiles the robot and holds it at home for a few control steps, which proves that the physics library is linked and
/// works.
fn physics() -> Finding {
    let robot = panda();
    let stay: Vec<f32> = robot.home.iter().chain([&robot.gripper.max_width]).map(|&value| value as f32).collect();
    let simulated = Model::compile(&default_world(), &robot, &[]).and_then(|scene| {
        let mut sim = Sim::new(Arc::new(scene));
        for _ in 0..HELD_STEPS {
            sim.control_step(&stay)?;
        }
        Ok(sim.time_s())
    });
    let engine = genmanip_sim::engine_version();
    let (ok, found, mend) = match simulated {
        Ok(seconds) => (true, format!("{engine}, {} simulated for {seconds:.2} s", robot.name), String::new()),
        Err(error) => (false, format!("{engine}: {error}"), "run `cargo xtask setup` and build again".into()),
    };
    Finding { what: "physics", ok, needed: true, found, mend }
}

/// Finding on the Python environment whose reader checks datasets independently.
fn python() -> Finding {
    let interpreter = std::env::var("GENMANIP_PYTHON").unwrap_or_else(|_| ".python/bin/python".into());
    let probe = Command::new(&interpreter)
        .args(["-c", "import pyarrow, av; print(f'pyarrow {pyarrow.__version__}, av {av.__version__}')"])
        .output();
    match probe {
        Ok(output) if output.status.success() => Finding {
            what: "dataset reader",
            ok: true,
            needed: false,
            found: String::from_utf8_lossy(&output.stdout).trim().to_owned(),
            mend: String::new(),
        },
        _ => Finding {
            what: "dataset reader",
            ok: false,
            needed: false,
            found: format!("{interpreter} has no pyarrow and av"),
            mend: "run `cargo xtask setup` (only needed to check datasets with another program)".into(),
        },
    }
}

fn disk() -> Finding {
    let here = Path::new(".");
    let probe = here.join(format!(".genmanip-doctor-{}", std::process::id()));
    let writable = std::fs::write(&probe, b"x").is_ok();
    let _ = std::fs::remove_file(&probe);
    Finding {
        what: "current folder",
        ok: writable,
        needed: true,
        found: if writable { "writable".into() } else { "not writable".into() },
        mend: if writable { String::new() } else { "change to a folder you may write to".into() },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_processor_without_fused_products_will_do() {
        let [full, plain] = [true, false].map(|has| processor_with(2, has));
        assert!(full.ok && full.mend.is_empty() && full.found.starts_with("2 cores, "));
        assert!(!plain.ok && !plain.needed, "pictures are slow there, but drawn");
        assert!(plain.found.ends_with("three to four times as long") && plain.mend.contains("-cpu host"));
    }
}
