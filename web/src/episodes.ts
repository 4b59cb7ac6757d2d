// Messages about runs and episodes between the page and the server.

import type { Refusal, Scene } from "./contract.ts";

export interface OfferedPolicy {
  policy: string;
  about: string;
}

export interface EpisodeRow {
  /** Key in addresses. */
  episode: string;
  policy: string;
  source: string;
  /** Newest revision with the scenario of the episode. */
  revision?: number;
  /** False if the result alone was stored. */
  recorded: boolean;
  oracle: boolean;
  success: boolean;
  ending: string | null;
  failure?: { cause: string; evidence: string };
  duration_s: number;
  has_transcript: boolean;
}

export interface Run {
  number: number;
  policy: string;
  revision: number;
  state: "waiting" | "running" | "done" | "cancelled" | "failed";
  time_s: number;
  error?: Refusal;
  episode?: EpisodeRow;
}

export interface Moment {
  kind: "held" | "contact" | "slip" | "disturbed" | "takeover";
  from_s: number;
  to_s: number;
  object?: string;
  peak_n?: number;
  text?: string;
}

export interface EpisodeMessage {
  episode: EpisodeRow;
  result: { failures: { cause: string; evidence: string }[]; agent_failure?: { class?: string; stage: string; evidence: string } };
  timeline: { moments: Moment[]; failed_at_s?: number; acted_until_s: number };
  scene: Scene;
}
