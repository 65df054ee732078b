/** How fast bytes arrive, and how long the first of a request takes. */

/** Before anything was measured: 10 Mbit/s. */
const FIRST_GUESS = 1.25e6;
/** Time constant of the mean, seconds during which something was under way. */
const MEMORY_S = 1;
const LEAST_SAMPLE_S = 0.02;
const KEPT_DELAYS = 8;

export class Meter {
  #rate: number | null = null;
  #underWay = 0;
  #since = 0;
  #bytes = 0;
  readonly #delays: number[] = [];

  /** @param now milliseconds, of any origin */
  constructor(readonly now: () => number) {}

  /** Bytes a second. */
  get rate(): number {
    return this.#rate ?? FIRST_GUESS;
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
    this.#bytes += bytes;
    const elapsed = (this.now() - this.#since) / 1000;
    if (elapsed < LEAST_SAMPLE_S) return;
    const kept = this.#rate === null ? 0 : Math.exp(-elapsed / MEMORY_S);
    this.#rate = kept * (this.#rate ?? 0) + ((1 - kept) * this.#bytes) / elapsed;
    this.#since = this.now();
    this.#bytes = 0;
  }

  end(): void {
    this.#underWay--;
  }
}
