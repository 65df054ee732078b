/** Aborting what no longer moves. */

import { StreamError } from "./errors.js";

/** A signal that follows another one, and that aborts by itself where nothing happens for too long. */
export class Deadline {
  readonly #controller = new AbortController();
  #timer: ReturnType<typeof setTimeout> | undefined;
  readonly #follow = () => this.#controller.abort(this.outer.reason);

  /** @param source name, for the message */
  constructor(
    readonly outer: AbortSignal,
    readonly milliseconds: number,
    readonly source: string,
  ) {
    if (outer.aborted) this.#follow();
    else outer.addEventListener("abort", this.#follow);
  }

  get signal(): AbortSignal {
    return this.#controller.signal;
  }

  /** The time runs anew. */
  start(): void {
    this.pause();
    const { milliseconds, source } = this;
    this.#timer = setTimeout(() => {
      this.#controller.abort(new StreamError("stalled", `nothing arrived for ${milliseconds / 1000} s`, { source }));
    }, milliseconds);
  }

  pause(): void {
    clearTimeout(this.#timer);
  }

  /** A promise that no longer waits once the signal aborts, whether or not who made it listens to the signal. */
  race<T>(promise: Promise<T>): Promise<T> {
    const { signal } = this;
    return new Promise((resolve, reject) => {
      const stop = () => reject(signal.reason);
      if (signal.aborted) stop();
      signal.addEventListener("abort", stop, { once: true });
      promise.then(resolve, reject).finally(() => signal.removeEventListener("abort", stop));
    });
  }

  end(): void {
    this.pause();
    this.outer.removeEventListener("abort", this.#follow);
  }

  /** What to throw for an error: the reason of an abort where there was one. */
  reason(error: unknown): unknown {
    return this.signal.aborted ? this.signal.reason : error;
  }
}
