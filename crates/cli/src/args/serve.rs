//! Arguments of `serve`.

use genmanip_terminal::parse;
use std::net::SocketAddr;
use std::path::PathBuf;

use clap::{Args, Subcommand};

/// Services for other programs.
#[derive(Debug, Subcommand)]
pub enum ServeCommand {
    /// Segmentation masks of the objects in an image, from colour and depth
    #[command(
        after_help = "Examples:\n  genmanip serve segment\n  genmanip serve segment --openapi > segment.json\n  \
                      curl http://127.0.0.1:8091/health"
    )]
    Segment(ServeArguments),
    /// Grasps of an object given by its point cloud, for the Panda's hand
    #[command(after_help = "Example:\n  genmanip serve grasp --address 127.0.0.1:8092")]
    Grasp(ServeArguments),
    /// Motions from an RGB-D image, the arm's joints and an instruction, for a real camera and arm; nothing is moved
    #[command(
        after_help = "Example:\n  genmanip serve agent --vlm model.toml --address 127.0.0.1:8093\n\nA question begins a \
                      job; docs/guides/services.md says how it is asked about."
    )]
    Agent(ServeAgentArguments),
    /// Simulation environments that a program steps through, one action per request
    #[command(
        after_help = "Examples:\n  genmanip serve env suites/mine --address 127.0.0.1:8094\n  genmanip serve env --tasks \
                      examples/tasks\n\nexamples/python/env_client.py is a program that drives one; \
                      docs/guides/services.md has every request."
    )]
    Env(ServeEnvArguments),
    /// A learned policy over openpi's websocket protocol: an observation in, an action chunk out
    #[command(
        after_help = "Examples:\n  genmanip serve policy learned:out/policy --address 127.0.0.1:8000\n  genmanip evaluate \
                      out/scenarios --policy openpi:url=ws://127.0.0.1:8000,preset=genmanip\n\ndocs/guides/policy-servers.md \
                      says what is sent."
    )]
    Policy(ServePolicyArguments),
}

/// Arguments of a policy as a service.
#[derive(Debug, Args)]
pub struct ServePolicyArguments {
    /// Policy made by `train`, of a preset without simulator truth
    #[arg(value_name = "learned:DIR")]
    pub policy: String,
    #[command(flatten)]
    pub listen: ListenArguments,
}

/// Arguments of environments as a service.
#[derive(Debug, Args)]
pub struct ServeEnvArguments {
    /// A frozen suite, a run, or scenarios
    #[arg(value_name = "SUITE|RUN|SCENARIOS", required_unless_present = "tasks")]
    pub scenes: Option<PathBuf>,
    /// Task files, or folders of them, instead; a new layout is made for each seed
    #[arg(long, value_name = "PATH", num_args = 1.., conflicts_with = "scenes")]
    pub tasks: Vec<PathBuf>,
    /// Maximum number of concurrent sessions; each needs about 35 MB of memory, more with cameras
    #[arg(long, value_name = "N", default_value_t = 16, value_parser = parse::count)]
    pub sessions: usize,
    #[command(flatten)]
    pub serve: ServeArguments,
}

/// Arguments of the agent as a service.
#[derive(Debug, Args)]
pub struct ServeAgentArguments {
    /// Settings file of the vision-language model (TOML), see docs/guides/agent.md
    #[arg(long, value_name = "FILE")]
    pub vlm: String,
    /// Segmentation source: `rgbd` (built in, from colour and depth) or a server
    #[arg(long, value_name = "rgbd|http:URL", default_value = "rgbd")]
    pub masks: String,
    /// Grasp source: `rgbd` (built in, from the object's points) or a server
    #[arg(long, value_name = "rgbd|http:URL", default_value = "rgbd")]
    pub grasps: String,
    /// Standard deviation of measured depth at a distance of 1 m, m: 0.0036 for a RealSense D435, 0 for perfect depth
    #[arg(long, value_name = "M", default_value_t = 0.0)]
    pub depth_error: f64,
    /// Form of the model's answer for a placement: one grid cell (`p2p`), or a path over the grid with heights and
    /// rotations (`grid`)
    #[arg(long, default_value = "p2p", value_parser = ["p2p", "grid"])]
    pub path: String,
    #[command(flatten)]
    pub serve: ServeArguments,
}

/// Arguments of every service over HTTP.
#[derive(Debug, Args)]
pub struct ServeArguments {
    #[command(flatten)]
    pub listen: ListenArguments,
    /// Print the OpenAPI description instead of serving
    #[arg(long)]
    pub openapi: bool,
}

/// Arguments of every service.
#[derive(Debug, Args)]
pub struct ListenArguments {
    /// IP address and TCP port to listen on; port 0 picks a free one
    #[arg(long, value_name = "IP:PORT", default_value = "127.0.0.1:8091")]
    pub address: SocketAddr,
    /// Allow an address that other machines can reach; there is no authentication
    #[arg(long)]
    pub allow_others: bool,
    /// Maximum size of a request, MiB
    #[arg(long, value_name = "MIB", default_value_t = 64, value_parser = parse::count)]
    pub max_mb: usize,
    /// Maximum number of requests processed at the same time [default: one per core]
    #[arg(long, value_name = "N", value_parser = parse::count)]
    pub workers: Option<usize>,
}
