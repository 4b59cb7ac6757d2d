// Keys of teleoperation and words for its status, without a browser.

import type { Pose } from "../contract.ts";

/** Keys of the arm by `code`, as the server maps them. */
export const ARM_KEYS: readonly { codes: readonly string[]; keys: string; words: string }[] = [
  { codes: ["KeyW", "KeyS"], keys: "W S", words: "forward, back" },
  { codes: ["KeyA", "KeyD"], keys: "A D", words: "left, right" },
  { codes: ["KeyR", "KeyF"], keys: "R F", words: "up, down" },
  { codes: ["ArrowLeft", "ArrowRight"], keys: "← →", words: "roll" },
  { codes: ["ArrowUp", "ArrowDown"], keys: "↑ ↓", words: "pitch" },
  { codes: ["KeyQ", "KeyE"], keys: "Q E", words: "yaw" },
  { codes: ["Space"], keys: "Space", words: "close or open the gripper" },
  { codes: ["ShiftLeft", "ShiftRight"], keys: "Shift", words: "slow, while held" },
  { codes: ["KeyC"], keys: "C", words: "clutch, while held" },
  { codes: ["KeyV"], keys: "V", words: "frame: world, hand" },
  { codes: ["Enter"], keys: "Enter", words: "end the take" },
];

export type Command = "pause" | "back" | "turn" | "retry" | "keep" | "trim" | "discard";

/** Keys of the take. */
export const TAKE_KEYS: readonly { code: string; key: string; command: Command; words: string }[] = [
  { code: "KeyP", key: "P", command: "pause", words: "pause or go on" },
  { code: "KeyB", key: "B", command: "back", words: "back 5 s" },
  { code: "KeyT", key: "T", command: "turn", words: "take over from the policy or hand over to it" },
  { code: "KeyN", key: "N", command: "retry", words: "begin anew" },
  { code: "KeyK", key: "K", command: "keep", words: "keep" },
  { code: "KeyL", key: "L", command: "trim", words: "keep without idle ends" },
  { code: "KeyX", key: "X", command: "discard", words: "discard" },
];

const ARM_CODES = new Set(ARM_KEYS.flatMap((one) => one.codes));

interface KeyLike {
  code: string;
  ctrlKey: boolean;
  metaKey: boolean;
  altKey: boolean;
}

/** Meaning of a key press on the pad; null if it belongs to the page or to the browser. */
export function meaning(event: KeyLike): { arm: string } | { command: Command } | null {
  if (event.ctrlKey || event.metaKey || event.altKey) return null;
  if (ARM_CODES.has(event.code)) return { arm: event.code };
  const take = TAKE_KEYS.find((one) => one.code === event.code);
  return take ? { command: take.command } : null;
}

export interface TeleopStatus {
  phase: "waiting" | "running" | "paused" | "judged" | "kept" | "discarded" | "failed";
  take: number;
  time_s: number;
  steps: number;
  late_steps: number;
  held: "silence" | "clutch" | "release_first" | "other_joints" | null;
  limits: ("speed" | "workspace" | "lead" | "joint" | "singularity" | "reach" | "ramp")[];
  frame: string;
  closed: boolean;
  contact_n: number;
  grasped: string | null;
  conditions: [number, number];
  next: { text: string; distance: number; unit: string | null } | null;
  success: boolean | null;
  world_from_tcp: Pose;
  policy: string | null;
  undone: [number, number];
  note: string | null;
}

const HELD = { silence: "The arm holds: no input", clutch: "The arm holds: clutch", release_first: "The arm holds: release all keys first", other_joints: "The arm holds: other joints" };
const LIMITS = {
  speed: "at the speed limit",
  workspace: "at the border of the workspace",
  lead: "slowed: the arm is blocked or lags behind",
  joint: "a joint is at its limit",
  singularity: "near a singularity",
  reach: "out of reach",
  ramp: "catches up",
};
const PHASES = {
  waiting: "Waits for another episode to end",
  running: "",
  paused: "Paused",
  judged: "keep it, begin anew or discard it",
  kept: "Kept",
  discarded: "Discarded",
  failed: "Failed",
};

/** Motion of the arm and its reason, for the status line. */
export function statusWords(status: TeleopStatus, hasFocus: boolean): string {
  if (status.phase === "judged" && status.success !== null) return `${status.success ? "Success" : "Goal missed"}: ${PHASES.judged}`;
  if (status.phase === "paused" && status.note) return `Paused: ${status.note}`;
  if (status.phase !== "running") return PHASES[status.phase];
  if (status.policy === "go_to") return "The arm goes to the target: any key of the arm stops it";
  if (status.policy) return `${status.policy} is in command`;
  if (status.held) return HELD[status.held];
  if (!hasFocus) return "The arm holds: the keys need the focus, press Tab or click them";
  return ["The arm follows", ...status.limits.map((limit) => LIMITS[limit])].join("; ");
}

/** Message of a command; `policy` is the one to hand over to. */
export function message(command: Command, status: TeleopStatus | null, policy: string): object {
  if (command === "turn") return status?.policy ? { type: "take_over" } : { type: "hand_over", policy };
  if (command === "trim") return { type: "keep", trim: true };
  return { type: command === "pause" && status?.phase === "paused" ? "resume" : command };
}

/** The undone seconds, as an addition to a sentence. */
export const undoneWords = ([times, seconds]: [number, number]): string => (times > 0 ? `; went back ${times}×, ${seconds.toFixed(1)} s cut` : "");

/** Number of kept takes by skill; empty without any. */
export const keptWords = (kept: Record<string, number>): string =>
  Object.entries(kept)
    .map(([skill, count]) => `${count} kept (${skill})`)
    .join(", ");

/** Distance of a condition in centimetres or degrees; null for a quantity without unit. */
export function distanceWords({ distance, unit }: { distance: number; unit: string | null }): string | null {
  if (unit === "m") return `${(distance * 100).toFixed(1)} cm`;
  if (unit === "rad") return `${((distance * 180) / Math.PI).toFixed(0)}°`;
  return null;
}
