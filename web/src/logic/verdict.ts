// The verdict on a revision, folded from the messages of its stages.

import { STAGES, type Problem, type Stage } from "../contract.ts";

export type StageState = "waiting" | "ok" | "warning" | "blocking";

export interface Verdict {
  revision: number;
  /** True while an object is dragged: nothing of it is stored. */
  preview: boolean;
  done: boolean;
  stages: Partial<Record<Stage, Problem[]>>;
}

export interface StageMessage {
  revision: number;
  stage: Stage;
  problems: Problem[];
  done: boolean;
  preview?: boolean;
}

export function empty(revision: number): Verdict {
  return { revision, preview: false, done: false, stages: {} };
}

/** Verdict after a message; one of an older revision changes nothing. */
export function folded(verdict: Verdict, message: StageMessage): Verdict {
  const preview = message.preview ?? false;
  if (message.revision < verdict.revision) return verdict;
  if (!preview && verdict.preview && message.revision === verdict.revision && !message.done) {
    // A stage of the stored state after a drag begins a new verdict.
    return folded(empty(message.revision), message);
  }
  const isNew = message.revision > verdict.revision || preview !== verdict.preview;
  const stages = isNew && !preview ? {} : { ...verdict.stages };
  stages[message.stage] = message.problems;
  return { revision: message.revision, preview, done: message.done && !preview, stages };
}

export function stageState(verdict: Verdict, stage: Stage): StageState {
  const problems = verdict.stages[stage];
  if (!problems) return "waiting";
  if (problems.some((problem) => problem.blocking)) return "blocking";
  return problems.length > 0 ? "warning" : "ok";
}

/** Problems, blocking ones first, else in the order of the stages. */
export function problemsOf(verdict: Verdict): Problem[] {
  const all = STAGES.flatMap((stage) => verdict.stages[stage] ?? []);
  return [...all.filter((problem) => problem.blocking), ...all.filter((problem) => !problem.blocking)];
}

/** Numbers of problems and of warnings, and the words of the first. */
export interface Counted {
  blocking: number;
  warnings: number;
  first: string;
}

export function ranked(problems: Problem[]): Counted {
  const blocking = problems.filter((problem) => problem.blocking);
  return { blocking: blocking.length, warnings: problems.length - blocking.length, first: sentence((blocking[0] ?? problems[0])?.message ?? "") };
}

/** Numbers in words, such as "2 problems, 1 warning". */
export function countedWords({ blocking, warnings }: Counted): string {
  const counted = (count: number, word: string) => (count > 0 ? [`${count} ${word}${count === 1 ? "" : "s"}`] : []);
  return [...counted(blocking, "problem"), ...counted(warnings, "warning")].join(", ");
}

/** Words with a capital at their beginning. */
export function sentence(words: string): string {
  return words.charAt(0).toUpperCase() + words.slice(1);
}

/** Summary for the header and for screen readers. */
export function summary(verdict: Verdict): string {
  const found = countedWords(ranked(problemsOf(verdict)));
  if (!verdict.done) return found ? `${found} so far` : "checking";
  return found || "no problems";
}
