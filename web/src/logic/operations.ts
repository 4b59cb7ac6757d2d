// Operations: fields they touch, their effect before the server has answered, and their words.

import { RELATIONS, type Atom, type Camera, type GraphEdge, type Operation, type Pose, type ScenarioState } from "../contract.ts";
import { compose, inverse, movedBounds, toEuler } from "./pose.ts";

/** Fields that an operation changes; two that share none can be applied in either order. */
export function fieldsOf(operation: Operation): string[] {
  switch (operation.op) {
    case "place":
      return operation.args.objects.map((placement) => `objects/${placement.id}/pose`);
    case "state":
      return [`objects/${operation.args.object}/joints`, `objects/${operation.args.object}/state`];
    case "add":
    case "duplicate":
      return [];
    case "remove":
    case "swap":
      return [`objects/${operation.args.object}`];
    case "instruction":
      return ["instruction"];
    case "goal":
      return ["goal"];
    case "edges":
      return ["edges"];
    case "kind":
      return ["kind"];
    case "camera":
      return [`cameras/${operation.args.camera.name}`];
    case "remove_camera":
      return [`cameras/${operation.args.name}`];
  }
}

/** State as it will be once the operation is applied, as far as the page can know. */
export function predict(state: ScenarioState, operation: Operation): ScenarioState {
  switch (operation.op) {
    case "place": {
      const places = new Map(operation.args.objects.map((placement) => [placement.id, placement]));
      const objects = state.objects.map((object) => {
        const placement = places.get(object.id);
        if (!placement) return object;
        const { pose } = placement;
        const change = compose(pose, inverse(object.pose));
        return {
          ...object,
          pose,
          joint_positions: placement.joint_positions ?? object.joint_positions,
          bounds_m: movedBounds(object.bounds_m, object.pose, pose),
          links: object.links.map((link) => ({ ...link, world_from_link: compose(change, link.world_from_link) })),
        };
      });
      return { ...state, objects };
    }
    case "remove": {
      const { object } = operation.args;
      return {
        ...state,
        objects: state.objects.filter((one) => one.id !== object),
        edges: state.edges.filter((edge) => !endsOf(edge).includes(object)),
      };
    }
    case "instruction":
      return { ...state, instruction: operation.args.text };
    case "kind":
      return { ...state, kind: operation.args.kind };
    case "goal": {
      const { goal } = operation.args;
      return { ...state, goal, goal_sentences: goal.map((atoms) => atoms.map((atom) => atomWords(atom, state)).join(" and ")) };
    }
    case "edges":
      return { ...state, edges: operation.args.edges, description: operation.args.description ?? state.description };
    case "camera": {
      const { camera } = operation.args;
      const old = state.cameras.find((one) => one.name === camera.name);
      if (!old && camera.mount !== "world") return state;
      const world = camera.mount === "world" && camera.mount_from_camera ? camera.mount_from_camera : carriedPose(old!, camera.mount_from_camera);
      const now = { ...camera, world_from_camera: world };
      const cameras = old ? state.cameras.map((one) => (one.name === camera.name ? now : one)) : [...state.cameras, now];
      return { ...state, cameras };
    }
    case "remove_camera":
      return { ...state, cameras: state.cameras.filter((camera) => camera.name !== operation.args.name) };
    case "state":
    case "add":
    case "duplicate":
    case "swap":
      return state;
  }
}

/** Pose in the world of a camera that gets another one on its mount. */
function carriedPose(old: Camera, mount_from_camera: Pose | undefined): Pose {
  if (!old.mount_from_camera || !mount_from_camera) return old.world_from_camera;
  return compose(old.world_from_camera, compose(inverse(old.mount_from_camera), mount_from_camera));
}

/** Operation that gives a camera another pose in the world; null while its pose on the mount is unknown. */
export function cameraMoved(camera: Camera, world_from_camera: Pose): Operation | null {
  const { world_from_camera: before, ...own } = camera;
  if (!own.mount_from_camera) return null;
  const mount_from_camera = compose(own.mount_from_camera, compose(inverse(before), world_from_camera));
  return { op: "camera", args: { camera: { ...own, mount_from_camera } } };
}

/** Ids of the objects that an operation changes. */
export function objectsOf(operation: Operation): string[] {
  if (operation.op === "place") return operation.args.objects.map((placement) => placement.id);
  return operation.op === "state" || operation.op === "remove" || operation.op === "swap" ? [operation.args.object] : [];
}

