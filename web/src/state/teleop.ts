// Teleoperation of the open scenario: what the devices report goes to the server, what it simulates comes back.

import { batch, computed, signal } from "@preact/signals";
import { descriptor, hexadecimal, MULTI_AXIS_CONTROLLER, report, type ReportCollection } from "../logic/hid.ts";
import { posedAt } from "../logic/track.ts";
import { meaning, message, type Command, type TeleopStatus } from "../logic/teleop.ts";
import { leave, live, loadEpisodes, policy } from "./playback.ts";
import { address } from "./requests.ts";
import * as store from "./store.ts";

/** Interval of messages with events, ms: the arm holds after 60 ms without one. */
const TICK_MS = 16;

export const status = signal<TeleopStatus | null>(null);
export const isActive = signal(false);
/** True while the pad has the focus and the page is visible: only then keys move the arm. */
export const hasFocus = signal(false);
/** Device that moves the arm: a gamepad by its index, or a SpaceMouse. */
export const device = signal<"keyboard" | "space_mouse" | number>("keyboard");
export const gamepads = signal<{ index: number; name: string }[]>([]);
export const spaceMouse = signal<HidDevice | null>(null);
/** Takes kept since the page was opened, by skill. */
export const kept = signal<Record<string, number>>({});
let skill = "";
export const isOver = computed(() => ["kept", "discarded", "failed"].includes(status.value?.phase ?? ""));

/** Parts of WebHID's `HIDDevice` and `HID`; only some browsers have them. */
interface HidDevice extends EventTarget {
  readonly productName: string;
  readonly opened: boolean;
  readonly collections: readonly ReportCollection[];
  open(): Promise<void>;
}
interface Hid extends EventTarget {
  requestDevice(options: { filters: object[] }): Promise<HidDevice[]>;
}
const hid = (navigator as { hid?: Hid }).hid;
export const hasHid = hid !== undefined;

let socket: WebSocket | null = null;
let sequence = 0;
let queue: object[] = [];
/** Codes of the arm's keys that were pressed on the pad and are still down. */
const pressed = new Set<string>();
let ticker: ReturnType<typeof setInterval> | undefined;
let scene: Parameters<typeof posedAt>[0] | null = null;
let tries = 0;

let first: string | undefined;

/** Begins to teleoperate the open scenario; `by` is the policy in command at first, if not the person. */
export function begin(by?: string): void {
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
  first = by;
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
  own.onopen = () => say({ type: "start", scenario: key, author: store.author.peek(), policy: first });
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

type Told = { type: "started"; skill: string } | { type: "status"; status: TeleopStatus } | { type: "refused"; error: { message: string; hint: string } };

function hear(told: Told): void {
  if (told.type === "refused") {
    store.notify(told.error.message, { hint: told.error.hint, isError: true });
    if (!status.peek()) end();
  } else if (told.type === "started") {
    tries = 0;
    skill = told.skill;
    connectDevice();
    clearInterval(ticker);
    ticker = setInterval(tick, TICK_MS);
  } else {
    status.value = told.status;
    if (!isOver.peek()) return;
    if (told.status.phase === "kept") kept.value = { ...kept.value, [skill]: (kept.value[skill] ?? 0) + 1 };
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
    store.target.value = null;
    store.isReplaying.value = false;
  });
}

function say(message: object): void {
  if (socket?.readyState === WebSocket.OPEN) socket.send(JSON.stringify(message));
}

export function command(what: Command): void {
  // Keys pressed before come first.
  send();
  say(message(what, status.peek(), policy.peek()));
}

/** Shows the target at the gripper, or removes it. */
export function toggleTarget(): void {
  store.target.value = store.target.peek() ? null : (status.peek()?.world_from_tcp ?? null);
}

/** Sends the arm to the target; a touch of the device stops it. */
export function goThere(): void {
  send();
  say({ type: "go_to", pose: store.target.peek() });
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
  } else if (device.peek() === "keyboard" && !event.repeat) {
    // A key that was down before the pad had the focus, such as that of the shortcut which opened it, moves nothing.
    const counts = down || pressed.has(meant.arm);
    if (down) pressed.add(meant.arm);
    else pressed.delete(meant.arm);
    if (counts) queue.push({ type: "key", code: meant.arm, down });
  }
  return true;
}

