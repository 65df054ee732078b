/**
 * A Zstandard decompressor (RFC 8878) for the frames of SPEC §5.8: one frame, content size stated, no dictionary,
 * no content checksum.
 */

import { demand, Refused } from "./errors.js";
import { BackwardBits, badFrame, constantFseTable, makeFseTable, readFseTable } from "./fse.js";
import { readHuffmanStream, readHuffmanTable } from "./huffman.js";

/**
 * @typedef {import("./fse.js").FseTable} FseTable
 * @typedef {import("./huffman.js").HuffmanTable} HuffmanTable
 * @typedef {{bytes: Uint8Array, at: number, out: Uint8Array, filled: number, blockSize: number,
 *   huffman: HuffmanTable | null, tables: (FseTable | null)[], offsets: number[]}} Frame
 *   tables of literal lengths, offsets, match lengths
 */

const MAX_WINDOW = 8388608;
const MAX_BLOCK = 131072;

const LITERAL_LENGTHS = baselines(
  [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15],
  [1, 1, 1, 1, 2, 2, 3, 3, 4, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16],
);
const MATCH_LENGTHS = baselines(
  Array.from({ length: 32 }, (_, i) => i + 3),
  [1, 1, 1, 1, 2, 2, 3, 3, 4, 4, 5, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16],
);

const DEFAULT_TABLES = [
  makeFseTable(
    [4, 3, 2, 2, 2, 2, 2, 2, 2, 2, 2, 2, 2, 1, 1, 1, 2, 2, 2, 2, 2, 2, 2, 2, 2, 3, 2, 1, 1, 1, 1, 1, -1, -1, -1, -1],
    6,
  ),
  makeFseTable(
    [1, 1, 1, 1, 1, 1, 2, 2, 2, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, -1, -1, -1, -1, -1],
    5,
  ),
  makeFseTable(
    [1, 4, 3, 2, 2, 2, 2, 2, 2, ...new Array(37).fill(1), -1, -1, -1, -1, -1, -1, -1],
    6,
  ),
];
const MAX_LOGS = [9, 8, 9];
const MAX_SYMBOLS = [35, 31, 52];

/**
 * Codes 0.. have the base values `single` without extra bits, then consecutive ranges of 2^extra values.
 * @param {number[]} single
 * @param {number[]} extra
 */
function baselines(single, extra) {
  const base = [...single];
  const bits = single.map(() => 0);
  let next = single[single.length - 1] + 1;
  for (const n of extra) {
    base.push(next);
    bits.push(n);
    next += 2 ** n;
  }
  return { base, bits };
}

/**
 * The content of the frame that is all of `bytes`, checked in the order of §5.8.
 * @param {Uint8Array} bytes
 * @param {number} mostContent bytes, → `content-limit`
 * @returns {Uint8Array}
 */
export function decompress(bytes, mostContent) {
  const { contentSize, windowSize, at } = readFrameHeader(bytes);
  demand(contentSize <= mostContent, "content-limit", `a frame of ${contentSize} bytes`);
  if (windowSize > MAX_WINDOW) badFrame(`a window of ${windowSize} bytes`);
  /** @type {Frame} */
  const frame = {
    bytes,
    at,
    out: new Uint8Array(contentSize),
    filled: 0,
    blockSize: Math.min(windowSize, MAX_BLOCK),
    huffman: null,
    tables: [null, null, null],
    offsets: [1, 4, 8],
  };
  for (let last = false; !last; ) last = readBlock(frame);
  if (frame.filled !== contentSize) badFrame("fewer bytes than the frame states");
  if (frame.at !== bytes.length) badFrame("bytes after the frame");
  return frame.out;
}

/** @param {Uint8Array} bytes */
function readFrameHeader(bytes) {
  const byte = (/** @type {number} */ i) => bytes[i] ?? badFrame("a frame header is cut");
  const little = (/** @type {number} */ i, /** @type {number} */ n) => {
    let value = 0;
    for (let k = n - 1; k >= 0; k--) value = value * 256 + byte(i + k);
    return value;
  };
  if (bytes.length < 5 || little(0, 4) !== 0xfd2fb528) badFrame("not a Zstandard frame");
  const descriptor = byte(4);
  const single = (descriptor & 32) !== 0;
  if ((descriptor & 8) !== 0) badFrame("a reserved bit of the frame header is 1");
  if ((descriptor & 4) !== 0) badFrame("a content checksum");
  let at = 5;
  const windowByte = single ? 0 : byte(at++);
  const dictionaryBytes = [0, 1, 2, 4][descriptor & 3];
  if (little(at, dictionaryBytes) !== 0) badFrame("a dictionary");
  at += dictionaryBytes;
  const sizeBytes = [single ? 1 : 0, 2, 4, 8][descriptor >> 6];
  if (sizeBytes === 0) badFrame("no content size");
  const contentSize = little(at, sizeBytes) + (sizeBytes === 2 ? 256 : 0);
  if (contentSize === 0) badFrame("no content");
  const windowBase = 2 ** (10 + (windowByte >> 3));
  const windowSize = single ? contentSize : windowBase + (windowBase / 8) * (windowByte & 7);
  return { contentSize, windowSize, at: at + sizeBytes };
}

