// The first hour of somebody who has no manual: a faulty scenario of a run is found, repaired, approved and put into a
// suite, all by what the page shows; then a suite of more.

import assert from "node:assert/strict";
import { execFileSync } from "node:child_process";
import { cpSync, mkdirSync, readFileSync, readdirSync } from "node:fs";
import path from "node:path";
import { openPage, until, untilChecked } from "./driver.mjs";
import { startStudio } from "./program.mjs";

const SUITE = "genmanip-200-rc";
const MOST_MINUTES = 5;
/** Time for the expert to solve a scenario five times on a busy machine. */
const EXPERT_MS = 240_000;
const BESIDE = ["009_appearance-000", "010_appearance-000", "015_spatial-000"];

const button = (page, name) => page.getByRole("button", { name });

/** A run of the expert on sound scenarios and on one in which every grasp hits a neighbour; answers the id of that one. */
function prepare(program, folder, suites) {
  const run = (...args) => execFileSync(program, args, { cwd: folder, stdio: ["ignore", "ignore", "pipe"] });
  run("review", path.join(suites, SUITE), "--plant", "faulty", "--faults", "8", "--seed", "7");
  const lines = readFileSync(path.join(folder, "faulty.txt"), "utf8").split("\n").map((line) => line.split(" "));
  const [id] = lines.find(([, fault]) => fault === "grasp_blocked");
  const sound = BESIDE.map((name) => path.join(suites, SUITE, "scenarios", `${name}.json`));
  run("evaluate", `faulty/${id}.json`, ...sound, "--policy", "expert", "--out", "run");
  return id;
}

const person = (browser, url, name) => openPage(browser, url, { script: [(author) => localStorage.setItem("genmanip.studio.author", author), name], patience_s: 120 });

/** The stored state that the page shows, such as `abc@2`: a first edit of a frozen scenario makes a copy, of another key. */
const stored = () => window.studio.state() && `${window.studio.state().key}@${window.studio.state().revision}`;

/** Applies the first repair of every problem in turn until the verdict names none. */
async function repair(page) {
  for (let step = 0; step < 6; step++) {
    await untilChecked(page);
    const problems = page.getByRole("list", { name: "Problems" });
    if ((await problems.getByText("Nothing is wrong").count()) > 0) return step;
    const before = await page.evaluate(stored);
    const show = problems.getByRole("button", { name: "Show repairs" });
    if ((await problems.locator(".repairs button:not(:text('Show repairs'))").count()) === 0) await show.first().click();
    await problems.locator(".repairs button:not(:text('Show repairs'))").first().click({ timeout: 60_000 });
    await until("the repair is stored", async () => ![before, undefined].includes(await page.evaluate(stored)));
  }
  throw new Error(`not repaired: ${await page.locator(".problems").innerText()}`);
}

async function approve(page) {
  await page.getByRole("tab", { name: "Review" }).click();
  await button(page, "Approve").click();
  await page.getByRole("list", { name: "Reviews" }).getByText("approved").first().waitFor();
}

/** Writes the suite from the dialogue; answers the ids that it lists. */
async function write(page, name, approved) {
  await button(page, "Balance and suite").click();
  await page.getByRole("heading", { name: `Balance of ${approved} approved` }).waitFor();
  await page.getByLabel("Suite", { exact: true }).fill(name);
  await button(page, "Write the suite").click();
  const items = page.getByRole("list", { name: "Scenarios of the suite" }).getByRole("listitem");
  await items.first().waitFor();
  await page.getByRole("list", { name: "Suites" }).getByText(`Suite ${name}:`).waitFor();
  return (await items.allInnerTexts()).map((text) => text.split(" ")[0]);
}

