//! A policy from a Python module, in a Python process connected by pipes.
//!
//! The process needs NumPy and the policy's dependencies, but no GenManip package: it runs `policy_process.py`, which
//! is embedded in this crate. A process serves several episodes in sequence, so that a model is loaded once.

use std::io::{Read, Write};
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use genmanip_core::{ActionChunk, EpisodeStart, Observation, Policy, PolicyError, PolicySpec, RgbdImage};
use serde_json::{Map, Value, json};

/// Program of the process: the interface of a policy, which the Python package shares, and the loop that serves it.
const PROGRAM: [&str; 2] = [include_str!("../../../python/genmanip/_policy.py"), include_str!("policy_process.py")];
/// Maximum size of a message header and of an array (bytes). Bounds memory for invalid messages.
const MAX_BYTES: usize = 4 << 20;
/// Maximum length of a policy's error that is reported (characters).
const MAX_MISTAKE_CHARS: usize = 2000;
/// Name of the first request to a process in messages.
const MAKING: &str = "the constructor or spec()";

/// Class of the policy, and the interpreter that runs it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ProcessSettings {
    /// Class as `module:Class`; the module is resolved from the working folder.
    pub class: String,
    /// Path or name of the Python interpreter.
    pub python: String,
    /// Response timeout; the first response waits for the module import.
    pub answer: Duration,
}

/// Process pool of one class, reused between episodes.
#[derive(Debug)]
pub struct Processes {
    settings: ProcessSettings,
    idle: Mutex<Vec<Process>>,
}

impl Processes {
    /// Creates the pool without starting a process.
    pub fn new(settings: ProcessSettings) -> Arc<Self> {
        Arc::new(Self { settings, idle: Mutex::default() })
    }

    /// Settings of the pool.
    pub fn settings(&self) -> &ProcessSettings {
        &self.settings
    }

    fn idle(&self) -> MutexGuard<'_, Vec<Process>> {
        self.idle.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Policy for one episode: an instance of the class in an idle or new process. `read_spec` parses its spec.
    ///
    /// # Errors
    /// [`PolicyError::Unreachable`] if no process can be started, [`PolicyError::Mistake`] if the class cannot be
    /// instantiated or its spec is invalid.
    pub fn policy(
        self: &Arc<Self>,
        read_spec: impl FnOnce(Value) -> Result<PolicySpec, String>,
    ) -> Result<ProcessPolicy, PolicyError> {
        let idle = self.idle().pop();
        let mut process = match idle {
            Some(process) => process,
            None => Process::start(&self.settings)?,
        };
        let made = process.ask("make", Value::Null, &[]).and_then(|(head, _)| {
            let spec = head.get("spec").cloned().unwrap_or_default();
            read_spec(spec).map_err(PolicyError::Mistake)
        });
        match made {
            Ok(spec) => Ok(ProcessPolicy { process: Some(process), spec, owner: Arc::clone(self) }),
            Err(error) => {
                // The process is kept for the next episode, so that its imports are reused.
                self.idle().extend((!process.is_lost).then_some(process));
                Err(error)
            }
        }
    }
}

/// A policy in a Python process.
#[derive(Debug)]
pub struct ProcessPolicy {
    /// Process of the instance; `None` after a failed response, since the next message would belong to another request.
    process: Option<Process>,
    spec: PolicySpec,
    owner: Arc<Processes>,
}

impl ProcessPolicy {
    fn ask(&mut self, what: &str, given: Value, arrays: &[Array]) -> Result<Answer, PolicyError> {
        let ended = || PolicyError::Mistake("its Python process has ended".into());
        let process = self.process.as_mut().ok_or_else(ended)?;
        let answer = process.ask(what, given, arrays);
        if process.is_lost {
            self.process = None;
        }
        answer
    }
}

impl Drop for ProcessPolicy {
    fn drop(&mut self) {
        self.owner.idle().extend(self.process.take());
    }
}

impl Policy for ProcessPolicy {
    fn spec(&self) -> PolicySpec {
        self.spec.clone()
    }

