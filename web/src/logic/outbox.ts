// Commands that the server has not acknowledged yet: one in flight, resent until answered, kept over reloads.

import type { Conflict, Operation } from "../contract.ts";
import { fieldsOf } from "./operations.ts";

export interface Entry {
  /** `client_operation_id`: the server applies each id once. */
  id: string;
  /** Key of the scenario. */
  key: string;
  what: "command" | "undo" | "redo" | "revert";
  operation?: Operation;
  /** Command that is taken back by `revert`. */
  revision?: number;
  /** Revision that the author saw. */
  base: number;
  author: string;
  at: string;
  /** True once a request may have reached the server. */
  sent: boolean;
  /** The server's answer that somebody else changed the same field; waits for the author's choice. */
  conflict?: Conflict;
}

/** Entries after `id` was applied as `revision` of scenario `key`: later ones follow our own change. */
export function acknowledged(entries: Entry[], id: string, revision: number, key: string): Entry[] {
  const done = entries.find((entry) => entry.id === id);
  if (!done) return entries;
  const isNext = revision === done.base + 1;
  const changed = done.operation ? fieldsOf(done.operation) : [];
  return entries
    .filter((entry) => entry.id !== id)
    .map((entry) => {
      if (entry.key !== done.key) return entry;
      const own = entry.operation ? fieldsOf(entry.operation) : [];
      // Nobody else changed these fields up to `revision`, or ours would have been a conflict.
      const followsUs = isNext || (own.length > 0 && own.every((field) => changed.includes(field)));
      return { ...entry, key, base: followsUs ? Math.max(entry.base, revision) : entry.base };
    });
}

/** Takes back the newest entry of a scenario that cannot have reached the server; null when there is none. */
export function withdrawn(entries: Entry[], key: string): { rest: Entry[]; entry: Entry } | null {
  const entry = entries.findLast((one) => one.key === key);
  if (!entry || entry.sent || entry.what !== "command") return null;
  return { rest: entries.filter((one) => one !== entry), entry };
}

/** The entry that may be sent now. */
export function nextToSend(entries: Entry[]): Entry | null {
  const [first] = entries;
  return first && !first.conflict ? first : null;
}

/** Answer to one request. */
export type Answer =
  | { is: "applied"; revision: number; key: string }
  | { is: "conflict"; conflict: Conflict }
  | { is: "refused" }
  /** No answer: the server may or may not have it. */
  | { is: "lost" };

/** Entries after an answer. */
export function answered(entries: Entry[], id: string, answer: Answer): Entry[] {
  switch (answer.is) {
    case "applied":
      return acknowledged(entries, id, answer.revision, answer.key);
    case "conflict":
      return entries.map((entry) => (entry.id === id ? { ...entry, conflict: answer.conflict } : entry));
    case "refused":
      return entries.filter((entry) => entry.id !== id);
    case "lost":
      return entries;
  }
}

/** The author's choice: `theirs` drops the command, `mine` sends it again as a new one upon the newer revision. */
export function resolved(entries: Entry[], id: string, choice: "mine" | "theirs", newId: string): Entry[] {
  if (choice === "theirs") return entries.filter((entry) => entry.id !== id);
  return entries.map((entry) =>
    entry.id === id && entry.conflict ? { ...entry, id: newId, base: entry.conflict.revision, sent: false, conflict: undefined } : entry,
  );
}

/** Entries from their stored text; none when the text is no list of entries. */
export function restored(text: string | null): Entry[] {
  try {
    const list: unknown = JSON.parse(text ?? "[]");
    if (!Array.isArray(list)) return [];
    return list.filter((one: Partial<Entry>): one is Entry => Boolean(one && typeof one.id === "string" && typeof one.key === "string"));
  } catch {
    return [];
  }
}

/** Seconds to wait before try `n` (from 0), without jitter. */
export function backoff(n: number): number {
  return Math.min(8, 0.25 * 2 ** n);
}
