/** How fast bytes arrive, and how long the first of a request takes. */

/** Before anything was measured: 10 Mbit/s. */
const FIRST_GUESS = 1.25e6;
const KEPT_DELAYS = 8;
/** A link is as fast as what came in the best stretch of some length among the last ones, milliseconds. */
const STRETCH_MS = 100;
const KEPT_STRETCHES_MS = 2000;

export class Meter {
  readonly #delays: number[] = [];
  /** [when, bytes] of the last STRETCH_MS. */
  #arrivals: [number, number][] = [];
  /** [when, bytes a second], each less than those before it and later. */
  #best: [number, number][] = [];

  /** @param now milliseconds, of any origin */
  constructor(readonly now: () => number) {}

  /** Bytes a second that the link can bring, also while it mostly waits for questions. */
  get capacity(): number {
    return this.#best[0]?.[1] ?? FIRST_GUESS;
  }

  /** Least of the last delays from question to first byte, seconds. */
  get delay(): number {
    return this.#delays.length === 0 ? 0 : Math.min(...this.#delays);
  }

  firstByte(delayMs: number): void {
    this.#delays.push(delayMs / 1000);
    if (this.#delays.length > KEPT_DELAYS) this.#delays.shift();
  }

  add(bytes: number): void {
    const now = this.now();
    this.#arrivals.push([now, bytes]);
    this.#arrivals = this.#arrivals.filter(([when]) => when > now - STRETCH_MS);
    const speed = this.#arrivals.reduce((sum, [, each]) => sum + each, 0) / (STRETCH_MS / 1000);
    this.#best = this.#best.filter(([when, other]) => other > speed && when > now - KEPT_STRETCHES_MS);
    this.#best.push([now, speed]);
  }
}
