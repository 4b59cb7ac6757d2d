// List of scenarios with a filter by kind and text.

import { computed, signal } from "@preact/signals";
import { useEffect } from "preact/hooks";
import { open } from "../state/connection.ts";
import { setListed } from "../state/shortcuts.ts";
import { dialog, openKey, scenarios } from "../state/store.ts";
import { Icon, withKeys } from "./widgets.tsx";

const text = signal("");
const kind = signal("");

const kinds = computed(() => [...new Set(scenarios.value?.map((row) => row.kind) ?? [])].sort());

const listed = computed(() => {
  const words = text.value.toLowerCase().split(/\s+/).filter(Boolean);
  return (scenarios.value ?? []).filter((row) => {
    if (kind.value && row.kind !== kind.value) return false;
    const all = `${row.id} ${row.instruction} ${row.kind} ${row.source}`.toLowerCase();
    return words.every((word) => all.includes(word));
  });
});

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
          {scenarios.value === null ? "loading" : rows.length === scenarios.value.length ? `${rows.length} scenarios` : `${rows.length} of ${scenarios.value.length}`}
        </p>
      </div>
      <ul>
        {rows.map((row) => (
          <li key={row.key}>
            <button type="button" aria-current={row.key === openKey.value ? "true" : undefined} onClick={() => open(row.key)}>
              <span class="instruction">{row.instruction}</span>
              <span class="muted">
                {row.kind.replaceAll("_", " ")} · {row.objects} objects
                {row.read_only ? " · frozen" : row.revision > 0 ? ` · rev. ${row.revision}` : ""}
              </span>
              <span class="muted id">{row.id}</span>
            </button>
          </li>
        ))}
      </ul>
    </nav>
  );
}
