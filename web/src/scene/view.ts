// The 3-D view: one WebGL renderer that draws when something changed.

import {
  Color,
  NoToneMapping,
  PCFShadowMap,
  PerspectiveCamera,
  Quaternion,
  Raycaster,
  Scene as ThreeScene,
  Vector2,
  Vector3,
  WebGLRenderer,
  Object3D,
  Mesh,
} from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";
import { effect, untracked } from "@preact/signals";
import type { Bounds, Camera, Placement, Pose, Scene, SceneObject } from "../contract.ts";
import { add, movedBounds, turned, type Vector } from "../logic/pose.ts";
import { snapMove, snapTurn } from "../logic/snap.ts";
import { preview } from "../state/connection.ts";
import { apply, placeCamera, placements } from "../state/edits.ts";
import { ghosts } from "../state/difference.ts";
import { episode, isLive, isPlaying, posed } from "../state/playback.ts";
import * as store from "../state/store.ts";
import { theme } from "../state/theme.ts";
import { Detail, drawsInSoftware } from "./detail.ts";
import { Frustums, Furniture, Lights, lookThroughCamera, readPalette, setPose, type Palette } from "./fixtures.ts";
import { DragMeasure, Gizmo, type Handle } from "./gizmo.ts";
import { ghostly, Items, type Highlight } from "./items.ts";
import { MeshCache } from "./meshes.ts";

Object3D.DEFAULT_UP.set(0, 0, 1);

/** Views by name: direction from the middle of the table to the eye, and distance in metres. */
const VIEWS: Record<string, { from: Vector; distance: number }> = {
  home: { from: [0.86, 0.17, 0.62], distance: 1.6 },
  top: { from: [0.001, 0, 1], distance: 1.7 },
  side: { from: [0.02, 0.9, 0.5], distance: 1.6 },
  robot: { from: [-0.75, 0.02, 0.75], distance: 1.9 },
};

/** The dragged thing: an object with those that stand on it, a camera, or without both the target of teleoperation. */
interface Target {
  object?: SceneObject;
  camera?: Camera;
  name: string;
  pose: Pose;
  bounds_m: Bounds;
}

interface Drag {
  target: Target;
  handle: Handle;
  measure: DragMeasure;
  neighbours: { id: string; bounds: Bounds }[];
  pose: Pose;
  pointer: number;
}

export class View {
  private renderer: WebGLRenderer;
  private scene = new ThreeScene();
  private eye = new PerspectiveCamera(38, 1, 0.02, 30);
  private through = new PerspectiveCamera(38, 1, 0.01, 20);
  private controls: OrbitControls;
  private raycaster = new Raycaster();
  private resolution = new Vector2(1, 1);
  private cache = new MeshCache();
  private lights = new Lights();
  private furniture = new Furniture();
  private frustums = new Frustums();
  private gizmo = new Gizmo();
  private objects: Items;
  private robot: Items;
  /** Objects as they were in the revision that is compared with. */
  private ghosts: Items;
  private palette: Palette;
  private drag: Drag | null = null;
  private press: { x: number; y: number; pointer: number } | null = null;
  private shownKey: string | null = null;
  private isRequested = false;
  private detail: Detail;
  private disposals: (() => void)[] = [];
  /** Called after each frame, to move labels along. */
  onFrame: () => void = () => undefined;

  constructor(private readonly host: HTMLElement) {
    const isSoftware = drawsInSoftware();
    this.renderer = new WebGLRenderer({ antialias: !isSoftware, powerPreference: "high-performance" });
    this.renderer.shadowMap.enabled = true;
    this.renderer.shadowMap.type = PCFShadowMap;
    this.renderer.shadowMap.autoUpdate = false;
    this.renderer.toneMapping = NoToneMapping;
    const canvas = this.renderer.domElement;
    canvas.tabIndex = 0;
    canvas.setAttribute("role", "application");
    canvas.setAttribute("aria-label", "3-D view of the scenario. All that can be done here is also in the list of objects.");
    host.prepend(canvas);
    this.palette = readPalette(host);
    // Meshes arrive one after the other: they are drawn together.
    let arrival: ReturnType<typeof setTimeout> | undefined;
    const changed = () => {
      clearTimeout(arrival);
      arrival = setTimeout(() => this.changedShape(), 60);
    };
    this.objects = new Items(this.cache, this.resolution, changed);
    this.robot = new Items(this.cache, this.resolution, changed);
    this.ghosts = new Items(this.cache, this.resolution, changed, ghostly());
    this.scene.add(this.ghosts.group, this.lights, this.furniture, this.frustums, this.objects.group, this.robot.group, this.gizmo.group);
    this.controls = new OrbitControls(this.eye, canvas);
    this.controls.zoomToCursor = true;
    this.controls.minDistance = 0.12;
    this.controls.maxDistance = 5;
    this.controls.maxPolarAngle = Math.PI * 0.55;
    this.controls.addEventListener("change", () => this.request());
    this.controls.addEventListener("start", () => this.detail.begin());
    this.controls.addEventListener("end", () => this.detail.end());
    this.detail = new Detail(this.renderer, this.lights, () => this.request(), isSoftware);
    this.look("home");
    this.listen(canvas);
    this.follow();
    const observer = new ResizeObserver(() => this.resize());
    observer.observe(host);
    this.disposals.push(() => observer.disconnect());
    this.resize();
  }

