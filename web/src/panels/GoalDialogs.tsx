// Forms for the goal and for the edges of the scene graph.

import { useSignal } from "@preact/signals";
import { RELATIONS, type Atom, type GraphEdge, type RelationAtom, type ScenarioState } from "../contract.ts";
import { atomWords } from "../logic/operations.ts";
import { apply } from "../state/edits.ts";
import * as store from "../state/store.ts";
import { FormButtons } from "./dialogs.tsx";
import { Dialog, Icon } from "./widgets.tsx";

interface Props {
  onClose: () => void;
}

export function GoalDialog({ onClose }: Props) {
  const state = store.current.value;
  const goal = useSignal<Atom[][]>(structuredClone(store.current.peek()?.goal ?? []));
  if (!state) return null;
  const isRight = goal.value.length > 0 && goal.value.every((atoms) => atoms.length > 0 && atoms.every(isWhole));
  const save = () => {
    if (JSON.stringify(goal.value) !== JSON.stringify(state.goal)) apply({ op: "goal", args: { goal: goal.value } });
    onClose();
  };
  const setAtoms = (index: number, atoms: Atom[]) => {
    const next = goal.value.map((own, at) => (at === index ? atoms : own));
    goal.value = next.filter((own) => own.length > 0);
  };
  return (
    <Dialog title="Goal" wide onClose={onClose}>
      <form onSubmit={(event) => (event.preventDefault(), save())}>
        <p class="muted">The goal holds when every condition of one alternative holds.</p>
        {goal.value.map((atoms, index) => (
          <fieldset key={index} class="alternative">
            <legend>{goal.value.length > 1 ? `Alternative ${index + 1}` : "Conditions"}</legend>
            {atoms.map((atom, at) => (
              <AtomRow
                key={at}
                atom={atom}
                state={state}
                label={`Condition ${at + 1} of alternative ${index + 1}`}
                onChange={(changed) => setAtoms(index, atoms.map((own, other) => (other === at ? changed : own)))}
                onRemove={() => setAtoms(index, atoms.filter((_, other) => other !== at))}
              />
            ))}
            <AddButton words="Condition" onClick={() => setAtoms(index, [...atoms, newAtom(state)])} />
          </fieldset>
        ))}
        <AddButton words="Alternative" onClick={() => (goal.value = [...goal.value, [newAtom(state)]])} />
        <p class="sentence" aria-live="polite">
          {goal.value.map((atoms) => atoms.map((atom) => atomWords(atom, state)).join(" and ")).join(", or ")}
        </p>
        <FormButtons onClose={onClose} isRight={isRight} />
      </form>
    </Dialog>
  );
}

export function EdgesDialog({ onClose }: Props) {
  const state = store.current.value;
  const edges = useSignal<GraphEdge[]>(structuredClone(store.current.peek()?.edges ?? []));
  const description = useSignal(store.current.peek()?.description ?? "");
  if (!state) return null;
  const isRight = edges.value.every((edge) => isWhole({ test: "relation", ...edge }));
  const save = () => {
    const isDescribedAnew = description.value !== state.description;
    const isSame = JSON.stringify(edges.value) === JSON.stringify(state.edges) && !isDescribedAnew;
    if (!isSame) apply({ op: "edges", args: { edges: edges.value, ...(isDescribedAnew ? { description: description.value } : {}) } });
    onClose();
  };
  return (
    <Dialog title="Scene graph" wide onClose={onClose}>
      <form onSubmit={(event) => (event.preventDefault(), save())}>
        <p class="muted">Relations that hold before the robot moves. Objects without a support here stand on the table.</p>
        <div class="alternative">
          {edges.value.map((edge, index) => (
            <RelationRow
              key={index}
              edge={edge}
              state={state}
              label={`Relation ${index + 1}`}
              onChange={(changed) => (edges.value = edges.value.map((own, at) => (at === index ? changed : own)))}
              onRemove={() => (edges.value = edges.value.filter((_, at) => at !== index))}
            />
          ))}
          <AddButton words="Relation" onClick={() => (edges.value = [...edges.value, newEdge(state)])} />
        </div>
        <label class="field">
          <span>Description of the scene</span>
          <textarea rows={3} value={description.value} onInput={(event) => (description.value = event.currentTarget.value)} />
        </label>
        <FormButtons onClose={onClose} isRight={isRight} />
      </form>
    </Dialog>
  );
}

function newEdge(state: ScenarioState): GraphEdge {
  const subject = store.selectedId.peek() ?? state.objects[0]?.id ?? "";
  const reference = state.objects.find((object) => object.id !== subject)?.id ?? "";
  return { subject, relation: "left", reference };
}

function newAtom(state: ScenarioState): Atom {
  return { test: "relation", ...newEdge(state) };
}

