//! `cargo xtask test --cluster`: a real Slurm with two nodes on this machine, one of which is lost in mid-array.
//!
//! Everything lies in `target/cluster` and runs as whoever calls: munge, the controller and a daemon per node, all from
//! Debian's packages, on ports that are free. Nothing of a Slurm that is installed already is touched.

use crate::problem::{OnPath, Problem, Result};
use crate::process::{self, Workspace};
use std::collections::BTreeMap;
use std::fs;
use std::io::Read;
use std::net::TcpListener;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

const PROGRAMS: [&str; 8] = ["munged", "slurmctld", "slurmd", "sbatch", "squeue", "sinfo", "scancel", "scontrol"];
const PACKAGES: &str = "apt-get install --no-install-recommends slurmctld slurmd slurm-client munge";
const TASKS: [&str; 2] = ["examples/tasks/021_spatial.json", "examples/tasks/024_appearance.json"];
/// Attempts of each task; chosen: twelve shards of one attempt keep both nodes busy for minutes.
const EPISODES: &str = "6";
const SHARDS: &str = "12";
const SEED: &str = "781001";
/// The node that is lost.
const LOST: &str = "genmanip-n1";
/// The other one; names that no other Slurm of this machine has.
const KEPT: &str = "genmanip-n0";
/// Timeout of every wait.
const PATIENCE: Duration = Duration::from_secs(900);

pub fn run(workspace: &Workspace) -> Result {
    check_programs(workspace)?;
    let (place, genmanip) = (workspace.target_dir()?.join("cluster"), workspace.genmanip()?);
    let _ = fs::remove_dir_all(&place);
    fs::create_dir_all(&place).on("make the folder", &place)?;
    let cluster = Cluster::begin(workspace, &place)?;
    let collect = |out: &Path| {
        let mut words = vec!["collect"];
        words.extend(TASKS);
        words.extend(["--episodes", EPISODES, "--fps", "10", "--seed", SEED, "--out"]);
        words.into_iter().map(str::to_owned).chain([out.display().to_string()]).collect::<Vec<_>>()
    };
    let (shards, merged, whole) = (place.join("shards"), place.join("merged"), place.join("whole"));
    let mut launch = cluster.command(&genmanip);
    launch.args(["--quiet", "launch", "--slurm", "--shards", SHARDS, "--cpus", "1", "--"]).args(collect(&shards));
    process::output(&mut launch)?;
    println!("cluster: {SHARDS} shards of {EPISODES} attempts at {} tasks submitted", TASKS.len());
    cluster.lose_a_node()?;
    cluster.finish()?;
    let restarted = cluster.restarted()?;
    if restarted == 0 {
        return Err(Problem {
            what: "no job was queued again".into(),
            expected: format!("the one that ran on {LOST} when it was lost"),
            hint: format!("{} says what Slurm did", cluster.place.join("slurmctld.log").display()),
        });
    }
    process::output(workspace.command(&genmanip).args(["--quiet", "merge"]).arg(&shards).arg("--out").arg(&merged))?;
    process::output(workspace.command(&genmanip).arg("--quiet").args(collect(&whole)))?;
    let files = same(&merged, &whole)?;
    println!(
        "cluster: {LOST} lost, {restarted} job queued again; merged run and that of one process: {files} equal files"
    );
    Ok(())
}

fn check_programs(workspace: &Workspace) -> Result {
    let is_there = |program: &&str| {
        let mut which = workspace.command("sh");
        which.args(["-c", &format!("command -v {program}")]).stdout(Stdio::null()).stderr(Stdio::null());
        which.status().is_ok_and(|status| status.success())
    };
    match PROGRAMS.iter().find(|program| !is_there(program)) {
        None => Ok(()),
        Some(missing) => Err(Problem {
            what: format!("there is no `{missing}`"),
            expected: format!("{} on the PATH", PROGRAMS.join(", ")),
            hint: format!("on Debian and Ubuntu: {PACKAGES}"),
        }),
    }
}

