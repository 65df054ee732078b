/** Telling a stream where the camera is. */

import type { Camera } from "../plan/types.js";

/** Controls move a camera by rounding errors for ever; smaller changes than this share are none. */
const STILL = 1e-7;

/** Passes views on that differ from the last one, with the velocity between them. */
export class Looking {
  #told: { numbers: number[]; at: number; view: Camera } | null = null;

  constructor(private readonly tell: (view: Camera) => void) {}

  look(view: Camera): void {
    const at = performance.now();
    const numbers = [...view.position, ...view.forward, ...view.up, view.fovY, view.width, view.height];
    const before = this.#told;
    if (before !== null && numbers.every((x, i) => Math.abs(x - before.numbers[i]) <= STILL * Math.abs(x))) return;
    const seconds = Math.max((at - (before?.at ?? at)) / 1000, 1e-3);
    const velocity = view.position.map((x, axis) => (x - (before?.view.position[axis] ?? x)) / seconds) as Camera["position"];
    this.#told = { numbers, at, view };
    this.tell({ ...view, velocity });
  }
}