  dispose(): void {
    for (const end of this.disposals) end();
    this.objects.clear();
    this.robot.clear();
    this.ghosts.clear();
    this.controls.dispose();
    this.renderer.dispose();
    this.renderer.domElement.remove();
  }

  /** Figures for tests: what the renderer holds. */
  figures(): { geometries: number; textures: number; meshes: number; frames: number } {
    const { memory, render } = this.renderer.info;
    return { geometries: memory.geometries, textures: memory.textures, meshes: this.cache.size, frames: render.frame };
  }

  request(): void {
    if (this.isRequested) return;
    this.isRequested = true;
    requestAnimationFrame(() => {
      this.isRequested = false;
      this.draw();
    });
  }

  /** Looks at the table from a named side. */
  look(name: string): void {
    const { from, distance } = VIEWS[name]!;
    const workspace = store.scene.peek()?.workspace ?? { x: [0.2, 0.9], y: [-0.5, 0.5] };
    const target = new Vector3((workspace.x[0] + workspace.x[1]) / 2 - 0.06, (workspace.y[0] + workspace.y[1]) / 2, 0.05);
    this.controls.target.copy(target);
    this.eye.position.copy(new Vector3(...from).normalize().multiplyScalar(distance).add(target));
    this.controls.update();
    this.request();
  }

  /** Looks at an object from where the eye is. */
  frame(object: SceneObject): void {
    const middle = middleOf(object);
    const [low, high] = object.bounds_m;
    const size = Math.hypot(high[0] - low[0], high[1] - low[1], high[2] - low[2]);
    const direction = this.eye.position.clone().sub(this.controls.target).normalize();
    this.controls.target.copy(middle);
    this.eye.position.copy(middle).addScaledVector(direction, Math.max(0.3, size * 3));
    this.controls.update();
  }

  orbit(angle: number): void {
    const offset = this.eye.position.clone().sub(this.controls.target).applyAxisAngle(new Vector3(0, 0, 1), angle);
    this.eye.position.copy(this.controls.target).add(offset);
    this.controls.update();
  }

  zoom(factor: number): void {
    const offset = this.eye.position.clone().sub(this.controls.target).multiplyScalar(factor);
    offset.clampLength(this.controls.minDistance, this.controls.maxDistance);
    this.eye.position.copy(this.controls.target).add(offset);
    this.controls.update();
  }

  /** World axis that is nearest to a direction of the view: `right` and `far` on the table. */
  axisOf(direction: "right" | "far"): Vector {
    const camera = this.camera();
    const forward = camera.getWorldDirection(new Vector3());
    const flat = direction === "far" ? forward : forward.clone().cross(new Vector3(0, 0, 1));
    if (Math.hypot(flat.x, flat.y) < 0.05) {
      // From straight above the image's own axes decide.
      flat.set(0, 1, 0).applyQuaternion(camera.quaternion);
      if (direction === "right") flat.cross(new Vector3(0, 0, 1));
    }
    return Math.abs(flat.x) >= Math.abs(flat.y) ? [Math.sign(flat.x), 0, 0] : [0, Math.sign(flat.y), 0];
  }

  /** Place of a world point in the host, in CSS pixels; null behind the eye. */
  project(point: Vector): { x: number; y: number } | null {
    const at = new Vector3(...point).project(this.camera());
    if (at.z > 1 || at.z < -1) return null;
    const { left, top, width, height } = this.port();
    return { x: left + ((at.x + 1) / 2) * width, y: top + ((1 - at.y) / 2) * height };
  }

