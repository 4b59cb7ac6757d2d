// Commands and snapshots of the open scenario, newest first.

import { useSignal } from "@preact/signals";
import { useEffect } from "preact/hooks";
import type { HistoryLine } from "../contract.ts";
import { operationWords } from "../logic/operations.ts";
import { redo, revert, undo } from "../state/edits.ts";
import { history } from "../state/requests.ts";
import { run } from "../state/shortcuts.ts";
import * as store from "../state/store.ts";
import { DifferenceList } from "./DifferenceList.tsx";
import { withKeys } from "./widgets.tsx";

/** Changes when a snapshot was made. */
import { snapshots } from "./dialogs.tsx";

export function HistoryTab() {
  const lines = useSignal<HistoryLine[] | null>(null);
  const key = store.scene.value?.key;
  const revision = store.confirmed.value?.revision;
  const isOnline = store.isOnline.value;
  const made = snapshots.value;
  useEffect(() => {
    if (!key || !isOnline) return;
    let isGone = false;
    void history(key)
      .then((list) => {
        if (!isGone) lines.value = list;
      })
      .catch((error: Error) => store.notify("The history cannot be read.", { hint: error.message, isError: true }));
    return () => {
      isGone = true;
    };
  }, [key, revision, isOnline, made]);
  const state = store.current.value;
  if (!state) return null;
  const waiting = store.entries.value.filter((entry) => entry.key === store.openKey.value);
  return (
    <>
      <div class="actions">
        <button type="button" disabled={!state.can_undo && waiting.length === 0} title={withKeys("Undo", "undo")} onClick={undo}>
          Undo
        </button>
        <button type="button" disabled={!state.can_redo} title={withKeys("Redo", "redo")} onClick={redo}>
          Redo
        </button>
        <button type="button" disabled={!store.isEditable.value} title={withKeys("Name this revision", "snapshot")} onClick={() => run("snapshot")}>
          Name this revision
        </button>
      </div>
      <DifferenceList lines={lines.value ?? []} />
      <ol class="history" aria-label="History, newest first">
        {[...waiting].reverse().map((entry) => (
          <li key={entry.id} class="waiting">
            <span class="muted">waits</span>
            <span>{entry.operation ? operationWords(entry.operation.op, entry.operation.args as never, state) : entry.what}</span>
          </li>
        ))}
        {[...(lines.value ?? [])].reverse().map((line, index) => (
          <li key={index} class={line.snapshot ? "snapshot" : ""}>
            <span class="muted">{line.revision ?? 0}</span>
            <span>
              {line.snapshot ? <strong>{line.snapshot}</strong> : wordsOf(line, state)}
              <span class="muted"> {[line.author, timeOf(line.at)].filter(Boolean).join(", ")}</span>
            </span>
            {line.op && !line.snapshot && (
              <button
                type="button"
                class="quiet"
                disabled={!store.isEditable.value}
                aria-label={`Revert revision ${line.revision}`}
                title="Takes back this command alone"
                onClick={() => revert(line.revision)}
              >
                revert
              </button>
            )}
          </li>
        ))}
        {lines.value?.length === 0 && waiting.length === 0 && <li class="muted">No change yet.</li>}
      </ol>
    </>
  );
}

function wordsOf(line: HistoryLine, state: NonNullable<typeof store.current.value>): string {
  const words = line.op ? operationWords(line.op, line.args, state) : "start";
  if (line.undoes !== undefined && line.undoes !== null) return `undo of ${line.undoes}: ${words}`;
  if (line.redoes !== undefined && line.redoes !== null) return `redo of ${line.redoes}: ${words}`;
  return words;
}

function timeOf(at: string | undefined): string {
  const time = at ? new Date(at) : null;
  if (!time || Number.isNaN(time.getTime())) return "";
  const isToday = time.toDateString() === new Date().toDateString();
  return isToday ? time.toLocaleTimeString([], { hour: "2-digit", minute: "2-digit" }) : time.toLocaleDateString();
}
