/** Large scenes for tests: copies of a small one side by side, in pages of any size. */

import { BLOCK, NO_TILE } from "../../conformance/decoders/js/constants.js";
import { type Container, emptyEntries, putEntry } from "../../conformance/decoders/js/container.js";
import { openScar } from "../../conformance/decoders/js/decoder.js";
import { repack } from "../../conformance/decoders/js/packing.mjs";

const FIXED = 100;
const SUMMARY = 136;

/** The same blocks in pages of 2^pageBits tiles. */
export function repaged(bytes: Uint8Array, pageBits: number): Uint8Array {
  return repack(openScar(bytes).container, { pageBits });
}

/** 8^doublings copies of a scene, its cube doubled so many times: a tile of copy c is c times as many tiles further on. */
export function replicated(bytes: Uint8Array, doublings: number, pageBits: number): Uint8Array {
  const { container } = openScar(bytes);
  return repack(copies(container, 8 ** doublings, doublings), { pageBits });
}

function copies(container: Container, times: number, doublings: number): Container {
  const { header, layers, tiles } = container;
  const n = header.tile_count;
  const blocks = replicatedBlocks(container, times);
  const modelBytes = layers.map(({ stream_bytes }) => stream_bytes[0]);
  const head = container.source.read(0, header.header_length).slice();
  const view = new DataView(head.buffer);
  const put = (at: number, value: number) => view.setBigUint64(at, BigInt(value), true);
  let end = header.header_length;
  const summaries = layers.map((layer, i) => {
    const streams = layer.stream_bytes.map((size, stream) => (stream === 0 ? modelBytes[i] : size * times));
    const bytes = streams.reduce((a, b) => a + b, 0);
    end += bytes;
    const numbers = [layer.anchor_count * times, layer.gaussian_count * times, bytes, end, ...streams];
    numbers.forEach((value, at) => put(FIXED + SUMMARY * i + 8 * at, value));
    const [anchor_count, gaussian_count] = numbers;
    return { anchor_count, gaussian_count, byte_count: bytes, end_offset: end, stream_bytes: streams };
  });
  view.setUint8(28, header.lattice_bits + doublings);
  view.setUint32(32, n * times, true);
  put(16, end);
  put(40, header.anchor_count * times);
  put(48, header.gaussian_count * times);
  const whole = Buffer.concat([head, ...blocks.bodies]);
  const cubes = {
    depth: Uint8Array.from({ length: n * times }, (_, t) => tiles.depth[t % n] + doublings),
    shift: Uint8Array.from({ length: n * times }, (_, t) => tiles.shift[t % n]),
    prefix: BigUint64Array.from({ length: n * times }, (_, t) => {
      return (BigInt(Math.floor(t / n)) << BigInt(3 * tiles.depth[t % n])) | tiles.prefix[t % n];
    }),
  };
  return {
    source: { length: whole.length, read: (at, size) => new Uint8Array(whole.subarray(at, at + size)) },
    header: { ...header, tile_count: n * times, file_length: end },
    layers: summaries,
    tiles: cubes,
    entries: blocks.entries,
  };
}

/** Blocks of tiles as many times as there are copies, those of no tile once. */
function replicatedBlocks({ header, source, entries }: Container, times: number) {
  const order: { e: number; tile: number }[] = [];
  for (let layer = 1; layer <= header.layer_count; layer++) {
    const own = [...entries.kind.keys()].filter((e) => entries.layer[e] === layer);
    const ofKind = (test: (kind: number) => boolean) => own.filter((e) => test(entries.kind[e]));
    for (const e of ofKind((kind) => kind < BLOCK.TILE)) order.push({ e, tile: NO_TILE });
    for (let copy = 0; copy < times; copy++) {
      for (const e of ofKind((kind) => kind === BLOCK.TILE)) {
        order.push({ e, tile: copy * header.tile_count + entries.tile[e] });
      }
    }
    for (const e of ofKind((kind) => kind > BLOCK.TILE)) order.push({ e, tile: NO_TILE });
  }
  const made = emptyEntries(order.length);
  order.forEach(({ e, tile }, i) => {
    const [kind, flags, layer, length] = [entries.kind[e], entries.flags[e], entries.layer[e], entries.length[e]];
    putEntry(made, i, { kind, flags, layer, tile, length, offset: 0, count: entries.count[e], crc32: entries.crc32[e] });
  });
  return { entries: made, bodies: order.map(({ e }) => source.read(entries.offset[e], entries.length[e])) };
}
