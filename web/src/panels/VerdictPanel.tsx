// The verdict on the newest revision, stage by stage, with repairs.

import { useSignal } from "@preact/signals";
import { useEffect } from "preact/hooks";
import { STAGES, type Problem, type Repair } from "../contract.ts";
import { sentence, stageState } from "../logic/verdict.ts";
import { applyRepair, repairAll, repairsOf } from "../state/edits.ts";
import * as store from "../state/store.ts";
import { withKeys } from "./widgets.tsx";

const WORDS = { waiting: "waiting", ok: "passed", warning: "warning", blocking: "problem" } as const;

export function VerdictPanel() {
  const verdict = store.verdict.value;
  const problems = store.problems.value;
  const isRepairing = useSignal(false);
  const all = async () => {
    isRepairing.value = true;
    try {
      await repairAll();
    } finally {
      isRepairing.value = false;
    }
  };
  return (
    <section class="verdict" aria-label="Verdict">
      <div class="row">
        <h2>
          Verdict <span class="muted">{verdict.preview ? "while dragging" : store.waiting.value > 0 ? "before the edits that wait" : ""}</span>
        </h2>
        <button type="button" disabled={problems.length === 0 || isRepairing.value || !store.isEditable.value} title={withKeys("Repair all I can", "repair.all")} onClick={() => void all()}>
          {isRepairing.value ? "Repairing…" : "Repair all I can"}
        </button>
      </div>
      <ol class="stages" aria-label="Stages">
        {STAGES.map((stage) => {
          const state = store.current.value ? stageState(verdict, stage) : "waiting";
          return (
            <li key={stage} class={state}>
              <span class="sign" aria-hidden="true" />
              {stage}
              <span class="hidden">: {WORDS[state]}</span>
            </li>
          );
        })}
      </ol>
      <ul class="problems" aria-label="Problems">
        {problems.map((problem) => (
          <ProblemRow key={store.problemKey(problem)} problem={problem} />
        ))}
        {problems.length === 0 && <li class="muted none">{verdict.done ? "Nothing is wrong with this revision." : "Checking this revision."}</li>}
      </ul>
    </section>
  );
}

function ProblemRow({ problem }: { problem: Problem }) {
  const key = store.problemKey(problem);
  const isSelected = store.selectedProblem.value === key;
  const found = useSignal<Repair[] | null>(problem.repairs?.length ? problem.repairs : null);
  const revision = store.verdict.value.revision;
  useEffect(() => {
    if (problem.repairs?.length) {
      found.value = problem.repairs;
      return;
    }
    found.value = null;
    if (!isSelected || store.verdict.value.preview) return;
    let isGone = false;
    void repairsOf(problem)
      .catch(() => [])
      .then((repairs) => {
        if (!isGone) found.value = repairs;
      });
    return () => {
      isGone = true;
    };
  }, [isSelected, revision, problem.repairs]);
  const choose = () => {
    if (problem.object) store.select(problem.object);
    store.selectedProblem.value = key;
  };
  return (
    <li class={`${problem.blocking ? "blocking" : "warning"} ${isSelected ? "selected" : ""}`}>
      <button type="button" class="problem" aria-pressed={isSelected} onClick={choose}>
        <span class="hidden">{problem.blocking ? "Problem" : "Warning"}: </span>
        {sentence(problem.message)} <span class="muted stage">{problem.stage}</span>
      </button>
      <span class="repairs">
        {found.value && withoutTwins(found.value).map((repair) => (
          <button key={repair.label} type="button" disabled={!store.isEditable.value || store.isDragging.value} onClick={() => applyRepair(repair)}>
            {sentence(repair.label)}
          </button>
        ))}
        {isSelected && found.value === null && <span class="muted">Looking for repairs</span>}
        {isSelected && found.value?.length === 0 && <span class="muted">No repair is known: change it by hand</span>}
        {!isSelected && found.value === null && (
          <button type="button" onClick={choose}>
            Show repairs
          </button>
        )}
      </span>
    </li>
  );
}

/** Repairs with different words: two places at the same distance read alike, and the first is the better one. */
function withoutTwins(repairs: Repair[]): Repair[] {
  return repairs.filter((repair, index) => repairs.findIndex((one) => one.label === repair.label) === index);
}
