// The state of the page: one signal per thing that changes by itself.

import { batch, computed, effect, signal } from "@preact/signals";
import type { Camera, Pose, Problem, Scene, SceneObject, ScenarioRow, ScenarioState } from "../contract.ts";
import type { Entry } from "../logic/outbox.ts";
import { predict } from "../logic/operations.ts";
import { empty, problemsOf, type Verdict } from "../logic/verdict.ts";

export const author = signal("");
export const version = signal("");
export const scenarios = signal<ScenarioRow[] | null>(null);
/** Key of the open scenario. */
export const openKey = signal<string | null>(null);
/** The open scenario without its changing part. */
export const scene = signal<Scene | null>(null);
/** Newest state that the server confirmed. */
export const confirmed = signal<ScenarioState | null>(null);
/** Commands that the server has not answered. */
export const entries = signal<Entry[]>([]);
export const verdict = signal<Verdict>(empty(0));
export const isOnline = signal(false);
/** True from the first connection on: before it nothing is said to be offline. */
export const wasOnline = signal(false);
/** Seconds until the next try to connect. */
export const retryIn = signal<number | null>(null);
export const presence = signal<string[]>([]);
/** The server's reason for refusing all edits. */
export const stopped = signal<string | null>(null);
export const selectedId = signal<string | null>(null);
export const hoveredId = signal<string | null>(null);
export const selectedCamera = signal<string | null>(null);
/** Camera that the 3-D view looks through. */
export const lookThrough = signal<string | null>(null);
export const selectedProblem = signal<string | null>(null);
export const gizmoMode = signal<"move" | "turn">("move");
/** Pose that the teleoperated gripper is to go to, as handles in the 3-D view. */
export const target = signal<Pose | null>(null);
export const snapping = signal(true);
export const dialog = signal<DialogName | null>(null);
export const tab = signal<"objects" | "cameras" | "history" | "runs" | "review">("objects");
/** True while the 3-D view plays an episode back: nothing is edited then. */
export const isReplaying = signal(false);
/** Words for the status line and for screen readers. */
export const status = signal("");
export const notices = signal<Notice[]>([]);
/** Steps by which the detail of moving images was lowered. */
export const detail = signal(0);
/** True while an object is dragged. */
export const isDragging = signal(false);
/** Progress of loading meshes: loaded and wanted. */
export const meshes = signal<[number, number]>([0, 0]);

export type DialogName =
  | "help"
  | "new"
  | "add"
  | "swap"
  | "instruction"
  | "goal"
  | "edges"
  | "snapshot"
  | "camera"
  | "author"
  | "sheet"
  | "balance"
  | "questions";

export interface Notice {
  id: number;
  words: string;
  hint?: string;
  isError: boolean;
}

/** State with the commands that wait: what people see. */
export const current = computed<ScenarioState | null>(() => {
  const state = confirmed.value;
  if (!state) return null;
  return entries.value
    .filter((entry) => entry.key === openKey.value && entry.operation && !entry.conflict)
    .reduce((seen, entry) => predict(seen, entry.operation!), state);
});

export const selected = computed<SceneObject | null>(
  () => current.value?.objects.find((object) => object.id === selectedId.value) ?? null,
);

export const camera = computed<Camera | null>(() => {
  const cameras = current.value?.cameras ?? [];
  return cameras.find((one) => one.name === selectedCamera.value) ?? cameras[0] ?? null;
});

export const waiting = computed(() => entries.value.filter((entry) => !entry.conflict).length);
export const conflicting = computed(() => entries.value.find((entry) => entry.conflict) ?? null);
export const problems = computed<Problem[]>(() => problemsOf(verdict.value));
/** Objects of problems, and whether one of them blocks. */
export const troubled = computed(() => {
  const ids = new Map<string, boolean>();
  for (const problem of problems.value) {
    if (problem.object) ids.set(problem.object, problem.blocking || (ids.get(problem.object) ?? false));
  }
  return ids;
});
/** Revision that the open scenario is compared with. */
export const difference = signal<number | null>(null);
/** Objects of the open scenario that edits leave alone, and that the 3-D view leaves out. */
export const locked = signal<ReadonlySet<string>>(new Set());
export const hidden = signal<ReadonlySet<string>>(new Set());

/** Adds an object to one of these sets, or takes it out. */
export function toggle(set: typeof locked, id: string): boolean {
  const now = new Set(set.peek());
  if (!now.delete(id)) now.add(id);
  set.value = now;
  return now.has(id);
}

export const isEditable = computed(() => Boolean(current.value) && !stopped.value && !isReplaying.value);

export function problemKey(problem: Problem): string {
  return [problem.stage, problem.code, problem.object ?? "", problem.other ?? ""].join(" ");
}

/** Selects an object; null deselects. */
export function select(id: string | null): void {
  batch(() => {
    selectedId.value = id;
    if (id !== null) tab.value = "objects";
    if (id === null) selectedProblem.value = null;
  });
}

/** Selects a camera in place of an object. */
export function selectCamera(name: string): void {
  batch(() => {
    selectedId.value = null;
    selectedCamera.value = name;
    tab.value = "cameras";
  });
}

/** Takes a newer state of the open scenario; an older one changes nothing. */
export function confirm(state: ScenarioState): void {
  const known = confirmed.value;
  if (known && state.revision < known.revision) return;
  batch(() => {
    confirmed.value = state;
    if (!known || state.revision > known.revision) verdict.value = empty(state.revision);
    if (selectedId.value && !state.objects.some((object) => object.id === selectedId.value)) {
      // A swap changes the id: what took its place is selected instead.
      const at = known?.objects.findIndex((object) => object.id === selectedId.value) ?? -1;
      const instead = state.objects.length === known?.objects.length ? state.objects[at]?.id : undefined;
      selectedId.value = instead ?? null;
    }
    if (lookThrough.value && !state.cameras.some((one) => one.name === lookThrough.value)) lookThrough.value = null;
  });
}

/** Shows a scene from its beginning. */
export function show(message: Scene): void {
  batch(() => {
    const isSame = scene.value?.key === message.key;
    scene.value = message;
    stopped.value = null;
    if (isSame) {
      confirm(message.state);
      return;
    }
    confirmed.value = message.state;
    verdict.value = empty(message.state.revision);
    locked.value = hidden.value = new Set();
    difference.value = null;
    selectedId.value = null;
    selectedProblem.value = null;
    lookThrough.value = null;
    if (!message.state.cameras.some((one) => one.name === selectedCamera.value)) {
      selectedCamera.value = message.state.cameras[0]?.name ?? null;
    }
  });
}

let noticeCount = 0;

/** Tells something for a few seconds; errors stay until dismissed. */
export function notify(words: string, options: { hint?: string; isError?: boolean } = {}): void {
  const id = ++noticeCount;
  const isError = options.isError ?? false;
  notices.value = [...notices.value.slice(-3), { id, words, isError, ...(options.hint ? { hint: options.hint } : {}) }];
  if (!isError) setTimeout(() => dismiss(id), 4000);
}

export function dismiss(id: number): void {
  notices.value = notices.value.filter((notice) => notice.id !== id);
}

const QUEUE = "genmanip.studio.unsent";

/** Keeps unsent commands over reloads of the tab. */
export function keepEntries(restored: Entry[]): void {
  entries.value = restored;
  effect(() => {
    try {
      sessionStorage.setItem(QUEUE, JSON.stringify(entries.value));
    } catch {
      // A full or forbidden storage loses nothing while the page is open.
    }
  });
}

export function storedEntries(): string | null {
  try {
    return sessionStorage.getItem(QUEUE);
  } catch {
    return null;
  }
}
