//! Parts that all bridges share: the socket at which they listen, their settings, their report.

use std::net::{SocketAddr, TcpListener};

use genmanip_core::Seed;
use genmanip_real::bridge::server::{Flaws, LoopReport};
use genmanip_real::bridge::{BridgeSettings, LinkSettings};
use genmanip_terminal::{Failed, Printer};

use crate::args::BridgeArguments;

/// Opens the socket at which a bridge listens; refuses one that other machines can reach unless that is allowed.
pub fn open(arguments: &BridgeArguments) -> Result<(TcpListener, SocketAddr), Failed> {
    let wanted = arguments.address;
    if !wanted.ip().is_loopback() && !arguments.allow_others {
        return Err(Failed::new(format!("other machines can reach {wanted}, and nobody is asked who they are"))
            .hint("listen at 127.0.0.1, or pass --allow-others"));
    }
    let listener = TcpListener::bind(wanted).map_err(|error| {
        Failed::because(format!("cannot listen at {wanted}"), &error)
            .hint("another bridge may run there; choose another --address")
    })?;
    let address = listener.local_addr().map_err(|error| Failed::because("cannot listen", &error))?;
    Ok((listener, address))
}

pub fn settings(arguments: &BridgeArguments) -> BridgeSettings {
    BridgeSettings { top_speed: arguments.top_speed, workspace_m: arguments.workspace, ..BridgeSettings::default() }
}

pub fn flaws(arguments: &BridgeArguments, seed: Seed) -> Flaws {
    let link = LinkSettings {
        latency_s: arguments.latency_ms / 1e3,
        jitter_s: arguments.jitter_ms / 1e3,
        loss: arguments.loss,
    };
    Flaws { link, seed }
}

pub fn say(report: &LoopReport, printer: &Printer) {
    printer.say(format!(
        "{} control periods, {} of them late, the longest {:.1} ms",
        report.ticks,
        report.late,
        1e3 * report.longest_s
    ));
}
