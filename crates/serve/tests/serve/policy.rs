//! A policy over openpi's protocol.

use std::collections::BTreeMap;
use std::io::{Read, Write};
use std::net::TcpStream;
use std::sync::Arc;

use genmanip_core::{
    ActionChunk, CameraRequest, EpisodeStart, ImageChannels, Intrinsics, Observation, Policy, PolicyError, PolicySpec,
    Pose, RgbdImage, Seed,
};
use genmanip_remote_policies::Timeouts;
use genmanip_remote_policies::served::{Offer, ServedPolicy};
use genmanip_serve::{PolicyEndpoint, PolicyServer, ServeSettings};

const ARM_DOF: usize = 7;
const SIZE: [u32; 2] = [8, 6];

/// Actions that every bit of the instruction and the observation changes.
struct Sensitive {
    instruction: String,
}

impl Policy for Sensitive {
    fn spec(&self) -> PolicySpec {
        let [width, height] = SIZE;
        PolicySpec {
            cameras: vec![CameraRequest::new("side", ImageChannels::RGB).sized(width, height)],
            execute_steps: 2,
            ..PolicySpec::native("sensitive", 15.0)
        }
    }

    fn reset(&mut self, start: &EpisodeStart) -> Result<(), PolicyError> {
        self.instruction.clone_from(&start.instruction);
        Ok(())
    }

    fn act(&mut self, observation: &Observation) -> Result<ActionChunk, PolicyError> {
        let state = &observation.state[Observation::STATE];
        if state[0] > 3.0 {
            return Err(PolicyError::Unsuited("the first joint is out of range".into()));
        }
        let bytes = state.iter().flat_map(|number| number.to_le_bytes());
        let bytes = bytes.chain(observation.images["side"].rgb.iter().copied()).chain(self.instruction.bytes());
        let mix = |hash: u32, byte: u8| (hash ^ u32::from(byte)).wrapping_mul(16_777_619);
        let hash = bytes.fold(2_166_136_261, mix);
        let number = |place: u32| f32::from_bits((hash.rotate_left(place) >> 9) | 0x3f80_0000) - 1.0;
        let finished = state[0] > 2.0;
        let rows = if finished { 0 } else { 3 };
        let row = |row: u32| (0..=ARM_DOF as u32).map(|place| number(8 * row + place)).collect();
        Ok(ActionChunk { actions: (0..rows).map(row).collect(), finished })
    }
}

fn sensitive() -> Box<dyn Policy> {
    Box::new(Sensitive { instruction: String::new() })
}

fn served(max_request_bytes: usize) -> PolicyServer {
    let endpoint =
        PolicyEndpoint { robot: "still".into(), arm_dof: ARM_DOF, spec: sensitive().spec(), make: Arc::new(sensitive) };
    let address = ([127, 0, 0, 1], 0).into();
    PolicyServer::start(endpoint, &ServeSettings { address, max_request_bytes, workers: 1 }).unwrap()
}

fn client(server: &PolicyServer) -> ServedPolicy {
    let offer = Offer::of(&format!("ws://{}", server.address()), Timeouts::default()).unwrap();
    assert_eq!(offer.robot, "still");
    let spec: PolicySpec = serde_json::from_value(offer.spec.clone()).unwrap();
    assert_eq!(spec, sensitive().spec());
    let mut policy = offer.policy(spec, ARM_DOF);
    policy.reset(&start()).unwrap();
    policy
}

fn start() -> EpisodeStart {
    EpisodeStart { instruction: "put it there".into(), seed: Seed::new(1), cameras: Vec::new(), scenario: None }
}

fn observation(first: f64, level: u8, [width, height]: [u32; 2]) -> Observation {
    let intrinsics = Intrinsics::from_vertical_fov(width, height, 0.8);
    let rgb = vec![level; (3 * width * height) as usize];
    let image = RgbdImage { rgb, ..RgbdImage::of_depth(intrinsics, Pose::IDENTITY, vec![]) };
    let state = vec![first, 0.1, f64::EPSILON, -0.3, 0.4, 0.5, 0.6, 0.04];
    Observation {
        state: BTreeMap::from([(Observation::STATE.to_owned(), state)]),
        images: BTreeMap::from([("side".to_owned(), Arc::new(image))]),
        ..Observation::default()
    }
}

#[test]
fn actions_are_those_of_the_policy_in_process() {
    let server = served(1 << 20);
    let mut apart = client(&server);
    let mut here = sensitive();
    here.reset(&start()).unwrap();
    for (first, level) in [(0.1, 7), (0.1, 8), (0.1 + f64::EPSILON, 8), (2.5, 8), (0.1, 7)] {
        let seen = observation(first, level, SIZE);
        assert_eq!(apart.act(&seen).unwrap(), here.act(&seen).unwrap(), "{first} {level}");
    }
    // Two clients at once, of which one has another instruction.
    let (mut other, seen) = (client(&server), observation(0.1, 7, SIZE));
    other.reset(&EpisodeStart { instruction: "leave it".into(), ..start() }).unwrap();
    assert_ne!(other.act(&seen).unwrap(), apart.act(&seen).unwrap());
}

#[test]
fn wrong_requests_are_refused_with_their_place() {
    let server = served(1 << 20);
    let short = Observation {
        state: BTreeMap::from([(Observation::STATE.to_owned(), vec![0.0; 3])]),
        ..observation(0.1, 7, SIZE)
    };
    let cases = [
        (short, "`observation.state` of shape [3]: expected 7 joint positions [rad] and the opening [m]"),
        (observation(f64::NAN, 7, SIZE), "expected 7 joint positions"),
        (observation(0.1, 7, [6, 8]), "`observation.images.side` of shape [8, 6, 3]: expected [6, 8, 3]"),
        (observation(3.5, 7, SIZE), "the first joint is out of range"),
        (observation(0.1, 7, [800, 600]), "the request is too large"),
    ];
    for (seen, expected) in cases {
        let error = client(&server).act(&seen).unwrap_err();
        let PolicyError::Unreachable(said) = &error else { panic!("{error}") };
        assert!(said.contains(expected), "expected `{expected}` in: {said}");
    }
    // The server is still there.
    client(&server).act(&observation(0.1, 7, SIZE)).unwrap();
}

#[test]
fn pages_of_other_sites_get_no_connection() {
    let server = served(1 << 20);
    for (headers, status) in [
        ("host: localhost\r\n", "101"),
        ("host: localhost\r\norigin: https://example.org\r\n", "403"),
        ("host: rebound.example.org\r\n", "403"),
    ] {
        let mut stream = TcpStream::connect(server.address()).unwrap();
        let key = "sec-websocket-version: 13\r\nsec-websocket-key: dGhlIHNhbXBsZSBub25jZQ==\r\n";
        write!(stream, "GET / HTTP/1.1\r\n{headers}connection: upgrade\r\nupgrade: websocket\r\n{key}\r\n").unwrap();
        let mut answer = [0; 12];
        stream.read_exact(&mut answer).unwrap();
        assert_eq!(String::from_utf8_lossy(&answer[9..]), status, "{headers:?}");
    }
}
