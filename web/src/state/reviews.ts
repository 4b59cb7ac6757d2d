// Reviews of the open scenario and the queue, as the server tells them.

import { batch, computed, signal } from "@preact/signals";
import { ABOUT, CRITERIA, SAID, criteriaOf, decided, filtered, toggled, UNMARKED, type Marks, type Review, type ReviewRow, type ReviewState } from "../logic/review.ts";
import { open } from "./connection.ts";
import { json } from "./requests.ts";
import * as store from "./store.ts";

export const rows = signal<ReviewRow[]>([]);
/** True once the queue has been read. */
export const isLoaded = signal(false);
export const kind = signal("");
/** Filter by what is missing; `mine` is all that the reviewer can do. */
export const missing = signal("mine");
export const listed = computed(() => filtered(rows.value, kind.value, missing.value));
export const state = signal<ReviewState | null>(null);
export const marks = signal<Marks>(UNMARKED);
/** Scenarios that the expert tries. */
export const trying = signal<string[]>([]);
let since = 0;
/** Scenario and reviewer of the marks. */
let marked = "";

const path = (key: string) => `/api/reviews/${encodeURIComponent(key)}`;
const who = () => `?reviewer=${encodeURIComponent(store.author.peek())}`;

function told<T>(promise: Promise<T>): Promise<T | null> {
  return promise.catch((error: Error) => {
    store.notify(error.message, { isError: true });
    return null;
  });
}

export async function loadQueue(): Promise<void> {
  const queue = await told(json<{ scenarios: ReviewRow[] }>(`/api/reviews${who()}`));
  if (!queue) return;
  batch(() => {
    rows.value = queue.scenarios;
    isLoaded.value = true;
  });
}

/** Reads the reviews of a scenario; another scenario or reviewer begins without marks. */
export async function load(key: string, isQuiet = false): Promise<void> {
  const now = `${key} ${store.author.peek()}`;
  if (marked !== now) {
    marked = now;
    batch(() => {
      state.value = null;
      marks.value = UNMARKED;
    });
    since = performance.now();
  }
  const asked = json<ReviewState>(path(key) + who());
  const found = await (isQuiet ? asked.catch(() => null) : told(asked));
  if (found && marked === now) state.value = found;
}

/** Scenario that the queue opened last. */
let queued: string | null = null;

/** Opens the next scenario of the filtered queue: its first one, or the one after that which it opened last. */
export async function next(): Promise<void> {
  store.tab.value = "review";
  await loadQueue();
  const list = listed.peek();
  const now = store.openKey.peek();
  const at = now === queued ? list.findIndex((row) => row.key === now) : -1;
  const row = list.slice(at + 1).find((one) => one.key !== now) ?? list.find((one) => one.key !== now);
  if (row) {
    queued = row.key;
    open(row.key);
  } else store.status.value = "Nothing is left in this queue.";
}

export function mark(number: number): boolean {
  if (store.tab.peek() !== "review") return false;
  marks.value = toggled(marks.peek(), number);
  return true;
}

/** Says something about the open scenario; false where that does not apply. */
export function decide(verdict: Review["decision"]["verdict"]): boolean {
  const now = state.peek();
  if (store.tab.peek() !== "review" || !now) return false;
  const found = decided(verdict, marks.peek());
  if ("missing" in found) store.notify(found.missing);
  else void say(now, found.decision, marks.peek());
  return true;
}

async function say(now: ReviewState, decision: Review["decision"], with_: Marks, isBulk = false): Promise<boolean> {
  const said = await told(
    json<ReviewState>(path(now.key), {
      reviewer: { name: store.author.peek(), kind: "human" },
      content_sha256: now.content_sha256,
      decision,
      criteria: isBulk || decision.verdict === "take_back" ? Object.fromEntries(with_.failed.map((one) => [one, false])) : criteriaOf(with_),
      note: with_.note.trim(),
      adjudicates: now.work === "adjudicate" || undefined,
      duration_s: now.key === state.peek()?.key ? Math.round((performance.now() - since) / 100) / 10 : undefined,
      client_operation_id: crypto.randomUUID(),
      at: new Date().toISOString(),
    }),
  );
  if (!said) return false;
  if (store.openKey.peek() === now.key) {
    state.value = said;
    marks.value = UNMARKED;
  }
  store.status.value = `${now.id}: your review is stored (${SAID[decision.verdict]}).`;
  await loadQueue();
  if (decision.verdict === "approve" && !said.trials && !trying.peek().includes(now.key)) void certify(now.key);
  return true;
}

/** Lets the expert try a scenario, as approval needs it. */
export async function certify(key: string): Promise<void> {
  trying.value = [...trying.peek(), key];
  const tried = await told(json<ReviewState>(`${path(key)}/certificate`, { at: new Date().toISOString(), reviewer: store.author.peek() }, 600_000));
  trying.value = trying.peek().filter((one) => one !== key);
  if (!tried) return;
  if (store.openKey.peek() === key) state.value = tried;
  await loadQueue();
}

/** Rejects several scenarios for one reason; answers how many. */
export async function rejectAll(keys: string[], reason: string): Promise<number> {
  let count = 0;
  for (const key of keys) {
    const now = await told(json<ReviewState>(path(key) + who()));
    if (now && (await say(now, { verdict: "reject", reasons: [reason] }, bulkMarks(reason), true))) count += 1;
  }
  return count;
}

/** A criterion of the reason does not hold; nothing else was looked at. */
function bulkMarks(reason: string): Marks {
  return { ...UNMARKED, failed: CRITERIA.filter((criterion) => ABOUT[criterion][1] === reason) };
}
