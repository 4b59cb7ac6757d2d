import assert from "node:assert/strict";
import test from "node:test";
import { blank, fieldName, fields, median, missing } from "../../src/logic/answers.ts";

const text = { type: "string" };
const POINT = { type: "object", properties: { selected_point: { type: "object", properties: { type: { type: "string", enum: ["grid"] }, label: text } }, turn_deg: { type: "number" } } };
const OBJECT = { type: "object", properties: { number: { type: "integer", enum: [-1, 1, 2] }, color: text } };
const TASKS = { type: "object", properties: { subtasks: { type: "array", items: text } } };

test("an answer begins without a decision, and names what it lacks", () => {
  const cases = [
    [OBJECT, { number: null, color: "" }, "number"],
    [POINT, { selected_point: { type: "grid", label: "" }, turn_deg: 0 }, "label"],
    [TASKS, { subtasks: [] }, null],
    [{ type: "boolean" }, null, "answer"],
    [text, "", "answer"],
    [{}, null, "answer"],
  ];
  for (const [schema, begin, lacks] of cases) {
    assert.deepEqual(blank(schema), begin);
    assert.equal(missing(schema, begin), lacks);
  }
  // Remarks may stay empty; a decision of 0, false or -1 is one.
  assert.equal(missing(OBJECT, { number: -1, color: "" }), null);
  assert.equal(missing({ type: "boolean" }, false), null);
  assert.equal(missing(TASKS, { subtasks: ["Take it.", ""] }), "subtasks");
  assert.equal(missing(POINT, { selected_point: { type: "grid", label: "c3" }, turn_deg: null }), "turn_deg");
  assert.deepEqual(fields(POINT.properties.selected_point).map(([name]) => name), ["label"]);
});

test("names and times are for people", () => {
  assert.equal(fieldName("object_name"), "Object name");
  assert.deepEqual([median([]), median([3]), median([5, 1]), median([9, 1, 2])], [null, 3, 3, 2]);
});
