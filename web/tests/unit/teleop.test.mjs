import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import test from "node:test";
import { ARM_KEYS, distanceWords, keptWords, meaning, message, statusWords, TAKE_KEYS, undoneWords } from "../../src/logic/teleop.ts";

const press = (code, more = {}) => ({ code, ctrlKey: false, metaKey: false, altKey: false, ...more });
const status = (more) => ({ phase: "running", held: null, limits: [], success: null, policy: null, note: null, undone: [0, 0], ...more });

test("keys of the arm are those that the server maps, and none has two meanings", () => {
  const source = readFileSync(new URL("../../../crates/teleop/src/device/keyboard.rs", import.meta.url), "utf8");
  const mapped = [...source.matchAll(/\("(\w+)", (?:\d|Control)/g)].map(([, code]) => code);
  const shown = ARM_KEYS.flatMap((one) => one.codes);
  assert.deepEqual([...shown].sort(), mapped.sort());
  const all = [...shown, ...TAKE_KEYS.map((one) => one.code)];
  assert.equal(new Set(all).size, all.length);
});

test("meanings of keys", () => {
  assert.deepEqual(meaning(press("KeyW")), { arm: "KeyW" });
  assert.deepEqual(meaning(press("KeyK")), { command: "keep" });
  assert.equal(meaning(press("KeyR", { ctrlKey: true })), null);
  assert.equal(meaning(press("Tab")), null);
});

test("words of a status", () => {
  const cases = [
    [status({}), true, "The arm follows"],
    [status({}), false, "The arm holds: the keys need the focus, press Tab or click them"],
    [status({ held: "silence", limits: ["joint"] }), true, "The arm holds: no input"],
    [status({ limits: ["lead", "joint"] }), true, "The arm follows; slowed: the arm is blocked or lags behind; a joint is at its limit"],
    [status({ phase: "paused", held: "silence" }), true, "Paused"],
    [status({ phase: "paused", note: "expert has finished: you are in command" }), true, "Paused: expert has finished: you are in command"],
    [status({ policy: "expert", held: "silence" }), true, "expert is in command"],
    [status({ policy: "go_to" }), true, "The arm goes to the target: any key of the arm stops it"],
    [status({ phase: "judged", success: false }), true, "Goal missed: keep it, begin anew or discard it"],
  ];
  for (const [now, hasFocus, words] of cases) assert.equal(statusWords(now, hasFocus), words);
  assert.equal(distanceWords({ distance: 0.0224, unit: "m" }), "2.2 cm");
  assert.equal(distanceWords({ distance: Math.PI / 2, unit: "rad" }), "90°");
  assert.equal(distanceWords({ distance: 0.5, unit: null }), null);
});

test("messages of commands", () => {
  const cases = [
    ["pause", status({}), { type: "pause" }],
    ["pause", status({ phase: "paused" }), { type: "resume" }],
    ["back", status({}), { type: "back" }],
    ["turn", status({}), { type: "hand_over", policy: "expert" }],
    ["turn", status({ policy: "clumsy" }), { type: "take_over" }],
    ["keep", status({}), { type: "keep" }],
    ["trim", null, { type: "keep", trim: true }],
  ];
  for (const [command, now, wanted] of cases) assert.deepEqual(message(command, now, "expert"), wanted);
  const commands = TAKE_KEYS.map((one) => one.command);
  assert.deepEqual([...new Set(cases.map(([command]) => command))].filter((one) => !commands.includes(one)), []);
});

test("what was undone and what was kept is said", () => {
  assert.equal(undoneWords([0, 0]), "");
  assert.equal(undoneWords([2, 10.2]), "; went back 2×, 10.2 s cut");
  assert.equal(keptWords({}), "");
  assert.equal(keptWords({ on: 2, open: 1 }), "2 kept (on), 1 kept (open)");
});
