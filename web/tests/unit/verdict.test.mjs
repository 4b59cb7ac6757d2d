import assert from "node:assert/strict";
import test from "node:test";
import { empty, folded, problemsOf, stageState, summary } from "../../src/logic/verdict.ts";

const problem = (stage, blocking) => ({ stage, code: "overlap", object: "1", message: "", blocking });
const message = (revision, stage, problems = [], done = false, preview = false) => ({ revision, stage, problems, done, preview });

test("stages add up and a newer revision begins anew", () => {
  let verdict = folded(empty(3), message(3, "wording"));
  verdict = folded(verdict, message(3, "collision", [problem("collision", true)]));
  assert.deepEqual([stageState(verdict, "wording"), stageState(verdict, "collision"), stageState(verdict, "goal")], ["ok", "blocking", "waiting"]);
  assert.equal(summary(verdict), "1 problem so far");
  verdict = folded(verdict, message(4, "wording"));
  assert.deepEqual([verdict.revision, problemsOf(verdict).length, stageState(verdict, "collision")], [4, 0, "waiting"]);
  assert.equal(summary(verdict), "checking");
  assert.equal(summary(folded(verdict, message(4, "goal", [], true))), "no problems");
});

test("an older revision is never shown", () => {
  const verdict = folded(empty(5), message(5, "wording"));
  assert.equal(folded(verdict, message(4, "collision", [problem("collision", true)], true)), verdict);
});

test("a preview is no verdict, and the stored state's verdict replaces it", () => {
  const whole = folded(folded(empty(2), message(2, "wording")), message(2, "goal", [], true));
  const preview = folded(whole, message(2, "collision", [problem("collision", true)], true, true));
  assert.deepEqual([preview.preview, preview.done, stageState(preview, "collision")], [true, false, "blocking"]);
  const again = folded(preview, message(2, "wording"));
  assert.deepEqual([again.preview, problemsOf(again).length], [false, 0]);
});

test("blocking problems come first", () => {
  const verdict = folded(folded(empty(1), message(1, "wording", [problem("wording", false)])), message(1, "reach", [problem("reach", true)], true));
  assert.deepEqual(problemsOf(verdict).map((one) => one.stage), ["reach", "wording"]);
  assert.equal(summary(verdict), "1 problem, 1 warning");
});
