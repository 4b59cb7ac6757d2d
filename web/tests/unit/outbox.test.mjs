import assert from "node:assert/strict";
import test from "node:test";
import { answered, backoff, nextToSend, resolved, restored, withdrawn } from "../../src/logic/outbox.ts";

const place = (id) => ({ op: "place", args: { objects: [{ id, pose: { position_m: [0, 0, 0], orientation_wxyz: [1, 0, 0, 0] } }] } });
const entry = (id, operation, more = {}) => ({ id, key: "s", what: "command", operation, base: 3, author: "ada", at: "", sent: false, ...more });

test("what follows our own change is based upon it", () => {
  const entries = [entry("a", place("1")), entry("b", place("1")), entry("c", place("2")), entry("d", place("1"), { key: "other" })];
  const after = answered(entries, "a", { is: "applied", revision: 4, key: "s" });
  assert.deepEqual(after.map(({ id, base }) => [id, base]), [["b", 4], ["c", 4], ["d", 3]]);
});

test("somebody else's change in between stays visible to other fields", () => {
  const entries = [entry("a", place("1")), entry("b", place("1")), entry("c", place("2")), entry("u", undefined, { what: "undo" })];
  const after = answered(entries, "a", { is: "applied", revision: 9, key: "s" });
  assert.deepEqual(after.map(({ id, base }) => [id, base]), [["b", 9], ["c", 3], ["u", 3]]);
});

test("edits of a frozen scenario follow to its copy", () => {
  const after = answered([entry("a", place("1"), { base: 0 }), entry("b", place("1"), { base: 0 })], "a", { is: "applied", revision: 1, key: "copy" });
  assert.deepEqual(after.map(({ key, base }) => [key, base]), [["copy", 1]]);
});

test("a conflict holds the queue until the author has chosen", () => {
  const conflict = { field: "instruction", mine: "a", theirs: "b", revision: 7 };
  const entries = answered([entry("a", place("1"), { sent: true }), entry("b", place("2"))], "a", { is: "conflict", conflict });
  assert.equal(nextToSend(entries), null);
  assert.equal(nextToSend(resolved(entries, "a", "theirs", "n")).id, "b");
  const mine = nextToSend(resolved(entries, "a", "mine", "n"));
  assert.deepEqual([mine.id, mine.base, mine.sent, mine.conflict], ["n", 7, false, undefined]);
});

test("a lost answer keeps the entry and its id", () => {
  const entries = [entry("a", place("1"), { sent: true })];
  assert.equal(nextToSend(answered(entries, "a", { is: "lost" })).id, "a");
  assert.equal(nextToSend(answered(entries, "a", { is: "refused" })), null);
});

test("only what cannot have arrived is taken back", () => {
  const [a, b] = [entry("a", place("1"), { sent: true }), entry("b", place("1"))];
  assert.equal(withdrawn([a, b], "s").entry.id, "b");
  assert.equal(withdrawn([a], "s"), null);
  assert.equal(withdrawn([b], "other"), null);
});

test("stored entries", () => {
  assert.deepEqual(restored(null), []);
  assert.deepEqual(restored("{"), []);
  assert.deepEqual(restored('{"id":1}'), []);
  assert.deepEqual(restored('[1,{"id":"a"},{"id":"a","key":"s"}]'), [{ id: "a", key: "s" }]);
});

test("waiting grows and is bounded", () => {
  assert.deepEqual([0, 1, 2, 10].map(backoff), [0.25, 0.5, 1, 8]);
});
