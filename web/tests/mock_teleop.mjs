// Teleoperation of the mock server: R lifts the hand and F lowers it, 30 states a second, without physics.

const RATE_HZ = 30;
const SPEED_M_S = 0.2;

/** Serves a page's socket of teleoperation; `studio.driven` lists its messages, for tests. */
export function teleoperate(studio, socket) {
  studio.driven = [];
  const session = { keys: new Set(), lift_m: 0, phase: "running", closed: false, heard: 0, held: null, steps: 0, take: 1, policy: null, undone: [0, 0] };
  let document;
  let timer;
  const tell = () => {
    const { phase, closed, held, steps, take, policy, undone } = session;
    const next = { text: "left: gap 0.042 m, at most 0.020 m", distance: 0.022, unit: "m" };
    const status = { phase, take, time_s: steps / RATE_HZ, steps, late_steps: 1, held, limits: [], frame: "world", closed, contact_n: 0, grasped: null, conditions: [0, 1], next, success: null, world_from_tcp: { position_m: [0.4, 0, 0.3], orientation_wxyz: [0, 1, 0, 0] }, policy, undone, note: null };
    socket.send(JSON.stringify({ type: "status", status }));
  };
  const step = () => {
    if (session.phase !== "running") return;
    session.steps += 1;
    const up = Number(session.keys.has("KeyR")) - Number(session.keys.has("KeyF"));
    session.held = up !== 0 && performance.now() - session.heard > 1000 ? "silence" : null;
    if (!session.held) session.lift_m += (up * SPEED_M_S) / RATE_HZ;
    const scene = document.scene();
    const poses = (links, lift_m) =>
      links.flatMap((link) => {
        const [x, y, z] = link.world_from_link.position_m;
        return [x, y, z + lift_m, ...link.world_from_link.orientation_wxyz];
      });
    const values = [session.steps / RATE_HZ, 0.05, ...poses(scene.robot.links, session.lift_m), ...scene.state.objects.flatMap((one) => poses(one.links, 0))];
    socket.send(Buffer.from(new Float32Array(values).buffer));
    tell();
  };
  const end = (phase) => {
    session.phase = phase;
    clearInterval(timer);
    tell();
  };
  socket.on("close", () => clearInterval(timer));
  socket.on("message", (text) => {
    const message = JSON.parse(text);
    if (message.type !== "events") studio.driven.push(message.type);
    if (message.type === "start") {
      document = studio.documents.get(message.scenario);
      socket.send(JSON.stringify({ type: "started", scenario: message.scenario, skill: "left", again: false }));
      timer = setInterval(step, 1000 / RATE_HZ);
    } else if (message.type === "events") {
      session.heard = performance.now();
      for (const event of message.events) {
        if (event.type !== "alive") studio.driven.push(event.type === "key" ? `${event.code} ${event.down ? "down" : "up"}` : event.type);
        if (event.type === "key" && event.code === "Space" && event.down) session.closed = !session.closed;
        if (event.type === "key" && event.down && session.policy === "go_to") session.policy = null;
        if (event.type === "key") session.keys[event.down ? "add" : "delete"](event.code);
        if (event.type === "blurred" || event.type === "connected") session.keys.clear();
        if (event.type === "connected") studio.device = event.device;
        if (event.type === "report") studio.report = event.bytes;
      }
    } else if (message.type === "pause" || message.type === "resume") {
      session.phase = message.type === "pause" ? "paused" : "running";
      tell();
    } else if (message.type === "back") {
      session.undone = [session.undone[0] + 1, session.undone[1] + Math.min(session.steps / RATE_HZ, 5)];
      Object.assign(session, { lift_m: 0, steps: Math.max(session.steps - 5 * RATE_HZ, 0), phase: "paused" });
      tell();
    } else if (message.type === "hand_over" || message.type === "take_over") {
      session.policy = message.policy ?? null;
      tell();
    } else if (message.type === "go_to") {
      Object.assign(session, { policy: "go_to" });
      studio.goal = message.pose;
      tell();
    } else if (message.type === "retry") {
      Object.assign(session, { lift_m: 0, steps: 0, take: session.take + 1, phase: "running", closed: false });
    } else if (message.type === "gripper") {
      session.closed = !session.closed;
    } else {
      end(message.type === "keep" ? "kept" : "discarded");
    }
  });
}
