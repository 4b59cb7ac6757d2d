// Teleoperation of the open scenario: what the devices report goes to the server, what it simulates comes back.

import { batch, computed, signal } from "@preact/signals";
import { posedAt } from "../logic/track.ts";
import { meaning, type Command, type TeleopStatus } from "../logic/teleop.ts";
import { leave, live, loadEpisodes } from "./playback.ts";
import { address } from "./requests.ts";
import * as store from "./store.ts";

/** Interval of messages with events, ms: the arm holds after 60 ms without one. */
const TICK_MS = 16;

export const status = signal<TeleopStatus | null>(null);
export const isActive = signal(false);
/** True while the pad has the focus and the page is visible: only then keys move the arm. */
export const hasFocus = signal(false);
/** Index of the gamepad that moves the arm; null for the keyboard. */
export const gamepad = signal<number | null>(null);
export const gamepads = signal<{ index: number; name: string }[]>([]);
/** Takes kept since the page was opened. */
export const kept = signal(0);
export const isOver = computed(() => ["kept", "discarded", "failed"].includes(status.value?.phase ?? ""));

let socket: WebSocket | null = null;
let sequence = 0;
let queue: object[] = [];
let ticker: ReturnType<typeof setInterval> | undefined;
let scene: Parameters<typeof posedAt>[0] | null = null;
let tries = 0;

/** Begins to teleoperate the open scenario. */
export function begin(): void {
  const [shown, state] = [store.scene.peek(), store.confirmed.peek()];
  if (!shown || !state || isActive.peek()) return;
  leave();
  scene = { robot: shown.robot, state: { ...shown.state, ...state } };
  batch(() => {
    store.tab.value = "runs";
    store.select(null);
    store.isReplaying.value = true;
    status.value = null;
    isActive.value = true;
  });
  tries = 0;
  connect(shown.key);
}

function connect(key: string): void {
  const url = new URL(address("/api/teleop"), location.href);
  url.protocol = url.protocol.replace("http", "ws");
  const own = new WebSocket(url);
  own.binaryType = "arraybuffer";
  socket = own;
  sequence = 0;
  queue = [];
  own.onopen = () => say({ type: "start", scenario: key, author: store.author.peek() });
  own.onmessage = (event) => {
    if (typeof event.data === "string") hear(JSON.parse(event.data) as Told);
    else show(new Float32Array(event.data as ArrayBuffer));
  };
  own.onclose = () => {
    if (socket !== own) return;
    socket = null;
    // The server pauses the take; the person resumes it.
    if (isActive.peek() && !isOver.peek() && tries++ < 20) setTimeout(() => isActive.peek() && connect(key), 250 * Math.min(tries, 8));
    else end();
  };
}

type Told = { type: "started" } | { type: "status"; status: TeleopStatus } | { type: "refused"; error: { message: string; hint: string } };

function hear(told: Told): void {
  if (told.type === "refused") {
    store.notify(told.error.message, { hint: told.error.hint, isError: true });
    if (!status.peek()) end();
  } else if (told.type === "started") {
    tries = 0;
    connectDevice();
    clearInterval(ticker);
    ticker = setInterval(tick, TICK_MS);
  } else {
    status.value = told.status;
    if (!isOver.peek()) return;
    if (told.status.phase === "kept") kept.value += 1;
    store.status.value = `The take was ${told.status.phase}.`;
    end();
    void loadEpisodes();
  }
}

function show(values: Float32Array): void {
  if (!scene || !isActive.peek()) return;
  const links = scene.robot.links.length + scene.state.objects.reduce((sum, object) => sum + object.links.length, 0);
  if (values.length === 2 + 7 * links) live.value = posedAt(scene, { frames: 1, width: values.length, values }, 0);
}

function end(): void {
  clearInterval(ticker);
  const own = socket;
  socket = null;
  own?.close();
  batch(() => {
    isActive.value = false;
    live.value = null;
    store.isReplaying.value = false;
  });
}

function say(message: object): void {
  if (socket?.readyState === WebSocket.OPEN) socket.send(JSON.stringify(message));
}

export function command(what: Command): void {
  // What was pressed before comes first.
  send();
  say({ type: what === "pause" && status.peek()?.phase === "paused" ? "resume" : what });
}

export function toggleGripper(): void {
  send();
  say({ type: "gripper" });
}

/** A key of the pad; true if it has a meaning. */
export function key(event: KeyboardEvent, down: boolean): boolean {
  const meant = meaning(event);
  if (!meant) return false;
  if ("command" in meant) {
    if (down && !event.repeat) command(meant.command);
  } else if (gamepad.peek() === null && !event.repeat) {
    queue.push({ type: "key", code: meant.arm, down });
  }
  return true;
}

/** The pad got or lost the focus, or the page became visible or hidden: lost keys count as released at once. */
export function focus(has: boolean): void {
  if (!has && hasFocus.peek()) {
    queue.push({ type: "blurred" });
    if (isActive.peek()) send();
  }
  hasFocus.value = has;
}

export function choose(index: number | null): void {
  gamepad.value = index;
  connectDevice();
}

function connectDevice(): void {
  const pad = gamepads.peek().find((one) => one.index === gamepad.peek());
  const device = pad ? { kind: "gamepad", name: pad.name.slice(0, 100) } : { kind: "keyboard" };
  queue = [{ type: "connected", device }];
}

/** Gamepads with the standard mapping that are connected now. */
export function findGamepads(): void {
  const found = (navigator.getGamepads?.() ?? []).filter((one) => one?.mapping === "standard").map((one) => ({ index: one!.index, name: one!.id }));
  gamepads.value = found;
  if (gamepad.peek() !== null && !found.some((one) => one.index === gamepad.peek())) choose(null);
}

function tick(): void {
  if (document.hidden || !document.hasFocus()) return;
  const index = gamepad.peek();
  if (index !== null) {
    const pad = navigator.getGamepads()[index];
    if (pad) queue.push({ type: "gamepad", axes: pad.axes.slice(0, 4), buttons: pad.buttons.slice(0, 17).map((button) => button.value) });
  } else if (hasFocus.peek()) {
    queue.push({ type: "alive" });
  }
  if (queue.length > 0) send();
}

function send(): void {
  if (socket?.readyState !== WebSocket.OPEN || queue.length === 0) return;
  say({ type: "events", sequence: sequence++, sent_ms: performance.now(), events: queue.splice(0, 200) });
}
