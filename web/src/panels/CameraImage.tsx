// The image of the data set from our renderer: of the scenario with the visible share of each object, else of the episode
// that is played back.

import { effect, signal, useSignal } from "@preact/signals";
import { useEffect } from "preact/hooks";
import { nameOf } from "../logic/operations.ts";
import * as playback from "../state/playback.ts";
import { cameraImage, stateImage } from "../state/requests.ts";
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
  const episode = playback.episode.value?.episode.episode;
  const wanted = `${key} ${camera?.name} ${episode ?? revision}`;
  const put = (loaded: Blob, ofShares: Record<string, number>) => {
    if (image.peek()) URL.revokeObjectURL(image.peek()!.url);
    image.value = { url: URL.createObjectURL(loaded), of: wanted };
    shares.value = ofShares;
    failure.value = null;
  };
  useEffect(() => {
    if (!key || !camera || episode === undefined || !isOnline) return;
    const abort = new AbortController();
    let [shown, isLoading] = [-1, false];
    // One image after the other: playing faster than they come skips some.
    const follow = async () => {
      if (isLoading) return;
      isLoading = true;
      try {
        while (!abort.signal.aborted && shown !== playback.state.peek()) {
          const next = playback.state.peek();
          put(await stateImage(key, episode, camera.name, next, abort.signal), {});
          shown = next;
        }
      } catch (error) {
        if (!abort.signal.aborted) failure.value = (error as Error).message;
      } finally {
        isLoading = false;
      }
    };
    const stop = effect(() => {
      void playback.state.value;
      void follow();
    });
    return () => {
      stop();
      abort.abort();
    };
  }, [key, camera?.name, episode, isOnline]);
  useEffect(() => {
    if (!key || !camera || revision === undefined || episode !== undefined || !isOnline) return;
    const abort = new AbortController();
    const load = async () => {
      try {
        const loaded = await cameraImage(key, camera.name, revision, abort.signal);
        put(loaded.image, loaded.shares);
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
  }, [key, camera?.name, revision, episode, isOnline]);
  const isCurrent = image.value?.of === wanted && store.waiting.value === 0;
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
