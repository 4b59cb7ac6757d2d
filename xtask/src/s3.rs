//! `cargo xtask test --s3`: a folder pushed to a real S3 server and pulled, each killed several times and continued, behind
//! a proxy that lets a tenth of all calls fail; every byte comes back.
//!
//! The server is `s3s-fs`, built once into `target/s3`; nothing outside of that folder is touched.

use crate::cluster;
use crate::problem::{OnPath, Problem, Result};
use crate::process::{self, Workspace};
use std::fs;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{Shutdown, TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread::sleep;
use std::time::{Duration, Instant};

/// An independent implementation of S3, permissively licensed.
const SERVER: &str = "s3s-fs@0.14.1";
const BUCKET: &str = "my-bucket";
const KEYS: [(&str, &str); 2] = [("AWS_ACCESS_KEY_ID", "tester"), ("AWS_SECRET_ACCESS_KEY", "not-a-secret")];
/// Small files, chosen: enough calls that a tenth of them are many.
const SMALL_FILES: u32 = 300;
/// After so many calls pushes are killed, one after the other; one that goes on asks first for what was sent. Chosen: the
/// first is sending files in parts, and a whole push makes more than 600 calls.
const PUSHES_KILLED_AFTER: [usize; 4] = [20, 200, 300, 350];
/// The same of pulls, of which a whole one makes more than 300 calls.
const PULLS_KILLED_AFTER: [usize; 4] = [5, 70, 70, 70];
/// Until the server listens, or so many calls are made.
const PATIENCE: Duration = Duration::from_secs(300);

pub fn run(workspace: &Workspace) -> Result {
    let place = workspace.target_dir()?.join("s3");
    let server = installed(workspace, &place)?;
    let (from, to, kept) = (place.join("from"), place.join("to"), place.join("server"));
    for folder in [&from, &to, &kept] {
        let _ = fs::remove_dir_all(folder);
    }
    make_files(&from)?;
    fs::create_dir_all(kept.join(BUCKET)).on("make the folder", &kept)?;
    let port = free_port()?;
    let _server = Server::start(workspace, &server, port, &kept)?;
    let proxy = Proxy::start(port)?;
    let genmanip = workspace.genmanip()?;
    let address = format!("s3://{BUCKET}/runs/monday");
    let data = |words: [&str; 3]| {
        let mut command = workspace.command(&genmanip);
        command.args(["data"]).args(words).env("AWS_ENDPOINT_URL", format!("http://127.0.0.1:{}", proxy.port));
        command.envs(KEYS);
        command
    };
    let (source, target) = (from.display().to_string(), to.display().to_string());

    let kill = |words: [&str; 3], after: usize| killed(&mut data(words), after, &proxy);
    for (number, after) in PUSHES_KILLED_AFTER.into_iter().enumerate() {
        kill(["push", &source, &address], after)?;
        if number == 0 && process::output(&mut data(["pull", &address, &target])).is_ok() {
            return Err(Problem {
                what: "half a folder was pulled".into(),
                expected: "a refusal, as there is no list of files yet".into(),
                hint: "this is a defect of `genmanip data push`".into(),
            });
        }
    }
    print!("{}", process::output(&mut data(["push", &source, &address]))?);
    let mut half_written = 0;
    for after in PULLS_KILLED_AFTER {
        kill(["pull", &address, &target], after)?;
        half_written += cluster::files(&to)?.keys().filter(|name| name.contains(".partial-")).count();
    }
    print!("{}", process::output(&mut data(["pull", &address, &target]))?);
    let files = cluster::same(&from, &to)?;
    let (calls, failed) = (proxy.calls(), proxy.failed());
    if failed * 20 < calls {
        return Err(Problem {
            what: format!("only {failed} of {calls} calls failed"),
            expected: "about a tenth".into(),
            hint: "this is a defect of the proxy".into(),
        });
    }
    let (pushes, pulls) = (PUSHES_KILLED_AFTER.len(), PULLS_KILLED_AFTER.len());
    println!(
        "s3: {files} equal files after {pushes} killed pushes and {pulls} killed pulls, whose {half_written} half-written \
         files are gone; {failed} of {calls} calls failed"
    );
    Ok(())
}

/// Starts a command and kills it when it has made so many calls.
fn killed(command: &mut Command, after: usize, proxy: &Proxy) -> Result {
    let program = Path::new("genmanip");
    let before = proxy.calls();
    let mut child = command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().on("start", program)?;
    let begun = Instant::now();
    let is_running = |child: &mut Child| matches!(child.try_wait(), Ok(None));
    while proxy.calls() < before + after && begun.elapsed() < PATIENCE && is_running(&mut child) {
        sleep(Duration::from_millis(1));
    }
    let _ = child.kill();
    let Output { status, stderr, .. } = child.wait_with_output().on("wait for", program)?;
    if status.code().is_some() {
        let said = String::from_utf8_lossy(&stderr);
        return Err(Problem {
            what: format!("`{}` ended ({status}) before it was killed: {}", process::shown(command), said.trim()),
            expected: format!("more than {after} calls"),
            hint: "make SMALL_FILES larger, unless it failed".into(),
        });
    }
    Ok(())
}

/// Builds the server, unless that was done.
fn installed(workspace: &Workspace, place: &Path) -> Result<PathBuf> {
    let program = place.join("bin/s3s-fs");
    if !program.exists() {
        eprintln!("s3: building {SERVER}");
        let (root, build) = (place.display().to_string(), place.join("build"));
        let words = ["install", SERVER, "--locked", "--features", "binary", "--root", &root];
        process::visible(workspace.cargo(words).env("CARGO_TARGET_DIR", &build))?;
        fs::remove_dir_all(&build).on("remove", &build)?;
    }
    Ok(program)
}

/// Many small files, and before them two that are sent in parts.
fn make_files(folder: &Path) -> Result {
    let write = |name: String, bytes: Vec<u8>| {
        let path = folder.join(name);
        let parent = path.parent().unwrap_or(folder);
        fs::create_dir_all(parent).on("make the folder", parent)?;
        fs::write(&path, bytes).on("write", &path)
    };
    for number in 0..SMALL_FILES {
        let bytes = (0..number * 40).map(|index| (index * 31 + number) as u8).collect();
        write(format!("episodes/{number:03}/a file + ü.bin"), bytes)?;
    }
    for (number, bytes) in [17_000_000_u32, 40_000_000].into_iter().enumerate() {
        write(format!("cameras/{number}.mp4"), (0..bytes).map(|index| (index / 7) as u8).collect())?;
    }
    Ok(())
}

fn free_port() -> Result<u16> {
    let listener = TcpListener::bind("127.0.0.1:0").and_then(|listener| listener.local_addr());
    Ok(listener.on("find a free port on", Path::new("127.0.0.1"))?.port())
}

/// Ends with the test.
struct Server(Child);

impl Server {
    fn start(workspace: &Workspace, program: &Path, port: u16, kept: &Path) -> Result<Self> {
        let log = kept.with_file_name("server.log");
        let file = fs::File::create(&log).on("write", &log)?;
        let mut command: Command = workspace.command(program);
        command.args(["--host", "127.0.0.1", "--port", &port.to_string()]);
        command.args(["--access-key", KEYS[0].1, "--secret-key", KEYS[1].1]).arg(kept);
        let errors = file.try_clone().on("write", &log)?;
        let child = command.stdin(Stdio::null()).stdout(file).stderr(errors).spawn().on("start", program)?;
        let server = Self(child);
        let begun = Instant::now();
        while TcpStream::connect(("127.0.0.1", port)).is_err() {
            if begun.elapsed() > PATIENCE {
                return Err(Problem {
                    what: "the server does not listen".into(),
                    expected: format!("{SERVER} on port {port}"),
                    hint: format!("{} says why", log.display()),
                });
            }
            sleep(Duration::from_millis(20));
        }
        Ok(server)
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Hands calls on, and lets a tenth of them fail: refused before they are made, their answer lost, or cut in the middle.
struct Proxy {
    port: u16,
    counts: Arc<Counts>,
}

#[derive(Default)]
struct Counts {
    calls: AtomicUsize,
    failed: AtomicUsize,
}

impl Proxy {
    fn start(server: u16) -> Result<Self> {
        let here = Path::new("127.0.0.1");
        let listener = TcpListener::bind("127.0.0.1:0").on("listen on", here)?;
        let port = listener.local_addr().on("listen on", here)?.port();
        let counts = Arc::new(Counts::default());
        let shared = Arc::clone(&counts);
        std::thread::spawn(move || {
            for client in listener.incoming().flatten() {
                let counts = Arc::clone(&shared);
                std::thread::spawn(move || {
                    // Whoever hangs up is not our business.
                    let _ = hand_on(client, server, &counts);
                });
            }
        });
        Ok(Self { port, counts })
    }

    fn calls(&self) -> usize {
        self.counts.calls.load(Ordering::Relaxed)
    }

    fn failed(&self) -> usize {
        self.counts.failed.load(Ordering::Relaxed)
    }
}

fn hand_on(mut client: TcpStream, server: u16, counts: &Counts) -> std::io::Result<()> {
    let call = read_call(&client)?;
    let number = counts.calls.fetch_add(1, Ordering::Relaxed) + 1;
    // Knuth's multiplicative hash: each tenth of the calls, in no order.
    let drawn = (number as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 32;
    let fails = drawn.is_multiple_of(10);
    counts.failed.fetch_add(usize::from(fails), Ordering::Relaxed);
    let how = if fails { drawn / 10 % 3 } else { 3 };
    if how == 0 {
        return client.write_all(b"HTTP/1.1 503 Slow Down\r\nconnection: close\r\ncontent-length: 0\r\n\r\n");
    }
    let mut upstream = TcpStream::connect(("127.0.0.1", server))?;
    upstream.write_all(&call)?;
    let mut answer = Vec::new();
    upstream.read_to_end(&mut answer)?;
    match how {
        1 => {}
        2 => client.write_all(&answer[..answer.len() / 2])?,
        _ => client.write_all(&answer)?,
    }
    client.shutdown(Shutdown::Both)
}

/// A whole call, which asks for its connection to be closed behind it.
fn read_call(client: &TcpStream) -> std::io::Result<Vec<u8>> {
    let (mut reader, mut call, mut length) = (BufReader::new(client), Vec::new(), 0_usize);
    loop {
        let mut line = String::new();
        if reader.read_line(&mut line)? == 0 {
            return Err(std::io::ErrorKind::UnexpectedEof.into());
        }
        let lower = line.to_ascii_lowercase();
        if let Some(value) = lower.strip_prefix("content-length:") {
            length = value.trim().parse().map_err(|_| std::io::ErrorKind::InvalidData)?;
        }
        if line.trim().is_empty() {
            break;
        }
        if !lower.starts_with("connection:") {
            call.extend(line.as_bytes());
        }
    }
    call.extend(b"connection: close\r\n\r\n");
    let head = call.len();
    call.resize(head + length, 0);
    reader.read_exact(&mut call[head..])?;
    Ok(call)
}