    fn reset(&mut self, start: &EpisodeStart) -> Result<(), PolicyError> {
        let start = json!({"instruction": start.instruction, "seed": start.seed.value()});
        self.ask("reset", json!({"start": start}), &[]).map(|_| ())
    }

    fn act(&mut self, observation: &Observation) -> Result<ActionChunk, PolicyError> {
        let mut arrays = Vec::new();
        let seen = encoded_observation(observation, &mut arrays);
        let (head, answered) = self.ask("act", json!({"observation": seen}), &arrays)?;
        let wrong = |what: &str| PolicyError::Mistake(format!("{}: {what}", self.owner.settings.class));
        let [Array { dtype: F32, shape, bytes }] = &answered[..] else { return Err(wrong("act returned no array")) };
        let &[_, width] = &shape[..] else { return Err(wrong("act returned no rows of actions")) };
        let numbers = bytes.chunks_exact(4).filter_map(|word| Some(f32::from_le_bytes(word.try_into().ok()?)));
        let numbers: Vec<f32> = numbers.collect();
        let finished = head.get("finished").and_then(Value::as_bool).unwrap_or_default();
        Ok(ActionChunk { actions: numbers.chunks_exact(width.max(1)).map(<[f32]>::to_vec).collect(), finished })
    }
}

const F32: &str = "<f4";

/// Response: message header and arrays.
type Answer = (Map<String, Value>, Vec<Array>);

/// An array of a message.
#[derive(Clone, Debug, PartialEq)]
struct Array {
    /// NumPy dtype string, e.g. `<f4`.
    dtype: &'static str,
    shape: Vec<usize>,
    bytes: Vec<u8>,
}

impl Array {
    fn of_reals(numbers: &[f64], shape: &[usize]) -> Self {
        let bytes = numbers.iter().flat_map(|number| number.to_le_bytes()).collect();
        Self { dtype: "<f8", shape: shape.to_vec(), bytes }
    }

    fn of_floats<'a>(numbers: impl IntoIterator<Item = &'a f32>, shape: &[usize]) -> Self {
        let bytes = numbers.into_iter().flat_map(|number| number.to_le_bytes()).collect();
        Self { dtype: F32, shape: shape.to_vec(), bytes }
    }
}

/// Encodes an observation with the Python package's names; arrays are appended to `arrays`.
fn encoded_observation(observation: &Observation, arrays: &mut Vec<Array>) -> Value {
    let mut put = |array: Array| {
        arrays.push(array);
        json!({"array": arrays.len() - 1})
    };
    let mut seen = json!({"time_s": observation.time_s});
    for (name, key) in Observation::NAMES {
        let values = observation.state.get(key).map_or(&[][..], Vec::as_slice);
        seen[name] = put(Array::of_reals(values, &[values.len()]));
    }
    let images = observation.images.iter().map(|(name, image)| (name.clone(), encoded_image(image, &mut put)));
    seen["images"] = Value::Object(images.collect());
    if let Some(truth) = &observation.privileged {
        let rows: Vec<f64> = truth.objects.iter().flat_map(|object| object.pose.to_row()).collect();
        seen["objects"] = put(Array::of_reals(&rows, &[truth.objects.len(), 7]));
        seen["object_joints"] = truth.objects.iter().map(|object| json!(object.joint_positions)).collect();
        seen["grasped"] = json!(truth.grasped);
    }
    seen
}

