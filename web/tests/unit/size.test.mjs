import assert from "node:assert/strict";
import { readFileSync, readdirSync } from "node:fs";
import test from "node:test";
import { gzipSync } from "node:zlib";

const DIST = new URL("../../dist/", import.meta.url);
const files = readdirSync(DIST, { recursive: true, withFileTypes: true }).filter((entry) => entry.isFile());
const contents = files.map((entry) => readFileSync(`${entry.parentPath ?? entry.path}/${entry.name}`));

test("the page stays small", () => {
  const raw = contents.reduce((sum, bytes) => sum + bytes.length, 0);
  const packed = contents.reduce((sum, bytes) => sum + gzipSync(bytes, { level: 9 }).length, 0);
  console.log(`web/dist: ${raw} bytes, ${packed} compressed`);
  assert.ok(raw <= 700_000, `${raw} bytes`);
  assert.ok(packed <= 180_000, `${packed} bytes compressed`);
});

test("the page asks no other host", () => {
  // Addresses in comments and of name spaces are not fetched.
  const text = contents.map((bytes) => bytes.toString("utf8")).join("\n");
  const calls = [...text.matchAll(/(?:fetch|import|src=|href=)\(?["'`]https?:[^"'`]*/g)].map(([call]) => call);
  assert.deepEqual(calls, []);
});
