// The 3-D view with its tools; three.js is loaded after the page is painted.

import { signal, useSignalEffect } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import type { View } from "../scene/view.ts";
import { keyLabel } from "../logic/keys.ts";
import { run, setView } from "../state/shortcuts.ts";
import * as store from "../state/store.ts";
import { posed } from "../state/playback.ts";
import { Timeline } from "./Timeline.tsx";
import { withKeys } from "./widgets.tsx";

const failure = signal<string | null>(null);

export function ViewPanel() {
  const host = useRef<HTMLDivElement>(null);
  const labels = useRef<HTMLDivElement>(null);
  const legend = useRef<SVGSVGElement>(null);
  const shown = useRef<View | null>(null);
  useEffect(() => {
    let isGone = false;
    // After the first paint: making a WebGL context holds up what the page draws.
    void painted()
      .then(() => import("../scene/view.ts"))
      .then(({ View }) => {
        if (isGone) return;
        const view = new View(host.current!);
        view.onFrame = () => {
          placeLabels(view, labels.current);
          turnLegend(view, legend.current);
        };
        shown.current = view;
        setView(view);
        // For tests and for the curious.
        const studio = { figures: () => view.figures(), project: (at: never) => view.project(at), state: () => store.confirmed.peek(), waiting: () => store.entries.peek().length };
        (window as { studio?: unknown }).studio = studio;
        view.request();
      })
      .catch((error: Error) => (failure.value = error.message));
    return () => {
      isGone = true;
      setView(null);
      shown.current?.dispose();
    };
  }, []);
  useSignalEffect(() => {
    void [store.selectedId.value, store.hoveredId.value, store.problems.value];
    shown.current?.request();
  });
  const camera = store.lookThrough.value;
  const tool = (action: string, words: string, isPressed?: boolean) => (
    <button type="button" title={withKeys(words, action)} aria-pressed={isPressed} onClick={() => run(action)}>
      {words}
    </button>
  );
  return (
    <section class="view" aria-label="Layout">
      <div class="host" ref={host}>
        <div class="labels" ref={labels} aria-hidden="true">
          <Labels />
        </div>
      </div>
      <div class="tools" role="toolbar" aria-label="Tools of the 3-D view">
        <div class="group">
          {tool("gizmo.move", "Move", store.gizmoMode.value === "move")}
          {tool("gizmo.turn", "Turn", store.gizmoMode.value === "turn")}
          {tool("snap", "Snap", store.snapping.value)}
        </div>
        <div class="group">
          {tool("view.home", "Table")}
          {tool("view.top", "Top")}
          {tool("view.side", "Side")}
          {tool("view.robot", "Robot")}
        </div>
        <div class="group">{tool("add", "Add object")}</div>
      </div>
      {camera && (
        <div class="through">
          <span>
            through camera <strong>{camera}</strong>
          </span>
          <button type="button" onClick={() => (store.lookThrough.value = null)}>
            Leave ({keyLabel("escape")})
          </button>
        </div>
      )}
      <Timeline />
      <svg class="legend" ref={legend} viewBox="-50 -50 100 100" aria-hidden="true">
        {["far", "robot's left", "up"].map((words, axis) => (
          <g key={words} class={`axis axis-${axis}`}>
            <line x1="0" y1="0" x2="0" y2="0" />
            <text>{words}</text>
          </g>
        ))}
      </svg>
      {!store.current.value && !failure.value && (
        <p class="empty">{store.scenarios.value?.length === 0 ? "No scenario was given to the studio." : "Loading the scenario…"}</p>
      )}
      {failure.value && (
        <p class="empty">
          The 3-D view cannot start: {failure.value}. Everything else works; objects can be moved by their numbers.
        </p>
      )}
    </section>
  );
}

function painted(): Promise<void> {
  return new Promise((resolve) => requestAnimationFrame(() => setTimeout(resolve)));
}

/** Names beside the selected object, the one under the mouse, and those with problems. */
function Labels() {
  const state = store.current.value;
  const ids = new Set([store.selectedId.value, store.hoveredId.value, ...(store.isReplaying.value ? [] : store.troubled.value.keys())]);
  return (
    <>
      {state?.objects
        .filter((object) => ids.has(object.id))
        .map((object) => (
          <span key={object.id} data-id={object.id} class={`label ${object.id === store.selectedId.value ? "selected" : ""} ${store.troubled.value.has(object.id) ? "troubled" : ""}`}>
            {object.name}
          </span>
        ))}
    </>
  );
}

function placeLabels(view: View, host: HTMLElement | null): void {
  const objects = posed.peek()?.objects ?? store.current.peek()?.objects;
  if (!host || !objects) return;
  for (const label of host.children as HTMLCollectionOf<HTMLElement>) {
    const object = objects.find((one) => one.id === label.dataset["id"]);
    const [low, high] = object?.bounds_m ?? [[0, 0, 0], [0, 0, 0]];
    const at = object && !store.isDragging.peek() ? view.project([(low[0]! + high[0]!) / 2, (low[1]! + high[1]!) / 2, high[2]! + 0.015]) : null;
    label.style.display = at ? "block" : "none";
    if (at) label.style.transform = `translate(${at.x.toFixed(1)}px, ${at.y.toFixed(1)}px) translate(-50%, -100%)`;
  }
}

function turnLegend(view: View, legend: SVGSVGElement | null): void {
  if (!legend) return;
  view.directions().forEach(([x, y], axis) => {
    const group = legend.children[axis]!;
    const [line, text] = [group.children[0] as SVGLineElement, group.children[1] as SVGTextElement];
    line.setAttribute("x2", (x * 26).toFixed(1));
    line.setAttribute("y2", (y * 26).toFixed(1));
    text.setAttribute("x", (x * 34).toFixed(1));
    text.setAttribute("y", (y * 34 + 3).toFixed(1));
    text.setAttribute("text-anchor", x > 0.35 ? "start" : x < -0.35 ? "end" : "middle");
    text.style.opacity = Math.hypot(x, y) < 0.25 ? "0" : "1";
  });
}
