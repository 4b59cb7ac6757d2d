//! Policies behind other programs' protocols, against servers on loopback that speak them.

#![allow(clippy::unwrap_used)] // clippy's exemption covers test functions, not what they call

mod vla_eval;

use std::collections::BTreeMap;
use std::net::{SocketAddr, TcpListener};
use std::sync::Arc;
use std::time::Duration;

use genmanip_core::glam::{DMat3, DVec3};
use genmanip_core::{
    ActionSpace, EpisodeStart, Gripper, Intrinsics, MassProperties, Observation, Policy, PolicyError, Pose, RgbdImage,
    RobotLink, RobotModel, Seed,
};
use genmanip_remote_policies::Timeouts;
use genmanip_remote_policies::fake::{self, Answer, Question};
use genmanip_remote_policies::openpi::{OpenpiPolicy, OpenpiSettings, Preset};

/// A test arm with a fixed tool 0.5 m in front of the base.
fn robot() -> Arc<RobotModel> {
    let parent_from_link = Pose { position: DVec3::new(0.5, 0.0, 0.2), ..Pose::IDENTITY };
    let mass = MassProperties { mass_kg: 1.0, center: DVec3::ZERO, inertia: DMat3::IDENTITY };
    let (visual, pieces) = (Vec::new(), Vec::new());
    let hand = RobotLink { name: "hand".into(), parent: None, parent_from_link, joint: None, visual, pieces, mass };
    let gripper = Gripper { fingers: [1, 2], max_width: 0.08, max_force: 70.0, pad_size: DVec3::ONE };
    Arc::new(RobotModel {
        name: "still".into(),
        links: vec![hand],
        hand: 0,
        hand_from_tcp: Pose::IDENTITY,
        gripper,
        home: vec![0.0; 7],
        drives: None,
        reach: None,
        hand_from_wrist_camera: None,
        never_colliding: Vec::new(),
    })
}

fn policy(address: SocketAddr, preset: Preset) -> OpenpiPolicy {
    let timeouts = Timeouts {
        answer: Duration::from_millis(500),
        pause: Duration::from_millis(10),
        reconnects: 2,
        ..Timeouts::default()
    };
    let (exterior, wrist) = ("side".to_owned(), "hand".to_owned());
    let url = format!("ws://{address}");
    let settings = OpenpiSettings {
        url,
        preset,
        exterior,
        wrist,
        execute_steps: None,
        api_key: Some("kept-secret".into()),
        timeouts,
    };
    OpenpiPolicy::new(settings, robot())
}

fn observation() -> Observation {
    let image = |level: u8| {
        let intrinsics = Intrinsics::from_vertical_fov(32, 18, 0.8);
        let empty = RgbdImage::of_depth(intrinsics, Pose::IDENTITY, vec![]);
        Arc::new(RgbdImage { rgb: vec![level; 32 * 18 * 3], ..empty })
    };
    let state = vec![0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.02];
    Observation {
        state: BTreeMap::from([(Observation::STATE.to_owned(), state)]),
        images: BTreeMap::from([("side".to_owned(), image(200)), ("hand".to_owned(), image(100))]),
        ..Observation::default()
    }
}

fn start() -> EpisodeStart {
    EpisodeStart { instruction: "put it there".into(), seed: Seed::new(1), cameras: Vec::new(), scenario: None }
}

fn server(answering: impl Fn(&Question) -> Answer + Send + Sync + 'static) -> SocketAddr {
    fake::start(answering).unwrap()
}

#[test]
fn a_droid_server_is_shown_what_it_expects_and_its_speeds_are_in_rad_per_s() {
    let address = server(|question| {
        assert_eq!(question.prompt(), Some("put it there"));
        let joints = question.array("observation/joint_position").unwrap();
        assert_eq!((joints.shape.clone(), joints.reals()[6]), (vec![7], 0.7));
        let closed = question.array("observation/gripper_position").unwrap().reals();
        assert!((closed[0] - 0.75).abs() < 1e-12, "{closed:?}");
        let picture = question.array("observation/exterior_image_1_left").unwrap();
        assert_eq!(picture.shape, [224, 224, 3]);
        // 126 image rows between black ones.
        let pixels = picture.reals();
        assert_eq!((pixels[0], pixels[(112 * 224 + 112) * 3], pixels.last().copied()), (0.0, 200.0, Some(0.0)));
        Answer::Actions(vec![vec![0.5, -2.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.9]; 10])
    });
    let mut policy = policy(address, Preset::Droid);
    let spec = policy.spec();
    assert_eq!((spec.action.space, spec.rate_hz, spec.execute_steps), (ActionSpace::JointVelocity, 15.0, 8));
    policy.reset(&start()).unwrap();
    let chunk = policy.act(&observation()).unwrap();
    assert_eq!((chunk.actions.len(), chunk.finished), (10, false));
    assert_eq!(chunk.actions[3], [1.5, -3.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.9]);
}

