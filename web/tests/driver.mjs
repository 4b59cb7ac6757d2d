// Chromium and what every browser test does with a page of the studio.

import { AxeBuilder } from "@axe-core/playwright";
import path from "node:path";
import { fileURLToPath } from "node:url";
import { chromium } from "playwright-core";

export const CHROMIUM = process.env["CHROMIUM"] ?? "/usr/bin/chromium";
const FLAGS = [
  "--headless=new",
  "--no-sandbox",
  "--use-angle=swiftshader",
  "--enable-unsafe-swiftshader",
  "--disable-quic",
  "--no-first-run",
  "--disable-background-networking",
  "--disable-component-update",
  "--disable-sync",
  "--enable-precise-memory-info",
  "--js-flags=--expose-gc",
];
const DIST = path.join(path.dirname(fileURLToPath(import.meta.url)), "../dist");
export const SIZE = { width: 1366, height: 768 };

export const launch = () => chromium.launch({ executablePath: CHROMIUM, args: FLAGS });

/** A page of its own, with a list of its `failures`. `script`, a function and its argument, runs in it before the page
 * does; `isDist` takes the scripts of this folder in place of the program's own; `patience_s` bounds each wait. */
export async function openPage(browser, url, { script = null, isDist = false, patience_s = 30, ...options } = {}) {
  const context = await browser.newContext({ viewport: SIZE, ...options });
  context.setDefaultTimeout(1000 * patience_s);
  if (isDist) await context.route(/\/assets\//, (route) => route.fulfill({ path: path.join(DIST, new URL(route.request().url()).pathname) }));
  const page = await context.newPage();
  if (script) await page.addInitScript(...script);
  page.failures = [];
  page.on("dialog", (dialog) => dialog.accept());
  page.on("pageerror", (error) => page.failures.push(error.stack ?? error.message));
  page.on("console", (message) => message.type() === "error" && !/ERR_|WebSocket/.test(message.text()) && page.failures.push(message.text()));
  await page.goto(url);
  await ready(page);
  return page;
}

/** The scene is shown: list and meshes are there. */
export async function ready(page) {
  await page.waitForSelector(".objects button");
  await page.waitForFunction(() => {
    const figures = window.studio?.figures();
    return figures && figures.meshes > 3 && figures.frames > 1;
  });
}

export const revision = (page) => page.evaluate(() => Number(/revision (\d+)/.exec(document.querySelector(".chip.verdict")?.textContent ?? "")?.[1] ?? -1));
export const untilRevision = (page, wanted) => page.waitForFunction((value) => document.querySelector(".chip.verdict")?.textContent?.startsWith(`revision ${value}:`), wanted);
export const untilChecked = (page) => page.waitForFunction(() => !/checking|so far/.test(document.querySelector(".chip.verdict")?.textContent ?? "checking"));
export const field = (page, name) => page.inputValue(`[data-field=${name}]`);
export const selectFirst = (page) => page.click(".objects li:first-child button");

/** Selects the object that is farthest from the robot: nothing covers it in the view. */
export async function selectClear(page) {
  const buttons = page.locator("ul[aria-label=Objects] button");
  let best = [-Infinity, 0];
  for (let index = 0; index < (await buttons.count()); index++) {
    if ((await buttons.nth(index).getAttribute("aria-pressed")) !== "true") await buttons.nth(index).click();
    const x = Number(await field(page, "x"));
    if (x > best[0]) best = [x, index];
  }
  if ((await buttons.nth(best[1]).getAttribute("aria-pressed")) !== "true") await buttons.nth(best[1]).click();
}

/** Different colours in a picture of an element: one when nothing was drawn. */
export async function colours(page, selector) {
  const picture = (await page.locator(selector).first().screenshot()).toString("base64");
  return page.evaluate(async (data) => {
    const bytes = Uint8Array.from(atob(data), (letter) => letter.charCodeAt(0));
    const bitmap = await createImageBitmap(new Blob([bytes], { type: "image/png" }));
    const canvas = new OffscreenCanvas(bitmap.width, bitmap.height);
    const context = canvas.getContext("2d");
    context.drawImage(bitmap, 0, 0);
    const { data: pixels } = context.getImageData(0, 0, bitmap.width, bitmap.height);
    const seen = new Set();
    for (let at = 0; at < pixels.length; at += 4) seen.add((pixels[at] << 16) | (pixels[at + 1] << 8) | pixels[at + 2]);
    return seen.size;
  }, picture);
}

/** Place of the selected object's middle in the window. */
export async function middle(page) {
  const box = await page.locator(".host canvas").boundingBox();
  const [x, y] = await Promise.all([field(page, "x"), field(page, "y")]);
  const at = await page.evaluate((point) => window.studio.project(point), [Number(x), Number(y), 0.02]);
  return { x: box.x + at.x, y: box.y + at.y };
}

export async function seriousFindings(page) {
  const { violations } = await new AxeBuilder({ page }).analyze();
  return violations
    .filter(({ impact }) => impact === "serious" || impact === "critical")
    .map(({ id, nodes }) => `${id}: ${nodes.slice(0, 3).map((node) => node.target.join(" ")).join("; ")}`);
}

export async function until(what, condition, limit = 15_000) {
  const end = Date.now() + limit;
  while (!(await condition())) {
    if (Date.now() > end) throw new Error(`waited in vain until ${what}`);
    await new Promise((resolve) => setTimeout(resolve, 40));
  }
}
