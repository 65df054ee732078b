/** Tile table, directory and blocks (SPEC §5.4 to §5.6): everything about a file but the content of its blocks. */

import { BLOCK, NO_TILE } from "./constants.js";
import { crc32 } from "./crc32.js";
import { demand, Refused } from "./errors.js";
import { directoryEnd, readHeader, RECORD_BYTES } from "./header.js";

/**
 * @typedef {import("./constants.js").Limits} Limits
 * @typedef {import("./source.js").Source} Source
 * @typedef {import("./header.js").Header} Header
 * @typedef {import("./header.js").Summary} Summary
 * @typedef {{depth: Uint8Array, shift: Uint8Array, reserved: Uint16Array, prefix: BigUint64Array}} Tiles
 *   one number a tile
 * @typedef {{kind: Uint8Array, flags: Uint8Array, layer: Uint8Array, reserved: Uint8Array, tile: Uint32Array,
 *   offset: Float64Array, length: Float64Array, count: Uint32Array, crc32: Uint32Array}} Entries one number an entry
 * @typedef {{source: Source, header: Header, layers: Summary[], tiles: Tiles, entries: Entries}} Container
 */

const CHUNK = 1 << 20;
const MAX_DEPTH = 21;
const LAST_KNOWN_MODEL = BLOCK.PREDICTORS;
const LAST_MODEL = 15;

/**
 * Rules of §5.1 to §5.5, in their order.
 * @param {Source} source
 * @param {Limits} limits
 * @param {boolean} allowTruncated
 * @returns {Container}
 */
export function readContainer(source, limits, allowTruncated) {
  const { header, layers } = readHeader(source, limits, allowTruncated);
  const start = header.header_length;
  const end = directoryEnd(header);
  demand(source.length >= end, "truncated-directory", "the directory is cut", source.length);
  const bytes = source.read(start, end - start);
  demand(crc32(bytes) === header.directory_crc32, "directory-crc-mismatch", "directory CRC", header.header_length);
  const data = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
  const tiles = readTiles(data, header.tile_count);
  checkTiles(tiles, header);
  const entries = readEntries(data, RECORD_BYTES.tile * header.tile_count, header.entry_count);
  checkEntries(entries, header, layers, limits);
  return { source, header, layers, tiles, entries };
}

/**
 * @param {DataView} data
 * @param {number} count
 * @returns {Tiles}
 */
function readTiles(data, count) {
  const tiles = {
    depth: new Uint8Array(count),
    shift: new Uint8Array(count),
    reserved: new Uint16Array(count),
    prefix: new BigUint64Array(count),
  };
  for (let t = 0, at = 0; t < count; t++, at += RECORD_BYTES.tile) {
    tiles.depth[t] = data.getUint8(at);
    tiles.shift[t] = data.getUint8(at + 1);
    tiles.reserved[t] = data.getUint16(at + 2, true);
    tiles.prefix[t] = data.getBigUint64(at + 4, true);
  }
  return tiles;
}

/**
 * R-5.4-3 to R-5.4-8, each over all tiles before the next.
 * @param {Tiles} tiles
 * @param {Header} header
 */
function checkTiles(tiles, header) {
  const { depth, shift, reserved, prefix } = tiles;
  const all = (/** @type {(t: number) => boolean} */ holds, /** @type {string} */ id) => {
    for (let t = 0; t < depth.length; t++) {
      if (!holds(t)) throw new Refused(id, `tile ${t}`, header.header_length + RECORD_BYTES.tile * t);
    }
  };
  all((t) => reserved[t] === 0, "bad-reserved");
  all((t) => depth[t] <= MAX_DEPTH, "tile-depth");
  all((t) => shift[t] <= 31, "tile-shift");
  all((t) => {
    const bits = header.lattice_bits - depth[t] - shift[t];
    return bits >= 0 && bits <= 21;
  }, "tile-local-bits");
  all((t) => prefix[t] >> BigInt(3 * depth[t]) === 0n, "tile-prefix");
  let past = 0n;
  all((t) => {
    const height = BigInt(3 * (MAX_DEPTH - depth[t]));
    const first = prefix[t] << height;
    const follows = first >= past;
    past = (prefix[t] + 1n) << height;
    return follows;
  }, "tile-order");
}

/**
 * @param {DataView} data
 * @param {number} at
 * @param {number} count
 * @returns {Entries}
 */
function readEntries(data, at, count) {
  const entries = {
    kind: new Uint8Array(count),
    flags: new Uint8Array(count),
    layer: new Uint8Array(count),
    reserved: new Uint8Array(count),
    tile: new Uint32Array(count),
    offset: new Float64Array(count),
    length: new Float64Array(count),
    count: new Uint32Array(count),
    crc32: new Uint32Array(count),
  };
  // Numbers of 2^53 and more lose their low bits, and are refused all the same.
  const u64 = (/** @type {number} */ i) => data.getUint32(i, true) + data.getUint32(i + 4, true) * 2 ** 32;
  for (let e = 0; e < count; e++, at += RECORD_BYTES.entry) {
    entries.kind[e] = data.getUint8(at);
    entries.flags[e] = data.getUint8(at + 1);
    entries.layer[e] = data.getUint8(at + 2);
    entries.reserved[e] = data.getUint8(at + 3);
    entries.tile[e] = data.getUint32(at + 4, true);
    entries.offset[e] = u64(at + 8);
    entries.length[e] = u64(at + 16);
    entries.count[e] = data.getUint32(at + 24, true);
    entries.crc32[e] = data.getUint32(at + 28, true);
  }
  return entries;
}

/**
 * R-5.5-1 to R-5.5-13, each over all entries before the next.
 * @param {Entries} entries
 * @param {Header} header
 * @param {Summary[]} layers
 * @param {Limits} limits
 */