function isWhole(atom: Atom): boolean {
  if (atom.test === "state") return atom.object !== "" && atom.state !== "";
  const ends = [atom.subject, atom.reference, ...(atom.relation === "between" ? [atom.second_reference ?? ""] : [])];
  return ends.every(Boolean) && new Set(ends).size === ends.length;
}

interface RowProps<T> {
  state: ScenarioState;
  label: string;
  onChange: (changed: T) => void;
  onRemove: () => void;
}

function AtomRow({ atom, state, label, onChange, onRemove }: RowProps<Atom> & { atom: Atom }) {
  const withStates = state.objects.filter((object) => object.states.length > 0);
  const test =
    withStates.length > 0 || atom.test === "state" ? (
      <select
        aria-label="Kind of condition"
        value={atom.test}
        onChange={(event) => {
          if (event.currentTarget.value === "relation") onChange(newAtom(state));
          else onChange({ test: "state", object: withStates[0]?.id ?? "", state: withStates[0]?.states[0] ?? "" });
        }}
      >
        <option value="relation">relation</option>
        <option value="state">state</option>
      </select>
    ) : null;
  if (atom.test === "state") {
    const states = state.objects.find((object) => object.id === atom.object)?.states ?? [];
    return (
      <div class="atom" role="group" aria-label={label}>
        {test}
        <Choice label="Object" value={atom.object} options={withStates.map((object) => [object.id, object.name])} onChange={(object) => onChange({ ...atom, object, state: state.objects.find((one) => one.id === object)?.states[0] ?? "" })} />
        <span class="muted">is</span>
        <Choice label="State" value={atom.state} options={states.map((name) => [name, name])} onChange={(name) => onChange({ ...atom, state: name })} />
        <RemoveButton label={label} onClick={onRemove} />
      </div>
    );
  }
  return <RelationRow edge={atom} state={state} label={label} onChange={(edge) => onChange({ ...edge, test: "relation" } as RelationAtom)} onRemove={onRemove} before={test} isGoal />;
}

function RelationRow({ edge, state, label, onChange, onRemove, before, isGoal = false }: RowProps<GraphEdge> & { edge: GraphEdge; before?: preact.ComponentChildren; isGoal?: boolean }) {
  const objects: [string, string][] = state.objects.map((object) => [object.id, nameWithId(object, state)]);
  // Other surfaces of the world can carry, too; the table, on which everything stands, only as a goal.
  const isOnTable = isGoal && ["on", "top"].includes(edge.relation);
  const others = (store.scene.value?.surfaces ?? []).slice(isOnTable ? 0 : 1).map((surface): [string, string] => [surface.id, surface.name ?? surface.id]);
  const setRelation = (relation: string) => {
    const { second_reference: _, ...rest } = edge;
    const third = state.objects.find((object) => object.id !== edge.subject && object.id !== edge.reference)?.id ?? "";
    onChange(relation === "between" ? { ...rest, relation, second_reference: edge.second_reference ?? third } : { ...rest, relation });
  };
  return (
    <div class="atom" role="group" aria-label={label}>
      {before}
      <Choice label="Subject" value={edge.subject} options={objects} onChange={(subject) => onChange({ ...edge, subject })} />
      <Choice label="Relation" value={edge.relation} options={Object.entries(RELATIONS)} onChange={setRelation} />
      <Choice label="Reference" value={edge.reference} options={[...objects, ...others]} onChange={(reference) => onChange({ ...edge, reference })} />
      {edge.relation === "between" && (
        <>
          <span class="muted">and</span>
          <Choice label="Second reference" value={edge.second_reference ?? ""} options={[...objects, ...others]} onChange={(second_reference) => onChange({ ...edge, second_reference })} />
        </>
      )}
      <RemoveButton label={label} onClick={onRemove} />
    </div>
  );
}

function nameWithId(object: ScenarioState["objects"][number], state: ScenarioState): string {
  const isShared = state.objects.some((other) => other.id !== object.id && other.name === object.name);
  return isShared ? `${object.name} (${object.id})` : object.name;
}

interface ChoiceProps {
  label: string;
  value: string;
  options: [string, string][];
  onChange: (value: string) => void;
}

function Choice({ label, value, options, onChange }: ChoiceProps) {
  const all = options.some(([own]) => own === value) ? options : [[value, value || "choose"] as [string, string], ...options];
  return (
    <select aria-label={label} value={value} onChange={(event) => onChange(event.currentTarget.value)}>
      {all.map(([own, words]) => (
        <option key={own} value={own}>
          {words}
        </option>
      ))}
    </select>
  );
}

function AddButton({ words, onClick }: { words: string; onClick: () => void }) {
  return (
    <button type="button" class="quiet" onClick={onClick}>
      <Icon name="plus" /> {words}
    </button>
  );
}

function RemoveButton({ label, onClick }: { label: string; onClick: () => void }) {
  return (
    <button type="button" class="quiet" aria-label={`Remove ${label.toLowerCase()}`} onClick={onClick}>
      <Icon name="close" />
    </button>
  );
}

