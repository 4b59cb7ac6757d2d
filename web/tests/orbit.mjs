// Orbiting of the 3-D view by mouse, with what it costs: frames, heap, geometries and contexts of the GPU.

/** Runs in a page before its own scripts do: keeps the contexts of the GPU that are made. */
export function countContexts() {
  const own = HTMLCanvasElement.prototype.getContext;
  window.contextsOfGpu = new Set();
  HTMLCanvasElement.prototype.getContext = function (kind, ...rest) {
    const context = own.call(this, kind, ...rest);
    if (context && /webgl/.test(kind)) window.contextsOfGpu.add(context);
    return context;
  };
}

/** Number of contexts that were made since the page was opened and not released; the page asks a short-lived one whether it draws in software. */
export const contextsAt = (page) => page.evaluate(() => [...window.contextsOfGpu].filter((context) => !context.isContextLost()).length);

/** Orbits for some seconds; frames per second. */
export async function turn(page, seconds) {
  const drawn = () => page.evaluate(() => [window.studio.figures().frames, performance.now()]);
  const before = await drawn();
  await page.mouse.move(420, 480);
  await page.mouse.down();
  const end = Date.now() + 1000 * seconds;
  for (let step = 0; Date.now() < end; step++) await page.mouse.move(420 + 80 * Math.sin(step / 15), 480 + 20 * Math.sin(step / 40));
  const after = await drawn();
  await page.mouse.up();
  return ((after[0] - before[0]) * 1000) / (after[1] - before[1]);
}

/** Heap after a collection of garbage, geometries and contexts. */
export async function footprint(page) {
  await page.waitForTimeout(500);
  const found = await page.evaluate(() => {
    window.gc?.();
    return { geometries: window.studio.figures().geometries, heap: performance.memory.usedJSHeapSize };
  });
  return { ...found, contexts: await contextsAt(page) };
}

/** Orbits for `seconds`; the heap, geometries and contexts of the first tenth and of the end, and the frame rates. */
export async function orbit(page, seconds) {
  const rounds = Math.max(2, Math.round(seconds / 20));
  const rates = [];
  let early;
  for (let round = 0; round < rounds; round++) {
    rates.push(await turn(page, seconds / rounds));
    if (round === Math.floor(rounds / 10)) early = await footprint(page);
  }
  const isLowered = (await page.locator(".bottom:has-text('detail lowered')").count()) === 1;
  return { early, late: await footprint(page), slowest: Math.min(...rates), isLowered };
}

/** Throws unless memory is flat (± 10 %) and the view smooth, or its detail lowered. */
export function assertFlat({ early, late, slowest, isLowered }) {
  const grown = (name, slack) => late[name] > early[name] * 1.1 + slack && `${name}: ${early[name]} to ${late[name]}`;
  const wrong = [grown("heap", 1e6), grown("geometries", 4), late.contexts !== early.contexts && `contexts: ${early.contexts} to ${late.contexts}`, slowest < 30 && !isLowered && `${slowest.toFixed(1)} frames a second at full detail`];
  const found = wrong.filter(Boolean);
  if (found.length > 0) throw new Error(found.join("; "));
}
