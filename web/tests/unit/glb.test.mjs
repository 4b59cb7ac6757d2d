import assert from "node:assert/strict";
import test from "node:test";
import { readGlb } from "../../src/scene/glb.ts";
import { standIn } from "../glb.mjs";

const bytesOf = (buffer) => buffer.buffer.slice(buffer.byteOffset, buffer.byteOffset + buffer.length);

test("positions, normals, triangles and material of a mesh", async () => {
  const group = await readGlb(bytesOf(standIn("box", [0.2, 0.1, 0.3], [0.5, 0.25, 0])));
  const [mesh] = group.children;
  assert.equal(group.children.length, 1);
  assert.deepEqual([mesh.geometry.getAttribute("position").count, mesh.geometry.getIndex().count], [24, 36]);
  mesh.geometry.computeBoundingBox();
  const { min, max } = mesh.geometry.boundingBox;
  [...min, ...max].forEach((value, index) => assert.ok(Math.abs(value - [-0.1, -0.05, 0, 0.1, 0.05, 0.3][index]) < 1e-6));
  assert.deepEqual(mesh.material.color.toArray(), [0.5, 0.25, 0]);
  // Triangles are seen from outside.
  const [a, b, c] = [0, 1, 2].map((corner) => mesh.geometry.getIndex().getX(corner));
  const at = (index) => ["getX", "getY", "getZ"].map((get) => mesh.geometry.getAttribute("position")[get](index));
  const [p, q, r] = [at(a), at(b), at(c)];
  const [u, v] = [q.map((value, axis) => value - p[axis]), r.map((value, axis) => value - p[axis])];
  const outwards = u[1] * v[2] - u[2] * v[1];
  assert.ok(outwards * mesh.geometry.getAttribute("normal").getX(a) > 0);
});

test("what is no mesh is refused", async () => {
  const whole = bytesOf(standIn("cylinder", [0.1, 0.1, 0.1], [1, 1, 1]));
  for (const length of [0, 4, 19, 40, 200, whole.byteLength - 400]) {
    await assert.rejects(readGlb(whole.slice(0, length)), `${length} bytes`);
  }
  await assert.rejects(readGlb(new ArrayBuffer(64)), /no GLB file/);
});
