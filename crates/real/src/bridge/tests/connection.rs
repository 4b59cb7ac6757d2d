//! Server and client over TCP on this machine.

use std::io::{BufRead, BufReader, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;

use super::fake::{FakeArm, robot};
use super::*;
use crate::bridge::client::{ArmClient, BridgeError, ClientSettings, TcpConnection};
use crate::bridge::server::{Clock, Flaws, LoopReport, serve};

struct OneImage;

impl ImageSource for OneImage {
    fn cameras(&self) -> Vec<String> {
        vec!["static".into()]
    }

    fn image(&self, camera: &str, _size: Option<[u32; 2]>) -> Result<CameraImage, String> {
        let head = ImageHead { camera: camera.into(), width: 2, height: 1, has_depth: true, exposed_s: 0.5 };
        let image = CameraImage { head, rgb: vec![1, 2, 3, 4, 5, 6], depth_m: vec![0.5, 1.5] };
        if camera == "static" { Ok(image) } else { Err(format!("no camera `{camera}`")) }
    }
}

struct Running {
    address: SocketAddr,
    stop: Arc<AtomicBool>,
    server: JoinHandle<Result<LoopReport, DriverError>>,
}

fn running(link: LinkSettings) -> Running {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap();
    let stop = Arc::new(AtomicBool::new(false));
    let asked = Arc::clone(&stop);
    let server = std::thread::spawn(move || {
        let mut arm = FakeArm { is_paced: true, ..FakeArm::new() };
        let (robot, settings) = robot();
        let bridge = Bridge::new(robot, settings, arm.reading()).unwrap();
        let flaws = Flaws { link, ..Flaws::none() };
        serve(listener, bridge, &mut arm, Arc::new(OneImage), flaws, Clock::new(), &asked)
    });
    Running { address, stop, server }
}

fn client(running: &Running, dead_man: &Arc<AtomicBool>) -> ArmClient<TcpConnection> {
    let connection = TcpConnection::open(&format!("tcp://{}", running.address)).unwrap();
    ArmClient::connect(connection, ClientSettings::default(), Arc::clone(dead_man)).unwrap()
}

#[test]
fn an_arm_follows_over_a_bad_connection_and_stops_with_its_client() {
    let running = running(LinkSettings { latency_s: 0.02, jitter_s: 0.01, loss: 0.1 });
    let dead_man = Arc::new(AtomicBool::new(true));
    let mut arm = client(&running, &dead_man);
    assert_eq!((arm.welcome().robot.as_str(), arm.state().motion), ("planar", Motion::Standing));
    let image = arm.image("static", None).unwrap();
    assert_eq!((image.rgb.as_slice(), image.depth_m.as_slice()), (&[1, 2, 3, 4, 5, 6][..], &[0.5, 1.5][..]));
    assert!(matches!(arm.image("wrist", None), Err(BridgeError::Refused { .. })));
    for _ in 0..60 {
        arm.command(&[0.8, -0.2], 0.08).unwrap();
        arm.wait(arm.now_s() + 1.0 / 60.0).unwrap();
    }
    let off = arm.state().positions.iter().zip([0.8, -0.2]).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    assert!(off < 1e-3, "{:?}", arm.state());
    // Nobody else moves the arm meanwhile.
    let mut other = client(&running, &dead_man);
    assert!(matches!(other.command(&[0.0, 0.0], 0.0), Err(BridgeError::Refused { word, .. }) if word == "leased"));
    // After a pause the arm has stopped at the deadline, and is started again.
    arm.wait(arm.now_s() + 0.5).unwrap();
    assert_eq!(arm.state().reason, Some(StopReason::Deadline));
    arm.command(&[0.7, -0.2], 0.08).unwrap();
    assert_eq!((arm.tally().starts, arm.state().errors.len()), (2, 0));
    // The lease of a client that has gone is free at once.
    drop(arm);
    let mut last = Err(BridgeError::Person);
    for _ in 0..50 {
        last = other.command(&[0.3, -0.5], 0.0);
        if last.is_ok() {
            break;
        }
        other.wait(other.now_s() + 0.02).unwrap();
    }
    last.unwrap();
    dead_man.store(false, Ordering::Relaxed);
    assert_eq!(other.command(&[0.3, -0.5], 0.0), Err(BridgeError::Person));
    assert_eq!(other.state().motion, Motion::Standing);
    running.stop.store(true, Ordering::Relaxed);
    let report = running.server.join().unwrap().unwrap();
    assert!(report.ticks > 500, "{report:?}");
}

#[test]
fn what_is_no_request_is_refused() {
    let running = running(LinkSettings::default());
    // (lines, words of the replies; "-" where the connection is closed)
    let hello = r#"{"type": "hello", "protocol": "genmanip.bridge/1", "state_rate_hz": 1}"#;
    let cases: [(&[&str], &[&str]); 5] = [
        (&["nonsense"], &["malformed", "-"]),
        (&[r#"{"type": "acquire"}"#], &["malformed", "-"]),
        (&[r#"{"type": "hello", "protocol": "genmanip.bridge/9", "state_rate_hz": 1}"#], &["malformed", "-"]),
        (&[hello, r#"{"type": "acquire", "more": 1}"#], &["welcome", "malformed"]),
        (
            &[
                hello,
                r#"{"type": "command", "lease": 9, "sequence": 1, "valid_for_s": 0.1, "dead_man": true, "positions": [0, 0]}"#,
            ],
            &["welcome", "no_lease"],
        ),
    ];
    for (lines, expected) in cases {
        let mut stream = TcpStream::connect(running.address).unwrap();
        stream.write_all((lines.join("\n") + "\n").as_bytes()).unwrap();
        let replies = BufReader::new(stream).lines().map(|line| {
            let value: serde_json::Value = serde_json::from_str(&line.unwrap()).unwrap();
            value.get("word").unwrap_or(&value["type"]).as_str().unwrap().to_owned()
        });
        let got: Vec<String> =
            replies.filter(|word| word != "state").chain(["-".into()]).take(expected.len()).collect();
        assert_eq!(got, expected, "{lines:?}");
    }
    running.stop.store(true, Ordering::Relaxed);
    running.server.join().unwrap().unwrap();
    let refused = TcpConnection::open("http://127.0.0.1:1");
    assert!(matches!(refused, Err(BridgeError::Address(_))), "{refused:?}");
}
