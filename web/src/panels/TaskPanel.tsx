// Instruction, goal and scene graph of the open scenario.

import { useMemo } from "preact/hooks";
import { KINDS, RELATIONS } from "../contract.ts";
import { layoutGraph, NODE, nodeLines } from "../logic/graph.ts";
import { atomWords, edgeWords, endsOfAtom, nameOf } from "../logic/operations.ts";
import { apply } from "../state/edits.ts";
import * as store from "../state/store.ts";
import { Icon, withKeys } from "./widgets.tsx";

/** Width of the drawn graph, in its own units. */
const WIDTH = 366;

export function TaskPanel() {
  const state = store.current.value;
  if (!state) return <section class="task" />;
  const selected = store.selectedId.value;
  return (
    <section class="task" aria-label="Task">
      <div class="row">
        <h2>Instruction</h2>
        <label class="kind">
          <span class="hidden">Kind of task</span>
          <select
            value={state.kind}
            disabled={!store.isEditable.value}
            onChange={(event) => apply({ op: "kind", args: { kind: event.currentTarget.value } })}
          >
            {[...new Set([...KINDS, state.kind])].map((kind) => (
              <option key={kind} value={kind}>
                {kind.replaceAll("_", " ")}
              </option>
            ))}
          </select>
        </label>
        <EditButton action="instruction" words="Edit the instruction" />
      </div>
      <p class="instruction">{state.instruction}</p>
      {state.paraphrases && state.paraphrases.length > 0 && (
        <details>
          <summary>{state.paraphrases.length} paraphrases</summary>
          <ul>
            {state.paraphrases.map((words) => (
              <li key={words}>{words}</li>
            ))}
          </ul>
        </details>
      )}
      <div class="row">
        <h2>Goal</h2>
        <EditButton action="goal" words="Edit the goal" />
      </div>
      <ol class="goal">
        {state.goal.map((atoms, index) => (
          <li key={index}>
            {index > 0 && <span class="muted">or </span>}
            {atoms.map((atom, at) => (
              <span key={at}>
                {at > 0 && <span class="muted"> and </span>}
                <button
                  type="button"
                  class={`link ${endsOfAtom(atom).includes(selected ?? "") ? "lit" : ""}`}
                  onClick={() => store.select(endsOfAtom(atom)[0]!)}
                >
                  {atomWords(atom, state)}
                </button>
              </span>
            ))}
          </li>
        ))}
        {state.goal.length === 0 && <li class="muted">no goal</li>}
      </ol>
      <div class="row">
        <h2>Scene graph</h2>
        <span class="muted key">
          <svg width="22" height="8" aria-hidden="true">
            <line class="edge" x1="0" y1="4" x2="22" y2="4" />
          </svg>
          now
          <svg width="22" height="8" aria-hidden="true">
            <line class="edge goal" x1="0" y1="4" x2="22" y2="4" />
          </svg>
          goal
        </span>
        <EditButton action="edges" words="Edit the scene graph" />
      </div>
      <Graph />
      {state.description && (
        <details>
          <summary>Description of the scene</summary>
          <p>{state.description}</p>
        </details>
      )}
    </section>
  );
}

function EditButton({ action, words }: { action: store.DialogName; words: string }) {
  return (
    <button
      type="button"
      class="quiet"
      aria-label={words}
      title={withKeys(words, action)}
      disabled={!store.isEditable.value}
      onClick={() => (store.dialog.value = action)}
    >
      <Icon name="edit" />
    </button>
  );
}

function Graph() {
  const state = store.current.value!;
  const layout = useMemo(() => {
    const nodes = state.objects.map((object) => ({ id: object.id, name: object.name }));
    // Surfaces of the world are named in edges without being objects.
    for (const edge of [...state.edges, ...state.goal.flat()]) {
      const references = "reference" in edge ? [edge.reference, edge.second_reference] : [];
      for (const id of references) if (id && !nodes.some((node) => node.id === id)) nodes.push({ id, name: nameOf(id, state) });
    }
    return layoutGraph(nodes, state.edges, state.goal, WIDTH);
  }, [state.objects.map((object) => object.id + object.name).join(), state.edges, state.goal]);
  const selected = store.selectedId.value;
  const hovered = store.hoveredId.value;
  const edgeText = state.edges.map((edge) => `${nameOf(edge.subject, state)} ${edgeWords(edge, state)}`).join("; ");
  return (
    <svg class="graph" viewBox={`0 0 ${layout.width} ${layout.height}`} role="group" aria-label={`Scene graph: ${edgeText}`}>
      <defs>
        {["now", "goal", "lit"].map((name) => (
          <marker key={name} id={`arrow-${name}`} viewBox="0 0 8 8" refX="7" refY="4" markerWidth="6.5" markerHeight="6.5" orient="auto-start-reverse">
            <path class={`tip ${name}`} d="M0 .8 7.5 4 0 7.2z" />
          </marker>
        ))}
      </defs>
      {layout.edges.map((edge, index) => {
        const isLit = selected !== null && (edge.from === selected || edge.to === selected);
        return (
          <path
            key={index}
            class={`edge ${edge.isGoal ? "goal" : ""} ${isLit ? "lit" : ""} ${selected && !isLit ? "faint" : ""}`}
            d={edge.path}
            marker-end={`url(#arrow-${isLit ? "lit" : edge.isGoal ? "goal" : "now"})`}
          />
        );
      })}
      {layout.edges.map((edge, index) => {
        const isLit = selected !== null && (edge.from === selected || edge.to === selected);
        return (
          <g key={index} class={`edge-label ${edge.isGoal ? "goal" : ""} ${isLit ? "lit" : ""} ${selected && !isLit ? "faint" : ""}`}>
            <title>{RELATIONS[edge.label] ?? edge.label}</title>
            <text x={edge.labelAt.x} y={edge.labelAt.y + 3.5}>
              {edge.label}
            </text>
          </g>
        );
      })}
      {layout.nodes.map((node) => {
        const object = state.objects.find((one) => one.id === node.id);
        const blocks = store.troubled.value.get(node.id);
        const classes = ["node", object?.role ?? "surface", node.id === selected ? "selected" : "", node.id === hovered ? "hovered" : "", blocks === undefined ? "" : blocks ? "blocking" : "warning"];
        const choose = () => object && store.select(node.id);
        return (
          <g
            key={node.id}
            class={classes.join(" ")}
            role="button"
            tabindex={object ? 0 : -1}
            aria-pressed={node.id === selected}
            aria-label={`${node.name}${object ? `, ${object.role}` : ""}`}
            transform={`translate(${node.x} ${node.y})`}
            onClick={choose}
            onKeyDown={(event) => {
              if (event.key !== "Enter" && event.key !== " ") return;
              event.preventDefault();
              event.stopPropagation();
              choose();
            }}
            onPointerEnter={() => (store.hoveredId.value = node.id)}
            onPointerLeave={() => (store.hoveredId.value = null)}
          >
            <title>{node.name}</title>
            <rect x={-NODE.width / 2} y={-NODE.height / 2} width={NODE.width} height={NODE.height} rx="4" />
            {nodeLines(node.name).map((line, index, all) => (
              <text key={index} y={4 + (index - (all.length - 1) / 2) * 12.5}>
                {line}
              </text>
            ))}
          </g>
        );
      })}
    </svg>
  );
}
