// Frame of the page: header, three columns, dialogues, what is told.

import { useEffect } from "preact/hooks";
import { connect, open, resolve } from "../state/connection.ts";
import { redo, undo } from "../state/edits.ts";
import * as questions from "../state/questions.ts";
import * as store from "../state/store.ts";
import { summary } from "../logic/verdict.ts";
import { operationWords, valueWords } from "../logic/operations.ts";
import { theme, toggleTheme } from "../state/theme.ts";
import { CameraImage } from "./CameraImage.tsx";
import { CamerasTab } from "./CamerasTab.tsx";
import { CatalogueDialog } from "./CatalogueDialog.tsx";
import { AuthorDialog, HelpDialog, InstructionDialog, SnapshotDialog } from "./dialogs.tsx";
import { EdgesDialog, GoalDialog } from "./GoalDialogs.tsx";
import { HistoryTab } from "./HistoryTab.tsx";
import { NewDialog } from "./NewDialog.tsx";
import { ObjectsTab } from "./ObjectsTab.tsx";
import { QuestionsDialog } from "./QuestionsDialog.tsx";
import { RunsTab } from "./RunsTab.tsx";
import { BalanceDialog, SheetDialog } from "./ReviewDialogs.tsx";
import { ReviewTab } from "./ReviewTab.tsx";
import { ScenarioList } from "./ScenarioList.tsx";
import { TaskPanel } from "./TaskPanel.tsx";
import { VerdictPanel } from "./VerdictPanel.tsx";
import { ViewPanel } from "./ViewPanel.tsx";
import { Dialog, Icon, withKeys } from "./widgets.tsx";

export function App() {
  return (
    <div class="app">
      <Header />
      <Banners />
      <main class="columns">
        <ScenarioList />
        <div class="middle">
          <ViewPanel />
          <div class="dock">
            <VerdictPanel />
            <CameraImage />
          </div>
        </div>
        <aside class="right" aria-label="Task and objects">
          <TaskPanel />
          <Tabs />
        </aside>
      </main>
      <Footer />
      <OpenDialog />
      <ConflictDialog />
    </div>
  );
}

function Header() {
  const shown = store.scene.value;
  const state = store.current.value;
  const others = [...new Set(store.presence.value)].filter((name) => name !== store.author.value);
  const verdict = store.verdict.value;
  const blocking = store.problems.value.some((problem) => problem.blocking);
  return (
    <header class="top">
      <h1>
        GenManip <span>studio</span>
      </h1>
      <div class="title">
        {shown && (
          <>
            <strong>{shown.id}</strong>
            <span class="muted">
              {shown.source}
              {shown.parent ? ", a copy" : ""}
            </span>
            {shown.read_only && (
              <span class="chip" title="The first edit makes a copy that names this scenario as its parent.">
                <Icon name="lock" /> frozen: the first edit makes a copy
              </span>
            )}
          </>
        )}
      </div>
      {state && (
        <span class={`chip verdict ${!verdict.done ? "waiting" : blocking ? "blocking" : "ok"}`}>
          revision {state.revision}: {summary(verdict)}
        </span>
      )}
      {others.length > 0 && <span class="chip presence">also here: {others.join(", ")}</span>}
      <div class="buttons">
        {questions.isAsked.value && (
          <button type="button" title={withKeys("Answer in place of a model", "questions")} onClick={() => (store.dialog.value = "questions")}>
            Questions{questions.open.value.length > 0 && <span class="open-questions">{questions.open.value.length}</span>}
          </button>
        )}
        <button type="button" title={withKeys("Undo", "undo")} aria-label="Undo" disabled={!state?.can_undo && store.waiting.value === 0} onClick={undo}>
          <Icon name="undo" />
        </button>
        <button type="button" title={withKeys("Redo", "redo")} aria-label="Redo" disabled={!state?.can_redo} onClick={redo}>
          <Icon name="redo" />
        </button>
        <button type="button" title={withKeys("Light or dark", "theme")} aria-label="Dark colours" aria-pressed={theme.value === "dark"} onClick={toggleTheme}>
          <Icon name="moon" />
        </button>
        <button type="button" title={withKeys("Keys", "help")} aria-label="Keys" onClick={() => (store.dialog.value = "help")}>
          ?
        </button>
        <button type="button" class="author" title="Your name in the history" onClick={() => (store.dialog.value = "author")}>
          {store.author.value || "…"}
        </button>
      </div>
    </header>
  );
}

function Banners() {
  const waiting = store.waiting.value;
  const isOffline = store.wasOnline.value && !store.isOnline.value;
  const edits = `${waiting} ${waiting === 1 ? "edit" : "edits"} waiting`;
  return (
    <div class="banners">
      {isOffline && (
        <div class="banner warning" role="status">
          <span>
            Offline, {edits}. {waiting > 0 ? "They are sent when the server answers again." : "You can go on editing."}
          </span>
          <button type="button" onClick={connect}>
            Connect now
          </button>
        </div>
      )}
      {store.stopped.value && (
        <div class="banner danger" role="alert">
          <span>Editing is stopped: {store.stopped.value}</span>
          <button
            type="button"
            onClick={() => {
              const key = store.openKey.peek();
              store.openKey.value = null;
              if (key) open(key);
            }}
          >
            Read it again
          </button>
        </div>
      )}
    </div>
  );
}

const TABS = [
  ["objects", "Objects"],
  ["cameras", "Cameras"],
  ["history", "History"],
  ["runs", "Runs"],
  ["review", "Review"],
] as const;