/// A Slurm of our own.
struct Cluster<'a> {
    workspace: &'a Workspace,
    place: PathBuf,
    /// In the order in which they end.
    daemons: Vec<(&'static str, Child)>,
}

impl<'a> Cluster<'a> {
    fn begin(workspace: &'a Workspace, place: &Path) -> Result<Self> {
        let mut cluster = Self { workspace, place: place.into(), daemons: Vec::new() };
        let at = |name: &str| place.join(name).display().to_string();
        for folder in ["state".to_owned(), format!("spool-{KEPT}"), format!("spool-{LOST}")] {
            fs::create_dir_all(place.join(folder)).on("make the folder", place)?;
        }
        let mut key = [0; 128];
        let random = Path::new("/dev/urandom");
        fs::File::open(random).and_then(|mut file| file.read_exact(&mut key)).on("read", random)?;
        let key_file = place.join("munge.key");
        fs::write(&key_file, key).on("write", &key_file)?;
        process::output(workspace.command("chmod").arg("0600").arg(&key_file))?;
        // A socket's path has at most 107 letters.
        let socket = std::env::temp_dir().join(format!("genmanip-munge-{}", std::process::id()));
        let settings = place.join("slurm.conf");
        fs::write(&settings, configuration(workspace, place, &socket)?).on("write", &settings)?;
        let mut munged = workspace.command("munged");
        munged.args(["--foreground", "--force"]).arg(format!("--socket={}", socket.display()));
        for (option, name) in
            [("key", "munge.key"), ("pid", "munged.pid"), ("log", "munged.log"), ("seed", "munged.seed")]
        {
            munged.arg(format!("--{option}-file={}", at(name)));
        }
        cluster.start("munged", munged)?;
        cluster.wait("munge's socket", |_| Ok(socket.exists().then_some(())))?;
        let controller = cluster.command("slurmctld");
        cluster.start("slurmctld", controller)?;
        for node in [KEPT, LOST] {
            let mut daemon = cluster.command("slurmd");
            daemon.args(["-N", node]);
            cluster.start(if node == LOST { LOST } else { KEPT }, daemon)?;
        }
        cluster.wait("two idle nodes", |cluster| {
            let nodes = cluster.asked("sinfo", &["-h", "-N", "-o", "%T"])?;
            Ok((nodes.lines().filter(|state| *state == "idle").count() == 2).then_some(()))
        })?;
        Ok(cluster)
    }

    fn start(&mut self, name: &'static str, mut command: Command) -> Result {
        let log = self.place.join(format!("{name}.out"));
        let file = fs::File::create(&log).on("write", &log)?;
        if name != "munged" {
            command.arg("-D");
        }
        let child = command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(file).spawn();
        self.daemons.insert(0, (name, child.map_err(|error| process::cannot_start(name, &error))?));
        Ok(())
    }

    /// A program that speaks to this Slurm.
    fn command(&self, program: impl AsRef<std::ffi::OsStr>) -> Command {
        let mut command = self.workspace.command(program);
        command.env("SLURM_CONF", self.place.join("slurm.conf"));
        command
    }

    /// Standard output of a Slurm program; empty while the controller does not listen yet.
    fn asked(&self, program: &str, arguments: &[&str]) -> Result<String> {
        let mut command = self.command(program);
        let answer = command.args(arguments).stdin(Stdio::null()).output();
        let answer = answer.map_err(|error| process::cannot_start(program, &error))?;
        Ok(String::from_utf8_lossy(&answer.stdout).into_owned())
    }

    /// Asks until there is an answer.
    fn wait<T>(&self, what: &str, answer: impl Fn(&Self) -> Result<Option<T>>) -> Result<T> {
        let start = Instant::now();
        while start.elapsed() < PATIENCE {
            if let Some(answer) = answer(self)? {
                return Ok(answer);
            }
            sleep(Duration::from_millis(500));
        }
        Err(Problem {
            what: format!("{what} did not come in {} s", PATIENCE.as_secs()),
            expected: "a Slurm that works".into(),
            hint: format!("its logs lie in {}", self.place.display()),
        })
    }

