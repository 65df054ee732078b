/**
 * When the page shows a scene over a slow connection: `node dist/tests/times.mjs URL KBIT_S ROUND_TRIP_MS [UNTIL]`. URL is
 * what `scarfmt view` prints; UNTIL is the state to wait for, "layer" (layer 1 drawn) unless given. Prints JSON: when the
 * small picture and layer 1 were drawn, milliseconds from the request for the page, and what was loaded, in order.
 */

import { type AddressInfo, connect, createServer, type Socket } from "node:net";
import { browsing } from "./chromium.js";

/** What a packet carries, bytes. */
const PACKET = 1460;
/** Bytes of a connection that may wait for the link. */
const MOST_WAITING = 1 << 16;

/** The way to a browser: packets of all connections take turns, and each takes as long as its bytes. */
class Link {
  readonly #waiting = new Map<Socket, Buffer[]>();
  /** Sent, but not yet there, in order. */
  readonly #underWay: { to: Socket; packet: Buffer; at: number }[] = [];
  #free = 0;
  #running = false;

  constructor(
    readonly bytesPerMs: number,
    readonly delayMs: number,
  ) {}

  send(to: Socket, data: Buffer): void {
    if (this.#waiting.size === 0) this.#free = Math.max(this.#free, performance.now());
    const packets = this.#waiting.get(to) ?? [];
    this.#waiting.set(to, packets);
    for (let at = 0; at < data.length; at += PACKET) packets.push(data.subarray(at, at + PACKET));
    if (!this.#running) this.#next();
  }

  isFull(to: Socket): boolean {
    return (this.#waiting.get(to)?.length ?? 0) * PACKET > MOST_WAITING;
  }

  #next(): void {
    const now = performance.now();
    while (this.#waiting.size > 0 && this.#free <= now) {
      const [[to, packets]] = this.#waiting;
      const packet = packets.shift()!;
      // Behind all others, while it has more.
      this.#waiting.delete(to);
      if (packets.length > 0) this.#waiting.set(to, packets);
      this.#free += packet.length / this.bytesPerMs;
      this.#underWay.push({ to, packet, at: this.#free + this.delayMs });
      to.emit("sent");
    }
    while (this.#underWay.length > 0 && this.#underWay[0].at <= now) {
      const { to, packet } = this.#underWay.shift()!;
      if (!to.destroyed) to.write(packet);
    }
    this.#running = this.#waiting.size + this.#underWay.length > 0;
    if (this.#running) setTimeout(() => this.#next(), 1);
  }
}

/** Runs with the address of a server behind a link of such a kind. Half of a round trip passes each way, and one to connect. */
async function shaped(server: URL, kbits: number, roundTripMs: number, run: (address: string) => Promise<void>): Promise<void> {
  const link = new Link(kbits / 8, roundTripMs / 2);
  const proxy = createServer((browser) => {
    const upstream = connect(Number(server.port), server.hostname);
    let wait = roundTripMs;
    browser.on("data", (data) => {
      setTimeout(() => upstream.destroyed || upstream.write(data), wait + roundTripMs / 2);
      wait = 0;
    });
    upstream.on("data", (data) => {
      link.send(browser, data);
      if (link.isFull(browser)) upstream.pause();
    });
    browser.on("sent", () => link.isFull(browser) || upstream.resume());
    for (const [one, other] of [[browser, upstream], [upstream, browser]]) {
      one.on("error", () => other.destroy());
      one.on("close", () => one === browser && other.destroy());
    }
  });
  await new Promise<void>((resolve) => proxy.listen(0, "127.0.0.1", resolve));
  try {
    await run(`http://127.0.0.1:${(proxy.address() as AddressInfo).port}${server.pathname}${server.search}`);
  } finally {
    proxy.close();
  }
}

/** In the page: notes when something is first seen. */
function watchPage(): void {
  const seen: Record<string, number> = {};
  Object.assign(window, { seen });
  const look = () => {
    const canvas = document.querySelector("canvas");
    if (canvas?.style.background.includes("blob:")) seen.poster ??= performance.now();
    requestAnimationFrame(look);
  };
  requestAnimationFrame(look);
  document.addEventListener("scar-viewer", ({ detail: viewer }: CustomEventInit) => {
    const drawn = new Set<number>();
    viewer.on("front", () => (seen.front ??= performance.now()));
    viewer.on("drawn", ({ tile }: { tile: number }) => {
      seen.tile ??= performance.now();
      drawn.add(tile);
      if (drawn.size === viewer.front.index.tiles) seen.layer ??= performance.now();
    });
    viewer.on("state", (state: string) => (seen[state] = performance.now()));
  });
}

/** In the page: what was loaded, in order. */
const LOADED = `performance.getEntriesByType("resource").map(({ name, startTime, responseEnd, transferSize }) => {
  return [name.split("/").pop(), Math.round(startTime), Math.round(responseEnd), transferSize];
})`;

const [url, kbits, roundTripMs, awaited = "layer"] = process.argv.slice(2);
await shaped(new URL(url), Number(kbits), Number(roundTripMs), (address) =>
  browsing(
    async (page) => {
      await page.evaluateOnNewDocument(watchPage);
      await page.goto(address, { waitUntil: "domcontentloaded" });
      await page.waitForFunction(`seen[${JSON.stringify(awaited)}] !== undefined`, { polling: 200 });
      console.log(JSON.stringify({ seen: await page.evaluate("seen"), loaded: await page.evaluate(LOADED) }));
    },
    { width: 1280, height: 800 },
  ),
);
process.exit(0);
