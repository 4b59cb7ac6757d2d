// Key presses become actions, unless they belong to a text field.

import type { View } from "../scene/view.ts";
import { actionOf, isTyping } from "../logic/keys.ts";
import { moved, turned, type Vector } from "../logic/pose.ts";
import { open } from "./connection.ts";
import * as edits from "./edits.ts";
import * as playback from "./playback.ts";
import * as questions from "./questions.ts";
import * as reviews from "./reviews.ts";
import * as store from "./store.ts";
import * as teleop from "./teleop.ts";
import { toggleTheme } from "./theme.ts";

/** The 3-D view, once it is loaded. */
let view: View | null = null;

export function setView(loaded: View | null): void {
  view = loaded;
}

/** Pose of a camera that sees what the 3-D view shows; null while there is no view. */
export const eyePose = () => view?.eyePose() ?? null;

export function listenToKeys(): void {
  window.addEventListener("keydown", (event) => {
    const target = event.target as HTMLElement | null;
    if (isTyping(target as never, event.key) || document.querySelector("dialog[open]")) return;
    const found = actionOf(event);
    if (!found) return;
    const isDone = found.action === "review.mark" ? reviews.mark(Number(event.key)) : run(found.action, found.fine);
    if (isDone) event.preventDefault();
  });
}

const STEP_M = 0.01;
const FINE_M = 0.001;
const STEP_RAD = Math.PI / 12;
const FINE_RAD = Math.PI / 180;

/** Carries out an action; false when it does not apply now. */
export function run(action: string, fine = false): boolean {
  const object = store.selected.peek();
  const state = store.current.peek();
  const canEdit = store.isEditable.peek();
  const moveBy = fine ? FINE_M : STEP_M;
  const turnBy = fine ? FINE_RAD : STEP_RAD;
  const camera = !object && store.tab.peek() === "cameras" && !store.lookThrough.peek() ? store.camera.peek() : null;
  const move = (axis: Vector, sign: number) => {
    if (camera && canEdit) {
      edits.placeCamera(camera, moved(camera.world_from_camera, axis.map((value) => value * sign * moveBy) as Vector));
      return true;
    }
    if (!object || !canEdit) return false;
    edits.nudge(object, axis.map((value) => value * sign * moveBy) as Vector);
    return true;
  };
  const along = (direction: "right" | "far", sign: number) =>
    move(view?.axisOf(direction) ?? (direction === "right" ? [0, -1, 0] : [1, 0, 0]), sign);
  const turn = (sign: number) => {
    if (camera && canEdit) {
      edits.placeCamera(camera, turned(camera.world_from_camera, sign * turnBy));
      return true;
    }
    if (!object || !canEdit) return false;
    edits.place(object, turned(object.pose, sign * turnBy));
    return true;
  };
  const show = (name: store.DialogName, isPossible: boolean) => {
    if (isPossible) store.dialog.value = name;
    return isPossible;
  };
  if (store.isReplaying.peek() && (action === "move.left" || action === "move.right")) {
    playback.step(action === "move.right" ? 1 : -1, fine);
    return true;
  }
  switch (action) {
    case "help":
      return show("help", true);
    case "filter":
      document.getElementById("filter")?.focus();
      return true;
    case "scenario.next":
      return step(1);
    case "scenario.previous":
      return step(-1);
    case "instruction":
      return show("instruction", canEdit);
    case "goal":
      return show("goal", canEdit);
    case "edges":
      return show("edges", canEdit);
    case "snapshot":
      return show("snapshot", canEdit);
    case "add":
      return show("add", canEdit);
    case "new":
      return show("new", true);
    case "difference":
      store.difference.value = store.difference.peek() === null ? 0 : null;
      if (store.difference.peek() !== null) store.tab.value = "history";
      return true;
    case "lock":
    case "hide": {
      if (!object) return false;
      const isIn = store.toggle(action === "lock" ? store.locked : store.hidden, object.id);
      store.status.value = `${object.name} is ${isIn ? "" : "no longer "}${action === "lock" ? "locked" : "hidden"}.`;
      return true;
    }
    case "swap":
      return show("swap", canEdit && object !== null);
    case "object.next":
      return selectNeighbour(1);
    case "object.previous":
      return selectNeighbour(-1);
    case "escape":
      return escape();
    case "numbers":
      if (!object) return false;
      store.tab.value = "objects";
      requestAnimationFrame(() => document.querySelector<HTMLInputElement>("[data-field=x]")?.select());
      return true;
    case "move.left":
      return along("right", -1);
    case "move.right":
      return along("right", 1);
    case "move.far":
      return along("far", 1);
    case "move.near":
      return along("far", -1);
    case "move.up":
      return move([0, 0, 1], 1);
    case "move.down":
      return move([0, 0, 1], -1);
    case "turn.left":
      return turn(1);
    case "turn.right":
      return turn(-1);
    case "drop":
      if (object) void edits.drop(object);
      return object !== null;
    case "undo":
      edits.undo();
      return true;
    case "redo":
      edits.redo();
      return true;
    case "duplicate":
      if (object && canEdit) edits.duplicate(object);
      return object !== null;
    case "remove":
      if (object && canEdit) edits.remove(object);
      return object !== null;
    case "gizmo.move":
      store.gizmoMode.value = "move";
      return true;
    case "gizmo.turn":
      store.gizmoMode.value = "turn";
      return true;
    case "snap":
      store.snapping.value = !store.snapping.peek();
      store.status.value = store.snapping.peek() ? "Snapping on." : "Snapping off.";
      return true;
    case "frame":
      if (object) view?.frame(object);
      return object !== null;
    case "view.home":
    case "view.top":
    case "view.side":
    case "view.robot":
      store.lookThrough.value = null;
      view?.look(action.slice(5));
      return true;
    case "orbit.left":
      view?.orbit(-Math.PI / 24);
      return true;
    case "orbit.right":
      view?.orbit(Math.PI / 24);
      return true;
    case "zoom.in":
      view?.zoom(1 / 1.15);
      return true;
    case "zoom.out":
      view?.zoom(1.15);
      return true;
    case "camera.next": {
      const cameras = state?.cameras ?? [];
      const at = cameras.findIndex((camera) => camera.name === store.camera.peek()?.name);
      const next = cameras[(at + 1) % Math.max(1, cameras.length)];
      if (!next) return false;
      store.selectedCamera.value = next.name;
      if (store.lookThrough.peek()) store.lookThrough.value = next.name;
      return true;
    }
    case "camera.look":
      store.lookThrough.value = store.lookThrough.peek() ? null : (store.camera.peek()?.name ?? null);
      return true;
    case "theme":
      toggleTheme();
      return true;
    case "problem.next":
      return nextProblem();
    case "repair":
      void repairSelected();
      return true;
    case "repair.all":
      void edits.repairAll();
      return true;
    case "run":
      void playback.startRun();
      return true;
    case "teleop":
      teleop.begin();
      return true;
    case "play":
      if (playback.episode.peek()) playback.togglePlay();
      else store.tab.value = "runs";
      return true;
    case "moment.next":
      return playback.nextStop(1);
    case "moment.previous":
      return playback.nextStop(-1);
    case "review.next":
      void reviews.next();
      return true;
    case "review.approve":
    case "review.reject":
    case "review.send_back":
    case "review.take_back":
      return reviews.decide(action.slice(7) as "approve");
    case "sheet":
    case "balance":
      return show(action, true);
    case "questions":
      return show(action, questions.isAsked.peek());
    default:
      return false;
  }
}

