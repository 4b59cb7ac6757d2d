// The socket of this tab, and the sending of commands that wait.

import { batch, effect } from "@preact/signals";
import type { ServerMessage, ScenarioState, Placement } from "../contract.ts";
import { answered, backoff, nextToSend, resolved } from "../logic/outbox.ts";
import { empty, folded, type Verdict } from "../logic/verdict.ts";
import { hear, loadPolicies } from "./playback.ts";
import * as requests from "./requests.ts";
import {
  author,
  confirm,
  confirmed,
  entries,
  isDragging,
  isOnline,
  notify,
  openKey,
  presence,
  retryIn,
  scenarios,
  scene,
  select,
  show,
  status,
  stopped,
  verdict,
  wasOnline,
} from "./store.ts";

let socket: WebSocket | null = null;
let tries = 0;
let timer: ReturnType<typeof setTimeout> | undefined;
let isSending = false;
let sendTries = 0;

/** Connects now, and again for as long as the page is open. */
export function connect(): void {
  clearTimeout(timer);
  retryIn.value = null;
  const address = new URL(requests.address("/api/socket"), location.href);
  address.protocol = address.protocol.replace("http", "ws");
  const own = new WebSocket(address);
  socket = own;
  own.onopen = () => {
    tries = 0;
    batch(() => {
      isOnline.value = true;
      wasOnline.value = true;
    });
    sayOpen();
    sendTries = 0;
    void drain();
    void loadPolicies();
    if (!scenarios.value) void loadScenarios();
  };
  own.onmessage = (event) => receive(JSON.parse(String(event.data)) as ServerMessage);
  own.onclose = () => {
    if (socket !== own) return;
    socket = null;
    batch(() => {
      isOnline.value = false;
      presence.value = [];
    });
    const seconds = backoff(tries++) * (0.75 + Math.random() / 2);
    retryIn.value = seconds;
    timer = setTimeout(connect, seconds * 1000);
  };
}

/** Opens a scenario: its scene comes by the socket. */
export function open(key: string): void {
  if (openKey.value === key) return;
  batch(() => {
    openKey.value = key;
    confirmed.value = null;
    scene.value = null;
    verdict.value = empty(0);
    stopped.value = null;
  });
  sayOpen();
}

function sayOpen(): void {
  if (openKey.value) say({ type: "open", scenario: openKey.value, author: author.value });
}

/** Tells the server under which name this tab works. */
export function rename(name: string): void {
  author.value = name;
  sayOpen();
}

function say(message: object): boolean {
  if (socket?.readyState !== WebSocket.OPEN) return false;
  socket.send(JSON.stringify(message));
  return true;
}

let lastPreview = 0;

/** Asks for a quick verdict on poses that are not stored, at most 20 times a second. */
export function preview(objects: Placement[]): void {
  const now = performance.now();
  if (now - lastPreview < 50) return;
  lastPreview = now;
  say({ type: "preview", objects });
}

function receive(message: ServerMessage): void {
  switch (message.type) {
    case "scene":
      if (message.key === openKey.value) show(message);
      break;
    case "applied":
      acceptState(message.state, message.client_operation_id);
      break;
    case "conflict":
      entries.value = answered(entries.value, message.client_operation_id, { is: "conflict", conflict: message.conflict });
      break;
    case "refused":
      refuse(message.client_operation_id, message.error);
      break;
    case "verdict":
      // A preview that comes after its drag is no longer about what is shown.
      if (message.revision !== confirmed.value?.revision || (message.preview && !isDragging.value)) break;
      if (message.preview && !verdict.value.preview) stored = verdict.value;
      verdict.value = folded(verdict.value, message);
      if (message.error) notify("The verdict could not be completed.", { hint: message.error, isError: true });
      break;
    case "presence":
      presence.value = message.authors;
      break;
    case "run":
      hear(message.run);
      break;
    case "stopped":
      stopped.value = message.message;
      break;
  }
}

/** Verdict on the stored state, shown again after a drag. */
let stored: Verdict = empty(0);

effect(() => {
  if (isDragging.value) return;
  const shown = verdict.peek();
  if (shown.preview) verdict.value = stored.revision === shown.revision ? stored : empty(shown.revision);
});

/** A state that the server applied: by our request, or for another tab. */
function acceptState(state: ScenarioState, id: string): void {
  batch(() => {
    const entry = entries.value.find((one) => one.id === id);
    const key = state.key ?? entry?.key ?? openKey.value!;
    entries.value = answered(entries.value, id, { is: "applied", revision: state.revision, key });
    if (entry && key !== entry.key && entry.key === openKey.value) {
      // The first edit of a frozen scenario made a copy.
      notify("This scenario is frozen: you now edit a copy of it.");
      scene.value = scene.value && { ...scene.value, key, read_only: false, parent: entry.key };
      confirmed.value = state;
      verdict.value = empty(state.revision);
      openKey.value = key;
      sayOpen();
      void loadScenarios();
    } else if (key === openKey.value && confirmed.value) {
      // Whoever could not be stored before can be now, e.g. when the disk has room again.
      stopped.value = null;
      const before = new Set(confirmed.value.objects.map((object) => object.id));
      confirm(state);
      updateRow(key, state);
      const isNew = entry?.operation?.op === "add" || entry?.operation?.op === "duplicate";
      const added = isNew ? state.objects.find((object) => !before.has(object.id)) : undefined;
      if (added) select(added.id);
    }
  });
}

function updateRow(key: string, state: ScenarioState): void {
  scenarios.value =
    scenarios.value?.map((row) =>
      row.key === key
        ? { ...row, revision: state.revision, instruction: state.instruction, kind: state.kind, objects: state.objects.length }
        : row,
    ) ?? null;
}

function refuse(id: string, error: { message: string; hint?: string } | undefined): void {
  // Without an id it is an answer to `open`.
  if (id !== "" && !entries.value.some((entry) => entry.id === id)) return;
  entries.value = answered(entries.value, id, { is: "refused" });
  notify(error?.message ?? "The server refused the change.", { isError: true, ...(error?.hint ? { hint: error.hint } : {}) });
}

export async function loadScenarios(): Promise<void> {
  try {
    scenarios.value = await requests.scenarioRows();
  } catch (error) {
    if (isOnline.value) notify("The scenarios cannot be listed.", { hint: String((error as Error).message), isError: true });
  }
}

/** Sends what waits, one after the other, until nothing does. */
export async function drain(): Promise<void> {
  if (isSending) return;
  isSending = true;
  try {
    for (;;) {
      const entry = nextToSend(entries.value);
      if (!entry || !isOnline.value) return;
      entries.value = entries.value.map((one) => (one.id === entry.id ? { ...one, sent: true } : one));
      const { answer, state, error } = await requests.send(entry);
      switch (answer.is) {
        case "applied":
          if (sendTries > 0) status.value = "";
          sendTries = 0;
          acceptState({ ...(state as ScenarioState), key: answer.key }, entry.id);
          break;
        case "conflict":
          entries.value = answered(entries.value, entry.id, answer);
          break;
        case "refused":
          refuse(entry.id, error);
          break;
        case "lost":
          if (error) status.value = `Not stored yet: ${error.message}`;
          await new Promise((resolve) => setTimeout(resolve, backoff(sendTries++) * 1000));
      }
    }
  } finally {
    isSending = false;
  }
}

/** The author's choice in a conflict. */
export function resolve(id: string, choice: "mine" | "theirs"): void {
  entries.value = resolved(entries.value, id, choice, crypto.randomUUID());
  void drain();
}
