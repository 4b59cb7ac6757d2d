// Level of detail: lowered by itself while frames are slow, full again at rest.

import type { WebGLRenderer } from "three";
import { detail } from "../state/store.ts";
import type { Lights } from "./fixtures.ts";

/** Most pixels of the canvas per CSS pixel, and shadows: the first level at rest, the others while something moves. */
const LEVELS = [
  { ratio: 2, shadows: true },
  { ratio: 1, shadows: true },
  { ratio: 1, shadows: false },
  { ratio: 0.7, shadows: false },
  { ratio: 0.5, shadows: false },
];

/** Level to begin with where the processor draws, and its pixels at rest, in place of the anti-aliasing that it lacks. */
const SOFTWARE_LEVEL = 2;
const SOFTWARE_RATIO = 1.5;

/** Frame time above which detail is lowered, and the frames over which it is averaged. */
const SLOW_MS = 34;
const FRAMES = 6;
const REST_MS = 300;

export class Detail {
  private isMoving = false;
  private last = 0;
  private sum = 0;
  private count = 0;
  private timer: ReturnType<typeof setTimeout> | undefined;
  private wanted: number;
  private shown = -1;
  private readonly restRatio: number;
  /** Level at the start; `detail` counts from it. */
  private readonly base: number;

  constructor(
    private readonly renderer: WebGLRenderer,
    private readonly lights: Lights,
    private readonly request: () => void,
    isSoftware: boolean,
  ) {
    // The first frames of a slow machine come sooner without shadows.
    this.base = isSoftware ? SOFTWARE_LEVEL : 0;
    this.wanted = this.base;
    this.restRatio = isSoftware ? SOFTWARE_RATIO : window.devicePixelRatio;
    this.prepare();
  }

  begin(): void {
    clearTimeout(this.timer);
    this.isMoving = true;
    this.last = 0;
    this.wanted = this.base + detail.peek();
  }

  end(): void {
    this.isMoving = false;
    this.rest();
  }

  /** Draws once in full detail when nothing has moved for a while. */
  rest(): void {
    clearTimeout(this.timer);
    if (this.isMoving) return;
    this.timer = setTimeout(() => {
      this.wanted = 0;
      this.request();
    }, REST_MS);
  }

  /** Measures a frame that was just drawn. */
  drawn(): void {
    if (!this.isMoving) return;
    const now = performance.now();
    const took = now - this.last;
    this.last = now;
    // A pause of the hand is no slow frame.
    if (took > 1000) return;
    this.sum += took;
    this.count += 1;
    if (this.count < FRAMES) return;
    const mean = this.sum / this.count;
    this.sum = 0;
    this.count = 0;
    if (mean > SLOW_MS && this.wanted < LEVELS.length - 1) {
      detail.value += 1;
      this.wanted = this.base + detail.peek();
    }
  }

  /** Sets the renderer up for the next frame; a change of size clears the canvas, so not after one. */
  prepare(): void {
    if (this.wanted === this.shown) return;
    this.shown = this.wanted;
    const { ratio, shadows } = LEVELS[this.shown]!;
    this.renderer.setPixelRatio(Math.min(ratio, this.shown === 0 ? this.restRatio : window.devicePixelRatio));
    if (this.lights.sun.castShadow !== shadows) {
      this.lights.sun.castShadow = shadows;
      this.renderer.shadowMap.needsUpdate = true;
    }
  }
}

/** True if the browser draws 3-D with the processor. */
export function drawsInSoftware(): boolean {
  const context = document.createElement("canvas").getContext("webgl2");
  const info = context?.getExtension("WEBGL_debug_renderer_info");
  const name = context && info ? String(context.getParameter(info.UNMASKED_RENDERER_WEBGL)) : "";
  context?.getExtension("WEBGL_lose_context")?.loseContext();
  return /swiftshader|llvmpipe|softpipe|software|basic render/i.test(name);
}