function checkEntries(entries, header, layers, limits) {
  const { kind, flags, layer, reserved, tile, offset, length, count } = entries;
  const start = header.header_length + RECORD_BYTES.tile * header.tile_count;
  const all = (/** @type {(e: number) => boolean} */ holds, /** @type {string} */ id) => {
    for (let e = 0; e < kind.length; e++) {
      if (!holds(e)) throw new Refused(id, `directory entry ${e}`, start + RECORD_BYTES.entry * e);
    }
  };
  all((e) => kind[e] !== 0, "entry-kind");
  all((e) => reserved[e] === 0, "bad-reserved");
  all((e) => flagsFit(kind[e], flags[e]), "entry-flags");
  all((e) => layer[e] >= 1 && layer[e] <= (kind[e] === BLOCK.METADATA ? 1 : header.layer_count), "entry-layer");
  all((e) => tileFits(kind[e], tile[e], header.tile_count), "entry-tile");
  all((e) => e === 0 || follows(entries, e), "entry-order");
  all((e) => length[e] >= 1 && length[e] <= header.file_length, "entry-length");
  all((e) => length[e] <= limits.block_bytes, "limit-block-bytes");
  let end = directoryEnd(header);
  all((e) => {
    const fits = offset[e] === end && end <= header.file_length;
    end += length[e];
    return fits;
  }, "entry-offset");
  all((e) => kind[e] !== BLOCK.TILE || count[e] <= limits.tile_anchors, "limit-tile-anchors");
  all((e) => kind[e] !== BLOCK.METADATA || count[e] === 0, "entry-count");
  checkLayerSums(entries, layers);
  all((e) => (flags[e] & 1) === 0 || known(kind[e]), "unknown-critical-block");
}

/**
 * @param {number} kind
 * @param {number} flags
 */
function flagsFit(kind, flags) {
  if (kind <= BLOCK.TILE) return flags === 1;
  return kind === BLOCK.METADATA ? flags === 2 : flags <= 2;
}

/**
 * @param {number} kind
 * @param {number} tile
 * @param {number} tileCount
 */
function tileFits(kind, tile, tileCount) {
  if (kind === BLOCK.TILE) return tile < tileCount;
  if (kind <= LAST_MODEL || kind === BLOCK.METADATA) return tile === NO_TILE;
  return tile < tileCount || tile === NO_TILE;
}

/** Whether entry e comes after the one before. @param {Entries} entries @param {number} e */
function follows({ layer, kind, tile }, e) {
  if (layer[e] !== layer[e - 1]) return layer[e] > layer[e - 1];
  if (kind[e] !== kind[e - 1]) return kind[e] > kind[e - 1];
  return tile[e] > tile[e - 1];
}

/** @param {number} kind */
function known(kind) {
  return kind <= LAST_KNOWN_MODEL || kind === BLOCK.TILE || kind === BLOCK.METADATA;
}

/**
 * R-5.5-12.
 * @param {Entries} entries
 * @param {Summary[]} layers
 */
function checkLayerSums({ layer, kind, length, count }, layers) {
  let e = 0;
  let before = 0;
  layers.forEach((summary, i) => {
    let bytes = 0;
    let models = 0;
    let anchors = 0;
    for (; e < layer.length && layer[e] === i + 1; e++) {
      bytes += length[e];
      if (kind[e] === BLOCK.TILE) anchors += count[e];
      else models += length[e];
    }
    const fits = bytes === summary.byte_count && models === summary.stream_bytes[0];
    demand(fits, "layer-directory-bytes", `the blocks of layer ${i + 1}`);
    demand(anchors === summary.anchor_count - before, "layer-directory-anchors", `anchors of layer ${i + 1}`);
    before = summary.anchor_count;
  });
}

/**
 * The entry of a block, or -1.
 * @param {Container} container
 * @param {number} layer from 1
 * @param {number} kind
 * @param {number} [tile]
 * @returns {number}
 */
export function findBlock({ entries }, layer, kind, tile = NO_TILE) {
  let low = 0;
  let high = entries.kind.length;
  while (low < high) {
    const e = (low + high) >>> 1;
    const before =
      entries.layer[e] !== layer
        ? entries.layer[e] < layer
        : entries.kind[e] !== kind
          ? entries.kind[e] < kind
          : entries.tile[e] < tile;
    if (before) low = e + 1;
    else high = e;
  }
  const found = low < entries.kind.length && entries.layer[low] === layer;
  return found && entries.kind[low] === kind && entries.tile[low] === tile ? low : -1;
}

/**
 * The bytes of a block whose CRC was checked.
 * @param {Container} container
 * @param {number} e
 * @returns {Uint8Array}
 */
export function blockBytes({ source, entries }, e) {
  requireArrived(source, entries, e);
  return source.read(entries.offset[e], entries.length[e]);
}

/**
 * @param {Source} source
 * @param {Entries} entries
 * @param {number} e
 */
function requireArrived(source, entries, e) {
  const arrived = entries.offset[e] + entries.length[e] <= source.length;
  demand(arrived, "truncated-block", `the block of entry ${e} is cut`, source.length);
}

/**
 * R-5.6-1, without holding the block in memory.
 * @param {Container} container
 * @param {number} e
 */
export function checkBlock({ source, entries }, e) {
  requireArrived(source, entries, e);
  const end = entries.offset[e] + entries.length[e];
  let crc = 0;
  for (let at = entries.offset[e]; at < end; at += CHUNK) crc = crc32(source.read(at, Math.min(CHUNK, end - at)), crc);
  demand(crc === entries.crc32[e], "crc-mismatch", `the block of entry ${e}`, entries.offset[e]);
}
