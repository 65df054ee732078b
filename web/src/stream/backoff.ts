/** How often, and after how long, something that failed is tried again. */

import type { StreamError } from "./errors.js";

export interface RetryOptions {
  /** Failures in a row, without a useful byte between them, after which the stream gives up. */
  retries: number;
  /** Milliseconds before the first retry; doubled each time, up to `mostMs`, times 0.5 to 1 at random. */
  firstMs: number;
  mostMs: number;
}

/** Errors that no retry mends. */
const LASTING = new Set(["file-changed", "encoded", "bad-source"]);
const PASSING_STATUS = new Set([408, 425, 429, 500, 502, 503, 504]);
/** Other statuses are asked about again, since edges of a network do not always agree; but not long. */
const RETRIES_OF_STATUS = 2;

/** Counts failures in a row. */
export class Backoff {
  #failures = 0;

  constructor(
    readonly options: RetryOptions,
    readonly random: () => number = Math.random,
  ) {}

  succeeded(): void {
    this.#failures = 0;
  }

  /** @returns milliseconds to wait, null where it is no use */
  failed(error: StreamError): number | null {
    const { retries, firstMs, mostMs } = this.options;
    const n = this.#failures++;
    const statusLasts = error.id === "http-status" && !PASSING_STATUS.has(error.status ?? 0);
    const most = statusLasts ? Math.min(RETRIES_OF_STATUS, retries) : retries;
    if (LASTING.has(error.id) || n >= most) return null;
    return Math.min(firstMs * 2 ** n, mostMs) * (0.5 + 0.5 * this.random());
  }
}
