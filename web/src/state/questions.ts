// Questions that an agent puts to a model, answered by the person at the page.

import { batch, computed, signal } from "@preact/signals";
import { blank, type Json, type Schema } from "../logic/answers.ts";
import { json } from "./requests.ts";
import * as store from "./store.ts";

export interface QuestionRow {
  name: string;
  is_answered: boolean;
  duration_s: number | null;
}

export interface Question {
  name: string;
  answer: string | null;
  question: {
    messages: { role: string; parts: ({ text: string[] | string } | { image: string })[] }[];
    reply_schema?: { name: string; schema: Schema };
  };
}

const POLL_MS = 2000;

/** True if the studio was started with a folder of questions. */
export const isAsked = signal(false);
export const rows = signal<QuestionRow[]>([]);
export const open = computed(() => rows.value.filter((row) => !row.is_answered));
/** The question on display. */
export const shown = signal<Question | null>(null);
export const answer = signal<Json>(null);
export const isSending = signal(false);

/** Time for which the question was in view before it was last hidden, and since when it is in view, ms. */
let seen = { before: 0, since: 0 };

/** Polls for questions as long as the page is open. */
export function listen(): void {
  isAsked.value = true;
  document.addEventListener("visibilitychange", () => {
    if (document.hidden) pause();
    else if (store.dialog.peek() === "questions") resume();
  });
  void load();
  setInterval(() => document.hidden || void load(), POLL_MS);
}

/** Stops the clock of the question: the page or the dialogue is no longer in view. */
export function pause(): void {
  seen = { before: durationMs(), since: 0 };
}

/** Lets the clock run on. */
export function resume(): void {
  pause();
  seen.since = performance.now();
}

const durationMs = () => seen.before + (seen.since > 0 ? performance.now() - seen.since : 0);

/** Reads the list, and shows the oldest open question if none is shown. */
export async function load(): Promise<void> {
  const found = await json<{ questions: QuestionRow[] }>("/api/questions").catch(() => null);
  if (!found) return;
  rows.value = found.questions;
  const next = open.peek()[0];
  if (!shown.peek() && next && store.dialog.peek() === "questions") await show(next.name);
}

export async function show(name: string): Promise<void> {
  try {
    const found = await json<Question>(`/api/questions/${name}`);
    batch(() => {
      shown.value = found;
      answer.value = blank(found.question.reply_schema?.schema ?? { type: "string" });
    });
    seen = { before: 0, since: performance.now() };
  } catch (error) {
    store.notify((error as Error).message, { isError: true });
  }
}

/** Answers the question on display, then shows the next one. */
export async function send(): Promise<void> {
  const question = shown.peek();
  if (!question || isSending.peek()) return;
  isSending.value = true;
  const about = { author: store.author.peek(), duration_s: durationMs() / 1000, at: new Date().toISOString() };
  try {
    await json(`/api/questions/${question.name}/answer`, { answer: answer.peek(), ...about });
    store.status.value = `Question ${question.name} is answered.`;
    shown.value = null;
  } catch (error) {
    store.notify((error as Error).message, { isError: true });
  } finally {
    isSending.value = false;
  }
  await load();
}
