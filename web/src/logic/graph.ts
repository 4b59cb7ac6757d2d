// Layered layout of a scene graph: subjects above their references, goal edges beside those of the scene.

import type { Atom, GraphEdge } from "../contract.ts";
import { endsOf } from "./operations.ts";

export interface GraphNode {
  id: string;
  name: string;
}

export interface PlacedNode extends GraphNode {
  x: number;
  y: number;
}

export interface PlacedEdge {
  /** Subject and references; the path goes to `to`. */
  from: string;
  to: string;
  label: string;
  isGoal: boolean;
  /** Alternative of the goal, from 0. */
  alternative: number;
  path: string;
  labelAt: { x: number; y: number };
}

export interface Layout {
  width: number;
  height: number;
  nodes: PlacedNode[];
  edges: PlacedEdge[];
}

export const NODE = { width: 104, height: 26 };
const ROW = 74;
const LABEL = { width: 46, height: 14 };

interface Arrow {
  from: string;
  to: string;
  label: string;
  isGoal: boolean;
  alternative: number;
}

/** Coordinates of nodes and edges for a drawing of `width` pixels. */
export function layoutGraph(nodes: GraphNode[], edges: GraphEdge[], goal: Atom[][], width: number): Layout {
  const known = new Set(nodes.map((node) => node.id));
  const arrows = arrowsOf(edges, goal).filter((arrow) => known.has(arrow.from) && known.has(arrow.to) && arrow.from !== arrow.to);
  const perRow = Math.max(1, Math.floor(width / (NODE.width + 14)));
  const rows = ordered(rowsOf(nodes.map((node) => node.id), arrows, perRow), arrows);
  const names = new Map(nodes.map((node) => [node.id, node.name]));
  const placed = new Map<string, PlacedNode>();
  rows.forEach((row, level) => {
    const step = width / row.length;
    row.forEach((id, index) => {
      // Every other row is shifted a little, so that straight edges between far rows pass between nodes.
      const shift = row.length < perRow && level % 2 === 1 ? Math.min(16, step / 8) : 0;
      placed.set(id, { id, name: names.get(id)!, x: step * (index + 0.5) + shift, y: ROW * level + NODE.height / 2 + 4 });
    });
  });
  const taken: Box[] = [...placed.values()].map((node) => box(node.x, node.y, NODE.width, NODE.height));
  const between = new Map<string, number>();
  const drawn = arrows.map((arrow) => {
    const pair = [arrow.from, arrow.to].sort().join(" ");
    const nth = between.get(pair) ?? 0;
    between.set(pair, nth + 1);
    return edgeOf(arrow, placed.get(arrow.from)!, placed.get(arrow.to)!, nth, taken);
  });
  return { width, height: Math.max(1, rows.length) * ROW - (ROW - NODE.height) + 8, nodes: [...placed.values()], edges: drawn };
}

function arrowsOf(edges: GraphEdge[], goal: Atom[][]): Arrow[] {
  const arrows: Arrow[] = [];
  const add = (edge: GraphEdge, isGoal: boolean, alternative: number) => {
    const [from, ...references] = endsOf(edge);
    for (const to of references) arrows.push({ from: from!, to, label: edge.relation, isGoal, alternative });
  };
  edges.forEach((edge) => add(edge, false, 0));
  goal.forEach((atoms, alternative) => atoms.forEach((atom) => atom.test === "relation" && add(atom, true, alternative)));
  return arrows;
}

/** Rows of ids: a subject above its references where the edges allow it; wide layers are split, loners come last. */
function rowsOf(ids: string[], arrows: Arrow[], perRow: number): string[][] {
  const below = new Map<string, string[]>(ids.map((id) => [id, []]));
  const isReached = (from: string, to: string): boolean => from === to || below.get(from)!.some((next) => isReached(next, to));
  // Edges of the scene first: where edges contradict each other, the goal's point upwards.
  for (const arrow of [...arrows.filter((one) => !one.isGoal), ...arrows.filter((one) => one.isGoal)]) {
    if (!isReached(arrow.to, arrow.from)) below.get(arrow.from)!.push(arrow.to);
  }
  const heights = new Map<string, number>();
  const heightOf = (id: string): number => {
    const known = heights.get(id);
    if (known !== undefined) return known;
    const height = Math.max(-1, ...below.get(id)!.map(heightOf)) + 1;
    heights.set(id, height);
    return height;
  };
  const connected = ids.filter((id) => arrows.some((arrow) => arrow.from === id || arrow.to === id));
  const top = Math.max(0, ...connected.map(heightOf));
  const rows: string[][] = [];
  for (let height = top; height >= 0; height--) rows.push(...split(connected.filter((id) => heightOf(id) === height), perRow));
  rows.push(...split(ids.filter((id) => !connected.includes(id)), perRow));
  return rows.filter((row) => row.length > 0);
}

