// Reviews: what a reviewer has marked, and what may be said with it.

export const CRITERIA = ["instruction_clear", "goal_matches", "plausible", "feasible", "looks_right"] as const;
export type Criterion = (typeof CRITERIA)[number];

/** Words of a criterion, and the reason of a rejection where it does not hold. */
export const ABOUT: Record<Criterion, [words: string, reason: string]> = {
  instruction_clear: ["The instruction is clear", "ambiguous"],
  goal_matches: ["The goal matches the instruction", "goal_wrong"],
  plausible: ["It is plausible in daily life", "implausible"],
  feasible: ["The robot can do it", "unreachable"],
  looks_right: ["The scene looks right", "looks_wrong"],
};
/** Words of what somebody decided. */
export const SAID: Record<Review["decision"]["verdict"], string> = { approve: "approved", reject: "rejected", send_back: "sent back", take_back: "took back" };
export const FURTHER = ["duplicate", "unsafe", "other"] as const;
export type Further = (typeof FURTHER)[number];

export type Work = "second" | "first" | "adjudicate";

export interface ReviewRow {
  key: string;
  id: string;
  kind: string;
  instruction: string;
  camera: string | null;
  standing: string;
  missing?: number;
  work: Work | null;
  has_said: boolean;
  is_certified: boolean;
  group: number | null;
}

export interface Review {
  reviewer: { name: string; kind: string; version?: string };
  decision: { verdict: "approve" | "reject" | "send_back" | "take_back"; reasons?: string[] };
  criteria?: Partial<Record<Criterion, boolean>>;
  note?: string;
  adjudicates?: boolean;
}

export interface ReviewState extends ReviewRow {
  content_sha256: string;
  reviews: Review[];
  trials: { episodes: number; verified: number } | null;
}

/** The marks of a review: criteria that do not hold, further reasons, and a note. */
export interface Marks {
  failed: Criterion[];
  further: Further[];
  note: string;
}

export const UNMARKED: Marks = { failed: [], further: [], note: "" };

/** Toggles the criterion or reason with a number from 1. */
export function toggled(marks: Marks, number: number): Marks {
  const flip = <T>(list: T[], one: T | undefined) =>
    one === undefined ? list : list.includes(one) ? list.filter((other) => other !== one) : [...list, one];
  const at = number - 1 - CRITERIA.length;
  return at < 0 ? { ...marks, failed: flip(marks.failed, CRITERIA[number - 1]) } : { ...marks, further: flip(marks.further, FURTHER[at]) };
}

/** Decision of the marks, or what is still missing. */
export function decided(verdict: Review["decision"]["verdict"], marks: Marks): { decision: Review["decision"] } | { missing: string } {
  const reasons = [...marks.failed.map((criterion) => ABOUT[criterion][1]), ...marks.further];
  const hasNote = marks.note.trim() !== "";
  if (verdict === "approve" && reasons.length > 0) return { missing: "Something is marked as wrong: reject it, send it back, or unmark that." };
  if (verdict === "reject" && reasons.length === 0) return { missing: "Mark what is wrong first: keys 1 to 8." };
  if (verdict === "reject" && marks.further.includes("other") && !hasNote) return { missing: "The reason “other” needs a note." };
  if (verdict === "send_back" && !hasNote) return { missing: "Say in the note what should be changed." };
  return { decision: verdict === "reject" ? { verdict, reasons } : { verdict } };
}

export function criteriaOf(marks: Marks): Record<Criterion, boolean> {
  return Object.fromEntries(CRITERIA.map((criterion) => [criterion, !marks.failed.includes(criterion)])) as Record<Criterion, boolean>;
}

/** Target shares by axis and value, from 0 to 1. */
export type Targets = Record<string, Record<string, number>>;

/** Targets with another one of a value, in percent; the values of the axis that are left keep their proportions. */
export function retargeted(targets: Targets, axis: string, now: { value: string; wanted: number }[], value: string, percent: number): Targets {
  const share = Math.min(1, Math.max(0, percent / 100 || 0));
  const others = now.filter((one) => one.value !== value);
  const sum = others.reduce((total, one) => total + one.wanted, 0);
  // The rest is shared equally where the others have no share to scale.
  const rest = (wanted: number) => (sum > 0 ? (wanted / sum) * (1 - share) : (1 - share) / others.length);
  const own = others.length > 0 ? share : 1;
  return { ...targets, [axis]: Object.fromEntries(now.map((one) => [one.value, one.value === value ? own : rest(one.wanted)])) };
}

const ORDER: (Work | null)[] = ["second", "first", "adjudicate"];

/** Rows of a kind and of what is missing; what completes a pair comes first. */
export function filtered(rows: ReviewRow[], kind: string, missing: string): ReviewRow[] {
  const is = (row: ReviewRow) => (!kind || row.kind === kind) && (missing === "mine" ? row.work !== null : !missing || row.work === missing || row.standing === missing);
  const rank = (row: ReviewRow) => (row.work === null ? ORDER.length : ORDER.indexOf(row.work));
  return rows.filter(is).sort((a, b) => rank(a) - rank(b));
}

export function standingWords(row: { standing: string; missing?: number }): string {
  if (row.standing === "open") return row.missing === 1 ? "1 of 2 reviews; somebody else gives the second" : "0 of 2 reviews";
  return { sent_back: "sent back", adjudication: "the reviewers differ", uncertified: "approved, but the expert has not solved it" }[row.standing] ?? row.standing;
}
