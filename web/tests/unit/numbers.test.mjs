import assert from "node:assert/strict";
import test from "node:test";
import { formatNumber, parseNumber } from "../../src/logic/numbers.ts";

test("typed numbers", () => {
  const cases = [
    ["0.35", "m", 0, 0.35],
    [" ,35 ", "m", 0, 0.35],
    ["35 cm", "m", 0, 0.35],
    ["350mm", "m", 0, 0.35],
    ["-1e-3", "m", 0, -0.001],
    ["−15", "deg", 0, -15],
    ["90°", "deg", 0, 90],
    ["+=2cm", "m", 0.1, 0.12],
    ["-= 1", "m", 0.1, -0.9],
    ["*=2", "deg", 15, 30],
    ["", "m", 1, null],
    ["abc", "m", 1, null],
    ["1.2.3", "m", 1, null],
    ["5 deg", "m", 1, null],
    ["1e999", "m", 1, null],
    ["5 constructor", "m", 1, null],
  ];
  for (const [text, unit, current, expected] of cases) {
    const parsed = parseNumber(text, unit, current);
    if (expected === null) assert.equal(parsed, null, text);
    else assert.ok(Math.abs(parsed - expected) < 1e-12, `${text}: ${parsed}`);
  }
});

test("numbers as text", () => {
  assert.equal(formatNumber(-0.00001, 3), "0.000");
  assert.equal(formatNumber(0.12345, 3), "0.123");
  assert.equal(formatNumber(-12.5, 1), "-12.5");
});
