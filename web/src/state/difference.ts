// The open scenario compared with an earlier revision of it.

import { computed, effect, signal } from "@preact/signals";
import type { Difference, SceneObject } from "../contract.ts";
import * as requests from "./requests.ts";
import { confirmed, difference, isOnline, isReplaying, notify, openKey } from "./store.ts";

interface Compared {
  from: number;
  to: number;
  changes: Difference;
  /** Objects as they were. */
  before: SceneObject[];
  /** Names of the cameras that there were. */
  cameras: string[];
}

const known = signal<Compared | null>(null);

/** The differences; null while nothing is compared, or the answer is not there yet. */
export const compared = computed(() => (difference.value === null || known.value?.from !== difference.value ? null : known.value));

/** Objects that stood elsewhere or are gone, as they were. */
export const ghosts = computed<SceneObject[]>(() => {
  if (!compared.value || isReplaying.value) return [];
  const { changes, before } = compared.value;
  const changed = new Set([...changes.moved, ...changes.turned].map((one) => one.id).concat(changes.articulated, changes.removed));
  return before.filter((object) => changed.has(object.id));
});

const revision = computed(() => confirmed.value?.revision);

effect(() => {
  const [key, from, to] = [openKey.value, difference.value, revision.value];
  if (!key || from === null || to === undefined || !isOnline.value) return;
  let isGone = false;
  void Promise.all([requests.difference(key, from, to), requests.sceneAt(key, from)])
    .then(([changes, scene]) => {
      if (!isGone) known.value = { from, to, changes, before: scene.state.objects, cameras: scene.state.cameras.map((camera) => camera.name) };
    })
    .catch((error: Error) => {
      if (!isGone) notify("The revisions cannot be compared.", { hint: error.message, isError: true });
    });
  return () => {
    isGone = true;
  };
});
