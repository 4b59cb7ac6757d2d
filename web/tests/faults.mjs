// Two people edit one scenario while connection, server, token and disk fail at random.

import assert from "node:assert/strict";
import { openPage, ready, until } from "./driver.mjs";
import { EDIT_FAULTS, FaultyProxy } from "./proxy.mjs";

const STEP_M = 0.001;
const PATIENCE_MS = 90_000;
/** Faults of the connection, which a server of any kind stands. */
export const CONNECTION = [...EDIT_FAULTS, "cut", "reload"];
/** Faults that need the program: killed, started with another token, without room for its files. */
export const SERVER = ["restart", "expire", "full"];

/** Random whole numbers below `bound`, repeated by the seed (mulberry32). */
function randomOf(seed) {
  let state = seed >>> 0;
  return (bound) => {
    state = (state + 0x6d2b79f5) >>> 0;
    let mixed = Math.imul(state ^ (state >>> 15), state | 1);
    mixed ^= mixed + Math.imul(mixed ^ (mixed >>> 7), mixed | 61);
    return Math.floor((((mixed ^ (mixed >>> 14)) >>> 0) / 2 ** 32) * bound);
  };
}

/** A person with a page, an object, and what that person did to it. */
class Editor {
  made = 0;
  offset_m = 0;
  #done = [];
  #undone = [];

  constructor(page, index) {
    this.page = page;
    this.index = index;
  }

  async take() {
    await ready(this.page);
    const button = this.page.locator("ul[aria-label=Objects] button").nth(this.index);
    if ((await button.getAttribute("aria-pressed")) !== "true") await button.click();
  }

  async move(isUp) {
    await this.page.keyboard.press(isUp ? "Shift+PageUp" : "Shift+PageDown");
    this.#did(isUp ? STEP_M : -STEP_M);
    this.#undone = [];
  }

  /** Undoes the last change, or does the last undone one again; false when there is none. */
  async step(isUndo) {
    const by = (isUndo ? this.#done : this.#undone).pop();
    if (by === undefined) return false;
    await this.page.keyboard.press(isUndo ? "Control+z" : "Control+y");
    if (isUndo) {
      this.made += 1;
      this.offset_m -= by;
      this.#undone.push(by);
    } else {
      this.#did(by);
    }
    return true;
  }

  #did(by_m) {
    this.made += 1;
    this.offset_m += by_m;
    this.#done.push(by_m);
  }

  /** The server has everything that this page did, and the page can be edited. */
  settled() {
    return this.page.waitForFunction(() => window.studio?.waiting() === 0 && /connected/.test(document.querySelector(".bottom .dot.on + span")?.textContent ?? "") && !document.querySelector(".banner"), null, { timeout: PATIENCE_MS });
  }

  height_m() {
    return this.page.evaluate((index) => window.studio.state().objects[index].pose.position_m[2], this.index);
  }
}

/** Runs in each page before its own scripts: its author, and nothing is drawn, since nobody looks. */
function prepare(author) {
  if (location.protocol !== "http:") return;
  localStorage.setItem("genmanip.studio.author", author);
  for (const draw of ["drawArrays", "drawElements"]) WebGL2RenderingContext.prototype[draw] = () => undefined;
}

/** The state without what depends on who asks. */
const shared = ({ can_undo: _undo, can_redo: _redo, key: _key, ...state }) => state;

/** Lets `count` faults of the `kinds` happen to two editors of scenario `key`, and checks that every edit arrived exactly
 * once and that both pages and the server end with equal states. `server` has a `port`, and for faults of `SERVER` a
 * function `again` that kills it and starts it on the same port; without it nothing is undone, since the mock server takes
 * back the others' changes too. The first cut lasts `cut_s` seconds. */
