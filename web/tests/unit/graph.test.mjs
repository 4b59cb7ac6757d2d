import assert from "node:assert/strict";
import { readFileSync, readdirSync } from "node:fs";
import test from "node:test";
import { layoutGraph, NODE, nodeLines } from "../../src/logic/graph.ts";

const SUITE = new URL("../../../suites/genmanip-200-rc/scenarios/", import.meta.url);
const WIDTH = 366;

test("every graph of the suite is drawn without overlapping nodes, inside of its frame, twice the same", () => {
  for (const file of readdirSync(SUITE).filter((_, index) => index % 4 === 0)) {
    const { task } = JSON.parse(readFileSync(new URL(file, SUITE), "utf8"));
    const nodes = task.scene_graph.nodes.map(({ id }) => ({ id, name: id }));
    const draw = () => layoutGraph(nodes, task.scene_graph.edges, task.goal, WIDTH);
    const layout = draw();
    assert.deepEqual(layout, draw(), file);
    assert.equal(layout.nodes.length, nodes.length, file);
    for (const [index, node] of layout.nodes.entries()) {
      assert.ok(node.x >= NODE.width / 2 && node.x <= WIDTH - NODE.width / 2 && node.y <= layout.height, `${file}: ${node.id}`);
      for (const other of layout.nodes.slice(index + 1)) {
        const isApart = Math.abs(node.x - other.x) > NODE.width || Math.abs(node.y - other.y) > NODE.height;
        assert.ok(isApart, `${file}: ${node.id} and ${other.id}`);
      }
    }
    assert.ok(layout.edges.every((edge) => !edge.path.includes("NaN")), file);
  }
});

test("what carries is drawn beneath", () => {
  const nodes = ["cup", "tray"].map((id) => ({ id, name: id }));
  const { nodes: placed } = layoutGraph(nodes, [{ subject: "cup", relation: "on", reference: "tray" }], [], 100);
  assert.ok(placed[0].y < placed[1].y);
});

test("edges of a pair do not share a path, and unknown ends are left out", () => {
  const nodes = ["a", "b"].map((id) => ({ id, name: id }));
  const edges = [{ subject: "a", relation: "left", reference: "b" }, { subject: "b", relation: "near", reference: "a" }, { subject: "a", relation: "on", reference: "gone" }];
  const goal = [[{ test: "relation", subject: "a", relation: "in", reference: "b" }, { test: "state", object: "a", state: "open" }]];
  const layout = layoutGraph(nodes, edges, goal, WIDTH);
  assert.equal(layout.edges.length, 3);
  assert.equal(new Set(layout.edges.map((edge) => edge.path)).size, 3);
  assert.deepEqual(layout.edges.map((edge) => edge.isGoal), [false, false, true]);
});

test("names fit into two lines", () => {
  assert.deepEqual(nodeLines("Lemon"), ["Lemon"]);
  assert.deepEqual(nodeLines("Dark-Brown Basket (270 mm)"), ["Dark-Brown", "Basket"]);
  assert.deepEqual(nodeLines("Oak Pepper Mill with Dark-Grey Knob"), ["Oak Pepper Mill", "with Dark-Grey…"]);
  assert.deepEqual(nodeLines("Incomprehensibilities"), ["Incomprehensib…"]);
});

test("an empty scene", () => {
  assert.deepEqual(layoutGraph([], [], [], WIDTH).nodes, []);
});