/** Instances at the ends of an edge, the subject first. */
export function endsOf(edge: GraphEdge): string[] {
  return [edge.subject, edge.reference, ...(edge.second_reference ? [edge.second_reference] : [])];
}

/** Instances of an atom, the subject first. */
export function endsOfAtom(atom: Atom): string[] {
  return atom.test === "relation" ? endsOf(atom) : [atom.object];
}

/** Objects that stand on or lie in `id`, and what stands on those. */
export function carriedBy(id: string, edges: GraphEdge[]): string[] {
  const carried: string[] = [];
  const open = [id];
  while (open.length > 0) {
    const below = open.pop()!;
    for (const edge of edges) {
      const isSupport = edge.relation === "on" || edge.relation === "in" || edge.relation === "top";
      if (isSupport && edge.reference === below && edge.subject !== id && !carried.includes(edge.subject)) {
        carried.push(edge.subject);
        open.push(edge.subject);
      }
    }
  }
  return carried;
}

type Named = Pick<ScenarioState, "objects">;

export function nameOf(id: string, state: Named): string {
  return state.objects.find((object) => object.id === id)?.name ?? id;
}

export function atomWords(atom: Atom, state: Named): string {
  if (atom.test === "state") return `the ${nameOf(atom.object, state)} is ${atom.state}`;
  return `the ${nameOf(atom.subject, state)} is ${edgeWords(atom, state)}`;
}

/** Words of a relation without its subject: `to the robot's left of the bowl`. */
export function edgeWords(edge: GraphEdge, state: Named): string {
  const relation = RELATIONS[edge.relation] ?? edge.relation;
  const second = edge.second_reference ? ` and the ${nameOf(edge.second_reference, state)}` : "";
  return `${relation} the ${nameOf(edge.reference, state)}${second}`;
}

/** Words of an operation for the history and for what waits. */
export function operationWords(op: string, args: Record<string, unknown> | undefined, state: Named): string {
  const name = (id: unknown) => (typeof id === "string" ? nameOf(id, state) : "");
  switch (op) {
    case "place": {
      const objects = (args?.["objects"] ?? []) as { id: string }[];
      const [first] = objects;
      const more = objects.length > 1 ? ` and ${objects.length - 1} more` : "";
      return `place ${first ? name(first.id) : "objects"}${more}`;
    }
    case "add":
      return `add ${name(args?.["id"]) || assetOf(args?.["asset"])}`;
    case "state":
      return `set ${name(args?.["object"])} ${String(args?.["state"] ?? "joints")}`;
    case "insert":
    case "exchange":
      return "put an object back";
    case "remove":
      return `remove ${name(args?.["object"])}`;
    case "duplicate":
      return `duplicate ${name(args?.["object"])}`;
    case "swap":
      return `swap ${name(args?.["object"])} for ${assetOf(args?.["uid"])}`;
    case "instruction":
      return "change the instruction";
    case "goal":
      return "change the goal";
    case "edges":
      return "change the scene graph";
    case "kind":
      return `set the kind to ${String(args?.["kind"] ?? "").replaceAll("_", " ")}`;
    case "camera":
      return `set the camera ${(args?.["camera"] as { name?: string } | undefined)?.name ?? ""}`;
    case "remove_camera":
      return `remove the camera ${String(args?.["name"] ?? "")}`;
    default:
      return op.replaceAll("_", " ");
  }
}

function assetOf(asset: unknown): string {
  if (typeof asset === "string") return asset;
  return (asset as { uid?: string } | undefined)?.uid ?? "an object";
}

/** A value of a conflict as people read it. */
export function valueWords(value: unknown): string {
  if (value === null || value === undefined) return "removed";
  if (typeof value === "string") return value;
  const pose = ((value as { pose?: unknown }).pose ?? value) as { position_m?: number[]; orientation_wxyz?: [number, number, number, number] };
  if (Array.isArray(pose.position_m)) {
    const at = pose.position_m.map((metres) => metres.toFixed(3)).join(", ");
    const yaw = pose.orientation_wxyz ? `, turned ${((toEuler(pose.orientation_wxyz)[2] * 180) / Math.PI).toFixed(1)}°` : "";
    return `at ${at} m${yaw}`;
  }
  return JSON.stringify(value);
}
