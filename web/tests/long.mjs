// Long tests of the page with the real program, in Chromium; `cargo xtask test web --long` runs them all:
// `node tests/long.mjs --program PATH [--seed S] [--tabs N] [--faults N] [--cut-s S] [--orbit-s S] [--suite N] [PART…]`.

import assert from "node:assert/strict";
import { cpSync, existsSync, mkdirSync, mkdtempSync, rmSync } from "node:fs";
import { tmpdir } from "node:os";
import path from "node:path";
import { fileURLToPath } from "node:url";
import { parseArgs } from "node:util";
import { CHROMIUM, launch, openPage } from "./driver.mjs";
import { CONNECTION, SERVER, withstand } from "./faults.mjs";
import { startMock } from "./mock.mjs";
import { assertFlat, countContexts, orbit, turn } from "./orbit.mjs";
import { startStudio } from "./program.mjs";
import { manyTabs } from "./tabs.mjs";
import { trial } from "./trial.mjs";

const number = (value) => ({ type: "string", default: String(value) });
const { values, positionals } = parseArgs({
  options: { program: { type: "string" }, shots: { type: "string" }, seed: number(1), tabs: number(10), faults: number(500), "cut-s": number(60), "orbit-s": number(600), suite: number(20) },
  allowPositionals: true,
});
const SUITES = path.join(path.dirname(fileURLToPath(import.meta.url)), "../../suites");
const SCENARIOS = path.join(SUITES, "genmanip-200-rc/scenarios");
const FILE = "009_appearance-000.json";

/** Parts in their order: each takes the browser and an empty folder, and answers with its figures. */
const PARTS = {
  tabs: (browser, folder) => manyTabs(browser, values.program, folder, SCENARIOS, Number(values.tabs)),
  trial: (browser, folder) => trial(browser, values.program, folder, SUITES, Number(values.suite), shot),
  faults,
  orbit: orbiting,
};

async function shot(page, name) {
  if (!values.shots) return;
  mkdirSync(values.shots, { recursive: true });
  await page.screenshot({ path: path.join(values.shots, `${name}.png`) });
}

async function faults(browser, folder) {
  cpSync(path.join(SCENARIOS, FILE), path.join(folder, FILE));
  let studio = await startStudio(values.program, folder, [FILE]);
  const server = {
    port: studio.port,
    token: null,
    /** Kills the program and starts it again: with or without a token, with or without room for what it writes. */
    async again({ isTokenNeeded = Boolean(this.token), isFull = false } = {}) {
      await studio.kill();
      // Enough to open the scenario, not to write one more edit.
      const limits = isFull ? { fileKib: 0 } : {};
      studio = await startStudio(values.program, folder, [FILE], { port: this.port, options: isTokenNeeded ? ["--allow-others"] : [], ...limits });
      this.token = studio.token;
    },
  };
  try {
    const found = await withstand(browser, server, path.parse(FILE).name, { count: Number(values.faults), seed: Number(values.seed), kinds: [...CONNECTION, ...SERVER], cut_s: Number(values["cut-s"]) });
    return `${found.edits} edits arrived once through ${found.faults} faults: ${JSON.stringify(found.kinds)}`;
  } finally {
    await studio.kill();
  }
}

async function orbiting(browser) {
  const mock = await startMock({ scenarios: 2, extraObjects: 36 });
  try {
    const page = await openPage(browser, mock.url, { script: [countContexts] });
    await page.waitForFunction(() => document.querySelectorAll(".objects li").length >= 40);
    await turn(page, 5);
    const found = await orbit(page, Number(values["orbit-s"]));
    const { early, late } = found;
    assertFlat(found);
    assert.deepEqual(page.failures, []);
    return `${values["orbit-s"]} s around 40 objects: heap ${(early.heap / 1e6).toFixed(1)} to ${(late.heap / 1e6).toFixed(1)} MB, ${early.geometries} to ${late.geometries} geometries, ${late.contexts} context of the GPU, at least ${found.slowest.toFixed(0)} frames a second${found.isLowered ? " with lowered detail" : ""}`;
  } finally {
    await mock.close();
  }
}

const unknown = positionals.find((name) => !PARTS[name]);
if (unknown || !values.program || !existsSync(values.program) || !existsSync(CHROMIUM)) {
  console.error(unknown ? `there is no part ${unknown}: ${Object.keys(PARTS).join(", ")}` : `--program PATH and Chromium (${CHROMIUM}) are needed`);
  process.exit(2);
}
const browser = await launch();
let failed = 0;
for (const name of positionals.length > 0 ? positionals : Object.keys(PARTS)) {
  const folder = mkdtempSync(path.join(tmpdir(), "genmanip-long-"));
  const start = Date.now();
  const seconds = () => ((Date.now() - start) / 1000).toFixed(0);
  try {
    const figures = await PARTS[name](browser, folder);
    console.log(`ok      ${name} (${seconds()} s): ${figures}`);
    rmSync(folder, { recursive: true });
  } catch (error) {
    failed += 1;
    for (const [index, context] of browser.contexts().entries()) if (context.pages()[0]) await shot(context.pages()[0], `failed-${name}-${index}`).catch(() => undefined);
    console.log(`FAILED  ${name} (${seconds()} s), its files are in ${folder}\n${`${error.message}\n${error.stack}`.replace(/^/gm, "        ")}`);
  }
  for (const context of browser.contexts()) await context.close();
}
await browser.close();
process.exit(failed > 0 ? 1 : 0);
