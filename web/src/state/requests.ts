// HTTP requests to the server of the page.

import type { CatalogueEntry, Difference, HistoryLine, KnownCameras, Operation, PhraseChoice, Problem, Refusal, Repair, ScenarioRow, Scene } from "../contract.ts";
import type { EpisodeMessage, EpisodeRow, OfferedPolicy, Run } from "../episodes.ts";
import type { Answer, Entry } from "../logic/outbox.ts";
import type { Track } from "../logic/track.ts";

/** Longest wait for an answer before a request counts as lost. */
const PATIENCE_MS = 15_000;

/** The same for laying a scene out. */
const LAYOUT_PATIENCE_MS = 120_000;

/** Token of `--allow-others`: from the address, else what this tab was given before. */
const token = readToken();

function readToken(): string | null {
  const given = new URLSearchParams(location.search).get("token");
  try {
    if (given) sessionStorage.setItem("genmanip.studio.token", given);
    return given ?? sessionStorage.getItem("genmanip.studio.token");
  } catch {
    return given;
  }
}

/** Address with the token, for what the browser fetches by itself. */
export function address(path: string): string {
  return token ? `${path}${path.includes("?") ? "&" : "?"}token=${encodeURIComponent(token)}` : path;
}

/** Request that is answered within bounds; rejects when the server cannot be reached. */
export async function request(path: string, init: RequestInit = {}, patience_ms = PATIENCE_MS): Promise<Response> {
  const signals = [AbortSignal.timeout(patience_ms), ...(init.signal ? [init.signal] : [])];
  const headers = new Headers(init.headers);
  if (token) headers.set("authorization", `Bearer ${token}`);
  return fetch(address(path), { ...init, headers, signal: AbortSignal.any(signals) });
}

export async function json<T>(path: string, body?: unknown, patience_ms = PATIENCE_MS): Promise<T> {
  const init = body === undefined ? {} : { method: "POST", headers: { "content-type": "application/json" }, body: JSON.stringify(body) };
  const response = await request(path, init, patience_ms);
  if (!response.ok) throw new Error((await refusalOf(response)).message);
  return (await response.json()) as T;
}

async function refusalOf(response: Response): Promise<Refusal> {
  const fallback = { message: `the server answered ${response.status}` };
  try {
    const body = (await response.json()) as { error?: Refusal | string };
    if (typeof body.error === "string") return { message: body.error };
    return body.error ?? fallback;
  } catch {
    return fallback;
  }
}

const scenarioPath = (key: string) => `/api/scenarios/${encodeURIComponent(key)}`;

export const session = () => json<{ version: string; author: string; needs_token: boolean; asks: boolean }>("/api/session");
export const scenarioRows = () => json<ScenarioRow[]>("/api/scenarios");
export const history = (key: string) => json<HistoryLine[]>(`${scenarioPath(key)}/history`);
/** Problems of all stages; the later stages of a crowded scene take seconds. */
export const verdictOf = (key: string) => json<{ revision: number; problems: Problem[] }>(`${scenarioPath(key)}/verdict`, undefined, LAYOUT_PATIENCE_MS);
export const settle = (key: string, objects: string[]) => json<Operation>(`${scenarioPath(key)}/settle`, { objects });
export const snapshot = (key: string, name: string, author: string, at: string) =>
  json<unknown>(`${scenarioPath(key)}/snapshots`, { name, author, at });
export const repairs = async (key: string, revision: number, problem: Problem) => {
  const { stage, code, object } = problem;
  return (await json<{ repairs: Repair[] }>(`${scenarioPath(key)}/repairs`, { revision, stage, code, object })).repairs;
};
export const catalogue = async (query: string, isGraspable: boolean, signal: AbortSignal) => {
  const graspable = isGraspable ? "&graspable=true" : "";
  const response = await request(`/api/catalogue?query=${encodeURIComponent(query)}&limit=40${graspable}`, { signal });
  if (!response.ok) throw new Error((await refusalOf(response)).message);
  return (await response.json()) as CatalogueEntry[];
};