/** @param {Frame} frame @returns {boolean} whether the block was the last */
function readBlock(frame) {
  const { bytes, at } = frame;
  if (at + 3 > bytes.length) badFrame("a block header is cut");
  const header = bytes[at] | (bytes[at + 1] << 8) | (bytes[at + 2] << 16);
  const size = header >> 3;
  const type = (header >> 1) & 3;
  if (type === 3) badFrame("a reserved block type");
  const stored = type === 1 ? 1 : size;
  frame.at = at + 3 + stored;
  if (frame.at > bytes.length) badFrame("a block is cut");
  if (size > frame.blockSize) badFrame("a block that is too large");
  const part = bytes.subarray(at + 3, frame.at);
  if (type === 2) {
    readCompressedBlock(frame, part);
  } else {
    if (frame.filled + size > frame.out.length) badFrame("more bytes than the frame states");
    if (type === 0) frame.out.set(part, frame.filled);
    else frame.out.fill(part[0], frame.filled, frame.filled + size);
    frame.filled += size;
  }
  return (header & 1) === 1;
}

/**
 * @param {Frame} frame
 * @param {Uint8Array} bytes of the block
 */
function readCompressedBlock(frame, bytes) {
  const { literals, end } = readLiterals(frame, bytes);
  const start = frame.filled;
  const used = readSequences(frame, bytes, end, literals);
  append(frame, literals.subarray(used));
  if (frame.filled - start > frame.blockSize) badFrame("a block of too many bytes");
}

/**
 * @param {Frame} frame
 * @param {Uint8Array} bytes
 */
function append(frame, bytes) {
  if (frame.filled + bytes.length > frame.out.length) badFrame("more bytes than the frame states");
  frame.out.set(bytes, frame.filled);
  frame.filled += bytes.length;
}

/**
 * RFC 8878 §3.1.1.3.1.
 * @param {Frame} frame
 * @param {Uint8Array} bytes of the block
 * @returns {{literals: Uint8Array, end: number}}
 */
function readLiterals(frame, bytes) {
  if (bytes.length === 0) badFrame("an empty block");
  const type = bytes[0] & 3;
  const format = (bytes[0] >> 2) & 3;
  const headerBytes = type < 2 ? [1, 2, 1, 3][format] : [3, 3, 4, 5][format];
  if (headerBytes > bytes.length) badFrame("a literals header is cut");
  let header = 0;
  for (let k = headerBytes - 1; k >= 0; k--) header = header * 256 + bytes[k];
  if (type < 2) {
    const size = Math.floor(header / (headerBytes === 1 ? 8 : 16));
    return plainLiterals(frame, bytes, headerBytes, size, type === 1);
  }
  const width = [10, 10, 14, 18][format];
  const size = Math.floor(header / 16) % 2 ** width;
  const end = headerBytes + Math.floor(header / 2 ** (4 + width));
  if (end > bytes.length || size > frame.blockSize) badFrame("literals that are too large");
  let at = headerBytes;
  if (type === 2) {
    const tree = readHuffmanTable(bytes.subarray(0, end), at);
    frame.huffman = tree.table;
    at = tree.end;
  }
  if (frame.huffman === null) badFrame("literals without a Huffman tree");
  const literals = new Uint8Array(size);
  const part = bytes.subarray(at, end);
  if (format === 0) readHuffmanStream(frame.huffman, part, literals);
  else readFourStreams(frame.huffman, part, literals);
  return { literals, end };
}

/**
 * @param {Frame} frame
 * @param {Uint8Array} bytes
 * @param {number} at
 * @param {number} size
 * @param {boolean} repeated one byte stands for all
 */
function plainLiterals(frame, bytes, at, size, repeated) {
  const end = at + (repeated ? 1 : size);
  if (end > bytes.length || size > frame.blockSize) badFrame("literals that are too large");
  const literals = repeated ? new Uint8Array(size).fill(bytes[at]) : bytes.subarray(at, end);
  return { literals, end };
}

/**
 * @param {HuffmanTable} table
 * @param {Uint8Array} bytes jump table and four streams
 * @param {Uint8Array} out
 */
function readFourStreams(table, bytes, out) {
  if (bytes.length < 6) badFrame("a jump table is cut");
  const each = (out.length + 3) >> 2;
  if (3 * each > out.length) badFrame("too few literals for four streams");
  let at = 6;
  for (let i = 0; i < 4; i++) {
    const past = i < 3 ? at + (bytes[2 * i] | (bytes[2 * i + 1] << 8)) : bytes.length;
    if (past > bytes.length) badFrame("a stream of literals is cut");
    readHuffmanStream(table, bytes.subarray(at, past), out.subarray(i * each, i < 3 ? (i + 1) * each : out.length));
    at = past;
  }
}

