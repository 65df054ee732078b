/** Blocks on their way: requests for what is wanted most, again where they fail. */

import { Assembler, firstFrom, type Partial } from "./assembler.js";
import { Backoff, type RetryOptions } from "./backoff.js";
import { asStreamError, StreamError } from "./errors.js";
import type { Directory } from "../format/directory.js";
import type { Meter } from "./meter.js";
import { type ByteRange, MOST_PARALLEL, nextRequest, requestSizes } from "./requests.js";
import type { Body, ByteSource } from "./source.js";

export interface TransferEvents {
  /** A page or a block whose CRC is right. */
  onBlock(entry: number, body: Uint8Array): void;
  /** One that came damaged each time. */
  onDamaged(entry: number): void;
  /** Nothing more is tried until `resume`. */
  onFailure(error: StreamError): void;
  onRetry(error: StreamError, delayMs: number): void;
  /** Nothing is under way, for now. */
  onIdle(): void;
}

export interface TransferCounts {
  requests: number;
  retries: number;
  /** Bytes that arrived, and those of them in blocks that were taken. */
  bytesRead: number;
  bytesUsed: number;
}

const IDLE = 0;
const UNDER_WAY = 1;
const ARRIVED = 2;
const DAMAGED = 3;
const DAMAGE_RETRIES = 2;

interface Transfer extends ByteRange {
  controller: AbortController;
  assembler: Assembler;
  started: number;
  /** Whether any block was taken. */
  useful: boolean;
}

export class Transfers {
  readonly counts: TransferCounts = { requests: 0, retries: 0, bytesRead: 0, bytesUsed: 0 };
  readonly #state: Uint8Array;
  /** Blocks that a request brought in part. */
  readonly #partial = new Map<number, Partial>();
  readonly #damages = new Map<number, number>();
  readonly #running = new Set<Transfer>();
  readonly #backoff: Backoff;
  #wanted: number[] = [];
  #isWanted: Uint8Array;
  #timer: ReturnType<typeof setTimeout> | undefined;
  #cursor = 0;
  #waiting = false;
  #stopped = false;
  #held = false;
  /** Whether decoders are under way, too: beside one request they have more of the connection than beside several. */
  alone = false;
  #wake: (() => void) | null = null;

  constructor(
    readonly source: ByteSource,
    readonly front: Directory,
    readonly meter: Meter,
    readonly events: TransferEvents,
    retry: RetryOptions,
  ) {
    this.#state = new Uint8Array(front.entries.offset.length);
    this.#isWanted = new Uint8Array(this.#state.length);
    this.#backoff = new Backoff(retry);
  }

  /** Whether nothing is wanted that has not arrived. */
  get idle(): boolean {
    return this.#running.size === 0 && this.#idle().next().done === true;
  }

