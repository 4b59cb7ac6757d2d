//! Franka Hand without waiting: commands are sent and answered between the control periods of the arm.

use franka::network::{Network, connect_gripper};
use franka::wire::gripper::{GripperCommand, GripperState};
use franka::{FrankaError, FrankaResult};

/// Change of width that counts as closing, m; smaller ones are moved to without force.
const CLOSING_M: f64 = 1e-3;

/// Speed and force of the hand.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HandSettings {
    /// Speed of the opening width, m/s.
    pub speed_m_s: f64,
    /// Force of each finger when it closes, N.
    pub force_n: f64,
}

impl Default for HandSettings {
    fn default() -> Self {
        // The maker's largest speed; half of the largest continuous force, as the simulated Panda's hand.
        Self { speed_m_s: 0.1, force_n: 35.0 }
    }
}

/// Franka Hand.
#[derive(Debug)]
pub struct Hand {
    host: String,
    settings: HandSettings,
    /// Connection; `None` if it is lost.
    network: Option<Network>,
    width_m: f64,
    commands: Commands,
}

/// Commands that are on their way.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Commands {
    /// Number of the command that the hand executes.
    running: Option<u32>,
    /// Number of the stop that ends it.
    stopping: Option<u32>,
    /// Width to go to next, m.
    wanted_m: Option<f64>,
}

impl Hand {
    /// Connects to the hand of the arm at `host` and waits for its first state.
    ///
    /// # Errors
    /// If nothing answers, or another version of the protocol.
    pub fn connect(host: &str, settings: HandSettings) -> FrankaResult<Self> {
        let mut hand = Self { host: host.into(), settings, network: None, width_m: 0.0, commands: Commands::default() };
        hand.reconnect()?;
        Ok(hand)
    }

    /// Opening width, m: the last one that arrived.
    pub fn width_m(&self) -> f64 {
        self.width_m
    }

    /// True if the connection is lost.
    pub fn is_lost(&self) -> bool {
        self.network.is_none()
    }

    /// Connects again; commands on their way are forgotten.
    ///
    /// # Errors
    /// As [`Hand::connect`].
    pub fn reconnect(&mut self) -> FrankaResult<()> {
        let (network, _) = connect_gripper(&self.host)?;
        self.width_m = network.blocking_receive_struct::<GripperState>()?.width.get();
        (self.network, self.commands) = (Some(network), Commands::default());
        Ok(())
    }

    /// Takes what has arrived, and goes to a new width, m, if one is given; never waits.
    ///
    /// A command that is still executed is stopped first: an object between the fingers would keep it going for minutes.
    pub fn tick(&mut self, wanted_m: Option<f64>) {
        let Some(network) = &self.network else { return };
        self.commands.wanted_m = wanted_m.or(self.commands.wanted_m);
        if self.commands.advance(network, &mut self.width_m, &self.settings).is_err() {
            self.network = None;
        }
    }
}

impl Commands {
    fn advance(&mut self, network: &Network, width_m: &mut f64, settings: &HandSettings) -> FrankaResult<()> {
        network.tcp.throw_if_connection_closed()?;
        while let Some(state) = network.try_receive_struct::<GripperState>()? {
            *width_m = state.width.get();
        }
        if has_answer(network, self.running)? {
            self.running = None;
        }
        if has_answer(network, self.stopping)? {
            // The answer to the stopped command, if one comes, is of no interest.
            (self.stopping, self.running) = (None, None);
        }
        let Some(wanted_m) = self.wanted_m else { return Ok(()) };
        match (self.running, self.stopping) {
            (_, Some(_)) => {}
            (Some(_), None) => self.stopping = Some(send(network, GripperCommand::Stop, &[])?),
            (None, None) => {
                let HandSettings { speed_m_s, force_n } = *settings;
                let sent = match wanted_m < *width_m - CLOSING_M {
                    // Any width counts as grasped, so that the fingers keep pressing whatever is between them.
                    true => send(network, GripperCommand::Grasp, &[wanted_m, ANY_M, ANY_M, speed_m_s, force_n])?,
                    false => send(network, GripperCommand::Move, &[wanted_m, speed_m_s])?,
                };
                (self.running, self.wanted_m) = (Some(sent), None);
            }
        }
        Ok(())
    }
}

/// Tolerance of a grasp that accepts all widths of the hand, m.
const ANY_M: f64 = 0.1;

/// Sends a command with its numbers; returns its number.
fn send(network: &Network, command: GripperCommand, numbers: &[f64]) -> FrankaResult<u32> {
    let payload: Vec<u8> = numbers.iter().flat_map(|number| number.to_le_bytes()).collect();
    network.tcp.send_request(u32::from(command.to_u16()), &payload)
}

/// True if the answer to a command has arrived. Its verdict does not matter: the bridge judges by the width.
fn has_answer(network: &Network, command: Option<u32>) -> Result<bool, FrankaError> {
    command.map_or(Ok(false), |id| Ok(network.tcp.try_receive_response(id)?.is_some()))
}
