// Verdicts on the listed scenarios, so that those with problems are found without opening each.

import { computed, effect, signal } from "@preact/signals";
import type { ScenarioRow } from "../contract.ts";
import { ranked, type Counted } from "../logic/verdict.ts";
import { verdictOf } from "./requests.ts";
import * as store from "./store.ts";

interface Checked extends Counted {
  revision: number;
}

const checked = signal<ReadonlyMap<string, Checked>>(new Map());
/** Number of scenarios that are still to be checked; null unless that is under way. */
export const left = signal<number | null>(null);

/** Verdict on the present revision of a listed scenario; undefined before it is checked. */
export function known(key: string, revision: number): Checked | undefined {
  const found = checked.value.get(key);
  return found?.revision === revision ? found : undefined;
}

/** Ids of scenarios that can be edited: a frozen one of the same id was copied. */
const editable = computed(() => new Set(store.scenarios.value?.filter((row) => !row.read_only).map((row) => row.id)));

/** True if an editable copy takes the place of a frozen scenario. */
export const isReplaced = (row: ScenarioRow) => row.read_only && editable.value.has(row.id);

/** True if a scenario has a problem that blocks, and no copy takes its place. */
export const isFaulty = (row: ScenarioRow) => (known(row.key, row.revision)?.blocking ?? 0) > 0 && !isReplaced(row);

/** Number of such scenarios. */
export const faulty = computed(() => store.scenarios.value?.filter(isFaulty).length ?? 0);

// The open scenario is judged anyway.
effect(() => {
  const verdict = store.verdict.value;
  const key = store.openKey.value;
  if (key && verdict.done && !verdict.preview && verdict.revision === store.confirmed.value?.revision) keep(key, verdict.revision, ranked(store.problems.value));
});

function keep(key: string, revision: number, counted: Counted): void {
  checked.value = new Map([...checked.peek(), [key, { revision, ...counted }]]);
}

/** Checks the listed scenarios that are not checked yet, one after the other; again while it runs: ends it. */
export async function checkAll(keys: string[]): Promise<void> {
  if (left.peek() !== null) {
    left.value = null;
    return;
  }
  const rows = (store.scenarios.peek() ?? []).filter((row) => keys.includes(row.key) && !known(row.key, row.revision));
  for (const [index, row] of rows.entries()) {
    if (index > 0 && left.peek() === null) return;
    left.value = rows.length - index;
    try {
      const { revision, problems } = await verdictOf(row.key);
      keep(row.key, revision, ranked(problems));
    } catch (error) {
      store.notify(`${row.id} cannot be checked.`, { hint: (error as Error).message, isError: true });
      break;
    }
  }
  left.value = null;
  store.status.value = faulty.peek() === 0 ? "No listed scenario has a problem." : `${faulty.peek()} with problems.`;
}
