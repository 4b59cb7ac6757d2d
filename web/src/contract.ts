// Messages between the page and the server of `genmanip studio`.

import type { Run } from "./episodes.ts";

/** Lengths in metres, quaternions as (w, x, y, z), as in scenario files. */
export interface Pose {
  position_m: [number, number, number];
  orientation_wxyz: [number, number, number, number];
}

export interface ScenarioRow {
  key: string;
  id: string;
  kind: string;
  instruction: string;
  source: string;
  read_only: boolean;
  revision: number;
  objects: number;
}

export interface RelationAtom {
  test: "relation";
  subject: string;
  relation: string;
  reference: string;
  second_reference?: string;
}

export interface StateAtom {
  test: "state";
  object: string;
  state: string;
}

export type Atom = RelationAtom | StateAtom;

export interface GraphEdge {
  subject: string;
  relation: string;
  reference: string;
  second_reference?: string;
}

export interface Link {
  name: string;
  /** Absent for a link without visible parts. */
  mesh?: string | null;
  world_from_link: Pose;
}

export interface Joint {
  name: string;
  kind: "slide" | "hinge";
  lower: number;
  upper: number;
}

export type Bounds = [[number, number, number], [number, number, number]];

export interface SceneObject {
  id: string;
  uid: string;
  name: string;
  description: string;
  role: "moved" | "reference" | "other" | "distractor";
  graspable: boolean;
  pose: Pose;
  joint_positions: number[];
  states: string[];
  state?: string | null;
  joints?: Joint[];
  /** Axis-aligned box in the world. */
  bounds_m: Bounds;
  links: Link[];
}

export interface Intrinsics {
  width: number;
  height: number;
  fx: number;
  fy: number;
  cx: number;
  cy: number;
}

/** Brown's coefficients of a lens. */
export interface Distortion {
  k1: number;
  k2: number;
  p1: number;
  p2: number;
  k3: number;
}

export interface Camera {
  name: string;
  mount: "world" | "hand";
  /** OpenCV optical axes: x right, y down, z forward. */
  world_from_camera: Pose;
  mount_from_camera?: Pose;
  intrinsics: Intrinsics;
  distortion?: Distortion | null;
  sensor?: unknown;
}

export interface ScenarioState {
  key?: string;
  revision: number;
  kind: string;
  instruction: string;
  paraphrases?: string[];
  goal: Atom[][];
  goal_sentences: string[];
  description: string;
  edges: GraphEdge[];
  objects: SceneObject[];
  cameras: Camera[];
  can_undo: boolean;
  can_redo: boolean;
}

export interface Surface {
  id: string;
  name?: string;
  /** Centre of the top. */
  center_m: [number, number, number];
  size_m: [number, number, number];
  yaw_rad?: number;
}

export interface Scene {
  key: string;
  id: string;
  read_only: boolean;
  source: string;
  parent?: string | null;
  revision: number;
  state: ScenarioState;
  surfaces: Surface[];
  workspace: { x: [number, number]; y: [number, number] };
  robot: { name: string; links: Link[] };
}

export interface Placement {
  id: string;
  pose: Pose;
  joint_positions?: number[];
}

export type Operation =
  | { op: "place"; args: { objects: Placement[] } }
  | { op: "state"; args: { object: string; state?: string; joint_positions?: number[] } }
  | { op: "add"; args: { asset: string; pose: Pose } }
  | { op: "remove"; args: { object: string } }
  | { op: "duplicate"; args: { object: string; pose: Pose } }
  | { op: "swap"; args: { object: string; uid: string } }
  | { op: "instruction"; args: { text: string } }
  | { op: "goal"; args: { goal: Atom[][] } }
  | { op: "edges"; args: { edges: GraphEdge[]; description?: string } }
  | { op: "kind"; args: { kind: string } }
  | { op: "camera"; args: { camera: Omit<Camera, "world_from_camera"> } }
  | { op: "remove_camera"; args: { name: string } };

export interface Conflict {
  field: string;
  mine: unknown;
  theirs: unknown;
  revision: number;
}

export interface Refusal {
  message: string;
  hint?: string;
}

export interface Repair {
  label: string;
  op: string;
  args: unknown;
}

export const STAGES = ["wording", "relations", "collision", "reach", "visibility", "stability", "goal"] as const;
export type Stage = (typeof STAGES)[number];

export interface Problem {
  stage: Stage;
  code: string;
  object?: string | null;
  other?: string | null;
  message: string;
  value?: number | null;
  limit?: number | null;
  unit?: string | null;
  blocking: boolean;
  repairs?: Repair[];
}

export interface CatalogueEntry {
  uid: string;
  name: string;
  description: string;
  category: string;
  size_m: [number, number, number];
  thumbnail: string;
}

/** Cameras and sensors that can be bought. */
export interface KnownCameras {
  presets: { name: string; about: string; intrinsics: Intrinsics }[];
  sensors: { name: string; about: string; sensor: unknown }[];
}

/** Objects that a phrase of a sentence may mean; if none is known, those that share a word with it. */
export interface PhraseChoice {
  phrase: string;
  is_known: boolean;
  candidates: { uid: string; name: string }[];
}

/** Differences of two revisions. */
export interface Difference {
  moved: { id: string; distance_m: number }[];
  turned: { id: string; angle_rad: number }[];
  articulated: string[];
  added: string[];
  removed: string[];
  instruction?: [string, string];
  goal?: [Atom[][], Atom[][]];
  kind?: [string, string];
  edges_added: GraphEdge[];
  edges_removed: GraphEdge[];
  description?: [string, string];
  cameras: string[];
}

export interface HistoryLine {
  revision: number;
  op?: string;
  args?: Record<string, unknown>;
  author?: string;
  at?: string;
  undoes?: number;
  redoes?: number;
  snapshot?: string;
}

export type ServerMessage =
  | ({ type: "scene" } & Scene)
  | { type: "applied"; client_operation_id: string; author: string; state: ScenarioState }
  | { type: "conflict"; client_operation_id: string; conflict: Conflict }
  | { type: "refused"; client_operation_id: string; error: Refusal }
  | { type: "verdict"; revision: number; stage: Stage; problems: Problem[]; done: boolean; preview?: boolean; error?: string }
  | { type: "presence"; authors: string[] }
  | { type: "run"; run: Run }
  | { type: "stopped"; message: string };

export const KINDS = ["pick_and_place", "spatial", "appearance", "common_sense", "long_horizon", "articulated"] as const;

/** Relations with their words; directions are the robot's. */
export const RELATIONS: Record<string, string> = {
  left: "to the robot's left of",
  right: "to the robot's right of",
  front: "on the far side of",
  back: "on the robot's side of",
  near: "near",
  on: "on",
  in: "in",
  top: "on or in",
  between: "between",
};