  /** Directions of the world's axes in the image, for the legend. */
  directions(): [number, number][] {
    const inverse = this.camera().quaternion.clone().invert();
    return [0, 1, 2].map((axis) => {
      const direction = new Vector3().setComponent(axis, 1).applyQuaternion(inverse);
      return [direction.x, -direction.y];
    });
  }

  /** Pose of a camera that sees what the view shows. */
  eyePose(): Pose {
    const { position, quaternion } = this.camera();
    // From OpenGL's axes to optical ones: y down, z ahead.
    const { w, x, y, z } = quaternion.clone().multiply(new Quaternion(1, 0, 0, 0));
    return { position_m: position.toArray(), orientation_wxyz: [w, x, y, z] };
  }

  /** Ends a drag without a change. */
  cancelDrag(): boolean {
    if (!this.drag) return false;
    this.endDrag();
    this.sync();
    return true;
  }

  private camera(): PerspectiveCamera {
    return store.lookThrough.peek() ? this.through : this.eye;
  }

  /** Part of the host that the image fills, CSS pixels: all of it, or the shape of the dataset's image. */
  private port(): { left: number; top: number; width: number; height: number } {
    const { clientWidth: width, clientHeight: height } = this.host;
    const name = store.lookThrough.peek();
    const camera = name ? store.current.peek()?.cameras.find((one) => one.name === name) : undefined;
    if (!camera) return { left: 0, top: 0, width, height };
    const ratio = camera.intrinsics.width / camera.intrinsics.height;
    const fitted = Math.min(width, height * ratio);
    return { left: (width - fitted) / 2, top: (height - fitted / ratio) / 2, width: fitted, height: fitted / ratio };
  }

  private resize(): void {
    const { clientWidth: width, clientHeight: height } = this.host;
    if (width === 0 || height === 0) return;
    this.renderer.setSize(width, height);
    this.eye.aspect = width / height;
    this.eye.updateProjectionMatrix();
    this.resolution.set(width, height);
    this.draw();
  }

  private draw(): void {
    this.detail.prepare();
    const camera = this.camera();
    const name = store.lookThrough.peek();
    const shown = name ? store.current.peek()?.cameras.find((one) => one.name === name) : undefined;
    if (shown) lookThroughCamera(this.through, shown);
    const { left, top, width, height } = this.port();
    this.renderer.setViewport(left, this.host.clientHeight - top - height, width, height);
    this.frustums.hideNear(camera.position);
    if (this.gizmo.group.visible) {
      const distance = camera.position.distanceTo(this.gizmo.group.position);
      const factor = shown ? (0.16 * distance * shown.intrinsics.height) / (2 * shown.intrinsics.fy * 0.34) : 0.16 * distance;
      this.gizmo.group.scale.setScalar(factor);
      this.gizmo.face(camera.position.clone().sub(this.gizmo.group.position).normalize());
    }
    this.renderer.render(this.scene, camera);
    this.detail.drawn();
    this.onFrame();
  }

  private changedShape(): void {
    this.renderer.shadowMap.needsUpdate = true;
    this.detail.rest();
    this.request();
  }

  /** Follows the page's signals. */
  private follow(): void {
    const on = (run: () => void | (() => void)) => this.disposals.push(effect(run));
    on(() => {
      void store.current.value;
      void store.scene.value;
      void episode.value;
      void isLive.value;
      untracked(() => this.sync());
    });
    on(() => {
      const shown = ghosts.value;
      untracked(() => {
        this.count(this.ghosts.update(shown, new Set()));
        this.request();
      });
    });
    on(() => {
      if (posed.value) untracked(() => this.play());
    });
    on(() => {
      if (!isPlaying.value) return;
      this.detail.begin();
      return () => this.detail.end();
    });
    on(() => {
      void theme.value;
      untracked(() => {
        this.palette = readPalette(this.host);
        this.scene.background = new Color(this.palette.background);
        this.furniture.paint(this.palette);
        this.highlight();
        this.showCameras();
        this.request();
      });
    });
    on(() => {
      void [store.selectedId.value, store.hoveredId.value, store.troubled.value, store.locked.value, store.hidden.value];
      untracked(() => this.highlight());
    });
    on(() => {
      void [store.selectedCamera.value, store.tab.value, store.isEditable.value];
      untracked(() => this.showCameras());
    });
    on(() => {
      this.controls.enabled = store.lookThrough.value === null;
      untracked(() => this.showCameras());
    });
    on(() => {
      void store.target.value;
      untracked(() => this.highlight());
    });
    on(() => {
      this.gizmo.setMode(store.gizmoMode.value);
      this.request();
    });
  }

