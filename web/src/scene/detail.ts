// Level of detail: lowered by itself while frames are slow, full again at rest.

import type { WebGLRenderer } from "three";
import { detail } from "../state/store.ts";
import type { Lights } from "./fixtures.ts";

/** Pixel ratios and shadows of the levels, while something moves. */
const LEVELS = [
  { ratio: 2, shadows: true },
  { ratio: 1, shadows: true },
  { ratio: 1, shadows: false },
  { ratio: 0.7, shadows: false },
  { ratio: 0.5, shadows: false },
];

/** Frame time above which detail is lowered, and the frames over which it is averaged. */
const SLOW_MS = 34;
const FRAMES = 6;

export class Detail {
  private isMoving = false;
  private last = 0;
  private sum = 0;
  private count = 0;
  private rest: ReturnType<typeof setTimeout> | undefined;
  private wanted = 0;
  private shown = -1;

  constructor(
    private readonly renderer: WebGLRenderer,
    private readonly lights: Lights,
    private readonly request: () => void,
  ) {
    this.prepare();
  }

  begin(): void {
    clearTimeout(this.rest);
    this.isMoving = true;
    this.last = 0;
    this.wanted = detail.peek();
  }

  end(): void {
    this.isMoving = false;
    clearTimeout(this.rest);
    this.rest = setTimeout(() => {
      this.wanted = 0;
      this.request();
    }, 250);
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
    if (mean > SLOW_MS && detail.peek() < LEVELS.length - 1) {
      detail.value += 1;
      this.wanted = detail.peek();
    }
  }

  /** Sets the renderer up for the next frame; a change of size clears the canvas, so not after one. */
  prepare(): void {
    if (this.wanted === this.shown) return;
    this.shown = this.wanted;
    const { ratio, shadows } = LEVELS[this.shown]!;
    this.renderer.setPixelRatio(Math.min(ratio, ratio < 1 ? ratio : window.devicePixelRatio));
    if (this.lights.sun.castShadow !== shadows) {
      this.lights.sun.castShadow = shadows;
      this.renderer.shadowMap.needsUpdate = true;
    }
  }
}
