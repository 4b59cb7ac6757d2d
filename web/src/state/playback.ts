// Runs of policies, and the episode that the 3-D view plays back instead of the scenario.

import { batch, computed, effect, signal } from "@preact/signals";
import type { EpisodeMessage, EpisodeRow, OfferedPolicy, Run } from "../episodes.ts";
import { durationOf, posedAt, stateAt, type Posed, type Track } from "../logic/track.ts";
import * as requests from "./requests.ts";
import { isOnline, isReplaying, notify, openKey, scene, select, status, tab } from "./store.ts";

export interface Episode extends EpisodeMessage {
  track: Track;
  duration_s: number;
}

export const policies = signal<OfferedPolicy[]>([]);
export const policy = signal("expert");
/** Newest job of the open scenario. */
export const run = signal<Run | null>(null);
/** Episodes of the open scenario; null before they are known. */
export const rows = signal<EpisodeRow[] | null>(null);
export const episode = signal<Episode | null>(null);
/** Key of the episode that is being loaded. */
export const loading = signal<string | null>(null);
export const time_s = signal(0);
export const isPlaying = signal(false);
/** Simulated seconds per second. */
export const speed = signal(1);

/** Index of the state that is shown. */
export const state = computed(() => (episode.value ? stateAt(episode.value.track, time_s.value) : 0));

/** Robot and objects of the take that is teleoperated; null while there is none. */
export const live = signal<Posed | null>(null);
export const isLive = computed(() => live.value !== null);

/** Robot and objects that are shown instead of the scenario: of a take, or of the open episode at its time; else null. */
export const posed = computed<Posed | null>(() => {
  if (live.value) return live.value;
  const shown = episode.value;
  return shown && posedAt(shown.scene, shown.track, state.value);
});

export const isRunning = computed(() => run.value?.state === "waiting" || run.value?.state === "running");

export async function loadPolicies(): Promise<void> {
  try {
    policies.value = await requests.policies();
  } catch {
    // The list is asked for again with the next connection.
  }
}

export async function loadEpisodes(): Promise<void> {
  const key = openKey.peek();
  if (!key) return;
  try {
    const found = await requests.episodes(key);
    if (openKey.peek() === key) rows.value = found;
  } catch (error) {
    if (isOnline.peek()) notify("The episodes cannot be listed.", { hint: (error as Error).message, isError: true });
  }
}

/** State of the newest job, as the server says. */
export function hear(told: Run): void {
  const known = run.peek();
  run.value = told;
  const isNews = known?.number === told.number && known.state !== told.state;
  if (!isNews) return;
  if (told.state === "failed") notify(`${told.policy} was not run: ${told.error?.message}`, { isError: true, hint: told.error?.hint ?? "" });
  if (told.state === "cancelled") status.value = "The episode was cancelled.";
  if (told.state === "done" && told.episode) {
    status.value = `${told.policy} ${told.episode.success ? "succeeded" : "failed"}.`;
    void loadEpisodes();
    if (tab.peek() === "runs" && !episode.peek() && told.policy !== "teleop") void openEpisode(told.episode.episode);
  }
}

export async function startRun(): Promise<void> {
  const key = openKey.peek();
  if (!key || isRunning.peek()) return;
  tab.value = "runs";
  try {
    hear(await requests.startRun(key, policy.peek()));
  } catch (error) {
    notify("The policy was not run.", { hint: (error as Error).message, isError: true });
  }
}

export async function cancelRun(): Promise<void> {
  const key = openKey.peek();
  if (key) await requests.cancelRun(key).catch((error: Error) => notify("Not cancelled.", { hint: error.message, isError: true }));
}

/** Opens an episode at its start; its moments and its failure are stops of the time line. */
export async function openEpisode(name: string): Promise<void> {
  const key = openKey.peek();
  if (!key) return;
  loading.value = name;
  try {
    const [message, track] = await Promise.all([requests.episode(key, name), requests.track(key, name)]);
    if (openKey.peek() !== key || loading.peek() !== name) return;
    batch(() => {
      select(null);
      tab.value = "runs";
      episode.value = { ...message, track, duration_s: durationOf(track) };
      isReplaying.value = true;
      isPlaying.value = false;
      time_s.value = 0;
    });
  } catch (error) {
    notify("The episode cannot be played.", { hint: (error as Error).message, isError: true });
  } finally {
    if (loading.peek() === name) loading.value = null;
  }
}

/** Shows the scenario again. */
export function leave(): boolean {
  if (!episode.peek()) return false;
  batch(() => {
    episode.value = null;
    isReplaying.value = false;
    isPlaying.value = false;
  });
  return true;
}

export function seek(to_s: number): void {
  time_s.value = Math.max(0, Math.min(episode.peek()?.duration_s ?? 0, to_s));
}

/** Goes to another time and stops there; a single state if `fine`. */
export function step(direction: 1 | -1, fine: boolean): void {
  const shown = episode.peek();
  if (!shown) return;
  isPlaying.value = false;
  const { frames, width, values } = shown.track;
  const next = Math.max(0, Math.min(frames - 1, state.peek() + direction));
  seek(fine ? values[next * width]! : time_s.peek() + direction * 0.25);
}

/** Times worth a look: beginnings of what happened, the failure and the end. */
export const stops = computed(() => {
  const shown = episode.value;
  if (!shown) return [];
  const { moments, failed_at_s } = shown.timeline;
  const times = [0, ...moments.map((moment) => moment.from_s), failed_at_s ?? shown.duration_s, shown.duration_s];
  return [...new Set(times)].sort((a, b) => a - b);
});

export function nextStop(direction: 1 | -1): boolean {
  const now = time_s.peek();
  const list = direction > 0 ? stops.peek().filter((at) => at > now + 0.02) : stops.peek().filter((at) => at < now - 0.02);
  const to = direction > 0 ? list[0] : list.at(-1);
  if (to === undefined) return false;
  isPlaying.value = false;
  seek(to);
  return true;
}

export function togglePlay(): void {
  const shown = episode.peek();
  if (!shown) return;
  if (!isPlaying.peek() && time_s.peek() >= shown.duration_s) seek(0);
  isPlaying.value = !isPlaying.peek();
}

effect(() => {
  if (!isPlaying.value) return;
  let before = performance.now();
  let frame = requestAnimationFrame(function advance(now) {
    seek(time_s.peek() + ((now - before) / 1000) * speed.peek());
    before = now;
    if (time_s.peek() >= (episode.peek()?.duration_s ?? 0)) isPlaying.value = false;
    else frame = requestAnimationFrame(advance);
  });
  return () => cancelAnimationFrame(frame);
});

/** Another scenario has other episodes; a copy of this one is another one, too. */
const shownKey = computed(() => scene.value?.key);
effect(() => {
  void shownKey.value;
  batch(() => {
    leave();
    rows.value = null;
    run.value = null;
    loading.value = null;
  });
});