  private sync(): void {
    const played = posed.peek();
    const scene = episode.peek()?.scene ?? store.scene.peek();
    const objects = played?.objects ?? store.current.peek()?.objects;
    if (!scene || !objects) {
      this.objects.clear();
      this.changedShape();
      return;
    }
    const loading: Promise<unknown>[] = [];
    if (scene.key !== this.shownKey) this.showScene(scene);
    if (played) this.cancelDrag();
    const dragged = this.drag?.target.object;
    const held = new Set(dragged ? placements(dragged, this.drag!.pose).map((placement) => placement.id) : []);
    loading.push(...this.objects.update(objects, held));
    this.robot.item(scene.robot.name).update({ position_m: [0, 0, 0], orientation_wxyz: [1, 0, 0, 0] }, played?.robot ?? scene.robot.links, loading);
    this.count(loading);
    this.highlight();
    this.showCameras();
    this.changedShape();
  }

  /** Shows another time of the open episode or of the take. */
  private play(): void {
    const { objects, robot } = posed.peek()!;
    const loading: Promise<unknown>[] = [];
    this.objects.update(objects, new Set());
    const scene = (episode.peek()?.scene ?? store.scene.peek())!;
    this.robot.item(scene.robot.name).update({ position_m: [0, 0, 0], orientation_wxyz: [1, 0, 0, 0] }, robot, loading);
    this.changedShape();
  }

  private showScene(scene: Scene): void {
    this.cancelDrag();
    for (const [name, item] of [...this.robot.byId]) {
      if (name === scene.robot.name) continue;
      item.dispose();
      this.robot.byId.delete(name);
    }
    this.furniture.show(scene, this.palette);
    this.shownKey = scene.key;
  }

  private count(loading: Promise<unknown>[]): void {
    const [loaded, wanted] = store.meshes.peek();
    const fresh = loaded === wanted;
    store.meshes.value = [fresh ? 0 : loaded, (fresh ? 0 : wanted) + loading.length];
    for (const one of loading) {
      one
        .catch((error: Error) => store.notify("A mesh is missing.", { hint: error.message, isError: true }))
        .finally(() => (store.meshes.value = [store.meshes.peek()[0] + 1, store.meshes.peek()[1]]));
    }
  }

  private highlight(): void {
    const selected = store.selectedId.peek();
    const hovered = store.hoveredId.peek();
    const troubled = store.isReplaying.peek() ? new Map<string, boolean>() : store.troubled.peek();
    for (const [id, item] of this.objects.byId) {
      const blocks = troubled.get(id);
      const trouble: Highlight = blocks === undefined ? null : blocks ? "danger" : "warning";
      const highlight: Highlight = id === selected ? "selected" : id === hovered ? "hovered" : trouble;
      const { accent, muted, danger, warning } = this.palette;
      item.setHighlight(highlight, { selected: accent, hovered: muted, danger, warning, none: muted }[highlight ?? "none"]);
    }
    for (const [id, item] of this.objects.byId) item.group.visible = !store.hidden.peek().has(id);
    this.placeGizmo();
    this.request();
  }

  /** The thing that the handles move: the target of teleoperation, the selected object, or the selected camera while the cameras are listed. */
  private target(): Target | null {
    const goal = store.target.peek();
    if (goal) return { name: "target", pose: goal, bounds_m: [goal.position_m, goal.position_m] };
    if (!store.isEditable.peek()) return null;
    const object = store.selected.peek();
    if (object) {
      const isFixed = store.locked.peek().has(object.id) || store.hidden.peek().has(object.id);
      return isFixed ? null : { object, name: object.name, pose: object.pose, bounds_m: object.bounds_m };
    }
    const camera = store.tab.peek() === "cameras" && !store.lookThrough.peek() ? store.camera.peek() : null;
    if (!camera?.mount_from_camera) return null;
    const { position_m } = camera.world_from_camera;
    return { camera, name: camera.name, pose: camera.world_from_camera, bounds_m: [position_m, position_m] };
  }

