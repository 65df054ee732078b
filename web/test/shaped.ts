/** A network between a browser and a server on this machine: so many bytes a second for all connections, and a delay. */

import { connect, createServer, type AddressInfo, type Server, type Socket } from "node:net";

/** Bytes that go over the link at a time; connections take turns. */
const PIECE = 1460;
/** Beyond this many bytes that wait, a server is not read from. */
const MOST_QUEUED = 64 * 1024;
const TICK_MS = 1;

interface Line {
  client: Socket;
  server: Socket;
  queue: Buffer[];
  queued: number;
  ended: boolean;
}

/**
 * Forwards connections to a port of this machine. A connection costs one round trip before its first request, and each
 * request another; what comes back shares one link, connections by turns.
 */
export class ShapedNetwork {
  /** Bytes that came through to the browser. */
  delivered = 0;
  #lines: Line[] = [];
  #last = performance.now();
  #credit = 0;
  #timer: ReturnType<typeof setInterval> | undefined;
  readonly #server: Server;

  /** @param rate bytes a second; Infinity for no link at all, then there is no delay either */
  constructor(
    readonly port: number,
    public rate: number,
    public roundTripMs: number,
  ) {
    this.#server = createServer({ noDelay: true }, (client) => this.#accept(client));
  }

  /** @returns the port to connect to */
  async start(): Promise<number> {
    await new Promise<void>((resolve) => this.#server.listen(0, "127.0.0.1", resolve));
    this.#timer = setInterval(() => this.#pump(), TICK_MS);
    return (this.#server.address() as AddressInfo).port;
  }

  stop(): void {
    clearInterval(this.#timer);
    for (const line of this.#lines) this.#cut(line);
    this.#server.close();
  }

  #accept(client: Socket): void {
    const server = connect({ port: this.port, host: "127.0.0.1", noDelay: true });
    const line: Line = { client, server, queue: [], queued: 0, ended: false };
    const ready = performance.now() + this.roundTripMs;
    this.#lines.push(line);
    client.on("data", (data) => {
      const wait = Math.max(ready - performance.now(), 0) + this.roundTripMs / 2;
      setTimeout(() => server.write(data), wait);
    });
    server.on("data", (data) => {
      line.queue.push(data);
      line.queued += data.length;
      if (line.queued > MOST_QUEUED) server.pause();
    });
    server.on("end", () => (line.ended = true));
    for (const socket of [client, server]) {
      socket.on("error", () => this.#cut(line));
      socket.on("close", () => (socket === client ? this.#cut(line) : (line.ended = true)));
    }
  }

  #cut(line: Line): void {
    this.#lines = this.#lines.filter((one) => one !== line);
    line.client.destroy();
    line.server.destroy();
  }

  #pump(): void {
    const now = performance.now();
    this.#credit += (this.rate * (now - this.#last)) / 1000;
    this.#last = now;
    while (this.#credit > 0) {
      const line = this.#lines.find(({ queued }) => queued > 0);
      if (line === undefined) {
        // What an idle link could have sent is lost.
        this.#credit = 0;
        break;
      }
      this.#credit -= this.#send(line);
      this.#lines.push(...this.#lines.splice(this.#lines.indexOf(line), 1));
    }
    for (const line of this.#lines) if (line.ended && line.queued === 0) this.#endLater(line);
  }

  #send(line: Line): number {
    const [first] = line.queue;
    const piece = first.subarray(0, PIECE);
    if (piece.length === first.length) line.queue.shift();
    else line.queue[0] = first.subarray(PIECE);
    line.queued -= piece.length;
    if (line.queued < MOST_QUEUED) line.server.resume();
    this.#later(() => {
      this.delivered += piece.length;
      line.client.write(piece);
    });
    return piece.length;
  }

  #endLater(line: Line): void {
    this.#lines = this.#lines.filter((one) => one !== line);
    this.#later(() => line.client.end());
  }

  #later(act: () => void): void {
    setTimeout(act, this.roundTripMs / 2);
  }
}
