/** Ranges of a file on a server: single ranges, one file throughout, no ranges where there are none. */

import { Deadline } from "./deadline.js";
import { StreamError } from "./errors.js";
import type { Body, ByteSource } from "./source.js";

export interface HttpOptions {
  /** Used in place of the global `fetch`: what has a file elsewhere than on a server answers with status 206. */
  fetch?: typeof fetch;
  /** Sent with every request. Headers beyond the safelisted ones make browsers ask a foreign server first. */
  headers?: Record<string, string>;
  credentials?: RequestCredentials;
  /** Milliseconds without a byte after which a request is given up. */
  stallMs: number;
}

/** What tells one version of a file from another. */
interface Version {
  etag: string | null;
  modified: string | null;
}

export class HttpSource implements ByteSource {
  readonly name: string;
  size: number | null = null;
  ranged: boolean | null = null;
  #version: Version | null = null;

  constructor(
    readonly url: string,
    readonly options: HttpOptions,
  ) {
    this.name = url;
  }

  async open(offset: number, length: number, signal: AbortSignal): Promise<Body> {
    const deadline = new Deadline(signal, this.options.stallMs, this.name);
    let response: Response | undefined;
    try {
      deadline.start();
      response = await deadline.race(this.#request(offset, length, deadline.signal));
      const start = this.#accept(response, offset);
      deadline.pause();
      return { offset: start, chunks: this.#chunks(response, deadline) };
    } catch (error) {
      deadline.end();
      void response?.body?.cancel().catch(() => undefined);
      throw this.#explained(deadline.reason(error), signal, offset);
    }
  }

  #request(offset: number, length: number, signal: AbortSignal): Promise<Response> {
    const { fetch: ask = fetch, headers, credentials } = this.options;
    const all: Record<string, string> = { ...headers };
    if (this.ranged !== false) all["Range"] = `bytes=${offset}-${offset + length - 1}`;
    const validator = this.#validator();
    if (validator !== null && this.ranged === true && isSameOrigin(this.url)) all["If-Range"] = validator;
    // Chromium's cache lets requests for one URL wait for each other, ranges included.
    return ask(this.url, { headers: all, signal, cache: "no-store", ...(credentials === undefined ? {} : { credentials }) });
  }

  /** Only a strong ETag may stand in If-Range; a date may. */
  #validator(): string | null {
    const { etag, modified } = this.#version ?? { etag: null, modified: null };
    return etag !== null && !etag.startsWith("W/") ? etag : modified;
  }

  /** @returns the byte with which the body begins */
  #accept(response: Response, offset: number): number {
    const { status } = response;
    const source = this.name;
    const place = { source, status, offset };
    if (status !== 206 && status !== 200) {
      throw new StreamError("http-status", `cannot load ${this.url}: the server answers ${status} ${response.statusText}`.trim(), place);
    }
    this.#checkVersion(response, offset);
    if (status === 200) return this.#acceptWhole(response, offset);
    const encoding = response.headers.get("Content-Encoding");
    if (encoding !== null && encoding !== "identity") {
      throw new StreamError("encoded", `the server encodes ranges (${encoding}): offsets are of another file`, place);
    }
    const range = /^bytes (\d+)-\d+\/(\d+|\*)$/.exec(response.headers.get("Content-Range") ?? "");
    if (range !== null && Number(range[1]) !== offset) {
      throw new StreamError("no-range", `asked from byte ${offset}, answered from ${range[1]}`, place);
    }
    this.ranged = true;
    if (range !== null && range[2] !== "*") this.#checkSize(Number(range[2]), offset);
    return offset;
  }

  #acceptWhole(response: Response, offset: number): number {
    if (this.ranged === true) {
      const changed = isSameOrigin(this.url) && this.#validator() !== null;
      const message = changed ? "the file on the server was changed" : "the server no longer answers with ranges";
      throw new StreamError(changed ? "file-changed" : "no-range", message, { source: this.name, offset, status: 200 });
    }
    this.ranged = false;
    const length = response.headers.get("Content-Length");
    if (length !== null && response.headers.get("Content-Encoding") === null) this.#checkSize(Number(length), 0);
    return 0;
  }

  #checkVersion({ headers }: Response, offset: number): void {
    const found = { etag: headers.get("ETag"), modified: headers.get("Last-Modified") };
    const known = this.#version;
    this.#version ??= found;
    const differs = (a: string | null | undefined, b: string | null) => a != null && b !== null && a !== b;
    if (differs(known?.etag, found.etag) || differs(known?.modified, found.modified)) {
      throw new StreamError("file-changed", "the file on the server was changed", { source: this.name, offset });
    }
  }

  #checkSize(size: number, offset: number): void {
    if (this.size !== null && size !== this.size) {
      const message = `the file on the server was changed: ${size} bytes, before ${this.size}`;
      throw new StreamError("file-changed", message, { source: this.name, offset });
    }
    this.size = size;
  }

  async *#chunks({ body }: Response, deadline: Deadline): AsyncGenerator<Uint8Array, void, void> {
    const reader = body?.getReader();
    try {
      while (reader !== undefined) {
        deadline.start();
        // Not every fetch ends a read that waits when it is aborted.
        const { done, value } = await deadline.race(reader.read());
        deadline.pause();
        if (done) return;
        yield value;
      }
    } catch (error) {
      throw this.#explained(deadline.reason(error), deadline.outer, null);
    } finally {
      deadline.end();
      void reader?.cancel().catch(() => undefined);
    }
  }

  #explained(error: unknown, signal: AbortSignal, offset: number | null): unknown {
    if (signal.aborted) return signal.reason;
    if (error instanceof StreamError) return error;
    const or = isSameOrigin(this.url) ? "" : ", or does not allow this page to read it (CORS)";
    const message = `cannot load ${this.url}: the server does not answer${or}`;
    return new StreamError("network", message, { source: this.name, offset, cause: error });
  }
}

/** Whether a page may send any header there without asking first. Outside of pages there are no origins. */
function isSameOrigin(url: string): boolean {
  if (typeof location === "undefined") return true;
  return new URL(url, location.href).origin === location.origin;
}