fn encoded_image(image: &RgbdImage, put: &mut impl FnMut(Array) -> Value) -> Value {
    let size = [image.height() as usize, image.width() as usize];
    let with_three = [size[0], size[1], 3];
    let k = &image.intrinsics;
    let mut seen = json!({
        "K": put(Array::of_reals(&[k.fx, 0.0, k.cx, 0.0, k.fy, k.cy, 0.0, 0.0, 1.0], &[3, 3])),
        "size": [image.width(), image.height()],
        "world_from_camera": put(Array::of_reals(&image.world_from_camera.to_matrix(), &[4, 4])),
    });
    if let Some(lens) = &image.distortion {
        seen["distortion"] = put(Array::of_reals(&[lens.k1, lens.k2, lens.p1, lens.p2, lens.k3], &[5]));
    }
    if !image.rgb.is_empty() {
        seen["rgb"] = put(Array { dtype: "|u1", shape: with_three.to_vec(), bytes: image.rgb.clone() });
    }
    if !image.depth_m.is_empty() {
        seen["depth_m"] = put(Array::of_floats(&image.depth_m, &size));
    }
    if !image.ids.is_empty() {
        let bytes = image.ids.iter().flat_map(|id| id.to_le_bytes()).collect();
        seen["ids"] = put(Array { dtype: "<u2", shape: size.to_vec(), bytes });
    }
    if !image.normals.is_empty() {
        let bytes = image.normals.iter().flatten().flat_map(|part| part.to_le_bytes()).collect();
        seen["normals"] = put(Array { dtype: "|i1", shape: with_three.to_vec(), bytes });
    }
    if !image.points_m.is_empty() {
        seen["points_m"] = put(Array::of_floats(image.points_m.iter().flatten(), &with_three));
    }
    seen
}

/// A running process and the receiver of its reader thread.
#[derive(Debug)]
struct Process {
    child: Child,
    input: ChildStdin,
    messages: Receiver<std::io::Result<Answer>>,
    answer: Duration,
    /// True after a failed response: the next message would belong to another request.
    is_lost: bool,
}

impl Process {
    fn start(settings: &ProcessSettings) -> Result<Self, PolicyError> {
        let ProcessSettings { class, python, answer } = settings;
        let unreachable = |what: String| PolicyError::Unreachable(what);
        let mut command = Command::new(python);
        command.args(["-c", &PROGRAM.concat(), class]).stdin(Stdio::piped()).stdout(Stdio::piped());
        let mut child = command.spawn().map_err(|error| unreachable(format!("cannot start `{python}`: {error}")))?;
        let pipes = (child.stdin.take(), child.stdout.take());
        let (Some(input), Some(mut output)) = pipes else { return Err(unreachable("the process has no pipes".into())) };
        let (sender, messages) = channel();
        std::thread::spawn(move || {
            loop {
                let message = receive(&mut output);
                let ended = message.is_err();
                if sender.send(message).is_err() || ended {
                    return;
                }
            }
        });
        Ok(Self { child, input, messages, answer: *answer, is_lost: false })
    }

    /// Sends a request and waits for the response; an exception, a dead and a silent process are mistakes of the policy.
    fn ask(&mut self, what: &str, given: Value, arrays: &[Array]) -> Result<Answer, PolicyError> {
        let mut head = json!({"ask": what});
        if let (Value::Object(head), Value::Object(given)) = (&mut head, given) {
            head.extend(given);
        }
        let method = if what == "make" { MAKING.to_owned() } else { format!("{what}()") };
        self.is_lost = true;
        let sent = send(&mut self.input, head, arrays);
        let answer = sent.map(|()| self.messages.recv_timeout(self.answer));
        let (head, arrays) = match answer {
            Ok(Ok(Ok(answer))) => answer,
            Ok(Err(RecvTimeoutError::Timeout)) => {
                let waited = format!("{method} gave no answer within {} s", self.answer.as_secs_f64());
                let hint = "timeout_s=… waits longer; the first answer includes the import of the module";
                return Err(PolicyError::Mistake(format!("{waited}\nhint: {hint}")));
            }
            Ok(Ok(Err(_)) | Err(RecvTimeoutError::Disconnected)) | Err(_) => return Err(self.ended(&method)),
        };
        self.is_lost = false;
        match head.get("error").and_then(Value::as_str) {
            Some(mistake) => Err(PolicyError::Mistake(mistake.trim().chars().take(MAX_MISTAKE_CHARS).collect())),
            None => Ok((head, arrays)),
        }
    }

