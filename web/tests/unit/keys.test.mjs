import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import test from "node:test";
import { actionOf, BINDINGS, describe, isTyping, keyLabel, printed } from "../../src/logic/keys.ts";

const press = (key, more = {}) => ({ key, ctrlKey: false, metaKey: false, altKey: false, shiftKey: false, ...more });

test("no key has two actions", () => {
  const keys = BINDINGS.flatMap((binding) => binding.keys);
  assert.equal(new Set(keys).size, keys.length);
  assert.equal(new Set(BINDINGS.map((binding) => binding.action)).size, BINDINGS.length);
});

test("key presses", () => {
  const cases = [
    [press("?", { shiftKey: true }), "help", false],
    [press("ArrowLeft"), "move.left", false],
    [press("ArrowLeft", { shiftKey: true }), "move.left", true],
    [press("PageUp", { shiftKey: true }), "move.up", true],
    [press("{", { shiftKey: true }), "turn.left", true],
    [press("]"), "turn.right", false],
    [press("z", { ctrlKey: true }), "undo", false],
    [press("Z", { ctrlKey: true, shiftKey: true }), "redo", false],
    [press("z", { metaKey: true }), "undo", false],
    [press("N", { shiftKey: true }), "object.previous", false],
    [press("n"), "object.next", false],
  ];
  for (const [event, action, fine] of cases) assert.deepEqual(actionOf(event), { action, fine }, describe(event));
  assert.equal(actionOf(press("0")), null);
  assert.equal(actionOf(press("n", { ctrlKey: true })), null);
});

test("shortcuts leave text fields and pressed buttons alone", () => {
  const cases = [
    [{ tagName: "INPUT", type: "search" }, "a", true],
    [{ tagName: "INPUT", type: "checkbox" }, "a", false],
    [{ tagName: "TEXTAREA" }, "Delete", true],
    [{ tagName: "SELECT" }, "a", true],
    [{ tagName: "DIV", isContentEditable: true }, "a", true],
    [{ tagName: "BUTTON" }, "Enter", true],
    [{ tagName: "BUTTON" }, "a", false],
    [{ tagName: "CANVAS" }, "ArrowLeft", false],
    [null, "a", false],
  ];
  for (const [target, key, expected] of cases) assert.equal(isTyping(target, key), expected, JSON.stringify(target));
});

test("keys as printed", () => {
  assert.equal(printed("Ctrl+Shift+z"), "Ctrl Shift Z");
  assert.equal(printed("+"), "+");
  assert.equal(keyLabel("remove"), "Del or ⌫");
});

test("the guide lists every key", () => {
  const guide = readFileSync(new URL("../../../docs/guides/studio.md", import.meta.url), "utf8");
  for (const binding of BINDINGS) {
    const row = guide.split("\n").find((line) => line.startsWith("|") && line.endsWith(`| ${binding.words} |`));
    assert.ok(row, `no row says "${binding.words}"`);
    for (const key of binding.keys) assert.ok(row.includes(`\`${printed(key)}\``), `${binding.words}: ${printed(key)}`);
  }
});
