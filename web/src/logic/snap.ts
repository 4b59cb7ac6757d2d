// Snapping of dragged objects, in metres and radians.

import type { Bounds, Surface } from "../contract.ts";
import type { Vector } from "./pose.ts";

export const GRID_M = 0.01;
export const TURN_RAD = Math.PI / 12;

/** Distances below which a face snaps to a neighbour's, and a bottom to a surface. */
const NEIGHBOUR_M = 0.006;
const SURFACE_M = 0.012;

export interface SnapScene {
  /** Box of the object where the drag began. */
  bounds: Bounds;
  /** Position of the object where the drag began. */
  start: Vector;
  neighbours: { id: string; bounds: Bounds }[];
  surfaces: Surface[];
}

export interface Snapped {
  position: Vector;
  /** Cause of each snap, for the status line. */
  causes: string[];
}

/** Axes that the drag may change; others keep the value of `start`. */
export type Axes = [boolean, boolean, boolean];

/** Position near `wanted`: faces touch or align with neighbours, else on the grid; bottoms rest on a surface or on a
 * neighbour. */
export function snapMove(wanted: Vector, axes: Axes, scene: SnapScene): Snapped {
  const position = wanted.map((value, axis) => (axes[axis] ? value : scene.start[axis]!)) as Vector;
  const causes: string[] = [];
  for (const axis of [0, 1]) {
    if (!axes[axis]) continue;
    const near = nearNeighbour(position, axis, scene);
    if (near) {
      position[axis] = near.value;
      causes.push(near.cause);
    } else {
      position[axis] = onGrid(position[axis]!, GRID_M);
    }
  }
  if (axes[2]) {
    const rest = restingHeight(position, scene);
    if (rest) {
      position[2] = rest.value;
      causes.push(rest.cause);
    } else {
      position[2] = onGrid(position[2]!, GRID_M);
    }
  }
  return { position, causes };
}

export function onGrid(value: number, step: number): number {
  // Rounded again, so that 0.3 is 0.3 and not 0.30000000000000004.
  return Number((Math.round(value / step) * step).toFixed(9));
}

/** Angle of a drag, a whole number of steps. */
export function snapTurn(angle: number, step = TURN_RAD): number {
  return Math.round(angle / step) * step;
}

interface Candidate {
  value: number;
  cause: string;
}

function boundsAt(position: Vector, scene: SnapScene): Bounds {
  const by = position.map((value, axis) => value - scene.start[axis]!);
  return scene.bounds.map((corner) => corner.map((value, axis) => value + by[axis]!)) as Bounds;
}

/** Faces that meet, then faces and centres in line; only neighbours that are close on the other axis. */
function nearNeighbour(position: Vector, axis: number, scene: SnapScene): Candidate | null {
  const [low, high] = boundsAt(position, scene);
  const other = 1 - axis;
  let best: Candidate | null = null;
  let distance = NEIGHBOUR_M;
  for (const { id, bounds } of scene.neighbours) {
    const [nearLow, nearHigh] = bounds;
    const overlaps = (a: number) => low[a]! < nearHigh[a]! - 1e-6 && high[a]! > nearLow[a]! + 1e-6;
    if (!overlaps(2)) continue;
    const candidates: [number, string][] = [];
    if (overlaps(other)) {
      candidates.push([nearHigh[axis]! - low[axis]!, `touches ${id}`], [nearLow[axis]! - high[axis]!, `touches ${id}`]);
    }
    const gap = Math.max(nearLow[other]! - high[other]!, low[other]! - nearHigh[other]!);
    if (gap < 0.1) {
      const centre = (nearLow[axis]! + nearHigh[axis]! - low[axis]! - high[axis]!) / 2;
      candidates.push([centre, `in line with ${id}`]);
    }
    for (const [by, cause] of candidates) {
      if (Math.abs(by) < distance) {
        distance = Math.abs(by);
        best = { value: position[axis]! + by, cause };
      }
    }
  }
  return best;
}

/** Height at which the bottom meets a surface or the top of a neighbour beneath. */
function restingHeight(position: Vector, scene: SnapScene): Candidate | null {
  const [low, high] = boundsAt(position, scene);
  const tops = scene.surfaces.map((surface): [number, string] => [surface.center_m[2], `on ${surface.name ?? surface.id}`]);
  for (const { id, bounds } of scene.neighbours) {
    const isOver = [0, 1].every((axis) => low[axis]! < bounds[1][axis]! && high[axis]! > bounds[0][axis]!);
    if (isOver) tops.push([bounds[1][2], `on ${id}`]);
  }
  let best: Candidate | null = null;
  let distance = SURFACE_M;
  for (const [top, cause] of tops) {
    const by = top - low[2];
    if (Math.abs(by) < distance) {
      distance = Math.abs(by);
      best = { value: position[2] + by, cause };
    }
  }
  return best;
}

/** Nearest free spot for a box on the table, searched in rings around `wanted`; `wanted` when all is taken. */
export function freeSpot(
  wanted: [number, number],
  size: [number, number],
  taken: Bounds[],
  workspace: { x: [number, number]; y: [number, number] },
): [number, number] {
  const gap = 0.02;
  const isFree = (x: number, y: number) =>
    taken.every(
      ([low, high]) =>
        x + size[0] / 2 + gap < low[0] || x - size[0] / 2 - gap > high[0] || y + size[1] / 2 + gap < low[1] || y - size[1] / 2 - gap > high[1],
    ) &&
    x - size[0] / 2 >= workspace.x[0] &&
    x + size[0] / 2 <= workspace.x[1] &&
    y - size[1] / 2 >= workspace.y[0] &&
    y + size[1] / 2 <= workspace.y[1];
  for (let ring = 0; ring < 40; ring++) {
    const radius = ring * 0.02;
    const count = Math.max(1, ring * 8);
    for (let step = 0; step < count; step++) {
      const angle = (step / count) * 2 * Math.PI;
      const x = onGrid(wanted[0] + radius * Math.cos(angle), GRID_M);
      const y = onGrid(wanted[1] + radius * Math.sin(angle), GRID_M);
      if (isFree(x, y)) return [x, y];
    }
  }
  return wanted;
}
