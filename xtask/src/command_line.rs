//! Names on the command line of xtask, for `main` and for the check of pages that quote them.

/// Names of the subcommands.
pub const SUBCOMMANDS: [&str; 9] = ["setup", "demo", "install", "wheel", "test", "fuzz", "tidy", "docs", "help"];

/// Phases of `cargo xtask test`, in their order: what fails in seconds comes before what takes minutes.
pub const PHASES: [&str; 15] = [
    "setup",
    "fmt",
    "tidy",
    "deny",
    "typos",
    "clippy",
    "doc",
    "build",
    "link check",
    "bytes",
    "web",
    "python",
    "docs",
    "test",
    "real",
];

/// Phases that run only when they are named: `bytes` compiles the renderer and all below it again, `real` downloads another
/// project's simulator.
pub const OPT_IN: [&str; 2] = ["bytes", "real"];

/// Options of `cargo xtask test`, each of which is a test of its own.
const OPTIONS: [&str; 7] = ["--packs", "--interop", "--cluster", "--s3", "--train", "--models", "--long"];

/// Words that may follow `cargo xtask test`.
pub fn test_words() -> Vec<&'static str> {
    PHASES.iter().flat_map(|name| name.split(' ')).chain(OPTIONS).collect()
}

pub const USAGE: &str = "\
Usage: cargo xtask SUBCOMMAND

  setup            download and verify the simulator library, make the Python environment of the tests
  setup web        install the packages that build and test the studio's page (Node.js, once 130 MB)
  setup real       install the packages of the simulated Franka arm that `test real` drives (Linux on x86-64, once 200 MB)
  demo [ARGS…]     set-up, build, and run `genmanip demo` (ARGS are passed on; default: --out out/demo)
  install [--root DIR]   build, and put `genmanip`, `genmanip-lab` and the suites where cargo installs programs
  install --learn  the same, with programs that train policies (minutes longer)
  wheel [--out DIR]   build the Python wheel, with the simulator's library inside, and check that it runs elsewhere
  test [PHASE…]    everything CI runs, or only the named phases
  test bytes       compare rendered images with and without wide SIMD registers (minutes; not part of CI)
  test real        drive another project's simulated Franka arm over Franka's own protocol (minutes; not part of CI)
  test web --long [OPTION…]   the studio killed 100 times, 500 faults, ten tabs, a trial, ten minutes of orbiting (an
                   hour; not part of CI); options shorten it: --kills N --faults N --cut-s S --tabs N --suite N --orbit-s S
  test --packs     import objects of published packages (downloads 320 MB, takes minutes; not part of CI)
  test --interop   let published packages of other projects ask, answer and read us (downloads 3 GB; not part of CI)
  test --cluster   collect on a Slurm of two nodes on this machine and lose one (needs its packages; not part of CI)
  test --s3        push and pull a folder through a real S3 server that fails (builds one; not part of CI)
  test --train     train `reach` with Stable-Baselines3 (downloads 3 GB, then takes ten minutes; not part of CI)
  test --models    ask a small language model and a grasp network (downloads 180 MB, then minutes; not part of CI)
  fuzz             list the readers that mutated inputs can be fed to
  fuzz TARGET [--minutes N] [--seed S]   feed one of them for N minutes of CPU time, save what breaks it
  tidy             check the rules that the compiler does not know
  tidy --rule RULE [PATH…]   list what breaks one rule, limits of xtask/tidy-exceptions.txt aside
  docs [PAGE…]     run the code blocks of README.md and docs/guides, as the phase `docs` does, with what is built
  docs --interop [PAGE…]   those too that need the network or other projects' packages

Example: cargo xtask test fmt clippy";

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_usage_names_every_subcommand_and_option() {
        for name in SUBCOMMANDS.iter().filter(|name| **name != "help").chain(&OPTIONS) {
            assert!(USAGE.contains(&format!(" {name} ")), "{name}");
        }
    }
}
