//! Push to and pull from a server that injects failures.

#![allow(clippy::unwrap_used)] // clippy's exemption covers test functions, not what they call

mod server;

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::time::Duration;

use genmanip_data::files::Writing;
use genmanip_s3::{Access, Bucket, LIST, RetryPolicy, S3Error, TransferSummary, pull, push};
use server::Server;

/// Retry policy with millisecond delays.
const QUICK: RetryPolicy =
    RetryPolicy { attempts: 9, initial_delay: Duration::from_millis(1), max_delay: Duration::from_millis(4) };

fn bucket(server: &Server, retry_policy: RetryPolicy) -> Bucket {
    let access = Access::from_variables(|name| match name {
        "AWS_ACCESS_KEY_ID" => Some("tester".into()),
        "AWS_SECRET_ACCESS_KEY" => Some("hush".into()),
        "AWS_ENDPOINT_URL" => Some(server.url()),
        _ => None,
    });
    Bucket::new("my-bucket", access.unwrap(), retry_policy)
}

/// Files with all kinds of names and sizes; one exceeds the part size.
fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, bytes: &[u8]| {
        let path = folder.path().join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, bytes).unwrap();
    };
    write("meta/info.json", b"{}");
    write("empty", b"");
    write("names/with blanks + signs=ü.txt", b"name");
    for number in 0..30_u8 {
        write(&format!("episodes/{number:03}/frames.parquet"), &vec![number; 1000 * usize::from(number)]);
    }
    let large: Vec<u8> = (0..17_000_000_u32).map(|index| (index / 7) as u8).collect();
    write("videos/large.mp4", &large);
    // Unfinished file of another process.
    write(".frames.parquet.partial-aa-bb-7-70-0", b"half");
    folder
}

fn contents(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let (mut found, mut folders) = (BTreeMap::new(), vec![folder.to_owned()]);
    while let Some(here) = folders.pop() {
        for entry in fs::read_dir(here).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else {
                let name = path.strip_prefix(folder).unwrap().to_str().unwrap().to_owned();
                found.insert(name, fs::read(&path).unwrap());
            }
        }
    }
    found.retain(|name, _| !name.contains(".partial-"));
    found
}

/// An upload whose completion response was lost counts as complete, whatever the server reports on retry.
#[test]
fn a_lost_completion_response_is_recovered() {
    for status in [403, 404] {
        let (server, from) = (Server::start(), folder());
        server.lose_completions(status);
        let sent = push(&bucket(&server, QUICK), from.path(), "runs", 4, &|_| ());
        assert_eq!(
            sent.map(|moved| moved.moved).map_err(|error| error.to_string()),
            Ok(contents(from.path()).len()),
            "{status}"
        );
    }
}

/// Every seventh call fails, alternating before and after the server processed it; every object still arrives.
#[test]
fn a_folder_survives_a_server_that_refuses_calls() {
    let (server, from) = (Server::start(), folder());
    server.fail_every(7);
    let bucket = bucket(&server, QUICK);
    let sent = push(&bucket, from.path(), "runs/monday", 4, &|_| ()).unwrap();
    let expected = contents(from.path());
    assert_eq!((sent.files, sent.moved), (expected.len(), expected.len()));
    let to = tempfile::tempdir().unwrap();
    let fetched = pull(&bucket, "runs/monday", to.path(), 4, &|_| ()).unwrap();
    assert_eq!((fetched.files, fetched.moved, fetched.bytes), (sent.files, sent.files, sent.bytes));
    assert!(contents(to.path()) == expected, "the pulled folder differs");
    assert!(server.failed() > 10, "only {} calls failed", server.failed());
    assert_eq!(server.unsigned(), 0, "calls whose payload did not match the signature");

    // Only changed files are transferred again.
    fs::write(from.path().join("empty"), b"not any more").unwrap();
    fs::write(to.path().join("meta/info.json"), b"[]").unwrap();
    let moved = |moved: TransferSummary| moved.moved;
    assert_eq!(moved(push(&bucket, from.path(), "runs/monday", 4, &|_| ()).unwrap()), 1);
    assert_eq!(moved(pull(&bucket, "runs/monday", to.path(), 4, &|_| ()).unwrap()), 2);
    assert!(contents(to.path()) == contents(from.path()));
    assert_eq!(moved(pull(&bucket, "runs/monday", to.path(), 4, &|_| ()).unwrap()), 0);
}