export const knownCameras = () => json<KnownCameras>("/api/cameras");
export const world = (key: string) => address(`${scenarioPath(key)}/world`);
export const phrases = async (text: string) => (await json<{ phrases: PhraseChoice[] }>("/api/sentences", { text })).phrases;
export const create = async (text: string, choices: Record<string, string>) => (await json<{ key: string }>("/api/scenarios", { text, choices }, LAYOUT_PATIENCE_MS)).key;
export const difference = (key: string, from: number, to: number) => json<Difference>(`${scenarioPath(key)}/difference?from=${from}&to=${to}`);
export const sceneAt = (key: string, revision: number) => json<Scene>(`${scenarioPath(key)}?revision=${revision}`);
export const policies = () => json<OfferedPolicy[]>("/api/policies");
export const startRun = async (key: string, policy: string) => (await json<{ run: Run }>(`${scenarioPath(key)}/run`, { policy })).run;
export const cancelRun = (key: string) => json<unknown>(`${scenarioPath(key)}/run/cancel`, {});
export const episodes = (key: string) => json<EpisodeRow[]>(`${scenarioPath(key)}/episodes`);
export const episode = (key: string, name: string) => json<EpisodeMessage>(`${scenarioPath(key)}/episodes/${name}`);
export const transcript = (key: string, name: string) => address(`${scenarioPath(key)}/episodes/${name}/transcript/transcript.html`);

/** States of an episode. */
export async function track(key: string, name: string): Promise<Track> {
  const response = await request(`${scenarioPath(key)}/episodes/${name}/states`);
  if (!response.ok) throw new Error((await refusalOf(response)).message);
  const [frames, width] = ["x-frames", "x-width"].map((name) => Number(response.headers.get(name))) as [number, number];
  return { frames, width, values: new Float32Array(await response.arrayBuffer()) };
}

/** The data set's image of a camera, with the visible share of each object. */
export async function cameraImage(
  key: string,
  camera: string,
  revision: number,
  signal: AbortSignal,
): Promise<{ image: Blob; shares: Record<string, number> }> {
  const response = await request(`${scenarioPath(key)}/images/${encodeURIComponent(camera)}?revision=${revision}`, { signal });
  if (!response.ok) throw new Error((await refusalOf(response)).message);
  const shares = JSON.parse(response.headers.get("x-visible-shares") ?? "{}") as Record<string, number>;
  return { image: await response.blob(), shares };
}

/** The data set's image of a camera at a state of an episode. */
export async function stateImage(key: string, episode: string, camera: string, state: number, signal: AbortSignal): Promise<Blob> {
  const response = await request(`${scenarioPath(key)}/episodes/${episode}/images/${encodeURIComponent(camera)}?state=${state}`, { signal });
  if (!response.ok) throw new Error((await refusalOf(response)).message);
  return response.blob();
}

/** Sends one entry; `state` comes with an applied one, `error` with a refused one. */
export async function send(entry: Entry): Promise<{ answer: Answer; state?: unknown; error?: Refusal }> {
  const common = { client_operation_id: entry.id, author: entry.author, at: entry.at };
  const own = entry.what === "command" ? { ...entry.operation, base_revision: entry.base } : entry.what === "revert" ? { revision: entry.revision } : {};
  const body = { ...own, ...common };
  const path = `${scenarioPath(entry.key)}/${entry.what === "command" ? "commands" : entry.what}`;
  let response: Response;
  let content: Record<string, unknown>;
  try {
    response = await request(path, { method: "POST", headers: { "content-type": "application/json" }, body: JSON.stringify(body) });
    content = (await response.json().catch(() => ({}))) as Record<string, unknown>;
  } catch {
    return { answer: { is: "lost" } };
  }
  if (response.ok) {
    const state = (content["state"] ?? content) as { revision?: number; key?: string };
    if (typeof state.revision !== "number") return { answer: { is: "lost" } };
    return { answer: { is: "applied", revision: state.revision, key: state.key ?? entry.key }, state };
  }
  if (response.status === 409 && content["conflict"]) {
    return { answer: { is: "conflict", conflict: content["conflict"] as Entry["conflict"] & object } };
  }
  // A proxy or a server that is going down has not judged the command; a missing token is asked for again.
  const error = (content["error"] ?? { message: `the server answered ${response.status}` }) as Refusal;
  if (response.status >= 500 || response.status === 401 || response.status === 429) return { answer: { is: "lost" }, error };
  return { answer: { is: "refused" }, error };
}