  /** Bytes asked for that have not arrived. */
  get underWay(): number {
    let sum = 0;
    for (const { end, assembler } of this.#running) sum += Math.max(end - assembler.position, 0);
    return sum;
  }

  /** Whether a block came, whole or damaged for good. */
  hasArrived(entry: number): boolean {
    return this.#state[entry] >= ARRIVED;
  }

  isWanted(entry: number): boolean {
    return this.#isWanted[entry] === 1;
  }

  /** @param entries in the order to fetch; those that arrived or are under way may be among them */
  want(entries: number[]): void {
    this.#wanted = entries.filter((e) => this.#state[e] < ARRIVED);
    this.#cursor = 0;
    this.#isWanted = new Uint8Array(this.#state.length);
    for (const e of this.#wanted) this.#isWanted[e] = 1;
    for (const e of this.#partial.keys()) if (this.#isWanted[e] === 0) this.#partial.delete(e);
    this.#pump();
  }

  /** A block is let go. It is fetched again once it is wanted anew. */
  forget(entry: number): void {
    this.#isWanted[entry] = 0;
    if (this.#state[entry] === ARRIVED) this.#state[entry] = IDLE;
  }

  /** While what arrived is not yet used up, nothing more is asked for. */
  hold(held: boolean): void {
    if (this.#held === held) return;
    this.#held = held;
    if (held) return;
    this.#wake?.();
    this.#pump();
  }

  /** Takes over a body whose first bytes were read elsewhere: what begins at `offset` or later. */
  adopt(body: Body, rest: Uint8Array, offset: number, end: number, wants: (entry: number) => boolean): void {
    const { offset: at, length } = this.front.entries;
    const entries: number[] = [];
    for (let e = firstFrom(at, offset); e < at.length && at[e] < end; e++) if (length[e] > 0 && wants(e)) entries.push(e);
    if (this.source.ranged !== false) for (const e of entries) this.#state[e] = UNDER_WAY;
    const transfer = this.#transfer({ start: offset, end, entries }, wants);
    void this.#settle(transfer, this.#read(transfer, body, rest));
  }

  /** Tries again after a failure. */
  resume(): void {
    this.#stopped = false;
    this.#backoff.succeeded();
    this.#pump();
  }

  close(): void {
    this.#stopped = true;
    clearTimeout(this.#timer);
    for (const { controller } of this.#running) controller.abort(new DOMException("closed", "AbortError"));
    this.#wake?.();
  }

  /** Entries wanted that are not under way, in order. */
  *#idle(): Generator<number, void, void> {
    while (this.#cursor < this.#wanted.length && this.#state[this.#wanted[this.#cursor]] >= ARRIVED) this.#cursor++;
    for (let i = this.#cursor; i < this.#wanted.length; i++) {
      const entry = this.#wanted[i];
      if (this.#state[entry] === IDLE && this.#isWanted[entry] === 1) yield entry;
    }
  }

  #pump(): void {
    if (this.#stopped || this.#waiting || this.#held) return;
    const whole = this.source.ranged === false;
    const sizes = requestSizes(this.meter.capacity, this.meter.delay);
    if (this.alone) sizes.most = sizes.underWay;
    for (;;) {
      if (this.#running.size >= (whole ? 1 : this.alone ? 2 : MOST_PARALLEL)) return;
      if (this.#running.size > 0 && this.underWay >= sizes.underWay) return;
      if (this.#idle().next().done === true) return;
      this.#start(whole ? this.#wholeFile() : this.#withGaps(nextRequest(this.#idle(), this.front.entries, sizes)));
    }
  }

  /** A gap may hold blocks that are wanted later: since their bytes come, they are taken. */
  #withGaps({ start, end }: ByteRange): ByteRange {
    const { offset, length } = this.front.entries;
    const entries: number[] = [];
    for (let e = firstFrom(offset, start); e < offset.length && offset[e] + length[e] <= end; e++) {
      if (this.#state[e] === IDLE && this.#isWanted[e] === 1) entries.push(e);
    }
    return { start, end, entries };
  }

  #wholeFile(): ByteRange {
    return { start: 0, end: this.front.header.file_length, entries: [] };
  }

  #start(range: ByteRange): void {
    const whole = this.source.ranged === false;
    const chosen = new Set(range.entries);
    const partial = this.#partial.get(range.entries[0]);
    for (const e of range.entries) this.#partial.delete(e);
    const start = range.start + (partial?.filled ?? 0);
    const wants = (e: number) => (whole ? this.#isWanted[e] === 1 : chosen.has(e));
    const transfer = this.#transfer({ ...range, start }, wants, partial);
    for (const e of range.entries) this.#state[e] = UNDER_WAY;
    this.counts.requests++;
    void this.#settle(transfer, this.#ask(transfer));
  }

  #transfer(range: ByteRange, wants: (entry: number) => boolean, partial?: Partial): Transfer {
    const transfer: Transfer = {
      ...range,
      controller: new AbortController(),
      started: this.meter.now(),
      useful: false,
      assembler: new Assembler(
        this.front.entries,
        range.start,
        (e) => this.#state[e] < ARRIVED && wants(e),
        (e, body) => this.#take(transfer, e, body),
        partial,
      ),
    };
    this.#running.add(transfer);
    return transfer;
  }

  async #ask(transfer: Transfer): Promise<void> {
    const { start, end, controller } = transfer;
    const body = await this.source.open(start, end - start, controller.signal);
    this.meter.firstByte(this.meter.now() - transfer.started);
    await this.#read(transfer, body, new Uint8Array(0));
  }

  async #read(transfer: Transfer, body: Body, rest: Uint8Array): Promise<void> {
    transfer.assembler.push(rest);
    // Leaving the loop early closes the body, since a generator returns with the loop.
    for await (const chunk of body.chunks) {
      transfer.controller.signal.throwIfAborted();
      this.counts.bytesRead += chunk.length;
      this.meter.add(chunk.length);
      transfer.assembler.push(chunk);
      // One request of bounded size may go on; one for the whole file may not outrun the decoders.
      if (this.#held && this.source.ranged === false) await new Promise<void>((resolve) => (this.#wake = resolve));
      transfer.controller.signal.throwIfAborted();
    }
    if (transfer.assembler.position < transfer.end) {
      const { position: offset } = transfer.assembler;
      throw new StreamError("cut", `the connection ended at byte ${offset}, before ${transfer.end}`, {
        source: this.source.name,
        offset,
      });
    }
  }

  async #settle(transfer: Transfer, reading: Promise<void>): Promise<void> {
    let failure: unknown;
    try {
      await reading;
    } catch (error) {
      failure = error;
    }
    this.#running.delete(transfer);
    for (const e of transfer.entries) if (this.#state[e] === UNDER_WAY) this.#state[e] = IDLE;
    const { unfinished } = transfer.assembler;
    const keep = this.source.ranged !== false && unfinished !== null && this.#isWanted[unfinished.entry] === 1;
    if (keep) this.#partial.set(unfinished.entry, unfinished);
    if (!transfer.controller.signal.aborted && failure !== undefined) {
      this.#retryLater(asStreamError(failure, { source: this.source.name, offset: transfer.start }));
    }
    this.#pump();
    if (this.#running.size === 0) this.events.onIdle();
  }

  #retryLater(error: StreamError): void {
    if (this.#stopped) return;
    const delay = this.#backoff.failed(error);
    if (delay === null) {
      this.#stopped = true;
      this.#waiting = false;
      clearTimeout(this.#timer);
      for (const { controller } of this.#running) controller.abort(error);
      error.fatal = true;
      this.events.onFailure(error);
      return;
    }
    this.counts.retries++;
    this.events.onRetry(error, delay);
    if (this.#waiting) return;
    this.#waiting = true;
    this.#timer = setTimeout(() => {
      this.#waiting = false;
      this.#pump();
    }, delay);
  }

  #take(transfer: Transfer, entry: number, body: Uint8Array | null): void {
    if (body === null) {
      const damages = (this.#damages.get(entry) ?? 0) + 1;
      this.#damages.set(entry, damages);
      this.#state[entry] = damages > DAMAGE_RETRIES ? DAMAGED : IDLE;
      if (damages > DAMAGE_RETRIES) this.events.onDamaged(entry);
      else this.counts.retries++;
      return;
    }
    if (!transfer.useful) this.#backoff.succeeded();
    transfer.useful = true;
    this.#state[entry] = ARRIVED;
    this.counts.bytesUsed += body.length;
    this.events.onBlock(entry, body);
  }
}