function Tabs() {
  const current = store.tab.value;
  const onKeyDown = (event: KeyboardEvent) => {
    const by = event.key === "ArrowRight" ? 1 : event.key === "ArrowLeft" ? -1 : 0;
    if (by === 0) return;
    event.preventDefault();
    event.stopPropagation();
    const at = TABS.findIndex(([name]) => name === current);
    const [next] = TABS[(at + by + TABS.length) % TABS.length]!;
    store.tab.value = next;
    document.getElementById(`tab-${next}`)?.focus();
  };
  return (
    <section class="tabs">
      <div role="tablist" aria-label="Details" onKeyDown={onKeyDown}>
        {TABS.map(([name, words]) => (
          <button
            key={name}
            id={`tab-${name}`}
            type="button"
            role="tab"
            aria-selected={current === name}
            aria-controls="tab-panel"
            tabIndex={current === name ? 0 : -1}
            onClick={() => (store.tab.value = name)}
          >
            {words}
          </button>
        ))}
      </div>
      <div id="tab-panel" role="tabpanel" aria-labelledby={`tab-${current}`} class="panel" tabIndex={0}>
        {current === "objects" && <ObjectsTab />}
        {current === "cameras" && <CamerasTab />}
        {current === "history" && <HistoryTab />}
        {current === "runs" && <RunsTab />}
        {current === "review" && <ReviewTab />}
      </div>
    </section>
  );
}

function Footer() {
  const [loaded, wanted] = store.meshes.value;
  const left = store.waiting.value;
  return (
    <footer class="bottom">
      <span class={store.isOnline.value ? "dot on" : "dot"} aria-hidden="true" />
      <span>{store.isOnline.value ? "connected" : "not connected"}</span>
      {left > 0 && <span>{left === 1 ? "1 edit is being stored" : `${left} edits are being stored`}</span>}
      <span class="status" role="status" aria-live="polite">
        {store.status.value}
      </span>
      {loaded < wanted && (
        <span>
          meshes {loaded} of {wanted}
        </span>
      )}
      {store.detail.value > 0 && (
        <button type="button" class="quiet" title="Frames were slow, so moving images are drawn coarser." onClick={() => (store.detail.value = 0)}>
          detail lowered while moving
        </button>
      )}
      <span class="muted">genmanip {store.version.value}</span>
      <div class="notices">
        {store.notices.value.map((notice) => (
          <div key={notice.id} class={`notice ${notice.isError ? "danger" : ""}`} role={notice.isError ? "alert" : "status"}>
            <div>
              <p>{notice.words}</p>
              {notice.hint && <p class="muted">{notice.hint}</p>}
            </div>
            <button type="button" class="quiet" aria-label="Dismiss" onClick={() => store.dismiss(notice.id)}>
              <Icon name="close" />
            </button>
          </div>
        ))}
      </div>
    </footer>
  );
}

function OpenDialog() {
  const name = store.dialog.value;
  // The close event of a dialogue comes late: by then another one may be open.
  const close = () => store.dialog.peek() === name && (store.dialog.value = null);
  // An object that somebody else removed takes its dialogue with it.
  const isLost = name === "swap" && !store.selected.value;
  useEffect(() => {
    if (isLost) close();
  }, [isLost]);
  switch (isLost ? null : name) {
    case "help":
      return <HelpDialog onClose={close} />;
    case "add":
    case "swap":
      return <CatalogueDialog purpose={name as "add" | "swap"} onClose={close} />;
    case "instruction":
      return <InstructionDialog onClose={close} />;
    case "new":
      return <NewDialog onClose={close} />;
    case "goal":
      return <GoalDialog onClose={close} />;
    case "edges":
      return <EdgesDialog onClose={close} />;
    case "snapshot":
      return <SnapshotDialog onClose={close} />;
    case "author":
      return <AuthorDialog onClose={close} />;
    case "sheet":
      return <SheetDialog onClose={close} />;
    case "questions":
      return <QuestionsDialog onClose={close} />;
    case "balance":
      return <BalanceDialog onClose={close} />;
    default:
      return null;
  }
}

/** Both values of a field that two people changed; the later one chooses. */
function ConflictDialog() {
  const entry = store.conflicting.value;
  const state = store.confirmed.value;
  if (!entry?.conflict) return null;
  const { field, mine, theirs } = entry.conflict;
  const words = entry.operation && state ? operationWords(entry.operation.op, entry.operation.args as never, state) : entry.what;
  const choose = (choice: "mine" | "theirs") => resolve(entry.id, choice);
  return (
    <Dialog key={entry.id} title="Somebody else changed this too" onClose={() => choose("theirs")}>
      <p>
        Your change ({words}) and a newer one are about the same thing: <strong>{fieldWords(field)}</strong>.
      </p>
      <div class="versions">
        <div>
          <h3>Yours</h3>
          <p class="value">{valueWords(mine)}</p>
          <button type="button" class="primary" onClick={() => choose("mine")}>
            Keep mine
          </button>
        </div>
        <div>
          <h3>Theirs</h3>
          <p class="value">{valueWords(theirs)}</p>
          <button type="button" onClick={() => choose("theirs")}>
            Take theirs
          </button>
        </div>
      </div>
    </Dialog>
  );
}

function fieldWords(field: string): string {
  const [what, id, part] = field.split("/");
  const state = store.confirmed.peek();
  if (what === "objects" && id && state) {
    const name = state.objects.find((object) => object.id === id)?.name ?? id;
    return part ? `${part} of ${name}` : name;
  }
  return field.replaceAll("/", " ");
}
