import assert from "node:assert/strict";
import test from "node:test";
import { freeSpot, onGrid, snapMove, snapTurn } from "../../src/logic/snap.ts";

const table = { id: "table", name: "table", center_m: [0.4, 0, 0], size_m: [1.4, 1.5, 0.04] };
const scene = (neighbours = []) => ({ bounds: [[0.47, -0.03, 0], [0.53, 0.03, 0.1]], start: [0.5, 0, 0], neighbours, surfaces: [table] });
const all = [true, true, true];

function check(wanted, axes, neighbours, expected, cause) {
  const { position, causes } = snapMove(wanted, axes, scene(neighbours));
  position.forEach((value, axis) => assert.ok(Math.abs(value - expected[axis]) < 1e-9, `${wanted} became ${position}, expected ${expected}`));
  if (cause) assert.ok(causes.some((one) => one.includes(cause)), `${causes} should name ${cause}`);
}

test("positions snap to the grid and bottoms to the table", () => {
  check([0.5234, 0.0871, 0.007], all, [], [0.52, 0.09, 0], "on table");
  check([0.5234, 0.0871, 0.153], all, [], [0.52, 0.09, 0.15]);
});

test("a drag along one axis keeps the others", () => {
  check([0.5234, 0.0871, 0.2], [true, false, false], [], [0.52, 0, 0]);
  check([0.9, 0.9, 0.003], [false, false, true], [], [0.5, 0, 0]);
});

test("faces meet a neighbour's before the grid", () => {
  const mug = { id: "mug", bounds: [[0.6, -0.05, 0], [0.7, 0.05, 0.1]] };
  check([0.568, 0, 0], [true, true, false], [mug], [0.57, 0, 0], "touches mug");
  check([0.573, 0.001, 0], [true, true, false], [mug], [0.57, 0, 0], "touches mug");
});

test("centres come in line with a close neighbour's", () => {
  const mug = { id: "mug", bounds: [[0.573, 0.1, 0], [0.613, 0.14, 0.1]] };
  check([0.595, 0, 0], [true, true, false], [mug], [0.593, 0, 0], "in line with mug");
});

test("neighbours far above do not count", () => {
  const lamp = { id: "lamp", bounds: [[0.6, -0.05, 0.5], [0.7, 0.05, 0.6]] };
  check([0.568, 0, 0], [true, true, false], [lamp], [0.57, 0, 0]);
});

test("bottoms rest on a neighbour beneath", () => {
  const box = { id: "box", bounds: [[0.4, -0.1, 0], [0.6, 0.1, 0.083]] };
  check([0.5, 0, 0.079], [false, false, true], [box], [0.5, 0, 0.083], "on box");
});

test("turns snap to 15 degrees", () => {
  assert.equal(snapTurn(0.3), Math.PI / 12);
  assert.equal(snapTurn(-0.1), -0);
  assert.equal(onGrid(0.1 + 0.2, 0.01), 0.3);
});

test("a free spot lies in the working area and touches nothing", () => {
  const workspace = { x: [0.2, 0.9], y: [-0.5, 0.5] };
  const taken = [[[0.4, -0.15, 0], [0.7, 0.15, 0.1]]];
  const [x, y] = freeSpot([0.55, 0], [0.1, 0.1], taken, workspace);
  const isApart = x + 0.05 < 0.4 || x - 0.05 > 0.7 || y + 0.05 < -0.15 || y - 0.05 > 0.15;
  assert.ok(isApart && x - 0.05 >= 0.2 && x + 0.05 <= 0.9, `${x} ${y}`);
  assert.deepEqual(freeSpot([0.55, 0], [0.1, 0.1], [], workspace), [0.55, 0]);
  const full = [[[0, -1, 0], [1, 1, 0.1]]];
  assert.deepEqual(freeSpot([0.55, 0], [0.1, 0.1], full, workspace), [0.55, 0]);
});