    /// Kills a node with all that runs on it, while it makes an episode.
    fn lose_a_node(&self) -> Result {
        let running = self.wait("a job on the node that is to be lost", |_| {
            let running = processes_of(LOST);
            // Its job has begun to work when the shell of the script has become our program.
            Ok(running.iter().any(|process| process.name == "genmanip").then_some(running))
        })?;
        // In mid-attempt, not while it starts.
        sleep(Duration::from_secs(3));
        let daemon = self.daemons.iter().find(|(name, _)| *name == LOST).map(|(_, child)| child.id());
        let mut ids: Vec<u32> = daemon.into_iter().collect();
        for process in running.iter().chain(&processes_of(LOST)) {
            // Above the job stands the program that watches it, which is gone with the node too.
            let is_watcher = name_of(process.parent).is_some_and(|name| name.starts_with("slurmstepd"));
            ids.extend(is_watcher.then_some(process.parent));
            ids.push(process.id);
        }
        ids.sort_unstable();
        ids.dedup();
        for id in ids {
            let _ = process::output(self.workspace.command("kill").args(["-9", &id.to_string()]));
        }
        println!(
            "cluster: {LOST} killed while it ran {}",
            running.iter().map(|one| one.name.as_str()).collect::<Vec<_>>().join(", ")
        );
        Ok(())
    }

    /// Waits until no job is left; one that was queued again need not wait the two minutes that Slurm leaves a user to
    /// look at it.
    fn finish(&self) -> Result {
        self.wait("the end of all jobs", |cluster| {
            let jobs = cluster.asked("squeue", &["-h", "-r", "-o", "%i %T %r"])?;
            for job in jobs.lines().filter(|job| job.ends_with(" PENDING BeginTime")) {
                let id = job.split(' ').next().unwrap_or_default();
                cluster.asked("scontrol", &["update", &format!("JobId={id}"), "StartTime=now"])?;
            }
            let is_up = !cluster.asked("sinfo", &["-h"])?.is_empty();
            Ok((jobs.is_empty() && is_up).then_some(()))
        })
    }

    /// Number of jobs that ran a second time.
    fn restarted(&self) -> Result<usize> {
        let jobs = self.asked("scontrol", &["show", "job", "-o"])?;
        Ok(jobs.lines().filter(|job| job.contains(" Restarts=") && !job.contains(" Restarts=0 ")).count())
    }
}

impl Drop for Cluster<'_> {
    fn drop(&mut self) {
        let _ = self.asked("scancel", &["--state=RUNNING,PENDING", "--name=genmanip"]);
        for (_, child) in &mut self.daemons {
            let _ = process::output(self.workspace.command("kill").arg(child.id().to_string()));
            let _ = child.wait();
        }
    }
}

