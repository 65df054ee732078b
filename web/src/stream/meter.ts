/** How fast bytes arrive, and how long the first of a request takes. */

/** Before anything was measured: 10 Mbit/s. */
const FIRST_GUESS = 1.25e6;
/** Time constant of the mean, seconds during which something was under way. */
const MEMORY_S = 1;
const LEAST_SAMPLE_S = 0.02;
const KEPT_DELAYS = 8;
/** A link is as fast as what came in the best stretch of some length among the last ones, milliseconds. */
const STRETCH_MS = 100;
const KEPT_STRETCHES_MS = 2000;

export class Meter {
  #rate: number | null = null;
  #underWay = 0;
  #since = 0;
  #bytes = 0;
  readonly #delays: number[] = [];
  /** [when, bytes] of the last STRETCH_MS. */
  #arrivals: [number, number][] = [];
  /** [when, bytes a second], each less than those before it and later. */
  #best: [number, number][] = [];

  /** @param now milliseconds, of any origin */
  constructor(readonly now: () => number) {}

  /** Bytes a second. */
  get rate(): number {
    return this.#rate ?? FIRST_GUESS;
  }

  /**
   * Bytes a second that the link can bring: more than `rate` while it waits for questions. Were questions as small as
   * `rate` asks for, the link would wait the longer.
   */
  get capacity(): number {
    const [first] = this.#best.filter(([when]) => when > this.now() - KEPT_STRETCHES_MS);
    return Math.max(this.rate, first?.[1] ?? 0);
  }

  /** Least of the last delays from question to first byte, seconds. */
  get delay(): number {
    return this.#delays.length === 0 ? 0 : Math.min(...this.#delays);
  }

  begin(): void {
    if (this.#underWay++ > 0) return;
    this.#since = this.now();
    this.#bytes = 0;
  }

  firstByte(delayMs: number): void {
    this.#delays.push(delayMs / 1000);
    if (this.#delays.length > KEPT_DELAYS) this.#delays.shift();
  }

  add(bytes: number): void {
    this.#addToStretch(bytes);
    this.#bytes += bytes;
    const elapsed = (this.now() - this.#since) / 1000;
    if (elapsed < LEAST_SAMPLE_S) return;
    const kept = this.#rate === null ? 0 : Math.exp(-elapsed / MEMORY_S);
    this.#rate = kept * (this.#rate ?? 0) + ((1 - kept) * this.#bytes) / elapsed;
    this.#since = this.now();
    this.#bytes = 0;
  }

  #addToStretch(bytes: number): void {
    const now = this.now();
    this.#arrivals.push([now, bytes]);
    this.#arrivals = this.#arrivals.filter(([when]) => when > now - STRETCH_MS);
    const speed = this.#arrivals.reduce((sum, [, each]) => sum + each, 0) / (STRETCH_MS / 1000);
    this.#best = this.#best.filter(([when, other]) => other > speed && when > now - KEPT_STRETCHES_MS);
    this.#best.push([now, speed]);
  }

  end(): void {
    this.#underWay--;
  }
}
