// Cameras as a list and as numbers: pose, projection, lens and sensor.

import { signal } from "@preact/signals";
import { useEffect } from "preact/hooks";
import type { Camera, Distortion, Intrinsics, KnownCameras, Pose } from "../contract.ts";
import { fromEuler, toEuler, type Vector } from "../logic/pose.ts";
import { apply, placeCamera } from "../state/edits.ts";
import { knownCameras, world } from "../state/requests.ts";
import { eyePose } from "../state/shortcuts.ts";
import * as store from "../state/store.ts";
import { keyLabel } from "../logic/keys.ts";
import { NumberField } from "./widgets.tsx";

const DEGREES = 180 / Math.PI;
/** Projection of a new camera where the server names no preset. */
const PLAIN: Intrinsics = { width: 640, height: 360, fx: 480, fy: 480, cx: 319.5, cy: 179.5 };
/** Pose of a new camera while there is no 3-D view: from above the table. */
const ABOVE: Pose = { position_m: [0.5, 0, 1.2], orientation_wxyz: [0, 1, 0, 0] };

const known = signal<KnownCameras>({ presets: [], sensors: [] });

export function CamerasTab() {
  const state = store.current.value;
  const camera = store.camera.value;
  const isOnline = store.isOnline.value;
  useEffect(() => {
    if (isOnline && known.peek().presets.length === 0) void knownCameras().then((all) => (known.value = all), () => undefined);
  }, [isOnline]);
  if (!state) return null;
  return (
    <>
      <ul class="objects" aria-label="Cameras">
        {state.cameras.map((one) => (
          <li key={one.name}>
            <button type="button" aria-pressed={one.name === camera?.name} onClick={() => store.selectCamera(one.name)}>
              <span class="name">{one.name}</span>
              <span class="muted kind">{one.mount === "hand" ? "on hand" : "fixed"}</span>
              <span class="muted id">
                {one.intrinsics.width}×{one.intrinsics.height}
              </span>
            </button>
          </li>
        ))}
      </ul>
      <div class="actions">
        <button type="button" disabled={!store.isEditable.value} title="A new camera that sees what the 3-D view shows" onClick={() => add(state.cameras)}>
          Add camera
        </button>
        <a class="button" href={world(store.openKey.value ?? "")} download title="For genmanip layout and collect: --world FILE">
          Save as world file
        </a>
      </div>
      {camera ? <Numbers key={camera.name} camera={camera} /> : <p class="muted hint">The world has no camera.</p>}
    </>
  );
}

function add(cameras: Camera[]): void {
  let name = "camera";
  for (let number = 2; cameras.some((one) => one.name === name); number++) name = `camera${number}`;
  const preset = known.peek().presets.find((one) => one.name === "d435") ?? known.peek().presets[0];
  const camera = { name, mount: "world" as const, mount_from_camera: eyePose() ?? ABOVE, intrinsics: preset ? resized(preset.intrinsics, PLAIN.width, PLAIN.height) : PLAIN };
  if (apply({ op: "camera", args: { camera } })) store.selectCamera(name);
}

/** The same view in other pixels; pixel centres are at whole numbers. */
export function resized({ width, height, fx, fy, cx, cy }: Intrinsics, toWidth: number, toHeight: number): Intrinsics {
  const [x, y] = [toWidth / width, toHeight / height];
  return { width: toWidth, height: toHeight, fx: fx * x, fy: fy * y, cx: (cx + 0.5) * x - 0.5, cy: (cy + 0.5) * y - 0.5 };
}

