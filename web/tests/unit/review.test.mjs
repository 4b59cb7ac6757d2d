import assert from "node:assert/strict";
import test from "node:test";
import { criteriaOf, decided, filtered, standingWords, toggled, UNMARKED } from "../../src/logic/review.ts";

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
  assert.equal(standingWords({ standing: "open", missing: 1 }), "one review is missing");
  assert.equal(standingWords({ standing: "open", missing: 2 }), "not reviewed");
  assert.equal(standingWords({ standing: "approved" }), "approved");
});