/// Metadata, request and response of openpi's own client and packer, as recorded by `testdata/record_conversation.py`.
fn recorded() -> [Vec<u8>; 3] {
    let packed = include_bytes!("../../testdata/openpi_conversation.zlib");
    let bytes = miniz_oxide::inflate::decompress_to_vec_zlib(packed).unwrap();
    let mut rest = &bytes[..];
    std::array::from_fn(|_| {
        let (length, behind) = rest.split_first_chunk::<4>().unwrap();
        let (frame, behind) = behind.split_at(u32::from_le_bytes(*length) as usize);
        rest = behind;
        frame.to_vec()
    })
}

#[test]
fn a_recorded_conversation_of_the_real_client_is_repeated_to_the_byte() {
    let [metadata, question, answer] = recorded();
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap();
    let server = std::thread::spawn(move || {
        let mut socket = tungstenite::accept(listener.accept().unwrap().0).unwrap();
        socket.send(tungstenite::Message::binary(metadata)).unwrap();
        let asked = socket.read().unwrap().into_data();
        socket.send(tungstenite::Message::binary(answer)).unwrap();
        asked
    });
    let mut policy = policy(address, Preset::Droid);
    policy.reset(&start()).unwrap();
    let chunk = policy.act(&observation()).unwrap();
    assert!(server.join().unwrap() == question[..], "our question is not that of openpi's client");
    // Row 2 of the recorded response is -0.24 to -0.17; joint velocities of 1 are 3 rad/s.
    let speed = (0.16 - 0.4) * 3.0;
    assert_eq!((chunk.actions.len(), chunk.actions[2].len()), (10, 8));
    assert!((f64::from(chunk.actions[2][0]) - speed).abs() < 1e-6, "{:?}", chunk.actions[2]);
}

#[test]
fn a_libero_server_is_told_the_tool_and_its_changes_are_in_metres_and_rad() {
    let address = server(|question| {
        let state = question.array("observation/state").unwrap().reals();
        assert_eq!(state, [0.5, 0.0, 0.2, 0.0, 0.0, 0.0, 0.01, -0.01]);
        Answer::Actions(vec![vec![1.0, 0.5, -3.0, 0.2, 0.0, 0.0, -1.0]; 5])
    });
    let mut policy = policy(address, Preset::Libero);
    policy.reset(&start()).unwrap();
    let chunk = policy.act(&observation()).unwrap();
    assert_eq!(chunk.actions[0], [0.05, 0.025, -0.05, 0.1, 0.0, 0.0, -1.0]);
}

/// Server faults are never failures of the policy, and their messages are reported.
#[test]
fn servers_that_fail_are_not_reached() {
    let cases = [
        (Answer::Traceback("PermissionError: Api-Key kept-secret".into()), "Api-Key [key hidden]"),
        (
            Answer::Traceback("Traceback (most recent call last):\nKeyError: 'observation/state'".into()),
            "KeyError: 'obs",
        ),
        (Answer::Nothing, "no `actions`"),
        (Answer::Actions(vec![vec![0.0; 3]; 2]), "shape [2, 3], expected [1 to 1000, 8]"),
        (Answer::Actions(Vec::new()), "shape [0, 8]"),
        (Answer::Actions(vec![vec![f32::NAN; 8]]), "with NaN in row 0"),
        (Answer::Bytes(vec![0xdd, 0xff, 0xff, 0xff, 0xff]), "invalid MessagePack"),
        (Answer::Bytes(vec![0; 5 << 20]), "too large"),
        (Answer::Hangs(Duration::from_secs(2)), "did not answer within 0 s"),
    ];
    for (answer, expected) in cases {
        let mut policy = policy(server(move |_| answer.clone()), Preset::Droid);
        policy.reset(&start()).unwrap();
        match policy.act(&observation()) {
            Err(PolicyError::Unreachable(reason)) => {
                assert!(reason.contains(expected) && reason.len() < 700, "{reason}");
            }
            other => panic!("{expected}: {other:?}"),
        }
    }
    let nobody = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
    let error = policy(nobody, Preset::Droid).act(&observation()).unwrap_err();
    assert!(matches!(&error, PolicyError::Unreachable(reason) if reason.contains("refused")), "{error}");
}

#[test]
fn a_connection_that_is_lost_is_made_again() {
    let address = server(|question| match question.number {
        1 => Answer::Drops,
        number => Answer::Actions(vec![vec![number as f32 * 0.1; 8]]),
    });
    let mut policy = policy(address, Preset::DroidJointPosition);
    policy.reset(&start()).unwrap();
    let first = |chunk: genmanip_core::ActionChunk| chunk.actions[0][0];
    assert_eq!(first(policy.act(&observation()).unwrap()), 0.0);
    // The second request is repeated over a new connection, as the third.
    assert_eq!(first(policy.act(&observation()).unwrap()), 0.2);
}
