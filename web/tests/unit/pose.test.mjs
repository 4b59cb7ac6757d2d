import assert from "node:assert/strict";
import test from "node:test";
import { compose, fromEuler, inverse, movedBounds, rotate, samePose, toEuler, turned } from "../../src/logic/pose.ts";

const pose = (x, y, z, euler = [0, 0, 0]) => ({ position_m: [x, y, z], orientation_wxyz: fromEuler(euler) });
const near = (a, b, message) => a.forEach((value, index) => assert.ok(Math.abs(value - b[index]) < 1e-9, `${message}: ${a} and ${b}`));

test("euler angles and back", () => {
  for (const angles of [[0, 0, 0], [0.3, -0.4, 2.9], [-3, 1.2, 0.1], [0, 0, -1.5]]) near(toEuler(fromEuler(angles)), angles, "angles");
});

test("yaw turns x towards y", () => {
  near(rotate(fromEuler([0, 0, Math.PI / 2]), [1, 0, 0]), [0, 1, 0], "turned");
});

test("a pose and its inverse cancel", () => {
  const own = pose(0.4, -0.2, 0.1, [0.3, 0.2, 1]);
  assert.ok(samePose(compose(own, inverse(own)), pose(0, 0, 0)));
});

test("turning keeps the pivot and the height", () => {
  const by = turned(pose(0.5, 0, 0.02), Math.PI / 2, [0.4, 0, 0]);
  near(by.position_m, [0.4, 0.1, 0.02], "position");
});

test("boxes move with their object", () => {
  const box = [[0.4, -0.05, 0], [0.6, 0.05, 0.1]];
  const shifted = movedBounds(box, pose(0.5, 0, 0), pose(0.6, 0.1, 0));
  near(shifted.flat(), [0.5, 0.05, 0, 0.7, 0.15, 0.1], "shifted");
  const turnedBox = movedBounds(box, pose(0.5, 0, 0), pose(0.5, 0, 0, [0, 0, Math.PI / 2]));
  near(turnedBox.flat(), [0.45, -0.1, 0, 0.55, 0.1, 0.1], "turned");
});