/**
 * RFC 8878 §3.1.1.3.2 and §3.1.1.4.
 * @param {Frame} frame
 * @param {Uint8Array} bytes of the block
 * @param {number} at where the section starts; it ends with the block
 * @param {Uint8Array} literals
 * @returns {number} how many literals the sequences took
 */
function readSequences(frame, bytes, at, literals) {
  const byte = () => (at < bytes.length ? bytes[at++] : badFrame("a sequences section is cut"));
  let count = byte();
  if (count >= 128) count = count === 255 ? byte() + byte() * 256 + 0x7f00 : (count - 128) * 256 + byte();
  if (count === 0) {
    if (at !== bytes.length) badFrame("bytes after the sequences");
    return 0;
  }
  const modes = byte();
  if ((modes & 3) !== 0) badFrame("reserved bits of the sequence modes");
  for (let i = 0; i < 3; i++) at = readSequenceTable(frame, i, (modes >> (6 - 2 * i)) & 3, bytes, at);
  return runSequences(frame, count, new BackwardBits(bytes.subarray(at)), literals);
}

/**
 * @param {Frame} frame
 * @param {number} which 0 literal lengths, 1 offsets, 2 match lengths
 * @param {number} mode 0 predefined, 1 one symbol, 2 described, 3 as before
 * @param {Uint8Array} bytes
 * @param {number} at
 * @returns {number} where the description ends
 */
function readSequenceTable(frame, which, mode, bytes, at) {
  if (mode === 0) {
    frame.tables[which] = DEFAULT_TABLES[which];
  } else if (mode === 1) {
    if (at >= bytes.length) badFrame("a sequence table is cut");
    const symbol = bytes[at++];
    if (symbol > MAX_SYMBOLS[which]) badFrame("a sequence symbol that is not known");
    frame.tables[which] = constantFseTable(symbol);
  } else if (mode === 2) {
    const { table, end } = readFseTable(bytes, at, MAX_LOGS[which], MAX_SYMBOLS[which]);
    frame.tables[which] = table;
    return end;
  } else if (frame.tables[which] === null) {
    badFrame("a repeated table where there was none");
  }
  return at;
}

/**
 * @param {Frame} frame
 * @param {number} count at least 1
 * @param {BackwardBits} bits
 * @param {Uint8Array} literals
 * @returns {number} literals taken
 */
function runSequences(frame, count, bits, literals) {
  const [lengths, offsets, matches] = /** @type {FseTable[]} */ (frame.tables);
  let lengthState = bits.read(lengths.log);
  let offsetState = bits.read(offsets.log);
  let matchState = bits.read(matches.log);
  let used = 0;
  for (let i = 0; i < count; i++) {
    const offsetCode = offsets.symbol[offsetState];
    const matchCode = matches.symbol[matchState];
    const lengthCode = lengths.symbol[lengthState];
    const offsetValue = 2 ** offsetCode + bits.read(offsetCode);
    const match = MATCH_LENGTHS.base[matchCode] + bits.read(MATCH_LENGTHS.bits[matchCode]);
    const length = LITERAL_LENGTHS.base[lengthCode] + bits.read(LITERAL_LENGTHS.bits[lengthCode]);
    if (i + 1 < count) {
      lengthState = lengths.base[lengthState] + bits.read(lengths.bits[lengthState]);
      matchState = matches.base[matchState] + bits.read(matches.bits[matchState]);
      offsetState = offsets.base[offsetState] + bits.read(offsets.bits[offsetState]);
    }
    if (bits.left < 0 || used + length > literals.length) badFrame("sequences are cut");
    append(frame, literals.subarray(used, used + length));
    used += length;
    copyMatch(frame, nextOffset(frame.offsets, offsetValue, length), match);
  }
  if (bits.left !== 0) badFrame("bits after the last sequence");
  return used;
}

/**
 * RFC 8878 §3.1.1.5: offset values 1 to 3 name recent offsets.
 * @param {number[]} recent (3), changed
 * @param {number} value
 * @param {number} literalLength
 */
function nextOffset(recent, value, literalLength) {
  const which = value > 3 ? 3 : value - 1 + (literalLength === 0 ? 1 : 0);
  const offset = value > 3 ? value - 3 : which === 3 ? recent[0] - 1 : recent[which];
  if (which > 1) recent[2] = recent[1];
  if (which > 0) recent[1] = recent[0];
  recent[0] = offset;
  return offset;
}

/**
 * @param {Frame} frame
 * @param {number} offset
 * @param {number} length
 */
function copyMatch(frame, offset, length) {
  const { out, filled } = frame;
  if (offset < 1 || offset > filled) badFrame("an offset before the start of the content");
  if (filled + length > out.length) badFrame("more bytes than the frame states");
  if (offset >= length) out.copyWithin(filled, filled - offset, filled - offset + length);
  else for (let i = filled; i < filled + length; i++) out[i] = out[i - offset];
  frame.filled = filled + length;
}
