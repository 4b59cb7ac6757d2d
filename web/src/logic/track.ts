// States of an episode: where every link is at a time.

import type { Link, Pose, Scene, SceneObject } from "../contract.ts";
import { compose, inverse, movedBounds } from "./pose.ts";

/** Rows of time (s), opening of the gripper (m) and a pose for each link: the robot's, then the objects'. */
export interface Track {
  frames: number;
  width: number;
  values: Float32Array;
}

export interface Posed {
  robot: Link[];
  objects: SceneObject[];
}

/** Time of the last state, s. */
export function durationOf({ frames, width, values }: Track): number {
  return frames > 0 ? values[(frames - 1) * width]! : 0;
}

/** The last state that is not later than a time. */
export function stateAt({ frames, width, values }: Track, time_s: number): number {
  let [low, high] = [0, Math.max(0, frames - 1)];
  while (low < high) {
    const middle = (low + high + 1) >> 1;
    // States have 32 bits: their times are a little off.
    if (values[middle * width]! <= time_s + 1e-4) low = middle;
    else high = middle - 1;
  }
  return low;
}

/** Robot and objects of a scene in one of the states. */
export function posedAt(scene: Pick<Scene, "robot" | "state">, { width, values }: Track, state: number): Posed {
  let at = state * width + 2;
  const next = (link: Link): Link => {
    const [x, y, z, ...wxyz] = values.subarray(at, at + 7) as unknown as number[];
    at += 7;
    return { ...link, world_from_link: { position_m: [x!, y!, z!], orientation_wxyz: wxyz as Pose["orientation_wxyz"] } };
  };
  const robot = scene.robot.links.map(next);
  const objects = scene.state.objects.map((object) => {
    const links = object.links.map(next);
    const [before, now] = [object.links[0], links[0]];
    if (!before || !now) return object;
    const pose = compose(compose(now.world_from_link, inverse(before.world_from_link)), object.pose);
    return { ...object, links, pose, bounds_m: movedBounds(object.bounds_m, object.pose, pose) };
  });
  return { robot, objects };
}