/// A server that fails midway: the error reports the progress, there is no file list, and the next call resumes.
#[test]
fn interrupted_pushes_resume() {
    let (server, from) = (Server::start(), folder());
    let bucket = bucket(&server, RetryPolicy { attempts: 3, ..QUICK });
    server.fail_from(40);
    let error = push(&bucket, from.path(), "a", 1, &|_| ()).unwrap_err();
    let S3Error::Stopped { done, all, .. } = &error else { panic!("{error}") };
    let (done, all) = (*done, *all);
    assert!(0 < done && done < all, "{done} of {all}");
    assert!(error.hint().contains("the same command resumes"), "{}", error.hint());
    let source = std::error::Error::source(&error).unwrap().to_string();
    assert!(source.contains("gave up after 3 attempts; last error: 503 SlowDown: please"), "{source}");
    server.fail_from(usize::MAX);
    let to = tempfile::tempdir().unwrap();
    let error = pull(&bucket, "a", to.path(), 1, &|_| ()).unwrap_err();
    assert!(matches!(&error, S3Error::NotComplete { object } if object.ends_with(LIST)), "{error}");
    let sent = push(&bucket, from.path(), "a", 1, &|_| ()).unwrap();
    assert_eq!((sent.files, sent.moved), (all, all - done));
    pull(&bucket, "a", to.path(), 2, &|_| ()).unwrap();
    assert!(contents(to.path()) == contents(from.path()));
}

/// A pull removes unfinished files of a killed pull and keeps those of running processes.
#[test]
fn unfinished_files_of_a_killed_pull_are_removed() {
    let (server, from, to) = (Server::start(), folder(), tempfile::tempdir().unwrap());
    let bucket = bucket(&server, QUICK);
    push(&bucket, from.path(), "a", 2, &|_| ()).unwrap();
    let episode = to.path().join("episodes/007");
    let being_written = Writing::begin(&episode.join("frames.parquet")).unwrap();
    let name = fs::read_dir(&episode).unwrap().next().unwrap().unwrap().file_name().into_string().unwrap();
    // The same, by a process that has ended.
    let mut ended = std::process::Command::new("true").spawn().unwrap();
    ended.wait().unwrap();
    let [this, other] = [std::process::id(), ended.id()].map(|id| format!("-{id}-"));
    let left = name.replace(&this, &other);
    assert_ne!(left, name);
    for parent in [to.path(), &episode] {
        fs::write(parent.join(&left), b"half").unwrap();
    }
    pull(&bucket, "a", to.path(), 2, &|_| ()).unwrap();
    assert!(!to.path().join(&left).exists() && !episode.join(&left).exists(), "it is still there");
    assert!(episode.join(&name).exists(), "somebody was writing that");
    drop(being_written);
    assert!(contents(to.path()) == contents(from.path()));
}

/// Lists that leave the folder, objects that differ from the list, and permanent refusals.
#[test]
fn invalid_lists_and_objects_are_rejected() {
    let server = Server::start();
    let bucket = bucket(&server, RetryPolicy { attempts: 2, ..QUICK });
    let to = tempfile::tempdir().unwrap();
    let hash = "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855";
    let list = |path: &str, bytes: u64, hash: &str| {
        format!(r#"{{"schema":"genmanip.objects/1","files":[{{"path":"{path}","bytes":{bytes},"sha256":"{hash}"}}]}}"#)
    };
    for (list, expected) in [
        (list("../evil", 0, hash), "files[0].path: expected a path within the folder, got \"../evil\""),
        (list("/etc/evil", 0, hash), "expected a path within the folder"),
        (list("a//b", 0, hash), "expected a path within the folder"),
        (list("a", 0, "abc"), "files[0].sha256: expected 64 digits"),
        (list("here", 3, hash), "a different hash"),
        (list("gone", 0, hash), "does not exist"),
        ("[]".into(), "cannot read the file list"),
        ("{".into(), "cannot read the file list"),
    ] {
        server.put(&format!("p/{LIST}"), list.as_bytes());
        server.put("p/here", b"abc");
        let mut error: &dyn std::error::Error = &pull(&bucket, "p", to.path(), 2, &|_| ()).unwrap_err();
        let mut said = error.to_string();
        while let Some(source) = error.source() {
            error = source;
            said += &format!(": {error}");
        }
        assert!(said.contains(expected), "{list}: {said}");
        assert!(contents(to.path()).is_empty(), "{list}: something was written");
    }
    server.refuse_all();
    let error = push(&bucket, folder().path(), "p", 2, &|_| ()).unwrap_err();
    let source = std::error::Error::source(&error).unwrap().to_string();
    assert!(source.contains("responded 403") && error.hint().contains("keys"), "{source}: {}", error.hint());

    let links = tempfile::tempdir().unwrap();
    std::os::unix::fs::symlink("/etc/passwd", links.path().join("link")).unwrap();
    let error = push(&bucket, links.path(), "p", 2, &|_| ()).unwrap_err().to_string();
    assert!(error.starts_with("expected files and folders, found a link"), "{error}");
}