export async function withstand(browser, server, key, { count, seed, kinds = CONNECTION, cut_s = 0.5 }) {
  const random = randomOf(seed);
  const proxy = await FaultyProxy.before(server.port);
  const address = (token) => `${proxy.url}${token ? `?token=${token}` : ""}#${encodeURIComponent(key)}`;
  const ask = async (path = "") => {
    const head = server.token ? { authorization: `Bearer ${server.token}` } : {};
    const answer = await fetch(`http://127.0.0.1:${server.port}/api/scenarios/${encodeURIComponent(key)}${path}`, { headers: head });
    assert.equal(answer.status, 200, path);
    return answer.json();
  };
  const editors = [];
  for (const [index, name] of ["ada", "bo"].entries()) {
    const script = [prepare, name];
    editors.push(new Editor(await openPage(browser, address(server.token), { script, patience_s: 120 }), index));
    await editors[index].take();
  }
  const start = await Promise.all(editors.map((editor) => editor.height_m()));
  const known = (await ask("/history")).length;
  const edits = async (most) => {
    for (const editor of editors) for (let left = random(most + 1); left > 0; left--) await editor.move(random(2) === 0);
  };
  const everybody = (work) => Promise.all(editors.map(work));
  let token = server.token;
  /** Starts the server again; another token is taken by the pages from the address that they load. */
  const again = async (options, meanwhile = () => undefined) => {
    await Promise.all([server.again(options), meanwhile()]);
    if (server.token === token) return;
    token = server.token;
    await everybody(async (editor) => {
      // Another address with the same page: only a load takes the new token.
      await editor.page.goto("about:blank");
      await editor.page.goto(address(token));
      await editor.take();
    });
  };
  let [cuts, firstCut] = [{}, cut_s * 1000];
  const faults = {
    cut: async () => {
      proxy.cut(true);
      await everybody(({ page }) => page.waitForSelector(".banner:has-text('Offline')"));
      await edits(2);
      await editors[0].move(true);
      const waiting = await editors[0].page.textContent(".banner");
      assert.match(waiting, /Offline, [1-9]\d* edits? waiting/, "the page says what waits");
      await editors[0].page.waitForTimeout(firstCut || 100 + random(900));
      firstCut = 0;
      proxy.cut(false);
    },
    reload: async () => {
      proxy.spoil(["unanswered", "late"][random(2)]);
      await editors[0].move(random(2) === 0);
      await editors[0].page.reload();
      await editors[0].take();
    },
    restart: async () => {
      await again({}, () => edits(2));
    },
    expire: async () => {
      await again({ isTokenNeeded: !server.token }, () => edits(2));
    },
    full: async () => {
      await again({ isFull: true });
      await everybody((editor) => editor.settled());
      await editors[random(2)].move(random(2) === 0);
      await editors[0].page.waitForTimeout(300);
      await again({});
    },
  };
  for (let number = 0; number < count; number++) {
    if (number > 0 && number % 50 === 0) console.log(`        ${number} of ${count} faults`);
    const kind = kinds[random(kinds.length)];
    cuts[kind] = (cuts[kind] ?? 0) + 1;
    try {
      if (faults[kind]) {
        await faults[kind]();
      } else {
        const struck = proxy.struck;
        proxy.spoil(kind);
        await editors[random(2)].move(random(2) === 0);
        await edits(2);
        await until("the fault happens", () => proxy.struck > struck, PATIENCE_MS);
      }
      await everybody((editor) => editor.settled());
      // The undone edit was acknowledged: one that still waits would be withdrawn instead.
      for (const editor of editors) {
        if (server.again && random(3) === 0 && (await editor.step(random(2) === 0))) await editor.settled();
      }
    } catch (error) {
      error.message = `fault ${number} (${kind}) of seed ${seed}: ${error.message}`;
      throw error;
    }
  }
  const newest = () => ask().then((scene) => scene.state);
  const made = editors.reduce((sum, editor) => sum + editor.made, 0);
  const lines = (await ask("/history")).slice(known);
  const ids = new Set(lines.map((line) => line.client_operation_id));
  assert.deepEqual([lines.length, ids.size], [made, made], "every edit arrived exactly once");
  const state = await newest();
  for (const [index, editor] of editors.entries()) {
    await editor.page.waitForFunction((revision) => window.studio.state().revision === revision, state.revision);
    assert.deepEqual(shared(await editor.page.evaluate(() => window.studio.state())), shared(state), "page and server have equal states");
    assert.ok(Math.abs((await editor.height_m()) - start[index] - editor.offset_m) < 1e-6, "the object is where it was moved to");
    assert.deepEqual(editor.page.failures.filter((failure) => !/40[139]|503/.test(failure)), []);
  }
  if (server.again) {
    await server.again();
    assert.equal(JSON.stringify(shared(await newest())), JSON.stringify(shared(state)), "the disk has the same bytes");
  }
  for (const { page } of editors) await page.context().close();
  await proxy.close();
  return { faults: count, edits: made, kinds: cuts };
}