    /// Mistake of a process that ended while it was asked.
    fn ended(&mut self, method: &str) -> PolicyError {
        let _ = self.child.kill();
        let status = self.child.wait().map_or_else(|error| error.to_string(), |status| status.to_string());
        let hint = match method {
            MAKING => "its own output is above; the Python that runs a policy needs NumPy: pip install numpy",
            _ => "a policy returns or raises; a process that is killed may lack memory; its own output is above",
        };
        PolicyError::Mistake(format!("its Python process ended during {method} ({status})\nhint: {hint}"))
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn send(pipe: &mut impl Write, mut head: Value, arrays: &[Array]) -> std::io::Result<()> {
    head["arrays"] = arrays.iter().map(|array| json!({"dtype": array.dtype, "shape": array.shape})).collect();
    let head = serde_json::to_vec(&head)?;
    let length = u32::try_from(head.len()).map_err(std::io::Error::other)?;
    pipe.write_all(&length.to_le_bytes())?;
    pipe.write_all(&head)?;
    arrays.iter().try_for_each(|array| pipe.write_all(&array.bytes))?;
    pipe.flush()
}

fn receive(pipe: &mut impl Read) -> std::io::Result<Answer> {
    let wrong = |what: &str| std::io::Error::other(format!("invalid message: {what}"));
    let mut length = [0; 4];
    pipe.read_exact(&mut length)?;
    let length = u32::from_le_bytes(length) as usize;
    if length > MAX_BYTES {
        return Err(wrong("the header is too long"));
    }
    let mut head = vec![0; length];
    pipe.read_exact(&mut head)?;
    let head: Map<String, Value> = serde_json::from_slice(&head)?;
    let listed = head.get("arrays").and_then(Value::as_array).ok_or_else(|| wrong("it lists no arrays"))?;
    let mut arrays = Vec::new();
    for encoded_observation in listed {
        let axes = encoded_observation
            .get("shape")
            .and_then(Value::as_array)
            .ok_or_else(|| wrong("an array without shape"))?;
        let shape: Option<Vec<usize>> = axes.iter().map(|axis| usize::try_from(axis.as_u64()?).ok()).collect();
        let shape = shape.ok_or_else(|| wrong("an invalid shape"))?;
        let size = shape.iter().try_fold(4_usize, |size, axis| size.checked_mul(*axis));
        let size = size.filter(|size| *size <= MAX_BYTES).ok_or_else(|| wrong("an array that is too large"))?;
        let mut bytes = vec![0; size];
        pipe.read_exact(&mut bytes)?;
        arrays.push(Array { dtype: F32, shape, bytes });
    }
    Ok((head, arrays))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_come_back() {
        let arrays = [Array::of_floats(&[1.0, 2.0, 3.0], &[1, 3]), Array::of_floats(&[], &[0, 8])];
        let mut bytes = Vec::new();
        send(&mut bytes, json!({"finished": true}), &arrays).unwrap();
        let (head, received) = receive(&mut bytes.as_slice()).unwrap();
        assert_eq!((head["finished"].as_bool(), &received[..]), (Some(true), &arrays[..]));
    }

    #[test]
    fn what_is_no_message_is_refused() {
        let framed = |head: &str| [&(head.len() as u32).to_le_bytes()[..], head.as_bytes()].concat();
        let cases = [
            (vec![1, 0], "failed to fill"),
            (vec![0xff; 8], "the header is too long"),
            (framed("[]"), "expected a map"),
            (framed("{}"), "it lists no arrays"),
            (framed("{\"arrays\": [{}]}"), "an array without shape"),
            (framed("{\"arrays\": [{\"shape\": [-1]}]}"), "an invalid shape"),
            (framed("{\"arrays\": [{\"shape\": [99999999, 99999999, 99999999]}]}"), "an array that is too large"),
            (framed("{\"arrays\": [{\"shape\": [2]}]}"), "failed to fill"),
        ];
        for (bytes, expected) in cases {
            let error = receive(&mut bytes.as_slice()).unwrap_err().to_string();
            assert!(error.contains(expected), "{error}");
        }
    }

    #[test]
    fn an_interpreter_that_is_not_there_is_named() {
        let settings =
            ProcessSettings { class: "a:B".into(), python: "no-such-python".into(), answer: Duration::from_secs(1) };
        let error = Processes::new(settings).policy(|_| Err(String::new())).unwrap_err();
        assert!(matches!(&error, PolicyError::Unreachable(what) if what.contains("no-such-python")), "{error:?}");
    }
}
