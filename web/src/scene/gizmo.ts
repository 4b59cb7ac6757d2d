// Handles of the selected object: arrows and a square that move it, rings that turn it.

import {
  BufferGeometry,
  ConeGeometry,
  CylinderGeometry,
  Group,
  Line,
  LineBasicMaterial,
  Mesh,
  MeshBasicMaterial,
  PlaneGeometry,
  Plane,
  Raycaster,
  TorusGeometry,
  Vector3,
  type Object3D,
} from "three";

export type Handle = { mode: "move"; axes: [boolean, boolean, boolean] } | { mode: "turn"; axis: 0 | 1 | 2 };

const COLOURS = [0xd1495b, 0x3c9d5d, 0x3b7dd8];
const PLANE_COLOUR = 0xc9962b;
const AXES = [new Vector3(1, 0, 0), new Vector3(0, 1, 0), new Vector3(0, 0, 1)] as const;

interface Part {
  handle: Handle;
  visible: MeshBasicMaterial;
  shown: Mesh[];
  target: Object3D;
}

export class Gizmo {
  readonly group = new Group();
  private parts: Part[] = [];
  private modes: Record<"move" | "turn", Group> = { move: new Group(), turn: new Group() };
  private mode: "move" | "turn" = "move";

  constructor() {
    this.group.visible = false;
    this.group.add(this.modes.move, this.modes.turn);
    for (const axis of [0, 1, 2] as const) {
      this.addArrow(axis);
      this.addRing(axis);
    }
    this.addSquare();
    this.setMode("move");
  }

  setMode(mode: "move" | "turn"): void {
    this.mode = mode;
    this.modes.move.visible = mode === "move";
    this.modes.turn.visible = mode === "turn";
  }

  /** Leaves out arrows that point at the viewer: a drag along them has no length on the screen. */
  face(view: Vector3): void {
    for (const part of this.parts) {
      const { handle } = part;
      const isArrow = handle.mode === "move" && handle.axes.filter(Boolean).length === 1;
      if (!isArrow) continue;
      const along = Math.abs(view.getComponent(handle.axes.indexOf(true)));
      for (const mesh of [...part.shown, part.target]) mesh.visible = along < 0.95;
    }
  }

  /** Handle under the ray, nearest first. */
  pick(raycaster: Raycaster): Handle | null {
    if (!this.group.visible) return null;
    const targets = this.parts.filter((part) => part.handle.mode === this.mode && part.target.visible);
    const [hit] = raycaster.intersectObjects(targets.map((part) => part.target), false);
    return targets.find((part) => part.target === hit?.object)?.handle ?? null;
  }

  /** Lights one handle. */
  light(handle: Handle | null): void {
    for (const part of this.parts) part.visible.opacity = handle === null || part.handle === handle ? 0.95 : 0.35;
    if (handle === null) for (const part of this.parts) part.visible.opacity = 0.85;
  }

  private material(color: number): MeshBasicMaterial {
    return new MeshBasicMaterial({ color, depthTest: false, depthWrite: false, transparent: true, opacity: 0.85, side: 2, toneMapped: false });
  }

  private addPart(mode: "move" | "turn", handle: Handle, visible: MeshBasicMaterial, shown: Mesh[], target: Mesh): void {
    for (const mesh of shown) mesh.renderOrder = 20;
    // Seen by rays alone: fingers and mice need more room than eyes.
    target.material = new MeshBasicMaterial({ colorWrite: false, depthTest: false, depthWrite: false, side: 2 });
    target.renderOrder = 19;
    this.modes[mode].add(...shown, target);
    this.parts.push({ handle, visible, shown, target });
  }

