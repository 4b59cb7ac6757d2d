// Contact sheet for triage, and the balance of what was approved.

import { useSignal } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import { ABOUT, CRITERIA, FURTHER, retargeted, standingWords, type ReviewRow, type Targets } from "../logic/review.ts";
import { sentence } from "../logic/verdict.ts";
import { open } from "../state/connection.ts";
import { address, json } from "../state/requests.ts";
import * as reviews from "../state/reviews.ts";
import * as store from "../state/store.ts";
import { Dialog } from "./widgets.tsx";

const REASONS = [...CRITERIA.map((criterion) => ABOUT[criterion][1]), ...FURTHER.slice(0, 2)];

function review(key: string, onClose: () => void): void {
  store.tab.value = "review";
  open(key);
  onClose();
}

/** Thumbnails of the filtered queue, near-duplicates beside each other; several are rejected at once. */
export function SheetDialog({ onClose }: { onClose: () => void }) {
  const chosen = useSignal<string[]>([]);
  const reason = useSignal("duplicate");
  useEffect(() => void reviews.loadQueue(), []);
  const rows = [...reviews.listed.value].sort((a, b) => (a.group ?? 1e9) - (b.group ?? 1e9));
  const flip = (key: string) => (chosen.value = chosen.value.includes(key) ? chosen.value.filter((one) => one !== key) : [...chosen.value, key]);
  const reject = async () => {
    const keys = chosen.value.filter((key) => rows.some((row) => row.key === key));
    const count = await reviews.rejectAll(keys, reason.value);
    chosen.value = [];
    store.notify(`${count} rejected: ${reason.value.replace("_", " ")}`);
  };
  return (
    <Dialog title={`Contact sheet: ${rows.length}`} wide onClose={onClose}>
      <div class="row">
        <span class="grow">{chosen.value.length} chosen</span>
        <select aria-label="Reason" value={reason.value} onChange={(event) => (reason.value = event.currentTarget.value)}>
          {REASONS.map((one) => (
            <option key={one} value={one}>
              {one.replace("_", " ")}
            </option>
          ))}
        </select>
        <button type="button" disabled={chosen.value.length === 0} onClick={() => void reject()}>
          Reject the chosen
        </button>
      </div>
      <ul class="sheet">
        {rows.map((row) => (
          <li key={row.key} class={row.group === null ? "" : "alike"}>
            <Thumbnail row={row} />
            <label class="check">
              <input type="checkbox" checked={chosen.value.includes(row.key)} disabled={row.work === null} onChange={() => flip(row.key)} />
              <span class="name">{row.id}</span>
            </label>
            {row.group !== null && <span class="mark warning">alike {row.group + 1}</span>}
            <button type="button" class="quiet" title={standingWords(row)} onClick={() => review(row.key, onClose)}>
              {row.instruction}
            </button>
          </li>
        ))}
      </ul>
    </Dialog>
  );
}

function Thumbnail({ row }: { row: ReviewRow }) {
  if (!row.camera) return <span class="muted">no camera</span>;
  const source = address(`/api/scenarios/${encodeURIComponent(row.key)}/images/${encodeURIComponent(row.camera)}`);
  return <img src={source} alt="" width={160} height={90} loading="lazy" />;
}

interface Dashboard {
  balance: { scenarios: number; axes: { axis: string; total_variation: number; values: { value: string; share: number; wanted: number; count: number }[] }[]; pairs: { axes: string[]; total_variation: number; rarest: string[] | null }[] };
  helpful: { key: string; id: string; reason: string }[];
  standings: Record<string, number>;
  policies: { policy: string; scenarios: number; episodes: number; successes: number }[];
  measured: { key: string; id: string; difficulty: string; mean_success: number }[];
  left_out: { episodes: number; reason: string }[];
}

/** A suite that was written. */
interface Written {
  folder: string;
  scenarios: number;
  choice: { chosen: { scenario: string; reason: string }[]; rejected: { scenario: string; reason: string }[] };
}

interface Detection {
  planted: number;
  detected: number;
  sound: number;
  false_alarms: number;
}

interface Agreement {
  planted: Record<string, Detection>;
  decision: { items: number; raw: number; kappa: number | null; ac1: number } | null;
}

