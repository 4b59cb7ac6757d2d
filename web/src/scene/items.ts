// Objects and robot links in the 3-D view, kept in step with the state.

import { Group, Mesh, MeshBasicMaterial, Vector2, type Material, type ShaderMaterial } from "three";
import type { Link, Pose, SceneObject } from "../contract.ts";
import { compose, inverse } from "../logic/pose.ts";
import { outlineMaterial, setPose } from "./fixtures.ts";
import type { MeshCache } from "./meshes.ts";

export type Highlight = "selected" | "hovered" | "danger" | "warning" | null;

export class Item {
  readonly group = new Group();
  private links = new Map<string, { path: string; group: Group }>();
  private outlines: Mesh[] = [];
  private outline: ShaderMaterial | null = null;
  private isGone = false;
  highlight: Highlight = null;

  constructor(
    readonly id: string,
    private readonly cache: MeshCache,
    private readonly resolution: Vector2,
    private readonly changed: () => void,
    /** Material in place of the meshes' own. */
    private readonly material?: Material,
  ) {}

  /** Pose of the item and of its links; meshes are loaded when they are new. */
  update(pose: Pose, links: Link[], loading: Promise<unknown>[]): void {
    setPose(this.group, pose);
    const item_from_world = inverse(pose);
    const wanted = new Set<string>();
    links.forEach((link, index) => {
      if (!link.mesh) return;
      const name = `${index} ${link.name}`;
      wanted.add(name);
      let known = this.links.get(name);
      if (known && known.path !== link.mesh) {
        this.drop(name);
        known = undefined;
      }
      if (!known) {
        known = { path: link.mesh, group: new Group() };
        this.links.set(name, known);
        this.group.add(known.group);
        loading.push(this.load(known.path, known.group));
      }
      setPose(known.group, compose(item_from_world, link.world_from_link));
    });
    for (const name of [...this.links.keys()]) if (!wanted.has(name)) this.drop(name);
  }

  setHighlight(highlight: Highlight, color: string): void {
    if (highlight === this.highlight && this.outline?.uniforms["color"]!.value.getStyle() === color) return;
    this.highlight = highlight;
    this.clearOutline();
    if (highlight) {
      this.outline = outlineMaterial(this.resolution);
      this.outline.uniforms["color"]!.value.set(color);
      this.outline.uniforms["pixels"]!.value = highlight === "selected" ? 2.6 : 1.8;
      this.addOutline();
    }
  }

  dispose(): void {
    this.isGone = true;
    this.clearOutline();
    for (const name of [...this.links.keys()]) this.drop(name);
    this.group.removeFromParent();
  }

  private async load(path: string, into: Group): Promise<void> {
    const content = await this.cache.acquire(path);
    if (this.isGone || into.parent !== this.group) {
      this.cache.release(path);
      return;
    }
    content.traverse((object) => {
      object.userData["item"] = this.id;
      object.castShadow = object.receiveShadow = !this.material;
      if (this.material && object instanceof Mesh) object.material = this.material;
    });
    into.userData["loaded"] = true;
    into.add(content);
    if (this.outline) {
      for (const mesh of this.outlines) mesh.removeFromParent();
      this.outlines = [];
      this.addOutline();
    }
    this.changed();
  }

  private drop(name: string): void {
    const link = this.links.get(name)!;
    this.links.delete(name);
    link.group.removeFromParent();
    // A mesh that is still loading is given back when it arrives.
    if (link.group.userData["loaded"]) this.cache.release(link.path);
  }

  private addOutline(): void {
    const meshes: Mesh[] = [];
    this.group.traverse((object) => object instanceof Mesh && meshes.push(object));
    for (const mesh of meshes) {
      const shell = new Mesh(mesh.geometry, this.outline!);
      shell.raycast = () => undefined;
      mesh.parent!.add(shell);
      this.outlines.push(shell);
    }
  }

  private clearOutline(): void {
    for (const mesh of this.outlines) mesh.removeFromParent();
    this.outlines = [];
    this.outline?.dispose();
    this.outline = null;
  }
}

/** Material of what is no longer there. */
export function ghostly(): Material {
  return new MeshBasicMaterial({ color: 0x4fa3d8, transparent: true, opacity: 0.45, depthWrite: false });
}

/** All items of a kind, by id. */
export class Items {
  readonly group = new Group();
  readonly byId = new Map<string, Item>();

  constructor(
    private readonly cache: MeshCache,
    private readonly resolution: Vector2,
    private readonly changed: () => void,
    /** Material in place of the meshes' own. */
    private readonly material?: Material,
  ) {}

  /** Objects of a state; those in `held` keep the pose that a drag gave them. */
  update(objects: SceneObject[], held: Set<string>): Promise<unknown>[] {
    const loading: Promise<unknown>[] = [];
    const ids = new Set(objects.map((object) => object.id));
    for (const [id, item] of [...this.byId]) {
      if (ids.has(id)) continue;
      item.dispose();
      this.byId.delete(id);
    }
    for (const object of objects) {
      if (!held.has(object.id)) this.item(object.id).update(object.pose, object.links, loading);
    }
    return loading;
  }

  item(id: string): Item {
    let item = this.byId.get(id);
    if (!item) {
      item = new Item(id, this.cache, this.resolution, this.changed, this.material);
      this.byId.set(id, item);
      this.group.add(item.group);
    }
    return item;
  }

  clear(): void {
    for (const item of this.byId.values()) item.dispose();
    this.byId.clear();
  }
}
