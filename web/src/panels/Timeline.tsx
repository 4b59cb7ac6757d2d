// Time line of the open episode, below the 3-D view.

import { keyLabel } from "../logic/keys.ts";
import * as playback from "../state/playback.ts";
import { momentWords, outcome } from "./RunsTab.tsx";
import { withKeys } from "./widgets.tsx";

const SPEEDS = [0.25, 0.5, 1, 2, 4];

export function Timeline() {
  const shown = playback.episode.value;
  if (!shown) return null;
  const { duration_s, timeline, episode } = shown;
  const share = (at: number) => `${((100 * at) / (duration_s || 1)).toFixed(2)}%`;
  const now = playback.time_s.value;
  const happening = timeline.moments.filter((moment) => moment.from_s <= now + 0.02 && now <= moment.to_s + 0.3).map((moment) => momentWords(moment, shown.scene.state));
  return (
    <div class="timeline" role="group" aria-label="Episode">
      <button type="button" title={withKeys(playback.isPlaying.value ? "Pause" : "Play", "play")} onClick={playback.togglePlay}>
        {playback.isPlaying.value ? "Pause" : "Play"}
      </button>
      <div class="track">
        <div class="marks" aria-hidden="true">
          <span class="moment settling" style={{ left: share(timeline.acted_until_s), right: 0 }} />
          {timeline.moments.map((moment, index) => (
            <span key={index} class={`moment ${moment.kind}`} title={momentWords(moment, shown.scene.state)} style={{ left: share(moment.from_s), width: share(moment.to_s - moment.from_s) }} />
          ))}
          {timeline.failed_at_s !== undefined && <span class="moment failed" title="failed here" style={{ left: share(timeline.failed_at_s) }} />}
        </div>
        <input
          type="range"
          aria-label="Time"
          aria-valuetext={`${now.toFixed(1)} of ${duration_s.toFixed(1)} seconds${happening.length > 0 ? `: ${happening.join(", ")}` : ""}`}
          min={0}
          max={duration_s}
          step="any"
          value={now}
          onInput={(event) => {
            playback.isPlaying.value = false;
            playback.seek(Number(event.currentTarget.value));
          }}
        />
      </div>
      <span class="time">
        {now.toFixed(1)} / {duration_s.toFixed(1)} s
      </span>
      <label>
        <span class="hidden">Speed</span>
        <select value={playback.speed.value} onChange={(event) => (playback.speed.value = Number(event.currentTarget.value))}>
          {SPEEDS.map((speed) => (
            <option key={speed} value={speed}>
              {speed}×
            </option>
          ))}
        </select>
      </label>
      <span class={`chip verdict ${episode.success ? "ok" : "blocking"}`}>
        {episode.policy}: {outcome(episode)}
      </span>
      <button type="button" title={`Back to the scenario (${keyLabel("escape")})`} onClick={playback.leave}>
        Leave
      </button>
      <span class="happening muted">{happening.join(", ")}</span>
    </div>
  );
}
