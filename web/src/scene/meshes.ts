// Meshes by address, shared by all objects that show them; the least recently used unused ones are freed.

import { Mesh, Texture, type Group, type Material } from "three";
import { address } from "../state/requests.ts";
import { readGlb } from "./glb.ts";

/** Meshes kept although nothing shows them, so that going back to a scenario loads nothing. */
const KEPT = 48;

interface Entry {
  group: Promise<Group>;
  users: number;
}

export class MeshCache {
  private entries = new Map<string, Entry>();

  /** A copy of the mesh's objects with shared geometry; give it back with `release`. */
  async acquire(path: string): Promise<Group> {
    const entry = this.entries.get(path) ?? { group: load(path), users: 0 };
    entry.users += 1;
    // Moved to the end: the oldest come first.
    this.entries.delete(path);
    this.entries.set(path, entry);
    try {
      return (await entry.group).clone();
    } catch (error) {
      this.entries.delete(path);
      throw error;
    }
  }

  release(path: string): void {
    const entry = this.entries.get(path);
    if (!entry) return;
    entry.users -= 1;
    const unused = [...this.entries].filter(([, one]) => one.users <= 0);
    for (const [old, one] of unused.slice(0, Math.max(0, unused.length - KEPT))) {
      this.entries.delete(old);
      void one.group.then(free, () => undefined);
    }
  }

  get size(): number {
    return this.entries.size;
  }
}

async function load(path: string): Promise<Group> {
  const response = await fetch(address(path));
  if (!response.ok) throw new Error(`the mesh ${path} is missing (${response.status})`);
  return readGlb(await response.arrayBuffer());
}

function free(group: Group): void {
  const materials = new Set<Material>();
  group.traverse((object) => {
    if (!(object instanceof Mesh)) return;
    object.geometry.dispose();
    materials.add(object.material as Material);
  });
  for (const material of materials) {
    const map = (material as { map?: Texture | null }).map;
    if (map) {
      (map.image as ImageBitmap | undefined)?.close?.();
      map.dispose();
    }
    material.dispose();
  }
}