/** The pad got or lost the focus, or the page became visible or hidden: lost keys count as released at once. */
export function focus(has: boolean): void {
  if (!has && hasFocus.peek()) {
    pressed.clear();
    queue.push({ type: "blurred" });
    if (isActive.peek()) send();
  }
  hasFocus.value = has;
}

export function choose(chosen: "keyboard" | "space_mouse" | number): void {
  device.value = chosen;
  connectDevice();
}

function connectDevice(): void {
  const [chosen, mouse] = [device.peek(), spaceMouse.peek()];
  const pad = gamepads.peek().find((one) => one.index === chosen);
  const name = (text: string) => text.slice(0, 100);
  const connected = pad
    ? { kind: "gamepad", name: name(pad.name) }
    : chosen === "space_mouse" && mouse
      ? { kind: "space_mouse", name: name(mouse.productName), descriptor: hexadecimal(descriptor(mouse.collections)) }
      : { kind: "keyboard" };
  queue = [{ type: "connected", device: connected }];
  pressed.clear();
}

/** Asks the browser for a SpaceMouse and moves the arm with it; needs a click or a key, and shows the browser's dialogue. */
export async function chooseSpaceMouse(): Promise<void> {
  try {
    const found = (await hid?.requestDevice({ filters: [MULTI_AXIS_CONTROLLER] }))?.find((one) =>
      one.collections.some(({ usage, usagePage }) => usage === MULTI_AXIS_CONTROLLER.usage && usagePage === MULTI_AXIS_CONTROLLER.usagePage),
    );
    if (!found) return;
    if (!found.opened) await found.open();
    if (found !== spaceMouse.peek()) {
      spaceMouse.peek()?.removeEventListener("inputreport", heardReport);
      found.addEventListener("inputreport", heardReport);
      spaceMouse.value = found;
    }
    choose("space_mouse");
  } catch (error) {
    const hint = "close other programs that use it; on Linux your user needs read access to its /dev/hidraw file";
    store.notify(`The SpaceMouse cannot be opened: ${(error as Error).message}`, { hint, isError: true });
  }
}

function heardReport(event: Event): void {
  const { reportId, data } = event as Event & { reportId: number; data: DataView };
  // Reports in the background are dropped: the arm holds, and nothing is made up for later.
  if (!isActive.peek() || device.peek() !== "space_mouse" || document.hidden || !document.hasFocus()) return;
  queue.push({ type: "report", bytes: hexadecimal(report(reportId, data)) });
}

hid?.addEventListener("disconnect", (event) => {
  if ((event as Event & { device: HidDevice }).device !== spaceMouse.peek()) return;
  spaceMouse.value = null;
  if (device.peek() !== "space_mouse") return;
  queue.push({ type: "disconnected" });
  send();
  choose("keyboard");
});

/** Gamepads with the standard mapping that are connected now. */
export function findGamepads(): void {
  const found = (navigator.getGamepads?.() ?? []).filter((one) => one?.mapping === "standard").map((one) => ({ index: one!.index, name: one!.id }));
  gamepads.value = found;
  if (typeof device.peek() === "number" && !found.some((one) => one.index === device.peek())) choose("keyboard");
}

function tick(): void {
  if (document.hidden || !document.hasFocus()) return;
  const chosen = device.peek();
  if (typeof chosen === "number") {
    const pad = navigator.getGamepads()[chosen];
    if (pad) queue.push({ type: "gamepad", axes: pad.axes.slice(0, 4), buttons: pad.buttons.slice(0, 17).map((button) => button.value) });
  } else if (chosen === "keyboard" && hasFocus.peek()) {
    queue.push({ type: "alive" });
  }
  if (queue.length > 0) send();
}

function send(): void {
  if (socket?.readyState !== WebSocket.OPEN || queue.length === 0) return;
  say({ type: "events", sequence: sequence++, sent_ms: performance.now(), events: queue.splice(0, 200) });
}
