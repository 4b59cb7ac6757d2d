// Edits as people make them; every one becomes an operation in the outbox.

import { batch } from "@preact/signals";
import type { Camera, CatalogueEntry, Operation, Placement, Pose, Problem, Repair, SceneObject } from "../contract.ts";
import { withdrawn, type Entry } from "../logic/outbox.ts";
import { cameraMoved, carriedBy, objectsOf } from "../logic/operations.ts";
import { compose, inverse, moved, type Vector } from "../logic/pose.ts";
import { freeSpot } from "../logic/snap.ts";
import { drain } from "./connection.ts";
import * as requests from "./requests.ts";
import {
  author,
  confirmed,
  current,
  entries,
  isEditable,
  isOnline,
  isReplaying,
  locked,
  notify,
  openKey,
  problemKey,
  problems,
  scene,
  selectedProblem,
  status,
  stopped,
  verdict,
} from "./store.ts";

/** Commands taken back before they were sent; redo sends them. */
let taken: Entry[] = [];

function entry(what: Entry["what"], operation?: Operation): Entry | null {
  const key = openKey.value;
  const state = confirmed.value;
  if (!key || !state) return null;
  if (isReplaying.value) {
    status.value = "Leave the episode to edit the scenario.";
    return null;
  }
  if (stopped.value) {
    notify("Editing is stopped.", { hint: stopped.value, isError: true });
    return null;
  }
  const own = { key, what, base: state.revision, author: author.value, at: new Date().toISOString(), sent: false };
  return { id: crypto.randomUUID(), ...own, ...(operation ? { operation } : {}) };
}

/** Queues one operation: one step of undo; false when nothing may be edited, or it would change a locked object. */
export function apply(operation: Operation): boolean {
  const held = objectsOf(operation).find((id) => locked.value.has(id));
  if (held !== undefined) {
    status.value = `${current.value?.objects.find((object) => object.id === held)?.name ?? held} is locked.`;
    return false;
  }
  const own = entry("command", operation);
  if (!own) return false;
  taken = [];
  entries.value = [...entries.value, own];
  void drain();
  return true;
}

export function undo(): void {
  const back = openKey.value ? withdrawn(entries.value, openKey.value) : null;
  if (back) {
    taken.push(back.entry);
    entries.value = back.rest;
    return;
  }
  step("undo");
}

export function redo(): void {
  const again = taken.pop();
  if (again && again.key === openKey.value) {
    entries.value = [...entries.value, again];
    void drain();
    return;
  }
  step("redo");
}

/** Takes back one command of the history, whoever made it, and keeps those after it. */
export function revert(revision: number): void {
  const own = entry("revert");
  if (!own) return;
  entries.value = [...entries.value, { ...own, revision }];
  void drain();
}

function step(what: "undo" | "redo"): void {
  const state = confirmed.value;
  if (!state) return;
  if (entries.value.length === 0 && !(what === "undo" ? state.can_undo : state.can_redo)) {
    status.value = `Nothing to ${what}.`;
    return;
  }
  const own = entry(what);
  if (!own) return;
  entries.value = [...entries.value, own];
  void drain();
}

/** Placements of an object and of what stands on it, for a new pose of the object. */
export function placements(object: SceneObject, pose: Pose): Placement[] {
  const state = current.value;
  const change = compose(pose, inverse(object.pose));
  const carried = state ? carriedBy(object.id, state.edges) : [];
  const others = state?.objects.filter((other) => carried.includes(other.id) && !locked.value.has(other.id) && rests(other, object)) ?? [];
  return [
    { id: object.id, pose },
    ...others.map((other) => ({ id: other.id, pose: compose(change, other.pose) })),
  ];
}

/** The graph says that it stands there; the boxes say whether it still does. */
function rests(other: SceneObject, below: SceneObject): boolean {
  const [low, high] = below.bounds_m;
  const [otherLow, otherHigh] = other.bounds_m;
  return [0, 1].every((axis) => otherLow[axis]! < high[axis]! && otherHigh[axis]! > low[axis]!) && otherLow[2] < high[2] + 0.03;
}

export function place(object: SceneObject, pose: Pose): void {
  apply({ op: "place", args: { objects: placements(object, pose) } });
}

/** Moves along a world axis, metres. */
export function nudge(object: SceneObject, by: Vector): void {
  place(object, moved(object.pose, by));
}

/** Gives a camera another pose in the world. */
export function placeCamera(camera: Camera, world_from_camera: Pose): void {
  const operation = cameraMoved(camera, world_from_camera);
  if (operation) apply(operation);
}

export function chooseState(object: SceneObject, state: string): void {
  apply({ op: "state", args: { object: object.id, state } });
}

