// List of scenarios with a filter by kind and text.

import { computed, signal } from "@preact/signals";
import { useEffect } from "preact/hooks";
import { countedWords } from "../logic/verdict.ts";
import { checkAll, faulty, isFaulty, isReplaced, known, left } from "../state/checks.ts";
import { open } from "../state/connection.ts";
import { setListed } from "../state/shortcuts.ts";
import type { ScenarioRow } from "../contract.ts";
import { dialog, openKey, scenarios } from "../state/store.ts";
import { Icon, withKeys } from "./widgets.tsx";

const text = signal("");
const kind = signal("");
/** True to list only scenarios with problems. */
const isFaultyOnly = signal(false);

const kinds = computed(() => [...new Set(scenarios.value?.map((row) => row.kind) ?? [])].sort());

const listed = computed(() => {
  const words = text.value.toLowerCase().split(/\s+/).filter(Boolean);
  return (scenarios.value ?? []).filter((row) => {
    if (kind.value && row.kind !== kind.value) return false;
    const verdict = known(row.key, row.revision);
    if (isFaultyOnly.value && !isFaulty(row) && row.key !== openKey.value) return false;
    const all = `${row.id} ${row.instruction} ${row.kind} ${row.source} ${verdict?.first ?? ""}`.toLowerCase();
    return words.every((word) => all.includes(word));
  });
});

function Checked({ row }: { row: ScenarioRow }) {
  const verdict = known(row.key, row.revision);
  if (!verdict) return null;
  const words = countedWords(verdict);
  if (!words) return <span class="found ok">no problems</span>;
  return (
    <span class={`found ${verdict.blocking > 0 ? "blocking" : "warning"}`} title={verdict.first}>
      <strong>{words}</strong> <span class="first">{verdict.first}</span>
    </span>
  );
}

export function ScenarioList() {
  const rows = listed.value;
  useEffect(() => setListed(rows.map((row) => row.key)), [rows]);
  useEffect(() => {
    document.querySelector(".scenarios [aria-current=true]")?.scrollIntoView({ block: "nearest" });
  }, [openKey.value, rows]);
  return (
    <nav class="scenarios" aria-label="Scenarios">
      <div class="filter">
        <label>
          <span class="hidden">Filter by text</span>
          <input
            id="filter"
            type="search"
            placeholder="Filter ( / )"
            value={text.value}
            onInput={(event) => (text.value = event.currentTarget.value)}
            onKeyDown={(event) => {
              if (event.key === "Escape") event.currentTarget.blur();
              if (event.key === "Enter" && rows[0]) open(rows[0].key);
            }}
          />
        </label>
        <label>
          <span class="hidden">Kind</span>
          <select value={kind.value} onChange={(event) => (kind.value = event.currentTarget.value)}>
            <option value="">all kinds</option>
            {kinds.value.map((name) => (
              <option key={name} value={name}>
                {name.replaceAll("_", " ")}
              </option>
            ))}
          </select>
        </label>
        <p class="muted count">
          <button type="button" class="quiet" title={withKeys("New scenario from one sentence", "new")} onClick={() => (dialog.value = "new")}>
            <Icon name="plus" /> New
          </button>
          {scenarios.value === null ? "Loading" : rows.length === scenarios.value.length ? `${rows.length} scenario${rows.length === 1 ? "" : "s"}` : `${rows.length} of ${scenarios.value.length}`}
        </p>
        <p class="count checks">
          <button type="button" title="Judge every listed scenario, and mark those with problems" disabled={rows.length === 0} onClick={() => void checkAll(rows.map((row) => row.key))}>
            {left.value === null ? "Check all" : `Stop, ${left.value} left`}
          </button>
          {(faulty.value > 0 || isFaultyOnly.value) && (
            <button type="button" aria-pressed={isFaultyOnly.value} onClick={() => (isFaultyOnly.value = !isFaultyOnly.value)}>
              With problems: {faulty.value}
            </button>
          )}
        </p>
      </div>
      <ul>
        {rows.map((row) => (
          <li key={row.key}>
            <button type="button" aria-current={row.key === openKey.value ? "true" : undefined} onClick={() => open(row.key)}>
              <span class="instruction">{row.instruction}</span>
              <span class="muted">
                {row.kind.replaceAll("_", " ")} · {row.objects} objects
                {row.read_only ? (isReplaced(row) ? " · see its copy" : " · frozen") : row.revision > 0 ? ` · rev. ${row.revision}` : ""}
              </span>
              <span class="muted id">{row.id}</span>
              <Checked row={row} />
            </button>
          </li>
        ))}
      </ul>
    </nav>
  );
}