function split(ids: string[], perRow: number): string[][] {
  const count = Math.ceil(ids.length / perRow);
  return Array.from({ length: count }, (_, row) => ids.filter((_, index) => index % count === row));
}

/** Order within rows by the mean place of neighbours, a few sweeps down and up. */
function ordered(rows: string[][], arrows: Arrow[]): string[][] {
  const neighbours = (id: string) => arrows.flatMap((arrow) => (arrow.from === id ? [arrow.to] : arrow.to === id ? [arrow.from] : []));
  const place = new Map<string, number>();
  const record = (row: string[]) => row.forEach((id, index) => place.set(id, (index + 0.5) / row.length));
  rows.forEach(record);
  let result = rows;
  for (let sweep = 0; sweep < 6; sweep++) {
    const order = sweep % 2 === 0 ? [...result.keys()] : [...result.keys()].reverse();
    result = [...result];
    for (const index of order) {
      const row = result[index]!;
      const mean = (id: string) => {
        const near = neighbours(id).filter((other) => !row.includes(other));
        return near.length === 0 ? place.get(id)! : near.reduce((sum, other) => sum + place.get(other)!, 0) / near.length;
      };
      const means = new Map(row.map((id) => [id, mean(id)]));
      const sorted = [...row].sort((a, b) => means.get(a)! - means.get(b)!);
      result[index] = sorted;
      record(sorted);
    }
  }
  return result;
}

interface Box {
  left: number;
  right: number;
  top: number;
  bottom: number;
}

function box(x: number, y: number, width: number, height: number): Box {
  return { left: x - width / 2, right: x + width / 2, top: y - height / 2, bottom: y + height / 2 };
}

function overlap(a: Box, b: Box): boolean {
  return a.left < b.right && a.right > b.left && a.top < b.bottom && a.bottom > b.top;
}

/** Curve between two nodes: the `nth` one of a pair bends farther out; its label takes the first free place. */
function edgeOf(arrow: Arrow, from: PlacedNode, to: PlacedNode, nth: number, taken: Box[]): PlacedEdge {
  const dx = to.x - from.x;
  const dy = to.y - from.y;
  const length = Math.hypot(dx, dy) || 1;
  const isSameRow = Math.abs(dy) < 1;
  const isLong = Math.abs(dy) > ROW * 1.5;
  const side = nth % 2 === 0 ? 1 : -1;
  const bend = (isSameRow ? 34 : isLong ? 30 : 8) * (nth + 1) * side * (isSameRow && dx > 0 ? -1 : 1);
  const middle = { x: (from.x + to.x) / 2 - (dy / length) * bend, y: (from.y + to.y) / 2 + (dx / length) * bend };
  const start = border(from, middle);
  const end = border(to, middle);
  const at = (t: number) => ({
    x: (1 - t) ** 2 * start.x + 2 * t * (1 - t) * middle.x + t ** 2 * end.x,
    y: (1 - t) ** 2 * start.y + 2 * t * (1 - t) * middle.y + t ** 2 * end.y,
  });
  const places = [0.5, 0.4, 0.6, 0.3, 0.7, 0.22, 0.78].map(at);
  const isFree = (place: { x: number; y: number }) => !taken.some((other) => overlap(other, box(place.x, place.y, LABEL.width, LABEL.height)));
  const labelAt = places.find(isFree) ?? places[0]!;
  taken.push(box(labelAt.x, labelAt.y, LABEL.width, LABEL.height));
  const round = (value: number) => Math.round(value * 10) / 10;
  const path = `M${round(start.x)} ${round(start.y)}Q${round(middle.x)} ${round(middle.y)} ${round(end.x)} ${round(end.y)}`;
  return { ...arrow, path, labelAt: { x: round(labelAt.x), y: round(labelAt.y) } };
}

/** Point where the line from a node's centre towards `target` leaves the node. */
function border(node: PlacedNode, target: { x: number; y: number }): { x: number; y: number } {
  const dx = target.x - node.x;
  const dy = target.y - node.y;
  const factor = Math.min((NODE.width / 2 + 3) / Math.max(Math.abs(dx), 1e-6), (NODE.height / 2 + 3) / Math.max(Math.abs(dy), 1e-6));
  return { x: node.x + dx * factor, y: node.y + dy * factor };
}