export function setJoints(object: SceneObject, joint_positions: number[]): void {
  // The name in the graph stays: whether it still fits is the verdict's to say.
  apply({ op: "place", args: { objects: [{ id: object.id, pose: object.pose, joint_positions }] } });
}

export function remove(object: SceneObject): void {
  apply({ op: "remove", args: { object: object.id } });
}

const UPRIGHT: Pose["orientation_wxyz"] = [1, 0, 0, 0];

function spotNear(wanted: [number, number], size: [number, number]): [number, number] {
  const state = current.value;
  const shown = scene.value;
  if (!state || !shown) return wanted;
  return freeSpot(wanted, size, state.objects.map((object) => object.bounds_m), shown.workspace);
}

export function duplicate(object: SceneObject): void {
  const [low, high] = object.bounds_m;
  const middle: [number, number] = [(low[0] + high[0]) / 2, (low[1] + high[1]) / 2];
  const [x, y] = spotNear(middle, [high[0] - low[0], high[1] - low[1]]);
  const table = scene.value?.surfaces[0]?.center_m[2] ?? 0;
  const pose = moved(object.pose, [x - middle[0], y - middle[1], Math.min(0, table - low[2])]);
  apply({ op: "duplicate", args: { object: object.id, pose } });
}

/** Adds a catalogue object on the nearest free spot to the middle of the table. */
export function addObject(found: CatalogueEntry): void {
  const shown = scene.value;
  if (!shown) return;
  const { x, y } = shown.workspace;
  const middle: [number, number] = [(x[0] + x[1]) / 2, (y[0] + y[1]) / 2];
  const [atX, atY] = spotNear(middle, [found.size_m[0], found.size_m[1]]);
  const table = shown.surfaces[0]?.center_m[2] ?? 0;
  apply({ op: "add", args: { asset: found.uid, pose: { position_m: [atX, atY, table], orientation_wxyz: UPRIGHT } } });
}

export function swapObject(object: SceneObject, found: CatalogueEntry): void {
  apply({ op: "swap", args: { object: object.id, uid: found.uid } });
}

/** Lets the object fall in the simulator and stores where it comes to rest. */
export async function drop(object: SceneObject): Promise<void> {
  const key = openKey.value;
  if (!key || !isEditable.value) return;
  if (!isOnline.value || entries.value.length > 0) {
    notify("Dropping needs the server, and nothing that waits.");
    return;
  }
  status.value = `Dropping ${object.name}…`;
  try {
    const { op, args } = await requests.settle(key, [object.id]);
    status.value = "";
    apply({ op, args } as Operation);
  } catch (error) {
    status.value = "";
    notify("The drop failed.", { hint: (error as Error).message, isError: true });
  }
}

/** Repairs that the verdict named or that the server finds when asked. */
export async function repairsOf(problem: Problem): Promise<Repair[]> {
  if (problem.repairs && problem.repairs.length > 0) return problem.repairs;
  const key = openKey.value;
  if (!key || !isOnline.value) return [];
  return requests.repairs(key, verdict.value.revision, problem);
}

export function applyRepair(repair: Repair): boolean {
  return apply({ op: repair.op, args: repair.args } as Operation);
}

/** Most repairs of one press of *repair all I can*. */
const MOST_REPAIRS = 20;

/** Applies the first repair of each problem, waiting for the verdict after each; stops where none helps. */
export async function repairAll(): Promise<void> {
  const tried = new Set<string>();
  let applied = 0;
  while (applied < MOST_REPAIRS) {
    if (!(await settledVerdict())) break;
    const open = problems.value.find((problem) => !tried.has(problemKey(problem)));
    if (!open) break;
    tried.add(problemKey(open));
    status.value = `Repairing: ${open.message}`;
    const [repair] = await repairsOf(open).catch(() => []);
    if (!repair) continue;
    if (applyRepair(repair)) applied += 1;
  }
  const left = problems.value.length;
  batch(() => {
    selectedProblem.value = null;
    status.value = `${applied} ${applied === 1 ? "repair" : "repairs"} applied; ${left === 0 ? "no problem is" : `${left} ${left === 1 ? "problem is" : "problems are"}`} left.`;
  });
}

/** Waits until nothing is unsent and the verdict of the newest revision is whole; false after 20 s. */
async function settledVerdict(): Promise<boolean> {
  for (let waited = 0; waited < 400; waited++) {
    const isWhole = verdict.value.done && verdict.value.revision === confirmed.value?.revision;
    if (entries.value.length === 0 && isWhole) return true;
    if (!isOnline.value || stopped.value || entries.value.some((one) => one.conflict)) return false;
    await new Promise((resolve) => setTimeout(resolve, 50));
  }
  return false;
}
