use std::path::Path;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use genmanip_core::{Document, Seed};
use genmanip_llm::fake::{Behaviour, FakeServer};
use genmanip_llm::{
    CassetteChat, CassetteMode, CassetteSettings, ChatError, ChatModel, ChatRequest, HttpChat, Image, Message, Part,
    Role, read_cassette,
};
use serde_json::Value;

use crate::{client, impatient, question};

/// A PNG file, 2 pixels wide and 1 high, with these colours.
pub fn png(rgb: [u8; 6]) -> Vec<u8> {
    let mut file = Vec::new();
    let mut encoder = png::Encoder::new(&mut file, 2, 1);
    encoder.set_color(png::ColorType::Rgb);
    encoder.write_header().unwrap().write_image_data(&rgb).unwrap();
    file
}

fn pixels(file: &[u8]) -> Vec<u8> {
    let mut reader = png::Decoder::new(std::io::Cursor::new(file)).read_info().unwrap();
    let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
    reader.next_frame(&mut pixels).unwrap();
    pixels
}

pub fn image(rgb: [u8; 6]) -> Part {
    Part::Image(Image::new(png(rgb)).unwrap())
}

pub const RED_GREEN: [u8; 6] = [255, 0, 0, 0, 255, 0];
const RED_BLUE: [u8; 6] = [255, 0, 0, 0, 0, 255];

fn question_with(parts: impl IntoIterator<Item = Part>) -> ChatRequest {
    ChatRequest { messages: vec![Message::system("Answer."), Message::user_parts(parts)], ..question("") }
}

pub fn words(text: &str) -> Part {
    Part::Text(text.into())
}

#[test]
fn an_image_arrives_decodable() {
    let server = FakeServer::scripted([Behaviour::Answer("green".into())]).unwrap();
    let request = question_with([words("Which colour is at the right of"), image(RED_GREEN), words("this?")]);
    client(&server).chat(&request).unwrap();
    let body = &server.seen()[0].body;
    assert_eq!(body["messages"][0]["content"], "Answer.", "a single text stays a string");
    let parts: Vec<&Value> = body["messages"][1]["content"].as_array().unwrap().iter().collect();
    let kinds: Vec<&Value> = parts.iter().map(|part| &part["type"]).collect();
    assert_eq!(kinds, ["text", "image_url", "text"]);
    assert_eq!(parts[2]["text"], "this?");
    let url = parts[1]["image_url"]["url"].as_str().unwrap();
    let file = STANDARD.decode(url.strip_prefix("data:image/png;base64,").unwrap()).unwrap();
    assert_eq!(file, png(RED_GREEN));
    assert_eq!(pixels(&file), RED_GREEN);
}

#[test]
fn the_key_depends_on_every_part_and_its_place() {
    let requests = [
        question_with([words("a"), image(RED_GREEN)]),
        question_with([words("a"), image(RED_BLUE)]),
        question_with([image(RED_GREEN), words("a")]),
        question_with([words("a"), image(RED_GREEN), image(RED_GREEN)]),
        question_with([image(RED_GREEN)]),
        question_with([words("a"), words("b")]),
        question_with([words("a\nb")]),
        question_with([words("a")]),
        question_with([]),
    ];
    for (index, request) in requests.iter().enumerate() {
        assert_eq!(request.key(), request.clone().key());
        for other in &requests[..index] {
            assert_ne!(request.key(), other.key(), "{request:?} and {other:?}");
        }
    }
    assert_eq!(question_with([words("a")]).key(), question("a").key(), "one text is one text, however it is written");
}

fn cassettes(mode: CassetteMode, folder: &Path) -> CassetteSettings {
    CassetteSettings { mode, folder: folder.into(), note: String::new() }
}

#[test]
fn cassettes_hold_hashes_of_images_and_tell_others_apart() {
    let folder = tempfile::tempdir().unwrap();
    let server = FakeServer::scripted([Behaviour::Answer("two pixels".into())]).unwrap();
    let record = CassetteChat::new(client(&server), cassettes(CassetteMode::Record, folder.path()), None);
    let request = question_with([words("What is\nthis?"), image(RED_GREEN)]);
    record.chat(&request).unwrap();
    let path = std::fs::read_dir(folder.path()).unwrap().next().unwrap().unwrap().path();
    let cassette = read_cassette(&path).unwrap();
    assert_eq!(cassette.key, request.key());
    let recorded = serde_json::to_string_pretty(&cassette.to_value()["request"]["messages"][1]).unwrap();
    let Part::Image(image_file) = image(RED_GREEN) else { unreachable!() };
    let expected = serde_json::json!({
        "role": "user",
        "parts": [
            {"text": ["What is", "this?"]},
            {"image": {
                "media_type": "image/png", "size_bytes": png(RED_GREEN).len(), "sha256": image_file.sha256(),
            }},
        ],
    });
    assert_eq!(recorded, serde_json::to_string_pretty(&expected).unwrap());
    assert!(!std::fs::read_to_string(&path).unwrap().contains(&STANDARD.encode(png(RED_GREEN))));

    let replay = CassetteChat::<HttpChat>::replay(cassettes(CassetteMode::Replay, folder.path()));
    assert_eq!(replay.chat(&request).unwrap().text, "two pixels");
    let miss = |parts: Vec<Part>| replay.chat(&question_with(parts)).unwrap_err().to_string();
    let error = miss(vec![words("What is\nthis?"), image(RED_BLUE)]);
    assert!(error.contains("which differs at messages[1] part 1 line 1: asked \"image/png, "), "{error}");
    let error = miss(vec![words("What is\nthat?"), image(RED_GREEN)]);
    assert!(error.contains("messages[1] part 0 line 2: asked \"that?\", recorded \"this?\""), "{error}");
    let error = miss(vec![words("What is\nthis?")]);
    assert!(error.contains("messages[1] part 1 line 1: asked \"nothing\", recorded \"image/png, "), "{error}");
}

#[test]
fn only_users_show_images() {
    let server = FakeServer::scripted([]).unwrap();
    for (message, role) in [(0, Role::System), (1, Role::Assistant)] {
        let mut request = question_with([words("?")]);
        request.messages[message] = Message { role, parts: vec![image(RED_GREEN)] };
        let error = client(&server).chat(&request).unwrap_err();
        assert_eq!(error, ChatError::MisplacedImage { message });
    }
    assert!(server.seen().is_empty());
}

#[test]
fn what_is_too_large_is_not_sent() {
    let server = FakeServer::scripted([Behaviour::Answer("seen".into())]).unwrap();
    let size_bytes = png(RED_GREEN).len() as u64;
    let ask = |max_image_bytes: u64, max_request_bytes: u64| {
        let mut settings = impatient(server.base_url());
        (settings.max_image_bytes, settings.max_request_bytes) = (max_image_bytes, max_request_bytes);
        let request = question_with([words("?"), image(RED_GREEN), image(RED_BLUE)]);
        HttpChat::new(settings, None, Seed::new(1)).unwrap().chat(&request)
    };
    let error = ask(size_bytes - 1, 1 << 20).unwrap_err();
    let expected = format!("the image in message 1 has {size_bytes} bytes, more than the limit of {}", size_bytes - 1);
    assert_eq!(error.to_string(), expected);
    assert!(error.hint().contains("max_image_bytes"));
    let error = ask(size_bytes, 200).unwrap_err();
    assert!(matches!(error, ChatError::RequestTooLarge { limit_bytes: 200, .. }), "{error}");
    assert!(error.hint().contains("max_request_bytes"));
    assert!(server.seen().is_empty());
    assert_eq!(ask(size_bytes, 1 << 20).unwrap().text, "seen");
}
