/** Decoders side by side. A tile stays with one of them, since its integers lie there. */

import type { Channel, MakeChannel } from "../decoder/channel.js";
import type { Failure, Output, Reply, Request, Task, TileOutput } from "../decoder/protocol.js";
import type { Block, Cube, Point, TileBlock } from "../decoder/types.js";
import { StreamError } from "./errors.js";

interface Lane {
  channel: Channel;
  /** Tiles that it decodes, or will without being asked again. */
  underWay: number;
  tiles: number;
  memory: number;
  waiting: Map<number, (reply: Reply) => void>;
}

export interface TileTask {
  tile: number;
  cube: Cube;
  layers: TileBlock[];
  output: Output;
  eye?: Point;
  /** Whether the state of the tile is of no use afterwards. */
  last: boolean;
}

export interface Decoded {
  output: TileOutput | null;
  failure: Failure | null;
  /** Milliseconds in the decoder. */
  took: number;
}

export class Pool {
  readonly #lanes: Lane[];
  readonly #laneOf = new Map<number, Lane>();
  #ids = 0;

  /**
   * @param ahead tiles that a decoder may be given at once: with two it has the next one while the answer to the last
   *   is on its way
   * @param onFailure gets what ends the whole pool: a worker that cannot be loaded, or died
   */
  constructor(
    count: number,
    make: MakeChannel,
    onFailure: (error: StreamError) => void,
    readonly ahead = 1,
  ) {
    this.#lanes = Array.from({ length: count }, () => {
      const lane: Lane = { channel: undefined as never, underWay: 0, tiles: 0, memory: 0, waiting: new Map() };
      lane.channel = make({
        onReply: (reply) => {
          lane.memory = reply.memory;
          const answer = lane.waiting.get(reply.id);
          lane.waiting.delete(reply.id);
          answer?.(reply);
        },
        onFailure: (message) => onFailure(new StreamError("worker", message)),
      });
      return lane;
    });
  }

  /** Bytes that all decoders hold, as of their last replies. */
  get memory(): number {
    return this.#lanes.reduce((sum, { memory }) => sum + memory, 0);
  }

  /** @returns the failure of the first decoder that had one */
  open(front: Uint8Array): Promise<Failure | null> {
    return this.#all({ kind: "open", front });
  }

  models(layer: number, blocks: Block[]): Promise<Failure | null> {
    return this.#all({ kind: "models", layer, blocks });
  }

  /** Whether a tile could be decoded at once. */
  isFree(tile: number): boolean {
    const lane = this.#laneOf.get(tile);
    return lane === undefined ? this.hasFree : this.#isFree(lane);
  }

  /** Whether some decoder can be given a tile. */
  get hasFree(): boolean {
    return this.#lanes.some((lane) => this.#isFree(lane));
  }

  #isFree({ underWay }: Lane): boolean {
    return underWay < this.ahead;
  }

  /** Decodes; the bodies are transferred. `isFree` must hold. */
  async run(task: TileTask): Promise<Decoded> {
    const lane = this.#laneOf.get(task.tile) ?? this.#leastLoaded();
    if (!this.#laneOf.has(task.tile)) {
      this.#laneOf.set(task.tile, lane);
      lane.tiles++;
    }
    lane.underWay++;
    const { result, failure, took } = await this.#post(lane, { kind: "tile", ...task }, transferable(task.layers));
    lane.underWay--;
    if (task.last || failure !== null) this.#unpin(task.tile);
    return { output: result, failure, took };
  }

  /** Forgets the state of a tile. */
  release(tile: number): void {
    const lane = this.#laneOf.get(tile);
    if (lane === undefined) return;
    this.#unpin(tile);
    void this.#post(lane, { kind: "release", tile }, []);
  }

  close(): void {
    for (const { channel, waiting } of this.#lanes) {
      waiting.clear();
      channel.close();
    }
  }

  #unpin(tile: number): void {
    const lane = this.#laneOf.get(tile);
    if (lane === undefined) return;
    this.#laneOf.delete(tile);
    lane.tiles--;
  }

  #leastLoaded(): Lane {
    const load = ({ underWay, tiles }: Lane) => [underWay, tiles];
    const isLess = ([a, b]: number[], [c, d]: number[]) => a < c || (a === c && b < d);
    return this.#lanes.reduce((best, lane) => (isLess(load(lane), load(best)) ? lane : best));
  }

  async #all(task: Task): Promise<Failure | null> {
    const replies = await Promise.all(this.#lanes.map((lane) => this.#post(lane, task, [])));
    return replies.find(({ failure }) => failure !== null)?.failure ?? null;
  }

  #post(lane: Lane, task: Task, transfer: ArrayBuffer[]): Promise<Reply> {
    const request: Request = { ...task, id: this.#ids++ };
    return new Promise((resolve) => {
      lane.waiting.set(request.id, resolve);
      lane.channel.post(request, transfer);
    });
  }
}

/** Buffers of the bodies that are theirs alone. */
function transferable(layers: TileTask["layers"]): ArrayBuffer[] {
  const alone = layers.filter(({ body }) => body.length > 0 && body.byteLength === body.buffer.byteLength);
  return alone.map(({ body }) => body.buffer as ArrayBuffer);
}
