// List of objects, and the selected one in numbers: everything that the 3-D view can do.

import type { SceneObject } from "../contract.ts";
import { fromEuler, toEuler, type Vector } from "../logic/pose.ts";
import { chooseState, place, setJoints } from "../state/edits.ts";
import { run } from "../state/shortcuts.ts";
import * as store from "../state/store.ts";
import { NumberField, withKeys } from "./widgets.tsx";

const DEGREES = 180 / Math.PI;

export function ObjectsTab() {
  const state = store.current.value;
  if (!state) return null;
  const selected = store.selected.value;
  return (
    <>
      <ul class="objects" aria-label="Objects">
        {state.objects.map((object) => {
          const blocks = store.troubled.value.get(object.id);
          return (
            <li key={object.id}>
              <button
                type="button"
                aria-pressed={object.id === store.selectedId.value}
                class={object.id === store.hoveredId.value ? "hovered" : ""}
                onClick={() => store.select(object.id === store.selectedId.value ? null : object.id)}
                onPointerEnter={() => (store.hoveredId.value = object.id)}
                onPointerLeave={() => (store.hoveredId.value = null)}
              >
                <span class={`role ${object.role}`} aria-hidden="true" />
                <span class="name">{object.name}</span>
                {store.locked.value.has(object.id) && <span class="mark">locked</span>}
                {store.hidden.value.has(object.id) && <span class="mark">hidden</span>}
                {blocks !== undefined && <span class={blocks ? "mark blocking" : "mark warning"}>{blocks ? "problem" : "warning"}</span>}
                <span class="muted kind">{object.role}</span>
                <span class="muted id" title={object.id}>
                  {object.id}
                </span>
              </button>
            </li>
          );
        })}
      </ul>
      {selected ? <Details key={selected.id} object={selected} /> : <p class="muted hint">Select an object here, in the graph or in the view.</p>}
    </>
  );
}

function Details({ object }: { object: SceneObject }) {
  const canEdit = store.isEditable.value && !store.locked.value.has(object.id);
  const euler = toEuler(object.pose.orientation_wxyz);
  const [low, high] = object.bounds_m;
  const setPosition = (axis: number, value: number) => {
    const position = [...object.pose.position_m] as Vector;
    position[axis] = value;
    place(object, { ...object.pose, position_m: position });
  };
  const setAngle = (axis: number, degrees: number) => {
    const angles = [...euler] as Vector;
    angles[axis] = degrees / DEGREES;
    place(object, { ...object.pose, orientation_wxyz: fromEuler(angles) });
  };
  const button = (action: string, words: string, isPossible = canEdit) => (
    <button type="button" disabled={!isPossible} title={withKeys(words, action)} onClick={() => run(action)}>
      {words}
    </button>
  );
  const view = (action: string, words: string, isPressed: boolean) => (
    <button type="button" aria-pressed={isPressed} title={withKeys(words, action)} onClick={() => run(action)}>
      {words}
    </button>
  );
  return (
    <div class="details">
      <h3>
        {object.name} <span class="muted id">{object.id}</span>
      </h3>
      <p class="muted">
        {object.description} {object.graspable ? "" : "The hand cannot grasp it."}
      </p>
      <fieldset class="numbers" disabled={!canEdit}>
        <legend class="hidden">Position and rotation</legend>
        {["x", "y", "z"].map((name, axis) => (
          <NumberField key={name} name={name} label={name} value={object.pose.position_m[axis]!} digits={4} unit="m" step={0.01} onCommit={(value) => setPosition(axis, value)} />
        ))}
        {["roll", "pitch", "yaw"].map((name, axis) => (
          <NumberField key={name} name={name} label={name} value={euler[axis]! * DEGREES} digits={1} unit="deg" step={15} onCommit={(value) => setAngle(axis, value)} />
        ))}
      </fieldset>
      <p class="muted">
        box {[0, 1, 2].map((axis) => `${((high[axis]! - low[axis]!) * 100).toFixed(1)}`).join(" × ")} cm, bottom at {(low[2] * 1000).toFixed(1)} mm
      </p>
      <Joints object={object} canEdit={canEdit} />
      <div class="actions">
        {button("drop", "Drop")}
        {button("duplicate", "Duplicate", store.isEditable.value)}
        {button("swap", "Swap")}
        {button("frame", "Look at it", true)}
        {button("remove", "Remove")}
        {view("lock", "Lock", store.locked.value.has(object.id))}
        {view("hide", "Hide", store.hidden.value.has(object.id))}
      </div>
    </div>
  );
}

function Joints({ object, canEdit }: { object: SceneObject; canEdit: boolean }) {
  const joints = object.joints ?? [];
  if (object.states.length === 0 && joints.length === 0) return null;
  return (
    <fieldset class="joints" disabled={!canEdit}>
      <legend>Joints</legend>
      {object.states.length > 0 && (
        <div class="segments" role="group" aria-label="State">
          {object.states.map((name) => (
            <button key={name} type="button" aria-pressed={object.state === name} onClick={() => chooseState(object, name)}>
              {name}
            </button>
          ))}
        </div>
      )}
      {joints.map((joint, index) => {
        const isHinge = joint.kind === "hinge";
        const factor = isHinge ? DEGREES : 1;
        const value = (object.joint_positions[index] ?? 0) * factor;
        const set = (wanted: number) => {
          const positions = joints.map((_, at) => object.joint_positions[at] ?? 0);
          positions[index] = Math.max(joint.lower, Math.min(joint.upper, wanted / factor));
          setJoints(object, positions);
        };
        return <NumberField key={joint.name} name={`joint-${index}`} label={joint.name} value={value} digits={isHinge ? 1 : 4} unit={isHinge ? "deg" : "m"} step={isHinge ? 5 : 0.01} onCommit={set} />;
      })}
    </fieldset>
  );
}
