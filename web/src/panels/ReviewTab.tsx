// Review of the open scenario: the queue, criteria, reasons, a note, and the other's answer once both have said.

import { useEffect } from "preact/hooks";
import { ABOUT, CRITERIA, FURTHER, SAID, standingWords, type Review } from "../logic/review.ts";
import * as reviews from "../state/reviews.ts";
import * as store from "../state/store.ts";
import { withKeys } from "./widgets.tsx";

const FILTERS = [
  ["mine", "for me to do"],
  ["second", "second review missing"],
  ["first", "not reviewed"],
  ["adjudicate", "to adjudicate"],
  ["sent_back", "sent back"],
  ["uncertified", "without certificate"],
  ["approved", "approved"],
  ["rejected", "rejected"],
  ["", "all"],
] as const;

const AGAIN_MS = 10_000;

export function ReviewTab() {
  const key = store.openKey.value;
  const revision = store.confirmed.value?.revision;
  const author = store.author.value;
  useEffect(() => void reviews.loadQueue(), [author]);
  useEffect(() => {
    if (!key) return;
    void reviews.load(key);
    // Somebody else may say something meanwhile.
    const timer = setInterval(() => void reviews.load(key, true), AGAIN_MS);
    return () => clearInterval(timer);
  }, [key, revision, author]);
  const now = reviews.state.value;
  return (
    <div class="review">
      <Queue />
      {now && now.key === key ? (
        <>
          <p>
            <span class={`chip ${now.standing}`}>{standingWords(now)}</span> <Expert />
          </p>
          <Marking />
          <Said />
        </>
      ) : (
        <p class="muted">{key ? "loading" : "no scenario is open"}</p>
      )}
      <div class="actions">
        <button type="button" title={withKeys("Contact sheet", "sheet")} onClick={() => (store.dialog.value = "sheet")}>
          Contact sheet
        </button>
        <button type="button" title={withKeys("Balance of the approved, and the suite of them", "balance")} onClick={() => (store.dialog.value = "balance")}>
          Balance and suite
        </button>
      </div>
    </div>
  );
}

function Queue() {
  const kinds = [...new Set(reviews.rows.value.map((row) => row.kind))].sort();
  return (
    <div class="row queue">
      <button type="button" title={withKeys("Next scenario to review", "review.next")} onClick={() => void reviews.next()}>
        Next
      </button>
      <select aria-label="What is missing" value={reviews.missing.value} onChange={(event) => (reviews.missing.value = event.currentTarget.value)}>
        {FILTERS.map(([value, words]) => (
          <option key={value} value={value}>
            {words}
          </option>
        ))}
      </select>
      <select aria-label="Kind to review" value={reviews.kind.value} onChange={(event) => (reviews.kind.value = event.currentTarget.value)}>
        <option value="">all kinds</option>
        {kinds.map((name) => (
          <option key={name} value={name}>
            {name.replaceAll("_", " ")}
          </option>
        ))}
      </select>
      <span class="muted" aria-label="Number">
        {reviews.isLoaded.value ? reviews.listed.value.length : "…"}
      </span>
    </div>
  );
}

function Expert() {
  const now = reviews.state.value!;
  if (reviews.trying.value.includes(now.key)) return <span class="muted">the expert is trying it</span>;
  if (now.trials) {
    return (
      <span class="muted">
        the expert solved it {now.trials.verified} of {now.trials.episodes} times
      </span>
    );
  }
  return (
    <button type="button" onClick={() => void reviews.certify(now.key)}>
      Let the expert try
    </button>
  );
}

function Marking() {
  const marks = reviews.marks.value;
  const now = reviews.state.value!;
  const isOwn = now.has_said;
  const blocking = store.problems.value.filter((problem) => problem.blocking).length;
  return (
    <>
      <p class="muted ask">Press what is wrong, if anything:</p>
      <ul class="criteria" aria-label="Criteria">
        {CRITERIA.map((criterion, index) => {
          const fails = marks.failed.includes(criterion);
          return (
            <li key={criterion}>
              <button type="button" aria-pressed={fails} title={`Mark as wrong (${index + 1})`} onClick={() => reviews.mark(index + 1)}>
                <kbd>{index + 1}</kbd> {ABOUT[criterion][0]}
                <span class={fails ? "no" : "muted"}>{fails ? `no: ${ABOUT[criterion][1].replace("_", " ")}` : "yes"}</span>
              </button>
            </li>
          );
        })}
      </ul>
      <div class="actions" role="group" aria-label="Further reasons">
        {FURTHER.map((reason, index) => (
          <button key={reason} type="button" aria-pressed={marks.further.includes(reason)} onClick={() => reviews.mark(CRITERIA.length + index + 1)}>
            <kbd>{CRITERIA.length + index + 1}</kbd> {reason}
          </button>
        ))}
      </div>
      <label class="field">
        <span class="hidden">Note</span>
        <textarea rows={1} placeholder="Note" maxLength={2000} value={marks.note} onKeyDown={(event) => event.key === "Escape" && event.currentTarget.blur()} onInput={(event) => (reviews.marks.value = { ...marks, note: event.currentTarget.value })} />
      </label>
      {blocking > 0 && <p class="caution">The verdict names {blocking === 1 ? "a problem" : `${blocking} problems`}: repair first, or mark what is wrong.</p>}
      <div class="actions">
        <span class="muted">{now.work === "adjudicate" ? "You decide between the two, as" : "You review as"}</span>
        <button type="button" class="quiet" title="Change your name" onClick={() => (store.dialog.value = "author")}>
          {store.author.value}
        </button>
      </div>
      <div class="actions">
        <button type="button" class={isOwn || blocking > 0 ? "" : "primary"} title={withKeys("Approve", "review.approve")} onClick={() => reviews.decide("approve")}>
          Approve
        </button>
        <button type="button" title={withKeys("Reject", "review.reject")} onClick={() => reviews.decide("reject")}>
          Reject
        </button>
        <button type="button" title={withKeys("Send back with the note", "review.send_back")} onClick={() => reviews.decide("send_back")}>
          Send back
        </button>
        {isOwn && (
          <button type="button" title={withKeys("Take your review back", "review.take_back")} onClick={() => reviews.decide("take_back")}>
            Take back
          </button>
        )}
      </div>
    </>
  );
}

function Said() {
  const now = reviews.state.value!;
  if (now.reviews.length === 0) return <p class="muted">Another reviewer's answer appears after yours.</p>;
  return (
    <ul class="said" aria-label="Reviews">
      {now.reviews.map((review) => (
        <li key={review.reviewer.name}>
          <strong>{review.reviewer.name}</strong> {words(review)}
          {review.note && <q>{review.note}</q>}
        </li>
      ))}
    </ul>
  );
}

function words({ decision, criteria, adjudicates }: Review): string {
  const said = SAID[decision.verdict];
  const failed = CRITERIA.filter((criterion) => criteria?.[criterion] === false).map((criterion) => ABOUT[criterion][1]);
  const why = [...new Set([...(decision.reasons ?? []), ...failed])].join(", ").replaceAll("_", " ");
  return `${adjudicates ? "decided: " : ""}${said}${why ? ` (${why})` : ""}`;
}
