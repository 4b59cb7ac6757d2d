//! Services on loopback, used by the agent's clients.

#![allow(clippy::unwrap_used)] // clippy's exemption covers test functions, not what they call

mod env;
mod policy;

use std::io::{Read, Write};
use std::net::TcpStream;

use genmanip_agent::segmentation::{RgbdSegmenter, SegmentQuestion, Segmenter};
use genmanip_agent::services::ServiceMasks;
use genmanip_core::glam::DVec3;
use genmanip_core::{Camera, Intrinsics, RgbdImage};
use genmanip_llm::{HttpService, Service, ServiceSettings};
use genmanip_serve::{Endpoint, ServeSettings, Server, openapi};
use serde_json::{Value, json};

fn server(max_request_bytes: usize) -> Server {
    let address = ([127, 0, 0, 1], 0).into();
    let settings = ServeSettings { address, max_request_bytes, workers: 2 };
    Server::start(Endpoint::Segment(RgbdSegmenter::default()), &settings).unwrap()
}

fn client(server: &Server) -> HttpService {
    let url = format!("http://{}/segment", server.address());
    HttpService::new(ServiceSettings { total_timeout_s: 20.0, ..ServiceSettings::at(&url) }).unwrap()
}

/// A table seen obliquely from above, with a red cube and a blue one on it.
fn two_cubes() -> RgbdImage {
    let intrinsics = Intrinsics::from_vertical_fov(160, 90, 0.6);
    let world_from_camera = Camera::pose_looking_at(DVec3::new(1.4, 0.0, 1.0), DVec3::new(0.5, 0.0, 0.0));
    let cubes = [DVec3::new(0.5, -0.15, 0.0), DVec3::new(0.5, 0.15, 0.0)];
    let (mut depth, mut rgb) = (Vec::new(), Vec::new());
    for y in 0..90 {
        for x in 0..160 {
            let ray = intrinsics.unproject(genmanip_core::glam::DVec2::new(f64::from(x), f64::from(y)), 1.0);
            let (eye, along) = (world_from_camera.position, world_from_camera.transform_vector(ray));
            let table = -eye.z / along.z;
            let hit = |cube: &DVec3| {
                let (low, high) = (*cube - DVec3::new(0.04, 0.04, 0.0), *cube + DVec3::new(0.04, 0.04, 0.08));
                let (one, other) = ((low - eye) / along, (high - eye) / along);
                let (near, far) = (one.min(other).max_element(), one.max(other).min_element());
                (near < far).then_some(near)
            };
            let hits = cubes.iter().map(hit).collect::<Vec<_>>();
            let (color, at) = match hits[..] {
                [Some(at), _] => ([200, 30, 30], at),
                [_, Some(at)] => ([30, 30, 200], at),
                _ => ([190, 170, 140], table),
            };
            rgb.extend::<[u8; 3]>(color);
            depth.push(at as f32);
        }
    }
    RgbdImage { rgb, ..RgbdImage::of_depth(intrinsics, world_from_camera, depth) }
}

/// Status and body of a raw request.
fn bare(server: &Server, request: &str) -> (String, String) {
    let mut stream = TcpStream::connect(server.address()).unwrap();
    stream.write_all(request.as_bytes()).unwrap();
    let mut text = String::new();
    let _ = stream.read_to_string(&mut text);
    let (head, body) = text.split_once("\r\n\r\n").unwrap_or((&text, ""));
    (head.lines().next().unwrap_or_default().to_owned(), body.to_owned())
}

#[test]
fn masks_over_http_are_those_of_the_library() {
    let server = server(1 << 20);
    let image = two_cubes();
    let question = SegmentQuestion { image: &image, ignore: &[], within: None };
    let masks = ServiceMasks::new(client(&server)).segment(&question).unwrap();
    assert_eq!(masks, RgbdSegmenter::default().segment(&question).unwrap());
    assert!(masks.len() >= 2, "a mask for each cube: {}", masks.len());
}

#[test]
fn bad_requests_are_refused_with_their_place() {
    let server = server(10_000);
    let ask = |value: Value| client(&server).ask(&value).unwrap_err().to_string();
    assert!(ask(json!({"rgb": 7})).contains("answered 400: at rgb: invalid type"), "{}", ask(json!({"rgb": 7})));
    let pose = json!({"position_m": [0, 0, 0], "orientation_wxyz": [1, 0, 0, 0]});
    let k = json!({"width": 2, "height": 2, "fx": 1, "fy": 1, "cx": 0, "cy": 0});
    let short = ask(json!({"intrinsics": k, "world_from_camera": pose, "rgb": "AAAA"}));
    assert!(short.contains("400: rgb has 3 bytes, expected 12"), "{short}");
    let flat = ask(json!({"intrinsics": k, "world_from_camera": pose, "rgb": "AAAAAAAAAAAAAAAA"}));
    assert!(flat.contains("422: segmentation needs colour and depth of 4 pixels"), "{flat}");
    assert!(ask(json!({"rgb": "A".repeat(20_000)})).contains("answered 413"), "too large");
    let deep = "[".repeat(5000);
    let head = format!(
        "POST /segment HTTP/1.1\r\nhost: localhost\r\nconnection: close\r\ncontent-length: {}\r\n\r\n",
        deep.len()
    );
    assert!(bare(&server, &(head + &deep)).0.contains("400"), "nested too deeply");
}

#[test]
fn a_service_says_what_it_is() {
    let server = server(1000);
    let (status, body) = bare(&server, "GET /health HTTP/1.1\r\nhost: localhost\r\nconnection: close\r\n\r\n");
    assert_eq!(
        (status.as_str(), serde_json::from_str::<Value>(&body).unwrap()["service"].clone()),
        ("HTTP/1.1 200 OK", json!("segment"))
    );
    let (_, body) = bare(&server, "GET /openapi.json HTTP/1.1\r\nhost: localhost\r\nconnection: close\r\n\r\n");
    let described: Value = serde_json::from_str(&body).unwrap();
    assert_eq!(described, openapi(&Endpoint::Segment(RgbdSegmenter::default())));
    let asked = &described["paths"]["/segment"]["post"]["requestBody"]["content"]["application/json"]["schema"];
    assert!(asked["properties"]["depth_m"].is_object(), "{asked}");
    assert!(bare(&server, "GET /segment HTTP/1.1\r\nhost: localhost\r\nconnection: close\r\n\r\n").0.contains("405"));
}

#[test]
fn pages_of_other_sites_are_refused() {
    let server = server(1000);
    for (headers, status) in [
        ("host: localhost\r\n", "200"),
        ("host: localhost\r\norigin: https://example.org\r\n", "403"),
        ("host: rebound.example.org\r\n", "403"),
    ] {
        let (answered, body) = bare(&server, &format!("GET /health HTTP/1.1\r\n{headers}connection: close\r\n\r\n"));
        assert!(answered.contains(status), "{headers:?}: {answered} {body}");
    }
}