const percent = (share: number) => `${Math.round(100 * share)} %`;

/** Distribution of the approved scenarios against its targets, who helps most, agreement, and the suite. */
export function BalanceDialog({ onClose }: { onClose: () => void }) {
  const found = useSignal<Dashboard | null>(null);
  const agreement = useSignal<Agreement | null>(null);
  const targets = useSignal<Targets>({});
  const name = useSignal("reviewed");
  const written = useSignal<Written | string | null>(null);
  const suites = useSignal<{ name: string; scenarios: string[] }[]>([]);
  const told = (error: Error) => store.notify(error.message, { isError: true });
  useEffect(() => {
    void json<Dashboard>("/api/balance").then((now) => (found.value = now), told);
    void json<Agreement>("/api/agreement").then((now) => (agreement.value = now), told);
  }, []);
  useEffect(() => void json<{ suites: typeof suites.value }>("/api/suites").then((now) => (suites.value = now.suites), told), [written.value]);
  const retarget = (axis: Dashboard["balance"]["axes"][number], value: string, percent: number) => {
    const wanted = (targets.value = retargeted(targets.peek(), axis.axis, axis.values, value, percent));
    // An answer to earlier targets may arrive last.
    void json<Dashboard>("/api/balance", { targets: wanted }).then((now) => targets.peek() === wanted && (found.value = now), told);
  };
  const build = () =>
    json<Written>("/api/suites", { name: name.value, targets: Object.keys(targets.value).length > 0 ? targets.value : undefined }).then(
      (made) => (written.value = made),
      (error: Error) => (written.value = error.message),
    );
  const now = found.value;
  if (!now) return <Dialog title="Balance" wide onClose={onClose}>loading</Dialog>;
  const words = agreement.value?.decision;
  return (
    <Dialog title={`Balance of ${now.balance.scenarios} approved`} wide onClose={onClose}>
      <p>
        {Object.entries(now.standings).map(([standing, count]) => `${count} ${standing.replace("_", " ")}`).join(", ")}
        {words && `. Reviewers agree on ${percent(words.raw)} of ${scenarioCount(words.items)}: κ ${words.kappa?.toFixed(2) ?? "not defined"}, AC1 ${words.ac1.toFixed(2)}`}
      </p>
      <Planted planted={agreement.value?.planted ?? {}} />
      <div class="balance">
        <table>
          <thead>
            <tr>
              <th scope="col">axis</th>
              <th scope="col" title="total variation distance from the target">
                distance
              </th>
              <th scope="col">approved, and what is wanted</th>
            </tr>
          </thead>
          <tbody>
            {now.balance.axes.map((axis) => (
              <tr key={axis.axis}>
                <th scope="row">{axis.axis}</th>
                <td>{axis.total_variation.toFixed(2)}</td>
                <td>
                  {axis.values.slice(0, 12).map((value) => (
                    <span key={value.value} class="share" title={`${value.count}; wanted ${percent(value.wanted)}`}>
                      <span class="name">{value.value.replaceAll("_", " ")}</span> {percent(value.share)}
                      <input
                        type="number"
                        min={0}
                        max={100}
                        aria-label={`Target of ${axis.axis} ${value.value}, percent`}
                        value={Math.round(100 * value.wanted)}
                        onChange={(event) => retarget(axis, value.value, Number(event.currentTarget.value))}
                      />
                      <meter min={0} max={1} value={value.share} aria-label={`${axis.axis} ${value.value}`} />
                      <i style={{ left: `${100 * value.wanted}%` }} />
                    </span>
                  ))}
                  {axis.values.length > 12 && `and ${axis.values.length - 12} more`}
                </td>
              </tr>
            ))}
          </tbody>
        </table>
        <div>
          <h3>Helps most</h3>
          <ol>
            {now.helpful.slice(0, 8).map((one) => (
              <li key={one.key}>
                <button type="button" class="quiet" onClick={() => review(one.key, onClose)}>
                  {one.id}
                </button>
                <span class="muted">{one.reason}</span>
              </li>
            ))}
          </ol>
          <Difficulty now={now} onClose={onClose} />
          <h3>Pairs farthest from their targets</h3>
          <ol>
            {now.balance.pairs.slice(0, 5).map((pair) => (
              <li key={pair.axes.join()}>
                {pair.axes.join(" × ")}: {pair.total_variation.toFixed(2)}
                <span class="muted">{pair.rarest ? `missing ${pair.rarest.join(" with ")}` : ""}</span>
              </li>
            ))}
          </ol>
        </div>
      </div>
      <div class="actions end">
        <label class="check">
          Suite
          <input value={name.value} maxLength={64} onInput={(event) => (name.value = event.currentTarget.value)} />
        </label>
        <button type="button" class="primary" disabled={now.balance.scenarios === 0} onClick={() => void build()}>
          Write the suite
        </button>
      </div>
      {now.balance.scenarios === 0 && <p class="muted end">A suite needs approved scenarios: two reviewers approve, and the expert solves it.</p>}
      <Suite written={written.value} />
      {suites.value.length > 0 && (
        <ul class="said" aria-label="Suites">
          {suites.value.map((one) => (
            <li key={one.name}>
              Suite <strong>{one.name}</strong>: {one.scenarios.slice(0, 30).join(", ")}
              {one.scenarios.length > 30 && ` and ${one.scenarios.length - 30} more`}
            </li>
          ))}
        </ul>
      )}
    </Dialog>
  );
}

