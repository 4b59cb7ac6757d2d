// Many tabs of one studio: every one sees the edits, reviews and jobs of the others, and the server's memory is bounded.

import assert from "node:assert/strict";
import { cpSync, mkdirSync } from "node:fs";
import path from "node:path";
import WebSocket from "ws";
import { openPage, until } from "./driver.mjs";
import { startStudio } from "./program.mjs";

/** Crowded, so that every tab has an object of its own. */
const SCENARIO = "appearance-200-00061-000";
/** Number of its objects, from the first, that carry none and lie in none: a bowl moves the tomato that lies in it. */
const FREE = 7;
/** Times that all tabs come and go, before the memory is taken and after. */
const CYCLES = 20;

export async function manyTabs(browser, program, folder, suite, count) {
  const scenes = path.join(folder, "scenes");
  mkdirSync(scenes, { recursive: true });
  cpSync(path.join(suite, `${SCENARIO}.json`), path.join(scenes, `${SCENARIO}.json`));
  const studio = await startStudio(program, folder, ["scenes"]);
  try {
    const atRest = studio.resident();
    const tabs = [];
    for (let index = 0; index < count; index++) {
      const script = [(name) => localStorage.setItem("genmanip.studio.author", name), `tab ${index}`];
      tabs.push(await openPage(browser, studio.url, { script, patience_s: 120 }));
    }
    const everybody = (work) => Promise.all(tabs.map(work));
    const objects = await tabs[0].locator("ul[aria-label=Objects] button").count();
    await everybody((page) => until("all are here", async () => (await page.textContent(".presence"))?.split(",").length === count - 1, 120_000));
    const revisionIs = (wanted) => everybody((page) => page.waitForFunction((value) => window.studio.state().revision === value, wanted));
    const lift = async (page, index) => {
      const button = page.locator("ul[aria-label=Objects] button").nth(index % objects);
      if ((await button.getAttribute("aria-pressed")) !== "true") await button.click();
      await page.keyboard.press("Shift+PageUp");
    };
    // One after the other, then all at once, each another object.
    let revision = 0;
    for (const [index, page] of tabs.entries()) {
      await lift(page, index);
      await revisionIs(++revision);
    }
    const together = tabs.slice(0, Math.min(objects, FREE));
    await Promise.all(together.map(lift));
    await revisionIs((revision += together.length));
    const state = (page) => page.evaluate(() => JSON.stringify({ ...window.studio.state(), can_undo: 0, can_redo: 0 }));
    const states = await Promise.all(tabs.map(state));
    assert.equal(new Set(states).size, 1, "all tabs show the same");
    // Two review, all see the outcome.
    await everybody((page) => page.getByRole("tab", { name: "Review" }).click());
    for (const page of tabs.slice(0, 2)) {
      await page.getByRole("button", { name: "duplicate" }).click();
      await page.getByRole("button", { name: "Reject" }).click();
    }
    await everybody((page) => page.waitForSelector(".review .chip:text('rejected')"));
    // One runs a policy, all get its episode.
    await everybody((page) => page.getByRole("tab", { name: "Runs" }).click());
    await tabs[2 % count].selectOption("#policy", "do_nothing");
    await tabs[2 % count].getByRole("button", { name: "Run", exact: true }).click();
    await everybody((page) => page.waitForSelector("ul[aria-label=Episodes] li:has-text('do_nothing')", { timeout: 120_000 }));
    for (const page of tabs) assert.deepEqual(page.failures, []);
    const busy = studio.resident();
    for (const page of tabs) await page.context().close();
    const visits = async () => {
      for (let cycle = 0; cycle < CYCLES; cycle++) await Promise.all(Array.from({ length: count }, () => visit(studio.url)));
      return studio.resident();
    };
    const early = await visits();
    const late = await visits();
    const mb = (bytes) => Math.round(bytes / 1e6);
    const found = `${count} tabs: server ${mb(atRest)} MB at rest, ${mb(busy)} MB with all, ${mb(early)} MB after ${count * CYCLES} visits, ${mb(late)} MB after ${2 * count * CYCLES}`;
    assert.ok(late <= early * 1.1 + 8e6, found);
    return found;
  } finally {
    await studio.kill();
  }
}

/** Opens the scenario as a tab does, waits for its whole verdict, and leaves. */
function visit(url) {
  return new Promise((resolve, reject) => {
    const socket = new WebSocket(new URL("/api/socket", url.replace("http", "ws")));
    const timer = setTimeout(() => reject(new Error("no verdict in a minute")), 60_000);
    socket.on("open", () => socket.send(JSON.stringify({ type: "open", scenario: SCENARIO, author: "visitor" })));
    socket.on("error", reject);
    socket.on("message", (text) => {
      const message = JSON.parse(String(text));
      if (message.type !== "verdict" || !message.done) return;
      clearTimeout(timer);
      socket.close();
      resolve();
    });
  });
}
