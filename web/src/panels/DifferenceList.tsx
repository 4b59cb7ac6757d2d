// Fields in which the open scenario differs from an earlier revision; the 3-D view shows where objects were.

import type { Difference, HistoryLine } from "../contract.ts";
import { edgeWords, nameOf, valueWords } from "../logic/operations.ts";
import { compared } from "../state/difference.ts";
import * as store from "../state/store.ts";
import { withKeys } from "./widgets.tsx";

export function DifferenceList({ lines }: { lines: HistoryLine[] }) {
  const state = store.confirmed.value;
  if (!state) return null;
  const names = new Map(lines.filter((line) => line.snapshot).map((line) => [line.revision, line.snapshot!]));
  const start = store.scene.value?.parent ? "0, the parent" : "0, the start";
  const earlier = Array.from({ length: state.revision }, (_, index) => index);
  const found = compared.value;
  const rows = found ? changesOf(found.changes, { objects: [...state.objects, ...found.before] }, found.cameras, state.cameras.map((camera) => camera.name)) : [];
  return (
    <div class="difference">
      <label>
        <span>Compare with revision</span>
        <select
          id="compare"
          title={withKeys("Compare", "difference")}
          value={store.difference.value ?? ""}
          onChange={(event) => (store.difference.value = event.currentTarget.value === "" ? null : Number(event.currentTarget.value))}
        >
          <option value="">none</option>
          {(earlier.length > 0 ? earlier : [0]).map((number) => (
            <option key={number} value={number}>
              {number === 0 ? start : names.has(number) ? `${number}, ${names.get(number)}` : number}
            </option>
          ))}
        </select>
      </label>
      {store.difference.value !== null && (
        <ul aria-label="Differences">
          {rows.map(([what, words, id]) => (
            <li key={`${what} ${id ?? ""}`}>
              {id && state.objects.some((object) => object.id === id) ? (
                <button type="button" class="link" onClick={() => (store.selectedId.value = id)}>
                  {what}
                </button>
              ) : (
                <strong>{what}</strong>
              )}{" "}
              {words}
            </li>
          ))}
          {found && rows.length === 0 && <li class="muted">Nothing differs.</li>}
          {!found && <li class="muted">Comparing…</li>}
        </ul>
      )}
    </div>
  );
}

type Row = [what: string, words: string, id?: string];

function changesOf(changes: Difference, named: Parameters<typeof nameOf>[1], camerasBefore: string[], camerasNow: string[]): Row[] {
  const rows: Row[] = [];
  const ofObject = (id: string, words: string) => {
    const known = rows.find((row) => row[2] === id);
    if (known) known[1] += `, ${words}`;
    else rows.push([nameOf(id, named), words, id]);
  };
  for (const { id, distance_m } of changes.moved) ofObject(id, `moved by ${(distance_m * 100).toFixed(1)} cm`);
  for (const { id, angle_rad } of changes.turned) ofObject(id, `turned by ${((angle_rad * 180) / Math.PI).toFixed(0)}°`);
  for (const id of changes.articulated) ofObject(id, "joints or state changed");
  for (const id of changes.added) ofObject(id, "is new");
  for (const id of changes.removed) ofObject(id, "is gone");
  for (const field of ["instruction", "kind", "goal", "description"] as const) {
    const change = changes[field];
    if (change) rows.push([field, `was ${valueWords(change[0])}`]);
  }
  const edge = (one: Difference["edges_added"][number]) => `${nameOf(one.subject, named)} ${edgeWords(one, named)}`;
  for (const one of changes.edges_added) rows.push(["scene graph", `has now: ${edge(one)}`]);
  for (const one of changes.edges_removed) rows.push(["scene graph", `had: ${edge(one)}`]);
  for (const name of changes.cameras) rows.push([`camera ${name}`, !camerasBefore.includes(name) ? "is new" : camerasNow.includes(name) ? "changed" : "is gone"]);
  return rows;
}
