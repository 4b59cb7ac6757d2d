// The image of the data set from our renderer, with the visible share of each object.

import { signal, useSignal } from "@preact/signals";
import { useEffect } from "preact/hooks";
import { nameOf } from "../logic/operations.ts";
import { cameraImage } from "../state/requests.ts";
import * as store from "../state/store.ts";
import { withKeys } from "./widgets.tsx";

interface Shown {
  url: string;
  of: string;
}

const shares = signal<Record<string, number>>({});

export function CameraImage() {
  const image = useSignal<Shown | null>(null);
  const failure = useSignal<string | null>(null);
  const state = store.current.value;
  const camera = store.camera.value;
  const key = store.scene.value?.key;
  const revision = store.confirmed.value?.revision;
  const isOnline = store.isOnline.value;
  useEffect(() => {
    if (!key || !camera || revision === undefined || !isOnline) return;
    const abort = new AbortController();
    const load = async () => {
      try {
        const loaded = await cameraImage(key, camera.name, revision, abort.signal);
        const url = URL.createObjectURL(loaded.image);
        if (image.peek()) URL.revokeObjectURL(image.peek()!.url);
        image.value = { url, of: `${key} ${camera.name} ${revision}` };
        shares.value = loaded.shares;
        failure.value = null;
      } catch (error) {
        if (!abort.signal.aborted) failure.value = (error as Error).message;
      }
    };
    // Quick changes in a row ask for one image.
    const timer = setTimeout(() => void load(), image.peek() ? 120 : 0);
    return () => {
      clearTimeout(timer);
      abort.abort();
    };
  }, [key, camera?.name, revision, isOnline]);
  const isCurrent = image.value?.of === `${key} ${camera?.name} ${revision}` && store.waiting.value === 0;
  const seen = Object.entries(shares.value);
  return (
    <section class="image" aria-label="Image of the data set">
      <div class="row">
        <h2>Camera</h2>
        <label>
          <span class="hidden">Camera</span>
          <select title={withKeys("Next camera", "camera.next")} value={camera?.name ?? ""} onChange={(event) => (store.selectedCamera.value = event.currentTarget.value)}>
            {state?.cameras.map((one) => (
              <option key={one.name} value={one.name}>
                {one.name}
              </option>
            ))}
          </select>
        </label>
      </div>
      <div class={`frame ${isCurrent ? "" : "old"}`}>
        {image.value ? <img src={image.value.url} alt={`The scene from camera ${camera?.name ?? ""}`} width={512} height={288} /> : <p class="muted">{failure.value ?? "No image yet."}</p>}
      </div>
      {failure.value && image.value && <p class="muted">{failure.value}</p>}
      <ul class="shares" aria-label="Visible share of each object">
        {state &&
          seen.map(([id, share]) => (
            <li key={id}>
              <button type="button" class={id === store.selectedId.value ? "lit" : ""} onClick={() => store.select(id)}>
                <span class="bar" style={{ width: `${Math.round(share * 100)}%` }} />
                <span class="name">{nameOf(id, state)}</span>
                <span>{Math.round(share * 100)} %</span>
              </button>
            </li>
          ))}
      </ul>
    </section>
  );
}