  private addArrow(axis: 0 | 1 | 2): void {
    const material = this.material(COLOURS[axis]!);
    const shaft = new Mesh(new CylinderGeometry(0.012, 0.012, 0.62, 8), material);
    const head = new Mesh(new ConeGeometry(0.05, 0.17, 16), material);
    const target = new Mesh(new CylinderGeometry(0.09, 0.09, 0.8, 6));
    for (const [mesh, along] of [[shaft, 0.49], [head, 0.88], [target, 0.6]] as const) {
      if (axis === 0) mesh.rotation.z = -Math.PI / 2;
      if (axis === 2) mesh.rotation.x = Math.PI / 2;
      mesh.position.setComponent(axis, along);
    }
    const axes: [boolean, boolean, boolean] = [axis === 0, axis === 1, axis === 2];
    this.addPart("move", { mode: "move", axes }, material, [shaft, head], target);
  }

  private addSquare(): void {
    const material = this.material(PLANE_COLOUR);
    const square = new Mesh(new PlaneGeometry(0.2, 0.2), material);
    const target = new Mesh(new PlaneGeometry(0.28, 0.28));
    for (const mesh of [square, target]) mesh.position.set(0.28, 0.28, 0);
    this.addPart("move", { mode: "move", axes: [true, true, false] }, material, [square], target);
  }

  private addRing(axis: 0 | 1 | 2): void {
    const material = this.material(COLOURS[axis]!);
    const radius = axis === 2 ? 0.85 : 0.68;
    const ring = new Mesh(new TorusGeometry(radius, 0.014, 6, 72), material);
    const target = new Mesh(new TorusGeometry(radius, 0.07, 4, 36));
    for (const mesh of [ring, target]) {
      if (axis === 0) mesh.rotation.y = Math.PI / 2;
      if (axis === 1) mesh.rotation.x = Math.PI / 2;
    }
    this.addPart("turn", { mode: "turn", axis }, material, [ring], target);
  }
}

/** Displacement of a drag along the axes of a handle: from where its ray was to where it is. */
export class DragMeasure {
  private plane = new Plane();
  private start = new Vector3();
  private readonly origin: Vector3;
  private readonly axis: Vector3 | null;
  readonly isPossible: boolean;

  constructor(handle: Handle, origin: Vector3, raycaster: Raycaster, view: Vector3) {
    this.origin = origin.clone();
    if (handle.mode === "turn") {
      this.axis = AXES[handle.axis]!;
      this.plane.setFromNormalAndCoplanarPoint(this.axis, origin);
    } else {
      const [x, y, z] = handle.axes;
      const single = Number(x) + Number(y) + Number(z) === 1;
      this.axis = single ? AXES[x ? 0 : y ? 1 : 2]! : null;
      // A plane that holds the axis and faces the viewer best; a flat drag stays level.
      const normal = this.axis ? view.clone().addScaledVector(this.axis, -view.dot(this.axis)).normalize() : AXES[2]!;
      this.plane.setFromNormalAndCoplanarPoint(normal.lengthSq() > 1e-9 ? normal : AXES[2]!, origin);
    }
    this.isPossible = raycaster.ray.intersectPlane(this.plane, this.start) !== null;
  }

  /** Displacement in metres; null while the ray meets the plane behind the viewer or far away. */
  moved(raycaster: Raycaster): Vector3 | null {
    const at = raycaster.ray.intersectPlane(this.plane, new Vector3());
    if (!at || at.distanceTo(raycaster.ray.origin) > 6) return null;
    const by = at.sub(this.start);
    return this.axis ? this.axis.clone().multiplyScalar(by.dot(this.axis)) : by;
  }

  /** Angle in radians about the axis of a ring. */
  turned(raycaster: Raycaster): number | null {
    const at = raycaster.ray.intersectPlane(this.plane, new Vector3());
    if (!at || !this.axis) return null;
    const from = this.start.clone().sub(this.origin);
    const to = at.sub(this.origin);
    return Math.atan2(this.axis.dot(from.clone().cross(to)), from.dot(to));
  }
}

/** A line along a moved axis or from the middle of a ring, shown during a drag. */
export function guideLine(color: number): Line {
  const geometry = new BufferGeometry().setFromPoints([new Vector3(), new Vector3()]);
  const line = new Line(geometry, new LineBasicMaterial({ color, depthTest: false, transparent: true, opacity: 0.6 }));
  line.renderOrder = 18;
  line.frustumCulled = false;
  return line;
}
