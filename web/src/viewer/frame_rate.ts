/** How many frames a second there are while a picture moves. */

/** Frames of which the rate is told, milliseconds. */
const RATED_MS = 1000;
/** Between frames of a picture that moves; after a longer pause it stood still. */
const PAUSE_MS = 250;

export class FrameRate {
  #frames: number[] = [];

  /** @param now when a frame was drawn, milliseconds */
  add(now: number): void {
    if (now - (this.#frames.at(-1) ?? now) > PAUSE_MS) this.#frames = [];
    this.#frames.push(now);
    while (this.#frames[0] < now - RATED_MS) this.#frames.shift();
  }

  /** Of the last second in which there were frames; 0 before there are two. */
  get perSecond(): number {
    const [first = 0, last = 0] = [this.#frames[0], this.#frames.at(-1)];
    return first === last ? 0 : (1000 * (this.#frames.length - 1)) / (last - first);
  }
}
