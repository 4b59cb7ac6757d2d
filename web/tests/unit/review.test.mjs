import assert from "node:assert/strict";
import test from "node:test";
import { criteriaOf, decided, filtered, retargeted, standingWords, toggled, UNMARKED } from "../../src/logic/review.ts";

test("marks become decisions, and what is missing is said", () => {
  const mark = (numbers, note = "") => ({ ...numbers.reduce(toggled, UNMARKED), note });
  // Marked numbers, note, verdict, reasons or the beginning of what is missing.
  const cases = [
    [[], "", "approve", undefined],
    [[1], "", "approve", "Something is marked"],
    [[1, 1], "", "approve", undefined],
    [[], "", "reject", "Mark what is wrong"],
    [[1, 4, 6], "", "reject", ["ambiguous", "unreachable", "duplicate"]],
    [[8], " ", "reject", "The reason “other”"],
    [[8], "odd", "reject", ["other"]],
    [[3], "", "send_back", "Say in the note"],
    [[3], "move it", "send_back", undefined],
    [[2], "", "take_back", undefined],
  ];
  for (const [numbers, note, verdict, expected] of cases) {
    const found = decided(verdict, mark(numbers, note));
    if (typeof expected === "string") assert.ok(found.missing.startsWith(expected), found.missing);
    else assert.deepEqual(found.decision, expected ? { verdict, reasons: expected } : { verdict }, `${numbers} ${verdict}`);
  }
  assert.deepEqual(toggled(UNMARKED, 9), UNMARKED);
  assert.deepEqual(Object.values(criteriaOf(mark([2, 7]))), [true, false, true, true, true]);
});

test("the queue completes pairs first, and shows one kind or what is missing", () => {
  const row = (key, kind, standing, work) => ({ key, kind, standing, work });
  const rows = [
    row("a", "spatial", "open", "first"),
    row("b", "spatial", "adjudication", "adjudicate"),
    row("c", "appearance", "open", "second"),
    row("d", "spatial", "sent_back", null),
  ];
  const keys = (kind, missing) => filtered(rows, kind, missing).map((one) => one.key).join("");
  assert.equal(keys("", "mine"), "cab");
  assert.equal(keys("spatial", "mine"), "ab");
  assert.equal(keys("", ""), "cabd");
  assert.equal(keys("", "sent_back"), "d");
  assert.equal(keys("", "adjudicate"), "b");
});

test("standings in words", () => {
  assert.equal(standingWords({ standing: "open", missing: 1 }), "1 of 2 reviews; somebody else gives the second");
  assert.equal(standingWords({ standing: "open", missing: 2 }), "0 of 2 reviews");
  assert.equal(standingWords({ standing: "approved" }), "approved");
});

test("a target moves the others of its axis in proportion", () => {
  const axis = (...shares) => shares.map((wanted, index) => ({ value: "abc"[index], wanted }));
  // Shares before, value, percent, shares after.
  const cases = [
    [[0.5, 0.5], "a", 75, [0.75, 0.25]],
    [[0.2, 0.2, 0.6], "a", 60, [0.6, 0.1, 0.3]],
    [[1, 0, 0], "a", 50, [0.5, 0.25, 0.25]],
    [[0.5, 0.5], "b", 150, [0, 1]],
    [[0.5, 0.5], "b", -5, [1, 0]],
    [[0.5, 0.5], "b", Number.NaN, [1, 0]],
    [[1], "a", 30, [1]],
  ];
  for (const [before, value, percent, expected] of cases) {
    const found = retargeted({ other: { x: 1 } }, "kind", axis(...before), value, percent);
    assert.deepEqual(found.other, { x: 1 });
    const shares = Object.values(found.kind);
    assert.ok(shares.every((share, index) => Math.abs(share - expected[index]) < 1e-9), `${before} ${value} ${percent}: ${shares}`);
  }
});
