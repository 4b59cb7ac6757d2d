import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import test from "node:test";
import { descriptor, hexadecimal, report } from "../../src/logic/hid.ts";

test("input items of a device are written as a report descriptor", () => {
  // A test of the server's side reads the same file, and finds the layout of the device's own descriptor in it.
  const file = new URL("../../../crates/teleop/testdata/space_navigator_webhid.json", import.meta.url);
  const expected = JSON.parse(readFileSync(file, "utf8"));
  assert.equal(hexadecimal(descriptor(expected.collections)), expected.descriptor);
  assert.equal(descriptor([{ usagePage: 1, usage: 8 }]).length, 0);
});

test("a report has its id in front only if the device uses ids", () => {
  const data = new DataView(Uint8Array.from([9, 1, 2, 255]).buffer, 1);
  assert.equal(hexadecimal(report(1, data)), "010102ff");
  assert.equal(hexadecimal(report(0, data)), "0102ff");
});
