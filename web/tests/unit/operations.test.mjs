import assert from "node:assert/strict";
import test from "node:test";
import { atomWords, carriedBy, fieldsOf, operationWords, predict, valueWords } from "../../src/logic/operations.ts";

const pose = (x, y, z) => ({ position_m: [x, y, z], orientation_wxyz: [1, 0, 0, 0] });
const object = (id, name, at) => ({ id, name, pose: at, joint_positions: [], bounds_m: [[0, 0, 0], [0.1, 0.1, 0.1]], links: [{ name: "body", mesh: "/m", world_from_link: at }] });
const state = {
  instruction: "old",
  kind: "spatial",
  goal: [],
  goal_sentences: [],
  description: "d",
  edges: [{ subject: "1", relation: "on", reference: "2" }, { subject: "3", relation: "left", reference: "2" }],
  objects: [object("1", "Cup", pose(0, 0, 0.1)), object("2", "Tray", pose(0, 0, 0)), object("3", "Pear", pose(0, 0.3, 0))],
  cameras: [{ name: "static", mount: "world", world_from_camera: pose(1, 0, 1), mount_from_camera: pose(1, 0, 1) }],
};

test("a placed object takes its box and links along", () => {
  const after = predict(state, { op: "place", args: { objects: [{ id: "3", pose: pose(0.1, 0.3, 0) }] } });
  const pear = after.objects[2];
  assert.deepEqual(pear.links[0].world_from_link.position_m, [0.1, 0.3, 0]);
  assert.ok(Math.abs(pear.bounds_m[1][0] - 0.2) < 1e-9);
  assert.equal(after.objects[0], state.objects[0]);
});

test("edits that wait are seen", () => {
  const goal = [[{ test: "relation", subject: "1", relation: "left", reference: "3" }]];
  assert.equal(predict(state, { op: "instruction", args: { text: "new" } }).instruction, "new");
  assert.equal(predict(state, { op: "kind", args: { kind: "appearance" } }).kind, "appearance");
  assert.deepEqual(predict(state, { op: "goal", args: { goal } }).goal_sentences, ["the Cup is to the robot's left of the Pear"]);
  const removed = predict(state, { op: "remove", args: { object: "2" } });
  assert.deepEqual([removed.objects.length, removed.edges.length], [2, 0]);
  const moved = { ...state.cameras[0], mount_from_camera: pose(2, 0, 1) };
  assert.deepEqual(predict(state, { op: "camera", args: { camera: moved } }).cameras[0].world_from_camera.position_m, [2, 0, 1]);
  assert.equal(predict(state, { op: "remove_camera", args: { name: "static" } }).cameras.length, 0);
  assert.equal(predict(state, { op: "swap", args: { object: "1", uid: "9" } }), state);
});

test("fields of operations", () => {
  assert.deepEqual(fieldsOf({ op: "place", args: { objects: [{ id: "1" }, { id: "2" }] } }), ["objects/1/pose", "objects/2/pose"]);
  assert.deepEqual(fieldsOf({ op: "remove", args: { object: "1" } }), ["objects/1"]);
  assert.deepEqual(fieldsOf({ op: "state", args: { object: "1", state: "open" } }), ["objects/1/joints", "objects/1/state"]);
  assert.deepEqual(fieldsOf({ op: "camera", args: { camera: { name: "c" } } }), ["cameras/c"]);
});

test("what stands on an object moves along, over several levels and circles", () => {
  const edges = [["1", "on", "2"], ["3", "in", "1"], ["4", "left", "2"], ["2", "on", "3"]].map(([subject, relation, reference]) => ({ subject, relation, reference }));
  assert.deepEqual(carriedBy("2", edges).sort(), ["1", "3"]);
  assert.deepEqual(carriedBy("4", edges), []);
});

test("words", () => {
  assert.equal(atomWords({ test: "state", object: "2", state: "open" }, state), "the Tray is open");
  assert.equal(atomWords({ test: "relation", subject: "1", relation: "between", reference: "2", second_reference: "3" }, state), "the Cup is between the Tray and the Pear");
  assert.equal(operationWords("place", { objects: [{ id: "1" }, { id: "2" }] }, state), "place Cup and 1 more");
  assert.equal(operationWords("something_new", {}, state), "something new");
  assert.equal(valueWords(pose(0.1, 0.2, 0)), "at 0.100, 0.200, 0.000 m, turned 0.0°");
  assert.equal(valueWords(null), "removed");
  assert.equal(valueWords("text"), "text");
});
