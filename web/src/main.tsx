// Start of the page: restores what was not sent, connects, draws.

import { render } from "preact";
import { App } from "./panels/App.tsx";
import { restored } from "./logic/outbox.ts";
import { connect, loadScenarios, open } from "./state/connection.ts";
import { openEpisode } from "./state/playback.ts";
import { listen as listenToQuestions } from "./state/questions.ts";
import { session } from "./state/requests.ts";
import { author, keepEntries, notify, openKey, scenarios, scene, storedEntries, version, waiting } from "./state/store.ts";
import { listenToKeys } from "./state/shortcuts.ts";
import "./style.css";

const NAME = "genmanip.studio.author";

function storedName(): string | null {
  try {
    return localStorage.getItem(NAME);
  } catch {
    return null;
  }
}

async function start(): Promise<void> {
  keepEntries(restored(storedEntries()));
  render(<App />, document.getElementById("app")!);
  listenToKeys();
  try {
    const known = await session();
    version.value = known.version;
    author.value = storedName() ?? known.author;
    if (known.asks) listenToQuestions();
  } catch (error) {
    author.value = storedName() ?? "editor";
    notify("The server does not answer yet.", { hint: (error as Error).message, isError: true });
  }
  // Closing the tab would lose what waits; a reload would not, but the browser does not tell them apart.
  window.addEventListener("beforeunload", (event) => waiting.value > 0 && event.preventDefault());
  scene.subscribe((shown) => (document.title = shown ? `${shown.id} · GenManip studio` : "GenManip studio"));
  author.subscribe((name) => {
    try {
      if (name) localStorage.setItem(NAME, name);
    } catch {
      // The name lasts as long as the page.
    }
  });
  connect();
  await loadScenarios();
  openFirst();
  window.addEventListener("hashchange", openFirst);
  openKey.subscribe((key) => key && history.replaceState(null, "", `#${encodeURIComponent(key)}`));
}

/** The scenario that the address names, and its episode after a slash; else the first scenario. */
function openFirst(): void {
  const [named = "", episode = ""] = location.hash.slice(1).split("/").map(decodeURIComponent);
  const rows = scenarios.value ?? [];
  const key = rows.find((row) => row.key === named)?.key ?? openKey.value ?? rows[0]?.key;
  if (key) open(key);
  if (key === named && episode) playOnceShown(key, episode);
}

function playOnceShown(key: string, episode: string): void {
  let isFound = false;
  const stop = scene.subscribe((shown) => {
    if (isFound || shown?.key !== key) return;
    isFound = true;
    // Later, since a newly shown scenario closes the episode of the one before.
    queueMicrotask(() => {
      stop();
      void openEpisode(episode);
    });
  });
}

void start();
