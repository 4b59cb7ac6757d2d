// Layout of a scene graph on a grid: neighbours in the graph are neighbours in the drawing, subjects above what carries
// them.

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

export const NODE = { width: 92, height: 33 };
const ROW = 70;
const LABEL = { height: 12 };
/** Room between the columns, pixels: that of an edge with its label. */
const GAP = 30;

interface Arrow {
  from: string;
  to: string;
  label: string;
  isGoal: boolean;
  alternative: number;
}

interface Cell {
  row: number;
  column: number;
}

/** Letters that fit into a line of a node. */
const LETTERS = 15;

/** Name of a node in one or two lines: sizes in brackets are left out, what does not fit is cut. */
export function nodeLines(name: string): string[] {
  const lines: string[] = [];
  for (const word of name.replace(/\s*\(.*\)$/, "").split(/\s+/)) {
    const last = lines.at(-1);
    if (last !== undefined && `${last} ${word}`.length <= LETTERS) lines[lines.length - 1] = `${last} ${word}`;
    else lines.push(word);
  }
  const kept = lines.slice(0, 2);
  if (lines.length > 2) kept[1] += "…";
  return kept.map((line) => (line.length > LETTERS ? `${line.slice(0, LETTERS - 1)}…` : line));
}

/** Coordinates of nodes and edges for a drawing of `width` pixels. */
export function layoutGraph(nodes: GraphNode[], edges: GraphEdge[], goal: Atom[][], width: number): Layout {
  const known = new Set(nodes.map((node) => node.id));
  const arrows = arrowsOf(edges, goal).filter((arrow) => known.has(arrow.from) && known.has(arrow.to) && arrow.from !== arrow.to);
  const columns = Math.max(1, Math.min(nodes.length, Math.floor((width + GAP) / (NODE.width + GAP))));
  const cells = arranged(nodes.map((node) => node.id), arrows, columns);
  const rows = Math.max(0, ...[...cells.values()].map((cell) => cell.row)) + 1;
  const placed = new Map<string, PlacedNode>();
  for (const node of nodes) {
    const { row, column } = cells.get(node.id)!;
    placed.set(node.id, { ...node, x: (width / columns) * (column + 0.5), y: ROW * row + NODE.height / 2 + 18 });
  }
  const taken: Box[] = [...placed.values()].map((node) => box(node.x, node.y, NODE.width, NODE.height));
  const pairs = new Map<string, Arrow[]>();
  for (const arrow of arrows) {
    const pair = [arrow.from, arrow.to].sort().join(" ");
    pairs.set(pair, [...(pairs.get(pair) ?? []), arrow]);
  }
  const drawn = arrows.map((arrow) => {
    const parallel = pairs.get([arrow.from, arrow.to].sort().join(" "))!;
    const isBlocked = between(cells.get(arrow.from)!, cells.get(arrow.to)!, cells);
    return edgeOf(arrow, placed.get(arrow.from)!, placed.get(arrow.to)!, parallel.indexOf(arrow), parallel.length, isBlocked, taken);
  });
  return { width, height: rows * ROW - (ROW - NODE.height) + 34, nodes: [...placed.values()], edges: drawn };
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

const SUPPORTS = ["on", "in", "top"];

/** Cells of the nodes: swaps of two cells as long as one makes the edges shorter, from the order of the list. */
function arranged(ids: string[], arrows: Arrow[], columns: number): Map<string, Cell> {
  const rows = Math.ceil(ids.length / columns);
  const places: (string | null)[] = Array.from({ length: rows * columns }, (_, index) => ids[index] ?? null);
  const cellOf = (index: number): Cell => ({ row: Math.floor(index / columns), column: index % columns });
  const cellsNow = () => new Map(places.flatMap((id, index) => (id === null ? [] : [[id, cellOf(index)] as [string, Cell]])));
  let best = cost(cellsNow(), arrows);
  for (let sweep = 0; sweep < 12; sweep++) {
    let isBetter = false;
    for (let a = 0; a < places.length; a++) {
      for (let b = a + 1; b < places.length; b++) {
        if (places[a] === places[b]) continue;
        [places[a], places[b]] = [places[b]!, places[a]!];
        const now = cost(cellsNow(), arrows);
        if (now < best - 1e-9) {
          best = now;
          isBetter = true;
        } else {
          [places[a], places[b]] = [places[b]!, places[a]!];
        }
      }
    }
    if (!isBetter) break;
  }
  return cellsNow();
}

function cost(cells: Map<string, Cell>, arrows: Arrow[]): number {
  let sum = 0;
  for (const arrow of arrows) {
    const [from, to] = [cells.get(arrow.from)!, cells.get(arrow.to)!];
    sum += Math.hypot((from.column - to.column) * 1.1, from.row - to.row) ** 1.5;
    if (between(from, to, cells)) sum += 1.5;
    // Supports lie beneath; a goal says less about the drawing than the scene does.
    if (SUPPORTS.includes(arrow.label)) sum += 0.4 * (from.row - to.row + 1) * (arrow.isGoal ? 0.5 : 1);
    // Left of it is drawn left of it where that costs nothing.
    if (arrow.label === "left" && !arrow.isGoal) sum += 0.15 * (from.column - to.column);
    if (arrow.label === "right" && !arrow.isGoal) sum += 0.15 * (to.column - from.column);
  }
  return sum;
}

/** True if a node lies on the straight line between two cells. */
function between(from: Cell, to: Cell, cells: Map<string, Cell>): boolean {
  for (const cell of cells.values()) {
    const isEnd = (cell.row === from.row && cell.column === from.column) || (cell.row === to.row && cell.column === to.column);
    if (isEnd) continue;
    const cross = (to.row - from.row) * (cell.column - from.column) - (to.column - from.column) * (cell.row - from.row);
    const isWithin =
      Math.min(from.row, to.row) <= cell.row &&
      cell.row <= Math.max(from.row, to.row) &&
      Math.min(from.column, to.column) <= cell.column &&
      cell.column <= Math.max(from.column, to.column);
    if (cross === 0 && isWithin) return true;
  }
  return false;
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

/** Curve between two nodes: parallel edges fan out, an edge with a node in its way bends around it; its label takes the
 * first free place. */
function edgeOf(arrow: Arrow, from: PlacedNode, to: PlacedNode, nth: number, of: number, isBlocked: boolean, taken: Box[]): PlacedEdge {
  // The bend is measured across the same direction for both directions of a pair.
  const sign = arrow.from < arrow.to ? 1 : -1;
  const [dx, dy] = [to.x - from.x, to.y - from.y];
  const length = Math.hypot(dx, dy) || 1;
  const isFlat = Math.abs(dy) < 1;
  const bend = ((nth - (of - 1) / 2) * (isFlat ? 34 : 44) + (isBlocked ? (isFlat ? 52 : 120) : 0)) * sign;
  const middle = { x: (from.x + to.x) / 2 - (dy / length) * bend, y: (from.y + to.y) / 2 + (dx / length) * bend };
  const start = border(from, middle);
  const end = border(to, middle);
  const at = (t: number) => ({
    x: (1 - t) ** 2 * start.x + 2 * t * (1 - t) * middle.x + t ** 2 * end.x,
    y: (1 - t) ** 2 * start.y + 2 * t * (1 - t) * middle.y + t ** 2 * end.y,
  });
  // Beside a level edge, which its label would hide.
  const lift = isFlat && Math.abs(bend) < 20 ? -8 : 0;
  const places = [0.5, 0.42, 0.58, 0.34, 0.66, 0.26, 0.74].map((t) => ({ x: at(t).x, y: at(t).y + lift }));
  // A long word over a short level edge stands above the nodes.
  if (isFlat) places.push({ x: at(0.5).x, y: from.y - NODE.height / 2 - LABEL.height / 2 - 2 });
  const boxOf = (place: { x: number; y: number }) => box(place.x, place.y, arrow.label.length * 5.4 + 4, LABEL.height);
  const labelAt = places.find((place) => !taken.some((other) => overlap(other, boxOf(place)))) ?? places[0]!;
  taken.push(boxOf(labelAt));
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
