// Runs of policies on the open scenario, the episodes that were kept, and what happened in the open one.

import { useEffect } from "preact/hooks";
import type { EpisodeRow, Moment } from "../episodes.ts";
import { nameOf } from "../logic/operations.ts";
import { keyLabel } from "../logic/keys.ts";
import * as playback from "../state/playback.ts";
import { transcript } from "../state/requests.ts";
import * as store from "../state/store.ts";
import { isActive } from "../state/teleop.ts";
import { TeleopPanel } from "./TeleopPanel.tsx";
import { withKeys } from "./widgets.tsx";

export function RunsTab() {
  const key = store.scene.value?.key;
  const revision = store.confirmed.value?.revision;
  const isOnline = store.isOnline.value;
  useEffect(() => {
    if (isOnline) void playback.loadEpisodes();
  }, [key, revision, isOnline]);
  const rows = playback.rows.value;
  const open = playback.episode.value;
  return (
    <>
      {!isActive.value && <Start />}
      <TeleopPanel />
      <ul class="objects episodes" aria-label="Episodes">
        {rows?.map((row) => (
          <li key={row.episode}>
            <button
              type="button"
              aria-pressed={row.episode === open?.episode.episode}
              disabled={!row.recorded}
              title={row.recorded ? "Play it back" : "Its result alone was kept"}
              onClick={() => (row.episode === open?.episode.episode ? playback.leave() : void playback.openEpisode(row.episode))}
            >
              <span class="name">{row.policy}</span>
              <span class={row.success ? "mark ok" : "mark blocking"}>{outcome(row)}</span>
              <span class="muted kind">{row.duration_s.toFixed(1)} s</span>
              <span class="muted">{row.source === "studio" ? `rev. ${row.revision ?? "?"}` : row.source}</span>
            </button>
          </li>
        ))}
      </ul>
      {rows?.length === 0 && <p class="muted hint">No recorded episode: press Run, or open the folder of a run.</p>}
      {open && <Details key={open.episode.episode} episode={open} />}
    </>
  );
}

export const outcome = (row: EpisodeRow) => (row.success ? "success" : (row.failure?.cause.replaceAll("_", " ") ?? "failed"));

function Start() {
  const { policy, policies, run } = playback;
  const job = run.value;
  const about = policies.value.find((one) => one.policy === policy.value)?.about;
  return (
    <form class="run" onSubmit={(event) => (event.preventDefault(), void playback.startRun())}>
      <label>
        <span class="hidden">Policy</span>
        <select id="policy" title={about} value={policy.value} onChange={(event) => (policy.value = event.currentTarget.value)}>
          {policies.value.map((one) => (
            <option key={one.policy}>{one.policy}</option>
          ))}
        </select>
      </label>
      {playback.isRunning.value ? (
        <button type="button" onClick={() => void playback.cancelRun()}>
          Cancel
        </button>
      ) : (
        <button type="submit" class="primary" title={withKeys("Run the policy on this revision", "run")} disabled={!store.isOnline.value || !store.current.value}>
          Run
        </button>
      )}
      <span class="muted" role="status">
        {job && playback.isRunning.value ? (job.state === "waiting" ? "waits for its turn" : `${job.policy}: ${job.time_s.toFixed(1)} s so far`) : about}
      </span>
    </form>
  );
}

const WORDS: Record<Moment["kind"], string> = {
  held: "holds",
  contact: "contact",
  slip: "loses",
  disturbed: "displaced or toppled:",
  takeover: "",
};

/** Words of a moment, e.g. `loses the Orange, held for 1.2 s`. */
export function momentWords({ kind, object, peak_n, text }: Moment, named: Parameters<typeof nameOf>[1]): string {
  const of = kind === "contact" ? (peak_n === undefined ? "" : ` of ${peak_n.toFixed(0)} N`) : object ? ` the ${nameOf(object, named)}` : "";
  // A contact names links; the object of one has a name.
  const more = kind === "contact" && object ? text?.replace(/ on .*/, ` on the ${nameOf(object, named)}`) : text;
  return `${WORDS[kind]}${of}${more ? `${WORDS[kind] && ", "}${more.replace("robot/", "").replaceAll("_", " ")}` : ""}`;
}

function Details({ episode }: { episode: playback.Episode }) {
  const { timeline, result } = episode;
  const key = store.openKey.peek() ?? "";
  const jump = (at: number, words: string, kind: string) => (
    <li key={`${at} ${words}`}>
      <button type="button" class="link" onClick={() => playback.seek(at)}>
        <span class={`moment ${kind}`} aria-hidden="true" />
        <span class="muted">{at.toFixed(1)} s</span> {words}
      </button>
    </li>
  );
  const moments = timeline.moments.map((moment) => jump(moment.from_s, momentWords(moment, episode.scene.state), moment.kind));
  return (
    <div class="details">
      {result.failures.map((failure) => (
        <p key={failure.cause}>
          <strong class="wrong">{failure.cause.replaceAll("_", " ")}</strong>: {failure.evidence}
        </p>
      ))}
      {result.agent_failure && (
        <p>
          The agent: {result.agent_failure.class?.replaceAll("_", " ") ?? result.agent_failure.stage}, {result.agent_failure.evidence}
        </p>
      )}
      <ol class="moments" aria-label="What happened">
        {moments}
        {timeline.failed_at_s !== undefined && jump(timeline.failed_at_s, "failed here", "failed")}
      </ol>
      <div class="actions">
        {episode.episode.has_transcript && (
          <a href={transcript(key, episode.episode.episode)} target="_blank" rel="noreferrer">
            Transcript of the agent
          </a>
        )}
        <button type="button" onClick={playback.leave}>
          Leave the episode ({keyLabel("escape")})
        </button>
      </div>
    </div>
  );
}