  private placeGizmo(): void {
    const target = this.drag?.target ?? this.target();
    this.gizmo.group.visible = target !== null;
    if (!target) return;
    const pose = this.drag?.pose ?? target.pose;
    this.gizmo.group.position.copy(middleOf({ pose, bounds_m: movedBounds(target.bounds_m, target.pose, pose) }));
  }

  private showCameras(): void {
    const dragged = this.drag?.target.camera;
    const cameras = (store.current.peek()?.cameras ?? []).map((camera) =>
      camera.name === dragged?.name ? { ...camera, world_from_camera: this.drag!.pose } : camera,
    );
    this.placeGizmo();
    this.frustums.show(cameras, store.selectedCamera.peek(), store.lookThrough.peek(), this.palette);
    this.frustums.visible = store.lookThrough.peek() === null && !store.isReplaying.peek();
    this.request();
  }

  private listen(canvas: HTMLCanvasElement): void {
    // Before OrbitControls, which would turn the view during a drag of an object.
    this.host.addEventListener("pointerdown", (event) => this.pointerDown(event), { capture: true });
    this.host.addEventListener("pointermove", (event) => this.pointerMove(event), { capture: true });
    this.host.addEventListener("pointerup", (event) => this.pointerUp(event), { capture: true });
    for (const lost of ["pointercancel", "lostpointercapture"] as const) {
      this.host.addEventListener(lost, (event) => this.drag?.pointer === event.pointerId && this.cancelDrag(), { capture: true });
    }
    canvas.addEventListener("pointerleave", () => (store.hoveredId.value = null));
    canvas.addEventListener("webglcontextlost", (event) => event.preventDefault());
    canvas.addEventListener("webglcontextrestored", () => this.changedShape());
  }

  private aim(event: PointerEvent): void {
    const { left, top, width, height } = this.port();
    const box = this.host.getBoundingClientRect();
    const x = ((event.clientX - box.left - left) / width) * 2 - 1;
    const y = 1 - ((event.clientY - box.top - top) / height) * 2;
    const camera = this.camera();
    if (camera === this.through) {
      this.raycaster.ray.origin.setFromMatrixPosition(camera.matrixWorld);
      this.raycaster.ray.direction.set(x, y, 0.5).applyMatrix4(camera.projectionMatrixInverse).applyMatrix4(camera.matrixWorld);
      this.raycaster.ray.direction.sub(this.raycaster.ray.origin).normalize();
      this.raycaster.camera = camera;
    } else {
      this.raycaster.setFromCamera(new Vector2(x, y), camera);
    }
  }

  /** Object or camera under the ray. */
  private hit(): { item?: string; camera?: string } | null {
    const targets = [this.objects.group, this.robot.group, this.furniture, ...(this.frustums.visible ? [this.frustums] : [])];
    const [first] = this.raycaster.intersectObjects(targets, true).filter((hit) => hit.object instanceof Mesh && !store.hidden.peek().has(hit.object.userData["item"] as string));
    if (!first) return null;
    const { item, camera } = first.object.userData as { item?: string; camera?: string };
    return camera ? { camera } : item && this.objects.byId.has(item) ? { item } : null;
  }

  private pointerDown(event: PointerEvent): void {
    if (event.target !== this.renderer.domElement || event.button !== 0) return;
    this.renderer.domElement.focus({ preventScroll: true });
    this.press = { x: event.clientX, y: event.clientY, pointer: event.pointerId };
    const target = this.target();
    if (!target) return;
    this.aim(event);
    const handle = this.gizmo.pick(this.raycaster);
    // The selected object itself slides on the table.
    const slides = !handle && target.object && store.gizmoMode.peek() === "move" && this.hit()?.item === target.object.id;
    if (handle) this.startDrag(event, target, handle);
    else if (slides) this.startDrag(event, target, { mode: "move", axes: [true, true, false] });
  }

  private startDrag(event: PointerEvent, target: Target, handle: Handle): void {
    const view = this.camera().getWorldDirection(new Vector3());
    const measure = new DragMeasure(handle, this.gizmo.group.position, this.raycaster, view);
    if (!measure.isPossible) return;
    event.stopPropagation();
    event.preventDefault();
    const carried = new Set(target.object && placements(target.object, target.pose).map((placement) => placement.id));
    const others = target.object ? store.current.peek()!.objects.filter((other) => !carried.has(other.id)) : [];
    const neighbours = others.map((other) => ({ id: other.name, bounds: other.bounds_m }));
    this.drag = { target, handle, measure, neighbours, pose: target.pose, pointer: event.pointerId };
    this.host.setPointerCapture(event.pointerId);
    this.controls.enabled = false;
    this.gizmo.light(handle);
    this.detail.begin();
    store.isDragging.value = true;
  }

