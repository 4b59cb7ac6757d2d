import assert from "node:assert/strict";
import test from "node:test";
import { durationOf, posedAt, stateAt } from "../../src/logic/track.ts";

const UPRIGHT = [1, 0, 0, 0];
const link = (name, position_m) => ({ name, mesh: `/meshes/${name}.glb`, world_from_link: { position_m, orientation_wxyz: UPRIGHT } });
const scene = {
  robot: { name: "arm", links: [link("base", [0, 0, 0])] },
  state: { objects: [{ id: "mug", pose: { position_m: [0.5, 0, 0], orientation_wxyz: UPRIGHT }, bounds_m: [[0.45, -0.05, 0], [0.55, 0.05, 0.1]], links: [link("body", [0.5, 0, 0.02])] }] },
};
// Two links in three states; the mug rises by a decimetre in each.
const row = (time_s, z) => [time_s, 0.08, 0, 0, 0, ...UPRIGHT, 0.5, 0, z, ...UPRIGHT];
const track = { frames: 3, width: 16, values: new Float32Array([...row(0, 0.02), ...row(0.1, 0.12), ...row(0.25, 0.22)]) };

test("the state of a time is the last one that is not later", () => {
  const cases = [[-1, 0], [0, 0], [0.05, 0], [0.1, 1], [0.2, 1], [0.25, 2], [9, 2]];
  for (const [time_s, state] of cases) assert.equal(stateAt(track, time_s), state, `${time_s} s`);
  assert.ok(Math.abs(durationOf(track) - 0.25) < 1e-6);
  assert.equal(durationOf({ frames: 0, width: 16, values: new Float32Array() }), 0);
});

test("links stand where the state has them, and objects with them", () => {
  for (const state of [0, 1, 2]) {
    const { robot, objects } = posedAt(scene, track, state);
    assert.deepEqual(robot[0].world_from_link.position_m, [0, 0, 0]);
    const [mug] = objects;
    const heights = [mug.links[0].world_from_link.position_m[2] - 0.02, mug.pose.position_m[2], mug.bounds_m[0][2], mug.bounds_m[1][2] - 0.1];
    for (const height of heights) assert.ok(Math.abs(height - 0.1 * state) < 1e-6, `${heights} in state ${state}`);
  }
  assert.equal(scene.state.objects[0].pose.position_m[2], 0, "the scene itself stays");
});