const LENS = ["k1", "k2", "p1", "p2", "k3"] as const;

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
  const setSize = (width: number, height: number) => {
    if (width >= 16 && height >= 16) send({ intrinsics: resized(intrinsics, Math.round(width), Math.round(height)) });
  };
  const lens: Distortion = camera.distortion ?? { k1: 0, k2: 0, p1: 0, p2: 0, k3: 0 };
  const setLens = (name: keyof Distortion, value: number) => {
    const distortion = { ...lens, [name]: value };
    send({ distortion: LENS.some((one) => distortion[one] !== 0) ? distortion : undefined });
  };
  const { presets, sensors } = known.value;
  const text = camera.sensor ? JSON.stringify(camera.sensor) : "";
  const sensor = camera.sensor ? (sensors.find((one) => JSON.stringify(one.sensor) === text)?.name ?? "own") : "";
  const number = (name: string, label: string, value: number, digits: number, unit: "m" | "deg" | "", step: number, onCommit: (value: number) => void) => (
    <NumberField key={name} name={`camera-${name}`} label={label} value={value} digits={digits} unit={unit} step={step} onCommit={onCommit} />
  );
  return (
    <div class="details">
      <h3>{camera.name}</h3>
      <p class="muted">{camera.mount === "hand" ? "Pose in the frame of the hand" : "Pose in the world"}; optical axes: x right, y down, z ahead.</p>
      <fieldset class="numbers" disabled={!canEdit}>
        <legend class="hidden">Pose of the camera</legend>
        {["x", "y", "z"].map((name, axis) => number(name, name, pose.position_m[axis]!, 3, "m", 0.05, (value) => setPosition(axis, value)))}
        {["roll", "pitch", "yaw"].map((name, axis) => number(name, name, euler[axis]! * DEGREES, 1, "deg", 5, (value) => setAngle(axis, value)))}
      </fieldset>
      <fieldset class="numbers" disabled={!canEdit}>
        <legend class="hidden">Projection</legend>
        {number("fov", "fov", fieldOfView, 1, "deg", 2, setFieldOfView)}
        {number("width", "width", intrinsics.width, 0, "", 16, (value) => setSize(value, intrinsics.height))}
        {number("height", "height", intrinsics.height, 0, "", 16, (value) => setSize(intrinsics.width, value))}
        {(["fx", "fy", "cx", "cy"] as const).map((name) => number(name, name, intrinsics[name], 1, "", 5, (value) => send({ intrinsics: { ...intrinsics, [name]: value } })))}
      </fieldset>
      <fieldset class="choices" disabled={!canEdit}>
        <legend class="hidden">Device</legend>
        <label>
          <span>Projection of</span>
          <select
            id="camera-preset"
            value=""
            onChange={(event) => {
              const preset = presets.find((one) => one.name === event.currentTarget.value);
              if (preset) send({ intrinsics: preset.intrinsics });
            }}
          >
            <option value="">own numbers</option>
            {presets.map((one) => (
              <option key={one.name} value={one.name}>
                {one.about}
              </option>
            ))}
          </select>
        </label>
        <label>
          <span>Sensor</span>
          <select id="camera-sensor" value={sensor} onChange={(event) => send({ sensor: sensors.find((one) => one.name === event.currentTarget.value)?.sensor })}>
            <option value="">ideal</option>
            {sensor === "own" && <option value="own">own numbers</option>}
            {sensors.map((one) => (
              <option key={one.name} value={one.name}>
                {one.about}
              </option>
            ))}
          </select>
        </label>
      </fieldset>
      <details>
        <summary>Lens</summary>
        <fieldset class="numbers" disabled={!canEdit}>
          <legend class="hidden">Distortion</legend>
          {LENS.map((name) => number(name, name, lens[name], 4, "", 0.01, (value) => setLens(name, value)))}
        </fieldset>
      </details>
      <div class="actions">
        <button type="button" aria-pressed={store.lookThrough.value === camera.name} onClick={() => (store.lookThrough.value = store.lookThrough.value === camera.name ? null : camera.name)}>
          Look through ({keyLabel("camera.look")})
        </button>
        <button type="button" disabled={!canEdit} title="The camera sees what the 3-D view shows" onClick={() => placeCamera(camera, eyePose() ?? camera.world_from_camera)}>
          To this view
        </button>
        <button type="button" disabled={!canEdit} onClick={() => apply({ op: "remove_camera", args: { name: camera.name } })}>
          Remove
        </button>
      </div>
    </div>
  );
}