  private pointerMove(event: PointerEvent): void {
    if (this.drag && event.pointerId === this.drag.pointer) {
      event.stopPropagation();
      this.aim(event);
      this.moveDrag(event.altKey);
      return;
    }
    if (event.target !== this.renderer.domElement || event.buttons !== 0) return;
    this.aim(event);
    const handle = this.gizmo.pick(this.raycaster);
    this.gizmo.light(handle);
    const item = handle ? null : (this.hit()?.item ?? null);
    if (store.hoveredId.peek() !== item) store.hoveredId.value = item;
    const canSlide = item !== null && item === store.selectedId.peek() && store.gizmoMode.peek() === "move";
    this.renderer.domElement.style.cursor = handle || canSlide ? "grab" : item ? "pointer" : "default";
    if (handle) this.request();
  }

  private moveDrag(isFree: boolean): void {
    const { target, handle, measure, neighbours } = this.drag!;
    const snaps = store.snapping.peek() !== isFree;
    if (handle.mode === "move") {
      const by = measure.moved(this.raycaster);
      if (!by) return;
      const start = target.pose.position_m;
      const wanted = add(start, [by.x, by.y, by.z]);
      // A gripper does not rest on surfaces.
      const surfaces = target.object || target.camera ? (store.scene.peek()?.surfaces ?? []) : [];
      const scene = { bounds: target.bounds_m, start, neighbours, surfaces };
      const snapped = snaps ? snapMove(wanted, handle.axes, scene) : { position: wanted, causes: [] };
      this.drag!.pose = { ...target.pose, position_m: snapped.position };
      const at = snapped.position.map((metres) => metres.toFixed(3)).join(", ");
      store.status.value = [`${target.name} at ${at} m`, ...snapped.causes].join(", ");
    } else {
      const angle = measure.turned(this.raycaster);
      if (angle === null) return;
      const turn = snaps ? snapTurn(angle) : angle;
      const axis: Vector = [0, 0, 0];
      axis[handle.axis] = 1;
      this.drag!.pose = turned(target.pose, turn, target.pose.position_m, axis);
      store.status.value = `${target.name} turned by ${((turn * 180) / Math.PI).toFixed(snaps ? 0 : 1)}°`;
    }
    if (target.object) {
      const objects = placements(target.object, this.drag!.pose);
      this.showPlacements(objects);
      preview(objects);
      this.placeGizmo();
    } else {
      this.showCameras();
    }
    this.changedShape();
  }

  private showPlacements(objects: Placement[]): void {
    for (const { id, pose } of objects) setPose(this.objects.item(id).group, pose);
  }

  private pointerUp(event: PointerEvent): void {
    const press = this.press;
    this.press = null;
    if (this.drag?.pointer === event.pointerId) {
      const { target, pose } = this.drag;
      this.endDrag();
      event.stopPropagation();
      const isMoved = JSON.stringify(pose) !== JSON.stringify(target.pose);
      if (!isMoved) this.sync();
      else if (target.object) apply({ op: "place", args: { objects: placements(target.object, pose) } });
      else if (target.camera) placeCamera(target.camera, pose);
      else store.target.value = pose;
      return;
    }
    if (!press || press.pointer !== event.pointerId) return;
    if (Math.hypot(event.clientX - press.x, event.clientY - press.y) > 4) return;
    this.aim(event);
    const hit = this.hit();
    if (hit?.camera) {
      store.selectCamera(hit.camera);
    } else {
      store.select(hit?.item ?? null);
    }
  }

  private endDrag(): void {
    const { pointer } = this.drag!;
    this.drag = null;
    if (this.host.hasPointerCapture(pointer)) this.host.releasePointerCapture(pointer);
    this.controls.enabled = store.lookThrough.peek() === null;
    this.gizmo.light(null);
    this.detail.end();
    store.isDragging.value = false;
  }
}

function middleOf(object: Pick<SceneObject, "bounds_m" | "pose">): Vector3 {
  const [low, high] = object.bounds_m;
  const [x, y] = object.pose.position_m;
  return new Vector3(x, y, (low[2] + high[2]) / 2);
}
