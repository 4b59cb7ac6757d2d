// Verdicts on the listed scenarios, so that those with problems are found without opening each.

import { computed, effect, signal } from "@preact/signals";
import { ranked, type Counted } from "../logic/verdict.ts";
import { verdictOf } from "./requests.ts";
import * as store from "./store.ts";

interface Checked extends Counted {
  revision: number;
}

const checked = signal<ReadonlyMap<string, Checked>>(new Map());
/** Number of scenarios that are still to be checked; null unless that is under way. */
export const left = signal<number | null>(null);

/** What the verdict on the present revision of a listed scenario said; undefined before it is checked. */
export function known(key: string, revision: number): Checked | undefined {
  const found = checked.value.get(key);
  return found?.revision === revision ? found : undefined;
}

/** Number of listed scenarios with a problem that blocks. */
export const faulty = computed(() => store.scenarios.value?.filter((row) => (known(row.key, row.revision)?.blocking ?? 0) > 0).length ?? 0);

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