/// `slurm.conf`: two nodes of one core each on this host.
fn configuration(workspace: &Workspace, place: &Path, socket: &Path) -> Result<String> {
    let host = process::output(workspace.command("hostname").arg("-s"))?.trim().to_owned();
    let user = process::output(workspace.command("id").arg("-un"))?.trim().to_owned();
    // Held together until all are known, so that none comes twice.
    let free = || TcpListener::bind("127.0.0.1:0").on("take a free port of", Path::new("127.0.0.1"));
    let listeners = [free()?, free()?, free()?];
    let mut ports = Vec::new();
    for listener in &listeners {
        ports.push(listener.local_addr().on("take a free port of", Path::new("127.0.0.1"))?.port());
    }
    let (place, socket) = (place.display(), socket.display());
    Ok(format!(
        "ClusterName=genmanip\nSlurmctldHost={host}(127.0.0.1)\nSlurmUser={user}\nSlurmdUser={user}\n\
         AuthType=auth/munge\nAuthInfo=socket={socket}\nCredType=cred/munge\n\
         StateSaveLocation={place}/state\nSlurmdSpoolDir={place}/spool-%n\n\
         SlurmctldPidFile={place}/slurmctld.pid\nSlurmdPidFile={place}/slurmd-%n.pid\n\
         SlurmctldLogFile={place}/slurmctld.log\nSlurmdLogFile={place}/slurmd-%n.log\nSlurmctldPort={controller}\n\
         ProctrackType=proctrack/linuxproc\nTaskPlugin=task/none\nMpiDefault=none\nJobCompType=jobcomp/none\n\
         SchedulerType=sched/backfill\nSchedulerParameters=sched_interval=2,bf_interval=2\n\
         SelectType=select/cons_tres\nSelectTypeParameters=CR_Core\nSlurmdParameters=config_overrides\n\
         JobRequeue=1\nReturnToService=2\nSlurmdTimeout=15\nMinJobAge=3600\n\
         NodeName={KEPT} NodeHostname={host} NodeAddr=127.0.0.1 Port={first} CPUs=1 RealMemory=8000 State=UNKNOWN\n\
         NodeName={LOST} NodeHostname={host} NodeAddr=127.0.0.1 Port={second} CPUs=1 RealMemory=8000 State=UNKNOWN\n\
         PartitionName=all Nodes={KEPT},{LOST} Default=YES MaxTime=INFINITE State=UP\n",
        controller = ports[0],
        first = ports[1],
        second = ports[2],
    ))
}

/// A process of a job.
struct Process {
    id: u32,
    parent: u32,
    name: String,
}

/// The processes of jobs on a node: Slurm tells each in its environment where it runs.
fn processes_of(node: &str) -> Vec<Process> {
    let wanted = format!("SLURMD_NODENAME={node}");
    let own = |id: u32| -> Option<Process> {
        let environment = fs::read(format!("/proc/{id}/environ")).ok()?;
        environment.split(|byte| *byte == 0).find(|entry| *entry == wanted.as_bytes())?;
        // `ID (NAME) STATE PARENT …`
        let state = fs::read_to_string(format!("/proc/{id}/stat")).ok()?;
        let parent = state.rsplit(')').next()?.split_whitespace().nth(1)?.parse().ok()?;
        Some(Process { id, parent, name: name_of(id)? })
    };
    let ids = fs::read_dir("/proc").into_iter().flatten().flatten();
    ids.filter_map(|entry| own(entry.file_name().to_str()?.parse().ok()?)).collect()
}

fn name_of(id: u32) -> Option<String> {
    fs::read_to_string(format!("/proc/{id}/comm")).ok().map(|name| name.trim().to_owned())
}

/// Number of files of two runs; an error unless all are equal, timings apart.
pub fn same(left: &Path, right: &Path) -> Result<usize> {
    let [ours, theirs] = [files(left)?, files(right)?];
    let differs = |what: &str| Problem {
        what: format!("two folders that should hold the same do not: {what}"),
        expected: "the same files".into(),
        hint: format!("compare {} and {}", left.display(), right.display()),
    };
    let names = |files: &BTreeMap<String, Vec<u8>>| files.keys().cloned().collect::<Vec<_>>();
    if names(&ours) != names(&theirs) {
        return Err(differs("other files"));
    }
    match ours.iter().find(|(name, bytes)| theirs.get(*name) != Some(*bytes)) {
        Some((name, _)) => Err(differs(name)),
        None => Ok(ours.len()),
    }
}

/// Contents of all files below a folder, timings apart.
pub fn files(root: &Path) -> Result<BTreeMap<String, Vec<u8>>> {
    let (mut found, mut folders) = (BTreeMap::new(), vec![root.to_path_buf()]);
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(&folder).on("list", &folder)? {
            let path = entry.on("list", &folder)?.path();
            if path.is_dir() {
                folders.push(path);
            } else if path.file_name().is_none_or(|name| name != "timings.json") {
                let name = path.strip_prefix(root).unwrap_or(&path).display().to_string();
                found.insert(name, fs::read(&path).on("read", &path)?);
            }
        }
    }
    Ok(found)
}
