// Rotations and poses; quaternions are (w, x, y, z).

import type { Bounds, Pose } from "../contract.ts";

export type Vector = [number, number, number];
export type Quaternion = [number, number, number, number];

export function multiply(a: Quaternion, b: Quaternion): Quaternion {
  const [aw, ax, ay, az] = a;
  const [bw, bx, by, bz] = b;
  return [
    aw * bw - ax * bx - ay * by - az * bz,
    aw * bx + ax * bw + ay * bz - az * by,
    aw * by - ax * bz + ay * bw + az * bx,
    aw * bz + ax * by - ay * bx + az * bw,
  ];
}

export function conjugate([w, x, y, z]: Quaternion): Quaternion {
  return [w, -x, -y, -z];
}

export function normalize(q: Quaternion): Quaternion {
  const length = Math.hypot(...q) || 1;
  return q.map((value) => value / length) as Quaternion;
}

export function rotate(q: Quaternion, v: Vector): Vector {
  const [, x, y, z] = multiply(multiply(q, [0, ...v]), conjugate(q));
  return [x, y, z];
}

/** Rotation by `angle` radians about a unit axis. */
export function aboutAxis(axis: Vector, angle: number): Quaternion {
  const s = Math.sin(angle / 2);
  return [Math.cos(angle / 2), axis[0] * s, axis[1] * s, axis[2] * s];
}

/** Roll, pitch and yaw in radians: rotations about the fixed x, y and z axes, in this order. */
export function toEuler(q: Quaternion): Vector {
  const [w, x, y, z] = normalize(q);
  const sine = Math.max(-1, Math.min(1, 2 * (w * y - z * x)));
  return [
    Math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)),
    Math.asin(sine),
    Math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)),
  ];
}

export function fromEuler([roll, pitch, yaw]: Vector): Quaternion {
  const about = (axis: Vector, angle: number) => aboutAxis(axis, angle);
  return multiply(about([0, 0, 1], yaw), multiply(about([0, 1, 0], pitch), about([1, 0, 0], roll)));
}

/** `a * b`: b given in the frame that a places. */
export function compose(a: Pose, b: Pose): Pose {
  const moved = rotate(a.orientation_wxyz, b.position_m);
  return {
    position_m: add(a.position_m, moved),
    orientation_wxyz: normalize(multiply(a.orientation_wxyz, b.orientation_wxyz)),
  };
}

export function inverse(pose: Pose): Pose {
  const back = conjugate(normalize(pose.orientation_wxyz));
  return { position_m: rotate(back, scale(pose.position_m, -1)), orientation_wxyz: back };
}

export function add(a: Vector, b: Vector): Vector {
  return [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
}

export function subtract(a: Vector, b: Vector): Vector {
  return [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
}

export function scale(a: Vector, factor: number): Vector {
  return [a[0] * factor, a[1] * factor, a[2] * factor];
}

/** Pose moved in the world. */
export function moved(pose: Pose, by: Vector): Pose {
  return { position_m: add(pose.position_m, by), orientation_wxyz: pose.orientation_wxyz };
}

/** Pose turned about a vertical line through `pivot`, by radians. */
export function turned(pose: Pose, angle: number, pivot: Vector = pose.position_m, axis: Vector = [0, 0, 1]): Pose {
  const turn = aboutAxis(axis, angle);
  return {
    position_m: add(pivot, rotate(turn, subtract(pose.position_m, pivot))),
    orientation_wxyz: normalize(multiply(turn, pose.orientation_wxyz)),
  };
}

/** Moves boxes with their object: exact for translations, the box of the turned box otherwise. */
export function movedBounds(bounds: Bounds, from: Pose, to: Pose): Bounds {
  const change = compose(to, inverse(from));
  const low: Vector = [Infinity, Infinity, Infinity];
  const high: Vector = [-Infinity, -Infinity, -Infinity];
  for (let corner = 0; corner < 8; corner++) {
    const point = [0, 1, 2].map((axis) => bounds[(corner >> axis) & 1]![axis]!) as Vector;
    const at = add(change.position_m, rotate(change.orientation_wxyz, point));
    for (let axis = 0; axis < 3; axis++) {
      low[axis] = Math.min(low[axis]!, at[axis]!);
      high[axis] = Math.max(high[axis]!, at[axis]!);
    }
  }
  return [low, high];
}

export function samePose(a: Pose, b: Pose, tolerance = 1e-9): boolean {
  const near = (left: readonly number[], right: readonly number[]) =>
    left.every((value, index) => Math.abs(value - right[index]!) <= tolerance);
  return near(a.position_m, b.position_m) && near(a.orientation_wxyz, b.orientation_wxyz);
}