const scenarioCount = (count: number) => `${count} ${count === 1 ? "scenario" : "scenarios"}`;

/** The suite that was just written with its scenarios, or why there is none. */
function Suite({ written }: { written: Written | string | null }) {
  const shown = useRef<HTMLDivElement>(null);
  useEffect(() => shown.current?.scrollIntoView({ block: "nearest" }), [written]);
  if (written === null) return null;
  if (typeof written === "string") {
    return (
      <div ref={shown} role="alert" class="caution">
        {sentence(written)}
      </div>
    );
  }
  return (
    <div ref={shown} role="status" class="written">
      <p>
        <strong>{scenarioCount(written.scenarios)}</strong> in <code>{written.folder}</code>. <code>genmanip suite freeze {written.folder}</code> makes the suite final.
      </p>
      <ul aria-label="Scenarios of the suite">
        {written.choice.chosen.map((one) => (
          <li key={one.scenario}>
            {one.scenario} <span class="muted">{one.reason}</span>
          </li>
        ))}
      </ul>
    </div>
  );
}

/** Planted faults that each reviewer found, and sound scenarios that the reviewer refused. */
function Planted({ planted }: { planted: Record<string, Detection> }) {
  const share = (part: number, all: number) => `${part} of ${all}${all > 0 ? ` (${percent(part / all)})` : ""}`;
  const rows = Object.entries(planted);
  if (rows.length === 0) return null;
  return (
    <ul class="said" aria-label="Planted faults">
      {rows.map(([name, one]) => (
        <li key={name}>
          <strong>{name}</strong> found {share(one.detected, one.planted)} planted faults, refused {share(one.false_alarms, one.sound)} sound scenarios
        </li>
      ))}
    </ul>
  );
}

/** Success of the reference policies, and the scenarios that they solve least. */
function Difficulty({ now, onClose }: { now: Dashboard; onClose: () => void }) {
  if (now.policies.length === 0 && now.left_out.length === 0) return null;
  return (
    <>
      <h3>Measured difficulty</h3>
      {now.left_out.map((one) => (
        <p key={one.reason} class="muted">
          {one.episodes} {one.episodes === 1 ? "episode does" : "episodes do"} not count, {one.reason}.
        </p>
      ))}
      <ul aria-label="Reference policies">
        {now.policies.map((one) => (
          <li key={one.policy}>
            {one.policy}: {percent(one.successes / one.episodes)} of {one.episodes} episodes on {scenarioCount(one.scenarios)}
          </li>
        ))}
      </ul>
      <ol aria-label="Hardest scenarios">
        {now.measured.slice(0, 8).map((one) => (
          <li key={one.key}>
            <button type="button" class="quiet" onClick={() => review(one.key, onClose)}>
              {one.id}
            </button>
            <span class="muted">
              {one.difficulty}, {percent(one.mean_success)} success
            </span>
          </li>
        ))}
      </ol>
    </>
  );
}