function escape(): boolean {
  if (view?.cancelDrag()) return true;
  if (store.lookThrough.peek()) {
    store.lookThrough.value = null;
    return true;
  }
  if (playback.leave()) return true;
  store.select(null);
  return true;
}

/** Keys of the scenarios as the list shows them. */
let listed: string[] = [];

export function setListed(keys: string[]): void {
  listed = keys;
}

function step(by: number): boolean {
  const at = listed.indexOf(store.openKey.peek() ?? "");
  const next = listed[Math.max(0, Math.min(listed.length - 1, at + by))];
  if (next) open(next);
  return next !== undefined;
}

function selectNeighbour(by: number): boolean {
  const objects = store.current.peek()?.objects ?? [];
  if (objects.length === 0) return false;
  const at = objects.findIndex((object) => object.id === store.selectedId.peek());
  const next = at < 0 ? (by > 0 ? 0 : objects.length - 1) : (at + by + objects.length) % objects.length;
  store.select(objects[next]!.id);
  return true;
}

function nextProblem(): boolean {
  const problems = store.problems.peek();
  if (problems.length === 0) return false;
  const at = problems.findIndex((problem) => store.problemKey(problem) === store.selectedProblem.peek());
  const next = problems[(at + 1) % problems.length]!;
  if (next.object) store.select(next.object);
  store.selectedProblem.value = store.problemKey(next);
  return true;
}

async function repairSelected(): Promise<void> {
  const problems = store.problems.peek();
  const problem = problems.find((one) => store.problemKey(one) === store.selectedProblem.peek()) ?? problems[0];
  if (!problem) return;
  const [repair] = await edits.repairsOf(problem).catch(() => []);
  if (repair) edits.applyRepair(repair);
  else store.status.value = "No repair is known for this problem.";
}
