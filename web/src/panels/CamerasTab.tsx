// Cameras as a list and as numbers.

import type { Camera } from "../contract.ts";
import { fromEuler, toEuler, type Vector } from "../logic/pose.ts";
import { apply } from "../state/edits.ts";
import * as store from "../state/store.ts";
import { keyLabel } from "../logic/keys.ts";
import { NumberField } from "./widgets.tsx";

const DEGREES = 180 / Math.PI;

export function CamerasTab() {
  const state = store.current.value;
  const camera = store.camera.value;
  if (!state) return null;
  return (
    <>
      <ul class="objects" aria-label="Cameras">
        {state.cameras.map((one) => (
          <li key={one.name}>
            <button type="button" aria-pressed={one.name === camera?.name} onClick={() => (store.selectedCamera.value = one.name)}>
              <span class="name">{one.name}</span>
              <span class="muted kind">{one.mount === "hand" ? "on hand" : "fixed"}</span>
              <span class="muted id">
                {one.intrinsics.width}×{one.intrinsics.height}
              </span>
            </button>
          </li>
        ))}
      </ul>
      {camera ? <Numbers key={camera.name} camera={camera} /> : <p class="muted hint">The world has no camera.</p>}
    </>
  );
}

function Numbers({ camera }: { camera: Camera }) {
  const pose = camera.mount_from_camera ?? camera.world_from_camera;
  // The file's own pose must be known to be sent back.
  const canEdit = store.isEditable.value && camera.mount_from_camera !== undefined;
  const euler = toEuler(pose.orientation_wxyz);
  const { intrinsics } = camera;
  const send = (change: Partial<Camera>) => {
    const { world_from_camera: _, ...own } = camera;
    apply({ op: "camera", args: { camera: { ...own, ...change } } });
  };
  const setPosition = (axis: number, value: number) => {
    const position = [...pose.position_m] as Vector;
    position[axis] = value;
    send({ mount_from_camera: { ...pose, position_m: position } });
  };
  const setAngle = (axis: number, degrees: number) => {
    const angles = [...euler] as Vector;
    angles[axis] = degrees / DEGREES;
    send({ mount_from_camera: { ...pose, orientation_wxyz: fromEuler(angles) } });
  };
  const fieldOfView = 2 * Math.atan(intrinsics.width / 2 / intrinsics.fx) * DEGREES;
  const setFieldOfView = (degrees: number) => {
    if (!(degrees > 1 && degrees < 170)) return;
    const fx = intrinsics.width / 2 / Math.tan(degrees / 2 / DEGREES);
    send({ intrinsics: { ...intrinsics, fx, fy: (intrinsics.fy * fx) / intrinsics.fx } });
  };
  return (
    <div class="details">
      <h3>{camera.name}</h3>
      <p class="muted">{camera.mount === "hand" ? "Pose in the frame of the hand" : "Pose in the world"}; optical axes: x right, y down, z ahead.</p>
      <fieldset class="numbers" disabled={!canEdit}>
        <legend class="hidden">Pose of the camera</legend>
        {["x", "y", "z"].map((name, axis) => (
          <NumberField key={name} name={`camera-${name}`} label={name} value={pose.position_m[axis]!} digits={3} unit="m" step={0.05} onCommit={(value) => setPosition(axis, value)} />
        ))}
        {["roll", "pitch", "yaw"].map((name, axis) => (
          <NumberField key={name} name={`camera-${name}`} label={name} value={euler[axis]! * DEGREES} digits={1} unit="deg" step={5} onCommit={(value) => setAngle(axis, value)} />
        ))}
        <NumberField name="fov" label="field of view" value={fieldOfView} digits={1} unit="deg" step={2} onCommit={setFieldOfView} />
      </fieldset>
      <p class="muted">
        fx {intrinsics.fx.toFixed(1)}, fy {intrinsics.fy.toFixed(1)}, cx {intrinsics.cx}, cy {intrinsics.cy} px
      </p>
      <div class="actions">
        <button type="button" aria-pressed={store.lookThrough.value === camera.name} onClick={() => (store.lookThrough.value = store.lookThrough.value === camera.name ? null : camera.name)}>
          Look through ({keyLabel("camera.look")})
        </button>
        <button type="button" disabled={!store.isEditable.value} onClick={() => apply({ op: "remove_camera", args: { name: camera.name } })}>
          Remove
        </button>
      </div>
    </div>
  );
}
