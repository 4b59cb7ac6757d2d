// Search of the tagged collection: adds an object or swaps the selected one.

import { useSignal } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import type { CatalogueEntry } from "../contract.ts";
import { addObject, swapObject } from "../state/edits.ts";
import { address, catalogue } from "../state/requests.ts";
import * as store from "../state/store.ts";
import { Dialog } from "./widgets.tsx";

interface Props {
  purpose: "add" | "swap";
  onClose: () => void;
}

export function CatalogueDialog({ purpose, onClose }: Props) {
  const object = purpose === "swap" ? store.selected.value : null;
  const text = useSignal("");
  const isGraspable = useSignal(object?.graspable ?? false);
  const found = useSignal<CatalogueEntry[] | null>(null);
  const failure = useSignal<string | null>(null);
  const grid = useRef<HTMLUListElement>(null);
  useEffect(() => {
    const abort = new AbortController();
    const search = async () => {
      try {
        found.value = await catalogue(text.value, isGraspable.value, abort.signal);
        failure.value = null;
      } catch (error) {
        if (!abort.signal.aborted) failure.value = (error as Error).message;
      }
    };
    const timer = setTimeout(() => void search(), found.peek() ? 150 : 0);
    return () => {
      clearTimeout(timer);
      abort.abort();
    };
  }, [text.value, isGraspable.value]);
  const choose = (entry: CatalogueEntry) => {
    if (object) swapObject(object, entry);
    else addObject(entry);
    onClose();
  };
  const onKeyDown = (event: KeyboardEvent) => {
    const items = [...(grid.current?.querySelectorAll("button") ?? [])];
    const at = items.indexOf(document.activeElement as HTMLButtonElement);
    const first = items[0];
    if (!first) return;
    const perRow = Math.max(1, items.filter((item) => item.offsetTop === first.offsetTop).length);
    const by = { ArrowRight: 1, ArrowLeft: -1, ArrowDown: perRow, ArrowUp: -perRow }[event.key];
    if (by === undefined || (at < 0 && event.key !== "ArrowDown")) return;
    event.preventDefault();
    if (at < 0) first.focus();
    else if (at + by < 0) document.getElementById("catalogue-text")?.focus();
    else items[Math.min(items.length - 1, at + by)]?.focus();
  };
  return (
    <Dialog title={object ? `Swap ${object.name} for` : "Add an object"} wide onClose={onClose}>
      <div class="catalogue" onKeyDown={onKeyDown}>
        <div class="row">
          <label class="grow">
            <span class="hidden">Words that describe the object</span>
            <input
              id="catalogue-text"
              type="search"
             
              placeholder="red mug, container, fruit…"
              value={text.value}
              onInput={(event) => (text.value = event.currentTarget.value)}
              onKeyDown={(event) => {
                const [best] = found.value ?? [];
                if (event.key === "Enter" && best) choose(best);
              }}
            />
          </label>
          <label class="check">
            <input type="checkbox" checked={isGraspable.value} onChange={(event) => (isGraspable.value = event.currentTarget.checked)} />
            the hand can grasp it
          </label>
        </div>
        <p class="muted" role="status">
          {failure.value ?? (found.value === null ? "Searching" : found.value.length === 0 ? "Nothing fits these words." : `${found.value.length} objects, best first`)}
        </p>
        <ul ref={grid}>
          {found.value?.map((entry) => (
            <li key={entry.uid}>
              <button type="button" title={entry.description} onClick={() => choose(entry)}>
                <img src={address(entry.thumbnail)} alt="" loading="lazy" width={112} height={84} />
                <span class="name">{entry.name}</span>
                <span class="muted">
                  {entry.category} · {entry.size_m.map((metres) => Math.round(metres * 100)).join("×")} cm
                </span>
              </button>
            </li>
          ))}
        </ul>
      </div>
    </Dialog>
  );
}
