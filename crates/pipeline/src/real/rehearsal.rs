//! Bridge and simulated arm in this process, on a clock that the client advances by waiting: repeatable, and as fast as
//! the machine.

use genmanip_core::{CameraRequest, PrivilegedState, Seed};
use genmanip_real::bridge::client::{BridgeError, Connection};
use genmanip_real::bridge::{Bridge, BridgeSettings, CameraImage, ImageSource, Link, LinkSettings, Reply, Request};
use genmanip_rollout::Stage;
use genmanip_workspace::WorkspaceError;

use super::arm::SideChannel;
use super::simulated::{SimulatedArm, SimulatedArmSettings, SimulatedCameras, bridge_robot};

/// Connection to a bridge in this process.
#[derive(Debug)]
pub struct Rehearsal {
    bridge: Bridge,
    arm: SimulatedArm,
    cameras: SimulatedCameras,
    now_s: f64,
    tick_s: f64,
    state_every_s: f64,
    next_state_s: f64,
    requests: Link<Request>,
    replies: Link<Reply>,
}

impl Rehearsal {
    /// Arm at rest in the initial state of a stage.
    ///
    /// # Errors
    /// For settings that the bridge does not accept, and if the stage cannot be rendered.
    pub fn new(
        stage: &Stage,
        settings: BridgeSettings,
        arm: SimulatedArmSettings,
        link: LinkSettings,
        seed: Seed,
    ) -> Result<Self, WorkspaceError> {
        let tick_s = settings.guard.tick_s;
        let arm = SimulatedArm::new(stage, arm, tick_s, seed);
        let cameras = arm.cameras(stage).map_err(|error| WorkspaceError::broken("the cameras", error))?;
        let bridge = Bridge::new(bridge_robot(&stage.robot), settings, arm.reading());
        let bridge = bridge.ok_or_else(|| WorkspaceError::input("the settings of the bridge are not valid"))?;
        Ok(Self {
            bridge,
            arm,
            cameras,
            now_s: 0.0,
            tick_s,
            state_every_s: f64::INFINITY,
            next_state_s: f64::INFINITY,
            requests: Link::new(link, seed.fork("requests")),
            replies: Link::new(link, seed.fork("replies")),
        })
    }

    fn tick(&mut self) -> Result<(), BridgeError> {
        self.now_s += self.tick_s;
        while let Some(request) = self.requests.receive(self.now_s) {
            let reply = match request {
                Request::Hello { state_rate_hz, .. } => {
                    self.state_every_s = 1.0 / state_rate_hz.clamp(1.0, 1000.0);
                    self.next_state_s = self.now_s;
                    Some(Reply::Welcome(self.bridge.welcome(self.cameras.cameras())))
                }
                request => self.bridge.handle(self.now_s, &request),
            };
            if let Some(reply) = reply {
                self.replies.send(self.now_s, reply, false);
            }
        }
        let orders = self.bridge.tick(self.now_s, self.arm.reading());
        self.arm.advance(&orders).map_err(|error| BridgeError::Connection {
            address: "the simulated arm".into(),
            reason: error.to_string(),
        })?;
        if self.now_s >= self.next_state_s {
            self.next_state_s = (self.next_state_s + self.state_every_s).max(self.now_s);
            self.replies.send(self.now_s, Reply::State(self.bridge.state(self.now_s)), true);
        }
        Ok(())
    }
}

impl SideChannel for Rehearsal {
    fn truth(&self) -> PrivilegedState {
        PrivilegedState { objects: self.arm.sim().object_states(), grasped: self.arm.grasped() }
    }

    fn ids(&self, request: &CameraRequest) -> Result<Vec<u16>, String> {
        self.cameras.ids(request)
    }
}

impl Connection for Rehearsal {
    fn now_s(&self) -> f64 {
        self.now_s
    }

    fn send(&mut self, request: &Request) -> Result<(), BridgeError> {
        self.requests.send(self.now_s, request.clone(), request.is_streamed());
        Ok(())
    }

    fn receive(&mut self, until_s: f64) -> Result<Option<Reply>, BridgeError> {
        loop {
            if let Some(reply) = self.replies.receive(self.now_s) {
                return Ok(Some(reply));
            }
            if self.now_s + self.tick_s > until_s + 1e-9 {
                return Ok(None);
            }
            self.tick()?;
        }
    }

    fn image(&mut self, camera: &str, size: Option<[u32; 2]>) -> Result<CameraImage, BridgeError> {
        let refused = |message| BridgeError::Refused { request: "image".into(), word: "camera".into(), message };
        self.cameras.image(camera, size).map_err(refused)
    }
}
