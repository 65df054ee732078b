/** Reading what comes before all else again where that may help. */

import { Backoff, type RetryOptions } from "./backoff.js";
import { asStreamError, type StreamError } from "./errors.js";

export const RETRY: RetryOptions = { retries: 6, firstMs: 250, mostMs: 8000 };

export interface RetryingParts {
  signal: AbortSignal;
  /** For messages. */
  source: string;
  retry: RetryOptions;
  onRetry(error: StreamError, delayMs: number): void;
}

/** Throws StreamError where it fails for good, or the reason of the signal. */
export async function retrying<Found>(
  read: () => Promise<Found>,
  { signal, source, retry, onRetry }: RetryingParts,
): Promise<Found> {
  const backoff = new Backoff(retry);
  for (let damages = 0; ;) {
    try {
      return await read();
    } catch (cause) {
      if (signal.aborted) throw signal.reason;
      const error = asStreamError(cause, { source });
      const again = isOfTransport(error) || (isDamage(error) && damages++ === 0);
      const delayMs = again ? backoff.failed(error) : null;
      if (delayMs === null) throw error;
      onRetry(error, delayMs);
      await pause(delayMs, signal);
    }
  }
}

/** Refusals are of the file: asking again gives the same. */
function isOfTransport({ id }: StreamError): boolean {
  return ["network", "http-status", "stalled", "cut", "no-range"].includes(id);
}

/** Bytes that changed on their way come right the second time, those that changed on a disk do not. */
function isDamage({ id }: StreamError): boolean {
  return ["header-crc-mismatch", "directory-crc-mismatch", "page-crc-mismatch"].includes(id);
}

/** Waits; rejects with the reason of the signal. */
function pause(milliseconds: number, signal: AbortSignal): Promise<void> {
  return new Promise((resolve, reject) => {
    const stop = () => {
      clearTimeout(timer);
      reject(signal.reason);
    };
    const timer = setTimeout(() => {
      signal.removeEventListener("abort", stop);
      resolve();
    }, milliseconds);
    signal.addEventListener("abort", stop, { once: true });
  });
}
