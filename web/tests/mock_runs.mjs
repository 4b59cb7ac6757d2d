// Runs and episodes of the mock server: an episode lifts the first object; `random` loses it, others succeed.

export const POLICIES = [
  { policy: "expert", about: "plans with what the simulator knows; its results say oracle" },
  { policy: "agent", about: "asks a vision-language model" },
  { policy: "random", about: "moves joints at random" },
];
const RATE_HZ = 30;
const DURATION_S = 3;

/** Answers an address below that of a scenario; `rest` begins with `run` or `episodes`. */
export function answerRuns(studio, document, rest, method, query, body, send) {
  document.episodes ??= [];
  const tell = () => studio.tell(document.key, { type: "run", run: document.run });
  const [what, name, part] = rest;
  if (what === "run" && name === "cancel") {
    clearInterval(document.timer);
    document.run = { ...document.run, state: "cancelled" };
    send(200, { run: document.run });
    return tell();
  }
  if (what === "run" && method === "POST") {
    if (!POLICIES.some((one) => one.policy === body.policy)) return send(422, { error: { message: "no such policy", hint: "" } });
    document.run = { number: (document.run?.number ?? 0) + 1, policy: body.policy, revision: document.revision, state: "running", time_s: 0 };
    document.timer = setInterval(() => {
      document.run = { ...document.run, time_s: document.run.time_s + 0.5 };
      if (document.run.time_s >= DURATION_S) {
        clearInterval(document.timer);
        const episode = keep(document, body.policy);
        document.run = { ...document.run, state: "done", episode: episode.row };
      }
      tell();
    }, studio.runStep ?? 60);
    return send(200, { run: document.run });
  }
  if (what === "run") return send(200, { run: document.run ?? null });
  if (name === undefined) return send(200, document.episodes.map((one) => one.row).reverse());
  const episode = document.episodes.find((one) => one.row.episode === name);
  if (!episode) return send(404, { error: { message: "no such episode" } });
  if (part === "states") return send(200, episode.states, { "x-frames": String(episode.frames), "x-width": String(episode.width) });
  if (part === "images") {
    document.statesDrawn = [...(document.statesDrawn ?? []), query.get("state")];
    return send(200, document.image(), { "content-type": "image/svg+xml" });
  }
  if (part === "transcript") return send(200, Buffer.from("<!doctype html><title>Transcript</title><p>asked</p>"), { "content-type": "text/html" });
  const { row, result, timeline, scene } = episode;
  return send(200, { episode: row, result, timeline, scene });
}

function keep(document, policy) {
  const scene = structuredClone(document.scene());
  const [object] = scene.state.objects;
  const isLost = policy === "random";
  const failure = { cause: "slipped", evidence: `${object.name} slipped at 2.0 s` };
  const row = {
    episode: `e${document.episodes.length}`,
    policy,
    source: "studio",
    revision: document.revision,
    recorded: true,
    oracle: policy === "expert",
    success: !isLost,
    ending: "finished",
    ...(isLost ? { failure } : {}),
    duration_s: DURATION_S,
    has_transcript: policy === "agent",
  };
  const held = { kind: "held", from_s: 0.8, to_s: isLost ? 2 : 2.4, object: object.id };
  const moments = [{ kind: "contact", from_s: 0.5, to_s: 0.7, peak_n: 12, text: "robot/hand on table" }, held, ...(isLost ? [{ kind: "slip", from_s: 2, to_s: 2, object: object.id, text: "held for 1.2 s" }] : [])];
  const timeline = { moments, acted_until_s: 2.5, ...(isLost ? { failed_at_s: 2 } : {}) };
  const frames = DURATION_S * RATE_HZ + 1;
  const links = [...scene.robot.links, ...scene.state.objects.flatMap((one) => one.links)];
  const width = 2 + 7 * links.length;
  const values = new Float32Array(frames * width);
  for (let frame = 0; frame < frames; frame++) {
    const time_s = frame / RATE_HZ;
    const lift = 0.1 * Math.max(0, Math.min(1, time_s - 1));
    const poses = links.flatMap((link) => {
      const [x, y, z] = link.world_from_link.position_m;
      const rises = object.links.includes(link) || link.name === "hand";
      return [x, y, z + (rises ? lift : 0), ...link.world_from_link.orientation_wxyz];
    });
    values.set([time_s, 0.05, ...poses], frame * width);
  }
  const episode = { row, result: { failures: isLost ? [failure] : [] }, timeline, scene, frames, width, states: Buffer.from(values.buffer) };
  document.episodes.push(episode);
  return episode;
}
