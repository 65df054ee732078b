/** A web server for one scene, that can be told to misbehave, and for the pages of a folder. */

import { existsSync, readFileSync } from "node:fs";
import { createServer, type IncomingMessage, type Server, type ServerResponse } from "node:http";
import type { AddressInfo } from "node:net";

export interface Asked {
  /** First and last byte of the Range header; null without one. */
  range: [number, number] | null;
  headers: IncomingMessage["headers"];
}

/** Answers a request itself and returns true, or leaves it to the server. */
export type Trick = (asked: Asked, response: ServerResponse, number: number) => boolean;

const TYPES: Record<string, string> = {
  html: "text/html",
  js: "text/javascript",
  mjs: "text/javascript",
  css: "text/css",
  wasm: "application/wasm",
};

export class FileServer {
  /** Requests for the scene. */
  readonly asked: Asked[] = [];
  /** Files of the folder that were asked for, by name, and those of them that are not there. */
  readonly named: string[] = [];
  readonly missing: string[] = [];
  /** What is awaited before one is sent. */
  before: (name: string) => Promise<void> = async () => undefined;
  etag: string | null = '"one"';
  ranges = true;
  trick: Trick = () => false;
  /** Milliseconds before each answer. */
  delay = 0;
  /** Answers that are neither finished nor cut. */
  pending = 0;
  #server: Server;

  constructor(
    public bytes: Uint8Array,
    readonly folder?: URL,
  ) {
    this.#server = createServer((request, response) => {
      const { pathname } = new URL(request.url ?? "/", "http://host/");
      if (pathname !== "/scene.scar") return void this.#send(pathname === "/" ? "index.html" : pathname.slice(1), response);
      this.pending++;
      response.on("close", () => this.pending--);
      if (this.delay === 0) this.#answer(request, response);
      else setTimeout(() => this.#answer(request, response), this.delay);
    });
  }

  async start(): Promise<string> {
    await new Promise<void>((resolve) => this.#server.listen(0, "127.0.0.1", resolve));
    return `http://127.0.0.1:${(this.#server.address() as AddressInfo).port}/scene.scar`;
  }

  async stop(): Promise<void> {
    this.#server.closeAllConnections();
    await new Promise((resolve) => this.#server.close(resolve));
  }

  /** Answers without ranges, and with the first `count` bytes until what this returns is called. */
  holdAfter(count: number): () => void {
    let release: () => void = () => undefined;
    let released = false;
    this.ranges = false;
    this.trick = (_, response) => {
      response.writeHead(200, { "Content-Length": String(this.bytes.length) });
      response.write(this.bytes.subarray(0, count));
      release = () => response.end(this.bytes.subarray(count));
      // One who was kept waiting too long asks again, perhaps afterwards.
      if (released) release();
      return true;
    };
    return () => {
      released = true;
      release();
    };
  }

  /** Headers of a 206 answer for a range, cut to the file. */
  rangeHeaders([first, last]: [number, number]): Record<string, string> {
    const end = Math.min(last, this.bytes.length - 1);
    return {
      "Content-Range": `bytes ${first}-${end}/${this.bytes.length}`,
      "Content-Length": String(end - first + 1),
      ...(this.etag === null ? {} : { ETag: this.etag }),
    };
  }

  async #send(name: string, response: ServerResponse): Promise<void> {
    this.named.push(name);
    await this.before(name);
    const file = new URL(name, this.folder);
    const found = existsSync(file);
    if (!found) this.missing.push(name);
    const type = TYPES[name.split(".").pop() ?? ""] ?? "text/plain";
    response.writeHead(found ? 200 : 404, { "Content-Type": type }).end(found ? readFileSync(file) : "");
  }

  #answer(request: IncomingMessage, response: ServerResponse): void {
    const match = /^bytes=(\d+)-(\d+)$/.exec(request.headers.range ?? "");
    const range: Asked["range"] = match === null ? null : [Number(match[1]), Number(match[2])];
    const asked = { range, headers: request.headers };
    this.asked.push(asked);
    if (this.trick(asked, response, this.asked.length)) return;
    const condition = request.headers["if-range"];
    const matches = condition === undefined || condition === this.etag;
    if (range === null || !this.ranges || !matches) {
      const etag = this.etag === null ? {} : { ETag: this.etag };
      response.writeHead(200, { "Content-Length": String(this.bytes.length), ...etag });
      response.end(this.bytes);
    } else if (range[0] >= this.bytes.length) {
      response.writeHead(416, { "Content-Range": `bytes */${this.bytes.length}` }).end();
    } else {
      response.writeHead(206, this.rangeHeaders(range));
      response.end(this.bytes.subarray(range[0], range[1] + 1));
    }
  }
}

/** Runs with the address of a scene and its server, which is stopped whatever happens. @param folder of pages beside it */
export async function serving(
  bytes: Uint8Array,
  run: (url: string, server: FileServer) => Promise<void>,
  folder?: URL,
): Promise<void> {
  const server = new FileServer(bytes, folder);
  const url = await server.start();
  try {
    await run(url, server);
  } finally {
    await server.stop();
  }
}
