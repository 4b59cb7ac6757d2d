// Teleoperation: a pad that takes the keys, commands of the take, and what the arm does and why.

import { useEffect, useRef } from "preact/hooks";
import { ARM_KEYS, distanceWords, keptWords, statusWords, TAKE_KEYS, undoneWords } from "../logic/teleop.ts";
import { policy } from "../state/playback.ts";
import * as store from "../state/store.ts";
import * as teleop from "../state/teleop.ts";
import { withKeys } from "./widgets.tsx";

const distance = (next: { distance: number; unit: string | null }) => {
  const words = distanceWords(next);
  return words ? ` (${words} off)` : "";
};

export function TeleopPanel() {
  if (teleop.isActive.value) return <Active />;
  return (
    <div class="actions teleop-start">
      <button type="button" title={withKeys("Move the robot yourself and record it", "teleop")} disabled={!store.isOnline.value || !store.current.value} onClick={() => teleop.begin()}>
        Teleoperate
      </button>
      <button type="button" disabled={!store.isOnline.value || !store.current.value} onClick={() => teleop.begin(policy.value)}>
        Take over from {policy.value}
      </button>
      <span class="muted">{keptWords(teleop.kept.value)}</span>
    </div>
  );
}

function Active() {
  const pad = useRef<HTMLDivElement>(null);
  useEffect(() => {
    pad.current?.focus();
    const look = () => teleop.focus(!document.hidden && document.hasFocus() && document.activeElement === pad.current);
    const lose = () => teleop.focus(false);
    window.addEventListener("blur", lose);
    window.addEventListener("focus", look);
    document.addEventListener("visibilitychange", look);
    window.addEventListener("gamepadconnected", teleop.findGamepads);
    window.addEventListener("gamepaddisconnected", teleop.findGamepads);
    teleop.findGamepads();
    look();
    return () => {
      window.removeEventListener("blur", lose);
      window.removeEventListener("focus", look);
      document.removeEventListener("visibilitychange", look);
      window.removeEventListener("gamepadconnected", teleop.findGamepads);
      window.removeEventListener("gamepaddisconnected", teleop.findGamepads);
      teleop.focus(false);
    };
  }, []);
  const onKey = (down: boolean) => (event: KeyboardEvent) => {
    if (!teleop.key(event, down)) return;
    event.preventDefault();
    event.stopPropagation();
  };
  const goThere = () => {
    teleop.goThere();
    // Keys stop the arm from now on.
    pad.current?.focus();
  };
  const status = teleop.status.value;
  return (
    <section class="teleop" aria-label="Teleoperation">
      <p>{store.current.value?.instruction}</p>
      <div
        ref={pad}
        class="pad"
        role="application"
        tabIndex={0}
        aria-label="Pad: keys move the arm while it has the focus"
        onKeyDown={onKey(true)}
        onKeyUp={onKey(false)}
        onFocus={() => teleop.focus(true)}
        onBlur={() => teleop.focus(false)}
      >
        <dl>
          {ARM_KEYS.map((one) => (
            <div key={one.keys}>
              <dt>{one.keys}</dt>
              <dd>{one.words}</dd>
            </div>
          ))}
        </dl>
      </div>
      <p role="status" aria-live="polite">
        {status ? statusWords(status, teleop.hasFocus.value || teleop.device.value !== "keyboard") : "The simulation starts"}
      </p>
      {/* Both lines keep their place while the simulation starts: the controls below must not move under the pointer. */}
      <p class="two-lines">
        {status ? `${status.conditions[0]} of ${status.conditions[1]} conditions hold` : ""}
        {status?.next && `; next: ${status.next.text}${distance(status.next)}`}
      </p>
      <p class="muted two-lines">
        {status && (
          <>
            take {status.take}, {status.time_s.toFixed(1)} s, {status.late_steps} of {status.steps} steps late; gripper {status.closed ? "closed" : "open"}
            {status.grasped && `, holds ${status.grasped}`}
            {status.contact_n > 2 && `, contact of ${status.contact_n.toFixed(0)} N`}; frame: {status.frame}
            {undoneWords(status.undone)}
          </>
        )}
      </p>
      <label class="field">
        <span>Device</span>
        <select value={String(teleop.device.value)} onChange={({ currentTarget: { value } }) => teleop.choose(value === "keyboard" || value === "space_mouse" ? value : Number(value))}>
          <option value="keyboard">Keyboard</option>
          {teleop.spaceMouse.value && <option value="space_mouse">{teleop.spaceMouse.value.productName}</option>}
          {teleop.gamepads.value.map((one) => (
            <option key={one.index} value={one.index}>
              {one.name}
            </option>
          ))}
        </select>
      </label>
      {teleop.hasHid && !teleop.spaceMouse.value && (
        <div class="actions">
          <button type="button" onClick={teleop.chooseSpaceMouse}>
            Connect a SpaceMouse…
          </button>
        </div>
      )}
      <div class="actions">
        {TAKE_KEYS.map((one) => (
          <button key={one.key} type="button" class={one.command === "keep" ? "primary" : ""} onClick={() => teleop.command(one.command)}>
            {one.words} ({one.key})
          </button>
        ))}
        <button type="button" onClick={teleop.toggleGripper}>
          gripper
        </button>
      </div>
      <div class="actions">
        <button type="button" aria-pressed={store.target.value !== null} title="Handles at the gripper, to be dragged to where it is to go" disabled={!status} onClick={teleop.toggleTarget}>
          Target
        </button>
        <button type="button" title="The planner brings the gripper to the target, around all objects" disabled={!store.target.value || status?.phase === "judged"} onClick={goThere}>
          Go there
        </button>
      </div>
    </section>
  );
}