/** The trial; then, with `size`, a suite of that many scenarios, reviewed by the same two. */
export async function trial(browser, program, folder, suites, size, shot) {
  mkdirSync(folder, { recursive: true });
  const id = prepare(program, folder, suites);
  const report = [];
  let studio = await startStudio(program, folder, ["run"]);
  try {
    const start = Date.now();
    const page = await person(browser, studio.url, "ada");
    // Found by the words of its problem.
    await button(page, "Check all").click();
    const row = page.getByRole("navigation", { name: "Scenarios" }).getByRole("button", { name: /would hit/ });
    await row.waitFor({ timeout: 120_000 });
    await shot(page, "trial-found");
    await row.click();
    await untilChecked(page);
    const problem = page.getByRole("list", { name: "Problems" }).getByText(/^\W*(Problem: )?Every grasp of .* would hit the .* beside it/i);
    assert.equal(await problem.count(), 1, "the verdict names the neighbour");
    const repairs = await repair(page);
    await shot(page, "trial-repaired");
    await approve(page);
    await page.getByText("1 of 2 reviews; somebody else gives the second").waitFor();
    await shot(page, "trial-approved");
    // A colleague gives the second review: the queue begins with what completes a pair.
    const colleague = await person(browser, studio.url, "bo");
    await colleague.getByRole("tab", { name: "Review" }).click();
    await button(colleague, "Next").click();
    await colleague.waitForFunction((wanted) => document.querySelector("header strong")?.textContent === wanted && window.studio.state()?.revision > 0, id);
    await untilChecked(colleague);
    await approve(colleague);
    await colleague.getByText("the expert solved it 5 of 5 times").waitFor({ timeout: EXPERT_MS });
    const listed = await write(page, "reviewed", 1);
    await shot(page, "trial-suite");
    assert.deepEqual(listed, [id]);
    const minutes = (Date.now() - start) / 60_000;
    report.push(`found, repaired in ${repairs} ${repairs === 1 ? "step" : "steps"}, approved by two and in the suite after ${minutes.toFixed(1)} minutes`);
    assert.ok(minutes <= MOST_MINUTES, report[0]);
    for (const one of [page, colleague]) {
      assert.deepEqual(one.failures, []);
      await one.context().close();
    }
    assert.deepEqual(idsOf(folder, "reviewed"), [id]);
    if (size > 1) {
      await studio.kill();
      place(folder, suites, id, size);
      studio = await startStudio(program, folder, ["run", "more"]);
      report.push(await reviewMore(browser, studio, size, folder));
    }
  } finally {
    await studio.kill();
  }
  return report.join("; ");
}

const idsOf = (folder, name) => JSON.parse(readFileSync(path.join(folder, "studio", name, "suite.json"), "utf8")).scenarios.map((entry) => entry.id);

/** Sound scenarios for a suite of `size`, the same number of each kind. */
function place(folder, suites, id, size) {
  const from = path.join(suites, SUITE, "scenarios");
  const kindOf = (name) => JSON.parse(readFileSync(path.join(from, name), "utf8")).task.kind;
  const names = readdirSync(from).sort();
  const there = [`${id}.json`, ...BESIDE.map((name) => `${name}.json`)];
  const room = new Map();
  for (const name of names) if (!room.has(kindOf(name))) room.set(kindOf(name), 0);
  for (const kind of room.keys()) room.set(kind, size / room.size);
  for (const name of there) room.set(kindOf(name), room.get(kindOf(name)) - 1);
  mkdirSync(path.join(folder, "more"));
  for (const name of names.filter((name) => !there.includes(name))) {
    const left = room.get(kindOf(name));
    if (left > 0) cpSync(path.join(from, name), path.join(folder, "more", name));
    room.set(kindOf(name), left - 1);
  }
}

/** Two people approve what the verdict finds sound, by keys, and one writes the suite. */
async function reviewMore(browser, studio, size, folder) {
  const start = Date.now();
  let reviewed = 0;
  for (const name of ["ada", "bo"]) {
    const page = await person(browser, studio.url, name);
    await page.getByRole("tab", { name: "Review" }).click();
    for (let last; ; last = await page.evaluate(stored)) {
      const left = page.getByLabel("Number");
      await left.waitFor();
      await page.keyboard.press("q");
      await until("the next one is open", async () => (await left.textContent()) === "0" || ![last, undefined].includes(await page.evaluate(stored)), 30_000);
      if ((await left.textContent()) === "0") break;
      await untilChecked(page);
      await page.waitForFunction(() => document.querySelector(".review .criteria"));
      const before = Number(await left.textContent());
      await page.keyboard.press("Shift+Y");
      await until("the review is kept", async () => Number(await left.textContent()) < before, 30_000);
      reviewed += 1;
    }
    assert.deepEqual(page.failures, []);
    if (name === "bo") {
      const rate = (reviewed * 3_600_000) / (Date.now() - start);
      const state = async () => (await (await fetch(new URL("/api/balance", studio.url))).json()).balance.scenarios;
      await until("the expert has solved them", async () => (await state()) === size, size * EXPERT_MS);
      const listed = await write(page, "more", size);
      assert.equal(listed.length, size);
      assert.deepEqual(idsOf(folder, "more").sort(), listed.sort());
      return `${reviewed} further reviews at ${rate.toFixed(0)} an hour, a suite of ${size} after ${((Date.now() - start) / 60_000).toFixed(1)} minutes`;
    }
    await page.context().close();
  }
}
