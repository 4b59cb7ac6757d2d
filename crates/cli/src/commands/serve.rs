//! `genmanip serve`: masks, grasps, the agent, environments and policies for other programs.

use std::sync::Arc;

use genmanip_agent::segmentation::RgbdSegmenter;
use genmanip_agent_sim::AgentChoice;
use genmanip_assets::worlds::default_world;
use genmanip_motion::PlannerSettings;
use genmanip_pipeline::evaluate::Suite;
use genmanip_pipeline::offered::{OfferedPolicy, offered};
use genmanip_pipeline::sessions::SceneSource;
use genmanip_serve::{
    AgentEndpoint, Endpoint, EnvEndpoint, PolicyEndpoint, PolicyServer, ServeError, ServeSettings, Server, openapi,
};
use genmanip_workspace::worlds;

use crate::args::{
    ListenArguments, ServeAgentArguments, ServeArguments, ServeCommand, ServeEnvArguments, ServePolicyArguments,
};
use genmanip_terminal::Printer;
use genmanip_terminal::{ExitStatus, Failed};

pub fn run(command: &ServeCommand, printer: &Printer) -> Result<ExitStatus, Failed> {
    match command {
        ServeCommand::Segment(arguments) => serve(Endpoint::Segment(RgbdSegmenter::default()), arguments, printer),
        ServeCommand::Grasp(arguments) => {
            let planner = worlds::planner(&default_world(), &PlannerSettings::default())?;
            serve(Endpoint::Grasp(planner), arguments, printer)
        }
        ServeCommand::Env(arguments) => serve(Endpoint::Env(environments(arguments)?), &arguments.serve, printer),
        ServeCommand::Policy(arguments) => serve_policy(arguments, printer),
        ServeCommand::Agent(arguments) => serve(Endpoint::Agent(agent(arguments)?), &arguments.serve, printer),
    }
}

fn environments(arguments: &ServeEnvArguments) -> Result<Arc<EnvEndpoint>, Failed> {
    let ServeEnvArguments { scenes, tasks, sessions, .. } = arguments;
    let scenes = match scenes {
        Some(path) => SceneSource::of_suite(&Suite::at(path)?)?,
        None => SceneSource::of_tasks(tasks, None)?,
    };
    Ok(Arc::new(EnvEndpoint::new(Arc::new(scenes), *sessions)))
}

fn agent(arguments: &ServeAgentArguments) -> Result<AgentEndpoint, Failed> {
    let ServeAgentArguments { vlm, masks, grasps, path, .. } = arguments;
    let choice =
        AgentChoice::named(vlm, masks, path, "full")?.with_grasps(grasps)?.with_depth_error(arguments.depth_error)?;
    let planner = worlds::planner(&default_world(), &PlannerSettings::default())?;
    // Fails at the start, not at the first request, if the agent cannot be made.
    choice.for_one_image(&planner)?;
    let own = Arc::clone(&planner);
    let make = Arc::new(move || choice.for_one_image(&own).map_err(|error| error.to_string()));
    Ok(AgentEndpoint { planner, make })
}

fn serve(endpoint: Endpoint, arguments: &ServeArguments, printer: &Printer) -> Result<ExitStatus, Failed> {
    if arguments.openapi {
        let description = openapi(&endpoint);
        printer.data(&description, &serde_json::to_string_pretty(&description).unwrap_or_default());
        return Ok(ExitStatus::Done);
    }
    let settings = settings(&arguments.listen)?;
    let (name, path) = (endpoint.name(), endpoint.path());
    let server = Server::start(endpoint, &settings).map_err(|error| cannot_offer(name, &error))?;
    printer.say(format!("offering {name} at http://{}{path}; Ctrl-C ends it", server.address()));
    server.wait();
    Ok(ExitStatus::Done)
}

fn serve_policy(arguments: &ServePolicyArguments, printer: &Printer) -> Result<ExitStatus, Failed> {
    let settings = settings(&arguments.listen)?;
    let OfferedPolicy { robot, spec, make } = offered(&arguments.policy)?;
    let endpoint = PolicyEndpoint { robot: robot.name.clone(), arm_dof: robot.arm_dof(), spec, make };
    let server = PolicyServer::start(endpoint, &settings).map_err(|error| cannot_offer("the policy", &error))?;
    printer.say(format!("offering {} at ws://{}; Ctrl-C ends it", arguments.policy, server.address()));
    server.wait();
    Ok(ExitStatus::Done)
}

fn settings(arguments: &ListenArguments) -> Result<ServeSettings, Failed> {
    if !arguments.address.ip().is_loopback() && !arguments.allow_others {
        return Err(Failed::new(format!("{} can be reached by other machines", arguments.address))
            .hint("nobody is asked who they are; add --allow-others if your network is trusted"));
    }
    Ok(ServeSettings {
        address: arguments.address,
        max_request_bytes: arguments.max_mb << 20,
        workers: arguments.workers.unwrap_or(ServeSettings::default().workers),
    })
}

fn cannot_offer(name: &str, error: &ServeError) -> Failed {
    Failed::because(format!("cannot offer {name}"), error).hint("choose another --address")
}
